"""fastibl render: put an object into a recording."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from ._arguments import add_colours_of_map, add_object, object_of, parser

if TYPE_CHECKING:
    from .._fastibl import CubeMap, Environment
    from ..recording import Recording
    from ..session import Session

_DIFFUSE, _GLOSSY, _EXPONENT = 0.7, 0.1, 64.0


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(
        commands,
        "render",
        run,
        "put an object into a recording and write the video",
        "fastibl render my-recording --object spot.obj --height 0.12 --out out.webm",
    )
    made.add_argument("recording", type=Path, help="folder of a recording")
    add_object(made)
    made.add_argument(
        "--environment", type=Path, help="light by this map (.hdr, .exr, .ktx2, .dds, .png, .jpg) instead of capturing"
    )
    made.add_argument(
        "--turn", type=float, default=0.0, metavar="DEGREES", help="turn this map about z, counter-clockwise from above"
    )
    add_colours_of_map(made)
    own = "of a file with a material or colours its own"
    made.add_argument("--diffuse", type=float, help=f"k_L (default: {_DIFFUSE}; {own})")
    made.add_argument("--glossy", type=float, help=f"k_G (default: {_GLOSSY}; {own})")
    made.add_argument("--exponent", type=float, help=f"of the glossy lobe (default: {_EXPONENT:g}; {own})")
    made.add_argument(
        "--supersampling",
        type=int,
        default=1,
        metavar="N",
        help="draw the object N times as large along each axis and average: for shiny, curved objects (default: 1)",
    )
    made.add_argument("--out", type=Path, default=Path("out.webm"), help="video to write (default: %(default)s)")
    made.add_argument(
        "--layers",
        type=Path,
        metavar="FOLDER",
        help="also write what each picture is made from: object, shadow ratio and plate, as linear .exr",
    )


def _as_bright_as_here(cube: CubeMap, recording: Recording) -> CubeMap | Environment:
    """A given map, as bright as the board's white shows the light to be: a file's radiance has units of its own."""
    from ..board_meter import first_brightness, scaled

    board = recording.board
    factor = None if board is None else first_brightness(cube, recording.rig, board, recording)
    if factor is None:
        return cube
    print(f"the map's light is taken {factor:.3g} times, as the board's white shows it")
    return scaled(cube, factor)


def _session(arguments: argparse.Namespace, recording: Recording) -> Session:
    from .._fastibl import Material, Scene
    from ..environment_files import read_environment
    from ..map_rotation import rotate_map
    from ..session import Session

    mesh, material = object_of(arguments)
    given = (arguments.diffuse, arguments.glossy, arguments.exponent)
    if material is None or given != (None, None, None):
        diffuse, glossy, exponent = (
            default if value is None else value
            for value, default in zip(given, (_DIFFUSE, _GLOSSY, _EXPONENT), strict=True)
        )
        material = Material([diffuse] * 3, [glossy] * 3, exponent)
    environment = None
    if arguments.environment is not None:
        cube = read_environment(arguments.environment, response=arguments.response, primaries=arguments.primaries)
        environment = _as_bright_as_here(rotate_map(cube, math.radians(arguments.turn)), recording)
    return Session(
        Scene(mesh, material),
        recording.rig,
        recording.board,
        environment,
        methods=arguments.methods,
        backend=arguments.backend,
        distance=arguments.distance,
        supersampling=arguments.supersampling,
    )


def run(arguments: argparse.Namespace) -> int:
    import numpy as np
    from tqdm import tqdm

    from ..layer_files import write_layers
    from ..pictures import openexr
    from ..recording import Recording
    from ..video import VideoWriter

    recording = Recording.open(arguments.recording)
    times = recording.back_times
    fps = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 15.0
    seconds: list[float] = []
    seen, result = 0, None
    if arguments.layers is not None:
        openexr()  # fails before any work is done
        arguments.layers.mkdir(parents=True, exist_ok=True)
    with VideoWriter(arguments.out, fps) as video:
        session = _session(arguments, recording)
        for frame in tqdm(recording, total=len(recording), unit="frame", disable=None):
            if frame.back is None:
                session.process(frame)
                continue
            result = session.process(frame)
            video.add(result.image, frame.time)
            if arguments.layers is not None:
                path = arguments.layers / f"{len(seconds):05d}.exr"
                write_layers(path, session.layers, frame.back, recording.rig.back.response)
            seconds.append(result.timings["total"])
            seen += result.back_from_marker is not None
    if result is None:
        raise ValueError(f"{arguments.recording} holds no back pictures")
    print(result.plan)
    print(
        f"board seen in {seen} of {len(seconds)} frames; {1000 * np.median(seconds):.1f} ms a frame (median); "
        f"predicted error of the irradiance {100 * result.predicted_error:.1f} %"
    )
    layers = "" if arguments.layers is None else f", and {len(seconds)} .exr in {arguments.layers}"
    print(f"wrote {arguments.out}{layers}")
    return 0
