"""One material of the several that a file's parts have, for readers of files: what looks the same is one, and the
textures of others are laid side by side in an atlas (fastibl.atlas)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Material, Mesh, Response
from .atlas import packed
from .cutouts import Cut, Outline, TooManyPieces, cut_out, grown
from .expected import present
from .file_limits import MOST_PIXELS
from .picture_headers import jpeg_size, png_size
from .pictures import decode_alpha, decode_picture, unit
from .uv_borders import single_copies

_FINE = 0.5  # texels: outlines that are off by more are told
_CLEAR, _SOLID = 0.1, 0.9  # alphas: what is blended has few texels between them if it is meant as an outline
_MOST_BETWEEN = 0.1  # of the texels
_MOST_WITHIN = 0.005  # of the texels: those of which all within two texels are between them, as in a pane of glass


class Pictures:
    """Textures as a file's materials name them; together of no more than `MOST_PIXELS`."""

    def __init__(self) -> None:
        self._pixels = 0

    def decoded(self, data: bytes, name: str) -> NDArray[Any]:
        """(h, w, 3) uint8 or uint16 RGB of a PNG or JPEG. Raises ValueError, with the name, for others."""
        if data[:1] not in (b"\x89", b"\xff"):
            raise ValueError(f"{name} is neither PNG nor JPEG")
        picture = decode_picture(data, png_size if data[:1] == b"\x89" else jpeg_size, name)
        self._pixels += picture.shape[0] * picture.shape[1]
        if self._pixels > MOST_PIXELS:
            raise ValueError(f"its textures have more than {MOST_PIXELS} pixels together")
        return picture

    def alpha(self, data: bytes, name: str) -> NDArray[np.float32] | None:
        """(h, w) from 0 to 1 of a picture that was decoded; None where it has no alpha."""
        alpha = decode_alpha(data, name) if data[:1] == b"\x89" else None
        return None if alpha is None else unit(alpha)


@dataclass(frozen=True)
class Lie:
    """Which set of uvs a texture is read with, and where KHR_texture_transform takes them."""

    uvs: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0  # radians
    scale: tuple[float, float] = (1.0, 1.0)

    def applied(self, uvs: NDArray) -> NDArray:
        """Both with v downwards, as the format has it. Turned as its text, its test model and all readers have it; the
        matrix that it shows turns the other way (KhronosGroup/glTF, issue 1563)."""
        c, s = np.cos(self.rotation), np.sin(self.rotation)
        return (uvs * self.scale) @ np.array([[c, -s], [s, c]]) + self.offset


@dataclass(frozen=True)
class Texture:
    """A picture as a material reads it. Its floats take four times the picture's memory, and materials share pictures:
    they are made where they are used."""

    source: Any  # which of the file's pictures
    picture: NDArray = field(compare=False, repr=False)  # (h, w, 3) uint8 or uint16 RGB
    wrap: tuple[str, str] = ("repeat", "repeat")
    lie: Lie = Lie()
    srgb: bool = False
    channel: int | None = None  # the channel that is read; None for all three
    factor: tuple[float, ...] | float = 1.0

    @property
    def bare(self) -> Texture:
        """What is decoded for it: one for all that differ in their factor, or in how they lie and go on."""
        return Texture(self.source, self.picture, srgb=self.srgb, channel=self.channel)

    @property
    def pixels(self) -> NDArray:
        return self.picture if self.channel is None else self.picture[..., self.channel]

    def values(self) -> NDArray[np.float32]:
        """(h, w, 3), or (h, w) of one channel: linear floats."""
        out = unit(self.pixels)
        if self.srgb:
            out = Response.srgb().decode(out)
        out *= np.asarray(self.factor, np.float32)
        return out


@dataclass(frozen=True)
class Cutout:
    """Where there is a surface: where a picture's alpha is at least `cutoff`."""

    source: int  # which of the file's pictures
    alpha: NDArray = field(compare=False, repr=False)  # (h, w) from 0 to 1
    cutoff: float
    wrap: tuple[str, str] = ("repeat", "repeat")
    lie: Lie = Lie()
    _outlines: dict[tuple[int, int], Outline] = field(default_factory=dict, compare=False, repr=False)
    _filled: dict[Any, NDArray] = field(default_factory=dict, compare=False, repr=False)  # pictures by their source

    def outline(self, copies: tuple[int, int]) -> Outline:
        """Of so many copies from border to border: 2 where the mirror image lies beside the picture."""
        if copies not in self._outlines:
            alpha = self.alpha
            if copies[0] == 2:  # the first copy is the left one, and the lower one
                alpha = np.concatenate([alpha, alpha[:, ::-1]], axis=1)
            if copies[1] == 2:
                alpha = np.concatenate([alpha[::-1], alpha])
            self._outlines[copies] = Outline(alpha, self.cutoff, self.wrap)
        return self._outlines[copies]

    @property
    def shows_all(self) -> bool:
        return bool((self.alpha >= self.cutoff).all())

    @property
    def is_outline(self) -> bool:
        """Whether a picture that is blended is meant as an outline: little of it shines through, and something of it is
        solid."""
        import cv2

        between = ((self.alpha > _CLEAR) & (self.alpha < _SOLID)).astype(np.uint8)
        within = cv2.erode(between, np.ones((5, 5), np.uint8))
        few = between.mean() <= _MOST_BETWEEN and within.mean() <= _MOST_WITHIN
        return bool(few and (self.alpha >= _SOLID).any())

    def filled(self, texture: Texture) -> Texture:
        """A texture that lies as the cutout does, with colours that go on where nothing is seen."""
        if (texture.picture.shape[:2], texture.lie) != (self.alpha.shape, self.lie):
            return texture
        if texture.source not in self._filled:
            self._filled[texture.source] = grown(texture.picture, self.alpha >= self.cutoff)
        source = texture.source, self.source, self.cutoff
        return replace(texture, source=source, picture=self._filled[texture.source])


@dataclass(frozen=True)
class Surface:
    """A material: linear constants, or textures. Materials that look the same are equal."""

    base_color: Texture | tuple[float, ...] = (1.0, 1.0, 1.0)
    metallic: Texture | float = 1.0
    roughness: Texture | float = 1.0
    emission: Texture | tuple[float, ...] = (0.0, 0.0, 0.0)
    normal: Texture | None = None
    normal_scale: float = 1.0
    anisotropy: float = 0.0
    anisotropy_rotation: float = 0.0
    ior: float = 1.5
    specular: float = 1.0
    specular_color: tuple[float, ...] = (1.0, 1.0, 1.0)
    cutout: Cutout | None = None

    @property
    def textures(self) -> list[Texture]:
        every = (self.base_color, self.metallic, self.roughness, self.emission, self.normal)
        return [t for t in every if isinstance(t, Texture)]

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows of its largest textures; 1 without."""
        shapes = [t.picture.shape for t in self.textures]
        return max((s[1] for s in shapes), default=1), max((s[0] for s in shapes), default=1)

    @property
    def wraps(self) -> set[tuple[str, str]]:
        """How its textures go on beyond their borders."""
        return {t.wrap for t in self.textures}

    @property
    def wrap(self) -> tuple[str, str]:
        return min(self.wraps, default=("repeat", "repeat"))

    def material(self) -> Material:
        """Raises ValueError for more values of textures than those of two pictures of `MOST_PIXELS`."""
        count, most = sum(t.pixels.size for t in self.textures), 2 * 3 * MOST_PIXELS
        if count > most:  # several textures may use the same picture
            raise ValueError(f"its material's textures have {count} values together; there may be {most}")
        base_color, metallic, roughness, normal, emission = (
            m.values() if isinstance(m, Texture) else m
            for m in (self.base_color, self.metallic, self.roughness, self.normal, self.emission)
        )
        return Material.pbr(
            base_color, metallic, roughness, normal, emission, anisotropy=self.anisotropy,
            anisotropy_rotation=self.anisotropy_rotation, normal_scale=self.normal_scale,
            wrap=self.wrap, ior=self.ior, specular=self.specular, specular_color=self.specular_color,
        )  # fmt: skip


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
        self.normals = _normals_of(self)
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
        starts = np.cumsum([0, *(len(p.vertices) for p in own)])
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(p, name) for p in own])
            for name in ("uvs", *_CARRIED)
            if getattr(own[0], name) is not None
        }
        triangles = np.concatenate([p.triangles + start for p, start in zip(own, starts, strict=False)])
        out.append(replace(own[0], triangles=triangles, sets={}, **joined))
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


def _normals_of(part: Part) -> NDArray:
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

    def laid(name: str, channels: int, missing: Any = None) -> NDArray[np.float32]:
        sheet = np.zeros((atlas.height, atlas.width, channels), np.float32)
        owners: dict[Any, list[int]] = {}  # materials by the picture they share: each is decoded once, one at a time
        for m, surface in surfaces.items():
            value = getattr(surface, name)
            value = value.bare if isinstance(value, Texture) else missing if value is None else value
            # Each material has its own normal_scale, which goes into the picture.
            owners.setdefault((value, surface.normal_scale if name == "normal" else None), []).append(m)
        for (value, scale), materials in owners.items():
            shown = value.values() if isinstance(value, Texture) else np.float32(value)
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


def mesh_of(parts: list[Part]) -> Mesh:
    normals = np.concatenate([_normals_of(p) for p in parts])
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.triangles + start for p, start in zip(parts, starts, strict=False)]),
        None if any(p.uvs is None for p in parts) else np.concatenate([p.uvs for p in parts]),
        normals,
        None if all(p.colors is None for p in parts) else np.concatenate([_colors_of(p) for p in parts]),
    )


def _colors_of(part: Part) -> NDArray:
    return np.ones((len(part.vertices), 3)) if part.colors is None else part.colors


def joined(path: Path, parts: list[Part], surfaces: dict[int, Surface], stacklevel: int) -> Material:
    """The one material of all, whose textures the parts' uvs are moved to. surfaces: by number; each looks another way.

    Raises ValueError for textures that cannot lie side by side; warns of what is not kept.
    """
    if any(len(surfaces[p.material].wraps) > 1 and any(p.reaches_beyond) for p in parts):
        raise ValueError("its textures go on beyond their borders in different ways")
    if len(surfaces) == 1:
        (surface,) = surfaces.values()
        return surface.material()
    material, told = _atlas(parts, surfaces)
    for text in told:
        warnings.warn(f"{path}: {text}", stacklevel=stacklevel + 1)
    return material
