"""Poses of cameras that look in a given direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ._fastibl import Pose


def looking(towards: ArrayLike, eye: ArrayLike = (0.0, 0.0, 0.05)) -> Pose:
    """camera_from_marker of a camera at `eye` (metres) that looks along `towards`, upright where it can be."""
    forward = np.asarray(towards, float) / np.linalg.norm(towards)
    up = (0.0, 0.0, 1.0) if abs(forward[2]) < 0.95 else (0.0, 1.0, 0.0)
    eye = np.asarray(eye, float)
    return Pose.look_at(eye, eye + forward, up)
