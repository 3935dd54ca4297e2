"""What a part of the report consists of; each step's module returns one Section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..measuring import Row
from .plots import Chart


@dataclass(frozen=True)
class Table:
    """head, rows: texts; the first column is the name. marked: "chosen" or "paper", by index of a row. note: below the
    table. compact: whether it stands beside a plot."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    marked: dict[int, str] = field(default_factory=dict)
    note: str = ""
    title: str = ""
    compact: bool = False


@dataclass(frozen=True)
class Strip:
    """Pictures side by side, each (h, w, 3) uint8 with its caption."""

    title: str
    pictures: Sequence[tuple[str, NDArray[np.uint8]]]
    note: str = ""


@dataclass
class Section:
    """name: short, for links. what: what is measured, and how. seen: what one sees, in sentences made from the numbers.

    text: preformatted text with its title. missing: the reason, if there is nothing to show. best: the results
    (steps.Result) with the marks "chosen" and "paper", for the overview.
    """

    name: str
    title: str
    what: str
    seen: list[str] = field(default_factory=list)
    charts: list[Chart] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    strips: list[Strip] = field(default_factory=list)
    text: list[tuple[str, str]] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    missing: str = ""
    best: dict[str, Any] = field(default_factory=dict)


def percent(value: float | None, digits: int = 2) -> str:
    """ "0.27 %"; "–" for what is not known."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{100 * value:.{digits}g} %" if abs(value) < 0.995 else f"{100 * value:.0f} %"


def signed(value: float | None) -> str:
    """ "+0.3 %"."""
    if value is None or not np.isfinite(value):
        return "–"
    if abs(value) < 5e-6:
        return "0 %"
    return f"{100 * value:+.2g} %" if abs(value) < 0.995 else f"{100 * value:+.0f} %"


def times(ratio: float) -> str:
    """ "3.2 times"."""
    return f"{ratio:.2g} times" if ratio < 9.95 else f"{ratio:.0f} times"
