"""Rotation matrices and their vectors, many at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def rotations_from(w: NDArray) -> NDArray[np.float64]:
    """Rotations (..., 3, 3) from rotation vectors (..., 3), by Rodrigues' formula."""
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    zero = np.zeros(w.shape[:-1])
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*w.shape[:-1], 3, 3)
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross @ cross


def rotation_vectors(r: NDArray) -> NDArray[np.float64]:
    """Rotation vectors (..., 3) of rotations (..., 3, 3), at most half a turn; half a turn may be about either
    direction."""
    axis = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], -1)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, np.trace(r, axis1=-2, axis2=-1)[..., None] - 1)
    vectors = axis * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-300), 0.5)
    half = angle[..., 0] > np.pi - 1e-6  # the sine does not tell the axis, but R + 1 is twice its square
    if np.any(half):
        square = r[half] + np.eye(3)
        largest = np.argmax(np.diagonal(square, axis1=-2, axis2=-1), axis=-1)
        along = np.take_along_axis(square, largest[:, None, None], axis=-2)[:, 0]
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        along *= np.where((along * axis[half]).sum(axis=-1, keepdims=True) < 0, -1, 1)
        vectors[half] = angle[half] * along
    return vectors


def accumulated(w: NDArray) -> NDArray[np.float64]:
    """Rotations (n + 1, 3, 3) from the identity on: each is the one before, turned by the next of (n, 3) vectors."""
    rotations = [np.eye(3)]
    for step in rotations_from(w):
        rotations.append(step @ rotations[-1])
    return np.array(rotations)


class RotationPath:
    """Rotations (n, 3, 3) at increasing times (n,), interpolated in between: turning evenly from each to the next."""

    def __init__(self, times: NDArray, rotations: NDArray):
        self.times, self._rotations = times, rotations
        self._turns = rotation_vectors(rotations[1:] @ rotations[:-1].transpose(0, 2, 1))

    def __call__(self, at: NDArray) -> NDArray[np.float64]:
        """Rotations (m, 3, 3) at times (m,) from the first to the last time."""
        k = np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.times) - 2)
        share = (at - self.times[k]) / (self.times[k + 1] - self.times[k])
        return rotations_from(share[:, None] * self._turns[k]) @ self._rotations[k]
