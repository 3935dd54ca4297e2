"""The shadow on the plane: the ratio of light with and without the object, by every method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import CubeMap, MeshShadow, ShadowMap, cast_shadow
from ..comparison import level_at_most
from ..lighting import PAPER
from ..measuring import one_core, side_by_side
from ..measuring.samples import grid
from .inputs import HEIGHT, Inputs
from .section import Section, Strip
from .spheres import enlarged, tenfold
from .steps import CHOSEN, Result, step_section
from .steps import PAPER as BY_PAPER
from .visibility import Sky

_RESOLUTION = 128
_WHAT = """How much darker the table gets where the object keeps light away: a ratio between 0 and 1 for each point, by
which the camera's picture of the table is multiplied. Truth: rays from {count} points to every texel of the map above
the horizon, bright texels cut into 64. The error is the root mean square of the ratio over points and colours; no
shadow at all would err by {none}. “spheres” are what the object is replaced by (the paper's idea), “mesh” has the
object's own visibility baked beforehand. Time is that of a map of 128 × 128 ratios, on one core, in each frame in which
light or object changed."""


def _casts(inputs: Inputs, extent: float) -> dict[tuple[str, str], Callable]:
    """Functions from a map to its ShadowMap, by method and setting."""
    where: dict[str, Any] = {"resolution": _RESOLUTION, "extent": extent, "centre": (0.0, 0.0), "outer": False}
    out: dict[tuple[str, str], Callable] = {}

    def spheres(method: str, count: int, **options: Any) -> None:
        setting = " ".join(f"{k}={v}" for k, v in {**options, "spheres": count}.items())
        given = inputs.spheres(count)
        out[method, setting] = lambda cube: cast_shadow(cube, given, method, **where, **options)

    for count in (16, 50, 128):
        spheres("cap-sum", count)
        spheres("cap-product", count)
        spheres("directions", count, directions=256)
    for k in (16, 64, 1024):
        spheres("directions", 50, directions=k)
    for k in (0, 64, 256):
        baked = MeshShadow(inputs.mesh, extent=extent, directions=k)
        out["mesh", f"directions={k}"] = baked.cast
    return out


@one_core()
def measure(inputs: Inputs) -> Section:
    effort, extent = inputs.effort, 1.25 * HEIGHT
    points = grid(effort.grid, extent)
    truths = inputs.by_place(Sky(inputs).plane_ratio(inputs.mesh, points))
    none = float(np.mean([np.sqrt(((1 - t) ** 2).mean()) for t in truths.values()]))
    section = Section("shadow", "Shadow on the table", _WHAT.format(count=len(points), none=f"{none:.3f}"))
    casts, cubes = _casts(inputs, extent), list(inputs.places.values())
    default = "mesh", "directions=256"

    def call(cast: Callable, k: int) -> ShadowMap:
        return cast(cubes[k % len(cubes)])

    timings, yard = side_by_side(
        {f"{m} {s}": partial(call, cast) for (m, s), cast in casts.items()}, max(3, effort.rounds // 2)
    )
    results = []
    for (method, setting), cast in casts.items():
        errors, biases = {}, {}
        for name, cube in inputs.places.items():
            shadow: ShadowMap = cast(cube)
            ratio, true = shadow.sample(points).astype(np.float64), truths[name]
            errors[name] = float(np.sqrt(((ratio - true) ** 2).mean()))
            # The bias of the missing light: a shadow that is too weak has one below 0.
            biases[name] = float((1 - ratio).sum() / max((1 - true).sum(), 1e-12) - 1)
        mark = CHOSEN if (method, setting) == default else ""
        mark = BY_PAPER if (method, setting) == (PAPER.shadow, "spheres=50") else mark
        results.append(Result(method, setting, errors, biases, timings[f"{method} {setting}"].of_cpu, mark))
    note = "Bias: of the light that the object keeps away; below 0 the shadow is too weak."
    step_section(section, "shadow", "RMS error of the ratio", "time of a shadow map", results, yard, note)
    chosen = next(r for r in results if r.mark == CHOSEN)
    place = max(chosen.errors, key=lambda name: chosen.errors[name])
    shown = {"default": default, "the paper's": (PAPER.shadow, "spheres=50")}
    count = 36 if effort.name != "full" else 80
    points = grid(count, extent)
    coarse = CubeMap(level_at_most(inputs.places[place], 64).astype(np.float32))
    true = Sky(replace(inputs, places={place: coarse})).plane_ratio(inputs.mesh, points)
    pictures = [("truth", _picture(true, count))]
    for name, key in shown.items():
        ratio = casts[key](coarse).sample(points).astype(np.float64)
        pictures.append((name, _picture(ratio, count)))
        difference = (ratio - true).reshape(count, count, 3)[::-1]
        pictures.append((f"{name}: difference × 10", enlarged(tenfold(difference, 1.0))))
    section.strips.append(
        Strip(
            f"The table from above in “{place}”, where the default errs most",
            pictures,
            f"{200 * extent:.0f} cm wide, the object in the middle. Differences: grey is none, darker is too dark.",
        )
    )
    return section


def _picture(ratio: NDArray, count: int) -> NDArray[np.uint8]:
    """A ratio (n, 3) as a white table from above, y up."""
    linear = np.clip(ratio.reshape(count, count, 3)[::-1], 0, 1)
    return enlarged((linear ** (1 / 2.2) * 255).astype(np.uint8))
