"""The pictures of docs/program.md: the native program's window, and its overlays, in the simulated room."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2

from .measure import ROOT
from .window import PROGRAM, Screen, missing_tools

_IMAGES = ROOT / "docs" / "images"
_QUALITY = 85
_SIMULATED = ("--simulate", "--size", "800x600", "--object", "knot", "--do", "60:lamp=on")
_OVERLAYS = "pose,map,lights,timings"


def main() -> Iterator[Path]:
    """Writes the pictures one by one. Raises RuntimeError where the program or the screen is missing."""
    if not PROGRAM.is_file():
        raise RuntimeError(f"{PROGRAM.name} is not built: docs/program.md")
    if missing_tools():
        raise RuntimeError(f"needs {' and '.join(missing_tools())}")
    with tempfile.TemporaryDirectory() as name:
        shot = Path(name) / "shot.png"
        with Screen() as screen:
            _run(
                [*_SIMULATED, "--material", "gold", "--overlay", _OVERLAYS, "--frames", "660"], shot, screen.environment
            )
        yield _keep(shot, "program")
        every = f"{_OVERLAYS},shadow-map,plan"
        _run([*_SIMULATED, "--headless", "--material", "chrome", "--overlay", every, "--frames", "640"], shot)
        yield _keep(shot, "program-overlays")


def _run(arguments: list[str], shot: Path, environment: dict[str, str] | None = None) -> None:
    command = [str(PROGRAM), *arguments, "--screenshot", str(shot)]
    subprocess.run(command, check=True, capture_output=True, env=environment)


def _keep(shot: Path, name: str) -> Path:
    path = _IMAGES / f"{name}.jpg"
    cv2.imwrite(str(path), cv2.imread(str(shot)), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return path
