"""Error against time from the rows of results, one plot per step, with the frontier: see fastibl.measuring.frontier."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from fastibl.lighting import PAPER, STEPS
from fastibl.measuring import Point, Row, frontier, points  # noqa: F401 - part of what this file offers
from fastibl.report import plots

from .measure import ROOT

PLOTS = ROOT / "docs" / "plots"


def draw(metric: str, all_points: Sequence[Point], path: Path) -> None:
    """Writes one plot as SVG, the same bytes for the same rows."""
    error, _, time = metric.partition("; ")
    papers = {str(getattr(PAPER, step)) for step in STEPS} - {"none"}
    chart = plots.Frontier(
        path.stem,
        metric,
        time,
        error,
        all_points,
        paper=[p.label for p in all_points if p.method in papers],
        unit=" degrees" if "degrees" in error else " px" if "pixels" in error else "%",
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(plots.svg(plots.draw(chart)))


def plot(name: str, rows: Sequence[Row]) -> list[Path]:
    """Draws each metric of a benchmark that several methods share, to docs/plots/<name>-<metric>.svg."""
    written = []
    for metric, found in points(rows).items():
        if len(found) < 2:
            continue
        path = PLOTS / f"{name}-{re.sub('[^a-z0-9]+', '-', metric.lower()).strip('-')}.svg"
        draw(metric, found, path)
        written.append(path)
    return written
