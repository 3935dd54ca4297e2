"""fastibl board: the page to print."""

from __future__ import annotations

import argparse
from pathlib import Path

from ._arguments import parser


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(commands, "board", run, "write the board to print at true size", "fastibl board board.pdf")
    made.add_argument("out", type=Path, help="board.pdf or board.png")
    made.add_argument("--grid", metavar="ROWSxCOLUMNS", help="a plain grid instead of the default board, as 3x5")
    made.add_argument("--tag-size", type=float, default=0.04, help="of a grid's tags in metres (default: %(default)s)")
    made.add_argument("--spacing", type=float, default=0.012, help="between them in metres (default: %(default)s)")
    made.add_argument("--border-bits", type=int, choices=(1, 2), default=1, help="default: %(default)s")


def run(arguments: argparse.Namespace) -> int:
    from ..board import Board

    board = Board.default()
    if arguments.grid is not None:
        try:
            rows, columns = (int(part) for part in arguments.grid.lower().split("x"))
        except ValueError as error:
            raise ValueError(f"--grid must be ROWSxCOLUMNS, as 3x5, got {arguments.grid!r}") from error
        board = Board.grid(rows, columns, arguments.tag_size, arguments.spacing, arguments.border_bits)
    board.save(arguments.out)
    print(f"wrote {arguments.out}: {board.width * 1000:.0f} x {board.height * 1000:.0f} mm, print at 100 %")
    return 0
