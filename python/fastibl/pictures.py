"""Pictures in files: linear Radiance .hdr and OpenEXR .exr, and .png and .jpg encoded by a camera's response."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Response
from .file_limits import check_file_size, check_pixels, file_bytes
from .picture_headers import jpeg_size, png_size, radiance_primaries, radiance_size, radiance_upright
from .primaries import REC709, Given, Stated, as_rec709, from_chromaticities, given, of_picture
from .whole_file import path_ending, whole_file, write_whole

LINEAR = (".hdr", ".exr")
ENCODED = (".png", ".jpg", ".jpeg")
_SIZES = {".hdr": radiance_size, ".png": png_size, ".jpg": jpeg_size, ".jpeg": jpeg_size}


def openexr() -> Any:
    """The OpenEXR module. Raises an ImportError that says what to install."""
    try:
        import OpenEXR
    except ImportError as error:
        raise ImportError("reading and writing .exr needs OpenEXR: pip install OpenEXR") from error
    return OpenEXR


def read_picture(path: Path, response: Response | None = None, primaries: Given | None = None) -> NDArray[np.float32]:
    """Reads linear RGB (height, width, 3) float32 of Rec. 709 from a picture: .hdr or .exr, or .png or .jpg with a
    response. Other primaries are converted.

    response: the camera's response, or another encoding, of a .png or .jpg; its white becomes 1.
    primaries: those of the file, whatever it states; None leaves it to the file, and is Rec. 709's where it says
    nothing. Raises FileNotFoundError, ValueError for a file that is not such a picture, is cut off, or is larger than
    fastibl.file_limits allows, ImportError for .exr without OpenEXR.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no environment map at {path}")
    suffix = path.suffix.lower()
    if suffix not in LINEAR + ENCODED:
        raise ValueError(f"{path} is no picture that is read; those end in {', '.join(LINEAR + ENCODED)}")
    if suffix in LINEAR and response is not None:
        raise ValueError(f"{path} holds linear radiance; a response goes with {', '.join(ENCODED)}")
    if suffix == ".exr":
        image, chromaticities = _read_exr(path)
        stated = _chromaticities(path, chromaticities) if primaries is None else given(primaries)
        return as_rec709(image, stated, path)
    data = file_bytes(path)
    image = decode_picture(data, _SIZES[suffix], path)
    if image.dtype == np.float32:
        stated = _chromaticities(path, radiance_primaries(data)) if primaries is None else given(primaries)
        return as_rec709(image, stated, path)
    if response is None:
        raise ValueError(
            f"{path} holds {image.dtype} values; an environment map needs linear radiance (.hdr, .exr), or the "
            "response that it was encoded by (response=fastibl.Response.srgb(), --response srgb)"
        )
    stated = of_picture(data) if primaries is None else given(primaries)
    return as_rec709(response.decode(unit(image)), stated, path)


def unit(picture: NDArray[Any]) -> NDArray[np.float32]:
    """Scales a picture of whole numbers to 0 to 1."""
    return picture.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)


def picture_size(data: bytes, size_of: Any, name: Path | str) -> tuple[int, int]:
    """(width, height) that an encoded picture's header states. size_of: one of fastibl.picture_headers.

    Raises ValueError, with the name, for another kind of picture, or for more pixels than a picture may have.
    """
    try:
        width, height = size_of(data)
    except ValueError as error:
        raise ValueError(f"{name} is not a picture that can be read: {error}") from error
    check_pixels(name, width, height)
    return width, height


def shrunk_to(size: tuple[int, int], picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """A picture of so many columns and rows, by area."""
    import cv2

    if picture.shape[1::-1] == size:
        return picture
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA)).reshape(
        size[1], size[0], *picture.shape[2:]
    )


def decode_picture(data: bytes, size_of: Any, name: Path | str) -> NDArray[Any]:
    """RGB (height, width, 3) of an encoded picture, in its own dtype, and of the size stated in its header.

    size_of: one of fastibl.picture_headers. Raises ValueError, with the name, for what cannot be read.
    """
    import cv2

    flips: tuple[int, ...] = ()
    exposures: tuple[float, ...] = (1.0, 1.0, 1.0)
    if size_of is radiance_size:
        try:
            data, flips, exposures = radiance_upright(data)
        except ValueError as error:
            raise ValueError(f"{name} is not a picture that can be read: {error}") from error
    width, height = picture_size(data, size_of, name)
    try:
        image = cv2.imdecode(
            np.frombuffer(data, np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
        )
    except cv2.error:  # raised for a size that it does not believe
        image = None
    if image is None or image.shape != (height, width, 3):
        raise ValueError(f"{name} is not a picture that can be read: it is damaged or cut off")
    image = np.flip(cv2.cvtColor(image, cv2.COLOR_BGR2RGB, dst=image), flips)
    return np.ascontiguousarray(image if exposures == (1, 1, 1) else image / np.asarray(exposures, np.float32))


def decode_alpha(data: bytes, name: Path | str) -> NDArray[Any] | None:
    """Alpha (height, width) of a .png that decode_picture reads, in its own dtype; None where it has none."""
    import cv2

    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError(f"{name} is not a picture that can be read: it is damaged or cut off")
    if image.ndim == 2 and (at := data.find(b"\0\0\0\2tRNS", 33, data.find(b"IDAT"))) > 0:
        white, coded = int(np.iinfo(image.dtype).max), 2 ** data[24] - 1  # of a grey of 1, 2 and 4 bits, 8 were made
        key = int.from_bytes(data[at + 8 : at + 10], "big") * (white // coded)
        return np.where(image == key, 0, white).astype(image.dtype)
    return np.ascontiguousarray(image[..., 3]) if image.ndim == 3 and image.shape[2] == 4 else None


def write_picture(path: str | os.PathLike[str], image: NDArray[np.float32]) -> None:
    """Writes linear RGB (height, width, 3): .exr exactly, .hdr with shared exponents (to 1/256 of a pixel's brightest).

    Raises ValueError for another ending, ImportError for .exr without OpenEXR.
    """
    path = path_ending(path, *LINEAR)
    if path.suffix.lower() == ".exr":
        write_exr(path, {"RGB": np.asarray(image, np.float32)})
        return
    height, width = image.shape[:2]
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    write_whole(path, head.encode() + _rgbe(image).tobytes())


def write_exr(path: Path, channels: dict[str, NDArray[Any]], attributes: dict[str, Any] | None = None) -> None:
    """Writes channels of float32 or float16, (height, width) or (height, width, 3 or 4), and header attributes.

    The header states the primaries of Rec. 709, for programs that work in others, as ACEScg. Raises ImportError without
    OpenEXR, OSError where the file cannot be written; an older file is then left as it was.
    """
    exr = openexr()
    header = {
        "compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage, "chromaticities": REC709, **(attributes or {})
    }  # fmt: skip
    stored = {name: np.ascontiguousarray(pixels) for name, pixels in channels.items()}
    with whole_file(path) as part, exr.File(header, stored) as file:
        try:
            file.write(str(part))
        except RuntimeError as error:
            raise OSError(f"{path} cannot be written: {error}") from error


def _read_exr(path: Path) -> tuple[NDArray[np.float32], Any]:
    """RGB of the first part that has it, and the chromaticities that its header states, or None."""
    exr = openexr()
    check_file_size(path)
    try:
        with exr.File(str(path), header_only=True) as file:
            headers = [dict(part.header) for part in file.parts]  # closing the file empties them
    except Exception as error:  # OpenEXR raises whatever its C++ side raises
        raise ValueError(f"{path} is not an OpenEXR picture that can be read: {error}") from error
    pixels = sum(_exr_pixels(path, header, exr) for header in headers)
    check_pixels(path, pixels, 1)  # the pixels of all parts together
    try:
        with exr.File(str(path), separate_channels=True) as file:
            parts = [{name: np.array(c.pixels, np.float32) for name, c in p.channels.items()} for p in file.parts]
    except Exception as error:
        raise ValueError(f"{path} is not an OpenEXR picture that can be read: {error}") from error
    if len(parts) != len(headers):
        raise ValueError(f"{path} is not an OpenEXR picture that can be read: it is damaged or cut off")
    for header, channels in zip(headers, parts, strict=True):
        if {"R", "G", "B"} <= set(channels):
            image = _displayed(np.stack([channels[c] for c in "RGB"], axis=-1), path, header)
            return image, header.get("chromaticities")
    names = sorted({name for channels in parts for name in channels})
    raise ValueError(f"{path} holds the channels {', '.join(names)}; expected R, G and B")


def _displayed(image: NDArray[np.float32], path: Path, header: dict[str, Any]) -> NDArray[np.float32]:
    """The whole picture of which the data window is a part; black around it."""
    (left, top), _ = header["dataWindow"]
    (first, upper), (last, lower) = header.get("displayWindow", header["dataWindow"])
    width, height = int(last) - int(first) + 1, int(lower) - int(upper) + 1
    x, y = int(left) - int(first), int(top) - int(upper)
    if (x, y, width, height) == (0, 0, image.shape[1], image.shape[0]):
        return image
    check_pixels(path, width, height)
    whole = np.zeros((height, width, 3), np.float32)
    part = image[max(-y, 0) : max(height - y, 0), max(-x, 0) : max(width - x, 0)]
    whole[max(y, 0) : max(y, 0) + part.shape[0], max(x, 0) : max(x, 0) + part.shape[1]] = part
    return whole


def _chromaticities(path: Path, stated: Any) -> Stated | None:
    """What a picture's header states of its primaries; with a warning, nothing, where it states what cannot be."""
    try:
        return None if stated is None else from_chromaticities(stated)
    except (TypeError, ValueError) as error:  # TypeError: of a damaged type
        warnings.warn(f"{path} states what are no primaries, and is taken for Rec. 709: {error}", stacklevel=4)
        return None


def _exr_pixels(path: Path, header: dict[str, Any], exr: Any) -> int:
    """Pixels of a part, counted again for every three channels. Raises ValueError for too many, or for a deep part."""
    if header.get("type") not in (None, exr.scanlineimage, exr.tiledimage):
        raise ValueError(f"{path} holds deep pixels; expected a flat picture")
    try:
        (left, top), (right, bottom) = (map(int, corner) for corner in header["dataWindow"])
        layers = -(-len(header["channels"]) // 3)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is not an OpenEXR picture that can be read: its header is damaged") from error
    width, height = right - left + 1, bottom - top + 1
    check_pixels(path, width, height, max(layers, 1))
    return width * height * layers


def _rgbe(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Shared-exponent bytes (height, width, 4), rounded to nearest, because cutting off would darken by 0.3 %."""
    # Radiance from 1.5 * 2^-127 to 2^127; smaller values become black.
    brightest = np.minimum(image.max(axis=-1), np.float32(1.7e38))
    exponent = np.frexp(brightest)[1]
    # Rounding up may need one more bit.
    exponent += np.rint(np.ldexp(brightest.astype(np.float64), 8 - exponent)) > 255
    mantissa = np.rint(np.ldexp(image.astype(np.float64), (8 - exponent)[..., None]))
    black = (brightest <= 0) | (exponent < -126)
    bytes_ = np.concatenate([np.clip(mantissa, 0, 255), (exponent + 128)[..., None]], axis=-1)
    return np.where(black[..., None], 0, bytes_).astype(np.uint8)
