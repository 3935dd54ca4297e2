"""Maps captured with a rolling shutter while the camera turns, compared with those of a global shutter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import fastibl
from fastibl.expected import present
from fastibl.simulator import DistantPlace, simulate

from .. import inputs
from ..goals import Goal, percent, row, skipped
from ..light.speed import looking

READOUT, TURN = 0.03, np.radians(60)  # seconds, radians a second
_SIZE, _CENTRE = 128, (0.0, 0.0, 0.06)
_EYE = np.array([0.0, 0.0, 0.3])
_WIDE = fastibl.Camera(320, 240, fx=260, fy=260, cx=160, cy=120)  # 63 degrees


def _front(time: float, up_and_down: bool) -> fastibl.Pose:
    azimuth, elevation = TURN * time, np.radians(35)
    if up_and_down:
        azimuth, elevation = 0.5 * time, np.radians(46) + 0.3 * np.sin(TURN / 0.3 * time)
    across = np.cos(elevation)
    return looking(np.array([np.sin(azimuth) * across, np.cos(azimuth) * across, np.sin(elevation)]), _EYE)


@dataclass(frozen=True)
class Errors:
    """Mean |map - truth| / mean truth of the texels above the horizon that both films show."""

    still: float
    rolling: float
    ignored: float


@cache
def errors(name: str, up_and_down: bool) -> Errors:
    """The errors of the bracketing front camera, with known poses."""
    turn = fastibl.Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    rig = fastibl.Rig(fastibl.Camera(16, 16, fx=16, fy=16, cx=8, cy=8), _WIDE, turn)
    environment = fastibl.read_environment(inputs.MAPS[name], size=256)

    def path(time: float) -> fastibl.Pose:
        return turn.inverse() @ _front(time, up_and_down)

    def captured(film: fastibl.Recording, last: Callable[[float], fastibl.Pose | None]):
        capture = fastibl.Capture(size=_SIZE, centre=_CENTRE)
        for f in film:
            pose = _front(f.time, up_and_down)
            capture.add(f.front, present(film.rig.front), pose, f.front_exposure, f.time, last_row=last(f.time))
        return capture.environment().radiance.faces.astype(np.float64), np.isfinite(capture.last_seen)

    common: dict[str, Any] = {
        "seconds": 1.5, "fps": 20, "board": False, "hand": False, "rig": rig, "truth_size": 8, "path": path,
    }  # fmt: skip
    still, rolling = (simulate(environment, readout=r, **common) for r in (0.0, READOUT))
    maps = (
        captured(still, lambda _: None),
        captured(rolling, lambda time: _front(time + READOUT, up_and_down)),
        captured(rolling, lambda _: None),
    )
    truth = DistantPlace(environment).truth(_CENTRE, _SIZE).faces.astype(np.float64)
    white = 1 / min(present(f.front_exposure) for f in still)  # the largest value that a picture can tell
    seen = np.all([s for _, s in maps], axis=0) & (fastibl.texel_directions(_SIZE)[..., 2] > 0.05)
    true = np.minimum(truth[seen], white)
    return Errors(*(float(np.abs(np.minimum(m[seen], white) - true).mean() / true.mean()) for m, _ in maps))


@row("capture", "rolling shutter: map")
def rolling_map() -> Iterator[Goal]:
    for up_and_down, how in ((False, "sideways"), (True, "up and down")):
        what = f"60 degrees a second {how}, 30 ms readout, poses known: error of the map, of a global shutter's"
        if not inputs.MAPS:
            yield skipped(what, inputs.NO_MAPS)
            continue
        found = {name: errors(name, up_and_down) for name in inputs.MAPS}
        ratios = {name: e.rolling / e.still for name, e in found.items()}
        ignored = {name: e.ignored / e.still for name, e in found.items()}
        yield Goal(
            f"{what}: median, worst of {len(found)} maps",
            f"{np.median(list(ratios.values())):.2f}, {max(ratios.values()):.2f}",
            "<= 1.2",
            max(ratios.values()) <= 1.2,
            (
                f"{percent(float(np.median([e.still for e in found.values()])))} with a global shutter (median)",
                "one pose a picture: " + ", ".join(f"{name} {r:.1f}" for name, r in ignored.items()),
            ),
        )
