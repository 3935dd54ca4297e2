"""File formats of maps and light: round trips, orientation by one marked map, files that are damaged or hostile."""

import json
import struct
import zlib

import cv2
import numpy as np
import pytest
from test_export import gltf, opengl_lookup

import fastibl
from conftest import same_error, units
from fastibl import ktx2, reference, sh_files
from fastibl.file_limits import MOST_PIXELS


def away_from_edges(count=200):
    return [d for d in units(count) if np.sort(np.abs(d))[-2] < 0.95 * np.abs(d).max()]


def dds(levels, kind, legacy=False):
    """Bytes of a DDS cube of (6, n, n, c) arrays, face by face, each with its levels."""
    codes = {"<f2": (10, 113), "<f4": (2, 116)}[kind]
    n, count = levels[0].shape[1], len(levels)
    four = struct.pack("<I", codes[1]) if legacy else b"DX10"
    header = struct.pack("<4s7I44x2I4s5I5I", b"DDS ", 124, 0x2100F, n, n, 0, 0, count, 32, 4, four, 0, 0, 0, 0, 0,
                         0x401008, 0xFE00, 0, 0, 0)  # fmt: skip
    header += b"" if legacy else struct.pack("<5I", codes[0], 3, 4, 1, 0)
    return header + b"".join(level[f].astype(kind).tobytes() for f in range(6) for level in levels)


def with_alpha(faces):
    return np.concatenate([faces, np.ones_like(faces[..., :1])], axis=-1)


@pytest.mark.parametrize("axes", ["marker", "gltf"])
@pytest.mark.parametrize("handedness", ["left", "right"])
def test_ktx2_and_dds_lie_where_they_are_looked_up(marked, tmp_path, axes, handedness):
    path = tmp_path / "m.ktx2"
    assert fastibl.write_environment(path, marked, axes=axes, handedness=handedness) == [path]
    (faces,) = ktx2.read_ktx2(path)
    (tmp_path / "m.dds").write_bytes(dds([with_alpha(faces)], "<f2"))
    for d in away_from_edges():
        x, y, z = gltf(d) if axes == "gltf" else d
        at = (-x, y, z) if handedness == "left" else (x, y, z)
        np.testing.assert_allclose(opengl_lookup(faces, at), opengl_lookup(marked.faces, d), rtol=1e-3)
    for name in ("m.ktx2", "m.dds"):
        back = fastibl.read_environment(tmp_path / name, axes=axes, handedness=handedness)
        np.testing.assert_allclose(back.faces, marked.faces, rtol=1 / 2048)


def test_left_handed_faces_look_as_from_inside(marked, tmp_path):
    """Facing +z of a y-up frame, what lies at -x is on the right: as in a photograph."""
    fastibl.write_environment(tmp_path / "m.ktx2", marked, axes="marker")
    front = ktx2.read_ktx2(tmp_path / "m.ktx2")[0][4]
    columns = 2 * np.array([0, 31]) - 31
    directions = np.array([[-c, 0, 32] for c in columns])  # of the row's first and last texel
    expected = [opengl_lookup(marked.faces, d) for d in directions]
    np.testing.assert_allclose(front[16, [0, 31]], expected, rtol=1e-3)


def test_ktx2_bytes(tmp_path):
    """What the specification fixes: header, order and alignment of the levels, descriptor, keys."""
    levels = [np.full((6, n, n, 3), 2.0**-k) for k, n in enumerate((5, 2, 1))]
    ktx2.write_ktx2(tmp_path / "a.ktx2", levels)
    data = (tmp_path / "a.ktx2").read_bytes()
    assert data[:12] == bytes.fromhex("AB 4B 54 58 20 32 30 BB 0D 0A 1A 0A")
    assert struct.unpack_from("<9I", data, 12) == (97, 2, 5, 5, 0, 0, 6, 3, 0)
    index = [struct.unpack_from("<3Q", data, 80 + 24 * k) for k in range(3)]
    assert [length for _, length, _ in index] == [6 * n * n * 8 for n in (5, 2, 1)]
    assert [offset for offset, _, _ in index] == sorted((offset for offset, _, _ in index), reverse=True)
    assert all(offset % 8 == 0 for offset, _, _ in index) and index[0][0] + index[0][1] == len(data)
    for k, (offset, _, _) in enumerate(index):
        np.testing.assert_array_equal(np.frombuffer(data, "<f2", 4, offset), [2.0**-k] * 3 + [1])
    at, length, keys, _ = struct.unpack_from("<4I", data, 48)
    assert struct.unpack_from("<I", data, at)[0] == length == 92 and keys == at + length
    assert b"KTXorientation\0rd\0" in data and b"KTXwriter\0fastibl" in data
    for made, level in zip(ktx2.read_ktx2(tmp_path / "a.ktx2"), levels, strict=True):
        np.testing.assert_array_equal(made, level)


@pytest.mark.parametrize("packing", ["zlib", "zstandard"])
def test_packed_ktx2(tmp_path, packing):
    faces = np.random.default_rng(0).lognormal(size=(6, 8, 8, 3)).astype(np.float32)
    ktx2.write_ktx2(tmp_path / "a.ktx2", [faces])
    data = bytearray((tmp_path / "a.ktx2").read_bytes())
    offset, length, _ = struct.unpack_from("<3Q", data, 80)
    pack = zlib.compress
    if packing == "zstandard":
        pack = pytest.importorskip("zstandard", reason="pip install fastibl[ktx]").compress
    for count, fine in ((1, True), (4096, False)):  # a bomb: 4096 times as much as there should be
        packed = pack(bytes(data[offset:]) * count)
        struct.pack_into("<I", data, 44, {"zlib": 3, "zstandard": 2}[packing])
        struct.pack_into("<3Q", data, 80, offset, len(packed), length)
        (tmp_path / "b.ktx2").write_bytes(bytes(data[:offset]) + packed)
        if fine:
            np.testing.assert_allclose(ktx2.read_ktx2(tmp_path / "b.ktx2")[0], faces, rtol=1 / 2048)
        else:
            same_error(lambda: ktx2.read_ktx2(tmp_path / "b.ktx2"), ValueError, "b.ktx2", "damaged")


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("kind", ["<f2", "<f4"])
def test_dds_levels(tmp_path, kind, legacy):
    rng = np.random.default_rng(0)
    levels = [rng.lognormal(size=(6, n, n, 3)).astype(np.float32) for n in (8, 4, 2, 1)]
    (tmp_path / "a.dds").write_bytes(dds([with_alpha(level) for level in levels], kind, legacy))
    from fastibl.dds import read_dds

    for made, level in zip(read_dds(tmp_path / "a.dds"), levels, strict=True):
        np.testing.assert_allclose(made, level, rtol=1 / 2048 if kind == "<f2" else 0)


def test_packed_floats():
    """R11G11B10 and RGB9E5 by values that they hold exactly."""
    from fastibl.texels import decode

    one, half, quarter = 15 << 6, 14 << 6 | 1 << 5, 13 << 5
    word = struct.pack("<I", one | half << 11 | quarter << 22)
    np.testing.assert_array_equal(decode(word, "r11g11b10f", (1,)), [[1, 0.75, 0.25]])
    word = struct.pack("<I", 256 | 128 << 9 | 3 << 18 | 16 << 27)
    np.testing.assert_array_equal(decode(word, "rgb9e5", (1,)), [[1, 0.5, 3 / 256]])


@pytest.mark.parametrize("ending, kind", [("png", np.uint8), ("png", np.uint16), ("jpg", np.uint8)])
def test_encoded_pictures_need_their_response(tmp_path, ending, kind):
    most = np.iinfo(kind).max
    encoded = np.full((16, 32, 3), (0.25, 0.5, 0.75))
    cv2.imwrite(
        str(tmp_path / f"a.{ending}"), np.rint(encoded[..., ::-1] * most).astype(kind), [cv2.IMWRITE_JPEG_QUALITY, 100]
    )
    path = tmp_path / f"a.{ending}"
    same_error(lambda: fastibl.read_environment(path), ValueError, f"a.{ending}", "Response.srgb()")
    for response in (fastibl.Response.srgb(), fastibl.Response.gamma(2.0)):
        cube = fastibl.read_environment(path, size=8, response=response)
        expected = response.decode(np.array([0.25, 0.5, 0.75], np.float32))
        np.testing.assert_allclose(cube.mean(), expected, rtol=0.02 if kind is np.uint8 else 1e-4)
    fastibl.write_environment(tmp_path / "a.hdr", cube)
    same_error(lambda: fastibl.read_environment(tmp_path / "a.hdr", response=response), ValueError, "linear")


@pytest.mark.parametrize("axes", ["marker", "gltf"])
def test_spherical_harmonics_of_each_convention(marked, tmp_path, axes):
    """Evaluated as the renderers do, against a sum over all texels."""
    n = units(100)
    true = reference.irradiance(fastibl.CubeMap(marked.faces), n)
    x, y, z = np.moveaxis(gltf(n) if axes == "gltf" else n, -1, 0)
    bare = np.stack([np.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], axis=-1)

    fastibl.write_sh(tmp_path / "sh.txt", marked, axes=axes)
    lines = (tmp_path / "sh.txt").read_text().splitlines()
    rows = np.array([[float(v) for v in line[1 : line.index(")")].split(",")] for line in lines])
    assert lines[3].endswith("; // L11, irradiance, pre-scaled base")
    filament = np.pi * bare @ rows

    fastibl.write_sh(tmp_path / "sh.json", marked, "filament", axes=axes)
    named = json.loads((tmp_path / "sh.json").read_text())
    np.testing.assert_allclose(named["sh"], rows, rtol=1e-8, atol=1e-12)
    assert named["axes"] == axes

    fastibl.write_sh(tmp_path / "probe.json", marked, "three.js", axes=axes)
    sh = np.array(json.loads((tmp_path / "probe.json").read_text())["object"]["sh"]).reshape(9, 3)
    fastibl.write_sh(tmp_path / "probe.txt", marked, "three.js", axes=axes)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "probe.txt"), sh, rtol=1e-8)
    # three.js' shGetIrradianceAt.
    three = bare * [0.886227, *3 * [2 * 0.511664], *2 * [2 * 0.429043], 0.743125 / 3, 2 * 0.429043, 0.429043] @ sh
    np.testing.assert_allclose(three, filament, rtol=1e-4)
    off = np.abs(filament - true).mean() / true.mean()
    print(f"{axes}: {100 * off:.2f} % off the sum")
    assert off < 0.03

    white = fastibl.CubeMap(np.ones((6, 4, 4, 3)))
    np.testing.assert_allclose(sh_files.spherical_harmonics(white, "filament"), [[1] * 3] + [[0] * 3] * 8, atol=1e-6)
    same_error(lambda: fastibl.write_sh(tmp_path / "a.csv", marked), ValueError, "a.csv", ".json")
    same_error(lambda: fastibl.write_sh(tmp_path / "a.txt", marked, "unity"), ValueError, "unity", "three.js")


def bomb_png(width, height):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    )


def ktx2_header(**changed):
    fields = dict(kind=97, size=2, width=8, height=8, depth=0, layers=0, faces=6, levels=1, packing=0) | changed
    at = 80 + 24 * max(fields["levels"], 1)
    return (b"\xabKTX 20\xbb\r\n\x1a\n" + struct.pack("<9I", *fields.values()) + struct.pack("<4I2Q", 0, 0, 0, 0, 0, 0)
            + struct.pack("<3Q", at, 8 * 6 * 64, 8 * 6 * 64) * max(fields["levels"], 1)
            + bytes(8 * 6 * 64))  # fmt: skip


DDS, D3D9 = (dds([np.ones((6, 4, 4, 4))], "<f2", legacy) for legacy in (False, True))
HOSTILE = {
    "huge.png": (bomb_png(60000, 60000), "60000 x 60000"),
    "cut.png": (bomb_png(32, 16)[:50], "cut off"),
    "empty.png": (b"", "no PNG"),
    "huge.hdr": (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n" + bytes(99), "200000 x 100000"),
    "digits.hdr": (b"#?RADIANCE\n\n-Y " + b"9" * 5000 + b" +X 2\n", "no Radiance"),
    "cut.hdr": (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n" + bytes(99), "cut off"),
    "huge.jpg": (b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03" + bytes(20) + b"\xff\xd9", "65535 x 65535"),
    "cut.jpg": (b"\xff\xd8\xff\xc0\0\x11\x08\0\x10\0\x20\x03" + bytes(20), "cut off"),
    "no_frame.jpg": (b"\xff\xd8\xff\xe0\xff\xff" + bytes(20), "without a frame"),
    "flat.ktx2": (ktx2_header(faces=1), "no cube map"),
    "oblong.ktx2": (ktx2_header(height=4), "no cube map"),
    "array.ktx2": (ktx2_header(layers=2), "2 layers"),
    "huge.ktx2": (ktx2_header(width=1 << 31, height=1 << 31), "pixels are read"),
    "bytes.ktx2": (ktx2_header(kind=37), "VkFormat 37"),
    "basis.ktx2": (ktx2_header(packing=1), "BasisLZ"),
    "levels.ktx2": (ktx2_header(levels=9), "9 levels"),
    "many.ktx2": (ktx2_header()[:40] + struct.pack("<I", 1 << 31) + ktx2_header()[44:], "levels"),
    "cut.ktx2": (ktx2_header()[:200], "cut off"),
    "short.ktx2": (ktx2_header()[:40], "no KTX 2"),
    "zip.ktx2": (ktx2_header(packing=3), "damaged"),
    "short.dds": (b"DDS " + bytes(20), "no DDS"),
    "flat.dds": (D3D9[:112] + bytes(4) + bytes(200), "no cube map"),
    "cut.dds": (DDS[:-1], "cut off"),
    "five.dds": (D3D9[:112] + struct.pack("<I", 0x7E00) + bytes(999), "no cube"),
    "bc6h.dds": (DDS[:128] + struct.pack("<5I", 95, 3, 4, 1, 0) + bytes(999), "DXGI_FORMAT 95"),
    "huge.dds": (DDS[:12] + struct.pack("<2I", 1 << 31, 1 << 31)
                 + DDS[20:], "pixels are read"),
    "picture.tif": (b"II*\0" + bytes(64), ".hdr, .exr"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_maps_are_refused(name, tmp_path):
    data, word = HOSTILE[name]
    (tmp_path / name).write_bytes(data)
    response = fastibl.Response.srgb() if name.endswith(("png", "jpg")) else None
    same_error(lambda: fastibl.read_environment(tmp_path / name, response=response), ValueError, name, word)


def test_hostile_exr(tmp_path):
    """A header of 64 thousand squared pixels on a small file: refused before any of them is asked for."""
    pytest.importorskip("OpenEXR", reason="pip install fastibl[exr]")
    path = tmp_path / "a.exr"
    fastibl.write_environment(path, fastibl.CubeMap(np.ones((6, 4, 4, 3))), height=16)
    data = bytearray(path.read_bytes())
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        struct.pack_into("<4i", data, data.index(name) + len(name) + 4, 0, 0, 65535, 65535)
    path.write_bytes(bytes(data))
    same_error(lambda: fastibl.read_environment(path), ValueError, "a.exr", "65536 x 65536", str(MOST_PIXELS))
    path.write_bytes(bytes(data[: len(data) // 2]))
    same_error(lambda: fastibl.read_environment(path), ValueError, "a.exr")


def test_faces_of_different_sizes(marked, tmp_path):
    paths = fastibl.write_environment(tmp_path / "m.hdr", marked, "faces")
    fastibl.pictures.write_picture(paths[3], np.ones((7, 7, 3), np.float32))
    same_error(lambda: fastibl.read_environment(paths[0]), ValueError, "m_ny.hdr", "7 x 7", "32 x 32")
    paths[3].unlink()
    same_error(lambda: fastibl.read_environment(paths[0]), FileNotFoundError, "m_ny.hdr")
