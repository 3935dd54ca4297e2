"""Diffuse light: the irradiance of surfaces, by every method."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .. import Lighting, methods, reference
from ..expected import present
from ..lighting import PAPER, Method
from ..measuring import one_core, row, seconds_text, side_by_side
from ..measuring.samples import units
from .inputs import Inputs
from .section import Section
from .spheres import strip
from .steps import CHOSEN, Result, chosen_in, compared, setting_of, step_section, worst_place
from .steps import PAPER as BY_PAPER

_WHAT = """How much light falls on a surface, depending on where it faces: what a matte object shows. A method prepares
a few numbers (or a small map) from the picture of all light, once for each change of light, and then answers for any
surface. Truth is the sum over every texel of the map. The error of a surface is the root mean square over red, green and
blue of the difference, by the mean truth of its place; what is shown is the mean over {count} random surfaces and
{places} places. Time is that of one surface, on one core, in batches from Python."""


@one_core()
def measure(inputs: Inputs) -> Section:
    effort = inputs.effort
    section = Section("diffuse", "Matte surfaces", _WHAT.format(count=effort.normals, places=len(inputs.places)))
    normals = units(effort.normals, 7)
    truths = inputs.by_place(reference.irradiance(inputs.channels, normals))
    batches = [units(effort.batch, seed).astype(np.float32) for seed in (0, 1)]
    candidates = [Method("auto"), *methods("diffuse")]
    cubes = list(inputs.places.values())
    first = {m: Lighting(cubes[0], diffuse=m) for m in candidates}

    def use(method: Method, k: int) -> NDArray:
        return first[method].irradiance(batches[k % 2])

    def fit(method: Method, k: int) -> Lighting:
        return Lighting(cubes[k % len(cubes)], diffuse=method)

    calls: dict[str, Callable[[int], object]] = {f"use {m}": partial(use, m) for m in candidates}
    calls |= {f"fit {m}": partial(fit, m) for m in candidates}
    timings, yard = side_by_side(calls, effort.rounds)
    results = []
    for m in candidates:
        lit = {name: Lighting(cube, diffuse=m) for name, cube in inputs.places.items()}
        errors, biases = compared({name: l.irradiance(normals) for name, l in lit.items()}, truths)
        name = m.name
        mark = CHOSEN if name == "auto" else BY_PAPER if name == PAPER.diffuse and not m.settings else ""
        to_fit = timings[f"fit {m}"].of_cpu
        note = chosen_in([l.methods["diffuse"] for l in lit.values()]) if name == "auto" else ""
        to_use = timings[f"use {m}"].of_cpu.scaled(effort.batch)
        results.append(
            Result(name, setting_of(m), errors, biases, to_use, mark, {"to prepare": seconds_text(to_fit.median)}, note)
        )
        case = "prepare a map of 128 squared"
        section.rows.append(row(name, case, time=to_fit, setting=setting_of(m), step="diffuse", yard=yard))
    step_section(section, "diffuse", "mean error of the irradiance", "time of one surface", results, yard)
    _, place = present(worst_place(results, CHOSEN))
    cube, paper = inputs.places[place], PAPER.diffuse
    section.strips.append(
        strip(
            f"A matte sphere in “{place}”, where the default errs most",
            2 * effort.picture,
            lambda n, _: reference.irradiance(cube.level(min(2, cube.level_count - 1)), n),
            {
                "default": lambda n, _: Lighting(cube).irradiance(n),
                "the paper's": lambda n, _: Lighting(cube, diffuse=paper).irradiance(n),
            },
        )
    )
    return section
