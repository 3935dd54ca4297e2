"""Lamps on the mains, whose light swings by half up and down, in exposures shorter than one swing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.recording import truth_of

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .recordings import ROOM, sweep_film

_FRAMES, _SIZE = 60, (320, 240)
# What is measured, pictures a second, goal for the irradiance's error, arguments of simulate().
CASES: tuple[tuple[str, float, float, dict[str, Any]], ...] = (
    ("instant exposures", 15, 0.02, {}),
    ("instant exposures, at no rate of the mains", 13.0, 0.02, {}),
    ("20 ms, darker pictures 16 and 256 times shorter", 15, 0.02, {"shutter": 0.02}),
    ("rolling shutter of 30 ms, instant rows", 15, 0.05, {"readout": 0.03}),
)


@dataclass(frozen=True)
class Run:
    """error: that of the irradiance, the mean over the last ten frames. averaged: number of pictures that were
    averaged."""

    error: float
    averaged: int
    pictures: int


def swept(place: str, fps: float, doubt: bool = True, **timing: float) -> Run:
    film = sweep_film(place, seconds=_FRAMES / fps, fps=fps, seed=0, size=_SIZE, **timing)
    true = truth_of(film).environment(0.0)
    capture = fastibl.Capture(size=128, board=film.board, centre=inputs.OBJECT, doubt_exposures=doubt)
    errors, averaged = [], 0
    for index, frame in enumerate(film):
        for name in ("back", "front"):
            camera, turned = getattr(film.rig, name), fastibl.Pose() if name == "back" else film.rig.front_from_back
            first, last = (turned @ truth_of(film).pose(frame.time + later) for later in (0, camera.readout))
            image, exposure = getattr(frame, name), getattr(frame, f"{name}_exposure")
            row = last if camera.readout > 0 else None
            averaged += capture.add(image, camera, first, exposure, frame.time, last_row=row).how == "averaged"
        if index >= len(film) - 10:
            errors.append(irradiance_error(capture.environment(), true))
    return Run(float(np.mean(errors)), averaged, 2 * len(film))


@row("capture", "mains flicker")
def flicker() -> Iterator[Goal]:
    what = "lamps that swing 100 times a second between half and one and a half"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    places = [*list(inputs.MAPS)[::3], ROOM]
    for label, fps, goal, timing in CASES:
        ours = {place: swept(place, fps, flicker=100.0, **timing) for place in places}
        blind = {place: swept(place, fps, doubt=False, flicker=100.0, **timing) for place in places}
        (middle, worst), (believed, most) = (
            (float(np.median([r.error for r in runs.values()])), max(r.error for r in runs.values()))
            for runs in (ours, blind)
        )
        yield Goal(
            f"{what}, {label}: irradiance after {_FRAMES} frames, median, worst of {len(places)} places",
            f"{percent(middle)}, {percent(worst)}",
            f"median <= {percent(goal)}",
            middle <= goal,
            (
                f"all exposures believed: median {percent(believed)}, worst {percent(most)}",
                "by place: "
                + ", ".join(
                    f"{p} {percent(r.error)} ({r.averaged} of {r.pictures} pictures averaged; believed: "
                    f"{percent(blind[p].error)})"
                    for p, r in ours.items()
                ),
            ),
        )
    steady = {place: swept(place, 15) for place in places}
    wrongly = sum(r.averaged for r in steady.values())
    yield Goal(
        "steady light, the same films: pictures that are averaged",
        f"{wrongly} of {sum(r.pictures for r in steady.values())}",
        "<= 1 %",
        wrongly <= 0.01 * sum(r.pictures for r in steady.values()),
        ("irradiance: " + ", ".join(f"{p} {percent(r.error)}" for p, r in steady.items()),),
    )
    aliased = swept(ROOM, 15, flicker=120.0)
    yield Goal(
        "120 swings a second, 15 pictures a second at the same height of each: irradiance in the room",
        percent(aliased.error),
        "reported",
        None,
        ("no picture differs from another: only exposures of whole periods help (AdaptiveExposure(flicker=120))",),
    )
