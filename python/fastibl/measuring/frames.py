"""Times of whole frames in a steady state."""

from __future__ import annotations

import itertools
import time
from typing import Any

from .._fastibl import set_threads, threads
from ..recording import Recording
from ..session import Session
from ..sources import BackAndForth
from .timing import Timing, timing


def steady(
    session: Session, recording: Recording, cores: int = 1, rounds: int = 4
) -> tuple[Timing, list[dict[str, float]], Any]:
    """Plays a recording forth and back: the time of a frame, the seconds of each frame's passes, and the last result.

    The first round warms up and does not count. Tracking and capture are included.
    """
    import cv2

    before = threads(), cv2.getNumThreads()
    set_threads(cores)
    cv2.setNumThreads(cores)
    walls, cpus, passes, result = [], [], [], None
    try:
        # A camera does not jump: the recording goes back the way it came.
        period = recording.duration / max(len(recording) - 1, 1) or 1.0
        every = itertools.islice(BackAndForth(recording, period), (rounds + 1) * len(recording))
        for k, frame in enumerate(every):
            wall, cpu = time.perf_counter(), time.process_time()
            result = session.process(frame)
            result.image  # noqa: B018 - the picture has to arrive
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            if k >= len(recording):
                walls.append(wall)
                cpus.append(cpu)
                passes.append(dict(result.timings))
    finally:
        set_threads(before[0])
        cv2.setNumThreads(before[1])
    return timing(walls, cpus), passes, result
