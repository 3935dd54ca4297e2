"""What the loop shows of itself. Snapshots are immutable, so that servers read them while the session runs on."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._fastibl import Board, FrameResult, Rig
from ..recording import Frame

STATES = ("waiting", "running", "frozen", "ended")


@dataclass(frozen=True)
class Snapshot:
    """One moment of the loop.

    board: the one that is looked for, if any. version: grows with everything that is shown; picture: grows with the
    composites; taken: with the frames of any camera. state: one of STATES, and why. frame, result: the last ones with a
    back picture; front: the last front picture. newest: the last result of any frame, with the newest map. given:
    whether that map was given, not captured. timings: seconds by pass of the last frames. fps: processed pictures a
    second. messages: (number, text), the last ones. preparing: an object that is being made ready. recording: path,
    frames written and dropped. settings: the state of the controls. made: time.monotonic() of the last back picture.
    """

    rig: Rig
    board: Board | None = None
    version: int = 0
    picture: int = 0
    taken: int = 0
    state: str = "waiting"
    reason: str = ""
    frame: Frame | None = None
    result: FrameResult | None = None
    front: NDArray[np.uint8] | None = None
    newest: FrameResult | None = None
    given: bool = False
    timings: tuple[Mapping[str, float], ...] = ()
    fps: float = 0.0
    left_out: str = ""
    messages: tuple[tuple[int, str], ...] = ()
    preparing: str = ""
    recording: tuple[str, int, int] | None = None
    source: str = ""
    dropped: int = 0
    settings: Any = None
    made: float = field(default_factory=time.monotonic)


class Latest:
    """The newest snapshot. Any number of threads can wait for one that is newer than theirs."""

    def __init__(self, first: Snapshot):
        self._snapshot, self._changed, self._closed = first, threading.Condition(), False

    def get(self) -> Snapshot:
        return self._snapshot

    def publish(self, **changes: Any) -> None:
        """Replaces fields of the snapshot and counts up its version; only one thread may call it at a time."""
        with self._changed:
            self._snapshot = replace(self._snapshot, version=self._snapshot.version + 1, **changes)
            self._changed.notify_all()

    def wait_for_picture(self, after: int, timeout: float, number: str = "picture") -> Snapshot:
        """A snapshot whose counter of this name is not `after`, or the newest one when the time is up."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or getattr(self._snapshot, number) != after, timeout)
            return self._snapshot

    def close(self) -> None:
        """Ends all waiting."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
