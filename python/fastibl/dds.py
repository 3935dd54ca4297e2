"""DDS files (.dds): cube maps of floats with their MIP levels.

Microsoft, Programming Guide for DDS, https://learn.microsoft.com/windows/win32/direct3ddds/dx-graphics-dds-pguide.
Faces and levels here are as they lie in the file: +x -x +y -y +z -z, row 0 on top. Plain texels are read and written
here, because no maintained library does it; BC6H is read by OpenImageIO.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import texels
from .file_limits import check_pixels, file_bytes
from .primaries import Given, as_rec709, given
from .whole_file import path_ending, write_whole

_HEADER = struct.Struct("<4s7I44x2I4s5I5I")
_DX10 = struct.Struct("<5I")
_RGBA16F = 10  # DXGI_FORMAT_R16G16B16A16_FLOAT
_DXGI = {
    2: "rgba32f",
    6: "rgb32f",
    _RGBA16F: "rgba16f",
    26: "r11g11b10f",
    67: "rgb9e5",
    95: "bc6h",
    96: "bc6h",
}  # DXGI_FORMAT
_D3D9 = {113: "rgba16f", 116: "rgba32f"}  # D3DFORMAT, which stands in place of a FourCC
_CUBE, _ALL_FACES, _DX10_CUBE = 0x200, 0xFC00, 0x4
_FIELDS = 0x2100F  # caps, height, width, pitch, pixel format and number of levels are given
_FOURCC, _TEXTURE_2D = 0x4, 3
_COMPLEX, _TEXTURE, _MIPMAP = 0x8, 0x1000, 0x400000


def write_dds(path: str | os.PathLike[str], levels: Sequence[NDArray[np.float32]]) -> None:
    """Writes a cube map of half floats (R16G16B16A16_FLOAT, alpha 1), with Direct3D 10's header.

    levels: faces (6, n, n, 3), each half as wide as the one before (n >> k, at least 1). Values above 65504 are cut to
    that. Raises ValueError for other shapes.
    """
    path = path_ending(path, ".dds")
    size = texels.check_levels(levels)
    pitch = size * texels.BYTES["rgba16f"]
    header = _HEADER.pack(
        b"DDS ", 124, _FIELDS, size, size, pitch, 0, len(levels), 32, _FOURCC, b"DX10", 0, 0, 0, 0, 0,
        _COMPLEX | _TEXTURE | _MIPMAP, _CUBE | _ALL_FACES, 0, 0, 0,
    )  # fmt: skip
    header += _DX10.pack(_RGBA16F, _TEXTURE_2D, _DX10_CUBE, 1, 0)
    # Face by face, each with its levels.
    body = b"".join(texels.encode_rgba16f(level[face]) for face in range(6) for level in levels)
    write_whole(path, header + body)


def read_dds(path: str | os.PathLike[str], primaries: Given | None = None) -> list[NDArray[np.float32]]:
    """Reads the levels of a cube map, faces (6, n, n, 3) float32 each, largest first.

    Texels may be half, float, R11G11B10 or RGB9E5; of BC6H, only the largest level is read. primaries: those of
    the file, if not Rec. 709's, which are converted. Raises FileNotFoundError,
    ValueError for another kind of file or a damaged one, ImportError for BC6H without OpenImageIO.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no DDS file at {path}")
    stated = None if primaries is None else given(primaries)
    data = file_bytes(path)
    name, size, count, at = _described(data, path)
    sizes = [max(1, size >> k) for k in range(count)]
    lengths = [_bytes(n, name) for n in sizes]
    if len(data) < at + 6 * sum(lengths):
        raise ValueError(f"{path} is cut off: expected {at + 6 * sum(lengths)} bytes, got {len(data)}")
    if name == "bc6h":
        return [as_rec709(_read_bc6h(path, size), stated, path)]
    out: list[NDArray[np.float32]] = []
    for n, length in zip(sizes, lengths, strict=True):
        starts = range(at, at + 6 * sum(lengths), sum(lengths))  # face by face, each face with its levels
        level = np.stack([texels.decode(data[begin : begin + length], name, (n, n)) for begin in starts])
        out.append(as_rec709(level, stated, path, None if out else 4))
        at += length
    return out


def _described(data: bytes, path: Path) -> tuple[str, int, int, int]:
    """The kind of texels, face edge, number of levels, and the place where the texels begin, from a cube map's
    header."""
    if len(data) < _HEADER.size or data[:4] != b"DDS ":
        raise ValueError(f"{path} is no DDS file")
    fields = _HEADER.unpack_from(data)
    height, width, count = fields[3], fields[4], max(fields[7], 1)
    four, bits, sides = fields[10], fields[11], fields[17]
    at = _HEADER.size
    if four == b"DX10":
        if len(data) < at + _DX10.size:
            raise ValueError(f"{path} is cut off within its header")
        code, _, misc, many, _ = _DX10.unpack_from(data, at)
        at += _DX10.size
        cube, name, said = bool(misc & _DX10_CUBE) and many == 1, _DXGI.get(code), f"DXGI_FORMAT {code}"
    else:
        code = struct.unpack("<I", four)[0]
        cube, name = bool(sides & _CUBE) and sides & _ALL_FACES == _ALL_FACES, _D3D9.get(code)
        said = f"FourCC {four!r}" if code else f"{bits} bits, not float"
    if not cube or width != height:
        raise ValueError(f"{path} is no cube map of six square faces ({width} x {height})")
    if name is None:
        raise ValueError(f"{path} holds texels of {said}; float formats are read: {', '.join(texels.BYTES)}, bc6h")
    check_pixels(path, width, height, 8)  # six faces with their levels
    if count > width.bit_length():
        raise ValueError(f"{path} says that it has {count} levels from faces of {width} texels")
    return name, width, count, at


def _bytes(n: int, name: str) -> int:
    """The bytes of one face that is n texels wide."""
    if name == "bc6h":
        return 16 * (-(-n // 4)) ** 2  # blocks of 4 x 4
    return n * n * texels.BYTES[name]


def _read_bc6h(path: Path, n: int) -> NDArray[np.float32]:
    try:
        import OpenImageIO
    except ImportError as error:
        raise ImportError(f"{path} holds BC6H texels: pip install OpenImageIO") from error
    file = OpenImageIO.ImageInput.open(str(path))
    if file is None:
        raise ValueError(f"{path} is damaged: {OpenImageIO.geterror()}")
    strip = file.read_image(0, 0, 0, 3, "float")  # the faces, one below the other
    if strip is None or strip.shape != (6 * n, n, 3):
        raise ValueError(f"{path} is damaged: {file.geterror()}")
    return np.ascontiguousarray(strip, np.float32).reshape(6, n, n, 3)
