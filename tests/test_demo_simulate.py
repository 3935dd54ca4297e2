"""The native program without files: the simulated room, scripts, overlays, recordings that survive, cameras that go."""

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import fastibl
from bench.window import NO_DRIVER, PROGRAM, ROOT
from fastibl.recording import RecordingWriter

if not PROGRAM.is_file():
    pytest.skip(f"fastibl-demo is not built: no {PROGRAM}", allow_module_level=True)

SMALL = ("--simulate", "--size", "320x240", "--object", "steps", "--headless")


def run(*arguments, code=0, env=None, cwd=None):
    command = [str(part) for part in (PROGRAM, *arguments)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=300, cwd=cwd, env={**os.environ, **(env or {})}
    )
    assert done.returncode == code, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"
    return done


OVERLAYS = ("pose", "map", "lights", "shadow-map", "timings", "plan")


@pytest.fixture(scope="module")
def overlays(tmp_path_factory):
    """Pictures by overlay: of a frame without any, and of the same with it."""
    folder = tmp_path_factory.mktemp("overlays")
    orders = []
    for frame, name in enumerate(OVERLAYS, start=4):  # one after the other
        orders += ["--do", f"{frame}:{name}=on", "--do", f"{frame + 1}:{name}=off"]
    del orders[-2:]  # that frame does not come
    frames = ("--frames", 3 + len(OVERLAYS), "--out")
    run(*SMALL, *frames, folder / "without")
    run(*SMALL, *frames, folder / "with", *orders)
    without, drawn = (
        [cv2.imread(str(path)).astype(int) for path in sorted((folder / name).iterdir())]
        for name in ("without", "with")
    )
    for k in range(3):
        np.testing.assert_array_equal(without[k], drawn[k])
    return {name: (without[3 + k], drawn[3 + k]) for k, name in enumerate(OVERLAYS)}


# Where each overlay is drawn: rows and columns of a 320 x 240 picture, and where it is not.
PLACES = {
    "pose": (np.s_[205:, :150], np.s_[:60, 200:]),
    "map": (np.s_[140:, 220:], np.s_[:100, :140]),
    "lights": (np.s_[:20, 200:], np.s_[200:, :100]),
    "shadow-map": (np.s_[170:, :70], np.s_[:100, :]),
    "timings": (np.s_[:80, 220:], np.s_[200:, :100]),
    "plan": (np.s_[:80, :120], np.s_[200:, 200:]),
}


@pytest.mark.parametrize("name", PLACES)
def test_overlays(overlays, name):
    inside, outside = PLACES[name]
    without, drawn = overlays[name]
    changed = np.abs(drawn - without).max(axis=-1)
    assert (changed[inside] > 8).mean() > 0.3
    assert changed[outside].max() == 0


def test_scripts_change_what_is_shown(tmp_path):
    orders = {2: "material=chrome", 3: "shadow=off", 4: "object=ball", 5: "height=0.2", 6: "methods=paper"}
    orders |= {7: "diffuse=sh9", 8: "error=10", 9: "milliseconds=20", 10: "turn-left", 11: "backend=gl", 12: "lamp=on"}
    orders |= {13: "restart", 15: "quit"}
    script = [word for frame, order in orders.items() for word in ("--do", f"{frame}:{order}")]
    said = run(*SMALL, "--frames", 20, *script, "--out", tmp_path / "out", env=NO_DRIVER).stdout
    for words in (
        "material: chrome",
        "shadow: off",
        "ball, 20 cm high",
        "methods: paper",
        "diffuse: sh9",
        "error: 10",
    ):
        assert words in said
    assert "milliseconds: 20" in said and "lamp: on" in said and "beginning again" in said
    assert "backend: cpu" in said  # there is no driver
    frames = [cv2.imread(str(p)).astype(int) for p in sorted((tmp_path / "out").glob("*.png"))]
    assert len(frames) == 14  # quit before the fifteenth


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("--do", "3"), "expected FRAME:COMMAND"),
        (("--do", "0:pose"), "expected FRAME:COMMAND"),
        (("--do", "1:dance"), 'no command "dance"; there are: pose, map'),
        (("--do", "1:material=wood"), "material must be one of given, matte"),
        (("--do", "1:height=tall"), 'expected a number, got "tall"'),
        (("--do", "1:step=2"), "step takes no value"),
        (("--overlay", "fog"), "fog not in"),
        (("--at", "3"), "--at 3 needs --screenshot"),
        (("--screenshot", "no-folder/a.png"), "--screenshot: there is no folder no-folder"),
        (("--do", "9:screenshot=no-folder/a.png"), "screenshot: there is no folder no-folder"),
        (("--rig", "rig.yaml"), "--rig is of cameras: rig.yaml needs --back CAMERA"),
        (("--record", "."), "a recording is a new folder"),
    ],
)
def test_bad_arguments(arguments, message):
    assert message in run(*SMALL, "--frames", 1, *arguments, code=2).stderr


def test_bad_size():
    assert "each from 64 to 4096" in run("--simulate", "--size", "9x9", "--headless", "--frames", 1, code=2).stderr


def test_simulated_recordings_are_tracked(tmp_path):
    """What it records is a recording, and the board in it is tracked."""
    run(*SMALL, "--frames", 12, "--record", tmp_path / "rec")
    recording = fastibl.Recording.open(tmp_path / "rec")
    assert len(recording) == 12 and recording.board == fastibl.Board.default()
    scene = fastibl.Scene(fastibl.stand(fastibl.shapes.figurine(), 0.1), fastibl.Material())
    session = fastibl.Session(scene, recording.rig, recording.board)
    results = [session.process(frame) for frame in recording]
    assert all(result.back_from_marker is not None for result in results)
    assert np.median([result.tracked.residual_px for result in results]) < 0.3
    exposures = sorted({frame.front_exposure for frame in recording})
    assert len(exposures) == 3 and exposures[2] == pytest.approx(256 * exposures[0])


def test_recording_has_the_same_pictures(tmp_path):
    """What was recorded plays as what was seen."""
    odd = tmp_path / "Aufnahme – größer 日本"
    run(*SMALL, "--frames", 3, "--poses", "truth", "--record", odd / "rec", "--out", odd / "a")
    run("--recording", odd / "rec", "--object", "steps", "--headless", "--out", odd / "b")
    live, played = (
        [cv2.imdecode(np.fromfile(p, np.uint8), 1).astype(int) for p in sorted((odd / k).iterdir())] for k in "ab"
    )
    assert len(live) == len(played) == 3
    for a, b in zip(live, played, strict=True):
        assert np.abs(a - b).mean() < 2  # poses are tracked there


def test_killed_while_recording(tmp_path):
    folder = tmp_path / "rec"
    command = [str(part) for part in (PROGRAM, *SMALL, "--frames", 100000, "--record", folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    end = time.monotonic() + 60
    rows = 0
    while rows < 30 and time.monotonic() < end:
        time.sleep(0.02)
        rows = (folder / "frames.csv").read_text().count("\n") if (folder / "frames.csv").exists() else 0
    process.send_signal(signal.SIGKILL)
    process.wait()
    recording = fastibl.Recording.open(folder)
    frames = list(recording)  # a broken picture would warn, and warnings are errors here
    assert len(frames) == len(recording) >= 15
    files = len(list((folder / "back").glob("*.png")))
    assert files - len(frames) <= 1  # one may be half written; no more was begun
    text = (folder / "frames.csv").read_text()
    (folder / "frames.csv").write_text(text[:-5])  # as a machine that stops leaves it
    done = run("--recording", folder, "--headless", "--frames", 2)
    assert "is cut off; it is left out" in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_what_is_written(number, tmp_path):
    command = [
        str(part)
        for part in (
            PROGRAM,
            *SMALL,
            "--frames",
            100000,
            "--record",
            tmp_path / "rec",
            "--out",
            tmp_path / "a.webm",
        )
    ]
    # Under nohup the tests ignore SIGHUP, and what they start would, too.
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL)
    )
    end = time.monotonic() + 60
    table, rows = tmp_path / "rec" / "frames.csv", 0
    while rows < 30 and time.monotonic() < end:
        time.sleep(0.02)
        rows = table.read_text().count("\n") if table.exists() else 0
    process.send_signal(number)
    said = process.communicate(timeout=60)[0]
    assert process.returncode == 0 and "frames/s of processing" in said
    written = int(re.search(r"recorded (\d+) frames", said)[1])
    video, shown = cv2.VideoCapture(str(tmp_path / "a.webm")), 0
    while video.read()[0]:
        shown += 1
    assert shown == written == len(fastibl.Recording.open(tmp_path / "rec"))


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="needs /proc")
def test_a_signal_before_the_first_picture(tmp_path):
    command = [PROGRAM, *SMALL[:-3], "--object", "knot", "--headless", "--frames", "9", "--out", tmp_path / "a.webm"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 60
    caught = 0
    while not caught & 1 << signal.SIGINT - 1 and time.monotonic() < end:
        caught = int(re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{process.pid}/status").read_text())[1], 16)
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60)
    assert process.returncode == 0 and said == ("", "")
    assert not (tmp_path / "a.webm").exists()


def test_the_simulated_board_shows_its_white(tmp_path):
    """The paper is not clipped, so that it tells how bright the light on the table is."""
    run(*SMALL, "--frames", 1, "--out", tmp_path)
    picture = cv2.imread(str(next(tmp_path.glob("*.png"))))
    assert (picture >= 254).any(axis=-1).mean() < 0.01 and np.percentile(picture, 99) > 180


def test_names_that_leave_the_recording(tmp_path):
    run(*SMALL, "--frames", 1, "--record", tmp_path / "rec")
    table = tmp_path / "rec" / "frames.csv"
    shutil.copy(tmp_path / "rec" / "back" / "00000.png", tmp_path / "secret.png")
    for name in ("../secret.png", str(tmp_path / "secret.png"), "back/../../secret.png"):
        table.write_text(f"time,camera,file,exposure\n0.0,back,{name},1.0\n")
        assert (
            "leads out of the recording's folder" in run("--recording", tmp_path / "rec", "--headless", code=2).stderr
        )


def test_full_or_read_only_disk(tmp_path):
    if os.geteuid() == 0:
        where = "/proc/recording"  # root may write anywhere else
    else:
        tmp_path.chmod(0o500)
        where = tmp_path / "rec"
    assert "cannot be made" in run(*SMALL, "--frames", 1, "--record", where, code=1).stderr


def test_locale_with_a_decimal_comma(tmp_path):
    locales = tmp_path / "locales"
    locales.mkdir()
    made = shutil.which("localedef") and subprocess.run(
        ["localedef", "-i", "de_DE", "-f", "UTF-8", locales / "de_DE.UTF-8"], capture_output=True
    )
    if not made or not (locales / "de_DE.UTF-8").is_dir():
        pytest.skip("needs the sources of the locale de_DE (Debian: locales)")
    comma = {"LOCPATH": str(locales), "LC_ALL": "de_DE.UTF-8"}
    run(*SMALL, "--frames", 1, "--record", tmp_path / "a", env=comma)
    for name in ("rig.yaml", "board.yaml"):
        assert not re.search(r"\d,\d", (tmp_path / "a" / name).read_text())
    recording = fastibl.Recording.open(tmp_path / "a")
    assert recording.rig.front.fx == 197.75 and 0 < recording[0].back_exposure < 1
    play = ("--recording", tmp_path / "a", "--object", "steps", "--headless", "--height", "0.15", "--out")
    run(*play, tmp_path / "c.png", env=comma)
    run(*play, tmp_path / "d.png")
    assert (tmp_path / "c.png").read_bytes() == (tmp_path / "d.png").read_bytes()


def test_goes_on_when_a_camera_is_gone(tmp_path):
    """A video stands for a camera: it ends, and begins again, as one that is unplugged for a while."""
    recording = fastibl.simulate(seconds=0.5, fps=10, size=(320, 240), truth_size=16, hand=False)
    with RecordingWriter(tmp_path / "rec", recording.rig, recording.board, video=True) as writer:
        for frame in recording:
            writer.add(frame)
    camera = tmp_path / "rec" / "back.mkv"
    arguments = ("--back", camera, "--rig", tmp_path / "rec" / "rig.yaml", "--object", "steps", "--headless")
    done = run(*arguments, "--frames", 12)
    assert done.stderr.count("gives no more pictures; going on") >= 1
    assert done.stderr.count("the back camera is back") >= 1
    small = fastibl.Rig(recording.rig.back.replace(width=160, height=120))
    fastibl.recording.write_rig(tmp_path / "small.yaml", small)
    wrong = run("--back", camera, "--rig", tmp_path / "small.yaml", "--headless", "--frames", 1, code=2)
    assert "calibrated for 160 × 120, but gives 320 × 240" in wrong.stderr
    gone = run("--back", tmp_path / "no.mkv", "--rig", tmp_path / "small.yaml", "--headless", "--frames", 1, code=2)
    assert "does not open" in gone.stderr


def test_documented_keys_are_those_of_the_program():
    """docs/program.md holds the table that --help prints."""
    printed = run("--help").stdout.partition("Keys, and commands")[2].splitlines()[1:]
    rows = [(line[2:9].strip(), line[9:26].strip(), line[26:].strip()) for line in printed if line.strip()]
    assert len(rows) > 30
    text = (ROOT / "docs" / "program.md").read_text()
    table = "| key | command | |\n|---|---|---|\n"
    table += "".join(f"| {f'`{key}`' if key else ''} | `{name}` | {words} |\n" for key, name, words in rows)
    assert table in text
