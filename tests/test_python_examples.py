"""The Python examples run, and a type checker finds nothing in them."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import fastibl

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "python"
if not EXAMPLES.is_dir():
    pytest.skip("needs the source tree", allow_module_level=True)


def run(folder, name, *arguments):
    path = os.pathsep.join([str(Path(fastibl.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def white(tmp_path):
    fastibl.write_environment(tmp_path / "white.hdr", fastibl.CubeMap(np.ones((6, 16, 16, 3))))
    return tmp_path / "white.hdr"


def test_light_from_map(tmp_path, white):
    first, *_ = run(tmp_path, "light_from_map.py", white).splitlines()
    assert [float(v) for v in first.split("[")[1].rstrip("]").split()] == pytest.approx([np.pi] * 3, rel=0.01)


def test_own_renderer(tmp_path):
    run(tmp_path, "own_renderer.py", "out.png")
    image = cv2.imread(str(tmp_path / "out.png")).astype(int)
    assert image.shape == (240, 320, 3) and image.std() > 5
    assert image[150:175, 140:180].mean() < image[20:40, 20:60].mean()  # under the ball


def test_relight(tmp_path, white):
    film = fastibl.simulate(seconds=0.2, fps=10, size=(320, 240))
    with fastibl.recording.RecordingWriter(tmp_path / "film", film.rig, film.board) as writer:
        for frame in (*film, fastibl.Frame(1.0, front=film[0].front, front_exposure=film[0].front_exposure)):
            writer.add(frame)  # the last one is of the front camera alone
    run(tmp_path, "relight.py", tmp_path / "film", white, "out.png")
    image = cv2.imread(str(tmp_path / "out.png")).astype(int)
    left, right = image[:, :320], image[:, 320:]
    differs = (np.abs(left - right).max(axis=-1) > 8).mean()
    assert image.shape == (240, 640, 3) and 0.005 < differs < 0.6, differs


def test_types(tmp_path):
    pytest.importorskip("mypy")
    # Where the package is installed mypy finds it, and refuses to be told. Of it only its types count.
    package = Path(fastibl.__file__).parents[1]
    environment = {**os.environ, **({} if package.name == "site-packages" else {"MYPYPATH": str(package)})}
    command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", f"--cache-dir={tmp_path / 'mypy'}"]
    files = sorted(map(str, EXAMPLES.glob("*.py")))
    assert len(files) >= 4
    done = subprocess.run([*command, *files], capture_output=True, text=True, env=environment, cwd=tmp_path)
    found = [line for line in done.stdout.splitlines() if line.startswith(str(EXAMPLES)) and ": error:" in line]
    assert "error" not in done.stderr and not found, "\n".join(found) + done.stderr
    # Of the tree it also names what it finds in the package.
    all_of_them = f"{len(files)} source files"
    assert f"no issues found in {all_of_them}" in done.stdout or f"checked {all_of_them}" in done.stdout, done.stdout[
        -300:
    ]
