"""Maps turned by any rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import CubeMap, texel_directions, texel_solid_angles
from .axes import turned
from .expected import expect

_PARTS = 4  # along a texel's edge


def rotate_map(cube: CubeMap, rotation: ArrayLike | float) -> CubeMap:
    """The map with its light turned: what came from direction d comes from rotation @ d.

    cube: CubeMap; for an Environment give its radiance. Its size is kept.
    rotation: (3, 3), orthonormal with determinant 1, or an angle about z (up in the marker frame) in radians,
    counter-clockwise seen from above.
    Each texel is the mean of the old map over 4 x 4 parts; then each channel is scaled so that the sum over all
    directions is the same as before, also that of a sun in one texel. Light spreads by up to a texel: a small lamp's
    irradiance is kept, its radiance is not. Turns that only exchange axes keep every value.
    Raises TypeError for another map, ValueError for what is no rotation.
    """
    expect(cube, CubeMap, "cube", "for an Environment give its radiance")
    r = _matrix(rotation)
    axes = np.rint(r)
    if np.abs(r - axes).max() < 1e-7:
        return turned(cube, axes.astype(int))
    n = cube.size
    directions = texel_directions(_PARTS * n) @ r.astype(np.float32)  # r.T @ d of each
    parts = cube.sample(directions).reshape(6, n, _PARTS, n, _PARTS, 3)
    faces = parts.mean(axis=(2, 4), dtype=np.float64)
    before, after = _light(cube.faces), _light(faces)
    result = CubeMap(faces * np.where(after > 0, before / np.maximum(after, 1e-300), 1))
    result._count_cleaned_of(cube)
    return result


def _matrix(rotation: ArrayLike | float) -> NDArray[np.float64]:
    try:
        given = np.asarray(rotation, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"rotation must be (3, 3) or an angle in radians, got {rotation!r}") from None
    if given.shape == () and np.isfinite(given):
        c, s = np.cos(given), np.sin(given)
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    if given.shape != (3, 3):
        raise ValueError(f"rotation must be (3, 3) or a finite angle in radians, got {rotation!r}")
    if not (np.abs(given @ given.T - np.eye(3)).max() < 1e-4 and np.linalg.det(given) > 0):
        raise ValueError(f"rotation must be orthonormal with determinant 1, got {given.tolist()}")
    return given


def _light(faces: NDArray) -> NDArray[np.float64]:
    """Sum over all directions, by channel."""
    return np.einsum("fyxc,yx->c", faces.astype(np.float64), texel_solid_angles(faces.shape[1]))
