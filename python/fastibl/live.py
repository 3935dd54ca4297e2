"""A session that keeps going: frames of any source, whatever is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import FrameResult
from .calibration_files import CAMERAS
from .expected import expect, expect_source
from .recording import Frame
from .session import Session

_ROWS = 61  # step between the rows that are compared first
_NOISY = 0.01  # share of a picture's values, at least, that are neither black nor white where noise is to be seen
_SET_BACK = 1.0  # seconds by which a frame is earlier than the last where a clock was set


@dataclass(frozen=True)
class Played:
    """A frame as it was used, and the session's result. result: None where nothing of the frame could be used. refused:
    by "back", "front" or "frame", the reason why this picture or the whole frame was left out; by "time", how a clock
    was set back."""

    frame: Frame
    result: FrameResult | None
    refused: dict[str, str]


class _Watch:
    """Leaves out pictures that say nothing about the present moment."""

    def __init__(self, rig: Any):
        self._rig = rig
        self._last: dict[str, NDArray | None] = dict.fromkeys(CAMERAS)

    def usable(self, frame: Frame) -> tuple[Frame, dict[str, str]]:
        used, refused = replace(frame), {}
        for name in CAMERAS:
            picture = getattr(frame, name)
            if picture is None:
                continue
            why = self._wrong(name, picture, getattr(frame, f"{name}_exposure"))
            if why:
                setattr(used, name, None)
                setattr(used, f"{name}_exposure", 1.0)
                refused[name] = why
            # A copy: sources may use the memory for the next picture.
            self._last[name] = picture.copy() if isinstance(picture, np.ndarray) else None
        return used, refused

    def _wrong(self, name: str, picture: NDArray, exposure: float | None) -> str | None:
        camera = getattr(self._rig, name)
        if camera is None:
            return f"the rig has no {name} camera"
        shape = (camera.height, camera.width, 3)
        if getattr(picture, "shape", None) != shape:
            return f"expected a picture of shape {shape}, got {getattr(picture, 'shape', type(picture).__name__)}"
        if exposure is not None and not (exposure > 0 and np.isfinite(exposure)):
            return f"an exposure must be positive and finite, got {exposure}"
        # Sensors are noisy: no two of their pictures agree in every bit.
        last = self._last[name]
        if last is not None and _same(picture, last) and _shows_noise(picture):
            return "the same picture again: the camera froze"
        return None


def _same(a: NDArray, b: NDArray) -> bool:
    """Compares a few rows first: they tell nearly all pictures apart."""
    return np.array_equal(a[::_ROWS], b[::_ROWS]) and np.array_equal(a, b)


def _shows_noise(picture: NDArray) -> bool:
    """Black and white pictures show none, and repeat themselves: a covered camera's, or those of a held exposure."""
    white = np.iinfo(picture.dtype).max if picture.dtype.kind in "iu" else 1.0
    values = picture / white
    return bool(((values > 0.012) & (values < 0.988)).mean() >= _NOISY)


def play(session: Session, source: Any) -> Generator[Played, None, None]:
    """Processes a live source's frames one by one; what cannot be used is left out and named, and the session goes on.

    A picture whose size is not the camera's, or that repeats the last one to the bit and shows more than
    black and white, is left out; the other camera's
    picture is still used. A frame that the session refuses is skipped as a whole, also one that is up to a second
    earlier than the last; where the camera's clock was set back by more, times start anew.
    """
    expect(session, Session, "session")
    expect_source(source)
    return _play(session, source)


def _play(session: Session, source: Any) -> Generator[Played, None, None]:
    watch, last = _Watch(source.rig), -math.inf
    for frame in source:
        used, refused = watch.usable(frame)
        result = None
        if used.back is not None or used.front is not None:
            if frame.time < last - _SET_BACK:
                session.restart_clock()
                refused["time"] = f"set back by {last - frame.time:.3g} s: times start anew"
            try:
                result = session.process(used)
                last = frame.time
            except (ValueError, TypeError) as error:
                refused["frame"] = str(error)
        yield Played(used, result, refused)
