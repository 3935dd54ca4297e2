"""`fastibl live`: where its pictures come from, what it says, how it ends."""

import http.client
import itertools
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import cv2
import numpy as np
import pytest

import fastibl
from fastibl import found_camera, free_disk, sources
from fastibl.__main__ import build_parser, main
from fastibl.calibration_files import write_rig
from fastibl.commands import _kept_map, _live_film, _live_source
from fastibl.commands._live_source import open_source
from fastibl.commands.live import _Ending, _Log, _Watch
from fastibl.live_camera import LiveCamera, open_camera
from fastibl.live_page import Choices, LiveLoop, Settings
from fastibl.live_page import loop as loop_module


class FakeCapture:
    """A camera of 1280 x 720, whatever is asked for; None gives no picture."""

    def __init__(self, size=(1280, 720)):
        self.size, self.count = size, 0

    def isOpened(self):  # noqa: N802 - OpenCV's names
        return self.size is not None

    def getBackendName(self):  # noqa: N802
        return "V4L2"

    def get(self, which):
        return 100.0

    def set(self, which, value):
        return True

    def grab(self):
        return self.size is not None

    def retrieve(self):
        self.count += 1
        return True, np.full((self.size[1], self.size[0], 3), self.count % 250, np.uint8)

    def release(self):
        """Nothing to end."""


def parsed(*arguments):
    return build_parser().parse_args(["live", *map(str, arguments)])


@pytest.fixture
def no_camera(monkeypatch):
    monkeypatch.setattr(found_camera.picture_size, "__defaults__", (lambda device: FakeCapture(None),))


def test_without_a_camera_the_simulator_is_offered(no_camera, capsys):
    for arguments in ([], ["--back", "3"], ["--front", "1"]):
        assert main(["live", *arguments]) == 2
        said = capsys.readouterr().err
        assert "gives no picture" in said and "fastibl live --simulate" in said and said.count("\n") == 1
    assert main(["live", "--back", "rtsp://nowhere.invalid/x"]) == 2
    assert "does not answer" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--simulate", "--back", "0"], "not from several: --simulate, --back"),
        (["--recording", "x", "--simulate"], "not from several: --simulate, --recording"),
        (["--recording", "nowhere"], "nowhere"),
        (["--environment", "nowhere.hdr", "--front", "1"], "leave one away"),
        (["--simulate", "--port", "70000"], "--port"),
        (["--simulate", "--keep", "map.png"], "map.png"),
        (["--recording", "x", "--fov", "50"], "--fov is of cameras"),
        (["--recording", "x", "--rig", "rig.yaml"], "--rig is of cameras"),
        (["--recording", "x", "--exposures", "bracket"], "--exposures is of cameras"),
        (["--simulate", "--object", "a/x.obj", "b/x.obj"], "by name"),
    ],
)
def test_arguments_that_do_not_fit(arguments, message, capsys):
    assert main(["live", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_camera_without_calibration_is_guessed_and_says_so(monkeypatch):
    monkeypatch.setattr(found_camera.picture_size, "__defaults__", (lambda device: FakeCapture(),))
    monkeypatch.setattr(found_camera.scaled_opener, "__defaults__", (lambda device: FakeCapture(),))
    opened = open_source(parsed("--back", 0, "--front", 1, "--fov", 60), print)
    with opened.source as source:
        rig = source.rig
        assert (rig.back.width, rig.back.height) == (640, 360) == (rig.front.width, rig.front.height)
        assert 2 * np.degrees(np.arctan(320 / rig.back.fx)) == pytest.approx(60)
        assert 2 * np.degrees(np.arctan(320 / rig.front.fx)) == pytest.approx(65)
        assert np.allclose(rig.front_from_back.rotation @ [0, 0, 1], [0, 0, -1])
        frame = next(iter(source))
        picture = frame.back if frame.back is not None else frame.front
        assert picture.shape == (360, 640, 3) and source.refused == 0
    (notice,) = opened.notices
    assert all(text in notice for text in ("60° wide", "fastibl calibrate", "--fov", "front camera", "65°"))
    assert opened.lens is None, "it was told"
    opened = open_source(parsed("--back", 0), print)
    with opened.source as source:
        assert opened.lens.usual == source.rig.back and "65° wide" in opened.notices[0]
        assert "until the board" in opened.notices[0] and "until the board" not in notice


def test_pictures_that_are_not_larger_stay_as_they_are():
    assert found_camera.picture_size(0, (640, 480), lambda device: FakeCapture((320, 240))) == (320, 240)
    assert found_camera.picture_size(0, (640, 480), lambda device: FakeCapture((1920, 1080))) == (640, 360)


class Plug:
    """A camera that gives pictures while it is plugged in."""

    def __init__(self, plugged=True):
        self.plugged = plugged

    def open(self, device):
        return _Plugged(self)


class _Plugged(FakeCapture):
    def __init__(self, plug):
        super().__init__((96, 72))
        self.plug, self.alive = plug, plug.plugged

    def isOpened(self):  # noqa: N802 - OpenCV's name
        return self.alive

    def grab(self):
        time.sleep(0.005)
        self.alive &= self.plug.plugged
        return self.alive


def until(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture
def plug(monkeypatch, tmp_path):
    """A camera, and a calibration for it, with which it need not be there at the start."""
    made = Plug()
    monkeypatch.setattr(LiveCamera.__init__, "__kwdefaults__", {**LiveCamera.__init__.__kwdefaults__, "retry": 0.02})
    monkeypatch.setitem(LiveCamera.__init__.__kwdefaults__, "open_capture", made.open)
    write_rig(tmp_path / "rig.yaml", fastibl.Rig(fastibl.Camera(96, 72, 90, 90, 48, 36)))
    return made


def live_loop(tmp_path, *arguments):
    """A loop on what `fastibl live` opens for these arguments, in a thread."""
    log = _Log()
    opened = open_source(parsed("--rig", tmp_path / "rig.yaml", "--back", 0, *arguments), log)
    white = fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32))
    loop = LiveLoop(opened.source, Choices(height=0.05), Settings("cube"), {"environment": white}, folder=tmp_path)
    log.to = loop.say
    thread = threading.Thread(target=loop.run, daemon=True)
    thread.start()
    return loop, thread


def test_cameras_are_waited_for_without_limit(plug, tmp_path):
    """Also one that is not there at the start; the page says that it waits, and still takes changes."""
    assert parsed().patience is None and open_source(parsed("--simulate"), print).source is not None
    plug.plugged = False
    loop, thread = live_loop(tmp_path)
    assert loop.source.patience == np.inf
    until(lambda: loop.latest.get().reason)
    assert loop.latest.get().state == "waiting"
    plug.plugged = True
    until(lambda: loop.latest.get().picture > 2)
    assert loop.latest.get().state == "running"
    plug.plugged = False
    until(lambda: loop.latest.get().state == "waiting")
    shown = loop.latest.get()
    assert "goes on by itself" in shown.reason and any("gives no more" in text for _, text in shown.messages)
    assert loop.change({"shadow": False})
    until(lambda: loop.latest.get().picture > shown.picture)  # the last picture, once more
    assert not loop.latest.get().settings.shadow and loop.latest.get().state == "waiting"
    assert loop.change({"freeze": True})
    until(lambda: loop.latest.get().state == "frozen")
    assert loop.change({"freeze": False})
    plug.plugged = True
    until(lambda: loop.latest.get().state == "running")
    assert loop.latest.get().reason == ""
    loop.stop()
    thread.join(10)
    assert not thread.is_alive() and not loop.source.gave_up


class _FrontAlone:
    """A back picture, and then those of the front camera."""

    board = None

    def __init__(self):
        camera = fastibl.Camera(64, 48, 50, 50, 32, 24)
        self.rig = fastibl.Rig(camera, camera, fastibl.Pose())

    def __iter__(self):
        for k in range(4):
            picture = np.full((48, 64, 3), 40 + k, np.uint8)
            yield fastibl.Frame(k, *((None, picture) if k else (picture, None)))


def test_a_back_camera_that_is_away_is_told_while_the_front_goes_on(tmp_path, monkeypatch):
    white = fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32))
    states = []
    for late in (-1.0, 1e9):
        monkeypatch.setattr(loop_module, "_LATE", late)
        loop = LiveLoop(_FrontAlone(), Choices(height=0.05), Settings("cube"), {"environment": white}, folder=tmp_path)
        loop._after_frame = lambda session, played, loop=loop: states.append(loop.latest.get().state)
        loop.run(until_end=True)
    assert states == ["running", "waiting", "waiting", "waiting"] + ["running"] * 4


def test_patience_ends_it_with_an_exit_code(plug, tmp_path, monkeypatch, capsys):
    command = ["live", "--rig", str(tmp_path / "rig.yaml"), "--back", "0", "--folder", str(tmp_path)]
    plug.plugged = False
    assert main([*command, "--patience", "0.2"]) == 2
    assert "no picture came for 0.2 s" in capsys.readouterr().err
    plug.plugged = True
    take = LiveLoop._take

    def unplug(loop, played):
        plug.plugged = False
        take(loop, played)

    monkeypatch.setattr(LiveLoop, "_take", unplug)
    assert main([*command, "--patience", "2"]) == 2
    said = capsys.readouterr()
    assert "no picture came for 2 s" in said.err and re.search(r"^[1-9]\d* frames", said.out, re.M)


def frames_in(video):
    """Those that there are: CAP_PROP_FRAME_COUNT takes the length times a rate, and these have times of their own."""
    return sum(1 for _ in iter(lambda: video.read()[0], False))


class _Phone(BaseHTTPRequestHandler):
    """What telephones' camera programs serve: JPEG after JPEG."""

    def do_GET(self):  # noqa: N802 - the library's name
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        try:
            for k in itertools.count():
                picture = np.full((240, 320, 3), (40, 90, 200), np.uint8)
                cv2.circle(picture, (20 + k % 280, 120), 20, (255, 255, 255), -1)
                data = cv2.imencode(".jpg", picture)[1].tobytes()
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.wfile.write(head.encode() + data + b"\r\n")
        except OSError:
            return

    def log_message(self, *_):
        """Quiet."""


def test_a_telephone_by_its_url():
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Phone)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_address[1]}/video"
    try:
        capture = open_camera(url)
        if not capture.isOpened():
            pytest.skip("this OpenCV reads no URLs")
        capture.release()
        opened = open_source(parsed("--back", url, "--front", url, "--size", "160x120"), print)
        with opened.source as source:
            frame = next(iter(source))
            picture = frame.back if frame.back is not None else frame.front
            assert picture.shape == (120, 160, 3)
            assert np.abs(picture[5, 80].astype(int) - (200, 90, 40)).max() < 12  # RGB
        assert opened.about == f"camera {url} and camera {url}"
    finally:
        server.shutdown()
        server.server_close()


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("live") / "recording"
    fastibl.simulate(seconds=0.4, fps=10, size=(320, 240), truth_size=8, hand=False, out=path)
    return path


def test_a_recording_as_a_video_without_a_page(recording, tmp_path, capsys):
    out = tmp_path / "live.webm"
    assert main(["live", "--no-page", "--recording", str(recording), "--out", str(out), "--error", "0"]) == 0
    assert "4 frames" in capsys.readouterr().out
    video = cv2.VideoCapture(str(out))
    assert frames_in(video) == 4


@pytest.mark.parametrize("page", [True, False])
def test_a_full_disk_ends_the_video_and_not_the_page(recording, tmp_path, monkeypatch, capsys, page):
    looks = itertools.count()

    def check(path):
        if next(looks) == 3:  # at the start, and before each picture
            raise OSError("12 MiB are free")

    monkeypatch.setattr(_live_film, "check_free", check)
    monkeypatch.setattr(_live_film, "_CHECKS", -1.0)
    out = tmp_path / "live.webm"
    command = ["live", "--recording", str(recording), "--folder", str(tmp_path), "--out", str(out), "--error", "0"]
    assert main([*command, *(["--seconds", "1"] if page else ["--no-page"])]) == (0 if page else 2)
    said = capsys.readouterr()
    assert f"the video {out} ended after 2 pictures: 12 MiB are free" in said.err
    assert frames_in(cv2.VideoCapture(str(out))) == 2 and not list(tmp_path.glob("*.part"))
    assert f"{out}: 4" not in said.out and ("4 frames" if page else "error: 12 MiB are free") in said.out + said.err


def test_a_disk_without_room_for_a_video(recording, tmp_path, monkeypatch, capsys):
    """What was there stays; the page is shown without it."""
    usage = shutil.disk_usage(tmp_path)._replace(free=100 * 2**20)
    monkeypatch.setattr(free_disk.shutil, "disk_usage", lambda path: usage)
    out = tmp_path / "live.webm"
    out.write_bytes(b"older")
    command = ["live", "--recording", str(recording), "--folder", str(tmp_path), "--out", str(out), "--error", "0"]
    for more, code in (["--seconds", "1"], 0), (["--no-page"], 2):
        assert main([*command, *more]) == code
        assert "100 MiB are free" in capsys.readouterr().err and out.read_bytes() == b"older"


def test_the_address_stays_with_a_token_of_a_file(recording, tmp_path, capsys):
    command = ["live", "--recording", str(recording), "--folder", str(tmp_path), "--error", "0", "--seconds", "0.1"]
    path = tmp_path / "token"
    path.write_text("kiosk-AbCdEf0123456789\n")
    path.chmod(0o600)
    assert main([*command, "--token-file", str(path)]) == 0
    said = capsys.readouterr()
    assert re.search(r"http://127\.0\.0\.1:\d+/kiosk-AbCdEf0123456789/\n", said.out) and "chmod" not in said.err
    path.chmod(0o644)
    assert main([*command, "--token-file", str(path)]) == 0
    assert ("every user" in capsys.readouterr().err) == (os.name == "posix")
    path.write_text("short-secret")
    assert main([*command, "--token-file", str(path)]) == 2
    said = capsys.readouterr()
    assert "16 random characters" in said.err and "short-secret" not in said.out + said.err
    path.write_bytes(b"\xff" * 20)
    assert main([*command, "--token-file", str(path)]) == 2
    assert main([*command, "--token-file", str(tmp_path / "nowhere")]) == 2
    assert "nowhere" in capsys.readouterr().err


class _Result:
    """What KeptMap asks of a FrameResult: a map of which this share was seen."""

    def __init__(self, radiance, coverage=0.5):
        self.environment = self
        self.coverage = coverage
        self.radiance = fastibl.CubeMap(np.full((6, 16, 16, 3), radiance, np.float32))


@pytest.fixture
def written(monkeypatch):
    """Brightnesses of the maps that were written."""
    brightnesses = []

    def write(path, result):
        brightnesses.append(float(result.radiance.faces.mean()))
        fastibl.write_environment(path, result.radiance)

    monkeypatch.setattr(_kept_map, "write_environment", write)
    return brightnesses


def test_a_map_is_kept_for_the_next_start(recording, tmp_path, monkeypatch):
    path, results = tmp_path / "kept" / "map.ktx2", []
    take = _Watch.take
    monkeypatch.setattr(_Watch, "take", lambda *given: (results.append(given[2].result), take(*given)))
    command = ["live", "--no-page", "--recording", str(recording), "--keep", str(path), "--error", "0"]
    for k in range(2):
        assert main([*command, "--out", str(tmp_path / "live.webm")]) == 0
        environment = results[-1].environment
        assert (environment.knowledge["prior_flux"] > 0) == (k == 1)
        kept = fastibl.read_environment(path)
        np.testing.assert_allclose(kept.faces, environment.radiance.faces, rtol=1e-3, atol=1e-6)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_a_map_is_kept_now_and_then(tmp_path, monkeypatch, written):
    monkeypatch.setattr(_kept_map, "_PERIOD", 0.0)
    with _kept_map.KeptMap(tmp_path / "map.ktx2", print) as kept:
        assert kept.prior is None
        kept.note(_Result(1.0))
        kept._wait()
        assert written == [1.0]
        monkeypatch.setattr(_kept_map, "_PERIOD", 1e9)
        for radiance in (2.0, 3.0, 4.0):
            kept.note(_Result(radiance))
            kept._wait()
        assert written == [1.0, 2.0]
    assert written == [1.0, 2.0, 4.0], "the last one at the end"
    assert np.allclose(fastibl.read_environment(tmp_path / "map.ktx2").faces, 4.0, rtol=0.01)


def test_a_kept_map_is_not_lost(tmp_path, written):
    """By a night, whose dark pictures tell the unseen sky's brightness, too; or where nothing was seen at all."""
    said = []
    for light, kept in ((1.0, 1.0), (1e-3, 1.0), (0.3, 0.3), (0.0, 0.3)):
        with _kept_map.KeptMap(tmp_path / "map.ktx2", said.append) as file:
            file.note(_Result(light))
        assert np.allclose(fastibl.read_environment(tmp_path / "map.ktx2").faces, kept, rtol=0.01)
    assert [line.count("it is dark here") for line in said] == [1, 1]
    with _kept_map.KeptMap(tmp_path / "map.ktx2", said.append) as file:
        file.note(_Result(2.0, coverage=0.0))
    with _kept_map.KeptMap(tmp_path / "map.ktx2", said.append):
        """No picture came."""
    assert len(said) == 2 and len(written) == 2


def test_a_map_that_cannot_be_kept_ends_nothing(tmp_path, monkeypatch):
    path, said = tmp_path / "map.ktx2", []
    path.write_bytes(b"damaged")  # or of a kind that cannot be read, or not allowed to be
    with _kept_map.KeptMap(path, said.append) as kept:
        assert kept.prior is None and "without an earlier map" in said[0] and "stays as it is" in said[0]
        kept.note(_Result(1.0))
    assert path.read_bytes() == b"damaged" and len(said) == 1
    path.unlink()
    with _kept_map.KeptMap(path, said.append) as kept:

        def full(*_):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(_kept_map, "write_environment", full)
        monkeypatch.setattr(_kept_map, "_PERIOD", 0.0)
        for _ in range(3):
            kept.note(_Result(1.0))
            kept._wait()
    assert len(said) == 2 and "No space" in said[1] and not path.exists()
    with pytest.raises(ValueError, match=r"\.ktx2, got map\.hdr"):
        _kept_map.KeptMap(tmp_path / "map.hdr", print)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--simulate", "--rig", "r.yaml"], "--rig is of cameras"),
        (["--simulate", "--front-fov", "50"], "--front-fov is of cameras"),
        (["--simulate", "--flicker", "100"], "--flicker is of cameras"),
        (["--recording", "{recording}", "--size", "320x240"], "--size is of cameras"),
        (["--recording", "{recording}", "--patience", "9"], "--patience is of cameras"),
        (["--simulate", "--port", "8000"], "--port is of the page"),
        (["--simulate", "--open"], "--open is of the page"),
        (["--simulate", "--token-file", "token"], "--token-file is of the page"),
        (["--back", "0", "--rig", "{recording}/rig.yaml", "--fov", "70"], "--fov goes without --rig"),
        (["--back", "0", "--rig", "{recording}/rig.yaml", "--size", "320x240"], "--size goes without --rig"),
    ],
)
def test_options_that_would_do_nothing_are_refused(recording, capsys, options, told):
    assert main(["live", "--no-page", *(o.format(recording=recording) for o in options)]) == 2
    assert told in capsys.readouterr().err


def test_starting_anew_forgets_the_kept_map(tmp_path):
    prior = fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32))
    loop = LiveLoop(numbered(2), Choices(height=0.05), Settings("cube"), {"prior": prior}, folder=tmp_path)
    shown = []
    loop._after_frame = lambda session, played: shown.append(session)
    loop.change({"restart": True})
    loop.run(until_end=True)
    assert loop._options == {} and shown


def test_seconds_end_it_when_the_pictures_did_before(recording, tmp_path):
    command = [sys.executable, "-m", "fastibl", "live", "--recording", str(recording), "--folder", str(tmp_path)]
    done = subprocess.run([*command, "--seconds", "2", "--error", "0"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "4 frames" in done.stdout


_BROWSER = """
import sys, pathlib, urllib.parse, urllib.request
said = pathlib.Path(sys.argv[1])
path = pathlib.Path(urllib.request.url2pathname(urllib.parse.urlsplit(sys.argv[2]).path))
modes = [oct(p.stat().st_mode & 0o777) if p.exists() else "" for p in (path, path.parent)]
said.write_text("\\n".join([sys.argv[2], *modes, path.read_text() if path.exists() else ""]))
"""


def test_the_browser_is_not_told_the_token_by_its_arguments(recording, tmp_path):
    """They can be read by every user of the machine."""
    (tmp_path / "browser.py").write_text(_BROWSER)
    browser = [sys.executable, str(tmp_path / "browser.py"), str(tmp_path / "said"), "%s"]
    command = [sys.executable, "-m", "fastibl", "live", "--recording", str(recording), "--folder", str(tmp_path)]
    done = subprocess.run(
        [*command, "--open", "--seconds", "1", "--error", "0"],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "BROWSER": shlex.join(browser)},
    )
    assert done.returncode == 0, done.stderr
    url = re.search(r"http://127\.0\.0\.1:\d+/(\S+)/", done.stdout)
    address, of_file, of_folder, page = (tmp_path / "said").read_text().split("\n", 3)
    assert address.startswith("file:") and url[1] not in address
    assert f"url={url[0]}" in page
    if os.name == "posix":
        assert (of_file, of_folder) == ("0o600", "0o700")
    path = Path(url2pathname(urlsplit(address).path))
    assert not path.exists() and not path.parent.exists(), "it stays when the command has ended"


@pytest.mark.parametrize("name", ["SIGINT", *(["SIGTERM", "SIGHUP"] if os.name == "posix" else [])])
def test_a_signal_ends_it_and_keeps_what_was_written(recording, tmp_path, name):
    command = [sys.executable, "-m", "fastibl", "live", "--recording", str(recording), "--folder", str(tmp_path)]
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path / "live.webm")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        url = next(m for m in (re.search(r"http://127\.0\.0\.1:(\d+)/\S+", line) for line in process.stdout) if m)
        state = None
        while state != b'"ended"':
            connection = http.client.HTTPConnection("127.0.0.1", int(url[1]), timeout=10)
            connection.request("GET", url[0].partition(url[1])[2] + "state?viewer=abcdefgh")
            state = re.search(rb'"state": (".*?")', connection.getresponse().read())[1]
        process.send_signal(getattr(signal, name))
        out, said = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == 0 and "4 frames" in out and "Traceback" not in said, said
    assert frames_in(cv2.VideoCapture(str(tmp_path / "live.webm"))) == 4


class _Silent(BaseHTTPRequestHandler):
    """A camera that gives no picture yet."""

    def do_GET(self):  # noqa: N802 - the library's name
        self.send_error(404)

    def log_message(self, *_):
        """Quiet."""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("name, code", [("SIGTERM", 0), ("SIGHUP", 0), ("SIGINT", 130)])
def test_a_signal_before_the_first_picture(plug, tmp_path, name, code):
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Silent)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_address[1]}/video"
    command = [sys.executable, "-m", "fastibl", "live", "--rig", str(tmp_path / "rig.yaml"), "--back", url]
    process = subprocess.Popen(
        [*command, "--folder", str(tmp_path), "--out", str(tmp_path / "live.webm")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert any("http://" in line for line in process.stdout)
        process.send_signal(getattr(signal, name))
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
        server.shutdown()
        server.server_close()
    assert process.returncode == code and "Traceback" not in said, said
    assert list(tmp_path.iterdir()) == [tmp_path / "rig.yaml"]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_signal_before_there_is_a_loop(monkeypatch):
    """An object may take seconds to be made ready."""

    def slow(arguments, log):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
        raise AssertionError("it went on")

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(_live_source, "open_source", slow)
    with pytest.raises(SystemExit) as ended:
        main(["live", "--simulate"])
    assert ended.value.code == 0 and signal.getsignal(signal.SIGTERM) == before


_TRIES = """
import sys, time
import cv2
from fastibl.commands import _live_source
from fastibl.__main__ import build_parser
from fastibl.live_camera import LiveCamera

tries, level, lines = [], cv2.utils.logging.getLogLevel(), []
def opened(device, real=LiveCamera.__init__.__kwdefaults__["open_capture"]):
    tries.append(device)
    return real(device)
LiveCamera.__init__.__kwdefaults__.update(retry=0.01, open_capture=opened)
arguments = ["live", "--rig", sys.argv[1], "--back", "http://127.0.0.1:9/video", "--front", "/dev/nowhere"]
source = _live_source.open_source(build_parser().parse_args([*arguments]), lines.append).source
while min(map(tries.count, set(tries))) < 5 or len(set(tries)) < 2:
    time.sleep(0.01)
source.close()
assert cv2.utils.logging.getLogLevel() == level and len(lines) == 2, lines
"""


def test_a_camera_that_is_away_does_not_fill_the_log(tmp_path):
    """OpenCV and FFmpeg would write two lines at each try."""
    camera = fastibl.Camera(96, 72, 90, 90, 48, 36)
    write_rig(tmp_path / "rig.yaml", fastibl.Rig(camera, camera, fastibl.Pose()))
    command = [sys.executable, "-c", _TRIES, str(tmp_path / "rig.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_nohup_is_obeyed():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with _Ending():
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


# Sources.


def numbered(count):
    rig = fastibl.Rig(fastibl.Camera(64, 48, 50, 50, 32, 24))
    return fastibl.Recording(rig, [fastibl.Frame(k, np.full((48, 64, 3), k, np.uint8)) for k in range(count)])


def test_back_and_forth():
    source = sources.BackAndForth(numbered(4), 0.5)
    for _ in range(2):  # again from the begin
        frames = list(itertools.islice(source, 15))
        assert [int(f.back[0, 0, 0]) for f in frames] == [0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1, 2]
        assert [f.time for f in frames] == [0.5 * k for k in range(15)]
    assert source.kept == 4 and source.complete
    source = sources.BackAndForth(numbered(4), 0.5)
    assert [int(f.back[0, 0, 0]) for f in itertools.islice(source, 2)] == [0, 1] and source.kept == 2
    assert [int(f.back[0, 0, 0]) for f in itertools.islice(source, 6)] == [0, 1, 2, 3, 2, 1]
    source.close()
    assert list(source) == []
    assert [int(f.back[0, 0, 0]) for f in itertools.islice(sources.BackAndForth(numbered(1), 1), 3)] == [0, 0, 0]
    assert list(sources.BackAndForth(numbered(0), 1)) == []
    with pytest.raises(ValueError, match="period"):
        sources.BackAndForth(numbered(1), 0)


def test_a_pause_is_not_caught_up_with():
    now = [0.0]

    def sleep(seconds):
        now[0] += seconds

    given = []
    for frame in sources.Paced(numbered(6), catch_up=2.5, clock=lambda: now[0], sleep=sleep):
        given.append((frame.time, now[0]))
        now[0] += {1: 2.0, 3: 10.0}.get(frame.time, 0.0)
    # Two seconds late: the next come at once. Ten: the clock goes on from there.
    np.testing.assert_allclose(given, [(0, 0), (1, 1), (2, 3), (3, 3), (4, 13), (5, 14)])


# Given light.


def test_a_given_map_is_as_bright_as_the_boards_white():
    """Whatever units its file has: the simulated place is lit by the same map."""
    from fastibl.board_meter import brightness_of, scaled

    faces = np.full((6, 16, 16, 3), 0.5, np.float32)
    faces[4, 4:8, 4:8] = 20.0
    cube = fastibl.CubeMap(faces)
    film = fastibl.simulate(cube, seconds=0.1, fps=10, size=(320, 240), truth_size=8, hand=False)
    frame = film[0]
    pose = film.truth.pose(frame.time)
    for units in (1.0, 100.0):
        factor = brightness_of(fastibl.CubeMap(faces * np.float32(units)), film.rig, film.board, frame, pose)
        assert factor * units == pytest.approx(1.0, rel=0.12)  # the page's albedo here is 0.80, assumed is 0.85
    assert np.allclose(scaled(cube, 2.0).radiance.faces, 2 * faces)
    black = fastibl.Frame(0.0, np.zeros_like(frame.back), None, frame.back_exposure)
    assert brightness_of(cube, film.rig, film.board, black, pose) is None
    assert brightness_of(fastibl.CubeMap(0 * faces), film.rig, film.board, frame, pose) is None


def test_given_light_on_a_recording(recording, tmp_path, capsys):
    fastibl.write_environment(tmp_path / "room.hdr", fastibl.CubeMap(np.full((6, 8, 8, 3), 7.0, np.float32)))
    command = ["live", "--no-page", "--recording", str(recording), "--environment", str(tmp_path / "room.hdr")]
    assert main([*command, "--keep", str(tmp_path / "kept.hdr")]) == 2
    assert "leave one away" in capsys.readouterr().err
    assert main([*command, "--error", "0", "--out", str(tmp_path / "live.webm")]) == 0
    said = capsys.readouterr()
    assert "4 frames" in said.out and "as the board's white shows it" in said.err
