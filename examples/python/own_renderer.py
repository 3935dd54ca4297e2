"""A renderer of one's own, in NumPy, that takes from fastibl the light and the shadow: a ball on a table.

python own_renderer.py out.png
"""

from __future__ import annotations

import sys

import cv2
import numpy as np

import fastibl
from fastibl.room import Room

CENTRE, RADIUS = np.array([0.0, 0.0, 0.05]), 0.05


def rays(width: int, height: int) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float64]], ...]:
    """Eye, and directions (height, width, 3), of a camera 40 cm away that looks down by 45°; marker frame."""
    eye = np.array([0.0, -0.28, 0.31])
    x, y = np.meshgrid((np.arange(width) + 0.5 - width / 2) / width, (np.arange(height) + 0.5 - height / 2) / width)
    s = np.sqrt(0.5)
    directions = np.stack([x, -s * y + s, -s * y - s], axis=-1)
    return eye, directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def main(arguments: list[str]) -> None:
    cube = Room().truth(size=64)
    lighting = fastibl.Lighting(cube)
    eye, d = rays(320, 240)
    points = eye - d * (eye[2] / d[..., 2:])
    ratio = fastibl.shadow_ratio(cube, np.array([[*CENTRE, RADIUS]], np.float32), points[..., :2])
    radiance = 0.5 * ratio * lighting.irradiance(np.array([0.0, 0.0, 1.0])) / np.pi
    b, c = d @ (eye - CENTRE), np.sum((eye - CENTRE) ** 2) - RADIUS**2
    hit = b * b > c
    distance = -b[hit] - np.sqrt(b[hit] ** 2 - c)
    normals = (eye + distance[:, None] * d[hit] - CENTRE) / RADIUS
    shine = lighting.ggx(normals, -d[hit], roughness=0.3)
    radiance[hit] = 0.6 * lighting.irradiance(normals) / np.pi + 0.04 * shine
    encoded = 255 * np.clip(radiance / np.quantile(radiance, 0.98), 0, 1) ** (1 / 2.2)
    cv2.imwrite(arguments[0], encoded[..., ::-1].astype(np.uint8))
    print(f"wrote {arguments[0]}")


if __name__ == "__main__":
    main(sys.argv[1:])
