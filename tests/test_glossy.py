"""Glossy methods: energy, limits, continuity, error, seams, both back ends."""

import numpy as np
import pytest
import test_gl

import fastibl
from conftest import same_error, units
from fastibl import reference

LOBES = [
    fastibl.Method("centroid", lights=0),
    fastibl.Method("centroid"),
    fastibl.Method("stretched", taps=2),
    fastibl.Method("stretched", taps=3, lights=0),
    fastibl.Method("stretched"),
    fastibl.Method("stretched", taps=4),
]
EXPONENTS = (0.0, 0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 50.0, 2048.0, 1e5, 1e6, np.inf)


def pairs(count=300, seed=0):
    n, v = units(count, seed), units(count, seed + 1)
    return n, v * np.sign((n * v).sum(axis=1, keepdims=True))


@pytest.mark.parametrize("method", LOBES, ids=str)
@pytest.mark.parametrize("size", [1, 3, 32, 128])
def test_white_furnace(method, size):
    n, v = pairs()
    for scale in (1e-8, 1.0, 1e8):
        lighting = fastibl.Lighting(fastibl.CubeMap(np.full((6, size, size, 3), scale)), glossy=method)
        for s in EXPONENTS:
            np.testing.assert_allclose(lighting.glossy(n, v, s) / np.float32(scale), 1, atol=1e-6)


@pytest.mark.parametrize("method", LOBES, ids=str)
def test_exponent_0_is_diffuse_and_infinity_the_mirror(marked, method):
    n, v = pairs()
    lighting = fastibl.Lighting(marked, glossy=method)
    np.testing.assert_allclose(lighting.glossy(n, v, 0.0), lighting.irradiance(n) / np.pi, rtol=1e-5, atol=1e-6)
    mirror = 2 * (n * v).sum(axis=1, keepdims=True) * n - v
    for s in (1e6, np.inf):
        np.testing.assert_allclose(lighting.glossy(n, v, s), marked.sample(mirror), rtol=1e-4)


@pytest.mark.parametrize("method", LOBES, ids=str)
def test_continuous_in_the_exponent(marked, method):
    """Half a per cent more exponent changes little, also where one way of looking up ends and another begins."""
    n, v = pairs()
    lighting = fastibl.Lighting(marked, glossy=method)
    for s in (1e-4, 0.999, 1.999, 3.99, 7.98, 31.9, 2047.0, 8190.0, 131000.0):
        a, b = (lighting.glossy(n, v, e) for e in (s, 1.005 * s + 1e-4))
        assert np.abs(a - b).max() < 0.03 * marked.faces.max(), s


def test_error_on_real_maps(real_maps):
    n, v = pairs(15)
    means = {str(m): [] for m in LOBES}
    for name in ("adams_place_bridge", "studio_small_03", "venice_sunset"):
        cube = real_maps[name]
        for s in (2.0, 16.0, 128.0):
            true = reference.glossy(cube, n, v, s)
            for m in LOBES:
                given = fastibl.Lighting(cube, glossy=m).glossy(n, v, s)
                means[str(m)].append(np.sqrt(((given - true) ** 2).mean(axis=1)).mean() / true.mean())
    for m, e in means.items():
        print(f"{m}: {100 * np.mean(e):.1f} %")
        assert np.mean(e) < (0.14 if "centroid" in m else 0.08)
    assert np.mean(means["stretched"]) < 0.04 and np.mean(means["centroid"]) < 0.08


@pytest.mark.parametrize("method", ["mip", "centroid", "stretched"])
def test_normalizations(marked, method):
    n, v = pairs(100)
    lighting = fastibl.Lighting(marked, glossy=method)
    cosines = (n * v).sum(axis=1)
    for s in (0.7, 5.0, 100.0):
        values = {k: lighting.glossy(n, v, s, k) for k in ("energy", "paper", "exact")}
        rho = fastibl.directional_albedo(cosines, s)[:, None]
        np.testing.assert_allclose(values["paper"], rho * values["energy"], rtol=1e-5)
        exact = (s + 2) * (s + 4) / (8 * np.pi * (2 ** (-s / 2) + s)) / ((s + 8) / (8 * np.pi))
        np.testing.assert_allclose(values["exact"], exact * values["paper"], rtol=1e-5)


def test_the_exact_factor_conserves_energy():
    white = fastibl.Lighting(fastibl.CubeMap(np.ones((6, 8, 8, 3))))
    n = np.tile([[0.0, 0, 1]], (60, 1))
    angles = np.linspace(0, np.pi / 2, 60)
    v = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    for s in (0.0, 0.3, 1.0, 5.0, 8.0, 50.0, 1000.0, 1e6, np.inf):
        assert white.glossy(n, v, s, "exact").max() < 1.003  # the table of rho
        assert abs(white.glossy(n[:1], v[:1], s, "exact")[0, 0] - 1) < 0.003


@pytest.mark.parametrize("normalization", ["energy", "paper", "exact"])
def test_the_truth_has_each_normalization(normalization):
    """Of an even map, where the lobe's average is 1 whatever the method: what is left is the factor."""
    even = fastibl.CubeMap(np.ones((6, 16, 16, 3)))
    n, v = pairs(8)
    for s in (1.0, 7.0, 60.0):
        true = reference.glossy(even, n, v, s, normalization, split=2)
        off = np.abs(fastibl.Lighting(even).glossy(n, v, s, normalization) - true).max()
        print(f"{normalization} s = {s:g}: {off:.4f}")
        assert off < 0.006


def test_albedo_table_everywhere():
    cosines = np.linspace(0, 1, 33)
    worst = np.max(
        [
            np.abs(fastibl.directional_albedo(cosines, s) - reference.directional_albedo(cosines, s)).max()
            for s in (0.0, 0.3, 1.0, 3.0, 10.0, 50.0, 300.0, 2048.0, 3e4, 1e6)
        ]
    )
    print(f"rho within {worst:.4f}")
    assert worst < 0.005


@pytest.mark.parametrize("method", LOBES, ids=str)
def test_extremes(method):
    n, v = pairs()
    grazing = np.cross(n, v)
    grazing /= np.linalg.norm(grazing, axis=1, keepdims=True)
    sun = np.full((6, 64, 64, 3), 0.2)
    sun[2, 10, 50] = 1e6
    broken = sun.copy()
    broken[0, :3] = np.nan
    broken[1, 5, 5] = np.inf
    for faces in (np.zeros((6, 16, 16, 3)), sun, broken, np.random.default_rng(0).random((6, 1, 1, 3)) ** 8):
        lighting = fastibl.Lighting(fastibl.CubeMap(faces), glossy=method)
        for views in (v, grazing, -n, n):
            for s in EXPONENTS:
                value = lighting.glossy(n, views, s)
                assert np.isfinite(value).all() and (value >= 0).all(), s
        if not faces.any():
            assert not value.any()


def test_large_faces():
    faces = np.full((6, 1024, 1024, 3), 0.5, np.float32)
    faces[0, 512, 512] = 1e5
    lighting = fastibl.Lighting(fastibl.CubeMap(faces), glossy="stretched")
    n, v = pairs(50)
    for s in EXPONENTS:
        assert np.isfinite(lighting.glossy(n, v, s)).all()


def test_no_seams():
    """Steps across the edges of the cube against steps inside faces, of mirror directions on a great circle."""
    cube = fastibl.CubeMap(np.random.default_rng(1).random((6, 64, 64, 3)) ** 4)
    lighting = fastibl.Lighting(cube, glossy="centroid")
    ratios = []
    for s in (8.0, 32.0, 512.0, 2048.0):
        across, inside = [], []
        for k in range(400):
            axes = np.roll(np.eye(3), k % 3, axis=0)
            along = np.random.default_rng(k).uniform(-0.95, 0.95)
            for offset, kept in ((0.0, across), (0.35, inside)):
                a = np.pi / 4 + offset + np.array([-0.002, 0.002])
                d = (
                    np.cos(a)[:, None] * axes[0] * np.sign(k % 2 - 0.5)
                    + np.sin(a)[:, None] * axes[1]
                    + along * 0.7 * axes[2]
                )
                d /= np.linalg.norm(d, axis=1, keepdims=True)
                kept.append(np.abs(np.diff(lighting.glossy(d, d, s), axis=0)).mean())
        ratios.append(np.mean(across) / np.mean(inside))
    print("step across edges by steps inside:", np.round(ratios, 3))
    assert max(ratios) < 1.25


@test_gl.needs_gl
@pytest.mark.parametrize("half", ["0", "1"])
@pytest.mark.parametrize("environment", ["studio", "marked"])
@pytest.mark.parametrize("method", LOBES, ids=str)
def test_gl_equals_cpu(method, environment, half, monkeypatch):
    monkeypatch.setenv("FASTIBL_GL_HALF", half)
    camera = test_gl.camera_named("pinhole")
    frame = fastibl.Frame(
        time=0.0, back=test_gl.back_picture(camera), back_from_marker=test_gl.POSES["usual"], back_exposure=0.5
    )
    cube = test_gl.MAPS[environment]()
    for s in (0.4, 2.0, 6.0, 60.0, 1500.0):
        material = fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=s)
        scene = fastibl.Scene(test_gl.torus(), material, spheres=0, visibility_rays=0)
        made = test_gl.both(scene, camera, cube, frame, {"glossy": method, "diffuse": "sh9"})
        test_gl.compare_products(made, frame.back, object_tolerance=2e-4 if half == "0" else 2e-3)


@pytest.mark.parametrize("method", fastibl.methods("glossy"), ids=str)
def test_normals_that_are_not_numbers_do_no_harm(method):
    """They read no memory outside the table of the directional albedo, which ended the process."""
    lighting = fastibl.Lighting(fastibl.CubeMap(np.ones((6, 8, 8, 3))), glossy=method)
    for normalization in ("energy", "paper", "exact"):
        got = lighting.glossy(np.full((9, 3), np.nan), [0, 0, 1], 4.0, normalization)
        assert got.shape == (9, 3) and np.isfinite(got).all()


def test_the_directional_albedo_of_any_cosine():
    beyond = fastibl.directional_albedo(np.array([np.nan, -np.inf, -2, 0, 1, 2, np.inf]), 4.0)
    np.testing.assert_array_equal(beyond, beyond[[3, 3, 3, 3, 4, 4, 4]])


def test_an_exponent_that_does_not_broadcast_is_named():
    lighting = fastibl.Lighting(fastibl.CubeMap(np.ones((6, 8, 8, 3))))
    with pytest.raises(ValueError, match=r"exponent must be a number or broadcast to \(4,\), got shape \(3,\)"):
        lighting.glossy(np.ones((4, 3)), np.ones((4, 3)), np.ones(3))


@pytest.mark.parametrize("size", [1, 8, 32, 128])
@pytest.mark.parametrize("exponent", [1, 64, 255, 2048, 1e5, 1e6])
def test_the_oracle_resolves_every_lobe_in_every_map(size, exponent):
    """In even light, Eq. 3 gives the lobe's directional albedo."""
    views = [[np.sin(a), 0, np.cos(a)] for a in np.radians([0.1, 40, 75, 85])]
    up = [[0.0, 0, 1]] * 4
    found = reference.glossy(np.ones((6, size, size, 3)), up, views, exponent, "paper")[:, 0]
    true = reference.directional_albedo([v[2] for v in views], exponent)
    assert np.abs(found / true - 1).max() < 5e-4
    faces = np.random.default_rng(size).uniform(0.5, 2, (6, size, size, 3))
    energy = reference.glossy(faces, up, views, exponent)
    assert (energy > 0.5).all() and (energy < 2).all()


def test_the_oracle_refuses_what_is_no_map_or_surface():
    up = [[0.0, 0, 1]]
    for wrong in (
        "room.hdr",
        3.0,
        np.ones((3, 3)),
        np.ones((6, 4, 8, 3)),
        np.ones((6, 8, 8, 1)),
        np.ones((6, 0, 0, 3)),
    ):
        same_error(lambda wrong=wrong: reference.irradiance(wrong, up), ValueError, "(6, n, n, 3)", "got")
    broken = np.ones((6, 4, 4, 3))
    broken[1, 2, 3] = np.nan
    same_error(lambda: reference.irradiance(broken, up), ValueError, "finite")
    even = np.ones((6, 4, 4, 3))
    for options in ({"roughness": -1}, {"roughness": np.nan}, {"anisotropy": 2}, {"alpha": (0, 0)}):
        with pytest.raises(ValueError):
            reference.ggx(even, up, up, **options)
    assert reference.directional_albedo(2.0, 8) == reference.directional_albedo(1.0, 8)
    same_error(lambda: reference.shadow_ratio(even, np.zeros((0, 4)), np.ones((2, 3))), ValueError, "(..., 2)")
    two = np.concatenate([even, 2 * even], axis=-1)
    assert reference.shadow_ratio(two, [[0, 0, 0.2, 0.1]], [[0.0, 0.0]]).shape == (1, 6)


def test_every_direction_has_its_texel():
    for size in (1, 3, 16):
        directions, _, _ = reference.samples(np.zeros((6, size, size, 3)))
        np.testing.assert_array_equal(reference.texel_of(directions, size), np.arange(6 * size**2))
