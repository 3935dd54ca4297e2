"""Self-shadow by pixel on the GL back end mirrors the CPU's: the same rays, cells and lobes, in shaders."""

import numpy as np
import pytest
from scenes import scene_of
from test_gl import MOVED, POSES, camera_named, compare_products, needs_gl, torus
from test_near_shading import lamp_map, placed
from test_self_shadow import BOXES, smooth_map
from test_traced_lights import MATERIALS, lamp

import fastibl

pytestmark = needs_gl
METHODS = ["pixel-transfer", "traced-lights"]
STATUE = fastibl.shapes.figurine(0.1)
METHODS_BUT_ONE = {"bounce": "none", "diffuse": "irradiance-cube", "glossy": "centroid"}
CAMERA = camera_named("pinhole")
SUN = (0.5, -0.5, 0.7)
PBR = {
    "both": fastibl.Material.pbr((0.8, 0.5, 0.3), metallic=0.5, roughness=0.4),
    "satin": fastibl.Material(diffuse=(0.5, 0.4, 0.3), glossy=(0.3, 0.3, 0.3), exponent=40),
}


def drawn(scene, method, backend, camera=CAMERA, light=None, pose="usual", frames=1, **options):
    """Session and result, of the last of some frames."""
    methods = METHODS_BUT_ONE | {"self_shadow": method} | options.pop("methods", {})
    session = fastibl.Session(
        scene,
        fastibl.Rig(camera),
        environment=light or lamp(SUN, 800.0, 0.9995),
        methods=methods,
        backend=backend,
        error=0,
        **options,
    )
    for k in range(frames):
        frame = fastibl.Frame(k / 10, back_from_marker=POSES[pose] if isinstance(pose, str) else pose)
        result = session.process(frame)
    assert session.backend == backend and result.plan.methods.self_shadow == method
    return session, result


def both(scene, method, **options):
    """Of the CPU, then of GL, and of how many pixels GL's are not as vertices alone would have them."""
    made = [drawn(scene, method, backend, **options) for backend in ("cpu", "gl")]
    by_vertex = drawn(scene, "transfer", "gl", **options)[0].object.rgba
    return made, (np.abs(made[1][0].object.rgba - by_vertex).max(axis=-1) > 0.003 * by_vertex.max()).sum()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", [*MATERIALS, *PBR])
def test_mirror_by_material(kind, method):
    scene = scene_of(STATUE, (MATERIALS | PBR)[kind], spheres=0)
    made, changed = both(scene, method)
    compare_products(made, object_tolerance=2e-3)
    if method == "traced-lights" or kind != "matte":
        assert changed > 20


@pytest.mark.parametrize("diffuse", ["six-face", "sh9", "sh9-lobes"])
def test_mirror_by_method(diffuse):
    made, changed = both(scene_of(STATUE, PBR["satin"], spheres=0), "traced-lights", methods={"diffuse": diffuse})
    compare_products(made, object_tolerance=2e-3)
    assert changed > 20


@pytest.mark.parametrize("method", METHODS)
def test_an_object_that_is_turned(method):
    scene = fastibl.Scene(STATUE, PBR["satin"], spheres=0, marker_from_object=MOVED)
    made, changed = both(scene, method, pose="rolled")
    compare_products(made, object_tolerance=2e-3)
    assert changed > 20


@pytest.mark.parametrize("lens", ["pinhole", "barrel"])
@pytest.mark.parametrize("pose", ["near", "inside"])
def test_triangles_that_are_cut(pose, lens):
    """At the picture's edges, behind the camera, and where a lens bends the long edges of a box."""
    for mesh in (torus(), BOXES):
        scene = scene_of(mesh, PBR["satin"], spheres=0, refine=False)
        made, _ = both(scene, "traced-lights", pose=pose, camera=camera_named(lens))
        if made[0][0].object.rgba.size:
            compare_products(made, object_tolerance=2e-3)


def test_the_inside_of_an_open_mesh():
    """Its vertices have backs, which know for themselves what is hidden from them."""
    low = fastibl.Mesh(STATUE.vertices, STATUE.triangles[STATUE.vertices[STATUE.triangles][..., 1].min(axis=1) > -0.01])
    made, changed = both(scene_of(low, PBR["satin"], spheres=0), "traced-lights")
    compare_products(made, object_tolerance=2e-3)
    assert changed > 20


def test_light_of_the_plane_and_of_lamps_nearby_stays():
    """What rays find takes the place of the map's part of the shares alone."""
    light = placed(lamp_map(0.05, 0.4, size=32), [0.0, 0.1, 0.4, 0.05])
    scene = scene_of(STATUE, PBR["satin"], spheres=20)
    made, _ = both(scene, "traced-lights", light=light, methods={"bounce": "one-bounce"}, frames=2)
    compare_products(made, object_tolerance=2e-3)
    alone = drawn(scene, "traced-lights", "gl", light=light)[0].object.rgba
    assert np.abs(alone - made[1][0].object.rgba).max() > 0.005


def test_painted_vertices_holdouts_and_more_samples():
    colors = np.abs(np.sin(40 * STATUE.vertices)).astype(np.float32)
    painted = fastibl.Mesh(STATUE.vertices, STATUE.triangles, None, STATUE.normals, colors)
    scene = fastibl.Scene(painted, PBR["satin"], spheres=0)
    board = np.array([[-0.1, -0.09, 0.0], [0.02, -0.09, 0.0], [0.02, -0.09, 0.05], [-0.1, -0.09, 0.05]])
    scene.holdouts = [fastibl.Mesh(board, np.array([[0, 1, 2], [0, 2, 3]]))]
    made, changed = both(scene, "traced-lights", supersampling=2)
    compare_products(made, object_tolerance=2e-3)
    assert made[1][0].holdout.rgba[..., 3].any() and changed > 20


@pytest.mark.parametrize("width,height", [(8800, 24), (24, 12000)])
def test_an_object_as_large_as_half_a_texture(width, height):
    """The parts of pixels have tiles beside each other, or else in a row or a column."""
    camera = fastibl.Camera(width, height, 50000, 50000, width / 2, height / 2)
    made, _ = both(scene_of(torus(), PBR["satin"], spheres=0), "traced-lights", camera=camera)
    assert max(made[1][0].object.rgba.shape[:2]) > 8192
    compare_products(made, object_tolerance=2e-3)


def test_nothing_is_kept_of_another_light_method_pose_or_object():
    """One session through all of them, and new ones for each."""
    lights = [lamp(SUN, 800.0, 0.9995), lamp((-0.6, -0.3, 0.7), 50.0, 0.98), smooth_map()]
    scenes = [
        fastibl.Scene(STATUE, PBR["satin"], spheres=0),
        fastibl.Scene(torus(around=30), MATERIALS["matte"], spheres=0, marker_from_object=MOVED),
    ]
    session, _ = drawn(scenes[0], "traced-lights", "gl")
    for k, (light, scene, method) in enumerate(
        [(1, 0, "traced-lights"), (1, 0, "pixel-transfer"), (0, 0, "traced-lights"), (2, 1, "traced-lights")]
        + [(0, 1, "pixel-transfer"), (0, 1, "traced-lights"), (0, 0, "transfer"), (0, 0, "traced-lights")]
    ):
        session.set_scene(scenes[scene])
        session.set_environment(lights[light])
        session.set_methods(METHODS_BUT_ONE | {"self_shadow": method})
        pose = POSES["rolled" if k % 2 else "usual"]
        session.process(fastibl.Frame(1.0 + k, back_from_marker=pose))
        fresh, _ = drawn(scenes[scene], method, "gl", light=lights[light], pose=pose)
        np.testing.assert_array_equal(session.object.rgba, fresh.object.rgba)


def extreme_lights():
    texel = np.zeros((6, 4, 4, 3), np.float32)
    texel[4, 1, 2] = 1e6
    many = np.full((6, 32, 32, 3), 0.01, np.float32)
    many[:, ::6, ::6] = 50
    return {
        "black": np.zeros((6, 8, 8, 3), np.float32),
        "one texel of four": texel,
        "1e8": 1e8 * lamp(SUN).faces,
        "1e-25": 1e-25 * lamp(SUN).faces,
        "below": lamp((0, 0, -1)).faces,
        "grazing": lamp((1, 0, 0.02)).faces,
        "many lamps": many,
    }


@pytest.mark.parametrize("name", extreme_lights())
def test_extreme_light(name):
    light = fastibl.CubeMap(extreme_lights()[name])
    for material in (PBR["satin"], MATERIALS["ggx"]):
        made, _ = both(scene_of(STATUE, material, spheres=0), "traced-lights", light=light)
        assert np.isfinite(made[1][0].object.rgba).all() and (made[1][0].object.rgba >= 0).all()
        # At sharp edges of light, GL's chain itself shows 1 % of it more or less to GGX's taps.
        if name not in ("many lamps", "one texel of four") or material is PBR["satin"]:
            compare_products(made, object_tolerance=2e-3)


def test_a_plan_chooses_it_there_too():
    """Under a lamp, and it says the same error for both back ends."""
    scene = scene_of(BOXES, MATERIALS["matte"], spheres=0)
    said = []
    for backend in ("cpu", "gl"):
        session = fastibl.Session(
            scene, fastibl.Rig(CAMERA), environment=lamp(SUN, 800.0, 0.9995), backend=backend, error=1e-3
        )
        for k in range(40):
            plan = session.process(fastibl.Frame(k / 30, back_from_marker=POSES["usual"])).plan
        said.append((plan.methods.self_shadow, plan.best_error))
    assert said[0] == said[1] and said[0][0] == "traced-lights"
