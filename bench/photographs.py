"""Photographs that other people took, beside the project."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl._fastibl import _grey, _refine_corners
from fastibl.expected import present
from fastibl.tracking import detect

from .inputs import SHARED

TAGS = sorted((SHARED / "apriltag").glob("*.jpg"))  # pictures full of tags that all have id 0
GRID = sorted((SHARED / "aprilgrid").glob("*.jpg"))  # pictures of a Kalibr grid, taken with a telephone
NO_GRID = f"no photographs in {SHARED / 'aprilgrid'}"


def read(path: Path) -> NDArray[np.uint8]:
    return np.ascontiguousarray(present(cv2.imread(str(path)))[..., ::-1])


def grid(terms: int) -> tuple[fastibl.Board, fastibl.Camera, list[NDArray[np.uint8]]]:
    """The grid, the camera and the photographs of GRID. The lens is fitted once, to all of them.

    terms: those of its distortion, 4 (k1 k2 p1 p2) or 5 (and k3).
    """
    images = [read(path) for path in GRID]
    height, width = images[0].shape[:2]
    board = fastibl.Board.kalibr(6, 6, 0.088, 0.3)
    guess = fastibl.Camera(width, height, 900.0, 900.0, width / 2, height / 2)
    on_board = {tag.id: np.pad(tag.corners, ((0, 0), (0, 1))) for tag in board.tags}
    points, pixels = [], []
    for image in images:
        grey = _grey(image, guess)
        tags = _refine_corners(grey, detect(grey, board, guess)[0], board.border_bits, guess)
        points.append(np.concatenate([on_board[tag.id] for tag in tags]).astype(np.float32))
        pixels.append(np.concatenate([tag.corners - 0.5 for tag in tags]).astype(np.float32))
    flags = cv2.CALIB_FIX_K3 if terms == 4 else 0
    _, K, lens, *_ = cv2.calibrateCamera(points, pixels, (width, height), None, None, flags=flags)
    return board, fastibl.Camera.from_opencv(K, lens.ravel()[:terms].tolist(), (width, height)), images
