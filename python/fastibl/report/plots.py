"""Plots: error against time with the frontier, and lines. The colours are by Okabe and Ito, who see them as the
colour-blind do."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..measuring import Point, frontier
from .labels import Label, place

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B58900", "#3A9BD9", "#5C5C5C", "#7B4EA3")
_INK, _SOFT = "#1c2430", "#8a949e"


@dataclass(frozen=True)
class Frontier:
    """A plot of error against time. name: that of its file. paper, chosen: labels of the points to mark. unit: that of
    the error, "%" for a share."""

    name: str
    title: str
    time: str
    error: str
    points: Sequence[Point]
    paper: Sequence[str] = ()
    chosen: Sequence[str] = ()
    unit: str = "%"


@dataclass(frozen=True)
class Lines:
    """A plot of lines: values by name. dashed: names of the lines that are drawn dashed. wide: whether it takes the
    full width. mark: (from, to, text) along x."""

    name: str
    title: str
    x_label: str
    y_label: str
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]]
    log_x: bool = True
    log_y: bool = True
    unit: str = "%"
    dashed: Sequence[str] = ()
    mark: Sequence[tuple[float, float, str]] = ()
    wide: bool = False
    colours: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Dumbbells:
    """A plot of pairs, one per line: title, the default's (error, seconds), and those of the paper's method or None."""

    name: str
    title: str
    pairs: Sequence[tuple[str, tuple[float, float], tuple[float, float] | None]]


Chart = Frontier | Lines | Dumbbells


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)  # needed to measure labels
    return figure


def _number(value: float) -> str:
    rounded = float(f"{value:.3g}")
    return f"{rounded:g}" if rounded < 1e5 else f"{rounded:.0e}".replace("e+0", "e")


def _share(unit: str):
    from matplotlib.ticker import FuncFormatter

    if unit == "s":
        from matplotlib.ticker import EngFormatter

        return EngFormatter("s")
    return FuncFormatter(lambda v, _: _number(100 * v) + " %" if unit == "%" else f"{_number(v)}{unit}")


_STEPS = ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7), (1, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 9))


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers on a log axis: the coarsest steps that give three of them."""
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    found: list[float] = []
    for steps in _STEPS:
        found = [float(f"{m}e{k}") for k in decades for m in steps]
        found = [v for v in found if low <= v <= high]
        if len(found) >= 3:
            break
    return found[:: -(-len(found) // 8) or 1]


def _log_axis(axis: Any, formatter: Any, low: float, high: float) -> None:
    from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter

    axis.set_major_locator(FixedLocator(_ticks(low, high)))
    axis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=50))
    axis.set_major_formatter(formatter)
    axis.set_minor_formatter(NullFormatter())


def _dress(axes: Any, x: str, y: str) -> None:
    axes.set_xlabel(x, color=_INK), axes.set_ylabel(y, color=_INK)
    axes.grid(True, which="major", color="#e4e8ec", lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#b9c1c9")
    axes.tick_params(which="both", colors="#4a545e", labelsize=9)


def _limits(values: Sequence[float], below: float, above: float) -> tuple[float, float]:
    """The limits of a log axis: the range of values with some room, of at least half a decade."""
    values = [v for v in values if np.isfinite(v)] or [1.0]
    low, high = min(values), max(values)
    room = max(np.log10(high / low), 0.5)
    return low / 10 ** (below * room), high * 10 ** (above * room)


def _labels(points: Sequence[Point], marked: Mapping[str, str], colour: Mapping[str, str]) -> list[Label]:
    """One label per point. A method's name appears once; its other points are labelled with their setting."""
    named: set[str] = set()
    out = []
    for p in sorted(points, key=lambda p: (p.method, bool(p.setting), p.seconds)):
        text, bold = p.setting, p.label in marked
        if p.method not in named or bold:
            text, named = p.label, named | {p.method}
        out.append(Label(marked.get(p.label, text), p.seconds, p.error, colour[p.method], bold, 0 if bold else 1))
    return out


def draw_frontier(chart: Frontier, width: float = 6.5, height: float = 4.7) -> Any:
    """The figure. A step line joins the points that no other beats in both; ours is a filled star, the paper's a hollow
    diamond."""
    # An exact result has no place on a log axis; nothing here resolves errors below 1e-7.
    points = [Point(p.method, p.setting, p.seconds, max(p.error, 1e-7)) for p in chart.points if np.isfinite(p.error)]
    figure = _figure(width, height)
    axes = figure.add_subplot()
    if not points:  # no error is a number
        return figure
    axes.set(xscale="log", yscale="log")
    methods = sorted({p.method for p in points}, key=lambda m: min(p.seconds for p in points if p.method == m))
    colour = {m: COLOURS[k % len(COLOURS)] for k, m in enumerate(methods)}
    x_limits = _limits([p.seconds for p in points], 0.08, 0.12)
    y_limits = _limits([p.error for p in points], 0.1, 0.12)
    axes.set_xlim(x_limits), axes.set_ylim(y_limits)
    ahead = frontier(points)
    steps = [(ahead[0].seconds, y_limits[1]), *((p.seconds, p.error) for p in ahead), (x_limits[1], ahead[-1].error)]
    axes.step(*zip(*steps, strict=True), where="post", color="#c9d1d9", lw=3, solid_capstyle="butt", zorder=1)
    for m in methods:
        mine = sorted((p for p in points if p.method == m), key=lambda p: p.seconds)
        plain = [p for p in mine if p.label not in (*chart.paper, *chart.chosen)]
        if series := _series(mine):
            axes.plot(*zip(*series, strict=True), color=colour[m], lw=0.9, alpha=0.4, zorder=2)
        axes.scatter([p.seconds for p in plain], [p.error for p in plain], s=34, color=colour[m], zorder=3)
    marks: dict[str, str] = {}
    for names, shape, face, size in ((chart.paper, "D", False, 62), (chart.chosen, "*", True, 230)):
        for p in (p for p in points if p.label in names):
            filled = colour[p.method] if face else "white"
            axes.scatter(p.seconds, p.error, s=size, marker=shape, fc=filled, ec=colour[p.method], lw=1.8, zorder=4)
            marks[p.label] = f"{p.label} (the paper's)" if not face else p.label
    _log_axis(axes.xaxis, _share("s"), *x_limits)
    _log_axis(axes.yaxis, _share(chart.unit), *y_limits)
    _dress(axes, chart.time, chart.error)
    _legend(axes, chart)
    inner = np.concatenate([_along(a, b) for a, b in zip(steps, steps[1:], strict=False)])
    place(axes, _labels(points, marks, colour), inner)
    return figure


def _series(points: Sequence[Point]) -> list[tuple[float, float]]:
    """A method's points along its setting, if it has a single setting with whole numbers; otherwise none."""
    found = [(p.setting.partition("="), p) for p in points if p.setting]
    if len({key for (key, _, _), _ in found}) != 1 or not all(v.isdigit() for (_, _, v), _ in found):
        return []
    return [(p.seconds, p.error) for _, p in sorted(found, key=lambda f: int(f[0][2]))]


def _along(a: tuple[float, float], b: tuple[float, float]) -> np.ndarray:
    """Points on a step of the frontier: along x, then along y."""
    x, y = np.geomspace(a[0], b[0], 12), np.geomspace(a[1], b[1], 12)
    return np.concatenate([np.stack([x, np.full(12, a[1])], 1), np.stack([np.full(12, b[0]), y], 1)])


def _legend(axes: Any, chart: Frontier) -> None:
    from matplotlib.lines import Line2D

    plain: dict[str, Any] = {"ls": "none", "color": _SOFT, "mec": _SOFT}
    entries = [Line2D([], [], color="#c9d1d9", lw=3, label="frontier: nothing is faster and more exact")]
    if chart.chosen:
        entries.insert(0, Line2D([], [], marker="*", ms=13, label="chosen by default", **plain))
    if chart.paper:
        diamond = Line2D([], [], marker="D", ms=7, mfc="white", mew=1.6, label="the paper's", **plain)
        entries.insert(len(entries) - 1, diamond)
    axes.legend(
        handles=entries, ncol=len(entries), loc="lower left", bbox_to_anchor=(-0.02, 1.0), frameon=False,
        fontsize=8, labelcolor="#4a545e", handletextpad=0.5, columnspacing=1.2,
    )  # fmt: skip


def draw_lines(chart: Lines, width: float = 4.9, height: float = 3.5) -> Any:
    figure = _figure(2 * width if chart.wide else width, height)
    axes = figure.add_subplot()
    axes.set(xscale="log" if chart.log_x else "linear", yscale="log" if chart.log_y else "linear")
    everything = [v for _, y in chart.lines.values() for v in y if np.isfinite(v) and (v > 0 or not chart.log_y)]
    labels, middle = [], []
    for k, (name, (x, y)) in enumerate(chart.lines.items()):
        values = np.asarray(y, float)
        values = np.maximum(values, min(everything, default=1)) if chart.log_y else values
        colour = chart.colours.get(name, COLOURS[k % len(COLOURS)])
        marker = "o" if len(x) < 14 else None
        axes.plot(x, values, color=colour, lw=1.8, marker=marker, ms=4, ls=":" if name in chart.dashed else "-")
        if not np.isfinite(values).any():
            continue
        at = int(np.nanargmax(np.where(np.isfinite(values), np.arange(len(values)), np.nan)))
        at = at if chart.log_x else at * 2 // 3
        labels.append(Label(name, float(x[at]), float(values[at]), colour, True))
        middle += list(zip(x, values, strict=True))
    if chart.log_y and everything:
        limits = _limits(everything, 0.08, 0.16)
        axes.set_ylim(limits)
        _log_axis(axes.yaxis, _share(chart.unit), *limits)
    else:
        top = max(everything, default=1.0)
        axes.set_ylim(min(0.0, min(everything, default=0.0) * 1.1), top * 1.15)
        axes.yaxis.set_major_formatter(_share(chart.unit))
    if chart.log_x:
        xs = [v for x, _ in chart.lines.values() for v in x]
        _log_axis(axes.xaxis, _share(""), min(xs), max(xs))
        axes.set_xlim(_limits(xs, 0.06, 0.1))
    for begin, end, text in chart.mark:
        axes.axvspan(begin, max(end, begin), color="#000000", alpha=0.08, lw=1)
        axes.text((begin + end) / 2, axes.get_ylim()[1], text, ha="center", va="top", fontsize=8, color="#4a545e")
    _dress(axes, chart.x_label, chart.y_label)
    axes.set_title(chart.title, fontsize=10, color=_INK, loc="left")
    place(axes, labels, np.array([p for p in middle if np.isfinite(p).all()]))
    return figure


def draw_dumbbells(chart: Dumbbells, width: float = 10.4) -> Any:
    """Errors on the left, times on the right: the default's star and the paper's diamond, joined by a line."""
    from matplotlib.ticker import EngFormatter

    figure = _figure(width, 0.75 + 0.42 * len(chart.pairs))
    left, right = figure.subplots(1, 2, sharey=True)
    for k, axes in enumerate((left, right)):
        values = [p[k] for _, *both in chart.pairs for p in both if p is not None]
        limits = _limits([max(v, 1e-12) for v in values], 0.08, 0.08)
        axes.set(xscale="log", xlim=limits)
        for line, (_, ours, theirs) in enumerate(chart.pairs):
            if theirs is not None:
                axes.plot([ours[k], theirs[k]], [line, line], color="#c9d1d9", lw=4, zorder=1, solid_capstyle="round")
                axes.scatter(theirs[k], line, s=52, marker="D", fc="white", ec=COLOURS[1], lw=1.8, zorder=3)
            axes.scatter(ours[k], line, s=190, marker="*", color=COLOURS[0], zorder=4)
        _log_axis(axes.xaxis, _share("%") if k == 0 else EngFormatter("s"), *limits)
        _dress(axes, "error" if k == 0 else "time", "")
        axes.grid(False, axis="y"), axes.spines["left"].set_visible(False)
    left.set_yticks(range(len(chart.pairs)), [title for title, *_ in chart.pairs])
    left.tick_params(axis="y", length=0, labelsize=10), right.tick_params(axis="y", length=0)
    left.set_ylim(len(chart.pairs) - 0.5, -0.5)
    return figure


def draw(chart: Chart) -> Any:
    if isinstance(chart, Frontier):
        return draw_frontier(chart)
    return draw_lines(chart) if isinstance(chart, Lines) else draw_dumbbells(chart)


def svg(figure: Any) -> bytes:
    """The figure as SVG; the same bytes for the same figure."""
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "fastibl"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def write(chart: Chart, folder: Path) -> bytes:
    """Writes <name>.svg and <name>.png; returns the SVG."""
    figure = draw(chart)
    folder.mkdir(parents=True, exist_ok=True)
    drawn = svg(figure)
    (folder / f"{chart.name}.svg").write_bytes(drawn)
    figure.savefig(folder / f"{chart.name}.png", dpi=160)
    return drawn
