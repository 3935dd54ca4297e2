"""The irradiance of maps that a sweep captured, against the true ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .recordings import ROOM, sweep, sweeps


@row("capture", "irradiance after a sweep")
def after_sweep() -> Iterator[Goal]:
    what = "60 frames at 63 and 78 degrees, both cameras, brackets: error of the irradiance"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    errors = {name: s.moments[-1].error for name, s in sweeps()}
    seen = {name: s.moments[-1].coverage for name, s in sweeps()}
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


@row("capture", "irradiance after a sweep of the room")
def after_sweep_of_room() -> Iterator[Goal]:
    for distance in (float("inf"), 3.0):
        done = sweep(ROOM, distance).moments[-1]
        where = "nothing said of distances" if np.isinf(distance) else f"walls said to be at {distance:g} m"
        yield Goal(
            f"the same in the built-in room, lamps at 1-3 m, {where}",
            percent(done.error),
            "<= 10 %",
            done.error <= 0.1,
            (f"seen {percent(done.coverage)} of the sphere; predicted {percent(done.predicted)}",),
        )
