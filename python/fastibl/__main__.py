"""The command `fastibl`."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from . import __version__, commands
from .plain_text import plain_text


def build_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fastibl",
        description="Measures the light of a place with ordinary cameras and lights virtual objects with it.",
        epilog="fastibl COMMAND --help shows a command's options and an example.",
    )
    parser.add_argument("--version", action="version", version=f"fastibl {__version__}")
    sub = parser.add_subparsers(metavar="COMMAND", required=True)
    for module in commands.ALL:
        module.add(sub)
    return parser


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Prints a command's warnings for a person to read: one line, like an error's, without the place in the code."""
    before = warnings.formatwarning
    warnings.formatwarning = lambda message, *_, **__: f"fastibl: warning: {plain_text(message)}\n"
    try:
        yield
    finally:
        warnings.formatwarning = before


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command; the exit code is 0 for success, 2 for bad input, 130 when interrupted."""
    arguments = build_parser().parse_args(argv)
    try:
        with _plain_warnings():
            return arguments.run(arguments) or 0
    except (OSError, ValueError, TypeError, LookupError, ImportError, RuntimeError, MemoryError) as error:
        print(f"fastibl: error: {plain_text(error) or type(error).__name__}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("fastibl: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
