"""Triangles cut where they cross a texture's border, so that each shows a single copy of the texture.

The cut triangles look as the whole ones do, since what vertices carry is interpolated linearly. Neighbours stay
joined: an edge that two triangles share is cut at the same places.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from .polygons import fans, kept_corners

_NEAR = 1e-3  # of a texture: what reaches beyond its border by less shows the margin of its cell
_MARGIN = 1 / 32  # of a texture: what lies beyond a clamped border is drawn together, but keeps its tangents
_MOST_COPIES = 2**18  # on all triangles together: each becomes two or more of them


def single_copies(
    uvs: NDArray, values: NDArray, triangles: NDArray, wraps: tuple[str, str]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Triangles whose uvs lie within 0 to 1, or up to 1/32 beyond in the texture's margin, and show the same texels.

    uvs: (n, 2). values: (n, k) what vertices carry besides. triangles: (m, 3). wraps: along u and v, "clamp" where the
    texture ends at 0 and 1; any other has a border at every integer. Returns uvs, values and triangles.
    Raises ValueError where that takes too many triangles.
    """
    vertices = np.hstack([uvs, values]).astype(np.float64)
    if len(triangles):
        _check(vertices[triangles, :2], wraps)
        polygons = np.asarray(triangles, np.int64)
        for axis, wrap in enumerate(wraps):
            if wrap == "clamp":
                for border in (0.0, 1.0):
                    vertices, polygons = _cut(vertices, polygons, axis, np.full(len(polygons), border))
            else:
                vertices, polygons = _cut_at_integers(vertices, polygons, axis)
        vertices, polygons = _folded(vertices, polygons, wraps)
        triangles = fans(polygons)
    return vertices[:, :2], vertices[:, 2:], triangles


def _check(corners: NDArray, wraps: tuple[str, str]) -> None:
    """Raises ValueError for too many copies of a texture on triangles with these uvs (m, 3, 2), or uvs that are not
    finite."""
    if not np.isfinite(corners).all():
        raise ValueError("its uvs are not all finite")
    spans = [np.ptp(corners[..., k], axis=1) if wrap != "clamp" else np.zeros(1) for k, wrap in enumerate(wraps)]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2 if "clamp" not in wraps else np.zeros(1)
    copies = max(float(np.floor(n).sum()) for n in (*spans, areas))  # what lies on one copy is not cut
    if copies > _MOST_COPIES:
        raise ValueError(
            f"a texture repeats {copies:.0f} times where triangles are cut at its borders; it may {_MOST_COPIES} times"
        )


def _cut_at_integers(vertices: NDArray, polygons: NDArray, axis: int) -> tuple[NDArray, NDArray]:
    """Cuts at multiples of a power of two, then at those of half of it: polygons then cross one of them at most."""
    u = vertices[polygons, axis]
    first = np.floor(u.min() + _NEAR)
    step = 2.0 ** np.ceil(np.log2(max(u.max() - first, 1)))
    while step >= 1:
        u = vertices[polygons, axis]
        middle = (u.min(axis=1) + u.max(axis=1)) / 2 - first
        vertices, polygons = _cut(vertices, polygons, axis, first + (2 * np.floor(middle / (2 * step)) + 1) * step)
        step /= 2
    return vertices, polygons


def _cut(vertices: NDArray, polygons: NDArray, axis: int, borders: NDArray) -> tuple[NDArray, NDArray]:
    """Cuts polygons that cross their border (m,), the same for neighbours; new vertices and polygons follow the
    others."""
    away = vertices[polygons, axis] - borders[:, None]
    sides = np.where(np.abs(away) <= _NEAR, 0, np.sign(away)).astype(int)
    crossing = (sides.min(axis=1) < 0) & (sides.max(axis=1) > 0)
    if not crossing.any():
        return vertices, polygons
    cut, sides = polygons[crossing], sides[crossing]
    ends = np.stack([cut, np.roll(cut, -1, axis=1)], axis=-1)
    crossed = sides * np.roll(sides, -1, axis=1) < 0
    edges = np.sort(ends[crossed], axis=1)
    one, which = _different(edges.T)
    border = np.broadcast_to(borders[crossing, None], cut.shape)[crossed][one]
    low, high = vertices[edges[one, 0]], vertices[edges[one, 1]]
    way = (border - low[:, axis]) / (high[:, axis] - low[:, axis])
    added = low + way[:, None] * (high - low)
    added[:, axis] = border
    # Each corner is followed by the point where the edge that it begins is cut.
    around = np.stack([cut, np.zeros_like(cut)], axis=-1)
    around[crossed, 1] = len(vertices) + which
    halves = [_rows(around, np.stack([side * sides >= 0, crossed], axis=-1)) for side in (1, -1)]
    width = max(polygons.shape[1], *(half.shape[1] for half in halves))
    padded = [np.pad(rows, ((0, 0), (0, width - rows.shape[1])), "edge") for rows in (polygons[~crossing], *halves)]
    return np.concatenate([vertices, added]), np.concatenate(padded)


def _rows(around: NDArray, kept: NDArray) -> NDArray:
    """Polygons of the vertices (m, k, 2) that are kept."""
    return np.take_along_axis(around.reshape(len(around), -1), kept_corners(kept.reshape(len(kept), -1)), axis=1)


def _folded(vertices: NDArray, polygons: NDArray, wraps: tuple[str, str]) -> tuple[NDArray, NDArray]:
    """Moves the uvs of each polygon to the texture's first copy; a vertex between two copies becomes two."""
    corners = vertices[polygons, :2]
    copies = np.floor((corners.min(axis=1) + corners.max(axis=1)) / 2).astype(np.int64)
    copies[:, [wrap == "clamp" for wrap in wraps]] = 0
    if (copies == copies[0]).all():
        vertices = vertices.copy()
        vertices[:, :2] -= copies[0]
    else:
        at, moved = polygons.reshape(-1), copies.repeat(polygons.shape[1], axis=0)
        one, which = _different([at, *moved.T])
        vertices, polygons = vertices[at[one]], which.reshape(polygons.shape)
        vertices[:, :2] -= moved[one]
    for axis, wrap in enumerate(wraps):
        if wrap == "clamp":
            u = vertices[:, axis]
            inside = np.clip(u, 0, 1)
            vertices[:, axis] = inside + (u - inside) * (_MARGIN / max(np.abs(u - inside).max(), _MARGIN))
    return vertices, polygons


def _different(keys: Iterable[NDArray]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of rows of integers, given as columns: where each different row is first, and which of these each row is."""
    joined: NDArray[np.int64] = np.zeros(1, np.int64)
    for key in keys:
        values, ranks = np.unique(key, return_inverse=True)  # few numbers, however far apart
        joined = joined * len(values) + ranks
    _, one, which = np.unique(joined, return_index=True, return_inverse=True)
    return one, which
