"""Colours of a mesh's vertices: what they multiply, on both back ends, and the files that hold them."""

import pickle

import numpy as np
import pytest
from test_gl import marked_map, needs_gl, torus
from test_material import ABOVE, CAMERA, CENTRE, EYE, FROM_ABOVE, POSE, WHITE, layer_of, sphere, square
from test_mesh_files import POINTS, Gltf

import fastibl
from conftest import same_error
from fastibl.files import mesh_and_material
from fastibl.truth import TrueRenderer
from views import camera_of, looking

BACKENDS = ["cpu", pytest.param("gl", marks=needs_gl)]
RED = (0.7, 0.2, 0.1)


def painted(mesh, colors):
    colors = np.broadcast_to(np.asarray(colors, np.float32), mesh.vertices.shape)
    return fastibl.Mesh(mesh.vertices, mesh.triangles, mesh.uvs, mesh._given_normals, colors)


def stripes(mesh):
    """Dark, bright and dark from low to high, another in each channel."""
    z = (mesh.vertices[:, 2:] - mesh.vertices[:, 2].min()) / np.ptp(mesh.vertices[:, 2])
    return painted(mesh, 0.5 + 0.5 * np.sin(5 * z + [0, 2, 4]))


def decoded(code):
    x = np.asarray(code, float) / 255
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


# --- what they are


def test_values():
    mesh = painted(square(), np.eye(4)[:, :3])
    assert mesh.colors.shape == (4, 3) and mesh.colors.dtype == np.float32 and square().colors is None
    assert pickle.loads(pickle.dumps(mesh)) == mesh != square()
    np.testing.assert_array_equal(fastibl.stand(painted(sphere(8), RED), 0.1).colors[:3], np.float32([RED] * 3))
    corners, triangles = np.eye(3), [[0, 1, 2]]
    make = lambda colors: fastibl.Mesh(corners, triangles, colors=colors)  # noqa: E731
    same_error(lambda: make(np.ones((2, 3))), ValueError, "3 vertices", "colours", "2")
    same_error(lambda: make(np.ones(3)), ValueError, "colors", "(v, 3)", "(3,)")
    same_error(lambda: make(np.full((3, 3), 1.5)), ValueError, "colour 0", "0 to 1", "1.5")
    same_error(lambda: make(np.full((3, 3), np.nan)), ValueError, "colour 0", "nan")
    same_error(lambda: make(np.ones((3, 3), int)), TypeError, "colors")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", ["diffuse", "satin", "matte", "pbr", "metal", "brushed"])
def test_one_colour_is_that_of_the_material(kind, backend):
    """Vertices that are all red look as a red material does; what Eq. 3 reflects as gloss keeps its own colour."""
    make = {
        "diffuse": lambda c: fastibl.Material(diffuse=c),
        "satin": lambda c: fastibl.Material(diffuse=c, glossy=(0.3, 0.3, 0.3), exponent=40, emission=(0.1, 0, 0)),
        "matte": lambda c: fastibl.Material(diffuse=c, glossy=(0.1, 0.1, 0.1), exponent=0),
        "pbr": lambda c: fastibl.Material.pbr(c, 0.0, 0.4),
        "metal": lambda c: fastibl.Material.pbr(c, 1.0, 0.3),
        "brushed": lambda c: fastibl.Material.pbr(c, 0.6, 0.3, anisotropy=0.5),
    }[kind]
    of_material = layer_of(torus(), make(RED), marked_map(), backend=backend)
    of_vertices = layer_of(painted(torus(), RED), make((1.0, 1.0, 1.0)), marked_map(), backend=backend)
    assert (of_material[..., 3] > 0).sum() > 1000
    print(kind, backend, np.abs(of_vertices - of_material).max())
    # Where a lobe is narrow, how often a pixel is shaded goes by how much of the material's own light is glossy.
    off = np.abs(of_vertices - of_material).max(axis=-1) > 3e-6 * of_material.max()
    assert off.sum() <= (60 if kind == "brushed" else 0)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("pbr", [False, True])
def test_colours_run_straight_between_vertices(pbr, backend):
    """A square from above under even light: the colour at a place is the bilinear one of its corners."""
    corners = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], float)
    emission = (0.0, 0.0, 0.0)
    material = fastibl.Material.pbr((1, 1, 1), 0.0, 1.0) if pbr else fastibl.Material((1, 1, 1), emission=emission)
    white = layer_of(square(), material, WHITE, FROM_ABOVE, ABOVE, backend)[..., :3]
    got = layer_of(painted(square(), corners), material, WHITE, FROM_ABOVE, ABOVE, backend)[..., :3]
    x, y = np.meshgrid((np.arange(64) + 0.5) / 64, 1 - (np.arange(64) + 0.5) / 64)
    # Its two triangles meet along the diagonal from the first corner to the third.
    lower = np.stack([1 - x, x - y, y, 0 * x], axis=-1)
    upper = np.stack([1 - y, 0 * x, x, y - x], axis=-1)
    expected = np.where((x >= y)[..., None], lower, upper) @ corners
    inside = np.zeros((64, 64), bool)
    inside[3:-3, 3:-3] = True
    inside &= np.abs(x - y) > 0.03
    if pbr:  # 4 % are reflected by what lies on the colour, and less passes through it
        black = layer_of(painted(square(), 0 * corners), material, WHITE, FROM_ABOVE, ABOVE, backend)[..., :3]
        white, got = white - black, got - black
    error = np.abs(got - expected * white)[inside]
    print(backend, pbr, error.max())
    assert error.max() < 2e-4


@needs_gl
def test_both_back_ends_agree_where_a_mesh_is_cut():
    """The camera stands within the object: corners that are new where it is cut have the colours between theirs."""
    mesh = stripes(sphere(24))
    inside = looking(CENTRE - EYE, (0.01, 0.02, 0.04))
    for pose in (POSE, inside):
        for material in (
            fastibl.Material((1, 1, 1), glossy=(0.2, 0.2, 0.2), exponent=30),
            fastibl.Material.pbr((1, 1, 1)),
        ):
            cpu, gl = (layer_of(mesh, material, marked_map(), CAMERA, pose, b) for b in ("cpu", "gl"))
            covered = (cpu[..., 3] == 1) & (gl[..., 3] == 1)
            difference = np.abs(cpu - gl)[covered]
            print(covered.sum(), difference.max(), cpu[covered].std(axis=0))
            assert covered.sum() > 1000 and np.quantile(difference, 0.999) < 2e-3 * cpu.max()


@pytest.mark.parametrize(("pbr", "most"), [(False, 0.01), (True, 0.025)])  # of a white one 0.003 and 0.01
def test_a_picture_of_a_painted_object_against_the_truth(pbr, most):
    """By the methods that the plan chooses. Gloss is not painted: its error counts for more of what is dark."""
    material = fastibl.Material.pbr((1, 1, 1), 0.0, 0.6) if pbr else fastibl.Material((0.9, 0.9, 0.9))
    camera, back = camera_of(40, 30, 26.0), np.full((30, 40, 3), 90, np.uint8)
    scene = fastibl.Scene(stripes(sphere(24)), material)
    session = fastibl.Session(scene, fastibl.Rig(camera), environment=marked_map(), methods={"bounce": "none"})
    session.process(fastibl.Frame(0.0, back=back, back_exposure=0.2, back_from_marker=POSE))
    truth = TrueRenderer(scene, extent=0.25, grid=8, bounce=False).render(back, 0.2, camera, POSE, marked_map())
    layer, covered = np.zeros_like(truth.linear), truth.coverage == 1
    shown = session.object
    h, w = shown.rgba.shape[:2]
    layer[shown.y : shown.y + h, shown.x : shown.x + w] = 0.2 * shown.rgba[..., :3]
    error = np.sqrt(((layer - truth.linear)[covered] ** 2).mean())
    mean, spread = truth.linear[covered].mean(), truth.linear[covered].std()
    print(f"{error / mean:.2%} off, of a picture that varies by {spread / mean:.0%}")
    assert spread > 0.4 * mean and error < most * mean


def test_new_vertices_and_what_the_plane_gets():
    """Vertices that a scene adds have the colours between theirs; the bounce is that of a material of the colour."""
    mesh = fastibl.stand(fastibl.shapes.figurine(), 0.15)
    gains = []
    for kind in ("material", "vertices"):
        body = painted(mesh, RED) if kind == "vertices" else mesh
        scene = fastibl.Scene(body, fastibl.Material((1, 1, 1) if kind == "vertices" else RED))
        session = fastibl.Session(
            scene, fastibl.Rig(CAMERA), environment=marked_map(), methods={"bounce": "one-bounce"}
        )
        session.process(fastibl.Frame(0.0, back_from_marker=POSE))
        gains.append(session.plane_gain.sample(np.random.default_rng(0).uniform(-0.1, 0.1, (500, 2))))
    assert np.ptp(gains[0]) > 0.1
    np.testing.assert_allclose(gains[1], gains[0], atol=1e-5)
    ramp = painted(mesh, np.clip(mesh.vertices[:, 2:] / 0.15, 0, 1))
    refined = fastibl.Scene(ramp, fastibl.Material()).refined_mesh
    assert refined.colors is not None and len(refined.colors) == len(refined.vertices) > len(mesh.vertices)
    np.testing.assert_allclose(refined.colors[:, 0], refined.vertices[:, 2] / 0.15, atol=0.02)


# --- files


def obj_of(colors):
    lines = [f"v {x} {y} {z} {c}" for (x, y, z), c in zip([(0, 0, 0), (1, 0, 0), (0, 0, -1)], colors, strict=True)]
    return "\n".join([*lines, "f 1 2 3"])


def test_obj(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(obj_of(["0.5 0.25 1", "0 0 0", "1 1 1"]))
    assert fastibl.read_mesh(path).colors is None
    got = fastibl.read_mesh(path, up="z", colors=True)
    np.testing.assert_allclose(got.colors, decoded([[127.5, 63.75, 255], [0, 0, 0], [255] * 3]), atol=1e-6)
    np.testing.assert_array_equal(fastibl.read_mesh(path, colors=True).colors, got.colors)  # turned with it
    path.write_text(obj_of(["128 64 255", "0 0 0", "255 255 255"]))  # others write them so
    np.testing.assert_allclose(
        fastibl.read_mesh(path, colors=True).colors, decoded([[128, 64, 255], [0, 0, 0], [255] * 3]), atol=1e-6
    )
    path.write_text(obj_of(["1.0 0 0 1", "", "1.0"]))  # a weight before it; none; a weight alone
    np.testing.assert_array_equal(fastibl.read_mesh(path, colors=True).colors, [(0, 0, 1), (1, 1, 1), (1, 1, 1)])
    path.write_text(obj_of(["", "", ""]))
    assert fastibl.read_mesh(path, colors=True).colors is None
    path.write_text(obj_of(["", "0 x 0", ""]))
    same_error(lambda: fastibl.read_mesh(path, colors=True), ValueError, "line 2", "colour", "x")
    path.write_text("v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nv 0 0 0 0 1 0\nv 1 0 0 1 0 0\nf 1 2 3\nf 4 3 5\n")
    assert len(fastibl.read_mesh(path).vertices) == 3
    assert len(fastibl.read_mesh(path, colors=True).vertices) == 4  # places of two colours are two


@pytest.mark.parametrize(
    ("kind", "names", "white"),
    [("uchar", ("red", "green", "blue"), 255), ("float", ("red", "green", "blue"), 1.0),
     ("float", ("red", "green", "blue"), 255.0),
     ("ushort", ("diffuse_red", "diffuse_green", "diffuse_blue"), 65535)],
)  # fmt: skip
def test_ply(kind, names, white, tmp_path):
    values = [(0.2, 0.4, 0.8), (0, 0, 0), (1, 1, 1)]
    codes = [[v * white if kind == "float" else round(v * white) for v in value] for value in values]
    rows = [f"{p} {' '.join(map(str, c))}" for p, c in zip(("0 0 0", "1 0 0", "0 1 0"), codes, strict=True)]
    header = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {a}" for a in "xyz")]
    header += [f"property {kind} {n}" for n in names]
    header += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    path = tmp_path / "a.ply"
    path.write_text("\n".join([*header, *rows, "3 0 1 2", ""]))
    assert fastibl.read_mesh(path).colors is None
    got = fastibl.read_mesh(path, up="z", colors=True)
    np.testing.assert_allclose(got.colors, decoded(np.array(codes) / white * 255), atol=1e-6)
    mesh, material = mesh_and_material(path)
    np.testing.assert_array_equal(mesh.colors, got.colors)
    assert material == fastibl.Material(diffuse=(1, 1, 1))


def test_files_without_them(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(obj_of(["", "", ""]))
    mesh, material = mesh_and_material(path)
    assert mesh.colors is None and material is None
    other = tmp_path / "a.stl"
    other.write_bytes(b"")
    same_error(lambda: fastibl.read_mesh(other, colors=True), ValueError, ".obj and .ply", "read_object")


def test_gltf(tmp_path):
    """Linear, of both kinds, of some of its parts; flat triangles take those of their corners."""
    file = Gltf()
    index = file.add(np.uint32([0, 1, 2, 2, 1, 3]))
    place = file.add(POINTS)
    bytes_rgba = np.uint8([(255, 0, 51, 10), (0, 255, 0, 255), (0, 0, 255, 255), (51,) * 4, (0,) * 4, (0,) * 4])
    floats = np.float32(np.linspace(0, 1.2, 18).reshape(6, 3))
    path = file.write(
        tmp_path / "a.gltf",
        [{"attributes": {"POSITION": place, "COLOR_0": file.add(bytes_rgba, normalized=True)}, "indices": index},
         {"attributes": {"POSITION": place, "NORMAL": file.add(np.tile(np.float32([[0, 0, 1]]), (6, 1))),
                         "COLOR_0": file.add(floats)}, "indices": index},
         {"attributes": {"POSITION": place}, "indices": index}],
    )  # fmt: skip
    mesh, material = fastibl.read_object(path, up="z")
    # The second part keeps the four vertices that its triangles name.
    expected = [bytes_rgba[[0, 1, 2, 2, 1, 3], :3] / 255, floats[:4].clip(0, 1), np.ones((6, 3))]
    np.testing.assert_allclose(mesh.colors, np.concatenate(expected), atol=1e-6)
    assert material.model == "pbr" and fastibl.read_mesh(path).colors is None
    same_error(lambda: fastibl.read_mesh(path, colors=True), ValueError, ".obj and .ply", "read_object")
    file.json["meshes"][0]["primitives"][1]["attributes"]["COLOR_0"] = file.add(floats[:4])
    file.write(path, file.json["meshes"][0]["primitives"])
    same_error(lambda: fastibl.read_object(path), ValueError, "colours", "(6, 3)", "(4, 3)")
