"""Cameras that nobody calibrated: which there are, and how large their pictures are."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from .live_camera import open_camera, quiet

_TRIES = 30  # pictures that may fail before a camera counts as one that gives no pictures


class ScaledCapture:
    """A cv2.VideoCapture whose pictures are scaled down to `size` (width, height)."""

    def __init__(self, capture: Any, size: tuple[int, int]):
        self._capture, self._size = capture, size

    def __getattr__(self, name: str) -> Any:
        return getattr(self._capture, name)

    def retrieve(self) -> tuple[bool, Any]:
        read, picture = self._capture.retrieve()
        if read and picture is not None and picture.shape[1::-1] != self._size:
            picture = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA)
        return read, picture


def scaled_opener(sizes: dict[int | str, tuple[int, int]], opener: Callable[[int | str], Any] = open_camera) -> Any:
    """A function for LiveCamera's open_capture, with which each camera, by its device, gives pictures of its size."""
    return lambda device: ScaledCapture(opener(device), sizes[device])


def picture_size(
    device: int | str, asked: tuple[int, int], opener: Callable[[int | str], Any] = open_camera
) -> tuple[int, int]:
    """Size (width, height) in which a camera's pictures are used: the one it gives when asked for `asked`, scaled down
    to that width where it is larger. Where it gives no picture, raises an OSError that says what there is.
    """
    with quiet():
        capture = opener(device)
        try:
            picture = _first_picture(capture, asked)
        finally:
            capture.release()
    if picture is None:
        raise OSError(_missing(device))
    height, width = picture.shape[:2]
    if width <= asked[0]:
        return width, height
    return asked[0], max(16, round(height * asked[0] / width))


def _first_picture(capture: Any, asked: tuple[int, int]) -> np.ndarray | None:
    if not capture.isOpened():
        return None
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, asked[0])
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, asked[1])
    for _ in range(_TRIES):
        read, picture = capture.retrieve() if capture.grab() else (False, None)
        if read and picture is not None and picture.ndim == 3:
            return picture
    return None


def _missing(device: int | str) -> str:
    if isinstance(device, str) and "://" in device:
        return f"the camera {device} does not answer: is its address right, and is it on this network?"
    there = sorted(str(path) for path in Path("/dev").glob("video*")) if os.name == "posix" else []
    listed = f"there are {', '.join(there)}" if there else "none is connected"
    return f"camera {device} gives no picture ({listed}, or another program uses it)"
