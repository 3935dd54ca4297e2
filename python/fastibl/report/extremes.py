"""The suite of extreme cases: what must hold where light, objects and cameras are at their limits."""

from __future__ import annotations

from collections import defaultdict

from ..extremes import all_cases, run_case
from ..gl_device import gl_device
from ..measuring import row
from .inputs import Inputs
from .section import Section, Table

_WHAT = """Suns a hundred million times as bright as the sky, black maps, maps with holes, mirrors and chalk, objects that
are no objects, cameras at grazing angles: each case states what must hold, and what came out. “Digits lost”: decimal
digits by which a result is less exact than single precision can store it. The command “fastibl extremes” runs them alone."""


def measure(inputs: Inputs) -> Section:
    section = Section("extremes", "Extreme cases", _WHAT)
    quick = inputs.effort.name != "full"
    cases = all_cases(backend="cpu" if quick or gl_device()[1] else "all")
    if quick:
        # A few cases of each step, none that takes seconds: the full report and `fastibl extremes` run all of them.
        by_step = defaultdict(list)
        for case in cases:
            if not case.long:
                by_step[case.step].append(case)
        cases = [case for each in by_step.values() for case in each[:: max(1, len(each) // 3)][:3]]
        section.seen.append(f"A quick report runs {len(cases)} of the cases.")
    found = [run_case(case) for case in cases]
    broken = [r for r in found if not r.held]
    section.seen.append(f"{len(found) - len(broken)} of {len(found)} expectations hold.")
    for r in broken:
        section.seen.append(f"Broken: {r.step}, {r.name}: {r.outcome}; expected: {r.expectation}.")
    steps = list(dict.fromkeys(r.step for r in found))
    count = [[s, str(sum(r.step == s for r in found)), str(sum(r.step == s and r.held for r in found)),
              _lost([r.lost for r in found if r.step == s and r.lost is not None])] for s in steps]  # fmt: skip
    section.tables.append(Table(["step", "cases", "hold", "digits lost, at most"], count))
    every = [
        [f"{r.step}: {r.name}" + (" [gl]" if r.backend == "gl" else ""), "✓" if r.held else "✗", r.expectation, r.outcome,
         "" if r.lost is None else f"{r.lost:.1f}"]
        for r in found
    ]  # fmt: skip
    section.tables.append(Table(["case", "", "expected", "came out", "digits lost"], every))
    for s in steps:
        share = sum(r.step == s and not r.held for r in found) / sum(r.step == s for r in found)
        section.rows.append(row("all", s, "share of broken expectations", share, step="extremes"))
    return section


def _lost(values: list[float]) -> str:
    return f"{max(values):.1f}" if values else "–"
