"""The captured light of `fastibl live`, kept in a file for its next start."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..environment_files import read_environment, write_environment

if TYPE_CHECKING:
    from .._fastibl import CubeMap, FrameResult

_PERIOD = 300.0  # seconds between writings
_DARK = 0.02  # share of the brightest map's radiance below which a map is not kept: what is unseen has no light then


class KeptMap:
    """Reads a map at the start, as `prior`, and writes what was captured every few minutes and on close().

    say: called with one line when the file cannot be read or written, which ends nothing. A context manager.
    Raises ValueError for another ending than .ktx2, a cube map of the session's own texels: an equirectangular picture
    would blur the unseen sky a little more with each start.
    """

    def __init__(self, path: Path, say: Callable[[str], None]):
        if path.suffix.lower() != ".ktx2":
            raise ValueError(f"a map that is kept must end in .ktx2, got {path.name}")
        self.path, self._say = path, say
        self._readable = True  # what is there is never replaced where it could not be read
        self.prior = self._read()
        self._brightest = 0.0 if self.prior is None else _brightness(self.prior)
        self._newest: FrameResult | None = None
        self._due = time.monotonic() + _PERIOD
        self._writing: threading.Thread | None = None
        self._told = False

    def note(self, result: FrameResult) -> None:
        """Takes a frame's result; now and then, its map is written in a thread of its own."""
        self._newest = result
        if time.monotonic() >= self._due and (self._writing is None or not self._writing.is_alive()):
            self._due = time.monotonic() + _PERIOD
            self._writing = threading.Thread(target=self._write, args=(result,), name="fastibl map", daemon=True)
            self._writing.start()

    def close(self) -> None:
        self._wait()
        result, self._newest = self._newest, None
        if result is not None:
            self._write(result)

    def _wait(self) -> None:
        if self._writing is not None:
            self._writing.join()

    def _read(self) -> CubeMap | None:
        if not self.path.exists():
            return None
        try:
            return read_environment(self.path)
        except (OSError, ValueError) as error:
            self._readable = False
            self._say(f"light is captured without an earlier map, and {self.path} stays as it is: {error}")
            return None

    def _write(self, result: FrameResult) -> None:
        environment = result.environment
        if not self._readable or environment is None or not environment.coverage > 0:
            return
        brightness = _brightness(environment.radiance)
        if brightness <= _DARK * self._brightest:
            self._tell(f"{self.path} stays as it is: it is dark here")
            return
        self._brightest = max(self._brightest, brightness)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_environment(self.path, environment)
        except OSError as error:
            self._tell(f"the map is not kept: {error}")

    def _tell(self, line: str) -> None:
        """Once: a disk stays full, and a night is long."""
        if not self._told:
            self._told = True
            self._say(line)

    def __enter__(self) -> KeptMap:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _brightness(cube: CubeMap) -> float:
    return float(cube.faces.mean())
