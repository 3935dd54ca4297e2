"""Shadow methods: error of the ratio on the plane against rays, against time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import fastibl

from . import inputs
from .measure import Row, measure, one_core, row

_COUNTS = (10, 50, 200)
_SIZE = 64  # face edge of the maps: every texel above the horizon is one direction of the truth
_GRID = 18


def _points(mesh: fastibl.Mesh) -> NDArray:
    """Points (n, 2) around the object, outside its footprint."""
    axis = (np.arange(_GRID) + 0.5) / _GRID * 0.6 - 0.3
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    up = np.zeros((len(points), 3), np.float32)
    up[:, 2] = 1
    origins = np.pad(points, ((0, 0), (0, 1)), constant_values=1e-6).astype(np.float32)
    return points[~fastibl.Bvh(mesh).occluded(origins, up)]


def _rms(ratio: NDArray, true: NDArray) -> float:
    counts = (1 - true > 0.01).any(axis=-1)
    return float(np.sqrt(((ratio - true)[counts] ** 2).mean()))


def _maps() -> dict[str, fastibl.CubeMap]:
    if inputs.MAPS:
        return {name: fastibl.read_environment(path, size=_SIZE) for name, path in inputs.MAPS.items()}
    noise = np.random.default_rng(0).lognormal(sigma=2, size=(6, _SIZE, _SIZE, 3))
    return {"noise": fastibl.CubeMap(noise.astype(np.float32))}


@one_core()
def rows() -> list[Row]:
    maps = _maps()
    mesh = inputs.scene().mesh
    points = _points(mesh)
    spheres = {count: fastibl.fit_spheres(mesh, count) for count in _COUNTS}
    by_mesh = {name: fastibl.reference.shadow_ratio(cube, mesh, points) for name, cube in maps.items()}
    by_spheres = {name: fastibl.reference.shadow_ratio(cube, spheres[50], points) for name, cube in maps.items()}
    out = []
    for name, true in by_mesh.items():
        out.append(row("none", name, "RMS of the ratio against the mesh", _rms(np.ones_like(true), true)))
    for method in fastibl.methods("shadow"):
        for count, given in spheres.items():
            ratios = {n: fastibl.shadow_ratio(cube, given, points, method.name) for n, cube in maps.items()}
            time = measure(
                lambda cube, m=method.name, s=given: fastibl.cast_shadow(cube, s, m), list(maps.values()), repetitions=9
            )
            setting = f"spheres={count}"
            errors = {name: _rms(ratios[name], by_mesh[name]) for name in maps}
            metric = "RMS of the ratio against the mesh; seconds a map of 64^2"
            out += [row(method.name, name, metric, e, setting=setting) for name, e in errors.items()]
            mean = float(np.mean(list(errors.values())))
            out.append(row(method.name, f"mean of {len(maps)} maps", metric, mean, time, setting=setting))
            if count == 50:
                errors = [_rms(ratios[name], by_spheres[name]) for name in maps]
                metric = "RMS of the ratio against the same spheres"
                out.append(
                    row(method.name, f"mean of {len(maps)} maps", metric, float(np.mean(errors)), setting=setting)
                )
    return out
