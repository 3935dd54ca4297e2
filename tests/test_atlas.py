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

BLACK = fastibl.CubeMap(np.zeros((6, 4, 4, 3), np.float32))
WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
CORNERS = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], float)  # v downwards


def encoded(picture):
    return base64.b64encode(cv2.imencode(".png", np.asarray(picture, np.uint8)[..., ::-1])[1]).decode()


def write(path, picture, uvs=CORNERS, wrap="repeat", materials=2, **more):
    """A square of 0.1 that a texture (h, w, 3) of sRGB makes shine, and plain ones of other colours out of view."""
    file, index = Gltf(), np.uint16([0, 1, 2, 0, 2, 3])
    images, parts = [{"uri": f"data:image/png;base64,{encoded(picture)}"}], []
    black = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}}
    looks = [black | {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}} | more]
    looks += [black | {"emissiveFactor": [0, k / materials, 1]} for k in range(1, materials)]
    for k in range(materials):
        corners = (square().vertices + [k, 0, 0]).astype("<f4")
        attributes = {"POSITION": file.add(corners), "TEXCOORD_0": file.add(np.asarray(uvs, "<f4"))}
        parts.append({"attributes": attributes, "indices": file.add(index), "material": k})
    sampler = {"wrapS": WRAPS[wrap], "wrapT": WRAPS[wrap]}
    return file.write(path, parts, materials=looks, images=images, samplers=[sampler],
                      textures=[{"source": 0, "sampler": 0}])  # fmt: skip


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
    file, index = Gltf(), np.uint16([0, 1, 2, 0, 2, 3])
    black, parts = {"baseColorFactor": [0, 0, 0, 1]}, []
    for k in range(len(looks)):
        corners = file.add((square().vertices + [k, 0, 0]).astype("<f4"))
        attributes = {"POSITION": corners, "TEXCOORD_0": file.add(np.asarray(uvs, "<f4"))}
        parts.append({"attributes": attributes, "indices": file.add(index), "material": k})
    shining = {"pbrMetallicRoughness": black, "emissiveTexture": {"index": 0}}
    materials = [shining | {"name": str(k), "emissiveFactor": look} for k, look in enumerate(looks)]
    images = [{"uri": f"data:image/png;base64,{encoded(picture)}"}]
    return file.write(path, parts, materials=materials, images=images, textures=[{"source": 0}])


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


@pytest.mark.parametrize("wrap, words", [("repeat", "repeats"), ("clamp", "crosses"), ("mirror", "crosses")])
def test_triangles_across_a_border_are_refused(wrap, words, tmp_path):
    for uvs in (CORNERS - [0.5, 0], CORNERS + [0, 0.5], CORNERS * 3 - 1):
        path = write(tmp_path / "a.gltf", picture_of(8, 8), uvs, wrap)
        same_error(lambda p=path: fastibl.read_object(p), ValueError, "a.gltf", words, "one material only")
        fastibl.read_object(write(tmp_path / "b.gltf", picture_of(8, 8), uvs, wrap, materials=1))


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
