"""What files of others say, as it may go to a terminal."""

from __future__ import annotations

import sys


def plain_text(text: object) -> str:
    """str(text) with control characters, but for line ends and tabs, as their escapes.

    A name in a file could else clear the screen, or colour a line as if the program had said it.
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in str(text))


def tell(line: str) -> None:
    """A line of a command's on stderr, above its progress bars."""
    from tqdm import tqdm

    tqdm.write(f"fastibl: {plain_text(line)}", file=sys.stderr)
