"""Which exposure a camera is to take next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ._fastibl import Camera, Capture, Pose


class Bracket:
    """Exposures in turn, whatever they show: what CameraSource and simulate ask for the next one.

    steps: by the first exposure, which the camera finds itself.
    """

    def __init__(self, steps: Sequence[float] = (1.0, 1 / 16, 1 / 256)):
        self.steps = tuple(float(step) for step in steps)
        if not self.steps or not all(step > 0 and np.isfinite(step) for step in self.steps):
            raise ValueError(f"the steps of a bracket must be positive and finite, got {steps}")
        self._first: float | None = None
        self._turn = 0

    def __call__(self, last: float) -> float:
        """The exposure after `last`, both multipliers."""
        if self._first is None:
            self._first = last / self.steps[0]
        self._turn = (self._turn + 1) % len(self.steps)
        return self._first * self.steps[self._turn]


class AdaptiveExposure:
    """Exposures by what the map still lacks where a camera looks, see Capture.next_exposure.

    camera: a perspective one. shortest, longest: what its driver can. Call `update` with what was captured; it is asked
    as a Bracket is. Before the first update the exposure stays as it is.
    """

    def __init__(self, camera: Camera, shortest: float, longest: float):
        if not (0 < shortest <= longest and np.isfinite(longest)):
            raise ValueError(f"exposures must range from a positive one to a longer one, got {shortest} to {longest}")
        self.camera, self.shortest, self.longest = camera, float(shortest), float(longest)
        self._next: float | None = None

    def update(self, capture: Capture, camera_from_marker: Pose | None) -> None:
        """Chooses the next exposure. camera_from_marker: where the camera looks now; None keeps what was chosen."""
        if camera_from_marker is not None:
            self._next = capture.next_exposure(self.camera, camera_from_marker, self.shortest, self.longest)

    def __call__(self, last: float) -> float:
        """The exposure after `last`, both multipliers."""
        return float(np.clip(last, self.shortest, self.longest)) if self._next is None else self._next
