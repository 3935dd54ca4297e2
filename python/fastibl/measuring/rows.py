"""The row that stands for every measurement, and files of rows."""

from __future__ import annotations

import json
import math
import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

from ..machine import cpu
from ..whole_file import write_whole
from .timing import Timing, yardstick_seconds

_CHECKOUT = Path(__file__).resolve().parents[3]


@dataclass(frozen=True)
class Row:
    """One measurement: how wrong a method was, and how long it took.

    method, setting: their public names. case: what it was tried on. metric: what `error` is, with its unit; "" where
    only time was measured. error: None where there is none. seconds: median of one call (or of one item, as `metric` or
    `case` says), None where it was not timed. spread: 10th and 90th percentile of the same. yardsticks: seconds in
    yardsticks of the same run. threads, backend: what was used. cpu: model and cores. commit: of the project, ""
    outside git. step: of lighting an object, such as "diffuse"; "" in files that are about one step.
    """

    method: str
    setting: str
    case: str
    metric: str
    error: float | None
    seconds: float | None
    spread: tuple[float, float] | None
    yardsticks: float | None
    threads: int
    backend: str
    cpu: str
    commit: str
    step: str = ""


@cache
def commit() -> str:
    """Short hash of the commit that is checked out, with "+" if the library was changed since; "" outside git."""
    if not (_CHECKOUT / ".git").exists():
        return ""
    try:
        head = _git("rev-parse", "--short=10", "HEAD").strip()
        changed = _git("status", "--porcelain", "--", "cpp", "python", "shaders")
        return head + ("+" if changed.strip() else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=_CHECKOUT, capture_output=True, text=True, check=True)
    return done.stdout


def row(
    method: str,
    case: str,
    metric: str = "",
    error: float | None = None,
    time: Timing | None = None,
    *,
    setting: str = "",
    threads: int = 1,
    backend: str = "cpu",
    step: str = "",
    yard: float | None = None,
) -> Row:
    """A Row of this run, machine and commit; numbers are kept to four digits.

    yard: the yardstick's seconds while `time` was taken; by default those of now.
    """
    return Row(
        method,
        setting,
        case,
        metric,
        None if error is None else _digits(error),
        _digits(time.median) if time else None,
        (_digits(time.low), _digits(time.high)) if time else None,
        _digits(time.median / (yard or yardstick_seconds())) if time else None,
        threads,
        backend,
        cpu(),
        commit(),
        step,
    )


def _digits(value: float) -> float:
    return float(f"{float(value):.4g}")


def write_rows(path: str | os.PathLike[str], rows: Sequence[Row], head: Mapping[str, Any]) -> Path:
    """Writes a file of rows: `head`, the yardstick, and one row per line, sorted. Returns its path."""
    path = Path(path)
    ordered = sorted(rows, key=lambda r: (r.step, r.case, r.metric, r.method, r.setting, r.threads, r.backend))
    first = {**head, "yardstick_seconds": _digits(yardstick_seconds())}
    lines = ",\n".join("  " + json.dumps(_columns(r), ensure_ascii=False) for r in ordered)
    text = json.dumps(first, indent=1, ensure_ascii=False)[:-2] + ',\n "rows": [\n' + lines + "\n ]\n}\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)
    return path


def _columns(r: Row) -> dict[str, Any]:
    """The row's columns, without the step where there is none."""
    return {key: value for key, value in asdict(r).items() if key != "step" or value}


def read_head(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a file of rows holds besides them; the file is one that read_rows() reads."""
    return {name: value for name, value in json.loads(Path(path).read_text(encoding="utf-8")).items() if name != "rows"}


def read_rows(path: str | os.PathLike[str]) -> list[Row]:
    """The rows of a file. Raises ValueError for a file of another schema or without rows, FileNotFoundError for no
    file."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"the measurements {path} are missing")
    needed = {f.name for f in fields(Row) if f.default is MISSING}
    known = {f.name for f in fields(Row)}
    try:
        given_rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
        wrong = not all(isinstance(given, dict) and needed <= set(given) <= known for given in given_rows)
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is no file of measurements: {error}") from error
    if wrong:
        raise ValueError(f"{path} does not have the columns {', '.join(sorted(needed))}")
    if not given_rows:
        raise ValueError(f"{path} holds no measurements")
    for number, given in enumerate(given_rows):
        if not _is_row(given):
            raise ValueError(f"{path}: row {number} has values that no measurement has: {given}")
    return [
        Row(**{**given, "spread": None if given["spread"] is None else tuple(given["spread"])}) for given in given_rows
    ]


_WORDS = ("method", "setting", "case", "metric", "backend", "cpu", "commit", "step")


def _is_row(given: Mapping[str, Any]) -> bool:
    def number(value: Any, least: float = -math.inf) -> bool:
        return isinstance(value, (int, float)) and not isinstance(value, bool) and not value <= least

    spread = given["spread"]
    return (
        all(isinstance(given.get(name, ""), str) for name in _WORDS)
        and isinstance(given["threads"], int)
        and (given["error"] is None or number(given["error"]))
        and all(given[name] is None or number(given[name], 0) for name in ("seconds", "yardsticks"))
        and (given["seconds"] is None) == (given["yardsticks"] is None)
        and (spread is None or (isinstance(spread, list) and len(spread) == 2 and all(number(v) for v in spread)))
    )


def table(rows: Sequence[Row]) -> str:
    """Rows as text, for people."""
    out = []
    for r in rows:
        error = "" if r.error is None else f"{r.error:.4g} {r.metric}"
        seconds = "" if r.seconds is None else f"{seconds_text(r.seconds)} ({r.yardsticks:.3g} yardsticks)"
        method = f"{r.method} {r.setting}".strip()
        out.append(f"{r.case:34} {method:24} {r.backend}, {r.threads} threads  {error:52} {seconds}".rstrip())
    return "\n".join(out)


def seconds_text(seconds: float) -> str:
    """ "12.3 ms": three digits in the unit that suits; whole seconds from 1000 on."""
    if seconds >= 1000:
        return f"{seconds:.0f} s"
    for unit, scale in (("s", 1), ("ms", 1e3), ("µs", 1e6)):
        if seconds * scale >= 0.9995:  # which is written as 1
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"
