"""What an object hides, by rays to every texel of a map; computed once and used for every place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import reference
from .._fastibl import Bvh, Mesh
from ..measuring import all_cores
from .inputs import Inputs

_BRIGHT = 1 / 2000  # share of the plane's irradiance, in any channel, above which a texel is cut into 8 x 8
_CUT = 8
_BATCH = 16  # points whose directions are held in memory at once


class Sky:
    """The directions of all light, and the light of each in each place; bright texels are cut finer.

    directions: (d, 3). radiance: (d, 3 k) for k places. angles: (d,) solid angles.
    """

    def __init__(self, inputs: Inputs):
        directions, angles, radiance = reference.samples(inputs.channels)
        flux = radiance * (angles * np.maximum(directions[:, 2], 0))[:, None]
        share = flux / np.maximum(flux.sum(axis=0), 1e-30)
        bright = np.flatnonzero((share > _BRIGHT).any(axis=1))
        fine, fine_angles = reference._refined(inputs.channels.shape, bright, angles, _CUT)
        rest = np.ones(len(angles), bool)
        rest[bright] = False
        self.directions = np.concatenate([directions[rest], fine.reshape(-1, 3)])
        self.angles = np.concatenate([angles[rest], fine_angles.reshape(-1)])
        self.radiance = np.concatenate([radiance[rest], np.repeat(radiance[bright], _CUT * _CUT, axis=0)])

    def without(self, mesh: Mesh, points: NDArray, normals: NDArray) -> tuple[NDArray, NDArray]:
        """Irradiance (p, 3 k) at points (p, 3) with unit normals: without the light that the mesh hides, and with all
        light."""
        with all_cores():
            return self._without(mesh, points, normals)

    def _without(self, mesh: Mesh, points: NDArray, normals: NDArray) -> tuple[NDArray, NDArray]:
        bvh = Bvh(mesh)
        centre = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
        radius = float(np.linalg.norm(mesh.vertices - centre, axis=1).max()) * 1.0001
        directions = self.directions.astype(np.float32)
        flux = (self.radiance * self.angles[:, None]).astype(np.float32)
        origins, normals = points.astype(np.float32), normals.astype(np.float32)
        seen, whole = np.empty((len(points), flux.shape[1])), np.empty((len(points), flux.shape[1]))
        for i in range(0, len(points), _BATCH):
            part = slice(i, i + _BATCH)
            weights = np.maximum(normals[part] @ directions.T, 0)
            whole[part] = weights @ flux
            # Only rays towards the mesh's bounding sphere can meet it.
            offset = centre - points[part]
            away = np.linalg.norm(offset, axis=1, keepdims=True)
            least = np.where(away > radius, np.sqrt(np.maximum(1 - (radius / away) ** 2, 0)), -1.1)
            near = (offset / away).astype(np.float32) @ directions.T > least
            for origin, asked, weight in zip(origins[part], near & (weights > 0), weights, strict=True):
                asked[asked] = bvh.occluded(origin, directions[asked])
                weight[~asked] = 0
            seen[part] = whole[part] - weights @ flux
        return seen, whole

    def plane_ratio(self, mesh: Mesh, points: NDArray) -> NDArray:
        """Ratio (p, 3 k) of the light on the plane at points (p, 2) with and without the mesh."""
        above = np.pad(np.asarray(points, np.float64), ((0, 0), (0, 1)), constant_values=1e-6)
        seen, whole = self.without(mesh, above, np.broadcast_to([0.0, 0.0, 1.0], above.shape))
        return np.where(whole > 0, seen / np.maximum(whole, 1e-30), 1.0)
