"""Triangles cut along the outline of what a texture shows: where its alpha is below a cutoff, there is no surface.

Cut once, a leaf on a square is a leaf for pictures, rays, shadows and spheres alike. The outline is where the bilinear
alpha equals the cutoff, as a graphics card draws it, within a quarter of a texel. Pictures larger than 1024 texels, and
those with more edges than an outline can have, are shrunk first, and keep how much of them is seen. An object that
would get too many triangles has coarser outlines.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .polygons import fans, kept_corners

_LONGEST = 1024  # most texels of the alpha along an edge
_MOST_EDGES = 2**17  # between texels that are seen and texels that are not
_BEYOND = {"clamp": 1 / 16}  # how far uvs reach beyond the picture, by its wrap; see fastibl.uv_borders
_NEAR = 2e-3
# By how many texels outlines may be off, and how many squares along an edge of the picture they are then cut into: in
# one piece, slivers across a leaf would be shaded in streaks, and take rays twice as long.
_SQUARES = {0.05: 8, 0.25: 8, 0.5: 8, 1.0: 4, 2.0: 2, 4.0: 1}
_MOST_OFF = 0.05  # of the area that is seen
_ENOUGH = 2**16  # pieces of all triangles of an object: with more, outlines are coarser where they can be
_MOST_PIECES = 2**18
_FLAT = 1e-12  # twice the area in uv of triangles that have none
_AT_ONCE = 2**19  # pairs of triangles


class TooManyPieces(ValueError):
    """What outlines leave of an object has too many triangles."""


class Outline:
    """Where a picture's alpha is at least a cutoff: triangles that cover it, and what lies just beyond its borders."""

    def __init__(self, alpha: NDArray, cutoff: float, wraps: tuple[str, str]):
        """alpha: (h, w), rows from the top. wraps: how it goes on, along u and v."""
        self._alpha, self._cutoff = _shrunk(np.asarray(alpha, np.float32), cutoff)
        self._wraps = wraps
        self._made: dict[float, tuple[NDArray[np.float64], float]] = {}

    def within(self, tolerance: float) -> NDArray[np.float64]:
        """Triangles (n, 3, 2) in uv (v upwards), counter-clockwise; less than `tolerance` off where they would cover
        more or less than is seen, as of thin strands. tolerance: a key of `_SQUARES`."""
        for own in sorted((t for t in _SQUARES if t <= tolerance), reverse=True):
            if own not in self._made:
                self._made[own] = _triangles(self._alpha, self._cutoff, self._wraps, own)
            triangles, area = self._made[own]
            if abs(_twice_areas(triangles).sum() / 2 - area) <= _MOST_OFF * area:
                break
        return triangles

    def shows(self, uvs: NDArray) -> NDArray[np.bool_]:
        """Whether there is a surface at places (n, 2) within the picture."""
        h, w = self._alpha.shape
        x, y = np.clip(uvs[:, 0] * w, 0, w - 1).astype(int), np.clip((1 - uvs[:, 1]) * h, 0, h - 1).astype(int)
        return np.asarray(self._alpha[y, x] >= self._cutoff)


class Cut(NamedTuple):
    """Triangles that are to be cut. uvs: (n, 2), v upwards, within the picture or just beyond, as of
    fastibl.uv_borders.single_copies. values: (n, k) what vertices carry besides. triangles: (m, 3)."""

    uvs: NDArray
    values: NDArray
    triangles: NDArray
    outline: Outline

    @property
    def corners(self) -> NDArray[np.float64]:
        """Their uvs (m, 3, 2)."""
        return np.asarray(self.uvs, np.float64)[self.triangles]


def cut_out(cuts: list[Cut]) -> tuple[list[tuple[NDArray, NDArray, NDArray]], float]:
    """The parts of an object's triangles that lie within their outlines: uvs, values and triangles of each.

    Also returns by how many texels outlines may be off. Raises TooManyPieces.
    """
    tried: list[NDArray] = []
    found: tuple[list[tuple[NDArray, NDArray]], float] | None = None
    for tolerance in list(_SQUARES)[1:]:
        outlines = [cut.outline.within(tolerance) for cut in cuts]
        if tried and all(a is b for a, b in zip(tried, outlines, strict=True)):
            continue
        tried, pairs = outlines, _all_pairs(cuts, outlines)
        if pairs is not None:
            found = list(zip(outlines, pairs, strict=True)), tolerance
            if sum(map(len, pairs)) <= _ENOUGH:
                break
    if found is None:
        raise TooManyPieces(f"its outlines have more than {_MOST_PIECES} triangles")
    shown, tolerance = found
    return [_applied(cut, *own) for cut, own in zip(cuts, shown, strict=True)], tolerance


def _all_pairs(cuts: list[Cut], outlines: list[NDArray]) -> list[NDArray] | None:
    """For each cut its triangles' pairs with those of the outline; None for too many."""
    out, left = [], _MOST_PIECES
    for cut, shown in zip(cuts, outlines, strict=True):
        pairs = _meeting(cut.corners, shown, left)
        if pairs is None:
            return None
        out.append(pairs)
        left -= len(pairs)
    return out


def _applied(cut: Cut, shown: NDArray, pairs: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    corners = cut.corners
    which, weights = _pieces(corners, shown, pairs)
    # What shows one place or a line of the picture is there or not.
    flat = np.flatnonzero(np.abs(_twice_areas(corners)) <= _FLAT)
    flat = flat[cut.outline.shows(corners[flat].mean(axis=1))]
    whole = np.eye(3)[np.minimum(np.arange(weights.shape[1]), 2)]
    which = np.concatenate([which, flat])
    weights = np.concatenate([weights, np.broadcast_to(whole, (len(flat), *whole.shape))])
    vertices = np.hstack([cut.uvs, cut.values]).astype(np.float64)
    made = np.einsum("pkc,pci->pki", weights, vertices[cut.triangles[which]])
    rows = made.reshape(made.shape[0] * made.shape[1], made.shape[2])
    one, names = _same(rows, vertices)
    return rows[one, :2], rows[one, 2:], fans(names.reshape(made.shape[:2]))


def grown(picture: NDArray, seen: NDArray) -> NDArray:
    """A picture (h, w, c) whose texels that are not seen (h, w) continue those that are, so that coarse levels and
    outlines show no colour of what is not there: mean colours of ever larger squares (push and pull)."""
    import cv2

    if seen.all() or not seen.any():
        return picture
    levels = [(np.asarray(picture, np.float32) * seen[..., None], seen.astype(np.float32))]
    while max(levels[-1][1].shape) > 1:
        colors, weights = levels[-1]
        size = tuple(max((n + 1) // 2, 1) for n in weights.shape[::-1])
        smaller = [cv2.resize(a, size, interpolation=cv2.INTER_AREA) for a in (colors, weights)]
        levels.append((smaller[0].reshape(*size[::-1], -1), smaller[1].reshape(size[::-1])))
    below: NDArray = levels[-1][0] / np.maximum(levels[-1][1], 1e-9)[..., None]
    for colors, weights in levels[-2::-1]:
        wide = cv2.resize(below, weights.shape[::-1], interpolation=cv2.INTER_LINEAR).reshape(colors.shape)
        below = np.where(weights[..., None] > 0, colors / np.maximum(weights, 1e-9)[..., None], wide)
    below = np.where(seen[..., None], picture, below)
    return below if picture.dtype.kind == "f" else np.rint(below).astype(picture.dtype)


def _triangles(
    alpha: NDArray, cutoff: float, wraps: tuple[str, str], tolerance: float
) -> tuple[NDArray[np.float64], float]:
    """Triangles of an outline, and the area of what they stand for."""
    import contourpy
    import mapbox_earcut

    values = np.asarray(alpha, np.float64)[::-1]  # v upwards
    x, values = _extended(values, 1, wraps[0])
    y, values = _extended(values, 0, wraps[1])
    size = np.array([alpha.shape[1], alpha.shape[0]])
    steps = [max(-(-len(places) // _SQUARES[tolerance]), 1) for places in (x, y)]
    borders = [np.append(places[::step], places[-1]) for places, step in zip((x, y), steps, strict=True)]
    # Between the codes of 16 bits, so that what equals the cutoff is seen.
    lines = contourpy.contour_generator(
        x, y, values, fill_type="ChunkCombinedOffsetOffset", chunk_size=(steps[1], steps[0])
    )
    triangles, area = [np.zeros((0, 3, 2))], 0.0
    for points, ends, firsts in zip(*lines.filled(cutoff - 1e-6, 1e9), strict=True):
        if points is None:
            continue
        rings = [points[a : b - 1] for a, b in pairwise(ends)]  # the last corner is the first
        area += sum(_area(ring) for ring in rings)
        rings = [_simplified(ring, size, tolerance, borders) for ring in rings]
        for first, end in pairwise(firsts):
            polygon = [ring for ring in rings[first:end] if len(ring) > 2]
            if len(rings[first]) > 2:
                corners = np.concatenate(polygon)
                ring_ends = np.cumsum([len(ring) for ring in polygon]).astype(np.uint32)
                triangles.append(corners[mapbox_earcut.triangulate_float64(corners, ring_ends).reshape(-1, 3)])
    out = np.concatenate(triangles)
    areas = _twice_areas(out)
    out[areas < 0] = out[areas < 0, ::-1]
    return out[np.abs(areas) > _FLAT], area


def _area(ring: NDArray) -> float:
    """Of a closed line (n, 2), negative around a hole."""
    x, y = ring.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def _shrunk(alpha: NDArray[np.float32], cutoff: float) -> tuple[NDArray[np.float32], float]:
    """An alpha (h, w) of no more texels and edges than outlines are made of, and the cutoff at which as much of it is
    seen: thin strands would be lost at the same."""
    import cv2

    seen = float((alpha >= cutoff).mean())
    scale = min(_LONGEST / max(alpha.shape), 1.0)
    small, own = alpha, cutoff
    while True:
        if scale < 1:
            size = max(round(alpha.shape[1] * scale), 1), max(round(alpha.shape[0] * scale), 1)
            small = cv2.resize(alpha, size, interpolation=cv2.INTER_AREA).reshape(size[::-1])
            fine = cv2.resize(small, (4 * size[0], 4 * size[1]), interpolation=cv2.INTER_LINEAR)
            own = max(float(np.quantile(fine, 1 - seen)), 1e-3) if 0 < seen < 1 else cutoff
        inside = small >= own
        edges = (inside[1:] != inside[:-1]).sum() + (inside[:, 1:] != inside[:, :-1]).sum()
        if edges <= _MOST_EDGES or max(small.shape) < 64:
            return small, own
        scale *= 0.5


def _extended(values: NDArray, axis: int, wrap: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places along an axis: of texels' middles, of the borders, and just beyond them; and the values there."""
    n = values.shape[axis]
    first, last = values.take([0], axis), values.take([-1], axis)
    if wrap == "repeat":
        first = last = (first + last) / 2
    beyond = _BEYOND.get(wrap, _NEAR)
    places = np.concatenate([[-beyond, 0], (np.arange(n) + 0.5) / n, [1, 1 + beyond]])
    return places, np.concatenate([first, first, values, last, last], axis)


def _simplified(ring: NDArray, size: NDArray, tolerance: float, borders: list[NDArray]) -> NDArray[np.float64]:
    """A closed line (n, 2) with fewer corners, within `tolerance` texels (Douglas and Peucker 1973). It stays where it
    meets borders (places along x and y), beyond which others continue it."""
    import cv2

    def fewer(line: NDArray, closed: bool) -> NDArray:
        kept = cv2.approxPolyDP((line * size).astype(np.float32)[:, None], tolerance, closed)[:, 0]
        return kept / size

    met, passing = np.zeros((2, len(ring)), bool)
    ring = ring.copy()
    for axis, lines in enumerate(borders):
        places = ring[:, axis]
        line = lines[np.abs(places[:, None] - lines).argmin(axis=1)]
        on = np.abs(places - line) < 1e-9  # of interpolated ones the last bits differ
        places[on] = line[on]
        met |= on
        passing |= on & (places == np.roll(places, 1)) & (places == np.roll(places, -1))
    fixed = np.flatnonzero(met & ~passing)
    if len(fixed) < 2:
        return fewer(ring, True)
    ring = np.roll(ring, -fixed[0], axis=0)
    around, ends = np.concatenate([ring, ring[:1]]), [*(fixed - fixed[0]), len(ring)]
    return np.concatenate([np.r_[around[[a]], fewer(around[a : b + 1], False)[1:-1]] for a, b in pairwise(ends)])


def _twice_areas(corners: NDArray) -> NDArray[np.float64]:
    """Of triangles (n, 3, 2), positive if counter-clockwise."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _meeting(corners: NDArray, shown: NDArray, most: int) -> NDArray[np.int64] | None:
    """Pairs (p, 2) of triangles of both sets (m, 3, 2), (n, 3, 2) that overlap; None for more than `most`."""
    found: list[NDArray[Any]] = [np.zeros((0, 2), np.int64)]
    count = 0
    if len(shown) == 0:
        return found[0]
    step = max(_AT_ONCE // max(len(shown), 1), 1)
    low, high = shown.min(axis=1), shown.max(axis=1)
    for start in range(0, len(corners), step):
        own = corners[start : start + step]
        near = (own.min(axis=1)[:, None] < high).all(axis=2) & (own.max(axis=1)[:, None] > low).all(axis=2)
        pairs = np.argwhere(near) + [start, 0]
        pairs = pairs[np.abs(_twice_areas(corners[pairs[:, 0]])) > _FLAT]
        a, b = corners[pairs[:, 0]], shown[pairs[:, 1]]
        pairs = pairs[~(_apart(a, b) | _apart(b, a))]
        found.append(pairs)
        count += len(pairs)
        if count > most:
            return None
    return np.concatenate(found)


def _apart(a: NDArray, b: NDArray) -> NDArray[np.bool_]:
    """Whether triangles (p, 3, 2) lie beyond an edge of others."""
    turn = np.sign(_twice_areas(a))[:, None, None]
    beyond: NDArray[np.bool_] = np.all(_beyond(a, b) * turn <= _FLAT, axis=2)
    return np.asarray(beyond.any(axis=1))


def _beyond(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """(p, 3, k): twice the areas that the edges of triangles (p, 3, 2) span with points (p, k, 2)."""
    along = np.roll(a, -1, axis=1) - a
    to = b[:, None] - a[:, :, None]
    return along[:, :, None, 0] * to[..., 1] - along[:, :, None, 1] * to[..., 0]


def _pieces(corners: NDArray, shown: NDArray, pairs: NDArray) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """What each pair has in common: the triangle that it is part of, and the polygon's corners (p, 6, 3), as weights of
    the triangle's (Sutherland and Hodgman 1974)."""
    whole, by = corners[pairs[:, 0]], shown[pairs[:, 1]]
    weights = np.broadcast_to(np.eye(3), (len(pairs), 3, 3))
    for edge in range(3):
        sides = _beyond(by, np.einsum("pkc,pci->pki", weights, whole))[:, edge]
        sides = np.where(np.abs(sides) < 1e-14, 0, sides)
        following = np.roll(sides, -1, axis=1)
        crossed = sides * following < 0
        way = np.where(crossed, sides / np.where(crossed, sides - following, 1), 0)[..., None]
        cut = weights + way * (np.roll(weights, -1, axis=1) - weights)
        around = np.stack([weights, cut], axis=2).reshape(len(pairs), 2 * weights.shape[1], 3)
        kept = np.stack([sides >= 0, crossed], axis=2).reshape(around.shape[:2])
        weights = np.take_along_axis(around, kept_corners(kept)[..., None], axis=1)
        keep = kept.sum(axis=1) > 2
        weights, whole, by, pairs = weights[keep], whole[keep], by[keep], pairs[keep]
    return pairs[:, 0], weights if len(weights) else np.zeros((0, 3, 3))


def _same(made: NDArray, given: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of vertices (n, k) that differ by rounding alone: where each is first, and which of these each one is."""
    scale = 1e-9 + 1e-7 * np.abs(given).max(axis=0, initial=0)
    _, one, names = np.unique(np.rint(made / scale), axis=0, return_index=True, return_inverse=True)
    return one, names.reshape(-1)
