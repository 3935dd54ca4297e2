"""Self-shadow against a float64 oracle that asks every triangle about every ray, closed forms, and extremes."""

from functools import cache

import numpy as np
import pytest
from scenes import scene_of
from test_material import sphere
from test_occlusion import floor_and_wall, soup

import fastibl
from conftest import in_picture, same_error, units
from fastibl import _fastibl, reference
from fastibl.extremes.views import looking, rays_of

MATTE = fastibl.Material(diffuse=(0.8, 0.7, 0.6))


def smooth_map(seed=0, size=16):
    """A map of a few broad colours and a lamp."""
    d, _, _ = reference.samples(np.zeros((6, size, size, 3)))
    rng = np.random.default_rng(seed)
    radiance = 0.2 + sum(rng.random(3) * np.exp(3 * (d @ axis)[:, None] - 3) for axis in units(5, seed))
    radiance += (d @ units(1, seed + 1)[0] > 0.95)[:, None] * (8, 6, 3)
    return fastibl.CubeMap(radiance.reshape(6, size, size, 3))


def constant(value=1.0, size=8):
    return fastibl.CubeMap(np.full((6, size, size, 3), value))


def two_boxes(gap=0.02):
    """Two cubes with their own vertices on every face, beside each other: creases and a narrow slot."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * 0.05
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    points, triangles = [], []
    for shift in (0, 0.1 + gap):
        for quad in quads:
            k = len(points)
            points += [corners[i] * (1, 1, 1) + (shift, 0.3 * shift, 0.5 * shift) for i in quad]
            triangles += [[k, k + 1, k + 2], [k, k + 2, k + 3]]
    return fastibl.Mesh(np.array(points), triangles)


def free_rays(mesh, vertex, directions):
    """(n,) whether rays from just above a vertex meet no triangle."""
    corners = mesh.vertices.astype(float)
    normal = mesh.normals[vertex].astype(float)
    return free_from(mesh, corners[vertex] + 1e-4 * np.linalg.norm(np.ptp(corners, axis=0)) / 2 * normal, directions)


def free_from(mesh, origin, directions):
    """(n,) whether rays from a place meet no triangle: they pass on different sides of its edges."""
    a, b, c = np.moveaxis((mesh.vertices.astype(float) - origin)[mesh.triangles], 1, 0)
    sides = np.stack([directions @ np.cross(p, q).T for p, q in ((a, b), (b, c), (c, a))], -1)
    sides *= np.sign((a * np.cross(b, c)).sum(-1))[:, None]
    return ~(sides > 0).all(-1).any(-1)


def seen_of_boxes(eye, pose):
    """Of each pixel of LENS: its ray (h, w, 3), the triangle of BOXES that it meets, or -1, and how far away."""
    seen = rays_of(LENS, pose).reshape(LENS.height, LENS.width, 3)
    eyes = np.broadcast_to(eye, (seen.size // 3, 3)).astype(np.float32)
    triangle, t, _ = fastibl.Bvh(BOXES).nearest(eyes, seen.reshape(-1, 3).astype(np.float32))
    return seen, triangle.reshape(seen.shape[:2]), t.reshape(seen.shape[:2])


BOXES, SOUP = two_boxes(), soup(25, seed=3)


@cache
def oracle(mesh_name, split=2, size=16, turned=False):
    """Irradiance of each vertex (v, 3), with and without the mesh: every texel, cut, against every triangle."""
    mesh = {"boxes": BOXES, "soup": SOUP}[mesh_name]
    d, angles, radiance = reference.samples(smooth_map() if size == 16 else extreme("sun"), split)
    if turned:
        d = d @ np.asarray(TURN.matrix)[:3, :3]  # into the frame of the object
    shadowed, full = [], []
    for i, n in enumerate(mesh.normals.astype(float)):
        up = d @ n > 0
        weights = ((d[up] @ n) * angles[up])[:, None] * radiance[up]
        free = free_rays(mesh, i, d[up])
        shadowed.append(weights[free].sum(0)), full.append(weights.sum(0))
    return np.array(shadowed), np.array(full)


TURN = fastibl.Pose.from_rotation_vector(np.array([0.4, -0.9, 0.5]), np.zeros(3))


def relative(estimated, true):
    return np.sqrt(((estimated - true) ** 2).mean(-1)) / true.mean()


@pytest.mark.parametrize("name", ["boxes", "soup"])
@pytest.mark.parametrize(("size", "mean", "worst"), [(16, 0.03, 0.15), (32, 0.015, 0.08), (64, 0.008, 0.05)])
def test_against_brute_force(name, size, mean, worst):
    cube, mesh = smooth_map(), {"boxes": BOXES, "soup": SOUP}[name]
    true, full = oracle(name)
    shadow = fastibl.SelfShadow(mesh, size=size)
    light = fastibl.Lighting(cube, diffuse="irradiance-cube")
    error = relative(shadow.irradiance(light), true)
    paper = relative(light.irradiance(mesh.normals) * fastibl.ambient_occlusion(mesh)[:, None], true)
    print(f"{size} cells: mean {error.mean():.4f}, worst {error.max():.4f}; P_V: {paper.mean():.4f}, {paper.max():.4f}")
    assert error.mean() < mean and error.max() < worst
    assert error.mean() < 0.5 * paper.mean()
    assert np.abs(full - true).max() > 0.2 * true.mean()  # there is something to shadow


def test_a_turned_object_is_the_same_as_a_mesh_that_was_turned():
    rotation = np.asarray(TURN.matrix)[:3, :3]
    turned = fastibl.Mesh(BOXES.vertices @ rotation.T, BOXES.triangles)
    light = fastibl.Lighting(smooth_map(), diffuse="irradiance-cube")
    true, _ = oracle("boxes", turned=True)
    one = relative(fastibl.SelfShadow(BOXES).irradiance(light, TURN), true).mean()
    other = relative(fastibl.SelfShadow(turned).irradiance(light), true).mean()
    print(f"placed {one:.4f}, baked turned {other:.4f}")
    assert one < 0.005 and other < 0.005
    assert relative(fastibl.SelfShadow(BOXES).irradiance(light), true).mean() > 0.1  # not placed: another light


def test_a_wall_against_closed_forms():
    """A lamp behind the wall is hidden, one before it is not; a uniform sky gives the form factor."""
    mesh, x = floor_and_wall(False, 1.0)
    shadow = fastibl.SelfShadow(mesh)
    sky = shadow.shares(fastibl.Lighting(constant()))[4::3]
    expected = 1 - (1 - x / np.hypot(x, 1)) / 2
    print(f"uniform sky: largest error {np.abs(sky - expected[:, None]).max():.4f}")
    np.testing.assert_allclose(sky, np.repeat(expected[:, None], 3, 1), atol=0.012)
    d, _, _ = reference.samples(np.zeros((6, 64, 64, 3)))
    for direction, free in (([-1, 0.1, 0.5], x / 1 > 2.1), ([1, 0.1, 0.5], x > 0), ([-0.3, 0, 1], x > 0.31)):
        axis = np.array(direction) / np.linalg.norm(direction)
        lamp = np.where(d @ axis > np.cos(np.radians(1.5)), 100.0, 0.0)
        cube = fastibl.CubeMap(np.repeat(lamp.reshape(6, 64, 64, 1), 3, -1))
        shares = shadow.shares(fastibl.Lighting(cube, diffuse="irradiance-cube"))[4::3]
        clear = np.abs(x / (abs(direction[0]) / direction[2]) - 1) > 0.2  # 2.8 degrees from the edge of the shadow
        np.testing.assert_allclose(shares[clear], np.repeat(free[clear, None], 3, 1), atol=0.03)


def test_channels_have_shadows_of_their_own():
    """A blue lamp on the left and a red one on the right of the wall."""
    mesh, x = floor_and_wall(False, 1.0)
    d, _, _ = reference.samples(np.zeros((6, 32, 32, 3)))
    faces = np.zeros((len(d), 3))
    faces[d @ [-0.8, 0, 0.6] > 0.98] = (0, 0, 50)
    faces[d @ [0.8, 0, 0.6] > 0.98] = (50, 0, 0)
    shares = fastibl.SelfShadow(mesh).shares(fastibl.Lighting(fastibl.CubeMap(faces.reshape(6, 32, 32, 3))))[4::3]
    assert (shares[:3, 2] < 0.02).all() and (shares[:, 0] > 0.98).all()
    assert (shares[:, 1] == 1).all()  # no green light: nothing to keep away


@pytest.mark.parametrize("value", [1e-9, 1.0, 1e6])
def test_furnace(value):
    """A constant map gives P_V, in [0, 1], whatever it is."""
    mesh = soup(40, seed=5)
    truth = fastibl.ambient_occlusion(mesh, rays=4096)
    shares = fastibl.SelfShadow(mesh).shares(fastibl.Lighting(constant(value)))
    error = shares - truth[:, None]
    print(f"radiance {value}: RMS from P_V {np.sqrt((error**2).mean()):.4f}, worst {np.abs(error).max():.4f}")
    assert shares.min() >= 0 and shares.max() <= 1 and np.ptp(shares, axis=1).max() < 1e-5
    assert np.sqrt((error**2).mean()) < 0.006 and np.abs(error).max() < 0.03


def test_convex_objects_keep_nothing_from_themselves():
    box = fastibl.Mesh(BOXES.vertices[:24], BOXES.triangles[:12])
    shadow = fastibl.SelfShadow(box)
    assert (shadow.shares(fastibl.Lighting(smooth_map())) == 1).all()
    np.testing.assert_allclose(
        shadow.glossy_shares(fastibl.Lighting(smooth_map()), (0.0, 1.0, 1.0), 32.0), 1, atol=1e-6
    )


@pytest.mark.parametrize("diffuse", [m.name for m in fastibl.methods("diffuse")])
def test_every_diffuse_method_gives_shares(diffuse):
    shares = fastibl.SelfShadow(soup(20)).shares(fastibl.Lighting(smooth_map(), diffuse=diffuse))
    assert np.isfinite(shares).all() and shares.min() >= 0 and shares.max() <= 1 and shares.min() < 0.5


def extreme(name):
    faces = np.full((6, 64, 64, 3), 0.01)
    if name == "black":
        faces[:] = 0
    elif name == "sun":
        faces[4, 20, 30] = 1e6
    elif name == "cap":
        faces[2, 5, 5] = np.inf
    elif name == "nan":
        faces[1, ::3] = np.nan
        faces[0, ::3] = -5
    elif name == "only below":
        faces[:] = 0
        faces[5] = 3
    elif name == "one texel a face":
        return fastibl.CubeMap(np.arange(18.0).reshape(6, 1, 1, 3))
    elif name == "odd":
        return fastibl.CubeMap(np.random.default_rng(0).random((6, 37, 37, 3)))
    return fastibl.CubeMap(faces)


@pytest.mark.parametrize("name", ["black", "sun", "cap", "nan", "only below", "one texel a face", "odd"])
@pytest.mark.parametrize("diffuse", ["sh9-lobes", "irradiance-cube", "six-face"])
def test_extreme_maps(name, diffuse):
    mesh = soup(20)
    light = fastibl.Lighting(extreme(name), diffuse=diffuse)
    shadow = fastibl.SelfShadow(mesh)
    shares = shadow.shares(light)
    assert np.isfinite(shares).all() and shares.min() >= 0 and shares.max() <= 1
    assert np.isfinite(shadow.irradiance(light)).all()
    if name == "black":
        assert (shares == 1).all() and (shadow.irradiance(light) == 0).all()


def test_a_small_sun_is_there_or_not():
    """One texel of 1e6: vertices that see it keep nearly all of the light, the others lose nearly all."""
    mesh, cube = SOUP, extreme("sun")
    true, full = oracle("soup", 1, 64)
    shares = fastibl.SelfShadow(mesh).shares(fastibl.Lighting(cube, diffuse="irradiance-cube"))
    lit = full.mean(1) > 0.05 * full.mean()
    error = np.abs(shares - true / full).max(1)[lit]
    hidden = (true / full).max(1)[lit] < 0.1
    assert hidden.sum() > 5 and (~hidden).sum() > 5
    print(f"{lit.sum()} of {len(lit)} vertices face the sun; share of the light: worst error {np.sort(error)[-4:]}")
    assert np.median(error) < 0.02 and (error < 0.1).mean() > 0.9


def test_hostile_meshes():
    light = fastibl.Lighting(smooth_map())
    flat = fastibl.Mesh(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), [[0, 1, 2], [0, 2, 3]])
    assert (fastibl.SelfShadow(flat).shares(light) == 1).all()  # open: nothing above it
    nothing = fastibl.Mesh(np.zeros((4, 3)), [[0, 1, 2]])  # no area, and a vertex of no triangle
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    inwards = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    room = fastibl.Mesh(corners, [t for a, b, c, d in inwards for t in ((a, b, c), (a, c, d))])
    far = fastibl.Mesh(soup(10).vertices * 1e4 + 1e5, soup(10).triangles)
    tiny = fastibl.Mesh(soup(10).vertices * 1e-6, soup(10).triangles)
    for mesh in (nothing, room, far, tiny):
        shares = fastibl.SelfShadow(mesh, size=32).shares(light)
        assert shares.shape == (len(mesh.vertices), 3) and np.isfinite(shares).all()
        assert shares.min() >= 0 and shares.max() <= 1
    assert fastibl.SelfShadow(room).shares(light).max() < 0.004  # sealed: dark, but for the error of sh9-lobes
    # A vertex inside another part sees nothing.
    closed = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    inside = fastibl.Mesh(
        np.concatenate([corners, 0.5 + 0.1 * np.eye(3)]),
        [*(t for a, b, c, d in closed for t in ((a, b, c), (a, c, d))), [8, 9, 10]],
    )
    assert fastibl.SelfShadow(inside).shares(light)[8:].max() < 0.004


def test_visible_directions():
    mesh = SOUP
    directions = units(300, 4)
    got = fastibl.SelfShadow(mesh).visible(directions)
    normals = mesh.normals.astype(float)
    assert got.shape == (len(normals), 300) and got.dtype == bool
    agree = []
    for i, n in enumerate(normals):
        free = free_rays(mesh, i, directions)
        assert not got[i, directions @ n <= 0].any()
        agree.append((got[i] == free)[directions @ n > 0].mean())
    print(f"rays that agree with their cell: {np.mean(agree):.4f}")
    assert np.mean(agree) > 0.96


def test_spheres_stand_for_a_mesh_that_deforms():
    """One sphere over a floor hides the cap of the sky that it covers; spheres around a vertex do not hide it."""
    floor = fastibl.Mesh(np.array([[0, 0, 0], [1e-3, 0, 0], [0, 1e-3, 0.0]]), [[0, 1, 2]])
    light = fastibl.Lighting(constant())
    for radius, height in ((0.5, 1.0), (0.2, 1.0), (1.0, 3.0)):
        spheres = np.array([[0, 0, height, radius], [0, 0, 0, 0.4], [0, 0, -3, 1], [np.nan, 0, 1, 1], [0, 0, 1, -1]])
        for size, limit in ((16, 0.08), (64, 0.02)):  # straight above, whole rings of cells are in or out
            share = fastibl.SelfShadow.from_spheres(floor, spheres, size=size).shares(light)[0]
            print(f"sphere {radius} at {height}, {size} cells: {share[0]:.4f}, {1 - (radius / height) ** 2:.4f}")
            np.testing.assert_allclose(share, 1 - (radius / height) ** 2, atol=limit)
    rng = np.random.default_rng(0)
    for size, limit in ((16, 0.015), (64, 0.002)):
        off = []
        for _ in range(40):
            turn, z, radius = rng.uniform(0, 2 * np.pi), rng.uniform(0.6, 1), rng.uniform(0.2, 0.5)
            towards = np.array([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
            shadow = fastibl.SelfShadow.from_spheres(floor, [[*towards, radius]], size=size)
            off.append(shadow.shares(light)[0, 0] - (1 - radius**2 * z))
        print(f"spheres anywhere, {size} cells: RMS {np.sqrt(np.mean(np.square(off))):.4f}")
        assert np.sqrt(np.mean(np.square(off))) < limit
    mesh, cube = BOXES, smooth_map()
    spheres = np.array([[k, 0.3 * k, 0.5 * k, 0.05] for k in (0, 0.12)])  # those within the boxes
    true, _ = oracle("boxes")
    light = fastibl.Lighting(cube, diffuse="irradiance-cube")
    near = relative(fastibl.SelfShadow.from_spheres(mesh, spheres).irradiance(light), true).mean()
    none = relative(light.irradiance(mesh.normals), true).mean()
    print(f"spheres within boxes: {near:.4f}, without shadow {none:.4f}")
    assert near < 0.6 * none


def test_glossy_shares_against_brute_force():
    """The light in the free part of the lobe, whatever the lobe, under soft light and under a lamp."""
    mesh, eye = BOXES, np.array([0.3, -0.4, 0.5])
    faces = smooth_map(size=32).faces.copy()
    faces[fastibl.texel_directions(32) @ [-0.36, 0.48, 0.8] > 0.97] = (30, 20, 10)
    maps = {"soft": smooth_map(size=32), "lamp": fastibl.CubeMap(faces)}
    for name, cube in maps.items():
        glossy_against_rays(mesh, cube, eye, name)


def glossy_against_rays(mesh, cube, eye, name):
    d, angles, radiance = reference.samples(cube)
    shadow, occlusion = fastibl.SelfShadow(mesh), fastibl.ambient_occlusion(mesh, 1024)
    normals = mesh.normals.astype(float)
    views = (eye - mesh.vertices) / np.linalg.norm(eye - mesh.vertices, axis=1, keepdims=True)
    facing = np.flatnonzero((views * normals).sum(1) > 0.1)
    free = {i: free_rays(mesh, i, d) for i in facing}
    for exponent in (2.0, 16.0, 128.0):
        full, true = [], []
        for i in facing:
            half = d + views[i]
            half /= np.linalg.norm(half, axis=1, keepdims=True)
            w = np.maximum(half @ normals[i], 0) ** exponent * np.maximum(d @ normals[i], 0) * angles
            w /= w.sum()
            full.append(w @ radiance), true.append((w * free[i]) @ radiance)
        full, true = np.array(full), np.array(true)
        shares = shadow.glossy_shares(fastibl.Lighting(cube), eye, exponent)[facing]
        assert shares.min() >= 0 and shares.max() <= 1
        error = {
            method: relative(full * s[:, None], true).mean()
            for method, s in {"none": np.ones(len(facing)), "P_V": occlusion[facing], "transfer": shares}.items()
        }
        print(f"{name}, exponent {exponent}: " + ", ".join(f"{method} {e:.4f}" for method, e in error.items()))
        assert error["transfer"] < 0.4 * min(error["none"], error["P_V"])


def test_glossy_shares_of_any_exponent_and_eye():
    mesh = soup(20)
    sun = np.zeros((6, 64, 64, 3), np.float32)
    sun[4, 20, 40] = 1e9
    for size in (16, 32, 64, 128):
        shadow = fastibl.SelfShadow(mesh, size=size)
        for cube in (smooth_map(), fastibl.CubeMap(sun), constant(0.0), constant(1e-30), constant(1e9)):
            light = fastibl.Lighting(cube, diffuse="sh9", glossy="mip")
            for exponent in (0.0, 1e-3, 5.0, 1e6, np.inf):
                for eye in ((0, 0, 9.0), (0, 0, -9.0), tuple(map(float, mesh.vertices[0])), (1e9, 0, 0)):
                    shares = shadow.glossy_shares(light, np.array(eye), exponent)
                    assert shares.shape == (len(mesh.vertices),)
                    assert shares.min() >= 0 and shares.max() <= 1  # false for NaN


def test_same_bits_for_any_threads_and_every_time():
    mesh, before, light = soup(60), fastibl.threads(), fastibl.Lighting(smooth_map())
    try:
        results = []
        for count in (1, 2, 2):
            fastibl.set_threads(count)
            shadow = fastibl.SelfShadow(mesh)
            spheres = fastibl.SelfShadow.from_spheres(mesh, np.array([[0, 0, 2, 0.5], [1, 0, 1, 0.3]]))
            results.append(
                shadow.shares(light).tobytes()
                + shadow.glossy_shares(light, (1.0, 2.0, 3.0), 20.0).tobytes()
                + spheres.shares(light).tobytes()
                + shadow.shares(light).tobytes()  # again: what is kept gives the same
            )
        assert results[0] == results[1] == results[2]
    finally:
        fastibl.set_threads(before)


def test_bad_input_is_refused():
    mesh = soup(3)
    shadow, light = fastibl.SelfShadow(mesh, size=16), fastibl.Lighting(smooth_map())
    for size in (0, 8, 24, 256):
        same_error(lambda size=size: fastibl.SelfShadow(mesh, size=size), ValueError, "cells", str(size))
    same_error(lambda: fastibl.SelfShadow.from_spheres(mesh, np.zeros((2, 3))), ValueError, "(m, 4)", "(2, 3)")
    same_error(lambda: shadow.glossy_shares(light, (0.0, 0.0, 1.0), -1.0), ValueError, "exponent", "-1")
    same_error(lambda: shadow.glossy_shares(light, (0.0, 0.0, 1.0), float("nan")), ValueError, "exponent", "nan")
    same_error(lambda: shadow.glossy_shares(light, (0.0, 0.0), 1.0), ValueError, "eye")
    same_error(lambda: shadow.visible(np.zeros(3)), ValueError, "(k, 3)", "(3,)")
    with pytest.raises(TypeError):
        shadow.shares(smooth_map())
    with pytest.raises(TypeError):
        fastibl.SelfShadow(np.zeros((4, 3)))
    assert "16 cells" in repr(shadow) and shadow.size == 16 and shadow.nbytes > 0
    assert shadow.shares(light).shape == (9, 3)


# In the picture


def session_of(methods="auto", material=MATTE, cube=None, mesh=None, backend="cpu"):
    scene = scene_of(mesh or two_boxes(), material, spheres=0)
    camera = fastibl.Camera(160, 120, 150.0, 150.0, 80.0, 60.0)
    session = fastibl.Session(
        scene, fastibl.Rig(camera), environment=cube or smooth_map(), error=None, methods=methods, backend=backend
    )
    pose = np.array([[1, 0, 0, -0.06], [0, -1, 0, 0.02], [0, 0, -1, 0.35], [0, 0, 0, 1.0]])
    return session, session.process(fastibl.Frame(0.0, back_from_marker=pose))


def test_the_picture_holds_the_shares():
    """Ratio of the object's light with and without self-shadow: that of the vertices, between them."""
    (with_, a), (without, _) = session_of(), session_of({"self_shadow": "none"})
    assert "self_shadow" in a.passes
    seen = with_.object.rgba[..., 3] == 1
    ratio = with_.object.rgba[seen][:, :3] / without.object.rgba[seen][:, :3]
    shares = fastibl.SelfShadow(with_.scene.mesh).shares(fastibl.Lighting(smooth_map()))
    print(f"least share of a vertex {shares.min():.3f}, of a pixel {ratio.min():.3f}")
    assert ratio.min() > shares.min() - 1e-3 and ratio.max() < 1 + 1e-4
    assert ratio.min() < 0.95


def test_methods_by_name():
    assert [m.name for m in fastibl.methods("self_shadow")] == [
        "none",
        "ambient-occlusion",
        "transfer",
        "pixel-transfer",
        "traced-lights",
        "traced",
    ]
    pictures = {
        m: session_of({"self_shadow": m})[0].object.rgba for m in ("none", "ambient-occlusion", "transfer", "auto")
    }
    assert np.array_equal(pictures["auto"], pictures["transfer"])
    assert not np.array_equal(pictures["transfer"], pictures["ambient-occlusion"])
    assert not np.array_equal(pictures["none"], pictures["ambient-occlusion"])
    paper = session_of("paper")[1]
    assert paper.plan.methods.self_shadow == "ambient-occlusion" and "self_shadow" not in paper.passes
    same_error(lambda: session_of({"self_shadow": "best"}), ValueError, "best", "transfer")


def share_picture(scene, method, environment, pose):
    """(h, w) what is left of the glossy light, and where pixels are all object."""
    made = []
    for name in (method, "none"):
        methods = {
            "self_shadow": name,
            "bounce": "none",
            "diffuse": fastibl.Method("irradiance-cube", size=32, source=32),
        }
        methods["glossy"] = fastibl.Method("sampled", taps=64)
        session = fastibl.Session(scene, fastibl.Rig(LENS), environment=environment, methods=methods)
        session.process(fastibl.Frame(0.0, back_from_marker=pose))
        made.append(in_picture(session.object, LENS, np.float64))
    whole = made[1][..., 3] == 1
    return np.where(whole, made[0][..., 1] / np.where(whole, made[1][..., 1], 1), 1), whole


LENS = fastibl.Camera(96, 72, 110.0, 110.0, 48.0, 36.0)


def lobe_weights(material, normal, view, d):
    """Of directions d (n, 3): half vectors to the exponent, or GGX with Smith's masking, times the cosine; or that."""
    if material.model != "pbr" and material.diffuse[0] > 0:
        return np.maximum(d @ normal, 0)
    half = d + view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    cosine, h, v = np.maximum(d @ normal, 0), np.maximum(half @ normal, 0), normal @ view
    if material.model != "pbr":
        return h**material.exponent * cosine
    alpha2 = material.roughness**4
    mask = v * np.sqrt(alpha2 + (1 - alpha2) * cosine**2) + cosine * np.sqrt(alpha2 + (1 - alpha2) * v**2)
    return cosine / (1 + (alpha2 - 1) * h**2) ** 2 / np.maximum(mask, 1e-9)


@pytest.mark.parametrize("kind", ["matte", "broad", "shiny", "sharp", "ggx"])
def test_traced_shares_against_brute_force(kind):
    """The share of the light at pixels between vertices: every texel, cut, against every triangle."""
    material = {
        "matte": fastibl.Material(diffuse=(1, 1, 1)),
        "broad": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=16),
        "shiny": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=200),
        "sharp": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=3000),
        "ggx": fastibl.Material.pbr((1, 1, 1), metallic=1.0, roughness=0.45),
    }[kind]
    d = fastibl.texel_directions(64)
    cube = fastibl.CubeMap(smooth_map(size=64).faces.mean(axis=-1, keepdims=True) * np.ones(3))
    faces = cube.faces.copy()
    faces[d @ [-0.36, 0.48, 0.8] > 0.96] = 20
    cube = fastibl.CubeMap(faces)
    scene = fastibl.Scene(BOXES, material, spheres=0, refine=False)  # of corners alone
    eye, middle = np.array([-0.35, 0.1, 0.42]), np.array([0.05, 0, 0])
    pose = looking(middle - eye, eye)
    directions, angles, radiance = reference.samples(cube, 2)
    seen, triangle, t = seen_of_boxes(eye, pose)
    traced, whole = share_picture(scene, "traced", cube, pose)
    transfer, _ = share_picture(scene, "transfer", cube, pose)
    inside = whole.copy()  # all of a pixel and its neighbours on one side of one box
    side = np.where(triangle >= 0, triangle // 2, -1)
    for axis in (0, 1):
        for step in (-1, 1):
            inside &= (np.roll(side, step, axis) == side) & (side >= 0)
    rows, columns = np.nonzero(inside)
    chosen = np.random.default_rng(0).permutation(len(rows))[:50]
    true, error = [], {"traced": [], "transfer": []}
    for y, x in zip(rows[chosen], columns[chosen], strict=True):
        normal = BOXES.normals[BOXES.triangles[triangle[y, x]][0]].astype(float)
        place = eye + t[y, x] * seen[y, x] + 1e-5 * normal
        free = free_from(BOXES, place, directions)
        view = (eye - place) / np.linalg.norm(eye - place)
        light = lobe_weights(material, normal, view, directions) * angles * radiance[:, 1]
        true.append((light * free).sum() / light.sum())
        error["traced"].append(traced[y, x] - true[-1]), error["transfer"].append(transfer[y, x] - true[-1])
    rms = {name: np.sqrt(np.mean(np.square(e))) for name, e in error.items()}
    print(f"{kind}: least share {min(true):.2f}; RMS traced {rms['traced']:.4f}, transfer {rms['transfer']:.4f}")
    assert min(true) < (0.8 if kind == "matte" else 0.5) and len(chosen) == 50
    assert rms["traced"] < 0.02 and rms["traced"] < 0.2 * rms["transfer"]


@pytest.mark.parametrize("kind", ["broad", "shiny", "ggx"])
def test_shares_with_every_pixels_lobe_are_nearer_to_those_by_rays(kind):
    """On a round surface the lobe turns from vertex to vertex, and across what is hidden."""
    material = {
        "broad": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=16),
        "shiny": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=100),
        "ggx": fastibl.Material.pbr((1, 1, 1), metallic=1.0, roughness=0.45),
    }[kind]
    cube = fastibl.CubeMap(smooth_map(size=32).faces.mean(axis=-1, keepdims=True) * np.ones(3))
    scene = scene_of(fastibl.shapes.figurine(0.2), material, spheres=0)
    eye = np.array([0.3, -0.25, 0.25])
    pose = looking(np.array([0, 0, 0.09]) - eye, eye)
    traced, whole = share_picture(scene, "traced", cube, pose)
    touched = whole & (traced < 0.99)
    error = {}
    for method in ("transfer", "pixel-transfer"):
        share, _ = share_picture(scene, method, cube, pose)
        off = np.abs(share - traced)[touched]
        error[method] = np.array([np.sqrt(np.mean(off**2)), np.median(off)])
    print(f"{kind}: RMS and median off those by rays, {touched.sum()} pixels: {error}")
    assert touched.sum() > 200 and (error["pixel-transfer"] < 0.6 * error["transfer"]).all()


def test_rays_to_all_of_the_light_are_of_the_cpu_alone():
    if _fastibl.with_gl:
        same_error(lambda: session_of({"self_shadow": "traced"}, backend="gl"), ValueError, "traced", "cpu")
        session, _ = session_of({"self_shadow": "traced-lights"}, backend="gl")
        same_error(lambda: session.set_methods({"self_shadow": "traced"}), ValueError, "traced", "cpu")


def test_diffuse_light_is_by_vertex_whatever_the_pixels_lobe():
    pictures = [session_of({"self_shadow": m}, MATTE)[0].object.rgba for m in ("transfer", "pixel-transfer")]
    np.testing.assert_array_equal(*pictures)


def test_traced_changes_the_maps_light_alone():
    """What the plane sends and near lights change stays as it is by vertex; where nothing is hidden nothing changes."""
    with_bounce, without = (
        [session_of({"self_shadow": m, "bounce": b}, MATTE)[0].object.rgba for m in ("traced", "transfer")]
        for b in ("one-bounce", "none")
    )
    difference = [a - b for a, b in (with_bounce, without)]
    assert np.abs(difference[1]).max() > 0.005
    np.testing.assert_allclose(difference[0], difference[1], atol=2e-5)
    ball = fastibl.Scene(sphere(24), MATTE, spheres=0)
    seen = []
    for method in ("traced", "transfer"):
        methods = {"self_shadow": method, "diffuse": "sh9", "bounce": "none"}
        session = fastibl.Session(ball, fastibl.Rig(LENS), environment=smooth_map(), methods=methods)
        eye = np.array([-0.2, 0.1, 0.2])
        session.process(fastibl.Frame(0.0, back_from_marker=looking(-eye, eye)))
        seen.append(session.object.rgba.copy())
    np.testing.assert_array_equal(*seen)


def test_p_v_is_the_papers():
    """By name: the diffuse term times P_V, the glossy term untouched."""
    material = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.9, 0.9, 0.9), exponent=20)
    none, paper = (session_of({"self_shadow": m}, material)[0].object.rgba for m in ("none", "ambient-occlusion"))
    assert np.array_equal(none, paper)
    assert (session_of("auto", material)[0].object.rgba <= none + 1e-6).all()
    assert not np.array_equal(session_of("auto", material)[0].object.rgba, none)


@pytest.mark.skipif(not _fastibl.with_gl, reason="built without GL")
@pytest.mark.parametrize("method", ["none", "ambient-occlusion", "transfer"])
@pytest.mark.parametrize("kind", ["matte", "glossy", "pbr"])
def test_gl_looks_like_the_cpu(method, kind):
    material = {
        "matte": MATTE,
        "glossy": fastibl.Material(diffuse=(0.3, 0.3, 0.4), glossy=(0.5, 0.4, 0.4), exponent=40),
        "pbr": fastibl.Material.pbr((0.7, 0.5, 0.3), 0.5, 0.4),
    }[kind]
    made = [session_of({"self_shadow": method}, material, backend=backend) for backend in ("cpu", "gl")]
    (cpu, a), (gl, b) = made
    off = np.abs(a.image.astype(int) - b.image).max(-1)[(a.image[..., 3] > 0) | (b.image[..., 3] > 0)]
    print(f"{kind}, {method}: worst {off.max()}/255, above 2/255: {np.mean(off > 2):.1e} of {len(off)} pixels")
    assert np.mean(off > 2) <= 0.001
    # Another light, a turn and another method: what was uploaded before is not kept.
    pose = np.array([[1, 0, 0, -0.06], [0, -1, 0, 0.02], [0, 0, -1, 0.35], [0, 0, 0, 1.0]])
    for session in (cpu, gl):
        session.set_environment(fastibl.Environment(smooth_map(3)))
        session.move(fastibl.Pose.from_rotation_vector(np.array([0.2, 0.1, 0.5]), np.zeros(3)))
        session.set_methods({"self_shadow": "transfer" if method == "none" else "none"})
    a, b = (session.process(fastibl.Frame(1.0, back_from_marker=pose)) for session in (cpu, gl))
    off = np.abs(a.image.astype(int) - b.image).max(-1)[(a.image[..., 3] > 0) | (b.image[..., 3] > 0)]
    assert np.mean(off > 2) <= 0.001
