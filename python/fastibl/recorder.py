"""Records while a source runs: pictures are written in a thread of their own, so that cameras never wait."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ._fastibl import Rig
from .free_disk import LEAST_FREE, check_free
from .recording import CAMERAS, Frame, RecordingWriter

_BUFFER = 256 * 2**20  # bytes of pictures that may wait to be written
_SYNC = 0.5  # seconds between calls that write the list of pictures through to the disk


class Recorder:
    """Writes frames to a recording as they come; a context manager.

    path, rig, board: as in RecordingWriter. buffer: bytes of pictures that may wait; a frame that finds no room is
    dropped and counted. least_free: bytes to keep free on the disk; below that, recording ends with .error. A process
    that is killed loses only what was waiting: every picture is whole before frames.csv names it.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        rig: Rig,
        board: Any = None,
        *,
        buffer: int = _BUFFER,
        least_free: int = LEAST_FREE,
    ):
        self._buffer, self._least_free = buffer, least_free
        self.path = Path(path)
        check_free(self.path, least_free)  # before an older recording is removed
        self._writer = RecordingWriter(path, rig, board)
        self._queue: deque[Frame] = deque()
        self._changed = threading.Condition()
        self._waiting = 0  # bytes
        self._closing = False
        self.written = self.dropped = 0  # frames
        self.error: Exception | None = None
        self._told = False  # whether the error was raised to the caller
        self._thread = threading.Thread(target=self._run, name="fastibl recorder", daemon=True)
        self._thread.start()

    def add(self, frame: Frame, wait: bool = False) -> bool:
        """Takes a frame to be written; returns False if it was dropped. wait: whether to wait for room, for sources
        that can wait. Raises what ended the recording, if anything did, and ValueError after close().
        """
        size = _bytes(frame)
        # Sources may use the memory of a picture for the next one.
        given = {name: getattr(frame, name) for name in (*CAMERAS, "attitude")}
        copies: dict[str, Any] = {name: a.copy() for name, a in given.items() if isinstance(a, np.ndarray)}
        frame = replace(frame, **copies)
        with self._changed:
            if wait:
                self._changed.wait_for(lambda: self.error is not None or self._closing or self._has_room(size))
            if self.error is not None:
                self._told = True
                raise self.error
            if self._closing:
                raise ValueError(f"the recording {self.path} is closed: it takes no more frames")
            if not self._has_room(size):
                self.dropped += 1
                return False
            self._queue.append(frame)
            self._waiting += size
            self._changed.notify_all()
        return True

    def _has_room(self, size: int) -> bool:
        return not self._queue or self._waiting + size <= self._buffer

    def close(self) -> None:
        """Writes what is waiting. Raises what ended the recording if add() did not; what was waiting then counts as
        dropped."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()
        try:
            self._writer.close()
        except OSError as error:  # there was no room for the end of frames.csv
            self.error = self.error or error
        if self.error is not None and not self._told:
            self._told = True
            raise self.error

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, error: object, *_: object) -> None:
        try:
            self.close()
        except Exception:
            if error is None:  # otherwise that exception goes on
                raise

    def _run(self) -> None:
        synced = time.monotonic()
        try:
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._queue or self._closing)
                    if not self._queue:
                        return
                    frame = self._queue[0]  # it counts as waiting while it is written
                self._writer.add(frame)
                with self._changed:
                    self._queue.popleft()
                    self._waiting -= _bytes(frame)
                    self._changed.notify_all()
                self.written += 1
                if time.monotonic() - synced > _SYNC:
                    synced = time.monotonic()
                    self._writer.sync()
                    check_free(self.path, self._least_free)
        except Exception as error:  # noqa: BLE001 - whatever it is, add() and close() tell
            with self._changed:
                self.error = error
                self.dropped += len(self._queue)
                self._queue.clear()
                self._waiting = 0
                self._changed.notify_all()


def _bytes(frame: Frame) -> int:
    return sum(picture.nbytes for picture in (getattr(frame, name) for name in CAMERAS) if picture is not None)
