"""Videos: shown when they were taken, in the colours that they are said to be in, whole or not at all."""

import re
import shutil
from contextlib import contextmanager

import numpy as np
import pytest

from fastibl.video import VideoWriter
from fastibl.whole_file import path_ending

av = pytest.importorskip("av")
COLOURS = np.array([(230, 60, 60), (60, 200, 60), (60, 60, 220), (200, 140, 100), (128, 128, 128)])


def stripes(height=144, width=320):
    return np.ascontiguousarray(np.repeat(COLOURS, width // len(COLOURS), 0)[None].repeat(height, 0).astype(np.uint8))


def times(path):
    with av.open(str(path)) as video:
        return [float(frame.pts * frame.time_base) for frame in video.decode(video=0)]


def test_pictures_are_shown_when_they_were_taken(tmp_path):
    given = [7.0, 7.1, 7.25, 10.2, 10.2, 10.31]  # a pause, and two at once
    with VideoWriter(tmp_path / "a.webm", 30) as video:
        for time in given:
            video.add(stripes(), time)
    shown = times(tmp_path / "a.webm")
    assert len(shown) == len(given)
    assert np.abs(np.array(shown) - (np.array(given) - given[0])).max() <= 0.0011


def test_time_that_begins_anew_goes_on_in_the_film(tmp_path):
    with VideoWriter(tmp_path / "a.webm", 25) as video:
        for time in (7.0, 7.1, 0.0, 0.1, 0.3, -5.0, -4.9):
            video.add(stripes(32, 40), time)
    np.testing.assert_allclose(times(tmp_path / "a.webm"), [0, 0.1, 0.14, 0.24, 0.44, 0.48, 0.58], atol=0.0011)


@pytest.mark.parametrize("fps", [30, 30000 / 1001, 12.5])
def test_pictures_without_times_come_at_the_rate(tmp_path, fps):
    with VideoWriter(tmp_path / "a.webm", fps) as video:
        for _ in range(40):
            video.add(stripes(32, 40))
    assert np.abs(np.array(times(tmp_path / "a.webm")) - np.arange(40) / fps).max() <= 0.0006


@pytest.mark.parametrize("fps", [0, 1 / 3600])
def test_pictures_of_a_time_lapse_are_shown_when_they_were_taken(tmp_path, fps):
    with VideoWriter(tmp_path / "a.webm", fps) as video:
        for k in range(3):
            video.add(stripes(32, 40), 60.0 * k)
    assert times(tmp_path / "a.webm") == [0, 60, 120]


def test_colours_are_those_of_bt709_as_the_file_says(tmp_path):
    with VideoWriter(tmp_path / "a.webm", 30) as video:
        for _ in range(3):
            video.add(stripes())
    with av.open(str(tmp_path / "a.webm")) as film:
        about = film.streams.video[0].codec_context
        planes = next(film.decode(video=0)).to_ndarray(format="yuv420p").astype(float)
    assert (about.colorspace, about.color_primaries, about.color_trc, about.color_range) == (1, 1, 1, 1)
    y, u, v = planes[:144], planes[144:180].reshape(72, 160), planes[180:].reshape(72, 160)
    worst = 0
    for k, colour in enumerate(COLOURS):
        x = 64 * k + 32
        # ITU-R BT.709, limited range.
        luma, cb, cr = (y[70, x] - 16) / 219, (u[35, x // 2] - 128) / 224, (v[35, x // 2] - 128) / 224
        red, blue = luma + 1.5748 * cr, luma + 1.8556 * cb
        green = (luma - 0.2126 * red - 0.0722 * blue) / 0.7152
        worst = max(worst, np.abs(255 * np.array([red, green, blue]) - colour).max())
    print(f"at most {worst:.1f} codes")
    assert worst <= 4


def test_an_older_video_stays_where_a_new_one_cannot_be_written(tmp_path, monkeypatch):
    path = tmp_path / "a.webm"
    path.write_bytes(b"older")
    video = VideoWriter(path, 30)
    video.add(stripes())
    assert path.read_bytes() == b"older"

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(video, "_container", type("Full", (), {"mux": full})())
    with pytest.raises(OSError, match="No space"):
        video.close()
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]


def test_a_folder_is_not_written_over(tmp_path):
    path = tmp_path / "a.webm"
    path.mkdir()
    with pytest.raises(IsADirectoryError, match=re.escape(str(path))):
        VideoWriter(path, 30)
    for ending in (".png", ".exr", ".ktx2"):
        path = tmp_path / f"a{ending}"
        path.mkdir()
        with pytest.raises(IsADirectoryError, match=re.escape(str(path))):
            path_ending(path, ending)
    assert not list(tmp_path.glob("*/*")) and not list(tmp_path.glob("*.part"))


def test_no_picture_is_no_video(tmp_path):
    path = tmp_path / "a.webm"
    with VideoWriter(path, 30):
        pass
    with pytest.raises(KeyError), VideoWriter(path, 30):
        raise KeyError  # not what the video lacks
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "picture, time, error, said",
    [
        (np.zeros((16, 16, 4), np.uint8), 0, ValueError, r"\(h, w, 3\), got \(16, 16, 4\)"),
        (np.zeros((16, 16), np.uint8), 0, ValueError, r"\(h, w, 3\), got \(16, 16\)"),
        (np.zeros((0, 16, 3), np.uint8), 0, ValueError, r"\(h, w, 3\), got \(0, 16, 3\)"),
        (np.zeros((16, 16, 3), np.uint16), 0, TypeError, "uint8, got uint16"),
        (stripes(), np.nan, ValueError, "finite .*got nan"),
        (stripes(), np.inf, ValueError, "finite .*got inf"),
    ],
)
def test_a_picture_that_is_refused_leaves_no_trace(tmp_path, picture, time, error, said):
    path = tmp_path / "a.webm"
    path.write_bytes(b"older")
    with pytest.raises(error, match=said), VideoWriter(path, 30) as video:
        video.add(picture, time)
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]
    with VideoWriter(path, 30) as video:
        for at in (7.0, 7.1):
            with pytest.raises(error):
                video.add(picture, time)
            video.add(stripes(), at)
    assert times(path) == [0, 0.1]


def test_an_older_video_stays_where_no_picture_can_be_encoded(tmp_path):
    path = tmp_path / "a.webm"
    path.write_bytes(b"older")
    with pytest.raises(av.FFmpegError), VideoWriter(path, 30) as video:
        video._stream.options = {"cpu-used": "99"}
        video.add(stripes(), 0)
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("fps", [1e9, np.inf])
def test_more_than_a_thousand_a_second_are_a_thousand(tmp_path, fps):
    with VideoWriter(tmp_path / "a.webm", fps) as video:
        for _ in range(3):
            video.add(stripes(32, 40))
    assert times(tmp_path / "a.webm") == [0, 0.001, 0.002]


def test_what_was_added_before_an_error_is_a_video(tmp_path):
    path = tmp_path / "a.webm"
    with pytest.raises(ValueError, match="shape"), VideoWriter(path, 30) as video:
        for _ in range(4):
            video.add(stripes())
        video.add(stripes(8, 8))
    assert len(times(path)) == 4


def noise(k):
    return np.random.default_rng(k).integers(0, 256, (48, 64, 3), np.uint8)


def test_a_film_that_is_cut_plays_but_for_its_last_seconds(tmp_path):
    """As a power cut leaves it: beside the film that was there before."""
    video = VideoWriter(tmp_path / "a.webm", 30)
    for k in range(180):
        video.add(noise(k), k / 30)
    (part,) = tmp_path.glob("*.part")
    shutil.copy(part, tmp_path / "cut.webm")
    video.close()
    cut = times(tmp_path / "cut.webm")
    assert len(times(tmp_path / "a.webm")) == 180
    assert cut[0] == 0 and cut[-1] > 6 - 2.5 and np.abs(np.diff(cut) - 1 / 30).max() < 0.002


@contextmanager
def least_room(bytes_of_a_file):
    """No file may become larger: writing fails as on a full disk."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_of_a_file, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("keep_cut", [False, True])
def test_a_full_disk_cuts_the_film(tmp_path, keep_cut):
    path, count = tmp_path / "a.webm", 0
    path.write_bytes(b"older")
    with least_room(200_000):
        video = VideoWriter(path, 30, keep_cut=keep_cut)
        with pytest.raises(OSError):
            while count < 1000:
                video.add(noise(count))
                count += 1
        with pytest.raises(OSError):
            video.close()
        video.close()
    assert list(tmp_path.iterdir()) == [path]
    if keep_cut:
        assert 30 <= len(times(path)) <= count
    else:
        assert path.read_bytes() == b"older"


def test_a_cut_film_that_does_not_play_is_not_kept(tmp_path):
    path = tmp_path / "a.webm"
    path.write_bytes(b"older")
    with least_room(100), pytest.raises(OSError):
        video = VideoWriter(path, 30, keep_cut=True)
        video.add(noise(0))
        video.close()
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]
