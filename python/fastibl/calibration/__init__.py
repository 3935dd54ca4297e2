"""Measures what a rig has to know about itself: lenses, responses, the board, how its cameras sit relative to each
other, and when they take their pictures.

Each figure comes with its standard deviation; where the data cannot support it, there is a refusal instead: a
ValueError that says what to photograph.
"""

from .board import BoardCalibration, calibrate_board
from .guess import guess_camera
from .intrinsics import CameraCalibration, calibrate_camera
from .response import ResponseCalibration, calibrate_response
from .rig import RigCalibration, calibrate_rig
from .timing import PosePath, TimingCalibration, calibrate_timing

__all__ = [
    "BoardCalibration",
    "CameraCalibration",
    "PosePath",
    "ResponseCalibration",
    "RigCalibration",
    "TimingCalibration",
    "calibrate_board",
    "calibrate_camera",
    "calibrate_response",
    "calibrate_rig",
    "calibrate_timing",
    "guess_camera",
]
