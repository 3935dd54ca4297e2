"""The ratio of light on the plane with and without an object, by directions to every part of the upper sky.

A direction is the centre of a texel above the horizon; a texel that holds more than 1/2000 of the plane's irradiance in
any channel of any map is cut into 8 x 8. Rays towards a mesh are Embree's; spheres are exact caps of the sky. Sums are
in float64, for each channel separately. Truths are kept under this file's code: see truth.py.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

import fastibl
from fastibl import reference

ABOVE = 1e-5  # rays start this far above the plane, as a share of the object's extent
NO_EMBREE = "rays need Embree: pip install embreex"

_BLOCK = 8  # edge of the squares in which texels are handled, and of those into which bright ones are cut
_LARGEST = 1 / 2000  # share of the irradiance that one direction may stand for


@cache
def texels(size: int) -> tuple[NDArray, NDArray]:
    return reference.samples(np.zeros((6, size, size, 3)))[:2]


def pieces(size: int, chosen: NDArray, split: int) -> tuple[NDArray, NDArray]:
    """Directions (n, split^2, 3) and solid angles (n, split^2) of the pieces of some texels."""
    face, rest = np.divmod(chosen, size * size)
    row, column = np.divmod(rest, size)
    edge = np.arange(split)
    t, s = np.broadcast_arrays(
        (row[:, None, None] + (edge[:, None] + 0.5) / split) / size * 2 - 1,
        (column[:, None, None] + (edge + 0.5) / split) / size * 2 - 1,
    )
    t, s = (x.reshape(len(chosen), split * split, 1) for x in (t, s))
    major, right, down = (reference._FACES[face, k][:, None] for k in range(3))
    d = major + s * right + t * down
    length = np.linalg.norm(d, axis=-1)
    # The solid angle of an element ds dt of a face is ds dt / |d|^3. For pieces this small, the middle is exact to
    # 1e-6.
    return d / length[..., None], (2 / (size * split)) ** 2 / length**3


class Sky:
    """The upper half of maps of one size, as directions: blocks of 64 neighbouring ones, and their weights."""

    def __init__(self, cubes: Sequence[fastibl.CubeMap], largest: float = _LARGEST):
        size = cubes[0].size
        if any(c.size != size for c in cubes):
            raise ValueError("the lights must be of one size")
        directions, angles = texels(size)
        radiance = np.hstack([c.faces.reshape(-1, 3).astype(np.float64) for c in cubes])
        flux = radiance * (angles * np.maximum(directions[:, 2], 0))[:, None]
        total = flux.sum(axis=0)
        flux /= np.where(total > 0, total, 1)
        self.dark = total <= 0
        bright = np.flatnonzero((flux > largest).any(axis=1))
        fine, fine_angles = pieces(size, bright, _BLOCK)
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
        """(points, maps, 3). hide(origin, hidden (blocks, 64)) sets to 1 what a point does not see."""
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


def rays(mesh: fastibl.Mesh) -> Callable[[NDArray, NDArray], NDArray[np.bool_]]:
    """A function that asks Embree which rays from one point (3,) towards (n, 3) meet a mesh. ImportError without
    embreex."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise ImportError(NO_EMBREE) from error
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.vertices[mesh.triangles], np.float32))

    def meet(origin: NDArray, directions: NDArray) -> NDArray[np.bool_]:
        starts = np.broadcast_to(origin.astype(np.float32), directions.shape).copy()
        return scene.run(starts, np.ascontiguousarray(directions, np.float32), query="OCCLUDED") >= 0

    return meet


def behind_mesh(sky: Sky, mesh: fastibl.Mesh) -> Callable[[NDArray, NDArray], None]:
    """Casts rays by Embree towards all that lies within the cone of the mesh's bounding sphere. ImportError without
    embreex."""
    meet = rays(mesh)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    centre = (low + high).astype(np.float64) / 2
    radius = 1.001 * float(np.linalg.norm(mesh.vertices - centre, axis=1).max())
    above = ABOVE * float((high - low).max())
    directions = sky.directions.astype(np.float32)
    up = sky.directions[..., 2] > 0

    def hide(origin: NDArray, hidden: NDArray) -> None:
        origin = origin + (0, 0, above)
        inside, _ = _in_caps(sky.middle, sky.reach, origin, centre[None], np.array([radius]))
        chosen = np.flatnonzero(inside[:, 0])
        met = meet(origin, directions[chosen].reshape(-1, 3))
        hidden[chosen] = met.reshape(len(chosen), -1) & up[chosen]

    return hide


def _in_caps(
    middle: NDArray, reach: NDArray, origin: NDArray, centres: NDArray, radii: NDArray
) -> tuple[NDArray, NDArray]:
    """(blocks, spheres): whether some of a block may lie in a sphere's cap, and whether the whole block does."""
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
    """Hides a direction that lies in the cap of any sphere; blocks are decided as a whole where possible."""
    s = np.asarray(given, np.float64).reshape(-1, 4)
    s = s[np.isfinite(s).all(axis=1) & (s[:, 3] > 0) & (s[:, 2] + s[:, 3] > 0)]
    centre = s[:, :3].mean(axis=0, keepdims=True) if len(s) else np.zeros((1, 3))
    radius = np.max(np.linalg.norm(s[:, :3] - centre, axis=1) + s[:, 3], initial=0, keepdims=True)

    def hide(origin: NDArray, hidden: NDArray) -> None:
        near = np.flatnonzero(_in_caps(sky.middle, sky.reach, origin, centre, radius)[0])
        some, whole = _in_caps(sky.middle[near], sky.reach[near], origin, s[:, :3], s[:, 3])
        full = np.any(whole, axis=1)
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


def mesh_ratio(cubes: Sequence[fastibl.CubeMap], mesh: fastibl.Mesh, points: NDArray, bar: bool = False) -> NDArray:
    """The true ratio (points, maps, 3) for any mesh, maps of one size, and points (n, 2)."""
    sky = Sky(cubes)
    return sky.ratios(points, behind_mesh(sky, mesh), bar)


def sphere_ratio(cubes: Sequence[fastibl.CubeMap], given: ArrayLike, points: NDArray, bar: bool = False) -> NDArray:
    """The true ratio (points, maps, 3) for the union of any spheres (m, 4)."""
    sky = Sky(cubes)
    return sky.ratios(points, behind_spheres(sky, given), bar)
