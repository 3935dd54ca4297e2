"""When the rows of a simulated picture are exposed, and how bright flickering lamps are meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Camera, Pose

_BAND_STEP, _BLUR_STEP = 0.25, 1.0  # pixels of motion between bands of rows, and between an exposure's poses
_MOST_POSES = 64  # most poses of one exposure
_PROBE_TIMES = 5
_PROBE_DISTANCES = (0.4, 100.0)  # metres: as near as a camera comes; as far as only rotation moves a picture


@dataclass(frozen=True)
class Shutter:
    """Times of a camera's exposure and of the lamps, in seconds.

    exposure_time: of one row; 0 is an instant. flicker: Hz of the lamps' light, 0 for steady ones.
    flicker_depth: 0 to 1; the light swings between 1 - depth and 1 + depth times its mean, greatest at time 0.
    glare: share of a picture's light that spreads evenly over all of it. clock_offset: a picture that is
    stamped `time` begins at `time` + clock_offset of the clock of poses and events.
    """

    exposure_time: float = 0.0
    flicker: float = 0.0
    flicker_depth: float = 0.5
    glare: float = 0.0
    clock_offset: float = 0.0

    def __post_init__(self) -> None:
        for name, value, most in (
            ("shutter", self.exposure_time, np.inf),
            ("flicker", self.flicker, np.inf),
            ("flicker_depth", self.flicker_depth, 1.0),
            ("glare", self.glare, 1.0),
        ):
            if not (np.isfinite(value) and 0 <= value <= most):
                raise ValueError(f"{name} must be finite and from 0 to {most:g}, got {value}")
        if not np.isfinite(self.clock_offset):
            raise ValueError(f"clock_offset must be finite, got {self.clock_offset}")

    def lamps(self, times: NDArray[np.float64], exposure_time: float) -> NDArray[np.float64]:
        """Light of the lamps relative to its mean over a period, averaged over exposures whose middles are at
        `times`."""
        swing = self.flicker_depth * np.sinc(self.flicker * exposure_time)
        return 1 + swing * np.cos(2 * np.pi * self.flicker * np.asarray(times))


@dataclass(frozen=True)
class Band:
    """Rows that are taken with the same poses; each (time, camera_from_marker) has the same weight."""

    rows: slice
    poses: list[tuple[float, Pose]]


def row_times(camera: Camera, begin: float) -> NDArray[np.float64]:
    """Time of each row's mid-exposure: row r at begin + r / height * readout."""
    return begin + np.arange(camera.height) / camera.height * camera.readout


def bands(camera: Camera, pose_at: Callable[[float], Pose], begin: float, exposure_time: float) -> Iterator[Band]:
    """Divides the picture from top to bottom into as few bands and poses as keep the steps below what a lens resolves.

    pose_at: camera_from_marker of a time. begin: time of the first row's mid-exposure.
    """
    speed = _pixel_speed(camera, pose_at, begin - exposure_time / 2, begin + camera.readout + exposure_time / 2)
    count = int(np.clip(np.ceil(speed * camera.readout / _BAND_STEP), 1, camera.height))
    poses = int(np.clip(np.ceil(speed * exposure_time / _BLUR_STEP), 1, _MOST_POSES))
    within = ((np.arange(poses) + 0.5) / poses - 0.5) * exposure_time
    ends = np.arange(count + 1) * camera.height // count
    for first, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        middle = begin + (first + end - 1) / 2 / camera.height * camera.readout if camera.readout else begin
        yield Band(slice(first, end), [(t, pose_at(t)) for t in (middle + within).tolist()])


def _pixel_speed(camera: Camera, pose_at: Callable[[float], Pose], begin: float, end: float) -> float:
    """The highest speed, in pixels a second, of anything that the camera shows."""
    if end <= begin:
        return 0.0
    poses = [pose_at(t) for t in np.linspace(begin, end, _PROBE_TIMES).tolist()]
    x, y = np.meshgrid(np.linspace(0.02, 0.98, 3) * camera.width, np.linspace(0.02, 0.98, 3) * camera.height)
    rays = camera.unproject(np.stack([x.ravel(), y.ravel()], axis=-1))
    points = np.concatenate([rays * distance for distance in _PROBE_DISTANCES])
    back = poses[_PROBE_TIMES // 2].inverse()
    seen = np.stack([camera.project(pose @ (back @ points)) for pose in poses])
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=-1)
    return float(np.nanmax(steps, initial=0.0)) * (_PROBE_TIMES - 1) / (end - begin)
