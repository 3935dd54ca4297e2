"""Places labels beside points so that none covers another: greedily, by what each place would hide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MARKER = 8.0  # pixels around a point that labels keep free, at 100 dots an inch
_AWAY = (9.0, 17.0, 28.0, 42.0, 60.0)  # pixels from a point to its label
_LEADER = 14.0  # from this distance on, a thin line leads from the label to its point
_AROUND = 16  # directions that are tried


def readable(colour: str) -> str:
    """#rrggbb for words in the colour of a line, dark enough on white (WCAG 2.2, 1.4.3)."""
    return "#" + "".join(f"{round(0.72 * int(colour[k : k + 2], 16)):02x}" for k in (1, 3, 5))


@dataclass(frozen=True)
class Label:
    """The text beside the point (x, y) in the axes' data; labels with a smaller rank are placed first."""

    text: str
    x: float
    y: float
    colour: str
    bold: bool = False
    rank: int = 1


def _overlap(box: NDArray, others: NDArray) -> float:
    """The area that a box (4,) x0 y0 x1 y1 shares with others (n, 4)."""
    if not len(others):
        return 0.0
    width = np.minimum(box[2], others[:, 2]) - np.maximum(box[0], others[:, 0])
    height = np.minimum(box[3], others[:, 3]) - np.maximum(box[1], others[:, 1])
    return float((np.maximum(width, 0) * np.maximum(height, 0)).sum())


def _candidates(at: NDArray, size: NDArray) -> list[tuple[float, NDArray]]:
    """Boxes around a point, with their distance from it; those to the right and above come first."""
    out = []
    for away in _AWAY:
        for k in range(_AROUND):
            angle = np.pi / 8 + 2 * np.pi * k / _AROUND
            towards = np.array([np.cos(angle), np.sin(angle)])
            # The box touches the ray with its nearest edge: its middle lies half its size further along.
            middle = at + away * towards + towards * size / 2 * [1.0, 1.0]
            out.append((away, np.concatenate([middle - size / 2, middle + size / 2])))
    return out


def place(axes: Any, labels: list[Label], avoid: NDArray, size: float = 8.5) -> None:
    """Draws labels. avoid: (n, 2) data points, besides those of the labels, that should stay visible."""
    figure = axes.figure
    figure.canvas.draw()
    figure.set_layout_engine("none")  # the axes must stay where they are now
    renderer, unit = figure.canvas.get_renderer(), figure.dpi / 100
    frame = axes.get_window_extent(renderer)
    points = axes.transData.transform([(label.x, label.y) for label in labels])
    others = axes.transData.transform(avoid) if len(avoid) else np.empty((0, 2))
    markers = np.concatenate([points, others])
    own = [_MARKER * (1.6 if label.bold else 1) for label in labels]
    reach = np.concatenate([own, np.full(len(others), 2.0)])[:, None] * unit
    taken = np.concatenate([markers - reach, markers + reach], axis=1)
    placed = np.empty((0, 4))
    for k in sorted(range(len(labels)), key=lambda k: (labels[k].rank, -points[k][1])):
        label = labels[k]
        style = {"fontsize": size, "color": readable(label.colour), "fontweight": "bold" if label.bold else "normal"}
        text = axes.text(0, 0, label.text, **style)
        extent = text.get_window_extent(renderer)
        text.remove()
        best, best_cost, best_away = np.full(4, np.nan), np.inf, 0.0
        for away, box in _candidates(points[k], np.array([extent.width, extent.height])):
            out = max(frame.x0 - box[0], 0) + max(box[2] - frame.x1, 0)
            out += max(frame.y0 - box[1], 0) + max(box[3] - frame.y1, 0)
            cost = 3 * _overlap(box, placed) + _overlap(box, taken) + 200 * out / unit + 0.8 * away
            if cost < best_cost:
                best, best_cost, best_away = box, cost, away * unit
        placed = np.vstack([placed, best])
        x, y = axes.transData.inverted().transform(((best[0] + best[2]) / 2, (best[1] + best[3]) / 2))
        arrow = {"arrowstyle": "-", "color": label.colour, "lw": 0.5, "alpha": 0.6, "shrinkA": 0, "shrinkB": 3}
        axes.annotate(
            label.text, (label.x, label.y), (x, y), ha="center", va="center",
            arrowprops=arrow if best_away > _LEADER * unit else None, **style,
        )  # fmt: skip
