"""Which side of a triangle is seen: meshes that are inside out, and the backs of open ones, on both back ends."""

import numpy as np
import pytest
from scenes import scene_of
from test_gl import needs_gl
from test_near_shading import CENTRE, lamp_map, placed
from test_place import ball

import fastibl
from views import camera_of, looking

BACKENDS = ["cpu", pytest.param("gl", marks=needs_gl)]
EYE = np.array([0.15, -0.3, 0.25])
CAMERA, POSE = camera_of(160, 120, 30.0), looking(CENTRE - EYE, EYE)


def colours_of(mesh, source, material=None, backend="cpu", **options):
    """RGB of the object over the whole picture."""
    scene = scene_of(mesh, material or fastibl.Material(diffuse=(0.7, 0.6, 0.5)))
    session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=source, backend=backend, **options)
    session.process(fastibl.Frame(0.0, back_from_marker=POSE))
    layer, out = session.object, np.zeros((CAMERA.height, CAMERA.width, 3))
    h, w = layer.rgba.shape[:2]
    out[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba[..., :3]
    return out


def off(a, b):
    """RMS difference by the mean, over what either shows."""
    shown = (a.sum(axis=-1) > 0) | (b.sum(axis=-1) > 0)
    return np.sqrt(((a - b)[shown] ** 2).mean()) / a[shown].mean()


def smooth(mesh):
    """With one normal a vertex: no sharp edges."""
    return fastibl.Mesh(mesh.vertices, mesh.triangles, None, mesh.normals)


def reversed_of(mesh, normals=False):
    return fastibl.Mesh(mesh.vertices, mesh.triangles[:, ::-1], None, mesh.normals if normals else None)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("outward_normals", [False, True])
def test_a_closed_mesh_that_is_inside_out_is_turned(backend, outward_normals):
    given, light = smooth(fastibl.shapes.figurine(0.12)), lamp_map(0.05, 0.4, size=32)
    right = fastibl.Mesh(given.vertices, given.triangles)  # its normals and sharp edges are found
    wrong = off(
        colours_of(given if outward_normals else right, light, backend=backend),
        colours_of(reversed_of(given, outward_normals), light, backend=backend),
    )
    print(f"a figurine with its triangles the wrong way round: {wrong:.1e} off")
    assert wrong < 1e-5


def test_inward_normals_of_a_mesh_inside_out_are_turned_too():
    given, light = smooth(fastibl.shapes.figurine(0.12)), lamp_map(0.05, 0.4, size=32)
    inside_out = fastibl.Mesh(given.vertices, given.triangles[:, ::-1], None, -given.normals)
    assert off(colours_of(given, light), colours_of(inside_out, light)) < 1e-5


def test_an_open_mesh_runs_as_its_normals_say():
    given, light = smooth(fastibl.shapes.figurine(0.12)), lamp_map(0.05, 0.4, size=32)
    kept = np.arange(len(given.triangles)) > 0
    right = fastibl.Mesh(given.vertices, given.triangles[kept], None, given.normals)
    assert off(colours_of(right, light), colours_of(reversed_of(right, True), light)) < 1e-5


def test_a_closed_mesh_of_which_half_is_inside_out_is_lit_on_both_sides():
    """Its parts cannot be told apart from a cavity: what is seen of backs is lit as what is seen of fronts."""
    one, light = ball(), fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32))
    n = len(one.vertices)
    two = np.concatenate([one.vertices + [-0.04, 0, 0], one.vertices + [0.04, 0, 0]])
    triangles = np.concatenate([one.triangles, one.triangles[:, ::-1] + n])
    right = np.concatenate([one.triangles, one.triangles + n])
    a, b = (colours_of(fastibl.Mesh(two, t), light) for t in (right, triangles))
    print(f"one of two balls inside out: {off(a, b):.1%} off")
    assert off(a, b) < 0.05


def sheet(steps=12):
    """A wavy sheet that the camera sees from one side, its triangles one way and the other."""
    x, y = np.meshgrid(*[np.linspace(-0.06, 0.06, steps + 1)] * 2)
    points = np.stack([x, y, 0.06 + 0.5 * y + 0.02 * np.cos(40 * x)], axis=-1).reshape(-1, 3)
    i = np.arange((steps + 1) ** 2).reshape(steps + 1, -1)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    uvs = np.stack([x, y], axis=-1).reshape(-1, 2) / 0.12 + 0.5
    return [fastibl.Mesh(points, t, uvs) for t in (triangles, triangles[:, ::-1])]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("self_shadow", ["none", "transfer"])
def test_backs_of_an_open_mesh_are_lit_by_near_lights_and_not_by_the_bounce_of_fronts(backend, self_shadow):
    front, back = sheet()
    lamp = placed(lamp_map(0.02, 0.3), [0.15, -0.12, 0.27, 0.02])
    for light, bounce in ((lamp, "none"), (lamp_map(0.05, 0.4), "one-bounce")):
        methods = {"self_shadow": self_shadow, "bounce": bounce}
        a, b = (colours_of(mesh, light, None, backend, methods=methods, error=None) for mesh in (front, back))
        print(f"{self_shadow}, bounce {bounce}: back against front {off(a, b):.1e}")
        assert off(a, b) < 1e-3


@pytest.mark.parametrize("backend", BACKENDS)
def test_backs_show_bumps_as_dents(backend):
    front, back = sheet()
    light = lamp_map(0.05, 0.4)
    bump = np.ones((16, 16, 3))
    bump[..., :2] = 0.4 * np.random.default_rng(0).uniform(-1, 1, (16, 16, 2))

    def picture(mesh, sign):
        normal = (bump * [sign, sign, 1] * 0.5 + 0.5).astype(np.float32)
        return colours_of(mesh, light, fastibl.Material.pbr((0.7,) * 3, 0.0, 0.6, normal=normal), backend, error=None)

    dent, same = off(picture(back, 1), picture(front, -1)), off(picture(back, 1), picture(front, 1))
    brushed = fastibl.Material.pbr((0.8,) * 3, 0.9, 0.4, anisotropy=0.7, anisotropy_rotation=0.5)
    alone = {"methods": {"self_shadow": "none", "bounce": "none"}, "error": None}
    turned = [colours_of(mesh, light, brushed, backend, **alone) for mesh in (front, back)]
    print(f"a back with bumps: {dent:.1e} from a front with dents, {same:.0%} from one with bumps")
    assert dent < 1e-3 < 0.05 < same
    assert off(*turned) < 1e-3
