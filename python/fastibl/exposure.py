"""Which exposure a camera is to take next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ._fastibl import Camera, Capture, Pose


def whole_periods(exposure: float, flicker: float, seconds_at_one: float = 0.01) -> float:
    """The longest exposure of at most `exposure` that lasts whole periods of flickering lamps, so that each picture
    takes their mean; `exposure` itself where it is shorter than one period, or flicker is 0.

    flicker: Hz, 100 or 120. seconds_at_one: exposure time of an exposure of 1. Raises ValueError for invalid values.
    """
    if not (flicker >= 0 and np.isfinite(flicker) and seconds_at_one > 0 and np.isfinite(seconds_at_one)):
        raise ValueError(f"flicker must be 0 Hz or more and times positive, got {flicker} Hz, {seconds_at_one} s")
    if not (exposure > 0 and np.isfinite(exposure)):
        raise ValueError(f"exposure must be positive and finite, got {exposure}")
    periods = np.floor(exposure * seconds_at_one * flicker * (1 + 1e-9))
    return float(periods / (flicker * seconds_at_one)) if periods >= 1 else float(exposure)


class Bracket:
    """Fixed exposures in turn, whatever they show; CameraSource and simulate ask it for the next one.

    steps: exposures relative to the first one, which the camera finds itself; each at least a 1000th of the one before,
    or light that clips in one is lost in the noise of the next.
    """

    def __init__(self, steps: Sequence[float] = (1.0, 1 / 16, 1 / 256)):
        self.steps = tuple(float(step) for step in steps)
        if not self.steps or not all(step > 0 and np.isfinite(step) for step in self.steps):
            raise ValueError(f"the steps of a bracket must be positive and finite, got {steps}")
        self._first: float | None = None
        self._turn = 0

    def __call__(self, last: float) -> float:
        """The exposure that follows `last`; both are multipliers."""
        if self._first is None:
            self._first = last / self.steps[0]
        self._turn = (self._turn + 1) % len(self.steps)
        return self._first * self.steps[self._turn]


class AdaptiveExposure:
    """Chooses exposures by what the map still lacks where a camera looks, see Capture.next_exposure.

    camera: a perspective one.
    shortest, longest: limits of its driver.
    Call `update` with what was captured; the next exposure is asked for as with a Bracket. Before the first update the
    exposure stays as it is.
    flicker: Hz of lamps on the mains, 100 or 120: exposures that are long enough are made whole periods, see
    whole_periods; 0 for daylight.
    seconds_at_one: exposure time of an exposure of 1, 10 ms for live cameras.
    """

    def __init__(
        self, camera: Camera, shortest: float, longest: float, flicker: float = 0.0, seconds_at_one: float = 0.01
    ):
        if not (0 < shortest <= longest and np.isfinite(longest)):
            raise ValueError(f"exposures must range from a positive one to a longer one, got {shortest} to {longest}")
        self.camera, self.shortest, self.longest = camera, float(shortest), float(longest)
        self.flicker, self.seconds_at_one = float(flicker), float(seconds_at_one)
        whole_periods(1.0, self.flicker, self.seconds_at_one)  # raises for values that are not valid
        self._next: float | None = None

    def update(self, capture: Capture, camera_from_marker: Pose | None) -> None:
        """Chooses the next exposure. camera_from_marker: where the camera looks now; None keeps the last choice."""
        if camera_from_marker is not None:
            chosen = capture.next_exposure(self.camera, camera_from_marker, self.shortest, self.longest)
            steady = whole_periods(chosen, self.flicker, self.seconds_at_one)
            self._next = steady if steady >= self.shortest else chosen

    def __call__(self, last: float) -> float:
        """The exposure that follows `last`; both are multipliers."""
        return float(np.clip(last, self.shortest, self.longest)) if self._next is None else self._next
