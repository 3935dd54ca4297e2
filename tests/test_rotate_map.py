"""Maps turned by any rotation, against sums over the map as it was."""

import numpy as np
import pytest

import fastibl
from conftest import same_error
from fastibl import reference
from fastibl.rotations import rotations_from

TURNS = {
    "a little": rotations_from(np.array([0.02, -0.01, 0.03])),
    "about z": rotations_from(np.array([0, 0, 1.1])),
    "any": rotations_from(np.array([1.2, -0.7, 0.4])),
}


def units(count, seed=0):
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def smooth(size=64):
    d = fastibl.texel_directions(size)
    faces = 1 + 0.5 * np.sin(3 * d @ np.float32([[1, 0.2, 0], [0, 1, 0.3], [0.4, 0, 1]]))
    return fastibl.CubeMap(faces.astype(np.float32))


@pytest.mark.parametrize("turn", TURNS)
def test_light_from_d_comes_from_r_d(turn):
    cube, r, d = smooth(), TURNS[turn], units(2000)
    off = np.abs(fastibl.rotate_map(cube, r).sample(d @ r.T) - cube.sample(d)).max()
    print(f"largest difference {off:.1e}")
    assert off < 5e-3  # texels of 1.4 degrees


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("texel", [(4, 10, 21), (0, 0, 0), (2, 31, 5)])
def test_a_sun_in_one_texel_keeps_its_irradiance(turn, texel):
    faces = np.full((6, 32, 32, 3), 0.1, np.float32)
    faces[texel] = np.float32([3.0, 2.0, 1.0]) / fastibl.texel_solid_angles(32)[texel[1:]]
    cube, r = fastibl.CubeMap(faces), TURNS[turn]
    turned = fastibl.rotate_map(cube, r)
    normals = units(300, 1)
    true = reference.irradiance(cube, normals)
    off = np.sqrt(((reference.irradiance(turned, normals @ r.T) - true) ** 2).mean()) / true.mean()
    print(f"irradiance off by {off:.2%}")
    assert off < 0.012  # the sun has moved by a fraction of a texel of 2.8 degrees
    angles = fastibl.texel_solid_angles(32)[..., None]
    sums = [(m.faces.astype(float) * angles).sum(axis=(0, 1, 2)) for m in (cube, turned)]
    np.testing.assert_allclose(*sums, rtol=1e-5)


def test_real_maps_keep_their_irradiance(real_maps):
    normals = units(100, 2)
    for name, cube in real_maps.items():
        true = reference.irradiance(cube, normals)
        for turn, r in TURNS.items():
            made = reference.irradiance(fastibl.rotate_map(cube, r), normals @ r.T)
            off = np.sqrt(((made - true) ** 2).mean()) / true.mean()
            print(f"{name:22} {turn:9} {off:.3%}")
            assert off < 0.003


def test_a_turn_and_back_and_what_stays():
    cube = smooth()
    r = TURNS["any"]
    assert np.abs(fastibl.rotate_map(fastibl.rotate_map(cube, r), r.T).faces - cube.faces).max() < 0.01
    np.testing.assert_array_equal(fastibl.rotate_map(cube, np.eye(3)).faces, cube.faces)
    quarter = fastibl.rotate_map(cube, np.pi / 2)  # no value changes
    np.testing.assert_array_equal(np.sort(quarter.faces.ravel()), np.sort(cube.faces.ravel()))
    np.testing.assert_allclose(quarter.sample([0.0, 1, 0]), cube.sample([1.0, 0, 0]), rtol=1e-6)
    even = fastibl.CubeMap(np.full((6, 8, 8, 3), 0.7, np.float32))
    np.testing.assert_allclose(fastibl.rotate_map(even, r).faces, 0.7, rtol=1e-6)
    assert not fastibl.rotate_map(fastibl.CubeMap(np.zeros((6, 8, 8, 3), np.float32)), r).faces.any()
    huge = fastibl.CubeMap(np.full((6, 8, 8, 3), 1e9, np.float32))
    np.testing.assert_allclose(fastibl.rotate_map(huge, r).faces, 1e9, rtol=1e-5)


@pytest.mark.parametrize(
    "rotation, words",
    [
        (np.diag([1, 1, -1]), "determinant 1"),
        (2 * np.eye(3), "orthonormal"),
        (np.full((3, 3), np.nan), "orthonormal"),
        (np.nan, "finite"),
        (np.eye(4), "(3, 3)"),
        ("z", "'z'"),
    ],
)
def test_what_is_no_rotation_is_refused(rotation, words):
    same_error(lambda: fastibl.rotate_map(smooth(8), rotation), ValueError, words)


def test_another_map_is_refused():
    with pytest.raises(TypeError, match="CubeMap.*give its radiance"):
        fastibl.rotate_map(fastibl.Environment(smooth(8)), 0.1)
