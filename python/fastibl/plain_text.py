"""Text from files of others, made safe for a terminal."""

from __future__ import annotations

import sys


def plain_text(text: object) -> str:
    """str(text) with control characters, except line ends and tabs, replaced by their escapes.

    Otherwise, a name in a file could clear the screen, or colour a line as if the program had written it.
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in str(text))


def tell(line: str) -> None:
    """Writes a line of a command to stderr, above its progress bars."""
    from tqdm import tqdm

    tqdm.write(f"fastibl: {plain_text(line)}", file=sys.stderr)
