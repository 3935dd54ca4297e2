"""What all benchmarks share: the row, the yardstick, the timer and the files of results."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import fastibl
from fastibl.machine import cpu

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).resolve().parent / "results"


@dataclass(frozen=True)
class Row:
    """One measurement: how wrong a method was, and how long it took.

    method, setting: by public name. case: what it was tried on. metric: what `error` is, with its unit; "" where
    only time was measured. error: None where there is none. seconds: median of one call (or of one item, as `metric`
    or `case` says), None where it was not timed. spread: 10th and 90th percentile of the same. yardsticks: seconds in
    yardsticks of the same run. threads, backend: what was used. cpu: model and cores. commit: of the project.
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


@dataclass(frozen=True)
class Timing:
    """Wall and CPU seconds of a call: median, 10th and 90th percentile over repetitions."""

    median: float
    low: float
    high: float
    cpu: float  # median of the process's CPU time, all threads
    cpu_low: float
    cpu_high: float
    count: int

    @property
    def of_cpu(self) -> Timing:
        """CPU time in the place of wall time: for one thread on a busy machine."""
        return Timing(self.cpu, self.cpu_low, self.cpu_high, self.cpu, self.cpu_low, self.cpu_high, self.count)

    def scaled(self, items: float) -> Timing:
        """The same for one of `items` equal parts of a call."""
        parts = (self.median, self.low, self.high, self.cpu, self.cpu_low, self.cpu_high)
        return Timing(*(v / items for v in parts), self.count)


def timing(walls: Iterable[float], cpus: Iterable[float]) -> Timing:
    """Robust centre and spread of measured seconds. Raises ValueError without any."""
    wall, cpu = np.asarray(list(walls)), np.asarray(list(cpus))
    if not len(wall):
        raise ValueError("no repetition was measured")
    low, middle, high = np.percentile(wall, (10, 50, 90))
    cpu_low, cpu_middle, cpu_high = np.percentile(cpu, (10, 50, 90))
    return Timing(*(float(v) for v in (middle, low, high, cpu_middle, cpu_low, cpu_high)), len(wall))


@contextmanager
def one_core() -> Iterator[None]:
    """The library on one thread, as a block or, with @one_core(), a whole function."""
    before = fastibl.threads()
    fastibl.set_threads(1)
    try:
        yield
    finally:
        fastibl.set_threads(before)


def measure(call: Callable[..., Any], inputs: Sequence[Any], repetitions: int = 15, warm: int = 2) -> Timing:
    """Times call(input) over `inputs` in turn: what a repetition gets differs from the one before."""
    if not len(inputs):
        raise ValueError("measure needs at least one input")
    for k in range(warm):
        call(inputs[k % len(inputs)])
    walls, cpus = [], []
    for k in range(repetitions):
        given = inputs[k % len(inputs)]
        wall, cpu = time.perf_counter(), time.process_time()
        call(given)
        walls.append(time.perf_counter() - wall), cpus.append(time.process_time() - cpu)
    return timing(walls, cpus)


def yardstick(repetitions: int = 41) -> Timing:
    """cv2.remap of a 1024 x 512 float RGB map to six faces of 256 squared, float maps ready made, on one thread."""
    rng = np.random.default_rng(0)
    pictures = [rng.random((512, 1024, 3), np.float32) for _ in range(2)]
    s, t = np.meshgrid((np.arange(256) + 0.5) / 128 - 1, (np.arange(256) + 0.5) / 128 - 1)
    one = np.ones_like(s)
    maps = []
    for x, y, z in ((one, s, t), (-one, s, t), (s, one, t), (s, -one, t), (s, t, one), (s, t, -one)):
        u = (0.5 + np.arctan2(x, y) / (2 * np.pi)) * 1024 - 0.5
        v = np.arctan2(np.hypot(x, y), z) / np.pi * 512 - 0.5
        maps.append((u.astype(np.float32), v.astype(np.float32)))
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return measure(
            lambda image: [cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP) for u, v in maps],
            pictures,
            repetitions,
        )
    finally:
        cv2.setNumThreads(threads)


@cache
def commit() -> str:
    """Short hash of the commit that is checked out, with "+" where the library was changed since; "" outside git."""
    try:
        run = {"cwd": ROOT, "capture_output": True, "text": True, "check": True}
        head = subprocess.run(["git", "rev-parse", "--short=10", "HEAD"], **run).stdout.strip()
        changed = subprocess.run(["git", "status", "--porcelain", "--", "cpp", "python", "shaders"], **run).stdout
        return head + ("+" if changed.strip() else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


@cache
def yardstick_seconds() -> float:
    """The yardstick of this run: CPU time, which on a busy machine is still that of a quiet one."""
    return yardstick().cpu


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
) -> Row:
    """A Row of this run, machine and commit; numbers are kept to four digits."""
    return Row(
        method,
        setting,
        case,
        metric,
        _digits(error),
        _digits(time.median) if time else None,
        (_digits(time.low), _digits(time.high)) if time else None,
        _digits(time.median / yardstick_seconds()) if time else None,
        threads,
        backend,
        cpu(),
        commit(),
    )


def _digits(value: float | None) -> float | None:
    return None if value is None else float(f"{float(value):.4g}")


def write_rows(name: str, rows: Sequence[Row], folder: Path = RESULTS) -> Path:
    """Writes bench/results/<name>.json: the command, the yardstick, and one row a line, sorted."""
    ordered = sorted(rows, key=lambda r: (r.case, r.metric, r.method, r.setting, r.threads, r.backend))
    head = {"command": f"./dev bench {name}", "yardstick_seconds": _digits(yardstick_seconds())}
    lines = ",\n".join("  " + json.dumps(asdict(r), ensure_ascii=False) for r in ordered)
    text = json.dumps(head, indent=1)[:-2] + ',\n "rows": [\n' + lines + "\n ]\n}\n"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    path.write_text(text, encoding="utf-8")
    return path


def read_rows(name: str, folder: Path = RESULTS) -> list[Row]:
    """Rows of a result file. Raises ValueError for a file of another schema."""
    path = folder / f"{name}.json"
    names = {f.name for f in fields(Row)}
    rows = []
    for given in json.loads(path.read_text(encoding="utf-8"))["rows"]:
        if set(given) != names:
            raise ValueError(f"{path} does not have the columns {', '.join(sorted(names))}")
        spread = given["spread"]
        rows.append(Row(**{**given, "spread": None if spread is None else tuple(spread)}))
    return rows


def table(rows: Sequence[Row]) -> str:
    """Rows as text, for people."""
    out = []
    for r in rows:
        error = "" if r.error is None else f"{r.error:.4g} {r.metric}"
        seconds = "" if r.seconds is None else f"{_time(r.seconds)} ({r.yardsticks:.3g} yardsticks)"
        method = f"{r.method} {r.setting}".strip()
        out.append(f"{r.case:34} {method:24} {r.backend}, {r.threads} threads  {error:52} {seconds}".rstrip())
    return "\n".join(out)


def _time(seconds: float) -> str:
    for unit, scale in (("s", 1), ("ms", 1e3), ("us", 1e6)):
        if seconds * scale >= 1:
            return f"{seconds * scale:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"
