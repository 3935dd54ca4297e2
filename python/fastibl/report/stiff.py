"""Stiff light: how errors grow as a sun becomes up to a hundred million times as bright as the sky."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import Lighting, MeshShadow, cast_shadow, reference
from ..lighting import PAPER
from ..measuring import one_core, row
from ..measuring.samples import grid, pairs, units
from .inputs import HEIGHT, Inputs, sun_and_sky
from .plots import COLOURS, Lines
from .section import Section, Table, percent
from .steps import sample_errors
from .visibility import Sky

_EXPONENT = 64.0
_TEXELS = (1, 100)
_WHAT = """Real light is stiff: half of it may come from a millionth of all directions, which is where methods break
that look fine in a soft room. A sun of one texel (0.7°, about a real sun), and one of 100 texels, in a clear sky; its
radiance is that of the sky times the number below. The same errors as above: matte surfaces, glossy ones with exponent
{exponent:g}, and the shadow on the table."""


@one_core()
def measure(inputs: Inputs) -> Section:
    section = Section("stiff", "Stiff light", _WHAT.format(exponent=_EXPONENT))
    suns = inputs.effort.suns
    places = {
        f"sun {strength:g}, {texels} texels": sun_and_sky(strength, texels) for texels in _TEXELS for strength in suns
    }
    here = replace(inputs, places=places)
    found = {
        "diffuse": _diffuse(here, max(150, inputs.effort.normals // 4)),
        "glossy": _glossy(here, max(3, inputs.effort.pairs // 2)),
        "shadow": _shadow(here, min(inputs.effort.grid, 20)),
    }
    titles = {"diffuse": "Matte surfaces", "glossy": "Glossy surfaces", "shadow": "Shadow (RMS of the ratio)"}
    table, broken = [], 0
    for step, by_method in found.items():
        lines, colours, dashed = {}, {}, []
        for k, (method, errors) in enumerate(by_method.items()):
            broken += sum(not np.isfinite(e) for e in errors)
            for name, e in zip(places, errors, strict=True):
                metric = "mean error under a sun"
                section.rows.append(row(method, name, metric, e if np.isfinite(e) else None, step=f"stiff {step}"))
            for j, texels in enumerate(_TEXELS):
                part = errors[j * len(suns) : (j + 1) * len(suns)]
                name = f"{method}, {texels} texel{'s' * (texels > 1)}"
                lines[name], colours[name] = (suns, part), COLOURS[k]
                dashed += [name] if j else []
            table.append([titles[step], method, *(percent(e) for e in errors[: len(suns)]), percent(max(errors))])
        section.charts.append(
            Lines(f"stiff-{step}", titles[step], "radiance of the sun by that of the sky", "error", lines,
                  dashed=dashed, colours=colours)
        )  # fmt: skip
    head = ["error", "method", *(f"{s:.0e}".replace("e+0", "e") for s in suns), "worst"]
    section.tables.append(
        Table(head, table, note="A sun of one texel, by its strength; worst: of both sizes.", title="")
    )
    worst = {step: max(by["default"]) for step, by in found.items()}
    count = sum(len(errors) for by_method in found.values() for errors in by_method.values())
    section.seen.append(
        "Over eight orders of magnitude of the sun the default stays within "
        + ", ".join(f"{percent(e)} ({step})" for step, e in worst.items())
        + f"; {count - broken} of {count} results are finite."
    )
    return section


def _diffuse(inputs: Inputs, count: int) -> dict[str, list[float]]:
    normals = units(count, 9)
    truths = inputs.by_place(reference.irradiance(inputs.channels, normals))

    def errors(method: str) -> list[float]:
        return [
            float(sample_errors(Lighting(cube, diffuse=method).irradiance(normals), truths[name]).mean())
            for name, cube in inputs.places.items()
        ]

    return {"default": errors("auto"), "the paper's": errors(PAPER.diffuse)}


def _glossy(inputs: Inputs, count: int) -> dict[str, list[float]]:
    n, v = pairs(count, seed=11)
    truths = inputs.by_place(reference.glossy(inputs.channels, n, v, _EXPONENT))

    def errors(method: str) -> list[float]:
        return [
            float(sample_errors(Lighting(cube, glossy=method).glossy(n, v, _EXPONENT), truths[name]).mean())
            for name, cube in inputs.places.items()
        ]

    return {"default": errors("auto"), "the paper's": errors(PAPER.glossy)}


def _shadow(inputs: Inputs, count: int) -> dict[str, list[float]]:
    extent = 1.25 * HEIGHT
    points = grid(count, extent)
    truths = inputs.by_place(Sky(inputs).plane_ratio(inputs.mesh, points))
    baked, spheres = MeshShadow(inputs.mesh, extent=extent), inputs.spheres(50)
    where: dict[str, Any] = {"resolution": 128, "extent": extent, "centre": (0.0, 0.0), "outer": False}

    def rms(ratio: NDArray, name: str) -> float:
        return float(np.sqrt(((ratio - truths[name]) ** 2).mean()))

    return {
        "default": [rms(baked.cast(cube).sample(points), name) for name, cube in inputs.places.items()],
        "the paper's": [
            rms(cast_shadow(cube, spheres, PAPER.shadow, **where).sample(points), name)
            for name, cube in inputs.places.items()
        ],
    }
