"""Surfaces that end where their texture's alpha does: glTF's MASK and BLEND, map_d of .mtl files."""

import struct
import warnings
import zlib

import cv2
import numpy as np
import pytest
from test_atlas import CORNERS, WRAPS, plain, squares
from test_material import ABOVE, FROM_ABOVE, layer_of, square

import fastibl
from conftest import same_error
from fastibl import cutouts
from fastibl.uv_borders import single_copies

BLACK = fastibl.CubeMap(np.zeros((6, 4, 4, 3), np.float32))
WHITE = fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32))
SHINING = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0, 0, 0, 1]},
           "emissiveFactor": [1, 1, 1], "alphaMode": "MASK"}  # fmt: skip


def leaf(width=64, height=48):
    """(h, w) from 0 to 1: a lopsided outline with a hole, soft over two texels; it meets the left and the lower border,
    and is the same on no two sides."""
    y, x = (np.mgrid[:height, :width] + 0.5) / [[[height]], [[width]]]
    radius = 0.3 + 0.1 * np.sin(3 * np.arctan2(y - 0.6, x - 0.25))
    inside = np.minimum(radius - np.hypot(x - 0.25, y - 0.6), np.hypot(x - 0.2, y - 0.45) - 0.09)
    return np.clip(inside * width / 2 + 0.5, 0, 1)


def rgba(alpha, color=(255, 255, 255), hidden=None):
    picture = np.empty((*alpha.shape, 4))
    picture[..., :3] = color
    picture[..., 3] = np.rint(255 * alpha)
    if hidden is not None:
        picture[alpha < 0.5, :3] = hidden
    return picture


def write(path, picture, look=SHINING, uvs=CORNERS, wrap="repeat", others=0, colors=None, copies=1):
    """A square of 0.1 with a texture (h, w, 3 or 4), and plain ones of other materials out of view. copies: of all."""
    return squares(path, picture, [look, *plain(others)], uvs, wrap, colors, copies)


def read(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return fastibl.read_object(path, up="z")


def bilinear(alpha, u, v, wrap):
    """Values of (h, w) at uvs with v downwards, in float64."""

    def texel(i, n):
        if wrap == "clamp":
            return np.clip(i, 0, n - 1)
        return i % n if wrap == "repeat" else np.minimum(i % (2 * n), 2 * n - 1 - i % (2 * n))

    (h, w), out = alpha.shape, 0.0
    x, y = u * w - 0.5, v * h - 0.5
    for dx in (0, 1):
        for dy in (0, 1):
            i, j = np.floor(x).astype(int) + dx, np.floor(y).astype(int) + dy
            share = (1 - np.abs(x - i)) * (1 - np.abs(y - j))
            out = out + share * alpha[texel(j, h), texel(i, w)]
    return out


def covered(alpha, uvs=CORNERS, wrap="repeat", cutoff=0.5, pixels=64, fine=16):
    """(pixels, pixels): how much of each pixel of the square from above is seen."""
    n = pixels * fine
    t, s = (np.mgrid[:n, :n] + 0.5) / n  # t downwards
    low, high = uvs.min(axis=0), uvs.max(axis=0)
    seen = bilinear(np.rint(255 * alpha) / 255, low[0] + s * np.ptp(uvs[:, 0]), low[1] + t * (high - low)[1], wrap)
    return (seen >= cutoff).reshape(pixels, fine, pixels, fine).mean(axis=(1, 3))


def coverage(path, backend="cpu"):
    return layer_of(*read(path), BLACK, FROM_ABOVE, ABOVE, backend)[..., 3]


def check_coverage(path, expected, backend="cpu"):
    """Of four samples a pixel, the same share is seen; what shines there is the texture."""
    try:
        off = coverage(path, backend) - expected
    except RuntimeError as error:
        pytest.skip(str(error))
    print(f"share seen: {expected.mean():.4f}, off by {off.mean():.5f}, RMS {off.std():.4f}")
    assert abs(off.mean()) < 0.003 and off.std() < 0.05 and np.abs(off).max() <= 0.5  # 1/4 texel inwards is 0.006


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_a_square_is_seen_where_its_alpha_is_high(backend, tmp_path):
    check_coverage(write(tmp_path / "a.gltf", rgba(leaf())), covered(leaf()), backend)


@pytest.mark.parametrize("others", [0, 2])
@pytest.mark.parametrize("wrap", WRAPS)
def test_outlines_go_on_beyond_borders(wrap, others, tmp_path):
    uvs = CORNERS * 2.4 - 0.7
    check_coverage(write(tmp_path / "a.gltf", rgba(leaf()), uvs=uvs, wrap=wrap, others=others),
                   covered(leaf(), uvs, wrap))  # fmt: skip


@pytest.mark.parametrize("cutoff", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("factor", [1.0, 0.6])
def test_factors_and_cutoffs(factor, cutoff, tmp_path):
    soft = cv2.GaussianBlur(leaf(), (0, 0), 4)
    pbr = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, factor]}
    look = SHINING | {"pbrMetallicRoughness": pbr, "alphaCutoff": cutoff}
    path = write(tmp_path / "a.gltf", rgba(soft), look)
    if factor * soft.max() < cutoff:
        same_error(lambda: read(path), ValueError, "a.gltf", "all of it is transparent")
    else:
        check_coverage(path, covered(soft, cutoff=cutoff / factor))


def test_a_fine_mesh_is_cut_as_a_coarse_one():
    """Its area and what it carries; neighbours share the vertices of their common edges."""
    outline = cutouts.Outline(leaf(), 0.5, ("repeat", "repeat"))
    n = 24
    at = np.stack(np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1)), axis=-1).reshape(-1, 2)
    i = np.arange((n + 1) ** 2).reshape(n + 1, -1)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    slope = np.array([[1.0, 2, 3], [-1, 0.5, 2]])
    [(uvs, values, cut)], off = cutouts.cut_out([cutouts.Cut(at, at @ slope, triangles, outline)])
    np.testing.assert_allclose(values, uvs @ slope, atol=1e-6)
    (ax, ay), (bx, by) = (uvs[cut[:, 1]] - uvs[cut[:, 0]]).T, (uvs[cut[:, 2]] - uvs[cut[:, 0]]).T
    areas = (ax * by - ay * bx) / 2
    expected = covered(leaf()).mean()
    print(f"area {areas.sum():.5f}, expected {expected:.5f}")
    assert off == 0.25 and areas.min() > -1e-12 and areas.sum() == pytest.approx(expected, rel=0.01)
    edges = np.sort(np.concatenate([cut[:, [0, 1]], cut[:, [1, 2]], cut[:, [2, 0]]]), axis=1)
    ends, counts = np.unique(edges, axis=0, return_counts=True)
    outer = uvs[ends[counts == 1]].mean(axis=1)  # edges of one triangle lie on the outline or on a border
    on = np.abs(bilinear(leaf(), outer[:, 0], 1 - outer[:, 1], "repeat") - 0.5) < 0.2
    on |= (np.minimum(outer, 1 - outer) < 1e-6).any(axis=1)
    print(f"{(~on).sum()} of {len(on)} outer edges lie within")
    assert counts.max() == 2 and on.all()


@pytest.mark.parametrize("tolerance", [0.25, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("size", [(1, 1), (2, 3), (64, 48), (700, 31), (2000, 1500)])
def test_outlines_are_as_near_as_they_say(size, tolerance):
    alpha = leaf(*size) if min(size) > 30 else np.random.default_rng(1).random(size[::-1])
    triangles = cutouts.Outline(alpha, 0.5, ("clamp", "clamp")).within(tolerance)
    n = 1024
    shown = np.zeros((n, n), np.uint8)
    for corners in triangles * n * 16 - 8:
        cv2.fillConvexPoly(shown, np.rint(corners * [1, -1] + [0, 16 * n - 16]).astype(np.int32), 1, shift=4)
    t, s = (np.mgrid[:n, :n] + 0.5) / n
    expected = bilinear(alpha, s, t, "clamp") >= 0.5
    texel = n / min(max(size), 1024) * max(size) / np.array(size)  # of the shrunk picture, in these pixels
    reach = np.ceil(tolerance * texel + 1.5).astype(int)
    wide = np.ones((2 * reach[1] + 1, 2 * reach[0] + 1), np.uint8)
    off = (shown != expected) & (
        cv2.dilate(expected.astype(np.uint8), wide) == cv2.erode(expected.astype(np.uint8), wide)
    )
    print(f"{len(triangles)} triangles; {off.mean():.5f} of the picture is further off")
    assert off.mean() < 1e-4


def test_many_copies_have_a_coarser_outline_and_say_so(tmp_path, monkeypatch):
    path = write(tmp_path / "a.gltf", rgba(leaf(512, 384)))
    whole = len(read(path)[0].triangles)
    monkeypatch.setattr(cutouts, "_ENOUGH", 90)
    with pytest.warns(UserWarning, match=r"a.gltf: left out are detail of outlines below \d texels") as told:
        mesh, _ = fastibl.read_object(path)
    assert len(mesh.triangles) < whole and told[0].filename == __file__
    monkeypatch.setattr(cutouts, "_MOST_PIECES", 1)
    with pytest.warns(UserWarning, match="left out are transparency .*more than 1 triangles"):
        mesh, _ = fastibl.read_object(path)
    assert len(mesh.triangles) == 2


def test_many_squares_with_one_picture(tmp_path):
    """A tree of leaves keeps its leaves; all parts together have a bound."""
    y, x = (np.mgrid[:64, :64] + 0.5) / 64
    ellipse = np.clip((0.45 - np.hypot((x - 0.5) * 2, y - 0.5)) * 64 + 0.5, 0, 1)
    for copies, uvs in ((1, CORNERS * 70), (6000, CORNERS)):
        path = write(tmp_path / "a.gltf", rgba(ellipse), uvs=uvs, copies=copies)
        with pytest.warns(UserWarning, match="left out are detail of outlines below [124] texels"):
            mesh, _ = fastibl.read_object(path)
        areas = np.linalg.norm(np.cross(*np.diff(mesh.vertices[mesh.triangles], axis=1).transpose(1, 0, 2)), axis=1) / 2
        share = areas.sum() / (copies * 0.04)
        print(f"{copies} squares: {len(mesh.triangles)} triangles, {share:.3f} of their area")
        assert len(mesh.triangles) < 300_000 and share == pytest.approx((ellipse >= 0.5).mean(), rel=0.06)


def test_what_would_cover_more_or_less_stays_whole(tmp_path):
    """A fence of thin wires whose outline would fill its holes, were it coarser."""
    wires = np.zeros((512, 512))
    wires[::16] = wires[1::16] = wires[:, ::16] = wires[:, 1::16] = 1
    with pytest.warns(UserWarning, match="left out are transparency .*more than 262144 triangles"):
        mesh, _ = fastibl.read_object(write(tmp_path / "a.gltf", rgba(wires), uvs=CORNERS * 20))
    assert len(mesh.triangles) == 2 and mesh.uvs.max() == 20


def test_pieces_without_anything_to_see(tmp_path):
    """Squares that show nothing go; the others are cut."""
    alpha = leaf()
    alpha[:, :20] = 0
    check_coverage(write(tmp_path / "a.gltf", rgba(alpha)), covered(alpha))
    with pytest.raises(ValueError, match="all of it is transparent"):
        read(write(tmp_path / "a.gltf", rgba(alpha), uvs=CORNERS * 0.25))
    path = write(tmp_path / "a.gltf", rgba(alpha), uvs=CORNERS * 0.25, others=1)
    assert len(read(path)[0].triangles) == 2


@pytest.mark.parametrize("at, shown", [((0.25, 0.6), 2), ((0.9, 0.1), 0)])
def test_colours_of_a_palette_are_there_or_not(at, shown, tmp_path):
    """Triangles that show one place of the picture, as low-poly models have them."""
    path = write(tmp_path / "a.gltf", rgba(leaf()), uvs=np.tile(at, (4, 1)), others=1)
    assert len(read(path)[0].triangles) == 2 + shown


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_thin_strands_of_large_pictures_keep_their_area(width):
    thin = np.zeros((4096, 4096), np.float32)
    for k in range(width):
        thin[:, 100 + k : 4000 : 151] = 1
    outline = cutouts.Outline(thin, 0.5, ("clamp", "clamp"))
    share = cutouts._twice_areas(outline.within(0.25)).sum() / 2 / (1 + 2 / 16)
    print(f"strands of {width} in 4096 texels: {share:.4f}, of {thin.mean():.4f}")
    assert share == pytest.approx(thin.mean(), rel=0.25)


def test_shadows_have_the_outline(tmp_path):
    """Of a disc's alpha on a square, as of a disc."""
    y, x = (np.mgrid[:128, :128] + 0.5) / 128
    alpha = np.clip((0.4 - np.hypot(x - 0.5, y - 0.5)) * 64 + 0.5, 0, 1)
    cut, material = read(write(tmp_path / "a.gltf", rgba(alpha)))
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    corners = np.concatenate([[(0, 0, 0)], 0.08 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)])
    k = np.arange(64)
    disc = fastibl.Mesh(corners, np.stack([0 * k, k + 1, (k + 1) % 64 + 1], axis=1))
    places, ratios = np.stack(np.meshgrid(*[np.linspace(-0.15, 0.15, 61)] * 2), axis=-1), []
    for mesh in (cut, disc, square()):
        mesh = fastibl.Mesh(mesh.vertices + [0, 0, 0.05], mesh.triangles)
        ratios.append(fastibl.MeshShadow(mesh, cache=False).ratio(WHITE, places))
    rms = [float(np.sqrt(np.mean((ratio - ratios[1]) ** 2))) for ratio in ratios]
    print(f"shadow against a disc's: {rms[0]:.5f} RMS; a square's {rms[2]:.5f}")
    assert rms[0] < 0.002 < 0.02 < rms[2]


def test_colours_of_what_is_not_there_are_not_seen(tmp_path):
    """A white leaf on transparent black stays white to its edge, and when it is far away."""
    look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}, "alphaMode": "MASK"}
    mesh, material = read(write(tmp_path / "a.gltf", rgba(leaf(), hidden=(0, 0, 0)), look))
    assert material.base_color.min() > 0.99
    mesh, material = read(write(tmp_path / "a.gltf", rgba(leaf(), hidden=(0, 0, 0)), look, others=3))
    far = fastibl.Camera(16, 16, 24, 24, 8, 8)
    seen = layer_of(mesh, material, WHITE, far, ABOVE)
    # What the square shows at its own place, as bright as white is.
    white = layer_of(square(), fastibl.Material.pbr((1, 1, 1), 0.0, 1.0), WHITE, FROM_ABOVE, ABOVE)[32, 32, 0]
    shown = seen[seen[..., 3] > 0]
    np.testing.assert_allclose(shown[:, 0] / shown[:, 3], white * np.ones(len(shown)), rtol=0.02)


def test_opaque_materials_keep_their_picture(tmp_path):
    """Its alpha counts for nothing, as when it has none or is high everywhere."""
    opaque = {k: v for k, v in SHINING.items() if k != "alphaMode"}
    for picture, look in ((rgba(leaf()), opaque), (rgba(leaf())[..., :3], SHINING), (rgba(0.6 + 0 * leaf()), SHINING)):
        mesh, _ = read(write(tmp_path / "a.gltf", picture, look))
        assert len(mesh.triangles) == 2


def test_masked_materials_without_a_picture(tmp_path):
    """Are there or not."""

    def look(alpha):
        return {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, alpha]}, "emissiveFactor": [1, 1, 1],
                "alphaMode": "MASK"}  # fmt: skip

    path = write(tmp_path / "a.gltf", rgba(leaf()), look(0.7), others=1)
    assert len(read(path)[0].triangles) == 4
    path = write(tmp_path / "a.gltf", rgba(leaf()), look(0.3), others=1)
    assert len(read(path)[0].triangles) == 2
    path = write(tmp_path / "a.gltf", rgba(leaf()), look(0.3))
    same_error(lambda: read(path), ValueError, "a.gltf", "all of it is transparent")


def test_what_is_blended_is_cut_where_it_is_an_outline(tmp_path):
    blended = SHINING | {"alphaMode": "BLEND"}
    wide = leaf(256, 192)
    check_coverage(write(tmp_path / "a.gltf", rgba(wide), blended), covered(wide))
    glass = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.3]}, "alphaMode": "BLEND"}
    window = np.where(np.hypot(*(np.mgrid[:192, :256] - 100.0)) < 25, 0.3, 1.0)  # 4 % of it
    soft = cv2.GaussianBlur(wide, (0, 0), 40)
    for picture, look in (
        (rgba(soft), blended), (rgba(0.3 + 0 * soft), blended), (rgba(wide), glass), (rgba(window), blended),
        (rgba(0.08 + 0 * soft), blended),
    ):  # fmt: skip
        with pytest.warns(UserWarning, match="a.gltf: left out are transparency$"):
            mesh, _ = fastibl.read_object(write(tmp_path / "a.gltf", picture, look))
        assert len(mesh.triangles) == 2
    # Exporters write BLEND for what has no transparency.
    opaque = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "BLEND"}
    for picture in (rgba(wide)[..., :3], rgba(1 + 0 * wide)):
        assert len(read(write(tmp_path / "a.gltf", picture, opaque))[0].triangles) == 2


def test_transparency_of_vertices_is_said(tmp_path):
    colors = [(1, 1, 1, 0.2)] * 4
    with pytest.warns(UserWarning, match="left out are transparency of vertices"):
        fastibl.read_object(write(tmp_path / "a.gltf", rgba(leaf()), colors=colors))
    opaque = {k: v for k, v in SHINING.items() if k != "alphaMode"}
    read(write(tmp_path / "a.gltf", rgba(leaf()), opaque, colors=colors))


def test_uvs_that_are_not_there(tmp_path):
    """A material that is masked by a picture is there or not."""
    path = write(tmp_path / "a.gltf", rgba(leaf()))
    path.write_text(path.read_text().replace('"TEXCOORD_0"', '"TEXCOORD_3"').replace('"TEXCOORD_3": 1', '"_X": 1'))
    same_error(lambda: fastibl.read_object(path), ValueError, "a.gltf", "all of it is transparent")
    alpha = leaf()
    alpha[[0, 0, -1, -1], [0, -1, 0, -1]] = 1
    path = write(tmp_path / "a.gltf", rgba(alpha))
    path.write_text(path.read_text().replace('"TEXCOORD_0"', '"TEXCOORD_3"').replace('"TEXCOORD_3": 1', '"_X": 1'))
    with pytest.warns(UserWarning, match="left out are textures of what has no uvs"):
        assert len(fastibl.read_object(path)[0].triangles) == 2


# --- .obj


def obj(tmp_path, lines):
    (tmp_path / "a.mtl").write_text(f"newmtl a\nKd 0 0 0\nKe 1 1 1\n{lines}\n")
    rows = [f"v {x} {y} {z}" for x, y, z in square().vertices] + ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "vn 0 0 1"]
    (tmp_path / "a.obj").write_text("\n".join(["mtllib a.mtl", *rows, "usemtl a", "f 1/1/1 2/2/1 3/3/1 4/4/1"]))
    return tmp_path / "a.obj"


def test_map_d(tmp_path):
    """Its alpha, else its grey; as its options say."""
    alpha = leaf(256, 192)
    cv2.imwrite(str(tmp_path / "grey.png"), np.rint(255 * alpha).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "alpha.png"), rgba(alpha, color=(200, 20, 30)).astype(np.uint8))
    for name in ("grey.png", "alpha.png"):
        check_coverage(obj(tmp_path, f"map_d {name}"), covered(alpha))
        check_coverage(obj(tmp_path, f"map_d -s 2 3 {name}"), covered(alpha, CORNERS * [2, 3]))
        check_coverage(obj(tmp_path, f"map_d -clamp on -s 2 2 {name}"), covered(alpha, CORNERS * 2 - [0, 1], "clamp"))
    cv2.imwrite(str(tmp_path / "soft.png"), np.rint(255 * cv2.GaussianBlur(alpha, (0, 0), 40)).astype(np.uint8))
    with pytest.warns(UserWarning, match="a.obj: left out are transparency"):
        mesh, _ = fastibl.read_object(obj(tmp_path, "map_d soft.png"))
    assert len(mesh.triangles) == 2


def test_pictures_of_map_d_and_map_kd(tmp_path):
    """Where they lie alike, colours go on where nothing is seen."""
    cv2.imwrite(str(tmp_path / "d.png"), np.rint(255 * leaf(256, 192)).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "kd.png"), rgba(leaf(256, 192), hidden=(0, 0, 0))[..., :3].astype(np.uint8))
    _, material = read(obj(tmp_path, "map_Kd kd.png\nmap_d d.png"))
    assert material.base_color.min() > 0.99
    same_error(lambda: read(obj(tmp_path, "map_Kd kd.png\nmap_d -s 2 2 d.png")), ValueError, "different ways")


def test_border_cuts_leave_outlines_whole():
    """What reaches just beyond a texture's border is not cut away."""
    alpha = np.ones((16, 16))
    alpha[6:10, 6:10] = 0
    uvs, values, triangles = single_copies(np.array([(0, 0), (1.0005, 0), (1, 1.0005), (0, 1)]), np.zeros((4, 1)),
                                           np.array([(0, 1, 2), (0, 2, 3)]), ("repeat", "repeat"))  # fmt: skip
    outline = cutouts.Outline(alpha, 0.5, ("repeat", "repeat"))
    [(uvs, *_)], _ = cutouts.cut_out([cutouts.Cut(uvs, values, triangles, outline)])
    assert uvs.max(axis=0) == pytest.approx((1.0005, 1.0005), abs=1e-9)


@pytest.mark.parametrize("bits", [1, 4, 8, 16])
def test_alpha_of_a_grey_that_is_named_transparent(bits):
    """As a PNG's tRNS names it, in the picture's own bits."""
    from fastibl.pictures import decode_alpha

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    row = {1: b"\x50", 4: b"\x05\x05", 8: bytes([0, 5, 0, 5]), 16: bytes([5, 0, 0, 5, 9, 0, 0, 5])}[bits]
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", 4, 1, bits, 0, 0, 0, 0))
    key = chunk(b"tRNS", struct.pack(">H", min(5, 2**bits - 1)))
    pixels = chunk(b"IDAT", zlib.compress(b"\0" + row)) + chunk(b"IEND", b"")
    white = 65535 if bits == 16 else 255
    np.testing.assert_array_equal(decode_alpha(data + key + pixels, "a.png"), [[white, 0, white, 0]])
    assert decode_alpha(data + pixels, "a.png") is None
