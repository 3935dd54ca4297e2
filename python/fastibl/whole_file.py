"""Files that are there whole, or as they were before."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A name to write under, that no other process or thread takes; it takes the file's place where nothing is raised.

    What is no file, a device or a pipe, is written to by its own name; links stay.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        yield path
        return
    path = Path(os.path.realpath(path))
    part = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}.part")
    try:
        yield part
        part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_whole(path: str | os.PathLike[str], data: bytes | str) -> None:
    """Writes a file, text as UTF-8 with the line ends it has."""
    with whole_file(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)
