"""Other primaries than those of all light in fastibl, Rec. 709 with its white, D65: what files state of them, and the
conversion. Whites are adapted by Bradford's matrix (Lindbloom, Chromatic Adaptation), so grey stays grey."""

from __future__ import annotations

import re
import struct
import warnings
import zlib
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .expected import expect

# x and y of red, green, blue and white.
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
REC2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
DISPLAY_P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
DCI_P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351)
ADOBE_RGB = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
ACES = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
ACESCG = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
_NAMED = {
    "ACEScg": ACESCG, "ACES": ACES, "Rec. 2020": REC2020, "Display P3": DISPLAY_P3, "DCI-P3": DCI_P3,
    "Adobe RGB": ADOBE_RGB, "Rec. 709": REC709,
}  # fmt: skip
_BY_CODE = {9: REC2020, 11: DCI_P3, 12: DISPLAY_P3}  # ITU-T H.273; wider than Rec. 709
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
_D50 = np.array([0.9642, 1.0, 0.8249])  # of ICC profiles
_ALIKE = 0.01  # matrices that differ from 1 by less are of Rec. 709 with its numbers rounded
_MOST_CUT = 0.01  # share of a channel's light that is cut without a word
_ODD = 0.05  # white of a profile that is farther than this from D50 is not to be believed
_MOST_PROFILE = 2**22  # bytes
_ICC = b"ICC_PROFILE\0"
# Cameras that take Adobe RGB add no profile, but this entry of EXIF, its interoperability index R03 (DCF 2.0). It may
# have either order of bytes.
_R03 = (b"\0\1\0\2\0\0\0\4R03\0", b"\1\0\2\0\4\0\0\0R03\0")

Given = str | Sequence[float]


class Stated(NamedTuple):
    """Primaries of a file."""

    name: str  # for people
    matrix: NDArray[np.float64]  # (3, 3), from them to Rec. 709


def from_chromaticities(chromaticities: Sequence[float] | NDArray[Any]) -> Stated | None:
    """Primaries by x and y of red, green, blue and white; None for those of Rec. 709.

    Raises ValueError for numbers that are no primaries.
    """
    given = np.asarray(chromaticities, np.float64).reshape(-1)
    if given.shape != (8,) or not np.isfinite(given).all() or (given[1::2] == 0).any():
        raise ValueError(f"expected x and y of red, green, blue and white, got {given.tolist()}")
    try:
        xyz_of, white = _xyz_of_rgb(given)
        adapted = _adapted(white, _xyz_of_rgb(np.array(REC709))[1])
    except np.linalg.LinAlgError:
        raise ValueError(f"{given.tolist()} lie on a line") from None
    name = next((name for name, xy in _NAMED.items() if np.abs(given - xy).max() < 2e-3), "its primaries")
    matrix = np.linalg.inv(_xyz_of_rgb(np.array(REC709))[0]) @ adapted @ xyz_of
    if not np.isfinite(matrix).all():
        raise ValueError(f"{given.tolist()} give no finite matrix")
    return _unless_rec709(name, matrix)


def given(primaries: Given) -> Stated | None:
    """Primaries by name (case, spaces, dots and hyphens do not count) or by x and y of red, green, blue and white;
    None for those of Rec. 709. Raises ValueError for others, TypeError for what is neither."""
    expect(primaries, (str, Sequence, np.ndarray), "primaries", f"one of {', '.join(_NAMED)}, or eight numbers")
    if not isinstance(primaries, str):
        return from_chromaticities(primaries)
    for name, xy in _NAMED.items():
        if _plain(primaries) == _plain(name):
            return from_chromaticities(xy)
    raise ValueError(f"primaries must be one of {', '.join(_NAMED)}, or eight numbers, got {primaries!r}")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def from_profile(profile: bytes) -> Stated | None:
    """Primaries of an ICC profile (ICC.1:2022, 7 and 9); None for those of Rec. 709, and for other profiles than RGB's
    with a matrix that takes white to D50."""
    try:
        if profile[16:24] != b"RGB XYZ " or profile[36:40] != b"acsp":
            return None
        (count,) = struct.unpack_from(">I", profile, 128)
        entries = (struct.unpack_from(">4s2I", profile, 132 + 12 * k) for k in range(min(count, 100)))
        tags = {name: profile[at : at + size] for name, at, size in entries}
        columns = [struct.unpack_from(">8x3i", tags[name]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
    except (struct.error, KeyError):
        return None
    xyz_of = np.array(columns).T / 2**16
    if np.abs(xyz_of.sum(axis=1) - _D50).max() > _ODD:
        return None
    xyz_of_709, white = _xyz_of_rgb(np.array(REC709))
    matrix = np.linalg.inv(_adapted(white, _D50) @ xyz_of_709) @ xyz_of
    return _unless_rec709(_profile_name(tags.get(b"desc", b"")) or "an ICC profile", matrix)


def of_picture(data: bytes) -> Stated | None:
    """Primaries that a PNG or JPEG picture states; None for those of Rec. 709, for other kinds of files, or where it
    states none."""
    if data[:2] == b"\xff\xd8":
        segments = list(_jpeg_segments(data))
        icc = {s[12]: s[14:] for kind, s in segments if kind == 0xE2 and s[:12] == _ICC and len(s) > 14}
        if icc:  # cut into numbered segments, where it is long
            return from_profile(b"".join(icc[number] for number in sorted(icc)))
        exif = b"".join(segment for kind, segment in segments if kind == 0xE1 and segment.startswith(b"Exif\0"))
        return from_chromaticities(ADOBE_RGB) if any(r03 in exif for r03 in _R03) else None
    chunks = dict(_png_chunks(data)) if data[:4] == b"\x89PNG" else {}
    if b"cICP" in chunks:  # in the order of PNG's third edition, 4.3
        code = chunks[b"cICP"][0] if chunks[b"cICP"] else 0
        return from_chromaticities(_BY_CODE[code]) if code in _BY_CODE else None
    if b"iCCP" in chunks:
        _, _, packed = chunks[b"iCCP"].partition(b"\0")
        try:
            return from_profile(zlib.decompressobj().decompress(packed[1:], _MOST_PROFILE))
        except zlib.error:
            return None
    if b"sRGB" in chunks or len(chunks.get(b"cHRM", b"")) != 32:
        return None
    xy = np.array(struct.unpack(">8I", chunks[b"cHRM"])) / 1e5
    try:
        return from_chromaticities([*xy[2:], *xy[:2]])
    except ValueError:
        return None


def as_rec709(
    image: NDArray[np.float32], stated: Stated | None, path: Any, stacklevel: int | None = 4
) -> NDArray[np.float32]:
    """Linear colours (..., 3) of these primaries in those of Rec. 709.

    What lies outside of Rec. 709 has negative values, which a map does not take: a warning says how much they are.
    stacklevel: that of the warning; None gives none.
    """
    if stated is None:
        return image
    out = (image @ stated.matrix.T.astype(np.float32)).astype(np.float32)
    share = [_negative_share(out[..., k]) for k in range(3)]
    if stacklevel is not None and max(share) > _MOST_CUT:
        k = int(np.argmax(share))
        warnings.warn(
            f"{path} has colours of {stated.name} beyond Rec. 709: the negative values that they become, "
            f"{share[k]:.0%} of the light in {('red', 'green', 'blue')[k]}, are cut",
            stacklevel=stacklevel,
        )
    return out


def _negative_share(channel: NDArray[np.float32]) -> float:
    """The negative values of a channel, in shares of its light."""
    known = channel[np.isfinite(channel)]
    below, above = (float(some.sum(dtype=np.float64)) for some in (known[known < 0], known[known > 0]))
    return min(-below / above, 1.0) if above > 0 else float(below < 0)


def _unless_rec709(name: str, matrix: NDArray[np.float64]) -> Stated | None:
    return None if np.abs(matrix - np.eye(3)).max() < _ALIKE else Stated(name, matrix)


def _adapted(white: NDArray[np.float64], to: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix (3, 3) of XYZ that takes one white to another."""
    return np.linalg.inv(_BRADFORD) @ np.diag((_BRADFORD @ to) / (_BRADFORD @ white)) @ _BRADFORD


def _xyz_of_rgb(chromaticities: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The matrix (3, 3) and the white's XYZ, from x and y of red, green, blue and white."""
    x, y = chromaticities[::2], chromaticities[1::2]
    every = np.stack([x / y, np.ones(4), (1 - x - y) / y])
    return every[:, :3] * np.linalg.solve(every[:, :3], every[:, 3]), every[:, 3]


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and contents of what comes before a PNG's pixels."""
    at = 8
    while at + 12 <= len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        if name == b"IDAT":
            return
        yield name, data[at + 8 : at + 8 + size]
        at += 12 + size


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Markers and contents of what comes before a JPEG's pixels."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:  # the pixels begin
        if data[at + 1] == 0xFF:  # a fill byte
            at += 1
            continue
        (size,) = struct.unpack_from(">H", data, at + 2)
        yield data[at + 1], data[at + 4 : at + 2 + size]
        at += 2 + size


def _profile_name(description: bytes) -> str:
    """The first name in a profile's description, of version 4 (mluc) or 2."""
    if description[:4] == b"mluc" and len(description) >= 28:
        size, at = struct.unpack_from(">2I", description, 20)
        name = description[at : at + size].decode("utf-16-be", "replace")
    else:
        name = description[12:].partition(b"\0")[0].decode("ascii", "replace")
    return re.sub(r"[^\x20-\x7e]", "", name)[:40].strip()
