"""Lines that the tests run, as counted by the last ./dev coverage."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass

from ..goals import Goal, row, skipped
from ..measure import ROOT

_FOLDER = ROOT / "build" / "coverage"
_AIM = 90.0  # percent
_WORST = 6  # files that are named in the notes


@dataclass(frozen=True)
class Covered:
    """Lines of code of one file, and how many of them ran."""

    file: str
    lines: int
    run: int


def of_cpp(text: str) -> list[Covered]:
    """From gcovr's JSON summary."""
    return [Covered(f["filename"], f["line_total"], f["line_covered"]) for f in json.loads(text)["files"]]


def of_python(text: str) -> list[Covered]:
    """From coverage.py's JSON report."""
    files = {name: file["summary"] for name, file in json.loads(text)["files"].items()}
    return [Covered(name, f["num_statements"], f["covered_lines"]) for name, f in files.items()]


@row("product", "coverage")
def coverage() -> Iterator[Goal]:
    for language, name, read in (("C++", "cpp.json", of_cpp), ("Python", "python.json", of_python)):
        what = f"lines that the tests run, {language}"
        path = _FOLDER / name
        if not path.is_file():
            yield skipped(what, "./dev coverage counts them, in half an hour")
            continue
        files = read(path.read_text("utf-8"))
        lines, run = sum(f.lines for f in files), sum(f.run for f in files)
        worst = sorted(files, key=lambda f: f.run - f.lines)[:_WORST]
        yield Goal(
            what,
            f"{100 * run / lines:.1f} % of {lines}",
            f"{_AIM:.0f} %",
            100 * run / lines >= _AIM,
            tuple(f"{f.file.rsplit('/fastibl/', 1)[-1]}: {f.lines - f.run} of {f.lines} do not run" for f in worst),
        )
