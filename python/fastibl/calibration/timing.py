"""When pictures are taken: a rolling shutter's readout, and the offset between two clocks, from a board in motion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Board, Camera, Pose, _row_evidence
from ..expected import present
from ..gyroscope import Gyroscope
from ..rotations import RotationPath, accumulated, rotation_vectors, rotations_from
from ..tracking import Tracker

_FIRST_READOUT = 0.02  # seconds, for the first round
_LEAST_READOUT = 1e-3  # seconds, the least with which the board is tracked
_ROUNDS = 6
_SETTLED = 2e-5  # seconds of change, below which the readout has settled
_LONGEST_GAP = 0.2  # seconds between neighbouring pictures, at most
_LEAST_FRAMES = 12
_BLOCKS = 10  # of the jackknife
_WORST_READOUT, _WORST_OFFSET = 2e-3, 5e-3  # seconds: a larger standard deviation means that the pictures do not tell
_ACCELERATION = (8.0, 4.0)  # radians and metres per second squared, as a hand can reach
_JERK = (100.0, 50.0)  # the same, per second cubed
_STEP = 0.01  # seconds
_LONGEST = 40_000  # seconds of a film or a gyroscope's log
_AROUND = 0.25  # seconds to each side of the offset at which the gyroscope turns as fast as the camera
_LEAST_AGREEMENT = 0.7  # least correlation of the two speeds
_RIVAL = 1.5  # another offset is as good if its mean square is less than this many times the least


@dataclass(frozen=True, eq=False)
class TimingCalibration:
    """Times of a camera, in seconds, each with its standard deviation.

    readout: from a picture's first row to its last.
    clock_offset: a picture stamped `time` begins at `time` + clock_offset of the other clock; None where no other clock
    was given.
    frames: number of pictures that were used.
    times, poses: those of the tracked pictures, camera_from_marker of the first row; they can serve as a clock for
    other cameras.
    gyroscope: how the gyroscope whose rates were given is mounted, and what it says of the camera; None where there was
    none.
    """

    readout: float
    readout_deviation: float
    clock_offset: float | None
    clock_offset_deviation: float | None
    frames: int
    times: NDArray[np.float64]
    poses: tuple[Pose, ...]
    gyroscope: Gyroscope | None = None

    def __str__(self) -> str:
        told = [f"readout {1e3 * self.readout:.2f} +- {1e3 * self.readout_deviation:.2f} ms"]
        if self.clock_offset is not None and self.clock_offset_deviation is not None:
            told.append(f"clock offset {1e3 * self.clock_offset:.2f} +- {1e3 * self.clock_offset_deviation:.2f} ms")
        if self.gyroscope is not None:
            told.append(f"the gyroscope's axes within {np.degrees(self.gyroscope.deviation):.2f} degrees")
        return f"{', '.join(told)}, from {self.frames} pictures"


class PosePath:
    """Poses by another clock, which can be read at any time between the first and the last of them.

    times: (n,) seconds, increasing. poses: n Pose, target_from_world. path(time) interpolates rotation and position
    evenly between neighbours; ValueError outside the times.
    """

    def __init__(self, times: ArrayLike, poses: Iterable[Pose | ArrayLike]):
        self.times = np.asarray(times, np.float64)
        self.poses = [p if isinstance(p, Pose) else Pose(p) for p in poses]
        if self.times.ndim != 1 or len(self.times) != len(self.poses) or len(self.poses) < 2:
            raise ValueError(f"expected two or more times and as many poses, got {self.times.shape}, {len(self.poses)}")
        if not np.all(np.diff(self.times) > 0):
            raise ValueError("times must increase")

    def __call__(self, time: float) -> Pose:
        first, last = self.times[0], self.times[-1]
        if not first <= time <= last:
            raise ValueError(f"poses are known from {first:g} to {last:g} s, not at {time:g} s")
        k = min(int(np.searchsorted(self.times, time, side="right")) - 1, len(self.poses) - 2)
        share = (time - self.times[k]) / (self.times[k + 1] - self.times[k])
        a, b = self.poses[k], self.poses[k + 1]
        rotation = rotations_from(share * rotation_vectors(b.rotation @ a.rotation.T)) @ a.rotation
        eye = (1 - share) * a.inverse().translation + share * b.inverse().translation
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ eye
        return Pose(matrix)


def calibrate_timing(
    frames: Iterable[tuple[float, NDArray[np.uint8]]],
    camera: Camera,
    board: Board,
    *,
    poses: tuple[ArrayLike, Iterable[Pose | ArrayLike]] | None = None,
    gyro: tuple[ArrayLike, ArrayLike] | None = None,
    longest_offset: float | None = 0.25,
) -> TimingCalibration:
    """Finds a camera's readout, and its clock relative to another, from pictures of a board while the camera moves.

    frames: (time, (h, w, 3) uint8 RGB) in order, of the whole board if possible; one to three seconds of brisk turns in
    several directions. Of pictures of one time, the first counts.
    camera: its lens; its stated readout is ignored.
    poses: (times, Pose or (n, 4, 4) or (n, 3, 3)) of anything that is fixed to the camera, target_from_world, by the
    other clock: from a motion capture system, an arm, or another camera (`.times`, `.poses` of its calibration).
    gyro: (times, (n, 3) radians a second) of a gyroscope fixed to the camera, about its own axes. How either is mounted
    need not be known.
    longest_offset: seconds on both sides of 0 within which the clock's offset is searched. None searches all of a
    gyroscope's log, whose clock may start at another moment (that of a telephone counts from its start), by how fast
    both turn.

    Each picture's edges say how far the board moved while its rows were read; the poses of the pictures before and
    after say how fast it moved. The readout is the ratio of the two. The offset is the one at which the turns between
    pictures agree with those by the other clock, whatever the fixed rotation between the two.

    Raises ValueError where the pictures cannot tell: fewer than 12 with a pose; a readout that is less certain than 2
    ms or runs from the last row up; or an offset that is less certain than 5 ms, lies at the end of the range, or is
    one of several.
    """
    if poses is not None and gyro is not None:
        raise ValueError("give poses or gyro, not both")
    if longest_offset is None:
        if gyro is None:
            raise ValueError("a clock is looked for anywhere by a gyroscope's log alone: give gyro or longest_offset")
    elif not (np.isfinite(longest_offset) and longest_offset > 0):
        raise ValueError(f"longest_offset must be positive seconds, got {longest_offset}")
    shots: list[tuple[float, NDArray]] = []
    for time, image in frames:
        if not shots or time != shots[-1][0]:
            shots.append((float(time), np.asarray(image)))
    if len(shots) < _LEAST_FRAMES:
        raise ValueError(f"timing needs {_LEAST_FRAMES} pictures or more, got {len(shots)}")
    readout = _FIRST_READOUT
    for _ in range(_ROUNDS):
        before = readout
        track = _Track(shots, camera.replace(readout=max(readout, _LEAST_READOUT)), board)
        readout, deviation, used = track.readout()
        if abs(readout - before) < _SETTLED:
            break
    if not deviation < _WORST_READOUT:
        raise ValueError(
            f"the motion does not tell the readout: {1e3 * readout:.1f} ms with a standard deviation of "
            f"{1e3 * deviation:.1f} ms; turn the camera faster, in several directions, with the board in view"
        )
    if readout < -max(4 * deviation, _LEAST_READOUT):  # a smaller one may be an error of tracking motion
        raise ValueError(f"the readout came out as {1e3 * readout:.2f} ms: are the pictures upside down?")
    agreed = gyroscope = None
    if poses is not None:
        agreed = _offset(track, *_rotations(*poses), (0.0, present(longest_offset)), False)
    elif gyro is not None:
        times, rotations = _integrated(*gyro)
        where = (_where(track, *gyro), _AROUND) if longest_offset is None else (0.0, longest_offset)
        agreed = _offset(track, times, rotations, where, True)
        rates = np.asarray(gyro[1], np.float64)
        gyroscope = Gyroscope(times, rates, agreed.mount, agreed.mount_deviation, agreed.drift, agreed.offset)
    return TimingCalibration(
        max(readout, 0.0),
        deviation,
        agreed.offset if agreed else None,
        agreed.deviation if agreed else None,
        used,
        track.times.copy(),
        tuple(track.poses),
        gyroscope,
    )


class _Track:
    """The pictures that have poses, as a camera with some readout sees them."""

    def __init__(self, shots: list[tuple[float, NDArray]], camera: Camera, board: Board):
        tracker = Tracker(board, camera)
        found = [(time, image, tracked) for time, image in shots if (tracked := tracker.track(image, time)) is not None]
        if len(found) < _LEAST_FRAMES:
            raise ValueError(f"the board has a pose in {len(found)} pictures only; {_LEAST_FRAMES} are needed")
        self.camera, self.board = camera, board
        self.times = np.array([time for time, _, _ in found])
        self.images = [image for _, image, _ in found]
        self.tracked = [tracked for _, _, tracked in found]
        self.poses = [tracked.camera_from_marker for tracked in self.tracked]

    def readout(self) -> tuple[float, float, int]:
        """The readout in seconds, its standard deviation, and the number of pictures.

        Let v be the motion over a readout T that a picture shows, A its information, and u the velocity that the poses
        around it tell: the least squares of v - T u.
        """
        products, squares = [], []
        for k in range(1, len(self.times) - 1):
            sums = self._evidence(k)
            if sums is not None:
                products.append(sums[0])
                squares.append(sums[1])
        if len(products) < _LEAST_FRAMES - 2:
            raise ValueError(f"the motion is known in {len(products)} pictures only; {_LEAST_FRAMES - 2} are needed")
        top, bottom = np.array(products), np.array(squares)
        if not bottom.sum() > 0:
            raise ValueError("the board does not move in the pictures")
        # Pictures that a wrong pose spoils are left out, at most a fifth of them.
        error = top - top.sum() / bottom.sum() * bottom
        size = np.abs(error) / np.sqrt(np.maximum(bottom, 1e-30))
        good = size <= max(5 * np.median(size), np.percentile(size, 80))
        top, bottom = top[good], bottom[good]
        value = top.sum() / bottom.sum()
        blocks = np.arange(len(top)) * min(_BLOCKS, len(top)) // len(top)
        without = [top[blocks != b].sum() / max(bottom[blocks != b].sum(), 1e-30) for b in np.unique(blocks)]
        n = len(without)
        return float(value), float(np.sqrt((n - 1) / n * np.sum((np.array(without) - value) ** 2))), len(top)

    def _evidence(self, k: int) -> tuple[float, float] | None:
        times, readout = self.times, self.camera.readout
        if max(times[k] - times[k - 1], times[k + 1] - times[k]) > _LONGEST_GAP:
            return None
        tracked = self.tracked[k]
        if tracked.last_row is None:  # tracked by corners alone
            return None
        found = _row_evidence(self.images[k], self.board, self.camera, tracked.camera_from_marker, tracked.last_row)
        if found is None:
            return None
        share, pose, A, b = found
        place = pose.translation
        # The pose and the accelerations are free, the accelerations within a hand's reach.
        A = A.copy()
        spread = _about_board(np.array(_ACCELERATION) * readout**2, place)
        A[12:18, 12:18] += np.linalg.inv(spread @ spread.T)
        spread = _about_board(np.array(_JERK) * readout**3, place)
        A[18:, 18:] += np.linalg.inv(spread @ spread.T)
        rest = np.r_[:6, 12:24]
        gain = np.linalg.solve(A[np.ix_(rest, rest)], A[rest, 6:12])
        information = A[6:12, 6:12] - A[6:12, rest] @ gain
        change = b[6:12] - gain.T @ b[rest]
        shown = _motion(tracked.camera_from_marker, tracked.last_row, place)
        speed = self._speed(k, share * readout, place)
        return float(speed @ (information @ shown + change)), float(speed @ information @ speed)

    def _speed(self, k: int, later: float, place: NDArray) -> NDArray[np.float64]:
        """The speed of the motion, per second, `later` than picture k: from the polynomial through that picture and up
        to two on each side."""
        near = [k - 1, k + 1]
        for step in (-1, 1):
            j = k + 2 * step
            if 0 <= j < len(self.times) and abs(self.times[j] - self.times[j - step]) <= _LONGEST_GAP:
                near.append(j)
        t = self.times[near] - self.times[k]
        motions = np.stack([_motion(self.poses[k], self.poses[j], place) for j in near])
        powers = np.arange(1, len(near) + 1)
        factors = np.linalg.solve(t[:, None] ** powers, motions)
        return (powers * later ** (powers - 1)) @ factors


def _motion(first: Pose, last: Pose, place: NDArray) -> NDArray[np.float64]:
    """(w, d): a steady turn about the camera and its shift, as they move a board at `place`."""
    turned = last.rotation @ first.rotation.T
    w = rotation_vectors(turned)
    return np.concatenate([w, turned.T @ last.translation - first.translation + np.cross(w, place)])


def _about_board(deviations: NDArray, place: NDArray) -> NDArray[np.float64]:
    """(6, 6): takes turns and shifts about the camera to (w, d) of a board at `place`."""
    x, y, z = place
    turn = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])  # w -> w x place
    out = np.zeros((6, 6))
    out[:3, :3], out[3:, :3], out[3:, 3:] = np.eye(3), turn, np.eye(3)
    return out * np.repeat(deviations, 3)


def _rotations(times: ArrayLike, poses: Iterable[Pose | ArrayLike]) -> tuple[NDArray, NDArray]:
    times = np.asarray(times, np.float64)
    matrices = np.array([p.matrix if isinstance(p, Pose) else p for p in poses], np.float64)
    if times.ndim != 1 or matrices.shape[:1] != times.shape or matrices.shape[1:] not in ((3, 3), (4, 4)):
        raise ValueError(f"poses must be (n,) times and n poses, got {times.shape} and {matrices.shape}")
    return _checked(times, matrices[:, :3, :3])


def _integrated(times: ArrayLike, rates: ArrayLike) -> tuple[NDArray, NDArray]:
    """body_from_world of a body that turns by `rates` about its own axes."""
    times, rates = np.asarray(times, np.float64), np.asarray(rates, np.float64)
    if times.ndim != 1 or rates.shape != (*times.shape, 3):
        raise ValueError(f"gyro must be (n,) times and (n, 3) rates, got {times.shape} and {rates.shape}")
    turns = -0.5 * (rates[1:] + rates[:-1]) * np.diff(times)[:, None]
    return _checked(times, accumulated(turns))


def _checked(times: NDArray, rotations: NDArray) -> tuple[NDArray, NDArray]:
    if len(times) < 2 or not np.all(np.diff(times) > 0) or not np.isfinite(rotations).all():
        raise ValueError("the other clock's times must increase, and what it tells must be finite")
    return times, rotations


def _where(track: _Track | TimingCalibration, times: ArrayLike, rates: ArrayLike) -> float:
    """Roughly how many seconds a gyroscope's clock is ahead: where both turn equally fast, about whatever axes."""
    times, speeds = np.asarray(times, np.float64), np.linalg.norm(np.asarray(rates, np.float64), axis=1)
    for what, span in (("the gyroscope's log", np.ptp(times)), ("the film", np.ptp(track.times))):
        if not span <= _LONGEST:
            raise ValueError(f"{what} lasts {span:.3g} s, expected at most {_LONGEST}: are its times in seconds?")
    seen = np.array([p.rotation for p in track.poses])
    steps = np.diff(track.times)
    turns = np.linalg.norm(rotation_vectors(seen[1:] @ seen[:-1].transpose(0, 2, 1)), axis=1) / steps
    middles = 0.5 * (track.times[1:] + track.times[:-1])
    at = np.arange(middles[0], middles[-1], _STEP)
    counts = (steps <= _LONGEST_GAP)[np.clip(np.searchsorted(track.times, at) - 1, 0, len(steps) - 1)].astype(float)
    here = np.interp(at, middles, turns)
    here = counts * (here - (counts @ here) / counts.sum())  # does not count where the board was out of view
    there = np.interp(np.arange(times[0], times[-1], _STEP), times, speeds)
    beyond = len(here) // 2  # for a log that begins late or ends early
    there = np.pad(there - there.mean(), beyond)
    size = 1 << (len(there) + len(here)).bit_length()

    def sums(values: NDArray, weights: NDArray) -> NDArray:
        """For every place in the log, the weighted sum of its values."""
        products = np.fft.rfft(values, size) * np.conj(np.fft.rfft(weights, size))
        return np.fft.irfft(products, size)[: len(there) - len(here) + 1]

    spread = sums(there**2, counts) - sums(there, counts) ** 2 / counts.sum()
    least = 1e-3 * (there @ there) * counts.sum() / len(there)  # for the parts of a log in which it rests
    agreement = sums(there, here) / np.sqrt(np.maximum(np.maximum(spread, least) * (here @ here), 1e-300))
    best = int(np.argmax(agreement))
    if not agreement[best] > _LEAST_AGREEMENT:
        raise ValueError(
            f"nowhere in its {times[-1] - times[0]:.1f} s does the gyroscope turn as the camera does "
            f"(correlation {agreement[best]:.2f} at most): are log and film of the same time?"
        )
    return float(times[0] + _STEP * (best - beyond) - middles[0])


@dataclass(frozen=True)
class _Agreement:
    """The agreement of two clocks: the offset in seconds and its standard deviation; camera_from_body and its largest
    standard deviation about any axis, radians; a gyroscope's drift."""

    offset: float
    deviation: float
    mount: NDArray[np.float64]
    mount_deviation: float
    drift: NDArray[np.float64]


def _offset(track: _Track, times: NDArray, rotations: NDArray, where: tuple[float, float], bias: bool) -> _Agreement:
    """where: middle and half width of the offsets that are searched, seconds. bias: whether a gyroscope's drift is
    found, too."""
    pairs = np.flatnonzero(np.diff(track.times) <= _LONGEST_GAP)
    begin, end = track.times[pairs], track.times[pairs + 1]
    seen = np.array([p.rotation for p in track.poses])
    turns = rotation_vectors(seen[pairs + 1] @ seen[pairs].transpose(0, 2, 1))
    low = max(where[0] - where[1], times[0] - begin.max(initial=-np.inf))
    high = min(where[0] + where[1], times[-1] - end.min(initial=np.inf))
    at = RotationPath(times, rotations)

    def fitted(offset: float, within: tuple[float, float] | None = None) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """The turns between pictures less those by the other clock; the latter without a steady drift; the mount and
        the drift. within: range of offsets for which turns must be known."""
        least, most = within or (offset, offset)
        known = (begin + least >= times[0]) & (end + most <= times[-1])
        there = rotation_vectors(at(end[known] + offset) @ at(begin[known] + offset).transpose(0, 2, 1))
        here, steps = turns[known], (end - begin)[known, None]
        drift, mount = np.zeros(3), np.eye(3)
        for _ in range(3 if bias else 1):
            u, _, v = np.linalg.svd((here - steps * drift).T @ there)
            mount = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
            left = here - there @ mount.T
            if bias:
                drift = (steps * left).sum(0) / (steps**2).sum()
        told = there @ mount.T
        changing = told - steps * (steps * told).sum(0) / (steps**2).sum() if bias else told
        return here - told - steps * drift, changing, mount, drift

    def cost(offset: float) -> float:
        left, *_ = fitted(offset)
        return float((left**2).sum(1).mean()) if len(left) >= _LEAST_FRAMES else np.inf

    step = 0.2 * float(np.median(end - begin))
    grid = np.arange(low, high + step, step)
    costs = np.array([cost(float(o)) for o in grid])
    if not np.isfinite(costs).any():
        raise ValueError("the other clock's times do not cover enough of the pictures'")
    best = int(np.argmin(costs))
    a, b = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    if best in (0, len(grid) - 1):
        raise ValueError(f"the clocks agree best {grid[best]:.3f} s apart, at the end of what was looked at")
    for _ in range(40):  # golden section
        c, d = b - 0.618 * (b - a), a + 0.618 * (b - a)
        a, b = (a, d) if cost(c) < cost(d) else (c, b)
    offset = 0.5 * (a + b)
    left, told, mount, drift = fitted(offset)
    # How an offset changes the turns while the mount adapts: the mount must not be able to hide the offset.
    h = 0.25 * step
    both = offset - h, offset + h
    slope = (fitted(both[1], both)[0] - fitted(both[0], both)[0]) / (2 * h)
    variance = (left**2).sum() / max(left.size - 7, 1)
    steepness = float((slope**2).sum())
    deviation = float(np.sqrt(variance / steepness)) if steepness > 0 else np.inf
    if not deviation < _WORST_OFFSET:
        raise ValueError(
            f"the motion does not tell the clock's offset: a standard deviation of {1e3 * deviation:.1f} ms"
        )
    least = cost(offset)
    minima = [i for i in range(1, len(grid) - 1) if costs[i] <= min(costs[i - 1], costs[i + 1])]
    rivals = [grid[i] for i in minima if abs(grid[i] - offset) > 3 * step and costs[i] < _RIVAL * least]
    if rivals:
        raise ValueError(f"the motion repeats itself: offsets of {offset:.3f} and {rivals[0]:.3f} s fit alike")
    # Nothing tells the mount about an axis that all turns share.
    across = (told**2).sum() * np.eye(3) - told.T @ told
    loose = np.sqrt(variance / max(np.linalg.eigvalsh(across)[0], 1e-300))
    return _Agreement(float(offset), deviation, mount, float(min(loose, np.pi)), drift)
