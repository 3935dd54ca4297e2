"""Shadows of spheres on the plane: against quadrature and the reference, and bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fastibl
from fastibl import reference

UNIFORM = fastibl.CubeMap(np.ones((6, 64, 64, 3), np.float32))
CAPS = ["cap-sum", "cap-product"]
METHODS = [*CAPS, "directions"]


def seeded_map(size=64, seed=0):
    """Soft light with a few strong lamps, another one in each channel."""
    directions = fastibl.texel_directions(size).astype(np.float64)
    rng = np.random.default_rng(seed)
    faces = 0.2 + 0.1 * directions
    for _ in range(4):
        axis = rng.normal(size=3)
        axis[2] = abs(axis[2]) + 0.3
        axis /= np.linalg.norm(axis)
        faces = faces + 5 * rng.random(3) * np.exp(60 * (directions @ axis - 1))[..., None]
    return fastibl.CubeMap(faces)


def plane_grid(extent, n):
    g = ((np.arange(n) + 0.5) / n * 2 - 1) * extent
    return np.stack(np.meshgrid(g, g), -1)


def cap_quadrature(alpha, theta, count=20000):
    """Projected solid angle of a cap above the horizon: azimuth width of the cap over the polar angle."""
    total = 0.0
    edges = np.clip([0, abs(theta - alpha), theta + alpha, np.pi / 2], 0, np.pi / 2)
    edges = np.sort(edges)
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        if high <= low:
            continue
        # Square-root ends are smoothed by this substitution.
        x = (np.arange(count) + 0.5) / count
        t = low + (high - low) * (1 - np.cos(np.pi * x)) / 2
        dt = (high - low) * np.pi * np.sin(np.pi * x) / 2 / count
        bottom = np.maximum(np.sin(theta) * np.sin(t), 1e-300)
        half = np.arccos(np.clip((np.cos(alpha) - np.cos(theta) * np.cos(t)) / bottom, -1, 1))
        total += np.sum(2 * half * np.cos(t) * np.sin(t) * dt)
    return total


def test_cap_formula_against_quadrature():
    worst = 0.0
    for alpha in np.radians([0.5, 3, 10, 30, 45, 60, 80, 89, 89.9]):
        for theta in np.radians([0, 0.1, 20, 45, 60, 80, 87, 89.5, 90, 90.5, 93, 110, 135, 165, 179]):
            sphere = np.array([[np.sin(theta), 0, np.cos(theta), np.sin(alpha)]])
            ratio = fastibl.shadow_ratio(UNIFORM, sphere, np.zeros(2), "cap-product")
            assert np.ptp(ratio) == 0
            error = abs((1 - ratio[0]) - cap_quadrature(alpha, theta) / np.pi)
            worst = max(worst, error)
    print(f"cap formula: largest error of the obstruction {worst:.1e} (grid of 135)")
    assert worst < 3e-4  # of which E(z) as a sum over texels is most


@pytest.mark.parametrize("sphere", [(0, 0, 0.5, 0.3), (0.2, -0.1, 0.1, 0.3), (0, 0, -0.1, 0.25), (0, 0, 0.2, 0.2)])
@pytest.mark.parametrize("method", METHODS)
def test_single_sphere_under_uniform_sky(sphere, method):
    spheres, points = np.array([sphere]), plane_grid(1.5, 24)
    ratio = fastibl.shadow_ratio(UNIFORM, spheres, points, method)
    truth = reference.shadow_ratio(UNIFORM, spheres, points)
    error = np.abs(ratio - truth)
    print(f"{sphere} {method}: RMS {np.sqrt(np.mean(error**2)):.4f}, max {error.max():.4f}")
    assert np.sqrt(np.mean(error**2)) < (0.004 if method == "directions" else 0.002)
    assert error.max() < 0.02  # the reference tells texels of 1.4 degrees apart


def test_small_sphere_takes_the_light_behind_it():
    # A sphere of 3 degrees before a slowly changing sky: radiance there times its projected solid angle.
    directions = fastibl.texel_directions(64)
    cube = fastibl.CubeMap(1 + 0.8 * directions)
    up = reference.irradiance(cube, [0.0, 0, 1])
    for direction in np.array([[0.3, 0.2, 0.9], [-0.9, 0.3, 0.3], [0.8, -0.2, 0.4], [0.1, 0.9, 0.2], [0.2, -0.9, 0.3]]):
        d = direction / np.linalg.norm(direction)
        sine = np.sin(np.radians(3))
        ratio = fastibl.shadow_ratio(cube, [[*d, sine]], np.zeros(2), "cap-product")
        expected = (1 + 0.8 * d) * np.pi * sine**2 * d[2] / up
        np.testing.assert_allclose(1 - ratio, expected, rtol=0.02)


def test_look_up_is_at_the_level_of_the_caps_solid_angle():
    cube = seeded_map()
    up = reference.irradiance(cube, [0.0, 0, 1])
    for sine in (0.02, 0.1, 0.3, 0.5):
        for d in np.array([[0.0, 0, 1], [0.5, 0.3, 0.7], [-0.7, 0.1, 0.6], [0.2, -0.7, 0.6]]):
            d /= np.linalg.norm(d)
            solid_angle = 2 * np.pi * (1 - np.sqrt(1 - sine**2))
            level = np.log(solid_angle / (4 * np.pi / (6 * cube.size**2))) / np.log(4)
            hidden = cube.sample(d, level) * np.pi * sine**2 * d[2] / up
            ratio = fastibl.shadow_ratio(cube, [[*d, sine]], np.zeros(2), "cap-product")
            np.testing.assert_allclose(ratio, np.clip(1 - hidden, 0, 1), atol=1e-3)


def test_methods_on_overlapping_spheres_against_reference():
    """The paper's combinations are known to be poor here (about 0.2 RMS): kept by name, and measured."""
    mesh = torus_like_spheres(50)
    points = plane_grid(1.5, 20)
    print()
    for name, cube in [("uniform", UNIFORM), ("lamps", seeded_map())]:
        truth = reference.shadow_ratio(cube, mesh, points)
        nothing = np.sqrt(np.mean((1 - truth) ** 2))
        for method in METHODS:
            error = fastibl.shadow_ratio(cube, mesh, points, method) - truth
            rms = np.sqrt(np.mean(error**2))
            print(f"{name:8} {method:12} RMS {rms:.3f} (no shadow {nothing:.3f})")
            assert rms < 0.4
        total, product = (fastibl.shadow_ratio(cube, mesh, points, m) for m in CAPS)
        assert (total <= product + 1e-6).all()


def torus_like_spheres(count):
    """Overlapping spheres along a standing ring, as a fit to a mesh gives them."""
    angle = np.arange(count) / count * 2 * np.pi
    radius = 0.14 + 0.02 * np.cos(5 * angle)
    return np.stack([0.35 * np.cos(angle), 0.1 * np.sin(2 * angle), 0.5 + 0.35 * np.sin(angle), radius], -1)


# Bad input: one point in each row of the table.


def test_no_light_is_flagged_and_leaves_no_shadow():
    below = np.ones((6, 16, 16, 3), np.float32) * (fastibl.texel_directions(16)[..., 2:] < 0)
    for faces in (np.zeros((6, 16, 16, 3), np.float32), below):
        shadow = fastibl.cast_shadow(fastibl.CubeMap(faces), [[0.0, 0, 1, 0.9]])
        assert shadow.no_light and (shadow.image == 1).all()
    assert not fastibl.cast_shadow(UNIFORM, [[0.0, 0, 1, 0.9]]).no_light


def test_channel_without_light_keeps_ratio_1():
    faces = np.ones((6, 16, 16, 3), np.float32) * np.float32([1, 0, 1])
    shadow = fastibl.cast_shadow(fastibl.CubeMap(faces), [[0.0, 0, 0.2, 0.3]])
    assert (shadow.image[..., 1] == 1).all() and not shadow.no_light
    assert shadow.image[..., 0].min() == 0


@pytest.mark.parametrize("method", METHODS)
def test_point_inside_or_touched_has_no_light(method):
    spheres = [[0.0, 0, 0.25, 0.5], [3, 0, 0.5, 0.5]]
    ratio = fastibl.shadow_ratio(seeded_map(), spheres, [[0.0, 0], [0.4, 0], [3, 0]], method)
    assert (ratio == 0).all()
    near = fastibl.shadow_ratio(UNIFORM, [[0.0, 0, 0, 0.5]], [[0.5001, 0.0], [0.4999, 0]], method)
    assert near[0, 0] == pytest.approx(0.5, abs=0.02)  # beside a dome half of the sky is left
    assert near[1, 0] == 0


@pytest.mark.parametrize(
    "bad",
    [
        (np.nan, 0, 1, 1),
        (0, np.nan, 1, 1),
        (0, 0, np.inf, 1),
        (0, 0, 1, np.nan),
        (0, 0, 1, np.inf),
        (0, 0, 1, 0),
        (0, 0, 0, -1),
    ],
)
def test_spheres_that_are_none_are_ignored_and_counted(bad):
    good = [0.1, 0.2, 0.4, 0.2]
    both = fastibl.cast_shadow(UNIFORM, np.array([good, bad]))
    assert both.ignored_spheres == 1
    alone = fastibl.cast_shadow(UNIFORM, np.array([good]))
    assert alone.ignored_spheres == 0
    np.testing.assert_array_equal(both.image, alone.image)
    assert (both.extent, both.centre) == (alone.extent, alone.centre)


def test_spheres_below_the_plane_are_ignored():
    points = np.concatenate([plane_grid(1, 8).reshape(-1, 2), np.zeros((1, 2))])  # the last is touched from below
    for below in [(0, 0, -1, 0.9), (0, 0, -1, 1), (0, 0, -1e6, 5)]:
        assert (fastibl.shadow_ratio(UNIFORM, np.array([below], float), points) == 1).all()
    assert fastibl.cast_shadow(UNIFORM, np.array([[0.0, 0, -1, 0.5]])).ignored_spheres == 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cover", [(0, 0, 0, 100), (0, 0, -9999.8, 1e4), (0, 0, 1e6 + 0.125, 1e6), (0, 0, 0, 3e38)])
def test_covering_all_is_exactly_0(cover, method):
    for cube in (UNIFORM, seeded_map()):
        assert (fastibl.shadow_ratio(cube, np.array([cover], float), plane_grid(1, 8), method) == 0).all()


def test_many_spheres_stay_at_0_or_above():
    same = np.tile([0.1, 0, 0.6, 0.4], (1000, 1))
    for method in CAPS:
        ratio = fastibl.shadow_ratio(seeded_map(), same, plane_grid(1, 8), method)
        assert (ratio >= 0).all() and (ratio <= 1).all() and ratio[4, 4].max() == 0
    once, often = (fastibl.shadow_ratio(seeded_map(), s, plane_grid(1, 8), "directions") for s in (same[:1], same))
    np.testing.assert_array_equal(once, often)


def test_extreme_radiance_and_far_spheres_stay_finite():
    faces = np.full((6, 16, 16, 3), 1e-20, np.float32)
    faces[4, 8, 8] = [np.inf, np.nan, -1]
    cube = fastibl.CubeMap(faces)
    spheres = np.array(
        [
            [0.0, 0, 0.5, 0.2],
            [1e30, 0, 1, 1],
            [0, 0, 1, 1e-30],
            [3e38, 3e38, 3e38, 3e38],
            [0, 0, 1e-40, 1e-41],
        ]
    )
    points = np.array([[0.0, 0], [3e38, -3e38], [1e-40, 0], [np.nan, 0], [np.inf, 1]])
    ratio = fastibl.shadow_ratio(cube, spheres, points)
    assert np.isfinite(ratio).all() and (ratio >= 0).all() and (ratio <= 1).all()
    assert (ratio[3:] == 1).all()
    shadow = fastibl.cast_shadow(cube, spheres, resolution=8)
    assert np.isfinite(shadow.image).all() and np.isfinite(shadow.extent) and np.isfinite(shadow.centre).all()
    assert (shadow.image >= 0).all() and (shadow.image <= 1).all()


def test_one_texel_faces_work():
    cube = fastibl.CubeMap(np.ones((6, 1, 1, 3)))
    for method, error in [("cap-product", 2e-3), ("directions", 0.02)]:
        ratio = fastibl.shadow_ratio(cube, [[0.0, 0, 0.5, 0.3]], np.zeros(2), method)
        np.testing.assert_allclose(ratio, 1 - 0.36, atol=error)


finite = st.floats(-2, 2, width=32)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(finite, finite, finite, st.floats(-0.5, 3, width=32)), max_size=6),
    st.sampled_from(METHODS),
    st.integers(0, 5),
)
def test_ratio_is_between_0_and_1(spheres, method, seed):
    array = np.array(spheres, np.float32).reshape(-1, 4)
    cube = seeded_map(16, seed)
    ratio = fastibl.shadow_ratio(cube, array, plane_grid(2, 6), method)
    assert (ratio >= 0).all() and (ratio <= 1).all()
    more = np.concatenate([array, [[0.3, 0.1, 0.5, 0.4]]])
    assert (fastibl.shadow_ratio(cube, more, plane_grid(2, 6), method) <= ratio + 1e-6).all()


# The map.


def test_map_is_the_ratio_at_its_texels_and_fades_at_its_border():
    spheres, cube = torus_like_spheres(20), seeded_map()
    shadow = fastibl.cast_shadow(cube, spheres, resolution=40, extent=2.0, centre=(0.5, -0.25), method="cap-sum")
    assert shadow.image.shape == (40, 40, 3) and shadow.image.dtype == np.float32
    assert shadow.extent == 2 and shadow.centre == (0.5, -0.25)
    points = plane_grid(2, 40) + [0.5, -0.25]
    ratio = fastibl.shadow_ratio(cube, spheres, points, "cap-sum")
    np.testing.assert_allclose(shadow.image[4:-4, 4:-4], ratio[4:-4, 4:-4], atol=2e-6)
    np.testing.assert_allclose(shadow.sample(points), shadow.image, atol=2e-5)
    image = shadow.image
    for border in (image[0], image[-1], image[:, 0], image[:, -1]):
        assert (border == 1).all()
    assert (image >= ratio - 1e-6).all()
    assert (shadow.sample([[2.6, 0.0], [0.5, -2.3], [np.nan, 0]]) == 1).all()
    with pytest.raises(ValueError):
        image[0, 0, 0] = 0


def test_map_frames_the_spheres_by_default():
    shadow = fastibl.cast_shadow(UNIFORM, [[1.0, 2, 0.5, 0.5], [2, 2, 0.5, 0.5]])
    assert shadow.centre == (1.5, 2) and shadow.extent == 3
    empty = fastibl.cast_shadow(UNIFORM, np.zeros((0, 4)))
    assert (empty.image == 1).all() and empty.extent == 1
    assert shadow == fastibl.cast_shadow(UNIFORM, [[1.0, 2, 0.5, 0.5], [2, 2, 0.5, 0.5]])
    assert shadow != empty and "64 x 64" in repr(shadow)


def test_threads_give_the_same_bits():
    before = fastibl.threads()
    try:
        results = []
        for count in (1, 2):
            fastibl.set_threads(count)
            shadow = fastibl.cast_shadow(seeded_map(), torus_like_spheres(50), resolution=100)
            ratio = fastibl.shadow_ratio(seeded_map(), torus_like_spheres(50), plane_grid(1, 33))
            results.append((shadow.image.tobytes(), ratio.tobytes()))
        assert results[0] == results[1]
    finally:
        fastibl.set_threads(before)


def test_light_is_scale_free():
    spheres, points = torus_like_spheres(10), plane_grid(1, 8)
    faces = np.array(seeded_map().faces)
    a = fastibl.shadow_ratio(fastibl.CubeMap(faces), spheres, points)
    for scale in (1e-15, 1e6):
        b = fastibl.shadow_ratio(fastibl.CubeMap(faces * np.float32(scale)), spheres, points)
        np.testing.assert_allclose(a, b, atol=2e-5)


def test_float_types_strides_and_shapes():
    spheres, points = np.array([[0.0, 0, 0.5, 0.3]]), plane_grid(1, 6)
    expected = fastibl.shadow_ratio(UNIFORM, spheres, points)
    assert expected.shape == (6, 6, 3) and expected.dtype == np.float32
    for dtype in (np.float16, np.float32, np.float64):
        got = fastibl.shadow_ratio(UNIFORM, spheres.astype(dtype), points.astype(dtype))
        np.testing.assert_allclose(got, expected, atol=2e-3)
    strided = np.zeros((6, 12, 3))
    strided[:, ::2, :2] = points
    np.testing.assert_array_equal(fastibl.shadow_ratio(UNIFORM, spheres, strided[:, ::2, :2]), expected)
    assert fastibl.shadow_ratio(UNIFORM, spheres, np.zeros((0, 2))).shape == (0, 3)
    assert fastibl.shadow_ratio(UNIFORM, np.zeros((0, 4)), np.zeros(2)).tolist() == [1, 1, 1]


def test_what_is_refused():
    good, points = np.array([[0.0, 0, 0.5, 0.3]]), np.zeros((3, 2))
    for spheres in (np.zeros(4), np.zeros((2, 3)), np.zeros((1, 2, 4))):
        with pytest.raises(ValueError, match=r"spheres must have shape \(m, 4\), got"):
            fastibl.shadow_ratio(UNIFORM, spheres, points)
    with pytest.raises(ValueError, match=r"points must have shape \(..., 2\), got"):
        fastibl.shadow_ratio(UNIFORM, good, np.zeros((3, 3)))
    with pytest.raises(TypeError, match="dtype"):
        fastibl.shadow_ratio(UNIFORM, good.astype(int), points)
    with pytest.raises(TypeError, match="dtype"):
        fastibl.shadow_ratio(UNIFORM, good, points.astype(int))
    with pytest.raises(TypeError):
        fastibl.shadow_ratio(UNIFORM, 1.0, points)
    with pytest.raises(TypeError):
        fastibl.shadow_ratio(np.ones((6, 4, 4, 3)), good, points)
    with pytest.raises(ValueError, match='no shadow method "sum"; there are: cap-sum, cap-product'):
        fastibl.shadow_ratio(UNIFORM, good, points, method="sum")
    for resolution in (1, -3, 10**5):
        with pytest.raises(ValueError, match="resolution"):
            fastibl.cast_shadow(UNIFORM, good, resolution=resolution)
    for extent in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="extent"):
            fastibl.cast_shadow(UNIFORM, good, extent=extent)
    with pytest.raises(ValueError, match="centre"):
        fastibl.cast_shadow(UNIFORM, good, centre=(1.0, 2.0, 3.0))
    with pytest.raises(ValueError, match="centre"):
        fastibl.cast_shadow(UNIFORM, good, centre=(np.nan, 2.0))
