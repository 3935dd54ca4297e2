"""glTF 2.0 files (.glb, .gltf) with a map as their light: extension EXT_lights_image_based.

https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Vendor/EXT_lights_image_based. Its text leaves open how
RGBD is encoded, how faces are flipped, the sign of the harmonics and the handedness of the cube; here they follow
Babylon.js, with which Microsoft and Adobe wrote the extension. According to the text, the light's intensity is a
"brightness multiplier for environment": images and harmonics hold the map divided by it.
"""

from __future__ import annotations

import base64
import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import texels
from ._fastibl import CubeMap, Environment, __version__
from .axes import handed, radiance_of, to_axes
from .lighting import Lighting
from .sh_files import COSINE, rounded
from .whole_file import path_ending, write_whole

NAME = "EXT_lights_image_based"
_RANGE = 255.0  # range of RGBD: one over the smallest alpha
_GAMMA = 2.2
_USUAL = (1 / 32, 8)  # range of mean radiance in which maps are written as they are
_SMALLEST = 16  # face edge of the roughest level, as the extension proposes
# The harmonics have the Condon-Shortley phase, as Babylon.js evaluates them.
_PHASE = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1])


def check_gltf_size(size: int) -> None:
    if size < 2 * _SMALLEST or size & (size - 1):
        raise ValueError(f"for a glTF light, size must be a power of two of at least {2 * _SMALLEST}, got {size}")


def write_gltf_light(
    path: str | os.PathLike[str], cube: CubeMap | Environment, size: int = 128, error: float = 0.002
) -> None:
    """Writes a map as the light of a glTF scene without objects: EXT_lights_image_based, in a .glb or .gltf.

    size: face edge of the sharpest level, a power of two of 32 or more; levels follow down to 16 texels, for roughness
    0 to 1 in even steps, as PNG in RGBD: 8 bits per channel, up to 255 times the light's intensity. What is brighter is
    cut to that in the sharpest level, but not in the other levels and the harmonics. The intensity is 1 for maps with a
    mean radiance of 1/32 to 8, else a power of two near that mean; it is larger where a rough level needs it. error:
    that of the levels, see Lighting.prefiltered. The map is in glTF's axes (y up). Raises ValueError for another size
    or ending.
    """
    path = path_ending(path, ".glb", ".gltf")
    check_gltf_size(size)
    turned = to_axes(radiance_of(cube), "gltf")
    levels = Lighting(turned).prefiltered(size, (size // _SMALLEST).bit_length(), mapping="gltf", error=error)
    # The extension's readers use left-handed cube coordinates, for the harmonics as well as for the faces.
    mirrored = [handed(level, "left").faces for level in levels if level is not None]
    harmonics = Lighting(handed(turned, "left")).sh9.astype(np.float64) * (COSINE * _PHASE)[:, None]
    brightest = max(float(faces.max()) for faces in mirrored[1:])  # of the rough levels
    intensity = texels.intensity(float(np.mean(turned.mean())), brightest, _RANGE, _USUAL)
    # The faces are "flipped" because readers flip them back.
    pictures = [[_png(rgbd(face[::-1] / np.float32(intensity))) for face in faces] for faces in mirrored]
    _write(path, _light(size, harmonics / intensity, len(pictures), intensity), sum(pictures, []))


def rgbd(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """RGBA bytes (..., 4) of linear RGB from 0 to 255: (linear alpha)^(1/2.2), with alpha the largest that fits."""
    brightest = np.maximum(linear.max(axis=-1, keepdims=True), 1e-6)
    alpha = np.clip(np.floor(_RANGE / brightest), 1, 255)
    color = np.rint(255 * np.clip(linear * alpha / 255, 0, 1) ** (1 / _GAMMA))
    return np.concatenate([color, alpha], axis=-1).astype(np.uint8)


def _png(rgba: NDArray[np.uint8]) -> bytes:
    import cv2

    return cv2.imencode(".png", np.ascontiguousarray(rgba[..., [2, 1, 0, 3]]))[1].tobytes()


def _light(size: int, harmonics: NDArray[np.float64], levels: int, intensity: float) -> dict[str, Any]:
    return {
        "name": "fastibl",
        "intensity": intensity,
        "rotation": [0, 0, 0, 1],
        "irradianceCoefficients": rounded(harmonics),
        "specularImageSize": size,
        "specularImages": [[6 * k + face for face in range(6)] for k in range(levels)],
    }


def _write(path: Path, light: dict[str, Any], pictures: list[bytes]) -> None:
    content: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"fastibl {__version__}"},
        "extensionsUsed": [NAME],
        "extensions": {NAME: {"lights": [light]}},
        "scene": 0,
        "scenes": [{"name": "light", "extensions": {NAME: {"light": 0}}}],
    }
    if path.suffix.lower() == ".gltf":
        uris = (f"data:image/png;base64,{base64.b64encode(data).decode()}" for data in pictures)
        content["images"] = [{"uri": uri} for uri in uris]
        write_whole(path, json.dumps(content))
        return
    body, content["bufferViews"] = b"", []
    for data in pictures:
        content["bufferViews"].append({"buffer": 0, "byteOffset": len(body), "byteLength": len(data)})
        body += data + bytes(-len(data) % 4)
    content["images"] = [{"bufferView": k, "mimeType": "image/png"} for k in range(len(pictures))]
    content["buffers"] = [{"byteLength": len(body)}]
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(body))
    write_whole(
        path,
        header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body,
    )
