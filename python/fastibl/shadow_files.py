"""Shadows in files: the ratio of the light on the plane, and a matte for compositing."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import ShadowMap
from .expected import expect
from .pictures import write_exr
from .whole_file import path_ending, write_whole

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709
_MOST = 4096  # most texels along an edge


def write_shadow(
    path: str | os.PathLike[str], shadow: ShadowMap, extent: float | None = None, resolution: int | None = None
) -> dict[str, Any]:
    """Writes a shadow as seen from above: +y at the top, +x to the right; .exr or .png. Returns the file's description.

    .exr: R, G, B, A is a black matte with the shadow's opacity, premultiplied: laid over a linear plate, it gives the
    plate with a grey shadow. ratio.R, ratio.G, ratio.B is the ratio of the light with and without the object; a linear
    plate times this ratio is exact in colour. The header has the plane's "extent" (metres from the middle to an edge),
    "centre" (metres, marker frame) and "metresPerPixel".
    .png: 16 bits, RGB black, alpha the same opacity, which is linear, so compose it in linear light; the description is
    beside the picture as .json. Opacity is 1 minus the Rec. 709 luminance of the ratio.
    extent: half the picture's edge in metres, by default all that the shadow reaches.
    resolution: pixels along an edge, by default those of the shadow's finest map, at most 4096.
    Raises ValueError for another ending, values that are not positive, and a shadow that was not cast, ImportError for
    .exr without OpenEXR.
    """
    path = path_ending(path, ".exr", ".png")
    suffix = path.suffix.lower()
    expect(shadow, ShadowMap, "shadow")
    if extent is None and not shadow.reach > 0:
        raise ValueError("there is no shadow to write: none was cast")
    extent = float(shadow.reach if extent is None else extent)
    if not 0 < extent < np.inf:
        raise ValueError(f"extent must be positive and finite (metres), got {extent}")
    resolution = _resolution(shadow, extent) if resolution is None else int(resolution)
    if not 1 <= resolution <= _MOST:
        raise ValueError(f"resolution must be 1 to {_MOST} pixels, got {resolution}")
    ratio = _from_above(shadow, extent, resolution)
    opacity = np.clip(1 - ratio @ _LUMINANCE, 0, 1).astype(np.float32)
    about = {
        "extent": extent,
        "centre": [float(v) for v in shadow.centre],
        "metresPerPixel": 2 * extent / resolution,
        "orientation": "row 0 is +y, column 0 is -x, marker frame",
    }
    if suffix == ".exr":
        centre = np.asarray(shadow.centre, np.float32)
        attributes = {"extent": extent, "centre": centre, "metresPerPixel": 2 * extent / resolution}
        write_exr(path, _layers(ratio, opacity), attributes)
        return {"file": path.name, **about}
    _write_png(path, opacity)
    about = {"file": path.name, "alpha": "1 - ratio, linear", **about}
    write_whole(path.with_suffix(".json"), json.dumps(about, indent=1) + "\n")
    return about


def _resolution(shadow: ShadowMap, extent: float) -> int:
    maps = [(len(shadow.image), shadow.extent)]
    if shadow.fine is not None:
        maps.append((len(shadow.fine), shadow.fine_extent))
    return min(_MOST, max(1, round(max(n / half for n, half in maps) * extent)))


def _from_above(shadow: ShadowMap, extent: float, resolution: int) -> NDArray[np.float32]:
    """The ratio (n, n, 3) at the pixels' centres; row 0 is at the largest y."""
    across = ((np.arange(resolution) + 0.5) / resolution * 2 - 1) * extent
    x, y = np.meshgrid(across + shadow.centre[0], across[::-1] + shadow.centre[1])
    return shadow.sample(np.stack([x, y], axis=-1))


def _layers(ratio: NDArray[np.float32], opacity: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    black = np.zeros_like(opacity)
    layers = {"R": black, "G": black, "B": black, "A": opacity}
    return layers | {f"ratio.{c}": ratio[..., k] for k, c in enumerate("RGB")}


def _write_png(path: Path, opacity: NDArray[np.float32]) -> None:
    import cv2

    rgba = np.zeros((*opacity.shape, 4), np.uint16)
    rgba[..., 3] = np.rint(opacity * 65535)
    data = cv2.imencode(".png", rgba)[1]
    write_whole(path, data.tobytes())
