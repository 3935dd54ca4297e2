"""What commands share: their parsers, argument types that say what was expected, and what several of them read."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .._fastibl import Board, Material, Mesh, Response

MESH_FILES = ".obj, .ply, .glb, .gltf, .stl, .off"


def picture_size(text: str) -> tuple[int, int]:
    """ "640x480" as (640, 480)."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match or min(int(g) for g in match.groups()) < 16:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT of at least 16x16, as in 640x480, got {text!r}")
    return int(match[1]), int(match[2])


def positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return value


def response(text: str) -> Response:
    """ "srgb", or the exponent of a power curve."""
    from .._fastibl import Response

    return Response.srgb() if text == "srgb" else Response.gamma(positive(text))


def add_colours_of_map(p: argparse.ArgumentParser) -> None:
    """Options of how a map's file is to be understood: --response, --primaries."""
    p.add_argument(
        "--response", type=response, metavar="CURVE", help='of a .png or .jpg map: "srgb" or an exponent, as 2.2'
    )
    p.add_argument(
        "--primaries", metavar="NAME",
        help='of the map, as ACEScg, "Rec. 2020", "Display P3" (default: what its file states, or Rec. 709)',
    )  # fmt: skip


def device(text: str) -> int | str:
    """A camera: its number, path or URL."""
    return int(text) if text.isdecimal() else text


def add_cameras(p: argparse._ActionsContainer, patience: float | None = 10.0) -> None:
    """Options of live cameras and their board. patience: default of --patience; None waits without limit."""
    p.add_argument("--back", type=device, metavar="CAMERA", help="number, device path, URL or video file (default: 0)")
    p.add_argument("--front", type=device, metavar="CAMERA", help="the same of the front camera (default: none)")
    p.add_argument("--board", type=Path, metavar="YAML", help="printed board (default: that of `fastibl board`)")
    p.add_argument("--seconds", type=positive, help="length (default: until Ctrl-C, or the end of a video file)")
    without = "%(default)g" if patience else "none: cameras are waited for"
    p.add_argument(
        "--patience",
        type=positive,
        default=patience,
        metavar="S",
        help=f"seconds without any picture after which it ends (default: {without})",
    )


_HEIGHT = 0.15  # metres


def add_object(p: argparse.ArgumentParser, several: bool = False) -> None:
    """Options of the virtual object, or of several to choose from, and of how it is lit."""
    what = f"mesh ({MESH_FILES}); by default the built-in figurine"
    if several:
        what = f"meshes ({MESH_FILES}) to choose from, besides built-in ones; the first is what it begins with"
    p.add_argument("--object", type=Path, nargs="+" if several else None, metavar="FILE", help=what)
    p.add_argument("--up", choices=("y", "z"), default="y", help="the mesh's upward axis (default: %(default)s)")
    height = f"of the object in metres (default: {_HEIGHT})"
    if several:
        p.add_argument("--height", type=positive, default=_HEIGHT, help=height)
    else:
        size = p.add_mutually_exclusive_group()
        size.add_argument("--height", type=positive, help=height)
        size.add_argument("--width", type=positive, help="of the object in metres, instead of its height")
        size.add_argument("--scale", type=positive, help="metres of a unit of the mesh: 1 keeps the size of a .glb")
    p.add_argument("--methods", choices=("auto", "paper"), default="auto", help="default: %(default)s")
    p.add_argument("--backend", choices=("auto", "cpu", "gl"), default="auto", help="default: %(default)s")
    p.add_argument(
        "--distance", type=positive, help="rough distance of the walls in metres; default: found from the pictures"
    )


def object_of(arguments: argparse.Namespace) -> tuple[Mesh, Material | None]:
    """The object that add_object's options name, standing on the board, and its own material, if it has one."""
    from .. import shapes
    from ..files import mesh_and_material, stand

    mesh, material = shapes.figurine(), None
    if arguments.object is not None:
        mesh, material = mesh_and_material(arguments.object, arguments.up)
    size = {name: value for name in ("height", "width", "scale") if (value := getattr(arguments, name)) is not None}
    return stand(mesh, **(size or {"height": _HEIGHT})), material


def board_of(path: Path | None) -> Board:
    """The board in a file; without a file, that of `fastibl board`. Raises ValueError where the file lists no tags."""
    from ..board import Board
    from ..calibration_files import read_board

    board = Board.default() if path is None else read_board(path)
    if board is None:
        raise ValueError(f"{path} lists no tags")
    return board


def parser(
    commands: argparse._SubParsersAction, name: str, run: Callable | None, help: str, example: str
) -> argparse.ArgumentParser:
    """Adds a command with its one-line help and an example."""
    made = commands.add_parser(
        name,
        help=help,
        description=help[0].upper() + help[1:] + ".",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.set_defaults(run=run)
    return made
