"""Objects of Wavefront .obj files with their .mtl: materials, pictures, and what is missing."""

import warnings

import cv2
import numpy as np
import pytest
from test_material import ABOVE, FROM_ABOVE, WHITE, emitting, layer_of, square
from test_mesh_files import Gltf

import fastibl
from conftest import same_error
from fastibl.files import mesh_and_material
from fastibl.surfaces import Picture, Texture, _Decoded

CORNERS = "v -0.1 -0.1 0\nv 0.1 -0.1 0\nv 0.1 0.1 0\nv -0.1 0.1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
BLACK = fastibl.CubeMap(np.zeros((6, 4, 4, 3), np.float32))
QUAD = "f 1/1/1 2/2/1 3/3/1 4/4/1\n"
HALVES = "usemtl a\nf 1/1/1 2/2/1 3/3/1\nusemtl b b\nf 1/1/1 3/3/1 4/4/1\n"


def picture(path, seed=0, size=(8, 8)):
    rgb = np.random.default_rng(seed).integers(40, 256, (*size, 3), dtype=np.uint8)
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), rgb[..., ::-1])
    return rgb


def written(tmp_path, mtl, faces=QUAD, name="a.mtl", newline="\n"):
    if mtl is not None:
        (tmp_path / name).write_bytes(mtl.replace("\n", newline).encode())
    path = tmp_path / "a.obj"
    path.write_bytes((f"mtllib {name}\n" + CORNERS + faces).replace("\n", newline).encode())
    return path


def read(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return fastibl.read_object(path, up="z")


def test_numbers(tmp_path):
    mtl = "# by hand\nnewmtl a\nKd 0.5 0.25 0.1\nKe 1 2 3\nPm 0.3\nPr 0.7\nNs 10\nillum 2\n"
    for newline in ("\n", "\r\n"):
        mesh, m = read(written(tmp_path, mtl, "usemtl a\n" + QUAD, newline=newline))
        assert m.model == "pbr" and m.base_color == pytest.approx((0.5, 0.25, 0.1)) and m.emission == (1, 2, 3)
        assert (m.metallic, m.roughness) == pytest.approx((0.3, 0.7)) and len(mesh.vertices) == 4


@pytest.mark.parametrize(
    ("lines", "roughness"),
    [("Ns 98\nKs 0.5 0.5 0.5", 0.02**0.25), ("Ns 98\nKs 0 0 0", 1.0), ("Ns 98\nKs 1\nillum 1", 1.0), ("", 1.0)],
)
def test_a_lobe_as_wide_as_the_exponent_tells(lines, roughness, tmp_path):
    m = read(written(tmp_path, f"newmtl a\n{lines}\n", "usemtl a\n" + QUAD))[1]
    assert m.roughness == pytest.approx(roughness) and m.base_color == pytest.approx((0.8,) * 3) and m.metallic == 0


def test_two_materials_each_where_it_is(tmp_path):
    """Names may have spaces. Each half looks as a material of its own does."""
    mtl = "newmtl a\nKd 0.9 0.1 0.1\nnewmtl b b\nKd 0.1 0.1 0.9\nPr 0.4\n"
    mesh, material = read(written(tmp_path, mtl, HALVES))
    got = layer_of(mesh, material, WHITE, FROM_ABOVE, ABOVE)
    x, y = np.meshgrid(np.arange(64), 63 - np.arange(64))
    for color, rough, half in (((0.9, 0.1, 0.1), 1.0, x > y + 2), ((0.1, 0.1, 0.9), 0.4, x < y - 2)):
        alone = layer_of(square(), fastibl.Material.pbr(color, 0.0, rough), WHITE, FROM_ABOVE, ABOVE)
        np.testing.assert_allclose(got[half], alone[half], atol=2e-3)


def test_names_hold_what_they_hold(tmp_path):
    """A # and several spaces, also beside comments."""
    red, blue = picture(tmp_path / "a#1  b.png", 1), picture(tmp_path / "c.png", 2)
    mtl = (
        "# made # by hand\n newmtl Material #25\nKd 1 1 1 # white\nmap_Kd -s 1 1 1 a#1  b.png\n"
        'newmtl Material #26 # the other\nmap_Kd  "c.png"   # quoted\n'
    )
    faces = "usemtl Material #25\nf 1/1/1 2/2/1 3/3/1 # first\nusemtl Material #26\nf 1/1/1 3/3/1 4/4/1#second\n"
    mesh, both = read(written(tmp_path, mtl, faces))
    for name, rgb in (("Material #25", red), ("Material #26", blue)):
        alone = read(written(tmp_path, mtl, f"usemtl {name}\n" + QUAD))[1]
        linear = fastibl.Response.srgb().decode(rgb.astype(np.float32) / 255)
        np.testing.assert_allclose(alone.base_color, linear, atol=1e-6)
    assert len(mesh.triangles) == 2 and np.ndim(both.base_color) == 3
    path = written(tmp_path, "newmtl a\nKd 0.5 0.25 0.1\n", "usemtl a # as defined\n" + QUAD)
    path.write_text(path.read_text().replace("mtllib a.mtl", "mtllib a.mtl # beside it"))
    assert read(path)[1].base_color == pytest.approx((0.5, 0.25, 0.1))


def test_a_picture_as_it_lies(tmp_path):
    """Kd times map_Kd, of a folder named as on Windows; 0 beside a picture counts as 1."""
    rgb = picture(tmp_path / "tex tures" / "a b.png")
    for kd, factor in (("0.5 1 1", (0.5, 1, 1)), ("0 0 0", (1, 1, 1))):
        mtl = f"newmtl a\nKd {kd}\nmap_Kd tex tures\\a b.png\n"
        mesh, material = read(written(tmp_path, mtl, "usemtl a\n" + QUAD, name="my own.mtl"))
        linear = fastibl.Response.srgb().decode(rgb.astype(np.float32) / 255)
        np.testing.assert_allclose(material.base_color, linear * np.float32(factor), atol=1e-6)
        np.testing.assert_allclose(mesh.uvs, square().uvs)


@pytest.mark.parametrize(
    ("options", "scale", "shift"),
    [("-s 2 2 1", (2, 2), (0, 0)), ("-s 2 3 -o 0.25 0.125", (2, 3), (0.25, 0.125)), ("-o 0.5", (1, 1), (0.5, 0)),
     ("-clamp on -s 2 2 2", (2, 2), (0, 0)), ("-s 2\t2 1\t", (2, 2), (0, 0)),
     ("-clamp\ton\t", (1, 1), (0, 0)), ("-bm 1 -mm 0 1", (1, 1), (0, 0))],
)  # fmt: skip
def test_options_of_pictures(options, scale, shift, tmp_path):
    """Seen as emission: uv times -s plus -o, v upwards."""
    picture(tmp_path / "a.png", size=(16, 16))
    mesh, material = read(written(tmp_path, f"newmtl a\nmap_Ke {options} a.png\n", "usemtl a\n" + QUAD))
    uvs = square().uvs * scale + shift
    np.testing.assert_allclose(mesh.uvs, uvs, atol=1e-6)
    assert material.wrap == (("clamp",) * 2 if "-clamp" in options else ("repeat",) * 2)
    if "-clamp" not in options:
        got = layer_of(mesh, material, BLACK, FROM_ABOVE, ABOVE)[..., :3]
        expected = emitting(material.emission, fastibl.Mesh(square().vertices, square().triangles, uvs))
        np.testing.assert_allclose(got, expected, atol=1e-5)
        assert got.std() > 0.05


def test_channels_and_bumps(tmp_path):
    rgb = picture(tmp_path / "a.png")
    mtl = "newmtl a\nmap_Pr a.png\nmap_Pm a.png\nnorm a.png\n"
    m = read(written(tmp_path, mtl, "usemtl a\n" + QUAD))[1]
    np.testing.assert_allclose(m.roughness, rgb[..., 0] / 255, atol=1e-6)
    np.testing.assert_allclose(m.metallic, rgb[..., 0] / 255, atol=1e-6)
    np.testing.assert_allclose(m.normal, rgb / 255, atol=1e-6)


def test_what_is_missing_or_left_out_is_said(tmp_path):
    path = written(tmp_path, None)
    with pytest.warns(UserWarning, match=r"a.obj: left out are a.mtl \(not there\)"):
        mesh, material = fastibl.read_object(path, up="z")
    assert material == fastibl.Material() and mesh == fastibl.read_mesh(path, up="z")
    path = written(tmp_path, "newmtl b b\nmap_Kd no.png\nKd 0.2 0.3 0.4\nd 0.5\nmap_Bump x.png\nmap_Ks y.png\n", HALVES)
    with pytest.warns(UserWarning, match="left out are") as told:
        mesh, material = fastibl.read_object(path, up="z")
    (text,) = [str(w.message) for w in told]
    for part in ("material a (not defined)", "no.png (not there)", "transparency", "bumps", "highlights of a colour"):
        assert part in text, part
    assert len(mesh.triangles) == 2 and material.model == "pbr"


@pytest.mark.parametrize("line", ["d 0.5", "d -halo 0.5", "D -halo 0.0", "Tr 0.5"])
def test_transparency_is_said(line, tmp_path):
    with pytest.warns(UserWarning, match="left out are transparency$"):
        fastibl.read_object(written(tmp_path, f"newmtl a\n{line}\n", "usemtl a\n" + QUAD))
    read(written(tmp_path, "newmtl a\nd -halo 1.0\n", "usemtl a\n" + QUAD))


def test_a_library_without_materials_is_said(tmp_path):
    path = written(tmp_path, "", "usemtl a\n" + QUAD)
    for content in ("newmtl a\nKd 1 0 0\n".encode("utf-16"), b"Kd 1 0 0\n"):
        (tmp_path / "a.mtl").write_bytes(content)
        with pytest.warns(UserWarning, match=r"a.obj: left out are a.mtl \(defines no material\)$"):
            assert fastibl.read_object(path, up="z")[1] == fastibl.Material()
    (tmp_path / "a.mtl").write_text("NEWMTL a\nKD 1 0 0\n")
    np.testing.assert_array_equal(read(path)[1].base_color, [1, 0, 0])


def test_pictures_of_other_kinds_are_left_out(tmp_path):
    """Kd stands in for them, and they are named once."""
    (tmp_path / "Wood.TGA").write_bytes(bytes(60))
    path = written(tmp_path, "newmtl a\nKd 0.4 0.3 0.2\nmap_Kd Wood.TGA\nmap_Ke Wood.TGA\n", "usemtl a\n" + QUAD)
    with pytest.warns(UserWarning, match=r"left out are Wood.TGA \(neither PNG nor JPEG\)$"):
        material = fastibl.read_object(path, up="z")[1]
    assert material.base_color == pytest.approx((0.4, 0.3, 0.2)) and material.emission == (0, 0, 0)


def test_pictures_that_repeat_beside_other_materials(tmp_path):
    """Seen as emission: each half as it is alone."""
    picture(tmp_path / "a.png", size=(16, 16))
    mtl = "newmtl a\nKd 0 0 0\nmap_Ke -s 3 2 -o 0.3 0.1 a.png\nnewmtl b b\nKd 0.1 0.1 0.9\n"
    both = layer_of(*read(written(tmp_path, mtl, HALVES)), BLACK, FROM_ABOVE, ABOVE)[..., :3]
    alone = layer_of(*read(written(tmp_path, mtl, "usemtl a\n" + QUAD)), BLACK, FROM_ABOVE, ABOVE)[..., :3]
    x, y = np.meshgrid(np.arange(64), 63 - np.arange(64))
    error = np.abs(both - alone).max(axis=-1)[x > y + 2]
    assert alone.std() > 0.05 and np.median(error) < 1e-3 and error.mean() < 5e-3 and both[x < y - 2].max() == 0


def test_strangers_files_stay_in_their_folder(tmp_path):
    picture(tmp_path / "secret.png")
    inside = tmp_path / "inside"
    inside.mkdir()
    for mtl, name in ((None, "../a.mtl"), ("newmtl a\nmap_Kd ../secret.png\n", "a.mtl")):
        path = written(inside, mtl, "usemtl a\n" + QUAD, name)
        (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
        with pytest.warns(UserWarning, match=r"left out are .*\.\./.* \(not there\)"):
            _, material = fastibl.read_object(path)
        assert np.ndim(getattr(material, "base_color", None) or 0) < 2 and material != fastibl.Material.pbr(
            (1, 0, 0), 0, 1
        )
    path = written(inside, "newmtl a\nmap_Kd a.mtl\n", "usemtl a\n" + QUAD)
    same_error(lambda: fastibl.read_object(path), ValueError, "a.obj", "neither PNG nor JPEG")
    path = written(inside, "newmtl a\nKd spectral x.rfl\nNs none\nPr\nmap_Pr -s\nKe 1e999 nan 1\n", "usemtl a\n" + QUAD)
    with pytest.warns(UserWarning, match="left out"):
        assert fastibl.read_object(path)[1].base_color == pytest.approx((0.8,) * 3)


@pytest.mark.parametrize(
    "named", ["../wood.png", "/home/bob/wood.png", r"C:\Users\bob\wood.png", "WOOD.PNG", "Maps/wood.png"]
)
def test_files_of_other_machines_are_those_beside_it(named, tmp_path):
    folder = tmp_path / "maps" if named.startswith("Maps") else tmp_path
    rgb = picture(folder / "wood.png")
    _, material = read(written(tmp_path, f"newmtl a\nmap_Kd {named}\n", "usemtl a\n" + QUAD))
    np.testing.assert_allclose(
        material.base_color, fastibl.Response.srgb().decode(rgb.astype(np.float32) / 255), atol=1e-6
    )


def test_names_with_accents_in_either_coding(tmp_path):
    picture(tmp_path / "ta\u0308x.png")
    assert read(written(tmp_path, "newmtl a\nmap_Kd t\u00e4x.png\n", "usemtl a\n" + QUAD))[1].base_color.shape == (
        8,
        8,
        3,
    )


def test_pictures_without_their_factors(tmp_path):
    """Exporters leave out Kd beside map_Kd and Ks beside map_Ks: 1 is meant."""
    rgb = picture(tmp_path / "a.png")
    _, material = read(written(tmp_path, "newmtl a\nmap_Kd a.png\n", "usemtl a\n" + QUAD))
    np.testing.assert_allclose(
        material.base_color, fastibl.Response.srgb().decode(rgb.astype(np.float32) / 255), atol=1e-6
    )
    with pytest.warns(UserWarning, match="left out are highlights of a colour"):
        material = fastibl.read_object(written(tmp_path, "newmtl a\nNs 98\nmap_Ks a.png\n", "usemtl a\n" + QUAD))[1]
    assert material.roughness == pytest.approx(0.02**0.25)


def test_what_blender_means(tmp_path):
    """Ns is 1000 (1 - roughness)^2, map_Bump a normal map."""
    picture(tmp_path / "n.png")
    lines = "newmtl a\nNs 250\nKs 0.5 0.5 0.5\nillum 2\nmap_Bump -bm 1.0 n.png\n"
    _, material = read(
        written(tmp_path, "# Blender 4.2.1 MTL File: 'a.blend'\n# www.blender.org\n\n" + lines, "usemtl a\n" + QUAD)
    )
    assert material.roughness == pytest.approx(0.5) and material.normal.shape == (8, 8, 3)
    with pytest.warns(UserWarning, match="left out are bumps"):
        material = fastibl.read_object(written(tmp_path, lines, "usemtl a\n" + QUAD))[1]
    assert material.roughness == pytest.approx((2 / 252) ** 0.25) and material.normal is None


def test_layers_and_other_pictures_are_said(tmp_path):
    with pytest.warns(UserWarning, match="left out are") as told:
        fastibl.read_object(
            written(tmp_path, "newmtl a\nPc 1\nPs 0\nmap_Ps s.png\nmap_refl r.png\n", "usemtl a\n" + QUAD)
        )
    text = str(told[0].message)
    assert all(word in text for word in ("clear coat", "map_ps", "reflection maps")) and "sheen" not in text


def test_edges_stay_as_they_are(tmp_path):
    """A box without normals has sharp edges, also where two materials meet; its colours are kept."""
    points = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    text = "mtllib a.mtl\n" + "".join(f"v {x} {y} {z} 1 0.5 0.25\n" for x, y, z in points)
    text += "usemtl a\n" + "".join("f {} {} {} {}\n".format(*f) for f in faces[:3])
    text += "usemtl b\n" + "".join("f {} {} {} {}\n".format(*f) for f in faces[3:])
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n")
    path = tmp_path / "box.obj"
    path.write_text(text)
    mesh, _ = read(path)
    plain = fastibl.Scene(fastibl.read_mesh(path, up="z"), spheres=0, visibility_rays=0).mesh
    assert len(mesh.vertices) == len(plain.vertices) == 24
    of = lambda m: sorted(map(tuple, np.round(np.hstack([m.vertices, m.normals]), 5).tolist()))  # noqa: E731
    assert of(mesh) == of(plain)
    np.testing.assert_allclose(
        mesh.colors, np.broadcast_to(fastibl.Response.srgb().decode(np.float32([1, 0.5, 0.25])), (24, 3))
    )
    assert mesh_and_material(path)[1].model == "pbr"


def test_warnings_point_at_the_call(tmp_path):
    with pytest.warns(UserWarning) as told:
        fastibl.read_object(written(tmp_path, None))
    assert told[0].filename == __file__


def test_several_libraries_and_tabs(tmp_path):
    """Every name that is not there is told; words may lie apart by tabs."""
    (tmp_path / "c.mtl").write_text("newmtl\ta\n\tKd\t0.5 0.25\t0.1\n")
    path = written(tmp_path, None, "usemtl a\n" + QUAD, name="b.mtl c.mtl d.mtl")
    with pytest.warns(UserWarning, match=r"left out are b.mtl \(not there\), d.mtl \(not there\)"):
        material = fastibl.read_object(path, up="z")[1]
    assert material.base_color == pytest.approx((0.5, 0.25, 0.1))


@pytest.mark.parametrize("name", ["a.obj", "a.gltf"])
def test_an_object_far_from_its_origin_is_told(name, tmp_path):
    path = written(tmp_path, "newmtl a\nKd 1 0 0\n", "usemtl a\n" + QUAD)
    path.write_text(path.read_text().replace("v 0.1 ", "v 100000.1 ").replace("v -0.1 ", "v 99999.9 "))
    if name == "a.gltf":
        file = Gltf()
        place = file.add(np.float32([(1e5, 0, 0), (1e5 + 1, 0, 0), (1e5, 1, 0)]))
        path = file.write(tmp_path / name, [{"attributes": {"POSITION": place}}])
    with pytest.warns(UserWarning, match="is subtracted from them") as told:
        fastibl.read_object(path)
    assert told[0].filename == __file__


# --- many pixels


def maps(tmp_path, count, size=(16, 32), one=False):
    """A file with so many pictures, of a material each, or of one material."""
    kinds = ["map_Kd", "map_Ke", "norm"] if one else ["map_Kd"] * count
    for k in range(count):
        picture(tmp_path / f"{k}.png", k, size)
    lines = [f"{kind} {k}.png\n" for k, kind in zip(range(count), kinds, strict=True)]
    mtl = "newmtl a\n" + "".join(lines) if one else "".join(f"newmtl {k}\n{line}" for k, line in enumerate(lines))
    return written(tmp_path, mtl, "".join(f"usemtl {'a' if one else k}\n{QUAD}" for k in range(1 if one else count)))


def test_pictures_are_as_many_as_they_like(tmp_path, monkeypatch):
    """Each is decoded where it is used; what fits into the memory of one gives the same as what fits into more."""
    path = maps(tmp_path, 5)
    whole = fastibl.read_object(path)[1]
    monkeypatch.setattr("fastibl.surfaces.MOST_PIXELS", 32 * 16)
    monkeypatch.setattr("fastibl.file_limits.MOST_PIXELS", 32 * 16)
    assert fastibl.read_object(path)[1] == whole
    monkeypatch.setattr("fastibl.surfaces._MOST_TOGETHER", 5 * 32 * 16 - 1)
    same_error(lambda: fastibl.read_object(path), ValueError, "a.obj", "more than 2559 pixels together")
    monkeypatch.setattr("fastibl.file_limits.MOST_PIXELS", 32 * 16 - 1)
    same_error(lambda: fastibl.read_object(path), ValueError, "a.obj", "0.png says that it is 32 x 16")


def test_pictures_of_one_material_are_shrunk_to_fit(tmp_path, monkeypatch):
    path = maps(tmp_path, 3, one=True)
    whole = fastibl.read_object(path)[1]
    monkeypatch.setattr("fastibl.surfaces.MOST_PIXELS", 32 * 16)
    with pytest.warns(UserWarning, match="a.obj: textures are shrunk: 32 x 16 to 18 x 9"):
        material = fastibl.read_object(path)[1]
    for name in ("base_color", "emission", "normal"):
        small, large = getattr(material, name), getattr(whole, name)
        assert small.shape == (9, 18, 3)
        np.testing.assert_allclose(small, cv2.resize(large, (18, 9), interpolation=cv2.INTER_AREA), atol=1e-5)


def test_pictures_are_decoded_once(tmp_path, monkeypatch):
    seen = []
    decode = cv2.imdecode
    monkeypatch.setattr(cv2, "imdecode", lambda *a: seen.append(1) or decode(*a))
    picture(tmp_path / "0.png", 0, (8, 8))
    path = written(tmp_path, "newmtl a\nmap_Kd 0.png\nmap_Pm 0.png\nmap_Pr 0.png\n", "usemtl a\n" + QUAD)
    fastibl.read_object(path)
    assert len(seen) == 1


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("channel", [None, 1])
@pytest.mark.parametrize("band", [2**22, 100])
def test_values_of_pictures(band, channel, kind, monkeypatch):
    """Linear, times the factor; where few are enough, means over squares."""
    monkeypatch.setattr("fastibl.surfaces._BAND", band)
    codes = np.random.default_rng(0).integers(0, np.iinfo(kind).max + 1, (36, 24, 3)).astype(kind)
    factor = 0.5 if channel else (0.25, 0.5, 2.0)
    shown = Picture(codes.shape[:2], lambda: codes, _Decoded())
    texture = Texture(0, shown, srgb=channel is None, channel=channel, factor=factor)
    linear = codes.astype(np.float32) / np.float32(np.iinfo(kind).max)
    linear = linear[..., 1] if channel else fastibl.Response.srgb().decode(linear)
    linear = linear * np.float32(factor)
    np.testing.assert_array_equal(texture.values(), linear)
    np.testing.assert_array_equal(texture.values((13, 1)), linear)
    means = linear.reshape(9, 4, 6, 4, *linear.shape[2:]).mean(axis=(1, 3))
    np.testing.assert_allclose(texture.values((5, 7)), means, rtol=1e-5)
