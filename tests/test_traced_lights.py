"""Self-shadow by rays to the brightest light: `traced-lights`."""

import numpy as np
import pytest
from scenes import scene_of
from test_material import sphere
from test_near_shading import BACKENDS, lamp_map, over_sphere, placed
from test_self_shadow import BOXES, LENS, MATTE, free_from, lobe_weights, seen_of_boxes, share_picture, smooth_map

import fastibl
from conftest import in_picture
from fastibl import reference
from fastibl.extremes.views import looking

MATERIALS = {
    "matte": fastibl.Material(diffuse=(1, 1, 1)),
    "broad": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=16),
    "shiny": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=200),
    "ggx": fastibl.Material.pbr((1, 1, 1), metallic=1.0, roughness=0.45),
}
EYE, MIDDLE = np.array([-0.35, 0.1, 0.42]), np.array([0.05, 0, 0])


def lamp(direction, radiance=200.0, cosine=0.998, size=64):
    """A grey sky with a lamp; cosine: of its angular radius."""
    d = fastibl.texel_directions(size)
    faces = smooth_map(size=size).faces.mean(axis=-1, keepdims=True) * np.ones(3, np.float32)
    faces[d @ (np.array(direction) / np.linalg.norm(direction)) > cosine] = radiance
    return fastibl.CubeMap(faces)


def picture(session, pose):
    session.process(fastibl.Frame(0.0, back_from_marker=pose))
    return in_picture(session.object, LENS, np.float64)


def session_of(scene, cube, method="traced-lights", **more):
    methods = {"self_shadow": method, "bounce": "none", "diffuse": "irradiance-cube", "glossy": "centroid"}
    return fastibl.Session(scene, fastibl.Rig(LENS), environment=cube, methods=methods, **{"error": 0.0, **more})


@pytest.mark.parametrize("kind", list(MATERIALS))
def test_against_brute_force(kind):
    """What is left of the light at pixels of a box on which another box throws the shadow of a lamp: every texel, cut
    in four, against every triangle. Rays to all of the light stand beside it: where the shadow has its edge, a
    pixel's middle is not what is drawn of it."""
    material, cube = MATERIALS[kind], lamp((0.6, 0.15, 0.78), 800.0, 0.9995)
    pose = looking(MIDDLE - EYE, EYE)
    directions, angles, radiance = reference.samples(cube, 2)
    seen, triangle, t = seen_of_boxes(EYE, pose)
    scene = fastibl.Scene(BOXES, material, spheres=0)
    shares, whole = {}, None
    for method in ("traced-lights", "traced", "pixel-transfer", "transfer"):
        shares[method], whole = share_picture(scene, method, cube, pose)
    top = np.zeros(triangle.shape, bool)  # of the lower box; all of a pixel and its neighbours
    at = EYE + t[..., None] * seen
    top[triangle >= 0] = np.abs(at[triangle >= 0] - [0, 0, 0.05]).max(axis=-1) < 0.047
    top &= whole & (np.abs(at[..., 2] - 0.05) < 1e-4)
    rows, columns = np.nonzero(top)
    chosen = np.random.default_rng(0).permutation(len(rows))[:60]
    true, error = [], {method: [] for method in shares}
    normal = np.array([0, 0, 1.0])
    for y, x in zip(rows[chosen], columns[chosen], strict=True):
        place = at[y, x] + 1e-5 * normal
        free = free_from(BOXES, place, directions)
        view = (EYE - place) / np.linalg.norm(EYE - place)
        light = lobe_weights(material, normal, view, directions) * angles * radiance[:, 1]
        true.append((light * free).sum() / light.sum())
        for method, share in shares.items():
            error[method].append(share[y, x] - true[-1])
    rms = {method: float(np.sqrt(np.mean(np.square(e)))) for method, e in error.items()}
    print(f"{kind}: {len(true)} pixels, shares {min(true):.2f} to {max(true):.2f}; RMS {rms}")
    assert len(true) == 60 and max(true) - min(true) > 0.3
    assert rms["traced-lights"] < 1.2 * rms["traced"]
    if kind != "shiny":  # few of its pixels mirror the lamp
        assert rms["traced-lights"] < 0.5 * min(rms["transfer"], rms["pixel-transfer"])


@pytest.mark.parametrize("kind", list(MATERIALS))
def test_nearly_as_good_as_rays_to_all_of_the_light(kind):
    """On a round object, under a sun of half a degree that is in a texel of the map."""
    cube = fastibl.CubeMap(lamp((0.7, -0.3, 0.6), 3e3, np.cos(np.radians(0.6)), size=128).faces)
    scene = scene_of(fastibl.shapes.figurine(0.2), MATERIALS[kind], spheres=0)
    eye = np.array([0.3, -0.25, 0.25])
    pose = looking(np.array([0, 0, 0.09]) - eye, eye)
    made = {m: picture(session_of(scene, cube, m), pose) for m in ("traced", "traced-lights", "transfer")}
    whole = made["traced"][..., 3] == 1
    true = made["traced"][whole][:, :3]
    error = {m: np.sqrt(((p[whole][:, :3] - true) ** 2).mean()) / true.mean() for m, p in made.items()}
    print(f"{kind}: off rays to all of the light, RMS by the mean: {error}")
    assert error["traced-lights"] < 0.6 * error["transfer"]


def test_light_without_anything_bright_is_left_to_the_vertices():
    pose = looking(MIDDLE - EYE, EYE)
    for kind in ("matte", "broad"):
        scene = fastibl.Scene(BOXES, MATERIALS[kind], spheres=0)
        made = [picture(session_of(scene, smooth_map(), m), pose) for m in ("traced-lights", "pixel-transfer")]
        np.testing.assert_allclose(*made, atol=1e-6)


def test_what_hides_nothing_from_itself_is_left_as_it_is():
    eye = np.array([-0.2, 0.1, 0.2])
    pose = looking(-eye, eye)
    for kind in ("matte", "broad"):
        scene = fastibl.Scene(sphere(24), MATERIALS[kind], spheres=0)
        made = [picture(session_of(scene, lamp((0, 0, 1)), m), pose) for m in ("traced-lights", "transfer")]
        np.testing.assert_array_equal(*made)


def test_nothing_is_kept_of_another_light_turn_or_object():
    pose = looking(MIDDLE - EYE, EYE)
    boxes, figurine = (fastibl.Scene(m, MATTE, spheres=0) for m in (BOXES, fastibl.shapes.figurine(0.15)))
    turned = fastibl.Pose.from_rotation_vector(np.array([0.4, -0.9, 0.5]), np.array([0, 0, 0.02]))
    session = session_of(boxes, lamp((0.6, 0.15, 0.78)))
    first = picture(session, pose)
    session.set_environment(lamp((-0.2, 0.8, 0.5)))
    second = picture(session, pose)
    np.testing.assert_array_equal(second, picture(session_of(boxes, lamp((-0.2, 0.8, 0.5))), pose))
    session.move(turned)
    third = picture(session, pose)
    session.move(fastibl.Pose())
    session.set_environment(lamp((0.6, 0.15, 0.78)))
    np.testing.assert_array_equal(first, picture(session, pose))
    assert np.abs(first - second).max() > 0.1 and np.abs(third - second).max() > 0.1
    session.set_scene(figurine)
    np.testing.assert_array_equal(picture(session, pose), picture(session_of(figurine, lamp((0.6, 0.15, 0.78))), pose))


def test_a_turned_object_and_turned_light_look_the_same():
    """From an eye that is turned with both, by a quarter about z: each texel then is a texel again."""
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    direction = np.array([0.6, 0.15, 0.78])
    scene = fastibl.Scene(BOXES, MATERIALS["broad"], spheres=0)
    still = picture(session_of(scene, lamp(direction)), looking(MIDDLE - EYE, EYE))
    d = fastibl.texel_directions(64)
    grey = smooth_map(size=64)
    # The map is turned texel by texel: by the direction from which each of its texels came.
    order = {tuple(k): i for i, k in enumerate(np.round(d.reshape(-1, 3) * 1e4).astype(int))}
    source = [order[tuple(k)] for k in np.round(d.reshape(-1, 3) @ turn * 1e4).astype(int)]
    faces = lamp(direction).faces.reshape(-1, 3)[source].reshape(grey.faces.shape)
    placed = np.eye(4)
    placed[:3, :3] = turn
    scene = fastibl.Scene(BOXES, MATERIALS["broad"], placed, spheres=0)
    eye, middle = turn @ EYE, turn @ MIDDLE
    moved = looking(middle - eye, eye)
    made = picture(session_of(scene, fastibl.CubeMap(faces)), moved)
    difference = np.abs(made - still)[..., :3]
    print(f"differ by {difference.max():.4f}, RMS {np.sqrt((difference**2).mean()):.5f}, of {still.max():.2f}")
    assert np.sqrt((difference**2).mean()) < 2e-3 * still[..., :3].max()


@pytest.mark.parametrize("method", ["traced-lights", "traced"])
def test_parts_of_a_pixel_are_shaded_as_one_after_rays_went_from_each(method):
    """What rays find belongs to one triangle, though a budget lets parts that are alike be shaded as one."""
    scene = scene_of(fastibl.shapes.figurine(0.2), MATTE, spheres=0)
    eye = np.array([0.3, -0.25, 0.25])
    pose = looking(np.array([0, 0, 0.09]) - eye, eye)
    cube = lamp((0.7, -0.3, 0.6), 3e3, np.cos(np.radians(0.6)), size=128)
    apart, as_one = (picture(session_of(scene, cube, method, error=e), pose)[..., :3] for e in (0.0, 0.02))
    off = np.sqrt(((apart - as_one) ** 2).mean()) / apart.mean()
    print(f"{method}: RMS {off:.5f} of the mean, largest {np.abs(apart - as_one).max() / apart.mean():.3f}")
    assert 0 < off < 2e-3


@pytest.mark.parametrize("name", ["black", "one texel of 4", "one texel of 1", "1e8", "below", "grazing", "many lamps"])
def test_extreme_light(name):
    """Nothing is lit more than without the object's own shadow, and nothing is negative or undefined."""
    d = fastibl.texel_directions(32)
    faces = np.full((6, 32, 32, 3), 0.5, np.float32)
    if name == "black":
        faces[:] = 0
    elif name.startswith("one texel"):
        size = int(name[-1])
        faces = np.full((6, size, size, 3), 0.01, np.float32)
        faces[4, 0, 0] = 100
    elif name == "many lamps":
        faces[np.random.default_rng(0).random(faces.shape[:3]) < 0.02] = (300, 100, 0)
    else:
        towards = {"1e8": (0.6, 0.15, 0.78), "below": (0.3, 0.2, -0.9), "grazing": (0.9, 0.4, 0.01)}[name]
        faces[d @ (np.array(towards) / np.linalg.norm(towards)) > 0.999] = 1e8 if name == "1e8" else 1e3
    cube, pose = fastibl.CubeMap(faces), looking(MIDDLE - EYE, EYE)
    for kind in ("matte", "shiny", "ggx"):
        scene = fastibl.Scene(BOXES, MATERIALS[kind], spheres=0)
        made, bare = (picture(session_of(scene, cube, m), pose)[..., :3] for m in ("traced-lights", "none"))
        assert np.isfinite(made).all() and (made >= 0).all()
        assert (made <= bare * (1 + 1e-3) + 1e-6).all()


def test_same_bits_for_any_threads():
    pose = looking(MIDDLE - EYE, EYE)
    cube, before, made = lamp((0.6, 0.15, 0.78)), fastibl.threads(), []
    scene = fastibl.Scene(BOXES, fastibl.Material(glossy=(0.3, 0.3, 0.3), exponent=50), spheres=0)
    try:
        for threads in (1, 2, 3):
            fastibl.set_threads(threads)
            made.append(picture(session_of(scene, cube), pose))
    finally:
        fastibl.set_threads(before)
    np.testing.assert_array_equal(made[0], made[1])
    np.testing.assert_array_equal(made[0], made[2])


def test_a_plan_chooses_it_under_a_lamp():
    """Where vertices leave too much wrong; under an even sky they do not."""
    scene = scene_of(fastibl.shapes.figurine(0.2), MATTE, spheres=20)
    under = fastibl.make_plan(scene, lamp((0.7, -0.3, 0.6), 2e3), error=0.02, track=False)
    even = fastibl.make_plan(scene, smooth_map(), error=0.02, track=False)
    print(f"lamp: {under.methods.self_shadow}, {under.best_error:.4f}; even: {even.methods.self_shadow}")
    assert under.methods.self_shadow == "traced-lights" and "rays to the brightest light" in str(under)
    assert even.methods.self_shadow == "transfer"
    by_vertex = fastibl.make_plan(
        scene, lamp((0.7, -0.3, 0.6), 2e3), error=0.02, track=False, methods={"self_shadow": "transfer"}
    )
    assert under.best_error < 0.7 * by_vertex.best_error


RADIUS = 0.02  # of the lamp nearby


def lamp_beside_boxes(distance, ambient):
    """A map with a lamp at this distance from its centre that one box keeps from the other, its place, and its radiance
    beyond the even light."""
    centre, facing = np.array([-0.06, 0.0, 0.05]), 3.0
    towards = np.array([0.8, 0.2, 0.5]) / np.linalg.norm([0.8, 0.2, 0.5])
    position = centre + distance * towards
    cube = lamp_map(RADIUS, distance, facing, size=128, centre=centre, ambient=ambient, towards=towards)
    return placed(cube, [*position, RADIUS], centre), position, facing / (np.pi * (RADIUS / distance) ** 2)


def top_of_a_box():
    """A pose, the places (h, w, 3) that its pixels show, and which of them are on the lower box's top."""
    pose = looking(MIDDLE - EYE, EYE)
    seen, triangle, t = seen_of_boxes(EYE, pose)
    at = EYE + t[..., None] * seen
    top = (triangle >= 0) & (np.abs(np.where(triangle[..., None] >= 0, at, 1) - [0, 0, 0.05]).max(axis=-1) < 0.047)
    return pose, at, top & (np.abs(at[..., 2] - 0.05) < 1e-4)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("distance", [0.25, 0.6])
def test_the_shadow_of_a_lamp_nearby(distance, backend):
    """On a box, of another box, by rays to places all over the lamp. In the map, the lamp stands elsewhere than as the
    pixels see it."""
    light, position, radiance = lamp_beside_boxes(distance, ambient=0.0)
    pose, at, top = top_of_a_box()
    made = {}
    for method in ("traced-lights", "traced", "transfer")[:: 1 if backend == "cpu" else 2]:
        scene = fastibl.Scene(BOXES, MATERIALS["matte"], spheres=0)
        made[method] = picture(session_of(scene, light, method, backend=backend), pose)
        top &= made[method][..., 3] == 1
    rows, columns = np.nonzero(top)
    true, error, up = [], {method: [] for method in made}, np.array([0, 0, 1.0])
    for y, x in zip(rows, columns, strict=True):
        place = at[y, x] + 1e-5 * up
        d, solid_angle = over_sphere(position - place, RADIUS, 300)
        true.append(radiance * solid_angle * (np.maximum(d @ up, 0) * free_from(BOXES, place, d)).mean() / np.pi)
        for method, colours in made.items():
            error[method].append(colours[y, x, 1] - true[-1])
    rms = {method: float(np.sqrt(np.mean(np.square(e))) / np.mean(true)) for method, e in error.items()}
    dark = np.mean(np.array(true) < 0.01 * max(true))
    print(f"{distance} m, {backend}: {len(true)} pixels, {100 * dark:.0f} % in shadow; RMS by their mean {rms}")
    assert len(true) > 200 and 0.1 < dark < 0.9
    for method in rms.keys() - {"transfer"}:
        assert rms[method] < 0.5 * rms["transfer"]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", ["broad", "ggx"])
def test_a_lamp_nearby_in_a_lobe(kind, backend):
    """The free share of glossy light on a box: a lobe sees the lamp where it is, and another box may hide it there."""
    material, ambient = MATERIALS[kind], 0.2
    light, position, radiance = lamp_beside_boxes(0.25, ambient)
    pose, at, top = top_of_a_box()
    scene = fastibl.Scene(BOXES, material, spheres=0)
    limits = {"traced-lights": 0.04, "transfer": 0.08, "pixel-transfer": 0.08}  # 0.3 by the map's directions
    made = {m: picture(session_of(scene, light, m, backend=backend), pose) for m in (*limits, "none")}
    top &= made["none"][..., 3] == 1
    shares = {m: made[m][..., 1] / np.where(top, made["none"][..., 1], 1) for m in limits}
    rows, columns = np.nonzero(top)
    chosen = np.random.default_rng(0).permutation(len(rows))[:80]
    sky, angles, _ = reference.samples(np.zeros((6, 48, 48, 3)))
    true, error, up = [], {method: [] for method in shares}, np.array([0, 0, 1.0])
    for y, x in zip(rows[chosen], columns[chosen], strict=True):
        place = at[y, x] + 1e-5 * up
        view = (EYE - place) / np.linalg.norm(EYE - place)
        lamp_d, solid_angle = over_sphere(position - place, RADIUS, 300)
        d = np.concatenate([sky, lamp_d])
        flux = np.concatenate([ambient * angles, np.full(300, radiance * solid_angle / 300)])
        flux = flux * lobe_weights(material, up, view, d)
        true.append((flux * free_from(BOXES, place, d)).sum() / flux.sum())
        for method, share in shares.items():
            error[method].append(share[y, x] - true[-1])
    rms = {method: float(np.sqrt(np.mean(np.square(e)))) for method, e in error.items()}
    print(f"{kind}, {backend}: {len(true)} pixels, shares {min(true):.2f} to {max(true):.2f}; RMS {rms}")
    assert len(true) == 80 and max(true) - min(true) > 0.3
    for method, limit in limits.items():
        assert rms[method] < limit
