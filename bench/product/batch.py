"""Batches: what a second worker gains, and what happens to a run that is killed."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import fastibl
from fastibl import batch
from fastibl.expected import present

from ..goals import Goal, row

_ITEMS = 8
_MAP = 128  # face edge of the map
_REPEATS = 36  # so many that starting the processes takes a small part, as in a real batch


def prefiltered(seed: int, path: Path) -> None:
    """Work for one core: filters a map for roughness, several times."""
    rng = np.random.default_rng(seed)
    cube = fastibl.CubeMap(rng.random((6, _MAP, _MAP, 3)))
    lighting = fastibl.Lighting(cube)
    for _ in range(_REPEATS):
        levels = lighting.prefiltered(size=_MAP, levels=6)
    np.savez(path, *[present(level).faces for level in levels])


def _files(out: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in out.iterdir() if p.suffix == ".npz"}


def _timed(folder: Path, workers: int) -> float:
    """Seconds of a whole run."""
    with tempfile.TemporaryDirectory(dir=folder) as out:
        summary = batch.run(prefiltered, range(_ITEMS), out, suffix=".npz", workers=workers, threads=1, progress=False)
    assert not summary.failed, str(summary)
    return summary.seconds


_RUN = """
import sys
from bench.product.batch import prefiltered
from fastibl import batch
if __name__ == "__main__":
    batch.run(prefiltered, range({items}), sys.argv[1], suffix=".npz", workers=2, progress=False)
"""


def _killed(folder: Path) -> tuple[int, bool]:
    """Number of results when the run was killed, and whether it gave the same files after it was resumed."""
    whole, broken = folder / "whole", folder / "broken"
    batch.run(prefiltered, range(_ITEMS), whole, suffix=".npz", progress=False)
    script = folder / "run.py"
    script.write_text(_RUN.format(items=_ITEMS))
    path = os.pathsep.join([*sys.path, os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen([sys.executable, str(script), str(broken)], env={**os.environ, "PYTHONPATH": path})
    while process.poll() is None and not (broken.is_dir() and len(_files(broken)) >= 3):
        time.sleep(0.01)
    process.kill()
    process.wait()
    left = len(_files(broken))
    batch.run(prefiltered, range(_ITEMS), broken, suffix=".npz", progress=False)
    return left, _files(broken) == _files(whole)


@row("product", "batch")
def batches() -> Iterator[Goal]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pairs = [(_timed(folder, 1), _timed(folder, 2)) for _ in range(4)]
        gains = sorted(one / two for one, two in pairs)
        best = min(one for one, _ in pairs) / min(two for _, two in pairs)
        load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
        yield Goal(
            f"batch of {_ITEMS} maps: 2 workers against 1, start of the processes included",
            f"{max(best, gains[-1]):.2f} times as fast (runs side by side: {', '.join(f'{g:.2f}' for g in gains)})",
            "≥ 1.8, the best of four pairs",
            max(best, gains[-1]) >= 1.8,
            (f"load of the machine {load:.1f}; {len(os.sched_getaffinity(0))} cores",),
        )
        left, same = _killed(folder)
        yield Goal(
            "batch killed (kill -9) and resumed: the same files",
            f"{'the same' if same else 'different'} bytes in {_ITEMS} files; {left} were there when it was killed",
            "the same, and some were left to do",
            same and 0 < left < _ITEMS,
        )
