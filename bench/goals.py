"""The project's own goals: what was measured, the goal, and whether it is met.

    ./dev goals                       all tables
    ./dev goals paper                 one table
    ./dev goals paper --only glossy   the rows whose names hold a word

The exit code is 1 if a row fails, else 0; a row that cannot be measured here is skipped and says why.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# Must be set before anything loads a driver: Mesa's software renderer reads its number of threads only once.
os.environ.setdefault("LP_NUM_THREADS", "2")


@dataclass(frozen=True)
class Goal:
    """One line of a table. passed: None for a line that was skipped, or that has no goal of its own; `goal` then says
    why."""

    what: str
    measured: str
    goal: str
    passed: bool | None
    notes: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        if self.passed and re.search(r"\bnan\b", self.measured):
            return "no"
        return "-" if self.passed is None else "yes" if self.passed else "no"


@dataclass(frozen=True)
class Row:
    """A measurement that fills one or more lines of a table."""

    name: str
    measure: Callable[[], Iterator[Goal]]


class SkipError(Exception):
    """What a row needs is not there: the message says what. The row is skipped."""


TABLES: dict[str, list[Row]] = {}


def row(table: str, name: str) -> Callable[[Callable[[], Iterator[Goal]]], Callable[[], Iterator[Goal]]]:
    """Adds a measurement to a table."""

    def add(measure: Callable[[], Iterator[Goal]]) -> Callable[[], Iterator[Goal]]:
        TABLES.setdefault(table, []).append(Row(name, measure))
        return measure

    return add


def skipped(what: str, reason: str) -> Goal:
    return Goal(what, "skipped", reason, None)


def largest(values: Iterable[float]) -> float:
    """The largest of some values; NaN if one of them is, which max() may pass over. ValueError where there are none."""
    return float(np.max([float(v) for v in values]))


def percent(value: float, digits: int = 3) -> str:
    return f"{100 * value:.{digits}g} %"


def by_map(means: dict[str, float]) -> tuple[str, str]:
    """Notes: the value for each map, and the mean without the studio map."""
    others = [v for name, v in means.items() if "studio" not in name]
    return (
        "by map: " + ", ".join(f"{name} {percent(v)}" for name, v in means.items()),
        f"mean without studio: {percent(sum(others) / max(len(others), 1))}",
    )


def measured(rows: Sequence[Row]) -> Iterator[Goal]:
    """Runs rows one after the other, with a progress line for each on stderr. A row that raises an error fails."""
    for k, r in enumerate(rows, 1):
        print(f"[{k}/{len(rows)}] {r.name} ...", end="", file=sys.stderr, flush=True)
        begin = time.perf_counter()
        try:
            yield from r.measure()
        except SkipError as reason:
            yield skipped(r.name, str(reason))
        except KeyboardInterrupt:  # what was measured is worth printing
            yield Goal(r.name, "interrupted", "to run", False)
            return
        except (Exception, SystemExit) as error:  # one broken row must not hide the others
            yield Goal(r.name, f"{type(error).__name__}: {error}", "to run", False)
        print(f" {time.perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)


def formatted(title: str, goals: Sequence[Goal]) -> str:
    """The table as text, with the notes of each line under it."""
    lines = [("what", "measured", "goal", "pass"), *((g.what, g.measured, g.goal, g.verdict) for g in goals)]
    widths = [max(len(line[k]) for line in lines) for k in range(3)]
    out = [title]
    for k, line in enumerate(lines):
        out.append("  ".join([*(text.ljust(w) for text, w in zip(line[:3], widths, strict=True)), line[3]]))
        if k == 0:
            out.append("-" * (sum(widths) + 10))
        else:
            out += [f"    {note}" for note in goals[k - 1].notes]
    met, failed = (sum(g.verdict == word for g in goals) for word in ("yes", "no"))
    skips = sum(g.measured == "skipped" for g in goals)
    out.append(f"{met} met, {failed} missed, {skips} skipped")
    return "\n".join(out)


def main(arguments: Sequence[str] | None = None) -> int:
    from fastibl import set_threads

    from . import capture, fuzzing, light, paper, plan, product, shadows  # noqa: F401 - fill their tables
    from .measure import commit, cpu, yardstick_seconds

    set_threads(1)  # rows that use more say so
    parser = argparse.ArgumentParser(
        prog="./dev goals", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("table", nargs="?", choices=sorted(TABLES), help="one table (default: all)")
    parser.add_argument("--only", metavar="WORD", help="only the rows whose names hold this word")
    parser.add_argument(
        "--maps", metavar="DIR", type=Path, help="the .hdr and .exr maps of this folder instead of the seven"
    )
    given = parser.parse_args(arguments)
    if given.maps:
        from . import inputs

        inputs.use_maps(given.maps)
        if not inputs.MAPS:
            parser.error(f"no .hdr or .exr map in {given.maps}")
    chosen = {
        name: [r for r in rows if not given.only or given.only.lower() in r.name.lower()]
        for name, rows in TABLES.items()
        if given.table in (None, name)
    }
    if not any(chosen.values()):
        names = ", ".join(r.name for name, rows in TABLES.items() if given.table in (None, name) for r in rows)
        parser.error(f"no row has {given.only!r} in its name; there are: {names}")
    return report(chosen, f"{cpu()}; commit {commit() or 'unknown'}; yardstick {1e3 * yardstick_seconds():.2f} ms")


def report(chosen: dict[str, list[Row]], machine: str) -> int:
    """Measures and prints tables; returns 1 if a line fails, else 0."""
    failed = False
    for name, rows in chosen.items():
        if rows:
            goals = list(measured(rows))
            failed |= any(g.verdict == "no" for g in goals)
            print(formatted(f"goals: {name} ({machine})", goals), flush=True)
    return int(failed)


if __name__ == "__main__":
    from bench.goals import main as run  # the module with which tables register, rather than __main__

    sys.exit(run())
