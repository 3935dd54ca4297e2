"""Capture: how far the light that two cameras saw is from the true light."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import process_time

import numpy as np
from numpy.typing import NDArray

from .. import Frame, Scene, Session
from .._fastibl import CubeMap, Environment
from ..comparison import irradiance_over_sphere, relative_errors
from ..demo import picture_of_map
from ..expected import present
from ..lighting import PAPER
from ..measuring import Timing, one_core, timing
from ..measuring.timing import yardstick_seconds
from ..recording import Recording, truth_of
from .inputs import Inputs
from .plots import COLOURS, Lines
from .section import Section, Strip, percent
from .spheres import tenfold
from .steps import CHOSEN, Result, cpu_of, step_section
from .steps import PAPER as BY_PAPER

_SIZES = (32, 128)
_WHAT = """Both cameras see parts of the room; every picture paints the directions that it sees into a map of all light.
The front camera changes its exposure, so that lamps and windows keep their true brightness. {count} pictures of
each camera over {seconds:.0f} s of {name}; the poses are given, so that capture is judged alone. The error is that of
the irradiance of a surface, mean over directions, by the place's mean, at the end. “single” is the paper's: one picture
of one exposure every five seconds. Time is that of a frame's pictures, mean over all
frames, on one core."""


@dataclass
class _Captured:
    environment: Environment
    time: Timing
    times: list[float]
    true: list[float]
    predicted: list[float]


def _capture(recording: Recording, scene: Scene, method: str, size: int, distance: float | None) -> _Captured:
    session = Session(
        scene, recording.rig, recording.board, methods={"capture": method}, size=size, cast_shadow=False, distance=distance,
        follow_surroundings=False,
    )  # fmt: skip
    truth, environment = truth_of(recording), None
    spent, times, found, predicted = [], [], [], []
    truths: dict[int, NDArray] = {}
    for frame in recording:
        pose = truth.pose(frame.time)
        given = Frame(
            frame.time, frame.back, frame.front, frame.back_exposure, frame.front_exposure, back_from_marker=pose
        )
        begin = process_time()
        result = session.process(given)
        spent.append(cpu_of("capture", result.timings, process_time() - begin))
        true_map = truth.environment(frame.time)
        true = truths.setdefault(id(true_map), irradiance_over_sphere(true_map))
        errors = relative_errors(irradiance_over_sphere(result.environment), true)
        times.append(frame.time)
        found.append(float(np.median(errors)))
        predicted.append(result.predicted_error)
        environment = result.environment
    # The mean, because the paper's method does nothing in most frames.
    time = replace(timing(spent, spent), median=float(np.mean(spent)))
    return _Captured(present(environment), time, times, found, predicted)


@one_core()
def measure(inputs: Inputs) -> Section:
    recording = inputs.sweep
    what = _WHAT.format(count=len(recording), seconds=recording.duration, name=inputs.recording_name)
    section = Section("capture", "Capturing the light", what)
    truth = truth_of(recording)
    if not truth.maps or not truth.poses:
        section.missing = "The recording holds no true light or poses to compare with."
        return section
    true_map = truth.environment(recording.times[-1])
    true = irradiance_over_sphere(true_map)
    infinite = float("inf")
    candidates: list[tuple[str, int, float | None]] = [("continuous", n, None) for n in _SIZES]
    candidates += [("continuous", _SIZES[-1], infinite), (PAPER.capture, _SIZES[-1], None)]
    results, place = [], inputs.recording_name
    kept: dict[tuple[str, int], _Captured] = {}
    for method, size, distance in candidates:
        found = _capture(recording, inputs.scene, method, size, distance)
        kept.setdefault((method, size), found)
        given = irradiance_over_sphere(found.environment)
        walls = "" if distance is None else " walls=far"
        mark = BY_PAPER if method == PAPER.capture else CHOSEN if size == 128 and not walls else ""
        extra = {
            "sphere seen": percent(found.environment.coverage),
            "predicted": percent(found.environment.predicted_error),
        }
        error = float(np.mean(np.sqrt(((given - true) ** 2).mean(axis=-1))) / true.mean())
        bias = float(given.mean() / true.mean() - 1)
        results.append(Result(method, f"size={size}{walls}", {place: error}, {place: bias}, found.time, mark, extra))
    note = "Predicted: what fastibl says of its own error, without knowing the truth. Size: texels along a cube face. "
    note += "Walls: how far they are is found from the pictures, except where all light is taken to come from far away."
    step_section(
        section,
        "capture",
        "mean error of the irradiance",
        "time of a frame's pictures",
        results,
        yardstick_seconds(),
        note,
    )
    ours, theirs = kept["continuous", 128], kept[PAPER.capture, 128]
    lines = {
        "default": (ours.times, ours.true),
        "default, predicted": (ours.times, ours.predicted),
        "the paper's": (theirs.times, theirs.true),
    }
    colours = {"default": COLOURS[0], "default, predicted": COLOURS[5], "the paper's": COLOURS[1]}
    section.charts.append(
        Lines(
            "capture-over-time", "Median error of the irradiance while the cameras look around", "time, s", "", lines,
            log_x=False, dashed=("default, predicted",), colours=colours,
        )
    )  # fmt: skip
    section.strips.append(_maps(ours.environment, theirs.environment, true_map))
    return section


def _maps(ours: Environment, theirs: Environment, true: CubeMap) -> Strip:
    scale = 0.28 / float(np.mean(true.mean()))
    pictures = [
        ("true light, all directions, up at the top", picture_of_map(true, scale, 160)),
        ("as captured (unseen parts dimmed)", picture_of_map(ours, scale, 160)),
        ("as captured: difference × 2", _difference(ours, true, scale)),
        ("as captured by the paper's method", picture_of_map(theirs, scale, 160)),
    ]
    return Strip("All light of the place", pictures, "Differences: grey is none, brighter is too bright.")


def _difference(environment: Environment, true: CubeMap, scale: float, height: int = 160) -> NDArray[np.uint8]:
    from .._fastibl import equirect_from_cubemap

    ours = equirect_from_cubemap(environment.radiance, height).astype(np.float64)
    return tenfold(ours - equirect_from_cubemap(true, height), scale, 2.0)
