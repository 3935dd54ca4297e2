"""The corners of a board's tags in pictures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Board, Camera, Response, _grey, _refine_corners
from ..explain_tracking import explain_tags, runs
from ..pictures import unit
from ..tracking import detect

_WHITE = 0.99  # share of a picture's values that lie below its white
_TOLD = 3  # number of pictures for which an error says what they show: each takes some tenths of a second


@dataclass(frozen=True)
class Seen:
    """The tags of one picture: ids, and their corners (n, 4, 2) on the board, in metres, and in the picture, in
    pixels."""

    ids: tuple[int, ...]
    on_board: NDArray[np.float64]
    pixels: NDArray[np.float64]

    def points(self) -> NDArray[np.float32]:
        """Points on the board (4 n, 3) for OpenCV."""
        return np.pad(self.on_board.reshape(-1, 2), ((0, 0), (0, 1))).astype(np.float32)

    def opencv_pixels(self) -> NDArray[np.float32]:
        """Pixels (4 n, 2), counted from the centre of the upper left pixel as OpenCV does."""
        return (self.pixels.reshape(-1, 2) - 0.5).astype(np.float32)


def grey_of(picture: ArrayLike, camera: Camera) -> tuple[NDArray[np.uint8], Camera]:
    """(height, width) uint8, and the camera with the response by which that picture is encoded.

    uint16 pictures are brightened to white and encoded again: 8 bits of a dark or linear picture would show no tags.
    """
    pixels = np.asarray(picture)
    if pixels.dtype.newbyteorder("=") != np.uint16:
        return _grey(picture, camera), camera
    light = camera.response.decode(unit(pixels))
    white = float(np.quantile(light[::4, ::4], _WHITE))
    encoded = camera.replace(response=Response.srgb())
    return _grey(light / np.float32(white if white > 0 else 1), encoded), encoded


def find_corners(picture: ArrayLike, board: Board, camera: Camera, refine: bool = True) -> Seen:
    """Finds the tags of the board, with their corners refined in linear light.

    camera: its lens and response; a guess will do where lines are nearly straight, and a better lens finds better
    corners. refine: False keeps corners as detected, some 0.7 pixels off, for a lens that bends lines and about which
    nothing is known. Tags that are too small to be refined are left out: one of them is as far off as a hundred others.
    """
    grey, camera = grey_of(picture, camera)
    known = {tag.id: np.asarray(tag.corners) for tag in board.tags}
    found = [(tag, np.asarray(corners)) for tag, corners in detect(grey, board, camera)[0] if tag in known]
    if refine:
        refined = _refine_corners(grey, found, board.border_bits, camera)
        found = [
            (tag.id, tag.corners)
            for tag, (_, before) in zip(refined, found, strict=True)
            if not np.array_equal(tag.corners, before)
        ]
    return Seen(
        tuple(tag for tag, _ in found),
        np.array([known[tag] for tag, _ in found]).reshape(-1, 4, 2),
        np.array([corners for _, corners in found], np.float64).reshape(-1, 4, 2),
    )


def what_is_seen(pictures: Sequence[ArrayLike], left_out: Sequence[int], board: Board, camera: Camera) -> str:
    """What is seen in the first pictures that show too little; it ends an error message: ". In picture 2: ..." or
    nothing."""
    said: dict[str, tuple[str, list[int]]] = {}
    for k in left_out[:_TOLD]:
        grey, _ = grey_of(pictures[k], camera)
        why = explain_tags(grey, board)
        if why is None:
            why = _what_lacks(pictures[k], board, camera)
        said.setdefault(re.sub(r"[\d ,]+", " ", why.replace("to", "")), (why, []))[1].append(k)  # whichever tags
    alike = {k[0]: f" (and alike in {', '.join(map(str, k[1:]))})" if k[1:] else "" for _, k in said.values()}
    told = " ".join(f"In picture {k[0]}{alike[k[0]]}: {why}" for why, k in said.values())
    return f". {told}" if told else ""


def _what_lacks(picture: ArrayLike, board: Board, camera: Camera) -> str:
    """Of a picture in which tags are seen, but too few."""
    seen, refined = ({*find_corners(picture, board, camera, refine).ids} for refine in (False, True))
    small = seen - refined
    return (
        f"Tags {runs(seen)} are seen"
        + (f", of which {runs(small)} are too small to be refined" if small else "")
        + ("; others are out of view, too small or too blurred." if len(seen) < len(board.tags) else ".")
    )


def size_of(pictures: Sequence[ArrayLike]) -> tuple[int, int]:
    """The (width, height) that all pictures share. Raises ValueError where they differ, or there are none."""
    for number, picture in enumerate(pictures):
        if np.ndim(picture) != 3:
            got = "None" if picture is None else f"shape {np.shape(picture)}"
            raise ValueError(f"picture {number} must have shape (height, width, 3), got {got}")
    sizes = {(np.shape(p)[1], np.shape(p)[0]) for p in pictures}
    if len(sizes) != 1:
        raise ValueError(f"expected pictures of one size, got {sorted(sizes) or 'none'}")
    return sizes.pop()
