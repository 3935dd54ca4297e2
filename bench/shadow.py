"""Shadow methods: error of the ratio on the plane, against rays and against the same spheres, and CPU time."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fastibl

from .measure import Row, Timing, measure, one_core, row
from .peers import cone_sum
from .shadows import truth
from .shadows.plane import seen

_COUNTS = (16, 50, 128)
_DIRECTIONS = (16, 64, 256, 1024)
_RESOLUTION = 128
_BY_MESH = f"RMS of the ratio against the mesh; seconds a map of {_RESOLUTION}^2"
_BY_SPHERES = f"RMS of the ratio against the same spheres; seconds a map of {_RESOLUTION}^2"
_PIXELS = "640 x 480 pixels"


@dataclass(frozen=True)
class Setting:
    """A method with the settings that are compared. options: those of shadow_ratio and cast_shadow."""

    method: str
    count: int  # of spheres, at most
    options: Mapping[str, Any]

    def __str__(self) -> str:
        return " ".join(f"{k}={v}" for k, v in {**self.options, "spheres": self.count}.items())

    def ratio(self, cube: fastibl.CubeMap, spheres: NDArray) -> NDArray:
        return fastibl.shadow_ratio(cube, spheres, truth.grid(), self.method, **self.options)

    def cast(self, cube: fastibl.CubeMap, spheres: NDArray) -> fastibl.ShadowMap:
        return fastibl.cast_shadow(
            cube, spheres, self.method, _RESOLUTION, truth.EXTENT, (0.0, 0.0), outer=False, **self.options
        )


def settings() -> Iterator[Setting]:
    for name in sorted({method.name for method in fastibl.methods("shadow")} - {"mesh"}):
        for count in _COUNTS:
            if name == "directions":
                yield from (Setting(name, count, {"directions": k}) for k in _DIRECTIONS)
            else:
                yield Setting(name, count, {})


def _objects() -> dict[str, fastibl.Mesh]:
    found = {name: mesh for name, mesh in truth.meshes().items() if name in truth.JUDGED}
    return found or {"figurine": fastibl.stand(fastibl.shapes.figurine(1.0), 1.0)}


@one_core()
def rows() -> list[Row]:
    """Rows for the means over the objects under each light, and over all lights."""
    lights, objects = truth.lights(), _objects()
    cubes = [light.cube for light in lights.values()]
    by_mesh = {name: truth.kept_mesh_ratio(cubes, mesh, truth.grid()) for name, mesh in objects.items()}
    spheres = {(name, n): fastibl.fit_spheres(mesh, n) for name, mesh in objects.items() for n in _COUNTS}
    by_spheres = {name: truth.kept_sphere_ratio(cubes, spheres[name, 50], truth.grid()) for name in objects}
    first = next(iter(objects))
    none = {n: [np.ones_like(t[:, k]) for t in by_mesh.values()] for k, n in enumerate(lights)}
    out = _rows("none", "", _BY_MESH, none, by_mesh)
    for s in settings():
        time = measure(lambda cube, s=s: s.cast(cube, spheres[first, s.count]), cubes, repetitions=len(cubes)).of_cpu
        ratios = {
            light: [s.ratio(cube, spheres[name, s.count]) for name in objects]
            for light, cube in zip(lights, cubes, strict=True)
        }
        out += _rows(s.method, str(s), _BY_MESH, ratios, by_mesh, time)
        if s.count == 50:
            out += _rows(s.method, str(s), _BY_SPHERES, ratios, by_spheres, time)
    for lights_ in (0, 64, 256):
        baked = {
            name: fastibl.MeshShadow(mesh, extent=truth.EXTENT, directions=lights_) for name, mesh in objects.items()
        }
        time = measure(baked[first].cast, cubes, repetitions=len(cubes)).of_cpu
        ratios = {
            light: [shadow.ratio(cube, truth.grid()) for shadow in baked.values()]
            for light, cube in zip(lights, cubes, strict=True)
        }
        out += _rows("mesh", f"directions={lights_}", _BY_MESH, ratios, by_mesh, time)
    return out + _pixels({n: spheres[first, n] for n in _COUNTS}, cubes)


def _pixels(spheres: Mapping[int, NDArray], cubes: list[fastibl.CubeMap]) -> list[Row]:
    """Times of a picture of 640 x 480 pixels of the plane, by the shadow map and by the paper's sum in every pixel."""
    points = seen()
    x, y = (np.ascontiguousarray(c) for c in points.T)
    out = []
    for count, given in spheres.items():
        ours = Setting("directions", count, {"directions": 256})
        time = measure(
            lambda cube, s=ours, g=given: s.cast(cube, g).sample(points), cubes, repetitions=len(cubes)
        ).of_cpu
        out.append(row("directions", _PIXELS, time=time, setting=str(ours)))
        try:
            cones = [cone_sum.ConeSum(cube, given) for cube in cubes]
        except RuntimeError as reason:
            print(f"per-pixel cone sum: skipped, {reason}", file=sys.stderr)
            continue
        time = measure(lambda c: c(x, y), cones, repetitions=len(cones)).of_cpu
        out.append(row("per-pixel cone sum (peer)", _PIXELS, time=time, setting=f"spheres={count}"))
    return out


def _rows(
    method: str,
    setting: str,
    metric: str,
    ratios: Mapping[str, list[NDArray]],
    true: Mapping[str, NDArray],
    time: Timing | None = None,
) -> list[Row]:
    """ratios: by light, one per object. true: by object, (points, lights, 3)."""
    errors = {
        light: float(np.mean([truth.errors(r, t[:, k]).rms for r, t in zip(given, true.values(), strict=True)]))
        for k, (light, given) in enumerate(ratios.items())
    }
    mean = float(np.mean(list(errors.values())))
    by_light = [row(method, light, metric, value, setting=setting) for light, value in errors.items()]
    return [*by_light, row(method, f"mean of {len(errors)} lights", metric, mean, time, setting=setting)]
