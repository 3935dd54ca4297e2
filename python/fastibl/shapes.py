"""Generated objects for demonstrations and tests."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Mesh
from .files import stand

Field = Callable[[NDArray], NDArray]  # (n, 3) points -> (n,): negative inside


def surface_net(field: Field, lower: NDArray, upper: NDArray, cell: float) -> Mesh:
    """Closed surface where field = 0, with one vertex for each cell of a grid that it crosses.

    Gibson 1998, Constrained Elastic Surface Nets; the vertices are then moved onto the surface itself. The
    surface must lie within lower and upper (3,), and be thicker than a cell. Where it crosses a cell twice, two sheets
    would be joined in an edge; the grid is then shifted a little and tried again. Triangles are counter-clockwise from
    outside. Raises ValueError where no shift helps.
    """
    for attempt in range(12):
        shift = cell * ((attempt * np.array([0.37, 0.59, 0.83])) % 1)
        vertices, quads = _net(field, np.asarray(lower, np.float64) - shift, upper, cell)
        edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
        if len(np.unique(edges[:, 0] * len(vertices) + edges[:, 1])) == len(edges):
            break
    else:
        raise ValueError(f"a grid of cells of {cell} is too coarse for this surface")
    for _ in range(3):
        vertices = _onto(field, _relaxed(vertices, quads), cell)
    return Mesh(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def _net(field: Field, lower: NDArray, upper: NDArray, cell: float) -> tuple[NDArray, NDArray]:
    """Middles (v, 3) of the cells that the surface crosses, and quads (q, 4) between neighbours."""
    counts = np.ceil((np.asarray(upper) - lower) / cell).astype(int) + 1
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1)
    inside = (field(lower + cell * grid.reshape(-1, 3)) < 0).reshape(counts)
    corners = np.zeros(counts - 1, int)
    for i, j, k in itertools.product((0, 1), repeat=3):
        corners += inside[i : counts[0] - 1 + i, j : counts[1] - 1 + j, k : counts[2] - 1 + k]
    crossed = (corners > 0) & (corners < 8)
    number = np.full(crossed.shape, -1)
    number[crossed] = np.arange(crossed.sum())
    quads = []
    for axis in range(3):  # four cells meet at each edge of the grid that crosses the surface: they form a quad
        u, v = (axis + 1) % 3, (axis + 2) % 3
        along = np.moveaxis(inside, axis, 0)
        edges = np.argwhere(np.moveaxis(along[1:] != along[:-1], 0, axis))
        around = []
        for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
            at = edges.copy()
            at[:, u] += du
            at[:, v] += dv
            around.append(number[tuple(at.T)])
        quad = np.stack(around, axis=1)
        leaving = inside[tuple(edges.T)]  # the surface faces along +axis
        quads.append(np.where(leaving[:, None], quad, quad[:, ::-1]))
    return lower + cell * (np.argwhere(crossed) + 0.5), np.concatenate(quads)


def _relaxed(vertices: NDArray, quads: NDArray) -> NDArray:
    """The vertices, moved half-way towards the mean of their neighbours, which evens out the triangles."""
    total, count = np.zeros_like(vertices), np.zeros(len(vertices))
    for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
        for here, there in ((a, b), (b, a)):
            np.add.at(total, quads[:, here], vertices[quads[:, there]])
            np.add.at(count, quads[:, here], 1)
    return (vertices + total / count[:, None]) / 2


def _onto(field: Field, points: NDArray, cell: float) -> NDArray:
    """The points, moved onto field = 0 by Newton steps of at most half a cell."""
    h = 1e-3 * cell
    for _ in range(4):
        value = field(points)
        slope = np.stack([(field(points + d) - field(points - d)) / (2 * h) for d in np.eye(3) * h], axis=1)
        step = value[:, None] * slope / np.maximum(np.sum(slope**2, axis=1), 1e-6)[:, None]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        points = points - step * np.minimum(1, cell / 2 / np.maximum(length, 1e-12))
    return points


def _sphere(p, centre, radius):
    return np.linalg.norm(p - np.array(centre), axis=1) - radius


def _ellipsoid(p, centre, radii):
    q = (p - np.array(centre)) / np.array(radii)
    length = np.linalg.norm(q, axis=1)
    gradient = np.linalg.norm(q / np.array(radii), axis=1)
    return length * (length - 1) / np.maximum(gradient, 1e-9)


def _capsule(p, a, b, radius):
    a, b = np.array(a), np.array(b)
    along = np.clip((p - a) @ (b - a) / np.sum((b - a) ** 2), 0, 1)
    return np.linalg.norm(p - a - along[:, None] * (b - a), axis=1) - radius


def _ring(p, centre, axis, radius, thickness):
    q = p - np.array(centre)
    along = q @ np.array(axis)
    across = np.sqrt(np.maximum(np.sum(q * q, axis=1) - along**2, 0))
    return np.hypot(across - radius, along) - thickness


def _join(a, b, blend):
    """A union whose seam is rounded over about `blend` (Quilez, polynomial smooth minimum)."""
    h = np.maximum(blend - np.abs(a - b), 0) / blend
    return np.minimum(a, b) - h * h * blend / 4


def _cut(a, b, blend):
    return -_join(-a, b, blend)


def _figurine(p: NDArray) -> NDArray:
    body = _ellipsoid(p, (0, 0, 0.37), (0.25, 0.21, 0.30))
    for side in (-1, 1):
        body = _join(body, _ellipsoid(p, (side * 0.14, -0.05, 0.06), (0.115, 0.17, 0.085)), 0.06)
    body = _join(body, _ring(p, (0, 0, 0.615), (0, 0, 1), 0.135, 0.042), 0.05)  # collar
    body = _join(body, _ring(p, (0.265, 0, 0.40), (0, 1, 0), 0.125, 0.034), 0.035)  # arm akimbo
    body = _join(body, _capsule(p, (-0.19, 0, 0.50), (-0.40, -0.07, 0.72), 0.042), 0.06)  # raised arm
    body = _join(body, _sphere(p, (-0.42, -0.08, 0.745), 0.07), 0.03)
    head = _ellipsoid(p, (0, -0.01, 0.79), (0.215, 0.195, 0.185))
    for side in (-1, 1):
        head = _join(head, _ring(p, (side * 0.22, 0, 0.80), (1, 0, 0), 0.05, 0.028), 0.02)  # ears
        head = _cut(head, _sphere(p, (side * 0.084, -0.195, 0.83), 0.062), 0.015)  # eye sockets
    head = _cut(head, _capsule(p, (-0.06, -0.21, 0.71), (0.06, -0.21, 0.71), 0.032), 0.02)  # mouth
    head = _join(head, _capsule(p, (0, 0, 0.95), (0.05, 0.02, 1.13), 0.028), 0.04)  # antenna
    head = _join(head, _sphere(p, (0.055, 0.022, 1.17), 0.058), 0.03)
    return _cut(_join(body, head, 0.03), p[:, 2], 0.02)  # flat soles at z = 0


def figurine(height: float = 0.12, detail: float = 1.0) -> Mesh:
    """A little robot on the marker: one closed smooth surface with hollows, a handle and thin parts.

    height: metres. detail: 1 gives about 6900 triangles, 2 four times as many; below 0.9 the thin parts would
    break. It looks along -y. Raises ValueError for an impossible height or detail.
    """
    if not 0.9 <= detail <= 4:
        raise ValueError(f"detail must be from 0.9 to 4, got {detail}")
    return stand(_robot(float(detail)), height)


@lru_cache(maxsize=4)
def _robot(detail: float) -> Mesh:
    lower, upper = np.array([-0.56, -0.31, -0.06]), np.array([0.50, 0.30, 1.30])
    return surface_net(_figurine, lower, upper, 0.0275 / detail)
