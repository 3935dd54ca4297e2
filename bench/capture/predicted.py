"""Whether what a map says of its own error is true."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .recordings import ROOM, Moment, moments

# Fitted on the first four by name; the others have never been looked at for it.
TUNED = ("adams_place_bridge", "dikhololo_night", "empty_warehouse_01", "kiara_1_dawn")
BANDS = ((0.0, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 1.0))  # of coverage


def films(names: list[str]) -> list[Moment]:
    """All frames of sweeps and of wandering hands, two of each."""
    return [m for name in names for path in ("sweep", "hand") for seed in (0, 1) for m in moments(name, path, seed)]


@row("capture", "predicted error")
def predicted() -> Iterator[Goal]:
    what = "share of frames whose error lies in the stated 90 % interval"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    for kind, names in (
        ("places it was fitted to", [n for n in inputs.MAPS if n in TUNED]),
        ("other places", [*(n for n in inputs.MAPS if n not in TUNED), ROOM]),
    ):
        every = films(names)
        for low, high in BANDS:
            some = [m for m in every if low <= m.coverage < high]
            if not some:
                continue
            share = float(np.mean([m.low <= m.error <= m.high for m in some]))
            above = float(np.mean([m.error > m.high for m in some]))
            width = float(np.median([m.high - m.low for m in some]))
            yield Goal(
                f"{what}, {percent(low)} to {percent(high)} seen, {kind}",
                percent(share),
                "85 to 95 %",
                0.85 <= share <= 0.95,
                (
                    f"{len(some)} frames of {len(names)} places; {percent(above)} above it; its median width "
                    f"{percent(width)}, median error {percent(float(np.median([m.error for m in some])))}",
                ),
            )
