"""What the plan takes: its choice against the cheapest that there is, and the time of planning itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from itertools import product

import numpy as np

import fastibl
from fastibl._fastibl import _due_seconds, _measured_errors, _plan_seconds
from fastibl.lighting import AUTO

from ..goals import Goal, percent, row
from ..measure import one_core
from . import cases, render, truth
from .cases import Case
from .promise import chosen, method

STEPS = ("diffuse", "glossy", "self_shadow", "shadow", "bounce")
RATIO = 1.25
# Each map, mesh and material is among them; glossy ones of a few candidates each.
CASES = (
    Case("potsdamer_platz", "spot", "white"),
    Case("kiara_1_dawn", "teapot", "clay"),
    Case("dikhololo_night", "spot", "satin"),
    Case("venice_sunset", "teapot", "plastic"),
    Case("adams_place_bridge", "spot", "pbr"),
    Case("studio_small_03", "spot", "clay"),
    Case("empty_warehouse_01", "teapot", "white"),
)


def frame_seconds(case: Case, methods: dict, repetitions: int = 3) -> float:
    """CPU seconds of a frame under light that changes every frame, the least of a few."""
    session = render.session(case)
    session.set_methods(methods)
    lights = [fastibl.Environment(cases.environment(case.map)) for _ in range(2)]
    least = np.inf
    for k in range(repetitions + 1):
        session.set_environment(lights[k % 2])
        frame = fastibl.Frame(0.0, back_from_marker=cases.pose(), back_exposure=cases.exposure(case.map))
        begin = time.process_time()
        session.process(frame)
        if k:
            least = min(least, time.process_time() - begin)
    return least


@cache
def every(case: Case) -> list[tuple[dict, float, float]]:
    """All combinations of candidates: methods, error, seconds."""
    found = _measured_errors(render.scene(case), fastibl.Environment(cases.environment(case.map)), AUTO)
    names = [found[step][0] for step in STEPS]
    matte = case.material in ("white", "clay")
    if matte:
        names[1] = names[1][:1]
    true, out = truth.truth(case.map, case.mesh, case.material), []
    for combination in product(*names):
        methods = {step: method(text) for step, text in zip(STEPS, combination, strict=True)}
        seconds = frame_seconds(case, methods, 2)
        out.append((methods, cases.errors(render.picture(render.session(case)), true, case.map).whole, seconds))
    return out


@row("plan", "cheapness")
@one_core()
def cheapness() -> Iterator[Goal]:
    ratios, notes = [], []
    for case in CASES:
        if case.material not in ("white", "clay"):
            continue  # hundreds of combinations of a second each
        for budget in cases.BUDGETS:
            plan = fastibl.make_plan(render.scene(case), cases.environment(case.map), error=budget, track=False)
            if not plan.meets_error:
                continue
            good = [seconds for _, error, seconds in every(case) if error <= budget]
            if not good:
                continue
            ratio = frame_seconds(case, chosen(plan)) / min(good)
            ratios.append(ratio)
            notes.append(f"{case.map}, {case.mesh}, {case.material}, {percent(budget)}: {ratio:.2f}")
    yield Goal(
        "time of a frame by the cheapest found by exhaustive search",
        f"{np.mean(np.array(ratios) <= RATIO):.0%} of {len(ratios)} within, median {np.median(ratios):.2f}",
        f"<= {RATIO}",
        max(ratios, default=0) <= RATIO,
        tuple(notes),
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
    yield Goal("measuring them, once a light", f"{1e3 * measuring:.0f} ms", "for information", None)
