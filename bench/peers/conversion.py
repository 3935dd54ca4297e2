"""Equirectangular pictures of 1024 x 512 to cubes of 6 x 256 squared."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.pictures import read_picture

from .. import inputs
from ..measure import Row, measure, yardstick
from .shared import nmae, over_maps

METRIC = "nMAE against 8 x 8 samples a texel (good to 0.5 %); seconds a map"
SIZE = 256


@cache
def _pictures() -> dict[str, NDArray]:
    return {name: read_picture(path) for name, path in inputs.MAPS.items()}


@cache
def _sampled() -> dict[str, NDArray]:
    """Means of 8 x 8 samples per texel, by OpenCV: shares nothing with the library."""
    out = {}
    for name, image in _pictures().items():
        fine = np.stack(_remapped(image, SIZE * 8))
        out[name] = fine.reshape(6, SIZE, 8, SIZE, 8, 3).mean(axis=(2, 4))
    return out


def _maps(size: int) -> list[tuple[NDArray, NDArray]]:
    d = fastibl.texel_directions(size).astype(np.float64)
    u = (0.5 + np.arctan2(d[..., 0], d[..., 1]) / (2 * np.pi)) * 1024 - 0.5
    v = np.arccos(np.clip(d[..., 2], -1, 1)) / np.pi * 512 - 0.5
    return [(a.astype(np.float32), b.astype(np.float32)) for a, b in zip(u, v, strict=True)]


def _remapped(image: NDArray, size: int, how: int = cv2.INTER_NEAREST) -> list[NDArray]:
    # Nearest pixels: the area-exact conversion also reads the picture as piecewise constant.
    return [cv2.remap(image, u, v, how, borderMode=cv2.BORDER_WRAP) for u, v in _maps(size)]


def opencv() -> list[Row]:
    errors = {
        name: nmae(np.stack(_remapped(image, SIZE, cv2.INTER_LINEAR)), _sampled()[name])
        for name, image in _pictures().items()
    }
    return over_maps("cv2.remap", METRIC, errors, yardstick(), "ready-made maps")


def py360convert() -> list[Row]:
    try:
        import py360convert as peer
    except ImportError as error:
        raise ImportError("pip install py360convert") from error

    def convert(image):
        return peer.e2c(image, face_w=SIZE, mode="bilinear", cube_format="list")

    images = list(_pictures().values())
    time = measure(convert, images, 9).of_cpu
    # Its faces are front, right, back, left, up and down, each in another orientation. So they are compared as a whole,
    # by the mean of their texels, and beside the others only in time.
    errors = {
        name: abs(float(np.stack(convert(image)).mean() / _sampled()[name].mean()) - 1)
        for name, image in _pictures().items()
    }
    return over_maps("py360convert e2c", "error of the plain mean of all texels; seconds a map", errors, time)


def ours() -> list[Row]:
    images = list(_pictures().values())
    time = measure(lambda image: fastibl.cubemap_from_equirect(image, size=SIZE), images, 9).of_cpu
    errors = {
        name: nmae(fastibl.cubemap_from_equirect(image, size=SIZE).faces, _sampled()[name])
        for name, image in _pictures().items()
    }
    return over_maps("cubemap_from_equirect", METRIC, errors, time)
