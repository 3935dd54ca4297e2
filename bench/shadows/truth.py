"""True shadows on the plane: ten lights, four meshes, one grid of points.

The light is what a method gets: a cube map of 256 squared texels, each of one radiance over its whole area. A direction
of the truth is the centre of a texel above the horizon; a texel that holds more than 1/2000 of the plane's irradiance
in any channel of any light is cut into 8 x 8. So a sun of a few texels is an area, as it is for whoever cuts its texels
finer. Sums are in float64, for each channel by itself.

    lights()["venice_sunset"].cube      what a method gets;  .soft tells small lamps and suns from the rest
    grid()                              (4096, 2) points of the plane
    mesh_truth("spot", "uniform")       (4096, 3) ratio of the light with and without the mesh
    sphere_truth(spheres, "uniform")    (4096, 3) the same for the union of spheres (m, 4)
    errors(ratio, truth)                RMS and worst of a method's ratio

The truths of a mesh or of spheres under all lights are made at once and kept on disk by their content (bench/brute.py).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

import fastibl
from fastibl import reference

from .. import inputs
from ..brute import stored

SIZE = 256  # face edge of the lights: texels of 0.22 to 0.45 degrees
POINTS = 64  # along an edge of the grid
EXTENT = 1.5  # half the edge of the grid; an object's largest extent is 1
MESHES = ("spot", "stanford-bunny", "teapot", "suzanne")
JUDGED = MESHES[:3]  # those that goals ask for
NO_EMBREE = "rays need Embree: pip install embreex"

_BLOCK = 8  # texels are handled in squares of this edge, and bright ones are cut into as many
_LARGEST = 1 / 2000  # share of the irradiance that one direction may stand for
_ABOVE = 1e-5  # rays start this far above the plane, by the object's extent
_SUN_DIAMETER = np.radians(0.53)
_SUN_SHARE = 0.75  # of the plane's irradiance, in each channel
_SUN_ELEVATION, _SUN_AZIMUTH = np.radians(35), np.radians(140)


class Light(NamedTuple):
    cube: fastibl.CubeMap
    soft: bool  # False: half of the irradiance comes from a fraction of a percent of the sky, and shadows have edges


class Errors(NamedTuple):
    rms: float  # over points and channels
    worst: float


def errors(ratio: ArrayLike, truth: NDArray) -> Errors:
    """Of ratios (n, 3) against their truth, over all points."""
    off = np.asarray(ratio, np.float64) - truth
    return Errors(float(np.sqrt((off**2).mean())), float(np.abs(off).max()))


def errors_in_shadow(ratio: ArrayLike, truth: NDArray, covered: NDArray) -> Errors:
    """The same over what can be seen to change: points that are not covered (n,), where 1 - truth > 0.01."""
    seen = (1 - truth > 0.01).any(axis=-1) & ~covered
    return errors(np.asarray(ratio)[seen], truth[seen])


# Objects and points


def grid(count: int = POINTS, extent: float = EXTENT) -> NDArray[np.float64]:
    """Points (count^2, 2): the texel centres of a ShadowMap of this extent, row by row from y min."""
    axis = ((np.arange(count) + 0.5) / count * 2 - 1) * extent
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


@cache
def meshes() -> dict[str, fastibl.Mesh]:
    """Meshes by name, largest extent 1, standing on the plane; those that are there."""
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
    """Which points of the grid lie under a mesh."""
    origins = np.pad(grid(), ((0, 0), (0, 1)), constant_values=_ABOVE).astype(np.float32)
    return fastibl.Bvh(meshes()[name]).occluded(origins, np.broadcast_to(np.float32([0, 0, 1]), origins.shape).copy())


# Lights


@cache
def lights(size: int = SIZE) -> dict[str, Light]:
    """The seven real maps, a uniform sky, the studio map clipped, and a sun in the dawn; the uniform sky alone where
    the maps are not there."""
    found = {
        name: Light(fastibl.read_environment(path, size=size), "studio" not in name)
        for name, path in inputs.MAPS.items()
    }
    found["uniform"] = Light(fastibl.CubeMap(np.ones((6, size, size, 3), np.float32)), True)
    for name, light in list(found.items()):
        if "studio" in name:
            faces = light.cube.faces
            found["studio clipped"] = Light(fastibl.CubeMap(np.minimum(faces, np.quantile(faces, 0.99))), True)
        if name == "kiara_1_dawn":
            found["dawn and sun"] = Light(with_sun(light.cube), False)
    return found


def with_sun(cube: fastibl.CubeMap) -> fastibl.CubeMap:
    """The map and a sun of 0.53 degrees that carries 75 % of the plane's irradiance, covering texels by area."""
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
    fine, fine_angles = _pieces(cube.size, near, 32)
    inside = fine @ axis > np.cos(_SUN_DIAMETER / 2)
    disc = np.zeros(len(d))
    disc[near] = (inside * fine_angles).sum(axis=1) / fine_angles.sum(axis=1)
    flux = angles * np.maximum(d[:, 2], 0)
    strength = _SUN_SHARE / (1 - _SUN_SHARE) * (flux @ radiance) / (flux @ disc)
    return fastibl.CubeMap((radiance + disc[:, None] * strength).reshape(faces.shape))


# Directions


@cache
def _texels(size: int) -> tuple[NDArray, NDArray]:
    return reference.samples(np.zeros((6, size, size, 3)))[:2]


def _pieces(size: int, texels: NDArray, split: int) -> tuple[NDArray, NDArray]:
    """Directions (n, split^2, 3) and solid angles (n, split^2) of the pieces of some texels."""
    face, rest = np.divmod(texels, size * size)
    row, column = np.divmod(rest, size)
    edge = np.arange(split)
    t, s = np.broadcast_arrays(
        (row[:, None, None] + (edge[:, None] + 0.5) / split) / size * 2 - 1,
        (column[:, None, None] + (edge + 0.5) / split) / size * 2 - 1,
    )
    t, s = (x.reshape(len(texels), split * split, 1) for x in (t, s))
    major, right, down = (reference._FACES[face, k][:, None] for k in range(3))
    d = major + s * right + t * down
    length = np.linalg.norm(d, axis=-1)
    # Of an element ds dt of a face: ds dt / |d|^3. Over pieces this small the middle is exact to 1e-6.
    return d / length[..., None], (2 / (size * split)) ** 2 / length**3


class Sky:
    """The upper half of some maps of one size as directions: blocks of 64 that lie together, and their weights."""

    def __init__(self, cubes: Sequence[fastibl.CubeMap], largest: float = _LARGEST):
        size = cubes[0].size
        if any(c.size != size for c in cubes):
            raise ValueError("the lights must be of one size")
        directions, angles = _texels(size)
        radiance = np.hstack([c.faces.reshape(-1, 3).astype(np.float64) for c in cubes])
        flux = radiance * (angles * np.maximum(directions[:, 2], 0))[:, None]
        total = flux.sum(axis=0)
        flux /= np.where(total > 0, total, 1)
        self.dark = total <= 0
        bright = np.flatnonzero((flux > largest).any(axis=1))
        fine, fine_angles = _pieces(size, bright, _BLOCK)
        fine_flux = fine_angles * np.maximum(fine[..., 2], 0)
        fine_flux = (fine_flux / fine_flux.sum(axis=1, keepdims=True))[..., None] * flux[bright][:, None]
        flux[bright] = 0
        n = size // _BLOCK
        order = np.arange(6 * size * size).reshape(6, n, _BLOCK, n, _BLOCK).transpose(0, 1, 3, 2, 4)
        order = order.reshape(-1, _BLOCK * _BLOCK)
        order = order[(directions[order][..., 2] > 0).any(axis=1)]
        self.directions = np.concatenate([directions[order], fine])  # (blocks, 64, 3)
        self.weights = np.concatenate([flux[order], fine_flux]).reshape(-1, flux.shape[1])  # of all maps; sums are 1
        middle = self.directions.sum(axis=1)
        self.middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
        self.reach = np.einsum("bki,bi->bk", self.directions, self.middle).min(axis=1)  # cosine of a block's radius

    def ratios(self, points: NDArray, hide: Callable[[NDArray, NDArray], None], bar: bool) -> NDArray:
        """(points, maps, 3): hide(origin, hidden (blocks, 64)) sets what a point does not see to 1."""
        out = np.empty((len(points), self.weights.shape[1]))
        for i in _steps(len(points), 16, bar):
            some = points[i : i + 16]
            hidden = np.zeros((len(some), *self.directions.shape[:2]))
            for point, mine in zip(some, hidden, strict=True):
                hide(np.array([*point, 0.0]), mine)
            out[i : i + 16] = 1 - hidden.reshape(len(some), -1) @ self.weights
        out[:, self.dark] = 1
        return out.reshape(len(points), -1, 3)


def _steps(count: int, step: int, bar: bool) -> Iterator[int]:
    """0, step, ... below count, with a progress bar on stderr."""
    if bar:
        print("\ncomputing a true shadow, once: it is kept for later runs", file=sys.stderr)
    with tqdm(total=count, unit=" points", file=sys.stderr, mininterval=0.5, disable=not bar) as shown:
        for i in range(0, count, step):
            yield i
            shown.update(min(step, count - i))


def behind_mesh(sky: Sky, mesh: fastibl.Mesh) -> Callable[[NDArray, NDArray], None]:
    """Rays by Embree towards what lies within the cone of the mesh's bounding sphere. ImportError without embreex."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise ImportError(NO_EMBREE) from error
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.vertices[mesh.triangles], np.float32))
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    centre = (low + high).astype(np.float64) / 2
    radius = 1.001 * float(np.linalg.norm(mesh.vertices - centre, axis=1).max())
    above = _ABOVE * float((high - low).max())
    directions = sky.directions.astype(np.float32)
    up = sky.directions[..., 2] > 0

    def hide(origin: NDArray, hidden: NDArray) -> None:
        origin = origin + (0, 0, above)
        inside, _ = _in_caps(sky.middle, sky.reach, origin, centre[None], np.array([radius]))
        chosen = np.flatnonzero(inside[:, 0])
        d = directions[chosen].reshape(-1, 3)
        starts = np.broadcast_to(origin.astype(np.float32), d.shape).copy()
        met = scene.run(starts, d, query="OCCLUDED") >= 0
        hidden[chosen] = met.reshape(len(chosen), -1) & up[chosen]

    return hide


def _in_caps(
    middle: NDArray, reach: NDArray, origin: NDArray, centres: NDArray, radii: NDArray
) -> tuple[NDArray, NDArray]:
    """(blocks, spheres): whether some of a block may lie in a sphere's cap, and whether all of it does."""
    c = centres - origin
    distance2 = (c * c).sum(axis=1)
    around = distance2 <= radii**2
    sine = np.where(around, 1, radii / np.sqrt(np.where(around, 1, distance2)))
    cosine = np.sqrt(1 - sine * sine)
    at = middle @ (c / np.sqrt(np.maximum(distance2, 1e-300))[:, None]).T
    near, far = np.outer(reach, cosine), np.outer(np.sqrt(np.maximum(1 - reach**2, 0)), sine)
    some = at >= near - far - 1e-12  # angle <= cap + block
    whole = (at >= near + far + 1e-12) & (reach[:, None] > cosine)  # angle + block <= cap
    return some | around, whole | around


def behind_spheres(sky: Sky, given: ArrayLike) -> Callable[[NDArray, NDArray], None]:
    """A direction is hidden where it lies in the cap of any sphere; blocks decide as a whole where they can."""
    s = np.asarray(given, np.float64).reshape(-1, 4)
    s = s[np.isfinite(s).all(axis=1) & (s[:, 3] > 0) & (s[:, 2] + s[:, 3] > 0)]
    centre = s[:, :3].mean(axis=0, keepdims=True) if len(s) else np.zeros((1, 3))
    radius = np.max(np.linalg.norm(s[:, :3] - centre, axis=1) + s[:, 3], initial=0, keepdims=True)

    def hide(origin: NDArray, hidden: NDArray) -> None:
        near = np.flatnonzero(_in_caps(sky.middle, sky.reach, origin, centre, radius)[0])
        some, whole = _in_caps(sky.middle[near], sky.reach[near], origin, s[:, :3], s[:, 3])
        full = whole.any(axis=1)
        hidden[near[full]] = 1
        block, sphere = np.nonzero(some & ~full[:, None])
        if not len(block):
            return
        block = near[block]
        c = s[:, :3] - origin
        distance = np.linalg.norm(c, axis=1)
        cosine = np.sqrt(1 - (s[:, 3] / distance) ** 2)
        axis = c / distance[:, None]
        met = np.einsum("pki,pi->pk", sky.directions[block], axis[sphere]) > cosine[sphere, None]
        chosen, first = np.unique(block, return_index=True)
        hidden[chosen] = np.logical_or.reduceat(met, first, axis=0)

    return hide


# Truths, not kept and kept


def mesh_ratio(cubes: Sequence[fastibl.CubeMap], mesh: fastibl.Mesh, points: NDArray, bar: bool = False) -> NDArray:
    """Truth (points, maps, 3) for any mesh, maps of one size, and points (n, 2)."""
    sky = Sky(cubes)
    return sky.ratios(points, behind_mesh(sky, mesh), bar)


def sphere_ratio(cubes: Sequence[fastibl.CubeMap], given: ArrayLike, points: NDArray, bar: bool = False) -> NDArray:
    """Truth (points, maps, 3) for the union of any spheres (m, 4)."""
    sky = Sky(cubes)
    return sky.ratios(points, behind_spheres(sky, given), bar)


def _light_key() -> list[NDArray | Path | str]:
    code = [Path(__file__), Path(reference.__file__), np.__version__]
    return [*(light.cube.faces for light in lights().values()), *code]


@cache
def _of_mesh(name: str) -> NDArray:
    mesh, cubes = meshes()[name], [light.cube for light in lights().values()]
    return stored(
        ["mesh", mesh.vertices, mesh.triangles, *_light_key()], lambda: mesh_ratio(cubes, mesh, grid(), bar=True)
    )


@cache
def _of_spheres(content: bytes) -> NDArray:
    given = np.frombuffer(content).reshape(-1, 4)
    cubes = [light.cube for light in lights().values()]
    return stored(["spheres", given, *_light_key()], lambda: sphere_ratio(cubes, given, grid(), bar=True))


def mesh_truth(mesh: str, light: str) -> NDArray[np.float64]:
    """(4096, 3) at `grid()`. The first call for a mesh works out all lights. ImportError without embreex."""
    return _of_mesh(mesh)[:, list(lights()).index(light)]


def sphere_truth(given: ArrayLike, light: str) -> NDArray[np.float64]:
    """(4096, 3) at `grid()` for the union of spheres (m, 4). The first call for a set works out all lights."""
    content = np.ascontiguousarray(given, np.float64).reshape(-1, 4).tobytes()
    return _of_spheres(content)[:, list(lights()).index(light)]
