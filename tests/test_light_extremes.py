"""Every method of light on extreme maps, both back ends: finite, never negative, right where the answer is known."""

import numpy as np
import pytest

import fastibl
from conftest import SHARED, units

SUN = SHARED / "hdri-sun"
GLOSSY_EXPONENTS = (0.0, 1e-3, 1.0, 64.0, 1e6, np.inf)


def one_texel():
    faces = np.full((6, 32, 32, 3), 0.2)
    faces[4, 9, 20] = 1e6
    return faces


def two_suns():
    faces = np.zeros((6, 32, 32, 3))
    faces[0, 15, 16] = faces[1, 15, 16] = 1e5
    return faces


def broken():
    faces = np.ones((6, 8, 8, 3))
    faces[0, 0, 0], faces[1, 2, 3], faces[2, 4, 5], faces[3, 1, 1] = np.nan, np.inf, -np.inf, -1e4
    return faces


def sun_map():
    files = sorted(SUN.glob("*.hdr"))
    if not files:
        pytest.skip(f"no map with a sun under {SUN}")
    return fastibl.read_environment(files[0], size=64).faces


MAPS = {
    "black": lambda: np.zeros((6, 8, 8, 3)),
    "dim": lambda: np.full((6, 8, 8, 3), 1e-8),
    "bright": lambda: np.full((6, 8, 8, 3), 1e8),
    "one texel": one_texel,
    "two suns": two_suns,
    "broken": broken,
    "1 x 1": lambda: np.arange(1.0, 19.0).reshape(6, 1, 1, 3),
    "3 x 3": lambda: np.random.default_rng(0).random((6, 3, 3, 3)),
    "1024 x 1024": lambda: np.broadcast_to(np.linspace(0.1, 1, 1024)[:, None], (6, 1024, 1024, 3)),
    "a real sun": sun_map,
}
CONSTANT = {"black": 0.0, "dim": 1e-8, "bright": 1e8}
CACHE = {}


def map_named(name):
    if name not in CACHE:
        CACHE[name] = fastibl.CubeMap(MAPS[name]())
    return CACHE[name]


def directions():
    """Normals and views at 0 to 90 degrees and a little below the surface."""
    n = np.repeat(units(40, 1), 6, axis=0)
    t = np.cross(n, units(len(n), 2))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    angle = np.radians(np.tile([0, 45, 80, 89.9, 90, 91], 40))[:, None]
    return n, np.cos(angle) * n + np.sin(angle) * t


def check(light, cube, constant, tolerance):
    assert np.isfinite(light).all() and (light >= 0).all()
    # A lobe is a mean of the map, to what the fits and their lobes overshoot.
    assert (light <= 1.5 * cube.faces.max(axis=(0, 1, 2))).all()
    if constant is not None:
        np.testing.assert_allclose(light, constant, rtol=tolerance)


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize("method", fastibl.methods("diffuse"), ids=str)
def test_diffuse_extremes(name, method):
    cube = map_named(name)
    n, _ = directions()
    e = fastibl.Lighting(cube, diffuse=method).irradiance(n)
    check(e / np.pi, cube, CONSTANT.get(name), 0.035 if method.name == "six-face" else 2e-6)


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize("method", fastibl.methods("glossy"), ids=str)
def test_glossy_extremes(name, method):
    cube = map_named(name)
    n, v = directions()
    lighting = fastibl.Lighting(cube, glossy=method)
    for s in GLOSSY_EXPONENTS:
        check(lighting.glossy(n, v, s), cube, CONSTANT.get(name), 2e-6)
        paper = lighting.glossy(n, v, s, normalization="paper")
        assert np.isfinite(paper).all() and (paper >= 0).all()
    matte = lighting.irradiance(n) / np.pi
    np.testing.assert_allclose(lighting.glossy(n, v, 0.0), matte, rtol=1e-5, atol=1e-6 * matte.max())


MATERIALS = {
    "matte": fastibl.Material(diffuse=(1, 1, 1)),
    "rough": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=3),
    "glossy": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=500),
    "mirror": fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=np.inf),
}


@pytest.fixture(scope="module")
def ball():
    n = 24
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), np.linspace(0.02, np.pi - 0.02, n))
    vertices = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], -1).reshape(-1, 3)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n - 1), np.arange(2 * n), indexing="ij"))
    a, b = i * 2 * n + j, i * 2 * n + (j + 1) % (2 * n)
    c, d = a + 2 * n, b + 2 * n
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)])
    return fastibl.Mesh((0.05 * vertices + (0, 0, 0.06)).astype(np.float32), triangles)


@pytest.mark.parametrize("methods", ["auto", "paper"])
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("name", MAPS)
def test_back_ends(name, material, methods, ball):
    """The shaded ball: finite and never negative on both, and the same where half floats are not in the way."""
    camera = fastibl.Camera(64, 64, 60, 60, 32, 32)
    eye = np.array([[1, 0, 0, 0], [0, 0, -1, 0.06], [0, 1, 0, 0.25], [0, 0, 0, 1.0]])
    scene = fastibl.Scene(ball, MATERIALS[material], spheres=0, visibility_rays=0)
    layers = []
    for backend in ("cpu", "gl"):
        try:
            session = fastibl.Session(
                scene, fastibl.Rig(camera), environment=map_named(name), methods=methods, backend=backend
            )
        except RuntimeError as error:
            assert layers
            pytest.skip(str(error))
        session.process(fastibl.Frame(time=0.0, back_from_marker=eye))
        rgba = session.object.rgba
        full = rgba[rgba[..., 3] == 1][:, :3]
        assert len(full) > 400
        assert np.isfinite(full).all() and (full >= 0).all()
        if name in CONSTANT and methods == "auto":
            np.testing.assert_allclose(full, CONSTANT[name], rtol=2e-5)
        layers.append(rgba)
    cpu, gl = layers
    assert cpu.shape == gl.shape
    difference = np.abs(cpu - gl).max(axis=-1)
    print(
        f"{name}, {material}, {methods}: GL {np.quantile(difference, 0.99) / max(cpu.max(), 1e-30):.1e} of the largest"
    )
    assert np.quantile(difference, 0.99) <= 2e-3 * max(float(cpu.max()), 1e-30)
