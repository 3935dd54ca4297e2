"""What files of others say, as it may go to a terminal."""

from __future__ import annotations


def plain_text(text: object) -> str:
    """str(text) with control characters, but for line ends and tabs, as their escapes.

    A name in a file could else clear the screen, or colour a line as if the program had said it.
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in str(text))
