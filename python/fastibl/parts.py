"""Parts of meshes as readers of files find them, each with its material: triangles are cut at the borders of textures
(fastibl.uv_borders) and along the outline of what their alpha leaves (fastibl.cutouts)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Mesh
from .cutouts import Cut, TooManyPieces, cut_out
from .expected import present
from .surfaces import Lie, Surface
from .uv_borders import single_copies

_FINE = 0.5  # texels: outlines that are off by more are told


@dataclass
class Part:
    """A primitive in the file's frame. sets: of uvs, with v downwards. uvs: those that its textures are read with, with
    v upwards."""

    vertices: NDArray
    triangles: NDArray
    normals: NDArray
    sets: dict[int, NDArray]
    material: int
    uvs: NDArray | None = None
    tangents: NDArray | None = None  # (n, 4) as the file gives them
    colors: NDArray | None = None  # (n, 3) linear

    @property
    def reaches_beyond(self) -> tuple[bool, bool]:
        """Whether uvs lie outside the picture, along u and v."""
        if self.uvs is None or len(self.uvs) == 0:
            return False, False
        beyond = (self.uvs.min(axis=0) < -1e-3) | (self.uvs.max(axis=0) > 1 + 1e-3)
        return bool(beyond[0]), bool(beyond[1])

    def lay(self, surface: Surface) -> bool:
        """Chooses the uvs that a surface's textures are read with. Returns False where it has none: all show the
        texture's first corner, as of viewers."""
        lies = {t.lie for t in surface.textures}
        lies |= {surface.cutout.lie} if surface.cutout else set()
        lies = lies or {Lie()}
        if len(lies) > 1:
            raise ValueError("a material's textures lie on its mesh in different ways: sets of uvs, or transforms")
        (lie,) = lies
        textured = bool(surface.textures or surface.cutout)
        if lie.uvs in self.sets or textured:
            own = self.sets.get(lie.uvs, np.zeros((len(self.vertices), 2)))
            self.uvs = lie.applied(own) * [1, -1] + [0, 1]
        return lie.uvs in self.sets or not textured

    def cut(self, wraps: tuple[str, str], copies: tuple[int, int]) -> NDArray:
        """Cuts its triangles at the borders of a texture, and returns its uvs, moved into it. copies: of the texture
        from border to border."""
        uvs, values, self.triangles = single_copies(present(self.uvs) / copies, self._carried(), self.triangles, wraps)
        self._carry(values)
        return uvs

    def _carried(self) -> NDArray:
        """(n, k): what vertices have besides uvs."""
        self.normals = normals_of(self)
        return np.hstack([v for name in _CARRIED if (v := getattr(self, name)) is not None])

    def _carry(self, values: NDArray) -> None:
        start = 0
        for name in _CARRIED:
            if (old := getattr(self, name)) is not None:
                setattr(self, name, values[:, start : start + old.shape[1]])
                start += old.shape[1]


_CARRIED = ("vertices", "normals", "tangents", "colors")


def copies_of(wrap: tuple[str, str], parts: list[Part]) -> tuple[int, int]:
    """How many times a texture lies from border to border, along u and v: a mirrored one that repeats has its mirror
    image beside it."""
    u, v = (2 if way == "mirror" and any(p.reaches_beyond[k] for p in parts) else 1 for k, way in enumerate(wrap))
    return u, v


def cut_away(parts: list[Part], surfaces: dict[int, Surface]) -> tuple[list[Part], set[str]]:
    """The parts without what their surfaces' cutouts do not show, and what is left out of that.

    Raises ValueError where nothing is left.
    """
    shown = [part for part in parts if (c := surfaces[part.material].cutout) is None or (c.alpha >= c.cutoff).any()]
    if not shown:
        raise ValueError("all of it is transparent")
    cut = _together([part for part in shown if surfaces[part.material].cutout is not None])
    shown = [part for part in shown if surfaces[part.material].cutout is None] + cut
    whole, left_out = [replace(part) for part in cut], set[str]()
    try:
        _cut_out(cut, surfaces, left_out)
    except TooManyPieces as error:
        left_out.add(f"transparency ({error}; simpler pictures or fewer copies have fewer)")
        for part, before in zip(cut, whole, strict=True):
            vars(part).update(vars(before))
    shown = [part for part in shown if len(part.triangles)]
    if not shown:
        raise ValueError("all of it is transparent")
    return shown, left_out


def _together(parts: list[Part]) -> list[Part]:
    """One part of all that have the same material and carry the same: the leaves of a tree may be thousands."""
    groups: dict[Any, list[Part]] = {}
    for part in parts:
        held = tuple(getattr(part, name) is None for name in ("uvs", *_CARRIED))
        groups.setdefault((part.material, held), []).append(part)
    out = []
    for own in groups.values():
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(p, name) for p in own])
            for name in ("uvs", *_CARRIED)
            if getattr(own[0], name) is not None
        }
        out.append(replace(own[0], triangles=_all_triangles(own), sets={}, **joined))
    return out


def _cut_out(parts: list[Part], surfaces: dict[int, Surface], left_out: set[str]) -> None:
    cuts, copies = [], []
    for part in parts:
        cutout = present(surfaces[part.material].cutout)
        copies.append(copies_of(cutout.wrap, [part]))
        try:
            uvs = part.cut(cutout.wrap, copies[-1])
        except ValueError as error:
            raise TooManyPieces(str(error)) from None
        part.uvs = uvs * copies[-1]
        cuts.append(Cut(uvs, part._carried(), part.triangles, cutout.outline(copies[-1])))
    done, off = cut_out(cuts)
    if off > _FINE and cuts:
        left_out.add(f"detail of outlines below {off:g} texels")
    for part, (uvs, values, triangles), factor in zip(parts, done, copies, strict=True):
        part.uvs, part.triangles = uvs * factor, triangles
        part._carry(values)


def _unit(vectors: NDArray) -> NDArray:
    """0 for what has no direction."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.where(np.isfinite(lengths) & (lengths > 0), vectors / lengths, 0)


def normals_of(part: Part) -> NDArray:
    """Unit normals; where a part has none that is one, those of its triangles."""
    normals = _unit(part.normals)
    void = ~normals.any(axis=1)
    if void.any():
        a, b, c = np.moveaxis(part.vertices[part.triangles], 1, 0)
        sums = np.zeros_like(normals)
        np.add.at(sums, part.triangles.reshape(-1), np.cross(b - a, c - a).repeat(3, axis=0))
        normals[void] = _unit(sums[void])
    return normals


def alike(parts: list[Part], surfaces: dict[int, Surface]) -> dict[int, Surface]:
    """One of each look; the parts are given its number."""
    first: dict[Surface, int] = {}
    for m, surface in surfaces.items():
        first.setdefault(surface, m)
    for part in parts:
        part.material = first[surfaces[part.material]]
    return {m: surface for surface, m in first.items()}


def _all_triangles(parts: list[Part]) -> NDArray[np.int64]:
    """Of parts whose vertices follow each other."""
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    return np.concatenate([p.triangles + start for p, start in zip(parts, starts, strict=False)])


def mesh_of(parts: list[Part]) -> Mesh:
    normals = np.concatenate([normals_of(p) for p in parts])
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        _all_triangles(parts),
        None if any(p.uvs is None for p in parts) else np.concatenate([p.uvs for p in parts]),
        normals,
        None if all(p.colors is None for p in parts) else np.concatenate([_colors_of(p) for p in parts]),
    )


def _colors_of(part: Part) -> NDArray:
    return np.ones((len(part.vertices), 3)) if part.colors is None else part.colors
