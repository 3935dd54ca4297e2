"""fastibl live: put an object before live cameras."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from ._arguments import add_cameras, add_object, board_of, object_of, parser, positive

_STOPS = (-14, 2)  # of the front camera's exposures around the one that it found itself


def add(commands: argparse._SubParsersAction) -> None:
    p = parser(
        commands,
        "live",
        run,
        "light an object by what live cameras see and write the video; goes on when a camera is unplugged",
        "fastibl live --rig rig.yaml --back 0 --front 1 --object spot.obj --height 0.12 --out out.webm",
    )
    p.add_argument("--rig", type=Path, required=True, metavar="YAML", help="calibration of the cameras")
    add_cameras(p)
    add_object(p)
    p.add_argument("--exposures", choices=("adaptive", "bracket", "constant"), default="adaptive", help="of the front")
    p.add_argument(
        "--flicker",
        type=float,
        default=0.0,
        metavar="HZ",
        help="of the lamps, 100 or 120: adaptive exposures last whole periods where they can (default: 0)",
    )
    p.add_argument(
        "--most-boost",
        type=positive,
        default=1.0,
        metavar="FACTOR",
        help="for constant exposures: most that clipped light is made brighter by the board's white (default: 1)",
    )
    p.add_argument("--fps", type=positive, default=30.0, help="of the video (default: 30)")
    p.add_argument("--out", type=Path, default=Path("live.webm"), help="video to write (default: %(default)s)")


class _FirstKnown:
    """An AdaptiveExposure whose range is around the first exposure."""

    def __init__(self, camera, flicker: float):
        from ..exposure import AdaptiveExposure

        self.schedule, self._begun = AdaptiveExposure(camera, 1e-9, 1e9, flicker), False

    def __call__(self, last: float) -> float:
        if not self._begun:
            self._begun = True
            self.schedule.shortest, self.schedule.longest = (last * 2.0**s for s in _STOPS)
        return self.schedule(last)


def run(arguments: argparse.Namespace) -> int:
    from tqdm import tqdm

    from .._fastibl import Scene
    from ..exposure import Bracket
    from ..live import play
    from ..recording import read_rig
    from ..session import Session
    from ..sources import CameraSource
    from ..video import VideoWriter

    rig = read_rig(arguments.rig)
    board = board_of(arguments.board)
    session = Session(
        Scene(object_of(arguments)),
        rig,
        board,
        methods=arguments.methods,
        backend=arguments.backend,
        distance=arguments.distance,
        most_boost=arguments.most_boost,
    )
    adapts = arguments.front is not None and arguments.exposures == "adaptive"
    adaptive = _FirstKnown(rig.front, arguments.flicker) if adapts else None
    schedule = adaptive or (Bracket() if arguments.exposures == "bracket" else None)
    source = CameraSource(
        rig,
        0 if arguments.back is None else arguments.back,
        arguments.front,
        board,
        schedules={"front": schedule} if schedule else None,
        patience=arguments.patience,
        log=lambda line: tqdm.write(f"fastibl: {line}"),
    )
    frames = posed = refused = 0
    error, end = float("nan"), None
    with source, VideoWriter(arguments.out, arguments.fps) as video, tqdm(desc="live", unit="frame") as bar:
        try:
            for played in play(session, source):
                end = end or (time.monotonic() + arguments.seconds if arguments.seconds else float("inf"))
                refused += bool(played.refused)
                result = played.result
                if result is not None and played.frame.back is not None:
                    video.add(result.image)
                    pose, error = result.back_from_marker, result.predicted_error
                    frames, posed = frames + 1, posed + (pose is not None)
                    if adaptive and pose is not None:
                        adaptive.schedule.update(session.capture, rig.front_from_back @ pose)
                    bar.update()
                    bar.set_postfix(error=f"{100 * error:.0f} %", dropped=source.dropped, refresh=False)
                if time.monotonic() >= end:
                    break
        except KeyboardInterrupt:
            pass
    if not frames:
        raise ValueError(f"the back camera gave no picture within {arguments.patience:g} s")
    print(
        f"{arguments.out}: {frames} frames, board seen in {posed}, {refused} with pictures left out, {source.dropped} "
        f"pictures not asked for in time; predicted error of the irradiance {100 * error:.1f} %"
    )
    return 0
