"""The commands of `fastibl`, one module each.

A module has `add(commands)`, which adds its parser to argparse's sub-commands (see `parser`), and
`run(arguments)`. What it raises as OSError, ValueError, TypeError or LookupError is shown as an error, with
exit code 2.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

from . import simulate

ALL = (simulate,)


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
