"""Baked shadows of meshes: against rays, at the extremes, and on disk."""

import io
import os
import subprocess
import sys
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

import fastibl
import fastibl.mesh_shadow as module
from conftest import same_error
from fastibl import MeshShadow, reference

GRID = 16


@pytest.fixture(autouse=True)
def cache_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("FASTIBL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def box(lower, upper):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    lower, upper = np.array(lower, np.float64), np.array(upper, np.float64)
    return fastibl.Mesh(lower + corners * (upper - lower), np.array(triangles, np.int32))


def table():
    """A table of one leg: the shadow has an overhang, and contact."""
    top, leg = box((-0.3, -0.2, 0.4), (0.3, 0.2, 0.5)), box((-0.05, -0.05, 0), (0.05, 0.05, 0.4))
    return fastibl.Mesh(
        np.concatenate([top.vertices, leg.vertices]), np.concatenate([top.triangles, leg.triangles + 8])
    )


def turned(mesh, angle, shift=(0, 0)):
    c, s = np.cos(angle), np.sin(angle)
    v = np.asarray(mesh.vertices, np.float64) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return fastibl.Mesh(v + np.array([*shift, 0]), mesh.triangles)


def pose(angle=0.0, shift=(0.0, 0.0, 0.0)):
    m = np.eye(4)
    m[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    m[:3, 3] = shift
    return m


def sky(seed=0, size=32, sigma=1.0):
    return fastibl.CubeMap(
        np.random.default_rng(seed).lognormal(sigma=sigma, size=(6, size, size, 3)).astype(np.float32)
    )


def lamp(direction, size=32, strength=1e4, colour=(1, 1, 1), ground=0.0):
    """One texel lit, on a grey sky."""
    faces = np.full((6, size, size, 3), ground, np.float32)
    d = reference.samples(faces)[0]
    k = int(np.argmax(d @ (np.array(direction) / np.linalg.norm(direction))))
    faces.reshape(-1, 3)[k] = np.float32(strength) * np.array(colour, np.float32)
    return fastibl.CubeMap(faces), d[k]


def centres(shadow, n):
    axis = ((np.arange(n) + 0.5) / n * 2 - 1) * shadow.extent
    return np.stack(np.meshgrid(axis, axis), axis=-1)


def error(shadow, cube, mesh, n):
    points = centres(shadow, n)
    off = shadow.cast(cube).image - reference.shadow_ratio(cube, mesh, points)
    return float(np.sqrt((off**2).mean())), float(np.abs(off).max())


@pytest.mark.parametrize(
    ("name", "make", "split", "rms", "worst"),
    [
        ("smooth", lambda: sky(0, sigma=0.5), 4, 0.002, 0.01),
        ("rough", lambda: sky(1, sigma=2.0), 4, 0.009, 0.04),
        ("one lamp", lambda: lamp((1, 0.5, 1.5), ground=0.1)[0], 8, 0.006, 0.04),
        ("two lamps", lambda: fastibl.CubeMap(lamp((1, 0, 1))[0].faces + lamp((-1, 0.3, 2))[0].faces), 8, 0.006, 0.04),
        ("white", lambda: fastibl.CubeMap(np.ones((6, 32, 32, 3), np.float32)), 4, 0.002, 0.01),
    ],
)
def test_ratio_is_that_of_rays(name, make, split, rms, worst):
    mesh, cube = table(), make()
    shadow = MeshShadow(mesh, GRID, cache=False)
    # A texel is an area for the library, and a direction for a ray: rays need smaller ones.
    fine = fastibl.CubeMap(np.repeat(np.repeat(cube.faces, split, axis=1), split, axis=2))
    near = slice(4, 12)
    off = shadow.cast(cube).image[near, near] - reference.shadow_ratio(fine, mesh, centres(shadow, GRID)[near, near])
    print(f"{name}: RMS {np.sqrt((off**2).mean()):.4f}, worst {np.abs(off).max():.4f}")
    assert np.sqrt((off**2).mean()) < rms and np.abs(off).max() < worst


def test_far_shadow_is_in_the_outer_map():
    """A low lamp: the shadow reaches beyond the fine map."""
    mesh = box((-0.2, -0.2, 0), (0.2, 0.2, 1.0))
    cube, d = lamp((1, 0, 0.25), size=128, ground=0.01)
    shadow = MeshShadow(mesh, 128, cache=False)
    x = np.linspace(-3.9, -1.6, 12)
    points = np.stack([x, np.zeros(12)], axis=-1)
    made, true = shadow.ratio(cube, points), reference.shadow_ratio(cube, mesh, points)
    print(f"far: worst {np.abs(made - true).max():.3f} within {shadow.extent * 6} m")
    assert np.abs(x).min() > shadow.extent and true.min() < 0.1
    assert np.sqrt(((made - true) ** 2).mean()) < 0.1
    assert (shadow.ratio(cube, [[0.0, 6.1 * shadow.extent], [1e6, 0.0]]) == 1).all()


def ball(n=120):
    """2 n² small triangles."""
    u, v = np.meshgrid(np.arange(n + 1) / n * 2 * np.pi, np.arange(n + 1) / n * np.pi, indexing="ij")
    vertices = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), 1 - np.cos(v)], -1).reshape(-1, 3) / 4
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1], -1)
    return fastibl.Mesh(vertices, quads.reshape(-1, 3))


def poles(n=40):
    """Three thin ones of many triangles, that a coarser mesh would lose."""
    u, z = np.meshgrid(np.arange(n + 1) / n * 2 * np.pi, np.linspace(0, 0.5, n + 1), indexing="ij")
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack([a, a + n + 1, a + n + 2, a, a + n + 2, a + 1], -1).reshape(-1, 3)
    each = [np.stack([x + 0.005 * np.cos(u), y + 0.005 * np.sin(u), z], -1) for x, y in ((0, 0), (0.1, 0), (0, 0.1))]
    faces = [quads + k * u.size for k in range(3)]
    return fastibl.Mesh(np.concatenate([e.reshape(-1, 3) for e in each]), np.concatenate(faces))


@pytest.mark.parametrize("make", [ball, poles])
def test_outer_map_of_many_triangles(make):
    """Drawn coarser where the outer map's texels do not tell triangles apart, and not where thin parts would vanish."""
    mesh, cube = make(), sky(7, size=16, sigma=2.0)
    shadow = MeshShadow(mesh, 64, cache=False)
    d, angles, radiance = reference.samples(cube.faces.astype(np.float64))
    up = d[:, 2] > 0
    light = (angles * d[:, 2])[up, None] * radiance[up]
    places = np.random.default_rng(0).uniform(-2, 2, (800, 2))
    places = places[np.abs(places).max(axis=1) > shadow.extent]
    origins = np.repeat(np.pad(places, ((0, 0), (0, 1)), constant_values=1e-6), up.sum(), axis=0)
    towards = np.tile(d[up], (len(places), 1))
    met = fastibl.Bvh(mesh).occluded(origins.astype(np.float32), towards.astype(np.float32)).reshape(len(places), -1)
    true = 1 - met @ light / light.sum(axis=0)
    off = shadow.ratio(cube, places) - true
    print(f"{len(mesh.triangles)} triangles: {(1 - true).mean():.4f} lost, {off.mean():+.5f} of it not found,", end=" ")
    print(f"RMS {np.sqrt((off**2).mean()):.4f}")
    assert abs(off.mean()) < 0.1 * (1 - true).mean() and np.sqrt((off**2).mean()) < 0.01


def test_bits_are_those_of_rays():
    """One direction alone: every texel is lit or not, as a ray says."""
    mesh = fastibl.shapes.figurine(0.5)
    cube, direction = lamp((0.7, -0.4, 1.0), size=128)
    shadow = MeshShadow(mesh, 64, rings=1, samples=1, directions=1, cache=False)
    image = shadow.cast(cube).image
    points = centres(shadow, 64).reshape(-1, 2)
    origins = np.pad(points, ((0, 0), (0, 1)), constant_values=1e-6).astype(np.float32)
    hidden = fastibl.Bvh(mesh).occluded(origins, np.broadcast_to(direction.astype(np.float32), origins.shape).copy())
    # All light but the 8 times mean that stays in the rest, which is less than a thousandth.
    assert (np.minimum(image, 1 - image) < 1e-3).all()
    different = int((hidden.reshape(64, 64) != (image[..., 0] < 0.5)).sum())
    print(f"{different} of {hidden.size} texels differ, {hidden.sum()} in shadow")
    assert different <= 4


def test_far_from_the_object_is_exactly_lit_and_under_it_exactly_dark():
    mesh = box((-0.1, -0.1, 0), (0.1, 0.1, 0.2))
    shadow = MeshShadow(mesh, 64, extent=2.0, cache=False)
    image = shadow.cast(lamp((0, 0, 1), ground=0)[0]).image
    assert (image[0] == 1).all() and (image[:, 0] == 1).all()
    for cube in (sky(3), lamp((1, 1, 1), ground=0.2)[0], fastibl.CubeMap(np.full((6, 8, 8, 3), 1e9, np.float32))):
        middle = shadow.cast(cube).image[31:33, 31:33]
        assert (middle == 0).all(), middle


def test_huge_object_covers_all():
    shadow = MeshShadow(box((-1e4, -1e4, 0), (1e4, 1e4, 1e4)), 16, extent=1.0, cache=False)
    assert (shadow.cast(sky(4, sigma=2)).image == 0).all()


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_scale_does_not_matter(scale):
    mesh = table()
    large = fastibl.Mesh(np.asarray(mesh.vertices, np.float64) * scale, mesh.triangles)
    a = MeshShadow(mesh, GRID, cache=False).cast(sky(5))
    b = MeshShadow(large, GRID, cache=False).cast(sky(5))
    assert np.abs(a.image - b.image).max() < 0.07  # a texel's centre on an edge may fall to either side
    assert np.sqrt(((a.image - b.image) ** 2).mean()) < 2e-3


def test_below_the_plane_casts_no_shadow():
    shadow = MeshShadow(box((-0.2, -0.2, -0.5), (0.2, 0.2, -0.1)), GRID, cache=False)
    assert (shadow.cast(sky(6)).image == 1).all()
    whole = MeshShadow(box((-0.2, -0.2, -1.5), (0.2, 0.2, 0.5)), 32, extent=1.0, cache=False)
    upper = MeshShadow(box((-0.2, -0.2, 0), (0.2, 0.2, 0.5)), 32, extent=1.0, cache=False)
    assert np.abs(whole.cast(sky(6)).image - upper.cast(sky(6)).image).max() == 0


def test_bad_meshes_and_options():
    with pytest.raises(ValueError, match="vert|triangle"):
        MeshShadow(fastibl.Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)))
    point = fastibl.Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))
    assert (MeshShadow(point, GRID, cache=False).cast(sky()).image == 1).all()
    for options in (
        {"resolution": 4},
        {"resolution": 5000},
        {"rings": 0},
        {"samples": 64},
        {"samples": 0},
        {"extent": -1.0},
        {"extent": np.nan},
        {"directions": -1},
    ):
        with pytest.raises(ValueError, match="got"):
            MeshShadow(table(), cache=False, **options)
    with pytest.raises(TypeError):
        MeshShadow("spot.obj")


def test_needles_and_slivers_are_finite():
    rng = np.random.default_rng(0)
    v = rng.normal(size=(300, 3)) * [1, 1e-4, 1]
    v[:50] *= 1e5
    mesh = fastibl.Mesh(v, rng.integers(0, 300, (400, 3)).astype(np.int32))
    image = MeshShadow(mesh, 33, extent=1.5, samples=4, cache=False).cast(sky(7, sigma=2)).image
    assert np.isfinite(image).all() and (image >= 0).all() and (image <= 1).all()


def test_no_light():
    shadow = MeshShadow(table(), GRID, cache=False)
    below = np.zeros((6, 16, 16, 3), np.float32)
    below[5] = 5
    for cube in (fastibl.CubeMap(np.zeros((6, 16, 16, 3), np.float32)), fastibl.CubeMap(below)):
        made = shadow.cast(cube)
        assert made.no_light and (made.image == 1).all()
        assert (shadow.ratio(cube, np.zeros((2, 2))) == 1).all()


def test_dark_channel_and_bad_radiance():
    shadow = MeshShadow(table(), GRID, cache=False)
    faces = sky(8).faces.copy()
    faces[..., 1] = 0
    assert (shadow.cast(fastibl.CubeMap(faces)).image[..., 1] == 1).all()
    faces[4, 3, 3] = np.nan, np.inf, -1
    image = shadow.cast(fastibl.CubeMap(faces)).image
    assert np.isfinite(image).all() and (image >= 0).all() and (image <= 1).all()
    tiny = fastibl.CubeMap(sky(8).faces * np.float32(1e-30))
    assert np.abs(shadow.cast(tiny).image - shadow.cast(sky(8)).image).max() < 1e-3


@pytest.mark.parametrize("size", [1, 2, 3, 7, 100])
def test_maps_of_any_size(size):
    white = fastibl.CubeMap(np.ones((6, size, size, 3), np.float32))
    shadow = MeshShadow(table(), GRID, cache=False)
    rms, worst = 0, 0
    off = shadow.cast(white).image - shadow.cast(fastibl.CubeMap(np.ones((6, 64, 64, 3), np.float32))).image
    rms, worst = float(np.sqrt((off**2).mean())), float(np.abs(off).max())
    print(f"white map of {size}: RMS {rms:.5f}, worst {worst:.5f}")
    assert rms < 2e-3 and worst < 0.02


def test_sun_in_one_texel():
    mesh = table()
    shadow = MeshShadow(mesh, 64, cache=False)
    cube, direction = lamp((1, 0.4, 0.9), size=128, strength=1e6, ground=0.3)
    fine = shadow.cast(cube).image
    points = centres(shadow, 64)
    off = fine - reference.shadow_ratio(cube, mesh, points)
    print(f"sun: RMS {np.sqrt((off**2).mean()):.4f}, beyond an edge {np.quantile(np.abs(off), 0.98):.4f}")
    # The truth here has one direction for a texel that is half a degree wide.
    assert np.sqrt((off**2).mean()) < 0.06 and np.quantile(np.abs(off), 0.97) < 0.02


def test_red_and_blue_lamps():
    mesh = table()
    red, _ = lamp((1, 0.2, 1), colour=(1, 0, 0))
    blue, _ = lamp((-0.6, 1, 1.2), colour=(0, 0, 0.02))
    cube = fastibl.CubeMap(red.faces + blue.faces)
    shadow = MeshShadow(mesh, 32, cache=False)
    image = shadow.cast(cube).image
    # Each channel as if its lamp were alone.
    for channel, alone in ((0, red), (2, blue)):
        off = np.abs(image[..., channel] - shadow.cast(alone).image[..., channel])
        print(f"channel {channel}: worst {off.max():.4f}, RMS {np.sqrt((off**2).mean()):.4f}")
        assert np.sqrt((off**2).mean()) < 0.01
    assert (image[..., 1] == 1).all()


def test_same_bits_for_any_number_of_threads():
    results = []
    try:
        for count in (1, 2, 3):
            fastibl.set_threads(count)
            results.append(MeshShadow(table(), 40, samples=7, cache=False).cast(sky(9, sigma=2)).image.tobytes())
    finally:
        fastibl.set_threads(0)
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize("angle", [0.3, np.pi / 2, -2.5])
def test_turned_object_needs_no_new_bake(angle):
    mesh, shift = table(), (0.7, -0.4)
    cube = fastibl.CubeMap(sky(10, sigma=0.7).faces + lamp((1, 0.2, 1.2), strength=300)[0].faces)
    shadow = MeshShadow(mesh, 128, cache=False)
    moved = shadow.cast(cube, pose(angle, (*shift, 0)))
    again = MeshShadow(turned(mesh, angle, shift), 128, extent=shadow.extent, cache=False).cast(cube)
    inner = centres(shadow, 64) * 0.6 + np.array(shift)
    off = moved.sample(inner) - again.sample(inner)
    print(f"turned by {angle:.2f}: RMS {np.sqrt((off**2).mean()):.4f}, worst {np.abs(off).max():.4f}")
    assert np.allclose(moved.centre, shift, atol=1e-6)
    # Both are bilinear between texels, which lie elsewhere: edges differ.
    assert np.sqrt((off**2).mean()) < 0.012 and np.abs(off).max() < 0.25


def test_an_object_beside_its_origin_turns_around_it():
    mesh, angle, shift = turned(table(), 0.0, (1.5, 0.6)), 2.0, (0.7, -0.4)
    cube = fastibl.CubeMap(sky(10, sigma=0.7).faces + lamp((1, 0.2, 1.2), strength=300)[0].faces)
    shadow = MeshShadow(mesh, 64, cache=False)
    moved = shadow.cast(cube, pose(angle, (*shift, 0)))
    again = MeshShadow(turned(mesh, angle, shift), 64, extent=shadow.extent, cache=False).cast(cube)
    points = again.centre + again.extent * np.random.default_rng(0).uniform(-0.6, 0.6, (500, 2))
    off = moved.sample(points) - again.sample(points)
    print(f"beside its origin: RMS {np.sqrt((off**2).mean()):.4f}, darkest {again.sample(points).min():.3f}")
    assert np.sqrt((off**2).mean()) < 0.02 and again.sample(points).min() < 0.5


def test_shifted_object_is_the_same_image():
    shadow, cube = MeshShadow(table(), GRID, cache=False), sky(11, sigma=2)
    a, b = shadow.cast(cube), shadow.cast(cube, pose(0, (3.0, -2.0, 0)))
    assert np.array_equal(a.image, b.image) and b.centre == (3.0, -2.0)


def test_tilted_or_lifted_object_is_refused():
    shadow = MeshShadow(table(), GRID, cache=False)
    tilted = np.eye(4)
    tilted[:3, :3] = [[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)], [0, np.sin(0.1), np.cos(0.1)]]
    over = np.diag([1.0, -1, -1, 1])
    for bad in (tilted, over, pose(0, (0, 0, 0.01))):
        assert not shadow.fits(bad)
        with pytest.raises(ValueError, match="tilted"):
            shadow.cast(sky(), bad)
    assert shadow.fits(np.eye(4)) and shadow.fits(pose(1.0, (1, 1, 0)))


def test_following_keeps_directions_and_does_not_flicker():
    shadow = MeshShadow(table(), 32, cache=False)
    base = sky(12, sigma=0.5).faces + lamp((1, 0.5, 1.5), strength=500)[0].faces
    before, truth_before = None, None
    worst = 0.0
    for k in range(10):
        cube = fastibl.CubeMap(base * (1 + 0.02 * np.sin(k + np.arange(32)[:, None, None] / 10)).astype(np.float32))
        now, exact = shadow.cast(cube, follow=True).image, reference.shadow_ratio(cube, table(), centres(shadow, 32))
        if before is not None:
            worst = max(worst, float(np.sqrt((((now - before) - (exact - truth_before)) ** 2).mean())))
        before, truth_before = now, exact
    print(f"error of the change: RMS {worst:.5f}")
    assert worst < 5e-4
    # Another light altogether: directions are chosen anew.
    other = lamp((-1, -1, 1), strength=1e5)[0]
    assert np.abs(shadow.cast(other, follow=True).image - shadow.cast(other).image).max() < 1e-6


def test_following_without_a_change_is_the_same_bits():
    shadow, cube = MeshShadow(table(), GRID, cache=False), sky(13, sigma=2)
    first = shadow.cast(cube, follow=True).image.tobytes()
    assert first == shadow.cast(cube, follow=True).image.tobytes() == shadow.cast(cube).image.tobytes()


# In a scene


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_session_casts_the_baked_shadow(backend):
    if backend == "gl" and not fastibl._fastibl.with_gl:
        pytest.skip("built without GL")
    mesh, cube = table(), sky(16, sigma=0.7)
    camera = fastibl.Camera(96, 64, 80, 80, 48, 32)
    looking = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 3], [0, 0, 0, 1]])

    def cast(scene):
        session = fastibl.Session(
            scene, fastibl.Rig(camera), environment=cube, methods={"shadow": "mesh"}, backend=backend
        )
        return session.process(fastibl.Frame(time=0.0, back=None, back_from_marker=looking)).shadow_map

    scene = fastibl.Scene(mesh, marker_from_object=pose(0.4, (0.1, 0.2, 0)))
    assert scene.baked_shadow is None and cast(scene).image.shape == (128, 128, 3)
    same_error(lambda: setattr(scene, "baked_shadow", 3), TypeError, "MeshShadow or None, got int")
    assert scene.baked_shadow is not None  # a session bakes what it needs
    scene.baked_shadow = MeshShadow(mesh, 32, cache=False)
    made, alone = cast(scene), MeshShadow(mesh, 32, cache=False).cast(cube, scene.marker_from_object)
    assert made.image.shape == (32, 32, 3) and np.allclose(made.centre, alone.centre)
    assert np.abs(made.image - alone.image).mean() < 0.02  # the session's map has a plane below it
    tilted = np.eye(4)
    tilted[1:3, 1:3] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    leaning = fastibl.Scene(mesh, marker_from_object=tilted)
    leaning.baked_shadow = MeshShadow(mesh, 32, cache=False)
    assert (cast(leaning).image < 0.9).any()  # of its triangles


LEANING = {
    "a plate, lifted": (lambda: box((-0.2, -0.2, 0), (0.2, 0.2, 0.008)), (0, 0, 0), (0.3, -0.2, 0.05)),
    "a plate on its edge": (lambda: box((-0.2, -0.2, 0), (0.2, 0.2, 0.008)), (1.2, 0.3, 0), (0, 0, 0.19)),
    "a table, tilted into the plane": (table, (0.4, -0.2, 0.5), (0, 0.1, -0.05)),
    "a sheet, lifted": (lambda: fastibl.Mesh(box((-0.2, -0.2, 0), (0.2, 0.2, 1)).vertices[::2], [[0, 1, 3], [0, 3, 2]]),
                        (0.3, 0, 0), (0, 0, 0.1)),
}  # fmt: skip


@pytest.mark.parametrize("backend", ["cpu", "gl"])
@pytest.mark.parametrize("method", ["mesh", "directions"])
@pytest.mark.parametrize("name", LEANING)
def test_an_object_that_does_not_stand_casts_its_own_shadow(name, method, backend):
    """Its spheres leave a third of a plate uncovered."""
    if backend == "gl" and not fastibl._fastibl.with_gl:
        pytest.skip("built without GL")
    make, turn, shift = LEANING[name]
    mesh, cube = make(), sky(3)
    place = fastibl.Pose.from_rotation_vector(np.array(turn, float), np.array(shift, float))
    looking = fastibl.Pose.look_at((1.0, -1.0, 1.0), (0, 0, 0))
    scene = fastibl.Scene(mesh, spheres=50)
    scene.baked_shadow = MeshShadow(mesh, 64, cache=False)
    session = fastibl.Session(
        scene,
        fastibl.Rig(fastibl.Camera(80, 60, 60.0, 60.0, 40.0, 30.0)),
        environment=cube,
        methods={"shadow": method, "bounce": "none"},
        backend=backend,
    )
    session.process(fastibl.Frame(0.0, back_from_marker=looking))
    session.move(place)
    session.process(fastibl.Frame(0.1, back_from_marker=looking))
    shadow, (x, y) = session.shadow_map, np.meshgrid(*[np.linspace(-0.5, 0.5, 24)] * 2)
    points = np.stack([x + shift[0], y + shift[1]], -1).reshape(-1, 2)
    moved = fastibl.Mesh(mesh.vertices @ place.rotation.T + place.translation, mesh.triangles)
    off = shadow.sample(points.astype(np.float32)) - reference.shadow_ratio(cube, moved, points)
    rms = np.sqrt((off**2).mean())
    print(f"{name}, {method}, {backend}: RMS {rms:.4f}, largest {np.abs(off).max():.3f}")
    assert rms < 0.015 and np.quantile(np.abs(off), 0.99) < 0.05


def test_an_object_of_many_triangles_does_not_lose_its_shadow_where_it_is_lifted():
    """40 000 triangles of a thin plate: drawn coarser, and by 32 directions."""
    n = 100
    u, v = np.meshgrid(np.linspace(-0.2, 0.2, n + 1), np.linspace(-0.2, 0.2, n + 1))
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (k.ravel() for k in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    faces = np.concatenate([np.stack(t, -1) for t in ((a, b, c), (a, c, d))])
    levels = [np.stack([u.ravel(), v.ravel(), np.full(u.size, z)], -1) for z in (0.0, 0.004)]
    mesh = fastibl.Mesh(np.concatenate(levels), np.concatenate([faces[:, ::-1], faces + u.size]))
    cube, place = sky(3), fastibl.Pose.from_rotation_vector(np.array([0.5, 0, 0]), np.array([0, 0, 0.15]))
    scene = fastibl.Scene(mesh, spheres=20, visibility_rays=0, marker_from_object=place)
    camera = fastibl.Camera(80, 60, 60.0, 60.0, 40.0, 30.0)
    session = fastibl.Session(scene, fastibl.Rig(camera), environment=cube, methods={"shadow": "mesh"})
    session.process(fastibl.Frame(0.0, back_from_marker=fastibl.Pose.look_at((1.0, -1.0, 1.0), (0, 0, 0))))
    points = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 20)] * 2), -1).reshape(-1, 2)
    thin = box((-0.2, -0.2, 0), (0.2, 0.2, 0.004))
    moved = fastibl.Mesh(thin.vertices @ place.rotation.T + place.translation, thin.triangles)
    off = session.shadow_map.sample(points.astype(np.float32)) - reference.shadow_ratio(cube, moved, points)
    print(f"RMS {np.sqrt((off**2).mean()):.4f}, largest {np.abs(off).max():.3f}")
    assert np.sqrt((off**2).mean()) < 0.03


# On disk


def files(folder):
    return sorted(folder.glob("shadow-*"))


def test_kept_on_disk(cache_folder, monkeypatch):
    mesh, cube = table(), sky(14)
    first = MeshShadow(mesh, GRID).cast(cube).image
    (path,) = files(cache_folder)
    monkeypatch.setattr("fastibl.mesh_shadow.BakedShadow.bake", None, raising=False)

    def no_bake(*_):
        raise AssertionError("baked although it was kept")

    monkeypatch.setattr(module, "_baked", no_bake)
    assert np.array_equal(MeshShadow(mesh, GRID).cast(cube).image, first)
    for other in (
        lambda: MeshShadow(mesh, GRID + 4),
        lambda: MeshShadow(mesh, GRID, samples=3),
        lambda: MeshShadow(turned(mesh, 0.1), GRID),
    ):
        with pytest.raises(AssertionError, match="baked"):
            other()
    assert files(cache_folder) == [path]


@pytest.mark.parametrize("damage", ["truncated", "empty", "noise", "flipped", "another", "missing array", "claims"])
def test_broken_file_is_made_anew(cache_folder, damage):
    mesh, cube = table(), sky(15)
    first = MeshShadow(mesh, GRID).cast(cube).image
    (path,) = files(cache_folder)
    content = path.read_bytes()
    if damage == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "empty":
        path.write_bytes(b"")
    elif damage == "noise":
        path.write_bytes(np.random.default_rng(0).bytes(len(content)))
    elif damage == "flipped":
        changed = bytearray(content)
        changed[len(content) // 2] ^= 0xFF
        path.write_bytes(bytes(changed))
    elif damage == "another":
        np.savez(
            path, begin=np.zeros(3, np.uint32), source_of=np.zeros(9, np.uint16), cover=np.zeros((9, 16), np.uint8)
        )
    elif damage == "claims":  # more than there is memory for
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "<i4", "fortran_order": False, "shape": (10**15,)})
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("begin.npy", header.getvalue())
    else:
        with np.load(path) as file:
            np.savez(path, begin=file["begin"])
    with pytest.warns(RuntimeWarning, match="made anew"):
        shadow = MeshShadow(mesh, GRID)
    assert np.array_equal(shadow.cast(cube).image, first)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MeshShadow(mesh, GRID)


def test_table_of_another_object_is_refused():
    from fastibl._fastibl import BakedShadow

    baked = BakedShadow.bake(table(), GRID, 0, 4, 1)
    begin, cells, cover, run_begin, runs, *outer = baked.tables
    assert len(cells) and len(runs)
    assert BakedShadow.from_tables(table(), GRID, 0, 4, 1, baked.tables).bytes == baked.bytes
    wrong, wrong_run = begin.copy(), run_begin.copy()
    wrong[1] = wrong_run[1] = 60000
    for bad in (
        (begin[:-1], cells, cover, run_begin, runs),
        (wrong, cells, cover, run_begin, runs),
        (begin, cells[:-1], cover, run_begin, runs),
        (begin, cells, cover[:, :8], run_begin, runs),
        (begin, cells, cover[: len(cover) // 2 * 2].reshape(-1, 32), run_begin, runs),
        (begin, cells, cover, run_begin, runs[: len(runs) // 2 * 2].reshape(-1, 4)),
        (begin, np.full_like(cells, 64), cover, run_begin, runs),
        (begin.astype(np.int64), cells, cover, run_begin, runs),
        (begin, cells, cover, run_begin[:-1], runs),
        (begin, cells, cover, wrong_run, runs),
        (begin, cells, cover, run_begin, runs[:-1]),
        (begin, cells, cover, run_begin, runs[:, ::-1]),
        (begin, cells, cover, run_begin, np.full_like(runs, 65)),
        (begin, cells, cover, run_begin, runs[:, 0]),
        (begin, cells, cover),
    ):
        with pytest.raises(ValueError, match="expected"):
            BakedShadow.from_tables(table(), GRID, 0, 4, 3, [*bad, *outer])
    with pytest.raises(ValueError, match="expected"):
        BakedShadow.from_tables(table(), 2 * GRID, 0, 4, 3, baked.tables)


def test_no_cache_when_turned_off(cache_folder, monkeypatch):
    MeshShadow(table(), GRID, cache=False)
    monkeypatch.setenv("FASTIBL_CACHE", "0")
    MeshShadow(table(), GRID)
    assert not cache_folder.exists()


def test_without_a_home_nothing_is_kept(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("FASTIBL_CACHE", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, as its specification says
    assert module.cache_folder() is None
    MeshShadow(table(), GRID)
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert module.cache_folder() == Path("/somewhere/fastibl")


def test_folder_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FASTIBL_CACHE", str(tmp_path / "file" / "inside"))
    with pytest.warns(RuntimeWarning, match="could not be kept"):
        MeshShadow(table(), GRID)


def test_cache_stays_small(cache_folder, monkeypatch):
    monkeypatch.setattr("fastibl.mesh_shadow._MOST_BYTES", 1)
    for k in range(3):
        MeshShadow(turned(table(), 0.1 * k), GRID)
    assert len(files(cache_folder)) == 1


def test_default_folder(monkeypatch, tmp_path):
    from fastibl.mesh_shadow import cache_folder as folder

    monkeypatch.delenv("FASTIBL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert folder() == tmp_path / "fastibl"
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert folder() == tmp_path / ".cache" / "fastibl"


def test_progress_is_reported_and_can_end_the_work(cache_folder):
    seen = []
    MeshShadow(table(), GRID, cache=False, progress=lambda done: not seen.append(done))
    assert seen[0] == 0 and seen[-1] == 1 and seen == sorted(seen)
    with pytest.raises(KeyboardInterrupt):
        MeshShadow(table(), GRID, progress=lambda done: done < 0.3)
    with pytest.raises(ZeroDivisionError):
        MeshShadow(table(), GRID, progress=lambda done: 1 / 0)
    assert not cache_folder.exists()


def test_nothing_is_printed_without_a_terminal():
    code = "import fastibl; fastibl.MeshShadow(fastibl.shapes.figurine(), 256, cache=False)"
    made = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ), check=True
    )
    assert made.stdout == "" and made.stderr == ""
