"""File formats of maps and light: round trips, orientation by one marked map, files that are damaged or hostile."""

import base64
import json
import re
import struct
import tracemalloc
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from test_export import AXES, gltf, in_axes, opengl_lookup

import fastibl
from conftest import same_error, units
from fastibl import __main__, ktx2, reference, sh_files
from fastibl.axes import to_axes
from fastibl.file_limits import MOST_PIXELS
from hostile import MORE, is_light, mutated, outcome


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


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("handedness", ["left", "right"])
def test_ktx2_and_dds_lie_where_they_are_looked_up(marked, tmp_path, axes, handedness):
    path = tmp_path / "m.ktx2"
    assert fastibl.write_environment(path, marked, axes=axes, handedness=handedness) == [path]
    (faces,) = ktx2.read_ktx2(path)
    fastibl.write_environment(tmp_path / "m.dds", marked, axes=axes, handedness=handedness)
    data = (tmp_path / "m.dds").read_bytes()
    assert struct.unpack_from("<I", data, 20)[0] == 32 * 8  # bytes of a row, which some writers leave out
    assert data[:20] + bytes(4) + data[24:] == dds([with_alpha(faces)], "<f2")
    for d in away_from_edges():
        x, y, z = in_axes(d, axes)
        at = (x, y, z) if (handedness == "left") == (axes == "unity") else (-x, y, z)
        np.testing.assert_allclose(opengl_lookup(faces, at), opengl_lookup(marked.faces, d), rtol=1e-3)
    same_error(lambda: fastibl.write_environment(path, marked, "strip"), ValueError, "layout", "m.ktx2")
    same_error(lambda: fastibl.write_environment(path, marked, height=8), ValueError, "height", "m.ktx2")
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


@pytest.mark.parametrize("version", ["1" * k for k in range(1, 9)])
def test_ktx2_levels_are_aligned_whatever_the_version(tmp_path, monkeypatch, version):
    """They follow a key that names it."""
    monkeypatch.setattr(ktx2, "__version__", version)
    ktx2.write_ktx2(tmp_path / "a.ktx2", [np.ones((6, n, n, 3)) for n in (2, 1)])
    data = (tmp_path / "a.ktx2").read_bytes()
    assert all(struct.unpack_from("<Q", data, 80 + 24 * k)[0] % 8 == 0 for k in range(2))


@pytest.mark.parametrize("packing", ["zlib", "zstandard"])
def test_packed_ktx2(tmp_path, packing):
    faces = np.random.default_rng(0).lognormal(size=(6, 8, 8, 3)).astype(np.float32)
    ktx2.write_ktx2(tmp_path / "a.ktx2", [faces])
    data = bytearray((tmp_path / "a.ktx2").read_bytes())
    offset, length, _ = struct.unpack_from("<3Q", data, 80)
    pack = zlib.compress
    if packing == "zstandard":
        pack = pytest.importorskip("zstandard", reason="pip install zstandard").compress
    for count, fine in ((1, True), (4096, False)):  # a bomb: 4096 times as much as there should be
        packed = pack(bytes(data[offset:]) * count)
        struct.pack_into("<I", data, 44, {"zlib": 3, "zstandard": 2}[packing])
        struct.pack_into("<3Q", data, 80, offset, len(packed), length)
        (tmp_path / "b.ktx2").write_bytes(bytes(data[:offset]) + packed)
        if fine:
            np.testing.assert_allclose(ktx2.read_ktx2(tmp_path / "b.ktx2")[0], faces, rtol=1 / 2048)
        else:
            tracemalloc.start()
            try:
                same_error(lambda: ktx2.read_ktx2(tmp_path / "b.ktx2"), ValueError, "b.ktx2", "damaged")
                assert tracemalloc.get_traced_memory()[1] < 50 * length + len(packed) + 2**20  # not all of the bomb
            finally:
                tracemalloc.stop()


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("kind", ["<f2", "<f4"])
def test_dds_levels(tmp_path, kind, legacy):
    rng = np.random.default_rng(0)
    levels = [rng.lognormal(size=(6, n, n, 3)).astype(np.float32) for n in (8, 4, 2, 1)]
    (tmp_path / "a.dds").write_bytes(dds([with_alpha(level) for level in levels], kind, legacy))
    from fastibl.dds import read_dds

    for made, level in zip(read_dds(tmp_path / "a.dds"), levels, strict=True):
        np.testing.assert_allclose(made, level, rtol=1 / 2048 if kind == "<f2" else 0)


def bc6h_block(code):
    """One color in 4 x 4 texels, as end points of 10 bits in mode 11, and its value."""
    bits = 3
    for k, end in enumerate((*code, *code)):
        bits |= int(end) << (5 + 10 * k)
    halves = (((code.astype(np.uint32) << 16) + 0x8000) >> 10) * 31 >> 6
    return bits.to_bytes(16, "little"), halves.astype("<u2").view("<f2").astype(np.float32)


def test_bc6h_dds(tmp_path):
    pytest.importorskip("OpenImageIO", reason="pip install OpenImageIO")
    codes = np.random.default_rng(0).integers(200, 600, (6, 2, 2, 3))
    data, n = dds([np.ones((6, 8, 8, 4))], "<f2")[:128] + struct.pack("<5I", 95, 3, 4, 1, 0), 8
    data = data[:28] + struct.pack("<I", 2) + data[32:]  # levels
    expected = np.empty((6, n, n, 3), np.float32)
    for face in range(6):
        for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
            block, value = bc6h_block(codes[face, row, column])
            data += block
            expected[face, 4 * row : 4 * row + 4, 4 * column : 4 * column + 4] = value
        data += bytes(16)  # level 1 of the face
    (tmp_path / "a.dds").write_bytes(data)
    np.testing.assert_array_equal(fastibl.dds.read_dds(tmp_path / "a.dds")[0], expected)
    cube = fastibl.read_environment(tmp_path / "a.dds", axes="marker", handedness="right")
    np.testing.assert_array_equal(cube.faces, expected)


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


@pytest.mark.parametrize("axes", AXES)
def test_spherical_harmonics_of_each_convention(marked, tmp_path, axes):
    """Evaluated as the renderers do, against a sum over all texels."""
    n = units(100)
    true = reference.irradiance(fastibl.CubeMap(marked.faces), n)
    x, y, z = np.moveaxis(in_axes(n, axes), -1, 0)
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
    "liar.hdr": (b"#?RADIANCE\n-Y 2 +X 4\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n", "200000 x 100000"),
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
    "bc7.dds": (DDS[:128] + struct.pack("<5I", 98, 3, 4, 1, 0) + bytes(999), "DXGI_FORMAT 98"),
    "bc6h.dds": (DDS[:128] + struct.pack("<5I", 95, 3, 4, 1, 0) + bytes(95), "cut off"),
    "levels.dds": (DDS[:28] + struct.pack("<I", 9) + DDS[32:], "9 levels"),
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


EQUIRECT = np.random.default_rng(5).uniform(0.1, 2, (16, 32, 3)).astype(np.float32)


def exr_of(path, parts):
    """A file of (header, channels) parts."""
    exr = pytest.importorskip("OpenEXR")
    made = [
        exr.Part({"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage, **head}, channels, f"part {k}")
        for k, (head, channels) in enumerate(parts)
    ]
    with exr.File(made) as file:
        file.write(str(path))
    return path


def test_exr_of_several_kinds_of_numbers_and_parts(tmp_path):
    """Half RGB beside float alpha; depth in a part before the picture."""
    half = {c: EQUIRECT[..., k].astype(np.float16) for k, c in enumerate("RGB")}
    expected = fastibl.cubemap_from_equirect(EQUIRECT.astype(np.float16).astype(np.float32), size=16).faces
    mixed = exr_of(tmp_path / "a.exr", [({}, half | {"A": np.ones((16, 32), np.float32)})])
    np.testing.assert_array_equal(fastibl.read_environment(mixed, 16).faces, expected)
    parts = exr_of(tmp_path / "b.exr", [({}, {"Z": np.ones((16, 32), np.float32)}), ({}, half)])
    np.testing.assert_array_equal(fastibl.read_environment(parts, 16).faces, expected)


def test_exr_data_window(tmp_path):
    """A part of the picture lies where its windows say; the rest is black."""
    window = lambda left, top, w, h: (np.array([left, top], np.int32), np.array([left + w - 1, top + h - 1], np.int32))  # noqa: E731
    for display, data in (
        ((0, 0, 32, 16), (8, 4, 16, 8)),
        ((5, -3, 32, 16), (5, -3, 32, 10)),
        ((4, 4, 16, 8), (0, 0, 32, 16)),
    ):
        (left, top, w, h), (x, y, dw, dh) = display, data
        path = exr_of(tmp_path / "a.exr", [({"displayWindow": window(*display), "dataWindow": window(*data)},
                                            {"RGB": np.ascontiguousarray(EQUIRECT[:dh, :dw])})])  # fmt: skip
        whole = np.zeros((h, w, 3), np.float32)
        for row in range(h):
            for column in range(w):
                if 0 <= row + top - y < dh and 0 <= column + left - x < dw:
                    whole[row, column] = EQUIRECT[row + top - y, column + left - x]
        expected = fastibl.cubemap_from_equirect(whole, size=8).faces
        np.testing.assert_array_equal(fastibl.read_environment(path, 8).faces, expected)


def test_exr_primaries(tmp_path):
    """A colour in ACES' primaries is the same colour in Rec. 709: by Mitsuba's and the ACES documents' matrix."""
    to_709 = np.array([[2.52169, -1.13413, -0.38756], [-0.27648, 1.37272, -0.09624], [-0.01538, -0.15298, 1.16835]])
    aces = EQUIRECT @ np.linalg.inv(to_709).T.astype(np.float32)
    head = {"chromaticities": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)}
    found = fastibl.read_environment(exr_of(tmp_path / "a.exr", [(head, {"RGB": aces.astype(np.float32)})]), 16).faces
    np.testing.assert_allclose(found, fastibl.cubemap_from_equirect(EQUIRECT, size=16).faces, atol=2e-3)
    same = {"chromaticities": (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)}
    found = fastibl.read_environment(exr_of(tmp_path / "b.exr", [(same, {"RGB": EQUIRECT})]), 16).faces
    np.testing.assert_array_equal(found, fastibl.cubemap_from_equirect(EQUIRECT, size=16).faces)


def hdr_with(tmp_path, *lines, order=b"-Y 16 +X 32"):
    from fastibl.pictures import write_picture

    write_picture(tmp_path / "plain.hdr", EQUIRECT)
    data = (tmp_path / "plain.hdr").read_bytes()
    data = data.replace(b"\n\n", b"\n" + b"".join(line + b"\n" for line in lines) + b"\n", 1)
    (tmp_path / "a.hdr").write_bytes(data.replace(b"-Y 16 +X 32", order))
    return fastibl.read_environment(tmp_path / "plain.hdr", 16).faces, tmp_path / "a.hdr"


def test_radiance_headers(tmp_path):
    """Radiance's own definition of EXPOSURE; pictures that run from another corner."""
    plain, path = hdr_with(tmp_path, b"EXPOSURE=2", b"VIEW=-vta", b"EXPOSURE= 4.0e+00")
    np.testing.assert_allclose(fastibl.read_environment(path, 16).faces, plain / 8, rtol=1e-6)
    _, path = hdr_with(tmp_path, b"COLORCORR=2 1 0.5", b"EXPOSURE=2", b"COLORCORR= 1 4.0 1", b"COLORCORR=3 3")
    np.testing.assert_allclose(fastibl.read_environment(path, 16).faces, plain / np.float32([4, 8, 1]), rtol=1e-6)
    from fastibl.pictures import read_picture

    upright = read_picture(tmp_path / "plain.hdr")
    for order, flips in ((b"+Y 16 +X 32", 0), (b"-Y 16 -X 32", 1), (b"+Y 16 -X 32", (0, 1))):
        _, path = hdr_with(tmp_path, order=order)
        np.testing.assert_array_equal(read_picture(path), np.flip(upright, flips))
    _, path = hdr_with(tmp_path, order=b"+X 32 -Y 16")
    same_error(lambda: fastibl.read_environment(path), ValueError, "a.hdr", "columns")
    data = (tmp_path / "plain.hdr").read_bytes()
    for head in (
        data.replace(b"FORMAT=32-bit_rle_rgbe\n", b""),
        data.replace(b"#?RADIANCE", b"#?AUTOPANO"),
        data.replace(b"\n\n-Y 16 +X 32\n", b"\r\n\r\n-Y 16 +X 32\r\n").replace(b"\nFORMAT", b"\r\nFORMAT"),
    ):
        assert head != data
        (tmp_path / "other.hdr").write_bytes(head)
        np.testing.assert_array_equal(read_picture(tmp_path / "other.hdr"), upright)
    (tmp_path / "xyz.hdr").write_bytes(
        path.read_bytes().replace(b"+X 32 -Y 16", b"-Y 16 +X 32").replace(b"rgbe", b"xyze")
    )
    same_error(lambda: fastibl.read_environment(tmp_path / "xyz.hdr"), ValueError, "xyz.hdr", "32-bit_rle_xyze")


@pytest.mark.parametrize("share", [0.02, 0.2, 0.5, 0.9, 0.99])
def test_an_exr_that_is_cut_off(marked, tmp_path, share):
    pytest.importorskip("OpenEXR")
    fastibl.write_environment(tmp_path / "whole.exr", marked)
    data = (tmp_path / "whole.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(data[: int(share * len(data))])
    same_error(lambda: fastibl.read_environment(tmp_path / "cut.exr"), ValueError, "cut.exr")


def test_photographs_are_no_crosses(marked, tmp_path):
    photograph = np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "photograph.png"), photograph)
    read = lambda name: fastibl.read_environment(tmp_path / name, response=fastibl.Response.srgb())  # noqa: E731
    same_error(lambda: read("photograph.png"), ValueError, "photograph.png", "corners are not empty", "twice as wide")
    (tmp_path / "room.tif").write_bytes(b"II*")
    same_error(lambda: read("room.tif"), ValueError, "room.tif", ".hdr, .exr, .png, .jpg, .jpeg, .ktx2, .dds")
    same_error(
        lambda: fastibl.read_environment(tmp_path / "photograph.png", response="srgb"), TypeError, "response", "str"
    )
    fastibl.write_environment(tmp_path / "cross.hdr", marked, layout="cross")
    assert fastibl.read_environment(tmp_path / "cross.hdr").size == marked.size


def test_what_files_hold_is_counted_when_cleaned(tmp_path):
    broken = EQUIRECT.copy()
    broken[3, 3, 0], broken[4, 4, 1], broken[5, 5, 2] = np.nan, -1, np.inf
    path = exr_of(tmp_path / "a.exr", [({}, {"RGB": broken})])
    expected = fastibl.cubemap_from_equirect(broken, size=16).cleaned
    assert min(expected.values()) > 0
    for axes in ("marker", "gltf"):
        assert fastibl.read_environment(path, 16, axes=axes).cleaned == expected


def test_an_export_that_fails_leaves_what_was_there(marked, tmp_path):
    fastibl.export_light(marked, tmp_path, size=32, levels=3, sh="filament")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert "sh.txt" in before and "light.json" in before
    for wrong in (dict(size=48, gltf=True), dict(layout="equirect"), dict(format="ktx2", levels=9, size=64)):
        with pytest.raises(ValueError):
            fastibl.export_light(marked, tmp_path, **wrong)
        assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
    for call in (fastibl.export_light, fastibl.write_gltf_light, fastibl.write_usd):
        same_error(lambda call=call: call(*((None, tmp_path) if call is fastibl.export_light else (
            tmp_path / ("a.glb" if call is fastibl.write_gltf_light else "a.usda"), None))),
            TypeError, "cube must be CubeMap", "None")  # fmt: skip
    same_error(lambda: fastibl.write_shadow(tmp_path / "a.exr", None), TypeError, "shadow must be ShadowMap", "None")
    same_error(lambda: fastibl.compare("room.hdr", marked), TypeError, "a map must be", "str")
    same_error(lambda: fastibl.compare(np.zeros((6, 4, 4, 3), np.uint8), marked), TypeError)
    same_error(lambda: fastibl.write_environment(tmp_path / "a.hdr", marked, height=-4), ValueError, "height", "-4")


def test_hostile_exr(tmp_path):
    """A header of 64 thousand squared pixels on a small file: refused before any of them is asked for."""
    pytest.importorskip("OpenEXR", reason="pip install OpenEXR")
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


def triangle_gltf(**changed):
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], "<f4").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(points).decode()
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "white.png"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": kind} for kind in ("VEC3", "VEC2")],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": uri}],
    }
    return content | changed


LAUGHS = [{"children": [k + 1, k + 1]} for k in range(64)] + [{"mesh": 0}]
NO_VIEW = [{"componentType": 5126, "count": 1 << 31, "type": "VEC3"}] * 2
HOSTILE_GLTF = {
    "leaves": (dict(buffers=[{"byteLength": 36, "uri": "../points.bin"}]), "outside of its folder"),
    "escapes": (dict(buffers=[{"byteLength": 36, "uri": "%2e%2e/points.bin"}]), "outside of its folder"),
    "absolute": (dict(buffers=[{"byteLength": 36, "uri": "/dev/zero"}]), "outside of its folder"),
    "missing": (dict(buffers=[{"byteLength": 36, "uri": "none.bin"}]), "not there"),
    "laughs": (dict(nodes=LAUGHS), "nodes form"),
    "ring": (dict(nodes=[{"mesh": 0, "children": [0]}]), "nodes form"),
    "nothing": (dict(accessors=NO_VIEW), "accessors"),
    "beyond": (dict(accessors=[{"bufferView": 0, "componentType": 5126, "count": 9, "type": "VEC3"}] * 2), ""),
    "wrong": (dict(nodes=[7]), "damaged"),
    "scenes": (dict(scenes=[[]]), "damaged"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE_GLTF)
def test_hostile_gltf_is_refused(name, tmp_path):
    folder = tmp_path / "object"
    folder.mkdir()
    (tmp_path / "points.bin").write_bytes(bytes(36))
    cv2.imwrite(str(folder / "white.png"), np.full((2, 2, 3), 255, np.uint8))
    path = folder / "a.gltf"
    path.write_text(json.dumps(triangle_gltf()))
    assert len(fastibl.read_object(path)[0].triangles) == len(fastibl.read_mesh(path).triangles) == 1
    changed, word = HOSTILE_GLTF[name]
    path.write_text(json.dumps(triangle_gltf(**changed)))
    for read in (fastibl.read_object, fastibl.read_mesh):
        same_error(lambda read=read: read(path), ValueError, "a.gltf", word)


@pytest.mark.parametrize(
    "uri, word", [("../white.png", "outside"), ("bomb.png", "60000 x 60000"), ("text.png", "JPEG")]
)
def test_hostile_textures_are_refused(uri, word, tmp_path):
    folder = tmp_path / "object"
    folder.mkdir()
    cv2.imwrite(str(tmp_path / "white.png"), np.full((2, 2, 3), 255, np.uint8))
    (folder / "bomb.png").write_bytes(bomb_png(60000, 60000))
    (folder / "text.png").write_text("no picture")
    (folder / "a.gltf").write_text(json.dumps(triangle_gltf(images=[{"uri": uri}])))
    same_error(lambda: fastibl.read_object(folder / "a.gltf"), ValueError, "a.gltf", word)
    assert len(fastibl.read_mesh(folder / "a.gltf").triangles) == 1  # looks at no texture


@pytest.mark.parametrize("content", [b"[" * 100000, b"[]", b"{}", b"glTF" + bytes(40)])
def test_what_is_no_gltf(content, tmp_path):
    for ending in (".glb", ".gltf"):
        (tmp_path / f"a{ending}").write_bytes(content)
        for read in (fastibl.read_object, fastibl.read_mesh):
            same_error(lambda read=read, ending=ending: read(tmp_path / f"a{ending}"), ValueError, f"a{ending}")


PLY = b"ply\nformat %b 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\n"
PLY += b"element face 2\nproperty list uint int vertex_indices\nend_header\n"
HOSTILE_MESHES = {
    "binary.ply": PLY % b"binary_little_endian" + bytes(100),
    "ascii.ply": PLY % b"ascii" + b"0 0 0\n",
    "list.ply": PLY.replace(b"4000000000", b"1") % b"binary_little_endian" + bytes(12) + struct.pack("<I", 4000000000),
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4000000000\n",
    "many.stl": bytes(80) + struct.pack("<I", 4000000000) + bytes(50),
    "archive.zip": b"PK\3\4" + bytes(60),
    "archive.3mf": b"PK\3\4" + bytes(60),
}


@pytest.mark.parametrize("name", HOSTILE_MESHES)
def test_hostile_meshes_are_refused(name, tmp_path):
    (tmp_path / name).write_bytes(HOSTILE_MESHES[name])
    same_error(lambda: fastibl.read_mesh(tmp_path / name), ValueError, name)


def test_large_files_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fastibl.file_limits.MOST_BYTES", 99)
    for name, read in (("a.ktx2", fastibl.read_environment), ("a.hdr", fastibl.read_environment),
                       ("a.obj", fastibl.read_mesh), ("a.glb", fastibl.read_object)):  # fmt: skip
        (tmp_path / name).write_bytes(bytes(100))
        same_error(lambda name=name, read=read: read(tmp_path / name), ValueError, name, "100 bytes", "99")


def glb(path):
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def test_gltf_light(marked, tmp_path):
    """Its picture bytes, decoded as Babylon.js does, and its harmonics, where the readers look them up."""
    fastibl.write_gltf_light(tmp_path / "light.glb", marked, size=32)
    content, body = glb(tmp_path / "light.glb")
    light = content["extensions"]["EXT_lights_image_based"]["lights"][0]
    assert content["scenes"][0]["extensions"]["EXT_lights_image_based"]["light"] == 0
    assert light["specularImageSize"] == 32 and len(light["specularImages"]) == 2
    faces = decoded(content, body, light, 0)[:, ::-1]  # the reader puts each face upright
    for d in away_from_edges():
        x, y, z = gltf(d)
        np.testing.assert_allclose(opengl_lookup(faces, (-x, y, z)), opengl_lookup(marked.faces, d), rtol=0.02)
    n = units(100)
    x, y, z = np.moveaxis(gltf(n) * [-1, 1, 1], -1, 0)
    # Peter-Pike Sloan 2008, Stupid Spherical Harmonics Tricks, appendix A2: with the Condon-Shortley phase.
    basis = np.stack([0.282095 + 0 * x, -0.488603 * y, 0.488603 * z, -0.488603 * x, 1.092548 * x * y, -1.092548 * y * z,
                      0.315392 * (3 * z * z - 1), -1.092548 * x * z, 0.546274 * (x * x - y * y)], axis=-1)  # fmt: skip
    true = reference.irradiance(marked, n)
    off = np.abs(basis @ np.array(light["irradianceCoefficients"]) - true).mean() / true.mean()
    print(f"irradiance of the harmonics {100 * off:.2f} % off the sum")
    assert off < 0.03

    fastibl.write_gltf_light(tmp_path / "light.gltf", marked, size=32)
    text = json.loads((tmp_path / "light.gltf").read_text())
    assert text["extensions"] == content["extensions"]
    assert (
        base64.b64decode(text["images"][0]["uri"].partition(",")[2]) == body[: content["bufferViews"][0]["byteLength"]]
    )
    same_error(lambda: fastibl.write_gltf_light(tmp_path / "a.glb", marked, size=48), ValueError, "48", "power of two")
    same_error(lambda: fastibl.write_gltf_light(tmp_path / "a.obj", marked), ValueError, "a.obj", ".glb")


def decoded(content, body, light, level):
    """Faces of a level of an image-based light as Babylon.js decodes them."""
    faces = []
    for index in light["specularImages"][level]:
        view = content["bufferViews"][content["images"][index]["bufferView"]]
        png = body[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        bgra = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED) / 255
        faces.append(bgra[..., 2::-1] ** 2.2 / bgra[..., 3:])
    return np.array(faces)


@pytest.mark.parametrize("scale", [1e-12, 1e-5, 1e-3, 0.1, 1, 5, 100, 1000, 1e7])
def test_gltf_light_of_any_unit(tmp_path, scale):
    """Images and harmonics times the intensity are the map's light, whatever its unit."""
    faces = np.random.default_rng(0).uniform(0.2, 1, (6, 32, 32, 3))
    faces[2] *= 4
    cube = fastibl.CubeMap(faces * scale)
    fastibl.write_gltf_light(tmp_path / "light.glb", cube, size=64)
    content, body = glb(tmp_path / "light.glb")
    light = content["extensions"]["EXT_lights_image_based"]["lights"][0]
    assert (light["intensity"] == 1) == (0.1 <= scale <= 5)  # as Babylon.js reads them best
    levels = fastibl.Lighting(to_axes(cube, "gltf")).prefiltered(64, 3)
    for k, level in enumerate(levels):
        off = light["intensity"] * decoded(content, body, light, k).mean() / level.faces.mean(dtype=np.float64) - 1
        print(f"level {k}: {100 * off:.2f} % off")
        assert abs(off) < 0.005
    constant = np.array(light["irradianceCoefficients"])[0] * light["intensity"]
    np.testing.assert_allclose(constant, np.array(cube.mean()) * 2 * np.pi**1.5, rtol=1e-4)


def test_a_sun_is_cut_in_the_sharpest_level_of_a_gltf_light_alone(tmp_path):
    faces = np.full((6, 64, 64, 3), 0.1)
    faces[2, 30:34, 30:34] = 20000
    cube = fastibl.CubeMap(faces)
    fastibl.write_gltf_light(tmp_path / "light.glb", cube, size=128)
    content, body = glb(tmp_path / "light.glb")
    light = content["extensions"]["EXT_lights_image_based"]["lights"][0]
    levels = fastibl.Lighting(to_axes(cube, "gltf")).prefiltered(128, 4)
    assert levels[1].faces.max() > 255 and light["intensity"] > 1
    for k in (1, 2, 3):
        found = light["intensity"] * decoded(content, body, light, k)
        assert found.max() == pytest.approx(levels[k].faces.max(), rel=0.01)
        assert found.mean() == pytest.approx(levels[k].faces.mean(), rel=0.005)
    black = fastibl.CubeMap(np.zeros((6, 4, 4, 3)))
    fastibl.write_gltf_light(tmp_path / "black.glb", black, size=32)
    content, body = glb(tmp_path / "black.glb")
    light = content["extensions"]["EXT_lights_image_based"]["lights"][0]
    assert light["intensity"] == 1 and decoded(content, body, light, 0).max() == 0


def test_rgbd_keeps_the_range():
    from fastibl.gltf_light import rgbd

    linear = np.geomspace(0.01, 255, 3000).astype(np.float32).reshape(-1, 1) * [1, 0.5, 0.25]
    coded = rgbd(linear.astype(np.float32)) / 255
    back = coded[:, :3] ** 2.2 / coded[:, 3:]
    off = np.abs(back / linear - 1)
    print(f"RGBD: at most {100 * off.max():.1f} % off, mean bias {100 * (back / linear - 1).mean():.3f} %")
    assert off[linear.max(axis=1) > 1].max() < 0.02 and abs((back / linear - 1).mean()) < 1e-3
    assert (rgbd(np.float32([[0, 0, 0], [1e6, 0, 0]])) == [[0, 0, 0, 255], [255, 0, 0, 1]]).all()


def test_faces_have_as_many_pixels_as_pictures(marked, tmp_path):
    path = tmp_path / "a.hdr"
    fastibl.write_environment(path, marked, height=16)
    told = "must be at most 4729, for six faces of 134217728 pixels together; got 100000"
    same_error(lambda: fastibl.read_environment(path, size=100000), ValueError, "size " + told)
    same_error(lambda: fastibl.export_light(marked, tmp_path, size=100000), ValueError, "size " + told)
    same_error(
        lambda: fastibl.export_light(marked, tmp_path, irradiance=300), ValueError, "irradiance must be 1 to 256", "300"
    )


@pytest.mark.parametrize("axes", ["marker", "gltf"])
def test_usd_dome_light(marked, tmp_path, axes):
    """Looked up through the transform and by the words of UsdLuxDomeLight: +z in the middle, +x to its left, +y up."""
    usd, lux = (pytest.importorskip(f"pxr.{name}", reason="pip install usd-core") for name in ("Usd", "UsdLux"))
    from pxr import UsdGeom

    path, picture = fastibl.write_usd(tmp_path / "light.usda", marked, axes=axes, height=128)
    stage = usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == {"gltf": "Y", "marker": "Z"}[axes]
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    (prim,) = (p for p in stage.Traverse() if p.IsA(lux.DomeLight))
    light = lux.DomeLight(prim)
    assert light.GetTextureFormatAttr().Get() == "latlong" and light.GetIntensityAttr().Get() == 1
    file = light.GetTextureFileAttr().Get().resolvedPath
    assert file == str(picture)
    image = fastibl.pictures.read_picture(picture)
    world_from_dome = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(usd.TimeCode.Default())).T[:3, :3]
    checked = 0
    for d in units(300):
        x, y, z = world_from_dome.T @ (gltf(d) if axes == "gltf" else d)
        row, column = int(np.arccos(y) / np.pi * 128), int((0.5 - np.arctan2(x, z) / (2 * np.pi)) * 256) % 256
        around = image[max(row - 6, 0) : row + 7, np.arange(column - 7, column + 8) % 256]
        if np.ptp(around, axis=(0, 1)).max() < 0.01:
            np.testing.assert_allclose(image[row, column], opengl_lookup(marked.faces, d), rtol=0.02)
            checked += 1
    assert checked > 100
    for name in ("room@2x.usda", "a@@@b@@.usda", 'my "room" ü.usda'):
        path, picture = fastibl.write_usd(tmp_path / name, marked, axes=axes, height=8)
        stage = usd.Stage.Open(str(path))
        light = lux.DomeLight(stage.GetPrimAtPath("/Light/Environment"))
        assert light.GetTextureFileAttr().Get().resolvedPath == str(picture)
    same_error(lambda: fastibl.write_usd(tmp_path / "a.usd", marked), ValueError, "a.usd", ".usda")
    same_error(lambda: fastibl.write_usd(tmp_path / "a.usda", marked, axes="unity"), ValueError, "unity")
    same_error(lambda: fastibl.write_usd(tmp_path / "a.usda", marked, format="png"), ValueError, "png")


@pytest.fixture(scope="module")
def shadow(marked):
    spheres = np.array([[0.1, 0.05, 0.1, 0.1]], np.float32)
    return fastibl.cast_shadow(marked, spheres, extent=0.4, resolution=32)


def test_shadow_exr(shadow, tmp_path):
    openexr = pytest.importorskip("OpenEXR", reason="pip install OpenEXR")
    about = fastibl.write_shadow(tmp_path / "s.exr", shadow)
    with openexr.File(str(tmp_path / "s.exr")) as file:
        header, channels = dict(file.header()), {name: np.array(c.pixels) for name, c in file.channels().items()}
    ratio, matte = channels["ratio"], channels["RGBA"]
    n = len(ratio)
    assert header["extent"] == pytest.approx(shadow.reach) and header["metresPerPixel"] == pytest.approx(
        2 * shadow.reach / n
    )
    np.testing.assert_allclose(header["centre"], shadow.centre)
    assert about["extent"] == pytest.approx(shadow.reach)
    # Rows from the top are +y downwards.
    for row, column in ((n // 2, n // 2), (n // 2 - 3, n // 2 + 5), (2, n - 5)):
        x = (column + 0.5) / n * 2 * shadow.reach - shadow.reach + shadow.centre[0]
        y = shadow.reach - (row + 0.5) / n * 2 * shadow.reach + shadow.centre[1]
        np.testing.assert_allclose(ratio[row, column], shadow.sample([[x, y]])[0], atol=1e-5)
    assert ratio.min() < 0.9 and (matte[..., :3] == 0).all()
    # Over a white plate, premultiplied: the plate's luminance times the ratio's.
    over = matte[..., :3] + (1 - matte[..., 3:])
    np.testing.assert_allclose(over[..., 0], ratio @ [0.2126, 0.7152, 0.0722], atol=1e-5)


def test_shadow_png(shadow, tmp_path):
    fastibl.write_shadow(tmp_path / "s.png", shadow, extent=0.3, resolution=50)
    rgba = cv2.imread(str(tmp_path / "s.png"), cv2.IMREAD_UNCHANGED)
    about = json.loads((tmp_path / "s.json").read_text())
    assert rgba.shape == (50, 50, 4) and rgba.dtype == np.uint16 and (rgba[..., :3] == 0).all()
    assert about["extent"] == 0.3 and about["metresPerPixel"] == pytest.approx(0.012) and about["file"] == "s.png"
    alpha = rgba[..., 3] / 65535
    row, column = np.unravel_index(np.argmax(alpha), alpha.shape)
    x, y = (column + 0.5) * 0.012 - 0.3 + shadow.centre[0], 0.3 - (row + 0.5) * 0.012 + shadow.centre[1]
    np.testing.assert_allclose(alpha[row, column], 1 - shadow.sample([[x, y]])[0] @ [0.2126, 0.7152, 0.0722], atol=1e-4)
    same_error(lambda: fastibl.write_shadow(tmp_path / "s.jpg", shadow), ValueError, "s.jpg", ".exr")
    same_error(lambda: fastibl.write_shadow(tmp_path / "s.png", shadow, extent=0), ValueError, "extent")
    same_error(lambda: fastibl.write_shadow(tmp_path / "s.png", shadow, resolution=9999), ValueError, "4096")


def test_export_as_one_ktx2(marked, tmp_path, capsys):
    """The command's cubes are those of Lighting, looked up by their handedness."""
    fastibl.write_environment(tmp_path / "room.ktx2", marked)
    command = [
        "export",
        str(tmp_path / "room.ktx2"),
        "--out",
        str(tmp_path / "light"),
        "--format",
        "ktx2",
        "--size",
        "32",
    ]
    command += ["--levels", "4", "--sh", "filament", "three.js", "--gltf", "--usd"]
    assert __main__.main(command) == 0
    assert "light.glb" in capsys.readouterr().out
    also = {"sh.txt", "sh.json", "probe.txt", "probe.json", "light.glb", "light.usda", "light_dome.hdr"}
    cubes = {"environment.ktx2", "irradiance.ktx2", "prefiltered.ktx2"}
    assert {p.name for p in (tmp_path / "light").iterdir()} == {"light.json"} | also | cubes
    manifest = json.loads((tmp_path / "light" / "light.json").read_text())
    assert set(manifest["also"]) == also and manifest["handedness"] == "left"
    assert [level["files"] for level in manifest["prefiltered"]["levels"]] == [["prefiltered.ktx2"]] * 4
    levels = ktx2.read_ktx2(tmp_path / "light" / "prefiltered.ktx2")
    (even,) = ktx2.read_ktx2(tmp_path / "light" / "irradiance.ktx2")
    read = fastibl.read_environment(tmp_path / "room.ktx2")
    lighting = fastibl.Lighting(to_axes(read, "gltf"))
    for made, expected in zip(
        [even, *levels], [lighting.irradiance_cube(16), *lighting.prefiltered(32, 4)], strict=True
    ):
        for d in away_from_edges(50):
            x, y, z = gltf(d)
            np.testing.assert_allclose(
                opengl_lookup(made, (-x, y, z)), opengl_lookup(expected.faces, (x, y, z)), rtol=1e-3
            )
    same_error(lambda: fastibl.export_light(marked, tmp_path, format="ktx2", size=4, levels=7), ValueError, "levels")
    same_error(lambda: fastibl.export_light(marked, tmp_path, sh=["unity"]), ValueError, "unity", "filament")
    same_error(lambda: fastibl.export_light(marked, tmp_path, format="ktx2", handedness="up"), ValueError, "up", "left")


def test_command_reads_encoded_pictures(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "room.png"), np.full((16, 32, 3), 188, np.uint8))
    command = ["export", str(tmp_path / "room.png"), "--out", str(tmp_path / "light"), "--size", "8", "--levels", "2"]
    assert __main__.main(command) == 2
    assert "--response" in capsys.readouterr().err
    assert __main__.main([*command, "--response", "srgb"]) == 0
    manifest = json.loads((tmp_path / "light" / "light.json").read_text())
    np.testing.assert_allclose(manifest["sh9"]["radiance"][0], [0.5029 * np.sqrt(4 * np.pi)] * 3, rtol=1e-3)
    with pytest.raises(SystemExit):
        __main__.main([*command, "--response", "film"])


def test_the_examples_of_the_page_run(marked, tmp_path, monkeypatch):
    page = Path(__file__).resolve().parents[1] / "docs" / "files.md"
    if not page.is_file():
        pytest.skip("needs the source tree")
    pytest.importorskip("OpenEXR", reason="pip install OpenEXR")
    monkeypatch.chdir(tmp_path)
    fastibl.write_environment("room.hdr", marked)
    cv2.imwrite("panorama.jpg", np.full((16, 32, 3), 200, np.uint8))
    names = {}
    for block in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
        exec(compile(block, str(page), "exec"), names)
    made = {"room.exr", "room.ktx2", "sh.txt", "light.glb", "light.usda", "shadow.exr", "shadow.png", "shadow.json"}
    assert made <= {p.name for p in tmp_path.iterdir()}


@pytest.mark.parametrize("ending", ["dds", "png", "jpg"])
def test_any_bytes_give_a_map_or_words(ending, tmp_path):
    path = tmp_path / f"a.{ending}"
    path.write_bytes(dds([with_alpha(np.ones((6, 4, 4, 3), np.float32))], "<f2"))
    response = None
    if ending != "dds":
        cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 256, (4, 8, 3), np.uint8))
        response = fastibl.Response.srgb()
    content, read = path.read_bytes(), 0

    @MORE
    @given(mutated(content))
    def check(data):
        nonlocal read
        path.write_bytes(data)
        cube = outcome(lambda: fastibl.read_environment(path, size=4, response=response))
        if cube is not None:
            is_light(cube.faces)
            read += 1

    check()
    assert read > 0
