"""Truth by brute force: float64 NumPy that integrates the map directly and shares no formula with the library.

Solid angles come from the spherical triangles of a texel's corners (van Oosterom and Strackee 1983), not from the
library's arctangents; an equirectangular picture is integrated as it is, without a cube map between.
"""

from __future__ import annotations

from collections.abc import Iterator
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


_STEP = 0.3  # distance of directions under a lobe, in widths of (n.h)^s
_AT_ONCE = 1 << 20  # directions


def _triangle_angle(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """The solid angle of the spherical triangle between unit vectors (..., 3)."""
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

    corners = directions(grid, grid)[:1]  # all faces are alike
    a, b, c, d = corners[:, :-1, :-1], corners[:, :-1, 1:], corners[:, 1:, 1:], corners[:, 1:, :-1]
    angles = np.broadcast_to(_triangle_angle(a, b, c) + _triangle_angle(a, c, d), (6, n, n))
    radiance = np.repeat(np.repeat(faces, split, axis=1), split, axis=2)
    return directions(middle, middle).reshape(-1, 3), angles.reshape(-1), radiance.reshape(-1, faces.shape[-1])


def _map(source: Any) -> NDArray[np.float64]:
    """The texels of a map: (6, n, n, 3 k) or (h, w, 3)."""
    if isinstance(source, Environment):
        source = source.radiance
    if isinstance(source, CubeMap):
        source = source.faces
    array = np.asarray(source, np.float64) if not isinstance(source, str) else np.zeros(0)
    cube = array.ndim == 4 and array.shape[0] == 6 and array.shape[1] == array.shape[2] and array.shape[3] % 3 == 0
    if not (cube or (array.ndim == 3 and array.shape[2] == 3)) or array.size == 0:
        got = repr(source) if isinstance(source, str) else array.shape
        raise ValueError(f"expected cube faces (6, n, n, 3) or a picture (h, w, 3), got {got}")
    if not np.isfinite(array).all():
        raise ValueError("expected finite radiance: CubeMap(faces) cleans what is not")
    return array


def texel_of(directions: NDArray, size: int) -> NDArray[np.int64]:
    """Of the texels (6, size, size), in one row, those that unit directions (n, 3) meet; float64."""
    along = np.einsum("nk,fk->nf", directions, _FACES[:, 0])
    face = along.argmax(axis=1)
    major, right, down = (np.einsum("nk,nk->n", directions, _FACES[face, k]) for k in range(3))
    column, row = (np.clip((side / major + 1) / 2 * size, 0, size - 1).astype(int) for side in (right, down))
    return (face * size + row) * size + column


def samples(source: Any, split: int = 1) -> tuple[NDArray, NDArray, NDArray]:
    """Unit directions (n, 3), solid angles (n,) and radiances (n, 3) of a map, float64.

    source: CubeMap, Environment, cube faces (6, n, n, 3) or equirectangular picture (h, 2h, 3). split: pieces of a
    texel along each axis.
    Cube faces may have 3 k channels, k maps side by side: functions that sum over them then return (..., 3 k). Raises
    ValueError for other shapes and for values that are not finite, which CubeMap(faces) would clean.
    """
    array = _map(source)
    if array.ndim == 4:
        return _cube_samples(array, split)
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


def _split_shape(shape: tuple[int, ...], split: int) -> tuple[int, ...]:
    """Of the map whose texels are split along each axis."""
    *faces, rows, columns, channels = shape
    return (*faces, split * rows, split * columns, channels)


def _units(vectors: ArrayLike, name: str) -> NDArray:
    array = np.asarray(vectors, np.float64)
    if array.ndim < 1 or array.shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3), got {array.shape}")
    return array / np.linalg.norm(array, axis=-1, keepdims=True)


def _pieces(texels: NDArray) -> int:
    return max(1, 64 // texels.shape[-3])


def irradiance(source: Any, normals: ArrayLike, split: int | None = None) -> NDArray:
    """Irradiance (..., 3) float64 on surfaces facing `normals` (..., 3): sum of L max(n.w, 0) dw over the map.

    split: pieces of a texel along each axis; by default so many that an edge has at least 64, for coarse maps.
    """
    texels = _map(source)
    directions, angles, radiance = samples(texels, _pieces(texels) if split is None else split)
    n = _units(normals, "normals")
    flat, flux = n.reshape(-1, 3), radiance * angles[:, None]
    out = np.empty((len(flat), flux.shape[1]))
    for i in range(0, len(flat), 64):
        out[i : i + 64] = np.maximum(flat[i : i + 64] @ directions.T, 0) @ flux
    return out.reshape(*n.shape[:-1], out.shape[1])


def glossy(
    source: Any,
    normals: ArrayLike,
    views: ArrayLike,
    exponent: float,
    normalization: str = "energy",
    split: int | None = None,
) -> NDArray:
    """Glossy radiance (..., 3) float64 of Eq. 3 with k_G = 1.

    The lobe is (n.h)^s max(n.w, 0). "energy" divides by its integral; "paper" keeps Eq. 3's (s + 8) / (8 pi),
    "exact" has (s + 2)(s + 4) / (8 pi (2^(-s/2) + s)). split: pieces of a texel along each axis; by default enough for
    the exponent, where the lobe is. An infinite exponent is a mirror, which shows one texel. Raises ValueError for an
    exponent below 0 or NaN, another normalization, or other shapes.
    """
    if not exponent >= 0:
        raise ValueError(f"exponent must be at least 0, got {exponent}")
    if np.isinf(exponent) and normalization != "energy":
        raise ValueError(f'a mirror is of normalization "energy", got {normalization!r}')
    if normalization not in ("energy", "paper", "exact"):
        raise ValueError(f'normalization must be "energy", "paper" or "exact", got {normalization!r}')
    n, v = np.broadcast_arrays(_units(normals, "normals"), _units(views, "views"))
    texels = _map(source)
    base = _pieces(texels) if split is None else split
    directions, angles, radiance = samples(texels, base)
    shape = _split_shape(texels.shape, base)
    width = np.sqrt(angles.max())
    # Beyond this angle from the mirror direction, the lobe is below 1/10000 of its height.
    reach = 2 * np.arccos(min(1e-4 ** (1 / max(exponent, 1e-9)), 1)) + 1.5 * width
    out = np.empty((n.size // 3, radiance.shape[1]))
    for i, (normal, view) in enumerate(zip(n.reshape(-1, 3), v.reshape(-1, 3), strict=True)):
        mirror = 2 * (view @ normal) * normal - view
        if np.isinf(exponent):  # the texel that the mirror shows
            out[i] = radiance[np.argmax(directions @ mirror)]
            continue
        weight = _lobe(directions, normal, view, exponent) * angles
        # Across the plane of incidence, the lobe is the narrower the more grazing the view is.
        step = _STEP * max(view @ normal, 0.1) / np.sqrt(exponent + 1)
        fine = 1 if split is not None else int(np.ceil(width / step))
        if fine > 1:
            chosen = np.flatnonzero(directions @ mirror > np.cos(min(reach, np.pi)))
            for some, pieces, piece_angles in _refined_parts(shape, chosen, angles, fine):
                weight[some] = (_lobe(pieces, normal, view, exponent) * piece_angles).sum(axis=1)
        out[i] = _factor(normalization, exponent, weight) * (weight @ radiance)
    return out.reshape(*n.shape[:-1], out.shape[1])


def _lobe(directions: NDArray, normal: NDArray, view: NDArray, exponent: float) -> NDArray:
    """(n.h)^s max(n.w, 0) for unit directions (..., 3)."""
    half = directions + view
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-300)
    return np.power(np.clip(half @ normal, 0, 1), exponent) * np.maximum(directions @ normal, 0)


def _factor(normalization: str, s: float, weight: NDArray) -> float:
    """Of the lobe (n.h)^s max(n.w, 0). weight: its height times the solid angle, of each direction."""
    if normalization == "paper":
        return (s + 8) / (8 * np.pi)
    if normalization == "exact":
        return (s + 2) * (s + 4) / (8 * np.pi * (2 ** (-s / 2) + s))
    return 1 / max(weight.sum(), 1e-300)


def _refined(shape: tuple[int, ...], chosen: NDArray, angles: NDArray, split: int) -> tuple[NDArray, NDArray]:
    """Directions (k, split^2, 3) and solid angles (k, split^2) of the pieces of k chosen texels of a map."""
    part = (np.arange(split) + 0.5) / split
    if len(shape) == 4:
        n = shape[1]
        face, row, column = np.unravel_index(chosen, (6, n, n))
        t = ((row[:, None] + part) * 2 / n - 1)[:, :, None, None]
        s = ((column[:, None] + part) * 2 / n - 1)[:, None, :, None]
        major, right, down = (_FACES[face, k][:, None, None] for k in range(3))
        points = major + s * right + t * down
        size = np.linalg.norm(points, axis=-1)
        directions, area = points / size[..., None], size**-3
    else:
        height, width = shape[:2]
        row, column = np.unravel_index(chosen, (height, width))
        polar = ((row[:, None] + part) / height * np.pi)[:, :, None]
        azimuth = (((column[:, None] + part) / width - 0.5) * 2 * np.pi)[:, None, :]
        across = np.sin(polar)
        z = np.broadcast_to(np.cos(polar), (len(chosen), split, split))
        directions = np.stack([across * np.sin(azimuth), across * np.cos(azimuth), z], axis=-1)
        area = np.broadcast_to(across, z.shape)
    area = area.reshape(len(chosen), split * split)  # also works where no texel is chosen
    return directions.reshape(len(chosen), split * split, 3), area * (angles[chosen] / area.sum(axis=1))[:, None]


def _refined_parts(
    shape: tuple[int, ...], chosen: NDArray, angles: NDArray, split: int
) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Some of the chosen texels at a time, as many as memory holds, with what _refined() gives for them."""
    count = max(1, _AT_ONCE // split**2)
    for begin in range(0, len(chosen), count):
        some = chosen[begin : begin + count]
        yield some, *_refined(shape, some, angles, split)


def ggx_alpha(roughness: float, anisotropy: float = 0.0) -> tuple[float, float]:
    """glTF's mapping (KHR_materials_anisotropy): alpha along and across the tangent, at least 0.02."""
    across = roughness**2
    return max(across + (1 - across) * anisotropy**2, 0.02), max(across, 0.02)


def _ggx_lobe(l: NDArray, v: NDArray, frame: NDArray, alpha: tuple[float, float]) -> NDArray:
    """D G2 / (4 n.v) for unit directions l (..., 3) towards the light; rows of frame: tangent, bitangent, normal.

    D follows from the tangent of the half vector's angle (Walter et al. 2007), G2 from Smith's masking in its
    height-correlated form for GGX.
    """
    h = l + v
    h = h / np.maximum(np.linalg.norm(h, axis=-1, keepdims=True), 1e-300)
    hx, hy, hz = (h @ axis for axis in frame)
    lx, ly, lz = (l @ axis for axis in frame)
    vx, vy, vz = frame @ v
    tangent2 = ((hx / alpha[0]) ** 2 + (hy / alpha[1]) ** 2) / np.maximum(hz, 1e-12) ** 2
    d = 1 / (np.pi * alpha[0] * alpha[1] * np.maximum(hz, 1e-12) ** 4 * (1 + tangent2) ** 2)

    def masked(x, y, z):
        return (np.sqrt(1 + ((alpha[0] * x) ** 2 + (alpha[1] * y) ** 2) / np.maximum(z, 1e-12) ** 2) - 1) / 2

    g = 1 / (1 + masked(vx, vy, vz) + masked(lx, ly, lz))
    return np.where((lz > 0) & (hz > 0), d * g / (4 * max(vz, 1e-12)), 0.0)


def _surface_frame(normal: NDArray, tangent: NDArray) -> NDArray:
    """Rows tangent, bitangent, normal; some tangent is chosen where the given one is 0 or along the normal."""
    across = np.cross(normal, tangent)
    if not np.linalg.norm(across) > 1e-4:
        across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.stack([np.cross(across, normal), across, normal])


def ggx(
    source: Any,
    normals: ArrayLike,
    views: ArrayLike,
    roughness: float = 0.4,
    anisotropy: float = 0.0,
    tangents: ArrayLike | None = None,
    *,
    alpha: tuple[float, float] | None = None,
    normalization: str = "energy",
    split: int | None = None,
) -> NDArray:
    """Radiance (..., 3) float64 reflected by a GGX surface with Fresnel term 1: the sum over the map.

    alpha: (alpha_x, alpha_y) instead of roughness and anisotropy. "energy" divides by the lobe's integral, "single"
    keeps the loss of single scattering. split: pieces along each axis of the texels where the lobe is above 1/1000 of
    its height; by default enough for alpha.
    """
    if normalization not in ("energy", "single"):
        raise ValueError(f'normalization must be "energy" or "single", got {normalization!r}')
    if not (0 <= roughness <= 1 and 0 <= anisotropy <= 1):
        raise ValueError(f"roughness and anisotropy must be 0 to 1, got {roughness} and {anisotropy}")
    pair = ggx_alpha(roughness, anisotropy) if alpha is None else (float(alpha[0]), float(alpha[1]))
    if not (0 < min(pair) and max(pair) <= 1):
        raise ValueError(f"alpha must be above 0 and at most 1, got {pair}")
    if tangents is None:
        tangents = np.zeros(3)
    n, v, t = np.broadcast_arrays(_units(normals, "normals"), _units(views, "views"), np.asarray(tangents, np.float64))
    texels = _map(source)
    base = _pieces(texels) if split is None else 1
    directions, angles, radiance = samples(texels, base)
    shape = _split_shape(texels.shape, base)
    if split is None:
        split = int(np.clip(np.ceil(0.3 / min(pair) * 128 * np.sqrt(98304 / 128**2 / len(angles))), 1, 24))
    out = np.empty((n.size // 3, radiance.shape[1]))
    rows = zip(n.reshape(-1, 3), v.reshape(-1, 3), t.reshape(-1, 3), strict=True)
    for i, (normal, view, tangent) in enumerate(rows):
        frame = _surface_frame(normal, tangent)
        weight = _ggx_lobe(directions, view, frame, pair) * angles
        if split > 1:
            density = weight / angles
            # Texels that the horizon cuts are refined, too.
            cut = np.abs(directions @ normal) < 2 * np.sqrt(angles)
            chosen = np.flatnonzero((density > 1e-3 * density.max()) | cut)
            for some, pieces, piece_angles in _refined_parts(shape, chosen, angles, split):
                weight[some] = (_ggx_lobe(pieces, view, frame, pair) * piece_angles).sum(axis=1)
        out[i] = weight @ radiance / (max(weight.sum(), 1e-300) if normalization == "energy" else 1)
    return out.reshape(*n.shape[:-1], out.shape[1])


def ggx_albedo(cos_view: float, alpha: tuple[float, float], azimuth: float = 0.0, count: int = 1500) -> float:
    """Directional albedo of single-scattering GGX with Fresnel term 1, by quadrature.

    azimuth: that of the view, from the tangent. The quadrature takes midpoints over the half vector: psi = atan(tan(its
    polar angle) / alpha) and its azimuth.
    """
    sine = np.sqrt(max(0.0, 1 - cos_view**2))
    v = np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cos_view])
    psi = ((np.arange(count) + 0.5) / count * np.pi / 2)[:, None]
    turn = ((np.arange(count // 3) + 0.5) / (count // 3) * 2 * np.pi)[None]
    radius = np.tan(psi)
    x, y = alpha[0] * radius * np.cos(turn), alpha[1] * radius * np.sin(turn)
    h = np.stack(np.broadcast_arrays(-x, -y, np.ones_like(x)), axis=-1)
    size = np.linalg.norm(h, axis=-1)
    h /= size[..., None]
    vh = h @ v
    l = 2 * vh[..., None] * h - v
    # dl = 4 v.h dh, dh = dx dy / |(x, y, 1)|^3, dx dy = alpha_x alpha_y r dr dturn, dr = (1 + r^2) dpsi.
    step = np.pi / 2 / count * 2 * np.pi / (count // 3)
    measure = 4 * np.maximum(vh, 0) / size**3 * alpha[0] * alpha[1] * radius * (1 + radius**2) * step
    return float((_ggx_lobe(l, v, np.eye(3), alpha) * measure).sum())


def directional_albedo(cos_view: ArrayLike, exponent: float, count: int = 400) -> NDArray:
    """rho(theta_v, s) of Eq. 3: the share that its glossy term reflects, by quadrature over the hemisphere of h.

    cos_view: (...). Returns (...) float64.
    """
    if not (exponent >= 0 and np.isfinite(exponent)):
        raise ValueError(f"exponent must be at least 0 and finite, got {exponent}")
    cosines = np.clip(np.asarray(cos_view, np.float64), 0, 1)
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

    occluder: spheres (m, 4), or a Mesh whose triangles are tested by rays. Every texel above the horizon counts, as one
    direction through its centre.
    """
    from ._fastibl import Bvh, Mesh

    directions, angles, radiance = samples(source)
    up = directions[:, 2] > 0
    d = directions[up]
    flux = radiance[up] * (angles[up] * d[:, 2])[:, None]
    total = flux.sum(axis=0)
    p = np.asarray(points, np.float64)
    if p.ndim < 1 or p.shape[-1] != 2:
        raise ValueError(f"points must have shape (..., 2), got {p.shape}")
    flat = p.reshape(-1, 2)
    out = np.ones((len(flat), len(total)))
    bvh = Bvh(occluder) if isinstance(occluder, Mesh) else None
    spheres = np.zeros((0, 4)) if bvh is not None else np.asarray(occluder, np.float64)
    if spheres.ndim != 2 or spheres.shape[1] != 4:
        raise ValueError(f"occluder must be a Mesh or spheres (m, 4), got {spheres.shape}")
    for i, point in enumerate(flat):
        origin = np.array([point[0], point[1], 0.0])
        if bvh is not None:
            origin[2] = 1e-6
            hidden = bvh.occluded(origin.astype(np.float32), d.astype(np.float32))
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
    return out.reshape(*p.shape[:-1], len(total))
