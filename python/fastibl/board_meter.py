"""How bright a given map has to be where the camera stands, as the board's white tells."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ._fastibl import Capture, CubeMap, Environment, Pose, Rig
from .lighting import Lighting
from .recording import Frame
from .tracking import Tracker


def brightness_of(cube: CubeMap, rig: Rig, board: Any, frame: Frame, back_from_marker: Pose) -> float | None:
    """Factor that brings the map's light on the plane to what the board's white shows in a frame; None where the white
    cannot be read.

    A map from a file has units of its own, and so has a camera without calibration: composites need their ratio.
    """
    capture = Capture(8, board=board)
    capture.add(frame.back, rig.back, back_from_marker, frame.back_exposure, frame.time)
    shown = capture.environment().plane_irradiance
    falls = float(np.mean(Lighting(cube).irradiance([[0.0, 0.0, 1.0]])))
    if shown is None or not falls > 0 or not np.mean(shown) > 0:
        return None
    return float(np.mean(shown)) / falls


def first_brightness(cube: CubeMap, rig: Rig, board: Any, frames: Iterable[Frame]) -> float | None:
    """brightness_of for the first of the frames that tells it; None where none does."""
    tracker = Tracker(board, rig.back)
    for frame in frames:
        pose = None if frame.back is None else tracker.track(frame.back)
        factor = None if pose is None else brightness_of(cube, rig, board, frame, pose.camera_from_marker)
        if factor is not None:
            return factor
    return None


def scaled(cube: CubeMap, factor: float) -> Environment:
    """The map as known everywhere, made brighter by this factor."""
    return Environment(CubeMap(cube.faces * np.float32(factor)))
