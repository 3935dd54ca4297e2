"""Equirectangular pictures of maps: the directions of their pixels, and what was seen there."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ._fastibl import CubeMap, Environment


@cache
def panorama_rays(height: int) -> NDArray[np.float32]:
    """Directions (h, 2h, 3) through the pixels, marker frame: z at the top, +y in the middle. Do not write to it."""
    y, x = (np.mgrid[:height, : 2 * height] + 0.5) / height
    azimuth, zenith = np.pi * (x - 1), np.pi * y
    across = np.sin(zenith)
    return np.stack([across * np.sin(azimuth), across * np.cos(azimuth), np.cos(zenith)], axis=-1).astype(np.float32)


def seen_map(environment: Environment) -> CubeMap:
    """A map that is 1 where a camera saw the given one, 0 elsewhere; sample it like the given one."""
    return CubeMap(np.repeat((environment.confidence > 0)[..., None], 3, axis=-1).astype(np.float32))
