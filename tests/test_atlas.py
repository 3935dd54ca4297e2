"""Textures of several materials in one: they look as each does alone."""

import base64
import tracemalloc

import cv2
import numpy as np
import pytest
from test_material import ABOVE, FROM_ABOVE, layer_of, square
from test_mesh_files import Gltf

import fastibl
from conftest import same_error
from fastibl.atlas import packed
from fastibl.uv_borders import single_copies

BLACK = fastibl.CubeMap(np.zeros((6, 4, 4, 3), np.float32))
WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
CORNERS = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float)  # v downwards


BLACK_BASE = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}}


def encoded(picture):
    """PNG of a picture (h, w, 3 or 4), with red first."""
    order = [2, 1, 0, 3][: np.shape(picture)[2]]
    return base64.b64encode(cv2.imencode(".png", np.asarray(picture, np.uint8)[..., order])[1]).decode()


def squares(path, picture, looks, uvs=CORNERS, wrap="repeat", colors=None, copies=1):
    """Squares of 0.1 beside each other, one of each material, which may name the texture (h, w, 3 or 4). copies: of
    all of them."""
    file, index, parts = Gltf(), np.uint16([0, 1, 2, 0, 2, 3]), []
    for k in range(len(looks)):
        corners = (square().vertices + [k, 0, 0]).astype("<f4")
        attributes = {"POSITION": file.add(corners), "TEXCOORD_0": file.add(np.asarray(uvs, "<f4"))}
        attributes |= {} if colors is None else {"COLOR_0": file.add(np.asarray(colors, "<f4"))}
        parts.append({"attributes": attributes, "indices": file.add(index), "material": k})
    file.json["nodes"] = [{"mesh": 0, "translation": [0, k, 0]} for k in range(copies)]
    images = [{"uri": f"data:image/png;base64,{encoded(picture)}"}]
    sampler = {"wrapS": WRAPS[wrap], "wrapT": WRAPS[wrap]}
    return file.write(path, parts, materials=looks, images=images, samplers=[sampler],
                      textures=[{"source": 0, "sampler": 0}])  # fmt: skip


def plain(count):
    """Materials without a texture, each of another colour."""
    return [BLACK_BASE | {"emissiveFactor": [0, (k + 1) / (count + 1), 1]} for k in range(count)]


def write(path, picture, uvs=CORNERS, wrap="repeat", materials=2, **more):
    """A square of 0.1 that a texture (h, w, 3) of sRGB makes shine, and plain ones of other colours out of view."""
    look = BLACK_BASE | {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}} | more
    return squares(path, picture, [look, *plain(materials - 1)], uvs, wrap)


def seen(path):
    """(64, 64, 3): the square alone."""
    return layer_of(*fastibl.read_object(path, up="z"), BLACK, FROM_ABOVE, ABOVE)[..., :3]


def picture_of(width, height):
    return np.random.default_rng(width).integers(0, 256, (height, width, 3))


@pytest.mark.parametrize("materials", [2, 5])
@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("size", [(1, 1), (2, 2), (4, 1), (3, 5), (16, 16), (50, 60), (256, 128)])
def test_a_texture_beside_others_looks_as_it_does_alone(size, wrap, materials, tmp_path):
    alone = seen(write(tmp_path / "a.gltf", picture_of(*size), wrap=wrap, materials=1))
    beside = seen(write(tmp_path / "b.gltf", picture_of(*size), wrap=wrap, materials=materials))
    # Coarse levels of what is clamped repeat the border's means alone, its outermost texels in an atlas.
    inside = slice(2, -2) if wrap == "clamp" and max(size) > 64 else slice(None)
    np.testing.assert_allclose(beside[inside, inside], alone[inside, inside], atol=1e-4)


def test_colours_of_a_palette_stay_pure(tmp_path):
    palette = np.array([[(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]])
    for k in range(4):
        shown = seen(write(tmp_path / "a.gltf", palette, np.full((4, 2), ((k + 0.5) / 4, 0.5))))
        np.testing.assert_allclose(shown[5:-5, 5:-5].reshape(-1, 3), np.tile(palette[0, k] / 255, (54 * 54, 1)),
                                   atol=1e-5)  # fmt: skip


def test_textures_of_a_material_may_have_several_sizes(tmp_path):
    """The smaller are enlarged, an odd number of times to the same."""
    alone = seen(write(tmp_path / "a.gltf", picture_of(4, 4), materials=1))
    rough = f"data:image/png;base64,{encoded(picture_of(12, 20))}"
    path = write(tmp_path / "b.gltf", picture_of(4, 4))
    text = path.read_text().replace('"textures": [', '"textures": [{"source": 0, "sampler": 0}, ')
    text = text.replace('"emissiveTexture": {"index": 0}', '"emissiveTexture": {"index": 1}')
    text = text.replace('"images": [', f'"images": [{{"uri": "{rough}"}}, ')
    text = text.replace('{"source": 0, "sampler": 0}]', '{"source": 1, "sampler": 0}]')
    text = text.replace(
        '1]}, "emissiveFactor": [1,', '1], "metallicRoughnessTexture": {"index": 0}}, "emissiveFactor": [1,'
    )
    path.write_text(text)
    assert np.ndim(fastibl.read_object(path)[1].roughness) == 2
    np.testing.assert_allclose(seen(path), alone, atol=1e-4)


# --- materials that share a picture


def write_sharing(path, picture, looks, uvs=CORNERS):
    """Squares beside each other, each with a material that shines by the same texture. looks: their emissiveFactor."""
    shining = BLACK_BASE | {"emissiveTexture": {"index": 0}}
    materials = [shining | {"name": str(k), "emissiveFactor": look} for k, look in enumerate(looks)]
    return squares(path, picture, materials, uvs)


def test_materials_that_look_the_same_are_one(tmp_path):
    """Nothing is laid beside the texture, which may repeat."""
    material = fastibl.read_object(write_sharing(tmp_path / "a.gltf", picture_of(8, 8), [[1, 1, 1]] * 9, CORNERS * 3))[
        1
    ]
    assert material.emission.shape == (8, 8, 3)


def test_factors_of_a_shared_picture_stay_apart(tmp_path):
    looks = [[1, 1, 1], [0.5, 0, 1], [0.25, 0.25, 0.25]]
    alone = seen(write_sharing(tmp_path / "a.gltf", picture_of(16, 16), looks[:1]))
    for k, look in enumerate(looks):
        turned = looks[k:] + looks[:k]  # the first is in view
        shown = seen(write_sharing(tmp_path / "b.gltf", picture_of(16, 16), turned))
        np.testing.assert_allclose(shown, alone * look, atol=1e-4)


def test_a_shared_picture_takes_memory_once(tmp_path, monkeypatch):
    monkeypatch.setattr("fastibl.atlas._MOST_TEXELS", 256 * 256)
    size, materials = 512, 16
    path = write_sharing(
        tmp_path / "a.gltf", np.zeros((size, size, 3)), [[1, 1, k / materials] for k in range(materials)]
    )
    tracemalloc.start()
    with pytest.warns(UserWarning, match="shrunk"):
        fastibl.read_object(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    floats = 12 * size**2
    assert peak < 5 * floats


# --- uvs beyond the picture


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("offset", [(1, 0), (-1, 2), (3, -2), (0, 1)])
def test_uvs_beyond_the_picture_are_folded(offset, wrap, tmp_path):
    uvs = 0.1 + 0.8 * CORNERS + offset
    alone = seen(write(tmp_path / "a.gltf", picture_of(8, 8), uvs, wrap, materials=1))
    beside = seen(write(tmp_path / "b.gltf", picture_of(8, 8), uvs, wrap))
    np.testing.assert_allclose(beside, alone, atol=1e-4)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize(
    "uvs", [CORNERS - [0.5, 0], CORNERS + [0, 0.5], CORNERS * 3 - 1, (CORNERS * 2.7 - 0.4) @ [[0.8, -0.6], [0.6, 0.8]]]
)
def test_triangles_across_a_border_look_as_alone(uvs, wrap, tmp_path):
    for size in ((8, 8), (5, 3)):
        alone = seen(write(tmp_path / "a.gltf", picture_of(*size), uvs, wrap, materials=1))
        beside = seen(write(tmp_path / "b.gltf", picture_of(*size), uvs, wrap))
        assert alone.std() > 0.05
        # Where a pixel shows two triangles, each is shaded in the middle of what it shows of it.
        error = np.abs(beside - alone).max(axis=-1)
        assert np.median(error) < 3e-4 and error.mean() < 1e-3 and error.max() < 0.1


@pytest.mark.parametrize("wrap", WRAPS)
def test_bumps_across_a_border_look_as_alone(wrap, tmp_path):
    """Also where the texture is mirrored: its bumps then are, too, but not the surface."""
    light = fastibl.CubeMap(np.random.default_rng(3).uniform(0, 2, (6, 8, 8, 3)).astype(np.float32))
    bumps = np.full((8, 8, 3), 255)
    bumps[..., :2] = np.random.default_rng(5).integers(60, 196, (8, 8, 2))
    length = np.sqrt(np.maximum(127.5**2 - ((bumps[..., :2] - 127.5) ** 2).sum(axis=-1), 0))
    bumps[..., 2] = np.round(127.5 + length)
    more = {"normalTexture": {"index": 0}, "emissiveFactor": [0, 0, 0],
            "pbrMetallicRoughness": {"metallicFactor": 1.0, "roughnessFactor": 0.3}}  # fmt: skip
    layers = []
    for materials in (1, 2):
        path = write(tmp_path / f"{materials}.gltf", bumps, CORNERS * 2.2 - 0.6, wrap, materials, **more)
        layers.append(layer_of(*fastibl.read_object(path, up="z"), light, FROM_ABOVE, ABOVE)[..., :3])
    flat = layer_of(square(), fastibl.Material.pbr((1, 1, 1), 1.0, 0.3), light, FROM_ABOVE, ABOVE)[..., :3]
    assert np.abs(layers[0] - flat).mean() > 0.05
    error = np.abs(layers[1] - layers[0]).max(axis=-1)
    print(f"{wrap}: median {np.median(error):.5f}, mean {error.mean():.5f}, largest {error.max():.3f}")
    assert np.median(error) < 3e-3 and error.mean() < 1e-2


def torus():
    """Closed, apart from the seams of its uvs; and its vertices' uvs, 3.3 and 2 copies of a texture around it."""
    a, b = np.meshgrid(np.arange(25), np.arange(17), indexing="ij")
    u, v = 2 * np.pi * (a % 24) / 24, 2 * np.pi * (b % 16) / 16
    points = np.stack([(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    at = (17 * a + b)[:-1, :-1].reshape(-1)
    triangles = np.concatenate([np.stack([at, at + 17, at + 18], 1), np.stack([at, at + 18, at + 1], 1)])
    return points, np.stack([3.3 * a / 24, 2 * b / 16 - 0.4], axis=-1).reshape(-1, 2), triangles


def area(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


@pytest.mark.parametrize("wrap", ["repeat", "clamp"])
def test_cut_triangles_are_the_same_surface(wrap):
    """Closed as it was, of the same area, and what vertices carry is where it was."""
    points, uvs, triangles = torus()
    carried = np.hstack([points, uvs])
    at, values, cut = single_copies(uvs, carried, triangles, (wrap, "repeat"))
    assert len(cut) > len(triangles) and at.min() > -0.032 and at.max() < 1.032
    corners = values[cut]
    assert area(values[:, :3], cut) == pytest.approx(area(points, triangles), rel=1e-12)
    # Each corner's place in the texture is that of its uvs, copies apart.
    off = corners[..., 3:] - at[cut]
    if wrap == "clamp":
        off[..., 0] = 0
        u = corners[..., 3]
        np.testing.assert_allclose(at[cut][..., 0][u <= 1], u[u <= 1], atol=1e-9)
        assert (at[cut][..., 0][u > 1.001] > 1).all()
    np.testing.assert_allclose(off, np.round(off), atol=1e-9)
    np.testing.assert_allclose(off, off[:, :1] + 0 * off, atol=1e-9)
    # Every edge has another triangle beside it.
    _, same = np.unique(np.round(values[:, :3], 9), axis=0, return_inverse=True)
    t = same.reshape(-1)[cut]
    edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("wrap", ["repeat", "clamp"])
def test_corners_on_borders(wrap):
    """Triangles whose corners lie on borders or half-way, together far from each other, and one by one."""
    uvs = np.random.default_rng(2).integers(-4, 5, (1200, 3, 2)) / 2
    flat = np.column_stack([uvs.reshape(-1, 2), np.zeros(3600)])
    for k in range(400):
        corners, triangle = uvs[k], np.array([[0, 1, 2]])
        at, values, cut = single_copies(corners, flat[3 * k : 3 * k + 3], triangle, (wrap, wrap))
        assert area(values, cut) == pytest.approx(area(flat[3 * k : 3 * k + 3], triangle), abs=1e-9)
        assert at.min() >= -1 / 32 and at.max() <= 1 + 1 / 32
    far = uvs + 1e6 * np.arange(1200)[:, None, None] if wrap == "repeat" else uvs
    triangles = np.arange(3600).reshape(-1, 3)
    at, values, cut = single_copies(far.reshape(-1, 2), flat, triangles, (wrap, wrap))
    assert area(values, cut) == pytest.approx(area(flat, triangles), rel=1e-9)
    if wrap == "repeat":
        places = np.column_stack([at, np.zeros(len(at))])
        assert area(places, cut) == pytest.approx(area(flat, triangles), rel=1e-6)


def test_as_many_copies_as_a_picture_can_show(tmp_path):
    for uvs, times in ((CORNERS * 1000, 1000000), (CORNERS * [1e6, 1e-6], 2000000)):
        path = write(tmp_path / "a.gltf", picture_of(8, 8), uvs)
        same_error(lambda p=path: fastibl.read_object(p), ValueError, "a.gltf", f"repeats {times} times")
        fastibl.read_object(write(tmp_path / "b.gltf", picture_of(8, 8), uvs, materials=1))
    mesh, _ = fastibl.read_object(write(tmp_path / "a.gltf", picture_of(8, 8), CORNERS * 100))
    assert len(mesh.triangles) == 2 * 100**2 + 2


# --- where they lie


SIZES = {
    "a large one and plain ones": [(4096, 4096)] + [(1, 1)] * 9,
    "plain ones": [(1, 1)] * 40,
    "all kinds": [(2048, 16), (16, 2048), (300, 200), (1, 1), (1024, 512), (64, 64)],
    "many": [(64, 64)] * 150,
}


@pytest.mark.parametrize("name", SIZES)
def test_cells_hold_their_textures_apart(name):
    sizes = SIZES[name]
    atlas = packed(sizes)
    taken = np.zeros((atlas.height // 8, atlas.width // 8), int)
    for (columns, rows), cell in zip(sizes, atlas.cells, strict=True):
        assert (cell.columns, cell.rows) == (columns, rows)
        margin = max(8, max(columns, rows) / 16)
        assert cell.left >= margin and cell.width - columns - cell.left >= margin
        assert cell.top >= margin and cell.height - rows - cell.top >= margin
        assert not any(n % 8 for n in (cell.x, cell.y, cell.width, cell.height))
        taken[cell.y // 8 : (cell.y + cell.height) // 8, cell.x // 8 : (cell.x + cell.width) // 8] += 1
    assert taken.max() == 1 and max(taken.shape) <= 1024


def test_plain_materials_keep_their_colour_in_the_level_that_light_is_read_from():
    """That of 64 texels across, where an object throws light: bilinear at the middle of a cell."""
    atlas = packed([(4096, 4096)] + [(1, 1)] * 9)
    texel = 2 ** int(np.ceil(np.log2(max(atlas.width, atlas.height) / 64)))
    for cell in atlas.cells[1:]:
        for start, size in ((cell.x, cell.width), (cell.y, cell.height)):
            at = (start + size / 2) / texel - 0.5
            assert np.floor(at) * texel >= start and (np.ceil(at) + 1) * texel <= start + size


def test_what_is_shrunk_is_said(tmp_path, monkeypatch):
    y, x = np.mgrid[:128, :256]
    ramps = np.stack([x, 255 - x, y * 2], axis=-1)
    path, alone = write(tmp_path / "a.gltf", ramps), seen(write(tmp_path / "b.gltf", ramps, materials=1))
    assert max(fastibl.read_object(path)[1].emission.shape) < 400  # 256, and little besides
    monkeypatch.setattr("fastibl.atlas._MOST_TEXELS", 200 * 200)
    with pytest.warns(UserWarning, match=r"a.gltf: textures are shrunk beside each other: 256 x 128 to \d+ x \d+"):
        material = fastibl.read_object(path)[1]
    assert np.prod(material.emission.shape[:2]) <= 200 * 200
    with pytest.warns(UserWarning, match="shrunk"):
        np.testing.assert_allclose(seen(path)[3:-3, 3:-3], alone[3:-3, 3:-3], atol=1e-3)
    monkeypatch.setattr("fastibl.atlas._MOST_TEXELS", 20 * 20)
    same_error(lambda: fastibl.read_object(path), ValueError, "a.gltf", "2 materials are more than fit")
