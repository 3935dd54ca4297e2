"""Films of a board for tracking: a hand-held camera, with pictures that are made fast and every disturbance on its own.

The page is warped by its homography onto 4 x 4 samples per pixel (the camera has no distortion). It is averaged,
blurred and disturbed in linear light, then given noise and encoded. It shares nothing with the tracker or the
simulator.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.extremes.board_pictures import look_at

FINE = 4  # samples along a pixel's edge
BLACK, WHITE, TABLE = 0.04, 0.85, 0.25  # in linear light
CAMERA = fastibl.Camera(640, 480, 522.0, 522.0, 320.0, 240.0)
FPS = 30.0


@dataclass(frozen=True)
class Look:
    """How a picture is taken. Lengths are in pixels, light is linear with white at 1."""

    blur: float = 0.5  # standard deviation of the lens's blur
    defocus: float = 0.0  # radius of a disc
    motion: float = 0.0  # length of a line, whose direction changes with the frame
    noise: float = 0.004  # standard deviation at white
    light: float = 1.0  # share of the light that is left; a gain makes up for it
    hidden: float = 0.0  # share of the board's area that is behind a moving thing
    shadow: bool = False  # a hard edge of shadow across the board, with 12 % of the light left
    jpeg: int = 0  # quality


def noise_deviation(light: NDArray, look: Look) -> NDArray:
    """Standard deviation of linear values: shot noise, and a part that remains in the dark. A gain of g multiplies it
    by sqrt(g)."""
    return look.noise / np.sqrt(look.light) * np.sqrt(np.clip(light, 0, 1) + 0.05)


_BOARDS: dict[tuple, fastibl.Board] = {}


@cache
def _page(key: tuple, dpi: int) -> NDArray[np.float32]:
    """Linear light of the printed page; edges between texels are exact shares of ink."""
    return BLACK + (WHITE - BLACK) / 255 * _BOARDS[key].image(dpi).astype(np.float32)


def page(board: fastibl.Board, dpi: int) -> NDArray[np.float32]:
    key = board.width, board.height, board.border_bits, tuple((tag.id, tag.corners.tobytes()) for tag in board.tags)
    _BOARDS[key] = board
    return _page(key, dpi)


def board_light(
    board: fastibl.Board, pose: NDArray, camera: fastibl.Camera = CAMERA, fine: int = FINE
) -> NDArray[np.float32]:
    """(height, width), linear, without noise. The only blur is that of the pixels, and that of texels of a third of a
    pixel: finer texels would need more samples to keep edges along rows in their places."""
    dpi = int(np.clip(53 / np.linalg.norm(pose[:3, 3]), 25, 150))
    texture = page(board, dpi)
    texel = 0.0254 / dpi  # the page's size is rounded to whole texels, the scale of what is on it is not
    marker_from_texel = np.array(
        [[texel, 0, 0.5 * texel - board.width / 2], [0, -texel, board.height / 2 - 0.5 * texel], [0, 0, 1]]
    )
    K = camera.opencv_matrix.copy()
    K[:2, 2] += 0.5  # pixel centres are at + 0.5
    H = K @ pose[:3, [0, 1, 3]] @ marker_from_texel
    rows, columns = texture.shape
    page_corners = np.array([[-1, -1, 1], [columns, -1, 1], [columns, rows, 1], [-1, rows, 1.0]])
    at = page_corners @ H.T
    light = np.full((camera.height, camera.width), TABLE, np.float32)
    if (at[:, 2] <= 1e-6).any():
        return light
    at = at[:, :2] / at[:, 2:]
    low = np.clip(np.floor(at.min(0)).astype(int), 0, [camera.width, camera.height])
    high = np.clip(np.ceil(at.max(0)).astype(int), 0, [camera.width, camera.height])
    width, height = (int(v) for v in high - low)
    if width < 1 or height < 1:
        return light
    to_fine = np.array([[fine, 0, -fine * low[0] - 0.5], [0, fine, -fine * low[1] - 0.5], [0, 0, 1]])
    seen = cv2.warpPerspective(
        texture,
        to_fine @ H,
        (width * fine, height * fine),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=TABLE,
    )
    light[low[1] : high[1], low[0] : high[0]] = cv2.resize(seen, (width, height), interpolation=cv2.INTER_AREA)
    return light


def _line(length: float, angle: float) -> NDArray[np.float32]:
    size = 2 * int(np.ceil(length / 2)) + 3
    kernel = np.zeros((size, size))
    for s in np.linspace(-length / 2, length / 2, 65):
        x, y = size // 2 + s * np.cos(angle), size // 2 + s * np.sin(angle)
        i, j, fx, fy = int(x), int(y), x - int(x), y - int(y)
        kernel[j : j + 2, i : i + 2] += np.outer([1 - fy, fy], [1 - fx, fx])
    return (kernel / kernel.sum()).astype(np.float32)


@cache
def _disc(radius: float) -> NDArray[np.float32]:
    n, fine = int(np.ceil(radius)) + 1, 15
    x = (np.arange((2 * n + 1) * fine) + 0.5) / fine - n - 0.5
    inside = (x[:, None] ** 2 + x**2 <= radius**2).reshape(2 * n + 1, fine, 2 * n + 1, fine).mean((1, 3))
    return (inside / inside.sum()).astype(np.float32)


@cache
def _noise(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng([seed, 99]).standard_normal((480 + 97, 640 + 89, 3), dtype=np.float32)


@cache
def _codes() -> NDArray[np.uint8]:
    """The sRGB codes of linear values in steps of 1/65535."""
    x = np.arange(65536) / 65535
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)


def picture(light: NDArray, look: Look, rng: np.random.Generator) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 from blurred light."""
    bank = _noise(int(rng.integers(4)))
    y, x = int(rng.integers(97)), int(rng.integers(89))
    sign = rng.choice([-1, 1], 3).astype(np.float32)
    noise = bank[y : y + light.shape[0], x : x + light.shape[1]] * sign
    value = light[..., None] + noise_deviation(light, look)[..., None].astype(np.float32) * noise
    image = _codes()[np.clip(np.rint(65535 * value), 0, 65535).astype(np.uint16)]
    if look.jpeg:
        image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, look.jpeg])[1], cv2.IMREAD_COLOR)
    return image


def disturbed(light: NDArray, board: fastibl.Board, pose: NDArray, look: Look, rng: np.random.Generator, phase: float):
    """Adds shadow, hidden parts and blur, in this order, which is that of the light."""
    light = light.copy()
    h, w = light.shape
    centre = pose[:3, 3] / pose[2, 3] * 522.0 + [320, 240, 0]
    size = 522.0 * np.sqrt(board.width * board.height) / pose[2, 3]
    y, x = np.mgrid[:h, :w].astype(np.float32)
    if look.shadow:
        angle = 0.7 + 0.3 * phase
        side = (x - centre[0]) * np.cos(angle) + (y - centre[1]) * np.sin(angle) + 0.15 * size * np.sin(2 * phase)
        light *= 0.12 + 0.88 * np.clip(side + 0.5, 0, 1)
    if look.hidden:
        # A patch of stripes and dots, with edges of its own, that covers the given share of the page.
        radius = np.sqrt(look.hidden * board.width * board.height / np.pi) / pose[2, 3] * 522.0
        at = centre[:2] + 0.35 * size * np.array([np.cos(phase), np.sin(phase)])
        inside = np.clip(radius - np.hypot(x - at[0], y - at[1]) + 0.5, 0, 1)
        stripes = 0.3 + 0.25 * np.sign(np.sin(0.45 * (x + 0.4 * y)) * np.sin(0.31 * (y - 0.2 * x)))
        light = light * (1 - inside) + stripes * inside
    if look.defocus:
        light = cv2.filter2D(light, -1, _disc(look.defocus), borderType=cv2.BORDER_REPLICATE)
    if look.motion:
        kernel = _line(look.motion, float(rng.uniform(0, np.pi)))
        light = cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    if look.blur:
        light = cv2.GaussianBlur(light, (0, 0), look.blur)
    return light.astype(np.float32)


class HandPath:
    """A hand-held camera aimed at the board, which turns by about 20 degrees a second and sways by 0.1 m a second."""

    def __init__(self, seed: int, tilt=(5.0, 60.0), distance=(0.38, 0.55), aim: float = 0.02):
        rng = np.random.default_rng([seed, 7])
        self.tilt, self.distance, self.aim = tilt, distance, aim
        self.phase, self.rate = rng.uniform(0, 2 * np.pi, (6, 3)), rng.uniform(0.6, 1.6, (6, 3)) * [0.5, 1.3, 3.1]
        self.start = rng.uniform(0, 360)

    def _wave(self, k: int, time: float) -> float:
        return float(np.sin(self.phase[k] + self.rate[k] * time) @ [0.70, 0.25, 0.05])

    def pose(self, time: float) -> NDArray[np.float64]:
        def within(k, low, high):
            return low + (high - low) * (0.5 + 0.5 * self._wave(k, time))

        return look_at(
            within(0, *self.tilt),
            within(1, *self.distance),
            self.start + 12 * time + 25 * self._wave(2, time),
            15 * self._wave(3, time),
            (self.aim * self._wave(4, time), self.aim * self._wave(5, time)),
        )


def film(
    board: fastibl.Board, path: HandPath, look: Look, frames: int, seed: int = 0, clear: int = 0
) -> Iterator[tuple[float, NDArray, NDArray[np.uint8]]]:
    """(time, camera_from_marker, picture). The first `clear` frames are undisturbed, for a tracker to start with."""
    rng = np.random.default_rng([seed, 3])
    for k in range(frames + clear):
        time = k / FPS
        pose = path.pose(time)
        now = look if k >= clear else Look()
        light = disturbed(board_light(board, pose), board, pose, now, rng, 0.8 * time)
        yield time, pose, picture(light, now, rng)


def small_turn(rotation: NDArray) -> NDArray[np.float64]:
    """Rotation vector, radians, of a small rotation (3, 3), to first order. cv2.Rodrigues gives 0 below 1e-5."""
    return 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )


# "each alone": by name.
HARD = {
    "4 px motion": Look(motion=4.0),
    "30 % hidden": Look(hidden=0.3),
    "cast shadow": Look(shadow=True),
    "defocus 2 px": Look(defocus=2.0),
    "low light 1/64": Look(light=1 / 64, noise=0.016),  # full well of 4000 electrons
    "JPEG 30": Look(jpeg=30),
}
ALL_AT_ONCE = replace(Look(), motion=4.0, hidden=0.3, shadow=True, defocus=2.0, light=1 / 64, noise=0.016, jpeg=30)
