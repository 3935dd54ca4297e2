"""Whether a map states its own error truly where no board measures the light, or where there is one exposure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.expected import present
from fastibl.recording import truth_of

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .boost import Same, one_exposure, true_map
from .predicted import BANDS
from .recordings import FRESH, Stated, every_place, recorded


@dataclass(frozen=True)
class Kind:
    """How a place is captured. every: the front camera's pictures that are taken, and after which the error is read."""

    name: str
    board: bool = False
    bracket: bool = True
    back: bool = True
    every: int = 1


KINDS = (
    Kind("both cameras, no board"),
    Kind("the front camera alone", back=False),
    Kind("five pictures of the front camera", every=12, back=False),
    Kind("one exposure, no board", bracket=False),
    Kind("one exposure, the front camera alone", bracket=False, back=False),
    Kind("one exposure, a board, nothing boosted", bracket=False, board=True),
)
_READ = 3  # frames between readings where all pictures are taken


@cache
def moments(place: str, path: str, kind: Kind) -> list[Stated]:
    """Moments of a film of 6 s, captured with its true poses."""
    front_exposures = None if kind.bracket else Same(one_exposure(true_map(place)))
    board = {} if kind.board else {"board": False}  # the paper itself is not there: to a map it is a part of the place
    film = recorded(
        place,
        seconds=6,
        fps=10,
        seed=0,
        size=(320, 240),
        position=inputs.OBJECT,
        path=path,
        hand=False,
        lamp=False,
        front_exposures=front_exposures,
        **board,
    )
    capture = fastibl.Capture(size=128, board=film.board, centre=inputs.OBJECT)
    true = truth_of(film).environment(0.0)
    out = []
    for index, frame in enumerate(film):
        pose = truth_of(film).pose(frame.time)
        if kind.back:
            capture.add(frame.back, film.rig.back, pose, exposure=frame.back_exposure, time=frame.time)
        # The first picture has an exposure of its own.
        if index % kind.every or (index == 0 and not kind.bracket):
            continue
        turned = film.rig.front_from_back @ pose
        capture.add(frame.front, present(film.rig.front), turned, exposure=frame.front_exposure, time=frame.time)
        if kind.every == 1 and index % _READ:
            continue
        environment = capture.environment()
        low, high = environment.predicted_interval
        out.append(Stated(environment.coverage, low, high, irradiance_error(environment, true)))
    return out


def _inside(some: list[Stated]) -> str:
    return percent(float(np.mean([m.inside for m in some])))


@row("capture", "stated error without a board")
def unmetered() -> Iterator[Goal]:
    what = "share of frames whose error lies in the stated 90 % interval"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    places = every_place()
    for kind in KINDS:
        films = {(p, path): moments(p, path, kind) for p in places for path in ("sweep", "hand")}
        every = [m for film in films.values() for m in film]
        share = float(np.mean([m.inside for m in every]))
        above = float(np.mean([m.error > m.high for m in every]))
        bands = {(low, high): [m for m in every if low <= m.coverage < high] for low, high in BANDS}
        fresh = [m for (place, _), film in films.items() if place == FRESH for m in film]
        yield Goal(
            f"{kind.name}: {what}",
            percent(share),
            ">= 85 %",
            share >= 0.85,
            (
                f"{len(every)} frames of {len(places)} places; {percent(above)} above it; median width "
                f"{percent(float(np.median([m.high - m.low for m in every])))}, median error "
                f"{percent(float(np.median([m.error for m in every])))}",
                "; ".join(
                    f"{percent(low)} to {percent(high)} of the sphere seen: {_inside(some)} of {len(some)}"
                    for (low, high), some in bands.items()
                    if some
                ),
                f"a place that nothing was fitted to: {_inside(fresh)} of {len(fresh)}" if fresh else "no fresh place",
            ),
        )
