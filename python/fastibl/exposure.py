"""Which exposure a camera is to take next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


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
