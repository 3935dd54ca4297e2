"""Videos for people: VP9 in WebM, which browsers play."""

from __future__ import annotations

import math
import os
from contextlib import ExitStack, suppress
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .whole_file import whole_file

_MILLISECOND = Fraction(1, 1000)
_BT709, _LIMITED = 1, 1  # ITU-T H.273; AVCOL_RANGE_MPEG
# VP9 at its fastest: fourteen times faster than OpenCV's writer, which takes no options.
_OPTIONS = {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "crf": "30", "b": "0"}
# Every second, what was encoded goes to the file, from which it plays even where the film is cut there.
_IN_PARTS = {"cluster_time_limit": "1000", "flush_packets": "1"}


class _NoPictures(Exception):
    pass


class VideoWriter:
    """Writes RGB pictures (h, w, 3) uint8 of one size as a .webm; a context manager.

    Colours are encoded by BT.709, as the file says. fps: pictures per second, for pictures that have no time of their
    own; at most 1000 count. The new file takes its place when it is closed, whatever was raised meanwhile; without a
    picture the older file stays; if it cannot be completed, on a full disk, the older file stays, or with keep_cut what
    was written until then takes its place. Of a program that is killed, the film stays beside it as a .part file, which
    plays but for its last seconds.

    Raises ValueError for another ending, a picture of another size or a time that is not finite, TypeError for one that
    is not uint8, OSError where the file cannot be written, ImportError where PyAV is missing. A picture that is refused
    leaves no trace.
    """

    def __init__(self, path: str | os.PathLike[str], fps: float, *, keep_cut: bool = False):
        self.path = Path(path)
        if self.path.suffix != ".webm":
            raise ValueError(f"a video must end in .webm, got {self.path.name}")
        try:
            import av
        except ImportError as error:
            raise ImportError("writing videos needs PyAV: pip install av") from error
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._av = av
        rate = Fraction(min(max(fps, 1 / 1001), 1000)).limit_denominator(1001)  # pictures have times of their own
        self._shape: tuple[int, ...] = ()
        self._whole = ExitStack()
        self._part = self._whole.enter_context(whole_file(self.path))
        if keep_cut:
            self._whole.push(self._keep_cut)
        self._container = self._whole.enter_context(av.open(str(self._part), "w", format="webm", options=_IN_PARTS))
        self._closed = False
        # Milliseconds, the unit of WebM: from picture to picture; which time is shown at 0; the last picture's time;
        # when it is shown.
        self._period, self._first, self._at, self._last, self._count = 1000 / rate, 0.0, -math.inf, -1, 0
        self._stream = self._container.add_stream("libvpx-vp9", rate=rate)
        self._stream.options = dict(_OPTIONS)
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.time_base = _MILLISECOND
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        context.color_range = _LIMITED

    def add(self, picture: NDArray[np.uint8], time: float | None = None) -> None:
        """time: seconds from any zero, increasing; without it, or where time begins anew with a smaller one, the
        picture is shown a period after the one before."""
        self._check(picture, time)
        at = float(self._count * self._period) if time is None else 1000 * time
        first = self._first if self._count else at
        if at < self._at:
            first = at - self._last - float(self._period)
        shown = max(round(at - first), self._last + 1)
        if not self._count:
            self._stream.height, self._stream.width = picture.shape[:2]
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG")
        frame.pts, frame.time_base = shown, _MILLISECOND
        self._container.mux(self._stream.encode(frame))
        self._shape, self._count = picture.shape, self._count + 1
        self._first, self._at, self._last = first, at, shown

    def _check(self, picture: NDArray[np.uint8], time: float | None) -> None:
        if picture.dtype != np.uint8:
            raise TypeError(f"a video's pictures must be uint8, got {picture.dtype}")
        if picture.ndim != 3 or picture.shape[2] != 3 or picture.size == 0:
            raise ValueError(f"a video's pictures must have shape (h, w, 3), got {picture.shape}")
        if self._shape and picture.shape != self._shape:
            raise ValueError(f"a video's pictures must all have shape {self._shape}, got {picture.shape}")
        if time is not None and not math.isfinite(time):
            raise ValueError(f"a picture's time must be finite (seconds), got {time}")

    def _keep_cut(self, _: object, error: object, *__: object) -> None:
        """Lets a film that could not be completed take its place, if it plays."""
        if not isinstance(error, OSError):
            return
        with suppress(self._av.FFmpegError, OSError, StopIteration):
            with self._av.open(str(self._part)) as film:
                next(film.decode(video=0))
            self._part.replace(os.path.realpath(self.path))

    def close(self) -> None:
        """Completes the file; without effect the second time."""
        if self._closed:
            return
        self._closed = True
        if not self._count:  # nothing was written, so no file is made
            with suppress(_NoPictures), self._whole:
                raise _NoPictures
            return
        with self._whole:
            self._container.mux(self._stream.encode())

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
