"""Whether a session's picture keeps the plan's promise while the cameras still discover the place.

The truth is what a session that is given the light draws by the most exact methods that it has, which the row "promise"
compares with rays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.expected import present
from fastibl.recording import truth_of
from fastibl.truth import TruePicture, picture_error

from .. import inputs
from ..capture.recordings import ROOM, sweep_film
from ..goals import Goal, percent, row, skipped

MATERIALS = {
    "matte": fastibl.Material(diffuse=(0.7, 0.6, 0.5)),
    "satin": fastibl.Material(diffuse=(0.5, 0.5, 0.5), glossy=(0.2, 0.2, 0.2), exponent=32),
    "metal": fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.7, 0.5), exponent=128),
}
BUDGET, _EXACT = 0.02, 0.001
_FRAMES = (8, 16, 24, 32, 40, 48, 56)  # of 60 in which both cameras turn once all round


@dataclass(frozen=True)
class Moment:
    """error: of the picture under the light that is known by then; assured: what the plan says that it is within.
    light: how far that light puts even an exact picture off; stated: what the plan says of the light."""

    frame: int
    said: bool  # that the picture is within the budget
    assured: float
    error: float
    light: float
    stated: float


def error_of(
    picture: NDArray[np.uint8], true: NDArray[np.uint8], frame: fastibl.Frame, camera: fastibl.Camera
) -> float:
    """The picture's error where `true`, a picture as well, differs from the back picture."""
    height, width = true.shape[:2]
    whole = np.ones((height, width, 3))
    truth = TruePicture(
        true, camera.response.decode(true / 255.0).astype(np.float64), np.zeros((height, width)), whole, whole
    )
    return picture_error(picture, truth, present(frame.back), camera.response)


def moments(place: str, scene: fastibl.Scene) -> list[Moment]:
    film = sweep_film(place, seconds=6, fps=10, seed=0, size=(320, 240))
    session = fastibl.Session(scene, film.rig, film.board, error=BUDGET)
    everything, out = truth_of(film).environment(0.0), []
    for index, frame in enumerate(film):
        result = session.process(frame)
        if index not in _FRAMES or result.back_from_marker is None:
            continue
        known, true = (
            fastibl.Session(scene, film.rig, film.board, error=_EXACT, environment=light).process(frame).image
            for light in (present(result.environment).radiance, everything)
        )
        out.append(
            Moment(
                index,
                result.plan.meets_error,
                result.plan.assured_error,
                error_of(result.image, known, frame, film.rig.back),
                error_of(known, true, frame, film.rig.back),
                present(result.plan.light_error),
            )
        )
    return out


@row("plan", "light that is discovered")
def discovered() -> Iterator[Goal]:
    what = "pictures of a sweep within 2 % under the light that is known by then, where the plan says so"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    for name, material in MATERIALS.items():
        scene = fastibl.Scene(inputs.scene().mesh, material)
        films = {place: moments(place, scene) for place in (*inputs.MAPS, ROOM)}
        every = [m for film in films.values() for m in film]
        said = [m for m in every if m.said]
        within, worst = float(np.mean([m.error <= BUDGET for m in said])), max(m.error for m in said)
        by_frame = {k: [m.error for m in every if m.frame == k] for k in _FRAMES}
        yield Goal(
            f"{what}: {name}",
            f"{percent(within)} of {len(said)}, worst {percent(worst)}",
            "95 %, never beyond 2x",
            within >= 0.95 and worst <= 2 * BUDGET,
            (
                f"all {len(every)} frames, whatever it says: "
                f"{percent(float(np.mean([m.error <= BUDGET for m in every])))} within 2 %, "
                f"{percent(float(np.mean([m.error <= m.assured for m in every])))} within what it assured",
                "by frame, mean and worst: "
                + ", ".join(f"{k}: {percent(float(np.mean(e)))}, {percent(max(e))}" for k, e in by_frame.items()),
                "; ".join(f"{place} {percent(max(m.error for m in film))}" for place, film in films.items()),
            ),
        )
        times = np.array([m.light / m.stated for m in every])
        low, middle, high = np.percentile(times, (5, 50, 95))
        yield Goal(
            f"what captured light does to such a picture, times the stated error of the light: {name}",
            f"median {middle:.1f}, 5th to 95th percentile {low:.1f} to {high:.1f}",
            "for information",
            None,
            (f"in the median {percent(float(np.median([m.light for m in every])))} of the picture",),
        )
