"""Bundle adjustment of a lens, of the board's poses, and of what else pictures may tell: how the print departs from the
stated board, and how the camera moved while a rolling shutter read its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._fastibl import Board, Camera, Pose
from .corners import Seen

_POWERS = tuple((i, n - i) for n in (2, 3, 4) for i in range(n + 1))  # of x and y in the height: none is a plane's
_ROUNDS, _ROUNDS_OF_MOTION = 4, 6
# Errors that motion leaves are alike in all corners of a picture, so they may reach this many of the deviations that
# independent errors would give.
_ALIKE = 4.0
_GAP = 0.15  # seconds: pictures further apart tell nothing about motion
_SURE = 20.0  # mean square of what is found in its deviations, 1 for independent noise; flat prints give up to 5
# Motion of a hand about and along each axis while all rows are read: radians and metres, 0.7 rad/s and 0.25 m/s for 30
# ms.
_HAND = np.repeat([0.021, 0.0075], 3)
FLATTEN = "fix it to something flat, as glass or a board, and take the pictures again"
_MOST = 0.001  # share of the board's size by which a print may bend, or its sides differ, without a warning


@dataclass(frozen=True)
class Bundle:
    """One adjustment.

    lens: as OpenCV has it, in the order of CameraCalibration.deviations, and its standard deviations; poses:
    camera_from_marker of each picture, for its middle row; residual: RMS of corners, pixels.
    bend: metres between the print's highest and lowest corner above the mean plane; stretch: its height relative to its
    width (1.002: 0.2 % too high); bent: whether the pictures can tell these from a flat print of the stated size.
    moved: pixels by which corners move from the first to the last row, the median of the pictures; 0 where all rows
    were assumed to be read at once.
    readout: seconds from the first to the last row, and its standard deviation, where times tell them.
    squares, freedom: sum of squares of the residuals, pixels squared, and its degrees of freedom; motions: number of
    parameters of the motion.
    """

    lens: NDArray[np.float64]
    deviations: NDArray[np.float64]
    poses: tuple[Pose, ...]
    residual: float
    bend: float
    stretch: float
    bent: bool
    moved: float
    readout: tuple[float, float] | None
    squares: float
    freedom: int
    motions: int

    def tells_motion(self, still: Bundle) -> bool:
        """Whether the pictures can tell their motion from rest; `still` is the fit without motion."""
        if not (np.isfinite(self.lens).all() and (self.lens[:2] > 0).all()):
            return False
        return (still.squares - self.squares) * self.freedom > _SURE * self.squares * self.motions

    def fault(self, board: Board) -> str | None:
        """What to do about a print that is bent or stretched too far; None where it is not."""
        if not self.bent:
            return None
        if self.bend > most_bend(board):
            return f"the print is bent by about {1000 * self.bend:.1f} mm: {FLATTEN}"
        if abs(self.stretch - 1) > _MOST:
            return (
                f"the print is about {abs(self.stretch - 1):.2%} too {'high' if self.stretch > 1 else 'wide'}: measure "
                "it with `fastibl calibrate board`, or print it again"
            )
        return None


def most_bend(board: Board) -> float:
    """Metres that a print may bend without a warning: 0.3 mm for the default board."""
    corners = np.concatenate([np.asarray(tag.corners) for tag in board.tags])
    return _MOST * float(np.ptp(corners, axis=0).max())


def smooth_bend(corners: NDArray[np.float64], heights: NDArray[np.float64]) -> float:
    """Metres between the highest and lowest corner above the mean plane, on a smooth surface through noisy heights.

    corners: (n, 2), heights: (n,) metres.
    """
    at = (corners - corners.mean(axis=0)) / np.ptp(corners)
    plane, bends = np.column_stack([at, np.ones(len(at))]), _heights(at)
    terms = np.hstack([plane, bends])
    smooth = terms @ np.linalg.lstsq(terms, heights, rcond=None)[0]
    return float(np.ptp(smooth - plane @ np.linalg.lstsq(plane, smooth, rcond=None)[0]))


@dataclass
class _Print:
    """corners: (n, 2) metres, all of them; middle, size: their middle and half their extent, metres. shape: how the
    print departs from the stated board: factors of the heights' powers, and of its sides (stretch, shear)."""

    corners: NDArray[np.float64]
    middle: NDArray[np.float64]
    size: float
    shape: NDArray[np.float64]

    @staticmethod
    def of(board: Board) -> _Print:
        corners = np.concatenate([np.asarray(tag.corners) for tag in board.tags])
        size = float(np.ptp(corners, axis=0).max()) / 2
        return _Print(corners, corners.mean(axis=0), size, np.zeros(len(_POWERS) + 2))

    def heights(self) -> NDArray[np.float64]:
        """The heights of all corners, metres."""
        return _heights((self.corners - self.middle) / self.size) @ self.shape[:-2]


@dataclass
class _View:
    """One picture. at: (n, 2) corners on the board, from its middle, in units of its half size; pixels: (n, 2) where
    they are seen, in OpenCV's coordinates; later: (n,) when they are seen, from -0.5 to 0.5 of the rows' time. motion:
    (6,) turn and shift of the board in that time at the middle row; more: what is added with the square of `later`."""

    at: NDArray[np.float64]
    pixels: NDArray[np.float64]
    later: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    motion: NDArray[np.float64]
    more: NDArray[np.float64]

    @staticmethod
    def of(seen: Seen, pose: Pose, print_: _Print, height: int) -> _View:
        return _View(
            (seen.on_board.reshape(-1, 2) - print_.middle) / print_.size,
            seen.opencv_pixels().astype(np.float64),
            seen.pixels.reshape(-1, 2)[:, 1] / height - 0.5,
            np.array(pose.rotation),
            np.array(pose.translation),
            np.zeros(6),
            np.zeros(6),
        )

    def move(self, step: NDArray) -> None:
        """step: turn and shift in the camera frame; with a rolling shutter, also what is added to the motion's turn and
        shift."""
        turn = Pose.from_rotation_vector(step[:3], step[3:6])
        self.rotation, self.translation = turn.rotation @ self.rotation, turn @ self.translation
        if len(step) > 6:
            self.motion = self.motion + step[6:]


def neighbours(times: Sequence[float]) -> list[tuple[int, int, int] | None]:
    """For each picture of a film, three pictures in a row with it in the middle or at an end; None where there are
    none."""
    close = np.diff(times) < _GAP
    runs = [k for k in range(len(close) - 1) if close[k] and close[k + 1]]  # first of three
    out: list[tuple[int, int, int] | None] = []
    for k in range(len(times)):
        first = next((f for f in (k - 1, k, k - 2) if f in runs), None)
        out.append(None if first is None else (first, first + 1, first + 2))
    return out


def adjust(
    seen: Sequence[Seen],
    poses: Sequence[Pose],
    camera: Camera,
    board: Board,
    count: int,
    *,
    bends: bool = True,
    moves: bool = False,
    times: Sequence[float] | None = None,
) -> Bundle:
    """Fits lens and poses by Gauss-Newton, starting from a fit with a flat print and a camera at rest.

    poses: camera_from_marker of each of `seen`.
    count: number of the lens's parameters that were fitted.
    bends: whether the print may be bent and stretched; moves: whether each picture's rows may be read one after the
    other.
    times: seconds of the pictures of a film, each of which has neighbours(): the poses then tell the motion, and the
    time from the first to the last row is fitted. Otherwise each picture has a motion of its own, like that of a hand.
    """
    print_ = _Print.of(board)
    lens = np.array([camera.fx, camera.fy, *_opencv_centre(camera), *camera.distortion], np.float64)
    lens = np.concatenate([lens, np.zeros(max(0, count - len(lens)))])
    views = [_View.of(s, p, print_, camera.height) for s, p in zip(seen, poses, strict=True)]
    columns = count + (len(print_.shape) if bends else 0)
    free = moves and times is None
    readout, noise = 0.0, 0.0  # seconds, pixels
    values = sum(v.pixels.size for v in views)
    freedom = max(1, values - columns - 6 * len(views))
    for round_ in range(_ROUNDS_OF_MOTION if moves else _ROUNDS):
        rates = _rates(views, times) if moves and times is not None else None
        normal, gradient, squares, blocks = 0.0, 0.0, 0.0, []
        for k, view in enumerate(views):
            shared, own, residual = _derivatives(view, print_, lens, camera.model, count)
            shared, by_rows = shared[:, :columns], np.repeat(view.later, 2)[:, None] * own
            if rates is not None:
                shared = np.column_stack([shared, by_rows @ rates[k][0]])
            if free and round_ > 0:  # the noise is known by then
                known = np.diag(noise / _HAND)
                own = np.block([[own, by_rows], [np.zeros((6, 6)), known]])
                shared = np.vstack([shared, np.zeros((6, shared.shape[1]))])
                residual = np.concatenate([residual, -known @ view.motion])
            solve = np.linalg.pinv(own)
            within, rest = shared - own @ (solve @ shared), residual - own @ (solve @ residual)
            normal, gradient = normal + within.T @ within, gradient + within.T @ residual
            squares += float(rest @ rest)
            blocks.append((solve, shared, residual))
        step = np.linalg.lstsq(normal, gradient, rcond=None)[0]
        squares = max(squares - float(step @ gradient), 0.0)  # as large as rounding where nothing fits
        lens[:count] += step[:count]
        if bends:
            print_.shape += step[count:columns]
        for view, (solve, shared, residual) in zip(views, blocks, strict=True):
            view.move(solve @ (residual - shared @ step))
        if rates is not None:
            readout += float(step[-1])
            for view, rate in zip(views, rates, strict=True):
                view.motion, view.more = readout * rate[0], readout**2 * rate[1]
        noise = np.sqrt(squares / freedom)
    covariance = np.linalg.pinv(normal) * squares / freedom
    deviations = (_ALIKE if moves else 1) * np.sqrt(np.maximum(np.diag(covariance), 0))
    bent = False
    if bends:
        parts = slice(count, columns - 2), slice(columns - 2, columns)  # the heights, and the sides
        found = print_.shape[:-2], print_.shape[-2:]
        bent = any(_ratio(f, covariance[p, p]) > _SURE for f, p in zip(found, parts, strict=True))
    return Bundle(
        lens,
        deviations[:count],
        tuple(Pose(np.vstack([np.column_stack([v.rotation, v.translation]), [0, 0, 0, 1]])) for v in views),
        float(np.sqrt(2 * squares / values)),
        smooth_bend(print_.corners, print_.heights()),
        1 + float(print_.shape[-2]),
        bent,
        float(np.median([_flow(v, print_, lens, camera.model, count) for v in views])) if moves else 0.0,
        (readout, float(deviations[-1])) if moves and times is not None else None,
        squares,
        freedom,
        6 * len(views) if free else 1,
    )


def _rates(views: Sequence[_View], times: Sequence[float]) -> list[NDArray]:
    """Turns and shifts a second, (6,), of each picture, from the parabola through three neighbours' poses."""
    import cv2

    rates = []
    for k, three in enumerate(neighbours(times)):
        if three is None:
            raise ValueError(f"picture {k} at {times[k]:g} s has no two others beside it")
        steps = []
        for j in three:
            turn = views[j].rotation @ views[k].rotation.T
            shift = views[j].translation - turn @ views[k].translation
            steps.append(np.concatenate([np.ravel(cv2.Rodrigues(turn)[0]), shift]))
        since = np.array([times[j] - times[k] for j in three])
        rates.append(np.polynomial.polynomial.polyfit(since, np.array(steps), 2)[1:])
    return rates


def _ratio(values: NDArray, covariance: NDArray) -> float:
    """The mean square of values in units of their deviations: 1 where they are noise."""
    return float(values @ np.linalg.pinv(covariance) @ values) / len(values)


def _opencv_centre(camera: Camera) -> tuple[float, float]:
    matrix = camera.opencv_matrix
    return float(matrix[0, 2]), float(matrix[1, 2])


def _heights(at: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([at[:, 0] ** i * at[:, 1] ** j for i, j in _POWERS], axis=1)


def _flow(view: _View, *fit) -> float:
    """Pixels by which the view's corners move from the first to the last row."""
    _, by_pose, _ = _derivatives(view, *fit)
    return float(np.sqrt(2 * np.mean((by_pose @ view.motion) ** 2)))


def _derivatives(
    view: _View, print_: _Print, lens: NDArray, model: str, count: int
) -> tuple[NDArray, NDArray, NDArray]:
    """Derivatives of one picture's corners by lens and shape, and by its pose; and the differences from where they are
    seen."""
    import cv2

    heights, (x, y) = _heights(view.at), view.at.T
    size, shape = print_.size, print_.shape
    stretch, shear = shape[-2:]
    moved = np.stack([x * (1 - stretch / 2) + shear * y, y * (1 + stretch / 2), heights @ shape[:-2] / size], axis=1)
    board = size * moved + [*print_.middle, 0]
    points = board @ view.rotation.T + view.translation
    if view.motion.any():
        moved = view.later[:, None] * view.motion + view.later[:, None] ** 2 * view.more
        turn, shift = moved[:, :3], moved[:, 3:]
        points = points + np.cross(turn, points + np.cross(turn, points) / 2) + shift  # to second order: 1e-3 px
    matrix, still = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]]), np.zeros(3)
    if model == "fisheye":
        found, j = cv2.fisheye.projectPoints(points[None], still, still, matrix, lens[4:8])
        by_lens, by_pose = j[:, :8], j[:, 8:14]
    else:
        found, j = cv2.projectPoints(points, still, still, matrix, lens[4:])
        by_lens, by_pose = j[:, 6 : 6 + count], j[:, :6]
    by_point = by_pose[:, 3:].reshape(-1, 2, 3) @ view.rotation
    zero = np.zeros_like(x)
    by_shape = [by_point[..., 2] * h[:, None] for h in heights.T]
    for dx, dy in ((-x / 2, y / 2), (y, zero)):
        by_shape.append(size * (by_point[..., 0] * dx[:, None] + by_point[..., 1] * dy[:, None]))
    shared = np.hstack([by_lens[:, :count], np.stack([b.reshape(-1) for b in by_shape], axis=1)])
    return shared, by_pose, (view.pixels - found.reshape(-1, 2)).reshape(-1)
