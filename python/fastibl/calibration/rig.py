"""How the front camera sits relative to the back camera, where the two share no view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._fastibl import Pose
from ..expected import expect
from ..rotations import rotation_vectors

_LEAST_MOMENTS = 4
_LEAST_TURN = np.radians(5)  # RMS about a second axis, at least
_ROUNDS = 20
_HUBER = 2.0
_ROBUST = 8  # moments, at least, for outliers to be told from the rest: fewer can be met exactly but for a few
_MOST_DEGREES, _MOST_METRES = 0.5, 0.005  # largest deviations that are accepted


@dataclass(frozen=True)
class RigCalibration:
    """The pose front_from_back, and how well it is known.

    degrees, metres: standard deviations of its rotation and of its translation (the largest of three axes).
    front_board_from_back_board: how the two boards lie relative to each other. residual_degrees, residual_metres: RMS
    of the disagreement between the moments.
    """

    front_from_back: Pose
    degrees: float
    metres: float
    front_board_from_back_board: Pose
    residual_degrees: float
    residual_metres: float

    def __str__(self) -> str:
        at = ", ".join(f"{1000 * x:.1f}" for x in self.front_from_back.translation)
        return (
            f"front_from_back: shift ({at}) mm +- {1000 * self.metres:.2f} mm, turn +- {self.degrees:.3f} degrees; "
            f"moments disagree by {self.residual_degrees:.3f} degrees and {1000 * self.residual_metres:.2f} mm"
        )


def calibrate_rig(back: Sequence[Pose | None], front: Sequence[Pose | None]) -> RigCalibration:
    """The rig from moments when the back camera saw one board and the front camera another, both boards at rest.

    back: back_from_marker of its board, front: front_from_marker of the other, moment by moment; None where a board was
    not seen. Solves front_from_front_board · Y = X · back_from_back_board for both unknowns (robot-world / hand-eye
    calibration: Shah 2013, then refined on all moments). Raises ValueError for fewer than four common
    moments, turns about one axis only, or a result known worse than within 0.5 degrees and 5 mm.
    """
    if len(back) != len(front):
        raise ValueError(f"expected poses of the same moments, got {len(back)} and {len(front)}")
    for name, poses in (("back", back), ("front", front)):
        for number, pose in enumerate(poses):
            expect(pose, (Pose, type(None)), f"{name}[{number}]")
    pairs = [(a.matrix, b.matrix) for a, b in zip(back, front, strict=True) if a is not None and b is not None]
    if len(pairs) < _LEAST_MOMENTS:
        raise ValueError(f"both boards were seen at {len(pairs)} moments; expected at least {_LEAST_MOMENTS}")
    a, b = (np.array(side) for side in zip(*pairs, strict=True))
    turns = rotation_vectors(_rotation(a[:, :3, :3].sum(axis=0)).T @ a[:, :3, :3])
    second = float(np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False)[1] / np.sqrt(len(turns)))
    if second < _LEAST_TURN:
        raise ValueError(
            "the rig was turned about one axis only: turn it by 30 degrees or more about two axes, both boards in view"
        )
    x, y = _start(a, b)
    x, y, covariance, residual = _refine(a, b, x, y)
    degrees = float(np.degrees(np.sqrt(np.diag(covariance)[:3].max())))
    metres = float(np.sqrt(np.diag(covariance)[3:6].max()))
    if not (degrees <= _MOST_DEGREES and metres <= _MOST_METRES):
        raise ValueError(
            f"front_from_back is known within {degrees:.2f} degrees and {1000 * metres:.1f} mm only: more moments, "
            "turned more, both boards large in the pictures"
        )
    rms = np.sqrt((residual**2).mean(axis=0))
    return RigCalibration(
        Pose(x), degrees, metres, Pose(y), float(np.degrees(np.linalg.norm(rms[:3]))), float(np.linalg.norm(rms[3:]))
    )


def _start(a: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
    """Turns by Shah 2013 (the largest singular value of a sum of Kronecker products), then shifts, in closed form."""
    turn_a, turn_b = a[:, :3, :3], b[:, :3, :3]
    u, _, vt = np.linalg.svd(sum(np.kron(p, q) for p, q in zip(turn_a, turn_b, strict=True)))
    turn_x, turn_y = (_rotation(v.reshape(3, 3).T) for v in (u[:, 0], vt[0]))
    if np.abs(turn_b[0] @ turn_y - turn_x @ turn_a[0]).max() > 1:  # singular vectors come with either sign
        turn_y = _rotation(-vt[0].reshape(3, 3).T)
    left = np.concatenate([np.hstack([r, -np.eye(3)]) for r in turn_b])
    shifts = np.linalg.lstsq(left, np.concatenate(a[:, :3, 3] @ turn_x.T - b[:, :3, 3]), rcond=None)[0]
    x, y = np.eye(4), np.eye(4)
    x[:3, :3], x[:3, 3], y[:3, :3], y[:3, 3] = turn_x, shifts[3:], turn_y, shifts[:3]
    return x, y


def _rotation(matrix: NDArray) -> NDArray[np.float64]:
    """The rotation nearest to a multiple of the matrix, which may be negative."""
    u, _, vt = np.linalg.svd(matrix * np.sign(np.linalg.det(matrix)))
    return u @ vt


def _refine(a: NDArray, b: NDArray, x: NDArray, y: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """X, Y, the covariance of X's turn and shift, and the residuals (n, 6) of turn and shift."""
    for _ in range(_ROUNDS):
        residual, jacobian = _residuals(a, b, x, y), np.empty((len(a), 6, 12))
        for k in range(12):
            step = 1e-6
            moved = np.zeros(12)
            moved[k] = step
            jacobian[..., k] = (_residuals(a, b, _moved(x, moved[:6]), _moved(y, moved[6:])) - residual) / step
        parts = np.abs(residual).reshape(-1, 2, 3)  # turns, shifts
        if len(a) < _ROBUST:
            scale, most = np.sqrt((parts**2).mean(axis=(0, 2))), np.inf
        else:
            scale, most = 1.4826 * np.median(parts, axis=(0, 2)), _HUBER
        scale = (scale + 1e-9).repeat(3)
        weight = np.minimum(1, most / np.maximum(np.abs(residual / scale), 1e-12)) / scale**2
        normal = np.einsum("nik,ni,nil->kl", jacobian, weight, jacobian)
        gradient = np.einsum("nik,ni,ni->k", jacobian, weight, residual)
        delta = -np.linalg.lstsq(normal, gradient, rcond=None)[0]
        x, y = _moved(x, delta[:6]), _moved(y, delta[6:])
        if np.abs(delta).max() < 1e-10:
            break
    # The scale is found from the same residuals: the variance of Student's t. Turns and shifts each have half.
    free = residual.size // 2 - 6
    covariance = np.linalg.pinv(normal)[:6, :6] * (residual.size // 2 / free) * (free / (free - 2))
    return x, y, covariance, residual


def _residuals(a: NDArray, b: NDArray, x: NDArray, y: NDArray) -> NDArray[np.float64]:
    left, right = b @ y, x @ a
    turn = rotation_vectors(left[:, :3, :3] @ right[:, :3, :3].transpose(0, 2, 1))
    return np.concatenate([turn, left[:, :3, 3] - right[:, :3, 3]], axis=1)


def _moved(pose: NDArray, delta: NDArray) -> NDArray[np.float64]:
    step = Pose.from_rotation_vector(delta[:3], delta[3:]).matrix
    out = np.array(pose)
    out[:3, :3] = step[:3, :3] @ pose[:3, :3]
    out[:3, 3] = pose[:3, 3] + delta[3:]
    return out
