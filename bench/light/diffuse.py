"""Diffuse light: error and time a normal, the irradiance cube, what is never negative."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import fastibl

from .. import brute, inputs
from ..goals import Goal, by_map, percent, row, skipped


@row("light", "diffuse methods against brute force")
def methods() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("mean error of the irradiance", inputs.NO_MAPS)
        return
    truths = brute.irradiance()
    for method in fastibl.methods("diffuse"):
        means, worst = {}, 0.0
        for name, cube in inputs.real_maps().items():
            true = truths[name]
            errors = brute.errors(fastibl.Lighting(cube, diffuse=method).irradiance(brute.normals()), true, true.mean())
            means[name], worst = float(errors.mean()), max(worst, float(errors.max()))
        yield Goal(
            f"{method}: mean and worst error of the irradiance",
            f"{percent(float(np.mean(list(means.values()))))}, {percent(worst)}",
            "(no goal of its own)",
            None,
            by_map(means),
        )
