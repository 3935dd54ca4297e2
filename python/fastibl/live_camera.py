"""One live camera: read in a thread, stamped when grabbed, opened again after it was unplugged. A video file can stand
in for a camera: it plays once, at its own speed."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera_files import HDR_ADVICE, FilmTimes, hdr_curve, is_film, open_film

SECONDS_AT_ONE = 0.01  # seconds of exposure time at an exposure of 1 of a live camera
_SETTLING = 15  # pictures in which a camera's automatic exposure settles before it is held
_LATENCY = 3  # pictures that may still be taken with the previous exposure after a new one was set
_NETWORK = 5000  # milliseconds within which a camera on the network must answer
_FAILURES = 3  # pictures in a row that fail before the camera counts as unplugged
_WARMING, _WARMING_FAILURES, _WARMING_PAUSE = 5.0, 30, 0.03  # the same before its first: at most so many seconds
_MANUAL = {"V4L2": 1.0, "DSHOW": 0.25, "MSMF": 0.25}  # value of CAP_PROP_AUTO_EXPOSURE for manual exposure


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture of one camera. time: seconds when it was grabbed. image: (h, w, 3) uint8 RGB. exposure: multiplier of
    radiance, None where the camera does not tell it. number: counts all pictures of the camera. setting: number of
    set_exposure calls before it."""

    time: float
    image: NDArray[np.uint8]
    exposure: float | None
    number: int
    setting: int = 0


class _Exposure:
    """The exposure of an open capture: held constant, and set and read back where the driver allows it."""

    def __init__(self, capture: Any):
        import cv2

        self._capture, self._property = capture, cv2.CAP_PROP_EXPOSURE
        self._backend = _backend(capture)
        settled = capture.get(cv2.CAP_PROP_EXPOSURE)
        manual = _MANUAL.get(self._backend, 1.0)
        self.held = bool(capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, manual) and capture.set(self._property, settled))
        self.white_held = bool(capture.set(cv2.CAP_PROP_AUTO_WB, 0))
        self.settable = self.held and self.seconds(settled) is not None
        self.value = self.read()

    def seconds(self, units: float) -> float | None:
        """The exposure time that a driver's value means; None where its unit is not known."""
        if self._backend == "V4L2":  # unit of exposure_time_absolute: 100 microseconds
            return units * 1e-4 if units > 0 else None
        if self._backend in ("DSHOW", "MSMF"):  # the value is an exponent: 2 ** units seconds
            return 2.0**units if -20 <= units <= 4 else None
        return None

    def read(self) -> float | None:
        """The multiplier in effect now. 1 where the exposure is held but the driver does not tell it; None where it may
        drift."""
        if not self.held:
            return None
        seconds = self.seconds(self._capture.get(self._property))
        return 1.0 if seconds is None else seconds / SECONDS_AT_ONE

    def set(self, exposure: float) -> None:
        """Asks for a multiplier; `value` is then what the driver made of it, whether it agreed or not."""
        if not self.settable:
            return
        seconds = exposure * SECONDS_AT_ONE
        units = max(1.0, round(seconds * 1e4)) if self._backend == "V4L2" else round(np.log2(seconds))
        self._capture.set(self._property, float(units))
        self.value = self.read()


def _backend(capture: Any) -> str:
    try:
        return str(capture.getBackendName())
    except Exception:  # not all versions have a name for every back end
        return ""


class _Film:
    """A video file that plays at its own speed: its pictures are grabbed at the times that the file gives."""

    def __init__(self, capture: Any, begin: float):
        self._times, self._begin, self._started = FilmTimes(capture), begin, time.monotonic()

    def next(self) -> tuple[float, float]:
        """The time of the picture that was just grabbed, by the camera's clock, and the seconds until it is due."""
        at = self._times.next()
        return self._begin + at, max(0.0, self._started + at - time.monotonic())


def open_camera(device: int | str) -> Any:
    """Opens a cv2.VideoCapture; a network camera gives up after some seconds, not half a minute."""
    import cv2

    if isinstance(device, str) and "://" in device:
        limit = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _NETWORK, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _NETWORK]
        return cv2.VideoCapture(device, cv2.CAP_FFMPEG, limit)
    return open_film(str(device)) if is_film(device) else cv2.VideoCapture(device)


_quieting = threading.Lock()
_quieted: list[int] = []  # OpenCV's own level of messages, once for each thread that wants quiet


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silences OpenCV's own messages about a camera that is not there, which come with each try: the log says it once.
    FFmpeg's messages are silenced by silence_ffmpeg()."""
    import cv2

    logging = cv2.utils.logging
    with _quieting:
        _quieted.append(_quieted[0] if _quieted else logging.getLogLevel())
        logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        with _quieting:
            level = _quieted.pop()
            if not _quieted:
                logging.setLogLevel(level)


def silence_ffmpeg() -> None:
    """Silences what FFmpeg writes to stderr in OpenCV: a line each time that a camera is tried, and for damaged
    pictures. To be called by a command before it opens cameras, as it sets an environment variable; one that the user
    has set counts."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # AV_LOG_QUIET


class LiveCamera:
    """A camera by number, device path or URL, or a video file, read in a thread of its own; a context manager.

    size: (width, height) asked of the camera.
    name: its name in messages.
    open_capture: called with the device, returns what behaves like a cv2.VideoCapture.
    retry: seconds between attempts to open a camera that is not there.
    clock: function that gives seconds, the same for all cameras.
    news: condition that is notified when a picture comes; may be shared.
    log: called with one line when the camera comes, goes, or cannot hold its exposure.
    The camera first finds its exposure by itself; then exposure and white balance are held, because radiance is
    compared between pictures. An exposure of 1 is 10 ms where the driver tells times.
    """

    def __init__(
        self,
        device: int | str,
        size: tuple[int, int] | None = None,
        *,
        name: str = "camera",
        open_capture: Callable[[int | str], Any] = open_camera,
        retry: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        news: threading.Condition | None = None,
        log: Callable[[str], None] = lambda line: None,
    ):
        self.device, self.name = device, name
        self._size, self._open, self._retry, self._clock, self._log = size, open_capture, retry, clock, log
        self._changed = news or threading.Condition()
        self._stop = threading.Event()
        self._file = is_film(device)
        self._ended = False
        self._shot: Shot | None = None
        self._number = 0
        self._wanted: float | None = None
        self.settings = 0  # number of calls of set_exposure
        self._connected = self._settable = False
        self.dropped = 0  # pictures that were replaced by the next one before anybody asked for them
        self.lost = 0  # how often it was unplugged
        self._start()

    def _start(self) -> None:
        self._thread = threading.Thread(target=self._run, name=f"fastibl {self.name}", daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        """Whether this is a video file and all its pictures were handed out; a camera may always come back."""
        return self._ended and not self.has_news

    def rewind(self) -> None:
        """Plays a video file that has ended from the beginning again."""
        if self.ended and not self._stop.is_set():
            self._ended = False
            self._start()

    @property
    def connected(self) -> bool:
        """Whether the camera gives pictures now."""
        return self._connected

    @property
    def settable(self) -> bool:
        """Whether the camera's driver takes exposure times; known once it gives pictures."""
        return self._settable

    def set_exposure(self, exposure: float) -> None:
        """Uses another exposure from about the next picture on; pictures taken in between have an unknown exposure."""
        if not (exposure > 0 and np.isfinite(exposure)):
            raise ValueError(f"an exposure must be positive and finite, got {exposure}")
        with self._changed:
            self._wanted = float(exposure)
            self.settings += 1

    @property
    def has_news(self) -> bool:
        """Whether there is a picture that has not been handed out yet."""
        return self._shot is not None

    def newest(self, timeout: float = 0.0) -> Shot | None:
        """The latest picture; each is given once. Waits up to `timeout` seconds for it; None if there is no new one."""
        with self._changed:
            self._changed.wait_for(lambda: self._shot is not None or self._stop.is_set(), timeout)
            shot, self._shot = self._shot, None
            return shot

    def close(self) -> None:
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(timeout=5.0)  # a driver that hangs must not hold up the program

    def __enter__(self) -> LiveCamera:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        told = False  # whether it was logged that the camera does not open
        self._missed = False  # whether it was logged that it gives no pictures
        silent = False  # whether it was logged that it opens, but gives none
        while not self._stop.is_set():
            capture = None
            with quiet(), contextlib.suppress(Exception):  # drivers may raise anything; opening is tried again
                capture = self._open(self.device)
            if capture is None or not capture.isOpened():
                if not told:
                    self._log(f"the {self.name} camera {self.device} does not open; trying again")
                told = self._missed = True
                self._stop.wait(self._retry)
                continue
            told = False
            if self._file and (curve := hdr_curve(str(self.device))):
                self._log(f"the {self.name} film {self.device} is HDR ({curve}): {HDR_ADVICE}")
            try:
                self._read(capture)
            except Exception as error:  # noqa: BLE001 - as above
                self._log(f"the {self.name} camera {self.device} failed: {error}")
            with contextlib.suppress(Exception):
                capture.release()
            gave, self._connected = self._connected, False
            if self._file:
                with self._changed:
                    self._ended = True
                    self._changed.notify_all()
                return
            if gave and not self._stop.is_set():
                self.lost += 1
                self._missed = True
                self._log(f"the {self.name} camera {self.device} gives no more pictures; going on without it")
            elif not silent and not self._stop.is_set():
                self._missed = True
                self._log(
                    f"the {self.name} camera {self.device} opens, but gives no pictures: another program may be using "
                    "it; trying again"
                )
            silent = not gave
            self._stop.wait(self._retry)

    def _read(self, capture: Any) -> None:
        """Reads pictures until the camera fails or is closed."""
        settled = sum(1 for _ in self._pictures(capture, 0 if self._file else _SETTLING, settle=True))
        if not settled and not self._file:
            return
        exposure = _Exposure(capture)
        if not exposure.held:
            self._log(f"the {self.name} camera cannot hold its exposure: each picture's is estimated")
        if not exposure.white_held:
            self._log(f"the {self.name} camera cannot hold its white balance: measured colours drift with it")
        self._settable = exposure.settable
        known, unsure, setting = exposure.value, 0, self.settings
        for image, grabbed in self._pictures(capture):
            self._connected = True
            if self._missed:
                self._missed = False
                self._log(f"the {self.name} camera {self.device} gives pictures now")
            with self._changed:
                self._number += 1
                self.dropped += self._shot is not None
                self._shot = Shot(grabbed, image, None if unsure else known, self._number, setting)
                self._changed.notify_all()
                wanted, self._wanted = self._wanted, None
                setting = self.settings
            unsure = max(0, unsure - 1)
            if wanted is not None and wanted != known:
                exposure.set(wanted)
                if exposure.value != known:
                    unsure = _LATENCY
                known = exposure.value
        # The picture that still waits was taken before the camera went away: it stays valid.

    def _pictures(
        self, capture: Any, count: int | None = None, settle: bool = False
    ) -> Iterator[tuple[NDArray[np.uint8], float]]:
        """Pairs (RGB picture, time at which it was grabbed), until `count` have come or no more come."""
        import cv2

        if settle and self._size is not None:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # avoids old pictures
        failed, most, begin = 0, _WARMING_FAILURES if settle and not self._file else _FAILURES, time.monotonic()
        film = _Film(capture, self._clock()) if self._file else None
        while failed < most and count != 0 and not self._stop.is_set():
            grabbed = capture.grab()
            now = self._clock()
            if film is not None and grabbed:
                now, wait = film.next()
                if self._stop.wait(wait):
                    return
            read, picture = capture.retrieve() if grabbed else (False, None)
            if not read or picture is None or picture.ndim != 3:
                failed += 1
                if most > _FAILURES and (time.monotonic() - begin > _WARMING or self._stop.wait(_WARMING_PAUSE)):
                    return
                continue
            failed, most = 0, _FAILURES
            count = None if count is None else count - 1
            yield np.ascontiguousarray(picture[..., ::-1]), now
