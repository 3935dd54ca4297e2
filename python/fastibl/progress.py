"""Progress of work that takes long: a bar on a terminal, or a caller's function."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_PATIENCE = 0.5  # seconds before a bar appears


@contextmanager
def reporting(progress: bool | Callable[[float], object] | None, what: str) -> Iterator[Callable[[float], bool] | None]:
    """What work calls with the part done, and ends where that returns False; None for nothing.

    progress: whether to show a bar on stderr if that is a terminal and the work takes long; or the function itself.
    """
    shown = progress is True and sys.stderr is not None and sys.stderr.isatty()
    bar = _Bar(what) if shown else None
    try:
        yield (lambda done: progress(done) is not False) if callable(progress) else bar
    finally:
        if bar:
            bar.close()


class _Bar:
    """Shows progress on stderr for work that takes long."""

    def __init__(self, what: str) -> None:
        self._what, self._begin, self._bar = what, time.monotonic(), None

    def __call__(self, done: float) -> bool:
        if self._bar is None and time.monotonic() - self._begin > _PATIENCE and done < 1:
            from tqdm import tqdm

            self._bar = tqdm(total=100, desc=self._what, unit="%", leave=False)
        if self._bar is not None:
            self._bar.update(round(100 * done) - self._bar.n)
        return True

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
