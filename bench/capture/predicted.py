"""Whether a map's statement about its own error is true."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache

import numpy as np

import fastibl
from fastibl.recording import truth_of

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .recordings import FRESH, ROOM, Moment, moment_of, moments

# The expected error was fitted to the first film of each path in these places, the interval's width to those of all
# places.
TUNED = ("adams_place_bridge", "dikhololo_night", "empty_warehouse_01", "kiara_1_dawn")
BANDS = ((0.0, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 1.0))  # of coverage


@cache
def films(place: str) -> list[Moment]:
    """All frames of sweeps and of wandering hands, two films of each."""
    return [m for path in ("sweep", "hand") for seed in (0, 1) for m in moments(place, path, seed)]


def _between(places: Iterable[str], low: float, high: float) -> list[Moment]:
    return [m for place in places for m in films(place) if low <= m.coverage < high]


def _share(some: list[Moment]) -> float:
    return float(np.mean([m.inside for m in some]))


def _inside(some: list[Moment]) -> str:
    return percent(_share(some)) if some else "no frame"


@row("capture", "predicted error")
def predicted() -> Iterator[Goal]:
    what = "share of frames whose error lies in the stated 90 % interval"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    places = [*inputs.MAPS, ROOM]
    for low, high in BANDS:
        some = _between(places, low, high)
        if not some:
            continue
        share = _share(some)
        above = float(np.mean([m.error > m.high for m in some]))
        width = float(np.median([m.high - m.low for m in some]))
        pushed = np.array([m.pushed for m in some])
        least, most = np.quantile(pushed, (0.05, 0.95))
        groups = {
            "places that its median was fitted to": [n for n in places if n in TUNED],
            "the others": [n for n in places if n not in TUNED],
            "a place that nothing was fitted to": [FRESH] if inputs.SUN_MAP.is_file() else [],
        }
        yield Goal(
            f"{what}, {percent(low)} to {percent(high)} of the sphere seen",
            percent(share),
            "85 to 95 %",
            0.85 <= share <= 0.95,
            (
                f"{len(some)} frames of {len(places)} places; {percent(above)} above it; its median width "
                f"{percent(width)}, median error {percent(float(np.median([m.error for m in some])))}",
                f"filled by push and pull: median error {percent(float(np.median(pushed)))}; an interval that holds "
                f"nine of ten of these frames, known afterwards, is {percent(float(most - least))} wide",
                "; ".join(f"{kind} {_inside(_between(names, low, high))}" for kind, names in groups.items()),
            ),
        )


@row("capture", "predicted error of a session in a room")
def in_a_room() -> Iterator[Goal]:
    """The room as the demo films it: walls and lamps at 1 to 3 m, of which no lamp's place may be known for long."""
    shares, notes = [], []
    for seed, hand in ((0, True), (0, False), (1, False), (2, False)):
        film = fastibl.simulate(seconds=12, fps=8, size=(320, 240), seed=seed, hand=hand, lamp=False)
        session = fastibl.Session(inputs.scene("figurine"), film.rig, film.board)
        some = []
        for frame in film:
            environment = session.process(frame).environment
            if environment is not None:
                some.append(moment_of(environment, truth_of(film).environment(frame.time)))
        shares.append(_share(some))
        notes.append(
            f"film {seed}{' with a hand in it' if hand else ''}: {percent(shares[-1])} of {len(some)} frames; median "
            f"error {percent(float(np.median([m.error for m in some])))}, expected "
            f"{percent(float(np.median([m.predicted for m in some])))}, upper end "
            f"{percent(float(np.median([m.high for m in some])))}"
        )
    value = float(np.mean(shares))
    yield Goal(
        "share of frames of a session in the built-in room whose error lies in the stated 90 % interval",
        percent(value),
        ">= 85 %",
        value >= 0.85,
        tuple(notes),
    )
