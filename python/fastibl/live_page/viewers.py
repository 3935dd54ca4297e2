"""Counts who looks at the page: a bounded number of viewers, who are forgotten when they fall silent."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable

_NAME = re.compile(r"[A-Za-z0-9]{8,32}")


class Viewers:
    """most: viewers at a time. silence: seconds without a request after which a viewer counts as gone."""

    def __init__(self, most: int = 4, silence: float = 8.0, clock: Callable[[], float] = time.monotonic):
        self.most, self._silence, self._clock = most, silence, clock
        self._lock = threading.Lock()
        self._seen: dict[str, float] = {}

    def admit(self, name: str) -> bool:
        """Whether there is room for this viewer; if so, the viewer counts from now on. Raises ValueError for an invalid
        name."""
        if not _NAME.fullmatch(name):
            raise ValueError("a viewer's name must be 8 to 32 letters and digits")
        with self._lock:
            self._forget()
            if name not in self._seen and len(self._seen) >= self.most:
                return False
            self._seen[name] = self._clock()
            return True

    def leave(self, name: str) -> None:
        with self._lock:
            self._seen.pop(name, None)

    def __len__(self) -> int:
        with self._lock:
            self._forget()
            return len(self._seen)

    def _forget(self) -> None:
        now = self._clock()
        self._seen = {name: seen for name, seen in self._seen.items() if now - seen < self._silence}
