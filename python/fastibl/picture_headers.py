"""Sizes of encoded pictures by their headers, so that a picture's size is known before memory is taken for it."""

from __future__ import annotations

import re
import struct

_RADIANCE = re.compile(rb"[-+]Y +(\d{1,10}) +[-+]X +(\d{1,10})[ \r]*\n")
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOF0 to SOF15 but DHT, JPG, DAC


def png_size(data: bytes) -> tuple[int, int]:
    """(width, height) of a PNG file. Raises ValueError for what is none, or is cut off."""
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 33:
        raise ValueError("it is no PNG picture")
    if data.rfind(b"IEND") < 33:
        raise ValueError("it is a PNG picture that is cut off")
    return struct.unpack(">II", data[16:24])


def jpeg_size(data: bytes) -> tuple[int, int]:
    """(width, height) of a JPEG file. Raises ValueError for what is none, or is cut off."""
    if data[:2] != b"\xff\xd8":
        raise ValueError("it is no JPEG picture")
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # fill
            at += 1
        elif marker in _JPEG_FRAMES:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            if data.rfind(b"\xff\xd9") < at:
                raise ValueError("it is a JPEG picture that is cut off")
            return width, height
        else:
            at += 2 + struct.unpack(">H", data[at + 2 : at + 4])[0]
    raise ValueError("it is a JPEG picture without a frame, or one that is cut off")


def radiance_size(data: bytes) -> tuple[int, int]:
    """(width, height) of a Radiance .hdr file. Raises ValueError for what is none."""
    # The size is the line after the header's blank line; a comment may hold one that is none.
    end = data.find(b"\n\n", 0, 65536)
    found = _RADIANCE.match(data, end + 2) if end > 0 else None
    if not data.startswith(b"#?") or not found:
        raise ValueError("it is no Radiance picture")
    return int(found[2]), int(found[1])
