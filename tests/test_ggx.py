"""Lighting.ggx: energy, extremes, and error against the sum over the map."""

import numpy as np
import pytest

import fastibl
from conftest import MAPS
from fastibl import reference

ALPHAS = [(0.02, 0.02), (0.1, 0.1), (0.1, 0.4), (0.4, 0.1), (0.02, 1.0), (1.0, 1.0)]


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def surfaces(count, angles=(0, 30, 60, 75), seed=5):
    """Normals, tangents and views: `count` at each angle, with random azimuth."""
    rng = np.random.default_rng(seed)
    n = unit(rng.normal(size=(count * len(angles), 3)))
    t = unit(np.cross(n, rng.normal(size=n.shape)))
    theta, phi = np.radians(np.repeat(angles, count))[:, None], rng.uniform(0, 2 * np.pi, (len(n), 1))
    return n, t, np.cos(theta) * n + np.sin(theta) * (np.cos(phi) * t + np.sin(phi) * np.cross(n, t))


def cube_of(function, size=32):
    return fastibl.CubeMap(np.asarray(function(fastibl.texel_directions(size)), np.float32))


def soft(d):
    """Radiance that no chain blurs wrongly: low bands only."""
    return np.stack([1 + 0.5 * d[..., 0], 1 + 0.4 * d[..., 1] * d[..., 2], 1 - 0.6 * d[..., 2]], axis=-1)


WHITE = cube_of(lambda d: np.ones(d.shape))


@pytest.mark.parametrize("method", ["taps", "gradient", "sampled"])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_white_furnace(alpha, method):
    n, t, v = surfaces(200, angles=(0, 20, 40, 60, 75, 85, 89, 90, 100, 180))
    seen = fastibl.Lighting(WHITE).ggx(n, v, tangents=t, alpha=alpha, method=method)
    print(f"{alpha} {method}: furnace off by {np.abs(seen - 1).max():.1e}")
    assert np.abs(seen - 1).max() <= 1e-6


@pytest.mark.parametrize("alpha", ALPHAS)
def test_directional_albedo(alpha):
    off = []
    for degrees in (0, 30, 60, 75, 85, 89):
        for azimuth in (0.0, 0.8, np.pi / 2):
            c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            ours = fastibl.ggx_albedo(np.array([s * np.cos(azimuth), s * np.sin(azimuth), c]), alpha=alpha).sum()
            off.append(abs(ours - reference.ggx_albedo(c, alpha, azimuth)))
    worst = np.max(off)
    print(f"{alpha}: directional albedo off by {worst:.1e}")
    assert worst < 1.5e-3


def split_albedo(cosine, alpha, count=800):
    """The split sum's a and b by midpoints over half vectors: D cos dh is even in u = 1 / (1 + (tan / alpha)^2), and
    u = s^2 smooths what grazes."""
    s = ((np.arange(count) + 0.5) / count)[:, None]
    phi = (np.arange(count // 2) + 0.5) / (count // 2) * np.pi  # the other half mirrors this one
    tangent = alpha * np.sqrt(1 / s**2 - 1)
    up = 1 / np.sqrt(1 + tangent**2)
    view_half = np.sqrt(1 - cosine**2) * tangent * up * np.cos(phi) + cosine * up
    light = 2 * view_half * up - cosine
    seen = (view_half > 0) & (light > 0)
    light = np.where(seen, light, 1)
    masked = 1 + sum((np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) / 2 for c in (cosine, light))  # Smith, by height
    value = np.where(seen, 2 * s * view_half / (masked * cosine * up), 0)
    edge = (1 - np.clip(view_half, 0, 1)) ** 5
    return (value * (1 - edge)).mean(), (value * edge).mean()


def test_the_split_sum_where_the_horizon_cuts_along_a_circle():
    """Seen along the normal, or nearly so."""
    off = []
    for roughness in np.linspace(0.2, 1, 33):
        for c in (0.95, 0.99, 1.0):
            ours = fastibl.ggx_albedo(np.array([np.sqrt(1 - c**2), 0, c]), roughness)
            off.append(np.abs(ours - split_albedo(c, roughness**2)).max())
    worst = np.max(off)
    print(f"albedo off by {worst:.1e}")
    assert worst < 1e-4


def test_the_table_of_the_split_sum():
    table = fastibl.dfg_table()
    assert table.shape == (64, 64, 2) and table.dtype == np.float32
    off = []
    for row in (0, 9, 20, 40, 63):
        for column in (0, 1, 5, 20, 63):
            cosine, roughness = (column + 0.5) / 64, (row + 0.5) / 64
            true = split_albedo(cosine, max(roughness**2, 0.02))
            off.append(np.abs(table[row, column] - true).max())
    worst = np.max(off)
    print(f"DFG off by {worst:.1e}")
    assert worst < 4e-4
    assert fastibl.dfg_table(3).shape == (3, 3, 2)
    for size in (0, -1, 1025):
        with pytest.raises(ValueError, match="size"):
            fastibl.dfg_table(size)


def test_single_scattering_is_the_albedo_of_a_white_map():
    n, t, v = surfaces(10)
    seen = fastibl.Lighting(WHITE).ggx(n, v, tangents=t, alpha=(0.1, 0.4), normalization="single")
    true = reference.ggx(WHITE, n, v, tangents=t, alpha=(0.1, 0.4), normalization="single")
    assert np.abs(seen - true).max() < 2e-3
    assert true.max() < 0.9  # it does lose light


@pytest.mark.parametrize("alpha", [a for a in ALPHAS if a != (0.02, 1.0)])
def test_error_on_a_soft_map(alpha):
    cube = cube_of(soft, 64)
    n, t, v = surfaces(8)
    true = reference.ggx(cube, n, v, tangents=t, alpha=alpha)
    error = np.abs(fastibl.Lighting(cube).ggx(n, v, tangents=t, alpha=alpha) - true).max() / true.mean()
    print(f"{alpha}: worst error {100 * error:.2f} % on a soft map")
    assert error < (0.03 if max(alpha) < 1 else 0.12)  # the chain ends in texels of 90 degrees


def test_error_falls_with_taps():
    if not MAPS:
        pytest.skip("no real HDR maps beside the project")
    cube = fastibl.read_environment(MAPS[0], size=128)
    n, t, v = surfaces(12)
    true = reference.ggx(cube, n, v, tangents=t, alpha=(0.1, 0.4))
    # Lights apart hide what the look-ups do.
    lighting, error = fastibl.Lighting(cube, glossy=fastibl.Method("stretched", lights=0)), {}
    for taps in (1, 4, 8, 16):
        seen = lighting.ggx(n, v, tangents=t, alpha=(0.1, 0.4), taps=taps)
        error[taps] = np.sqrt(((seen - true) ** 2).mean(axis=-1)).mean() / true.mean()
    print("error by taps:", {k: f"{100 * e:.1f} %" for k, e in error.items()})
    assert error[16] < error[8] < error[4] < error[1] and error[8] < 0.2


@pytest.mark.parametrize("alpha", [(0.1, 0.1), (0.1, 0.4), (0.5, 0.2), (1.0, 1.0)])
def test_samples_tend_to_the_truth(alpha):
    """The error falls with the samples, without a floor."""
    cube = fastibl.CubeMap(np.random.default_rng(5).lognormal(sigma=1.5, size=(6, 32, 32, 3)).astype(np.float32))
    n, t, v = surfaces(10, angles=(0, 30, 60, 80))
    true = reference.ggx(cube, n, v, tangents=t, alpha=alpha, split=12)
    lighting, errors = fastibl.Lighting(cube), []
    for taps in (4, 16, 64, 256, 1024, 4096, 16384, 65536):
        seen = lighting.ggx(n, v, tangents=t, alpha=alpha, method="sampled", taps=taps)
        errors.append(np.sqrt(((seen - true) ** 2).mean(axis=-1)).mean() / true.mean())
    print(f"{alpha}: " + ", ".join(f"{100 * e:.2f}" for e in errors) + " %")
    assert all(after < 0.7 * before for before, after in zip(errors, errors[2:], strict=False))  # 16 times as many
    assert errors[-1] < 0.005


def test_oracle_converges():
    rng = np.random.default_rng(0)
    cube = fastibl.CubeMap(rng.uniform(0, 1, (6, 64, 64, 3)).astype(np.float32) ** 4)
    n, t, v = surfaces(2)
    for alpha in ((0.02, 0.02), (0.1, 0.4)):
        once = reference.ggx(cube, n, v, tangents=t, alpha=alpha)
        twice = reference.ggx(cube, n, v, tangents=t, alpha=alpha, split=20)
        print(f"{alpha}: default pieces of a texel against 20: {np.abs(once / twice - 1).max():.1e}")
        assert np.abs(once / twice - 1).max() < 5e-3
    equirect = fastibl.equirect_from_cubemap(cube_of(soft, 64), 128)
    a, b = (reference.ggx(m, n, v, tangents=t, alpha=(0.1, 0.4)) for m in (equirect, cube_of(soft, 64)))
    assert np.abs(a - b).max() < 2e-3


def test_roughness_and_anisotropy_are_gltf_s():
    cube = cube_of(lambda d: np.random.default_rng(1).uniform(0, 1, d.shape), 16)
    lighting = fastibl.Lighting(cube)
    n, t, v = surfaces(5)
    for roughness, anisotropy, alpha in ((0.5, 0.0, (0.25, 0.25)), (0.4, 0.6, (0.16 + 0.84 * 0.36, 0.16)),
                                         (0.0, 0.0, (0.02, 0.02)), (1.0, 1.0, (1.0, 1.0))):  # fmt: skip
        a = lighting.ggx(n, v, roughness, anisotropy, t)
        np.testing.assert_allclose(a, lighting.ggx(n, v, tangents=t, alpha=alpha), rtol=1e-5)
    each = lighting.ggx(n, v, np.linspace(0, 1, len(n)), 0.3, t)
    np.testing.assert_array_equal(each[7], lighting.ggx(n[7], v[7], np.linspace(0, 1, len(n))[7], 0.3, t[7]))


def test_light_follows_the_tangent():
    """Turning map, normals, views and tangents by a quarter about z changes nothing."""
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    n, t, v = surfaces(10)
    here = fastibl.Lighting(cube_of(soft)).ggx(n, v, tangents=t, alpha=(0.1, 0.6))
    there = fastibl.Lighting(cube_of(lambda d: soft(d @ quarter))).ggx(
        n @ quarter.T, v @ quarter.T, tangents=t @ quarter.T, alpha=(0.1, 0.6)
    )
    np.testing.assert_allclose(here, there, atol=1e-4)
    swapped = fastibl.Lighting(cube_of(soft)).ggx(n, v, tangents=np.cross(n, t), alpha=(0.6, 0.1))
    np.testing.assert_allclose(here, swapped, atol=1e-4)
    opposite = fastibl.Lighting(cube_of(soft)).ggx(n, v, tangents=-t, alpha=(0.1, 0.6))
    np.testing.assert_allclose(here, opposite, atol=1e-4)


@pytest.mark.parametrize("alpha", [(0.1, 0.1), (0.1, 0.4), (0.3, 0.35)])
def test_no_step_along_a_path(alpha):
    """A small step of view, normal or tangent frame makes a small step of light, wherever the lobe's axes turn."""
    d = fastibl.texel_directions(64)
    cube = fastibl.CubeMap((0.1 + 5 * np.exp(30 * (d @ unit(np.array([0.3, 0.5, 0.8])) - 1)))[..., None].repeat(3, -1))
    lighting, count = fastibl.Lighting(cube), 4000
    u = np.linspace(0, 1, count)[:, None]
    paths = {
        "through the normal": (np.tile([0, 0, 1.0], (count, 1)), np.hstack([u - 0.5, 0 * u, np.full_like(u, 0.7)])),
        "beside the normal": (np.tile([0, 0, 1.0], (count, 1)), np.hstack([u - 0.5, 0 * u + 1e-3, 0 * u + 0.7])),
        "along the tangent to grazing": (np.tile([0, 0, 1.0], (count, 1)), np.hstack([u, 0 * u, 1.001 - u])),
        "across the tangent to grazing": (np.tile([0, 0, 1.0], (count, 1)), np.hstack([0 * u, u, 1.001 - u])),
        "around a ball": (unit(np.hstack([np.cos(6 * u), np.sin(6 * u), 0.3 + u])), 0 * u + np.array([0.2, 0.3, 1.0])),
    }  # fmt: skip
    for name, (n, v) in paths.items():
        light = lighting.ggx(n, unit(v), tangents=np.array([1.0, 0.2, 0.1]), alpha=alpha)[:, 0]
        step = np.abs(np.diff(light)).max() / light.mean()
        print(f"{alpha} {name}: largest of {count} steps {100 * step:.2f} % of the mean")
        assert step < 0.02


def test_extremes():
    n, t, v = surfaces(50, angles=(0, 60, 89, 90, 91, 180))
    black = fastibl.Lighting(cube_of(lambda d: np.zeros(d.shape), 8))
    for alpha in ALPHAS:
        assert (black.ggx(n, v, tangents=t, alpha=alpha) == 0).all()
    faces = np.zeros((6, 64, 64, 3), np.float32)
    faces[4, 20, 30] = 1e6
    sun = fastibl.Lighting(fastibl.CubeMap(faces))
    for alpha in ALPHAS:
        light = sun.ggx(n, v, tangents=t, alpha=alpha)
        assert np.isfinite(light).all() and (light >= 0).all()
    tiny = fastibl.Lighting(cube_of(lambda d: np.ones(d.shape), 1))
    assert np.abs(tiny.ggx(n, v, alpha=(0.02, 1.0)) - 1).max() < 1e-6
    large = fastibl.Lighting(cube_of(lambda d: np.full(d.shape, 1e8), 4)).ggx(n, v, alpha=(0.1, 0.4))
    assert np.abs(large / 1e8 - 1).max() < 1e-6


def test_a_degenerate_tangent_is_any_tangent():
    lighting = fastibl.Lighting(cube_of(soft))
    n, t, v = surfaces(20)
    plain = lighting.ggx(n, v, 0.5)
    for tangents in (np.zeros(3), n, -n, np.full(3, np.nan), np.full(3, np.inf)):
        light = lighting.ggx(n, v, 0.5, 0.7, tangents=tangents)
        assert np.isfinite(light).all() and (light > 0).all()
        np.testing.assert_allclose(lighting.ggx(n, v, 0.5, tangents=tangents), plain, rtol=0.02)


@pytest.mark.parametrize("lights", [0, 3])
def test_round_lobes_together_are_those_alone(lights):
    """Round ones are worked out eight at a time; beside one that is not round, each by itself."""
    rng = np.random.default_rng(3)
    faces = cube_of(soft, 64).faces.copy()
    for face in range(lights):
        faces[face, 20:23, 30:33] += 300
    lighting = fastibl.Lighting(fastibl.CubeMap(faces))
    assert (len(lighting.lights) > 0) == (lights > 0)
    count = 1003  # no multiple of 8
    n, v = unit(rng.normal(size=(2, count, 3)))
    v[:20] = n[:20]  # head-on
    roughness = rng.uniform(0, 1, count)
    together = lighting.ggx(n, v, roughness)
    alone = lighting.ggx(
        np.vstack([n, n[:1]]), np.vstack([v, v[:1]]), np.append(roughness, 0.5), np.append(np.zeros(count), 0.4)
    )[:-1]
    off = np.abs(together - alone).max(axis=1) / alone.max(axis=1)
    print(f"{len(lighting.lights)} lights: {off.max():.1e} apart at most, median {np.median(off):.1e}")
    assert off.max() < 1e-4 and np.median(off) < 2e-6
    np.testing.assert_array_equal(together[:5], lighting.ggx(n[:5], v[:5], roughness[:5]))
    behind = lighting.ggx(n, -n, roughness)  # no direction is the view's along the surface
    assert np.isfinite(behind).all() and (behind >= 0).all()


def test_bad_input_is_named():
    lighting = fastibl.Lighting(WHITE)
    n, v = np.array([0, 0, 1.0]), np.array([0, 0, 1.0])
    for arguments, error, text in (
        (dict(roughness=1.5), ValueError, "roughness must be 0.0 to 1.0, got 1.5"),
        (dict(roughness=np.nan), ValueError, "roughness"),
        (dict(anisotropy=-0.1), ValueError, "anisotropy"),
        (dict(alpha=(0.1, 2.0)), ValueError, "alpha"),
        (dict(alpha=(0.1, 0.2, 0.3)), ValueError, "broadcast|shape"),
        (dict(method="best"), ValueError, "taps, gradient, sampled"),
        (dict(taps=0), ValueError, "taps of taps must be 1 to 16"),
        (dict(taps=17), ValueError, "1 to 16, got 17"),
        (dict(method="sampled", taps=65537), ValueError, "1 to 65536, got 65537"),
        (dict(normalization="paper"), ValueError, "energy"),
        (dict(tangents=np.zeros(2)), ValueError, "tangents"),
        (dict(roughness="rough"), TypeError, "roughness"),
    ):
        with pytest.raises(error, match=text):
            lighting.ggx(n, v, **arguments)
    with pytest.raises(TypeError, match="normals"):
        lighting.ggx(np.array([0, 0, 1]), v)


def lamp(direction, radius, size=64):
    """A round lamp of irradiance 1 on what faces it, in faint light; the texels on its rim hold a part of it."""
    d = unit(np.asarray(direction, float))
    fine = (fastibl.texel_directions(4 * size) @ d > np.cos(radius)).reshape(6, size, 4, size, 4).mean(axis=(2, 4))
    return fastibl.CubeMap((0.02 + fine[..., None] / (np.pi * np.sin(radius) ** 2) * np.ones(3)).astype(np.float32))


@pytest.mark.parametrize("radius", [0.06, 0.09])
@pytest.mark.parametrize("angle", [0, 45, 75])
def test_lights_have_their_size(angle, radius):
    """Around the mirror direction of a lamp as wide as the lobe, where its size matters most."""
    n, v = np.array([0.0, 0, 1]), np.array([np.sin(np.radians(angle)), 0, np.cos(np.radians(angle))])
    offsets = np.radians([(0, 0), (4, 0), (0, 4), (-6, 6), (10, 0), (0, 12)])
    for alpha in (0.12, 0.3):
        seen, true = [], []
        for up, aside in offsets:
            tilt = np.radians(angle) - up
            cube = lamp((-np.sin(tilt) * np.cos(aside), np.sin(aside), np.cos(tilt)), radius)
            lighting = fastibl.Lighting(cube)
            assert lighting.lights
            seen.append(lighting.ggx(n, v, alpha=(alpha, alpha))[0])
            true.append(reference.ggx(cube, n, v, alpha=(alpha, alpha))[0])
        error = np.abs(np.array(seen) - true).max() / np.max(true)
        print(f"{angle} degrees, lamp of {radius}, alpha {alpha}: {100 * error:.1f} % of the highlight")
        assert error < (0.1 if angle > 60 else 0.06)


@pytest.mark.parametrize("lobe", ["GGX", "Blinn's"])
def test_neighbouring_lights_at_grazing_angles(lobe):
    """A bright band on the horizon: look-ups far from a light of it leave none of it to be added."""
    d = fastibl.texel_directions(64)
    azimuth, height = np.arctan2(d[..., 1], d[..., 0]), np.arcsin(d[..., 2])
    band = 30 * np.exp(-(((height - 0.12) / 0.06) ** 2) - (azimuth / 0.5) ** 2)
    cube = fastibl.CubeMap((0.3 + band[..., None] * [1.0, 0.8, 0.5]).astype(np.float32))
    n, _, v = surfaces(400, angles=(70, 78))
    mirrors = ((2 * (n * v).sum(axis=1, keepdims=True) * n - v) @ [0.99, 0, 0.12]) > 0.9
    n, v = n[mirrors], v[mirrors]

    def light(of):
        return of.ggx(n, v, alpha=(0.12, 0.12)) if lobe == "GGX" else of.glossy(n, v, 100.0)

    true = (
        reference.ggx(cube, n, v, alpha=(0.12, 0.12)) if lobe == "GGX" else reference.glossy(cube, n, v, 100, split=4)
    )
    errors = []
    for count in (0, 8):
        lighting = fastibl.Lighting(cube, glossy=fastibl.Method("stretched", lights=count))
        errors.append(np.sqrt(((light(lighting) - true) ** 2).mean()) / true.mean())
    print(f"{lobe}: {100 * errors[0]:.1f} % without lights, {100 * errors[1]:.1f} % with {len(lighting.lights)}")
    assert len(lighting.lights) > 1 and errors[1] < max(1.3 * errors[0], 0.05)
