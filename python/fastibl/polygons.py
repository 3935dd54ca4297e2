"""Convex polygons side by side: rows of corners, whose last is repeated where a polygon has fewer than others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fans(polygons: NDArray) -> NDArray[np.int64]:
    """Triangles (n, 3) of polygons (m, k) that name vertices; without those that name one twice."""
    k = np.arange(1, polygons.shape[1] - 1)
    out = np.stack([polygons[:, :1] + 0 * k, polygons[:, k], polygons[:, k + 1]], axis=-1).reshape(-1, 3)
    return out[(out != np.roll(out, 1, axis=1)).all(axis=1)]


def kept_corners(kept: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Where in rows (m, k) the corners lie that are kept, in their order: rows of as many as the longest has."""
    counts = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : max(counts.max(initial=0), 1)]
    last = np.take_along_axis(order, np.maximum(counts - 1, 0)[:, None], axis=1)
    return np.where(np.arange(order.shape[1]) < counts[:, None], order, last)
