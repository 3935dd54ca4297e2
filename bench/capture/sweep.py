"""The irradiance of maps that a sweep captured, compared with that of the true maps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import fastibl
from fastibl.comparison import irradiance_over_sphere
from fastibl.room import LOWER, UPPER

from .. import brute, inputs
from ..goals import Goal, percent, row, skipped
from .lights import match, regions
from .recordings import LIT_ROOM, ROOM, Sweep, followed, sweep, sweeps

_BOX = (tuple(float(x) for x in LOWER - [0, 0, 0.001]), tuple(float(x) for x in UPPER))
KNOWN: tuple[tuple[str, dict[str, Any]], ...] = (
    ("nothing said of distances", {}),
    ("all but lights said to be far", {"distance": float("inf")}),
    ("walls said to be at 3 m", {"distance": 3.0}),
    ("walls said to be a box", {"box": _BOX}),
)


def mean_error(estimated: Any, true: Any) -> float:
    """Mean over all normals of the error of a map's irradiance: RMS over RGB, divided by the map's mean."""
    light = irradiance_over_sphere(true)
    return float(brute.errors(irradiance_over_sphere(estimated), light, light.mean()).mean())


@row("capture", "irradiance after a sweep")
def after_sweep() -> Iterator[Goal]:
    what = "60 frames at 63 and 78 degrees, both cameras, brackets: error of the irradiance, mean over normals"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    errors = {name: mean_error(s.environment, s.true) for name, s in sweeps()}
    medians = {name: s.moment.error for name, s in sweeps()}
    seen = {name: s.moment.coverage for name, s in sweeps()}
    middle, worst = float(np.median(list(errors.values()))), max(errors.values())
    yield Goal(
        f"{what}, {len(errors)} maps at infinity: median, worst map",
        f"{percent(middle)}, {percent(worst)}",
        "<= 2 %, <= 5 %",
        middle <= 0.02 and worst <= 0.05,
        (
            "by map: " + ", ".join(f"{name} {percent(e)}" for name, e in errors.items()),
            "median over normals: " + ", ".join(f"{name} {percent(e)}" for name, e in medians.items()),
            "seen of the sphere: " + ", ".join(percent(c) for c in seen.values()),
        ),
    )


def _room_goal(what: str, environment: fastibl.Environment, true: fastibl.CubeMap, judged: bool) -> Goal:
    error = mean_error(environment, true)
    low, high = environment.predicted_interval
    found, invented = match(fastibl.main_lights(environment), regions(true))
    angles = [f.angle if f else 180.0 for f in found]
    angle = max(angles, default=0.0)
    energy = max((f.energy if f else 1.0 for f in found), default=0.0)
    return Goal(
        f"{what}: irradiance, worst direction of a main light",
        f"{percent(error)}, {angle:.2f} degrees",
        "<= 10 %, <= 3 degrees" if judged else "(no goal of its own)",
        bool(error <= 0.1 and angle <= 3) if judged else None,
        (
            f"seen {percent(environment.coverage)} of the sphere; error stated {percent(low)} to {percent(high)}; "
            f"{len(found)} true lights off by {', '.join(f'{a:.2f}' for a in angles)} degrees, {invented} invented, "
            f"worst energy {percent(energy)}",
            "triangulated: "
            + "; ".join(
                f"({', '.join(f'{x:.2f}' for x in light.position)}) m"
                for light in fastibl.main_lights(environment)
                if light.position
            ),
        ),
    )


@row("capture", "the room after a sweep")
def after_sweep_of_room() -> Iterator[Goal]:
    """The same sweep as at infinity; and a longer one with true poses, which shows what more pictures tell."""
    for place in (ROOM, LIT_ROOM):
        for what, known in KNOWN:
            swept: Sweep = sweep(place, **known)
            yield _room_goal(
                f"built-in {place}, lights at 1-3 m, 60 tracked frames, {what}",
                swept.environment,
                swept.true,
                judged=known.get("distance") != float("inf"),
            )
    for what, known in KNOWN:
        *_, (_, environment, true) = followed(ROOM, 20, "sweep", 0, **known)
        yield _room_goal(f"built-in {ROOM}, 120 frames with true poses, {what}", environment, true, judged=False)


@row("capture", "distance of the surroundings")
def distances() -> Iterator[Goal]:
    """Found in the room, and in no place at infinity. The room's: of the mean inverse distance of its walls."""
    ways = fastibl.texel_directions(32).reshape(-1, 3).astype(float)
    ways = ways[ways[:, 2] > 0]
    centre = np.array(inputs.OBJECT)
    with np.errstate(divide="ignore"):
        reach = np.where(ways > 0, (UPPER - centre) / ways, (LOWER - centre) / ways).min(axis=1)
    true = 1 / float((1 / reach).mean())
    for place in (ROOM, LIT_ROOM, *inputs.MAPS):
        found, after = [], []
        for path in ("sweep", "hand"):
            for seed in (0, 1):
                known = [capture.distance for capture, _, _ in followed(place, 10, path, seed)]
                found.append(known[-1])
                after += [next(k + 1 for k, x in enumerate(known) if np.isfinite(x))] if np.isfinite(known[-1]) else []
        near = place in (ROOM, LIT_ROOM)
        yield Goal(
            f"{place}, 60 frames of 2 sweeps and 2 hand films: metres to the walls, as found",
            ", ".join(f"{x:.2f}" for x in found),
            f"within 25 % of {true:.2f}" if near else "inf",
            bool(np.all(np.abs(np.array(found) / true - 1) < 0.25)) if near else bool(np.all(np.isinf(found))),
            (f"first after {', '.join(map(str, after))} pictures of each camera",) if after else (),
        )
