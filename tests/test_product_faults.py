"""What goes wrong around fastibl: killed, disk full, nothing may be written, another locale, files of strangers."""

import csv
import locale
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import zlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fastibl
from fastibl import Frame, Recording
from fastibl.recorder import Recorder
from fastibl.recording import RecordingWarning, RecordingWriter, read_board, read_rig, write_board, write_rig

LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs Linux")
CAMERA = fastibl.Camera(64, 48, 50, 50, 32, 24)
RIG = fastibl.Rig(CAMERA)
PATHS = [str(Path(fastibl.__file__).parents[1]), str(Path(__file__).parent)]


def frame(k):
    return Frame(k / 30, np.random.default_rng(k).integers(0, 256, (48, 64, 3), np.uint8))


def python(code, *arguments, **others):
    """A process that runs code, with the same fastibl."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(PATHS), **others.pop("env", {})}
    return subprocess.Popen([sys.executable, "-c", code, *map(str, arguments)], env=environment, text=True, **others)


def output(code, *arguments, **others):
    process = python(code, *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **others)
    said, errors = process.communicate(timeout=300)
    return process.returncode, said, errors


# Killed


_RECORD = """
import sys, time
from test_product_faults import RIG, frame
from fastibl.recorder import Recorder
with Recorder(sys.argv[1], RIG, least_free=0) as out:
    begin = time.monotonic()
    for k in range(10_000):
        time.sleep(max(0.0, begin + k / 30 - time.monotonic()))
        out.add(frame(k))
        print(k, flush=True)
"""


def test_a_killed_recorder_loses_at_most_the_last_second(tmp_path):
    process = python(_RECORD, tmp_path / "r", stdout=subprocess.PIPE)
    for line in process.stdout:
        if int(line) >= 60:
            break
    process.send_signal(signal.SIGKILL)
    given = max([60, *(int(line) for line in process.stdout if line.endswith("\n"))])
    process.wait()
    read = list(Recording.open(tmp_path / "r"))
    print(f"{given + 1} frames were given when it was killed, {len(read)} are read")
    assert read == [frame(k) for k in range(len(read))]
    assert (given + 1 - len(read)) / 30 < 1


# Two at once


def pyramid():
    vertices = [[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0], [0, 0, 0.1]]
    return fastibl.Mesh(np.array(vertices), np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))


def session_bits(seed):
    """Bytes that a session makes of a few pictures of noise, from poses that are given."""
    session = fastibl.Session(fastibl.Scene(pyramid(), fastibl.Material(), spheres=10), RIG, backend="cpu")
    matrix = np.diag([1.0, -1.0, -1.0, 1.0])  # straight down
    results = []
    for k in range(5):
        matrix[:3, 3] = 0.01 * k, 0.02, 0.3
        results.append(
            session.process(replace(frame(10 * seed + k), time=k / 30, back_from_marker=fastibl.Pose(matrix)))
        )
    return b"".join(r.image.tobytes() for r in results) + results[-1].environment.radiance.faces.tobytes()


@pytest.fixture(scope="module")
def alone():
    return [session_bits(seed) for seed in (0, 1)]


def test_two_sessions_in_two_threads(alone):
    together = [b"", b""]
    start = threading.Barrier(2)

    def work(seed):
        start.wait()
        together[seed] = session_bits(seed)

    threads = [threading.Thread(target=work, args=(seed,)) for seed in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone and alone[0] != alone[1]


def test_two_sessions_in_two_processes(alone):
    code = "import sys, test_product_faults as t; sys.stdout.buffer.write(t.session_bits(int(sys.argv[1])))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(PATHS)}
    both = [
        subprocess.Popen([sys.executable, "-c", code, str(seed)], stdout=subprocess.PIPE, env=environment)
        for seed in (0, 1)
    ]
    assert [process.communicate(timeout=300)[0] for process in both] == alone


# Nothing can be written


_FULL = """
import resource, sys
from pathlib import Path
from types import SimpleNamespace
from test_product_faults import RIG, frame
from fastibl import Camera, CubeMap, Frame, Recording, Rig, write_environment
from fastibl.live_page.pictures import save_picture
from fastibl.recorder import Recorder
from fastibl.recording import RecordingWriter
import numpy as np
kind, path = sys.argv[1:]
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))  # of any one file; a full disk says as much
wide = Rig(Camera(300, 200, 300, 300, 150, 100))
small = Frame(0.0, np.zeros((200, 300, 3), np.uint8))
big = Frame(1.0, np.random.default_rng(0).integers(0, 256, (200, 300, 3), np.uint8))
try:
    if kind == "recorder":
        out = Recorder(path, wide, least_free=0)
        out.add(small)
        out.add(big)
        try:
            out.close()
        finally:
            print("read", len(Recording.open(path)))
    if kind == "writer":
        with RecordingWriter(path, wide) as out:
            out.add(small)
            out.add(big)
    if kind == "list":  # frames.csv itself
        with RecordingWriter(path, RIG) as out:
            out._store = lambda camera, picture: "back/" + "0" * 900 + ".png"
            for k in range(100):
                out.add(frame(k))
    if kind == "map":
        write_environment(path + ".hdr", CubeMap(np.ones((6, 128, 128, 3))))
    if kind == "picture":  # of the live page
        save_picture(SimpleNamespace(result=SimpleNamespace(image=big.back)), Path(path + ".png"))
except OSError as error:
    print("told:", error)
"""


@LINUX
@pytest.mark.parametrize("kind", ["recorder", "writer", "list", "map", "picture"])
def test_a_full_disk_is_told_of(kind, tmp_path):
    status, said, errors = output(_FULL, kind, tmp_path / "r")
    assert status == 0 and "told: " in said and "File too large" in said, said + errors
    if kind in ("recorder", "writer"):
        assert len(list(Recording.open(tmp_path / "r"))) == 1  # the picture that was whole
    if kind == "recorder":
        assert "read 1" in said
    if kind == "list":
        with pytest.warns(RecordingWarning, match="cut off"):
            assert 10 < len(Recording.open(tmp_path / "r")) < 100
    if kind in ("map", "picture"):
        assert not list(tmp_path.iterdir()), "a part stays"


@LINUX
def test_a_full_tmpfs(tmp_path):
    """The same on a disk of 1 MB, where this user may make one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("may not mount a tmpfs here")
    try:
        out = Recorder(disk / "r", RIG, least_free=0)
        with pytest.raises(OSError, match="No space left"):
            for k in range(100_000):
                out.add(frame(k % 100))
        out.close()
        recording = Recording.open(disk / "r")
        assert len(list(recording)) == len(recording) == out.written > 50
    finally:
        subprocess.run(["umount", str(disk)], check=True)


_READ_ONLY = """
import os, sys
if os.getuid() == 0:
    os.setgid(65534)
    os.setuid(65534)
import test_product_faults as t
from fastibl.__main__ import main
folder = sys.argv[1]
t.session_bits(0)  # a session that may not keep what it bakes
print("status", main(["simulate", folder + "/new", "--seconds", "0.1"]))
print("status", main(["board", folder + "/board.pdf"]))
"""


@LINUX
def test_a_folder_that_may_only_be_read():
    probe = "import os; os.getuid() or (os.setgid(65534), os.setuid(65534)); import numpy, cv2, fastibl"
    if output(probe)[0] != 0:
        pytest.skip("another user than root cannot read this Python")
    with tempfile.TemporaryDirectory() as closed:  # not pytest's, which is closed to others
        os.chmod(closed, 0o555)
        environment = {"FASTIBL_CACHE": closed + "/cache", "HOME": closed, "PYTHONDONTWRITEBYTECODE": "1"}
        status, said, errors = output(_READ_ONLY, closed, env=environment)
        assert not os.listdir(closed)
    assert status == 0, errors
    assert said.count("status 2") == 2, said + errors
    assert errors.count("fastibl: error:") == 2 and "Permission denied" in errors and "Traceback" not in errors


def test_a_gpu_that_is_not_there_is_named(tmp_path):
    code = """
import numpy as np, fastibl
from test_product_faults import pyramid
scene = fastibl.Scene(pyramid(), fastibl.Material(), spheres=10)
camera = fastibl.Camera(32, 24, 30, 30, 16, 12)
cube = fastibl.CubeMap(np.ones((6, 8, 8, 3)))
try:
    fastibl.Session(scene, fastibl.Rig(camera), environment=cube, backend="gl")
except (RuntimeError, ValueError) as error:
    print("told:", error)
session = fastibl.Session(scene, fastibl.Rig(camera), environment=cube, backend="auto")
print("instead:", session.backend if hasattr(session, "backend") else "cpu")
"""
    status, said, errors = output(code, env={"FASTIBL_EGL_LIBRARY": "libNone.so"})
    assert status == 0, errors
    assert "told:" in said and ("libNone.so" in said or "without" in said) and "instead: cpu" in said


# Names and numbers of other places


def test_names_outside_ascii(tmp_path):
    folder = tmp_path / "Aufnahme Straße 東京 🎥"
    board = fastibl.Board.default()
    with RecordingWriter(folder, RIG, board) as out:
        out.add(frame(0))
    recording = Recording.open(folder)
    assert list(recording) == [frame(0)] and recording.rig == RIG and recording.board == board
    cube = fastibl.CubeMap(np.ones((6, 8, 8, 3)))
    fastibl.write_environment(folder / "Größe.hdr", cube)
    assert fastibl.read_environment(folder / "Größe.hdr", size=8).faces == pytest.approx(1, rel=0.01)
    (folder / "Würfel.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    assert len(fastibl.read_mesh(folder / "Würfel.obj").triangles) == 2


def test_a_plain_c_locale_and_its_encoding(tmp_path):
    """As in cron or a container: no UTF-8 but for the file system."""
    code = """
import sys
from test_product_faults import RIG, frame
from fastibl import Recording
from fastibl.recording import RecordingWriter
with RecordingWriter(sys.argv[1], RIG) as out:
    out.add(frame(0))
assert list(Recording.open(sys.argv[1])) == [frame(0)]
print(RIG, frame(0))
"""
    environment = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii:strict"}
    status, said, errors = output(code, tmp_path / "r-ö", env=environment)
    assert status == 0, errors


@pytest.fixture
def decimal_comma(tmp_path, monkeypatch):
    """A locale that writes 1,5; made here where the system has none."""
    before = locale.setlocale(locale.LC_ALL)
    if "de_DE.utf8" not in subprocess.run(["locale", "-a"], capture_output=True, text=True).stdout:
        command = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")]
        if not shutil.which("localedef") or subprocess.run(command, capture_output=True).returncode > 1:
            pytest.skip("no locale with a decimal comma (Debian: locales)")
        monkeypatch.setenv("LOCPATH", str(tmp_path))
    locale.setlocale(locale.LC_ALL, "de_DE.UTF-8")
    assert locale.localeconv()["decimal_point"] == ","
    yield
    locale.setlocale(locale.LC_ALL, before)


def test_a_decimal_comma_changes_no_file(tmp_path, decimal_comma):
    camera = fastibl.Camera(64, 48, 50.25, 50.5, 32.125, 24.75, [0.125, -0.0625, 0, 0], readout=0.015625)
    board = fastibl.Board.default()
    with RecordingWriter(tmp_path / "r", fastibl.Rig(camera), board) as out:
        out.add(frame(1))
    text = (tmp_path / "r" / "rig.yaml").read_text() + (tmp_path / "r" / "frames.csv").read_text()
    assert "50,25" not in text and "0.015625" in text
    recording = Recording.open(tmp_path / "r")
    assert recording.rig.back == camera and recording.board == board and list(recording) == [frame(1)]
    cube = fastibl.CubeMap(np.ones((6, 8, 8, 3)))
    fastibl.export_light(cube, tmp_path / "light", size=8)
    assert "3,14" not in (tmp_path / "light" / "light.json").read_text()
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1.5 0 0\nv 0 1.5 0\nv 0 0 1.5\nf 1 2 3\nf 1 2 4\n")
    assert fastibl.read_mesh(tmp_path / "m.obj").vertices.max() == 1.5
    with pytest.raises(ValueError, match=r"-1\.5"):
        fastibl.stand(fastibl.shapes.figurine(), -1.5)


# Recordings of strangers


@pytest.fixture
def recording(tmp_path):
    with RecordingWriter(tmp_path / "r", RIG, fastibl.Board.default()) as out:
        out.add(frame(0))
        out.write_truth(
            fastibl.recording.Truth(maps=[(0.0, fastibl.CubeMap(np.ones((6, 4, 4, 3))))], poses=[(0.0, fastibl.Pose())])
        )
    return tmp_path / "r"


def listed(recording, name):
    with open(recording / "frames.csv", "w", newline="") as file:
        csv.writer(file).writerows([("time", "camera", "file", "exposure"), ("0", "back", name, "1")])


@pytest.mark.parametrize(
    "name",
    ["../secret.png", "back/../../secret.png", "/etc/secret.png", "C:\\secret.png", "..\\secret.png", "//host/a.png"]
    + ["../film.mkv#0", "/dev/video0#0", "a\0.png"],
)
def test_names_that_leave_the_recording_are_refused(recording, name):
    fastibl.recording.Path(recording.parent / "secret.png").write_bytes((recording / "back/00000.png").read_bytes())
    listed(recording, name)
    with pytest.raises(ValueError, match="frames.csv"):
        Recording.open(recording)


@LINUX
def test_links_that_leave_the_recording_are_refused(recording):
    secret = recording.parent / "secret.png"
    secret.write_bytes((recording / "back/00000.png").read_bytes())
    (recording / "back/00000.png").unlink()
    (recording / "back/00000.png").symlink_to(secret)
    with pytest.warns(RecordingWarning, match="leads out of the recording"):
        assert list(Recording.open(recording)) == []
    (recording / "truth/map-0.npy").unlink()
    (recording / "truth/map-0.npy").symlink_to("/dev/zero")
    with pytest.raises((ValueError, OSError), match="truth|leads out"):
        Recording.open(recording)


def test_a_list_that_is_none(recording):
    path = recording / "frames.csv"
    for text, said in [
        (b"time,camera,file,exposure\n0,back," + b"x" * 200_000 + b".png,1\n", "no list|field"),
        (b"time,camera,file,exposure\n0,back,back/\xff.png,1\n", "UTF-8"),
        (b"time,camera,file,exposure\n0,back,playlist.m3u8,1\n", "pictures end in"),
    ]:
        path.write_bytes(text)
        with pytest.raises(ValueError, match=said):
            Recording.open(recording)
    with open(path, "wb") as file:
        file.truncate(2**28)
    with pytest.raises(ValueError, match="268435456 bytes"):
        Recording.open(recording)


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


@pytest.mark.parametrize("width, height", [(200_000, 200_000), (2**31 - 1, 1), (0, 5), (60_000, 60_000)])
def test_a_picture_that_claims_to_be_huge_takes_no_memory(recording, width, height):
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    (recording / "back/00000.png").write_bytes(b"\x89PNG\r\n\x1a\n" + data)
    with pytest.warns(RecordingWarning, match="cannot be read"):
        assert list(Recording.open(recording)) == []


def test_a_video_that_is_a_list_of_others_is_refused(recording):
    listed(recording, "back.mkv#0")
    (recording / "back.mkv").write_text("#EXTM3U\n#EXTINF:1\nfile:///etc/passwd\n")
    with pytest.warns(RecordingWarning, match="no Matroska, AVI or MP4"):
        assert list(Recording.open(recording)) == []


@pytest.mark.parametrize(
    "old, new, said",
    [
        ("width: 64", "width: 2000000000", "pixels are read"),
        ("width: 64", "width: 0", "no picture"),
        ("height: 48", "height: -48", "no picture"),
        ("height: 48", "height: 1e300", "whole number"),
        ("rows: 3", "rows: 1000000000", "matrix of"),
        ("gain: 1.", "gain: .Nan", "gain"),
    ],
)
def test_a_calibration_that_claims_too_much(recording, old, new, said):
    path = recording / "rig.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ValueError, match=said):
        Recording.open(recording)


def test_calibrations_that_are_too_large_or_none(recording):
    for name in ("rig.yaml", "board.yaml"):
        whole = (recording / name).read_text()
        for text, said in [
            ("", "rig|board"),
            ("%YAML:1.0\n---\n" + "a: [" * 20_000, "rig|board"),
            ("\0\1", "rig|board"),
        ]:
            (recording / name).write_text(text)
            with pytest.raises(ValueError, match=said):
                Recording.open(recording)
        with open(recording / name, "wb") as file:
            file.truncate(2**26)
        with pytest.raises(ValueError, match="67108864 bytes"):
            Recording.open(recording)
        (recording / name).write_text(whole)
    assert len(Recording.open(recording)) == 1


def test_truth_that_claims_too_much(recording):
    path = recording / "truth/map-0.npy"
    with open(path, "wb") as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f4", "fortran_order": False, "shape": (6, 100_000, 100_000, 3)}
        )
    with pytest.raises(ValueError, match="map-0.npy"):
        Recording.open(recording)
    np.save(path, np.ones((6, 4, 4, 3), np.float32))
    (recording / "truth/maps.csv").write_text("time,file\n0,../../map.npy\n")
    with pytest.raises(ValueError, match="must lie in the recording"):
        Recording.open(recording)
    (recording / "truth/maps.csv").write_text("time,file\n")
    (recording / "truth/events.json").write_text("[" * 100_000)
    with pytest.raises(ValueError, match="truth"):
        Recording.open(recording)


def test_rig_and_board_are_read_as_they_were_written(tmp_path):
    write_rig(tmp_path / "rig.yaml", RIG)
    write_board(tmp_path / "board.yaml", fastibl.Board.default())
    assert read_rig(tmp_path / "rig.yaml") == RIG and read_board(tmp_path / "board.yaml") == fastibl.Board.default()


FORK = """
import os, sys, time
import numpy as np
import fastibl

fastibl.set_threads(2)
cube = fastibl.CubeMap(np.random.default_rng(0).random((6, 64, 64, 3)))
made = lambda: fastibl.Lighting(cube).prefiltered(size=64)[3].faces
here = made()  # the threads were at work
child = os.fork()
if child == 0:  # where they are not
    same = np.array_equal(made(), here)
    started = len(os.listdir("/proc/self/task"))
    fastibl.set_threads(1)
    for _ in range(1000):  # a thread that was joined is listed for a moment
        left = len(os.listdir("/proc/self/task"))
        if left < started:
            break
        time.sleep(0.01)
    os._exit(0 if same and np.array_equal(made(), here) and started == left + 1 else 1)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@LINUX
@pytest.mark.parametrize("most", [None, 1])
def test_all_cores_that_may_be_used_are_where_nothing_is_said(most):
    allowed = set(sorted(os.sched_getaffinity(0))[:most])
    code = f"import os; os.sched_setaffinity(0, {allowed}); import fastibl; print(fastibl.threads())"
    process = python(code, stdout=subprocess.PIPE)
    assert int(process.communicate(timeout=60)[0]) == len(allowed)


def ends_well(code):
    """Runs a program that forks; nothing of it is left behind, also where it hangs."""
    process = python(code, start_new_session=True)
    try:
        assert process.wait(60) == 0
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


@LINUX
def test_a_process_forked_with_threads_neither_hangs_nor_differs():
    ends_well(FORK)


FORK_AT_WORK = """
import os, sys, threading
import numpy as np
import fastibl

film = fastibl.simulate(seconds=0.1, fps=10, size=(160, 120), truth_size=16)
at_work, forked = threading.Event(), threading.Event()

def detector(*_):
    at_work.set()
    forked.wait()
    return [], None

scene = fastibl.Scene(fastibl.shapes.figurine(detail=0.9), spheres=0, visibility_rays=0)
session = fastibl.Session(scene, film.rig, film.board, detector=detector, size=8)
thread = threading.Thread(target=lambda: session.process(next(iter(film))))
thread.start()
at_work.wait()
child = os.fork()
if child == 0:
    captures = [fastibl.Capture(size=1) for _ in range(500)]  # one waits for what the session holds, or none does
    os._exit(0 if sum(capture.environment().coverage for capture in captures) == 0 else 1)
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
forked.set()
thread.join()
sys.exit(code)
"""


@LINUX
def test_a_process_forked_while_a_session_is_at_work_does_not_hang():
    ends_well(FORK_AT_WORK)
