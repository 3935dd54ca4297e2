"""Textures of several materials in one picture: where each of them lies, and what is around it.

Where all fit, each texture keeps its texels, so that a bilinear look-up still shows the same. It lies in a cell with a
margin that continues the texture, so that coarse levels of the atlas do not mix it with its neighbours before it is
seen smaller than 1/16. Cells lie on whole texels of those levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

_LONGEST = 8192  # most texels along an edge
_MOST_TEXELS = 2**25  # this is 400 MB as float RGB
_LEAST_MARGIN = 8
_TRIED = 16  # number of rooms whose summed widths are tried as the atlas's width


@dataclass(frozen=True)
class Cell:
    """A rectangle of texels that contains the rectangle of a texture; rows from the top."""

    x: int
    y: int
    width: int
    height: int
    columns: int  # the texture's own size, without the margin
    rows: int

    @property
    def left(self) -> int:
        """Number of columns of the cell before those of the texture."""
        return (self.width - self.columns) // 2

    @property
    def top(self) -> int:
        return (self.height - self.rows) // 2

    def filled(self, picture: NDArray, wraps: tuple[str, str], copies: tuple[int, int] = (1, 1)) -> NDArray[np.float32]:
        """(height, width, c): the picture (h, w, c) in its place, continued into the margin around it. copies: how many
        times it fills that place, along its columns and rows."""
        import cv2

        size = min(self.columns // copies[0], picture.shape[1]), min(self.rows // copies[1], picture.shape[0])
        size = max(size[0], 1), max(size[1], 1)
        if size != picture.shape[1::-1]:
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], -1)
        out = picture.astype(np.float32, copy=False)
        for axis, (start, n, size_of_cell) in enumerate(
            ((self.top, self.rows, self.height), (self.left, self.columns, self.width))
        ):
            many, texels = copies[1 - axis], out.shape[axis]
            at = (np.arange(size_of_cell) - start + 0.5) * (many * texels / n) - 0.5
            if axis == 0:  # the first copy is the lowest
                at -= (many - 1) * texels
            first = np.floor(at).astype(int)
            weight = (at - first).astype(np.float32)
            here, next_ = (_wrapped(first + k, out.shape[axis], wraps[1 - axis]) for k in (0, 1))
            near = out.take(here, axis)
            if weight.any():
                near += (out.take(next_, axis) - near) * weight.reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
            out = near
        return out


@dataclass(frozen=True)
class Atlas:
    width: int
    height: int
    cells: list[Cell]

    def moved(self, cell: Cell, uvs: NDArray) -> NDArray[np.float64]:
        """Where the uvs (n, 2) of a cell's texture lie in the atlas; v upwards in both."""
        x = cell.x + cell.left + uvs[:, 0] * cell.columns
        y = cell.y + cell.top + (1 - uvs[:, 1]) * cell.rows
        return np.stack([x / self.width, 1 - y / self.height], axis=1)


def packed(sizes: Sequence[tuple[int, int]]) -> Atlas:
    """Cells for textures of these sizes (columns, rows); the largest are shrunk until all fit.

    Raises ValueError for more textures than fit, however small they are.
    """
    longest = max(map(max, sizes))
    while True:
        scales = [min(1.0, longest / max(size)) for size in sizes]
        shrunk = [(max(1, round(w * k)), max(1, round(h * k))) for (w, h), k in zip(sizes, scales, strict=True)]
        atlas = _pack(shrunk)
        if atlas is not None:
            return atlas
        if longest == 1:
            raise ValueError(f"its {len(sizes)} materials are more than fit into a picture of {_MOST_TEXELS} texels")
        longest = longest * 15 // 16


def _wrapped(i: NDArray[np.int64], n: int, wrap: str) -> NDArray[np.int64]:
    if wrap == "clamp":
        return np.clip(i, 0, n - 1)
    return i % n if wrap == "repeat" else np.minimum(i % (2 * n), 2 * n - 1 - i % (2 * n))


def _up(n: float, unit: int) -> int:
    return ceil(n / unit) * unit


@dataclass(frozen=True)
class _Room:
    """The room that a texture takes. unit: a power of two; the corners of the texture's cell are multiples of it."""

    columns: int
    rows: int
    width: int
    height: int
    unit: int

    @classmethod
    def of(cls, size: tuple[int, int], least: float) -> _Room:
        unit = margin = max(_LEAST_MARGIN, 1 << (ceil(max(size) / 16) - 1).bit_length())
        if min(size) + 2 * margin < least:
            unit = max(margin, 1 << (int(least / 2).bit_length() - 1))
        width, height = (_up(max(n + 2 * margin, least), unit) for n in size)
        return cls(*size, width, height, unit)


def _pack(sizes: list[tuple[int, int]]) -> Atlas | None:
    """Returns None where the textures do not fit."""
    atlas = _smallest([_Room.of(size, 0) for size in sizes])
    if atlas is None:
        return None
    # Light that an object throws is read from 64 texels across a picture: two of them go to the smallest texture, where
    # all textures can have that many.
    least = min(max(atlas.width, atlas.height) / 16, sqrt(atlas.width * atlas.height / len(sizes)))
    return _smallest([_Room.of(size, least) for size in sizes]) or atlas


def _smallest(rooms: list[_Room]) -> Atlas | None:
    """Puts the textures in shelves, the highest first, at the width that needs few texels without becoming a narrow
    strip."""
    area = sum(room.width * room.height for room in rooms)
    if area > _MOST_TEXELS:
        return None
    order = sorted(range(len(rooms)), key=lambda i: (-rooms[i].height, -rooms[i].width))
    widest = max(room.width for room in rooms)
    widths = np.cumsum([rooms[i].width for i in order])[:_TRIED].tolist()
    widths += [k * sqrt(area) for k in (1, 1.1, 1.25, 1.5, 2)]
    unit = max(room.unit for room in rooms)
    found: list[Atlas] = []
    for width in sorted({_up(max(width, widest), unit) for width in widths}):
        if width <= _LONGEST:
            atlas = _in_shelves(rooms, order, width, unit)
            if atlas.height <= _LONGEST and width * atlas.height <= _MOST_TEXELS:
                found.append(atlas)
    return min(found, key=lambda a: a.width * a.height * max(a.width, a.height), default=None)


def _in_shelves(rooms: list[_Room], order: list[int], width: int, unit: int) -> Atlas:
    cells: dict[int, Cell] = {}
    x = y = shelf = 0
    for i in order:
        room = rooms[i]
        x = _up(x, room.unit)
        if x + room.width > width:
            x, y, shelf = 0, _up(y + shelf, unit), 0
        cells[i] = Cell(x, y, room.width, room.height, room.columns, room.rows)
        x, shelf = x + room.width, max(shelf, room.height)
    return Atlas(width, _up(y + shelf, unit), [cells[i] for i in range(len(rooms))])
