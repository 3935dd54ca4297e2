"""Glossy light: the map under a lobe around the mirror direction, by every method."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from .. import Lighting, methods, reference
from ..comparison import level_at_most
from ..lighting import PAPER, Method
from ..measuring import one_core, side_by_side
from ..measuring.samples import pairs, units
from .inputs import Inputs
from .section import Section, percent
from .spheres import strip
from .steps import CHOSEN, Result, chosen_in, compared, setting_of, step_section
from .steps import PAPER as BY_PAPER

_TIMED = 64.0
_WHAT = """What a glossy surface mirrors, blurred: the average of the light around the mirror direction, weighted by
Blinn and Phong's lobe (n·h)^s; s = 8 is rough plastic, 512 nearly a mirror. Truth is the sum over every texel of the
map, cut finer where the lobe is sharp. {count} pairs of surface and view with 0 to 85 degrees between them; exponents
{exponents}. The lobe is normalised in truth and estimate (a white room looks white). Time is that of one pair, on one
core, in batches from Python."""


@one_core()
def measure(inputs: Inputs) -> Section:
    effort = inputs.effort
    n, v = pairs(effort.pairs)
    exponents = ", ".join(str(s) for s in effort.exponents)
    section = Section("glossy", "Glossy surfaces", _WHAT.format(count=len(n), exponents=exponents))
    truths = {s: inputs.by_place(reference.glossy(inputs.channels, n, v, s)) for s in effort.exponents}
    normals, views = units(effort.batch // 2, 2).astype(np.float32), units(effort.batch // 2, 3).astype(np.float32)
    views *= np.sign((normals * views).sum(axis=1, keepdims=True))
    batches = [(normals, views), (normals[::-1].copy(), views[::-1].copy())]
    candidates = [Method("auto"), *methods("glossy")]
    lit = {m: {name: Lighting(cube, glossy=m) for name, cube in inputs.places.items()} for m in candidates}
    first = next(iter(inputs.places))

    def call(method: Method, k: int) -> NDArray:
        normals, views = batches[k % 2]
        return lit[method][first].glossy(normals, views, _TIMED)

    timings, yard = side_by_side({str(m): partial(call, m) for m in candidates}, max(3, effort.rounds // 2))
    results, by_exponent = [], {}
    for m in candidates:
        errors, biases, extra = [], [], {}
        for s in effort.exponents:
            e, b = compared({name: l.glossy(n, v, float(s)) for name, l in lit[m].items()}, truths[s])
            errors.append(e)
            biases.append(b)
            extra[f"s = {s}"] = percent(float(np.mean(list(e.values()))))
            by_exponent[m.name, setting_of(m), s] = e
        mark = CHOSEN if m.name == "auto" else BY_PAPER if m.name == PAPER.glossy and not m.settings else ""
        results.append(
            Result(
                m.name,
                setting_of(m),
                {name: float(np.mean([e[name] for e in errors])) for name in inputs.places},
                {name: float(np.mean([b[name] for b in biases])) for name in inputs.places},
                timings[str(m)].of_cpu.scaled(len(normals)),
                mark,
                extra,
                chosen_in([l.methods["glossy"] for l in lit[m].values()]) if m.name == "auto" else "",
            )
        )
    step_section(section, "glossy", "mean error of the glossy light", "time of one pair", results, yard)
    s, place = max(
        ((s, name) for s in effort.exponents for name in inputs.places),
        key=lambda k: by_exponent["auto", "", k[0]][k[1]],
    )
    cube = inputs.places[place]
    faces = level_at_most(cube, 32 if s < 100 else 64)
    section.strips.append(
        strip(
            f"A glossy sphere (exponent {s}) in “{place}”, where the default errs most",
            effort.picture,
            lambda n, v: reference.glossy(faces, n, v, s, split=1),
            {
                "default": lambda n, v: Lighting(cube).glossy(n, v, float(s)),
                "the paper's": lambda n, v: Lighting(cube, glossy=PAPER.glossy).glossy(n, v, float(s)),
            },
        )
    )
    return section
