"""The README's picture, by `./dev bench demo-picture`: what the demo makes of its last moment, beside the truth."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.demo import POSITION, run_demo, write_label
from fastibl.expected import present

from .measure import ROOT

OUT = ROOT / "docs" / "images" / "demo.jpg"
_WIDTH = 1290  # pixels; each picture takes a third, each map a half


def _panel(picture: NDArray[np.uint8], width: int, text: str) -> NDArray[np.uint8]:
    height = round(picture.shape[0] * width / picture.shape[1])
    panel = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    write_label(panel, text)
    return panel


def main() -> list[Path]:
    """Uses the recording at FASTIBL_DEMO_RECORDING if that is set; otherwise simulates the demo's."""
    given = os.environ.get("FASTIBL_DEMO_RECORDING")
    recording = fastibl.Recording.open(given) if given else fastibl.simulate(seconds=12, position=POSITION)
    with tempfile.TemporaryDirectory() as folder:
        result = run_demo(recording, Path(folder))
    still, error = result.stills[-1], result.runs["default"].image_error[result.stills[-1].title]
    back = [f.back for f in recording if f.back is not None][-1]
    pictures = {
        "back camera": back,
        f"fastibl: {100 * error:.1f} % off": still.pictures["default"],
        "truth (brute force)": present(still.true).image,
    }
    maps = {"captured light (unseen parts dimmed)": result.maps["captured"], "true light": result.maps["true"]}
    rows = [
        np.hstack([_panel(picture, _WIDTH // len(row), text) for text, picture in row.items()])
        for row in (pictures, maps)
    ]
    cv2.imwrite(str(OUT), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    return [OUT]
