"""The irradiance of maps that a sweep captured, compared with that of the true maps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.room import LOWER, UPPER

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .lights import match, regions
from .recordings import ROOM, followed, sweeps


@row("capture", "irradiance after a sweep")
def after_sweep() -> Iterator[Goal]:
    what = "60 frames at 63 and 78 degrees, both cameras, brackets: error of the irradiance"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    errors = {name: s.moment.error for name, s in sweeps()}
    seen = {name: s.moment.coverage for name, s in sweeps()}
    middle, worst = float(np.median(list(errors.values()))), max(errors.values())
    yield Goal(
        f"{what}, {len(errors)} maps at infinity: median, worst map",
        f"{percent(middle)}, {percent(worst)}",
        "<= 2 %, <= 5 %",
        middle <= 0.02 and worst <= 0.05,
        (
            "by map: " + ", ".join(f"{name} {percent(e)}" for name, e in errors.items()),
            "seen of the sphere: " + ", ".join(percent(c) for c in seen.values()),
        ),
    )


@row("capture", "the room after a sweep")
def after_sweep_of_room() -> Iterator[Goal]:
    cases: tuple[tuple[str, dict[str, Any]], ...] = (
        ("nothing said of distances", {}),
        ("walls said to be at 3 m", {"distance": 3.0}),
        ("walls said to be a box", {"box": (LOWER - [0, 0, 0.001], UPPER)}),
    )
    for what, options in cases:
        *_, (_, environment, true) = followed(ROOM, 20, "sweep", 0, **options)
        error = irradiance_error(environment, true)
        low, high = environment.predicted_interval
        found, invented = match(fastibl.main_lights(environment), regions(true))
        angle = max((f.angle if f else 180.0 for f in found), default=0.0)
        energy = max((f.energy if f else 1.0 for f in found), default=0.0)
        yield Goal(
            f"built-in room, lamps at 1-3 m, 120 frames, {what}: irradiance, worst direction of a main light",
            f"{percent(error)}, {angle:.2f} degrees",
            "<= 10 %, <= 3 degrees",
            bool(error <= 0.1 and angle <= 3),
            (
                f"seen {percent(environment.coverage)} of the sphere; error stated {percent(low)} to {percent(high)}; "
                f"{len(found)} true lights, {invented} invented, worst energy {percent(energy)}",
                "triangulated: "
                + "; ".join(
                    f"({', '.join(f'{x:.2f}' for x in light.position)}) m"
                    for light in fastibl.main_lights(environment)
                    if light.position
                ),
            ),
        )
