"""Guesses for cameras that nobody calibrated."""

from __future__ import annotations

import numpy as np

from ._fastibl import Camera, Pose, Rig

# Angle across the longer side of the picture, however a telephone is held: between those of most webcams (55 to 78)
# and telephones (63 to 70).
DEGREES = 65.0


def guessed_camera(size: tuple[int, int], degrees: float = DEGREES) -> Camera:
    """A camera without distortion and with its axis in the middle; size: (width, height), degrees: across the longer of
    them. Raises ValueError for an angle that a perspective picture cannot have."""
    if not 5 <= degrees <= 150:
        raise ValueError(f"the angle across a picture must be 5 to 150 degrees, got {degrees:g}")
    width, height = size
    f = max(width, height) / 2 / np.tan(np.radians(degrees / 2))
    return Camera(width, height, f, f, width / 2, height / 2)


def degrees_across(camera: Camera) -> float:
    """The angle of guessed_camera()."""
    return float(2 * np.degrees(np.arctan(max(camera.width, camera.height) / 2 / camera.fx)))


def with_back(rig: Rig, back: Camera) -> Rig:
    """The rig with another back camera in the same place."""
    return Rig(back) if rig.front is None else Rig(back, rig.front, rig.front_from_back)


def guessed_rig(
    back: tuple[int, int],
    front: tuple[int, int] | None = None,
    degrees: float = DEGREES,
    front_degrees: float = DEGREES,
) -> Rig:
    """Cameras for pictures of these sizes (width, height); the front one is at the place of the back one, turned around
    as in a telephone."""
    if front is None:
        return Rig(guessed_camera(back, degrees))
    turn = Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    return Rig(guessed_camera(back, degrees), guessed_camera(front, front_degrees), turn)
