"""Sizes of encoded pictures from their headers, so that a picture's size is known before memory is taken for it."""

from __future__ import annotations

import re
import struct

_RADIANCE = re.compile(rb"([-+])Y +(\d{1,10}) +([-+])X +(\d{1,10})[ \r]*\n")
_BY_COLUMNS = re.compile(rb"[-+]X +\d{1,10} +[-+]Y +\d{1,10}[ \r]*\n")
_OF_RADIANCE = (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 1 / 3, 1 / 3)
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOF0 to SOF15, without DHT, JPG and DAC


def png_size(data: bytes) -> tuple[int, int]:
    """(width, height) of a PNG file. Raises ValueError for what is not PNG, or is cut off."""
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 33:
        raise ValueError("it is no PNG picture")
    if data.rfind(b"IEND") < 33:
        raise ValueError("it is a PNG picture that is cut off")
    return struct.unpack(">II", data[16:24])


def jpeg_size(data: bytes) -> tuple[int, int]:
    """(width, height) of a JPEG file. Raises ValueError for what is not JPEG, or is cut off."""
    if data[:2] != b"\xff\xd8":
        raise ValueError("it is no JPEG picture")
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # a fill byte
            at += 1
        elif marker in _JPEG_FRAMES:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            if data.rfind(b"\xff\xd9") < at:
                raise ValueError("it is a JPEG picture that is cut off")
            return width, height
        else:
            at += 2 + struct.unpack(">H", data[at + 2 : at + 4])[0]
    raise ValueError("it is a JPEG picture without a frame, or one that is cut off")


def _bmp_size(data: bytes) -> tuple[int, int]:
    # The older header has 12 bytes; a negative height means that rows run from the top.
    old = struct.unpack_from("<I", data, 14)[0] == 12
    width, height = struct.unpack_from("<HH" if old else "<ii", data, 18)
    return abs(width), abs(height)


def _tiff_size(data: bytes) -> tuple[int, int]:
    """The size of the first picture (TIFF 6.0, and BigTIFF, whose counts and offsets have 8 bytes)."""
    order = "<" if data[:2] == b"II" else ">"
    big = struct.unpack_from(order + "H", data, 2)[0] == 43
    (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
    (count,) = struct.unpack_from(order + ("Q" if big else "H"), data, at)
    sizes = {}
    for k in range(min(count, 2**16)):
        entry = at + (8 + 20 * k if big else 2 + 12 * k)
        tag, kind = struct.unpack_from(order + "HH", data, entry)
        if tag in (256, 257):
            (sizes[tag],) = struct.unpack_from(order + _TIFF_WHOLE[kind], data, entry + (12 if big else 8))
    return sizes[256], sizes[257]


def camera_picture_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) of a PNG, JPEG, BMP or TIFF file; None for other kinds. Raises ValueError for a damaged file."""
    size_of = next((size for start, size in _STARTS.items() if data.startswith(start)), None)
    try:
        return size_of(data) if size_of else None
    except (struct.error, KeyError):
        raise ValueError("its header is damaged or cut off") from None


def radiance_size(data: bytes) -> tuple[int, int]:
    """(width, height) of a Radiance .hdr file. Raises ValueError for any other file."""
    found = _radiance_head(data)
    return int(found[4]), int(found[2])


def radiance_upright(data: bytes) -> tuple[bytes, tuple[int, ...], tuple[float, ...]]:
    """A Radiance .hdr file with a plain header, which says that it runs from the upper left; the axes along which it
    does not; its exposures.

    The exposures of red, green and blue are the products of its EXPOSURE and COLORCORR lines. Values in the file are
    radiance times these (Ward, Radiance picture files). Raises ValueError for any other file, or one that runs by
    columns or holds XYZ.
    """
    found = _radiance_head(data)
    head = data[: found.start()]
    form = re.search(rb"^FORMAT=(.*?)\s*$", head, re.MULTILINE)
    if form and form[1].strip() != b"32-bit_rle_rgbe":
        raise ValueError(f"its FORMAT is {form[1].decode(errors='replace').strip()}; expected 32-bit_rle_rgbe")
    exposures = [1.0, 1.0, 1.0]
    for name, line in re.findall(rb"^(EXPOSURE|COLORCORR)=([-+.\deE\s]+)$", head, re.MULTILINE):
        try:
            factors = [float(value) for value in line.split()]
        except ValueError:
            continue
        if len(factors) == (1 if name == b"EXPOSURE" else 3):
            exposures = [e * f for e, f in zip(exposures, factors * 3, strict=False)]
    flips = tuple(axis for axis, sign in ((0, b"+"), (1, b"-")) if found[1 if axis == 0 else 3] == sign)
    upright = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (int(found[2]), int(found[4]))
    return upright + data[found.end() :], flips, tuple(e if 1e-30 < e < 1e30 else 1.0 for e in exposures)


def radiance_primaries(data: bytes) -> list[float] | None:
    """x and y of red, green, blue and white that a Radiance .hdr file states. Raises ValueError for any other file.

    None where it states nothing: no PRIMARIES line, only zeros (as Photoshop writes), or Radiance's own, which a file
    without that line has as well; programs take both for Rec. 709.
    """
    head = data[: _radiance_head(data).start()]
    found = re.findall(rb"^PRIMARIES=([-+.\deE\s]+)$", head, re.MULTILINE)
    try:
        stated = [float(value) for value in found[-1].split()] if found else []
    except ValueError:
        return None
    own = len(stated) == 8 and all(abs(s - o) < 2e-3 for s, o in zip(stated, _OF_RADIANCE, strict=True))
    return stated if any(stated) and not own else None


_TIFF_WHOLE = {3: "H", 4: "I", 16: "Q"}
_STARTS = {
    b"\x89PNG": png_size, b"\xff\xd8": jpeg_size, b"BM": _bmp_size, b"II*\0": _tiff_size, b"MM\0*": _tiff_size,
    b"II+\0": _tiff_size, b"MM\0+": _tiff_size,
}  # fmt: skip


def _radiance_head(data: bytes) -> re.Match[bytes]:
    # The size is in the line after the header's blank line; a comment may contain something like it.
    blank = re.search(rb"\n\r?\n", data[:65536])
    if data.startswith(b"#?") and blank:
        found = _RADIANCE.match(data, blank.end())
        if found:
            return found
        if _BY_COLUMNS.match(data, blank.end()):
            raise ValueError("it runs by columns (X before Y); pictures are read that run by rows")
    raise ValueError("it is no Radiance picture")
