"""The look-up of a shadow map: against bilinear interpolation in float64, and many points against single ones."""

from __future__ import annotations

import numpy as np
import pytest

import fastibl


def sky(seed: int = 0) -> fastibl.CubeMap:
    return fastibl.CubeMap(np.random.default_rng(seed).random((6, 16, 16, 3), np.float32) ** 4)


SPHERES = np.array([[0.1, -0.2, 0.3, 0.25], [0.3, 0.1, 0.2, 0.15]], np.float32)


def bilinear(image: np.ndarray, centre: tuple[float, float], extent: float, points: np.ndarray) -> np.ndarray:
    """NaN outside."""
    n = len(image)
    p = (points.astype(np.float64) - centre) * (0.5 * n / extent) + 0.5 * n - 0.5
    inside = ((p > -0.5) & (p < n - 0.5)).all(axis=-1)
    q = np.clip(np.where(inside[:, None], p, 0), 0, n - 1)
    i = np.minimum(q.astype(int), max(n - 2, 0))
    f, j = q - i, np.minimum(i + 1, n - 1)
    image = image.astype(np.float64)
    upper = image[i[:, 1], i[:, 0]] * (1 - f[:, :1]) + image[i[:, 1], j[:, 0]] * f[:, :1]
    lower = image[j[:, 1], i[:, 0]] * (1 - f[:, :1]) + image[j[:, 1], j[:, 0]] * f[:, :1]
    value = upper * (1 - f[:, 1:]) + lower * f[:, 1:]
    return np.where(inside[:, None], value, np.nan)


@pytest.mark.parametrize("resolution", [2, 3, 17, 64, 130])
@pytest.mark.parametrize("outer", [False, True])
def test_look_up_is_bilinear_in_the_finest_map_that_has_the_point(resolution, outer):
    shadow = fastibl.cast_shadow(sky(), SPHERES, resolution=resolution, outer=outer, extent=0.7, directions=64)
    rng = np.random.default_rng(resolution)
    points = (rng.uniform(-1.3, 1.3, (20000, 2)) * shadow.reach + shadow.centre).astype(np.float32)
    expected = bilinear(shadow.image, shadow.centre, shadow.extent, points)
    if shadow.outer is not None:
        coarse = bilinear(shadow.outer, shadow.centre, shadow.outer_extent, points)
        expected = np.where(np.isnan(expected), coarse, expected)
    expected = np.where(np.isnan(expected), 1, expected)
    many = shadow.sample(points)
    off = np.abs(many - expected)
    print(f"{resolution}^2, outer {shadow.outer is not None}: largest difference {off.max():.1e}")
    # Points on the border itself may be taken for either side of it.
    assert np.sort(off.max(axis=-1))[-3] < 1e-4 and (many <= 1).all() and (many >= 0).all()
    singly = np.array([shadow.sample(p) for p in points[:300]])
    np.testing.assert_array_equal(singly, many[:300])


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 255, 256, 257, 258, 259, 511, 514, 1000])
def test_look_up_of_any_number_of_points_stays_within_them(count):
    shadow = fastibl.cast_shadow(sky(1), SPHERES, resolution=4)
    points = np.random.default_rng(count).normal(size=(count, 2)).astype(np.float32)
    out = np.full((count + 8, 3), -7, np.float32)
    kept = out[4 : count + 4]
    shadow.sample(points, kept)
    np.testing.assert_array_equal(kept, [shadow.sample(p) for p in points] if count else np.empty((0, 3)))
    assert (out[:4] == -7).all() and (out[count + 4 :] == -7).all()


def test_look_up_of_points_that_are_nowhere():
    shadow = fastibl.cast_shadow(sky(2), SPHERES, resolution=8)
    worst = np.float32([np.nan, np.inf, -np.inf, 3e38, -3e38, 1e9, -1e9, 50, -50])
    points = np.stack(np.meshgrid(worst, np.append(worst, 0)), axis=-1).reshape(-1, 2).astype(np.float32)
    assert (shadow.sample(np.tile(points, (20, 1))) == 1).all()
    assert all((shadow.sample(p) == 1).all() for p in points)


def test_full_light_and_full_shadow_are_exact():
    cover = fastibl.cast_shadow(sky(3), np.float32([[0, 0, 0, 5]]), extent=1, resolution=32, outer=False)
    inside = np.random.default_rng(0).uniform(-0.6, 0.6, (5000, 2)).astype(np.float32)
    assert (cover.sample(inside) == 0).all()
    empty = fastibl.cast_shadow(sky(3), np.empty((0, 4), np.float32), extent=1, resolution=32)
    assert (empty.sample(inside) == 1).all()


def test_map_of_any_size_is_exact_at_its_texels_after_any_other():
    """Sums of edges reuse their memory: shadows that end at or beyond the last texel must leave nothing behind."""
    rng = np.random.default_rng(4)
    spheres = np.c_[rng.uniform(-1, 1, (30, 2)), rng.uniform(0.1, 0.6, 30), rng.uniform(0.05, 0.3, 30)]
    spheres = spheres.astype(np.float32)
    where = {"extent": 0.7, "centre": (0.0, 0.0), "outer": False, "directions": 32}
    for n in [100, 64, 63, 65, 130, 127, 7, 260, 100]:
        shadow = fastibl.cast_shadow(sky(4), spheres, resolution=n, **where)
        inner = slice(n // 10 + 2, n - n // 10 - 2)  # the rest fades towards the border
        x = ((np.arange(n) + 0.5) / n * 2 - 1)[inner] * 0.7
        points = np.stack(np.meshgrid(x, x), axis=-1).astype(np.float32)
        exact = fastibl.shadow_ratio(sky(4), spheres, points, directions=32)
        off = np.abs(shadow.image[inner, inner] - exact).max(axis=-1)
        assert not off.size or np.mean(off > 1e-6) < 0.01  # texels that an edge passes to 1e-5
        again = fastibl.cast_shadow(sky(4), spheres, resolution=n, **where)
        np.testing.assert_array_equal(shadow.image, again.image)
