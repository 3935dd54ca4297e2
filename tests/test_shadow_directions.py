"""The shadow of spheres by directions of equal energy: against the oracle, under changing light, under bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fastibl
from fastibl import reference

UNIFORM = fastibl.CubeMap(np.ones((6, 32, 32, 3)))


def lamps(size=64, seed=0, count=4, ambient=0.2):
    """Soft light with strong lamps, another one in each channel."""
    directions = fastibl.texel_directions(size).astype(np.float64)
    rng = np.random.default_rng(seed)
    faces = ambient * (1 + 0.5 * directions)
    for _ in range(count):
        axis = rng.normal(size=3)
        axis[2] = abs(axis[2]) + 0.3
        axis /= np.linalg.norm(axis)
        faces = faces + 5 * rng.random(3) * np.exp(60 * (directions @ axis - 1))[..., None]
    return fastibl.CubeMap(faces)


def grid(extent, n):
    g = ((np.arange(n) + 0.5) / n * 2 - 1) * extent
    return np.stack(np.meshgrid(g, g), -1)


def ring(count):
    """Overlapping spheres along a standing ring, some cut by the plane."""
    angle = np.arange(count) / count * 2 * np.pi
    radius = 0.14 + 0.02 * np.cos(5 * angle)
    return np.stack([0.35 * np.cos(angle), 0.1 * np.sin(2 * angle), 0.45 + 0.35 * np.sin(angle), radius], -1)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def test_error_falls_with_the_number_of_directions():
    points, spheres, cube = grid(1.5, 24), ring(50), lamps()
    truth = reference.shadow_ratio(cube, spheres, points)
    print(f"\nno shadow: RMS {rms(1 - truth):.4f}")
    errors = {}
    for count, goal in [(16, 0.06), (64, 0.02), (256, 0.006), (1024, 0.003)]:
        e = fastibl.shadow_ratio(cube, spheres, points, "directions", directions=count) - truth
        errors[count] = rms(e)
        print(f"K={count}: RMS {errors[count]:.4f}, max {np.abs(e).max():.4f}")
        assert errors[count] < goal
    assert errors[1024] < errors[256] < errors[64] < errors[16]


@pytest.mark.parametrize(
    "sphere",
    [
        (0, 0, 0.2, 0.3),  # cut by the plane
        (0, 0, -0.1, 0.25),  # its centre below
        (0, 0, 0.25, 0.25),  # tangent
        (0.3, -0.2, 1.0, 0.4),
        (0, 0, -9999.8, 1e4),  # a crest of 0.2
        (0, 0, 50, 30),
    ],
)
def test_map_bits_are_what_the_points_say(sphere):
    """The scan conversion against a direct test in double: the same at every texel, but on an edge."""
    cube, spheres = lamps(32), np.array([sphere], np.float64)
    shadow = fastibl.cast_shadow(cube, spheres, resolution=96, extent=1.5, centre=(0.1, 0), outer=False)
    image = shadow.image[6:-6, 6:-6]
    points = (grid(1.5, 96) + [0.1, 0])[6:-6, 6:-6]
    direct = fastibl.shadow_ratio(cube, spheres, points)
    different = (np.abs(image - direct) > 1e-6).any(axis=-1)
    print(f"{sphere}: {different.sum()} of {different.size} texels differ")
    assert different.sum() <= 3  # a bit of one direction, at its very edge
    assert np.abs(image - direct).max() <= 0.03


def test_saturated_lamps_are_right_in_each_channel():
    directions = fastibl.texel_directions(128).astype(np.float64)
    faces = np.full((6, 128, 128, 3), 1e-3)
    for channel, axis in [(0, [0.5, 0.2, 0.6]), (2, [-0.6, 0.3, 0.5])]:
        axis = np.array(axis) / np.linalg.norm(axis)
        faces[..., channel] += 8 * np.exp(150 * (directions @ axis - 1))
    faces[..., 1] = 1e-3
    cube, spheres, points = fastibl.CubeMap(faces), ring(50), grid(1.5, 20)
    truth = reference.shadow_ratio(cube, spheres, points)
    error = fastibl.shadow_ratio(cube, spheres, points, directions=256) - truth
    print("\nRMS of red, green, blue:", np.sqrt((error**2).mean((0, 1))).round(5), "max", np.abs(error).max((0, 1)))
    assert (np.sqrt((error**2).mean((0, 1)))[[0, 2]] < 0.005).all()
    assert np.sqrt((error**2).mean((0, 1)))[1] < 0.012  # dim, and not where the lamps are


def test_directions_and_shares():
    directions, shares = fastibl.light_directions(lamps(), 256)
    assert directions.shape == shares.shape == (256, 3) and directions.dtype == shares.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=1e-6)
    np.testing.assert_allclose(shares.sum(axis=0), 1, atol=1e-6)
    assert (directions[:, 2] > 0).all() and (shares >= 0).all()
    largest = shares.max(axis=-1)
    print(f"\nlargest share by the mean: {largest.max() / largest.mean():.2f}")
    assert largest.max() < 2.5 * largest.mean()
    for count in (8, 100, 1000):
        assert len(fastibl.light_directions(lamps(), count)[0]) == count
    dark = fastibl.CubeMap(np.zeros((6, 8, 8, 3)))
    assert fastibl.light_directions(dark)[0].shape == (0, 3)
    a, b = (fastibl.light_directions(lamps(), 64) for _ in range(2))
    np.testing.assert_array_equal(a, b)
    for count in (7, 4097, 0, -1):
        with pytest.raises(ValueError, match="directions must be from 8 to 4096"):
            fastibl.light_directions(UNIFORM, count)


@pytest.mark.parametrize("size", [1, 2, 3, 5, 15, 16, 33, 100, 130])
def test_any_size_of_map(size):
    faces = 1 + 0.5 * fastibl.texel_directions(size)
    cube, spheres, points = fastibl.CubeMap(faces), ring(20), grid(1, 9)
    ratio = fastibl.shadow_ratio(cube, spheres, points)
    fine = fastibl.shadow_ratio(fastibl.CubeMap(1 + 0.5 * fastibl.texel_directions(64)), spheres, points)
    assert rms(ratio - fine) < (0.08 if size < 4 else 0.02)


# The map.


def test_outer_map_carries_on_without_a_seam():
    spheres, cube = ring(50), lamps()
    shadow = fastibl.cast_shadow(cube, spheres)
    assert shadow.outer.shape[0] < shadow.image.shape[0] == 128 and shadow.reach == shadow.outer_extent > shadow.extent
    assert "outer" in repr(shadow)
    # Along a line from the middle outwards through the border of the inner map.
    s = np.linspace(0.0, 1.02 * shadow.reach, 4000)
    for d in ([1, 0], [0, -1], [-0.7, 0.7], [0.9, 0.4]):
        line = s[:, None] * d + shadow.centre
        ratio = shadow.sample(line)
        at = np.argmin(np.abs(np.abs(line - shadow.centre).max(axis=-1) - shadow.extent))
        jump = np.abs(np.diff(ratio[at - 3 : at + 4], axis=0)).max()
        assert jump < 0.01
        direct = fastibl.shadow_ratio(cube, spheres, line)
        outside = np.abs(line - shadow.centre).max(axis=-1) > shadow.extent
        assert np.abs(ratio - direct)[outside].max() < 0.05
    far = shadow.centre + 1.001 * shadow.reach * np.array([[1, 0.2], [-1, 1], [0.4, -1]])
    assert (shadow.sample(far) == 1).all()
    # The bound: what lies beyond the map is no more than 1/510.
    beyond = grid(4 * shadow.reach, 80).reshape(-1, 2)
    beyond = beyond[np.abs(beyond).max(axis=-1) > shadow.reach] + shadow.centre
    left_out = 1 - fastibl.shadow_ratio(cube, spheres, beyond)
    print(f"\nextent {shadow.extent:.2f} m, outer {shadow.reach:.2f} m, left out {left_out.max():.5f}")
    assert left_out.max() <= 1 / 510
    alone = fastibl.cast_shadow(cube, spheres, outer=False)
    assert alone.outer is None and (alone.image[0] == 1).all() and alone.reach == alone.extent


def test_spheres_below_the_plane_do_not_widen_the_map():
    above, below = ring(20), [[5.0, 5.0, -2.0, 1.5]]
    assert fastibl.cast_shadow(lamps(), np.vstack([above, below])) == fastibl.cast_shadow(lamps(), above)


@pytest.mark.parametrize("method", ["cap-sum", "cap-product", "directions"])
def test_places_that_are_none_lie_in_no_shadow(method):
    points = np.array([[np.nan, 0], [0, np.inf], [0, 0]], np.float32)
    ratios = fastibl.shadow_ratio(lamps(), ring(20), points, method=method)
    assert (ratios[:2] == 1).all() and (ratios[2] < 0.5).all()


@pytest.mark.parametrize("extent", [0.1, 0.2])
def test_a_small_inner_map_joins_its_outer_one_within_the_shadow(extent):
    """The outer map is coarser: where a map ends in the midst of a shadow, the two would differ by a step."""
    shadow = fastibl.cast_shadow(lamps(), ring(50), extent=extent)
    across = np.linspace(-0.9, 0.9, 41)
    steps = extent * np.linspace(0.9, 1.1, 2000)
    lines = [d for a in across for d in ((1, a), (-1, a), (a, 1), (a, -1))]
    jumps = [np.abs(np.diff(shadow.sample(steps[:, None] * d + shadow.centre), axis=0)).max() for d in lines]
    print(f"\nextent {extent} m in {shadow.outer_extent:.2f} m: largest step {max(jumps):.3f}")
    assert max(jumps) < 0.03


def test_sample_of_many_points_is_that_of_each():
    shadow = fastibl.cast_shadow(lamps(), ring(20))
    rng = np.random.default_rng(0)
    points = (rng.normal(size=(3000, 2)) * shadow.extent + shadow.centre).astype(np.float32)
    points[:4] = [[np.nan, 0], [np.inf, 0], [0, -3e38], [0, 0]]
    many = shadow.sample(points)
    for i in range(0, 3000, 7):
        np.testing.assert_array_equal(shadow.sample(points[i]), many[i])
    assert (many[:3] == 1).all() and np.isfinite(many).all()


def test_same_bits_for_any_number_of_threads():
    before, results = fastibl.threads(), []
    try:
        for count in (1, 2):
            fastibl.set_threads(count)
            shadow = fastibl.cast_shadow(lamps(), ring(50), resolution=200)
            points = fastibl.shadow_ratio(lamps(), ring(50), grid(1, 33))
            results.append((shadow.image.tobytes(), shadow.outer.tobytes(), points.tobytes()))
        assert results[0] == results[1]
    finally:
        fastibl.set_threads(before)


# Light that changes.


def test_small_change_of_light_does_not_flicker():
    directions = fastibl.texel_directions(64).astype(np.float64)
    spheres, points = ring(50), grid(1.0, 24)
    base = lamps().faces.astype(np.float64)
    caster = fastibl.DirectionShadow(256)
    options = dict(resolution=96, extent=1.2, outer=False)
    caster.cast(fastibl.CubeMap(base), spheres, **options)
    before_truth = reference.shadow_ratio(fastibl.CubeMap(base), spheres, points)
    before = caster.cast(fastibl.CubeMap(base), spheres, **options).sample(points)
    gain = 1 + 0.02 * np.sin(3 * directions @ [0.5, 0.3, 0.8] + 1)
    changed = fastibl.CubeMap(base * gain[..., None])
    after_truth = reference.shadow_ratio(changed, spheres, points)
    after = caster.cast(changed, spheres, **options).sample(points)
    error = (after - before) - (after_truth - before_truth)
    anew = fastibl.cast_shadow(changed, spheres, **options).sample(points)
    print(
        f"\ntrue change RMS {rms(after_truth - before_truth):.5f}; error of the change RMS {rms(error):.5f}, "
        f"max {np.abs(error).max():.5f}; with directions chosen anew {rms(anew - before):.5f}"
    )
    assert rms(error) < 5e-4 and np.abs(error).max() < 3e-3


def test_no_jump_over_a_recording():
    """A lamp is slowly turned up until the directions are chosen anew: the shadow follows the light, without a jump."""
    directions = fastibl.texel_directions(32).astype(np.float64)
    spheres, points, axis = ring(12), grid(1, 7), np.array([0.5, 0.4, 0.77])
    soft = 1 + 0.5 * directions[..., :1] * [1, 0.5, 0]
    lamp = np.exp(400 * (directions @ axis / np.linalg.norm(axis) - 1))[..., None] * [1, 0.9, 0.7]
    caster, before, errors, sets = fastibl.DirectionShadow(256), None, [], set()
    for i in range(300):
        cube = fastibl.CubeMap(soft + min(i, 250) ** 2 / 1000 * lamp)
        shadow = caster.cast(cube, spheres, resolution=128, extent=1.2, outer=False)
        sets.add(len(caster.light[0]))
        now = np.stack([shadow.sample(points), reference.shadow_ratio(cube, spheres, points)])
        if before is not None:
            change, true = now - before
            errors.append((rms(change - true), np.abs(change - true).max()))
        before = now
    typical, worst = np.array(errors).T
    print(
        f"\nsets of {sorted(sets)} directions; error of a change: largest RMS {typical.max():.5f}, "
        f"largest of all {worst.max():.5f}; in the end RMS {rms(now[0] - now[1]):.4f}"
    )
    assert 512 in sets  # both, while one is faded into the other
    assert typical.max() < 5e-4 and worst.max() < 3e-3


def test_fade_ends_and_equals_a_fresh_cast():
    spheres, soft = ring(30), lamps(32, count=0)
    sun = soft.faces.copy()
    sun[4, 20, 9] += 30
    caster = fastibl.DirectionShadow(64)
    caster.cast(soft, spheres)
    for share in np.linspace(0, 1, 60):  # slowly, so that it is faded
        shadow = caster.cast(fastibl.CubeMap((1 - share) * soft.faces + share * sun), spheres)
    for _ in range(80):
        shadow = caster.cast(fastibl.CubeMap(sun), spheres)
    assert len(caster.light[0]) == 64
    again = caster.cast(fastibl.CubeMap(sun), spheres)
    assert again == shadow
    points = grid(1, 20)
    truth = fastibl.shadow_ratio(fastibl.CubeMap(sun), spheres, points, directions=1024)
    assert rms(shadow.sample(points) - truth) < 0.03
    # Another place at once: as if there had been no other.
    other = lamps(32, seed=7)
    assert caster.cast(other, spheres) == fastibl.cast_shadow(other, spheres, directions=64)


def test_nothing_changed_returns_the_same_map():
    caster, cube = fastibl.DirectionShadow(64), lamps()
    a = caster.cast(cube, ring(30))
    assert caster.cast(cube, ring(30)) == a
    moved = caster.cast(cube, ring(30) + [0.1, 0, 0, 0])
    assert moved != a and moved.centre != a.centre
    assert caster.cast(cube, ring(30)) == a
    dark = fastibl.CubeMap(np.zeros((6, 64, 64, 3)))
    assert caster.cast(dark, ring(30)).no_light and (caster.cast(dark, ring(30)).image == 1).all()
    back = caster.cast(cube, ring(30))
    assert not back.no_light and back == a


# Bad input.


def test_grazing_light_alone_casts_nothing():
    """A sun at the horizon, of which what is seen at less than 1e-3 above it does not count."""
    faces = np.zeros((6, 1024, 1024, 3), np.float32)
    z = fastibl.texel_directions(1024)[0, :, :, 2]
    sun = (z > 0) & (z < 1e-3) & (np.arange(1024) == 300)[:, None]
    assert sun.any()
    faces[0, sun] = 1e4
    shadow = fastibl.cast_shadow(fastibl.CubeMap(faces), ring(5))
    assert shadow.no_light and (shadow.image == 1).all()
    assert (fastibl.shadow_ratio(fastibl.CubeMap(faces), ring(5), grid(1, 5)) == 1).all()
    faces[4] = 1e-3
    soft = fastibl.CubeMap(np.where(faces == 1e4, 0, faces))
    low, none = (fastibl.shadow_ratio(c, ring(5), grid(1, 5)) for c in (fastibl.CubeMap(faces), soft))
    assert rms(low - none) < 0.03  # the rest counts as if it were all


def test_extreme_radiance():
    spheres, points = ring(10), grid(1, 9)
    expected = fastibl.shadow_ratio(lamps(32), spheres, points)
    for scale in (1e-15, 1e6):
        got = fastibl.shadow_ratio(fastibl.CubeMap(lamps(32).faces * np.float32(scale)), spheres, points)
        assert rms(got - expected) < 1e-3
    faces = lamps(32).faces.copy()
    faces[4, 3, 3] = [np.inf, np.nan, -5]
    ratio = fastibl.shadow_ratio(fastibl.CubeMap(faces), spheres, points)
    assert np.isfinite(ratio).all() and (ratio >= 0).all() and (ratio <= 1).all()
    one = np.zeros((6, 64, 64, 3), np.float32)
    one[4, 40, 20] = 1e5
    shadow = fastibl.cast_shadow(fastibl.CubeMap(one), spheres)
    assert np.isfinite(shadow.image).all() and shadow.image.min() == 0 and shadow.image.max() == 1


any_float = st.floats(width=32, allow_nan=True, allow_infinity=True)
near = st.floats(-2, 2, width=32)
sphere = st.one_of(st.tuples(near, near, near, st.floats(-0.5, 3, width=32)), st.tuples(*[any_float] * 4))


@settings(max_examples=150, deadline=None)
@given(st.lists(sphere, max_size=6), st.integers(2, 80), st.integers(0, 5), st.booleans())
def test_any_spheres_give_ratios_between_0_and_1(spheres, resolution, seed, outer):
    array = np.array(spheres, np.float32).reshape(-1, 4)
    cube = lamps(16, seed)
    shadow = fastibl.cast_shadow(cube, array, resolution=resolution, extent=2.0, outer=outer, directions=32)
    for image in (shadow.image, shadow.outer):
        assert image is None or (np.isfinite(image).all() and (image >= 0).all() and (image <= 1).all())
    placed = fastibl.cast_shadow(cube, array, resolution=resolution, outer=outer, directions=8)
    assert np.isfinite(placed.image).all() and np.isfinite(placed.extent) and np.isfinite(placed.outer_extent)
    ratio = fastibl.shadow_ratio(cube, array, grid(2, 6), directions=32)
    assert (ratio >= 0).all() and (ratio <= 1).all()
    more = np.concatenate([array, [[0.3, 0.1, 0.5, 0.4]]])
    assert (fastibl.shadow_ratio(cube, more, grid(2, 6), directions=32) <= ratio).all()


def test_what_is_refused():
    with pytest.raises(ValueError, match="directions must be from 8 to 4096, got 7"):
        fastibl.shadow_ratio(UNIFORM, ring(3), np.zeros(2), directions=7)
    with pytest.raises(ValueError, match="directions"):
        fastibl.DirectionShadow(5000)
    with pytest.raises(ValueError, match="directions"):
        fastibl.cast_shadow(UNIFORM, ring(3), directions=0)
    with pytest.raises(ValueError, match="must be from 8 to 4096"):
        fastibl.Session(
            fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=4),
            fastibl.Rig(fastibl.Camera(8, 8, 5, 5, 4, 4)),
            methods={"shadow": fastibl.Method("directions", directions=4)},
        )
    assert fastibl.Method("directions", directions=64).settings == {"directions": 64}
    assert fastibl.Method("directions") in fastibl.methods("shadow")


def test_results_go_where_the_caller_wants_them():
    shadow = fastibl.cast_shadow(fastibl.CubeMap(np.ones((6, 16, 16, 3))), np.array([[0, 0, 0.5, 0.5]]))
    points = np.random.default_rng(0).uniform(-3, 3, (40, 30, 2)).astype(np.float32)
    out = np.empty((40, 30, 3), np.float32)
    assert shadow.sample(points, out) is out
    np.testing.assert_array_equal(out, shadow.sample(points))
    with pytest.raises(ValueError, match="one RGB for each point"):
        shadow.sample(points, np.empty((40, 30, 2), np.float32))
    for bad in (np.empty((40, 30, 3)), out[:, ::2], [1.0]):
        with pytest.raises(TypeError, match="float32"):
            shadow.sample(points, bad)


def test_a_map_in_use_stays_as_it_is():
    caster, cube = fastibl.DirectionShadow(64), fastibl.CubeMap(np.ones((6, 16, 16, 3)))
    first = caster.cast(cube, np.array([[0, 0, 0.5, 0.5]]))
    image = np.array(first.image)
    second = caster.cast(cube, np.array([[0.3, 0, 0.5, 0.4]]))
    np.testing.assert_array_equal(first.image, image)
    assert not np.array_equal(second.image, image)
