"""Materials as readers of files find them: textures, and what of a surface its texture's alpha leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Material, Response
from .cutouts import Outline, grown
from .file_limits import MOST_PIXELS
from .picture_headers import jpeg_size, png_size
from .pictures import decode_alpha, decode_picture, picture_size, shrunk_to, unit

_CLEAR, _SOLID = 0.1, 0.9  # alphas: what is blended has few texels between them if it is meant as an outline
_MOST_TOGETHER = 2**31  # pixels of all textures of a file, which take time: 32 of 8192 x 8192
_BAND = 2**22  # pixels that are made floats at a time
_MOST_BETWEEN = 0.1  # of the texels
_MOST_WITHIN = 0.005  # of the texels: those of which all within two texels are between them, as in a pane of glass


class _Decoded:
    """The pictures that were decoded last, of no more than `MOST_PIXELS` together."""

    def __init__(self) -> None:
        self._kept: dict[Picture, NDArray[Any]] = {}  # the last one used is the last

    def pixels(self, picture: Picture, load: Callable[[], NDArray[Any]]) -> NDArray[Any]:
        found = self._kept.pop(picture, None)
        room = MOST_PIXELS - picture.shape[0] * picture.shape[1]
        for old in list(self._kept):  # before more memory is taken
            if sum(h * w for h, w in (p.shape for p in self._kept)) > room:
                del self._kept[old]
        self._kept[picture] = found = load() if found is None else found
        return found


class Picture:
    """A picture that is decoded where it is used: all of a large object's, at once, may not find room."""

    def __init__(self, shape: tuple[int, int], load: Callable[[], NDArray[Any]], decoded: _Decoded) -> None:
        self.shape, self._load, self._decoded = shape, load, decoded  # shape: rows and columns

    @property
    def pixels(self) -> NDArray[Any]:
        """(h, w, 3) uint8 or uint16 RGB. Raises ValueError for a picture that is damaged."""
        return self._decoded.pixels(self, self._load)

    def changed(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Picture:
        """A picture made of this one, of the same shape."""
        return Picture(self.shape, lambda: change(self.pixels), self._decoded)


class Pictures:
    """Textures as a file's materials name them; each of no more than `MOST_PIXELS`."""

    def __init__(self) -> None:
        self._pixels, self._decoded = 0, _Decoded()
        self._alphas: dict[Any, NDArray[np.float32] | None] = {}
        self._cutouts: dict[Cutout, Cutout] = {}

    def picture(self, data: bytes, name: str) -> Picture:
        """Of a PNG or JPEG. Raises ValueError, with the name, for others."""
        if data[:1] not in (b"\x89", b"\xff"):
            raise ValueError(f"{name} is neither PNG nor JPEG")
        size_of = png_size if data[:1] == b"\x89" else jpeg_size
        width, height = picture_size(data, size_of, name)
        self._pixels += height * width
        if self._pixels > _MOST_TOGETHER:
            raise ValueError(f"its textures have more than {_MOST_TOGETHER} pixels together")
        return Picture((height, width), lambda: decode_picture(data, size_of, name), self._decoded)

    def alpha(self, source: Any, encoded: Callable[[], bytes], name: str) -> NDArray[np.float32] | None:
        """(h, w) from 0 to 1 of a picture that was decoded; None where it has no alpha. source: which picture."""
        if source not in self._alphas:
            data = encoded()
            alpha = decode_alpha(data, name) if data[:1] == b"\x89" else None
            self._alphas[source] = None if alpha is None else unit(alpha)
        return self._alphas[source]

    def shared(self, cutout: Cutout) -> Cutout | None:
        """The one of all materials that cut alike, which share what is made of it; None where it shows all."""
        return None if cutout.shows_all else self._cutouts.setdefault(cutout, cutout)


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
    picture: Picture = field(compare=False, repr=False)
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
    def count(self) -> int:
        """How many values it has."""
        return self.picture.shape[0] * self.picture.shape[1] * (3 if self.channel is None else 1)

    def values(self, least: tuple[int, int] | None = None) -> NDArray[np.float32]:
        """(h, w, 3), or (h, w) of one channel: linear floats. least: columns and rows that are enough; where they are
        half the picture's or fewer, it is shrunk as its floats are made."""
        import cv2

        pixels = self.picture.pixels
        pixels = pixels if self.channel is None else pixels[..., self.channel]
        rows, columns = pixels.shape[:2]
        most = 1 if least is None else max(min(columns // least[0], rows // least[1]), 1)
        by = next(k for k in range(most, 0, -1) if columns % k == 0 and rows % k == 0)
        table, size = self._table(pixels.dtype), (columns // by, rows // by)
        out = np.empty((size[1], size[0], *pixels.shape[2:]), np.float32)
        step = max(_BAND // (by * columns), 1)
        for first in range(0, size[1], step):
            band = _looked_up(pixels[first * by : (first + step) * by], table)
            if by > 1:
                band = cv2.resize(band, (size[0], band.shape[0] // by), interpolation=cv2.INTER_AREA)
            out[first : first + step] = band
        return out

    def _table(self, kind: np.dtype[Any]) -> NDArray[np.float32]:
        """(n, 3): the linear value of each code, by channel."""
        codes = np.arange(np.iinfo(kind).max + 1, dtype=kind)
        out = np.repeat(unit(codes)[:, None], 3, axis=1)
        if self.srgb:
            out = Response.srgb().decode(out)
        out *= np.asarray(self.factor, np.float32)
        return out


def _looked_up(pixels: NDArray[Any], table: NDArray[np.float32]) -> NDArray[np.float32]:
    """The table's values for codes (h, w, 3), or (h, w)."""
    import cv2

    if pixels.ndim == 2:
        table = np.ascontiguousarray(table[:, 0])
    if pixels.dtype == np.uint8:
        found = cv2.LUT(np.ascontiguousarray(pixels), table.reshape(1, len(table), -1))
        return np.asarray(found, np.float32).reshape(pixels.shape)
    if pixels.ndim == 2:
        return table[pixels]
    return np.stack([table[pixels[..., k], k] for k in range(3)], axis=-1)


@dataclass(frozen=True)
class Cutout:
    """Where there is a surface: where a picture's alpha is at least `cutoff`."""

    source: int  # which of the file's pictures
    alpha: NDArray = field(compare=False, repr=False)  # (h, w) from 0 to 1
    cutoff: float
    wrap: tuple[str, str] = ("repeat", "repeat")
    lie: Lie = Lie()
    _outlines: dict[tuple[int, int], Outline] = field(default_factory=dict, compare=False, repr=False)
    _filled: dict[Any, Picture] = field(default_factory=dict, compare=False, repr=False)  # pictures by their source

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
        if (texture.picture.shape, texture.lie) != (self.alpha.shape, self.lie):
            return texture
        if texture.source not in self._filled:
            self._filled[texture.source] = texture.picture.changed(lambda p: grown(p, self.alpha >= self.cutoff))
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

    def material(self) -> tuple[Material, set[str]]:
        """With what is shrunk in it, in words: its pictures have no more than `MOST_PIXELS` together, and its textures,
        of which several may read the same picture, no more values than two pictures of so many."""
        pixels = sum({t.source: t.picture.shape[0] * t.picture.shape[1] for t in self.textures}.values())
        values = sum(t.count for t in self.textures)
        share = min(MOST_PIXELS / max(pixels, 1), 2 * 3 * MOST_PIXELS / max(values, 1), 1.0)
        shrunk = set[str]()

        def shown(value: Any) -> Any:
            if not isinstance(value, Texture) or share == 1:
                return value.values() if isinstance(value, Texture) else value
            rows, columns = (max(int(n * sqrt(share)), 1) for n in value.picture.shape)
            shrunk.add(f"{value.picture.shape[1]} x {value.picture.shape[0]} to {columns} x {rows}")
            return shrunk_to((columns, rows), value.values((columns, rows)))

        base_color, metallic, roughness, normal, emission = (
            shown(m) for m in (self.base_color, self.metallic, self.roughness, self.normal, self.emission)
        )
        made = Material.pbr(
            base_color, metallic, roughness, normal, emission, anisotropy=self.anisotropy,
            anisotropy_rotation=self.anisotropy_rotation, normal_scale=self.normal_scale,
            wrap=self.wrap, ior=self.ior, specular=self.specular, specular_color=self.specular_color,
        )  # fmt: skip
        return made, shrunk
