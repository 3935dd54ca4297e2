"""Whether the plan keeps its promise: its choice is rendered and compared with rays; and whether a cheaper choice would
have been enough.

FASTIBL_QUICK=1 looks at every eleventh case. Pictures are 160 x 120, and compared before they are rounded to bytes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import fastibl

from .. import inputs
from ..goals import Goal, largest, percent, row, skipped
from . import cases, render, truth
from .cases import Case, Errors

QUICK = bool(os.environ.get("FASTIBL_QUICK"))
WITHIN, SAID = 0.98, 0.95


class Kind(NamedTuple):
    """What a plan is asked to do."""

    name: str
    moving: bool  # light that changes in every frame, which other methods suit
    known: bool  # the camera and its pose; if not, the promise is for views all round


# A plan takes captured light for moving light, as in a live view. Pictures in constant light have time.
PICTURE, FRAME, LIVE = KINDS = (
    Kind("a picture, light stays", moving=False, known=True),
    Kind("a frame of a live view, light moves", moving=True, known=True),
    Kind("a live view from anywhere, light moves", moving=True, known=False),
)


class Kept(NamedTuple):
    """One case with one budget: what the plan said, and what came out."""

    case: Case
    kind: Kind
    budget: float
    said: bool
    expected: float
    assured: float
    errors: Errors
    flip: tuple[float, float] | None  # mean, 99th percentile


def method(text: str) -> fastibl.Method:
    """The method of a name with settings, as a plan prints it."""
    name, _, rest = text.partition(" [")
    pairs = (pair.split("=") for pair in rest.rstrip("]").split(", ") if pair)
    return fastibl.Method(name, **{key: int(value) for key, value in pairs if int(value) >= 0})


def chosen(plan: fastibl.Plan) -> dict[str, fastibl.Method]:
    """A plan's methods by step, in a form in which they can be asked for."""
    m = plan.methods
    steps = {step: getattr(m, step) for step in ("diffuse", "glossy", "shadow", "self_shadow", "bounce")}
    settings = {step: getattr(m, f"{step}_settings", {}) for step in steps}
    return {s: fastibl.Method(n, **{k: v for k, v in settings[s].items() if v >= 0}) for s, n in steps.items()}


def flip(estimate: NDArray, true: NDArray) -> tuple[float, float] | None:
    """Mean and 99th percentile of FLIP between displayed pictures; None without flip-evaluator."""
    try:
        import flip_evaluator
    except ImportError:
        return None
    encode = cases.camera().response.encode
    pair = [encode(x.astype(np.float32)).astype(np.float32) for x in (true, estimate)]
    error, mean, _ = flip_evaluator.evaluate(*pair, "LDR", inputsRGB=True, applyMagma=False)
    return float(mean), float(np.percentile(error, 99))


def kept(case: Case, kind: Kind, budget: float, rendered: dict[str, tuple[Errors, tuple | None]]) -> Kept:
    plan = fastibl.make_plan(
        render.scene(case),
        cases.environment(case.map),
        error=budget,
        track=False,
        capture=kind.moving,
        offline=not kind.moving,
        camera=cases.camera() if kind.known else None,
        camera_from_marker=cases.pose() if kind.known else None,
    )
    methods = chosen(plan)
    key = repr(methods)
    if key not in rendered:
        estimate, true = render.render(case, methods), truth.truth(case.map, case.mesh, case.material)
        shown = flip(cases.composite(estimate, case.map), cases.composite(true, case.map))
        rendered[key] = (cases.errors(estimate, true, case.map), shown)
    errors, shown = rendered[key]
    return Kept(case, kind, budget, plan.meets_error, plan.expected_error, plan.assured_error, errors, shown)


@cache
def results(quick: bool = QUICK) -> list[Kept]:
    out = []
    for case in cases.cases(quick):
        rendered: dict = {}
        out += [kept(case, kind, budget, rendered) for kind in KINDS for budget in cases.BUDGETS]
    return out


def _share(values: Sequence[bool] | NDArray) -> float:
    """Of none, none: a promise that is never made is not kept."""
    return float(np.mean(values)) if len(values) else 0.0


def _held(found: Sequence[Kept]) -> str:
    if not found:
        return "none"
    return (
        f"{percent(_share([k.errors.whole <= k.budget for k in found]))} of {len(found)} within, "
        f"worst {largest(k.errors.whole / k.budget for k in found):.2f} of the budget"
    )


def _promise(what: str, every: Sequence[Kept]) -> Goal:
    said = [k for k in every if k.said]
    worst = largest(k.errors.whole / k.budget for k in said) if said else 0.0
    within = _share([k.errors.whole <= k.budget for k in said])
    unseen = [k for k in said if not k.case.tuned]
    notes = [
        *(f"budget {percent(b)}: {_held([k for k in said if k.budget == b])}" for b in cases.BUDGETS),
        *(f"{m}: {_held([k for k in said if k.case.map == m])}" for m in dict.fromkeys(k.case.map for k in every)),
        *(f"{m}: {_held([k for k in said if k.case.mesh == m])}" for m in dict.fromkeys(k.case.mesh for k in every)),
        f"without studio: {_held([k for k in said if 'studio' not in k.case.map])}",
        f"meshes that nothing was tuned on: {_held(unseen)}",
    ]
    return Goal(
        f"plan keeps its promise where it says it can: {what}",
        _held(said),
        f"within in {percent(WITHIN)}, never beyond 2x",
        bool(said) and within >= WITHIN and worst <= 2,
        tuple(notes),
    )


def _said(what: str, every: Sequence[Kept], judged: bool) -> Goal:
    by_material = {m: [k.said for k in every if k.case.material == m] for m in cases.MATERIALS}
    by_mesh = {m: [k.said for k in every if k.case.mesh == m] for m in cases.MESHES}
    said, could = _share([k.said for k in every]), _share([k.errors.whole <= k.budget for k in every])
    return Goal(
        f"it says that it can, 2 % and more: {what}",
        percent(said),
        f">= {percent(SAID)}" if judged else f"(>= {percent(SAID)} of known poses)",
        said >= SAID if judged else None,
        (
            "by material: " + ", ".join(f"{m} {percent(_share(v))}" for m, v in by_material.items() if v),
            "by mesh: " + ", ".join(f"{m} {percent(_share(v))}" for m, v in by_mesh.items() if v),
            f"what it chose was within the budget in {percent(could)} of them",
        ),
    )


@row("plan", "promise")
def promise() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("plan keeps its promise", inputs.NO_MAPS)
        return
    every = results()
    for kind in KINDS:
        yield _promise(kind.name, [k for k in every if k.kind == kind])
    for kind in KINDS:
        yield _said(kind.name, [k for k in every if k.budget >= 0.02 and k.kind == kind], judged=kind.known)
    two = [k for k in every if k.budget == 0.02]
    yield Goal(
        "error at 2 %: picture, object, shadow (median)",
        ", ".join(percent(float(np.median([getattr(k.errors, part) for k in two]))) for part in Errors._fields),
        "for information",
        None,
        tuple(
            f"{part}: 95th percentile {percent(float(np.percentile([getattr(k.errors, part) for k in two], 95)))}"
            for part in Errors._fields
        ),
    )
    shown = [k.flip for k in two if k.flip]
    if shown:
        yield Goal(
            "FLIP at 2 %: mean, 99th percentile (median of cases)",
            f"{np.median([s[0] for s in shown]):.4f}, {np.median([s[1] for s in shown]):.4f}",
            "for information",
            None,
            (f"worst case: {max(s[0] for s in shown):.4f}, {max(s[1] for s in shown):.4f}",),
        )
    else:
        yield Goal("FLIP at 2 %", "skipped", "pip install flip-evaluator", None)


@row("plan", "predicted error")
def predicted() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("expected error against measured", inputs.NO_MAPS)
        return
    every = {(k.case, k.expected, k.errors.whole): k for k in results()}.values()
    ratio = np.array([k.errors.whole / max(k.expected, 1e-9) for k in every])
    unseen = np.array([not k.case.tuned for k in every])
    near = (ratio > 0.5) & (ratio < 2)
    quantiles = np.percentile(ratio, (1, 5, 50, 95, 99))
    yield Goal(
        "expected error against measured, within a factor 2",
        percent(_share(near)),
        ">= 90 %",
        _share(near) >= 0.9,
        (
            "measured by expected, 1st, 5th, 50th, 95th, 99th percentile: " + ", ".join(f"{q:.2f}" for q in quantiles),
            f"on meshes that nothing was tuned on: {percent(_share(near[unseen]))}",
        ),
    )
