"""Meshes, materials and scenes as values: files, standing on the marker, normals, what is refused."""

import pickle

import numpy as np
import pytest

import fastibl
from conftest import same_error

TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def tetrahedron():
    return fastibl.Mesh(TETRAHEDRON, FACES)


OBJ = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def test_files_are_turned_up(tmp_path):
    path = tmp_path / "t.obj"
    path.write_text(OBJ)
    np.testing.assert_allclose(np.ptp(fastibl.read_mesh(path, up="z").vertices, axis=0), (1, 2, 3))
    mesh = fastibl.read_mesh(path)  # y is up: y becomes z, and z becomes -y
    assert mesh.vertices[:, 2].max() == 2 and mesh.vertices[:, 1].min() == -3
    # It is turned, not mirrored: the volume keeps its sign.
    for m in (mesh, fastibl.read_mesh(path, up="z"), tetrahedron()):
        a, b, c = (m.vertices[m.triangles[:, k]].astype(float) for k in range(3))
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(1)


def test_bad_files_are_refused(tmp_path):
    same_error(lambda: fastibl.read_mesh(tmp_path / "none.obj"), FileNotFoundError, "none.obj")
    (tmp_path / "t.obj").write_text(OBJ)
    same_error(lambda: fastibl.read_mesh(tmp_path / "t.obj", up="x"), ValueError, "up", "'x'")
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    same_error(lambda: fastibl.read_mesh(tmp_path / "empty.obj"), ValueError, "empty.obj")
    (tmp_path / "text.xyzzy").write_text("hello")
    same_error(lambda: fastibl.read_mesh(tmp_path / "text.xyzzy"), ValueError, "text.xyzzy")


def test_stand():
    turned = fastibl.Mesh(TETRAHEDRON * 7 + [3, -2, 5], FACES)
    mesh = fastibl.stand(turned, 0.12)
    lower, upper = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose((lower + upper)[:2], 0, atol=1e-7)
    np.testing.assert_allclose((lower[2], upper[2]), (0, 0.12), atol=1e-7)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), np.array([1, 2, 3]) * 0.04, rtol=1e-5)
    for height in (0.0, -1.0, float("nan"), float("inf")):
        same_error(lambda h=height: fastibl.stand(turned, h), ValueError, "height", str(height))
    flat = fastibl.Mesh(TETRAHEDRON * [1, 1, 0], FACES)
    same_error(lambda: fastibl.stand(flat, 1.0), ValueError, "extent along z")


def test_normals_point_outwards():
    import trimesh

    ball = trimesh.creation.icosphere(3)
    normals = fastibl.Mesh(ball.vertices, ball.faces).normals
    print(
        f"normals of a sphere within {np.degrees(np.arccos((normals * ball.vertices).sum(axis=1).min())):.2f} degrees"
    )
    assert (normals * ball.vertices).sum(axis=1).min() > 0.9995
    alone = fastibl.Mesh(np.concatenate([TETRAHEDRON, [[9.0, 9, 9]]]), FACES).normals[-1]
    np.testing.assert_array_equal(alone, (0, 0, 1))  # of a vertex without a triangle


def test_values_behave():
    mesh = fastibl.Mesh(TETRAHEDRON, FACES, np.zeros((4, 2)))
    assert pickle.loads(pickle.dumps(mesh)) == mesh != tetrahedron()
    assert pickle.loads(pickle.dumps(tetrahedron())) == tetrahedron() and tetrahedron().uvs is None
    material = fastibl.Material(diffuse=(0.1, 0.2, 0.3), glossy=(1, 1, 1), exponent=float("inf"), emission=(0, 0, 5))
    assert pickle.loads(pickle.dumps(material)) == material != fastibl.Material()
    strided = np.repeat(TETRAHEDRON.astype(np.float16), 2, axis=0)[::2]
    assert fastibl.Mesh(strided, FACES.astype(np.uint8)) == tetrahedron()


@pytest.mark.filterwarnings("ignore:overflow")
def test_what_is_no_mesh_is_refused():
    def make(vertices=TETRAHEDRON, triangles=FACES, uvs=None):
        return lambda: fastibl.Mesh(vertices, triangles, uvs)

    same_error(make(vertices=np.zeros((0, 3))), ValueError, "vertex")
    same_error(make(triangles=np.zeros((0, 3), int)), ValueError, "triangle")
    same_error(make(vertices=np.ones((4, 2))), ValueError, "(4, 2)")
    same_error(make(vertices=np.ones((2, 4, 3))), ValueError, "(v, 3)", "(2, 4, 3)")
    same_error(make(vertices=np.ones((4, 3), int)), TypeError, "floats", "int64")
    same_error(make(triangles=np.ones((4, 4), int)), ValueError, "(t, 3)", "(4, 4)")
    same_error(make(triangles=FACES.astype(float)), TypeError, "integers")
    same_error(make(triangles=FACES + 1), ValueError, "vertex index 4", "0 to 3")
    same_error(make(triangles=FACES - 1), ValueError, "vertex index -1")
    same_error(make(triangles=FACES + 2**32), ValueError, "vertex index")
    same_error(make(uvs=np.zeros((3, 2))), ValueError, "uvs", "4", "3")
    same_error(make(uvs=np.zeros((4, 3))), ValueError, "(v, 2)", "(4, 3)")
    for bad in (np.nan, np.inf, 1e300):
        same_error(make(vertices=np.where(TETRAHEDRON == 3, bad, TETRAHEDRON)), ValueError, "vertex 3", "not finite")


def test_what_is_no_material_is_refused():
    for name in ("diffuse", "glossy", "emission"):
        for bad in (-0.1, np.nan, np.inf):
            same_error(lambda n=name, b=bad: fastibl.Material(**{n: (0.5, b, 0.5)}), ValueError, name, "at least 0")
        same_error(lambda n=name: fastibl.Material(**{n: (0.5, 0.5)}), ValueError, name, "three numbers")
        same_error(lambda n=name: fastibl.Material(**{n: 0.5}), TypeError, name)
    for bad in (-1.0, float("nan")):
        same_error(lambda b=bad: fastibl.Material(exponent=b), ValueError, "exponent")


def test_what_is_no_scene_is_refused():
    same_error(lambda: fastibl.Scene(tetrahedron(), spheres=-1), ValueError, "spheres", "-1")
    same_error(lambda: fastibl.Scene(tetrahedron(), visibility_rays=-1), ValueError, "rays", "-1")
    same_error(lambda: fastibl.Scene(tetrahedron(), None, np.eye(3)), ValueError, "marker_from_object")
    scene = fastibl.Scene(tetrahedron(), spheres=0, visibility_rays=0)
    assert scene.spheres.shape == (0, 4) and (scene.visibility == 1).all()
    smooth = fastibl.Mesh(tetrahedron().vertices, tetrahedron().triangles, None, tetrahedron().normals)
    assert fastibl.Scene(smooth, spheres=0, visibility_rays=0).mesh == smooth
    assert scene.material == fastibl.Material() and scene.marker_from_object == fastibl.Pose()


def prism(around):
    """A closed prism around the z axis, one vertex a corner."""
    a = np.arange(around) * 2 * np.pi / around
    ring = np.stack([np.cos(a), np.sin(a), np.zeros(around)], -1)
    vertices = np.concatenate([ring, ring + [0, 0, 2], [[0, 0, 0], [0, 0, 2]]])
    i, j = np.arange(around), (np.arange(around) + 1) % around
    sides = [np.stack(t, -1) for t in ((i, j, around + i), (j, around + j, around + i))]
    ends = [np.stack(t, -1) for t in ((np.full(around, 2 * around), j, i),
                                      (np.full(around, 2 * around + 1), around + i, around + j))]  # fmt: skip
    return fastibl.Mesh(vertices, np.concatenate(sides + ends))


def drawn(mesh):
    """The mesh of a scene, and of each corner of a triangle the cosine between its normal and the triangle's."""
    made = fastibl.Scene(mesh, spheres=0, visibility_rays=0).mesh
    p = made.vertices[made.triangles]
    face = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    face /= np.maximum(np.linalg.norm(face, axis=-1, keepdims=True), 1e-30)
    return made, (made.normals[made.triangles] * face[:, None]).sum(-1)


def test_sharp_edges_of_a_mesh_without_normals_are_drawn_sharp():
    box, along = drawn(prism(4))
    assert len(box.vertices) == 3 * 8 + 2 and along.min() > 1 - 1e-6
    # A cylinder's ends are flat, its side is round.
    cylinder, along = drawn(prism(32))
    assert len(cylinder.vertices) == 2 * 32 + 2 + 2 * 32
    side = np.abs(cylinder.normals[:, 2]) < 0.5
    out = cylinder.vertices[side, :2] / np.linalg.norm(cylinder.vertices[side, :2], axis=1, keepdims=True)
    assert (cylinder.normals[side, :2] * out).sum(-1).min() > 1 - 1e-6
    assert along.min() > np.cos(np.pi / 32) - 1e-6
    # Their copies come after what was given, with its uvs; the surface is the same.
    uvs = np.random.default_rng(0).uniform(size=(10, 2)).astype(np.float32)
    given = fastibl.Mesh(prism(4).vertices, prism(4).triangles, uvs)
    made, _ = drawn(given)
    np.testing.assert_array_equal(made.vertices[:10], given.vertices)
    np.testing.assert_array_equal(made.vertices[made.triangles], given.vertices[given.triangles])
    np.testing.assert_array_equal(made.uvs[made.triangles], given.uvs[given.triangles])


def test_what_has_no_sharp_edges_or_normals_of_its_own_stays_as_it_is():
    for mesh in (prism(4), prism(32)):
        own = fastibl.Mesh(mesh.vertices, mesh.triangles, None, mesh.normals)
        assert drawn(own)[0] == own
    ring = prism(32)
    open_ring = fastibl.Mesh(ring.vertices, ring.triangles[:64])  # no ends
    assert drawn(open_ring)[0] == open_ring
    # A triangle without an area has no say, and neither have vertices of none.
    flat = fastibl.Mesh(
        np.concatenate([ring.vertices, [[9, 9, 9]]]), np.concatenate([ring.triangles[:64], [[0, 0, 1], [3, 3, 3]]])
    )
    assert drawn(flat)[0] == flat


def test_a_vertex_of_very_many_triangles_takes_no_time():
    """A fan of 200 000: each compared with each would take minutes."""
    n = 200_000
    a = np.arange(n) * 2 * np.pi / n
    ring = np.stack([np.cos(a), np.sin(a), np.zeros(n)], -1)
    i = np.arange(n)
    fan = fastibl.Mesh(np.concatenate([ring, [[0, 0, 1]]]), np.stack([i, (i + 1) % n, np.full(n, n)], -1))
    made, along = drawn(fan)
    np.testing.assert_allclose(made.normals[n], (0, 0, 1), atol=1e-4)
    assert len(made.vertices) == n + 1 and along.min() > 0.7


def test_stand_by_height_width_or_scale():
    box = fastibl.Mesh(np.array([(0, 0, 1), (2, 0, 1), (2, 1, 1), (0, 1, 5)], float), [[0, 1, 2], [0, 2, 3]])
    for size, extents in (
        ({"height": 0.2}, (0.1, 0.05, 0.2)), ({"width": 0.3}, (0.3, 0.15, 0.6)), ({"scale": 0.01}, (0.02, 0.01, 0.04)),
    ):  # fmt: skip
        placed = fastibl.stand(box, **size).vertices
        np.testing.assert_allclose(np.ptp(placed, axis=0), extents, rtol=1e-6)
        np.testing.assert_allclose(placed.max(axis=0) + placed.min(axis=0), (0, 0, extents[2]), atol=1e-7)
    np.testing.assert_array_equal(fastibl.stand(box, 0.2).vertices, fastibl.stand(box, height=0.2).vertices)
    flat = fastibl.Mesh(box.vertices * [1, 1, 0], box.triangles)
    same_error(lambda: fastibl.stand(flat, 0.1), ValueError, "without extent along z", "give its width or scale")
    assert np.ptp(fastibl.stand(flat, width=1.0).vertices[:, 0]) == pytest.approx(1)
    upright = fastibl.Mesh(np.array([(0, 0, 0), (0, 0, 1), (0, 0, 2)], float), [[0, 1, 2]])
    same_error(lambda: fastibl.stand(upright, width=1.0), ValueError, "along x and y", "give its height or scale")
    same_error(lambda: fastibl.stand(box), ValueError, "one of height, width and scale must be given, got none")
    same_error(lambda: fastibl.stand(box, 0.1, width=0.1), ValueError, "got height and width")
    for name in ("height", "width", "scale"):
        for wrong in (0, -1, np.nan, np.inf):
            same_error(lambda n=name, w=wrong: fastibl.stand(box, **{n: w}), ValueError, f"{name} must be positive")
        same_error(lambda n=name: fastibl.stand(box, **{n: "1"}), TypeError, f"{name} must be a number, got str")
