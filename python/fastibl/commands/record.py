"""fastibl record: a recording of live cameras."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from ._arguments import add_cameras, board_of, parser, picture_size


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
    p.add_argument("--size", type=picture_size, default=(640, 480), metavar="WxH", help="without --rig")
    p.add_argument("--bracket", action="store_true", help="the front camera takes darker pictures in turn")


def run(arguments: argparse.Namespace) -> int:
    from tqdm import tqdm

    from ..exposure import Bracket
    from ..guessed_rig import DEGREES, guessed_rig
    from ..recorder import Recorder
    from ..recording import RecordingWriter, read_rig
    from ..sources import CameraSource

    RecordingWriter.check_path(arguments.out)
    back = 0 if arguments.back is None and arguments.front is None else arguments.back
    rig = (
        guessed_rig(arguments.size, None if arguments.front is None else arguments.size)
        if arguments.rig is None
        else read_rig(arguments.rig)
    )
    if arguments.rig is None:
        print(
            f"no --rig: the recording says cameras of {DEGREES:g} degrees; calibrate before light is measured",
            file=sys.stderr,
        )
    board = board_of(arguments.board)
    schedules = {"front": Bracket()} if arguments.bracket else None
    source = CameraSource(
        rig,
        back,
        arguments.front,
        board,
        schedules=schedules,
        patience=arguments.patience,
        log=lambda line: tqdm.write(f"fastibl: {line}", file=sys.stderr),
    )
    recorder = None  # until the first frame: an older recording is there till then
    with source, ExitStack() as stack:
        end = None
        with tqdm(desc="record", unit="frame") as bar:
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
