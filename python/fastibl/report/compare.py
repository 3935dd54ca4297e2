"""Compares two reports: what became better or worse by more than their spread explains.

The rule, for rows that both reports have (same step, method, setting, case, metric, threads and back end):

- An error is worse where it is more than 5 % above the old one, and by more than 0.0005 (0.05 %); better likewise.
- A bias is judged by its size, in the same way.
- A time is worse where its 10th percentile is more than 1.25 times the old 90th percentile, both in yardsticks of
  their own run, and longer than a microsecond; better likewise. Times from another machine are shown, but do not count.

- An error that became NaN, while its row is still there, is worse.

Whatever is worse is a regression; so is a step of which no row is left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..expected import present
from ..measuring import Row, label, seconds_text
from .section import Section, Table

ERROR_FACTOR, ERROR_LEAST = 1.05, 5e-4
TIME_FACTOR, TIME_LEAST = 1.25, 1e-6
_SHOWN = 60
_NO_ERRORS = ("MiB",)  # metrics whose values are not errors


@dataclass(frozen=True)
class Change:
    """ratio: new divided by old, of the error or of the time in yardsticks. worse: None where the change is within the
    spread."""

    old: Row
    new: Row
    of: str  # "error", "bias" or "time"
    ratio: float
    worse: bool | None

    def text(self, r: Row) -> str:
        if self.of == "time":
            seconds = present(r.seconds)
            low, high = r.spread or (seconds, seconds)
            return f"{seconds_text(seconds)} ({seconds_text(low)} to {seconds_text(high)})"
        return "none" if r.error is None else f"{r.error:.3g}"


@dataclass(frozen=True)
class Comparison:
    """only_old, only_new: rows without a partner. same_machine: whether times count. lost: steps without any row."""

    changes: list[Change]
    only_old: int
    only_new: int
    same_machine: bool
    name: str = "the old report"
    lost: tuple[str, ...] = ()

    @property
    def regressed(self) -> bool:
        return bool(self.worse or self.lost)

    @property
    def worse(self) -> list[Change]:
        counted = [c for c in self.changes if c.worse and (c.of != "time" or self.same_machine)]
        return sorted(counted, key=lambda c: -c.ratio)

    @property
    def better(self) -> list[Change]:
        return sorted((c for c in self.changes if c.worse is False), key=lambda c: c.ratio)

    @property
    def not_counted(self) -> int:
        """Number of times that are longer, but on another machine."""
        return 0 if self.same_machine else sum(bool(c.worse) for c in self.changes if c.of == "time")


def _key(r: Row) -> tuple:
    return r.step, r.method, r.setting, r.case, r.metric, r.threads, r.backend


def compare(old: Sequence[Row], new: Sequence[Row], name: str = "the old report") -> Comparison:
    """Compares rows by the rule above. Raises ValueError where no row is in both."""
    before, after = {_key(r): r for r in old}, {_key(r): r for r in new}
    both = [key for key in after if key in before]
    if not both:
        raise ValueError("the two reports have no row in common: they were made with other inputs, or of other methods")
    changes = []
    for key in both:
        a, b = before[key], after[key]
        if (a.error, b.error) != (None, None) and a.metric not in _NO_ERRORS:
            changes.append(_error_change(a, b))
        if a.yardsticks and b.yardsticks and a.spread and b.spread:
            changes.append(_time_change(a, b))
    machines = {r.cpu for r in (*old, *new)}
    lost = tuple(sorted({r.step for r in old} - {r.step for r in new}))
    return Comparison(changes, len(before) - len(both), len(after) - len(both), len(machines) == 1, name, lost)


def of_other_inputs(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """What differs between two reports' heads; rows of different inputs cannot be compared. Empty where nothing
    differs."""
    out = []
    if (was := old.get("effort")) and was != new.get("effort"):
        out.append(f"the effort ({was}, now {new.get('effort')})")
    before, now = old.get("contents", {}), new.get("contents", {})
    out += [name for name in before if name in now and before[name] != now[name]]
    return ", ".join(out)


def _error_change(a: Row, b: Row) -> Change:
    old, new = (np.nan if r.error is None else abs(r.error) for r in (a, b))
    of = "bias" if "bias" in a.metric else "error"
    if not (np.isfinite(old) and np.isfinite(new)):  # a method that gives NaN now, or did before
        worse = None if np.isfinite(old) == np.isfinite(new) else bool(np.isfinite(old))
        return Change(a, b, of, {None: 1.0, True: np.inf, False: 0.0}[worse], worse)
    least = ERROR_LEAST if "degrees" not in a.metric and "metres" not in a.metric else 0.0
    worse = True if new > ERROR_FACTOR * old and new - old > least else None
    if old > ERROR_FACTOR * new and old - new > least:
        worse = False
    return Change(a, b, of, new / old if old else 1.0 if not new else 1e9, worse)


def _time_change(a: Row, b: Row) -> Change:
    yards, new_yards = present(a.yardsticks), present(b.yardsticks)
    seconds, new_seconds = present(a.seconds), present(b.seconds)
    (low, high), (new_low, new_high) = present(a.spread), present(b.spread)
    old, new = yards / seconds, new_yards / new_seconds  # yardsticks a second
    long = max(seconds, new_seconds) >= TIME_LEAST or "time of one" in a.metric
    worse = True if long and new_low * new > TIME_FACTOR * high * old else None
    if long and low * old > TIME_FACTOR * new_high * new:
        worse = False
    return Change(a, b, "time", new_yards / yards, worse)


def summary(c: Comparison) -> str:
    """One line."""
    machine = "" if c.same_machine else f"; another machine, so {c.not_counted} longer times do not count"
    lost = f"; gone: all of {', '.join(c.lost)}" if c.lost else ""
    return (
        f"{len(c.worse)} worse, {len(c.better)} better, of {len(c.changes)} values in both{machine}; "
        f"{c.only_new} rows are new, {c.only_old} are gone{lost}"
    )


def _lines(changes: Sequence[Change]) -> list[list[str]]:
    return [
        [c.new.step, label(c.new.method, c.new.setting), c.new.case, c.new.metric if c.of != "time" else "time",
         c.text(c.old), c.text(c.new), f"{c.ratio:.2f} ×"]
        for c in changes
    ]  # fmt: skip


def as_text(c: Comparison) -> str:
    """For people at a terminal, with the worst first."""
    out = []
    for title, changes in (("worse", c.worse), ("better", c.better)):
        for line in _lines(changes[:_SHOWN]):
            step, method, case, what, old, new, ratio = line
            out.append(f"{title:7} {step:14} {method:28} {case:28} {what}: {old} -> {new} ({ratio})")
    return "\n".join([*out, summary(c)])


def comparison_section(c: Comparison) -> Section:
    rule = (
        "Worse is: an error more than 5 % (and 0.05 % absolute) above the old one; a time whose 10th percentile is more "
        "than 1.25 times the old 90th percentile, in yardsticks of its own run. Times of another machine do not count."
    )
    section = Section("against", "Against an earlier report", f"{c.name}. {rule}", seen=[summary(c) + "."])
    rows = _lines([*c.worse[:_SHOWN], *c.better[:_SHOWN]])
    marks = {k: "worse" if k < len(c.worse[:_SHOWN]) else "better" for k in range(len(rows))}
    if rows:
        head = ["step", "method", "case", "what", "old", "new", "new by old"]
        section.tables.append(Table(head, rows, marks, "Worst first, then best first."))
    return section
