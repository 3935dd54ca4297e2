"""How a print departs from the board that it was said to be: bent, or stretched one way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._fastibl import Board, Camera, Pose
from .corners import Seen

_POWERS = tuple((i, n - i) for n in (2, 3, 4) for i in range(n + 1))  # of x and y in the height: none is a plane's
_ROUNDS = 4
_SURE = 20.0  # mean square of what is found in its deviations, 1 for independent noise; flat prints give up to 5
FLATTEN = "fix it to something flat, as glass or a board, and take the pictures again"
_MOST = 0.001  # of the board's size: what a print may bend, or its sides differ, without a warning


@dataclass(frozen=True)
class PrintShape:
    """A print as the pictures show it, where it is taken as free to bend and to stretch.

    bend: metres between the highest and the lowest corner above the mean plane; stretch: of its height against its
    width (1.002: 0.2 % too high). told: whether pictures tell it from a flat print as it was said to be. Of the same
    fit, in the order of CameraCalibration.deviations: lens, as OpenCV has it, its standard deviations,
    camera_from_marker of each picture, and the residual, RMS of corners in pixels.
    """

    bend: float
    stretch: float
    told: bool
    lens: NDArray[np.float64]
    deviations: NDArray[np.float64]
    poses: tuple[Pose, ...]
    residual: float

    def fault(self, board: Board) -> str | None:
        """What to do about a print that is too far from flat; None for one that is not."""
        if not self.told:
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
    """Metres that a print may bend without a warning: 0.3 mm of the default board."""
    corners = np.concatenate([np.asarray(tag.corners) for tag in board.tags])
    return _MOST * float(np.ptp(corners, axis=0).max())


def smooth_bend(corners: NDArray[np.float64], heights: NDArray[np.float64]) -> float:
    """Metres between the highest and the lowest corner above the mean plane, of a smooth surface through noisy heights.

    corners: (n, 2), heights: (n,) metres.
    """
    at = (corners - corners.mean(axis=0)) / np.ptp(corners)
    plane, bends = np.column_stack([at, np.ones(len(at))]), _heights(at)
    terms = np.hstack([plane, bends])
    smooth = terms @ np.linalg.lstsq(terms, heights, rcond=None)[0]
    return float(np.ptp(smooth - plane @ np.linalg.lstsq(plane, smooth, rcond=None)[0]))


def print_shape(seen: Sequence[Seen], poses: Sequence[Pose], camera: Camera, board: Board, count: int) -> PrintShape:
    """Fits lens, poses and the print's shape together, by Gauss and Newton from the fit of a flat one.

    poses: camera_from_marker of each of `seen`. count: of the lens's parameters that were fitted.
    """
    import cv2

    corners = np.concatenate([np.asarray(tag.corners) for tag in board.tags])
    middle, size = corners.mean(axis=0), float(np.ptp(corners, axis=0).max()) / 2
    lens = np.array([camera.fx, camera.fy, *_opencv_centre(camera), *camera.distortion], np.float64)
    lens = np.concatenate([lens, np.zeros(max(0, count - len(lens)))])
    shape = np.zeros(len(_POWERS) + 2)
    places = [np.concatenate([np.ravel(cv2.Rodrigues(p.rotation.copy())[0]), p.translation]) for p in poses]
    flat = [(s.on_board.reshape(-1, 2) - middle) / size for s in seen]
    pixels = [s.opencv_pixels().astype(np.float64) for s in seen]
    for _ in range(_ROUNDS):
        blocks = [
            _derivatives(at, size, middle, place, lens, shape, camera.model, count, to)
            for at, place, to in zip(flat, places, pixels, strict=True)
        ]
        normal, gradient, squares, own_solves = 0.0, 0.0, 0.0, []
        for shared, own, residual in blocks:
            solve = np.linalg.pinv(own)
            within = shared - own @ (solve @ shared)
            normal, gradient = normal + within.T @ within, gradient + within.T @ residual
            squares += float(((residual - own @ (solve @ residual)) ** 2).sum())
            own_solves.append(solve)
        step = np.linalg.lstsq(normal, gradient, rcond=None)[0]
        squares -= float(step @ gradient)
        lens[:count] += step[:count]
        shape += step[count:]
        places = [
            place + solve @ (residual - shared @ step)
            for place, solve, (shared, _, residual) in zip(places, own_solves, blocks, strict=True)
        ]
    freedom = max(1, sum(p.size for p in pixels) - len(step) - 6 * len(seen))
    covariance = np.linalg.pinv(normal) * squares / freedom
    return PrintShape(
        smooth_bend(corners, _heights((corners - middle) / size) @ shape[:-2]),
        1 + float(shape[-2]),
        bool(
            _ratio(shape[:-2], covariance[count:-2, count:-2]) > _SURE
            or _ratio(shape[-2:], covariance[-2:, -2:]) > _SURE
        ),
        lens,
        np.sqrt(np.diag(covariance)[:count]),
        tuple(Pose.from_rotation_vector(place[:3], place[3:]) for place in places),
        float(np.sqrt(2 * squares / sum(p.size for p in pixels))),
    )


def _ratio(values: NDArray, covariance: NDArray) -> float:
    """Mean square of values in their deviations: 1 where they are noise."""
    return float(values @ np.linalg.pinv(covariance) @ values) / len(values)


def _opencv_centre(camera: Camera) -> tuple[float, float]:
    matrix = camera.opencv_matrix
    return float(matrix[0, 2]), float(matrix[1, 2])


def _heights(at: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([at[:, 0] ** i * at[:, 1] ** j for i, j in _POWERS], axis=1)


def _derivatives(
    at: NDArray, size: float, middle: NDArray, place: NDArray, lens: NDArray, shape: NDArray, model: str, count: int,
    to: NDArray,
) -> tuple[NDArray, NDArray, NDArray]:  # fmt: skip
    """Of one picture's corners by lens and shape, and by its pose; and what they are off."""
    import cv2

    heights, (x, y) = _heights(at), at.T
    stretch, shear = shape[-2:]
    moved = np.stack([x * (1 - stretch / 2) + shear * y, y * (1 + stretch / 2), heights @ shape[:-2] / size], axis=1)
    points = size * moved + [*middle, 0]
    matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    if model == "fisheye":
        found, j = cv2.fisheye.projectPoints(points[None], place[:3], place[3:], matrix, lens[4:8])
        by_lens, by_pose = j[:, :8], j[:, 8:14]
    else:
        found, j = cv2.projectPoints(points, place[:3], place[3:], matrix, lens[4:])
        by_lens, by_pose = j[:, 6 : 6 + count], j[:, :6]
    by_point = by_pose[:, 3:].reshape(-1, 2, 3) @ cv2.Rodrigues(place[:3])[0]
    zero = np.zeros_like(x)
    by_shape = [by_point[..., 2] * h[:, None] for h in heights.T]
    for dx, dy in ((-x / 2, y / 2), (y, zero)):
        by_shape.append(size * (by_point[..., 0] * dx[:, None] + by_point[..., 1] * dy[:, None]))
    shared = np.hstack([by_lens[:, :count], np.stack([b.reshape(-1) for b in by_shape], axis=1)])
    return shared, by_pose, (to - found.reshape(-1, 2)).reshape(-1)
