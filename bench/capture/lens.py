"""The lens of a photograph, found from the board in it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import fastibl
from fastibl.calibration import guess_camera
from fastibl.guessed_rig import guessed_camera

from ..goals import Goal, percent, row

_SIZE = (1280, 960)
_LENSES = ((0.0, 0.0), (0.05, 0.01), (-0.1, 0.02))  # k1; how far the middle is off, as a share of the width
_TILTS = ((20, 0.05), (35, 0.02), (55, 0.01))  # degrees; what the focal length's median may be off


def photograph(degrees: float, k1: float, off: float, tilt: float, seed: int) -> tuple[fastibl.Camera, np.ndarray]:
    """A camera, degrees across, and its picture of the board in the built-in room."""
    width, height = _SIZE
    f = guessed_camera(_SIZE, degrees).fx
    matrix = np.array([[f, 0, (0.5 + off) * width], [0, f, height / 2 - off * width], [0, 0, 1]])
    camera = fastibl.Camera.from_opencv(matrix, [k1, 0, 0, 0, 0], _SIZE)
    t = np.radians(tilt)
    pose = fastibl.Pose.look_at(eye=(0.05, -0.45 * np.sin(t), 0.45 * np.cos(t)), target=(0.02, 0.02, 0.0))
    film = fastibl.simulate(
        seconds=0.1, fps=10, rig=fastibl.Rig(camera), path=lambda _: pose, hand=False, lamp=False, seed=seed
    )
    return camera, film[0].back


@row("capture", "lens of a photograph")
def lens() -> Iterator[Goal]:
    board = fastibl.Board.default()
    for tilt, most in _TILTS:
        off, stated = [], []
        for degrees in (54, 65, 76):
            for seed, (k1, middle) in enumerate(_LENSES):
                true, picture = photograph(degrees, k1, middle, tilt, seed)
                found, deviation = guess_camera([picture], board)
                off.append(abs(np.log(found.fx / true.fx)))
                stated.append(deviation)
        errors, deviations = np.array(off), np.array(stated)
        inside = float((errors <= 2 * deviations).mean())
        yield Goal(
            f"focal length by one photograph of the board from {tilt} degrees off its middle: median",
            percent(float(np.median(errors))),
            f"<= {percent(most)}, all within twice what is stated",
            bool(np.median(errors) <= most and inside == 1),
            (f"worst {percent(float(errors.max()))}; stated {percent(float(np.median(deviations)))}; "
             f"{percent(inside)} within twice that",),
        )  # fmt: skip
