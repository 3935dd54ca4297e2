"""Whole frames: the picture compared with that of a perfect system, and the time of every pass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import CubeMap, Frame, Pose, Response, Session, Tracker
from ..camera_files import as_bytes
from ..comparison import level_at_most
from ..expected import present
from ..gl_device import gl_device
from ..lighting import PAPER
from ..measuring import Row, Timing, all_cores, one_core, row, seconds_text, side_by_side
from ..measuring import measure as measure_calls
from ..measuring.frames import steady
from ..recording import Recording, truth_of
from ..session import Methods
from ..truth import TruePicture, TrueRenderer, picture_error
from .inputs import STREAM, Inputs
from .section import Section, Strip, Table
from .steps import CHOSEN, Result, step_section
from .steps import PAPER as BY_PAPER

_STEPS = ("diffuse", "glossy", "shadow", "self_shadow", "bounce")
_WHAT = """The finished picture: {name}, {height:.0f} cm high, laid over a camera picture of {width} × {picture_height}
pixels. Truth: 6144 directions of the true map with visibility by rays from what each pixel shows, 16 rays a pixel for
coverage, one bounce between object and table included; it is itself 0.2 % off, and 2 % where the sun's shadow is sharp.
The error is the root mean square over red, green and blue, in linear light, over the pixels that the object covers or
its shadow changes, by the truth's mean there. Here light and pose are given, so the picture is judged alone; “auto but …”
replaces one step by the paper's and shows what that step is worth. How pixels are sampled, at edges above all, counts
here, and not in what a plan says. Time: everything that runs when the light changed a little in this frame, as captured
light does (lighting, shadow, shading, compositing), on one core."""


def variants() -> dict[str, Methods]:
    """Choices of methods: the default, the paper's, and the default with one step as in the paper."""
    each: dict[str, Methods] = {
        f"auto but {step}={getattr(PAPER, step)}": {step: getattr(PAPER, step)} for step in _STEPS
    }
    return {"auto": "auto", **each, "paper": "paper"}


@dataclass
class _View:
    """A back picture, where it was taken, and the true picture for each place."""

    frame: Frame
    back: NDArray
    truths: Mapping[str, TruePicture]
    renderer: TrueRenderer


def _posed(recording: Recording) -> tuple[Frame, Pose] | None:
    """The last frame with a back picture and a pose. The pose is true, given or tracked: any of them serves the
    comparison."""
    for frame in reversed([f for f in recording if f.back is not None]):
        if truth_of(recording).poses:
            return frame, truth_of(recording).pose(frame.time)
        if frame.back_from_marker is not None:
            return frame, frame.back_from_marker
        if recording.board is not None:
            tracked = Tracker(recording.board, recording.rig.back).track(present(frame.back))
            if tracked is not None:
                return frame, tracked.camera_from_marker
    return None


def _view(inputs: Inputs, places: Mapping[str, CubeMap]) -> _View:
    recording, effort = inputs.follow, inputs.effort
    with all_cores():
        renderer = TrueRenderer(inputs.scene, extent=0.25, grid=96 if effort.name != "full" else 128)
        frame, pose = present(_posed(recording))
        back = as_bytes(present(frame.back))
        exposure = 1.0 if frame.back_exposure is None else frame.back_exposure
        given = Frame(frame.time, back, back_exposure=exposure, back_from_marker=pose)
        truths = {
            name: renderer.render(back, exposure, recording.rig.back, pose, cube) for name, cube in places.items()
        }
    return _View(given, back, truths, renderer)


def _alone(inputs: Inputs, view: _View, methods: Methods, places: Mapping[str, CubeMap]):
    """Pictures by place, with their errors and biases."""
    recording = inputs.follow
    response = recording.rig.back.response
    session = Session(inputs.scene, recording.rig, None, next(iter(places.values())), methods=methods)
    pictures, errors, biases = {}, {}, {}
    for k, (name, true) in enumerate(view.truths.items()):
        session.set_environment(places[name])
        image = pictures[name] = session.process(replace(view.frame, time=0.1 * k)).image
        errors[name] = picture_error(image, true, view.back, response)
        biases[name] = _bias(image, true, view.back, response)
    return pictures, errors, biases


def _times(inputs: Inputs, view: _View) -> tuple[dict[str, Timing], float, float]:
    """The time of a frame in which the light changed a little, for each variant, side by side; the yardstick; and the
    CPU seconds of the default's first frame in wholly different light, for which methods are chosen anew."""
    sessions = {
        name: Session(inputs.scene, inputs.follow.rig, None, inputs.stream(0), methods=methods)
        for name, methods in variants().items()
    }
    clock = {name: 0.0 for name in sessions}

    def one(name: str, cube: CubeMap) -> None:
        sessions[name].set_environment(cube)
        clock[name] += 0.1
        sessions[name].process(replace(view.frame, time=clock[name])).image  # noqa: B018 - the picture has to arrive

    calls = {name: lambda k, name=name: one(name, inputs.stream(k)) for name in sessions}
    timings, yard = side_by_side(calls, inputs.effort.rounds, warm=STREAM)
    here = inputs.stream(0)
    others = [CubeMap(4 * here.faces), here]  # in turn: as different as another place, even with one place alone
    return timings, yard, measure_calls(lambda cube: one("auto", cube), others, 3, warm=0).cpu


def _bias(image: NDArray, true: TruePicture, back: NDArray, response: Response) -> float:
    """The mean of the picture divided by that of the truth, less 1, where the object or its shadow is, in linear
    light."""
    where = (true.coverage > 0) | (np.abs(true.image.astype(int) - back).max(axis=-1) > 1)
    truth = np.clip(true.linear[where], 0, 1)
    return float(response.decode(image / 255.0)[where].mean(dtype=np.float64) / truth.mean() - 1)


def _of_truth(cube: CubeMap) -> CubeMap:
    """A map in the resolution over which the truth sums."""
    faces = level_at_most(cube, 32).astype(np.float32)
    times = max(1, 32 // faces.shape[1])
    return CubeMap(np.repeat(np.repeat(faces, times, axis=1), times, axis=2))


@one_core()
def measure(inputs: Inputs) -> Section:
    recording = inputs.follow
    camera = recording.rig.back
    height = 100 * float(np.ptp(inputs.mesh.vertices[:, 2]))
    what = _WHAT.format(name=inputs.mesh_name, height=height, width=camera.width, picture_height=camera.height)
    section = Section("frame", "The whole frame", what)
    if _posed(recording) is None:
        section.missing = "The recording holds no back picture whose pose is known or can be tracked."
        return section
    # The truth sums over 32 squared texels a face. The methods get the map in that resolution, so that the errors are
    # theirs.
    chosen = list(inputs.places.items())[: inputs.effort.frame_maps]
    places = {name: _of_truth(cube) for name, cube in chosen}
    view = _view(inputs, places)
    timings, yard, anew = _times(inputs, view)
    results, pictures = [], {}
    for name, methods in variants().items():
        method, _, setting = name.partition(" ")
        shown, errors, biases = _alone(inputs, view, methods, places)
        pictures[name] = shown
        mark = CHOSEN if name == "auto" else BY_PAPER if name == "paper" else ""
        results.append(Result(method, setting, errors, biases, timings[name].of_cpu, mark))
    step_section(section, "frame", "error of the picture", "time of a frame", results, yard)
    section.seen.append(
        f"Under wholly other light methods are judged and chosen anew: that frame takes {seconds_text(anew)}."
    )
    auto = results[0]
    place = max(auto.errors, key=lambda p: auto.errors[p])
    section.strips.append(_strip(view, place, {"default": pictures["auto"][place], "paper": pictures["paper"][place]}))
    _everything(section, inputs)
    return section


def _strip(view: _View, place: str, pictures: Mapping[str, NDArray]) -> Strip:
    """Truth, both choices and their differences, cut to the part of the picture where they show something."""
    true, back = view.truths[place], view.back
    changed = np.argwhere((true.coverage > 0) | (np.abs(true.image.astype(int) - back).max(axis=-1) > 8))
    (top, left), (bottom, right) = changed.min(axis=0), changed.max(axis=0) + 1
    cut = slice(max(0, top - 12), bottom + 12), slice(max(0, left - 12), right + 12)

    def large(picture: NDArray) -> NDArray:
        return cv2.resize(picture[cut], None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)

    def difference(picture: NDArray) -> NDArray[np.uint8]:
        apart = picture.astype(np.float64) - true.image
        return np.clip(127.5 + 10 * apart / 2, 0, 255).astype(np.uint8)

    shown = [("truth, by brute force", large(true.image))]
    for name, picture in pictures.items():
        title = "the paper's" if name == "paper" else name
        shown.append((f"{title} methods" if name != "paper" else "the paper's methods", large(picture)))
        shown.append((f"{title}: difference × 10", large(difference(picture))))
    return Strip(
        f"The object lit by “{place}”, where the default errs most", shown,
        "The object is lit by the place's map as it is, so it need not match the picture behind it. "
        "Differences: grey is none, brighter is too bright.",
    )  # fmt: skip


def _everything(section: Section, inputs: Inputs) -> None:
    """Adds the time of frames with everything running, and of each pass."""
    recording = inputs.follow
    if recording.board is None:
        return
    rows: list[Row] = []
    whole: dict[tuple[str, str, int], Timing] = {}
    parts: dict[str, dict[str, float]] = {}
    rounds = 3 if inputs.effort.name == "full" else 1
    settings = [("auto", "cpu", 1), ("paper", "cpu", 1), ("auto", "cpu", 2)]
    if inputs.effort.name == "full" and not gl_device()[1]:
        settings.append(("auto", "gl", 2))
    for methods, backend, threads in settings:
        session = Session(inputs.scene, recording.rig, recording.board, methods=methods, backend=backend)
        spent, passes, _ = steady(session, recording, threads, rounds)
        whole[methods, backend, threads] = spent
        case = f"{recording.rig.back.width}x{recording.rig.back.height}, everything running"
        time_ = spent.of_cpu if threads == 1 else spent
        rows.append(row(methods, case, time=time_, step="frame", backend=backend, threads=threads))
        if (backend, threads) == ("cpu", 1):
            names = {name for p in passes for name in p} - {"total"}
            slowed = spent.cpu / max(spent.median, 1e-9)  # by other programs on this machine
            parts[methods] = {n: slowed * float(np.mean([p.get(n, 0.0) for p in passes])) for n in names}
    section.rows += rows
    section.tables.append(
        Table(
            ["methods", "back end", "threads", "time of a frame", "frames a second"],
            [
                [
                    m,
                    b,
                    str(t),
                    seconds_text(s.cpu if t == 1 else s.median),
                    f"{1 / (s.cpu if t == 1 else s.median):.0f}",
                ]
                for (m, b, t), s in whole.items()
            ],
            {k: CHOSEN if m == "auto" else BY_PAPER for k, (m, _, _) in enumerate(whole)},
            "Tracking and capture included, in steady state; one thread: CPU time, more: time that passes.",
            "With everything running",
        )
    )
    order = sorted(set().union(*parts.values()), key=lambda n: -parts.get("auto", {}).get(n, 0))
    section.tables.append(
        Table(
            ["pass", "default", "the paper's"],
            [[n, *(_milliseconds(parts.get(m, {}).get(n, 0.0)) for m in ("auto", "paper"))] for n in order],
            title="What each pass takes of it",
            note="Mean over frames, one core.",
        )
    )
    if ("auto", "cpu", 1) in whole:
        auto = whole["auto", "cpu", 1]
        section.seen.append(
            f"With tracking and capture, a frame takes {seconds_text(auto.cpu)} on one core: "
            f"{1 / auto.cpu:.0f} frames a second."
        )


def _milliseconds(seconds: float) -> str:
    return "–" if seconds == 0 else seconds_text(seconds)
