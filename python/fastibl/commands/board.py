"""fastibl board: the page to print."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ._arguments import parser, positive

if TYPE_CHECKING:
    from .._fastibl import Board

_PAPERS = {"a4": (0.297, 0.210), "letter": (0.2794, 0.2159)}  # metres, in landscape format
_LARGEST = 2.0  # metres of a page: a larger number is likely to be millimetres


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(commands, "board", run, "write the board to print at true size", "fastibl board board.pdf")
    made.add_argument(
        "out", type=Path, help="board.pdf or board.png; of other boards than the default, .yaml beside it"
    )
    made.add_argument("--paper", choices=(*_PAPERS,), default=None, help="of the default board (default: a4)")
    which = made.add_mutually_exclusive_group()
    which.add_argument("--grid", metavar="ROWSxCOLUMNS", help="a plain grid instead of the default board, as 3x5")
    which.add_argument("--kalibr", metavar="ROWSxCOLUMNS", help="an AprilGrid as Kalibr's, ids from the lower left")
    made.add_argument("--tag-size", type=positive, help="of a grid's tags in metres (default: 0.04)")
    made.add_argument("--spacing", type=positive, help="between a grid's tags in metres (default: 0.012)")
    made.add_argument("--spacing-ratio", type=positive, help="of --kalibr, to the tags' size (default: 0.3)")
    made.add_argument("--border-bits", type=int, choices=(1, 2), help="of --grid, modules (default: 1; --kalibr has 2)")


def run(arguments: argparse.Namespace) -> int:
    from ..board import Board

    board = _board(arguments)
    if max(board.width, board.height) > _LARGEST:
        raise ValueError(
            f"the page would be {board.width:.3g} x {board.height:.3g} m, expected up to {_LARGEST:g} m: sizes are in "
            "metres, 40 mm are 0.04"
        )
    listed = arguments.out.with_suffix(".yaml")
    other = board != Board.default()
    if other:
        _check_free(listed, board)
    board.save(arguments.out)
    print(f"wrote {arguments.out}: {board.width * 1000:.0f} x {board.height * 1000:.0f} mm, print at 100 %")
    if other:
        from ..calibration_files import write_board

        write_board(listed, board)
        print(f"wrote {listed}: give it to other commands as --board {listed}")
    return 0


def _board(arguments: argparse.Namespace) -> Board:
    from ..board import Board

    if arguments.spacing is not None and arguments.grid is None or arguments.border_bits and arguments.grid is None:
        raise ValueError("--spacing and --border-bits go with --grid")
    if arguments.spacing_ratio is not None and arguments.kalibr is None:
        raise ValueError("--spacing-ratio goes with --kalibr")
    size = 0.04 if arguments.tag_size is None else arguments.tag_size
    if arguments.tag_size is not None and arguments.grid is None and arguments.kalibr is None:
        raise ValueError("--tag-size goes with --grid and --kalibr")
    if arguments.grid is not None or arguments.kalibr is not None:
        if arguments.paper is not None:
            raise ValueError("--paper goes with the default board")
    if arguments.grid is not None:
        spacing = 0.012 if arguments.spacing is None else arguments.spacing
        return Board.grid(*_counts("--grid", arguments.grid), size, spacing, arguments.border_bits or 1)
    if arguments.kalibr is not None:
        ratio = 0.3 if arguments.spacing_ratio is None else arguments.spacing_ratio
        return Board.kalibr(*_counts("--kalibr", arguments.kalibr), size, ratio)
    board = Board.default()
    if arguments.paper in (None, "a4"):
        return board
    return Board([(tag.id, tag.corners) for tag in board.tags], *_PAPERS[arguments.paper], board.border_bits)


def _counts(option: str, text: str) -> tuple[int, int]:
    try:
        rows, columns = (int(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise ValueError(f"{option} must be ROWSxCOLUMNS, as 3x5, got {text!r}") from error
    return rows, columns


def _check_free(path: Path, board: Board) -> None:
    """Raises FileExistsError where the file holds another board, such as one that was measured."""
    from ..calibration_files import read_board

    if path.is_file() and read_board(path) != board:
        raise FileExistsError(f"{path} holds another board: remove it, or write the page under another name")
