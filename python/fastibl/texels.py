"""Float texels of texture files (KTX 2, DDS) by name, as "rgba16f"; see `BYTES`."""

from __future__ import annotations

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


def encode_rgba16f(faces: NDArray[np.float32]) -> bytes:
    """Half floats with alpha 1; values above `HALF_MAX` are cut to that."""
    out = np.ones((*faces.shape[:-1], 4), "<f2")
    out[..., :3] = np.clip(faces, 0, HALF_MAX)
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
