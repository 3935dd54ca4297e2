"""Frames from cameras, files and folders. FakeCapture plays cv2.VideoCapture's part: no camera is needed."""

import struct
import threading
import time
import warnings
from fractions import Fraction

import cv2
import numpy as np
import pytest
from board_pictures import held

import fastibl
from conftest import same_error
from fastibl import camera_files, sources
from fastibl.camera_files import FilmOfBt709, FilmTimes, hdr_curve, read_pixels
from fastibl.exposure import Bracket
from fastibl.live_camera import LiveCamera
from fastibl.picture_headers import camera_picture_size

CAMERA = fastibl.Camera(64, 48, 50, 50, 32, 24)
TURN = fastibl.Pose.from_rotation_vector([0, np.pi, 0], [0, 0, 0])
RIG = fastibl.Rig(CAMERA, CAMERA, TURN)


class Driver:
    """What several FakeCaptures share: a camera that can be unplugged. Its pictures count in their pixels."""

    def __init__(self, period=0.004, backend="V4L2", size=(64, 48), tells=True):
        self.period, self.backend, self.size, self.tells = period, backend, size, tells
        self.plugged, self.count, self.opened = True, 0, 0
        self.properties = {cv2.CAP_PROP_EXPOSURE: 80.0}  # 8 ms

    def open(self, device):
        self.opened += 1
        return FakeCapture(self)


class FakeCapture:
    def __init__(self, driver):
        self.driver, self.alive = driver, driver.plugged

    def isOpened(self):  # noqa: N802 - OpenCV's names
        return self.alive

    def getBackendName(self):  # noqa: N802
        return self.driver.backend

    def get(self, which):
        return self.driver.properties.get(which, 0.0) if self.driver.tells else 0.0

    def set(self, which, value):
        if not self.driver.tells and which in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_AUTO_EXPOSURE):
            return False
        self.driver.properties[which] = value
        return True

    def grab(self):
        time.sleep(self.driver.period)
        self.alive &= self.driver.plugged
        return self.alive

    def retrieve(self):
        if not self.alive:
            return False, None
        self.driver.count += 1
        width, height = self.driver.size
        picture = np.zeros((height, width, 3), np.uint8)
        picture[..., 0], picture[..., 2] = 7, self.driver.count % 251  # BGR
        return True, picture

    def release(self):
        self.alive = False


def waited(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.002)
    return condition()


def camera_source(drivers, **options):
    """A source of cameras by name."""
    names = list(drivers)
    return sources.CameraSource(
        RIG if "front" in names else fastibl.Rig(CAMERA),
        back="back" if "back" in names else None,
        front="front" if "front" in names else None,
        open_capture=lambda device: drivers[device].open(device),
        retry=0.02,
        **options,
    )


def test_a_camera_gives_its_newest_picture():
    driver = Driver()
    with LiveCamera(0, (64, 48), open_capture=driver.open) as camera:
        first = camera.newest(5.0)
        assert first.image.shape == (48, 64, 3) and (first.image[..., 2] == 7).all()  # RGB
        assert first.number == 1 and driver.count > 10, "a camera must find its exposure first"
        time.sleep(0.1)
        later = camera.newest(0.0)
        assert later.number > 3 and camera.dropped >= later.number - 2
        assert later.time > first.time and camera.newest(0.0) is None or camera.newest(0.0).number > later.number
    assert not waited(lambda: camera.newest(0.0) is not None, 0.05)
    assert driver.properties[cv2.CAP_PROP_FRAME_WIDTH] == 64 and driver.properties[cv2.CAP_PROP_AUTO_EXPOSURE] == 1
    assert driver.properties[cv2.CAP_PROP_AUTO_WB] == 0


@pytest.mark.parametrize(
    "backend, units, exposure", [("V4L2", 80.0, 0.8), ("DSHOW", -7.0, 2**-7 / 0.01), ("UNKNOWN", 3.0, 1.0)]
)
def test_exposures_are_read_in_the_units_of_the_driver(backend, units, exposure):
    driver = Driver(backend=backend)
    driver.properties[cv2.CAP_PROP_EXPOSURE] = units
    with LiveCamera(0, open_capture=driver.open) as camera:
        assert camera.newest(5.0).exposure == pytest.approx(exposure)


def test_an_exposure_that_is_not_told_is_unknown():
    lines = []
    with LiveCamera(0, open_capture=Driver(tells=False).open, log=lines.append) as camera:
        assert camera.newest(5.0).exposure is None
    assert "cannot hold its exposure" in lines[0]


def test_a_set_exposure_is_unknown_until_it_holds():
    driver = Driver()
    with LiveCamera(0, open_capture=driver.open) as camera:
        before = camera.newest(5.0)
        assert before.exposure == pytest.approx(0.8)
        camera.set_exposure(0.05)
        seen = []
        while len(seen) < 40 and (not seen or seen[-1].exposure != pytest.approx(0.05)):
            seen.append(camera.newest(5.0))
        exposures = [shot.exposure for shot in seen]
        assert exposures[-1] == pytest.approx(0.05) and driver.properties[cv2.CAP_PROP_EXPOSURE] == 5
        assert set(exposures[:-1]) <= {before.exposure, None}
        with pytest.raises(ValueError, match="positive"):
            camera.set_exposure(0)


def test_unplugged_and_plugged_in_again():
    driver, lines = Driver(), []
    with LiveCamera(0, open_capture=driver.open, retry=0.02, log=lines.append) as camera:
        assert camera.newest(5.0) is not None and camera.connected
        driver.plugged = False
        assert waited(lambda: not camera.connected)
        camera.newest(0.0)
        assert camera.newest(0.05) is None
        driver.plugged = True
        assert camera.newest(5.0) is not None and waited(lambda: camera.connected)
        assert camera.lost == 1 and driver.opened > 2
    assert any("gives no more pictures" in line for line in lines) and "gives pictures now" in lines[-1]


@pytest.mark.parametrize("tells", [True, False])
def test_a_camera_that_opens_and_gives_nothing_is_told_of_once(tells):
    class Busy(FakeCapture):
        def grab(self):
            return False

    driver, lines, busy = Driver(tells=tells), [], [True]
    opened = lambda device: Busy(driver) if busy[0] else driver.open(device)  # noqa: E731
    with LiveCamera(0, open_capture=opened, retry=0.005, log=lines.append) as camera:
        assert waited(lambda: lines)
        time.sleep(1.2)  # it is tried again
        assert camera.newest(0.0) is None
        told = list(lines)
        busy[0] = False
        assert camera.newest(5.0) is not None
    assert len(told) == 1 and "opens, but gives no pictures" in told[0]
    assert "gives pictures now" in lines[-1]


def test_a_camera_that_takes_its_time_to_start():
    class Slow(FakeCapture):
        failures = 20

        def grab(self):
            self.failures -= 1
            return self.failures < 0 and super().grab()

    driver, lines = Driver(), []
    with LiveCamera(0, open_capture=lambda _: Slow(driver), retry=0.01, log=lines.append) as camera:
        assert camera.newest(5.0) is not None
    assert not lines


def test_an_exposure_that_a_driver_refuses_and_changes_is_not_the_old_one():
    driver = Driver()

    class Clamping(FakeCapture):
        def set(self, which, value):
            super().set(which, max(value, 30.0) if which == cv2.CAP_PROP_EXPOSURE else value)
            return which != cv2.CAP_PROP_EXPOSURE or value >= 30

    with LiveCamera(0, open_capture=lambda _: Clamping(driver)) as camera:
        assert camera.newest(5.0).exposure == pytest.approx(0.8)
        camera.set_exposure(0.05)
        assert waited(lambda: (shot := camera.newest(1.0)) is not None and shot.exposure == pytest.approx(0.3))


def test_a_driver_that_raises_is_tried_again():
    driver, calls = Driver(), []

    def broken(device):
        calls.append(device)
        if len(calls) < 3:
            raise RuntimeError("no such device")
        return driver.open(device)

    with LiveCamera("/dev/nowhere", open_capture=broken, retry=0.01) as camera:
        assert camera.newest(5.0) is not None
    assert len(calls) == 3


def taken(source, count):
    frames = []
    for frame in source:
        frames.append(frame)
        if len(frames) == count:
            break
    return frames


def test_two_cameras_in_step_make_pairs():
    with camera_source({"back": Driver(0.03), "front": Driver(0.03)}, together=0.03) as source:
        frames = taken(source, 12)
    pairs = sum(f.back is not None and f.front is not None for f in frames)
    assert pairs >= 6, [repr(f) for f in frames]
    assert all(b.time >= a.time for a, b in zip(frames, frames[1:], strict=False))
    assert frames[-1].back_exposure == pytest.approx(0.8)


def test_cameras_of_other_rhythms_come_as_they_are():
    with camera_source({"back": Driver(0.004), "front": Driver(0.02)}, together=0.001) as source:
        assert waited(lambda: source.cameras["front"].connected)
        frames = taken(source, 60)
    assert any(f.front is not None for f in frames) and sum(f.back is not None for f in frames) > 40
    assert all(b.time >= a.time for a, b in zip(frames, frames[1:], strict=False))


def test_a_session_goes_on_without_an_unplugged_camera():
    drivers = {"back": Driver(), "front": Driver()}
    with camera_source(drivers) as source:
        assert any(f.front is not None for f in taken(source, 20))
        drivers["front"].plugged = False
        assert waited(lambda: not source.cameras["front"].connected)
        taken(source, 2)
        assert all(f.front is None and f.back is not None for f in taken(source, 10))
        drivers["front"].plugged = True
        assert waited(lambda: any(f.front is not None for f in taken(source, 5)))


def test_without_any_camera_it_ends_by_patience_or_close():
    drivers = {"back": Driver()}
    drivers["back"].plugged = False
    with camera_source(drivers, patience=0.1) as source:
        assert list(source) == []
    with camera_source(drivers) as source:
        threading.Timer(0.05, source.close).start()
        assert list(source) == []


def test_waiting_ends_with_a_picture_or_the_end():
    driver = Driver()
    driver.plugged = False
    with camera_source({"back": driver}) as source:
        assert source.patience == np.inf and not source.wait(0.02)
        driver.plugged = True
        assert source.wait(5.0) and source.wait(0.0), "what was waited for comes next"
        assert taken(source, 1)[0].back is not None and not source.gave_up
    assert source.wait(5.0) and list(source) == [] and not source.gave_up
    driver.plugged = False
    with camera_source({"back": driver}, patience=0.1) as source:
        assert list(source) == [] and source.gave_up
        driver.plugged, source.patience = True, np.inf
        assert taken(source, 1) and not source.gave_up, "iterated again, it waits again"


def test_pictures_of_another_size_are_refused():
    lines = []
    with camera_source({"back": Driver(size=(32, 24))}, patience=0.2, log=lines.append) as source:
        assert list(source) == [] and source.refused > 3
    assert sum("calibrated for 64 x 48, but gives 32 x 24" in line for line in lines) == 1


def test_a_schedule_is_asked_after_each_picture():
    driver = Driver()
    with camera_source({"back": driver}, schedules={"back": Bracket((1, 1 / 4, 1 / 16))}) as source:
        exposures = [f.back_exposure for f in taken(source, 8)]
    # One picture more of each may be on its way when the next exposure is set.
    changes = [e for k, e in enumerate(exposures) if k == 0 or e != exposures[k - 1]]
    assert len(changes) >= 4 and changes == pytest.approx(([0.8, 0.2, 0.05] * 3)[: len(changes)])


def test_wrong_cameras():
    with pytest.raises(ValueError, match="a camera is needed"):
        sources.CameraSource(RIG, None, None)
    with pytest.raises(ValueError, match="rig has none"):
        sources.CameraSource(fastibl.Rig(CAMERA), None, 1)


# Files


def write_video(path, count, first=0, size=(64, 48)):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), 20, size)
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no FFV1")
    for k in range(count):
        picture = np.random.default_rng(k).integers(0, 256, (size[1], size[0], 3), np.uint8)
        picture[0, 0, 2] = first + k
        writer.write(picture)
    writer.release()
    return path


def hdr_video(path, transfer, kind=b"nclx", matrix=9):
    """A film whose description says another curve: kind is nclx in an .mp4, nclc in QuickTime's .mov."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 20, (64, 48))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no mp4v")
    for k in range(3):
        writer.write(np.full((48, 64, 3), 80 * k, np.uint8))
    writer.release()
    data, colour = path.read_bytes(), b"colr" + kind + bytes([0, 9, 0, transfer, 0, matrix, 0])
    added = (len(colour) + 12).to_bytes(4, "big") + b"free" + (len(colour) + 4).to_bytes(4, "big") + colour
    at = data.rindex(b"moov") - 4  # pictures come before it
    size = int.from_bytes(data[at : at + 4], "big")
    assert at + size == len(data)
    path.write_bytes(data[:at] + (size + len(added)).to_bytes(4, "big") + data[at + 4 :] + added)
    return path


def test_a_film_of_a_wide_range_is_told(tmp_path):
    """HLG of a telephone: OpenCV gives 8 bits, and 255 from 0.27 of the light of the brightest on."""
    for transfer, curve in ((18, "HLG"), (16, "PQ"), (1, None)):
        film = hdr_video(tmp_path / f"{transfer}.mp4", transfer)
        assert hdr_curve(film) == curve
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            assert len(list(sources.VideoSource(RIG, film))) == 3
        assert [curve in str(w.message) for w in told] == ([True] if curve else [])
    film = hdr_video(tmp_path / "IMG_0001.mov", 18, b"nclc")  # as telephones write it
    assert hdr_curve(film) == "HLG"
    lines = []
    with LiveCamera(str(film), log=lines.append) as camera:
        assert camera.newest(10) is not None
    assert sum("HLG" in line for line in lines) == 1
    for data in (b"", b"moov", bytes(64), b"\0\0\0\1free" + b"\xff" * 40, b"\0\0\0\0moov", b"RIFF" + bytes(100)):
        (tmp_path / "other").write_bytes(data)
        assert hdr_curve(tmp_path / "other") is None


@pytest.mark.parametrize("ending", ["mov", "mp4", "mkv", "webm"])
def test_containers_tell_of_a_wide_range(tmp_path, ending):
    """Films as FFmpeg writes them, which pictures that look like a statement do not confuse."""
    av = pytest.importorskip("av")
    for transfer, curve in ((18, "HLG"), (16, "PQ"), (1, None)):
        path = tmp_path / f"{transfer}.{ending}"
        with av.open(str(path), "w") as film:
            stream = film.add_stream("libvpx-vp9" if ending == "webm" else "mpeg4", rate=20)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            about = stream.codec_context
            about.color_primaries, about.color_trc, about.colorspace = 9, transfer, 9
            for _ in range(3):
                film.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")))
            film.mux(stream.encode())
        assert hdr_curve(path) == curve
        if ending == "mkv":
            path.write_bytes(path.read_bytes() + b"\x55\xba\x81\x10")
            assert hdr_curve(path) == curve


def test_films_of_bt709_for_an_opencv_that_knows_bt601_alone(tmp_path, monkeypatch):
    """By the luma equations of ITU-R BT.709 and BT.601, as OpenCV before 4.13 reads a film of BT.709."""
    rgb = np.random.default_rng(1).uniform(60, 190, (48, 64, 3))
    luma = rgb @ [0.2126, 0.7152, 0.0722]
    cb, cr = (rgb[..., 2] - luma) / 1.8556, (rgb[..., 0] - luma) / 1.5748
    red, blue = luma + 1.402 * cr, luma + 1.772 * cb
    wrong = np.stack([blue, (luma - 0.299 * red - 0.114 * blue) / 0.587, red], axis=-1)
    assert wrong.min() > 0 and wrong.max() < 255 and np.abs(wrong[..., ::-1] - rgb).max() > 10

    class Film:
        def read(self):
            return True, np.rint(wrong).astype(np.uint8)

        retrieve = read

        def get(self, which):
            return 20.0

    for read in (FilmOfBt709(Film()).read, FilmOfBt709(Film()).retrieve):
        assert np.abs(read()[1][..., ::-1] - rgb).max() <= 1.2
    assert FilmOfBt709(Film()).get(cv2.CAP_PROP_FPS) == 20
    broken = Film()
    broken.read = lambda: (False, None)
    assert FilmOfBt709(broken).read() == (False, None)

    monkeypatch.setattr(camera_files, "knows_bt601_alone", lambda: True)
    for matrix, taken in ((1, True), (6, False), (9, False)):
        film = camera_files.open_film(hdr_video(tmp_path / "film.mov", 1, b"nclc", matrix))
        assert isinstance(film, FilmOfBt709) == taken
        film.release()
    monkeypatch.undo()
    for version, scaler, alone in (("4.12.0", 6, True), ("4.13.0", 9, False), ("4.13.0", 8, True), ("5.0.0", 9, False)):
        monkeypatch.setattr(cv2, "__version__", version)
        monkeypatch.setattr(cv2, "getBuildInformation", lambda v=scaler: f"  swscale:     YES ({v}.1.100)\n")
        assert camera_files.knows_bt601_alone() == alone


def test_videos(tmp_path):
    back, front = write_video(tmp_path / "back.avi", 5), write_video(tmp_path / "front.avi", 3, 100)
    source = sources.VideoSource(RIG, back, front, exposures=(0.5, None))
    for _ in range(2):  # again
        frames = list(source)
        assert [f.time for f in frames] == pytest.approx([0, 0.05, 0.1, 0.15, 0.2])
        assert [f.back[0, 0, 0] for f in frames] == [0, 1, 2, 3, 4]
        assert [None if f.front is None else f.front[0, 0, 0] for f in frames] == [100, 101, 102, None, None]
        assert frames[0].back_exposure == 0.5 and frames[0].front_exposure is None
    assert next(iter(sources.VideoSource(RIG, back))).back_exposure is None, "who took the film chose it"
    assert [f.time for f in sources.VideoSource(RIG, back, fps=10)] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    for after, of_back in ((0.1, [0, 1, 2, 3, 4]), (-0.1, [None, None, 0, 1, 2, 3, 4])):  # films that began apart
        frames = list(sources.VideoSource(RIG, back, front, front_after=after))
        codes = [(f.back, f.front) for f in frames]
        assert [f.time for f in frames] == pytest.approx(0.05 * np.arange(len(of_back)))
        assert [None if b is None else b[0, 0, 0] for b, _ in codes] == of_back
        assert [None if f is None else f[0, 0, 0] for _, f in codes][2 * (after > 0) :][:3] == [100, 101, 102]
    with pytest.raises(ValueError, match="front_after must be finite"):
        sources.VideoSource(RIG, back, front, front_after=np.nan)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        sources.VideoSource(RIG, tmp_path / "nowhere.avi")
    for fps in (0, -5.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="fps must be positive and finite"):
            sources.VideoSource(RIG, back, fps=fps)
    (tmp_path / "empty.avi").write_bytes(b"")
    with pytest.warns(fastibl.recording.RecordingWarning, match="no picture"):
        assert list(sources.VideoSource(RIG, tmp_path / "empty.avi")) == []


def changing_film(path, steps):
    """A film whose pictures, which count, lie these many milliseconds apart."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as film:
        stream = film.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "bgr0"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        for k, time in enumerate(np.cumsum([0, *steps])):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 10 * k, np.uint8), format="rgb24")
            frame.pts, frame.time_base = int(time), Fraction(1, 1000)
            film.mux(stream.encode(frame))
        film.mux(stream.encode())
    return path


def test_a_film_whose_rate_changes_keeps_its_times(tmp_path):
    """Telephones take fewer pictures a second in dim light."""
    steps = [33, 33, 67, 67, 100, 33]
    film, expected = changing_film(tmp_path / "film.mkv", steps), np.cumsum([0, *steps]) / 1000
    assert [f.time for f in sources.VideoSource(RIG, film)] == pytest.approx(expected, abs=1e-6)
    assert [f.time for f in sources.VideoSource(RIG, film, fps=20)] == pytest.approx(np.arange(7) / 20)
    with LiveCamera(str(film)) as camera:
        shots = [camera.newest(5.0) for _ in expected]
    assert [s.image[0, 0, 0] for s in shots] == [10 * k for k in range(7)]
    assert np.array([s.time for s in shots]) - shots[0].time == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "told, times",
    [
        ([0, 0, 0, 0], [0, 0.1, 0.2, 0.3]),  # OpenCV's back ends without times
        ([np.nan, np.nan, np.nan, np.nan], [0, 0.1, 0.2, 0.3]),
        ([500, 560, 540, 900], [0, 0.06, 0.16, 0.4]),
        ([0, 50, np.inf, 400], [0, 0.05, 0.15, 0.4]),
    ],
)
def test_times_that_a_film_does_not_tell(told, times):
    class Film:
        def __init__(self):
            self.told = iter(told)

        def get(self, which):
            return 10.0 if which == cv2.CAP_PROP_FPS else next(self.told)

    film = FilmTimes(Film())
    assert [film.next() for _ in told] == pytest.approx(times)


def test_a_truncated_video_gives_what_it_holds(tmp_path):
    path = write_video(tmp_path / "back.avi", 30)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    frames = list(sources.VideoSource(RIG, path))
    assert 5 < len(frames) < 30 and [f.back[0, 0, 0] for f in frames[:5]] == [0, 1, 2, 3, 4]


def test_folders(tmp_path):
    for name, count in (("back", 3), ("front", 2)):
        (tmp_path / name).mkdir()
        for k in range(count):
            picture = np.full((48, 64, 3), (10, 20, k), np.uint8)
            assert cv2.imwrite(str(tmp_path / name / f"{k:03d}.png"), picture)
    source = sources.FolderSource(RIG, tmp_path / "back", tmp_path / "front", fps=10)
    frames = list(source)
    assert len(source) == 3 and [f.time for f in frames] == pytest.approx([0, 0.1, 0.2])
    assert tuple(frames[1].back[0, 0]) == (1, 20, 10) and frames[2].front is None
    (tmp_path / "back" / "._000.png").write_bytes(b"Mac OS X")
    (tmp_path / "back" / "003.png").mkdir()
    assert len(sources.FolderSource(RIG, tmp_path / "back", fps=10)) == 3
    (tmp_path / "back" / "001.png").write_bytes(b"broken")
    with pytest.warns(fastibl.recording.RecordingWarning, match="001.png"):
        frames = list(source)
    assert [f.back is None for f in frames] == [False, True, False]
    with pytest.raises(FileNotFoundError, match="nowhere"):
        sources.FolderSource(RIG, tmp_path / "nowhere")
    (tmp_path / "none").mkdir()
    with pytest.raises(ValueError, match="no pictures"):
        sources.FolderSource(RIG, tmp_path / "none")


def test_a_folders_pictures_are_the_sensors(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    jpeg = cv2.imencode(".jpg", picture)[1]
    for k in (1, 3, 6):
        (tmp_path / f"{k}.jpg").write_bytes(held(jpeg.tobytes(), k))
    expected = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)[..., ::-1]
    read = list(sources.FolderSource(RIG, tmp_path))
    assert len(read) == 3 and all(np.array_equal(f.back, expected) for f in read)


def test_a_folders_pictures_keep_their_bits(tmp_path):
    deep = np.random.default_rng(0).integers(0, 65536, (48, 64, 3), np.uint16)
    for k, suffix in enumerate(("png", "tif")):
        (tmp_path / f"{k}.{suffix}").write_bytes(cv2.imencode(f".{suffix}", deep)[1].tobytes())
    pictures = [f.back for f in sources.FolderSource(RIG, tmp_path)]
    assert len(pictures) == 2 and all(np.array_equal(p, deep[..., ::-1]) for p in pictures)


PICTURES = [cv2.imencode(end, np.zeros((9, 12, 3), np.uint8))[1].tobytes() for end in (".png", ".jpg", ".bmp", ".tif")]
TAGS = [(256, 4, 12), (257, 3, 9), (258, 3, 8)]
OLD_BMP = struct.pack("<2s4I4H", b"BM", 62, 0, 26, 12, 12, 9, 1, 1) + bytes(36)
BIG_TIFF = struct.pack(">2s3HQQ", b"MM", 43, 8, 0, 16, 3) + b"".join(
    struct.pack(">HHQ" + ("I4x" if kind == 4 else "H6x"), tag, kind, 1, value) for tag, kind, value in TAGS
)  # fmt: skip


@pytest.mark.parametrize("data", [*PICTURES, OLD_BMP, BIG_TIFF])
def test_a_pictures_size_is_checked_by_its_header(data, tmp_path, monkeypatch):
    assert camera_picture_size(data) == (12, 9)
    monkeypatch.setattr("fastibl.file_limits.MOST_PIXELS", 12 * 9 - 1)
    (tmp_path / "0.png").write_bytes(data)  # whatever its name says
    words = "0.png", "12 x 9", "up to 107 pixels"
    same_error(lambda: read_pixels(tmp_path / "0.png"), ValueError, *words)
    with pytest.warns(fastibl.recording.RecordingWarning, match="0.png.*12 x 9"):
        assert list(sources.FolderSource(RIG, tmp_path)) == []
    for end in (20, 40):
        (tmp_path / "0.png").write_bytes(data[:end])
        same_error(lambda: read_pixels(tmp_path / "0.png"), ValueError, "0.png")


def test_a_folders_pictures_come_by_their_numbers(tmp_path):
    for k in (1, 2, 3, 9, 10, 11, 100):
        cv2.imwrite(str(tmp_path / f"shot.{k}.png"), np.full((48, 64, 3), k, np.uint8))
    assert [f.back[0, 0, 0] for f in sources.FolderSource(RIG, tmp_path)] == [1, 2, 3, 9, 10, 11, 100]


def test_a_lost_picture_shifts_no_others(tmp_path):
    """By order, all that follow would be paired with the other camera's next picture, and come too soon."""
    lost = {"back": {7}, "front": {12, 13}}
    for name, gone in lost.items():
        (tmp_path / name).mkdir()
        for k in set(range(5, 35)) - gone:
            cv2.imwrite(str(tmp_path / name / f"{name}2_{2 * k}.png"), np.full((48, 64, 3), k, np.uint8))
    source = sources.FolderSource(RIG, tmp_path / "back", tmp_path / "front", fps=10)
    frames = list(source)
    assert len(frames) == len(source) == 30 and [f.time for f in frames] == pytest.approx(np.arange(30) / 10)
    for name, gone in lost.items():
        seen = [getattr(f, name) for f in frames]
        assert [None if p is None else p[0, 0, 0] for p in seen] == [None if k in gone else k for k in range(5, 35)]
    alone = list(sources.FolderSource(RIG, tmp_path / "back", fps=10))
    assert all(f.back_exposure is None for f in alone)
    assert [f.time for f in alone] == pytest.approx([k / 10 for k in range(30) if k != 2])
    # Two counters that have nothing in common: in order.
    for path in (tmp_path / "front").iterdir():
        path.rename(path.with_name(f"x{int(path.stem.split('_')[1]) + 9000}.png"))
    frames = list(sources.FolderSource(RIG, tmp_path / "back", tmp_path / "front", fps=10))
    assert len(frames) == 29 and all(f.back is not None for f in frames) and frames[28].front is None


def turned(path):
    """An MP4 file's film, said to be turned by a quarter."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 44  # of its matrix, 16.16 and 2.30
    quarter = [0, 1 << 16, 0, -(1 << 16), 0, 0, 48 << 16, 0, 1 << 30]
    data[at : at + 36] = b"".join(x.to_bytes(4, "big", signed=True) for x in quarter)
    path.write_bytes(data)
    return path


def test_a_films_pictures_are_the_sensors(tmp_path):
    path = tmp_path / "film.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 20, (64, 48))
    for k in range(5):
        writer.write(np.full((48, 64, 3), 40 * k, np.uint8))
    writer.release()
    turned(path)
    assert cv2.VideoCapture(str(path)).read()[1].shape == (64, 48, 3)  # as players show it
    assert all(f.back.shape == (48, 64, 3) for f in sources.VideoSource(RIG, path))
    with sources.CameraSource(fastibl.Rig(CAMERA), str(path)) as source:
        assert {f.back.shape for f in source} == {(48, 64, 3)} and source.refused == 0


def test_a_gap_between_frames_holds_nobody_up():
    """Changes are made, and programs ended, while the next frame of a time-lapse is hours away."""
    frames = [fastibl.Frame(t, np.zeros((48, 64, 3), np.uint8)) for t in (0.0, 0.01, 3600.0)]
    source = sources.Paced(fastibl.Recording(RIG, frames))
    given = iter(source)
    assert source.wait(0.0) and next(given).time == 0.0
    while not source.wait(0.005):
        pass
    assert next(given).time == 0.01
    begin = time.monotonic()
    assert not source.wait(0.05) and 0.04 < time.monotonic() - begin < 2
    threading.Timer(0.1, source.close).start()
    assert next(given, None) is not None and time.monotonic() - begin < 5, "closing ends the pause"

    def broken():
        yield frames[0]
        raise OSError("the film is cut off")

    class Film:
        rig, board = RIG, None

        def __iter__(self):
            return broken()

    source = sources.Paced(Film())
    given = iter(source)
    next(given)
    assert source.wait(0.01)
    with pytest.raises(OSError, match="cut off"):
        next(given)


def test_a_paced_source_is_iterated_again_and_side_by_side():
    frames = [fastibl.Frame(t, np.zeros((48, 64, 3), np.uint8)) for t in (0.0, 0.05, 0.1)]
    source = sources.Paced(fastibl.Recording(RIG, frames))
    assert [(a.time, b.time) for a, b in zip(source, source, strict=True)] == [(f.time, f.time) for f in frames]
    with source:
        assert len(list(source)) == 3
    begin = time.monotonic()
    assert len(list(source)) == 3 and time.monotonic() - begin > 0.09


def test_pace():
    frames = [fastibl.Frame(5 + k / 10, np.zeros((48, 64, 3), np.uint8)) for k in range(4)]
    now = [0.0]

    def sleep(seconds):
        now[0] += seconds

    source = sources.Paced(fastibl.Recording(RIG, frames), 2.0, clock=lambda: now[0], sleep=sleep)
    given = [(frame.time, now[0]) for frame in source]
    np.testing.assert_allclose(given, [(5, 0), (5.1, 0.05), (5.2, 0.1), (5.3, 0.15)], atol=1e-12)
    source.close()
