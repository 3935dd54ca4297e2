"""Where methods are compared: directions, pairs of normal and view, points of the plane. The same seed gives the same
samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ANGLES = (0, 30, 60, 75, 85)  # degrees between normal and view
VIEWS = (0, 30, 60, 75)  # the same for brushed surfaces


def units(count: int, seed: int = 0) -> NDArray[np.float64]:
    """Random unit vectors (count, 3)."""
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def pairs(count: int, seed: int = 3) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normals and views (5 count, 3): `count` at each of ANGLES."""
    n = units(count * len(ANGLES), seed)
    t = np.cross(n, np.random.default_rng([seed, 1]).normal(size=n.shape))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    angle = np.radians(np.repeat(ANGLES, count))[:, None]
    return n, np.cos(angle) * n + np.sin(angle) * t


def surfaces(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Normals, tangents and views (4 count, 3): `count` at each of VIEWS, with random azimuth."""
    rng = np.random.default_rng(17)
    n = units(count * len(VIEWS), 18)
    t = np.cross(n, rng.normal(size=n.shape))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    theta, phi = np.radians(np.repeat(VIEWS, count))[:, None], rng.uniform(0, 2 * np.pi, (len(n), 1))
    return n, t, np.cos(theta) * n + np.sin(theta) * (np.cos(phi) * t + np.sin(phi) * np.cross(n, t))


def grid(count: int, extent: float) -> NDArray[np.float64]:
    """Points (count^2, 2) of the plane, row by row from the least y: the texel centres of a ShadowMap of this
    extent."""
    axis = ((np.arange(count) + 0.5) / count * 2 - 1) * extent
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
