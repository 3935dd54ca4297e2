"""Corners of a board's tags in pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Board, Camera, _grey, _refine_corners
from ..tracking import detect


@dataclass(frozen=True)
class Seen:
    """Tags of one picture: ids, and their corners on the board (n, 4, 2) in metres and in the picture, pixels."""

    ids: tuple[int, ...]
    on_board: NDArray[np.float64]
    pixels: NDArray[np.float64]

    def points(self) -> NDArray[np.float32]:
        """(4 n, 3) for OpenCV."""
        return np.pad(self.on_board.reshape(-1, 2), ((0, 0), (0, 1))).astype(np.float32)

    def opencv_pixels(self) -> NDArray[np.float32]:
        """(4 n, 2), counted from the centre of the upper left pixel as OpenCV does."""
        return (self.pixels.reshape(-1, 2) - 0.5).astype(np.float32)


def find_corners(picture: ArrayLike, board: Board, camera: Camera) -> Seen:
    """Tags of the board, their corners refined in linear light.

    camera: its lens and response; a guess will do, and a better one finds better corners.
    """
    grey = _grey(picture, camera)
    known = {tag.id: np.asarray(tag.corners) for tag in board.tags}
    tags = _refine_corners(
        grey, [t for t in detect(grey, board, camera)[0] if t[0] in known], board.border_bits, camera
    )
    return Seen(
        tuple(tag.id for tag in tags),
        np.array([known[tag.id] for tag in tags]).reshape(-1, 4, 2),
        np.array([tag.corners for tag in tags]).reshape(-1, 4, 2),
    )


def size_of(pictures: Sequence[ArrayLike]) -> tuple[int, int]:
    """(width, height) that all pictures share; ValueError where they do not, or there are none."""
    sizes = {np.shape(p)[1::-1] for p in pictures}
    if len(sizes) != 1:
        raise ValueError(f"expected pictures of one size, got {sorted(sizes) or 'none'}")
    return sizes.pop()
