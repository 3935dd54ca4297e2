"""Linear pictures in files: Radiance .hdr and OpenEXR .exr."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def _openexr() -> Any:
    try:
        import OpenEXR
    except ImportError as error:
        raise ImportError("reading and writing .exr needs OpenEXR: pip install fastibl[exr]") from error
    return OpenEXR


def read_picture(path: Path) -> NDArray[np.float32]:
    """Linear RGB (height, width, 3) float32 of an .exr, .hdr or other float picture.

    Raises FileNotFoundError, ValueError for a file that is no linear picture, ImportError for .exr without OpenEXR.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no environment map at {path}")
    if path.suffix.lower() == ".exr":
        return _read_exr(path)
    import cv2

    try:
        image = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
    except cv2.error:  # a size that it does not believe
        image = None
    if image is None:
        raise ValueError(f"{path} is not a picture that can be read; expected an equirectangular .hdr or .exr")
    if image.dtype != np.float32:
        raise ValueError(f"{path} holds {image.dtype} values; an environment map needs linear radiance (.hdr, .exr)")
    return np.ascontiguousarray(image[..., ::-1])


def write_picture(path: Path, image: NDArray[np.float32]) -> None:
    """Writes linear RGB (height, width, 3): .exr exactly, .hdr with shared exponents (to 1/256 of a pixel's brightest).

    Raises ValueError for another ending, ImportError for .exr without OpenEXR.
    """
    suffix = path.suffix.lower()
    if suffix not in (".hdr", ".exr"):
        raise ValueError(f"{path} must end in .hdr or .exr")
    if suffix == ".exr":
        exr = _openexr()
        header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
        pixels = np.ascontiguousarray(image, np.float32)
        with exr.File(header, {"RGB": pixels}) as file:
            file.write(str(path))
        return
    height, width = image.shape[:2]
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    path.write_bytes(head.encode() + _rgbe(image).tobytes())


def _read_exr(path: Path) -> NDArray[np.float32]:
    exr = _openexr()
    try:
        with exr.File(str(path)) as file:
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except Exception as error:  # OpenEXR raises what its C++ side raises
        raise ValueError(f"{path} is not an OpenEXR picture that can be read: {error}") from error
    for name in ("RGB", "RGBA"):
        if name in channels:
            return np.ascontiguousarray(channels[name][..., :3], np.float32)
    if not {"R", "G", "B"} <= set(channels):
        raise ValueError(f"{path} holds the channels {', '.join(sorted(channels))}; expected R, G and B")
    return np.stack([channels[c] for c in "RGB"], axis=-1).astype(np.float32)


def _rgbe(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Shared-exponent bytes (height, width, 4), rounded to nearest: to cut off instead darkens by 0.3 %."""
    # Radiance 1.5 * 2^-127 ... 2^127; smaller is black.
    brightest = np.minimum(image.max(axis=-1), np.float32(1.7e38))
    exponent = np.frexp(brightest)[1]
    # Rounding up may need one more bit.
    exponent += np.rint(np.ldexp(brightest.astype(np.float64), 8 - exponent)) > 255
    mantissa = np.rint(np.ldexp(image.astype(np.float64), (8 - exponent)[..., None]))
    black = (brightest <= 0) | (exponent < -126)
    bytes_ = np.concatenate([np.clip(mantissa, 0, 255), (exponent + 128)[..., None]], axis=-1)
    return np.where(black[..., None], 0, bytes_).astype(np.uint8)
