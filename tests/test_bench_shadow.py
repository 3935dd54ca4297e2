"""What the goals of shadow are measured with: truths, and the peer."""

import numpy as np
import pytest

import fastibl
from bench.shadows import sky, truth
from fastibl import reference

SPHERES = np.array([(0.0, 0.0, 0.3, 0.3), (0.2, 0.1, 0.4, 0.25), (-0.3, 0.1, 0.05, 0.2), (0.1, -0.2, -0.6, 0.2)])
POINTS = np.array([(0.5, 0.2), (0.0, 0.01), (-0.31, 0.1), (1.4, -0.9), (0.05, 0.45)])


def seeded(size=32, seed=0):
    """Light with a few texels that hold much of it."""
    rng = np.random.default_rng(seed)
    faces = rng.random((6, size, size, 3)) + 0.1
    faces[rng.integers(0, 6, 8), rng.integers(0, size, 8), rng.integers(0, size, 8)] = 3000 * rng.random((8, 3))
    return fastibl.CubeMap(faces)


def test_truth_of_spheres_is_the_reference():
    """Without cut texels, direction for direction; with them, as the reference of the same map with finer texels."""
    cubes = [seeded(), seeded(seed=1)]
    whole = sky.Sky(cubes, largest=1)
    given = whole.ratios(POINTS, sky.behind_spheres(whole, SPHERES), False)
    for k, cube in enumerate(cubes):
        np.testing.assert_allclose(given[:, k], reference.shadow_ratio(cube, SPHERES, POINTS), atol=1e-12)
    fine = fastibl.CubeMap(np.repeat(np.repeat(cubes[0].faces, 8, axis=1), 8, axis=2))
    cut = sky.Sky(cubes[:1], largest=0)  # every texel is cut
    given = cut.ratios(POINTS, sky.behind_spheres(cut, SPHERES), False)[:, 0]
    np.testing.assert_allclose(given, reference.shadow_ratio(fine, SPHERES, POINTS), atol=1e-4)


def test_truth_of_spheres_knows_the_extremes():
    none = sky.sphere_ratio([seeded()], [(np.nan, 0, 1, 1), (0, 0, 1, -1), (0, 0, -2, 1)], POINTS)
    assert (none == 1).all() and (sky.sphere_ratio([seeded()], np.zeros((0, 4)), POINTS) == 1).all()
    black = seeded().faces * (1, 0, 1)
    dark = sky.sphere_ratio([fastibl.CubeMap(black)], SPHERES, POINTS)
    assert (dark[..., 1] == 1).all() and (dark[..., 0] < 1).any()
    around = sky.sphere_ratio([seeded()], [(0, 0, 0, 5)], POINTS)
    np.testing.assert_allclose(around, 0, atol=1e-12)


def test_truth_of_a_mesh_is_the_reference():
    pytest.importorskip("embreex")
    mesh = fastibl.stand(fastibl.shapes.figurine(1.0), 1.0)
    cube = seeded()
    given = (whole := sky.Sky([cube], largest=1)).ratios(POINTS, sky.behind_mesh(whole, mesh), False)[:, 0]
    # Both start their rays above the plane, not equally high.
    np.testing.assert_allclose(given, reference.shadow_ratio(cube, mesh, POINTS), atol=2e-3)
    assert given.min() < 0.9


def test_visibility_of_an_object_that_stays():
    from bench.shadows.steady import Visibility

    seen = Visibility(lambda given: sky.behind_spheres(given, SPHERES), POINTS, 32)
    for seed in (0, 1):
        cube = seeded(seed=seed)
        np.testing.assert_allclose(seen.ratio(cube), reference.shadow_ratio(cube, SPHERES, POINTS), atol=1e-5)
    assert (seen.ratio(fastibl.CubeMap(np.zeros((6, 32, 32, 3)))) == 1).all()


def test_lights_and_their_sun():
    lights = truth.lights(32)
    assert lights["uniform"].soft
    if "dawn and sun" not in lights:
        pytest.skip("no real HDR maps")
    assert len(lights) == 10 and sum(not light.soft for light in lights.values()) == 2
    dawn, sun = (reference.irradiance(lights[n].cube, [(0, 0, 1)], split=1) for n in ("kiara_1_dawn", "dawn and sun"))
    np.testing.assert_allclose(dawn / sun, 0.25, rtol=1e-5)


def test_errors():
    true = np.array([(0.5, 0.5, 0.5), (0.999, 1, 1), (0.2, 0.2, 0.2)])
    assert truth.errors(true + 0.1, true) == pytest.approx((0.1, 0.1))
    covered = np.array([False, False, True])
    off = true + np.array([0.1, 1, 1])[:, None]
    assert truth.errors_in_shadow(off, true, covered) == pytest.approx((0.1, 0.1))
    grid = truth.grid()
    assert grid.shape == (4096, 2) and np.allclose(grid[0], -1.5 + 3 / 128) and grid[1, 0] > grid[0, 0]


def test_the_peer_agrees_with_cap_sum():
    """The same caps and, in light without detail, the same radiance in them; in any light, the same mean."""
    from bench.peers import cone_sum

    try:
        cone_sum.load()
    except RuntimeError as reason:
        pytest.skip(str(reason))
    points = truth.grid(32).astype(np.float32)
    x, y = np.ascontiguousarray(points.T)
    given = SPHERES[:2] * (1, 1, 1, 0.3)  # small: a fetch takes the nearest texel, which is as wide as the cap
    d = fastibl.texel_directions(64)
    smooth = fastibl.CubeMap(1 + 0.3 * d)  # each channel along another axis
    worst = 0.0
    for cube in (fastibl.CubeMap(np.ones((6, 16, 16, 3))), smooth):
        ratio = cone_sum.ConeSum(cube, given)(x, y).T
        expected = fastibl.shadow_ratio(cube, given, points, "cap-sum")
        worst = max(worst, truth.errors(ratio, expected).rms / truth.errors(np.ones_like(expected), expected).rms)
        assert ((ratio == 0).all(axis=1) == (expected == 0).all(axis=1)).mean() > 0.99
    print(f"per-pixel cones against cap-sum in smooth light: {100 * worst:.2g} % of the shadow")
    assert worst < 0.03
    lit = fastibl.CubeMap(1 + 20 * np.exp(8 * (d[..., :1] - 1)) * (1, 0.5, 0.1))
    ratio = cone_sum.ConeSum(lit, given)(x, y).T
    expected = fastibl.shadow_ratio(lit, given, points, "cap-sum")
    np.testing.assert_allclose((1 - ratio).mean(axis=0), (1 - expected).mean(axis=0), rtol=0.05)
    none = cone_sum.ConeSum(fastibl.CubeMap(np.zeros((6, 16, 16, 3))), given[:1])(x, y)
    assert ((none == 1) | (none == 0)).all() and none.mean() > 0.8
    with pytest.raises(ValueError, match="16"):
        cone_sum.ConeSum(smooth, given)(x[:5], y[:5])


def test_pictures_show_what_they_are_given():
    from bench.shadows import pictures

    mesh = fastibl.stand(fastibl.shapes.figurine(1.0), 1.0)
    view = pictures.view_of(mesh)
    assert 0.02 < view.alpha.mean() < 0.5 and view.points.shape == (pictures.HEIGHT, pictures.WIDTH, 2)
    one = np.ones((pictures.HEIGHT, pictures.WIDTH, 3))
    light = pictures.object_light(mesh, view, fastibl.CubeMap(np.ones((6, 16, 16, 3))))
    assert (light[view.alpha == 0] == 0).all() and 0.2 < light[view.alpha == 1].mean() <= 1
    lit, dark = (pictures.picture(r, 0 * light, view.alpha) for r in (one, 0.5 * one))
    assert (lit > dark)[view.alpha == 0].all() and (lit == 0)[view.alpha == 1].all()
    off = pictures.difference(0.99 * one, one, view.alpha)
    assert (off[view.alpha == 1] == 128).all() and (off[view.alpha == 0] < 128).all()
    table = pictures.error_table({"a": {"dawn": {"ours": truth.Errors(0.01, 0.2)}}})
    assert table.splitlines() == ["| light | ours |", "|---|---|", "| dawn | 0.0100 (0.20) |"]
