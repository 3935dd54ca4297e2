"""Times of whole frames in steady state."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from .._fastibl import set_threads, threads
from ..recording import Frame, Recording
from ..session import Session
from .timing import Timing, timing


def later(frame: Frame, seconds: float) -> Frame:
    """The same pictures, taken later."""
    return replace(frame, time=frame.time + seconds)


def steady(
    session: Session, recording: Recording, cores: int = 1, rounds: int = 4
) -> tuple[Timing, list[dict[str, float]], Any]:
    """A recording again and again: the time of a frame, the passes' seconds of each, and the last result.

    The first round warms up and is not counted. Tracking and capture are included.
    """
    import cv2

    before = threads(), cv2.getNumThreads()
    set_threads(cores), cv2.setNumThreads(cores)
    walls, cpus, passes, result = [], [], [], None
    try:
        for k in range(rounds + 1):
            for frame in recording:
                frame = later(frame, k * (recording.duration + 0.1))
                wall, cpu = time.perf_counter(), time.process_time()
                result = session.process(frame)
                result.image  # noqa: B018 - the picture has to arrive
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
                if k:
                    walls.append(wall), cpus.append(cpu), passes.append(dict(result.timings))
    finally:
        set_threads(before[0]), cv2.setNumThreads(before[1])
    return timing(walls, cpus), passes, result
