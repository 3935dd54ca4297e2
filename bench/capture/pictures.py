"""A sun that clips in both exposures of the front camera, by `./dev bench capture-pictures`: its light as the lower
bound that the pictures show, as the board's white says, and the true map; cropped."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.expected import present
from fastibl.recording import truth_of

from .. import inputs
from ..measure import ROOT
from .boost import Alternate, one_exposure, true_map
from .recordings import FRESH, sweep_film

OUT = ROOT / "docs" / "images" / "capture-sun.jpg"


def last_picture(film: fastibl.Recording, **options) -> NDArray[np.uint8]:
    """The last picture of a session in which the board was seen."""
    session = fastibl.Session(inputs.scene("figurine"), film.rig, film.board, **options)
    out = None
    for frame in film:
        result = session.process(frame)
        out = result.image if result.tracked is not None else out
    return present(out)


def main() -> list[Path]:
    alternate = Alternate(0.5 * one_exposure(true_map(FRESH)))
    film = sweep_film(FRESH, seconds=6, fps=10, seed=0, size=(640, 480), front_exposures=alternate)
    shown = [last_picture(film, most_boost=most) for most in (1.0, None)]
    shown.append(last_picture(film, environment=truth_of(film).environment(0.0)))
    strip = np.concatenate([s[:, 120:560] for s in shown], axis=1)
    cv2.imwrite(str(OUT), strip[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    return [OUT]
