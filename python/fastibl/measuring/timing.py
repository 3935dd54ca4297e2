"""Times of calls: medians with their spread, and the yardstick by which machines are compared."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ContextDecorator
from dataclasses import dataclass
from functools import wraps
from inspect import isgeneratorfunction
from typing import Any, TypeVar, cast

import cv2
import numpy as np

from .._fastibl import set_threads, threads

_F = TypeVar("_F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Timing:
    """Wall and CPU seconds of a call: median, 10th and 90th percentile over repetitions."""

    median: float
    low: float
    high: float
    cpu: float  # median of the process's CPU time, all threads
    cpu_low: float
    cpu_high: float
    count: int

    @property
    def of_cpu(self) -> Timing:
        """CPU time in place of wall time: for one thread on a busy machine."""
        return Timing(self.cpu, self.cpu_low, self.cpu_high, self.cpu, self.cpu_low, self.cpu_high, self.count)

    def scaled(self, items: float) -> Timing:
        """The same for one of `items` equal parts of a call."""
        return Timing(
            self.median / items,
            self.low / items,
            self.high / items,
            self.cpu / items,
            self.cpu_low / items,
            self.cpu_high / items,
            self.count,
        )


def timing(walls: Iterable[float], cpus: Iterable[float]) -> Timing:
    """The robust centre and spread of measured seconds. Raises ValueError where there are none."""
    wall, cpu = np.asarray(list(walls)), np.asarray(list(cpus))
    if not len(wall):
        raise ValueError("no repetition was measured")
    low, middle, high = map(float, np.percentile(wall, (10, 50, 90)))
    cpu_low, cpu_middle, cpu_high = map(float, np.percentile(cpu, (10, 50, 90)))
    return Timing(middle, low, high, cpu_middle, cpu_low, cpu_high, len(wall))


class _On(ContextDecorator):
    """Sets the number of threads for a block or a function; for a function that yields, until its last value."""

    def __init__(self, count: int):
        self._count = count

    def _recreate_cm(self) -> _On:
        return _On(self._count)  # a new one for each call

    def __enter__(self) -> None:
        self._before = threads()
        set_threads(self._count)

    def __exit__(self, *_: object) -> None:
        set_threads(self._before)

    def __call__(self, function: _F) -> _F:
        if not isgeneratorfunction(function):
            return super().__call__(function)

        @wraps(function)
        def on(*given: Any, **named: Any) -> Iterator[Any]:
            with self._recreate_cm():
                yield from function(*given, **named)

        return cast("_F", on)


def one_core() -> _On:
    """The library on one thread, as a block or, with @one_core(), a whole function."""
    return _On(1)


def all_cores() -> _On:
    """The library on all cores, for computing truths."""
    return _On(0)


def measure(call: Callable[..., Any], inputs: Sequence[Any], repetitions: int = 15, warm: int = 2) -> Timing:
    """Times call(input) over `inputs` in turn, so that each repetition gets another input than the one before."""
    if not len(inputs):
        raise ValueError("measure needs at least one input")
    for k in range(warm):
        call(inputs[k % len(inputs)])
    walls, cpus = [], []
    for k in range(repetitions):
        given = inputs[k % len(inputs)]
        wall, cpu = time.perf_counter(), time.process_time()
        call(given)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return timing(walls, cpus)


def yardstick(repetitions: int = 41) -> Timing:
    """cv2.remap of a 1024 x 512 float RGB map to six faces of 256 squared, with float maps made beforehand, on one
    thread."""
    rng = np.random.default_rng(0)
    pictures = [rng.random((512, 1024, 3), np.float32) for _ in range(2)]
    s, t = np.meshgrid((np.arange(256) + 0.5) / 128 - 1, (np.arange(256) + 0.5) / 128 - 1)
    one = np.ones_like(s)
    maps = []
    for x, y, z in ((one, s, t), (-one, s, t), (s, one, t), (s, -one, t), (s, t, one), (s, t, -one)):
        u = (0.5 + np.arctan2(x, y) / (2 * np.pi)) * 1024 - 0.5
        v = np.arctan2(np.hypot(x, y), z) / np.pi * 512 - 0.5
        maps.append((u.astype(np.float32), v.astype(np.float32)))
    # After a block of this size, the allocator keeps freed memory. Without it, fresh memory from the system can cost a
    # factor of up to three, or nothing, depending on what the process did before.
    np.empty(1 << 24, np.uint8)
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return measure(
            lambda image: [cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP) for u, v in maps],
            pictures,
            repetitions,
        )
    finally:
        cv2.setNumThreads(before)


_LATELY = 20.0  # seconds for which a measured yardstick holds
_measured = (-math.inf, 0.0)  # when, and seconds of CPU time


def yardstick_seconds() -> float:
    """The yardstick in CPU time, which stays the same on a busy machine, as it is now: shared machines run at half of
    their speed for minutes."""
    global _measured
    if time.monotonic() - _measured[0] > _LATELY:
        seconds = yardstick(15).cpu
        _measured = (time.monotonic(), seconds)
    return _measured[1]


def side_by_side(
    calls: Mapping[str, Callable[[int], Any]], rounds: int = 7, warm: int = 1, each_at_least: float = 0.0
) -> tuple[dict[str, Timing], float]:
    """Times call(round) of all calls in turn, so that whatever slows the machine down for a while slows all of them.

    each_at_least: seconds for which a call is repeated within a round; its time is then that of one repetition. Returns
    the timings, and the CPU seconds of the yardstick, which runs in each round, too.
    """
    if not calls:
        raise ValueError("side_by_side needs at least one call")
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    repeated = dict.fromkeys(calls, 1)
    yards: list[float] = []
    first = next(iter(calls.values()))
    for k in range(-warm, rounds):
        if k > 0:
            first(k + warm - 1)  # the yardstick ran last and filled the caches
        for name, call in calls.items():
            wall, cpu = time.perf_counter(), time.process_time()
            for _ in range(repeated[name]):
                call(k + warm)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            if k < 0:
                repeated[name] = max(1, min(1000, int(each_at_least / max(wall, 1e-9))))
            else:
                spent[name].append((wall / repeated[name], cpu / repeated[name]))
        if k >= 0:
            yards.append(yardstick(1).cpu)
    return {name: timing(*zip(*pairs, strict=True)) for name, pairs in spent.items()}, float(np.median(yards))
