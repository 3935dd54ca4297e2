"""Pictures and films of a camera in files: the sensor's pixels as they lie in the file, and a film's own times.

A telephone does not turn its pictures; it notes beside them how they are to be held (EXIF's orientation, a film's
rotation). A lens belongs to the sensor's pixels, however the telephone was held, so the note is not followed unless it
is asked for.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .file_limits import check_pixels, file_bytes
from .picture_headers import camera_picture_size
from .whole_file import path_ending, write_whole

_PERIOD = 1 / 30  # seconds between pictures, where a film does not tell its rate
_MOST_DESCRIBED = 64 * 2**20  # bytes
_MOST_BEFORE_PICTURES = 2**20  # bytes
_MATROSKA = b"\x1a\x45\xdf\xa3"
_FILMS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".3gp", ".mts")
HDR_ADVICE = "it is read in 8 bits, white from two stops below its brightest on; film without HDR, or convert it first"
_HDR = {16: "PQ", 18: "HLG"}  # transfer characteristics of ITU-T H.273
_BT709 = 1  # matrix coefficients of ITU-T H.273
# Where films say their transfer characteristics and matrix: after the primaries in a box of ISO/IEC 14496-12 (.mp4) or
# of Apple's QuickTime File Format (.mov); in elements of Matroska, which come before the pictures, the clusters.
_CURVE_OF_BOX = re.compile(rb"colr(?:nclx|nclc)..(..)", re.DOTALL)
_MATRIX_OF_BOX = re.compile(rb"colr(?:nclx|nclc)....(..)", re.DOTALL)
_CURVE_OF_MATROSKA = re.compile(rb"\x55\xba\x81(.)", re.DOTALL)
_MATRIX_OF_MATROSKA = re.compile(rb"\x55\xb1\x81(.)", re.DOTALL)
_CLUSTER = b"\x1f\x43\xb6\x75"


def read_pixels(path: str | os.PathLike[str], any_depth: bool = False, upright: bool = False) -> NDArray[Any]:
    """RGB (height, width, 3) uint8 of a picture file.

    any_depth: whether to give uint16 and float32 for files that hold more than 8 bits, which are otherwise cut to 8.
    upright: whether to turn a picture as EXIF says; otherwise it is as the sensor took it.
    Raises ValueError, with the path, for what cannot be read, or is larger than fastibl.file_limits allows.
    """
    import cv2

    try:
        data = file_bytes(Path(path))
        size = camera_picture_size(data)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} is not a picture that can be read: {error}") from error
    if size is not None:
        check_pixels(Path(path), *size)
    try:
        bgr = decode_pixels(np.frombuffer(data, np.uint8), any_depth, upright)
    except cv2.error:
        bgr = None
    if bgr is None:
        raise ValueError(f"{path} is not a picture that can be read")
    return np.ascontiguousarray(bgr[..., ::-1])


def decode_pixels(data: NDArray[np.uint8], any_depth: bool = False, upright: bool = False) -> NDArray[Any] | None:
    """BGR (height, width, 3) of an encoded picture, as read_pixels() reads it. cv2.error for a size beyond belief."""
    import cv2

    if not data.size:
        return None
    flags = cv2.IMREAD_COLOR | (cv2.IMREAD_ANYDEPTH if any_depth else 0)
    flags |= 0 if upright else cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.imdecode(data, flags)


def write_pixels(path: str | os.PathLike[str], picture: NDArray[Any]) -> None:
    """Writes a picture (height, width, 3 or 4) RGB or RGBA, uint8 or uint16, either whole or not at all.

    path: ends in .png, or in .jpg or .jpeg, which have 8 bits and no alpha. Raises ValueError for another ending.
    """
    import cv2

    kind = path_ending(path, ".png", ".jpg", ".jpeg").suffix.lower()
    if kind != ".png":
        picture = as_bytes(picture)[..., :3]
    order = [2, 1, 0, 3][: picture.shape[2]]
    options = [] if kind == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 95]
    ok, encoded = cv2.imencode(kind, np.ascontiguousarray(picture[..., order]), options)
    if not ok:
        raise OSError(f"{path}: the picture cannot be encoded")
    write_whole(path, encoded.tobytes())


def as_bytes(picture: NDArray[Any]) -> NDArray[np.uint8]:
    """Converts a picture of 8 or 16 bits to 8 bits, for viewing."""
    return picture if picture.dtype == np.uint8 else np.rint(picture / 257).astype(np.uint8)


def open_film(path: str | os.PathLike[str]) -> Any:
    """Opens a cv2.VideoCapture of a film, or what behaves like one."""
    import cv2

    film = cv2.VideoCapture(os.fspath(path))
    film.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    if knows_bt601_alone() and _stated(path, _MATRIX_OF_BOX, _MATRIX_OF_MATROSKA) == _BT709:
        return FilmOfBt709(film)
    return film


def knows_bt601_alone() -> bool:
    """Whether OpenCV takes all films for BT.601's, as it did before 4.13 and FFmpeg 8 (opencv/opencv, issue 20513)."""
    import cv2

    version = tuple(map(int, re.findall(r"\d+", cv2.__version__)[:2]))
    scaler = re.search(r"swscale:\s+YES \((\d+)", cv2.getBuildInformation())
    return version < (4, 13) or (scaler is not None and int(scaler[1]) < 9)


class FilmOfBt709:
    """A cv2.VideoCapture of a film of BT.709 whose pictures OpenCV makes by BT.601's matrix; these are BT.709's.

    Codes that OpenCV has cut at 0 or 255 stay wrong.
    """

    def __init__(self, film: Any):
        self._film = film

    def __getattr__(self, name: str) -> Any:
        return getattr(self._film, name)

    def read(self) -> tuple[bool, Any]:
        return self._right(*self._film.read())

    def retrieve(self) -> tuple[bool, Any]:
        return self._right(*self._film.retrieve())

    def _right(self, read: bool, picture: Any) -> tuple[bool, Any]:
        import cv2

        return (read, cv2.transform(picture, _BT709_FROM_BT601)) if read and picture is not None else (read, picture)


def _bgr_from_luma(red: float, blue: float) -> NDArray[np.float64]:
    """Takes Y, Cb, Cr to blue, green, red (ITU-R BT.709, 3), by the shares of red and blue in Y."""
    green = 1 - red - blue
    of_blue, of_red = 2 * (1 - blue), 2 * (1 - red)
    return np.array([[1, of_blue, 0], [1, -blue * of_blue / green, -red * of_red / green], [1, 0, of_red]])


_BT709_FROM_BT601 = _bgr_from_luma(0.2126, 0.0722) @ np.linalg.inv(_bgr_from_luma(0.299, 0.114))


def is_film(device: object) -> bool:
    """Whether a camera is a film in a file; a number, a URL or a device in /dev is not."""
    return isinstance(device, str | os.PathLike) and Path(device).is_file()


def film_size(path: str | os.PathLike[str]) -> tuple[int, int]:
    """Size (width, height) of a film's first picture. Raises ValueError where it has none."""
    film = open_film(path)
    read, picture = film.read()
    film.release()
    if not read or picture is None:
        raise ValueError(f"the video {path} holds no picture")
    return picture.shape[1], picture.shape[0]


def is_film_name(path: str | os.PathLike[str]) -> bool:
    """Whether a file's name ends like that of a film."""
    return Path(path).suffix.lower() in _FILMS


def hdr_curve(path: str | os.PathLike[str]) -> str | None:
    """ "HLG" or "PQ" for a film (.mp4, .mov, .mkv, .webm) that says that its codes follow such a curve."""
    code = _stated(path, _CURVE_OF_BOX, _CURVE_OF_MATROSKA)
    return None if code is None else _HDR.get(code)


def _stated(path: str | os.PathLike[str], in_box: re.Pattern[bytes], in_matroska: re.Pattern[bytes]) -> int | None:
    """A code of ITU-T H.273 that a film states; None where it states none."""
    with open(path, "rb") as file:
        described = _film_description(file)
    found = (in_matroska if described.startswith(_MATROSKA) else in_box).search(described)
    return None if found is None else int.from_bytes(found[1], "big")


def _film_description(file: BinaryIO) -> bytes:
    """The "moov" box of an MP4 or MOV file, which may follow all of its pictures, or what a Matroska file has before
    its pictures; empty for other files."""
    end = os.fstat(file.fileno()).st_size
    while len(head := file.read(16)) >= 8:
        size, kind, extended = int.from_bytes(head[:4], "big"), head[4:8], head[8:]
        begin = file.tell() - len(head)
        if begin == 0 and head.startswith(_MATROSKA):
            return (head + file.read(_MOST_BEFORE_PICTURES)).partition(_CLUSTER)[0]
        size = int.from_bytes(extended, "big") if size == 1 else size
        if kind == b"moov":
            file.seek(begin)
            return file.read(min(size or _MOST_DESCRIBED, _MOST_DESCRIBED))
        if size < 8 or begin + size > end:  # the last box, or no box of such a file
            break
        file.seek(begin + size)
    return b""


class FilmTimes:
    """Seconds since a film's first picture, as the file says for each: telephones change their rate with the light.

    A picture for which the file says nothing new is one period after the one before. fps: used instead of the file's
    times.
    """

    def __init__(self, film: Any, fps: float | None = None):
        import cv2

        rate = fps or film.get(cv2.CAP_PROP_FPS)
        self.period = 1 / rate if 0 < rate < np.inf else _PERIOD
        self._film, self._told = film, fps is None
        self._first: float | None = None
        self._last, self._count = 0.0, 0

    def next(self) -> float:
        """Time of the picture that was just grabbed; call it exactly once for each picture."""
        import cv2

        count, self._count = self._count, self._count + 1
        if not self._told:
            return count * self.period
        said = self._film.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if self._first is None:
            self._first = said
            return 0.0
        time = said - self._first
        self._last = time if self._last < time < np.inf else self._last + self.period
        return self._last
