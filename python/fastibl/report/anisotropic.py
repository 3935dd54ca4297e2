"""Rough and brushed metal: GGX, isotropic and anisotropic, by number of look-ups."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .. import Lighting, reference
from ..comparison import level_at_most
from ..measuring import one_core, side_by_side
from ..measuring.samples import VIEWS, surfaces, units
from .inputs import Inputs
from .section import Section, percent
from .spheres import strip
from .steps import CHOSEN, PAPER, Result, compared, step_section

_TAPS = (1, 2, 4, 8, 16)
_DEFAULT = 8
_WHAT = """Brushed and rough metal: the GGX lobe, which today's renderers use; alpha is its width along and across the
brushing. The paper names such surfaces as future work and suggests texture gradients (“gradient”); the default sums a
few look-ups along the lobe (“taps”); “sampled” is filtered importance sampling. Truth is the sum over every texel, cut finer under the lobe. {count} surfaces at
0 to 75 degrees, widths {alphas}. Time is that of one surface, on one core, in batches from Python."""


def _truth(inputs: Inputs, n: NDArray, t: NDArray, v: NDArray, alpha: tuple[float, float]) -> dict[str, NDArray]:
    def some(part: NDArray) -> NDArray:
        return reference.ggx(inputs.channels, n[part], v[part], tangents=t[part], alpha=alpha)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return inputs.by_place(np.concatenate(list(pool.map(some, np.array_split(np.arange(len(n)), min(8, len(n)))))))


@one_core()
def measure(inputs: Inputs) -> Section:
    effort = inputs.effort
    n, t, v = surfaces(max(1, effort.lobes // len(VIEWS)))
    shown = ", ".join(f"{a:g} × {b:g}" for a, b in effort.alphas)
    section = Section("anisotropic", "Brushed and rough metal", _WHAT.format(count=len(n), alphas=shown))
    truths = {alpha: _truth(inputs, n, t, v, alpha) for alpha in effort.alphas}
    settings = [("taps", k) for k in _TAPS] + [("gradient", k) for k in (1, 4, 16)]
    settings += [("sampled", k) for k in (16, 64, 256)]
    # The gradient and the samples read the paper's own levels, which are plain means over squares of texels.
    lit = {"taps": {name: Lighting(cube) for name, cube in inputs.places.items()}}
    lit["gradient"] = lit["sampled"] = {name: Lighting(cube, glossy="mip") for name, cube in inputs.places.items()}
    count = effort.batch // 5
    batches = [tuple(units(count, seed + k).astype(np.float32) for k in range(3)) for seed in (30, 40)]
    first = next(iter(inputs.places))

    def call(method: str, taps: int, k: int) -> NDArray:
        normals, views, tangents = batches[k % 2]
        return lit[method][first].ggx(normals, views, tangents=tangents, alpha=(0.1, 0.4), method=method, taps=taps)

    timings, yard = side_by_side({f"{m} {k}": partial(call, m, k) for m, k in settings}, max(3, effort.rounds // 2))
    results = []
    for m, k in settings:
        errors, biases, extra = [], [], {}
        for alpha in effort.alphas:
            given = {
                name: l.ggx(n, v, tangents=t, alpha=np.array(alpha), method=m, taps=k) for name, l in lit[m].items()
            }
            e, b = compared(given, truths[alpha])
            errors.append(e)
            biases.append(b)
            extra[f"{alpha[0]:g} × {alpha[1]:g}"] = percent(float(np.mean(list(e.values()))))
        mark = CHOSEN if (m, k) == ("taps", _DEFAULT) else PAPER if (m, k) == ("gradient", 16) else ""
        results.append(
            Result(
                m,
                f"taps={k}",
                {name: float(np.mean([e[name] for e in errors])) for name in inputs.places},
                {name: float(np.mean([b[name] for b in biases])) for name in inputs.places},
                timings[f"{m} {k}"].of_cpu.scaled(count),
                mark,
                extra,
            )
        )
    step_section(section, "anisotropic", "mean error of the reflected light", "time of one surface", results, yard)
    place = max(inputs.places, key=lambda name: next(r for r in results if r.mark == CHOSEN).errors[name])
    cube, alpha = inputs.places[place], effort.alphas[0]
    brushed = np.array([0.0, 0.0, 1.0])
    faces = level_at_most(cube, 32)

    def tangents(normals: NDArray) -> NDArray:
        return np.cross(brushed, normals)

    section.strips.append(
        strip(
            f"A ball of brushed metal ({alpha[0]:g} × {alpha[1]:g}) in “{place}”, where the default errs most",
            effort.picture,
            lambda n, v: reference.ggx(faces, n, v, tangents=tangents(n), alpha=alpha, split=2),
            {
                "default": lambda n, v: Lighting(cube).ggx(n, v, tangents=tangents(n), alpha=np.array(alpha)),
                "gradient": lambda n, v: Lighting(cube, glossy="mip").ggx(
                    n, v, tangents=tangents(n), alpha=np.array(alpha), method="gradient", taps=16
                ),
            },
        )
    )
    return section
