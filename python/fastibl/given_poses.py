"""Checks whether poses given by a program can be meant as they are given, and warns once if not."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Board, Camera, Pose
from .tracking import Tracker

_FLIP = Pose(np.diag([1.0, -1, -1, 1]))  # from OpenGL's axes of a camera to OpenCV's, or back
_UNSEEN = 10  # poses that show neither marker nor object, before other axes are suspected
_LOOKS = 3  # pictures in which the board is looked for: each search takes some hundredths of a second
_BESIDE = 0.05  # share of the picture's width by which a board may lie beside the place that the pose gives


class GivenPoses:
    """Warns of poses that are the camera's in the marker's frame (the inverse), have other axes, or do not agree with
    the board that their pictures show. camera: that of the poses; board: None where none was given."""

    def __init__(self, camera: Camera, board: Board | None):
        self._camera, self._board = camera, board
        self._asked, self._unseen, self._looks = False, 0, _LOOKS if board is not None else 0
        self._turned_shows = ["pose", "pose.inverse()"]

    @property
    def due(self) -> bool:
        """Whether there is anything left to check."""
        return not self._asked or self._looks > 0

    def ask(self, pose: Pose, picture: Any, places: NDArray[np.float64], drawn: bool) -> None:
        """Checks one frame. places: (n, 3) points of the marker and the object, metres; drawn: whether any of them
        shows."""
        if not self._asked:
            self._asked = drawn or self._ask_axes(pose, places)
        if self._looks and picture is not None and self._shows(pose, np.zeros((1, 3))):
            self._looks -= 1
            self._ask_board(pose, picture)

    def _shows(self, camera_from_marker: Pose, places: NDArray[np.float64]) -> bool:
        pixels = self._camera.project(camera_from_marker @ places)
        return bool(((pixels >= 0) & (pixels < (self._camera.width, self._camera.height))).all(axis=1).any())

    def _ask_axes(self, pose: Pose, places: NDArray[np.float64]) -> bool:
        """True if there is nothing left to ask: the pose shows the marker or the object, or a warning was given."""
        if self._shows(pose, places):
            return True
        if self._shows(pose.inverse(), places):
            return _warn_of_pose("its inverse would: Pose.inverse() makes it of the camera's place")
        # With other axes, a camera that merely looks away also shows them, but not all the time while it moves.
        turned = {"pose": _FLIP @ pose, "pose.inverse()": _FLIP @ pose.inverse()}
        self._turned_shows = [name for name in self._turned_shows if self._shows(turned[name], places)]
        self._unseen += 1
        if not self._turned_shows or self._unseen < _UNSEEN:
            return False
        return _warn_of_pose(
            f"FLIP @ {self._turned_shows[0]} would, with FLIP = Pose(numpy.diag([1.0, -1, -1, 1])): cameras of OpenGL, "
            "ARKit, ARCore and Blender look along -z, with y up"
        )

    def _ask_board(self, pose: Pose, picture: Any) -> None:
        board = self._board
        found = None if board is None else Tracker(board, self._camera, "board").track(picture)
        if board is None or found is None or found.ambiguous:
            return
        self._looks = 0
        seen, known = [], []
        corners = {tag.id: np.asarray(tag.corners) for tag in board.tags}
        for tag in found.tags:
            known.append(np.pad(corners[tag.id], ((0, 0), (0, 1))))
            seen.append(np.asarray(tag.corners))
        beside = np.linalg.norm(self._camera.project(pose @ np.concatenate(known)) - np.concatenate(seen), axis=1)
        if np.median(beside) > _BESIDE * self._camera.width:
            warnings.warn(
                f"the picture shows the board {np.median(beside):.0f} px beside where back_from_marker has it, and its "
                "white is read as light there. Poses are of the board's middle, x to the right, y up the page, z out "
                "of it; where they are of another frame, give no board",
                stacklevel=4,
            )


def _warn_of_pose(what: str) -> bool:
    warnings.warn(
        f"back_from_marker shows neither the marker nor the object, and {what}. It takes points of the marker to "
        "the camera (x right, y down, z forward), as OpenCV's solvePnP gives it",
        stacklevel=5,
    )
    return True
