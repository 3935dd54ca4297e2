"""Limits on files: none is read that would take more memory than a large real one does."""

from __future__ import annotations

import unicodedata
from math import isqrt
from pathlib import Path

MOST_BYTES = 2**31  # largest size of a file
MOST_PIXELS = 2**27  # pixels of a picture: 16384 x 8192, 1.5 GiB as float RGB; or of all faces and levels of a cube
MOST_TRIANGLES = 2**26  # of a mesh
MOST_VERTICES = 2**27
MOST_CORNERS = 1024  # of a polygon, as in the reader of .obj: cutting one takes the square of this number


def file_bytes(path: Path) -> bytes:
    """All bytes of a file. Raises ValueError for one that is larger than `MOST_BYTES`."""
    check_file_size(path)
    return path.read_bytes()


class OutsideFolder(ValueError):
    """A file names another one that does not lie in its folder."""


class FolderFiles:
    """What a file names beside itself: of its own folder, and no more than `MOST_BYTES` with it."""

    def __init__(self, path: Path, size: int):
        self._folder, self._read = path.parent.resolve(), size

    def bytes(self, name: str) -> bytes:
        """Where no file has the name, one whose name differs in case alone, or in how its accents are coded, is meant.

        Raises OutsideFolder for a name that leaves the folder, ValueError for more than that; FileNotFoundError.
        """
        file = (self._folder / name).resolve()
        if file.is_relative_to(self._folder) and not file.is_file():
            file = self._alike(file.relative_to(self._folder)).resolve()
        if not file.is_relative_to(self._folder):
            raise OutsideFolder(f"it names {name}, which is outside of its folder")
        if not file.is_file():
            raise FileNotFoundError(f"it names {name}, which is not there")
        data = file_bytes(file)
        self._read += len(data)
        if self._read > MOST_BYTES:
            raise ValueError(f"its files have more than {MOST_BYTES} bytes together")
        return data

    def _alike(self, name: Path) -> Path:
        def plain(text: str) -> str:
            return unicodedata.normalize("NFC", text).casefold()

        path = self._folder
        for part in name.parts:
            if not (path / part).exists() and path.is_dir():
                part = min((p.name for p in path.iterdir() if plain(p.name) == plain(part)), default=part)
            path = path / part
        return path


def text_of(path: Path, most: int) -> str:
    """All text of a file. ValueError for one that is larger than real ones, or is not UTF-8."""
    size = path.stat().st_size
    if size > most:
        raise ValueError(f"{path} has {size} bytes; such files of up to {most} bytes are read")
    try:
        return path.read_text(encoding="utf-8-sig")  # spreadsheets begin a file with a byte order mark
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no UTF-8 text: {error}") from None


def check_file_size(path: Path) -> None:
    """Raises ValueError for a file that is larger than `MOST_BYTES`."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ValueError(f"{path} has {size} bytes; files of up to {MOST_BYTES} bytes are read")


def check_face_edge(name: str, edge: int) -> None:
    """Raises ValueError for a face edge in texels of which six faces have more than `MOST_PIXELS`."""
    if 6 * edge * edge > MOST_PIXELS:
        most = isqrt(MOST_PIXELS // 6)
        raise ValueError(f"{name} must be at most {most}, for six faces of {MOST_PIXELS} pixels together; got {edge}")


def check_pixels(path: Path | str, width: int, height: int, layers: int = 1) -> None:
    """Raises ValueError for a picture without pixels, or with more than `MOST_PIXELS`."""
    if width < 1 or height < 1:
        raise ValueError(f"{path} says that it is {width} x {height}, which is no picture")
    if width * height * layers > MOST_PIXELS:
        many = f" in {layers} layers" if layers != 1 else ""
        raise ValueError(f"{path} says that it is {width} x {height}{many}; up to {MOST_PIXELS} pixels are read")
