"""Files that state other primaries than Rec. 709. Truth: ICC.1 and CIE formulas in float64, matrices of standards."""

import struct
import warnings
import zlib

import cv2
import numpy as np
import pytest

import fastibl
from conftest import same_error
from fastibl import __main__, dds, ktx2, primaries, sources
from fastibl.pictures import read_picture, write_exr, write_picture
from fastibl.recorder import Recorder
from fastibl.recording import RecordingWarning

SRGB = fastibl.Response.srgb()
# Linear Display P3 to linear sRGB, from CSS Color Module Level 4 (sample code for color conversions).
SRGB_FROM_P3 = np.array([
    [1.2249401762805598, -0.2249401762805597, 0], [-0.0420569547096881, 1.0420569547096880, 0],
    [-0.0196375545903344, -0.0786360455506319, 1.0982736001409663],
])  # fmt: skip
# Recommendation ITU-R BT.2087, Annex 1 inverted: linear BT.2020 to linear BT.709.
BT709_FROM_BT2020 = np.linalg.inv([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
# Columns of the profile "Display P3": rXYZ, gXYZ, bXYZ, as s15Fixed16.
P3_COLUMNS = ((0x83DF, 0x3DBF, -0x45), (0x4ABF, 0xB137, 0xAB9), (0x2838, 0x110B, 0xC8B9))
SRGB_COLUMNS = ((0x6FA2, 0x38F5, 0x390), (0x6299, 0xB785, 0x18DA), (0x24A0, 0xF84, 0xB6CF))  # "sRGB IEC61966-2.1"
CODES = np.random.default_rng(3).integers(100, 156, (16, 32, 3), np.uint8)  # colours that Rec. 709 has, too
CODES[0] = np.arange(32)[:, None] * 8  # grey


def profile(columns, name="Display P3", kind=b"RGB XYZ "):
    tags = {
        name: b"XYZ \0\0\0\0" + struct.pack(">3i", *c)
        for name, c in zip((b"rXYZ", b"gXYZ", b"bXYZ"), columns, strict=True)
    }
    text = name.encode("utf-16-be")
    tags[b"desc"] = b"mluc\0\0\0\0" + struct.pack(">2I", 1, 12) + b"enUS" + struct.pack(">2I", len(text), 28) + text
    head, body, at = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for tag, data in tags.items():
        head += struct.pack(">4s2I", tag, at + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    start = struct.pack(">I4sI4s", at + len(body), b"appl", 0x04000000, b"mntr") + kind + bytes(12) + b"acsp"
    return start + bytes(128 - len(start)) + head + body


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(codes, *chunks):
    data = cv2.imencode(".png", codes[..., ::-1])[1].tobytes()
    return data[:33] + b"".join(chunk(*c) for c in chunks) + data[33:]


def jpeg(codes, icc):
    """In two segments, as long profiles are; another program's segment lies between them."""
    data = cv2.imencode(".jpg", codes[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    parts = [b"ICC_PROFILE\0" + bytes([k + 1, 2]) + part for k, part in enumerate((icc[:200], icc[200:]))]
    parts.insert(1, b"MPF\0other")
    return data[:2] + b"".join(b"\xff\xe2" + struct.pack(">H", len(p) + 2) + p for p in parts) + data[2:]


def linear(codes):
    e = codes / 255
    return np.where(e <= 0.04045, e / 12.92, ((e + 0.055) / 1.055) ** 2.4)


def icc_of(p):
    return (b"iCCP", b"name\0\0" + zlib.compress(p))


CHRM_P3 = (b"cHRM", struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000))
CHRM_709 = (b"cHRM", struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000))
P3 = icc_of(profile(P3_COLUMNS))


@pytest.mark.parametrize(
    "chunks, matrix",
    [
        ([P3], SRGB_FROM_P3),
        ([CHRM_P3, P3], SRGB_FROM_P3),
        ([CHRM_P3], SRGB_FROM_P3),
        ([(b"cICP", bytes([12, 13, 0, 1])), icc_of(profile(SRGB_COLUMNS))], SRGB_FROM_P3),
        ([(b"cICP", bytes([9, 1, 0, 1]))], BT709_FROM_BT2020),
        ([], None),
        ([CHRM_709], None),
        ([(b"sRGB", b"\0"), CHRM_P3], None),
        ([icc_of(profile(SRGB_COLUMNS))], None),
        ([(b"cICP", bytes([1, 13, 0, 1])), P3], None),
        ([icc_of(profile(P3_COLUMNS, kind=b"GRAYXYZ "))], None),
        ([icc_of(profile(P3_COLUMNS)[:180])], None),
        ([icc_of(profile([(0, 0, 0)] * 3))], None),
        ([(b"iCCP", b"name\0\0broken")], None),
        ([(b"iCCP", b"")], None),
        ([(b"cICP", b"")], None),
        ([(b"cHRM", bytes(32))], None),
    ],
)
def test_primaries_of_png(tmp_path, chunks, matrix):
    (tmp_path / "a.png").write_bytes(png(CODES, *chunks))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = read_picture(tmp_path / "a.png", SRGB)
    expected = linear(CODES) @ (np.eye(3) if matrix is None else matrix).T
    np.testing.assert_allclose(found, expected, atol=1e-6 if matrix is None else 5e-4)
    if matrix is SRGB_FROM_P3:
        assert np.ptp(found[0], axis=-1).max() < 2e-4  # grey stays grey


def test_profile_of_jpeg(tmp_path):
    """A panorama as a telephone writes it: Display P3."""
    (tmp_path / "a.jpg").write_bytes(jpeg(CODES, profile(P3_COLUMNS)))
    (tmp_path / "b.jpg").write_bytes(jpeg(CODES, profile(SRGB_COLUMNS)))
    plain, found = read_picture(tmp_path / "b.jpg", SRGB), read_picture(tmp_path / "a.jpg", SRGB)
    np.testing.assert_allclose(found, plain @ SRGB_FROM_P3.T, atol=5e-4)
    data = (tmp_path / "a.jpg").read_bytes()
    for end in range(2, 700, 7):  # cut off within what tells of colours
        primaries.of_picture(data[:end])
    for name, description in (("Display P3", None), ("an ICC profile", b""), ("Old", b"desc" + bytes(8) + b"Old\0")):
        icc = profile(P3_COLUMNS)
        if description is not None:
            icc = icc.replace(b"desc", b"none", 1) + description
            at = len(icc) - len(description)
            icc = icc.replace(
                b"none" + icc[icc.index(b"none") + 4 :][:8], struct.pack(">4s2I", b"desc", at, len(description))
            )
        assert primaries.from_profile(icc).name == name


@pytest.mark.parametrize("order", [">", "<"])
def test_a_cameras_adobe_rgb(tmp_path, order):
    """Told by EXIF's interoperability index alone. Truth: Adobe RGB (1998) Color Image Encoding, 4.3.5.3, with sRGB's
    inverse of IEC 61966-2-1."""
    xyz_of_adobe = [[0.57667, 0.18556, 0.18823], [0.29734, 0.62736, 0.07529], [0.02703, 0.07069, 0.99134]]
    srgb_of_xyz = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
    plain = cv2.imencode(".jpg", CODES[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    for index, matrix in (("R03", np.array(srgb_of_xyz) @ xyz_of_adobe), ("R98", np.eye(3))):
        entry = struct.pack(order + "2HI4s", 1, 2, 4, index.encode())
        body = b"II*\0" if order == "<" else b"MM\0*"
        body += struct.pack(order + "IH2HIIIH", 8, 1, 0xA005, 4, 1, 26, 0, 1) + entry + bytes(4)
        exif = b"Exif\0\0" + body
        data = plain[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + plain[2:]
        (tmp_path / "plain.jpg").write_bytes(plain)
        (tmp_path / "a.jpg").write_bytes(data)
        expected = read_picture(tmp_path / "plain.jpg", SRGB) @ matrix.T
        np.testing.assert_allclose(read_picture(tmp_path / "a.jpg", SRGB), expected, atol=1e-3)
    both = jpeg(CODES, profile(SRGB_COLUMNS))
    assert primaries.of_picture(both[:2] + data[2 : 2 + 2 + 2 + len(exif)].replace(b"R98", b"R03") + both[2:]) is None


def test_colours_beyond_rec709_are_told(tmp_path):
    """A lamp of ACEScg's green: a map holds no negative light, which adds some in red."""
    pytest.importorskip("OpenEXR")
    picture = np.full((16, 32, 3), 0.2, np.float32)
    head = {"chromaticities": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)}
    write_exr(tmp_path / "grey.exr", {"RGB": picture}, head)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(read_picture(tmp_path / "grey.exr"), 0.2, atol=1e-6)
    picture[4:6, 4:6] = 0.2, 20, 0.2
    write_exr(tmp_path / "green.exr", {"RGB": picture}, head)
    # ACEScg to linear sRGB by Bradford, from the ACES Central documents.
    to_709 = np.array([[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]])
    red = (picture @ to_709[0]).astype(np.float64)
    share = -red[red < 0].sum() / red[red > 0].sum()
    with pytest.warns(UserWarning, match=f"green.exr .* ACEScg .* {share:.0%} of the light in red, are cut") as told:
        cube = fastibl.read_environment(tmp_path / "green.exr", 16)
    assert told[0].filename == __file__
    assert cube.cleaned["negative"] > 0


def hdr(path, line):
    picture = np.random.default_rng(2).uniform(0.4, 1, (16, 32, 3)).astype(np.float32)
    write_picture(path, picture)
    plain = read_picture(path)
    path.write_bytes(path.read_bytes().replace(b"\nFORMAT", b"\n" + line + b"\nFORMAT", 1))
    return plain


def test_primaries_of_hdr(tmp_path):
    path = tmp_path / "a.hdr"
    plain = hdr(path, b"EXPOSURE=2\nPRIMARIES=1 0 0 1 0 0 .3 .3\nPRIMARIES= .708 .292 .170 .797 .131 .046 .3127 .3290")
    np.testing.assert_allclose(read_picture(path), plain / 2 @ BT709_FROM_BT2020.T, atol=5e-4)
    plain = hdr(path, b"PRIMARIES=.64 .33 .30 .60 .15 .06 .3127 .3290")
    np.testing.assert_array_equal(read_picture(path), plain)
    # What a file without this line has in Radiance, and what Photoshop writes: nothing is stated.
    for line in (b"0.640 0.330 0.290 0.600 0.150 0.060 0.3333 0.3333", b"0 0 0 0 0 0 0 0", b"1 2 3-", b""):
        plain = hdr(path, b"PRIMARIES=" + line)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            np.testing.assert_array_equal(read_picture(path), plain)
    for line in (b".1 .1 .2 .2 .3 .3 .4 .4", b"1 2 3", b".7 0 .2 .8 .1 .1 .3 .3", b".7 1e999 .2 .8 .1 .1 .3 .3"):
        plain = hdr(path, b"PRIMARIES=" + line)
        with pytest.warns(UserWarning, match="a.hdr states what are no primaries"):
            np.testing.assert_array_equal(read_picture(path), plain)


def test_chromaticities_that_are_none(tmp_path):
    pytest.importorskip("OpenEXR")
    picture = np.full((16, 32, 3), 0.2, np.float32)
    write_exr(tmp_path / "a.exr", {"RGB": picture}, {"chromaticities": (0.0,) * 8})
    with pytest.warns(UserWarning, match="a.exr states what are no primaries") as told:
        cube = fastibl.read_environment(tmp_path / "a.exr", 16)
    assert told[0].filename == __file__
    np.testing.assert_allclose(cube.faces, 0.2, rtol=1e-6)
    data = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "b.exr").write_bytes(
        data.replace(b"chromaticities\0chromaticities\0", b"chromaticities\0chromaticitieZ\0")
    )
    with pytest.warns(UserWarning, match="b.exr states what are no primaries"):  # a type that nobody knows
        assert fastibl.read_environment(tmp_path / "b.exr", 16) == cube


def test_primaries_of_ktx2(tmp_path):
    """Byte 13 of the data format descriptor, by Khronos' specification: 10 is Display P3, 4 is BT.2020."""
    faces = np.random.default_rng(4).uniform(0.4, 0.6, (6, 8, 8, 3)).astype(np.float16).astype(np.float32)
    ktx2.write_ktx2(tmp_path / "a.ktx2", [faces, faces[:, ::2, ::2]])
    data = bytearray((tmp_path / "a.ktx2").read_bytes())
    (at,) = struct.unpack_from("<I", data, 48)
    assert data[at + 12 : at + 15] == bytes([1, 1, 1])  # RGBSDA, BT.709, linear
    for code, matrix in ((10, SRGB_FROM_P3), (4, BT709_FROM_BT2020), (0, np.eye(3))):
        data[at + 13] = code
        (tmp_path / "b.ktx2").write_bytes(data)
        for level, expected in zip(ktx2.read_ktx2(tmp_path / "b.ktx2"), (faces, faces[:, ::2, ::2]), strict=True):
            np.testing.assert_allclose(level, expected @ matrix.T, atol=5e-4)


def test_written_exr_files_state_their_primaries(tmp_path, marked):
    """OpenEXR's chromaticities, as another library reads them, which takes its pixels as they are."""
    pytest.importorskip("OpenEXR")
    oiio = pytest.importorskip("OpenImageIO")
    fastibl.write_environment(tmp_path / "map.exr", marked)
    mesh = fastibl.stand(fastibl.shapes.figurine(), height=0.1)
    fastibl.write_shadow(tmp_path / "shadow.exr", fastibl.MeshShadow(mesh, resolution=8, rings=4).cast(marked))
    for name in ("map.exr", "shadow.exr"):
        about = oiio.ImageInput.open(str(tmp_path / name)).spec()
        np.testing.assert_allclose(
            about["chromaticities"], (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329), atol=1e-6
        )


@pytest.mark.parametrize("ending", ["exr", "hdr", "png", "ktx2", "dds"])
def test_given_primaries(tmp_path, ending):
    """They count, whatever the file states; a name or numbers."""
    if ending == "exr":
        pytest.importorskip("OpenEXR")
    path, read = tmp_path / f"a.{ending}", dict(size=8, response=SRGB if ending == "png" else None)
    if ending == "png":
        path.write_bytes(png(CODES, P3))
    else:
        values = linear(CODES) if ending in ("exr", "hdr") else np.full((6, 4, 4, 3), (0.3, 0.5, 0.4))
        values = values.astype(np.float16).astype(np.float32)
        if ending == "exr":
            write_exr(path, {"RGB": values}, {"chromaticities": primaries.DISPLAY_P3})
        elif ending == "hdr":
            write_picture(path, values)
        else:
            {"ktx2": ktx2.write_ktx2, "dds": dds.write_dds}[ending](path, [values])
    as_it_is = fastibl.read_environment(path, primaries="rec709", **read).faces
    for given in ("Display P3", "display-p3", primaries.DISPLAY_P3, list(primaries.DISPLAY_P3)):
        found = fastibl.read_environment(path, primaries=given, **read).faces
        np.testing.assert_allclose(found, as_it_is @ SRGB_FROM_P3.T, atol=5e-4)
    assert np.abs(found - as_it_is).max() > 0.01
    for wrong, kind, word in (
        ("sRGB-ish", ValueError, "ACEScg, ACES"), ((1, 2, 3), ValueError, "white, got"), (3, TypeError, "ACEScg, ACES")
    ):  # fmt: skip
        same_error(lambda wrong=wrong: fastibl.read_environment(path, primaries=wrong, **read), kind, word)


def test_given_primaries_of_commands(tmp_path):
    pytest.importorskip("OpenEXR")
    write_exr(tmp_path / "a.exr", {"RGB": linear(CODES).astype(np.float32)})
    out = tmp_path / "light"
    words = ["export", str(tmp_path / "a.exr"), "--out", str(out), "--size", "16", "--levels", "2", "--format", "exr"]
    __main__.main([*words, "--primaries", "Rec. 2020"])
    picture = read_picture(out / "environment.exr")
    expected = read_picture(tmp_path / "a.exr") @ BT709_FROM_BT2020.T
    np.testing.assert_allclose(np.sort(picture, axis=1), np.sort(expected, axis=1), atol=5e-4)


def test_camera_pictures_of_other_primaries_are_told(tmp_path):
    """A telephone's pictures: their codes are taken as they are."""
    camera = fastibl.Camera(32, 16, 30, 30, 16, 8)
    for k in range(3):
        (tmp_path / f"{k}.jpg").write_bytes(jpeg(CODES, profile(P3_COLUMNS)))
    source = sources.FolderSource(fastibl.Rig(camera), tmp_path)
    with pytest.warns(RecordingWarning, match="0.jpg .* Display P3") as told:
        frames = list(source)
    assert len(frames) == 3 and len(told) == 1
    for k in range(3):
        (tmp_path / f"{k}.jpg").write_bytes(jpeg(CODES, profile(SRGB_COLUMNS)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(list(source)) == 3


def test_recorded_pictures_of_other_primaries_are_told(tmp_path):
    with Recorder(tmp_path / "r", fastibl.Rig(fastibl.Camera(32, 16, 30, 30, 16, 8))) as recorder:
        for k in range(3):
            recorder.add(fastibl.Frame(float(k), back=CODES), wait=True)
    recording = fastibl.Recording.open(tmp_path / "r")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(list(recording)) == 3
    for path in (tmp_path / "r" / "back").glob("*.png"):
        path.write_bytes(png(CODES, P3))
    with pytest.warns(RecordingWarning, match="00000.png .* Display P3") as told:
        frames = list(fastibl.Recording.open(tmp_path / "r"))
    assert len(frames) == 3 and len(told) == 1


def test_textures_keep_their_codes(tmp_path):
    """glTF: colour space information of pictures must be ignored."""
    (tmp_path / "a.png").write_bytes(png(CODES, P3, (b"gAMA", struct.pack(">I", 100000))))
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    )
    from fastibl.surfaces import Pictures

    data = (tmp_path / "a.png").read_bytes()
    np.testing.assert_array_equal(Pictures().picture(data, "a.png").pixels, CODES)
    fastibl.read_object(tmp_path / "a.obj")
