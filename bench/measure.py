"""What all benchmarks share: fastibl.measuring, and the place of the result files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fastibl import measuring
from fastibl.measuring import (  # noqa: F401 - part of what this file offers
    Row,
    Timing,
    commit,
    cpu,
    measure,
    one_core,
    row,
    table,
    timing,
    yardstick,
    yardstick_seconds,
)

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).resolve().parent / "results"


def write_rows(name: str, rows: Sequence[Row], folder: Path = RESULTS) -> Path:
    """Writes bench/results/<name>.json."""
    return measuring.write_rows(folder / f"{name}.json", rows, {"command": f"./dev bench {name}"})


def read_rows(name: str, folder: Path = RESULTS) -> list[Row]:
    """Rows of a result file. Raises ValueError for a file of another schema."""
    return measuring.read_rows(folder / f"{name}.json")
