"""Materials as readers of files find them: textures, and what of a surface its texture's alpha leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Material, Response
from .cutouts import Outline, grown
from .file_limits import MOST_PIXELS
from .picture_headers import jpeg_size, png_size
from .pictures import decode_alpha, decode_picture, unit

_CLEAR, _SOLID = 0.1, 0.9  # alphas: what is blended has few texels between them if it is meant as an outline
_MOST_BETWEEN = 0.1  # of the texels
_MOST_WITHIN = 0.005  # of the texels: those of which all within two texels are between them, as in a pane of glass


class Pictures:
    """Textures as a file's materials name them; together of no more than `MOST_PIXELS`."""

    def __init__(self) -> None:
        self._pixels = 0
        self._alphas: dict[Any, NDArray[np.float32] | None] = {}
        self._cutouts: dict[Cutout, Cutout] = {}

    def decoded(self, data: bytes, name: str) -> NDArray[Any]:
        """(h, w, 3) uint8 or uint16 RGB of a PNG or JPEG. Raises ValueError, with the name, for others."""
        if data[:1] not in (b"\x89", b"\xff"):
            raise ValueError(f"{name} is neither PNG nor JPEG")
        picture = decode_picture(data, png_size if data[:1] == b"\x89" else jpeg_size, name)
        self._pixels += picture.shape[0] * picture.shape[1]
        if self._pixels > MOST_PIXELS:
            raise ValueError(f"its textures have more than {MOST_PIXELS} pixels together")
        return picture

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
