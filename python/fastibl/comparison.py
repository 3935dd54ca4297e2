"""How far an estimated environment is from the true one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import CubeMap, Environment, texel_directions, texel_solid_angles
from .expected import expect

_FINEST, _BLOCKS = 256, 32  # texels and blocks along a face's edge over which the irradiance is summed


@dataclass(frozen=True)
class Comparison:
    """Errors of the light that a matte (irradiance), a glossy (exponent 64) and a mirror sphere would show.

    rmse: relative to the true mean (1e-12 for a black one). scale_invariant_rmse: the same after the best
    common factor. angular: mean angle between estimated and true RGB, in degrees. median: median relative error of the
    irradiance over normals. Printing it gives one line per sphere.
    """

    rmse: dict[str, float]
    scale_invariant_rmse: dict[str, float]
    angular: dict[str, float]
    median: float

    def __str__(self) -> str:
        lines = [
            f"{name + ' sphere':14s} {100 * self.rmse[name]:.2f} % of the true mean (RMS), "
            f"{100 * self.scale_invariant_rmse[name]:.2f} % after the best factor, "
            f"{self.angular[name]:.2f} degrees of colour"
            for name in self.rmse
        ]
        return "\n".join([*lines, f"irradiance     {100 * self.median:.2f} %, median over normals"])


def _radiance(source: Any) -> CubeMap:
    if isinstance(source, Environment):
        return source.radiance
    expect(source, (CubeMap, np.ndarray), "a map")
    return source if isinstance(source, CubeMap) else CubeMap(source)


def level_at_most(source: Any, size: int) -> NDArray:
    """Faces (6, n, n, 3) float64 of a map's finest MIP level of at most `size` texels along an edge."""
    cube = _radiance(source)
    k = next((k for k in range(cube.level_count) if cube.level(k).shape[1] <= size), cube.level_count - 1)
    return np.asarray(cube.level(k), np.float64)


def irradiance_over_sphere(source: Any, size: int = 8) -> NDArray:
    """Irradiance (6, size, size, 3) float64 over normals, of the map's level of at most 256 squared texels.

    It is summed over blocks, each of which keeps the mean direction of its light per channel: this is wrong only where
    a block lies both above and below the horizon.
    """
    faces = level_at_most(source, _FINEST)
    pieces = max(1, _BLOCKS // faces.shape[1])
    faces = np.repeat(np.repeat(faces, pieces, axis=1), pieces, axis=2)
    n = faces.shape[1]
    directions = texel_directions(n).astype(np.float64)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    weighted = directions * texel_solid_angles(n)[None, ..., None]
    edge = max(1, n // _BLOCKS)
    starts = np.arange(0, n, edge)
    normals = texel_directions(size).reshape(-1, 3).astype(np.float64)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    out = np.empty((len(normals), 3))
    for c in range(3):
        light = np.add.reduceat(np.add.reduceat(faces[..., c, None] * weighted, starts, axis=1), starts, axis=2)
        out[:, c] = np.maximum(normals @ light.reshape(-1, 3).T, 0).sum(axis=1)
    return out.reshape(6, size, size, 3)


def relative_errors(estimated: NDArray, true: NDArray) -> NDArray:
    """RMS over RGB of the difference, divided by the true RGB mean at the same place; (...,)."""
    scale = np.maximum(true.mean(axis=-1), 1e-12)
    return np.sqrt(((estimated - true) ** 2).mean(axis=-1)) / scale


def irradiance_error(estimated: Any, true: Any) -> float:
    """Median over normals of the relative error of the estimated map's irradiance."""
    return float(np.median(relative_errors(irradiance_over_sphere(estimated), irradiance_over_sphere(true))))


def compare(estimated: Any, true: Any) -> Comparison:
    """Compare two maps (Environment, CubeMap or faces (6, n, n, 3)) by the spheres that they would light.

    Raises ValueError or TypeError for what is not a map.
    """
    from .lighting import Lighting

    a, b = _radiance(estimated), _radiance(true)
    matte = irradiance_over_sphere(a), irradiance_over_sphere(b)
    directions = texel_directions(16)
    spheres = {
        "matte": matte,
        "glossy": tuple(Lighting(m).glossy(directions, directions, exponent=64.0).astype(np.float64) for m in (a, b)),
        "mirror": (a.sample(directions).astype(np.float64), b.sample(directions).astype(np.float64)),
    }
    rmse, invariant, angular = {}, {}, {}
    for name, (x, y) in spheres.items():
        mean = y.mean() or 1e-12
        rmse[name] = float(np.sqrt(((x - y) ** 2).mean()) / mean)
        factor = (x * y).sum() / ((x * x).sum() or 1.0)
        invariant[name] = float(np.sqrt(((factor * x - y) ** 2).mean()) / mean)
        lengths = np.linalg.norm(x, axis=-1) * np.linalg.norm(y, axis=-1)
        cosine = (x * y).sum(axis=-1)[lengths > 0] / lengths[lengths > 0]
        angular[name] = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()) if cosine.size else 0.0
    return Comparison(rmse, invariant, angular, float(np.median(relative_errors(*matte))))
