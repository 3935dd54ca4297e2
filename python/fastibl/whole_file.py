"""Files that are either written completely or stay as they were before."""

from __future__ import annotations

import errno
import itertools
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_WRITTEN = itertools.count()
_STEM = 40  # characters of the name that are kept: a name as long as the file system allows has no room for an ending


def path_ending(path: str | os.PathLike[str], *endings: str) -> Path:
    """The path of a file to be written. Raises ValueError unless it ends in one of these, in small letters or large;
    IsADirectoryError for a folder."""
    path = _no_folder(path)
    if path.suffix.lower() not in endings:
        raise ValueError(f"{path} must end in {' or '.join(endings)}")
    return path


def _no_folder(path: str | os.PathLike[str]) -> Path:
    if Path(path).is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    return Path(path)


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A name to write under that no other process or thread uses; the new file replaces the old if nothing is raised.

    A device or a pipe, which is not a file, is written to under its own name; links stay, and so does the mode of a
    file that was there. The name is that of a new file: nothing is written through a link that somebody placed there.
    Raises IsADirectoryError for a folder.
    """
    path = _no_folder(path)
    if path.exists() and not path.is_file():
        yield path
        return
    path = Path(os.path.realpath(path))
    part = path.with_name(f"{path.stem[:_STEM]}.{os.getpid()}-{next(_WRITTEN)}.part")
    part.unlink(missing_ok=True)
    try:
        try:
            os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        except OSError as error:  # it names the part, of which nobody has heard
            raise OSError(error.errno, error.strerror, str(path)) from None
        if path.exists():
            part.chmod(stat.S_IMODE(path.stat().st_mode))
        yield part
        part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_whole(path: str | os.PathLike[str], data: bytes | str) -> None:
    """Writes a file; text is written as UTF-8 with its own line ends."""
    with whole_file(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)
