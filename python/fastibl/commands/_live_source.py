"""Where `fastibl live` takes its pictures from, and what it says about that."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ._arguments import board_of

_STOPS = (-14, 2)  # range of the front camera's exposures around the one that it found itself
_SIMULATED = 4.0  # seconds that the virtual camera moves before it turns back
_SIMULATED_FPS = 30.0
_CATCH_UP = 0.1  # seconds
# Options of cameras where they are not given.
_USUAL = {
    "rig": None, "fov": None, "front_fov": 65.0, "exposures": "adaptive", "flicker": 0, "patience": None,
    "size": (640, 480),
}  # fmt: skip


@dataclass
class Opened:
    """A source that was opened. about: the source in words, or a function that gives them. notices: what a user should
    know about it. adaptive: the light meter of its front camera. lens: finds that of its back camera."""

    source: Any
    about: str | Callable[[], str]
    notices: list[str] = field(default_factory=list)
    adaptive: Any = None
    lens: Any = None


class _FirstKnown:
    """An AdaptiveExposure whose range lies around the first exposure."""

    def __init__(self, camera: Any, flicker: float):
        from ..exposure import AdaptiveExposure

        self.schedule, self._begun = AdaptiveExposure(camera, 1e-9, 1e9, flicker), False

    def __call__(self, last: float) -> float:
        if not self._begun:
            self._begun = True
            self.schedule.shortest, self.schedule.longest = (last * 2.0**s for s in _STOPS)
        return self.schedule(last)


def open_source(arguments: argparse.Namespace, log: Callable[[str], None]) -> Opened:
    """Opens the source that the arguments ask for. Where no camera gives pictures, raises OSError that says what there
    is instead."""
    asked = [name for name in ("simulate", "recording") if getattr(arguments, name)]
    cameras = [name for name in ("back", "front") if getattr(arguments, name) is not None]
    if len(asked) + bool(cameras) > 1:
        given = ", ".join(f"--{name}" for name in asked + cameras)
        raise ValueError(f"pictures come from cameras, a recording or the simulator, not from several: {given}")
    if arguments.simulate:
        return _simulated(arguments)
    if arguments.recording:
        return _recorded(arguments)
    return _cameras(arguments, log)


def _refuse(arguments: argparse.Namespace, options: Sequence[str], why: str) -> None:
    """Raises ValueError where an option is given that would do nothing."""
    for name in options:
        if getattr(arguments, name) != _USUAL[name]:
            raise ValueError(f"--{name.replace('_', '-')} {why}")


def _simulated(arguments: argparse.Namespace) -> Opened:
    from ..simulator import simulate
    from ..sources import BackAndForth, Paced

    of_cameras = ("rig", "fov", "front_fov", "exposures", "flicker", "patience")
    _refuse(arguments, of_cameras, "is of cameras, and with --simulate there are none")
    made = simulate(
        arguments.environment,
        seconds=_SIMULATED,
        fps=_SIMULATED_FPS,
        size=arguments.size,
        board=board_of(arguments.board),
        hand=False,
        live=True,
        truth_size=16,
    )
    hand = BackAndForth(made, 1 / _SIMULATED_FPS)
    source = Paced(hand, catch_up=_CATCH_UP)
    place = "a simulated room" if arguments.environment is None else f"a place in {arguments.environment.name}"
    notice = (
        f"These pictures are simulated: a hand holds two cameras in {place}. The first {_SIMULATED:g} seconds are "
        "worked out while they are shown, and are slow; then the cameras go back and forth."
    )

    def about() -> str:
        return place if hand.complete else f"{place}, {hand.kept} of {len(made)} pictures worked out"

    return Opened(source, about, [notice])


def _recorded(arguments: argparse.Namespace) -> Opened:
    from ..recording import Recording
    from ..sources import Paced

    of_cameras = ("rig", "fov", "front_fov", "exposures", "flicker", "size", "patience")
    _refuse(arguments, of_cameras, "is of cameras; a recording has its own")
    recording = Recording.open(arguments.recording)
    if arguments.board is not None:
        recording.board = board_of(arguments.board)
    if recording.board is None:
        raise ValueError(f"{arguments.recording} says nothing of a board; nothing can be put before its pictures")
    return Opened(Paced(recording, catch_up=_CATCH_UP), f"recording {arguments.recording.name}")


def _cameras(arguments: argparse.Namespace, log: Callable[[str], None]) -> Opened:
    from ..calibration.guess import LensSearch
    from ..calibration_files import read_rig
    from ..exposure import Bracket
    from ..live_camera import silence_ffmpeg
    from ..sources import CameraSource

    silence_ffmpeg()
    back = 0 if arguments.back is None else arguments.back
    if arguments.front is not None and arguments.environment is not None:
        raise ValueError("with --environment the light is given, and a front camera has nothing to do: leave one away")
    guessed = arguments.rig is None
    if not guessed:
        _refuse(arguments, ("fov", "front_fov", "size"), "goes without --rig, which says it")
    rig, options, notices = (
        _found(arguments, back)
        if guessed
        else (read_rig(arguments.rig), {}, [])  # cameras are asked for the calibrated sizes
    )
    adapts = arguments.front is not None and arguments.exposures == "adaptive"
    adaptive = _FirstKnown(rig.front, arguments.flicker) if adapts else None
    schedule = adaptive or (Bracket() if arguments.exposures == "bracket" else None)
    board = board_of(arguments.board)
    source = CameraSource(
        rig,
        back,
        arguments.front,
        board,
        schedules={"front": schedule} if schedule else None,
        patience=math.inf if arguments.patience is None else arguments.patience,
        log=log,
        **options,
    )
    about = f"camera {back}" + ("" if arguments.front is None else f" and camera {arguments.front}")
    if arguments.front is None and arguments.environment is None:
        notices.append(
            "There is no front camera: only what the back camera sees lights the object, and the board's white tells "
            "how bright the rest must be. Turn the camera around the room, or give `--front CAMERA` or "
            "`--environment room.hdr`."
        )
    lens = LensSearch(rig.back, board) if guessed and arguments.fov is None else None
    return Opened(source, about, notices, adaptive, lens)


def _found(arguments: argparse.Namespace, back: int | str) -> tuple[Any, dict[str, Any], list[str]]:
    """A rig for cameras without calibration: the sizes of their pictures are taken as they come, their angles are
    guessed."""
    from ..found_camera import picture_size, scaled_opener
    from ..guessed_rig import DEGREES, guessed_rig

    devices = [back] if arguments.front is None else [back, arguments.front]
    try:
        sizes = {device: picture_size(device, arguments.size) for device in devices}
    except OSError as error:
        raise OSError(f"{error}; `fastibl live --simulate` shows everything without a camera") from None
    front = None if arguments.front is None else sizes[arguments.front]
    rig = guessed_rig(sizes[back], front, arguments.fov or DEGREES, arguments.front_fov)
    return rig, {"open_capture": scaled_opener(sizes)}, [guess_notice(arguments)]


def guess_notice(arguments: argparse.Namespace) -> str:
    """What it means that the cameras are not calibrated."""
    from ..guessed_rig import DEGREES

    told = arguments.fov is not None
    until = "" if told else ", until the board, seen from the side for some seconds, shows it"
    notice = (
        f"No calibration: the back camera's lens is taken for {arguments.fov if told else DEGREES:g}° wide and without "
        f"distortion{until}. 10° off put it a fifth too near or too far, and the object slips on the board when the "
        "camera moves. `fastibl calibrate` measures it in some minutes; `--fov` says what you know."
    )
    if arguments.front is not None:
        notice += (
            f" The front camera is taken for {arguments.front_fov:g}° wide, to look just the other way, and to be as "
            "sensitive: light comes from a wrong side by as much as it does not."
        )
    return notice
