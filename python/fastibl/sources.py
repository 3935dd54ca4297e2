"""Where frames come from: live cameras, videos, folders of pictures, recordings, the simulator. All are iterated alike.

A source has .rig and .board (None where there is none) and gives Frames whose times never run backwards; close() ends
what runs in the background. A Recording is itself a source.
"""

from __future__ import annotations

import itertools
import os
import re
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Rig
from .camera_files import HDR_ADVICE, FilmTimes, hdr_curve, open_film, read_pixels
from .expected import expect, expect_source
from .live_camera import LiveCamera, Shot
from .recording import CAMERAS, Frame, RecordingWarning, warn_of_primaries

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_WAIT = 0.1  # seconds between checks whether the source was closed
_EVEN = 0.9  # least share of equal steps between pictures' numbers, for the numbers to count as times


class Source(Protocol):
    """Anything that gives frames."""

    rig: Rig
    board: Any

    def __iter__(self) -> Iterator[Frame]: ...

    def close(self) -> None:
        """Ends what runs in the background."""


class _Closing:
    """Sources are context managers."""

    def close(self) -> None:
        """Ends what runs in the background."""

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class CameraSource(_Closing):
    """One or two live cameras, each read in a thread of its own.

    rig: says what was calibrated; front=None leaves its front camera out.
    back, front: number, device path or URL, or None; a video file stands in for a camera, and plays once, at its own
    speed.
    The source gives the newest picture of each camera: pictures that a slow reader has not asked for are dropped and
    counted. Pictures grabbed within `together` seconds make one Frame, others one each, so cameras may have any rhythm.
    A camera that is unplugged is missing from the frames until it is back. Iteration ends only with close(), after
    `patience` seconds without any picture (`gave_up` tells it; by default it waits without limit), or, where there are
    only video files, with the end of the last one. Times are seconds since the source was made.
    schedules: for "back" or "front", a function from the exposure of a picture to that of the next, such as a Bracket;
    without one, the exposure stays as the camera found it. A camera with a schedule gives no pictures while it changes
    from one exposure to the next. Where a camera does not hold its exposure, the Frame's exposure is None.
    Other options are those of LiveCamera.
    """

    live = True  # its times continue when it is iterated again

    def __init__(
        self,
        rig: Rig,
        back: int | str | None = 0,
        front: int | str | None = None,
        board: Any = None,
        *,
        together: float = 0.02,
        patience: float = np.inf,
        schedules: Mapping[str, Callable[[float], float]] | None = None,
        **options: Any,
    ):
        expect(rig, Rig, "rig")
        devices = {"back": back, "front": front}
        if back is None and front is None:
            raise ValueError("a camera is needed: back, front or both")
        if front is not None and rig.front is None:
            raise ValueError("a front camera was asked for, but the rig has none")
        self.rig, self.board = rig, board
        self._together, self.patience, self._schedules = together, patience, dict(schedules or {})
        self._log = options.get("log", lambda line: None)
        clock = options.pop("clock", time.monotonic)
        begin = clock()
        self._closed = False
        self.gave_up = False  # whether the iteration ended because no picture came within `patience`
        self._quiet = time.monotonic()  # since when no picture has come
        self._shots: dict[str, Shot] = {}  # pictures that were waited for and come next
        self._news = threading.Condition()
        self._told: set[str] = set()
        self.refused = 0  # pictures whose size is not the rig's
        self.cameras = {
            name: LiveCamera(
                device,
                (getattr(rig, name).width, getattr(rig, name).height),
                name=name,
                news=self._news,
                clock=lambda: clock() - begin,
                **options,
            )
            for name, device in devices.items()
            if device is not None
        }

    @property
    def dropped(self) -> int:
        """Pictures that were replaced by newer ones before they were asked for."""
        return sum(camera.dropped for camera in self.cameras.values())

    def close(self) -> None:
        self._closed = True
        for camera in self.cameras.values():
            camera.close()

    def __iter__(self) -> Iterator[Frame]:
        last = -np.inf
        self._quiet, self.gave_up = time.monotonic(), False
        for camera in self.cameras.values():
            camera.rewind()
        while not self._closed:
            if not self.wait(_WAIT):
                continue
            shots, self._shots = self._shots, {}
            if not shots:
                self.gave_up = not (self._closed or self._ended)
                return
            for group in _moments(shots, self._together):
                # A picture that took long to decode may come after a later one: the order of coming counts.
                last = max(last, max(shot.time for shot in group.values()))
                yield _frame(last, group)

    def wait(self, seconds: float) -> bool:
        """Waits until the next frame can be taken, or none will come any more; False where neither happened within this
        time. For who iterates and has something else to do while cameras give no pictures."""
        until = time.monotonic() + seconds
        while not self._shots and not self._closed:
            self._shots = self._newest(max(0.0, min(until - time.monotonic(), _WAIT)))
            if self._shots:
                self._quiet = time.monotonic()
            elif self._ended or time.monotonic() - self._quiet > self.patience:
                return True
            elif time.monotonic() >= until:
                return False
        return True

    @property
    def _ended(self) -> bool:
        return all(camera.ended for camera in self.cameras.values())

    def _newest(self, seconds: float) -> dict[str, Shot]:
        """The pictures that come within this time; waits a while for a second camera, whose picture makes a pair."""
        cameras = self.cameras.values()
        with self._news:
            self._news.wait_for(lambda: self._closed or self._ended or any(c.has_news for c in cameras), seconds)
            awaited = [c for c in cameras if c.connected]
            self._news.wait_for(lambda: all(c.has_news for c in awaited), self._together if len(awaited) > 1 else 0)
        shots: dict[str, Shot] = {}
        for name, camera in self.cameras.items():
            shot = camera.newest()
            if shot is None or not self._fits(name, shot):
                continue
            schedule = self._schedules.get(name)
            if schedule is not None and camera.settable:
                if shot.exposure is None:  # still on its way to the exposure that was set
                    continue
                if shot.setting == camera.settings:
                    camera.set_exposure(schedule(shot.exposure))
            shots[name] = shot
        return shots

    def _fits(self, name: str, shot: Shot) -> bool:
        camera = getattr(self.rig, name)
        if shot.image.shape[:2] == (camera.height, camera.width):
            return True
        self.refused += 1
        if name not in self._told:
            h, w = shot.image.shape[:2]
            self._log(f"the {name} camera is calibrated for {camera.width} x {camera.height}, but gives {w} x {h}")
            self._told.add(name)
        return False


def _moments(shots: dict[str, Shot], together: float) -> list[dict[str, Shot]]:
    """The pictures in order of time; those of one moment are together."""
    ordered = sorted(shots.items(), key=lambda item: item[1].time)
    if len(ordered) == 2 and ordered[1][1].time - ordered[0][1].time > together:
        return [dict([item]) for item in ordered]
    return [dict(ordered)]


def _frame(moment: float, shots: Mapping[str, Shot]) -> Frame:
    frame = Frame(moment)
    for name, shot in shots.items():
        setattr(frame, name, shot.image)
        setattr(frame, f"{name}_exposure", shot.exposure)
    return frame


class VideoSource(_Closing):
    """Video files of one or two cameras, read from the start, frame by frame; iterate as often as you like.

    back, front: files. Times are the files' own, from 0 at each file's first picture; fps: pictures per second to use
    instead. Pictures are as the sensor took them: a rotation noted in a file is ignored.
    exposures: (back, front), in one unit, for cameras whose exposure was held; None, the default, where a camera chose
    its own.
    front_after: seconds by which the front film began after the back film, negative if before it; a light that is
    switched in both films tells it.
    A video that ends early or breaks off ends the frames of that camera. A RecordingWarning is given where a video gave
    no frames, and where it is HDR, because its bright parts are cut.
    """

    def __init__(
        self,
        rig: Rig,
        back: str | os.PathLike[str] | None = None,
        front: str | os.PathLike[str] | None = None,
        board: Any = None,
        *,
        fps: float | None = None,
        exposures: tuple[float | None, float | None] = (None, None),
        front_after: float = 0.0,
    ):
        files = {"back": back, "front": front}
        self._files = {name: Path(file) for name, file in files.items() if file is not None}
        if not self._files:
            raise ValueError("a video is needed: back, front or both")
        if front is not None and rig.front is None:
            raise ValueError("a front video was given, but the rig has no front camera")
        for file in self._files.values():
            if not file.is_file():
                raise FileNotFoundError(f"no video at {file}")
        if fps is not None:
            _check_rate(fps)
        if not np.isfinite(front_after):
            raise ValueError(f"front_after must be finite seconds, got {front_after}")
        self.rig, self.board, self._fps = rig, board, fps
        self._exposures = dict(zip(CAMERAS, exposures, strict=True))
        self._starts = {"back": max(-front_after, 0.0), "front": max(front_after, 0.0)}

    def __iter__(self) -> Iterator[Frame]:
        videos = {name: open_film(file) for name, file in self._files.items()}
        for file in self._files.values():
            if curve := hdr_curve(file):
                warnings.warn(f"the video {file} is HDR ({curve}): {HDR_ADVICE}", RecordingWarning, stacklevel=2)
        try:
            times = {name: FilmTimes(video, self._fps) for name, video in videos.items()}
            upcoming = {name: _next_picture(video, times[name], self._starts[name]) for name, video in videos.items()}
            for name, (_, picture) in upcoming.items():
                if picture is None:
                    warnings.warn(f"the video {self._files[name]} holds no picture", RecordingWarning, stacklevel=2)
            while any(picture is not None for _, picture in upcoming.values()):
                moment = min(t for t, picture in upcoming.values() if picture is not None)
                frame = Frame(moment)
                for name, (t, picture) in list(upcoming.items()):
                    if picture is None or t > moment + 0.25 * times[name].period:
                        continue
                    setattr(frame, name, picture)
                    setattr(frame, f"{name}_exposure", self._exposures[name])
                    upcoming[name] = _next_picture(videos[name], times[name], self._starts[name])
                yield frame
        finally:
            for video in videos.values():
                video.release()


def _check_rate(fps: float) -> None:
    if not (fps > 0 and np.isfinite(fps)):
        raise ValueError(f"fps must be positive and finite, got {fps}")


def _next_picture(video: Any, times: FilmTimes, start: float) -> tuple[float, NDArray[np.uint8] | None]:
    read, picture = video.read()
    if not read or picture is None:
        return np.inf, None
    return start + times.next(), np.ascontiguousarray(picture[..., ::-1])


class FolderSource(_Closing):
    """Pictures in folders, ordered by the last number in their names: those of one number make one Frame.

    back, front: folders with .png, .jpg, … Pictures are as the sensor took them: EXIF turns none, and 16 bits are kept.
    fps: pictures per second, for the times.
    exposures: as in VideoSource.
    A number that is missing among evenly numbered pictures counts as a lost picture: those after it keep their times.
    Where numbers tell no order, or those of the two cameras differ, pictures follow each other in the order of their
    names. A picture that cannot be read is skipped with a RecordingWarning. Another one is given where a camera's first
    picture states other primaries than those of Rec. 709 (Display P3, Adobe RGB), because its codes are taken as they
    are.
    """

    def __init__(
        self,
        rig: Rig,
        back: str | os.PathLike[str] | None = None,
        front: str | os.PathLike[str] | None = None,
        board: Any = None,
        *,
        fps: float = 30.0,
        exposures: tuple[float | None, float | None] = (None, None),
    ):
        _check_rate(fps)
        if front is not None and rig.front is None:
            raise ValueError("a front folder was given, but the rig has no front camera")
        folders = {"back": back, "front": front}
        files = {name: _pictures_in(Path(folder)) for name, folder in folders.items() if folder is not None}
        if not files:
            raise ValueError("a folder is needed: back, front or both")
        self._files = _by_place(files)
        self._places = sorted(set().union(*self._files.values()))
        self.rig, self.board, self._fps = rig, board, fps
        self._exposures = dict(zip(CAMERAS, exposures, strict=True))

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[Frame]:
        told = set[str]()  # cameras whose primaries were looked at
        for place in self._places:
            frame = Frame(place / self._fps)
            for name, files in self._files.items():
                if place not in files:
                    continue
                try:
                    setattr(frame, name, read_pixels(files[place], any_depth=True))
                except ValueError as error:
                    warnings.warn(str(error), RecordingWarning, stacklevel=2)
                    continue
                if name not in told:
                    told.add(name)
                    warn_of_primaries(files[place])
                setattr(frame, f"{name}_exposure", self._exposures[name])
            if frame.back is not None or frame.front is not None:
                yield frame


def _by_number(path: Path) -> list[tuple[str, int]]:
    """A key for sorting: shot2.png comes before shot10.png."""
    return [(text, int(number or -1)) for text, number in re.findall(r"(\D*)(\d*)", path.name)]


def _last_number(path: Path) -> int:
    """-1 where there is no number."""
    return int((re.findall(r"\d+", path.stem) or ["-1"])[-1])


def _by_place(files: dict[str, list[Path]]) -> dict[str, dict[int, Path]]:
    """The pictures by their place in time, counted in pictures from the first one: see FolderSource."""
    numbers = {name: [_last_number(path) for path in paths] for name, paths in files.items()}
    several = list(numbers.values())
    shared = set(several[0]).intersection(*several)
    told = all(min(n) >= 0 and all(a < b for a, b in itertools.pairwise(n)) for n in several)
    if not told or 2 * len(shared) < min(map(len, several)):
        return {name: dict(enumerate(paths)) for name, paths in files.items()}
    every = sorted(set().union(*several))
    steps = np.diff(every)
    step = int(np.median(steps)) if len(steps) else 1
    even = len(steps) > 0 and (steps == step).mean() >= _EVEN and not (steps % step).any()
    even = even and every[-1] - every[0] < 2 * step * len(every)  # fewer pictures were lost than are there
    place = {n: (n - every[0]) // step if even else k for k, n in enumerate(every)}
    return {name: {place[n]: path for n, path in zip(numbers[name], files[name], strict=True)} for name in files}


def _is_picture(path: Path) -> bool:
    """Macs put files of their own beside others, with ._ before the name."""
    return path.is_file() and not path.name.startswith(".")


def _pictures_in(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise FileNotFoundError(f"no folder of pictures at {folder}")
    files = sorted((p for p in folder.iterdir() if p.suffix.lower() in PICTURES and _is_picture(p)), key=_by_number)
    if not files:
        raise ValueError(f"{folder} holds no pictures ({', '.join(PICTURES)})")
    return files


class Paced(_Closing):
    """A source whose frames come no sooner than their times say, like live ones. speed: 2 is twice as fast.

    Frames that are late are still given: nothing is dropped. catch_up: seconds; a frame that is later than this, after
    a pause, comes when it is asked for, and those after it keep their distance in time from it.
    """

    def __init__(
        self,
        source: Any,
        speed: float = 1.0,
        *,
        catch_up: float = np.inf,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] | None = None,
    ):
        if not (speed > 0 and np.isfinite(speed)):
            raise ValueError(f"speed must be positive and finite, got {speed}")
        expect_source(source)
        self.rig, self.board, self.source = source.rig, source.board, source
        self._speed, self._catch_up, self._clock, self._sleep = speed, catch_up, clock, sleep
        self._now: _PacedFrames | None = None  # that were begun last

    def close(self) -> None:
        if self._now is not None:
            self._now.closing.set()
        close(self.source)

    def wait(self, seconds: float) -> bool:
        """Waits for the next frame, at most so long; returns whether it may be taken now. Of several iterations, the
        one that was begun last is meant."""
        return self._now is None or self._now.wait(seconds)

    def __iter__(self) -> Iterator[Frame]:
        self._now = _PacedFrames(iter(self.source), self._speed, self._catch_up, self._clock, self._sleep)
        return self._now


class _PacedFrames(Iterator[Frame]):
    """One iteration of a Paced source."""

    def __init__(
        self,
        frames: Iterator[Frame],
        speed: float,
        catch_up: float,
        clock: Callable[[], float],
        sleep: Callable[[float], object] | None,
    ):
        self.closing = threading.Event()
        self._frames, self._speed, self._catch_up, self._clock = frames, speed, catch_up, clock
        self._sleep = self.closing.wait if sleep is None else sleep
        self._coming: Frame | None = None
        self._error: Exception | None = None
        self._begin: tuple[float, float] | None = None  # on the clock, and the frame's time then

    def wait(self, seconds: float) -> bool:
        if self.closing.is_set():
            return True
        try:
            frame = self._peek()
        except Exception as error:  # noqa: BLE001 - it is raised to whom takes the frame
            self._error = error
            return True
        left = 0.0 if frame is None else self._left(frame)
        if left > 0:
            self._sleep(min(left, seconds))
        return left <= seconds

    def __next__(self) -> Frame:
        frame = self._peek()
        if frame is None:
            raise StopIteration
        left = self._left(frame)
        if left > 0:
            self._sleep(left)
        elif left < -self._catch_up:
            self._begin = self._clock(), frame.time
        self._coming = None
        return frame

    def _peek(self) -> Frame | None:
        """The next frame, which stays the next one; None at the end."""
        error, self._error = self._error, None
        if error is not None:
            raise error
        if self._coming is None:
            self._coming = next(self._frames, None)
        return self._coming

    def _left(self, frame: Frame) -> float:
        """Seconds until a frame is due."""
        if self._begin is None:
            self._begin = self._clock(), frame.time
        begin, first = self._begin
        return (frame.time - first) / self._speed - (self._clock() - begin)


class BackAndForth(_Closing):
    """A source's frames to the end, then backwards to the beginning, and so on without end, like a camera that returns.

    source: has rig and board, and gives frames that are kept in memory. period: seconds between them. Times start at 0
    and keep increasing. When iterated again, it begins with the first frame, which need not be made again.
    """

    def __init__(self, source: Any, period: float):
        if not (period > 0 and np.isfinite(period)):
            raise ValueError(f"period must be positive and finite, got {period}")
        expect_source(source)
        self.rig, self.board, self._period = source.rig, source.board, period
        self._coming = iter(source)
        self._kept: list[Frame] = []
        self._closed = self._complete = False

    @property
    def kept(self) -> int:
        """Number of frames that are in memory by now."""
        return len(self._kept)

    @property
    def complete(self) -> bool:
        """Whether the source has given all of its frames."""
        return self._complete

    def close(self) -> None:
        self._closed = True

    def __iter__(self) -> Iterator[Frame]:
        for number in itertools.count():
            frame = None if self._closed else self._frame(number)
            if frame is None:
                return
            yield replace(frame, time=number * self._period)

    def _frame(self, number: int) -> Frame | None:
        if not self._complete and number >= len(self._kept):
            frame = next(self._coming, None)
            if frame is not None:
                self._kept.append(frame)
            self._complete = frame is None
        if not self._kept:
            return None
        last = len(self._kept) - 1
        place = number % max(2 * last, 1) if self._complete else number
        return self._kept[place if place <= last else 2 * last - place]


def close(source: Any) -> None:
    """Closes a source that can be closed: a Recording has nothing to close."""
    if hasattr(source, "close"):
        source.close()
