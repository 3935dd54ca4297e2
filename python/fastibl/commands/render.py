"""fastibl render: put an object into a recording, or into photographs."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..whole_file import path_ending
from ._arguments import add_colours_of_map, add_object, board_of, object_of, parser

if TYPE_CHECKING:
    from .._fastibl import CubeMap, Environment, FrameResult, Scene
    from ..photographs import Photographs
    from ..recording import Frame, Recording
    from ..session import Session

_DIFFUSE, _GLOSSY, _EXPONENT = 0.7, 0.1, 64.0
_SURE = 0.08  # relative deviation of a focal length that the board tells


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(
        commands,
        "render",
        run,
        "put an object into a recording and write the video, or into photographs",
        "fastibl render my-recording --object spot.obj --height 0.12 --out out.webm\n"
        "  fastibl render photo.jpg --environment room.hdr --out picture.png",
    )
    made.add_argument(
        "pictures",
        type=Path,
        nargs="+",
        metavar="RECORDING",
        help="folder of a recording; or photographs of the board (.jpg, .png), of one size, by one camera",
    )
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
    made.add_argument(
        "--out",
        type=Path,
        help="video to write (default: out.webm); of a photograph, the picture (default: out.png); of several, a "
        "folder (default: out)",
    )
    made.add_argument(
        "--layers",
        type=Path,
        metavar="FOLDER",
        help="also write what each picture is made from: object, shadow ratio and plate, as linear .exr",
    )
    photographs = made.add_argument_group("photographs")
    photographs.add_argument(
        "--board", type=Path, metavar="YAML", help="printed board (default: that of `fastibl board`)"
    )
    photographs.add_argument("--rig", type=Path, metavar="YAML", help="calibrated camera (default: the lens is found)")
    photographs.add_argument(
        "--fov",
        type=float,
        metavar="DEG",
        help="usual angle across a picture's longer side, where the lens is found (default: 65)",
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


def _scene(arguments: argparse.Namespace) -> Scene:
    from .._fastibl import Material, Scene

    mesh, material = object_of(arguments)
    given = (arguments.diffuse, arguments.glossy, arguments.exponent)
    if material is None or given != (None, None, None):
        diffuse, glossy, exponent = (
            default if value is None else value
            for value, default in zip(given, (_DIFFUSE, _GLOSSY, _EXPONENT), strict=True)
        )
        material = Material([diffuse] * 3, [glossy] * 3, exponent)
    return Scene(mesh, material)


def _map_of(arguments: argparse.Namespace) -> CubeMap | None:
    from ..environment_files import read_environment
    from ..map_rotation import rotate_map

    if arguments.environment is None:
        for name in ("turn", "response", "primaries"):
            if getattr(arguments, name):
                raise ValueError(f"--{name} is of a map, and goes with --environment")
        return None
    cube = read_environment(arguments.environment, response=arguments.response, primaries=arguments.primaries)
    return rotate_map(cube, math.radians(arguments.turn))


def _options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Those of a Session."""
    names = ("methods", "backend", "distance", "supersampling")
    return {name: getattr(arguments, name) for name in names}


def _draw(
    session: Session,
    source: Recording | Photographs,
    add: Callable[[FrameResult, Frame], None],
    layers: Path | None,
) -> tuple[FrameResult, list[float], int]:
    """Gives each picture to `add`, and returns the last result, seconds of each, and in how many the board was seen."""
    from tqdm import tqdm

    from ..layer_files import write_layers

    seconds: list[float] = []
    seen, result = 0, None
    for frame in tqdm(source, total=len(source), unit="frame", disable=None):
        made = session.process(frame)
        if frame.back is None:
            continue
        result = made
        add(result, frame)
        if layers is not None:
            write_layers(layers / f"{len(seconds):05d}.exr", session.layers, frame.back, source.rig.back.response)
        seconds.append(result.timings["total"])
        seen += result.back_from_marker is not None
    if result is None:
        raise ValueError("there are no back pictures")
    print(result.plan)
    return result, seconds, seen


def _render_recording(arguments: argparse.Namespace, path: Path) -> int:
    import numpy as np

    from ..recording import Recording
    from ..session import Session
    from ..video import VideoWriter

    for name in ("board", "rig", "fov"):
        if getattr(arguments, name) is not None:
            raise ValueError(f"--{name} is of photographs; a recording has its own")
    out = arguments.out or Path("out.webm")
    recording = Recording.open(path)
    times = recording.back_times
    fps = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 15.0
    with VideoWriter(out, fps) as video:
        cube = _map_of(arguments)
        environment = None if cube is None else _as_bright_as_here(cube, recording)
        session = Session(_scene(arguments), recording.rig, recording.board, environment, **_options(arguments))
        result, seconds, seen = _draw(
            session,
            recording,
            lambda result, frame: video.add(result.image, frame.time),
            arguments.layers,
        )
    print(
        f"board seen in {seen} of {len(seconds)} frames; {1000 * np.median(seconds):.1f} ms a frame (median); "
        f"predicted error of the irradiance {100 * result.predicted_error:.1f} %"
    )
    layers = "" if arguments.layers is None else f", and {len(seconds)} .exr in {arguments.layers}"
    print(f"wrote {out}{layers}")
    return 0


def _outputs(out: Path | None, photographs: Photographs) -> list[Path]:
    """Where the pictures go. Raises ValueError where two would go to one place, or one over a photograph."""
    if len(photographs) == 1:
        outputs = [path_ending(out or Path("out.png"), ".png", ".jpg", ".jpeg")]
    else:
        folder = out or Path("out")
        outputs = [folder / f"{path.stem}.png" for path in photographs.paths]
        if len({*outputs}) != len(outputs):
            raise ValueError("photographs must have names of their own, as their pictures go into one folder")
        folder.mkdir(parents=True, exist_ok=True)
    there = {path.resolve() for path in photographs.paths}
    for output in outputs:
        if output.resolve() in there:
            raise ValueError(f"{output} is a photograph that is read; give another --out")
    return outputs


def _render_photographs(arguments: argparse.Namespace) -> int:
    from ..calibration_files import read_rig
    from ..camera_files import write_pixels
    from ..expected import present
    from ..guessed_rig import DEGREES, degrees_across
    from ..photographs import Photographs
    from ..session import Session
    from ..tracking import Tracker

    if arguments.rig is not None and arguments.fov is not None:
        raise ValueError("--fov is of a lens that is not known; that of --rig is")
    photographs = Photographs(
        arguments.pictures,
        board_of(arguments.board),
        None if arguments.rig is None else read_rig(arguments.rig),
        degrees=DEGREES if arguments.fov is None else arguments.fov,
    )
    outputs = _outputs(arguments.out, photographs)
    camera = photographs.rig.back
    if photographs.lens_deviation is not None:
        sure = photographs.lens_deviation < _SURE
        said = "the board shows that the lens is" if sure else "the board hardly shows the lens, which is taken to be"
        print(f"{said} {degrees_across(camera):.0f} degrees wide (within {100 * photographs.lens_deviation:.1f} %)")
    scene, options = _scene(arguments), _options(arguments)
    cube = _map_of(arguments)
    session = Session(
        scene,
        photographs.rig,
        photographs.board,
        photographs.light(scene, **options) if cube is None else cube,
        **options,
    )
    written: list[Path] = []

    def write(result: FrameResult, frame: Frame) -> None:
        k = round(frame.time)
        if result.back_from_marker is not None:
            write_pixels(outputs[k], result.image)
            written.append(outputs[k])
            return
        why = Tracker(photographs.board, camera).explain(present(frame.back))
        message = f"{photographs.paths[k]}: the board is not seen. {why}"
        if len(photographs) == 1:
            raise ValueError(message)
        print(message)

    result, _, _ = _draw(session, photographs, write, arguments.layers)
    print(f"predicted error of the irradiance {100 * result.predicted_error:.1f} %")
    print(f"wrote {', '.join(map(str, written)) or 'nothing'}")
    return 0 if written else 1


def run(arguments: argparse.Namespace) -> int:
    from ..pictures import openexr

    if arguments.layers is not None:
        openexr()  # fails before any work is done
        arguments.layers.mkdir(parents=True, exist_ok=True)
    for path in arguments.pictures:
        if not path.exists():
            raise FileNotFoundError(f"no recording or photograph at {path}")
    if all(path.is_file() for path in arguments.pictures):
        return _render_photographs(arguments)
    if len(arguments.pictures) > 1:
        raise ValueError("expected one recording, or photographs")
    return _render_recording(arguments, arguments.pictures[0])
