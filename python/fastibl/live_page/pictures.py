"""Pictures for the page. Each is encoded once, when somebody first asks for it, however many ask."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .._fastibl import FrameResult, MainLight, main_lights
from ..camera_files import as_bytes, write_pixels
from ..guidance import Guidance, guide
from .snapshot import Snapshot

QUALITY = 85  # quality of JPEG
_MAP_HEIGHT = 160  # pixels
_MAP_PERIOD = 0.7  # seconds: the map grows slowly, and showing it takes as long as ten composites
_SHADOW_HEIGHT = 192
_LIGHTS = 6  # lights that are listed


def jpeg(picture: NDArray[Any]) -> bytes:
    """A JPEG of (h, w, 3) RGB with 8 or 16 bits, or of (h, w, 4) with straight alpha, which is laid over grey."""
    picture = as_bytes(picture)
    if picture.shape[2] == 4:
        alpha = picture[..., 3:].astype(np.uint16)
        picture = ((picture[..., :3] * alpha + 128 * (255 - alpha)) // 255).astype(np.uint8)
    ok, encoded = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not ok:
        raise OSError("a picture cannot be encoded")
    return encoded.tobytes()


@dataclass(frozen=True)
class Encoded:
    """number: that of the picture that was encoded."""

    number: int
    data: bytes


class _View:
    """The last encoding of one view. number: the snapshot's counter by which it changes. period: seconds for which it
    stays valid, even if new pictures come."""

    def __init__(self, make: Callable[[Snapshot], bytes | None], number: str = "picture", period: float = 0.0):
        self._make, self.number, self._period = make, number, period
        self._lock = threading.Lock()
        self._last: Encoded | None = None
        self._made = -np.inf

    def get(self, snapshot: Snapshot) -> Encoded | None:
        with self._lock:
            last, number = self._last, getattr(snapshot, self.number)
            if last is not None and (last.number == number or time.monotonic() - self._made < self._period):
                return last
            data = self._make(snapshot)
            if data is None:
                return None
            self._last, self._made = Encoded(number, data), time.monotonic()
            return self._last


@dataclass(frozen=True)
class Look:
    """What is known of a map: where to look next, its picture, and its lights."""

    guidance: Guidance
    lights: tuple[MainLight, ...]


class Light:
    """The newest look at the captured map, worked out at most every _MAP_PERIOD."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of: FrameResult | None = None
        self._look: Look | None = None
        self._made = -np.inf

    def look(self, snapshot: Snapshot) -> Look | None:
        """The newest look; None before there is a map."""
        result = snapshot.newest
        if result is None or result.environment is None:
            return None
        with self._lock:
            if result is not self._of and time.monotonic() - self._made >= _MAP_PERIOD:
                self._of, self._made = result, time.monotonic()
                self._look = Look(_guide(snapshot, result), tuple(main_lights(result.environment)[:_LIGHTS]))
            return self._look


def _guide(snapshot: Snapshot, result: FrameResult) -> Guidance:
    """Guidance for the front camera if there is one, because that is the camera that is turned to see light."""
    rig, pose = snapshot.rig, result.back_from_marker
    if pose is None and result.turned is not None:
        pose = result.turned.back_from_marker
    if pose is None:
        return guide(result.environment, height=_MAP_HEIGHT)
    if rig.front is None:
        return guide(result.environment, rig.back, pose, _MAP_HEIGHT)
    return guide(result.environment, rig.front, rig.front_from_back @ pose, _MAP_HEIGHT)


def _shadow(snapshot: Snapshot) -> bytes | None:
    """The shadow on the plane from above, +y up: the share of the light that the object leaves."""
    if snapshot.result is None:
        return None
    ratio = np.asarray(snapshot.result.shadow_map.image)
    if ratio.size == 0:
        return None
    grey = (255 * ratio[::-1].clip(0, 1) ** np.float32(1 / 2.2)).astype(np.uint8)
    size = (_SHADOW_HEIGHT * grey.shape[1] // grey.shape[0], _SHADOW_HEIGHT)
    return jpeg(cv2.resize(grey, size, interpolation=cv2.INTER_LINEAR))


class Pictures:
    """All views of the page by name."""

    def __init__(self) -> None:
        self.light = Light()
        self._views = {
            "composite": _View(lambda s: None if s.result is None else jpeg(s.result.image)),
            "back": _View(lambda s: None if s.frame is None or s.frame.back is None else jpeg(s.frame.back)),
            "front": _View(lambda s: None if s.front is None else jpeg(s.front), "taken"),
            "map": _View(self._map, "taken", _MAP_PERIOD),
            "shadow": _View(_shadow, period=_MAP_PERIOD),
        }

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._views)

    def number(self, name: str) -> str:
        """The counter of snapshots by which a view changes."""
        return self._views[name].number

    def get(self, name: str, snapshot: Snapshot) -> Encoded | None:
        """The view's picture; None where there is nothing to see yet. Raises KeyError for an unknown view."""
        return self._views[name].get(snapshot)

    def _map(self, snapshot: Snapshot) -> bytes | None:
        look = self.light.look(snapshot)
        return None if look is None else jpeg(look.guidance.image)


def save_picture(snapshot: Snapshot, path: Path) -> Path:
    """Writes the composite as a .png, either whole or not at all. Raises ValueError where there is none yet,
    FileExistsError where a file of that name exists, and other OSErrors where it cannot be written."""
    if snapshot.result is None:
        raise ValueError("there is no picture yet")
    path.touch(exist_ok=False)  # reserves the name before the picture is written under it
    try:
        write_pixels(path, snapshot.result.image)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return path
