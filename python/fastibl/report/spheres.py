"""Pictures of lit spheres: truth, a method, and ten times the difference."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from .section import Strip

VIEW = np.array([0.0, -0.94, 0.342])  # towards the eye, which is in front and a little above
_SHOWN = 240  # pixels of a picture's edge on the page


def surface(size: int) -> NDArray:
    """Unit normals (size^2, 3) of the sphere's pixels, row by row; pixels beside the sphere have the normal at the
    nearest point of its edge."""
    view = VIEW / np.linalg.norm(VIEW)
    right, up = np.array([1.0, 0, 0]), np.cross(np.array([1.0, 0, 0]), -view)
    axis = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = (c.reshape(-1, 1) for c in np.meshgrid(axis, -axis))
    inward = np.minimum(1, 0.985 / np.maximum(np.hypot(x, y), 1e-9))
    x, y = x * inward, y * inward
    return x * right + y * up + np.sqrt(1 - x**2 - y**2) * view


def encoded(linear: NDArray, scale: float) -> NDArray[np.uint8]:
    """Linear radiance as it is shown, nearly with sRGB's gamma."""
    return (np.clip(np.asarray(linear, np.float64) * scale, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)


def tenfold(difference: NDArray, scale: float, times: float = 10.0) -> NDArray[np.uint8]:
    """`times` a difference of linear radiance: grey means none, and brighter means too bright."""
    return (np.clip(0.5 + times / 2 * np.asarray(difference, np.float64) * scale, 0, 1) * 255).astype(np.uint8)


def _laid(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pixels (n^2, 3) as a round picture on white."""
    size = round(len(values) ** 0.5)
    picture = enlarged(values.reshape(size, size, 3)).astype(np.float64)
    axis = (np.arange(_SHOWN) + 0.5) / _SHOWN * 2 - 1
    inside = np.clip((0.985 - np.hypot(axis, axis[:, None])) * _SHOWN / 2, 0, 1)[..., None]
    return (inside * picture + (1 - inside) * 255).astype(np.uint8)


def enlarged(picture: NDArray[np.uint8], size: int = _SHOWN) -> NDArray[np.uint8]:
    return cv2.resize(picture, (size, size), interpolation=cv2.INTER_CUBIC)


def strip(
    title: str,
    size: int,
    truth: Callable[[NDArray, NDArray], NDArray],
    methods: dict[str, Callable[[NDArray, NDArray], NDArray]],
) -> Strip:
    """truth and methods: functions of normals and views (n, 3)."""
    normals = surface(size)
    views = np.broadcast_to(VIEW / np.linalg.norm(VIEW), normals.shape)
    true = np.asarray(truth(normals, views), np.float64)
    scale = 0.9 / max(float(np.percentile(true, 97)), 1e-12)
    pictures = [("truth", _laid(encoded(true, scale)))]
    for name, method in methods.items():
        estimate = np.asarray(method(normals, views), np.float64)
        pictures.append((name, _laid(encoded(estimate, scale))))
        pictures.append((f"{name}: difference × 10", _laid(tenfold(estimate - true, scale))))
    return Strip(title, pictures, "Differences: grey is none, brighter is too bright, darker too dark.")
