"""A session over 10 000 frames that have every fault cameras can have."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.faults import KINDS, Faulty
from fastibl.live import play
from fastibl.recording import truth_of

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .recordings import sweep_film

FRAMES, FPS, SECONDS = 10_000, 15, 20
_MAP = "potsdamer_platz"
_RATE = 0.1  # share of pictures at which a fault begins
_LOOK = 50  # frames between checks of the map's error and of the memory
_WARM = 1000  # frames after which memory must not grow
# In these cases the board is not seen where it is now: a pose would be an old one.
_NO_POSE = ("dropped", "unplugged", "black", "frozen", "mirrored", "resized")
_WRONG = ("torn", "zoom")  # the board is seen, but not where it is


class Laps:
    """A sweep played forth and back, over and over, with time running on. `pose` is the true one of the frame given
    last."""

    def __init__(self, film: fastibl.Recording, count: int, first: int = 0):
        self.rig, self.board, self.truth = film.rig, film.board, truth_of(film)
        self._frames, self._first, self._count = list(film), first, count
        self.pose = fastibl.Pose()

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[fastibl.Frame]:
        for k in range(self._first, self._first + self._count):
            lap, at = divmod(k, len(self))
            frame = self._frames[at if lap % 2 == 0 else len(self) - 1 - at]
            self.pose = self.truth.pose(frame.time)
            yield replace(frame, time=k / FPS)


@dataclass
class Run:
    """The results. errors: of the irradiance (frame, error). by_kind: rotation error in degrees; None where there was
    no pose."""

    errors: list[tuple[int, float]] = field(default_factory=list)
    by_kind: dict[str, list[float | None]] = field(default_factory=lambda: defaultdict(list))
    residuals: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    resident: list[float] = field(default_factory=list)  # MB
    refused: Counter = field(default_factory=Counter)
    taken: Counter = field(default_factory=Counter)
    seconds: float = 0.0


def session_for(film: fastibl.Recording) -> fastibl.Session:
    """A session that tracks, captures and draws a small ball: the cost of a frame is measured elsewhere."""
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([0.03 * np.cos(angles), 0.03 * np.sin(angles), np.full(12, 0.1)], axis=-1)
    points = np.concatenate([ring, [[0, 0, 0.07], [0, 0, 0.13]]])
    sides = [(k, (k + 1) % 12) for k in range(12)]
    mesh = fastibl.Mesh(points, [(b, a, 12) for a, b in sides] + [(a, b, 13) for a, b in sides])
    scene = fastibl.Scene(mesh, spheres=0, visibility_rays=0)
    return fastibl.Session(scene, film.rig, film.board, cast_shadow=False, methods={"self_shadow": "none"})


def run(session: fastibl.Session, source, laps: Laps, look: int = _LOOK) -> Run:
    true, out = laps.truth.environment(0.0), Run()
    begin = time.perf_counter()
    for k, played in enumerate(play(session, source)):
        kind = getattr(source, "happened", {}).get("back", "good")
        result = played.result
        for why in played.refused:
            out.refused[why] += 1
        pose = None if result is None else result.back_from_marker
        out.by_kind[kind].append(None if pose is None else float(np.degrees(pose.angle_to(laps.pose))))
        if result is not None and result.tracked is not None:
            out.residuals[kind].append(result.tracked.residual_px)
        for taken in () if result is None else (result.back_taken, result.front_taken):
            if taken is not None:
                out.taken[taken.how] += 1
        if k % look == look - 1:
            out.resident.append(_resident())
            if result is not None:
                out.errors.append((k + 1, irradiance_error(result.environment, true)))
    out.seconds = time.perf_counter() - begin
    return out


def _resident() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


@row("capture", "fault run")
def fault_run() -> Iterator[Goal]:
    what = f"fault run of {FRAMES} frames"
    if _MAP not in inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    film = sweep_film(_MAP, seconds=SECONDS, fps=FPS, seed=0, size=(320, 240))
    session, sweep = session_for(film), SECONDS * FPS
    clean_laps = Laps(film, 2 * sweep)
    clean = run(session, clean_laps, clean_laps)
    before = float(np.median([e for k, e in clean.errors if k > sweep]))
    laps = Laps(film, FRAMES, 2 * sweep)
    source = Faulty(laps, seed=1, kinds=_RATE)
    crash, faults = "none", None
    try:
        faults = run(session, source, laps)
    except Exception as error:  # noqa: BLE001 - that none comes out is what is measured
        crash = f"{type(error).__name__}: {error}"
    begun = ", ".join(f"{kind} {source.counts[kind]}" for kind in KINDS)
    yield Goal(
        f"{what}, a fault begins at {percent(_RATE)} of the pictures: what ended it",
        crash,
        "none",
        crash == "none",
        (f"pictures: {begun}",),
    )
    if faults is None:
        return
    yield from _poses(what, faults)
    warm = faults.resident[_WARM // _LOOK]
    growth = max(faults.resident[_WARM // _LOOK :]) - warm
    yield Goal(f"{what}: growth of memory after the first {_WARM}", f"{growth:.1f} MB", "<= 5 MB", growth <= 5, ())
    after_laps = Laps(film, 2 * sweep, 2 * sweep + FRAMES)
    after = run(session, after_laps, after_laps)
    during = np.array([e for _, e in faults.errors])
    recovered = next((k for k, e in after.errors if e <= before + 0.005), None)
    last = max(e for k, e in after.errors if k > sweep)
    yield Goal(
        f"{what}: irradiance error after a sweep of {sweep} good frames, before the faults {percent(before, 2)}",
        percent(last, 2),
        "<= 0.5 % more",
        last <= before + 0.005,
        (
            f"during the faults median {percent(float(np.median(during)))}, 95 % "
            f"{percent(float(np.quantile(during, 0.95)))}, worst {percent(during.max())}; within 0.5 % again after "
            f"{recovered} good frames",
            "pictures taken: " + ", ".join(f"{how} {count}" for how, count in faults.taken.items()),
            "left out before: " + ", ".join(f"{which} {count}" for which, count in faults.refused.items()),
            f"{faults.seconds:.0f} s, {1e3 * faults.seconds / FRAMES:.1f} ms a frame",
        ),
    )


def _poses(what: str, faults: Run) -> Iterator[Goal]:
    stale = {kind: sum(e is not None for e in faults.by_kind[kind]) for kind in _NO_POSE}
    yield Goal(
        f"{what}: poses given though the picture does not show the board now",
        str(sum(stale.values())),
        "0",
        sum(stale.values()) == 0,
        ("frames: " + ", ".join(f"{kind} {len(faults.by_kind[kind])}" for kind in _NO_POSE),),
    )
    usable = [k for k in faults.by_kind if k not in (*_NO_POSE, *_WRONG)]
    errors = [e for kind in usable for e in faults.by_kind[kind]]
    given = np.array([e for e in errors if e is not None])
    notes = []
    for kind in _WRONG:
        wrong = np.array([e for e in faults.by_kind[kind] if e is not None] or [0.0])
        notes.append(
            f"{kind}: {len(wrong)} poses, median {np.median(wrong):.2f}, worst {wrong.max():.2f} degrees, residual "
            f"{np.median(faults.residuals[kind] or [0]):.2f} px "
            f"(good frames {np.median(faults.residuals['good']):.2f} px)"
        )
    yield Goal(
        f"{what}: rotation error where the back picture is sound: 99 %, worst; share of frames with a pose",
        f"{np.quantile(given, 0.99):.2f}, {given.max():.2f} degrees; {percent(len(given) / len(errors))}",
        "worst <= 5 degrees, >= 95 %",
        bool(given.max() <= 5 and len(given) >= 0.95 * len(errors)),
        tuple(notes),
    )
