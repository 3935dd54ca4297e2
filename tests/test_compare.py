"""Comparing maps by the spheres that they light."""

import numpy as np
import pytest

import fastibl
from conftest import same_error

SPHERES = {"matte", "glossy", "mirror"}


def random_map(seed, size=32):
    return fastibl.CubeMap(0.1 + np.random.default_rng(seed).random((6, size, size, 3)))


def test_a_map_is_itself(marked):
    for given in (marked, fastibl.Environment(marked), marked.faces):
        comparison = fastibl.compare(given, marked)
        for errors in (comparison.rmse, comparison.scale_invariant_rmse):
            assert set(errors) == SPHERES and max(errors.values()) < 1e-7
        assert set(comparison.angular) == SPHERES and max(comparison.angular.values()) < 1e-3
        assert comparison.median == 0


def test_a_factor_is_no_scale_invariant_error(marked):
    comparison = fastibl.compare(fastibl.CubeMap(marked.faces * 1.7), marked)
    print(comparison)
    assert max(comparison.scale_invariant_rmse.values()) < 1e-6 and max(comparison.angular.values()) < 0.01
    # An estimate of 1.7 times the truth is 70 % off, by the root mean square of what it scales.
    assert 0.7 < min(comparison.rmse.values()) and comparison.rmse["matte"] < 0.9
    assert comparison.median == pytest.approx(0.7, abs=0.1)


@pytest.mark.parametrize("radiance", [1e-30, 1e-8, 1e6])
def test_errors_are_the_same_for_dim_and_bright_light(marked, radiance):
    scaled = fastibl.CubeMap(marked.faces * np.float32(radiance))
    found = fastibl.compare(fastibl.CubeMap(scaled.faces * 2), scaled)
    for sphere in found.rmse:
        assert found.scale_invariant_rmse[sphere] < 1e-4 and found.rmse[sphere] > 0.9


def test_a_tint_is_an_angular_error():
    true = fastibl.CubeMap(np.ones((6, 8, 8, 3)))
    tinted = fastibl.CubeMap(np.ones((6, 8, 8, 3)) * (1, 1, 0))
    comparison = fastibl.compare(tinted, true)
    for sphere in SPHERES:
        assert comparison.angular[sphere] == pytest.approx(np.degrees(np.arccos(2 / np.sqrt(6))), abs=0.01)
        assert comparison.rmse[sphere] == pytest.approx(np.sqrt(1 / 3), abs=1e-4)
        # The best factor leaves (1, 1, 0) as it is.
        assert comparison.scale_invariant_rmse[sphere] == pytest.approx(np.sqrt(1 / 3), abs=1e-4)
    assert comparison.median == pytest.approx(np.sqrt(1 / 3), abs=1e-4)


def test_sharper_spheres_see_more():
    """Two maps of the same light at other places: a matte sphere hardly differs, a mirror does."""
    comparison = fastibl.compare(random_map(0), random_map(1))
    print(comparison)
    assert comparison.rmse["matte"] < comparison.rmse["glossy"] < comparison.rmse["mirror"]


def test_maps_of_other_sizes_compare():
    fine = random_map(3)
    coarse = fastibl.CubeMap(fine.level(2))
    comparison = fastibl.compare(coarse, fine)
    print(f"a map of 8 squared texels for one of 32: matte {comparison.rmse['matte']:.4f}")
    assert comparison.rmse["matte"] < 0.01 < comparison.rmse["mirror"]


def test_black_maps_have_finite_errors(marked):
    black = fastibl.CubeMap(np.zeros((6, 4, 4, 3)))
    for pair in ((black, black), (black, marked), (marked, black)):
        comparison = fastibl.compare(*pair)
        for errors in (comparison.rmse, comparison.scale_invariant_rmse, comparison.angular):
            assert np.isfinite(list(errors.values())).all()
    assert fastibl.compare(black, marked).median == pytest.approx(1, abs=0.5)


def test_what_is_no_map_is_refused(marked):
    same_error(lambda: fastibl.compare(np.ones((6, 4, 5, 3)), marked), ValueError, "(6, 4, 5, 3)")
    same_error(lambda: fastibl.compare(marked, np.ones((4, 8, 3))), ValueError, "(6, n, n, 3)", "(4, 8, 3)")
    with pytest.raises((TypeError, ValueError)):
        fastibl.compare("room.hdr", marked)
    with pytest.raises((TypeError, ValueError)):
        fastibl.compare(marked, None)


def test_a_comparison_reads_like_a_table():
    ones = np.ones((6, 8, 8, 3), np.float32)
    text = str(fastibl.compare(1.1 * ones, ones))
    print("\n" + text)
    assert [line.split()[0] for line in text.splitlines()] == ["matte", "glossy", "mirror", "irradiance"]
    assert all("10.00 %" in line for line in text.splitlines())


def test_where_in_a_block_a_lamp_is_counts():
    """Of a map that is summed by blocks of 4 x 4: a sun moved within one, in the upper corner of a face."""
    faces = np.zeros((2, 6, 128, 128, 3), np.float32)
    faces[0, 4, 40, 40] = faces[1, 4, 43, 43] = 1.0
    angles = fastibl.texel_solid_angles(128)
    faces[1] *= float(angles[40, 40] / angles[43, 43])
    normals = fastibl.texel_directions(8).reshape(-1, 3).astype(np.float64)
    e = [np.maximum(normals @ fastibl.texel_directions(128)[4, k, k], 0) for k in (40, 43)]
    expected = np.sqrt(np.mean((e[1] - e[0]) ** 2)) / e[0].mean()
    found = fastibl.compare(faces[1], faces[0]).rmse["matte"]
    print(f"{found:.4f} of {expected:.4f}")
    assert found == pytest.approx(expected, rel=0.05) and expected > 0.02


@pytest.mark.parametrize("size", [1, 2, 4, 8])
def test_coarse_maps_are_what_they_are_in_finer_texels(size):
    faces = np.random.default_rng(size).random((6, size, size, 3)).astype(np.float32)
    fine = np.repeat(np.repeat(faces, 64 // size, axis=1), 64 // size, axis=2)
    assert fastibl.compare(faces, fine).rmse["matte"] < 2e-3
    normals = [(0, 0, 1), (0.6, 0, 0.8), (-0.6, 0.64, -0.48)]
    true = fastibl.reference.irradiance(fine, normals)
    np.testing.assert_allclose(fastibl.reference.irradiance(faces, normals), true, rtol=2e-3)
