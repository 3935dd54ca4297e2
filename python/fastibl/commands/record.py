"""fastibl record: a recording of live cameras."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..camera_files import film_size, is_film
from ..expected import present
from ..plain_text import tell
from ._arguments import add_cameras, board_of, parser, picture_size

if TYPE_CHECKING:
    from .._fastibl import Rig

_LOOKED_AT = 600  # frames in which the lens is looked for
_SURE = 0.03  # relative deviation of a focal length that is believed


def add(commands: argparse._SubParsersAction) -> None:
    p = parser(
        commands,
        "record",
        run,
        "record live cameras; what was written stays whole when the program is killed",
        "fastibl record my-recording --rig rig.yaml --back 0 --front 1 --seconds 20 --bracket",
    )
    p.add_argument("out", metavar="OUT", type=Path, help="folder to write; a recording that is there is replaced")
    add_cameras(p)
    p.add_argument("--rig", type=Path, metavar="YAML", help="calibration (default: none; angles are then guessed)")
    p.add_argument("--size", type=picture_size, metavar="WxH", help="without --rig (default: 640x480)")
    p.add_argument("--bracket", action="store_true", help="the front camera takes darker pictures in turn")


def run(arguments: argparse.Namespace) -> int:
    from ..recording import RecordingWriter

    RecordingWriter.check_path(arguments.out)
    devices = [device for device in (arguments.back, arguments.front) if device is not None]
    status = _copy_films(arguments) if devices and all(map(is_film, devices)) else _record_cameras(arguments)
    if arguments.rig is None:
        _find_lens(arguments.out)
    return status


def _rig(arguments: argparse.Namespace, back: tuple[int, int] | None, front: tuple[int, int] | None) -> Rig:
    """The rig of --rig, or a guessed one for pictures of these sizes."""
    from ..calibration_files import read_rig
    from ..guessed_rig import DEGREES, guessed_rig

    if arguments.rig is not None:
        return read_rig(arguments.rig)
    print(
        f"no --rig: cameras are taken to be {DEGREES:g} degrees wide, the back one until the board shows its lens",
        file=sys.stderr,
    )
    # With a front camera alone, the back camera is a mere placeholder.
    return guessed_rig(present(back or front), front)


def _find_lens(path: Path) -> None:
    """Writes the lens that the board shows into a recording whose back camera was guessed."""
    from ..calibration.guess import LensSearch
    from ..calibration_files import write_rig
    from ..guessed_rig import degrees_across, with_back
    from ..recording import Recording
    from ..tracking import Tracker

    recording = Recording.open(path)
    if not len(recording.back_times):
        return
    rig, board, usual = recording.rig, recording.board, recording.rig.back
    search, tracker = LensSearch(usual, board, enough=0.0), Tracker(board, usual)
    for frame in itertools.islice(recording, _LOOKED_AT):
        pose = None if frame.back is None else tracker.track(frame.back, frame.time)
        if pose is not None:
            search.add(present(frame.back), pose.camera_from_marker, frame.time)
    found = search.best()
    if found is None or found[1] > _SURE:
        print(
            "the board does not show the back camera's lens, which stays "
            f"{degrees_across(usual):.0f} degrees wide: show the board from the side, or calibrate the camera",
            file=sys.stderr,
        )
        return
    camera, deviation = found
    write_rig(path / "rig.yaml", with_back(rig, camera))
    print(
        f"the board shows that the back camera's lens is {degrees_across(camera):.0f} degrees wide (within "
        f"{100 * deviation:.1f} %)"
    )


def _copy_films(arguments: argparse.Namespace) -> int:
    """Records every picture of existing films, at the times that the films give."""
    from tqdm import tqdm

    from ..recorder import Recorder
    from ..sources import VideoSource

    if arguments.bracket:
        raise ValueError("--bracket is of cameras; a film's exposures are what they were")
    if arguments.size is not None:
        raise ValueError("--size is of cameras; a film's pictures are as large as they are")
    for film in filter(None, (arguments.back, arguments.front)):
        if Path(film).resolve().is_relative_to(arguments.out.resolve()):
            raise ValueError(
                f"{film} lies in {arguments.out}, whose older recording is removed first: choose another folder"
            )
    back, front = (None if film is None else film_size(film) for film in (arguments.back, arguments.front))
    rig, board = _rig(arguments, back, front), board_of(arguments.board)
    source = VideoSource(rig, arguments.back, arguments.front, board)
    with (
        Recorder(arguments.out, rig, board) as recorder,
        tqdm(source, desc="record", unit="frame", disable=None) as bar,
    ):
        for frame in bar:
            if arguments.seconds is not None and frame.time > arguments.seconds:
                break
            recorder.add(frame, wait=True)
    print(f"{arguments.out}: all {recorder.written} frames of the film, none told its exposure")
    return 0


def _sizes(devices: Sequence[int | str], asked: tuple[int, int]) -> dict[int | str, tuple[int, int]]:
    """How large the pictures of cameras are that nobody calibrated; `asked` for those that are not there yet."""
    from ..found_camera import picture_size

    sizes = dict.fromkeys(devices, asked)
    for device in devices:
        with contextlib.suppress(OSError):
            sizes[device] = picture_size(device, asked)
    return sizes


def _record_cameras(arguments: argparse.Namespace) -> int:
    from tqdm import tqdm

    from ..exposure import Bracket
    from ..found_camera import scaled_opener
    from ..live_camera import silence_ffmpeg
    from ..recorder import Recorder
    from ..sources import CameraSource

    silence_ffmpeg()
    back = 0 if arguments.back is None and arguments.front is None else arguments.back
    if arguments.size is not None and arguments.rig is not None:
        raise ValueError("--size goes without --rig, which says it")
    opened: dict[str, Any] = {}
    if arguments.rig is None:
        sizes = _sizes([d for d in (back, arguments.front) if d is not None], arguments.size or (640, 480))
        rig = _rig(arguments, sizes.get(back), sizes.get(arguments.front))
        opened["open_capture"] = scaled_opener(sizes)
    else:
        rig = _rig(arguments, None, None)
    board = board_of(arguments.board)
    schedules = {"front": Bracket()} if arguments.bracket else None
    source = CameraSource(
        rig,
        back,
        arguments.front,
        board,
        schedules=schedules,
        patience=arguments.patience,
        log=tell,
        **opened,
    )
    recorder = None  # made at the first frame: until then an older recording stays
    with source, ExitStack() as stack:
        end = None
        with tqdm(desc="record", unit="frame", disable=None) as bar:
            try:
                for frame in source:
                    recorder = recorder or stack.enter_context(Recorder(arguments.out, rig, board))
                    recorder.add(frame)
                    bar.update()
                    bar.set_postfix(dropped=recorder.dropped + source.dropped, refresh=False)
                    end = end or (time.monotonic() + arguments.seconds if arguments.seconds else np.inf)
                    if time.monotonic() >= end:
                        break
            except KeyboardInterrupt:
                if recorder is None:
                    raise
    if recorder is None:
        raise ValueError(f"no camera gave a picture within {arguments.patience:g} s")
    print(
        f"{arguments.out}: {recorder.written} frames, {recorder.dropped} dropped for lack of speed of the disk, "
        f"{source.dropped} pictures not asked for in time"
    )
    return 0
