"""The lens of a camera of which there are too few pictures to calibrate it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Board, Camera, Pose, Response
from ..expected import expect
from ..guessed_rig import DEGREES, guessed_camera
from .corners import Seen, find_corners, size_of

_USUAL = 0.12  # deviation of the logarithm of the focal length among cameras that take photographs
# What distortion and the lens's middle, which are not known, do to a focal length that a board shows at a tilt: this by
# the tilt's tangent. Distortion of 5 to 10 % and a middle that is off by 1 to 2 % of the width do up to 1.5 times that.
_LENS = 0.012
_LEAST_TILT = np.radians(3.0)


def guess_camera(
    pictures: Sequence[ArrayLike], board: Board, *, degrees: float = DEGREES, response: Response | None = None
) -> tuple[Camera, float]:
    """A camera without distortion, and the relative standard deviation of its focal length.

    A board that is seen at a tilt shows the focal length in how much smaller its far side is (Zhang 2000, for one
    picture): within some 10 % where it is seen from 6 degrees off the middle, 2 % from 35 on. That is weighed against
    what cameras usually have. With ten pictures and more, calibrate_camera() finds the distortion, too.

    pictures: (h, w, 3) uint8 or uint16 RGB, of one size and one focal length. degrees: the usual angle across a
    picture's longer side; that of the camera where no picture shows the board. Raises ValueError for pictures of
    several sizes.
    """
    expect(board, Board, "board")
    usual = guessed_camera(size_of(pictures), degrees).replace(response=response)
    return _by_corners([s for s in (find_corners(p, board, usual) for p in pictures) if s.ids], usual)


def _by_corners(seen: Sequence[Seen], usual: Camera) -> tuple[Camera, float]:
    """guess_camera, of corners that were found. usual: the camera where they tell nothing."""
    if not seen:
        return usual, _USUAL
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    points, pixels = [s.points() for s in seen], [s.opencv_pixels() for s in seen]
    try:
        _, found, _, turns, _, deviations, *_ = cv2.calibrateCameraExtended(
            points, pixels, (usual.width, usual.height), usual.opencv_matrix, np.zeros(5), flags=flags
        )
    except cv2.error:
        return usual, _USUAL
    f = float(found[0, 0])
    tilt = max(_tilt(cv2.Rodrigues(turn)[0]) for turn in turns)
    shown = np.hypot(float(np.max(deviations[:2])) / f, _LENS / np.tan(max(tilt, _LEAST_TILT))) if f > 0 else np.inf
    if not np.isfinite(shown):
        return usual, _USUAL
    weights = np.array([1 / _USUAL**2, 1 / shown**2])
    f = float(np.exp(weights @ np.log([usual.fx, f]) / weights.sum()))
    return usual.replace(fx=f, fy=f), float(weights.sum() ** -0.5)


def _tilt(rotation: NDArray[np.float64]) -> float:
    """Radians between a board's normal and the camera's axis."""
    return float(np.arccos(np.clip(abs(rotation[2, 2]), 0, 1)))


class LensSearch:
    """Finds the focal length of a camera that is in use, from views of the board at a tilt.

    usual: the camera until then. enough: relative deviation of the focal length at which the search ends.
    """

    _VIEWS = 3  # at least: a hand that moves shifts the rows of one picture
    _MOST_VIEWS = 8
    _TILT = np.radians(15)  # at least
    _APART = np.radians(8)  # between views
    _LATER = 1.0  # seconds after which the same view counts again
    _TRIES = 30  # views that are looked at: a board that is never seen from the side shows nothing more

    def __init__(self, usual: Camera, board: Board, enough: float = 0.02):
        self.usual, self._board, self._enough = usual, board, enough
        self._views: list[tuple[float, NDArray[np.float64], Seen]] = []  # tilt; the camera's direction from the board
        self._last, self._tried = -np.inf, 0

    def add(self, picture: ArrayLike, camera_from_marker: Pose, time: float) -> tuple[Camera, float] | None:
        """The camera and its deviation once views tell it well enough. camera_from_marker: by the usual camera.

        A picture that shows no more than those before is left out, which takes next to no time; others take some 20 ms.
        """
        tilt = _tilt(camera_from_marker.rotation)
        place = camera_from_marker.inverse().translation
        direction = place / np.linalg.norm(place)
        known = any(float(direction @ other) > np.cos(self._APART) for _, other, _ in self._views)
        full = len(self._views) == self._MOST_VIEWS
        least = min((t for t, *_ in self._views), default=0.0) if full else self._TILT
        if tilt < least or (known and 0 <= time - self._last < self._LATER) or self._tried == self._TRIES:
            return None
        self._last, self._tried = time, self._tried + 1
        seen = find_corners(picture, self._board, self.usual)
        if not seen.ids:
            return None
        if full:
            self._views.remove(min(self._views, key=lambda view: view[0]))
        self._views.append((tilt, direction, seen))
        best = self.best()
        return best if best is not None and best[1] <= self._enough else None

    def best(self) -> tuple[Camera, float] | None:
        """The camera and its deviation by the views so far; None where they are too few."""
        if len(self._views) < self._VIEWS:
            return None
        return _by_corners([view[2] for view in self._views], self.usual)
