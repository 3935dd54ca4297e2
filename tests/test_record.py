"""Recording live: nothing waits for the disk, and what was written survives a killed program."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import fastibl
from fastibl import Frame, Recording, recorder
from fastibl.__main__ import main
from fastibl.guessed_rig import guessed_camera
from fastibl.recorder import Recorder
from fastibl.recording import RecordingWarning, RecordingWriter, write_rig
from fastibl.sources import CameraSource

CAMERA = fastibl.Camera(64, 48, 50, 50, 32, 24)
RIG = fastibl.Rig(CAMERA)


def frame(k, **others):
    picture = np.random.default_rng(k).integers(0, 256, (48, 64, 3), np.uint8)
    return Frame(k / 30, picture, **others)


def test_what_is_added_is_recorded(tmp_path):
    given = [frame(k, back_exposure=None if k == 2 else 0.5) for k in range(6)]
    with Recorder(tmp_path / "r", RIG) as out:
        assert all(out.add(f) for f in given)
    assert (out.written, out.dropped, out.error) == (6, 0, None)
    read = list(Recording.open(tmp_path / "r"))
    assert read == given and read[2].back_exposure is None


def test_a_closed_recording_takes_no_more(tmp_path):
    out = Recorder(tmp_path / "r", RIG)
    out.add(frame(0))
    out.close()
    for wait in (False, True):
        with pytest.raises(ValueError, match="is closed"):
            out.add(frame(1), wait)
    assert (out.written, out.dropped) == (1, 0)


def test_a_source_may_use_its_memory_again(tmp_path):
    buffer, attitude = np.zeros((48, 64, 3), np.uint8), np.eye(3)
    with Recorder(tmp_path / "r", RIG) as out:
        for k in range(20):
            buffer[:] = k
            attitude[:] = [[np.cos(k), -np.sin(k), 0], [np.sin(k), np.cos(k), 0], [0, 0, 1]]
            assert out.add(Frame(k / 10, back=buffer, attitude=attitude), wait=True)
    read = list(Recording.open(tmp_path / "r"))
    assert [f.back.max() for f in read] == list(range(20))
    assert np.allclose([f.attitude[0, 0] for f in read], np.cos(range(20)))


def test_a_slow_disk_drops_frames_and_keeps_memory(tmp_path, monkeypatch):
    slow = RecordingWriter.add

    def add(self, f):
        time.sleep(0.02)
        slow(self, f)

    monkeypatch.setattr(RecordingWriter, "add", add)
    size = frame(0).back.nbytes
    with Recorder(tmp_path / "r", RIG, buffer=3 * size) as out:
        kept = [out.add(frame(k)) for k in range(20)]
    assert out.dropped == kept.count(False) >= 10 and out.written == kept.count(True) >= 3
    assert len(Recording.open(tmp_path / "r")) == out.written


def test_a_full_disk_ends_the_recording_and_says_so(tmp_path, monkeypatch):
    with pytest.raises(OSError, match="MiB are free"):
        Recorder(tmp_path / "r", RIG, least_free=2**62)
    monkeypatch.setattr(recorder, "_SYNC", 0.0)
    out = Recorder(tmp_path / "s", RIG)
    out._least_free = 2**62
    with pytest.raises(OSError, match="MiB are free"):
        for k in range(1000):
            out.add(frame(k))
            time.sleep(0.002)
    out.close()
    assert 1 <= len(Recording.open(tmp_path / "s")) == out.written < 1000


def test_what_waited_when_the_disk_was_full_is_told(tmp_path, monkeypatch):
    """Who closes a recording is told why frames are missing, if nobody was before."""

    def full(*_):
        time.sleep(0.05)
        raise OSError(28, "No space left on device")

    out = Recorder(tmp_path / "r", RIG)
    monkeypatch.setattr(out._writer, "add", full)
    assert all(out.add(frame(k)) for k in range(4))
    with pytest.raises(OSError, match="No space"):
        out.close()
    assert (out.written, out.dropped) == (0, 4)
    out.close()  # once is enough
    with pytest.raises(KeyError), Recorder(tmp_path / "s", RIG) as out:
        monkeypatch.setattr(out._writer, "add", full)
        out.add(frame(0))
        raise KeyError  # which goes on
    assert out.error is not None


def test_a_line_that_was_cut_off_is_left_out(tmp_path):
    with Recorder(tmp_path / "r", RIG) as out:
        for k in range(3):
            out.add(frame(k))
    path = tmp_path / "r" / "frames.csv"
    path.write_text(path.read_text() + "0.1,back,back/00003.png,0.")
    with pytest.warns(RecordingWarning, match="cut off"):
        assert len(Recording.open(tmp_path / "r")) == 3


def film(path, pictures=3000):
    """A video that plays as a camera does."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no MJPG")
    for k in range(pictures):
        writer.write(np.full((48, 64, 3), k % 256, np.uint8))
    writer.release()
    return str(path)


def test_a_film_is_recorded_whole(tmp_path, capsys, monkeypatch):
    """It played as a camera does: 37 of 90 pictures of 1920 x 1080 were lost, and times moved."""
    monkeypatch.setitem(Recorder.__init__.__kwdefaults__, "buffer", 3 * 64 * 48 * 3)  # reads faster than it writes
    out, video = tmp_path / "out", film(tmp_path / "camera.avi", 100)
    assert main(["record", str(out), "--back", video]) == 0
    said = capsys.readouterr()
    assert "all 100 frames" in said.out and "stays 65 degrees wide" in said.err
    recording = Recording.open(out)
    frames = list(recording)
    assert [int(f.back[0, 0, 0]) for f in frames] == pytest.approx(range(100), abs=2)
    np.testing.assert_allclose([f.time for f in frames], np.arange(100) / 30, atol=1e-3)
    assert recording.board is not None and recording.rig.back.width == 64 and frames[0].back_exposure is None

    assert main(["record", str(out), "--back", video, "--front", video, "--seconds", "0.5"]) == 0
    both = list(Recording.open(out))
    assert len(both) == 16 and all(f.front is not None for f in both)
    assert main(["record", str(out), "--front", video, "--seconds", "0.2"]) == 0
    assert all(f.back is None and f.front is not None for f in Recording.open(out))


def test_the_lens_of_a_film_is_found(tmp_path, capsys):
    """From the board that it shows; that of a rig stays. Truth: the simulator's camera."""
    camera = guessed_camera((640, 480), 52)
    made = fastibl.simulate(seconds=1.2, fps=10, rig=fastibl.Rig(camera.replace(readout=0.02)), hand=False, lamp=False)
    video = str(tmp_path / "film.avi")
    writer = cv2.VideoWriter(video, cv2.VideoWriter_fourcc(*"MJPG"), 10, (640, 480))
    for frame in made:
        writer.write(np.ascontiguousarray(frame.back[..., ::-1]))
    writer.release()
    out, rig = tmp_path / "out", tmp_path / "rig.yaml"
    assert main(["record", str(out), "--back", video]) == 0
    assert "lens is 52 degrees wide" in capsys.readouterr().out
    found = Recording.open(out).rig.back
    print(f"focal length off by {found.fx / camera.fx - 1:.4f}")
    assert found.fx == pytest.approx(camera.fx, rel=0.015) and len(list(Recording.open(out))) == 12
    write_rig(rig, fastibl.Rig(guessed_camera((640, 480))))
    assert main(["record", str(out), "--back", video, "--rig", str(rig)]) == 0
    assert "lens is" not in capsys.readouterr().out
    assert Recording.open(out).rig.back.fx == pytest.approx(guessed_camera((640, 480)).fx)


def test_a_film_is_not_removed_before_it_is_copied(tmp_path, capsys):
    recording = fastibl.simulate(seconds=0.3, fps=10, size=(64, 48), hand=False, out=tmp_path / "r", video=True)
    for out in ("r", "r/../r"):
        command = ["record", str(tmp_path / out), "--back", str(tmp_path / "r" / "back.mkv")]
        assert main(command) == 2
        assert "choose another folder" in capsys.readouterr().err
    assert len(list(Recording.open(tmp_path / "r"))) == len(recording)


def test_cameras_of_other_sizes_are_recorded_without_a_rig(tmp_path, capsys):
    """As large as they come, or scaled down to the width that was asked for."""
    video, none = film(tmp_path / "camera.avi"), str(tmp_path / "none")  # of 64 x 48 pixels
    for asked, width in ((["--size", "128x128"], 64), (["--size", "32x32"], 32)):
        command = ["record", str(tmp_path / "out"), "--back", video, "--front", none, "--seconds", "0.3", *asked]
        assert main(command) == 0
        recording = Recording.open(tmp_path / "out")
        assert recording.rig.back.width == width and recording[0].back.shape == (width * 3 // 4, width, 3)


def test_what_a_film_cannot_do_is_said(tmp_path, capsys):
    out, video = tmp_path / "out", film(tmp_path / "camera.avi", 3)
    broken, rig = tmp_path / "broken.avi", tmp_path / "rig.yaml"
    broken.write_bytes(Path(video).read_bytes()[:2000])
    write_rig(rig, fastibl.Rig(fastibl.Camera(80, 60, 50, 50, 40, 30)))
    for options, told in (
        (["--back", video, "--bracket"], "--bracket is of cameras"),
        (["--back", video, "--size", "80x60"], "--size is of cameras"),
        (["--back", str(broken)], "holds no picture"),
        (["--back", video, "--rig", str(rig)], "64"),
    ):
        assert main(["record", str(out), *options]) == 2
        error = capsys.readouterr().err
        print(error.splitlines()[-1])
        assert told in error and "Traceback" not in error


def test_the_command(tmp_path, capsys):
    """A film beside a camera that is not there plays as a camera does."""
    out, video, none = tmp_path / "out", film(tmp_path / "camera.avi"), str(tmp_path / "none")
    live = ["record", str(out), "--back", video, "--front", none, "--size", "64x48"]
    assert main([*live, "--seconds", "0.3"]) == 0
    assert "frames" in capsys.readouterr().out
    recording = Recording.open(out)
    assert len(recording) >= 3 and recording.board is not None and recording.rig.back.width == 64
    times = [f.time for f in recording]
    assert times == sorted(times)
    assert main(["record", str(out), "--back", none, "--patience", "0.2"]) == 2
    assert "no camera gave a picture" in capsys.readouterr().err
    assert [f.time for f in Recording.open(out)] == times, "what was there is gone, and nothing came"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("")
    assert main(["record", str(tmp_path / "other"), "--back", video, "--seconds", "0.3"]) == 2
    assert "thesis.txt" in capsys.readouterr().err


def test_a_video_file_plays_once_at_its_own_speed(tmp_path):
    with CameraSource(RIG, film(tmp_path / "camera.avi", 20)) as source:
        times = np.array([f.time for f in source])
    print(f"{len(times)} frames of 20, {np.median(np.diff(times)):.4f} s apart")
    assert 3 <= len(times) <= 20
    assert times[-1] - times[0] >= 0.6, "20 pictures at 30 a second"


def test_a_video_file_is_played_again(tmp_path):
    with CameraSource(RIG, film(tmp_path / "camera.avi", 6)) as source:
        first, again = (list(source) for _ in range(2))
    assert 1 <= len(first) <= 6 and 1 <= len(again) <= 6
    assert again[0].time > first[-1].time, "its times go on"


def test_a_killed_program_leaves_a_recording(tmp_path):
    out, video = tmp_path / "out", film(tmp_path / "camera.avi")
    command = [sys.executable, "-m", "fastibl", "record", str(out), "--back", video, "--size", "64x48"]
    command += ["--front", str(tmp_path / "none")]  # films alone are copied
    path = os.pathsep.join([os.path.dirname(os.path.dirname(fastibl.__file__)), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.DEVNULL)
    try:
        listed = out / "frames.csv"
        begin = time.monotonic()
        while not (listed.is_file() and listed.read_text().count("\n") > 30) and time.monotonic() < begin + 30:
            time.sleep(0.05)
        before = listed.read_text().count("\n") - 1
        assert before > 10
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    recording = Recording.open(out)
    frames = list(recording)
    print(f"{before} frames were listed just before, {len(frames)} are read after")
    assert len(frames) == len(recording) >= before
    assert frames[-1].back.shape == (48, 64, 3)


def test_live(tmp_path, capsys):
    pytest.importorskip("av")
    film = fastibl.simulate(seconds=2, fps=10, size=(320, 240), hand=False, lamp=False)
    fastibl.recording.write_rig(tmp_path / "rig.yaml", film.rig)
    cameras = {}
    for name in ("back", "front"):
        writer = cv2.VideoWriter(str(tmp_path / f"{name}.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30, (320, 240))
        if not writer.isOpened():
            pytest.skip("this OpenCV writes no MJPG")
        for _ in range(30):
            for f in film:
                writer.write(np.ascontiguousarray(getattr(f, name)[..., ::-1]))
        writer.release()
        cameras[name] = str(tmp_path / f"{name}.avi")
    out, rig = tmp_path / "out.webm", str(tmp_path / "rig.yaml")
    command = ["live", "--no-page", "--rig", rig, "--out", str(out)]
    assert main([*command, "--back", cameras["back"], "--front", cameras["front"], "--seconds", "1.5"]) == 0
    said = capsys.readouterr().out
    print(said)
    assert "board seen in" in said and "board seen in 0" not in said and out.stat().st_size > 1000
    assert main([*command, "--back", str(tmp_path / "none"), "--patience", "0.2"]) == 2
    assert "no picture" in capsys.readouterr().err
