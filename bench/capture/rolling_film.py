"""Films of a board with a rolling shutter: each row of pixels is rendered with the pose of its own time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.extremes.board_pictures import look_at

from .board_film import CAMERA, FINE, FPS, TABLE, Look, disturbed, page, picture

READOUT = 0.03  # seconds
TURN = np.radians(60)  # a second
Path = Callable[[float], NDArray]  # camera_from_marker (4, 4) at a time

ROLLING = CAMERA.replace(readout=READOUT)


def board_light(board: fastibl.Board, pose_at: Path, time: float, camera: fastibl.Camera) -> NDArray[np.float32]:
    """(height, width), linear: row r is seen by the pose at time + r / height * readout."""
    height, width = camera.height, camera.width
    poses = np.stack([pose_at(time + r / height * camera.readout) for r in range(height)])
    dpi = int(np.clip(53 / np.linalg.norm(poses[0, :3, 3]), 25, 150))
    texture, texel = page(board, dpi), 0.0254 / dpi
    marker_from_texel = np.array(
        [[texel, 0, 0.5 * texel - board.width / 2], [0, -texel, board.height / 2 - 0.5 * texel], [0, 0, 1]]
    )
    K = camera.opencv_matrix.copy()
    K[:2, 2] += 0.5  # pixel centres are at + 0.5
    texel_from_pixel = np.linalg.inv(K @ poses[:, :3][:, :, [0, 1, 3]] @ marker_from_texel)
    x, y = (np.arange(width * FINE) + 0.5) / FINE, (np.arange(height * FINE) + 0.5) / FINE
    m = np.repeat(texel_from_pixel, FINE, axis=0)
    across, down = m[:, :, :1], m[:, :, 1] * y[:, None] + m[:, :, 2]
    w = across[:, 2] * x + down[:, 2:]
    maps = [((across[:, k] * x + down[:, k : k + 1]) / w).astype(np.float32) for k in (0, 1)]
    behind = w * np.sign(np.median(w[::16, ::16])) <= 0
    if behind.any():
        for k in (0, 1):
            maps[k][behind] = -1e4
    seen = cv2.remap(
        texture, maps[0], maps[1], interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=TABLE
    )
    return cv2.resize(seen, (width, height), interpolation=cv2.INTER_AREA)


def around(seed: int, tilt: float = 35.0, distance: float = 0.45) -> Path:
    """A path around the board, which stays in the middle of the picture."""
    start = np.random.default_rng([seed, 5]).uniform(0, 360)
    return lambda t: look_at(tilt, distance, start + np.degrees(TURN) * t, 5 * np.sin(t))


def to_and_fro(seed: int, axis: tuple[float, float, float]) -> Path:
    """A turn about the camera's own place at 60 degrees a second at most; the board moves to and fro through the
    picture."""
    rng = np.random.default_rng([seed, 6])
    middle = look_at(rng.uniform(15, 45), 0.5, rng.uniform(0, 360))
    phase, rate = rng.uniform(0, 2 * np.pi), TURN / np.radians(10)

    def pose(time: float) -> NDArray:
        turn = np.eye(4)
        turn[:3, :3] = cv2.Rodrigues(np.radians(10) * np.sin(rate * time + phase) * np.array(axis))[0]
        return turn @ middle

    return pose


PATHS: dict[str, Callable[[int], Path]] = {
    "around the board": around,
    "sideways": lambda seed: to_and_fro(seed, (0.0, 1.0, 0.0)),
    "up and down": lambda seed: to_and_fro(seed, (1.0, 0.0, 0.0)),
    "about the view": lambda seed: to_and_fro(seed, (0.0, 0.0, 1.0)),
}


def film(
    board: fastibl.Board, pose_at: Path, camera: fastibl.Camera, frames: int, seed: int = 0, look: Look | None = None
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """(time, picture)."""
    rng, look = np.random.default_rng([seed, 4]), look or Look()
    for k in range(frames):
        time = k / FPS
        light = board_light(board, pose_at, time, camera)
        light = disturbed(light, board, pose_at(time + 0.5 * camera.readout), look, rng, 0.8 * time)
        yield time, picture(light, look, rng)
