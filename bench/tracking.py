"""Tracking methods: error of the pose in the built-in room, and time."""

from __future__ import annotations

import cv2
import numpy as np

import fastibl
from fastibl.expected import present
from fastibl.recording import truth_of

from . import inputs
from .measure import Row, measure, row


def rows() -> list[Row]:
    recording = inputs.short_recording()
    frames = list(recording)
    before = fastibl.threads(), cv2.getNumThreads()
    fastibl.set_threads(1)
    cv2.setNumThreads(1)
    try:
        out = []
        for method in fastibl.methods("tracking"):
            for refine in (True, False):
                tracker = fastibl.Tracker(recording.board, recording.rig.back, method=method.name, refine=refine)
                time = measure(tracker.track, [f.back for f in frames], repetitions=2 * len(frames)).of_cpu
                degrees, shifts, lost = [], [], 0
                for frame in frames:
                    tracked, true = tracker.track(present(frame.back)), truth_of(recording).pose(frame.time)
                    if tracked is None:
                        lost += 1
                        continue
                    degrees.append(np.degrees(tracked.camera_from_marker.angle_to(true)))
                    shifts.append(np.linalg.norm(tracked.camera_from_marker.translation - true.translation))
                case, setting = "room, 640x480", "" if refine else "unrefined"
                for metric, value in (
                    ("median rotation error in degrees; seconds a picture", np.median(degrees)),
                    ("worst rotation error in degrees", np.max(degrees)),
                    ("median shift in metres", np.median(shifts)),
                    ("share of pictures without a pose", lost / len(frames)),
                ):
                    timed = time if "seconds" in metric else None
                    out.append(row(method.name, case, metric, float(value), timed, setting=setting))
        return out
    finally:
        fastibl.set_threads(before[0])
        cv2.setNumThreads(before[1])
