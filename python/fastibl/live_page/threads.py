"""Threads that are used again and again: OpenCV keeps 900 bytes for each thread that ever scaled a picture."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable


class Threads:
    """Runs each job in a thread of its own, at once: in one that has finished its last job, or else in a new one. The
    program's end does not wait for them."""

    def __init__(self, name: str):
        self._name = name
        self._lock = threading.Lock()
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._free = 0  # threads that wait for a job
        self._open = True

    def run(self, job: Callable[[], None]) -> None:
        """job: must not raise."""
        with self._lock:
            if not self._open:
                return
            begins = self._free == 0
            if begins:
                thread = threading.Thread(target=self._work, name=self._name, daemon=True)
            else:
                self._free -= 1
            self._jobs.put(job)
        if begins:
            thread.start()

    def close(self) -> None:
        """Ends the threads, those at work after their jobs."""
        with self._lock:
            self._open = False
            for _ in range(self._free):
                self._jobs.put(None)

    def _work(self) -> None:
        while job := self._jobs.get():
            job()
            with self._lock:
                if not self._open:
                    return
                self._free += 1
