"""Where a board is, from the rays of its corners: for cameras in whose pictures no Tracker works."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Board, Camera, Pose
from .corners import find_corners

_LEAST_TAGS = 3
_LEAST_COSINE = 0.2  # between a corner's ray and the middle of all rays: a plane covers less than a half space
_MOST_OFF = 2.0  # pixels, median: beyond this, it is another board, or not the camera's lens


def board_pose(picture: ArrayLike, board: Board, camera: Camera) -> Pose | None:
    """camera_from_marker of a board in one picture of a camera of any model, including fisheye and 360 degrees.

    Each picture is used by itself. None where it shows fewer than three tags, or tags that no pose explains.
    """
    seen = find_corners(picture, board, camera)
    if len(seen.ids) < min(_LEAST_TAGS, len(board.tags)):
        return None
    pixels, on_board = seen.pixels.reshape(-1, 2), np.pad(seen.on_board.reshape(-1, 2), ((0, 0), (0, 1)))
    rays = np.asarray(camera.unproject(pixels), np.float64)
    if not np.isfinite(rays).all():
        return None
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    pose = _by_rays(on_board, rays)
    if pose is None:
        return None
    off = np.linalg.norm(np.asarray(camera.project(pose @ on_board)) - pixels, axis=1)
    return pose if np.median(off) <= _MOST_OFF else None  # NaN, for a place that no picture shows, gives None, too


def _by_rays(points: NDArray[np.float64], rays: NDArray[np.float64]) -> Pose | None:
    """The pose by SQPnP, refined, in a perspective picture that looks along the middle of the rays. points, rays: (n,
    3)."""
    import cv2

    ahead = rays.mean(axis=0)
    ahead /= np.linalg.norm(ahead)
    aside = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
    aside /= np.linalg.norm(aside)
    turn = np.stack([aside, np.cross(ahead, aside), ahead])  # from the camera
    there = rays @ turn.T
    if there[:, 2].min() < _LEAST_COSINE:
        return None
    flat, none = there[:, :2] / there[:, 2:], np.zeros(4)
    found, r, t = cv2.solvePnP(points, flat, np.eye(3), none, flags=cv2.SOLVEPNP_SQPNP)
    if not found:
        return None
    r, t = cv2.solvePnPRefineLM(points, flat, np.eye(3), none, r, t)
    if not (np.isfinite(r).all() and np.isfinite(t).all()):
        return None
    matrix = np.eye(4)
    matrix[:3, :3] = turn.T
    return Pose(matrix) @ Pose.from_rotation_vector(np.ravel(r), np.ravel(t))
