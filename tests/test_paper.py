"""The paper's methods, each against what the paper says, worked out in float64 NumPy.

Croubois, Farrugia and Iehl 2014, Fast Image Based Lighting for Mobile Realistic AR; docs/conventions.md has the table.
"""

import numpy as np
import pytest
from test_gl import needs_gl
from test_session import FRONT, ball, given, rig_of_two, seen_board, visible
from test_shadow import UNIFORM, cap_quadrature, plane_grid

import fastibl
from bench.paper import face_weights
from conftest import in_picture, units
from fastibl import reference
from views import camera_of, looking, rays_of

AXES = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
METHODS = {
    "tracking": "frame-marker",
    "capture": "single",
    "diffuse": "six-face",
    "glossy": "mip",
    "normalization": "paper",
    "shadow": "cap-product",
    "self_shadow": "ambient-occlusion",
    "bounce": "none",
}


def uneven_map(size=64, seed=0):
    """No two texels alike: a mean that is weighted in another way is another number."""
    return fastibl.CubeMap(np.random.default_rng(seed).random((6, size, size, 3)) ** 3)


def pyramid(cube):
    """The MIP chain: faces (6, n, n, 3) float64 of every level, each the solid-angle mean of the one before."""
    faces = cube.faces.astype(np.float64)
    angles = reference.samples(cube)[1].reshape(*faces.shape[:3], 1)
    levels = [faces]
    while faces.shape[1] > 1:
        n = faces.shape[1] // 2
        flux, angles = ((x.reshape(6, n, 2, n, 2, -1)).sum(axis=(2, 4)) for x in (faces * angles, angles))
        faces = flux / angles
        levels.append(faces)
    return levels


def place_on_face(directions):
    """Face, and place on it in [-1, 1]^2 to the right and down."""
    major, right, down = np.moveaxis(reference._FACES, 1, 0)
    face = (directions @ AXES.T).argmax(axis=1)
    along = (directions * major[face]).sum(axis=1)
    return face, *((directions * axis[face]).sum(axis=1) / along for axis in (right, down))


def trilinear(levels, directions, level):
    """Look-up between two levels, and whether it reads one face alone."""
    face, s, t = place_on_face(directions)
    value, inside = 0, True
    for k, share in ((int(level), 1 - level % 1), (int(level) + 1, level % 1)):
        if share == 0:
            continue
        n = levels[k].shape[1]
        x, y = ((a + 1) / 2 * n - 0.5 for a in (s, t))
        inside &= (np.minimum(x, y) >= 0) & (np.maximum(x, y) <= n - 1)
        i, j = (np.clip(np.floor(a).astype(int), 0, max(n - 2, 0)) for a in (x, y))
        f, g = (x - i)[:, None], (y - j)[:, None]
        last = n - 1
        upper, lower = (
            (1 - f) * levels[k][face, np.minimum(r, last), i]
            + f * levels[k][face, np.minimum(r, last), np.minimum(i + 1, last)]
            for r in (j, j + 1)
        )
        value = value + share * ((1 - g) * upper + g * lower)
    return value, inside


def equation_2(width, exponent):
    return np.clip(np.log2(width * np.sqrt(3)) - 0.5 * np.log2(exponent + 1), 0, np.log2(width))


def equation_9(cosine):
    return np.maximum(0.75 + cosine, 0) ** 2 / 1.75


def test_the_set_of_the_papers_methods():
    scene = fastibl.Scene(fastibl.shapes.figurine(0.2), visibility_rays=4)
    chosen = fastibl.make_plan(scene, methods="paper").methods
    assert {step: str(getattr(chosen, step)) for step in METHODS} == METHODS
    assert set(METHODS) == {*fastibl.lighting.STEPS, "normalization"}  # no step is without
    assert 40 <= len(scene.spheres) <= 50  # section 5: "around 50"


@pytest.mark.parametrize("exponent", [60.0, 250.0, 1000.0, 6000.0])
def test_equation_2(exponent):
    cube = uneven_map()
    n, v = units(3000, 1), units(3000, 2)
    v *= np.sign((n * v).sum(axis=1, keepdims=True))
    mirror = 2 * (n * v).sum(axis=1, keepdims=True) * n - v
    true, inside = trilinear(pyramid(cube), mirror, equation_2(64, exponent))
    ours = fastibl.Lighting(cube, glossy="mip").glossy(n[inside], v[inside], exponent)
    print(f"s = {exponent:g}: level {equation_2(64, exponent):.3f}, {inside.sum()} look-ups")
    assert inside.sum() > 500
    np.testing.assert_allclose(ours, true[inside], atol=1e-5)


def test_equation_2_ends_with_the_chain():
    cube = uneven_map()
    lighting = fastibl.Lighting(cube, glossy="mip")
    assert equation_2(64, 1e-3) == 6 and equation_2(64, 3 * 64**2) == 0
    np.testing.assert_allclose(lighting.glossy(AXES, AXES, 1e-3), pyramid(cube)[6][:, 0, 0], atol=1e-6)
    n = units(300)
    sharp, inside = trilinear(pyramid(cube), n, 0)
    for exponent in (3 * 64**2, 1e7):
        np.testing.assert_allclose(lighting.glossy(n, n, exponent)[inside], sharp[inside], atol=1e-5)


def test_diffuse_light_by_the_lowest_mip_of_one_face():
    """McGuire's, as section 3.2 tells it: the plain mean of the face's texels, as graphics hardware makes it."""
    cube, n = uneven_map(), units(500)
    mean = cube.faces.astype(np.float64).mean(axis=(1, 2))
    ours = fastibl.Lighting(cube, diffuse="nearest-face").irradiance(n)
    np.testing.assert_allclose(ours, np.pi * mean[(n @ AXES.T).argmax(axis=1)], rtol=1e-6)


@pytest.mark.parametrize("method", ["six-face", "six-face-exact"])
def test_equations_7_to_9(method):
    cube, n = uneven_map(), units(60)
    weights = equation_9(n @ AXES.T) if method == "six-face" else face_weights(n)
    true = weights @ pyramid(cube)[-1][:, 0, 0]
    lighting = fastibl.Lighting(cube, diffuse=method)
    np.testing.assert_allclose(lighting.irradiance(n), true, rtol=2e-6)
    np.testing.assert_allclose([lighting.irradiance(row) for row in n], true, rtol=2e-6)


def test_equation_9_is_close_to_equation_7():
    """The figures of docs/conventions.md."""
    n = np.concatenate([units(600), AXES, np.ones((1, 3)) / np.sqrt(3)])
    exact, fit = face_weights(n, 24), equation_9(n @ AXES.T)
    worst = np.abs(fit - exact).max()
    print(f"largest difference {worst:.4f}, largest weight {exact.max():.4f}; sums {fit.sum(1).min() / np.pi:.4f} ...")
    assert 0.028 < worst < 0.0295 and abs(exact.max() - 1.7408) < 1e-4
    assert abs(fit.sum(axis=1).min() / np.pi - 0.966) < 1e-3 and abs(fit.sum(axis=1).max() / np.pi - 0.978) < 1e-3


def share_below_a_lid(side, height):
    """P_V at a corner of a square, for a square of the same size above it: form factor of a parallel rectangle."""
    x = side / height
    hidden = 2 * x / np.sqrt(1 + x * x) * np.arctan(x / np.sqrt(1 + x * x)) / (2 * np.pi)
    return 1 - hidden


@pytest.mark.parametrize("backend", ["cpu", pytest.param("gl", marks=needs_gl)])
def test_equations_3_4_and_8_in_the_picture(backend):
    """A square below a lid: its corners, and so all of it, have one P_V. Faces of one colour each."""
    side, height, exponent = 0.1, 0.1, 300.0
    square = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * side / 2 + [0, 0, 0.02]
    mesh = fastibl.Mesh(np.concatenate([square, square + [0, 0, height]]), [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)])
    material = fastibl.Material(
        diffuse=(0.7, 0.5, 0.3), glossy=(0.2, 0.3, 0.4), exponent=exponent, emission=(0.05, 0.1, 0.2)
    )
    scene = fastibl.Scene(mesh, material, spheres=0, visibility_rays=8192, refine=False)
    share = share_below_a_lid(side, height)
    assert np.abs(scene.visibility[:4] - share).max() < 0.004 and abs(share - 0.7) < 0.2
    colours = np.random.default_rng(5).random((6, 3))
    cube = fastibl.CubeMap(np.broadcast_to(colours[:, None, None], (6, 32, 32, 3)))
    camera, eye = camera_of(120, 90, 30.0), np.array([0.1, -0.22, 0.16])
    pose = looking(np.array([0, 0, 0.02]) - eye, eye)
    session = fastibl.Session(scene, fastibl.Rig(camera), environment=cube, methods="paper", backend=backend)
    session.process(fastibl.Frame(0.0, back_from_marker=pose))
    rays = rays_of(camera, pose)
    on_square = eye + rays * ((0.02 - eye[2]) / rays[..., 2:])
    view, normal = -rays, np.array([0.0, 0, 1])
    mirror = rays * [1, 1, -1]
    face, s, t = place_on_face(mirror.reshape(-1, 3))
    texel = 2 / (32 >> int(np.ceil(equation_2(32, exponent))))
    inner = (np.maximum(np.abs(s), np.abs(t)) < 1 - texel).reshape(90, 120)
    layer = in_picture(session.object, camera)
    seen = (
        (rays[..., 2] < 0) & (np.abs(on_square[..., :2]).max(axis=-1) < 0.96 * side / 2) & (layer[..., 3] == 1) & inner
    )
    glossy = colours[face].reshape(90, 120, 3)
    rho = np.interp(view[..., 2], (c := np.linspace(0, 1, 101)), reference.directional_albedo(c, exponent))
    matte = share / np.pi * equation_9(AXES @ normal) @ colours
    true = material.emission + np.array(material.diffuse) * matte + np.array(material.glossy) * rho[..., None] * glossy
    off = np.abs(layer[..., :3] - true)[seen]
    print(
        f"{seen.sum()} pixels, P_V {share:.4f}, rho {rho[seen].min():.3f} to {rho[seen].max():.3f}: off {off.max():.4f}"
    )
    assert seen.sum() > 300 and off.max() < 0.002


@pytest.mark.parametrize("method", ["cap-sum", "cap-product"])
def test_obstructions_are_added_or_multiplied(method):
    """Of three spheres that overlap in the sky, which is uniform."""
    spheres = np.array([(0.1, 0.0, 0.5, 0.2), (0.2, 0.1, 0.6, 0.25), (-0.4, 0.2, 0.3, 0.1)])
    points = plane_grid(0.8, 6).reshape(-1, 2)
    hidden = np.zeros((len(points), len(spheres)))
    for i, p in enumerate(points):
        for k, (*middle, radius) in enumerate(spheres):
            d = np.array(middle) - [*p, 0]
            far = np.linalg.norm(d)
            hidden[i, k] = cap_quadrature(np.arcsin(radius / far), np.arccos(d[2] / far), 2000) / np.pi
    true = np.maximum(1 - hidden.sum(axis=1), 0) if method == "cap-sum" else (1 - hidden).prod(axis=1)
    ours = fastibl.shadow_ratio(UNIFORM, spheres, points, method)
    print(f"{method}: ratios {true.min():.3f} to {true.max():.3f}, off by {np.abs(ours - true[:, None]).max():.1e}")
    np.testing.assert_allclose(ours, np.broadcast_to(true[:, None], ours.shape), atol=6e-4)


def paper_session(**options):
    return fastibl.Session(ball(), rig_of_two(), size=16, methods="paper", **options)


def test_the_front_camera_alone_paints_the_map():
    """Where a texel's direction falls into the picture, its pixel is the radiance; white is the most that one shows."""
    session = paper_session()
    camera = rig_of_two().front
    ramp = np.zeros((48, 64, 3), np.uint8)
    ramp[...] = np.linspace(60, 255, 64).astype(np.uint8)[:, None]
    ramp[:, 60:] = 255
    environment = session.process(given(front=ramp, front_exposure=0.5)).environment
    pose = rig_of_two().front_from_back @ given().back_from_marker
    d = fastibl.texel_directions(16).reshape(-1, 3) @ pose.rotation.T
    x, y = (camera.fx * d[:, 0] / d[:, 2] + camera.cx, camera.fy * d[:, 1] / d[:, 2] + camera.cy)
    inside = (d[:, 2] > 0) & (x > 2) & (x < 62) & (y > 2) & (y < 46)
    seen = np.isfinite(session.capture.last_seen).reshape(-1)
    outside = (d[:, 2] < 0) | (x < -8) | (x > 72) | (y < -8) | (y > 56)
    assert inside.sum() > 40 and seen[inside].all() and not seen[outside].any()
    code = np.interp(x[inside] - 0.5, np.arange(64), ramp[0, :, 0]) / 255
    srgb = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    ours = environment.radiance.faces.reshape(-1, 3)[inside, 0]
    np.testing.assert_allclose(ours, srgb / 0.5, rtol=0.06)  # a texel is four pixels wide, and the ramp bends
    assert environment.radiance.faces.max() <= 2.001 and session.capture.distance == np.inf


@pytest.mark.parametrize("step", [0.5, 1 / 30])
def test_a_finger_on_the_front_camera(step):
    """Figure 4: the light of the next front picture is on the object at once, and gone at once."""
    session, shown = paper_session(), {}
    finger = np.zeros_like(FRONT)
    for time in np.concatenate([np.arange(0, 6, step), np.arange(9, 12, step), np.arange(15, 18, step)]):
        front = finger if 8 < time < 14 else FRONT
        result = session.process(given(float(time), front=front, front_exposure=1.0))
        # A picture that is dark all over is taken for a wrong exposure until four have said so.
        if result.front_taken is not None and result.front_taken.how != "left out":
            rgba = session.object.rgba
            shown[float(time)] = float(rgba[..., :3].sum() / rgba[..., 3].sum())
    times, light = list(shown), list(shown.values())
    print({round(t, 2): round(v, 4) for t, v in shown.items()})
    before, dark, after = (max(k for k, t in enumerate(times) if t < end) for end in (8, 14, 20))
    assert dark > before and after > dark
    assert light[before + 1] < 0.01 * light[before] and light[dark + 1] > 0.99 * light[before]


def test_the_order_of_the_steps():
    session = fastibl.Session(
        ball(), rig_of_two(), fastibl.Board.default(), detector=seen_board, size=16, methods="paper"
    )
    result = session.process(fastibl.Frame(0.0, back=visible(True), front=FRONT, front_exposure=1.0))
    assert result.passes == ["track", "capture", "mips", "irradiance", "shadow", "shade", "composite"]
    assert result.back_taken is None and len(result.tracked.tags) == 1
