"""DDS files (.dds): cube maps of floats with their MIP levels.

Microsoft, Programming Guide for DDS, https://learn.microsoft.com/windows/win32/direct3ddds/dx-graphics-dds-pguide.
Faces and levels here are as they lie in the file: +x -x +y -y +z -z, row 0 on top.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import texels
from .file_limits import check_pixels, file_bytes

_HEADER = struct.Struct("<4s7I44x2I4s5I5I")
_DX10 = struct.Struct("<5I")
_DXGI = {2: "rgba32f", 6: "rgb32f", 10: "rgba16f", 26: "r11g11b10f", 67: "rgb9e5"}  # DXGI_FORMAT
_D3D9 = {113: "rgba16f", 116: "rgba32f"}  # D3DFORMAT in place of a FourCC
_CUBE, _ALL_FACES, _DX10_CUBE = 0x200, 0xFC00, 0x4


def read_dds(path: str | os.PathLike[str]) -> list[NDArray[np.float32]]:
    """Levels of a cube map, faces (6, n, n, 3) float32 each, from the largest.

    Half, float, R11G11B10 and RGB9E5 texels; not BC6H, which no kept library decodes to floats. Raises
    FileNotFoundError, ValueError for what is no such file, or damaged.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no DDS file at {path}")
    data = file_bytes(path)
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
        raise ValueError(f"{path} holds texels of {said}; float formats are read: {', '.join(texels.BYTES)}")
    check_pixels(path, width, height, 8)  # six faces and their levels
    if count > width.bit_length():
        raise ValueError(f"{path} says that it has {count} levels from faces of {width} texels")
    sizes = [max(1, width >> k) for k in range(count)]
    a_face = sum(n * n for n in sizes) * texels.BYTES[name]
    if len(data) < at + 6 * a_face:
        raise ValueError(f"{path} is cut off: expected {at + 6 * a_face} bytes, got {len(data)}")
    out = []
    for n in sizes:
        length = n * n * texels.BYTES[name]
        out.append(
            np.stack([texels.decode(data[at + f * a_face : at + f * a_face + length], name, (n, n)) for f in range(6)])
        )
        at += length
    return out
