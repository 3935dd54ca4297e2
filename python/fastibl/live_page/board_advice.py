"""Says why the board is not seen in the newest picture."""

from __future__ import annotations

import threading
import time

import numpy as np

from ..explain_tracking import why_no_pose
from ..tracking import Tracker
from .snapshot import Snapshot

_PERIOD = 1.5  # seconds between searches: one takes some tenths of a second


class BoardAdvice:
    """Advice for pictures in which there is no pose. It is worked out at most every _PERIOD, and by one thread at a
    time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made, self._text = -np.inf, ""

    def of(self, snapshot: Snapshot) -> str:
        """The advice; empty where the board is seen, or none is looked for."""
        frame, result = snapshot.frame, snapshot.result
        lost = result is not None and result.back_from_marker is None and result.turned is None
        if not lost or frame is None or frame.back is None or snapshot.board is None:
            self._text = ""
            return ""
        if self._lock.acquire(blocking=False):
            try:
                if time.monotonic() - self._made >= _PERIOD:
                    board, camera = snapshot.board, snapshot.rig.back
                    found = Tracker(board, camera).track(frame.back)  # the board may be seen in this picture alone
                    self._text = why_no_pose(frame.back, board, camera) if found is None else ""
                    self._made = time.monotonic()
            finally:
                self._lock.release()
        return self._text
