"""The native program's window under an X server without a screen: keys, clicks, what is shown."""

import os
import subprocess
import time

import cv2
import numpy as np
import pytest

from bench.window import NO_DRIVER, PROGRAM, Screen, Window, missing_tools

if not PROGRAM.is_file():
    pytest.skip(f"fastibl-demo is not built: no {PROGRAM}", allow_module_level=True)
if missing_tools():
    pytest.skip(f"the window needs {' and '.join(missing_tools())}", allow_module_level=True)

SMALL = ("--simulate", "--size", "320x240", "--object", "ball")
PANEL = 300  # pixels

# Key as X names it, and what the program says to it.
KEYS = {
    "1": "pose: on",
    "2": "map: on",
    "3": "lights: on",
    "4": "shadow-map: on",
    "5": "timings: on",
    "6": "plan: on",
    "h": "help: on",
    "k": "material: matte",
    "s": "shadow: off",
    "w": "shadow-strength: 0.75",
    "m": "methods: paper",
    "t": "tracking: board",
    "d": "diffuse: six-face-exact",
    "g": "glossy: centroid",
    "f": "shadow-method: directions",
    "a": "self-shadow: transfer",
    "u": "bounce: one",
    "e": "error: 5",
    "i": "milliseconds: 5",
    "l": "lamp: on",
    "F1": "help: off",
    "Tab": "interface: off",
    "space": "freeze: on",
    "o": "steps, 12 cm high",
    "v": "steps, 20 cm high",
    "c": "beginning again",
}


@pytest.fixture(scope="module")
def screen():
    with Screen() as running:
        yield running


def shown(path, panel=PANEL):
    return cv2.imread(str(path))[:, panel:].astype(int)


def test_every_key(screen, tmp_path):
    with Window(screen, *SMALL, folder=tmp_path) as window:
        window.wait_for("Esc, too")
        for key, said in KEYS.items():
            window.press(key)
            window.wait_for(said)
        window.press("r")
        window.wait_for("recording to fastibl-recording")
        window.press("n", "n", "comma", "period", "r")
        window.wait_for("recorded ")
        window.press("p")
        window.wait_for("wrote fastibl-")
        window.press("b")
        window.wait_for("backend: ")  # cpu, too, where there is no driver
        assert "steps, matte" in window.title
        window.press("Escape")
        assert window.wait() == 0
        assert "frames/s in all" in window.output
    assert (tmp_path / "fastibl-recording" / "frames.csv").read_text().count("back/") == 2  # two steps
    # All commands of the table were used.
    used = {said.partition(":")[0].partition(",")[0] for said in KEYS.values()}
    told = {line[7:].split()[0] for line in window.output.splitlines()[:32]}
    by_their_words = {"object", "height", "restart", "record", "step", "turn-left", "turn-right", "screenshot", "quit"}
    assert told - used - by_their_words - {"backend"} == set()


def test_clicks_and_text(screen, tmp_path):
    """Every kind of control of the panel does what its command does."""
    (tmp_path / "own.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nv 0 1 0\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    with Window(screen, *SMALL, folder=tmp_path) as window:
        window.wait_for("Esc, too")
        window.press("space")  # a window that waits is quick
        window.wait_for("freeze: on")
        window.click(157, 58)  # check box
        window.wait_for("map: on")
        window.click(80, 196)  # list, and its fourth entry
        window.click(40, 271)
        window.wait_for("material: chrome")
        window.click(80, 311)  # text field: letters are no keys now
        window.type("own.obj")
        window.click(210, 311)  # button
        window.wait_for("own.obj, 12 cm high")
        window.click(193, 495)
        window.wait_for("beginning again")
        window.press("q")
        assert window.wait() == 0
        assert "record" not in window.output.partition("Esc, too")[2]  # as "r" would have told


def test_keys_that_are_held_and_tab_twice(screen, tmp_path):
    with Window(screen, *SMALL, folder=tmp_path) as window:
        window.wait_for("Esc, too")
        window.press("Tab")
        window.wait_for("interface: off")
        window.press("Tab")
        window.wait_for("interface: on")
        window.press("m")  # which no text field takes
        window.wait_for("methods: paper")
        window.hold("r", 2.0)
        window.press("r")
        window.wait_for("recorded ")
        window.press("q")
        assert window.wait() == 0
    assert len(list(tmp_path.glob("fastibl-recording*"))) == 1


def test_a_recording_that_is_gone_does_not_begin_again(screen, tmp_path):
    simulated = tmp_path / "rec"
    subprocess.run([str(PROGRAM), *SMALL, "--headless", "--frames", "3", "--record", str(simulated)], check=True)
    with Window(screen, "--recording", simulated, "--object", "ball", folder=tmp_path) as window:
        window.wait_for("Esc, too")
        while " ms " not in window.title:  # until a picture was read
            time.sleep(0.05)
        simulated.rename(tmp_path / "away")
        window.press("c")
        window.wait_for("no recording at")
        window.press("m")
        window.wait_for("methods: paper")
        window.press("q")
        assert window.wait() == 0
    # What the command line asks for and cannot be done ends it.
    with Window(screen, "--simulate", "--record", tmp_path / "away", folder=tmp_path) as window:
        assert window.wait() == 2


def test_frozen_frames_show_what_is_changed(screen, tmp_path):
    with Window(screen, *SMALL, "--no-interface", folder=tmp_path) as window:
        window.wait_for("Esc, too")
        window.press("space")
        window.wait_for("freeze: on")
        pictures = []
        for k, key in enumerate((None, "k", "s", "2", "Tab")):
            if key:
                window.press(key)
            window.type("p")
            window.wait_for("wrote ", count=k + 1)
            pictures.append(cv2.imread(str(sorted(tmp_path.glob("*.png"), key=lambda p: p.stat().st_mtime)[-1])))
        window.press("q")
        assert window.wait() == 0
    plain, matte, without_shadow, with_map, panel = (p.astype(int) for p in pictures)
    assert plain.shape == (240, 320, 3)
    assert np.abs(matte - plain).max() > 40
    assert np.abs(without_shadow - matte).max() > 20
    right = np.abs(with_map - without_shadow)[150:, 200:]
    assert right.mean() > 10
    assert panel.shape[1] == 320  # the window stays as large as it is


def test_screenshot_at_a_frame_has_the_panel(screen, tmp_path):
    shot = tmp_path / "shot.png"
    arguments = (*SMALL, "--frames", "4", "--screenshot", shot, "--at", "2", "--do", "2:material=gold")
    with Window(screen, *arguments, folder=tmp_path) as window:
        assert window.wait() == 0
        assert f"wrote {shot}" in window.output
        if "without its panel" in window.output:
            pytest.skip("built without Dear ImGui")
    picture = cv2.imread(str(shot))
    assert picture.shape[1] == 320 + PANEL and picture.shape[0] >= 560
    panel, view = picture[:, :PANEL], picture[:, PANEL:]
    assert len(np.unique(panel.reshape(-1, 3), axis=0)) > 20  # text and controls
    assert view.max() > 200


def test_a_window_without_opengl_says_so(screen, tmp_path):
    env = {**os.environ, "DISPLAY": screen.display, **NO_DRIVER}
    done = subprocess.run([PROGRAM, *SMALL], env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and "use --headless" in done.stderr
