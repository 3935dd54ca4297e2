"""A sweep with the board in view only at its start and its end."""

from __future__ import annotations

import numpy as np

import fastibl

_EYE = np.array([0.0, -0.36, 0.38])  # metres, in the marker frame
_BOARD = -np.degrees(np.arctan2(_EYE[2], -_EYE[1]))  # elevation at which the board is in the middle of the picture
_MIDDLE, _SWING = 32, 14  # degrees: elevations of the back camera, held upright, while it turns
_TURN = 1.7, 8.3  # seconds: one turn
# (time, heading, elevation), linear in between, then smoothed over _SMOOTH seconds on either side.
_KNOTS = np.array([(0.7, 0, _BOARD), (_TURN[0], 0, _MIDDLE), (_TURN[1], 360, _MIDDLE), (9.3, 360, _BOARD)])
_SMOOTH = 0.4


def turning(time: float) -> fastibl.Pose:
    """back_from_marker of a hand that turns round where it stands; the board is in view in the first and the last
    second.

    The camera is upright and looks up and down, at 60 to 120 degrees a second; its place wanders by 2 cm.
    """
    steps = np.linspace(-_SMOOTH, _SMOOTH, 41)
    weights = 1 + np.cos(np.pi * steps / _SMOOTH)
    weights /= weights.sum()
    heading, elevation = (np.radians(np.interp(time + steps, _KNOTS[:, 0], _KNOTS[:, k]) @ weights) for k in (1, 2))
    share = np.clip((time - _TURN[0]) / (_TURN[1] - _TURN[0]), 0, 1)
    elevation += np.radians(_SWING) * np.sin(6 * np.pi * share) * np.sin(np.pi * share) ** 0.5
    waves = 2 * np.pi * time * np.array([[0.31, 0.23, 0.41], [0.9, 1.3, 0.7], [3.1, 4.3, 5.7]])
    wander = 0.01 * np.sin(waves[0] + [0.3, 1.2, 2.1]) + 0.004 * np.sin(waves[1]) + 0.0006 * np.sin(waves[2])
    shake = 0.02 * np.sin(waves[0] + 1) + 0.008 * np.sin(waves[1] + 2) + 0.001 * np.sin(waves[2])
    eye = _EYE + wander
    across = np.cos(elevation)
    forward = np.array([np.sin(heading) * across, np.cos(heading) * across, np.sin(elevation)])
    right = np.array([np.cos(heading), -np.sin(heading), 0.0])
    look = np.eye(4)
    look[:3, :3] = np.cross(forward, right), -right, forward  # upright: the picture's rows run downwards
    look[:3, 3] = -look[:3, :3] @ eye
    return fastibl.Pose.from_rotation_vector(shake, np.zeros(3)) @ fastibl.Pose(look)


ABOUT = 3.0  # seconds


def turning_after_moving(time: float) -> fastibl.Pose:
    """The same after three seconds in which the hand moves about the board, 0.4 m to either side, and looks at it."""
    if time >= ABOUT:
        return turning(time - ABOUT)
    share = time / ABOUT
    side = np.sin(2 * np.pi * share) * np.sin(np.pi * share) ** 2
    start = turning(0)
    eye = np.array(start.inverse().translation)
    eye += [0.55 * side, 0.1 * (1 - np.cos(2 * np.pi * share)), 0.12 * np.sin(2 * np.pi * share) ** 2]
    look = np.array(fastibl.Pose.look_at(eye, (0, 0, 0)).rotation)
    first = np.array(start.rotation)
    began = np.array(fastibl.Pose.look_at(start.inverse().translation, (0, 0, 0)).rotation)
    matrix = np.eye(4)
    matrix[:3, :3] = first @ began.T @ look  # held as at the start
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return fastibl.Pose(matrix)
