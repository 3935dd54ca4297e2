"""The finer map where a compact light casts a baked shadow: it only sharpens, ends without a seam, and both back ends
read it."""

from __future__ import annotations

import numpy as np
import pytest
from test_gl import POSES, back_picture, both, camera_named, compare_products, needs_gl

import fastibl


def sun(size: int = 128, elevation: float = 0.7, azimuth: float = 0.4, strength: float = 2e4) -> fastibl.CubeMap:
    d = fastibl.texel_directions(size)
    axis = np.float32([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    faces = np.full((6, size, size, 3), (0.3, 0.4, 0.6), np.float32)
    faces[d @ axis > np.cos(np.radians(0.8))] += np.float32(strength) * np.float32([1, 0.9, 0.7])
    return fastibl.CubeMap(faces)


def block(height: float = 0.2) -> fastibl.Mesh:
    x, y, z = np.meshgrid([-0.04, 0.04], [-0.03, 0.03], [0, height], indexing="ij")
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return fastibl.Mesh(vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


def rays(cube: fastibl.CubeMap, mesh: fastibl.Mesh, points: np.ndarray) -> np.ndarray:
    """The ratio by rays to the pieces of all texels of the sun, and by the rest of the sky as a constant."""
    size = cube.size
    d = fastibl.texel_directions(size).reshape(-1, 3)
    faces = cube.faces.reshape(-1, 3)
    angle = (2 / size) ** 2 * np.abs(d).max(axis=1) ** 3
    flux = faces * (angle * np.maximum(d[:, 2], 0))[:, None]
    bright = np.flatnonzero(faces[:, 0] > 10)
    bvh = fastibl.Bvh(mesh)
    origins = np.pad(points, ((0, 0), (0, 1)), constant_values=1e-5).astype(np.float32)
    lost = np.zeros((len(points), 3))
    for i in bright:
        hit = bvh.occluded(origins, np.broadcast_to(d[i], origins.shape).astype(np.float32).copy())
        lost += hit[:, None] * flux[i]
    return lost / flux.sum(axis=0)


@pytest.mark.parametrize("turn", [0.0, 0.8])
def test_fine_map_has_the_sharp_shadow_and_the_same_soft_one(turn):
    cube, mesh = sun(strength=1e6), block()
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:2, 3] = 0.05, -0.02
    coarse = fastibl.MeshShadow(mesh, 64, cache=False, progress=False)
    fine = fastibl.MeshShadow(mesh, 64, cache=False, progress=False, fine=512)
    a, b = coarse.cast(cube, pose), fine.cast(cube, pose)
    assert a.fine is None and b.fine.shape == (512, 512, 3) and 0 <= b.fine.min() <= b.fine.max() <= 1
    np.testing.assert_array_equal(a.image, b.image)
    np.testing.assert_array_equal(a.outer, b.outer)
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (4000, 2)) * b.fine_extent + b.fine_centre
    there = (mesh.vertices @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
    lost = rays(cube, fastibl.Mesh(there, mesh.triangles), points)
    # What the sky leaves is smooth: the rest of the ratio must be that of the coarse map where the sun is not hidden.
    near = points.astype(np.float32)
    sharp, blurred = b.sample(near) + lost, a.sample(near) + lost
    smooth = np.median(sharp, axis=0)
    print(
        f"turn {turn}: spread around the smooth rest, fine {sharp.std(axis=0).max():.4f}, "
        f"coarse {blurred.std(axis=0).max():.4f}"
    )
    assert sharp.std(axis=0).max() < 0.5 * blurred.std(axis=0).max()
    assert np.abs(smooth - np.median(blurred, axis=0)).max() < 0.01


def test_fine_map_ends_without_a_seam():
    shadow = fastibl.MeshShadow(block(), 64, cache=False, progress=False, fine=512).cast(sun())
    for sign in (-1, 1):
        for axis in (0, 1):
            along = np.linspace(-0.999, 0.999, 801) * shadow.fine_extent
            points = np.zeros((801, 2))
            points[:, 1 - axis] = along
            sides = []
            for side in (0.9999, 1.0001):
                points[:, axis] = sign * side * shadow.fine_extent
                sides.append(shadow.sample((points + shadow.fine_centre).astype(np.float32)))
            step = np.abs(sides[0] - sides[1]).max()
            assert step < 2e-3, (sign, axis, step)


def test_no_fine_map_without_a_compact_light():
    mesh = block()
    even = fastibl.CubeMap(np.ones((6, 64, 64, 3), np.float32))
    for cube in (even, fastibl.CubeMap(np.zeros((6, 64, 64, 3), np.float32)), sun(strength=5)):
        assert fastibl.MeshShadow(mesh, 64, cache=False, progress=False, fine=256).cast(cube).fine is None
    with pytest.raises(ValueError, match="fine"):
        fastibl.MeshShadow(mesh, 64, cache=False, progress=False, fine=5)


def test_light_that_changes_keeps_the_fine_map_steady():
    shadow = fastibl.MeshShadow(block(), 64, cache=False, progress=False, fine=256)
    cube = sun()
    first = shadow.cast(cube, follow=True)
    faces = cube.faces.copy()
    faces[4] *= 1.02
    then = shadow.cast(fastibl.CubeMap(faces), follow=True)
    assert then.fine_extent == first.fine_extent and then.fine_centre == first.fine_centre
    change = np.abs(then.fine - first.fine).max()
    print(f"largest change {change:.4f}")
    assert 0 < change < 0.02


@needs_gl
@pytest.mark.parametrize("pose", ["usual", "near"])
def test_both_back_ends_read_the_fine_map(pose):
    scene, camera = fastibl.Scene(block(0.05), spheres=20), camera_named("pinhole")
    frame = fastibl.Frame(time=0.0, back=back_picture(camera), back_from_marker=POSES[pose])
    methods = {"shadow": fastibl.Method("mesh", fine=512)}
    made = both(scene, camera, sun(), frame, methods)
    assert all(result.shadow_map.fine is not None for _, result in made)
    assert compare_products(made, frame.back).sum() > 1000
