"""Front cameras that tell no exposure: one is assumed, and then measured by the board's white."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ._fastibl import Environment
from .recording import Frame
from .sources import close
from .white import camera_ratio

_MOST_UNSEEN = 0.6  # of the sky: with more the white says little of what was seen
_FRAMES = 30  # with a map before it is asked
_GOOD = 0.15  # of a factor's logarithm: no better than the paper's albedo is known
_ROUNDS = 2  # a map in the wrong scale fills what is unseen wrongly, too


class AssumedFront:
    """A source whose front pictures of untold exposure are taken with `exposure`: a guess, until `measure` knows.

    Without it they would be compared with a map that knows nothing of what they show, and left out.
    """

    def __init__(self, source: Any):
        self.source, self.rig, self.board = source, source.rig, source.board
        self.live = getattr(source, "live", False)
        self.exposure = 1.0
        self._untold, self._frames, self._rounds = False, 0, 0

    @property
    def dropped(self) -> int:
        """As the source has it."""
        return int(getattr(self.source, "dropped", 0))

    def close(self) -> None:
        close(self.source)

    def __enter__(self) -> AssumedFront:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        for frame in self.source:
            if frame.front is not None and frame.front_exposure is None:
                self._untold = True
                frame = replace(frame, front_exposure=self.exposure)
            yield frame

    def as_told(self, frame: Frame) -> Frame:
        """A frame that came from here as it came from the source: what was assumed is told to nobody else."""
        return replace(frame, front_exposure=None) if self._untold else frame

    def measure(self, environment: Environment | None) -> bool:
        """Whether a captured map tells another exposure, which is then used; the map itself is in the wrong scale.

        The map's light on the board must be that which the board's white shows to the back camera.
        """
        if not self._untold or self._rounds >= _ROUNDS or environment is None:
            return False
        self._frames += 1
        if self._frames < _FRAMES or environment.knowledge["unseen_sky"] > _MOST_UNSEEN:
            return False
        try:
            factor = float(np.mean(camera_ratio(environment).ratio))
        except (LookupError, ValueError):  # no white in view so far
            return False
        self._frames, self._rounds = 0, self._rounds + 1
        if abs(np.log(factor)) <= _GOOD:
            self._rounds = _ROUNDS
            return False
        self.exposure *= factor
        return True
