"""Cameras that look in some direction, and their pictures of functions of direction."""

import numpy as np

from .._fastibl import Camera, texel_directions
from ..viewpoint import looking as looking


def camera_of(width=128, height=96, degrees=80.0, **others):
    """A camera whose picture is `degrees` wide."""
    f = width / 2 / np.tan(np.radians(degrees / 2))
    return Camera(width, height, f, f, width / 2, height / 2, **others)


def rays_of(camera, pose, split=1):
    """Unit directions (h * split, w * split, 3) through the pixels, marker frame."""
    x, y = np.meshgrid(np.arange(camera.width * split), np.arange(camera.height * split))
    rays = camera.unproject((np.stack([x, y], axis=-1) + 0.5) / split) @ pose.rotation
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def picture_of(radiance, camera, pose, split=1):
    """Linear picture (h, w, 3) of radiance(directions); each pixel is the mean of split x split rays."""
    light = np.asarray(radiance(rays_of(camera, pose, split)), np.float64)
    return light.reshape(camera.height, split, camera.width, split, 3).mean(axis=(1, 3))


def exposed(light, camera, exposure=1.0):
    """8-bit picture of linear light, with the camera's gain, vignetting and response."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    r2 = ((x - camera.cx) / camera.fx) ** 2 + ((y - camera.cy) / camera.fy) ** 2
    vignette = 1 + sum(v * r2 ** (k + 1) for k, v in enumerate(camera.vignetting))
    linear = np.clip(light * (exposure * camera.gain * np.asarray(vignette)[..., None]), 0, 1)
    return np.round(camera.response.encode(linear) * 255).astype(np.uint8)


def all_around(steps=8):
    """Directions in which pictures 80 degrees wide cover the sphere."""
    turns = 2 * np.pi * np.arange(steps) / steps
    level = [(np.cos(a), np.sin(a), z) for z in (-0.7, 0.0, 0.7) for a in turns]
    return [*level, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]


def place_light(d):
    """Radiance (..., 3) of a place: a gradient, a window and a lamp of 6 degrees."""
    d = np.asarray(d)
    sky = 0.3 + 0.25 * d[..., 0] + 0.15 * d[..., 1] * d[..., 2]
    window = (np.abs(d[..., 1]) < 0.3) & (np.abs(d[..., 2] - 0.4) < 0.2) & (d[..., 0] > 0)
    lamp = d @ np.array([0.0, 0.6, 0.8]) > np.cos(np.radians(6))
    level = np.where(lamp, 60.0, np.where(window, 4.0, sky))
    return level[..., None] * np.array([1.0, 0.9, 0.7])


def place_map(size):
    """The map of place_light: faces (6, size, size, 3), each texel the mean of 4 x 4."""
    n = 4 * size
    faces = place_light(texel_directions(n)).astype(np.float32)
    return faces.reshape(6, size, 4, size, 4, 3).mean(axis=(2, 4))
