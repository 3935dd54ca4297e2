"""Error against time from the rows of results, one plot a step, with the frontier.

A row is drawn where it has both an error and a time; rows that differ in the exponent alone are one point, their mean.
The frontier joins what nothing else beats in both: "better" means ahead of it.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from .measure import ROOT, Row

PLOTS = ROOT / "docs" / "plots"


@dataclass(frozen=True)
class Point:
    method: str
    setting: str
    seconds: float
    error: float

    @property
    def label(self) -> str:
        return f"{self.method} {self.setting}".strip()


def points(rows: Iterable[Row]) -> dict[str, list[Point]]:
    """Points by metric, one a method and setting; the exponent is averaged over."""
    found: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for r in rows:
        if r.error is not None and r.seconds is not None:
            setting = " ".join(s for s in r.setting.split() if not s.startswith("exponent="))
            found[r.metric, r.method, setting].append(r)
    plots: dict[str, list[Point]] = defaultdict(list)
    for (metric, method, setting), same in found.items():
        seconds = sorted(r.seconds for r in same if r.seconds is not None)[len(same) // 2]
        error = sum(r.error for r in same if r.error is not None) / len(same)
        plots[metric].append(Point(method, setting, seconds, error))
    return dict(plots)


def frontier(all_points: Sequence[Point]) -> list[Point]:
    """The points that no other beats in both time and error, from fast to exact."""
    best: list[Point] = []
    for p in sorted(all_points, key=lambda p: (p.seconds, p.error)):
        if not best or p.error < best[-1].error:
            best.append(p)
    return best


def draw(metric: str, all_points: Sequence[Point], path: Path) -> None:
    """Writes one plot as SVG, the same bytes for the same rows."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "fastibl"
    import matplotlib.pyplot as plt
    from matplotlib.ticker import EngFormatter, LogLocator, StrMethodFormatter

    figure, axes = plt.subplots(figsize=(8, 5))
    ahead = frontier(all_points)
    slowest = max(p.seconds for p in all_points)
    x, y = [*(p.seconds for p in ahead), slowest], [100 * p.error for p in (*ahead, ahead[-1])]
    axes.step(x, y, where="post", color="#888", zorder=1)
    methods = sorted({p.method for p in all_points})
    colours = plt.get_cmap("tab10")
    for k, method in enumerate(methods):
        mine = [p for p in all_points if p.method == method]
        x, y = [p.seconds for p in mine], [100 * p.error for p in mine]
        axes.scatter(x, y, color=colours(k % 10), marker="osD^v"[k // 10 % 5], label=method, zorder=2)
        for p in mine:
            where = (p.seconds, 100 * p.error)
            axes.annotate(p.setting, where, textcoords="offset points", xytext=(5, 4), fontsize=7)
    error, _, time = metric.partition("; ")
    axes.set(xscale="log", yscale="log", xlabel=time, ylabel=f"{error}, %")
    for axis, label in ((axes.xaxis, EngFormatter("s")), (axes.yaxis, StrMethodFormatter("{x:g}"))):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(label)
        axis.set_minor_formatter("")
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)


def plot(name: str, rows: Sequence[Row]) -> list[Path]:
    """Draws each metric of a benchmark that several methods share to docs/plots/<name>-<metric>.svg."""
    written = []
    for metric, found in points(rows).items():
        if len(found) < 2:
            continue
        path = PLOTS / f"{name}-{re.sub('[^a-z0-9]+', '-', metric.lower()).strip('-')}.svg"
        draw(metric, found, path)
        written.append(path)
    return written
