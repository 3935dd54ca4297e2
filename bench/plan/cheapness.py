"""The cost of the plan: its choice compared with the cheapest one there is, and the time of planning itself."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

import fastibl
from fastibl._fastibl import _due_seconds, _measured_errors, _plan_seconds
from fastibl.lighting import AUTO

from ..goals import Goal, percent, row, skipped
from ..measure import one_core
from . import cases, render, truth
from .cases import Case
from .promise import chosen, method

STEPS = ("diffuse", "glossy", "self_shadow", "shadow", "bounce")
RATIO = 1.25
MOVING = 4  # frames in a row with new light until a session takes it for moving light
REPETITIONS = 5
# Each map is among them, two meshes and five materials; glossy ones have few candidates each.
CASES = (
    Case("potsdamer_platz", "spot", "white"),
    Case("kiara_1_dawn", "teapot", "clay"),
    Case("dikhololo_night", "spot", "satin"),
    Case("venice_sunset", "teapot", "plastic"),
    Case("adams_place_bridge", "spot", "pbr"),
    Case("studio_small_03", "spot", "clay"),
    Case("empty_warehouse_01", "teapot", "white"),
)


class Drawn(NamedTuple):
    """What methods make of a case: the picture's error, and the CPU seconds of a frame, the least of a few."""

    error: float
    moving: float  # with new light in every frame
    staying: float  # with constant light and a moving pose


def draw(case: Case, methods: dict) -> Drawn:
    session = render.session(case)
    session.set_methods(methods)
    lights = [fastibl.Environment(cases.environment(case.map)) for _ in range(2)]
    pose = cases.pose()

    def seconds(pose: fastibl.Pose) -> float:
        frame = fastibl.Frame(0.0, back_from_marker=pose, back_exposure=cases.exposure(case.map))
        begin = time.process_time()
        session.process(frame)
        return time.process_time() - begin

    moving, staying = [], []
    for k in range(MOVING + REPETITIONS):
        session.set_environment(lights[k % 2])
        moving.append(seconds(pose))
    for _ in range(REPETITIONS):
        staying += [seconds(cases.beside(pose)), seconds(pose)]
    true = truth.truth(case.map, case.mesh, case.material)
    return Drawn(cases.errors(render.picture(session), true, case.map).whole, min(moving[MOVING:]), min(staying))


@cache
def every(case: Case) -> list[Drawn]:
    """All combinations of candidates."""
    found = _measured_errors(render.scene(case), fastibl.Environment(cases.environment(case.map)), AUTO)
    names = [found[step][0] for step in STEPS]
    if case.material in ("white", "clay"):
        names[1] = names[1][:1]
    return [
        draw(case, {step: method(text) for step, text in zip(STEPS, combination, strict=True)})
        for combination in product(*names)
    ]


def ratio(case: Case, budget: float, which: str) -> float | None:
    """Time of the plan's choice divided by that of the cheapest choice within the budget; None where either has none.

    Infinite where the choice itself exceeds the budget: then it is no merit to be quick.
    """
    # A plan takes captured light for moving light.
    plan = fastibl.make_plan(
        render.scene(case),
        cases.environment(case.map),
        error=budget,
        track=False,
        capture=which == "moving",
        camera=cases.camera(),
        camera_from_marker=cases.pose(),
    )
    good = [getattr(drawn, which) for drawn in every(case) if drawn.error <= budget]
    if not plan.meets_error or not good:
        return None
    choice = draw(case, chosen(plan))
    return getattr(choice, which) / min(good) if choice.error <= budget else np.inf


def _cheapness(cases_: tuple[Case, ...], what: str) -> Iterator[Goal]:
    for which in ("staying", "moving"):
        found = {(c, b): r for c in cases_ for b in cases.BUDGETS if (r := ratio(c, b, which)) is not None}
        ratios = np.array(list(found.values()))
        yield Goal(
            f"{what}: time of a frame under {which} light by the cheapest found by exhaustive search",
            f"{np.mean(ratios <= RATIO):.0%} of {len(ratios)} within, median {np.median(ratios):.2f}, worst "
            f"{ratios.max():.2f}",
            f"<= {RATIO}",
            bool((ratios <= RATIO).all()),
            tuple(f"{c.map}, {c.mesh}, {c.material}, {percent(b)}: {r:.2f}" for (c, b), r in found.items()),
        )


@row("plan", "cheapness")
@one_core()
def cheapness() -> Iterator[Goal]:
    matte = tuple(case for case in CASES if case.material in ("white", "clay"))
    yield from _cheapness(matte, "matte")
    glossy = tuple(case for case in CASES if case not in matte)
    if os.environ.get("FASTIBL_EXHAUSTIVE"):
        yield from _cheapness(glossy, "glossy")
    else:
        yield skipped(
            "glossy: time of a frame by the cheapest found by exhaustive search",
            "1152 to 1728 combinations a case, some 10 minutes each: FASTIBL_EXHAUSTIVE=1",
        )


@row("plan", "planning")
@one_core()
def planning() -> Iterator[Goal]:
    case = Case("adams_place_bridge", "spot", "plastic")
    scene, environment = render.scene(case), fastibl.Environment(cases.environment(case.map))
    plan = fastibl.make_plan(scene, environment, error=0.02)
    due = _due_seconds(plan, 100000)
    yield Goal("due_passes", f"{1e6 * due:.2f} us", "<= 1 us", due <= 1e-6)
    making, measuring = _plan_seconds(scene, environment, 20)
    yield Goal("make_plan, errors measured", f"{1e3 * making:.2f} ms", "<= 1 ms", making <= 1e-3)
    called = []
    for _ in range(5):
        begin = time.process_time()
        fastibl.make_plan(scene, environment, error=0.02)
        called.append(time.process_time() - begin)
    called_again = min(called[1:])
    yield Goal(
        "fastibl.make_plan of a scene and light that it has judged before, as a program calls it",
        f"{1e3 * called_again:.2f} ms",
        "<= 1 ms",
        called_again <= 1e-3,
    )
    yield Goal("measuring them, once a light", f"{1e3 * measuring:.0f} ms", "for information", None)
