"""Every method of light on extreme maps, both back ends: finite, never negative, right where the answer is known."""

from functools import cache

import numpy as np
import pytest
from test_gl import FILTER_ERROR

import fastibl
from conftest import SHARED
from fastibl.extremes import worlds
from fastibl.extremes.worlds import grazing

SUN = SHARED / "hdri-sun"
GLOSSY_EXPONENTS = (0.0, 1e-3, 1.0, 64.0, 1e6, np.inf)
REAL = "a real sun"


@cache
def map_named(name):
    if name != REAL:
        return worlds.map_named(name)
    files = sorted(SUN.glob("*.hdr"))
    if not files:
        pytest.skip(f"no map with a sun under {SUN}")
    return fastibl.read_environment(files[0], size=64)


def check(light, cube, constant, tolerance):
    assert np.isfinite(light).all() and (light >= 0).all()
    # A lobe is a mean of the map, to what the fits and their lobes overshoot.
    assert (light <= 1.5 * cube.faces.max(axis=(0, 1, 2))).all()
    if constant is not None:
        np.testing.assert_allclose(light, constant, rtol=tolerance)


@pytest.mark.parametrize("name", [*worlds.MAPS, REAL])
@pytest.mark.parametrize("method", fastibl.methods("diffuse"), ids=str)
def test_diffuse_extremes(name, method):
    cube = map_named(name)
    n, _ = grazing()
    e = fastibl.Lighting(cube, diffuse=method).irradiance(n)
    check(e / np.pi, cube, worlds.CONSTANT.get(name), 0.035 if method.name == "six-face" else 2e-6)


@pytest.mark.parametrize("name", [*worlds.MAPS, REAL])
@pytest.mark.parametrize("method", fastibl.methods("glossy"), ids=str)
def test_glossy_extremes(name, method):
    cube = map_named(name)
    n, v = grazing()
    lighting = fastibl.Lighting(cube, glossy=method)
    for s in GLOSSY_EXPONENTS:
        # Of 1e-30, sums are denormal where lobes graze.
        check(lighting.glossy(n, v, s), cube, worlds.CONSTANT.get(name), 1e-5 if "1e-30" in name else 2e-6)
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
    return worlds.ball_mesh()


# Half floats hold no less than 1e-8 of a map's mean.
@pytest.mark.parametrize("name", [n for n in [*worlds.MAPS, REAL] if "1e-30" not in n])
@pytest.mark.parametrize("methods", ["auto", "paper"])
@pytest.mark.parametrize("material", MATERIALS)
def test_back_ends(name, material, methods, ball):
    """The shaded ball: finite and never negative on both, and the same where half floats are not in the way."""
    camera = fastibl.Camera(64, 64, 60, 60, 32, 32)
    eye = np.array([[1, 0, 0, 0], [0, 0, -1, 0.06], [0, 1, 0, 0.25], [0, 0, 0, 1.0]])
    scene = fastibl.Scene(ball, MATERIALS[material], spheres=0, visibility_rays=0)
    layers = []
    for backend in ("cpu", "gl"):
        try:
            session = fastibl.Session(
                scene, fastibl.Rig(camera), environment=map_named(name), methods=methods, backend=backend, error=0
            )
        except RuntimeError as error:
            assert layers
            pytest.skip(str(error))
        session.process(fastibl.Frame(time=0.0, back_from_marker=eye))
        rgba = session.object.rgba
        full = rgba[rgba[..., 3] == 1][:, :3]
        assert len(full) > 400
        assert np.isfinite(full).all() and (full >= 0).all()
        if name in worlds.CONSTANT and methods == "auto":
            np.testing.assert_allclose(full, worlds.CONSTANT[name], rtol=2e-5)
        layers.append(rgba)
    cpu, gl = layers
    assert cpu.shape == gl.shape
    difference = np.abs(cpu - gl).max(axis=-1)
    print(
        f"{name}, {material}, {methods}: GL {np.quantile(difference, 0.99) / max(cpu.max(), 1e-30):.1e} of the largest"
    )
    assert np.quantile(difference, 0.99) <= max(2e-3, FILTER_ERROR) * max(float(cpu.max()), 1e-30)


@pytest.mark.parametrize("length", [1e-38, 1e-25, 1e-16, 1e16, 1e20, 1e38])
def test_normals_of_any_length_are_normalised(length):
    faces = np.full((6, 8, 8, 3), 0.2, np.float32)
    faces[4] = 2.0
    lighting = fastibl.Lighting(fastibl.CubeMap(faces))
    normal, view = np.array([0.36, 0.48, 0.8]), np.array([0.0, 0.6, 0.8])
    for found, expected in (
        (lighting.irradiance(length * normal), lighting.irradiance(normal)),
        (lighting.glossy(length * normal, length * view), lighting.glossy(normal, view)),
        (lighting.ggx(length * normal, length * view), lighting.ggx(normal, view)),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-4)


@pytest.mark.parametrize("length", [3.4028235677973366e38, 1e39, np.inf])
def test_directions_that_are_no_floats_are_those_of_their_largest_parts(length):
    """3.4028235677973366e38 is a number in 64 bits, and infinite in 32."""
    faces = np.full((6, 8, 8, 3), 0.2, np.float32)
    faces[4] = 2.0
    lighting = fastibl.Lighting(fastibl.CubeMap(faces))
    given, meant, view = np.array([length, 1.0, -length]), np.array([1.0, 0.0, -1.0]), np.array([0.0, 0.6, -0.8])
    with np.errstate(over="ignore"):
        for found, expected in (
            (lighting.irradiance(given), lighting.irradiance(meant)),
            (lighting.glossy(given, view), lighting.glossy(meant, view)),
            (lighting.ggx(view, given), lighting.ggx(view, meant)),
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-4)
