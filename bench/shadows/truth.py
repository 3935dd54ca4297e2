"""True shadows on the plane: ten lights, four meshes, one grid of points.

The light is what a method gets: a cube map of 256 squared texels, each of one radiance over its whole area. A direction
of the truth is the centre of a texel above the horizon; a texel that holds more than 1/2000 of the plane's irradiance
in any channel of any light is cut into 8 x 8. So a sun of a few texels is an area, as it is for whoever cuts its texels
finer. Sums are in float64, for each channel by itself.

What the texels cost, on spot: the sun of texels against a round one RMS 0.0020, at most 0.034; the studio, warehouse
and sunset maps against every pixel of the 1k pictures RMS 0.0007, 0.0003 and 0.0002, at most 0.005. Methods do not pay
it, as they get the same texels.

    lights()["venice_sunset"].cube      what a method gets;  .soft tells small lamps and suns from the rest
    grid()                              (4096, 2) points of the plane
    mesh_truth("spot", "uniform")       (4096, 3) ratio of the light with and without the mesh
    sphere_truth(spheres, "uniform")    (4096, 3) the same for the union of spheres (m, 4)
    errors(ratio, truth)                RMS and worst of a method's ratio
    kept_mesh_ratio, kept_sphere_ratio  the truth of any mesh, spheres, lights and points

The truths of a mesh or of spheres under all lights are made at once and kept on disk by their content (bench/brute.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import fastibl
from fastibl import reference
from fastibl.measuring import samples

from .. import inputs
from ..brute import finite, stored
from . import sky
from .sky import ABOVE, NO_EMBREE, mesh_ratio, sphere_ratio  # noqa: F401 - part of what this file offers

SIZE = 256  # face edge of the lights' maps: texels of 0.22 to 0.45 degrees
POINTS = 64  # points along an edge of the grid
EXTENT = 1.5  # half the edge of the grid, where an object's largest extent is 1
MESHES = ("spot", "stanford-bunny", "teapot", "suzanne")
JUDGED = MESHES[:3]  # the meshes that goals ask for

_SUN_DIAMETER = np.radians(0.53)
_SUN_SHARE = 0.75  # share of the plane's irradiance, in each channel
_SUN_ELEVATION, _SUN_AZIMUTH = np.radians(35), np.radians(140)


class Light(NamedTuple):
    cube: fastibl.CubeMap
    soft: bool  # False: half of the irradiance comes from a fraction of a percent of the sky, and shadows have edges


class Errors(NamedTuple):
    rms: float  # over points and channels
    worst: float


def errors(ratio: ArrayLike, truth: NDArray) -> Errors:
    """The errors of ratios (n, 3) against their truth, over all points."""
    off = finite(np.asarray(ratio, np.float64) - truth)
    return Errors(float(np.sqrt((off**2).mean())), float(np.abs(off).max()))


def errors_in_shadow(ratio: ArrayLike, truth: NDArray, covered: NDArray) -> Errors:
    """The same errors where a change can be seen: at points that are not covered (n,), where 1 - truth > 0.01."""
    seen = (1 - truth > 0.01).any(axis=-1) & ~covered
    return errors(np.asarray(ratio)[seen], truth[seen])


# Objects and points


def grid(count: int = POINTS, extent: float = EXTENT) -> NDArray[np.float64]:
    """Points (count^2, 2): the texel centres of a ShadowMap of this extent, row by row from y min."""
    return samples.grid(count, extent)


@cache
def meshes() -> dict[str, fastibl.Mesh]:
    """The meshes that are there, by name, with a largest extent of 1, standing on the plane."""
    return {name: standing(name) for name in MESHES if inputs.mesh_path(name).is_file()}


def standing(name: str) -> fastibl.Mesh:
    mesh = fastibl.read_mesh(inputs.mesh_path(name))
    size = np.ptp(mesh.vertices, axis=0)
    return fastibl.stand(mesh, float(size[2] / size.max()))


@cache
def spheres(name: str, count: int = 50) -> NDArray[np.float32]:
    """The spheres that fastibl fits to a mesh."""
    return fastibl.fit_spheres(meshes()[name], count)


@cache
def covered(name: str) -> NDArray[np.bool_]:
    """Whether points of the grid lie under a mesh."""
    origins = np.pad(grid(), ((0, 0), (0, 1)), constant_values=ABOVE).astype(np.float32)
    return fastibl.Bvh(meshes()[name]).occluded(
        origins, np.broadcast_to(np.array([0, 0, 1], np.float32), origins.shape).copy()
    )


# Lights


@cache
def lights(size: int = SIZE) -> inputs.ByMap[Light]:
    """The seven real maps, a uniform sky, the studio map clipped, and a sun in the dawn. If the maps are not there,
    only the uniform sky."""
    found: inputs.ByMap[Light] = inputs.ByMap()
    for name, path in inputs.MAPS.items():
        cube = fastibl.read_environment(path, size=size)
        found[name] = Light(cube, "studio" not in name and not _has_a_sun(cube))
    found["uniform"] = Light(fastibl.CubeMap(np.ones((6, size, size, 3), np.float32)), True)
    for name, light in list(found.items()):
        if "studio" in name:
            faces = light.cube.faces
            found["studio clipped"] = Light(fastibl.CubeMap(np.minimum(faces, np.quantile(faces, 0.99))), True)
        if name == "kiara_1_dawn":
            found["dawn and sun"] = Light(with_sun(light.cube), False)
    return found


def _has_a_sun(cube: fastibl.CubeMap) -> bool:
    """Whether more than a tenth of a channel's light comes from one texel of 64 squared at most, 1.4 degrees wide."""
    flux = cube.faces.astype(np.float64) * fastibl.texel_solid_angles(cube.size)[..., None]
    part = max(cube.size // 64, 1)
    n = cube.size // part
    blocks = flux.reshape(6, n, part, n, part, 3).sum(axis=(2, 4))
    return bool((blocks.max(axis=(0, 1, 2)) > 0.1 * flux.sum(axis=(0, 1, 2))).any())


def with_sun(cube: fastibl.CubeMap) -> fastibl.CubeMap:
    """The map with a sun of 0.53 degrees that carries 75 % of the plane's irradiance and covers texels by area."""
    faces = cube.faces.astype(np.float64)
    axis = np.array(
        [
            np.cos(_SUN_ELEVATION) * np.cos(_SUN_AZIMUTH),
            np.cos(_SUN_ELEVATION) * np.sin(_SUN_AZIMUTH),
            np.sin(_SUN_ELEVATION),
        ]
    )
    d, angles, radiance = reference.samples(faces)
    near = np.flatnonzero(d @ axis > np.cos(_SUN_DIAMETER / 2 + 2 / cube.size))
    fine, fine_angles = sky.pieces(cube.size, near, 32)
    inside = fine @ axis > np.cos(_SUN_DIAMETER / 2)
    disc = np.zeros(len(d))
    disc[near] = (inside * fine_angles).sum(axis=1) / fine_angles.sum(axis=1)
    flux = angles * np.maximum(d[:, 2], 0)
    strength = _SUN_SHARE / (1 - _SUN_SHARE) * (flux @ radiance) / (flux @ disc)
    return fastibl.CubeMap((radiance + disc[:, None] * strength).reshape(faces.shape))


# Truths, kept


def kept_mesh_ratio(cubes: Sequence[fastibl.CubeMap], mesh: fastibl.Mesh, points: NDArray) -> NDArray[np.float64]:
    """(points, maps, 3) for maps of one size; kept on disk under their content. ImportError without embreex."""
    return stored(
        ["mesh", mesh.vertices, mesh.triangles, *_key(cubes, points)],
        lambda: mesh_ratio(cubes, mesh, points, bar=True),
    )


def kept_sphere_ratio(cubes: Sequence[fastibl.CubeMap], given: ArrayLike, points: NDArray) -> NDArray[np.float64]:
    """(points, maps, 3) for maps of one size; kept on disk under their content."""
    array = np.ascontiguousarray(given, np.float64).reshape(-1, 4)
    return stored(["spheres", array, *_key(cubes, points)], lambda: sphere_ratio(cubes, array, points, bar=True))


def _key(cubes: Sequence[fastibl.CubeMap], points: NDArray) -> list[NDArray | Path | str]:
    return [points, *(cube.faces for cube in cubes), Path(sky.__file__)]


@cache
def _of_mesh(name: str) -> NDArray:
    return kept_mesh_ratio([light.cube for light in lights().values()], meshes()[name], grid())


@cache
def _of_spheres(content: bytes) -> NDArray:
    given = np.frombuffer(content).reshape(-1, 4)
    return kept_sphere_ratio([light.cube for light in lights().values()], given, grid())


def mesh_truth(mesh: str, light: str) -> NDArray[np.float64]:
    """(4096, 3) at `grid()`. The first call for a mesh computes all lights. ImportError without embreex."""
    return _of_mesh(mesh)[:, list(lights()).index(light)]


def sphere_truth(given: ArrayLike, light: str) -> NDArray[np.float64]:
    """(4096, 3) at `grid()` for the union of spheres (m, 4). The first call for a set computes all lights."""
    content = np.ascontiguousarray(given, np.float64).reshape(-1, 4).tobytes()
    return _of_spheres(content)[:, list(lights()).index(light)]
