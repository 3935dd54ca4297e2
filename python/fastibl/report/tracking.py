"""Tracking: the camera's place, from one picture of the board, by every method."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from .. import Tracker, methods
from ..expected import present
from ..lighting import AUTO, PAPER
from ..measuring import Point, one_core, row, seconds_text, timing
from ..recording import Frame, Recording, truth_of
from .inputs import Inputs
from .plots import Frontier
from .section import Section, Table

_WHAT = """Where the camera stands, by the printed board in its picture: the first step of every frame. {count} pictures
of {width} × {height} pixels of {name}. {truth} Time is that of a picture, on one core; the first picture, in
which the board is searched everywhere, is not counted."""
_TRUE = "The error is the angle to the true rotation, and the distance to the true position."
_UNKNOWN = """The true poses of this recording are not known; the error shown is how far the tags' corners are from where
the pose puts them, in pixels, which says less."""


@one_core()
def measure(inputs: Inputs) -> Section:
    recording = inputs.follow
    frames = [f for f in recording if f.back is not None]
    camera = recording.rig.back
    section = Section("tracking", "Tracking the board", "")
    if recording.board is None or len(frames) < 2:
        section.missing = "The recording has no board or fewer than two pictures of the back camera."
        return section
    known = bool(truth_of(recording).poses)
    section.what = _WHAT.format(
        count=len(frames), width=camera.width, height=camera.height, name=inputs.recording_name,
        truth=_TRUE if known else _UNKNOWN,
    )  # fmt: skip
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        _compare(section, recording, frames, known, max(1, inputs.effort.rounds // 4))
    finally:
        cv2.setNumThreads(before)
    return section


def _compare(section: Section, recording: Recording, frames: list[Frame], known: bool, rounds: int) -> None:
    unit = "degrees" if known else "pixels"
    error = "median rotation error, degrees" if known else "median residual, pixels"
    metric = f"{error}; time of a picture"
    auto = "edges" if AUTO.tracking == "auto" else AUTO.tracking
    points, marked, names = [], {}, {}
    table: list[list[str]] = []
    for method in methods("tracking"):
        for refine in (True, False)[: 1 if method.name == "edges" else 2]:  # "edges" measures in its own way
            tracker = Tracker(recording.board, recording.rig.back, method=method.name, refine=refine)
            walls, cpus, errors, shifts, lost = _followed(tracker, recording, frames, known, rounds)
            time, setting = timing(walls, cpus).of_cpu, "" if refine else "unrefined"
            value = float(np.median(errors)) if errors else float("nan")
            common: dict[str, Any] = {"setting": setting, "step": "tracking"}
            case = f"{len(frames)} pictures"
            section.rows.append(row(method.name, case, metric, value if errors else None, time, **common))
            worst = max(errors, default=float("nan"))
            if errors:
                section.rows.append(row(method.name, case, f"worst {error.partition(' ')[2]}", worst, **common))
            if shifts:
                section.rows.append(row(method.name, case, "median shift, metres", float(np.median(shifts)), **common))
            section.rows.append(row(method.name, case, "share of pictures without a pose", lost, **common))
            point = Point(method.name, setting, time.median, value)
            if errors:
                points.append(point)
            mark = "chosen" if refine and method.name == auto else ""
            mark = "paper" if not refine and method.name == PAPER.tracking else mark
            if mark:
                marked[len(table)], names[mark] = mark, point
            shift = f"{1e3 * np.median(shifts):.2g} mm" if shifts else "–"
            table.append([point.label, *(f"{v:.2g}" if errors else "–" for v in (value, worst)), shift, f"{100 * lost:.0f} %",
                          seconds_text(time.median)])  # fmt: skip
    head = ["method", f"{unit}, median", f"{unit}, worst", "shift, median", "not found", "time"]
    legend = "★ chosen by default, ◇ the paper's: the four corners of one tag as the detector gives them."
    section.tables.append(Table(head, table, marked, legend, compact=True))
    if points:
        section.charts.append(
            Frontier(
                "tracking-error-against-time", section.title, "time of a picture", error, points,
                [p.label for m, p in names.items() if m == "paper"], [p.label for m, p in names.items() if m == "chosen"],
                "°" if known else " px",
            )
        )  # fmt: skip
    if not points:
        section.missing = "No method found the board in any picture of the recording."
    if points and {"chosen", "paper"} <= set(names):
        chosen, paper = names["chosen"], names["paper"]
        section.seen.append(
            f"The default ({chosen.label}) is off by {chosen.error:.2g} {unit} in {seconds_text(chosen.seconds)}; the "
            f"paper's ({paper.label}) by {paper.error:.2g} {unit} in {seconds_text(paper.seconds)}."
        )


def _followed(tracker: Tracker, recording: Recording, frames: list[Frame], known: bool, rounds: int):
    """Seconds, errors (degrees or pixels), shifts in metres, and the share of pictures without a pose, over all
    pictures."""
    import time

    walls, cpus, errors, shifts, lost = [], [], [], [], 0
    tracker.track(present(frames[0].back))
    for k in range(rounds):
        for frame in frames:
            back = present(frame.back)
            wall, cpu = time.perf_counter(), time.process_time()
            tracked = tracker.track(back)
            walls.append(time.perf_counter() - wall)
            cpus.append(time.process_time() - cpu)
            if k:
                continue
            if tracked is None:
                lost += 1
            elif known:
                true = truth_of(recording).pose(frame.time)
                errors.append(float(np.degrees(tracked.camera_from_marker.angle_to(true))))
                # The camera's place in the marker frame.
                here, there = tracked.camera_from_marker.inverse().translation, true.inverse().translation
                shifts.append(float(np.linalg.norm(here - there)))
            else:
                errors.append(tracked.residual_px)
    return walls, cpus, errors, shifts, lost / len(frames)
