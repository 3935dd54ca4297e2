"""Shared by the steps: a method's errors over places, its rows, and the table beside its plot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lighting import Method
from ..measuring import Row, Timing, frontier, label, points, row, seconds_text
from .plots import Frontier
from .section import Section, Table, percent, signed, times

CHOSEN, PAPER = "chosen", "paper"


@dataclass
class Result:
    """One method and setting. errors: mean over samples, by place. biases: mean of the estimate divided by mean of the
    truth, less 1.

    mark: CHOSEN, PAPER or "". extra: more columns of the table. note: text beside the name in the table.
    """

    method: str
    setting: str
    errors: dict[str, float]
    biases: dict[str, float]
    time: Timing | None = None
    mark: str = ""
    extra: dict[str, str] = field(default_factory=dict)
    note: str = ""

    @property
    def label(self) -> str:
        return label(self.method, self.setting)

    @property
    def error(self) -> float:
        return float(np.mean(list(self.errors.values())))

    @property
    def bias(self) -> float:
        return float(np.mean(list(self.biases.values()))) if self.biases else float("nan")


def setting_of(method: Method) -> str:
    return " ".join(f"{key}={value}" for key, value in method.settings.items())


def chosen_in(given: list[Method]) -> str:
    """What "auto" chose in the places: "sh9-lobes lobes=1/4/6"."""
    out = []
    for name in sorted({m.name for m in given}):
        settings = [m.settings for m in given if m.name == name]
        values = {key: "/".join(map(str, sorted({s[key] for s in settings}))) for key in settings[0]}
        out.append(" ".join([name, *(f"{key}={value}" for key, value in values.items())]))
    return " or ".join(out)


def sample_errors(estimated: NDArray, true: NDArray) -> NDArray:
    """RMS over RGB of the difference, divided by the mean of the truth; (n,)."""
    return np.sqrt(((np.asarray(estimated, np.float64) - true) ** 2).mean(axis=-1)) / true.mean()


def compared(estimates: Mapping[str, NDArray], truths: Mapping[str, NDArray]) -> tuple[dict, dict]:
    """Mean error and bias by place."""
    errors = {name: float(sample_errors(e, truths[name]).mean()) for name, e in estimates.items()}
    biases = {name: float(np.mean(e, dtype=np.float64) / truths[name].mean() - 1) for name, e in estimates.items()}
    return errors, biases


def rows_of(step: str, metric: str, results: Sequence[Result], yard: float, threads: int = 1) -> list[Row]:
    """Rows for each place, for the mean with its time, for the worst place, and for the bias."""
    out = []
    for r in results:
        common: dict[str, Any] = {"setting": r.setting, "step": step, "threads": threads}
        out += [row(r.method, place, metric, e, **common) for place, e in r.errors.items()]
        worst = max(r.errors.values())
        mean = f"mean of {len(r.errors)} places"
        out.append(row(r.method, mean, metric, r.error, r.time, yard=yard, **common))
        out.append(row(r.method, f"worst of {len(r.errors)} places", metric.partition(";")[0], worst, **common))
        if r.biases:
            out.append(row(r.method, mean, "bias", r.bias, **common))
    return out


def table_of(results: Sequence[Result], ahead: set[str], note: str = "") -> Table:
    """The methods from fast to slow; those on the frontier are marked with a dot."""
    extra = list(dict.fromkeys(key for r in results for key in r.extra))
    head = ["method", "error", "worst place", "bias", "time", *extra]
    ordered = sorted(results, key=lambda r: r.time.median if r.time else np.inf)
    rows = [
        [
            ("● " if r.label in ahead else "") + r.label + (f" ({r.note})" if r.note else ""),
            percent(r.error),
            percent(max(r.errors.values())),
            signed(r.bias) if r.biases else "–",
            seconds_text(r.time.median) if r.time else "–",
            *(r.extra.get(key, "–") for key in extra),
        ]
        for r in ordered
    ]
    marked = {k: r.mark for k, r in enumerate(ordered) if r.mark}
    legend = "★ chosen by default, ◇ the paper's, ● on the frontier. Worst place: the largest of the places' means."
    return Table(head, rows, marked, f"{legend} {note}".strip(), compact=True)


def step_section(
    section: Section, step: str, error: str, time: str, results: Sequence[Result], yard: float, note: str = ""
) -> Section:
    """Adds rows, plot and table of a step to its section."""
    metric = f"{error}; {time}"
    section.rows += rows_of(step, metric, results, yard)
    found = points(r for r in section.rows if r.metric == metric)[metric]
    marked = {mark: [r.label for r in results if r.mark == mark] for mark in (CHOSEN, PAPER)}
    name = step.replace(" ", "-")
    section.charts.append(
        Frontier(f"{name}-error-against-time", section.title, time, error, found, marked[PAPER], marked[CHOSEN])
    )
    ahead = {p.label for p in frontier(found)}
    section.tables.append(table_of(results, ahead, note))
    section.seen += sentences(results)
    section.best = {r.mark: r for r in results if r.mark}
    return section


def sentences(results: Sequence[Result]) -> list[str]:
    """What the numbers say about the chosen method, also compared with the paper's."""
    chosen = next((r for r in results if r.mark == CHOSEN), None)
    paper = next((r for r in results if r.mark == PAPER), None)
    if chosen is None or chosen.time is None:
        return []
    name = f"{chosen.label}: {chosen.note}" if chosen.note else chosen.label
    out = [f"The default ({name}) is wrong by {percent(chosen.error)} and takes {seconds_text(chosen.time.median)}."]
    if paper is not None and paper.time is not None:
        exact, fast = (
            max(paper.error, 1e-9) / max(chosen.error, 1e-9),
            paper.time.median / max(chosen.time.median, 1e-12),
        )
        out.append(
            f"The paper's ({paper.label}) is wrong by {percent(paper.error)} in {seconds_text(paper.time.median)}: the "
            f"default has {_smaller(exact)} error and is {_faster(fast)}."
        )
    return out


def _smaller(ratio: float) -> str:
    ratio = max(ratio, 1e-9)
    return f"{times(ratio)} less" if ratio > 1.1 else "about the same" if ratio > 0.9 else f"{times(1 / ratio)} the"


def _faster(ratio: float) -> str:
    return f"{times(ratio)} faster" if ratio > 1.1 else "about as fast" if ratio > 0.9 else f"{times(1 / ratio)} slower"


def worst_place(results: Sequence[Result], mark: str) -> tuple[Result, str] | None:
    """The result with that mark, and the place where its error is largest."""
    r = next((r for r in results if r.mark == mark), None)
    return None if r is None else (r, max(r.errors, key=lambda name: r.errors[name]))


def cpu_of(name: str, timings: Mapping[str, float], cpu: float) -> float:
    """CPU seconds of one pass of a frame: the frame's CPU time, times the pass's share of the time that passed."""
    return cpu * timings.get(name, 0.0) / max(timings["total"], 1e-9)


Progress = Callable[[str], None]
