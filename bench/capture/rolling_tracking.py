"""A rolling shutter and two clocks: poses, readout and offset compared with the truth, and what ignoring them costs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.calibration import PosePath, TimingCalibration, calibrate_timing
from fastibl.expected import present
from fastibl.extremes.board_pictures import rotation_error_degrees
from fastibl.recording import truth_of
from fastibl.simulator import DistantPlace, default_rig, simulate, with_readout

from .. import inputs
from ..goals import Goal, row, skipped
from ..light.speed import looking
from ..measure import one_core
from .board_film import CAMERA
from .rolling_film import PATHS, READOUT, ROLLING, TURN, Path, film

BOARD = fastibl.Board.default()
SEEDS, FRAMES = 3, 40
OFFSET = 0.02  # seconds
WORST = 0.2  # degrees
_HOW = "60 degrees a second, 30 ms readout"


@cache
def shots(name: str, seed: int) -> tuple[tuple[float, NDArray[np.uint8]], ...]:
    return tuple(film(BOARD, PATHS[name](seed), ROLLING, FRAMES, seed))


@dataclass
class Followed:
    """Degrees, one per picture; CPU seconds, without the first two pictures."""

    first: list[float]
    last: list[float]
    seconds: list[float]
    none: int = 0

    def p95(self) -> float:
        return float(np.percentile(self.first, 95))


def follow(name: str, camera: fastibl.Camera) -> Followed:
    out = Followed([], [], [])
    for seed in range(SEEDS):
        path, tracker = PATHS[name](seed), fastibl.Tracker(BOARD, camera)
        for k, (now, image) in enumerate(shots(name, seed)):
            begin = time.thread_time()
            tracked = tracker.track(image, now)
            if k > 1:
                out.seconds.append(time.thread_time() - begin)
            if tracked is None:
                out.none += 1
                continue
            out.first.append(rotation_error_degrees(tracked.camera_from_marker.matrix, path(now)))
            if tracked.last_row is not None:
                out.last.append(rotation_error_degrees(tracked.last_row.matrix, path(now + READOUT)))
    return out


@row("capture", "rolling shutter: pose")
@one_core()
def poses() -> Iterator[Goal]:
    for name in PATHS:
        rolling, ignored = follow(name, ROLLING), follow(name, CAMERA)
        yield Goal(
            f"{_HOW}, {name}, tracked: p95 of the rotation",
            f"{rolling.p95():.3f} degrees",
            f"<= {WORST}, all given",
            rolling.p95() <= WORST and rolling.none == 0,
            (
                f"median {np.median(rolling.first):.4f}, worst {max(rolling.first):.3f}, "
                f"p95 at the last row {np.percentile(rolling.last, 95):.3f}",
                f"taken as read at once: p95 {ignored.p95():.2f} degrees, none in {ignored.none} frames",
                f"CPU time a frame {1e3 * np.median(rolling.seconds):.2f} ms, "
                f"taken as read at once {1e3 * np.median(ignored.seconds):.2f} ms",
            ),
        )


def other_clock(path: Path) -> tuple[NDArray, NDArray]:
    """Poses of something fixed to the camera, 200 a second, by a clock that is OFFSET ahead of that of the pictures."""
    mounted = fastibl.Pose.from_rotation_vector([0.3, -1.0, 0.5], [0.1, 0.2, 0.3]).matrix
    times = np.arange(-0.3, FRAMES / 30 + 0.3, 0.005)
    return times + OFFSET, np.array([mounted @ path(t) for t in times])


@cache
def calibrated(name: str, seed: int) -> TimingCalibration:
    return calibrate_timing(shots(name, seed), CAMERA, BOARD, poses=other_clock(PATHS[name](seed)))


@row("capture", "rolling shutter: clocks")
def clocks() -> Iterator[Goal]:
    names = [name for name in PATHS if name != "around the board"]
    found = {(name, seed): calibrated(name, seed) for name in names for seed in range(SEEDS)}
    readouts = np.array([c.readout - READOUT for c in found.values()])
    offsets = np.array([present(c.clock_offset) - OFFSET for c in found.values()])
    stated = [(c.readout_deviation, c.clock_offset_deviation) for c in found.values()]
    by_deviation = np.abs(np.stack([readouts, offsets], 1)) / np.array(stated)
    for what, errors, k in (("readout", readouts, 0), ("clock offset", offsets, 1)):
        yield Goal(
            f"unknown {what}, from {FRAMES} pictures of a board: worst of {len(found)} films",
            f"{1e3 * np.abs(errors).max():.2f} ms",
            "<= 1 ms",
            bool(np.abs(errors).max() <= 1e-3),
            (f"error by the stated deviation: median {np.median(by_deviation[:, k]):.1f}, "
             f"worst {by_deviation[:, k].max():.1f}",),
        )  # fmt: skip
    # Poses of the other clock, with the offset that was found; and tracked poses, with the readout that was found.
    given, late, tracked = [], [], []
    for (name, seed), timing in found.items():
        path = PATHS[name](seed)
        times, matrices = other_clock(path)
        # Whoever gives poses knows the mount.
        mounted = matrices[0] @ np.linalg.inv(path(times[0] - OFFSET))
        known = PosePath(times, [fastibl.Pose(np.linalg.inv(mounted) @ m) for m in matrices])
        offset = present(timing.clock_offset)
        tracker = fastibl.Tracker(BOARD, CAMERA.replace(readout=timing.readout))
        for now, image in shots(name, seed):
            given.append(rotation_error_degrees(known(now + offset).matrix, path(now)))
            late.append(rotation_error_degrees(known(now).matrix, path(now)))
            found_now = present(tracker.track(image, now)).camera_from_marker
            tracked.append(rotation_error_degrees(found_now.matrix, path(now)))
    for what, degrees, notes in (
        ("poses by another clock, unknown 20 ms apart", given, (f"ignored: {np.percentile(late, 95):.2f} degrees",)),
        ("tracked, unknown readout", tracked, ()),
    ):
        value = float(np.percentile(degrees, 95))
        yield Goal(f"{_HOW}, {what}: p95 of the rotation", f"{value:.3f} degrees", f"<= {WORST}", value <= WORST, notes)


def around(time: float) -> fastibl.Pose:
    """A path around the board at 60 degrees a second, up and down."""
    tilt, azimuth = np.radians(48 + 9 * np.sin(2.5 * time)), TURN * time
    away = np.array([np.sin(tilt) * np.sin(azimuth), -np.sin(tilt) * np.cos(azimuth), np.cos(tilt)])
    return looking(-away, 0.5 * away)


@dataclass(frozen=True)
class Maps:
    """Mean |map - truth| / mean truth of texels above the horizon that all runs saw; and the 95th percentile of the
    poses' error, degrees."""

    still: float
    tracked: float
    given: float
    ignored: float
    degrees: float
    timing: TimingCalibration


@cache
def maps(name: str) -> Maps:
    environment = fastibl.read_environment(inputs.MAPS[name], size=256)
    common: dict[str, Any] = {
        "seconds": 3, "fps": 15, "hand": False, "truth_size": 8, "path": around, "rig": default_rig((480, 360)),
    }  # fmt: skip
    still = simulate(environment, readout=0.0, **common)
    rolling = simulate(environment, readout=READOUT, clock_offset=OFFSET, **common)
    mesh = fastibl.Mesh(np.array([[0, 0, 0.11], [0.01, 0, 0.13], [0, 0.01, 0.13]], np.float32), np.array([[0, 1, 2]]))
    scene = fastibl.Scene(mesh, fastibl.Material(), spheres=0, visibility_rays=0)

    times = np.arange(-0.2, 3.4, 0.005)
    reference = times, [around(t) for t in times]  # by the truth's clock
    timing = calibrate_timing(
        ((f.time, present(f.back)) for f in rolling), rolling.rig.back, rolling.board, poses=reference
    )
    known, offset = PosePath(*reference), present(timing.clock_offset)

    def run(film: fastibl.Recording, rig: fastibl.Rig, given: Callable[[float], fastibl.Pose] | None = None):
        session, degrees = fastibl.Session(scene, rig, film.board), []
        for frame in film:
            if given is not None:
                frame = fastibl.Frame(
                    frame.time, frame.back, frame.front, frame.back_exposure, frame.front_exposure,
                    given(frame.time), given(frame.time + rig.back.readout) if rig.back.readout else None,
                )  # fmt: skip
            pose = session.process(frame).back_from_marker
            if pose is not None:
                truth = around(frame.time + truth_of(film).clock_offset)
                degrees.append(rotation_error_degrees(pose.matrix, truth.matrix))
        capture = session.capture
        faces = capture.environment().radiance.faces.astype(np.float64)
        return faces, np.isfinite(capture.last_seen), float(np.percentile(degrees, 95))

    found = with_readout(rolling.rig, timing.readout)
    runs = (
        run(still, still.rig),
        run(rolling, found),
        run(rolling, found, lambda t: known(t + offset)),
        run(rolling, with_readout(rolling.rig, 0.0), known),
    )
    truth = DistantPlace(environment).truth((0.0, 0.0, 0.12), 128).faces.astype(np.float64)
    white = 1 / min(present(f.front_exposure) for f in still)  # the largest value that a picture can tell
    seen = np.all([s for _, s, _ in runs], axis=0) & (fastibl.texel_directions(128)[..., 2] > 0.05)
    true = np.minimum(truth[seen], white)
    of_still, tracked, given, ignored = (
        float(np.abs(np.minimum(faces[seen], white) - true).mean() / true.mean()) for faces, _, _ in runs
    )
    return Maps(of_still, tracked, given, ignored, degrees=runs[1][2], timing=timing)


@row("capture", "rolling shutter: session")
def session_maps() -> Iterator[Goal]:
    what = f"{_HOW}, both cameras, readout and a clock offset of 20 ms unknown"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    found = {name: maps(name) for name in inputs.MAPS}
    for how, error in (("tracked", lambda m: m.tracked), ("poses of another clock", lambda m: m.given)):
        ratios = {name: error(m) / m.still for name, m in found.items()}
        yield Goal(
            f"{what}; {how}: map error by a global shutter's, median, worst of {len(found)} maps",
            f"{np.median(list(ratios.values())):.2f}, {max(ratios.values()):.2f}",
            "<= 1.2",
            max(ratios.values()) <= 1.2,
            (
                ", ".join(f"{name} {r:.2f}" for name, r in ratios.items()),
                "neither known: " + ", ".join(f"{name} {m.ignored / m.still:.1f}" for name, m in found.items()),
            ),
        )
    degrees = max(m.degrees for m in found.values())
    readouts = [1e3 * (m.timing.readout - READOUT) for m in found.values()]
    offsets = [1e3 * (present(m.timing.clock_offset) - OFFSET) for m in found.values()]
    yield Goal(
        f"{what}; tracked: p95 of the rotation, worst of {len(found)} maps",
        f"{degrees:.3f} degrees",
        f"<= {WORST}",
        degrees <= WORST,
        (f"readout off by {max(map(abs, readouts)):.2f} ms, offset by {max(map(abs, offsets)):.2f} ms at most",),
    )
