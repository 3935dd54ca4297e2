"""Points of error against time, and the frontier that nothing beats.

A row is a point where it has both an error and a time. Rows of one method and setting are one point, whatever their
case and exponent: the mean of their errors, the median of their times.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from .rows import Row


def label(method: str, setting: str) -> str:
    """ "sh9-lobes lobes=4"; "directions=64" alone where the setting names the method."""
    return setting if setting.startswith(f"{method}=") else f"{method} {setting}".strip()


@dataclass(frozen=True)
class Point:
    method: str
    setting: str
    seconds: float
    error: float

    @property
    def label(self) -> str:
        """Method and setting, as plots show them."""
        return label(self.method, self.setting)


def points(rows: Iterable[Row]) -> dict[str, list[Point]]:
    """Points by metric, one a method and setting: rows of other cases and exponents are averaged, and the time is their
    median. One thread and one back end at a time: others are left out where rows of one thread on the CPU are there."""
    found: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for r in rows:
        if r.error is not None and r.seconds is not None:
            setting = " ".join(s for s in r.setting.split() if not s.startswith("exponent="))
            found[r.metric, r.method, setting].append(r)
    plots: dict[str, list[Point]] = defaultdict(list)
    for (metric, method, setting), every in found.items():
        same = [r for r in every if (r.threads, r.backend) == (1, "cpu")] or every
        seconds = median(r.seconds for r in same if r.seconds is not None)
        error = sum(r.error for r in same if r.error is not None) / len(same)
        plots[metric].append(Point(method, setting, seconds, error))
    return dict(plots)


def frontier(all_points: Sequence[Point]) -> list[Point]:
    """The points that no other point beats in both time and error, from fast to exact."""
    best: list[Point] = []
    for p in sorted(all_points, key=lambda p: (p.seconds, p.error)):
        if not best or p.error < best[-1].error:
            best.append(p)
    return best
