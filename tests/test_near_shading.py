"""Lights whose place is known: what they give varies over object and plane, on both back ends."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import scene_of

import fastibl
from fastibl.session import with_gl
from views import camera_of, looking

CENTRE = np.array([0.0, 0.0, 0.06])
TOWARDS = np.array([0.5, -0.4, 0.7]) / np.linalg.norm([0.5, -0.4, 0.7])
AMBIENT = 0.5
EYE = np.array([0.1, -0.4, 0.3])
CAMERA, POSE = camera_of(160, 120, 30.0), looking(CENTRE - EYE, EYE)
BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.skipif(not with_gl, reason="built without GL"))]


@pytest.fixture(scope="module")
def mesh():
    return fastibl.shapes.figurine(0.12)


def lamp_map(radius, distance, facing=3.0, size=64, centre=CENTRE, ambient=AMBIENT, towards=TOWARDS):
    """A map of even light with a disc that gives `facing` to what faces it."""
    sine2 = min((radius / distance) ** 2, 0.9)
    radiance = facing / (np.pi * sine2)
    fine = fastibl.texel_directions(size * 4).astype(np.float64)
    fine /= np.linalg.norm(fine, axis=-1, keepdims=True)
    lit = (fine @ towards > np.sqrt(1 - sine2)).reshape(6, size, 4, size, 4).mean(axis=(2, 4))
    if lit.max() == 0:  # smaller than a sample
        lit[np.unravel_index(np.argmax(fastibl.texel_directions(size) @ towards), lit.shape)] = 1e-3
    d = fastibl.texel_directions(size).astype(np.float64)
    cosine = d @ towards / np.linalg.norm(d, axis=-1)
    lit *= np.pi * sine2 / (lit * cosine * np.asarray(fastibl.texel_solid_angles(size), np.float64)).sum()
    return fastibl.CubeMap(np.repeat((ambient + radiance * lit)[..., None], 3, axis=-1).astype(np.float32))


def placed(cube, lights, centre=CENTRE):
    return fastibl.Environment(cube, centre=centre, lights=np.atleast_2d(np.asarray(lights, float)))


def session(mesh, environment, material=None, backend="cpu", error=None, **methods):
    methods = {"bounce": "none", **methods}
    scene = scene_of(mesh, material or fastibl.Material(diffuse=(1, 1, 1)))
    # Without a budget: the exact methods, whatever the light.
    return fastibl.Session(scene, fastibl.Rig(CAMERA), None, environment, error=error, methods=methods, backend=backend)


def processed(*args, **options):
    s = session(*args, **options)
    result = s.process(fastibl.Frame(0.0, back_from_marker=POSE))
    return s, result


def whole_pixels(layer):
    """Radiance (n, 3) of pixels wholly covered, and their places (n, 2: row, column) in the picture."""
    at = np.argwhere(layer.rgba[..., 3] == 1)
    return layer.rgba[tuple(at.T)][:, :3], at + [layer.y, layer.x]


def hits(mesh, places):
    """Points that pixels show."""
    d = CAMERA.unproject(places[:, ::-1] + 0.5) @ POSE.rotation
    _, t, _ = fastibl.Bvh(mesh).nearest(np.broadcast_to(EYE, d.shape).astype(np.float32), d.astype(np.float32))
    return EYE + t[:, None] * d


def over_sphere(arrow, radius, count):
    """Directions (count, 3) spread evenly over a sphere's outline as seen along `arrow`, and its solid angle."""
    z = arrow / np.linalg.norm(arrow)
    x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.7 else [0, 1.0, 0])
    x /= np.linalg.norm(x)
    span = 1 - np.sqrt(1 - radius**2 / (arrow @ arrow))
    c = 1 - span * (np.arange(count) + 0.5) / count
    s, turn = np.sqrt(1 - c * c), np.arange(count) * np.pi * (3 - np.sqrt(5))
    d = c[:, None] * z + s[:, None] * (np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(z, x))
    return d, 2 * np.pi * span


def sphere_irradiance(points, normals, position, radius, radiance, count=4000):
    """By sums over directions within the sphere's outline."""
    out = []
    for p, n in zip(points, normals, strict=True):
        d, solid_angle = over_sphere(position - p, radius, count)
        out.append(radiance * solid_angle * np.maximum(d @ n, 0).mean())
    return np.array(out)


def true_glossy(normals, view, exponent, distance, lamp, radius):
    """Mean radiance (n,) under the lobes of points of a ball of this radius, by sums over all directions and over the
    disc of a lamp at this distance from its middle.

    lamp: its radius, metres. It gives 3 to what faces it from the middle.
    """
    d = fastibl.texel_directions(48).reshape(-1, 3).astype(np.float64)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    angles = np.tile(np.asarray(fastibl.texel_solid_angles(48), np.float64).ravel(), 6)
    radiance = 3.0 / (np.pi * (lamp / distance) ** 2)
    out = []
    for n in normals:

        def lobe(w, n=n):
            half = w + view
            half /= np.linalg.norm(half, axis=1, keepdims=True)
            return np.maximum(half @ n, 0) ** exponent * np.maximum(w @ n, 0)

        arrow = distance * TOWARDS - radius * n
        w, solid_angle = over_sphere(arrow, lamp, 500)
        out.append(AMBIENT + radiance * solid_angle * lobe(w).mean() / (lobe(d) @ angles))
    return np.array(out)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("exponent", [300.0, 1000.0, 4000.0])
@pytest.mark.parametrize("method", ["stretched", "sampled"])
def test_sharp_highlights_are_where_the_lamp_is(method, exponent, backend):
    """On a shiny ball close to a lamp. Look-ups so fine that they hold the lamp show it where the map has it."""
    radius, distance, lamp = 0.03, 0.15, 0.015
    mesh = fastibl.Mesh(*icosphere(radius, CENTRE, 4))
    eye = CENTRE + [0.1, -1.5, 1.2]
    camera, pose = camera_of(160, 160, 3.0), looking(CENTRE - eye, eye)
    cube = lamp_map(lamp, distance, size=128)
    scene = scene_of(mesh, fastibl.Material((0, 0, 0), (1, 1, 1), exponent), visibility_rays=0)
    methods = {"glossy": method, "self_shadow": "none", "bounce": "none"}
    environments = {
        "near": placed(cube, [*(CENTRE + distance * TOWARDS), lamp]),
        "distant": fastibl.Environment(cube, centre=CENTRE),
    }
    off = {}
    for name, environment in environments.items():
        s = fastibl.Session(
            scene, fastibl.Rig(camera), None, environment, cast_shadow=False, methods=methods, backend=backend
        )
        s.process(fastibl.Frame(0.0, back_from_marker=pose))
        light, places = whole_pixels(s.object)
        d = camera.unproject(places[:, ::-1] + 0.5) @ pose.rotation
        _, t, _ = fastibl.Bvh(mesh).nearest(np.broadcast_to(eye, d.shape).astype(np.float32), d.astype(np.float32))
        normals = (eye + t[:, None] * d - CENTRE) / np.linalg.norm(eye + t[:, None] * d - CENTRE, axis=1, keepdims=True)
        view = (eye - CENTRE) / np.linalg.norm(eye - CENTRE)
        mirror = 2 * (normals @ view)[:, None] * normals - view
        arrow = distance * TOWARDS - radius * normals
        some = np.argsort(-(mirror * arrow).sum(axis=1) / np.linalg.norm(arrow, axis=1))[:250]
        true = true_glossy(normals[some], view, exponent, distance, lamp, radius)
        off[name] = np.sqrt(((light[some, 0] - true) ** 2).mean()) / true.mean()
    print(f"around the highlight: {100 * off['near']:.0f} %, with the lamp as distant {100 * off['distant']:.0f} %")
    assert off["near"] < 0.25 and off["distant"] > 3 * off["near"]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("material", ["shiny", "polished"])
def test_a_lamp_known_to_be_far_changes_no_highlight(mesh, material, backend):
    """As a lamp's place is found, it comes nearer step by step: the first step must change nothing."""
    materials = {
        "shiny": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=5000.0),
        "polished": fastibl.Material.pbr((1, 1, 1), 1.0, 0.12),
    }
    cube = lamp_map(0.05, 0.5, size=128)
    layers = []
    for environment in (placed(cube, [*(CENTRE + 1e6 * TOWARDS), 1e5]), fastibl.Environment(cube, centre=CENTRE)):
        methods = {"glossy": "stretched", "self_shadow": "none", "bounce": "none"}
        s = session(mesh, environment, materials[material], backend, **methods)
        s.process(fastibl.Frame(0.0, back_from_marker=POSE))
        layers.append(np.asarray(s.object.rgba))
    off = np.abs(layers[0] - layers[1]).max() / layers[1][..., :3].mean()
    print(f"{material}: {off:.2g} of the mean")
    assert off < 5e-4


@pytest.mark.parametrize("distance", [0.2, 0.5, 2.0])
def test_the_light_of_a_lamp_follows_its_distance(distance):
    mesh = fastibl.Mesh(*icosphere(0.06, CENTRE))
    radius, facing = 0.03, 3.0
    position = CENTRE + distance * TOWARDS
    cube = lamp_map(radius, distance, facing)
    errors = {}
    for name, environment in {
        "near": placed(cube, [*position, radius]),
        "distant": fastibl.Environment(cube, centre=CENTRE),
    }.items():
        s, _ = processed(mesh, environment, self_shadow="none")
        light, places = whole_pixels(s.object)
        some = np.random.default_rng(1).permutation(len(places))[:200]
        points = hits(mesh, places[some])
        normals = (points - CENTRE) / np.linalg.norm(points - CENTRE, axis=1, keepdims=True)
        radiance = facing / (np.pi * (radius / distance) ** 2)
        true = AMBIENT + sphere_irradiance(points, normals, position, radius, radiance) / np.pi
        errors[name] = np.median(np.abs(light[some, 0] - true)) / true.mean()
    print(f"{distance} m: " + ", ".join(f"{k} {100 * e:.2f} %" for k, e in errors.items()))
    assert errors["near"] < 0.005
    if distance < 1:
        assert errors["near"] < errors["distant"] / 10


def test_a_box_of_twelve_triangles_is_lit_between_its_corners():
    """Within a face half as wide as the lamp is far."""
    mesh, position, radius, facing = (
        box((-0.05, -0.05, 0), (0.05, 0.05, 0.1)),
        np.array([0.016, -0.028, 0.2]),
        0.01,
        3.0,
    )
    middle = np.array([0, 0, 0.1])
    distance = np.linalg.norm(position - middle)
    cube = lamp_map(radius, distance, facing, centre=middle, ambient=0.0, towards=(position - middle) / distance)
    s, _ = processed(mesh, placed(cube, [*position, radius], middle), self_shadow="none")
    light, places = whole_pixels(s.object)
    points = hits(mesh, places)
    top = (points[:, 2] > 0.1 - 1e-5) & (np.abs(points[:, :2]).max(axis=1) < 0.047)  # no side shows there
    up = np.broadcast_to([0.0, 0.0, 1.0], (top.sum(), 3))
    radiance = facing / (np.pi * (radius / distance) ** 2)
    true = sphere_irradiance(points[top], up, position, radius, radiance, 400) / np.pi
    off = np.sqrt(((light[top, 0] - true) ** 2).mean()) / true.mean()
    print(
        f"the top of a box under a lamp: {true.max() / true.min():.2f} times brighter below it, {100 * off:.2f} % off"
    )
    assert off < 0.02


def test_a_light_knows_its_place(mesh):
    position = CENTRE + 0.5 * TOWARDS
    cube = lamp_map(0.03, 0.5)
    (light,) = fastibl.Lighting(placed(cube, [*position, 0.03])).lights
    assert np.linalg.norm(np.array(light.position) - position) < 0.005
    (light,) = fastibl.Lighting(cube).lights
    assert light.position is None
    _, result = processed(mesh, placed(cube, [*position, 0.03]), fastibl.Material(glossy=(0.3, 0.3, 0.3)))
    assert result.lighting.lights[0].position is not None
    # A direction in which the map is dark has no light.
    (light,) = fastibl.Lighting(placed(cube, [0, 0, -3, 0.1])).lights
    assert light.position is None


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_very_far_is_distant(mesh, backend):
    cube = lamp_map(0.05, 0.5)
    material = fastibl.Material(diffuse=(0.5, 0.5, 0.5), glossy=(0.5, 0.5, 0.5), exponent=40.0)
    far = [*(CENTRE + 1e5 * TOWARDS), 1e4]
    named = {"error": 0.02, "diffuse": "irradiance-cube", "glossy": "centroid", "shadow": "mesh"}
    a, first = processed(mesh, fastibl.Environment(cube, centre=CENTRE), material, backend, **named)
    b, second = processed(mesh, placed(cube, far), material, backend, **named)
    assert np.abs(a.object.rgba - b.object.rgba).max() < 2e-3 * a.object.rgba.max()
    assert np.abs(np.asarray(first.shadow_map.image) - np.asarray(second.shadow_map.image)).max() < 2e-3
    (line,) = [p for p in second.plan.passes if p.name == "near_light"]
    assert not line.included and "too far" in line.reason and 0 < line.bound <= 0.002


def test_an_object_that_is_moved_beside_a_lamp_is_lit_by_it_at_once(mesh):
    """The plan of the frame before left the pass out: that lamp was far."""
    lamp = CENTRE + 100 * TOWARDS
    environment = placed(lamp_map(1.0, 100), [*lamp, 1.0])
    beside = fastibl.Pose.from_rotation_vector([0, 0, 0], 97 * TOWARDS)
    camera = POSE @ beside.inverse()

    def made(first):
        s = session(mesh, environment, error=0.05)
        if first:
            plan = s.process(fastibl.Frame(0.0, back_from_marker=POSE)).plan
            assert not next(p for p in plan.passes if p.name == "near_light").included
        s.move(beside)
        result = s.process(fastibl.Frame(1.0, back_from_marker=camera))
        assert "near_light" in result.passes
        return np.array(s.object.rgba)

    np.testing.assert_array_equal(made(True), made(False))


def test_nothing_is_done_where_no_light_is_near(mesh):
    _, result = processed(mesh, fastibl.Environment(lamp_map(0.05, 0.5)))
    (line,) = [p for p in result.plan.passes if p.name == "near_light"]
    assert not line.included and line.reason == "no light is known to be near" and line.bound == 0
    assert "near_light" not in result.passes


MATERIALS = {
    "matte": fastibl.Material(diffuse=(1, 0.8, 0.6)),
    "glossy": fastibl.Material(diffuse=(0.2, 0.2, 0.2), glossy=(0.6, 0.5, 0.4), exponent=30.0),
    "blunt": fastibl.Material(diffuse=(0, 0, 0), glossy=(0.6, 0.5, 0.4), exponent=3.0),
    "shiny": fastibl.Material(diffuse=(0, 0, 0), glossy=(0.6, 0.5, 0.4), exponent=2000.0),
    "pbr": fastibl.Material.pbr((0.8, 0.5, 0.3), 0.6, 0.5),
}


@pytest.mark.skipif(not with_gl, reason="built without GL")
@pytest.mark.parametrize("name", MATERIALS)
def test_both_back_ends_agree(mesh, name):
    environment = placed(lamp_map(0.04, 0.3), [*(CENTRE + 0.3 * TOWARDS), 0.04])
    layers, maps = [], []
    for backend in ("cpu", "gl"):
        s, result = processed(mesh, environment, MATERIALS[name], backend)
        layers.append(s.object), maps.append(np.asarray(result.shadow_map.image))
    a, b = layers
    assert (a.x, a.y, a.rgba.shape) == (b.x, b.y, b.rgba.shape)
    same = a.rgba[..., 3] == b.rgba[..., 3]
    off = np.abs(a.rgba - b.rgba)[same] / a.rgba[..., :3].mean()
    print(f"{name}: worst {off.max():.4f}, p99.9 {np.quantile(off, 0.999):.5f}")
    assert same.mean() > 0.999
    assert np.quantile(off, 0.999) < 0.02  # half floats of the lamp's radiance
    assert np.abs(maps[0] - maps[1]).max() < 1e-5


def test_a_highlight_moves_with_the_lamp(mesh):
    """A glossy object reads each light in its direction from the fragment."""
    middle = CENTRE + [0.06, 0.03, 0.0]
    ball = fastibl.Mesh(*icosphere(0.05, middle))
    material = fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=60.0)
    position, radius = CENTRE + 0.15 * TOWARDS, 0.01
    cube = lamp_map(radius, 0.15)
    true = brightest_true(position, middle)
    found = {}
    for name, environment in {"near": placed(cube, [*position, radius]), "distant": fastibl.Environment(cube)}.items():
        s, _ = processed(ball, environment, material, self_shadow="none")
        light, places = whole_pixels(s.object)
        bright = light[:, 0] > 0.8 * light[:, 0].max()
        points = hits(ball, places[bright])
        found[name] = np.linalg.norm(points.mean(axis=0) - true)
    print({k: f"{1e3 * v:.1f} mm" for k, v in found.items()})
    assert found["near"] < 0.002 < found["distant"] / 4


def brightest_true(position, middle):
    """Point of the ball whose mirror shows the lamp's middle."""
    rng = np.random.default_rng(0)
    n = rng.normal(size=(400000, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    p = middle + 0.05 * n
    view, light = EYE - p, position - p
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    half = view + light
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return p[np.argmax((half * n).sum(axis=1))]


def icosphere(radius, centre, rounds=4):
    g = (1 + 5**0.5) / 2
    v = np.array([[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g], [0, -1, -g], [0, 1, -g]])
    v = np.concatenate([v, [[g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]]]).astype(float)
    t = np.array(
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6]]
        + [[7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10]]
        + [[8, 6, 7], [9, 8, 1]]
    )
    for _ in range(rounds):
        edges = np.sort(t[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        unique, at = np.unique(edges, axis=0, return_inverse=True)
        middle = (len(v) + at.reshape(-1)).reshape(-1, 3)
        v = np.concatenate([v, v[unique].mean(axis=1)])
        a, b, c = t.T
        x, y, z = middle.T
        t = np.concatenate([np.stack(s, axis=1) for s in ((a, x, z), (b, y, x), (c, z, y), (x, y, z))])
    v *= radius / np.linalg.norm(v, axis=1, keepdims=True)
    return (v + centre).astype(np.float32), t.astype(np.int32)


def box(lower, upper):
    x0, y0, z0, x1, y1, z1 = *lower, *upper
    v = [(x, y, z) for z in (z0, z1) for y in (y0, y1) for x in (x0, x1)]
    t = [(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4)]
    t += [(2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5)]
    return fastibl.Mesh(np.array(v, np.float32), np.array(t, np.int32))


def true_ratio(points, mesh, position, radius, facing, centre, ambient=AMBIENT, count=150):
    """By rays to the lamp's disc, and to even light."""
    bvh = fastibl.Bvh(mesh)
    sky = fastibl.texel_directions(40).reshape(-1, 3).astype(np.float64)
    angles = np.tile(np.asarray(fastibl.texel_solid_angles(40), float).ravel(), 6)
    sky /= np.linalg.norm(sky, axis=1, keepdims=True)
    up = sky[:, 2] > 0
    sky, angles = sky[up], angles[up]
    distance = np.linalg.norm(position - centre)
    radiance = facing / (np.pi * (radius / distance) ** 2)
    out = []
    for x, y in points:
        p = np.array([x, y, 1e-5])
        even = ambient * angles * sky[:, 2]
        arrow = position - p
        d, solid_angle = over_sphere(arrow, radius, count)
        own = radiance * solid_angle / count * np.maximum(d[:, 2], 0)
        start = p.astype(np.float32)
        kept = (
            own[~bvh.occluded(start, d.astype(np.float32))].sum()
            + even[~bvh.occluded(start, sky.astype(np.float32))].sum()
        )
        out.append(kept / (own.sum() + even.sum()))
    return np.array(out)


@pytest.mark.parametrize(("distance", "shift", "turn"), [(0.25, 0.0, 0.0), (0.5, 0.0, 0.0), (0.4, 0.08, 0.7)])
def test_the_shadow_of_a_near_lamp(distance, shift, turn):
    mesh = box((-0.03, -0.02, 0), (0.03, 0.02, 0.08))
    radius, facing = 0.02, 3.0
    position = CENTRE + distance * TOWARDS
    cube = lamp_map(radius, distance, facing, size=128)
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    matrix[0, 3] = shift
    moved = fastibl.Mesh(
        (np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32), np.asarray(mesh.triangles)
    )
    grid = np.linspace(-0.16, 0.16, 33)
    points = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2) + [shift, 0]
    inside = np.abs((points - [shift, 0]) @ matrix[:2, :2])
    points = points[(inside[:, 0] > 0.032) | (inside[:, 1] > 0.022)]
    true = true_ratio(points, moved, position, radius, facing, CENTRE)
    shaded = 1 - true > 0.01
    baked = fastibl.MeshShadow(mesh)
    rms = {}
    for name, environment in {"near": placed(cube, [*position, radius]), "distant": fastibl.Environment(cube)}.items():
        ratio = baked.cast(environment, matrix).sample(points[shaded].astype(np.float32))[:, 0]
        rms[name] = np.sqrt(((ratio - true[shaded]) ** 2).mean())
    print(f"{distance} m: " + ", ".join(f"{k} {v:.4f}" for k, v in rms.items()))
    assert rms["near"] < 0.03
    assert rms["near"] < rms["distant"] / 3


def test_a_fine_map_of_a_near_lamp_agrees_with_the_others():
    mesh = box((-0.03, -0.02, 0), (0.03, 0.02, 0.08))
    position = CENTRE + 0.5 * TOWARDS
    environment = placed(lamp_map(0.005, 0.5, size=128), [*position, 0.005])
    points = np.random.default_rng(3).uniform(-0.15, 0.15, (500, 2)).astype(np.float32)
    plain = fastibl.MeshShadow(mesh).cast(environment).sample(points)
    fine = fastibl.MeshShadow(mesh, fine=512).cast(environment).sample(points)
    off = np.abs(plain - fine).max(axis=1)
    print(f"median {np.median(off):.5f}, p90 {np.quantile(off, 0.9):.4f}")
    assert np.median(off) < 1e-3 and np.quantile(off, 0.9) < 0.05


def test_a_followed_shadow_stays_where_a_new_one_falls():
    """A lamp is known better from frame to frame, then carried, and the object is shifted below it: shadows are drawn
    anew once they fall a quarter of a texel elsewhere."""
    mesh, radius = box((-0.03, -0.02, 0), (0.03, 0.02, 0.08)), 0.02
    followed = fastibl.MeshShadow(mesh)
    steps = [(d, 0.0) for d in np.linspace(0.40, 0.42, 30)] + [(0.30, 0.0), (0.60, 0.0)]
    steps += [(0.60, shift) for shift in np.linspace(0, 0.004, 9)] + [(0.60, 0.05)]
    cube, off = lamp_map(radius, 0.4, size=64), []
    for distance, shift in steps:
        matrix = np.eye(4)
        matrix[0, 3] = shift
        environment = placed(cube, [*(CENTRE + distance * TOWARDS), radius])
        kept = followed.cast(environment, matrix, follow=True)
        new = fastibl.MeshShadow(mesh).cast(environment, matrix)
        off.append(np.sqrt(((kept.image - new.image) ** 2).mean()))
    print(f"RMS against a new one: {max(off):.1e} at most, {np.median(off):.1e} in the median")
    assert max(off) < 4e-3


def test_a_lamp_between_the_parts_of_an_object_throws_what_is_below_it():
    """What is as high as the lamp throws no shadow; a roof above it neither."""
    lamp = np.array([0.15, 0.0, 0.1])
    low, high = box((-0.02, -0.02, 0), (0.02, 0.02, 0.05)), box((-0.02, -0.02, 0.0), (0.02, 0.02, 0.2))
    roof = box((-0.02, -0.02, 0.15), (0.02, 0.02, 0.2))
    both = fastibl.Mesh(
        np.concatenate([low.vertices, roof.vertices]), np.concatenate([low.triangles, np.asarray(roof.triangles) + 8])
    )
    towards = (lamp - CENTRE) / np.linalg.norm(lamp - CENTRE)
    cube = lamp_map(0.004, np.linalg.norm(lamp - CENTRE), facing=50.0, ambient=0.0, towards=towards, size=128)
    environment = placed(cube, [*lamp, 0.004])
    behind = np.float32([[-0.1, 0.0], [-0.06, 0.01], [0.06, 0.0]])
    ratios = {
        name: fastibl.MeshShadow(m).cast(environment).sample(behind)[:, 0]
        for name, m in {"low": low, "high": high, "both": both}.items()
    }
    print(ratios)
    # The shadow of the low box's edge (x = -0.02, z = 0.05) ends at x = -0.19.
    assert ratios["low"][0] < 0.2 and ratios["low"][2] > 0.8
    assert ratios["high"][0] < 0.2 and ratios["high"][2] > 0.8
    assert np.allclose(ratios["both"], ratios["low"], atol=0.05)


EXTREMES = {
    "inside the bounding sphere": ([0.05, -0.05, 0.12], 0.01),
    "on the plane": ([0.3, 0.1, 0.0], 0.01),
    "below the plane": ([0.3, 0.1, -0.2], 0.01),
    "as high as the centre": ([0.3, 0.1, 0.06], 0.01),
    "straight above, inside": ([0.0, 0.0, 0.1], 0.005),
    "NaN": ([np.nan, 0, 1], 0.01),
    "infinite": ([np.inf, 0, 1], 0.01),
    "no radius": ([0.1, -0.1, 0.3], 0.0),
    "negative radius": ([0.1, -0.1, 0.3], -1.0),
    "NaN radius": ([0.1, -0.1, 0.3], np.nan),
    "around the centre": ([0.1, -0.1, 0.3], 5.0),
    "at the centre": (CENTRE.tolist(), 0.0),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("where", [*EXTREMES, "a vertex", "dark"])
def test_extremes_are_finite(mesh, where, backend):
    if where == "a vertex":
        position, radius = np.asarray(mesh.vertices)[1000].tolist(), 0.0
    else:
        position, radius = EXTREMES.get(where, ([0.1, -0.1, 0.3], 0.01))
    arrow = np.asarray(position) - CENTRE
    distance = np.linalg.norm(arrow) if np.isfinite(arrow).all() and np.any(arrow) else 1.0
    towards = arrow / distance if np.isfinite(arrow).all() and np.any(arrow) else TOWARDS
    cube = lamp_map(max(abs(radius), 0.01) if radius == radius else 0.01, distance, towards=towards)
    if where == "dark":
        cube = fastibl.CubeMap(np.zeros((6, 16, 16, 3), np.float32))
    s, result = processed(mesh, placed(cube, [*position, radius]), MATERIALS["glossy"], backend)
    assert np.isfinite(s.object.rgba).all() and (s.object.rgba >= 0).all()
    ratio = np.asarray(result.shadow_map.image)
    assert np.isfinite(ratio).all() and ratio.min() >= 0 and ratio.max() <= 1 + 1e-4


def test_two_lamps_beside_each_other_are_counted_once(mesh):
    cube = lamp_map(0.03, 0.5)
    position = CENTRE + 0.5 * TOWARDS
    once = placed(cube, [*position, 0.03])
    twice = placed(cube, [[*position, 0.03], [*position + 0.001, 0.03]])
    a, _ = processed(mesh, once, self_shadow="none")
    b, _ = processed(mesh, twice, self_shadow="none")
    assert np.abs(a.object.rgba - b.object.rgba).max() < 0.01


@pytest.mark.parametrize("method", ["transfer", "ambient-occlusion", "none"])
def test_a_lamp_in_the_middle_of_the_map_changes_nothing_there(mesh, method):
    """A small object at the map's centre gets what the map gives it."""
    tiny = fastibl.Mesh((np.asarray(mesh.vertices) * 0.01 + CENTRE).astype(np.float32), np.asarray(mesh.triangles))
    eye = CENTRE + 0.01 * (EYE - CENTRE)
    pose = looking(CENTRE - eye, eye)
    cube = lamp_map(0.03, 0.5)
    layers = []
    for environment in (fastibl.Environment(cube, centre=CENTRE), placed(cube, [*(CENTRE + 0.5 * TOWARDS), 0.03])):
        scene = scene_of(tiny, fastibl.Material(diffuse=(1, 1, 1)), spheres=0)
        s = fastibl.Session(
            scene, fastibl.Rig(CAMERA), None, environment, error=0, methods={"bounce": "none", "self_shadow": method}
        )
        s.process(fastibl.Frame(0.0, back_from_marker=pose))
        layers.append(s.object.rgba)
    off = np.abs(layers[0] - layers[1])[..., :3] / layers[0][..., :3].mean()
    print(f"{method}: mean {off.mean():.5f}, worst {off.max():.4f}")
    assert off.mean() < 0.01


def test_arguments_are_checked():
    cube = fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32))
    with pytest.raises(ValueError, match="centre"):
        fastibl.Environment(cube, centre=[0.0, 1.0])
    with pytest.raises(ValueError, match="centre must be finite"):
        fastibl.Environment(cube, centre=[0.0, 1.0, np.nan])
    with pytest.raises(ValueError, match="lights"):
        fastibl.Environment(cube, lights=np.zeros((2, 3)))
    with pytest.raises(TypeError):
        fastibl.Environment(cube, lights=3.0)
    environment = fastibl.Environment(cube, centre=[0, 0, 1], lights=[[0, 0, 2, 0.1]])
    assert environment.centre == (0, 0, 1)
    assert environment.light_positions.tolist() == [[0, 0, 2, 0.1]]


SPHERES = np.array([[0.0, 0, 0.05, 0.03], [0.02, 0.01, 0.085, 0.02], [-0.03, 0.02, 0.01, 0.02]], np.float32)


def spheres_ratio(points, spheres, position, radius, facing, ambient, count=200):
    """By rays to the lamp's disc, and to even light."""
    sky = fastibl.texel_directions(40).reshape(-1, 3).astype(np.float64)
    angles = np.tile(np.asarray(fastibl.texel_solid_angles(40), float).ravel(), 6)
    sky /= np.linalg.norm(sky, axis=1, keepdims=True)
    sky, angles = sky[sky[:, 2] > 0], angles[sky[:, 2] > 0]
    radiance = facing / (np.pi * (radius / np.linalg.norm(position - CENTRE)) ** 2)

    def hidden(p, d, end=np.inf):
        out = np.zeros(len(d), bool)
        for *c, r in spheres.astype(float):
            m = np.array(c) - p
            along = d @ m
            inside = along**2 - m @ m + r * r
            first = along - np.sqrt(np.maximum(inside, 0))
            out |= (m @ m < r * r) | ((inside > 0) & (along > 0) & (first < end))
        return out

    result = []
    for x, y in points:
        p = np.array([x, y, 0.0])
        arrow = position - p
        d, solid_angle = over_sphere(arrow, radius, count)
        own = radiance * solid_angle / count * np.maximum(d[:, 2], 0)
        even = ambient * angles * sky[:, 2]
        kept = own[~hidden(p, d, np.linalg.norm(arrow))].sum() + even[~hidden(p, sky)].sum()
        result.append(kept / (own.sum() + even.sum()))
    return np.array(result)


@pytest.mark.parametrize("position", [CENTRE + 0.25 * TOWARDS, CENTRE + 0.5 * TOWARDS, np.array([0.2, 0.1, 0.09])])
def test_the_shadow_of_spheres_by_a_near_lamp(mesh, position):
    """The last lamp is lower than the object is high."""
    radius, facing = 0.01, 3.0
    arrow = position - CENTRE
    distance = np.linalg.norm(arrow)
    cube = lamp_map(radius, distance, facing, size=128, towards=arrow / distance)
    grid = np.linspace(-0.2, 0.2, 41)
    points = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    true = spheres_ratio(points, SPHERES, position, radius, facing, AMBIENT)
    shaded = 1 - true > 0.01
    rms = {}
    for name, environment in {"near": placed(cube, [*position, radius]), "distant": fastibl.Environment(cube)}.items():
        cast = fastibl.DirectionShadow(512).cast(environment, SPHERES)
        rms[name] = np.sqrt(((cast.sample(points[shaded].astype(np.float32))[:, 0] - true[shaded]) ** 2).mean())
    print(f"{distance:.2f} m: " + ", ".join(f"{k} {v:.4f}" for k, v in rms.items()))
    assert rms["near"] < 0.05
    assert rms["near"] < rms["distant"] / 2


ROOM = np.array([[-0.7, -0.9, 0.0], [0.8, 0.6, 1.1]])


def walls(points):
    """Radiance (..., 3) of the walls of a room, smooth and different everywhere."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    one = 1 + 0.7 * np.sin(4 * x + 1) * np.cos(3 * y) * np.cos(5 * z)
    return np.stack([one, 1 + 0.6 * np.sin(5 * y + 2 * z), 1 + 0.5 * np.cos(4 * x - 3 * z)], axis=-1)


def in_room(eye, d, yaw=0.0):
    c, s = np.cos(yaw), np.sin(yaw)
    to_walls = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])  # applied from the right
    eye, d = eye @ to_walls, d @ to_walls
    with np.errstate(divide="ignore"):
        t = np.where(d > 0, (ROOM[1] - eye) / d, (ROOM[0] - eye) / d).min(axis=-1)
    return walls(eye + t[..., None] * d)


def room_map(size=128, yaw=0.0):
    return fastibl.CubeMap(in_room(CENTRE, fastibl.texel_directions(size).astype(float), yaw).astype(np.float32))


def mirrored(places, middle, yaw):
    """What pixels show of a mirror ball."""
    d = CAMERA.unproject(places[:, ::-1] + 0.5) @ POSE.rotation
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    along = d @ (middle - EYE)
    t = along - np.sqrt(along**2 - np.sum((middle - EYE) ** 2) + 0.05**2)
    n = (EYE + t[:, None] * d - middle) / 0.05
    return in_room(EYE + t[:, None] * d, d - 2 * (d * n).sum(axis=1, keepdims=True) * n, yaw), (d * n).sum(axis=1)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("yaw", [0.0, 0.7])
@pytest.mark.parametrize("kind", ["mirror", "mip", "sampled", "pbr", "sampled pbr"])
def test_walls_of_a_box_are_seen_where_they_are(kind, yaw, backend):
    middle = np.array([0.06, 0.04, 0.05])
    ball = fastibl.Mesh(*icosphere(0.05, middle, 5))
    material = fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=1e5)
    methods = {"self_shadow": "none", **({"glossy": kind.split()[0]} if kind.startswith(("mip", "sampled")) else {})}
    if kind.endswith("pbr"):
        material = fastibl.Material.pbr((1, 1, 1), 1.0, 0.1)
    errors = {}
    for name, box in {"box": {"box": ROOM.tolist(), "box_yaw": yaw}, "infinity": {}}.items():
        environment = fastibl.Environment(room_map(yaw=yaw), centre=CENTRE, **box)
        s, _ = processed(ball, environment, material, backend, **methods)
        light, places = whole_pixels(s.object)
        true, facing = mirrored(places, middle, yaw)
        ours = np.abs(light - true)[facing < -0.5]  # towards the rim a pixel shows half the room
        errors[name] = np.sqrt((ours**2).mean()) / true.mean()
    print(kind, backend, yaw, errors)
    assert errors["box"] < (0.05 if kind.endswith("pbr") else 0.03)
    assert errors["box"] < errors["infinity"] / (2 if kind.endswith("pbr") else 3)


def test_a_box_without_its_centre_is_refused():
    with pytest.raises(ValueError, match="box must be finite and hold the centre"):
        fastibl.Environment(room_map(8), centre=[0.0, 0, 2], box=ROOM.tolist())


def test_a_light_nears_as_it_is_triangulated(mesh):
    """Found by capture, it is distant first, and then comes to be where it is without a jump."""
    from test_near_lights import CENTRE as middle
    from test_near_lights import LAMP, film

    capture = fastibl.Capture(size=64, centre=middle)
    true = 1 / np.linalg.norm(LAMP - middle)
    nearness = []

    def look(_):
        placed = [light.position for light in fastibl.Lighting(capture.environment()).lights if light.position]
        nearness.append(max((1 / np.linalg.norm(np.array(p) - middle) for p in placed), default=0.0) / true)

    film(capture, after=look)
    print(" ".join(f"{n:.2f}" for n in nearness))
    assert nearness[0] == 0 and nearness[-1] == pytest.approx(1, abs=0.03)
    assert np.abs(np.diff(nearness)).max() < 0.6
    environment = capture.environment()
    assert np.allclose(environment.centre, middle) and len(environment.light_positions) == 1
    s, result = processed(mesh, environment)
    assert result.lighting.lights[0].position is not None and "near_light" in result.passes


def test_a_lamp_comes_nearer_and_goes_away_in_steps(mesh):
    """In a session whose light moves: found 0.4 m away all at once, and no longer known to be near later."""
    cube, position = lamp_map(0.03, 0.4), CENTRE + 0.4 * TOWARDS
    s = session(mesh, fastibl.Environment(cube, centre=CENTRE))
    nearness = []
    for k in range(115):
        given = fastibl.CubeMap(cube.faces * np.float32(1 + 1e-4 * k))  # other light, by little
        known = [[*position, 0.03]] if 8 <= k < 60 else None
        s.set_environment(fastibl.Environment(given, centre=CENTRE, lights=known))
        lights = s.process(fastibl.Frame(k / 30, back_from_marker=POSE)).lighting.lights
        nearness.append(
            max((1 / np.linalg.norm(light.position - CENTRE) for light in lights if light.position), default=0)
        )
    print(" ".join(f"{n:.2f}" for n in nearness))
    steps = np.abs(np.diff(nearness))
    assert nearness[7] == 0 and nearness[59] == pytest.approx(2.5, rel=0.02) and nearness[-1] == 0
    assert (steps <= np.maximum(0.02, 0.1 * np.array(nearness[:-1])) + 1e-3).all()


@pytest.mark.parametrize("error", [0.02, 0.1])
def test_what_a_plan_chooses_moves_the_highlight_too(mesh, error):
    """Methods are judged under distant light: those that know no places are not chosen from where lights have some."""
    middle = CENTRE + [0.06, 0.03, 0.0]
    ball = fastibl.Mesh(*icosphere(0.05, middle))
    material = fastibl.Material(diffuse=(0.5, 0.5, 0.5), glossy=(0.1, 0.1, 0.1), exponent=30.0)
    position, radius = CENTRE + 0.15 * TOWARDS, 0.01
    environment = placed(lamp_map(radius, 0.15), [*position, radius])
    chosen, result = processed(ball, environment, material, error=error)
    exact, _ = processed(ball, environment, material, glossy="centroid")
    print(error, result.plan.methods)
    assert result.plan.methods.glossy.split()[0] in ("centroid", "stretched") and "lights=0" not in str(
        result.plan.methods
    )
    off = np.abs(whole_pixels(chosen.object)[0] - whole_pixels(exact.object)[0]).mean()
    assert off < 0.05 * whole_pixels(exact.object)[0].mean()
