"""Truth by brute force: float64 NumPy that integrates the map directly and shares no formula with the library.

Solid angles come from the spherical triangles of a texel's corners (van Oosterom and Strackee 1983), not from the
library's arctangents; an equirectangular picture is integrated as it is, without a cube map between.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import CubeMap, Environment

# Rows of OpenGL's table of faces: major axis, s axis (right), t axis (down).
_FACES = np.array(
    [
        [(1, 0, 0), (0, 0, -1), (0, -1, 0)],
        [(-1, 0, 0), (0, 0, 1), (0, -1, 0)],
        [(0, 1, 0), (1, 0, 0), (0, 0, 1)],
        [(0, -1, 0), (1, 0, 0), (0, 0, -1)],
        [(0, 0, 1), (1, 0, 0), (0, -1, 0)],
        [(0, 0, -1), (-1, 0, 0), (0, -1, 0)],
    ],
    np.float64,
)


def _triangle_angle(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """Solid angle of the spherical triangle of unit vectors (..., 3)."""
    volume = np.abs(np.einsum("...i,...i", a, np.cross(b, c)))
    dots = 1 + np.einsum("...i,...i", a, b) + np.einsum("...i,...i", b, c) + np.einsum("...i,...i", c, a)
    return 2 * np.arctan2(volume, dots)


def _cube_samples(faces: NDArray, split: int) -> tuple[NDArray, NDArray, NDArray]:
    n = faces.shape[1] * split
    grid = np.linspace(-1, 1, n + 1)
    middle = (grid[1:] + grid[:-1]) / 2

    def directions(axis_t: NDArray, axis_s: NDArray) -> NDArray:
        points = (
            _FACES[:, 0, None, None]
            + axis_s[None, None, :, None] * _FACES[:, 1, None, None]
            + axis_t[None, :, None, None] * _FACES[:, 2, None, None]
        )
        return points / np.linalg.norm(points, axis=-1, keepdims=True)

    corners = directions(grid, grid)[:1]  # all faces alike
    a, b, c, d = corners[:, :-1, :-1], corners[:, :-1, 1:], corners[:, 1:, 1:], corners[:, 1:, :-1]
    angles = np.broadcast_to(_triangle_angle(a, b, c) + _triangle_angle(a, c, d), (6, n, n))
    radiance = np.repeat(np.repeat(faces, split, axis=1), split, axis=2)
    return directions(middle, middle).reshape(-1, 3), angles.reshape(-1), radiance.reshape(-1, 3)


def samples(source: Any, split: int = 1) -> tuple[NDArray, NDArray, NDArray]:
    """Unit directions (n, 3), solid angles (n,) and radiances (n, 3) of a map, float64.

    source: CubeMap, Environment, cube faces (6, n, n, 3) or equirectangular picture (h, 2h, 3). split: pieces of a
    texel along each axis.
    """
    if isinstance(source, Environment):
        source = source.radiance
    if isinstance(source, CubeMap):
        source = source.faces
    array = np.asarray(source, np.float64)
    if array.ndim == 4 and array.shape[0] == 6:
        return _cube_samples(array, split)
    if array.ndim != 3 or array.shape[2] != 3:
        raise ValueError(f"expected cube faces (6, n, n, 3) or a picture (h, w, 3), got {array.shape}")
    height, width = array.shape[0] * split, array.shape[1] * split
    radiance = np.repeat(np.repeat(array, split, axis=0), split, axis=1)
    edges = np.linspace(0, np.pi, height + 1)
    polar, azimuth = (edges[1:] + edges[:-1]) / 2, ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    directions = np.stack(
        [
            np.sin(polar)[:, None] * np.sin(azimuth),
            np.sin(polar)[:, None] * np.cos(azimuth),
            np.broadcast_to(np.cos(polar)[:, None], (height, width)),
        ],
        axis=-1,
    )
    rings = (np.cos(edges[:-1]) - np.cos(edges[1:])) * 2 * np.pi / width
    angles = np.broadcast_to(rings[:, None], (height, width))
    return directions.reshape(-1, 3), angles.reshape(-1), radiance.reshape(-1, 3)


def _units(vectors: ArrayLike, name: str) -> NDArray:
    array = np.asarray(vectors, np.float64)
    if array.ndim < 1 or array.shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3), got {array.shape}")
    return array / np.linalg.norm(array, axis=-1, keepdims=True)


def irradiance(source: Any, normals: ArrayLike) -> NDArray:
    """Irradiance (..., 3) float64 on surfaces facing `normals` (..., 3): sum of L max(n.w, 0) dw over the map."""
    directions, angles, radiance = samples(source)
    n = _units(normals, "normals")
    flat, flux = n.reshape(-1, 3), radiance * angles[:, None]
    out = np.empty_like(flat)
    for i in range(0, len(flat), 64):
        out[i : i + 64] = np.maximum(flat[i : i + 64] @ directions.T, 0) @ flux
    return out.reshape(n.shape)


def glossy(
    source: Any,
    normals: ArrayLike,
    views: ArrayLike,
    exponent: float,
    normalization: str = "energy",
    split: int | None = None,
) -> NDArray:
    """Glossy radiance (..., 3) float64 of Eq. 3 with k_G = 1.

    The lobe is (n.h)^s max(n.w, 0). "energy" divides by its integral; "paper" keeps Eq. 3's (s + 8) / (8 pi). split:
    pieces of a texel along each axis; by default enough for the exponent.
    """
    if exponent < 0:
        raise ValueError(f"exponent must be at least 0, got {exponent}")
    if normalization not in ("energy", "paper"):
        raise ValueError(f'normalization must be "energy" or "paper", got {normalization!r}')
    n, v = np.broadcast_arrays(_units(normals, "normals"), _units(views, "views"))
    if split is None:
        split = 1 if exponent < 256 else 4 if exponent < 1024 else 8
    directions, angles, radiance = samples(source)
    fine = samples(source, split) if split > 1 else None
    out = np.empty((n.size // 3, 3))
    for i, (normal, view) in enumerate(zip(n.reshape(-1, 3), v.reshape(-1, 3), strict=True)):
        d, a, l = directions, angles, radiance
        if fine is not None:
            d, a, l = fine
        half = d + view
        half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-300)
        cosine = np.clip(half @ normal, 0, 1)
        weight = np.power(cosine, exponent) * np.maximum(d @ normal, 0) * a
        scale = (exponent + 8) / (8 * np.pi) if normalization == "paper" else 1 / max(weight.sum(), 1e-300)
        out[i] = scale * (weight @ l)
    return out.reshape(n.shape)


def directional_albedo(cos_view: ArrayLike, exponent: float, count: int = 400) -> NDArray:
    """rho(theta_v, s) of Eq. 3: the share that its glossy term reflects, by quadrature over the hemisphere of h.

    cos_view: (...). Returns (...) float64.
    """
    cosines = np.asarray(cos_view, np.float64)
    # Midpoints in the half-vector's polar angle (concentrated where the lobe is) and azimuth.
    u = (np.arange(count) + 0.5) / count
    top = min(np.pi / 2, 12 / np.sqrt(exponent + 1))
    polar, azimuth = u * top, u * 2 * np.pi
    h = np.stack(
        np.broadcast_arrays(
            np.sin(polar)[:, None] * np.cos(azimuth),
            np.sin(polar)[:, None] * np.sin(azimuth),
            np.cos(polar)[:, None],
        ),
        axis=-1,
    )
    area = np.sin(polar)[:, None] * (top / count) * (2 * np.pi / count)
    out = np.empty(cosines.size)
    for i, c in enumerate(cosines.reshape(-1)):
        v = np.array([np.sqrt(max(0, 1 - c * c)), 0, c])
        vh = h @ v
        light_z = 2 * vh * h[..., 2] - c
        inside = (vh > 0) & (light_z > 0)
        out[i] = np.sum(np.where(inside, h[..., 2] ** exponent * light_z * 4 * vh, 0) * area)
    return out.reshape(cosines.shape) * (exponent + 8) / (8 * np.pi)


def shadow_ratio(source: Any, occluder: Any, points: ArrayLike) -> NDArray:
    """Ratio (..., 3) float64 of the light on plane points (..., 2) with and without occluders.

    occluder: spheres (m, 4), or a Mesh whose triangles are met by rays. Every texel above the horizon counts, as one
    direction through its centre.
    """
    from ._fastibl import Bvh, Mesh

    directions, angles, radiance = samples(source)
    up = directions[:, 2] > 0
    d = directions[up]
    flux = radiance[up] * (angles[up] * d[:, 2])[:, None]
    total = flux.sum(axis=0)
    p = np.asarray(points, np.float64)
    flat = p.reshape(-1, 2)
    out = np.ones((len(flat), 3))
    bvh = Bvh(occluder) if isinstance(occluder, Mesh) else None
    spheres = None if bvh is not None else np.asarray(occluder, np.float64).reshape(-1, 4)
    for i, point in enumerate(flat):
        origin = np.array([point[0], point[1], 0.0])
        if bvh is not None:
            origin[2] = 1e-6
            hidden = bvh.occluded(np.broadcast_to(origin.astype(np.float32), d.shape).copy(), d.astype(np.float32))
        else:
            hidden = np.zeros(len(d), bool)
            for x, y, z, r in spheres:
                if not (np.isfinite([x, y, z, r]).all() and r > 0):
                    continue
                c = np.array([x, y, z]) - origin
                along = d @ c
                # A ray meets the sphere when it starts inside, or passes its centre closer than r ahead of it.
                hidden |= (c @ c < r * r) | ((along > 0) & (c @ c - along * along < r * r))
        lost = flux[hidden].sum(axis=0)
        out[i] = np.where(total > 0, 1 - lost / np.where(total > 0, total, 1), 1)
    return out.reshape(*p.shape[:-1], 3)
