"""KTX 2.0 files (.ktx2): cube maps of floats with their MIP levels.

Khronos, KTX File Format Specification 2.0, https://registry.khronos.org/KTX/specs/2.0/ktxspec.v2.html. Faces and levels
here are as they lie in the file: +x -x +y -y +z -z, row 0 on top ("rd", the only orientation that cubes may have).
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import texels
from ._fastibl import __version__
from .file_limits import check_pixels, file_bytes
from .primaries import (
    ACES,
    ACESCG,
    ADOBE_RGB,
    DISPLAY_P3,
    REC2020,
    Given,
    Stated,
    as_rec709,
    from_chromaticities,
    given,
)
from .whole_file import path_ending, write_whole

_IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
_RGBA16F = 97  # VK_FORMAT_R16G16B16A16_SFLOAT
_FORMATS = {_RGBA16F: "rgba16f", 90: "rgb16f", 109: "rgba32f", 106: "rgb32f", 122: "r11g11b10f", 123: "rgb9e5"}
_HEADER, _INDEX, _LEVEL = struct.Struct("<12s9I"), struct.Struct("<4I2Q"), struct.Struct("<3Q")
_PRIMARIES = {4: REC2020, 6: ACES, 7: ACESCG, 10: DISPLAY_P3, 11: ADOBE_RGB}  # Khronos Data Format Specification, 5.7
_SUPERCOMPRESSION = {1: "BasisLZ", 2: "Zstandard", 3: "ZLIB"}


def write_ktx2(path: str | os.PathLike[str], levels: Sequence[NDArray[np.float32]]) -> None:
    """Writes a cube map of half floats (R16G16B16A16_SFLOAT, linear BT.709 primaries, alpha 1).

    levels: faces (6, n, n, 3), each half as wide as the one before (n >> k, at least 1). Values above 65504 are cut to
    that. Raises ValueError for other shapes.
    """
    path = path_ending(path, ".ktx2")
    size = texels.check_levels(levels)
    descriptor = _descriptor()
    keys = b"".join(map(_key, ("KTXorientation", "KTXwriter"), ("rd", f"fastibl {__version__}")))
    at = _HEADER.size + _INDEX.size + _LEVEL.size * len(levels)
    index = _INDEX.pack(at, len(descriptor), at + len(descriptor), len(keys), 0, 0)
    at += len(descriptor) + len(keys)
    # The smallest level comes first; each level begins at a multiple of a texel's size.
    places: list[bytes] = []
    body = b""
    for level in reversed(levels):
        body += bytes(-(at + len(body)) % 8)
        data = texels.encode_rgba16f(level)
        places.insert(0, _LEVEL.pack(at + len(body), len(data), len(data)))
        body += data
    header = _HEADER.pack(_IDENTIFIER, _RGBA16F, 2, size, size, 0, 0, 6, len(levels), 0)
    write_whole(path, header + index + b"".join(places) + descriptor + keys + body)


def read_ktx2(path: str | os.PathLike[str], primaries: Given | None = None) -> list[NDArray[np.float32]]:
    """Reads the levels of a cube map, faces (6, n, n, 3) float32 each, largest first.

    Texels may be half, float, R11G11B10 or RGB9E5; plain, or packed by ZLIB or Zstandard. primaries: those of the
    file, whatever it states, see read_environment; others than Rec. 709's are converted. Raises FileNotFoundError,
    ValueError for another kind of file or a damaged one, ImportError for Zstandard without its package.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no KTX 2 file at {path}")
    data = file_bytes(path)
    if data[:12] != _IDENTIFIER or len(data) < _HEADER.size + _INDEX.size:
        raise ValueError(f"{path} is no KTX 2 file")
    _, kind, _, width, height, depth, layers, faces, count, packing = _HEADER.unpack_from(data)
    if faces != 6 or width != height or depth or layers:
        raise ValueError(
            f"{path} is no cube map: it has {faces} faces of {width} x {height}"
            + (f" x {depth}" if depth else "") + (f" in {layers} layers" if layers else "")
        )  # fmt: skip
    if kind not in _FORMATS:
        raise ValueError(f"{path} holds texels of VkFormat {kind}; float formats are read: {', '.join(texels.BYTES)}")
    check_pixels(path, width, height, 8)  # six faces with their levels
    count = max(count, 1)  # 0 asks the reader to make the other levels
    if count > width.bit_length() or len(data) < _HEADER.size + _INDEX.size + _LEVEL.size * count:
        raise ValueError(f"{path} says that it has {count} levels from faces of {width} texels")
    out, stated = [], _stated_primaries(data) if primaries is None else given(primaries)
    for k in range(count):
        n = max(1, width >> k)
        offset, length, _ = _LEVEL.unpack_from(data, _HEADER.size + _INDEX.size + _LEVEL.size * k)
        if offset + length > len(data):
            raise ValueError(f"{path} is cut off: level {k} ends at byte {offset + length} of {len(data)}")
        whole = 6 * n * n * texels.BYTES[_FORMATS[kind]]
        level = _unpacked(data[offset : offset + length], packing, whole, path)
        if len(level) != whole:
            raise ValueError(f"{path} is damaged: level {k} must have {whole} bytes, got {len(level)}")
        out.append(as_rec709(texels.decode(level, _FORMATS[kind], (6, n, n)), stated, path, 4 if k == 0 else None))
    return out


def _stated_primaries(data: bytes) -> Stated | None:
    """Those of the data format descriptor's basic block; None for Rec. 709, or where it states none."""
    at, length = struct.unpack_from("<2I", data, _HEADER.size)
    if length < 16 or at + 16 > len(data):
        return None
    code = data[at + 13]
    return from_chromaticities(_PRIMARIES[code]) if code in _PRIMARIES else None


def _unpacked(data: bytes, packing: int, most: int, path: Path) -> bytes:
    """The bytes of a level, at most one more than there should be, because packed data may claim any size."""
    if packing == 0:
        return data
    if packing == 3:
        try:
            return zlib.decompressobj().decompress(data, most + 1)
        except zlib.error as error:
            raise ValueError(f"{path} is damaged: {error}") from error
    if packing == 2:
        try:
            import zstandard
        except ImportError as error:
            raise ImportError(f"{path} is packed by Zstandard: pip install zstandard") from error
        try:
            window = max(1 << 23, 1 << most.bit_length())
            with zstandard.ZstdDecompressor(max_window_size=window).stream_reader(data) as stream:
                return stream.read(most + 1)
        except zstandard.ZstdError as error:
            raise ValueError(f"{path} is damaged: {error}") from error
    name = _SUPERCOMPRESSION.get(packing, f"scheme {packing}")
    raise ValueError(f"{path} is packed by {name}; plain, ZLIB and Zstandard are read")


def _descriptor() -> bytes:
    """Data format descriptor of R16G16B16A16_SFLOAT (Khronos Data Format Specification 1.3, section 5)."""
    samples = b"".join(
        struct.pack(
            "<HBB4BII", 16 * k, 15, channel | 0xC0, 0, 0, 0, 0, 0xBF800000, 0x3F800000
        )  # float, signed, -1 to 1
        for k, channel in enumerate((0, 1, 2, 15))
    )
    # Basic descriptor block, version 2; RGBSDA, BT.709, linear, straight alpha; 1 x 1 texel of 8 bytes.
    block = struct.pack("<IHH12B4x", 0, 2, 24 + len(samples), 1, 1, 1, 0, 0, 0, 0, 0, 8, 0, 0, 0) + samples
    return struct.pack("<I", 4 + len(block)) + block


def _key(name: str, value: str) -> bytes:
    entry = name.encode() + b"\0" + value.encode() + b"\0"
    return struct.pack("<I", len(entry)) + entry + bytes(-len(entry) % 4)
