"""How methods are measured: rows of error and time in one schema, for `fastibl report` and for the project's
benchmarks."""

from ..machine import cpu
from .frontier import Point, frontier, label, points
from .rows import Row, commit, read_head, read_rows, row, seconds_text, table, write_rows
from .timing import Timing, all_cores, measure, one_core, side_by_side, timing, yardstick, yardstick_seconds

__all__ = [
    "Point",
    "Row",
    "Timing",
    "all_cores",
    "commit",
    "cpu",
    "frontier",
    "label",
    "measure",
    "one_core",
    "points",
    "read_head",
    "read_rows",
    "row",
    "seconds_text",
    "side_by_side",
    "table",
    "timing",
    "write_rows",
    "yardstick",
    "yardstick_seconds",
]
