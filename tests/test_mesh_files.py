"""Mesh files as programs write them: polygons, normals, strips, skins, names of indices, faults."""

import base64
import gc
import json
import struct
import warnings
from urllib.parse import quote

import cv2
import numpy as np
import pytest

import fastibl
from conftest import same_error
from fastibl.file_limits import MOST_CORNERS
from fastibl.gltf_container import WIDTHS

CUBE = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
NORMALS = [(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)]


def area_of(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(float) for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def volume_of(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(float) for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def read(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return fastibl.read_mesh(path, up="z")


# --- .obj


def cube_obj(corner):
    lines = ["v {} {} {}".format(*p) for p in CUBE] + ["vn {} {} {}".format(*n) for n in NORMALS] + ["vt 0 0"]
    return "\n".join([*lines, *("f " + " ".join(corner(v + 1, k + 1) for v in side) for k, side in enumerate(SIDES))])


@pytest.mark.parametrize("corner", ["{0}", "{0}/1", "{0}//{1}", "{0}/1/{1}"])
def test_obj_corners(corner, tmp_path):
    """Smooth without normals; a file's own keep its edges sharp."""
    mesh = read(tmp_path, "cube.obj", cube_obj(corner.format))
    sharp = "{1}" in corner
    assert len(mesh.vertices) == (24 if sharp else 8) and len(mesh.triangles) == 12
    assert area_of(mesh) == pytest.approx(6) and volume_of(mesh) == pytest.approx(1)
    assert np.abs(mesh.normals).max() == pytest.approx(1 if sharp else 3**-0.5, abs=1e-6)


def test_obj_keeps_the_normals_that_some_faces_have(tmp_path):
    """The others get what they have without any."""
    own = np.array([0.6, 0, 0.8])
    text = cube_obj("{0}".format).rsplit("f ", 1)[0] + f"vn {own[0]} {own[1]} {own[2]}\n"
    last = " ".join(f"{v + 1}//-1" for v in SIDES[-1])
    mesh = read(tmp_path, "a.obj", text + "f " + last)
    np.testing.assert_allclose(mesh.normals[mesh.triangles[-2:]], np.tile(own, (2, 3, 1)), atol=1e-6)
    for k, normal in enumerate(NORMALS[:-1]):  # a cube's edges are sharp
        np.testing.assert_allclose(mesh.normals[mesh.triangles[2 * k : 2 * k + 2]], np.tile(normal, (2, 3, 1)))
    assert len(mesh.vertices) == 24 and volume_of(mesh) == pytest.approx(1)
    # Of one face, each corner by itself.
    mesh = read(tmp_path, "b.obj", LINES + "vn 0.6 0 0.8\nf 1//1 2//1 3\n")
    np.testing.assert_allclose(mesh.normals, [own, own, (0, 0, 1)], atol=1e-6)


def with_uvs(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    return fastibl.read_mesh(tmp_path / name, up="z", uvs=True)


def test_obj_uvs(tmp_path):
    """v upwards, as Mesh has them; -1, one number and three, and corners without."""
    uvs = "vt 0 0\nvt 1 0 0\nvt 0.25\nvt +0.5 1.5\n"
    square = LINES + "v 1 1 0\n" + uvs
    mesh = with_uvs(tmp_path, "a.obj", square + "f 1/1 2/2 4/-1 3/3\n")
    np.testing.assert_array_equal(mesh.uvs, [(0, 0), (1, 0), (0.25, 0), (0.5, 1.5)])
    np.testing.assert_array_equal(mesh.vertices[:, :2], [(0, 0), (1, 0), (0, 1), (1, 1)])
    seam = with_uvs(tmp_path, "b.obj", square + "f 1/1 2/2 3/3\nf 3/4 2/2 4\n")
    np.testing.assert_array_equal(seam.uvs[seam.triangles], [[(0, 0), (1, 0), (0.25, 0)], [(0.5, 1.5), (1, 0), (0, 0)]])
    assert len(seam.vertices) == 5
    assert with_uvs(tmp_path, "c.obj", square + "f 1 2 3\n").uvs is None
    assert read(tmp_path, "a.obj", square + "f 1/9 2/x 3/\n").uvs is None  # not looked at
    for text, words in (
        ("f 1/1 2/2 3/5\n", ["line 9", "uv from 1 to 4", '"5"']),
        ("f 1/0 2/2 3/1\n", ["line 9", "a uv from 1 on", '"1/0"']),
        ("vt 0 0,5\nf 1 2 3\n", ["line 9", "one to three numbers", "0,5"]),
        ("vt\nf 1 2 3\n", ["line 9", "one to three numbers"]),
        ("vt 0 nan\nf 1/1 2/2 3/-1\n", ["not finite"]),
    ):
        same_error(lambda t=text: with_uvs(tmp_path, "d.obj", square + t), ValueError, "d.obj", *words)
    (tmp_path / "a.ply").write_bytes(ply(b"ascii", SIDES))
    same_error(lambda: fastibl.read_mesh(tmp_path / "a.ply", uvs=True), ValueError, "a.ply", ".obj", "read_object")


@pytest.mark.parametrize("sharp", [True, False])
def test_obj_with_uvs_is_lit_as_without(sharp, tmp_path):
    """Seams of textures do not show: normals are those of a scene of the mesh without, smooth or at creases."""
    if sharp:
        text = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n" + cube_obj("{0}/{1}".format).replace("vt 0 0", "vt 2 2\nvt 2 3")
    else:
        n = 24
        around = [f"v {np.cos(a)} {np.sin(a)} {z}" for z in (0, 1) for a in np.arange(n) / n * 2 * np.pi]
        text = "\n".join(around + [f"vt {k / n} {z}" for z in (0, 1) for k in range(n + 1)]) + "\n"
        for k in range(n):
            corners = [(k, k), ((k + 1) % n, k + 1), ((k + 1) % n + n, k + 2 + n), (k + n, k + 1 + n)]
            text += "f " + " ".join(f"{v + 1}/{t + 1}" for v, t in corners) + "\n"
    (tmp_path / "a.obj").write_text(text)
    plain, mesh = (fastibl.read_mesh(tmp_path / "a.obj", up="z", uvs=uvs) for uvs in (False, True))
    lit, given = (fastibl.Scene(m, spheres=0, visibility_rays=0).mesh for m in (plain, mesh))
    np.testing.assert_array_equal(lit.vertices[lit.triangles], given.vertices[given.triangles])
    np.testing.assert_allclose(lit.normals[lit.triangles], given.normals[given.triangles], atol=1e-6)
    assert mesh.uvs is not None and len(mesh.vertices) == (24 if sharp else 50)


LINES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
TRIANGLES = {
    "a mark at its start": "\ufeff" + LINES + "f 1 2 3\n",
    "tabs and spaces": "\tv\t0 0 0\n  v 1  0 0 \nv 0 1 0 1.0\n \tf 1\t2 3 \n",
    "other ends of lines": (LINES + "f 1 2 3").replace("\n", "\r\n"),
    "remarks": "# v 9 9 9\n" + LINES.replace("\n", " # here\n") + "f 1 2 3 # there\n",
    "lines that go on": LINES.replace("0 1 0", "0 \\\n 1 \\\n0") + "f 1 \\\n2 3",
    "what is not read": "mtllib a.mtl\no thing\ng all\ns 1\nusemtl red\nvp 1 2\n" + LINES + "l 1 2\nf 1 2 3\np 1\n",
    "colours of vertices": LINES.replace(" 0\n", " 0 0.5 0.5 0.5\n") + "f 1 2 3\n",
    "a plus, and exponents": "v +0 0e0 0\nv 1.0E+0 0 0\nv 0 +1e-0 -0\nf 1 2 3\n",
    "vertices after the face": "f 1 2 3\n" + LINES,
    "what nothing uses": LINES + "v 9 9 9\nf 1 2 3\nv nan 1 1\n",
}  # fmt: skip


@pytest.mark.parametrize("name", TRIANGLES)
def test_obj_texts(name, tmp_path):
    mesh = read(tmp_path, "a.obj", TRIANGLES[name])
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles], [[(0, 0, 0), (1, 0, 0), (0, 1, 0)]])


def test_obj_indices_that_count_back(tmp_path):
    """Each from the vertices so far, as programs write that append one part after the other."""
    part = "v 0 0 {0}\nv 1 0 {0}\nv 0 1 {0}\nf -3 -2 -1\n"
    mesh = read(tmp_path, "a.obj", part.format(0) + part.format(5))
    assert sorted(mesh.vertices[mesh.triangles].mean(axis=1)[:, 2]) == [0, 5]


def polygon_obj(points, start):
    order = [(start + k) % len(points) + 1 for k in range(len(points))]
    return "".join("v {} {} {}\n".format(*p) for p in points) + "f " + " ".join(map(str, order))


POLYGONS = {
    "an L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3.0),
    "an arrow": ([(0, 0), (2, 1), (0, 2), (1.5, 1)], 0.5),
    "a comb": ([(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)], 8.0),
    "corners on an edge": ([(0, 0), (1, 0), (2, 0), (2, 2), (1, 2), (0, 2)], 4.0),
    "a corner twice": ([(0, 0), (2, 0), (2, 0), (2, 2), (0, 2)], 4.0),
    "a hole by a slit": ([(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)], 8.0),
}  # fmt: skip


@pytest.mark.parametrize("name", POLYGONS)
def test_polygons(name, tmp_path):
    """Their area, whichever corner comes first, whichever way they lie, and no triangle the other way round."""
    flat, area = POLYGONS[name]
    rng = np.random.default_rng(2)
    for start in range(len(flat)):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        points = np.pad(np.array(flat), ((0, 0), (0, 1))) @ turn.T
        mesh = read(tmp_path, "a.obj", polygon_obj(points.tolist(), start))
        a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(float) for k in range(3))
        signed = np.cross(b - a, c - a) @ (np.linalg.det(turn) * turn[:, 2]) / 2
        assert signed.sum() == pytest.approx(area, abs=1e-5) and signed.min() > -1e-5


@pytest.mark.parametrize(
    "text, words",
    [
        (LINES + "f 0 1 2", ["line 4", '"0"']),
        (LINES + "f 1 2 9", ["line 4", "from 1 to 3", '"9"']),
        (LINES + "f 1 2 -9", ["line 4", '"-9"']),
        (LINES + "f 1//1 2//1 3//1", ["line 4", "normal from 1 to 0"]),
        (LINES + "f 1 2", ["line 4", "3 corners", "2"]),
        (LINES + "f 1 2 3x", ["line 4", "3x"]),
        (LINES + "f 99999999999999999999 2 3", ["line 4", "99999999999999999999"]),
        (LINES + "f " + "1 2 3 " * 400, ["line 4", "1024", "1200"]),
        ("v 0 0\n", ["line 1", "three numbers"]),
        ("v 1,0 0 0\n", ["line 1", "1,0"]),
        ("v 1e999 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", ["finite"]),
        ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", ["finite"]),
        (LINES, ["holds no triangles"]),
        ("", ["holds no triangles"]),
    ],
)
def test_obj_errors(text, words, tmp_path):
    same_error(lambda: read(tmp_path, "a.obj", text), ValueError, "a.obj", *words)


# --- far from the origin

MAP = np.array([500000.125, 4649776.5, 120.0])  # metres, as in a map; float32 has steps of 0.5 there


def bumps():
    """A wavy square of 1 m with detail of millimetres: points and triangles."""
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9)))
    points = np.round(np.stack([x, y, 0.003 * np.sin(9 * x) * np.cos(7 * y)], axis=1), 6)
    i = np.arange(72).reshape(8, 9)[:, :8].ravel()
    return points, np.concatenate([np.stack([i, i + 1, i + 9], axis=1), np.stack([i + 1, i + 10, i + 9], axis=1)])


def far_obj(path, points, triangles):
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*p) for p in points]
    path.write_text("\n".join(["v 0 0 0", *lines, *("f {} {} {}".format(*t) for t in triangles + 2)]))  # 1: unused


def far_ply(path, points, triangles, kind="f8"):
    vertices = np.zeros(len(points), np.dtype([("p", f"<{kind}", 3)]))
    vertices["p"] = points
    faces = np.zeros(len(triangles), np.dtype([("n", "u1"), ("i", "<i4", 3)]))
    faces["n"], faces["i"] = 3, triangles
    name = {"f8": "double", "f4": "float"}[kind]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property {name} {axis}\n" for axis in "xyz")
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + vertices.tobytes() + faces.tobytes())


def far_off(path, points, triangles):
    rows = [f"OFF\n{len(points)} {len(triangles)} 0"] + [" ".join(map(repr, map(float, p))) for p in points]
    path.write_text("\n".join([*rows, *("3 {} {} {}".format(*t) for t in triangles)]) + "\n")


def far_glb(path, points, triangles):
    """The node is far away, its mesh is not."""
    file, middle = Gltf(), points.mean(axis=0)
    attributes = {
        "POSITION": file.add(np.float32(points - middle)), "NORMAL": file.add(np.float32([(0, 0, 1)] * len(points)))
    }  # fmt: skip
    primitive = {"attributes": attributes, "indices": file.add(triangles.astype(np.uint32).reshape(-1))}
    file.write(path, [primitive], nodes=[{"mesh": 0, "translation": middle.tolist()}])


FAR = {"a.obj": far_obj, "a.ply": far_ply, "a.off": far_off, "a.gltf": far_glb}


@pytest.mark.parametrize("name", FAR)
def test_far_meshes_keep_their_detail(name, tmp_path):
    """A whole offset is subtracted in float64."""
    points, triangles = bumps()
    FAR[name](tmp_path / name, points + MAP, triangles)
    said = rf"{name} is 1 wide and 4.64978e\+06 away .* to 0.3: \(500001, 4649777, 120\) is subtracted from them$"
    with pytest.warns(UserWarning, match=said) as told:
        mesh = fastibl.read_mesh(tmp_path / name, up="z")
    assert len(told) == 1 and told[0].filename == __file__
    assert len(mesh.vertices) == len(points)
    wanted = points + (MAP - (500001, 4649777, 120))
    np.testing.assert_allclose(mesh.vertices[mesh.triangles], wanted[triangles], atol=1e-6)


@pytest.mark.parametrize("name", ["a.obj", "a.gltf"])
def test_far_objects_keep_their_detail(name, tmp_path):
    points, triangles = bumps()
    FAR[name](tmp_path / name, points + MAP, triangles)
    if name == "a.obj":
        (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
        path = tmp_path / name
        path.write_text(path.read_text().replace("v 0 0 0", "mtllib a.mtl\nusemtl a\nv 0 0 0"))
    with pytest.warns(UserWarning, match="is subtracted from them"):
        mesh, _ = fastibl.read_object(tmp_path / name, up="z")
    wanted = points + (MAP - (500001, 4649777, 120))
    np.testing.assert_allclose(mesh.vertices[mesh.triangles], wanted[triangles], atol=1e-6)


def test_what_a_far_file_has_rounded_itself_is_said(tmp_path):
    points, triangles = bumps()
    far_ply(tmp_path / "a.ply", points + MAP, triangles, "f4")
    with pytest.warns(UserWarning, match="is subtracted from them; the file holds them rounded so already"):
        fastibl.read_mesh(tmp_path / "a.ply", up="z")


@pytest.mark.parametrize("name", FAR)
@pytest.mark.parametrize("shift", [0.0, 1000.0])
def test_meshes_that_float32_keeps_stay_where_they_are(shift, name, tmp_path):
    points, triangles = bumps()
    FAR[name](tmp_path / name, points + shift, triangles)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = fastibl.read_mesh(tmp_path / name, up="z")
    wanted = np.float32(points + shift)
    np.testing.assert_allclose(mesh.vertices[mesh.triangles], wanted[triangles], atol=1e-4 if shift else 1e-7)


def test_small_far_meshes_are_moved_by_decimals(tmp_path):
    points, triangles = bumps()
    far_ply(tmp_path / "a.ply", 1e-3 * points + (12.34567, 0, 0), triangles)
    with pytest.warns(UserWarning, match=r"\(12.346, 0.001, 0\) is subtracted from them$"):
        mesh = fastibl.read_mesh(tmp_path / "a.ply", up="z")
    wanted = 1e-3 * points + (12.34567 - 12.346, -0.001, 0)
    np.testing.assert_allclose(mesh.vertices[mesh.triangles], wanted[triangles], atol=1e-10)


# --- .ply


def ply(form, faces, extra=b"", vertex=b"", rows=None):
    head = b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n" % (
        form,
        len(CUBE),
    )
    head += vertex + b"element face %d\nproperty list uchar int vertex_indices\n" % len(faces) + extra + b"end_header\n"
    rows = rows or CUBE
    if form == b"ascii":
        lines = [" ".join(map(str, row)) for row in rows]
        tail = " 6 0 0 1 0 0 1" if extra else ""
        return head + "\n".join([*lines, *(f"{len(f)} " + " ".join(map(str, f)) + tail for f in faces)]).encode()
    order = "<" if b"little" in form else ">"
    return (
        head
        + b"".join(struct.pack(f"{order}{len(row)}f", *row) for row in rows)
        + b"".join(struct.pack(f"{order}B{len(f)}i", len(f), *f) for f in faces)
    )


MIXED = [*SIDES[:3], *((s[0], s[1], s[2]) for s in SIDES[3:]), *((s[0], s[2], s[3]) for s in SIDES[3:])]


@pytest.mark.parametrize("form", [b"ascii", b"binary_little_endian", b"binary_big_endian"])
def test_ply_of_triangles_and_quads(form, tmp_path):
    mesh = read(tmp_path, "a.ply", ply(form, MIXED))
    assert len(mesh.vertices) == 8 and len(mesh.triangles) == 12
    assert area_of(mesh) == pytest.approx(6) and volume_of(mesh) == pytest.approx(1)


@pytest.mark.parametrize("form", [b"ascii", b"binary_little_endian"])
def test_ply_leaves_no_file_open(form, tmp_path):
    gc.collect()  # what other tests left
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", ResourceWarning)
        read(tmp_path, "a.ply", ply(form, MIXED))
        gc.collect()
    assert not told


def test_ply_with_normals_and_with_uvs_of_corners(tmp_path):
    out = [(*p, *(np.array(p) * 2 - 1) / 3**0.5) for p in CUBE]
    named = b"property float nx\nproperty float ny\nproperty float nz\n"
    mesh = read(tmp_path, "a.ply", ply(b"binary_little_endian", SIDES, vertex=named, rows=out))
    np.testing.assert_allclose(mesh.normals, (mesh.vertices * 2 - 1) / 3**0.5, atol=1e-6)
    corners = ply(b"ascii", [s[:3] for s in SIDES], extra=b"property list uchar float texcoord\n")
    assert len(read(tmp_path, "b.ply", corners).triangles) == 6
    same_error(lambda: read(tmp_path, "c.ply", ply(b"ascii", [(0, 1, 8)])), ValueError, "c.ply", "vertex 8 of 8")


@pytest.mark.parametrize("form", [b"ascii", b"binary_little_endian"])
@pytest.mark.parametrize("newline", [b"\n", b"\r", b"\r\n"])
def test_ply_with_remarks_of_any_bytes(form, newline, tmp_path):
    remarks = b"comment TextureFile caf\xc3\xa9.png\nobj_info \xff end_header\nelement face"
    head, end, tail = ply(form, MIXED).replace(b"element face", remarks).rpartition(b"end_header\n")
    content = (head + end).replace(b"\n", newline) + (tail.replace(b"\n", newline) if form == b"ascii" else tail)
    assert volume_of(read(tmp_path, "a.ply", content)) == pytest.approx(1)


@pytest.mark.parametrize("form", [b"ascii", b"binary_little_endian"])
@pytest.mark.parametrize("none", [(0.0, 0.0, 0.0), (np.nan, 0.0, 1.0), (0.0, np.inf, 0.0)])
def test_normals_of_a_ply_that_are_none(form, none, tmp_path):
    """Smooth ones in their place."""
    own = (0.6, 0, 0.8)
    named = b"property float nx\nproperty float ny\nproperty float nz\n"
    mesh = read(tmp_path, "a.ply", ply(form, SIDES, vertex=named, rows=[(*p, *none) for p in CUBE]))
    plain = read(tmp_path, "b.ply", ply(form, SIDES))
    np.testing.assert_array_equal(mesh.normals, plain.normals)
    assert mesh._given_normals is None
    rows = [(*p, *(own if k == 3 else none)) for k, p in enumerate(CUBE)]
    mesh = read(tmp_path, "c.ply", ply(form, SIDES, vertex=named, rows=rows))
    there = (mesh.vertices == CUBE[3]).all(axis=1)
    np.testing.assert_allclose(mesh.normals[there], [own], atol=1e-6)
    others = {tuple(p): n for p, n in zip(plain.vertices.tolist(), plain.normals, strict=True)}
    for p, n in zip(mesh.vertices[~there].tolist(), mesh.normals[~there], strict=True):
        np.testing.assert_allclose(n, others[tuple(p)], atol=0.3)


@pytest.mark.parametrize("faces, named", [([(0, 1, -1)], -1), ([(0, 1, 2, -3)], -3), ([(0, 1, 2, 9)], 9)])
def test_ply_of_a_vertex_that_is_not_there(faces, named, tmp_path):
    same_error(lambda: read(tmp_path, "a.ply", ply(b"ascii", faces)), ValueError, f"vertex {named} of 8")


@pytest.mark.parametrize("newline", [b"\n", b"\r", b"\r\n"])
def test_ply_of_more_elements_than_bytes(newline, tmp_path):
    """Rows without properties take none, and were counted for ever."""
    content = ply(b"ascii", SIDES)
    for element, least in ((b"foo 1000000000000", 10**12), (b"foo 500\nproperty int a\nproperty int b", 1000)):
        told = content.replace(b"element face", b"element %b\nelement face" % element).replace(b"\n", newline)
        words = "a.ply", f"elements of {least + 24 + 6} bytes or more", f"it has {len(told)}"
        same_error(lambda told=told: read(tmp_path, "a.ply", told), ValueError, *words)
    same_error(lambda: read(tmp_path, "a.ply", b"ply\n" + b"comment\n" * 2**18), ValueError, "does not end")
    none = content.replace(b"element face", b"element foo 0\nelement face")
    assert len(read(tmp_path, "b.ply", none).triangles) == 12


def test_polygons_have_as_many_corners_in_every_file(tmp_path):
    angles = np.arange(MOST_CORNERS + 1) / (MOST_CORNERS + 1) * 2 * np.pi
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1).tolist()
    for most in (MOST_CORNERS, MOST_CORNERS + 1):
        head = ply(b"ascii", [range(most)], rows=points).replace(b"uchar", b"int")
        files = {
            "a.ply": head.replace(b"vertex 8", b"vertex %d" % len(points)),
            "a.obj": polygon_obj(points[:most], 0),
        }
        for name, content in files.items():
            if most == MOST_CORNERS:
                assert len(read(tmp_path, name, content).triangles) == most - 2
            else:
                words = f"may have {MOST_CORNERS} corners, got {most}"
                same_error(lambda f=(name, content): read(tmp_path, *f), ValueError, name, words)


def test_stl_and_off(tmp_path):
    assert volume_of(read(tmp_path, "a.off", off())) == pytest.approx(1)
    triangles = np.array([(s[0], s[k], s[k + 1]) for s in SIDES for k in (1, 2)])
    stl = bytes(80) + struct.pack("<I", 12)
    for t in triangles:
        stl += struct.pack("<12fH", 0, 0, 0, *np.ravel(np.array(CUBE)[t]), 0)
    mesh = read(tmp_path, "a.stl", stl)
    assert len(mesh.vertices) == 8 and volume_of(mesh) == pytest.approx(1)


def off(points=CUBE, faces=SIDES, head="OFF\n{} {} 0\n"):
    rows = [" ".join(map(str, p)) for p in points] + [f"{len(f)} " + " ".join(map(str, f)) for f in faces]
    return head.format(len(points), len(faces)) + "\n".join(rows) + "\n"


OUT = [(*p, *(np.array(p) * 2 - 1) / 3**0.5) for p in CUBE]  # places and normals


@pytest.mark.parametrize(
    "content",
    [
        off(head="OFF {} {} 0\n"),
        off(head="OFF\n{} {}\n"),
        off(head="OFF # what follows\n\n  # 3 1 0\n{} {} 0 # counts\n\n"),
        off().replace("\n", "\r\n"),
        off().replace("\n4 ", " # a remark\n4 "),
        off(faces=[(*s, 255, 0, 0) for s in SIDES]).replace("\n7 ", "\n4 "),
        off([(*p, 255, 0, 0, 255) for p in CUBE], head="COFF\n{} {} 0\n"),
        off(OUT, head="NOFF\n{} {} 0\n"),
        off([(*p, 0.5, 1, 0, 1) for p in OUT], head="CNOFF {} {} 0\n"),
        off(faces=[(0, 1), *SIDES, ()]),
        "# caf\xe9\x85\n" + off(),
    ],
)
def test_off_texts(content, tmp_path):
    mesh = read(tmp_path, "a.off", content.encode("latin-1"))
    assert len(mesh.vertices) == 8 and volume_of(mesh) == pytest.approx(1)
    np.testing.assert_allclose(mesh.normals, (mesh.vertices * 2 - 1) / 3**0.5, atol=1e-6)


def test_normals_of_an_off_are_its_own(tmp_path):
    own = np.array([0.6, 0, 0.8])
    mesh = read(tmp_path, "a.off", off([(*p, *own) for p in CUBE], head="NOFF\n{} {} 0\n"))
    np.testing.assert_allclose(mesh.normals, np.tile(own, (8, 1)), atol=1e-6)


def test_polygons_of_an_off_may_be_hollow(tmp_path):
    points, area = POLYGONS["a comb"]
    mesh = read(tmp_path, "a.off", off([(*p, 0) for p in points], [range(len(points))]))
    assert area_of(mesh) == pytest.approx(area)


@pytest.mark.parametrize(
    "content, words",
    [
        (off(head="PLY\n{} {} 0\n"), ["begin with OFF", '"PLY"']),
        ("", ["begin with OFF", '""']),
        (off(head="OFF BINARY\n{} {} 0\n"), ["numbers of vertices and faces", '"BINARY"']),
        (off(head="OFF\n9{} {} 0\n"), ["98 vertices and 6 faces", "14 lines follow"]),
        (off(head="OFF\n-{} {} 0\n"), ["below 0", "-8 6 0"]),
        (off([p[:2] for p in CUBE]), ["vertex 0", "3 numbers", "0.0 0.0"]),
        (off(head="NOFF\n{} {} 0\n"), ["vertex 0", "6 numbers"]),
        (off(faces=[(0, 1, 8)]), ["vertex 8 of 8"]),
        (off(faces=[(0, 1, -1)]), ["vertex -1 of 8"]),
        (off().replace("4 1 5 7 3", "5 1 5 7 3"), ["face 5", "as many vertices", "5 1 5 7 3"]),
        (off().replace("4 1 5 7 3", "4 1 5 7 x"), ["face 5", "4 1 5 7 x"]),
        (off(faces=[(0, 1)]), ["holds no triangles"]),
    ],
)
def test_off_errors(content, words, tmp_path):
    same_error(lambda: read(tmp_path, "a.off", content), ValueError, "a.off", *words)


FACET = "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n\tvertex 1 0 0\n  vertex 1 1e0 0\n endloop\nendfacet\n"
BINARY = b"abc".ljust(80) + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 1, 0, 0)


@pytest.mark.parametrize(
    "content",
    [
        f"solid x\n{FACET}endsolid x\n",
        f"solid\n{FACET}",
        f"solid x\n{FACET}endsolid x\n".upper(),
        f"\ufeff\n solid facet vertex 1\n{FACET}endsolid facet vertex 1\n".replace("\n", "\r\n"),
        f"solid K\xf6rper\n{FACET}".encode("latin-1"),
        BINARY,
        b"solid facet" + BINARY[11:],
        BINARY + b"\n",
        BINARY + b"\0" * 50,
    ],
)
def test_stl_of_one_facet(content, tmp_path):
    mesh = read(tmp_path, "a.stl", content)
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles], [[(0, 0, 0), (1, 0, 0), (1, 1, 0)]])


@pytest.mark.parametrize(
    "content, words",
    [
        (BINARY[:80] + b"\3\0\0\0" + BINARY[84:], ["cut off: 3 facets need 234 bytes", "has 134"]),
        (b"solid" + BINARY[5:-1], ["cut off: 1 facets need 134 bytes", "has 133"]),
        (BINARY[:50], ["cut off"]),
        ("solid x\n" + FACET + FACET[:60], ["cut off", "5 vertices"]),
        ("solid x\n" + FACET.replace("1e0 0", "1e0"), ["line 6", "3 numbers", '"1 1e0"']),
        ("solid x\n" + FACET.replace("1e0", "1,0"), ["line 6", "1,0"]),
        ("solid x\n" + FACET.replace("1e0", "nan"), ["finite"]),
        ("solid x\nendsolid x\n", ["holds no triangles"]),
        (BINARY[:80] + bytes(4), ["holds no triangles"]),
    ],
)
def test_stl_errors(content, words, tmp_path):
    same_error(lambda: read(tmp_path, "a.stl", content), ValueError, "a.stl", *words)


# --- glTF

KINDS = {
    np.dtype(k): n for k, n in (("i1", 5120), ("u1", 5121), ("<i2", 5122), ("<u2", 5123), ("<u4", 5125), ("<f4", 5126))
}
POINTS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 2, 0), (1, 2, 0)], "<f4")


class Gltf:
    """A file made of arrays."""

    def __init__(self):
        self.data, self.json = b"", {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], "nodes": []}

    def view(self, array):
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes})
        self.data += array.tobytes() + bytes(-array.nbytes % 4)
        return len(self.json["bufferViews"]) - 1

    def add(self, array, **more):
        kind = {v: k for k, v in WIDTHS.items() if k != "MAT2"}[1 if array.ndim == 1 else int(np.prod(array.shape[1:]))]
        self.json["accessors"].append(
            {"bufferView": self.view(array), "componentType": KINDS[array.dtype], "count": len(array), "type": kind}
            | more
        )
        return len(self.json["accessors"]) - 1

    def write(self, path, primitives, **more):
        self.json["meshes"] = [{"primitives": primitives}]
        self.json["nodes"] = self.json["nodes"] or [{"mesh": 0}]
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self.json["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
        path.write_text(json.dumps(self.json | more))
        return path


@pytest.mark.parametrize("mode, index, area", [(4, [0, 1, 2, 2, 1, 3], 1.0), (5, [0, 1, 2, 3, 4, 5], 2.0),
                                               (6, [0, 1, 3, 5, 4], 2.0)])  # fmt: skip
def test_gltf_strips_and_fans(mode, index, area, tmp_path):
    file = Gltf()
    path = file.write(
        tmp_path / "a.gltf",
        [{"mode": mode, "attributes": {"POSITION": file.add(POINTS)}, "indices": file.add(np.uint16(index))}],
    )
    for mesh in (fastibl.read_mesh(path, up="z"), fastibl.read_object(path, up="z")[0]):
        assert area_of(mesh) == pytest.approx(area)
        np.testing.assert_allclose(mesh.normals, np.broadcast_to([0, 0, 1], mesh.normals.shape), atol=1e-6)


def test_gltf_quantised_sparse_and_placed(tmp_path):
    """Both readers put what is quantised where its nodes say."""
    file = Gltf()
    short = file.add(np.int16(POINTS[:, :3] / 2 * 32767), normalized=True)
    sparse = file.add(POINTS)
    file.json["accessors"][sparse]["sparse"] = {
        "count": 1, "indices": {"bufferView": file.view(np.array([5], "<u2")), "componentType": 5123},
        "values": {"bufferView": file.view(np.array([(9, 2, 0)], "<f4"))},
    }  # fmt: skip
    index = file.add(np.uint32([0, 1, 2, 2, 1, 3, 2, 3, 4, 4, 3, 5]))
    file.json["nodes"] = [{"mesh": 0, "translation": [10, 0, 0], "scale": [2, 2, 2]}]
    path = file.write(tmp_path / "a.gltf", [{"attributes": {"POSITION": short}, "indices": index},
                                            {"attributes": {"POSITION": sparse}, "indices": index}],
                      extensionsRequired=["KHR_mesh_quantization"])  # fmt: skip
    for mesh in (fastibl.read_mesh(path, up="z"), fastibl.read_object(path, up="z")[0]):
        np.testing.assert_allclose(mesh.vertices.min(axis=0), (10, 0, 0), atol=1e-3)
        np.testing.assert_allclose(mesh.vertices.max(axis=0), (28, 4, 0), atol=1e-3)
        assert area_of(mesh) == pytest.approx(2 + 24, rel=1e-3)


def test_gltf_zeros_are_as_many_as_a_file_may_need(tmp_path):
    """Accessors without values of their own say how many zeros they are; each other value takes a byte or more."""
    file = Gltf()
    changed = {"count": 3, "indices": {"bufferView": file.view(np.arange(3, dtype="<u2")), "componentType": 5123},
               "values": {"bufferView": file.view(np.tile(np.float32([0, 0, 5]), (3, 1)))}}  # fmt: skip
    accessors, part = file.json["accessors"], {"attributes": {"POSITION": file.add(POINTS[:3])}}
    accessors.append({"componentType": 5126, "type": "VEC3", "count": 3, "sparse": changed})
    part["attributes"]["NORMAL"] = 1
    mesh = fastibl.read_mesh(file.write(tmp_path / "a.gltf", [part]), up="z")
    np.testing.assert_allclose(mesh.normals, np.tile([0, 0, 1], (3, 1)))
    accessors[1]["count"] = 100000
    path = file.write(tmp_path / "b.gltf", [{"attributes": {"POSITION": 1}}])
    for reader in (fastibl.read_mesh, fastibl.read_object):
        same_error(lambda reader=reader: reader(path), ValueError, "b.gltf", "100000 zeros", f"{len(file.data)} bytes")


def test_gltf_skins_rest(tmp_path):
    """By their joints, whatever the node says that holds the mesh."""
    file = Gltf()
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    inverse[1, 3, :3] = (0, -1, 0)  # columns follow each other
    attributes = {"POSITION": file.add(POINTS), "JOINTS_0": file.add(np.uint8([[k > 1, 0, 0, 0] for k in range(6)])),
                  "WEIGHTS_0": file.add(np.tile(np.float32([1, 0, 0, 0]), (6, 1)))}  # fmt: skip
    index = file.add(np.uint16([0, 1, 2, 2, 1, 3]))
    file.json["nodes"] = [
        {"mesh": 0, "skin": 0, "scale": [100, 100, 100]},
        {"scale": [2, 2, 2], "children": [2]},
        {"translation": [0, 3, 0]},
    ]
    skins = [{"joints": [1, 2], "inverseBindMatrices": file.add(inverse)}]
    path = file.write(tmp_path / "a.gltf", [{"attributes": attributes, "indices": index}], skins=skins)
    mesh = fastibl.read_mesh(path, up="z")
    expected = [(0, 0, 0), (2, 0, 0), (0, 6, 0), (2, 6, 0)]  # doubled; the upper ones about the joint at 1, moved to 3
    assert {tuple(np.round(p, 5)) for p in mesh.vertices.tolist()} == {tuple(map(float, p)) for p in expected}


def test_gltf_skins_of_more_than_four_joints(tmp_path):
    file, ones = Gltf(), np.ones((6, 1))
    attributes = {"POSITION": file.add(POINTS)}
    for k in range(3):  # half of the first, a quarter each of the others
        attributes[f"JOINTS_{k}"] = file.add(np.uint8(ones * [k, 0, 0, 0]))
        attributes[f"WEIGHTS_{k}"] = file.add(np.float32(ones * [0.25 + 0.25 * (k == 0), 0, 0, 0]))
    file.json["nodes"] = [{"mesh": 0, "skin": 0}, {}, {"translation": [0, 0, 4]}, {"translation": [0, 8, 0]}]
    index = file.add(np.uint16([0, 1, 2]))
    path = file.write(
        tmp_path / "a.gltf", [{"attributes": attributes, "indices": index}], skins=[{"joints": [1, 2, 3]}]
    )
    np.testing.assert_allclose(fastibl.read_mesh(path, up="z").vertices, POINTS[:3] + [0, 2, 1], atol=1e-6)


def test_gltf_skins_of_vertices_without_weight(tmp_path):
    """They go with the first joint that is named; one of no weight may be any number."""
    file = Gltf()
    named = np.uint8([[0, 255, 9, 0], [1, 255, 9, 0], [255, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
    weights = np.float32([[1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], *[[1, 0, 0, 0]] * 3])
    attributes = {"POSITION": file.add(POINTS), "JOINTS_0": file.add(named), "WEIGHTS_0": file.add(weights)}
    file.json["nodes"] = [{"mesh": 0, "skin": 0}, {"translation": [0, 0, 4]}, {"translation": [0, 8, 0]}]
    part = {"attributes": attributes, "indices": file.add(np.uint16([0, 1, 2]))}
    path = file.write(tmp_path / "a.gltf", [part], skins=[{"joints": [1, 2]}])
    expected = POINTS[:3] + [(0, 0, 4), (0, 8, 0), (0, 0, 4)]
    for mesh in (fastibl.read_mesh(path, up="z"), fastibl.read_object(path, up="z")[0]):
        np.testing.assert_allclose(mesh.vertices, expected, atol=1e-6)
    path.write_text(path.read_text().replace('"joints": [1, 2]', '"joints": []'))
    same_error(lambda: fastibl.read_mesh(path), ValueError, "a.gltf", "damaged")


def test_gltf_instances(tmp_path):
    """Each by its translation, rotation and scale, in its node; mirrored ones the right way round."""
    file = Gltf()
    half = np.float32(0.5**0.5)
    attributes = {
        "TRANSLATION": file.add(np.float32([(0, 0, 0), (5, 0, 0), (0, 0, 7)])),
        "ROTATION": file.add(np.int16(np.array([(0, 0, 0, 1), (0, 0, half, half), (0, 0, 0, 1)]) * 32767),
                             normalized=True),
        "SCALE": file.add(np.float32([(1, 1, 1), (2, 2, 2), (-1, 1, 1)])),
    }  # fmt: skip
    extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    file.json["nodes"] = [{"mesh": 0, "translation": [0, 0, 1], "extensions": extension}]
    part = {"attributes": {"POSITION": file.add(POINTS), "NORMAL": file.add(np.tile(np.float32([0, 0, 1]), (6, 1)))},
            "indices": file.add(np.uint16([0, 1, 2]))}  # fmt: skip
    path = file.write(tmp_path / "a.gltf", [part], extensionsRequired=["EXT_mesh_gpu_instancing"])
    expected = [[(0, 0, 1), (1, 0, 1), (0, 1, 1)], [(5, 0, 1), (5, 2, 1), (3, 0, 1)],
                [(0, 1, 8), (-1, 0, 8), (0, 0, 8)]]  # fmt: skip
    for mesh in (fastibl.read_object(path, up="z")[0], fastibl.read_mesh(path, up="z")):
        np.testing.assert_allclose(mesh.vertices[mesh.triangles], expected, atol=1e-3)
        np.testing.assert_allclose(mesh.normals[mesh.triangles], np.tile([0, 0, 1], (3, 3, 1)), atol=1e-6)
    content = json.loads(path.read_text())
    for change, words in (({"count": 2}, "not as many"), ({"count": 2**20 + 1}, "1048576 instances")):
        for name in attributes if "1048576" in words else ["SCALE"]:
            content["accessors"][attributes[name]] |= change
        path.write_text(json.dumps(content))
        same_error(lambda: fastibl.read_mesh(path), ValueError, "a.gltf", words)


def test_gltf_of_data_whose_characters_are_escaped(tmp_path):
    file = Gltf()
    file.json["bufferViews"].append({"buffer": 1, "byteLength": 36})
    file.json["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"})
    path = file.write(tmp_path / "a.gltf", [{"attributes": {"POSITION": 0}}])
    content = json.loads(path.read_text())
    uri = "data:application/octet-stream;base64," + quote(base64.b64encode(POINTS[:3].tobytes()), safe="")
    content["buffers"].append({"byteLength": 36, "uri": uri.replace("A", "%41")})
    path.write_text(json.dumps(content))
    np.testing.assert_allclose(fastibl.read_mesh(path, up="z").vertices, POINTS[:3])


def test_what_is_left_out_of_geometry_is_said(tmp_path):
    file = Gltf()
    points = file.add(POINTS[:3])
    part = {"attributes": {"POSITION": points}, "targets": [{"POSITION": points}]}
    path = file.write(tmp_path / "a.gltf", [part])
    for reader in (fastibl.read_mesh, fastibl.read_object):
        with pytest.warns(UserWarning, match="a.gltf: left out are morphs") as told:
            reader(path)
        assert told[0].filename == __file__
    joints = {"JOINTS_0": file.add(np.zeros((3, 4), np.uint8)), "WEIGHTS_0": file.add(np.ones((3, 4), np.float32))}
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": points}}}
    file.json["nodes"] = [{"mesh": 0, "skin": 0, "extensions": extension}]
    path = file.write(tmp_path / "b.gltf", [{"attributes": {"POSITION": points} | joints}], skins=[{"joints": [0]}])
    with pytest.warns(UserWarning, match="b.gltf: left out are instances of a skin"):
        assert len(fastibl.read_mesh(path).triangles) == 1


def textured(tmp_path, uvs, samplers=None, picture=None, **material):
    """A square of 2 x 2 whose texture is red on the left, green on the right."""
    file = Gltf()
    if picture is None:
        picture = np.zeros((2, 4, 3), np.uint8)
        picture[:, :2, 2], picture[:, 2:, 1] = 255, 255
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], "<f4")
    attributes = {"POSITION": file.add(corners), "TEXCOORD_0": file.add(np.asarray(uvs, "<f4"))}
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}} | material
    texture = {"source": 0, "sampler": 0} if samplers else {"source": 0}
    part = {"attributes": attributes, "indices": file.add(np.uint16([0, 1, 2, 0, 2, 3])), "material": 0}
    more = {"materials": [material], "images": [{"uri": "a.png"}], "textures": [texture], "samplers": samplers or []}
    return file.write(tmp_path / "a.gltf", [part], **more)


TWICE = [(-1, 2), (2, 2), (2, -1), (-1, -1)]  # three times along u and v, from the one before


@pytest.mark.parametrize("backend", ["cpu", "gl"])
@pytest.mark.parametrize("mode, seen", [(10497, "rrggrrggrrgg"), (33071, "rrrrrrgggggg"), (33648, "ggrrrrggggrr")])
def test_textures_go_on_beyond_their_borders(mode, seen, backend, tmp_path):
    mesh, material = fastibl.read_object(textured(tmp_path, TWICE, [{"wrapS": mode, "wrapT": mode}]), up="z")
    assert material.wrap[0] == {10497: "repeat", 33071: "clamp", 33648: "mirror"}[mode]
    camera = fastibl.Camera(120, 120, 60, 60, 60, 60)  # the square fills the picture
    scene = fastibl.Scene(mesh, material, spheres=0, visibility_rays=0)
    try:
        session = fastibl.Session(
            scene, fastibl.Rig(camera), environment=fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32)), backend=backend
        )
    except RuntimeError as error:
        pytest.skip(str(error))
    above = fastibl.Pose(np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1.0], [0, 0, 0, 1]]))
    session.process(fastibl.Frame(0.0, back_from_marker=above))
    row = session.object.rgba[60, 5::10, :2]
    assert "".join("r" if red > green else "g" for red, green in row) == seen
    # What brute force reads.
    from fastibl.truth import pbr_surface

    at = np.stack([np.arange(-0.99, 2, 0.25), np.full(12, 0.3)], axis=1)
    surface = pbr_surface(material, np.tile([0.0, 0, 1], (12, 1)), np.tile([1.0, 0, 0, 1], (12, 1)), at)
    assert "".join("r" if red > green else "g" for red, green, _ in surface.base_color) == seen


TRANSFORM = {"offset": [0.1, -0.2], "rotation": 0.7, "scale": [2, 0.5]}


def test_textures_are_moved_and_read_with_other_uvs(tmp_path):
    """T R S (u, v, 1), v downwards, R as the text of KHR_texture_transform has it (KhronosGroup/glTF, issue 1563)."""
    base = {"index": 0, "extensions": {"KHR_texture_transform": TRANSFORM}}
    pbr = {"pbrMetallicRoughness": {"baseColorTexture": base}}
    mesh, _ = fastibl.read_object(textured(tmp_path, TWICE, **pbr))
    (c, s), (x, y), (u, v) = (np.cos(0.7), np.sin(0.7)), TRANSFORM["offset"], TRANSFORM["scale"]
    moved = np.array([[1, 0, x], [0, 1, y], [0, 0, 1]]) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    moved = moved @ np.diag([u, v, 1.0])
    expected = np.array([moved @ [a, b, 1] for a, b in TWICE])[:, :2]
    found = {tuple(np.round(uv, 4)) for uv in mesh.uvs}
    assert found == {tuple(np.round((a, 1 - b), 4)) for a, b in expected.astype(np.float32)}
    path = textured(tmp_path, TWICE, pbrMetallicRoughness={"baseColorTexture": {"index": 0, "texCoord": 1}})
    content = json.loads(path.read_text())
    attributes = content["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_1"] = attributes.pop("TEXCOORD_0")
    path.write_text(json.dumps(content))
    assert np.abs(fastibl.read_object(path)[0].uvs).max() == pytest.approx(2)
    both = textured(tmp_path, TWICE, normalTexture={"index": 0}, **pbr)
    same_error(lambda: fastibl.read_object(both), ValueError, "a.gltf", "in different ways")


def test_wrap_is_named():
    picture = np.zeros((2, 2, 3), np.uint8)
    assert fastibl.Material.pbr(picture).wrap == ("repeat", "repeat")
    assert fastibl.Material.pbr(picture, wrap=("clamp", "mirror")).wrap == ("clamp", "mirror")
    assert fastibl.Material.pbr(picture, wrap="clamp") != fastibl.Material.pbr(picture)
    same_error(lambda: fastibl.Material.pbr(picture, wrap="border"), ValueError, "repeat, clamp or mirror", "border")
    same_error(lambda: fastibl.Material.pbr(picture, wrap=("clamp",)), ValueError, "two", "1")
    same_error(lambda: fastibl.Material.pbr(picture, wrap=3), TypeError, "repeat, clamp or mirror", "int")


def test_sixteen_bits_stay(tmp_path):
    flat = np.full((4, 4, 3), 32768, np.uint16)
    flat[..., 0] = 65535
    path = textured(tmp_path, TWICE, picture=flat, normalTexture={"index": 0}, pbrMetallicRoughness={})
    np.testing.assert_allclose(fastibl.read_object(path)[1].normal[..., :2], 32768 / 65535, atol=1e-6)


def test_one_picture_of_many_materials_counts_once(tmp_path, monkeypatch):
    monkeypatch.setattr("fastibl.surfaces.MOST_PIXELS", 8)
    path = textured(tmp_path, TWICE, emissiveTexture={"index": 0}, emissiveFactor=[1, 1, 1])
    assert fastibl.read_object(path)[1].emission.shape == (2, 4, 3)


def test_one_picture_in_every_place_is_bounded(tmp_path, monkeypatch):
    """A material makes floats of it for each: of two pictures of the most pixels, at most. It is shrunk to that."""
    monkeypatch.setattr("fastibl.surfaces.MOST_PIXELS", 8)
    every = {"emissiveTexture": {"index": 0}, "emissiveFactor": [1, 1, 1], "normalTexture": {"index": 0}}
    path = textured(tmp_path, TWICE, **every)
    with pytest.warns(UserWarning, match="a.gltf: textures are shrunk: 4 x 2 to 3 x 1") as told:
        material = fastibl.read_object(path)[1]
    assert told[0].filename == __file__
    assert material.base_color.shape == material.emission.shape == material.normal.shape == (1, 3, 3)


def test_attributes_that_are_not_as_many_as_vertices(tmp_path):
    square = [(0, 1), (1, 1), (1, 0), (0, 0)]
    for uvs, shape in ((square[:1], "(1, 2)"), ([(*uv, 0) for uv in square], "(4, 3)")):
        path = textured(tmp_path, uvs)
        content = json.loads(path.read_text())
        content["materials"].append({})
        first = content["meshes"][0]["primitives"][0]
        first["attributes"]["NORMAL"] = first["attributes"]["POSITION"]
        content["meshes"][0]["primitives"].append(first | {"material": 1})
        path.write_text(json.dumps(content))
        same_error(lambda path=path: fastibl.read_object(path), ValueError, "a.gltf", shape, "(4, 2)")


TANGENTS = {
    "of its uvs": ((1, 0, 0, 1), {}, 0),
    "of a mirrored node": ((1, 0, 0, 1), {"scale": [-1, 1, 1]}, 0),
    "of a turned node": ((1, 0, 0, 1), {"rotation": [0, 0, 1, 0]}, 0),
    "a little off": ((1, 0.2, 0.3, 1), {}, 0),
    "none": ((0, 0, 0, 1), {}, 0),
    "turned": ((0, 1, 0, 1), {}, 100),
    "of the other side": ((1, 0, 0, -1), {}, 100),
}


@pytest.mark.parametrize("name", TANGENTS)
def test_tangents_that_differ_are_said(name, tmp_path):
    tangent, node, share = TANGENTS[name]
    path = textured(tmp_path, [(0, 1), (1, 1), (1, 0), (0, 0)], normalTexture={"index": 0})
    content = json.loads(path.read_text())
    data = np.float32([[*tangent, 0, 0, 1]] * 4).tobytes()
    content["buffers"].append({"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()})
    content["bufferViews"].append({"buffer": 1, "byteLength": len(data), "byteStride": 28})
    view = len(content["bufferViews"]) - 1
    attributes = content["meshes"][0]["primitives"][0]["attributes"]
    for attribute, kind, offset in (("TANGENT", "VEC4", 0), ("NORMAL", "VEC3", 16)):
        attributes[attribute] = len(content["accessors"])
        content["accessors"].append(
            {"bufferView": view, "byteOffset": offset, "componentType": 5126, "count": 4, "type": kind}
        )
    content["nodes"][0] |= node
    path.write_text(json.dumps(content))
    if share:
        with pytest.warns(UserWarning, match=f"a.gltf: its tangents are left out, .* turned against {share} %"):
            fastibl.read_object(path)
        del content["materials"][0]["normalTexture"]  # and nothing needs them
        path.write_text(json.dumps(content))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fastibl.read_object(path)
        fastibl.read_mesh(path)


def test_vertices_that_no_triangle_names(tmp_path):
    """Primitives may share a buffer of which each shows a part."""
    file = Gltf()
    corners = np.concatenate([POINTS, POINTS - [0, 0, 50]]).astype("<f4")
    places = file.add(corners)
    index = np.uint16([0, 1, 2, 2, 1, 3])
    parts = [{"attributes": {"POSITION": places, "NORMAL": file.add(np.tile(np.float32([0, 0, 1]), (12, 1)))},
              "indices": file.add(index)}]  # fmt: skip
    mesh, _ = fastibl.read_object(file.write(tmp_path / "a.gltf", parts), up="z")
    assert len(mesh.vertices) == 4 and np.ptp(mesh.vertices[:, 2]) == 0
    np.testing.assert_array_equal(mesh.vertices[mesh.triangles], corners[index.reshape(-1, 3)])


@pytest.mark.parametrize("void", [0.0, np.nan])
def test_normals_that_are_none(void, tmp_path):
    """Are those of the triangles, with nothing said of divisions."""
    file = Gltf()
    normals = np.tile(np.float32([0, 0.6, 0.8]), (6, 1))
    normals[::2] = void
    part = {"attributes": {"POSITION": file.add(POINTS), "NORMAL": file.add(normals)},
            "indices": file.add(np.uint16([0, 1, 2, 2, 1, 3, 2, 3, 4, 4, 3, 5]))}  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh, _ = fastibl.read_object(file.write(tmp_path / "a.gltf", [part]), up="z")
    np.testing.assert_allclose(mesh.normals[::2], np.tile([0, 0, 1], (3, 1)), atol=1e-6)
    np.testing.assert_allclose(mesh.normals[1::2], normals[1::2], atol=1e-6)


def test_textures_that_cannot_be_shown_are_left_out(tmp_path):
    """One whose file is not there, and those of a part without uvs, which shows their first corner."""
    path = textured(tmp_path, TWICE, name="Wall")
    (tmp_path / "a.png").unlink()
    with pytest.warns(UserWarning, match=r"left out are a.png \(not there\)"):
        assert fastibl.read_object(path)[1].base_color == (1, 1, 1)
    path = textured(tmp_path, TWICE, name="Wall")
    path.write_text(path.read_text().replace('"TEXCOORD_0": 1', '"_X": 1'))
    with pytest.warns(UserWarning, match=r"left out are textures of what has no uvs \(of Wall\)"):
        mesh, material = fastibl.read_object(path)
    assert np.ndim(material.base_color) == 3 and (mesh.uvs == [0, 1]).all()


def test_extensions_that_may_be_left_out(tmp_path):
    """One that a file requires is, with the material's name; one that changes nothing is not said."""
    unlit = textured(tmp_path, TWICE, extensions={"KHR_materials_unlit": {}}, name="Sky")
    unlit.write_text(unlit.read_text().replace('"asset"', '"extensionsRequired": ["KHR_materials_unlit"], "asset"'))
    with pytest.warns(UserWarning, match=r"left out are KHR_materials_unlit \(of Sky\)"):
        fastibl.read_object(unlit)
    none = {"KHR_materials_clearcoat": {"clearcoatRoughnessFactor": 0.5}, "KHR_materials_transmission": {},
            "KHR_materials_sheen": {"sheenColorFactor": [0, 0, 0]}}  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fastibl.read_object(textured(tmp_path, TWICE, extensions=none))


def test_what_is_left_out_is_said(tmp_path):
    clear = {"extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}}, "alphaMode": "BLEND"}
    clear["pbrMetallicRoughness"] = {"baseColorFactor": [1, 1, 1, 0.5]}
    with pytest.warns(UserWarning, match="a.gltf: left out are KHR_materials_clearcoat, transparency"):
        fastibl.read_object(textured(tmp_path, TWICE, **clear))
    other = {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1]}}}
    same_error(
        lambda: fastibl.read_object(textured(tmp_path, TWICE, **other)),
        ValueError,
        "KHR_materials_pbrSpecularGlossiness",
    )
    file = Gltf()
    points = file.add(POINTS[:3])
    packed = {"attributes": {"POSITION": points}, "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0}}}
    path = file.write(tmp_path / "packed.gltf", [{"attributes": {"POSITION": points}}, packed])
    for reader in (fastibl.read_mesh, fastibl.read_object):
        same_error(lambda reader=reader: reader(path), ValueError, "packed.gltf", "KHR_draco_mesh_compression")
    packed["extensions"] = {"KHR_materials_variants": {"mappings": []}}
    assert len(fastibl.read_mesh(file.write(tmp_path / "variants.gltf", [packed])).triangles) == 1
