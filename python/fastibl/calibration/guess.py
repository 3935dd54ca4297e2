"""The lens of a camera of which there are too few pictures to calibrate it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .._fastibl import Board, Camera, Response
from ..expected import expect
from ..guessed_rig import DEGREES, guessed_camera
from .corners import find_corners, size_of

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
    picture; that of the camera where no picture shows the board. Raises ValueError for pictures of several sizes.
    """
    expect(board, Board, "board")
    width, height = size_of(pictures)
    usual = guessed_camera((width, height), degrees).replace(response=response)
    seen = [s for s in (find_corners(p, board, usual) for p in pictures) if s.ids]
    if not seen:
        return usual, _USUAL
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    points, pixels = [s.points() for s in seen], [s.opencv_pixels() for s in seen]
    matrix = usual.opencv_matrix
    try:
        _, found, _, turns, _, deviations, *_ = cv2.calibrateCameraExtended(
            points, pixels, (width, height), matrix, np.zeros(5), flags=flags
        )
    except cv2.error:
        return usual, _USUAL
    f = float(found[0, 0])
    tilt = max(float(np.arccos(np.clip(abs(cv2.Rodrigues(turn)[0][2, 2]), 0, 1))) for turn in turns)
    shown = np.hypot(float(np.max(deviations[:2])) / f, _LENS / np.tan(max(tilt, _LEAST_TILT))) if f > 0 else np.inf
    if not np.isfinite(shown):
        return usual, _USUAL
    weights = np.array([1 / _USUAL**2, 1 / shown**2])
    f = float(np.exp(weights @ np.log([usual.fx, f]) / weights.sum()))
    return usual.replace(fx=f, fy=f), float(weights.sum() ** -0.5)
