"""What commands share: their parsers, and argument types that say what was expected."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable


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


def parser(
    commands: argparse._SubParsersAction, name: str, run: Callable, help: str, example: str
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
