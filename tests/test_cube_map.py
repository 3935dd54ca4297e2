"""Cube maps: orientation, solid angles, MIP chain, seamless look-up, conversion, cleaning."""

import copy
import pickle

import numpy as np
import pytest

import fastibl
from conftest import MAPS, same_error, units
from fastibl import reference
from fastibl.axes import turned

# OpenGL ES 3.0, table 3.19: major axis, s axis, t axis of each face.
OPENGL = [
    ((1, 0, 0), (0, 0, -1), (0, -1, 0)),
    ((-1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    ((0, -1, 0), (1, 0, 0), (0, 0, -1)),
    ((0, 0, 1), (1, 0, 0), (0, -1, 0)),
    ((0, 0, -1), (-1, 0, 0), (0, -1, 0)),
]


@pytest.mark.parametrize("face", range(6))
def test_faces_have_opengl_orientation(face):
    major, s, t = (np.array(a, float) for a in OPENGL[face])
    n = 8
    faces = np.zeros((6, n, n, 3))
    faces[face, 1, 6] = (1, 2, 3)  # row 1, column 6
    direction = major + s * (2 * 6.5 / n - 1) + t * (2 * 1.5 / n - 1)
    np.testing.assert_allclose(fastibl.CubeMap(faces).sample(direction), (1, 2, 3), rtol=1e-5)
    expected = direction / np.linalg.norm(direction)
    np.testing.assert_allclose(fastibl.texel_directions(n)[face, 1, 6], expected, atol=1e-6)


def test_equirectangular_orientation_is_pinned():
    height, width = 64, 128
    image = np.full((height, width, 3), 0.01)
    # u = 1/2 + atan2(x, y) / 2 pi, v = acos(z) / pi
    marks = {
        (0, 1, 0): (1, 0, 0),
        (1, 0, 0): (0, 1, 0),
        (0, -1, 0): (0, 0, 1),
        (-1, 0, 0): (1, 1, 0),
        (0, 0, 1): (0, 1, 1),
    }
    for (x, y, z), colour in marks.items():
        u, v = 0.5 + np.arctan2(x, y) / (2 * np.pi), np.arccos(z) / np.pi
        rows = slice(max(0, int(v * height) - 4), int(v * height) + 4)
        columns = (int(u * width) + np.arange(-4, 4)) % width if abs(z) < 1 else np.arange(width)
        image[rows, columns] = colour
    cube = fastibl.cubemap_from_equirect(image, size=32)
    back = fastibl.equirect_from_cubemap(cube, height)
    for direction, colour in marks.items():
        np.testing.assert_allclose(cube.sample(np.array(direction, float)), colour, atol=0.02)
        u, v = 0.5 + np.arctan2(direction[0], direction[1]) / (2 * np.pi), np.arccos(direction[2]) / np.pi
        seen = back[min(int(v * height), height - 1), int(u * width) % width]
        np.testing.assert_allclose(seen, colour, atol=0.05)


@pytest.mark.parametrize("size", [1, 2, 7, 64])
def test_solid_angles(size):
    angles = fastibl.texel_solid_angles(size)
    assert abs(6 * angles.sum() - 4 * np.pi) < 1e-12
    _, expected, _ = reference.samples(np.ones((6, size, size, 3)))
    np.testing.assert_allclose(angles, expected.reshape(6, size, size)[0], rtol=1e-9)


@pytest.mark.parametrize("size", [1, 5, 12, 16])
def test_every_level_keeps_the_energy(size):
    faces = np.random.default_rng(1).random((6, size, size, 3)) ** 4
    cube = fastibl.CubeMap(faces)
    assert cube.level_count == int(np.log2(size)) + 1
    for k in range(cube.level_count):
        level = cube.level(k)
        assert level.shape[1] == max(1, size >> k)
        angles = fastibl.texel_solid_angles(level.shape[1])
        mean = (level * angles[..., None]).sum(axis=(0, 1, 2)) / (4 * np.pi)
        # Odd sizes share texels between two coarser ones by area on the face, not exactly by solid angle.
        np.testing.assert_allclose(mean, cube.mean(), rtol=1e-5 if size & (size - 1) == 0 else 3e-2)


def test_sampling_is_seamless():
    """Along a great circle through faces, edges and a corner, neighbours differ little."""
    cube = fastibl.CubeMap(np.random.default_rng(2).random((6, 8, 8, 3)))
    angle = np.linspace(0, 2 * np.pi, 40001)
    corner, across = np.array([1, 1, 1]) / np.sqrt(3), np.array([1, -1, 0]) / np.sqrt(2)
    circle = np.cos(angle)[:, None] * corner + np.sin(angle)[:, None] * across
    for level in (0.0, 0.5, 1.7, 3.0):
        steps = np.abs(np.diff(cube.sample(circle, level), axis=0)).max()
        print(f"level {level}: largest step {steps:.4f}")
        assert steps < 0.01


def test_texel_centres_are_exact_and_levels_blend():
    faces = np.random.default_rng(3).random((6, 4, 4, 3)).astype(np.float32)
    cube = fastibl.CubeMap(faces)
    d = fastibl.texel_directions(4)
    np.testing.assert_allclose(cube.sample(d), faces, atol=1e-5)
    np.testing.assert_allclose(cube.sample(d, 0.25), 0.75 * cube.sample(d, 0) + 0.25 * cube.sample(d, 1), atol=1e-5)
    np.testing.assert_array_equal(cube.sample(d, 99.0), cube.sample(d, 2.0))
    np.testing.assert_array_equal(cube.sample(d, -3.0), cube.sample(d, 0.0))
    np.testing.assert_array_equal(cube.sample(d, np.full((6, 4, 4), 1.5)), cube.sample(d, 1.5))


@pytest.mark.parametrize("size", [5, 7, 9, 13])
def test_nothing_between_texels_is_outside_what_they_hold(size):
    rng = np.random.default_rng(size)
    cube = fastibl.CubeMap((rng.random((6, size, size, 3)) < 0.5).astype(np.float32))
    for finer in (2 * size + 1, 3 * size, 5 * size):  # texels' centres on edges of the map's own, but for rounding
        light = cube.sample(reference.samples(np.zeros((6, finer, finer, 3)))[0].astype(np.float32))
        assert light.min() >= 0 and light.max() <= 1


def test_a_mirrored_map_has_a_mirrored_picture():
    """Samples within a pixel lie evenly around its middle."""
    cube = fastibl.CubeMap(np.random.default_rng(0).random((6, 16, 16, 3)))
    mirrored = turned(cube, np.diag([-1, 1, 1]))
    for height in (16, 32, 64):
        picture = fastibl.equirect_from_cubemap(cube, height)
        np.testing.assert_allclose(fastibl.equirect_from_cubemap(mirrored, height)[:, ::-1], picture, atol=1e-6)


def test_conversion_keeps_constant_and_energy():
    constant = fastibl.cubemap_from_equirect(np.full((16, 32, 3), 0.7), size=8)
    np.testing.assert_allclose(constant.faces, 0.7, rtol=1e-6)
    np.testing.assert_allclose(fastibl.equirect_from_cubemap(constant, 16), 0.7, rtol=1e-6)
    image = np.random.default_rng(4).random((24, 48, 3)) ** 8
    _, angles, radiance = reference.samples(image)
    want = angles @ radiance / (4 * np.pi)
    cube = fastibl.cubemap_from_equirect(image, size=16)
    np.testing.assert_allclose(cube.mean(), want, rtol=1e-5)
    _, angles, radiance = reference.samples(fastibl.equirect_from_cubemap(cube, 40))
    np.testing.assert_allclose(angles @ radiance / (4 * np.pi), want, rtol=1e-5)


@pytest.mark.skipif(not MAPS, reason="no real HDR maps beside the project")
def test_real_map_keeps_its_irradiance():
    import cv2

    image = cv2.imread(str(MAPS[0]), cv2.IMREAD_UNCHANGED)[..., ::-1]
    normals = units(20)
    truth = reference.irradiance(image, normals)
    error = np.abs(reference.irradiance(fastibl.read_environment(MAPS[0]), normals) - truth) / truth.mean()
    print(f"{MAPS[0].stem}: irradiance of the cube against the picture, largest error {100 * error.max():.3f} %")
    assert error.max() < 0.002


def test_faces_are_a_view_that_outlives_the_map():
    cube = fastibl.CubeMap(np.ones((6, 2, 2, 3)))
    view = cube.faces
    assert view.base is cube and not view.flags.writeable
    del cube
    assert view.sum() == 72


def test_cleaning_counts_what_it_changes():
    faces = np.ones((6, 2, 2, 3))
    faces[0, 0, 0] = (np.nan, -1, np.inf)
    faces[1, 0, 0, 0] = 1e30
    cube = fastibl.CubeMap(faces)
    assert cube.cleaned == {"nan": 1, "negative": 1, "capped": 2}
    np.testing.assert_array_equal(cube.faces[0, 0, 0], (0, 0, 1e9))
    assert np.isfinite(cube.level(1)).all()


def test_what_was_cleaned_is_kept_by_copies():
    faces = np.ones((6, 2, 2, 3))
    faces[0, 0, 0, 0], faces[1, 0, 0, 1] = np.nan, -1
    cube = fastibl.CubeMap(faces)
    for copied in (pickle.loads(pickle.dumps(cube)), copy.copy(cube), copy.deepcopy(cube)):
        assert copied == cube and copied.cleaned == {"nan": 1, "negative": 1, "capped": 0}


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64, np.int64, np.uint8, int, float])
def test_numbers_of_numpy_are_numbers(kind):
    cube = fastibl.CubeMap(np.random.default_rng(5).random((6, 4, 4, 3)))
    up, lighting = np.array([[0, 0, 1.0]]), fastibl.Lighting(cube)
    assert np.array_equal(cube.sample(up, kind(1)), cube.sample(up, 1.0))
    assert np.array_equal(lighting.glossy(up, up, kind(64)), lighting.glossy(up, up, 64.0))
    assert fastibl.directional_albedo(kind(1), 64) == fastibl.directional_albedo(np.array([1.0]), 64)[0]


def test_values_behave():
    cube = fastibl.CubeMap(np.random.default_rng(5).random((6, 3, 3, 3)))
    assert pickle.loads(pickle.dumps(cube)) == cube == copy.copy(cube)
    assert cube != fastibl.CubeMap(np.ones((6, 3, 3, 3)))


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.longdouble])
def test_any_float_and_stride(dtype):
    wide = np.random.default_rng(6).random((6, 4, 8, 3)).astype(dtype)
    strided = wide[:, :, ::2]
    assert fastibl.CubeMap(strided) == fastibl.CubeMap(np.ascontiguousarray(strided, np.float32))
    directions = np.asfortranarray(units(6).astype(dtype))
    directions.flags.writeable = False
    assert fastibl.CubeMap(strided).sample(directions).dtype == np.float32


def test_bad_input_is_refused():
    cube = fastibl.CubeMap(np.ones((6, 2, 2, 3)))
    same_error(lambda: fastibl.CubeMap(np.ones((6, 2, 3, 3))), ValueError, "(6, n, n, 3)", "(6, 2, 3, 3)")
    same_error(lambda: fastibl.CubeMap(np.ones((6, 0, 0, 3))), ValueError, "(6, 0, 0, 3)")
    same_error(lambda: fastibl.CubeMap(np.ones((6, 2, 2, 3), np.int32)), TypeError, "floats", "int32")
    same_error(lambda: fastibl.CubeMap(1.0), TypeError, "array", "float")
    same_error(lambda: fastibl.CubeMap(np.full((6, 2, 2, 3), None)), TypeError, "object")
    same_error(lambda: cube.sample(np.ones((4, 2))), ValueError, "(..., 3)", "(4, 2)")
    same_error(lambda: cube.sample(np.ones((4, 3), int)), TypeError, "floats", "int64")
    same_error(lambda: cube.sample(np.ones(3), np.ones(7)), ValueError)
    same_error(lambda: cube.level(2), IndexError, "0 to 1")
    same_error(lambda: fastibl.cubemap_from_equirect(np.ones((4, 8, 4))), ValueError, "(4, 8, 4)")
    same_error(lambda: fastibl.cubemap_from_equirect(np.ones((4, 8, 3)), size=0), ValueError, "0")
    same_error(lambda: fastibl.equirect_from_cubemap(cube, 0), ValueError, "0")
    same_error(lambda: fastibl.texel_solid_angles(0), ValueError, "0")


def test_files(tmp_path):
    same_error(lambda: fastibl.read_environment(tmp_path / "none.hdr"), FileNotFoundError, "none.hdr")
    (tmp_path / "text.hdr").write_text("hello")
    same_error(lambda: fastibl.read_environment(tmp_path / "text.hdr"), ValueError, "text.hdr")
    import cv2

    cv2.imwrite(str(tmp_path / "byte.png"), np.zeros((4, 8, 3), np.uint8))
    same_error(lambda: fastibl.read_environment(tmp_path / "byte.png"), ValueError, "uint8", "linear radiance")
    cv2.imwrite(str(tmp_path / "square.hdr"), np.ones((8, 8, 3), np.float32))
    same_error(lambda: fastibl.read_environment(tmp_path / "square.hdr"), ValueError, "8 x 8")
    cv2.imwrite(str(tmp_path / "good.hdr"), np.full((8, 16, 3), (1, 2, 3), np.float32))
    np.testing.assert_allclose(fastibl.read_environment(tmp_path / "good.hdr", size=4).mean(), (3, 2, 1), rtol=0.01)


@pytest.mark.parametrize("height", [0, 8193, 2**30, 2**31 - 1])
def test_pictures_too_large_are_refused(height, tmp_path):
    cube = fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32))
    with pytest.raises(ValueError, match="1 to 8192"):
        fastibl.equirect_from_cubemap(cube, height)
    if height:
        with pytest.raises(ValueError, match="1 to 8192"):
            fastibl.write_environment(tmp_path / "a.hdr", cube, height=height)
