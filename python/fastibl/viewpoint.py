"""Poses of cameras that look somewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._fastibl import Pose


def looking(towards: ArrayLike, eye: ArrayLike = (0.0, 0.0, 0.05)) -> Pose:
    """camera_from_marker of a camera at `eye` (metres) that looks along `towards`, upright where it can be."""
    z = np.asarray(towards, float) / np.linalg.norm(towards)
    up = np.array([0.0, 0, 1]) if abs(z[2]) < 0.95 else np.array([0.0, 1, 0])
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z])
    matrix[:3, 3] = -matrix[:3, :3] @ np.asarray(eye, float)
    return Pose(matrix)
