"""Videos for people: VP9 in WebM, which browsers play."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


class VideoWriter:
    """Writes RGB pictures (h, w, 3) uint8 of one size as a .webm; a context manager.

    Raises ValueError for another ending or a picture of another size, OSError where the file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], fps: float):
        self.path, self.fps = Path(path), float(fps)
        if self.path.suffix != ".webm":
            raise ValueError(f"a video must end in .webm, got {self.path.name}")
        self._writer: cv2.VideoWriter | None = None
        self._shape: tuple[int, ...] = ()

    def add(self, picture: NDArray[np.uint8]) -> None:
        if self._writer is None:
            self._shape = picture.shape
            self.path.parent.mkdir(parents=True, exist_ok=True)
            code = cv2.VideoWriter.fourcc(*"VP90")
            self._writer = cv2.VideoWriter(str(self.path), code, self.fps, (picture.shape[1], picture.shape[0]))
            if not self._writer.isOpened():
                raise OSError(f"cannot write the video {self.path}")
        if picture.shape != self._shape:
            raise ValueError(f"a video's pictures must all have shape {self._shape}, got {picture.shape}")
        self._writer.write(np.ascontiguousarray(picture[..., ::-1]))

    def close(self) -> None:
        if self._writer is not None:
            self._writer.release()

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
