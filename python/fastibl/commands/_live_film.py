"""The video of `fastibl live`."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..free_disk import check_free
from ..video import VideoWriter

_CHECKS = 0.5  # seconds between looks at the disk


class LiveFilm:
    """Writes pictures as a video until the disk is full; what was written is then kept, and the program goes on.

    say: called with one line when the video ends early. A context manager.
    """

    def __init__(self, path: Path, fps: float, say: Callable[[str], None]):
        self.path, self.written, self._say = path, 0, say
        self.error: Exception | None = None  # what ended it early
        self._video: VideoWriter | None = None
        self._checked = time.monotonic()
        try:
            check_free(path)  # before anything is made
        except OSError as error:
            self._end(error)
        else:
            self._video = VideoWriter(path, fps, keep_cut=True)

    def add(self, picture: NDArray[np.uint8], moment: float) -> None:
        """moment: seconds, as of VideoWriter.add()."""
        if self._video is None:
            return
        try:
            if time.monotonic() - self._checked > _CHECKS:
                self._checked = time.monotonic()
                check_free(self.path)
            self._video.add(picture, moment)
            self.written += 1
        except Exception as error:  # noqa: BLE001 - a disk that is full, or gone
            self._end(error)

    def close(self) -> None:
        if self._video is None:
            return
        video, self._video = self._video, None
        try:
            video.close()
        except Exception as error:  # noqa: BLE001 - as above
            self._end(error)

    def _end(self, error: Exception) -> None:
        if self.error is None:
            self.error = error
            self._say(f"the video {self.path} ended after {self.written} pictures: {error}")
        self.close()

    def __enter__(self) -> LiveFilm:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
