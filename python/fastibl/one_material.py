"""One material of the several that a file's parts have: what looks the same is one, and the textures of others are laid
side by side in an atlas (fastibl.atlas)."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Material
from .atlas import packed
from .parts import Part, copies_of
from .surfaces import Surface, Texture


def _scaled_bumps(normals: NDArray[np.float32], scale: float) -> NDArray[np.float32]:
    """An encoded normal map (h, w, 3) whose x and y are multiplied by a normalScale."""
    normals = (normals * 2 - 1) * np.asarray([scale, scale, 1], np.float32)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6)
    return normals * 0.5 + 0.5


def _area(part: Part) -> float:
    a, b, c = np.moveaxis(part.vertices[part.triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)


def _specular_of(parts: list[Part], surfaces: dict[int, Surface]) -> tuple[dict[str, Any], bool]:
    """What of all surfaces is not metal reflects, as arguments of Material.pbr; and whether that is the mean, by area,
    of surfaces that differ."""
    others = {m: s for m, s in surfaces.items() if s.metallic != 1.0}  # of a metal it does not matter
    looks = {(s.ior, s.specular, s.specular_color) for s in others.values()}
    if len(looks) < 2:
        ior, specular, color = looks.pop() if looks else (1.5, 1.0, (1.0, 1.0, 1.0))
        return {"ior": ior, "specular": specular, "specular_color": color}, False
    areas = {m: sum(_area(p) for p in parts if p.material == m) for m in others}
    whole = max(sum(areas.values()), 1e-30)
    strength, light = 0.0, np.zeros(3)
    for m, s in others.items():
        f0 = np.minimum(((s.ior - 1) / (s.ior + 1)) ** 2 * np.array(s.specular_color), 1)
        strength += areas[m] / whole * s.specular
        light += areas[m] / whole * s.specular * f0
    return {"specular": strength, "specular_color": tuple(light / max(0.04 * strength, 1e-9))}, True


def _atlas(parts: list[Part], surfaces: dict[int, Surface]) -> tuple[Material, list[str]]:
    """One material for all surfaces, and what of them it does not keep; moves the uvs of the parts to the material's
    textures."""
    if len({(s.anisotropy, s.anisotropy_rotation) for s in surfaces.values()}) > 1:
        raise ValueError("its materials differ in anisotropy")

    copies = {m: copies_of(s.wrap, [p for p in parts if p.material == m]) for m, s in surfaces.items()}
    sizes = {m: (s.size[0] * copies[m][0], s.size[1] * copies[m][1]) for m, s in surfaces.items()}
    atlas = packed(list(sizes.values()))
    where = dict(zip(surfaces, atlas.cells, strict=True))
    for part in parts:
        surface = surfaces[part.material]
        uvs = np.full((len(part.vertices), 2), 0.5)
        if surface.textures:
            uvs = part.cut(surface.wrap, copies[part.material])
        part.uvs = atlas.moved(where[part.material], uvs)
    shrunk = {
        f"{w} x {h} to {where[m].columns} x {where[m].rows}"
        for m, (w, h) in sizes.items()
        if (w, h) != (where[m].columns, where[m].rows)
    }
    told = [f"textures are shrunk beside each other: {', '.join(sorted(shrunk))}"] if shrunk else []
    specular, mean = _specular_of(parts, surfaces)
    if mean:
        told.append("what its materials reflect without being metal (KHR_materials_specular, _ior) becomes their mean")

    def cell_size(materials: list[int]) -> tuple[int, int]:
        """Columns and rows that a picture which these share has in the largest of their cells."""
        columns, rows = (
            max(max(getattr(where[m], name) // copies[m][k] for m in materials), 1)
            for k, name in enumerate(("columns", "rows"))
        )
        return columns, rows

    def laid(name: str, channels: int, missing: Any = None) -> NDArray[np.float32]:
        sheet = np.zeros((atlas.height, atlas.width, channels), np.float32)
        owners: dict[Any, list[int]] = {}  # materials by the picture they share: each is decoded once, one at a time
        for m, surface in surfaces.items():
            value = getattr(surface, name)
            value = value.bare if isinstance(value, Texture) else missing if value is None else value
            # Each material has its own normal_scale, which goes into the picture.
            owners.setdefault((value, surface.normal_scale if name == "normal" else None), []).append(m)
        for (value, scale), materials in owners.items():
            shown = value.values(cell_size(materials)) if isinstance(value, Texture) else np.float32(value)
            if shown.ndim < 2:
                shown = np.broadcast_to(shown, (1, 1, channels))
            shown = shown.reshape(*shown.shape[:2], channels)
            if scale is not None:
                shown = _scaled_bumps(shown, scale)
            filled: dict[Any, NDArray[np.float32]] = {}  # cells of the same size hold the same texels
            for m in materials:
                cell, wrap = where[m], surfaces[m].wrap
                key = replace(cell, x=0, y=0), wrap, copies[m]
                if key not in filled:
                    filled[key] = cell.filled(shown, wrap, copies[m])
                place = sheet[cell.y : cell.y + cell.height, cell.x : cell.x + cell.width]
                np.multiply(filled[key], np.float32(getattr(getattr(surfaces[m], name), "factor", 1.0)), out=place)
        return sheet if channels > 1 else sheet[..., 0]

    def joined(name: str, channels: int) -> Any:
        values = {getattr(s, name) for s in surfaces.values()}
        if len(values) == 1 and not any(isinstance(v, Texture) for v in values):
            return values.pop()
        sheet = laid(name, channels)
        return np.clip(sheet, 0, None, out=sheet)

    first = next(iter(surfaces.values()))
    merged = Material.pbr(
        joined("base_color", 3), joined("metallic", 1), joined("roughness", 1),
        laid("normal", 3, (0.5, 0.5, 1.0)) if any(s.normal is not None for s in surfaces.values()) else None,
        joined("emission", 3), anisotropy=first.anisotropy, anisotropy_rotation=first.anisotropy_rotation, **specular,
    )  # fmt: skip
    return merged, told


def joined(path: Path, parts: list[Part], surfaces: dict[int, Surface], stacklevel: int) -> Material:
    """The one material of all, whose textures the parts' uvs are moved to. surfaces: by number; each looks another way.

    Raises ValueError for textures that cannot lie side by side; warns of what is not kept.
    """
    if any(len(surfaces[p.material].wraps) > 1 and any(p.reaches_beyond) for p in parts):
        raise ValueError("its textures go on beyond their borders in different ways")
    if len(surfaces) == 1:
        (surface,) = surfaces.values()
        material, shrunk = surface.material()
        told = [f"textures are shrunk: {', '.join(sorted(shrunk))}"] if shrunk else []
    else:
        material, told = _atlas(parts, surfaces)
    for text in told:
        warnings.warn(f"{path}: {text}", stacklevel=stacklevel + 1)
    return material
