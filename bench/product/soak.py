"""Soak: frame after frame of one recording: memory must stay flat, the captured light as good, and frames as quick.
./dev soak 100000 for the full count."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..goals import Goal, row

_PROGRAM = "import sys; from bench.product.soak import main; sys.exit(main())"
_SAMPLES = 100  # of memory, over the whole run
_WARM = 0.2  # share of the run after which all buffers have their final size


@dataclass(frozen=True)
class Soak:
    """One run. frames: number done, `followed` of them with the board found. rss: bytes after each of `at` frames.
    seconds: those of the frames alone. errors: of the captured light (matte sphere, relative RMS), after the film's
    round that ends with the warm-up, and after the last one. milliseconds: medians of the frames of these rounds."""

    frames: int
    followed: int
    at: tuple[int, ...]
    rss: tuple[int, ...]
    seconds: float
    errors: tuple[float, float]
    milliseconds: tuple[float, float]

    @property
    def growth(self) -> float:
        """Bytes per frame: the slope of a line through the memory after the warm-up."""
        at, rss = np.array(self.at, float), np.array(self.rss, float)
        late = at >= _WARM * self.frames
        return float(np.polyfit(at[late], rss[late], 1)[0])

    @property
    def spread(self) -> int:
        """Bytes between the least and the most memory after the warm-up."""
        late = [r for a, r in zip(self.at, self.rss, strict=True) if a >= _WARM * self.frames]
        return max(late) - min(late)


def _rss() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def soak(frames: int, size: tuple[int, int], shown: bool = False) -> Soak:
    """Plays a short film forth and back through one Session, while its time runs on."""
    from dataclasses import replace

    import fastibl
    from fastibl.expected import present

    film = fastibl.simulate(seconds=2, fps=15, size=size, hand=False, lamp=False)
    mesh = fastibl.stand(fastibl.shapes.figurine(), height=0.2)
    session = fastibl.Session(fastibl.Scene(mesh, fastibl.Material(glossy=(0.1,) * 3)), film.rig, film.board)
    pictures = list(film)
    around = pictures + pictures[-2:0:-1]
    truth = film.truth.environment(0.0)
    at, rss, followed = [], [], 0
    step, length = max(1, frames // _SAMPLES), len(around)
    rounds = [min(frames, max(1, int(share * frames) // length) * length) for share in (_WARM, 1)]  # their last frames
    errors, milliseconds = [], []
    times: list[float] = []
    begin = time.perf_counter()
    for k in range(frames):
        result = session.process(replace(around[k % len(around)], time=k / 15))
        followed += result.back_from_marker is not None
        times = [*times[1 - length :], 1e3 * result.timings["total"]]
        if k + 1 in rounds:
            errors.append(fastibl.compare(present(result.environment), truth).rmse["matte"])
            milliseconds.append(float(np.median(times)))
        if (k + 1) % step == 0:
            at.append(k + 1)
            rss.append(_rss())
            if shown:
                print(f"{at[-1]:6d}  {rss[-1] / 2**20:.2f}", flush=True)
    seconds = time.perf_counter() - begin
    pairs = (errors[0], errors[-1]), (milliseconds[0], milliseconds[-1])
    return Soak(frames, followed, tuple(at), tuple(rss), seconds, *pairs)


def _in_a_process(frames: int, size: str) -> Soak:
    command = [sys.executable, "-c", _PROGRAM, str(frames), "--size", size]
    path = os.pathsep.join(p or "." for p in sys.path)
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path})
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "the soak run died")
    lines = [line.split() for line in done.stdout.splitlines() if line.strip()[:1].isdigit()]
    *_, rounds, end = done.stdout.splitlines()
    last = end.split()  # "seconds … for … frames, … followed"
    seconds, followed = float(last[1]), int(last[last.index("followed;") - 1])
    numbers = [float(word) for word in rounds.split() if word[0].isdigit()]
    at, rss = tuple(int(a) for a, _ in lines), tuple(int(float(m) * 2**20) for _, m in lines)
    errors, milliseconds = (numbers[0] / 100, numbers[1] / 100), (numbers[2], numbers[3])
    return Soak(frames, followed, at, rss, seconds, errors, milliseconds)


_GOAL = 10 * 2**20  # bytes in 100 000 frames that fragments of the heap may take
_WORSE = 0.005  # of the light, by which the last round may be further off than an early one
_SLOWER = 2  # of the time of a frame after the warm-up that one at the end may take, on a machine with other work
_FOLLOWED = 0.95  # share of frames: without the board, most passes have nothing to do


@row("product", "soak")
def soaks() -> Iterator[Goal]:
    for frames, size in ((2000, "320x240"), (200, "640x480")):
        run = _in_a_process(frames, size)
        whole = run.growth * 100_000
        yield Goal(
            f"soak: memory of a session in {frames} frames of {size}",
            f"{run.growth / 1024:+.2f} KiB a frame after the warm-up; spread {run.spread / 2**20:.1f} MiB, "
            f"last {run.rss[-1] / 2**20:.0f} MiB; the board is followed in {run.followed}",
            "spread ≤ 10 MiB, light no worse, frames as quick; 100 000 frames by ./dev soak 100000",
            _is_steady(run),
            (
                f"{1e3 * run.seconds / frames:.1f} ms a frame; by that slope {whole / 2**20:+.0f} MiB in 100 000",
                _rounds(run),
            ),
        )


def _is_steady(run: Soak) -> bool:
    light = run.errors[1] <= run.errors[0] + _WORSE
    quick = run.milliseconds[1] <= _SLOWER * run.milliseconds[0]
    return run.spread <= _GOAL and light and quick and run.followed > _FOLLOWED * run.frames


def _rounds(run: Soak) -> str:
    first, last = (100 * error for error in run.errors)
    return (
        f"light after the warm-up, and at the end: {first:.2f} % and {last:.2f} % off, frames of "
        f"{run.milliseconds[0]:.1f} ms and {run.milliseconds[1]:.1f} ms"
    )


def main() -> int:
    parser = argparse.ArgumentParser(prog="./dev soak", description=__doc__)
    parser.add_argument("frames", type=int, nargs="?", default=100_000)
    parser.add_argument("--size", default="320x240", help="of the pictures (default: %(default)s)")
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    os.environ.setdefault("FASTIBL_CACHE", "0")
    print("frames  MiB")
    run = soak(given.frames, (width, height), shown=True)
    flat = _is_steady(run)
    print(_rounds(run))
    print(
        f"seconds {run.seconds:.1f} for {run.frames} frames, {run.followed} followed; "
        f"{run.growth * 1000 / 1024:+.2f} KiB in 1000 frames, spread {run.spread / 2**20:.2f} MiB after the first "
        f"{_WARM:.0%}: {'flat' if flat else 'it grows, gets worse, or was not at work'}"
    )
    return 0 if flat else 1
