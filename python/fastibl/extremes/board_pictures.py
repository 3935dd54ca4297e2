"""Pictures of a board from known poses, by a renderer for checks that shares nothing with the simulator.

Each pixel is the mean of fine x fine rays through the full lens model. Each ray looks up the board's page, so no
picture is sampled twice.
"""

import pickle

import cv2
import numpy as np
from numpy.typing import NDArray

from .._fastibl import Camera


def look_at(tilt_degrees, distance, azimuth_degrees=0.0, roll_degrees=0.0, aim=(0.0, 0.0)):
    """camera_from_marker (4, 4) of a camera that is `distance` from the point `aim`, off the normal by `tilt`."""
    tilt, azimuth, roll = np.radians([tilt_degrees, azimuth_degrees, roll_degrees])
    out = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    z = -out
    up = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    right = np.cross(z, up)
    right /= np.linalg.norm(right)
    down = np.cross(z, right)
    rotation = np.stack([right, down, z])
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3] = turn @ rotation
    pose[:3, 3] = -pose[:3, :3] @ (np.array([*aim, 0.0]) + distance * out)
    return pose


def srgb(linear):
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


_pages: dict[tuple[bytes, float], NDArray[np.float32]] = {}


def page_of(board, dpi=300):
    key = (pickle.dumps(board), dpi)
    if key not in _pages:
        _pages[key] = board.image(dpi).astype(np.float32) / 255
    return _pages[key]


def render(
    board,
    camera,
    camera_from_marker,
    *,
    seed=0,
    blur=0.5,
    noise=0.004,
    fine=4,
    exposure=1.0,
    black=0.04,
    white=0.85,
    table=0.25,
    encode=srgb,
    dpi=300,
):
    """(height, width, 3) uint8. blur: sigma in pixels, in linear light; noise: that of a white pixel, linear."""
    page = page_of(board, dpi)
    rays = _rays(camera, fine)
    marker_from_camera = np.linalg.inv(np.asarray(camera_from_marker, np.float64))
    turn, origin = marker_from_camera[:3, :3].T.astype(np.float32), marker_from_camera[:3, 3]
    light = np.empty((camera.height, camera.width))
    # Some rows at a time, whose rays fit the processor's cache.
    rows = max(1, _AT_ONCE // (fine * fine * camera.width))
    for first in range(0, camera.height, rows):
        directions = rays[first * fine : (first + rows) * fine] @ turn
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -origin[2] / directions[..., 2]
        px = (origin[0] + distance * directions[..., 0] + board.width / 2) / board.width * page.shape[1] - 0.5
        py = (board.height / 2 - origin[1] - distance * directions[..., 1]) / board.height * page.shape[0] - 0.5
        px[~(distance > 0)] = -10
        ink = cv2.remap(
            page,
            px.astype(np.float32),
            py.astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=-1,
        )
        seen = np.where(ink < 0, table, black + (white - black) * np.clip(ink, 0, 1))
        light[first : first + rows] = seen.reshape(-1, fine, camera.width, fine).mean((1, 3)) * exposure
    if blur:
        light = cv2.GaussianBlur(light, (0, 0), blur)
    rng = np.random.default_rng(seed)
    light = light[..., None] + noise * np.sqrt(np.clip(light[..., None], 0, 1) + 0.05) * rng.standard_normal(
        (*light.shape, 3)
    )
    return np.rint(255 * encode(light)).astype(np.uint8)


_AT_ONCE = 1 << 15  # rays
_ray_cache: dict[tuple, NDArray[np.float32]] = {}


def _rays(camera, fine):
    """Through all parts of all pixels (fine · height, fine · width, 3)."""
    key = (repr(camera), camera.distortion, camera.model, fine)
    if key not in _ray_cache:
        K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
        y, x = (np.mgrid[: camera.height * fine, : camera.width * fine] + 0.5) / fine
        pixels = np.stack([x, y], -1).reshape(-1, 1, 2)
        # OpenCV's own inverse of the lens model, not fastibl's; K is in the same pixel convention as x and y.
        undistort = cv2.fisheye.undistortPoints if camera.model == "fisheye" else cv2.undistortPoints
        ideal = undistort(pixels, K, np.array(camera.distortion or (0.0,) * 4))
        rays = np.concatenate([ideal.reshape(*x.shape, 2), np.ones((*x.shape, 1))], -1)
        _ray_cache.clear()
        _ray_cache[key] = rays.astype(np.float32)
    return _ray_cache[key]


def vga(distortion=()):
    return Camera(640, 480, 522.0, 522.0, 320.0, 240.0, distortion=distortion)


def rotation_error_degrees(pose, truth):
    rotation = np.asarray(pose)[:3, :3].T @ np.asarray(truth)[:3, :3]
    axis = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    return np.degrees(np.arctan2(np.linalg.norm(axis), np.trace(rotation) - 1))


def project_tag(tag, camera, pose):
    pose = np.asarray(pose)
    points = np.pad(tag.corners, ((0, 0), (0, 1))) @ pose[:3, :3].T + pose[:3, 3]
    return camera.project(points)
