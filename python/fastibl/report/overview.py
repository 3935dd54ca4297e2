"""All steps at a glance, with the signed bias of every term."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..measuring import row, seconds_text
from .plots import Dumbbells
from .section import Section, Table, percent, signed
from .steps import CHOSEN, PAPER

_WHAT = """Each step in one line: ★ what fastibl does by default, ◇ what the paper does. Errors are relative, so 1 %
can hardly be seen and 20 % is plainly wrong; to the left is better in both plots. The sections below tell what each
step is and how it is measured."""
_BIAS = """An error may point either way. What stays when all surfaces, views and points are averaged is the bias: whether
a method makes things too bright (+) or too dark (−) on the whole. For shadows: of the light that the object keeps away,
so below 0 the shadow is too weak. Mean over all places."""


def overview(sections: Sequence[Section]) -> Section:
    out = Section("overview", "At a glance", _WHAT)
    steps = [s for s in sections if s.best.get(CHOSEN)]
    table = []
    for s in steps:
        ours, theirs = s.best[CHOSEN], s.best.get(PAPER)
        ratio = theirs.error / max(ours.error, 1e-9) if theirs else float("nan")
        name = f"{ours.label}: {ours.note}" if ours.note else ours.label
        table.append([
            s.title, name, percent(ours.error), seconds_text(ours.time.median),
            theirs.label if theirs else "–", percent(theirs.error) if theirs else "–",
            seconds_text(theirs.time.median) if theirs else "–",
            f"{ratio:.2g} ×" if ratio < 99.5 else f"{ratio:.0f} ×",
        ])  # fmt: skip
    head = ["step", "★ default", "error", "time", "◇ the paper's", "error", "time", "less error"]
    pairs = [
        (s.title, (s.best[CHOSEN].error, s.best[CHOSEN].time.median),
         (s.best[PAPER].error, s.best[PAPER].time.median) if s.best.get(PAPER) else None)
        for s in steps
    ]  # fmt: skip
    if pairs:
        out.charts.append(Dumbbells("overview", "Error and time of every step", pairs))
    out.tables.append(
        Table(head, table, note="Time: of one surface, one pair, one map or one frame; see each section.")
    )
    if worst := [s for s in steps if s.best.get(PAPER)]:
        better = sum(s.best[CHOSEN].error < s.best[PAPER].error for s in worst)
        faster = sum(s.best[CHOSEN].time.median <= 1.1 * s.best[PAPER].time.median for s in worst)
        ratios = [s.best[PAPER].error / max(s.best[CHOSEN].error, 1e-9) for s in worst]
        out.seen.append(
            f"The default is more exact than the paper's method in {better} of {len(worst)} steps, by a factor of "
            f"{np.exp(np.mean(np.log(ratios))):.2g} (geometric mean), and as fast or faster in {faster}."
        )
    return out


def biases(sections: Sequence[Section]) -> Section:
    out = Section("bias", "Too bright or too dark?", _BIAS)
    table = []
    for s in sections:
        results = {mark: s.best[mark] for mark in (CHOSEN, PAPER) if s.best.get(mark) and s.best[mark].biases}
        if not results:
            continue
        cells = []
        for mark in (CHOSEN, PAPER):
            r = results.get(mark)
            spread = "–" if r is None or len(r.biases) < 2 else (
                f"{signed(min(r.biases.values()))} … {signed(max(r.biases.values()))}"
            )  # fmt: skip
            cells += [signed(r.bias) if r else "–", spread]
            if r is not None:
                out.rows.append(row(r.method, s.name, "bias", r.bias, setting=r.setting, step="bias"))
        table.append([s.title, *cells])
    head = ["term", "★ default", "least … most of a place", "◇ the paper's", "least … most of a place"]
    out.tables.append(Table(head, table))
    return out
