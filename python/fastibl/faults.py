"""Faults of cameras, put into any source on purpose, to see what a session makes of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .calibration_files import CAMERAS
from .expected import expect_source
from .recording import Frame
from .sources import close

# By name: how many pictures in a row one event lasts, at least and at most.
KINDS: dict[str, tuple[int, int]] = {
    "dropped": (1, 3),
    "black": (1, 3),
    "frozen": (1, 15),
    "torn": (1, 1),
    "resized": (1, 3),
    "mirrored": (1, 3),
    "exposure": (1, 3),  # the tag is wrong, the picture is right
    "white balance": (5, 30),
    "zoom": (5, 20),
    "unplugged": (15, 60),
    "time": (1, 1),  # the time of the frame before
}
_TAGS = (1 / 64, 1 / 16, 1 / 4, 4.0, 16.0, 64.0)


@dataclass
class _Event:
    """What happens to one camera, and for how many more pictures it lasts."""

    kind: str
    left: int
    amount: NDArray[np.float64]  # three random numbers from 0 to 1


class Faulty:
    """A source with added faults, drawn from a seed; the rest stays as it is. The same seed gives the same faults.

    kinds: share of pictures at which a fault begins, by its name; a single number is divided among all KINDS.
    `happened` names the faults of the last frame, by camera; `counts` counts all so far, by kind. Frames without any
    picture are not given, as from a real camera's source.
    """

    def __init__(self, source: Any, seed: int = 0, kinds: float | Mapping[str, float] = 0.1):
        expect_source(source)
        if not isinstance(kinds, Mapping):
            kinds = dict.fromkeys(KINDS, kinds / len(KINDS))
        unknown = set(kinds) - set(KINDS)
        if unknown:
            raise ValueError(f"faults are {', '.join(KINDS)}, got {sorted(unknown)[0]!r}")
        if not (all(share >= 0 for share in kinds.values()) and sum(kinds.values()) <= 1 + 1e-9):
            raise ValueError(f"shares of faults must be positive and at most 1 together, got {dict(kinds)}")
        self.rig, self.board, self.source = source.rig, source.board, source
        self._seed, self._kinds = seed, dict(kinds)
        self.happened: dict[str, str] = {}
        self.counts = dict.fromkeys(KINDS, 0)

    def close(self) -> None:
        """Closes the wrapped source."""
        close(self.source)

    def __iter__(self) -> Iterator[Frame]:
        rng = np.random.default_rng(self._seed)
        events: dict[str, _Event | None] = dict.fromkeys(CAMERAS)
        shown: dict[str, NDArray | None] = dict.fromkeys(CAMERAS)  # the picture shown last, by camera
        last = None
        for given in self.source:
            frame, self.happened = replace(given), {}
            for name in CAMERAS:
                if getattr(given, name) is None:
                    continue
                event = events[name] or self._begun(rng)
                if event is not None and not _can_happen(frame, name, event, shown[name], last):
                    event = None
                if event is not None:
                    self.happened[name] = event.kind
                    self.counts[event.kind] += 1
                    _spoil(frame, name, event, shown[name])
                    if event.kind == "time" and last is not None:
                        frame.time = last
                    event.left -= 1
                    events[name] = event if event.left > 0 else None
                if getattr(frame, name) is not None:
                    shown[name] = getattr(frame, name)
            last = frame.time
            if frame.back is not None or frame.front is not None:
                yield frame

    def _begun(self, rng: np.random.Generator) -> _Event | None:
        draw, amount = rng.random(), rng.random(3)
        for kind, share in self._kinds.items():
            if draw < share:
                least, most = KINDS[kind]
                return _Event(kind, int(rng.integers(least, most + 1)), amount)
            draw -= share
        return None


def _can_happen(frame: Frame, name: str, event: _Event, before: NDArray | None, last: float | None) -> bool:
    """Whether a fault would change anything: what is repeated has to be there, and what is told wrongly, told."""
    if event.kind == "frozen":
        return before is not None
    if event.kind == "torn":
        return before is not None and before.shape == getattr(frame, name).shape
    if event.kind == "exposure":
        return getattr(frame, f"{name}_exposure") is not None
    return event.kind != "time" or last is not None


def _spoil(frame: Frame, name: str, event: _Event, before: NDArray | None) -> None:
    picture, (a, b, _) = getattr(frame, name), event.amount
    height = picture.shape[0]
    if event.kind in ("dropped", "unplugged"):
        picture = None
    elif event.kind == "black":
        picture = np.zeros_like(picture)
    elif event.kind == "frozen":
        picture = before
    elif event.kind == "torn" and before is not None:
        row = int((0.2 + 0.6 * a) * height)
        picture = np.concatenate([picture[:row], before[row:]])
    elif event.kind == "resized":
        picture = np.ascontiguousarray(picture[::2, ::2])
    elif event.kind == "mirrored":
        picture = np.ascontiguousarray(picture[:, ::-1])
    elif event.kind == "exposure":
        tag = f"{name}_exposure"
        setattr(frame, tag, getattr(frame, tag) * _TAGS[int(a * len(_TAGS))])
    elif event.kind == "white balance":
        gains = np.exp(1.4 * (event.amount - 0.5))  # from half to twice
        if picture.dtype.kind == "f":  # linear
            picture = (picture * gains).astype(picture.dtype)
        else:
            white = np.iinfo(picture.dtype).max
            picture = np.clip(np.round(picture * gains ** (1 / 2.2)), 0, white).astype(picture.dtype)
    elif event.kind == "zoom":
        picture = _zoomed(picture, 1.05 + 0.45 * b)
    setattr(frame, name, picture)


def _zoomed(picture: NDArray, factor: float) -> NDArray:
    import cv2

    height, width = picture.shape[:2]
    matrix = np.array([[factor, 0, (1 - factor) * width / 2], [0, factor, (1 - factor) * height / 2]])
    return cv2.warpAffine(picture, matrix, (width, height), flags=cv2.INTER_LINEAR)
