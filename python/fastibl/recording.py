"""Recordings: pictures of a back and a front camera, their calibration, and the truth where it is known.

A recording is a folder:

- rig.yaml: the cameras (matrices in OpenCV's convention), front_from_back, response curves, readout in seconds where it
  is known, model where it is not a perspective camera
- board.yaml: the printed board: tags, border_bits, page size
- frames.csv: time, camera, file, exposure; one row per picture. Pictures of the same time make one Frame. `file` is a
  lossless picture of 8 or 16 bits, or a frame of a lossless video: back.mkv#12. Both are read as the sensor took them;
  any orientation noted in the file is ignored. `exposure` is empty where the camera did not tell it
- attitudes.csv: time, m00 to m22; where there was a gyroscope, Frame.attitude of the frames that have one, and
  empty cells for a frame without one where a later frame of the same time has one
- truth/: where known, environment maps by time, camera poses by time, and what happened

A recording may come from anyone: files outside its folder are not read, nor are pictures, cameras and lists that claim
to be larger than large real ones.
"""

from __future__ import annotations

import bisect
import csv
import io
import json
import os
import re
import tempfile
import threading
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any, SupportsIndex, TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import CubeMap, Pose, Rig
from .calibration_files import CAMERAS as CAMERAS
from .calibration_files import read_board as read_board
from .calibration_files import read_rig as read_rig
from .calibration_files import write_board as write_board
from .calibration_files import write_rig as write_rig
from .camera_files import decode_pixels, open_film
from .expected import expect
from .file_limits import check_file_size, check_pixels, file_bytes, text_of
from .free_disk import check_free
from .picture_headers import jpeg_size, png_size
from .primaries import of_picture
from .whole_file import write_whole

if TYPE_CHECKING:
    import cv2

_ATTITUDE_COLUMNS = ("time", *(f"m{row}{column}" for row in range(3) for column in range(3)))
_MOST_TEXT = 2**27  # bytes of a list of pictures: enough for some days of film
_MOST_EVENTS = 2**22  # bytes
_PICTURES = {".png": png_size, ".jpg": jpeg_size, ".jpeg": jpeg_size}
# What RecordingWriter writes: files, and the names of files in folders.
_FILES = {"rig.yaml", "board.yaml", "frames.csv", "attitudes.csv", *(f"{camera}.mkv" for camera in CAMERAS)}
_FOLDERS = {camera: re.compile(r"\d{5,}\.png") for camera in CAMERAS}
_FOLDERS["truth"] = re.compile(r"map-\d+\.npy|maps\.csv|poses\.csv|events\.json")


@dataclass(eq=False)
class Frame:
    """Pictures of one moment.

    time: seconds.
    back, front: (h, w, 3) RGB or None: uint8 or uint16, encoded, or float32, linear.
    back_exposure, front_exposure: multipliers of radiance, None where they are not known.
    back_from_marker: Pose where it is known; tracking is then skipped.
    back_last_row: given with it, the pose when the last row of a rolling shutter was taken, `readout` later; None
    derives it from the poses before.
    attitude: (3, 3) rotation of the back camera from a gyroscope: from any frame at rest that is the same for all
    pictures, to the camera's; None where nothing tells it.
    """

    time: float
    back: NDArray | None = None
    front: NDArray | None = None
    back_exposure: float | None = 1.0
    front_exposure: float | None = 1.0
    back_from_marker: Pose | None = None
    back_last_row: Pose | None = None
    attitude: ArrayLike | None = None

    def __post_init__(self) -> None:
        expect(self.time, Real, "time", "seconds")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Frame):
            return NotImplemented
        given = ("back", "front", "back_from_marker", "back_last_row", "attitude")
        same = [_same(getattr(self, name), getattr(other, name)) for name in given]
        mine, others = ((frame.time, frame.back_exposure, frame.front_exposure) for frame in (self, other))
        return all(same) and mine == others

    def __repr__(self) -> str:
        seen = [n for n in CAMERAS if getattr(self, n) is not None]
        return f"<fastibl.Frame at {self.time:.3f} s: {' and '.join(seen) or 'no picture'}>"


def _same(a: Any, b: Any) -> bool:
    """Of pictures, poses or matrices, or None."""
    a, b = (x.matrix if isinstance(x, Pose) else x for x in (a, b))
    return a is b if a is None or b is None else np.array_equal(a, b)


class RecordingWarning(UserWarning):
    """A recording or film ends early, a part of it cannot be kept, or its colours are not what they are taken for."""


@dataclass(eq=False)
class Truth:
    """What is known of a recording besides its pictures.

    maps: (time from which it holds, environment map at the object), in order.
    poses: (time, back_from_marker), in order.
    lamp_time: when a lamp was switched on, or None.
    hand: times at which a hand began and ceased to cover the front camera, or None.
    position: the place from which the maps are seen, marker frame, metres.
    clock_offset: seconds; all times here are by the poses' clock, which shows `time` + clock_offset when a picture
    stamped `time` begins.
    """

    maps: Sequence[tuple[float, CubeMap]] = ()
    poses: Sequence[tuple[float, Pose]] = ()
    lamp_time: float | None = None
    hand: tuple[float, float] | None = None
    position: tuple[float, float, float] = (0.0, 0.0, 0.06)
    clock_offset: float = 0.0

    def environment(self, time: float) -> CubeMap:
        """The environment map that holds at `time`; before the first map's time, the first. LookupError if there are no
        maps."""
        if not self.maps:
            raise LookupError("this recording holds no true environment map")
        return self.maps[max(0, bisect.bisect_right([t for t, _ in self.maps], time) - 1)][1]

    def pose(self, time: float) -> Pose:
        """back_from_marker of the frame at `time` (within 1 ms). LookupError where it is not known."""
        times = [t for t, _ in self.poses]
        k = bisect.bisect_left(times, time)
        near = [i for i in (k - 1, k) if 0 <= i < len(times) and abs(times[i] - time) <= 1e-3]
        if not near:
            raise LookupError(f"this recording holds no true pose at {time} s")
        return self.poses[min(near, key=lambda i: abs(times[i] - time))][1]


class Recording:
    """Frames of a rig, in order of time; iterate as often as you like.

    .rig, .board (None where there is none), .truth (None where nothing is known), .path (None in memory). A
    picture that is missing or broken ends the iteration with a RecordingWarning that names it.
    """

    def __init__(
        self,
        rig: Rig,
        frames: Sequence[Frame] = (),
        board: Any = None,
        truth: Truth | None = None,
        path: Path | None = None,
    ):
        self.rig, self.board, self.truth, self.path = rig, board, truth, path
        self._frames = frames

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Recording:
        """The recording in a folder. FileNotFoundError or ValueError names what is wrong."""
        path = Path(path)
        if not path.is_dir():
            raise FileNotFoundError(f"no recording at {path}: expected a folder with rig.yaml and frames.csv")
        rig = read_rig(_inside(path, "rig.yaml"))
        frames = _StoredFrames(path)
        if rig.front is None and any("front" in pictures for _, pictures in frames.moments):
            raise ValueError(f"{path / 'frames.csv'} lists front pictures, but rig.yaml has no front camera")
        board = read_board(_inside(path, "board.yaml")) if (path / "board.yaml").is_file() else None
        truth = _read_truth(path / "truth") if (path / "truth").is_dir() else None
        return cls(rig, frames, board, truth, path)

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        return iter(self._frames)

    def __getitem__(self, index: int) -> Frame:
        """One frame. Raises OSError where a picture of it is missing or broken; TypeError for a slice, because frames
        are large."""
        expect(index, SupportsIndex, "index", "[recording[k] for k in range(…)] makes a list of frames")
        return self._frames[index]

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        times = self.times
        return times[-1] - times[0] if times else 0.0

    @property
    def times(self) -> list[float]:
        """Time of each frame in seconds, without reading pictures."""
        if isinstance(self._frames, _StoredFrames):
            return [time for time, _ in self._frames.moments]
        if hasattr(self._frames, "times"):
            return list(self._frames.times)
        return [frame.time for frame in self._frames]

    @property
    def back_times(self) -> list[float]:
        """Time in seconds of each frame that has a back picture, without reading pictures; front pictures may come
        between."""
        times = self.times
        return [times[k] for k in self.pictured("back")]

    def pictured(self, camera: str) -> list[int]:
        """Numbers of the frames that have a picture of a camera, "back" or "front"; of all frames where pictures are
        made when they are asked for."""
        if isinstance(self._frames, _StoredFrames):
            return [k for k, (_, pictures) in enumerate(self._frames.moments) if camera in pictures]
        if isinstance(self._frames, (list, tuple)):
            return [k for k, frame in enumerate(self._frames) if getattr(frame, camera) is not None]
        return list(range(len(self)))

    def __repr__(self) -> str:
        where = f" at {self.path}" if self.path else ""
        return f"<fastibl.Recording of {len(self)} frames, {self.duration:.1f} s{where}>"


def _foreign(item: Path) -> str:
    """The first file in a folder that no recording writes; the item itself if it is such a file or folder; "" if there
    is none."""
    inside = _FOLDERS.get(item.name)
    if item.is_symlink() or not (item.is_dir() if inside else item.is_file() and item.name in _FILES):
        return item.name
    if inside is None:
        return ""
    files = sorted(item.iterdir())
    return next((f"{item.name}/{f.name}" for f in files if f.is_dir() or not inside.fullmatch(f.name)), "")


@dataclass
class _Moment:
    """The frame that is being written, as it will be read: pictures of one time, one of each camera."""

    time: float = np.nan
    cameras: set[str] = field(default_factory=set)
    told: bool = False  # whether its attitude is written
    untold: int = 0  # frames of this time before it that have none, and no row that says so

    def take(self, time: float, camera: str) -> None:
        if time != self.time:
            self.time, self.cameras, self.told, self.untold = time, {camera}, False, 0
        elif camera in self.cameras:
            self.untold += not self.told
            self.cameras, self.told = {camera}, False
        else:
            self.cameras.add(camera)


class RecordingWriter:
    """Writes a recording, picture by picture; a context manager.

    path: a folder that does not exist or is empty; an older recording there is replaced, once all that is known
    beforehand is in order. video: whether to write lossless FFV1 videos instead of one PNG per picture. FileExistsError
    for a folder that holds anything else, including pictures of other names; ValueError for videos of an odd width or
    height; TypeError for what is not a Rig. close() raises OSError where a video does not hold all that was written.
    """

    def __init__(self, path: str | os.PathLike[str], rig: Rig, board: Any = None, video: bool = False):
        self.path, self._rig = Path(path), rig
        expect(rig, Rig, "rig")
        for name in CAMERAS if video else ():
            camera = getattr(rig, name)
            if camera is not None and (camera.width % 2 or camera.height % 2):  # OpenCV would cut the rest off
                raise ValueError(
                    f"videos are of even width and height, but the {name} camera's pictures are of "
                    f"{camera.width} x {camera.height} pixels; write pictures instead"
                )
        with tempfile.TemporaryDirectory() as made:
            write_rig(Path(made) / "rig.yaml", rig)
            if board is not None:
                write_board(Path(made) / "board.yaml", board)
            self._clear()
            self.path.mkdir(parents=True, exist_ok=True)
            for file in Path(made).iterdir():
                (self.path / file.name).write_bytes(file.read_bytes())
        self._videos: dict[str, cv2.VideoWriter] | None = {} if video else None
        self._counts = dict.fromkeys(CAMERAS, 0)
        self._file = open(self.path / "frames.csv", "w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(("time", "camera", "file", "exposure"))
        self._attitudes: TextIO | None = None
        self._moment = _Moment()
        self._told_of_poses = False

    @staticmethod
    def check_path(path: str | os.PathLike[str]) -> None:
        """Raises FileExistsError where no recording can be written: at a file, or a folder that holds other things."""
        path = Path(path)
        if path.exists() and not path.is_dir():
            raise FileExistsError(f"{path} is a file; a recording is a folder")
        here = sorted(path.iterdir()) if path.is_dir() else []
        other = next(filter(None, map(_foreign, here)), "")
        if other:
            raise FileExistsError(f"{path} holds {other}, which no recording writes; choose another folder")
        if here and not (path / "rig.yaml").is_file():
            raise FileExistsError(
                f"{path} holds {here[0].name}, and no rig.yaml: it is no recording; choose another folder"
            )

    def _clear(self) -> None:
        self.check_path(self.path)
        for item in self.path.iterdir() if self.path.is_dir() else ():
            if item.name in _FOLDERS:
                for file in item.iterdir():
                    file.unlink()
                item.rmdir()
            else:
                item.unlink()

    def add(self, frame: Frame) -> None:
        """Stores the pictures of a frame and its attitude; poses are not kept, and a warning says so once.

        ValueError, before anything of the frame is stored, for what is not a (h, w, 3) uint8 or uint16 picture of the
        rig's camera (uint8 in a recording of videos), an attitude that is not a rotation, a time that is not finite, or
        an exposure that is not positive.
        """
        if not np.isfinite(frame.time):
            raise ValueError(f"a frame's time must be finite seconds, got {frame.time}")
        for camera in CAMERAS:
            exposure = getattr(frame, f"{camera}_exposure")
            if exposure is not None and not (np.isfinite(exposure) and exposure > 0):
                raise ValueError(f"the {camera} exposure must be positive and finite, got {exposure}")
        if frame.back_from_marker is not None and not self._told_of_poses:
            self._told_of_poses = True
            warnings.warn("a recording keeps no given poses: boards are tracked in its pictures", RecordingWarning, 2)
        attitude = None if frame.attitude is None else _attitude_of(frame.attitude, f"the attitude at {frame.time} s")
        for camera, picture in [(camera, self._checked(frame, camera)) for camera in CAMERAS]:
            if picture is None:
                continue
            name = self._store(camera, np.ascontiguousarray(picture[..., ::-1]))
            exposure = getattr(frame, f"{camera}_exposure")
            told = "" if exposure is None else repr(float(exposure))
            self._rows.writerow((repr(float(frame.time)), camera, name, told))
            self._moment.take(frame.time, camera)
        self._file.flush()  # so that what was recorded survives a crash
        if attitude is not None and self._moment.time == frame.time and not self._moment.told:
            self._add_attitude(frame.time, attitude)

    def _checked(self, frame: Frame, camera: str) -> NDArray[Any] | None:
        picture = getattr(frame, camera)
        if picture is None:
            return None
        picture, of = np.asarray(picture), getattr(self._rig, camera)
        kinds = ("uint8", "uint16") if self._videos is None else ("uint8",)
        if picture.dtype not in kinds or picture.ndim != 3 or picture.shape[2] != 3:
            wanted = " or ".join(kinds)
            raise ValueError(f"the {camera} picture must be (h, w, 3) {wanted}, got {picture.shape} {picture.dtype}")
        if of is None:
            raise ValueError(f"the rig has no {camera} camera, but a frame has a {camera} picture")
        if picture.shape[:2] != (of.height, of.width):
            raise ValueError(
                f"the {camera} picture must be {of.width} x {of.height} pixels, as its camera in the rig, "
                f"got {picture.shape[1]} x {picture.shape[0]}"
            )
        return picture

    def _add_attitude(self, time: float, attitude: NDArray) -> None:
        if self._attitudes is None:
            self._attitudes = open(self.path / "attitudes.csv", "w", newline="", encoding="utf-8")
            csv.writer(self._attitudes, lineterminator="\n").writerow(_ATTITUDE_COLUMNS)
        rows = csv.writer(self._attitudes, lineterminator="\n")
        rows.writerows([_attitude_row(time, None)] * self._moment.untold)
        rows.writerow(_attitude_row(time, attitude))
        self._moment.told, self._moment.untold = True, 0
        self._attitudes.flush()

    def sync(self) -> None:
        """Writes the lists through to the disk: what they name then survives if the machine stops."""
        for file in (self._file, self._attitudes):
            if file is not None:
                os.fsync(file.fileno())

    def _store(self, camera: str, picture: NDArray) -> str:
        import cv2

        number = self._counts[camera]
        self._counts[camera] += 1
        if self._videos is None:
            name = f"{camera}/{number:05d}.png"
            (self.path / camera).mkdir(exist_ok=True)
            # cv2.imwrite would not notice a full disk.
            _, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
            (self.path / name).write_bytes(data.tobytes())
            return name
        file = self.path / f"{camera}.mkv"
        if camera not in self._videos:
            size = (picture.shape[1], picture.shape[0])
            writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"FFV1"), 30, size)
            if not writer.isOpened():
                raise OSError(f"this OpenCV cannot write FFV1 video to {file}; write pictures instead")
            self._videos[camera] = writer
        check_free(self.path, 2 * picture.nbytes)
        self._videos[camera].write(picture)
        return f"{file.name}#{number}"

    def write_truth(self, truth: Truth) -> None:
        folder = self.path / "truth"
        folder.mkdir(exist_ok=True)
        with open(folder / "maps.csv", "w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(("time", "file"))
            for k, (time, cube) in enumerate(truth.maps):
                np.save(folder / f"map-{k}.npy", np.ascontiguousarray(cube.faces))
                rows.writerow((repr(float(time)), f"map-{k}.npy"))
        with open(folder / "poses.csv", "w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(("time", *(f"m{i}{j}" for i in range(3) for j in range(4))))
            for time, pose in truth.poses:
                rows.writerow((repr(float(time)), *(repr(float(v)) for v in pose.matrix[:3].ravel())))
        events = {
            "lamp": truth.lamp_time,
            "hand": list(truth.hand) if truth.hand else None,
            "position": list(truth.position),
        }
        if truth.clock_offset:
            events["clock_offset"] = float(truth.clock_offset)
        (folder / "events.json").write_text(json.dumps(events, indent=2) + "\n", encoding="utf-8")

    def close(self) -> None:
        for writer in (self._videos or {}).values():
            writer.release()
        self._file.close()
        if self._attitudes is not None:
            self._attitudes.close()
        while self._videos:
            camera, _ = self._videos.popitem()
            self._check_whole(self.path / f"{camera}.mkv", self._counts[camera])

    def _check_whole(self, video: Path, count: int) -> None:
        """Raises OSError where a video holds fewer pictures than were written to it: OpenCV does not tell."""
        import cv2

        packets, held = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1]), 0  # not decoded
        while packets.grab():
            held += 1
        if held < count:
            raise OSError(f"{video} holds {held} of {count} pictures: is the disk full?")

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def write_attitudes(path: str | os.PathLike[str], attitudes: Sequence[ArrayLike | None]) -> int:
    """Stores attitudes in a recording, replacing those already there, and returns how many there are now.

    path: its folder. attitudes: Frame.attitude of each of its frames, or None. Raises ValueError for another number of
    them or for what is not a rotation, OSError where they cannot be written.
    """
    path = Path(path)
    times = [time for time, _ in _read_moments(_inside(path, "frames.csv"))]
    if len(attitudes) != len(times):
        raise ValueError(f"expected attitudes of {len(times)} frames, got {len(attitudes)}")
    given = [
        None if a is None else _attitude_of(a, f"the attitude at {t} s") for t, a in zip(times, attitudes, strict=True)
    ]
    together = Counter(times)  # frames of one time are told apart by their order
    rows = [_attitude_row(t, a) for t, a in zip(times, given, strict=True) if a is not None or together[t] > 1]
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([_ATTITUDE_COLUMNS, *rows])
    write_whole(_inside(path, "attitudes.csv"), text.getvalue())
    return sum(a is not None for a in given)


class _StoredFrames(Sequence[Frame]):
    """Frames that are read only when they are asked for."""

    def __init__(self, path: Path):
        self.path = path
        self.moments = _read_moments(_inside(path, "frames.csv"))
        attitudes = _read_attitudes(_inside(path, "attitudes.csv"))
        each = {time: iter(of_time) for time, of_time in attitudes.items()}  # frames of one time: one after the other
        self.attitudes = [next(each.get(time, iter(())), None) for time, _ in self.moments]
        self._videos: dict[str, tuple[cv2.VideoCapture, int]] = {}
        self._reading = threading.Lock()  # FFmpeg ends the process where two threads read one video
        self._looked_at = set[str]()  # cameras whose primaries were looked at

    def __len__(self) -> int:
        return len(self.moments)

    def __getitem__(self, index: Any) -> Any:
        time, pictures = self.moments[index]
        frame = Frame(time, attitude=self.attitudes[index])
        for camera, (file, exposure) in pictures.items():
            setattr(frame, camera, self._read(file))
            setattr(frame, f"{camera}_exposure", exposure)
            if camera not in self._looked_at and "#" not in file:
                self._looked_at.add(camera)
                warn_of_primaries(_inside(self.path, file), stacklevel=4)
        return frame

    def __iter__(self) -> Iterator[Frame]:
        for index in range(len(self)):
            try:
                frame = self[index]
            except OSError as error:
                warnings.warn(
                    f"{error}; {index} of {len(self)} frames were read",
                    RecordingWarning,
                    stacklevel=2,
                )
                return
            yield frame

    def _read(self, file: str) -> NDArray[Any]:
        name, mark, number = file.rpartition("#")
        if mark:
            with self._reading:
                picture = self._read_video(name, int(number))
        else:
            picture = self._read_picture(file)
        return np.ascontiguousarray(picture[..., ::-1])

    def _read_picture(self, file: str) -> NDArray[Any]:
        import cv2

        path = _inside(self.path, file)
        if not path.is_file():
            raise FileNotFoundError(f"the picture {path} is missing")
        try:
            data = file_bytes(path)
            check_pixels(path, *_PICTURES[path.suffix.lower()](data))
            picture = decode_pixels(np.frombuffer(data, np.uint8), any_depth=True)
        except (ValueError, cv2.error) as error:
            raise OSError(f"the picture {path} cannot be read: {error}") from None
        if picture is None:
            raise OSError(f"the picture {path} cannot be read; it may be cut off")
        return picture

    def _read_video(self, name: str, number: int) -> NDArray[np.uint8]:
        path = _inside(self.path, name)
        if not path.is_file():
            raise FileNotFoundError(f"the video {path} is missing")
        video, following = self._videos.get(name, (None, 0))
        if video is None or number < following:  # frame by frame: seeking is not exact in every container
            video, following = _open_video(path), 0
        picture: Any = None
        while following <= number:
            read, picture = video.read()
            if not read:
                self._videos.pop(name, None)
                raise OSError(f"the video {path} ends after {following} frames, frame {number} is missing")
            following += 1
        self._videos[name] = video, following
        return picture


def _open_video(path: Path) -> cv2.VideoCapture:
    import cv2

    with open(path, "rb") as file:
        head = file.read(12)
    # Judged by content: FFmpeg would read whatever a playlist of that name refers to, on this disk or on the network.
    if not (head.startswith((b"\x1a\x45\xdf\xa3", b"RIFF")) or head[4:8] == b"ftyp"):
        raise OSError(f"the video {path} cannot be read: it is no Matroska, AVI or MP4 file")
    video = open_film(path)
    if not video.isOpened():
        raise OSError(f"the video {path} cannot be read")
    try:
        check_pixels(path, int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    except ValueError as error:
        raise OSError(f"the video {path} cannot be read: {error}") from None
    return video


def _check_name(name: str, where: str) -> None:
    """Raises ValueError for a file name that leads out of its folder on any system."""
    for path in (PurePosixPath(name), PureWindowsPath(name)):
        if path.is_absolute() or path.drive or ".." in path.parts or "\0" in name:
            raise ValueError(f"{where}: a file must lie in the recording's folder, got {name!r}")


def _inside(folder: Path, name: str) -> Path:
    """The path of a file in a folder. Raises OSError if a link leads to a place outside it."""
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise OSError(f"{path} leads out of the recording, to {path.resolve()}")
    return path


def _read_moments(path: Path) -> list[tuple[float, dict[str, tuple[str, float | None]]]]:
    if not path.is_file():
        raise FileNotFoundError(f"the recording has no {path.name}: expected {path}")
    moments: dict[float, list[dict[str, tuple[str, float | None]]]] = {}
    try:
        _list_moments(path, moments)
    except csv.Error as error:
        raise ValueError(f"{path} is no list of pictures: {error}") from None
    return [(time, pictures) for time, each in sorted(moments.items(), key=lambda item: item[0]) for pictures in each]


def _list_moments(path: Path, moments: dict[float, list[dict[str, tuple[str, float | None]]]]) -> None:
    with io.StringIO(text_of(path, _MOST_TEXT), newline="") as file:
        rows = csv.DictReader(_whole_lines(file, path), skipinitialspace=True)
        missing = {"time", "camera", "file", "exposure"} - set(rows.fieldnames or ())
        if missing:
            raise ValueError(f"{path} has no column {sorted(missing)[0]}; expected time, camera, file, exposure")
        for row in rows:
            where = f"{path} line {rows.line_num}"
            try:
                time = float(row["time"])
                exposure = float(row["exposure"]) if row["exposure"] != "" else None
            except (TypeError, ValueError):
                raise ValueError(
                    f"{where}: time and exposure must be numbers, got {row['time']!r} and {row['exposure']!r}"
                ) from None
            if not (np.isfinite(time) and (exposure is None or (np.isfinite(exposure) and exposure > 0))):
                raise ValueError(f"{where}: time must be finite and exposure positive")
            if row["camera"] not in CAMERAS:
                raise ValueError(f"{where}: camera must be back or front, got {row['camera']!r}")
            name, mark, number = (row["file"] or "").rpartition("#")
            if not row["file"] or (mark and not (name and re.fullmatch("[0-9]{1,9}", number))):
                raise ValueError(f"{where}: expected a picture or video#number, got {str(row['file'])[:80]!r}")
            if not mark and PurePosixPath(row["file"]).suffix.lower() not in _PICTURES:
                raise ValueError(f"{where}: pictures end in {', '.join(_PICTURES)}, got {row['file']!r}")
            _check_name(name if mark else row["file"], where)
            here = moments.setdefault(time, [{}])
            if row["camera"] in here[-1]:  # a second picture of this camera at that time
                here.append({})
            here[-1][row["camera"]] = row["file"], exposure


def _attitude_of(attitude: ArrayLike, what: str) -> NDArray[np.float64]:
    """(3, 3) float64. Raises ValueError, naming `what`, for anything but a rotation."""
    try:
        m = np.asarray(attitude, np.float64)
    except (TypeError, ValueError):
        m = np.empty(0)
    square = m.shape == (3, 3) and np.abs(m.T @ m - np.eye(3)).sum() < 1e-3 and np.linalg.det(m) > 0
    if not square:
        raise ValueError(f"{what} must be a rotation, (3, 3), got {attitude!r}")
    return m


def _attitude_row(time: float, attitude: NDArray | None) -> tuple[float | str, ...]:
    """None: a frame without one, of a time that another frame has, too."""
    return float(time), *([""] * 9 if attitude is None else attitude.ravel().tolist())


def _read_attitudes(path: Path) -> dict[float, list[NDArray[np.float64] | None]]:
    """Attitudes by time, in their order; empty where there is no such list."""
    if not path.is_file():
        return {}
    attitudes: dict[float, list[NDArray[np.float64] | None]] = {}
    with io.StringIO(text_of(path, _MOST_TEXT), newline="") as file:
        for number, line in enumerate(_whole_lines(file, path), 1):
            cells = line.strip().split(",")
            if number == 1:
                if tuple(cells) != _ATTITUDE_COLUMNS:
                    raise ValueError(f"{path} must have the columns {', '.join(_ATTITUDE_COLUMNS)}, got {cells}")
                continue
            where = f"{path} line {number}"
            without = len(cells) == len(_ATTITUDE_COLUMNS) and not any(cells[1:])
            try:
                time, *numbers = map(float, cells[:1] if without else cells)
                matrix = None if without else np.reshape(numbers, (3, 3))
            except ValueError:
                raise ValueError(f"{where}: expected ten numbers, got {cells}") from None
            here = attitudes.setdefault(time, [])
            here.append(None if matrix is None else _attitude_of(matrix, f"{where}: the attitude"))
    return attitudes


def _whole_lines(file: TextIO, path: Path) -> Iterator[str]:
    """The lines, without a last one that a crash cut off."""
    for line in file:
        if line.endswith(("\n", "\r")):
            yield line
        else:
            warnings.warn(f"the last line of {path} is cut off; it is left out", RecordingWarning, stacklevel=4)


def warn_of_primaries(path: Path, stacklevel: int = 3) -> None:
    """Gives a RecordingWarning where a camera's picture states other primaries than those of Rec. 709."""
    if stated := of_picture(file_bytes(path)):
        warnings.warn(
            f"{path} has the primaries of {stated.name}; its codes are taken for those of Rec. 709, so that colours of "
            "the light and of the object differ; convert the pictures to sRGB",
            RecordingWarning,
            stacklevel=stacklevel,
        )


def _load(path: Path) -> NDArray:
    check_file_size(path)
    try:
        # Mapped, so that a header that claims more than the file holds takes no memory.
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy raises whatever the parser of its header raises
        raise ValueError(f"{path} is not an array that can be read: {error}") from error


def truth_of(recording: Recording) -> Truth:
    """What is known of a recording besides its pictures; of most recordings nothing is."""
    return recording.truth or Truth()


def _finite(value: Any, what: str) -> float:
    number = float(value)
    if not np.isfinite(number):
        raise ValueError(f"{what} must be a finite number, got {value}")
    return number


def _read_truth(folder: Path) -> Truth:
    truth = Truth()

    def rows(name: str) -> list[list[str]]:
        if not (folder / name).is_file():
            return []
        read = csv.reader(io.StringIO(text_of(_inside(folder, name), _MOST_TEXT), newline=""))
        return [row for row in read if row][1:]  # blank lines are none

    try:
        maps = []
        for time, name in rows("maps.csv"):
            _check_name(name, "maps.csv")
            if not (folder / name).is_file():
                raise FileNotFoundError(f"the true map {folder / name} is missing")
            maps.append((_finite(time, "the time of a map"), CubeMap(_load(_inside(folder, name)))))
        truth.maps = sorted(maps, key=lambda m: m[0])
        poses = [
            (
                _finite(row[0], "the time of a pose"),
                Pose(np.vstack([np.array(row[1:], np.float64).reshape(3, 4), [0, 0, 0, 1]])),
            )
            for row in rows("poses.csv")
        ]
        truth.poses = sorted(poses, key=lambda p: p[0])
        if (folder / "events.json").is_file():
            events = json.loads(text_of(_inside(folder, "events.json"), _MOST_EVENTS))
            if events.get("lamp") is not None:
                truth.lamp_time = _finite(events["lamp"], "lamp")
            if events.get("hand"):
                begin, end = (_finite(time, "hand") for time in events["hand"])
                truth.hand = begin, end
            x, y, z = (_finite(c, "position") for c in events.get("position", truth.position))
            truth.position = x, y, z
            truth.clock_offset = _finite(events.get("clock_offset", 0.0), "clock_offset")
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, csv.Error) as error:
        said = error if isinstance(error, ValueError) else repr(error)
        raise ValueError(f"{folder} cannot be read: {said}") from error
    return truth
