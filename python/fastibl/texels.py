"""Float texels of texture files (KTX 2, DDS) by name, as "rgba16f"; see `BYTES`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

BYTES = {"rgba16f": 8, "rgb16f": 6, "rgba32f": 16, "rgb32f": 12, "r11g11b10f": 4, "rgb9e5": 4}
HALF_MAX = 65504.0


def decode(data: bytes, name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """RGB (*shape, 3) float32 of texels as they lie in a file, little-endian. data: bytes of the right length."""
    if name == "r11g11b10f":
        return _r11g11b10f(np.frombuffer(data, "<u4")).reshape(*shape, 3)
    if name == "rgb9e5":
        return _rgb9e5(np.frombuffer(data, "<u4")).reshape(*shape, 3)
    kind, channels = ("<f2" if "16f" in name else "<f4"), (4 if "rgba" in name else 3)
    return np.ascontiguousarray(np.frombuffer(data, kind).reshape(*shape, channels)[..., :3], np.float32)


def check_levels(levels: Sequence[NDArray[np.float32]]) -> int:
    """The face edge of a cube map's largest level. Raises ValueError unless levels are faces (6, n, n, 3), each half as
    wide as the one before (n >> k, at least 1)."""
    size = np.shape(levels[0])[1] if len(levels) and np.ndim(levels[0]) == 4 else 0
    for k, level in enumerate(levels):
        if np.shape(level) != (6, max(1, size >> k), max(1, size >> k), 3):
            raise ValueError(f"level {k} must be (6, n, n, 3) with n = {max(1, size >> k)}, got {np.shape(level)}")
    check_level_count(len(levels), size)
    return size


def check_level_count(count: int, size: int) -> None:
    """Raises ValueError where faces of `size` texels cannot have so many levels."""
    if not 1 <= count <= size.bit_length():
        raise ValueError(f"expected 1 to {size.bit_length()} levels from faces of {size} texels, got {count}")


def intensity(mean: float, brightest: float, most: float, usual: tuple[float, float]) -> float:
    """The number, a power of two, by which a map is divided to be stored where `most` is the largest value.

    mean, brightest: of the map. usual: means that are stored as they are. Otherwise the mean becomes about 1, unless
    the brightest value needs more.
    """
    if (usual[0] <= mean <= usual[1] and brightest <= most) or mean == 0:
        return 1.0
    return float(2.0 ** np.ceil(np.log2(max(mean, brightest / most))))


def encode_rgba16f(faces: NDArray[np.float32]) -> bytes:
    """Half floats with alpha 1; values above `HALF_MAX` are cut to that."""
    out = np.ones((*np.shape(faces)[:-1], 4), "<f2")
    out[..., :3] = np.clip(np.asarray(faces, np.float32), 0, HALF_MAX)
    return out.tobytes()


def _r11g11b10f(packed: NDArray[np.uint32]) -> NDArray[np.float32]:
    # Unsigned floats with a half's exponent: their bits are those of a half without its sign and its last mantissa
    # bits.
    halves = np.stack([(packed & 0x7FF) << 4, (packed >> 11 & 0x7FF) << 4, (packed >> 22) << 5], axis=-1)
    return halves.astype("<u2").view("<f2").astype(np.float32)


def _rgb9e5(packed: NDArray[np.uint32]) -> NDArray[np.float32]:
    # OpenGL ES 3.0, section 3.8.3.2: mantissa 2^(E - 15 - 9).
    mantissas = np.stack([packed & 0x1FF, packed >> 9 & 0x1FF, packed >> 18 & 0x1FF], axis=-1)
    return np.ldexp(mantissas.astype(np.float32), ((packed >> 27).astype(np.int32) - 24)[..., None])
