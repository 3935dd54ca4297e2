"""The layers of a frame's picture, as a file for a compositing program."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import PictureLayers, Response
from .expected import expect
from .pictures import unit, write_exr
from .whole_file import path_ending

_MOST = np.float32(np.finfo(np.float16).max)


def write_layers(
    path: str | os.PathLike[str],
    layers: PictureLayers,
    plate: NDArray[Any] | None = None,
    response: Response | None = None,
) -> None:
    """Writes the layers of a frame, `Session.layers`, as a linear .exr of half floats.

    R, G, B, A is the object, premultiplied, and ratio.R, ratio.G, ratio.B is the factor on the plate before the object
    is laid over it: plate * ratio * (1 - A) + RGB is the frame's picture in linear light, where 1 is the white of the
    camera's response. plate: the back picture, (h, w, 3) RGB of 8 or 16 bits, or linear floats, as it was given to the
    session; plate.R, plate.G, plate.B is this picture in linear light. response: of the back camera (default: sRGB).
    Raises ValueError for another ending or a plate of another size, ImportError without OpenEXR.
    """
    expect(layers, PictureLayers, "layers")
    path = path_ending(path, ".exr")
    parts = {"": layers.object, "ratio.": layers.ratio}
    if plate is not None:
        if plate.shape != layers.ratio.shape:
            raise ValueError(f"the plate must be {layers.ratio.shape}, as the layers are, got {plate.shape}")
        encoded = plate.dtype.kind != "f"
        parts["plate."] = (response or Response.srgb()).decode(unit(plate)) if encoded else plate
    channels = {}
    for name, part in parts.items():
        for k, c in enumerate("RGBA"[: part.shape[2]]):
            channels[name + c] = np.minimum(part[..., k], _MOST).astype(np.float16)
    write_exr(path, channels)
