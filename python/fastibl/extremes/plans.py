"""Plans: budgets that nothing can meet, scenes without anything, products in any state."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np

from .._fastibl import CubeMap, Material, Mesh, Scene, due_passes
from ..lighting import Method, resolve_methods
from ..session import make_plan
from .case import Case, Outcome, refused, result_or_refusal
from .worlds import MAPS, ball_mesh, map_named

# How each scene is made, by name. Cases name them, so that a list of cases makes none.
_MAKERS: dict[str, Callable[[Mesh], Scene]] = {
    "matte": lambda ball: Scene(ball, spheres=4, visibility_rays=0),
    "mirror": lambda ball: Scene(
        ball, Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=np.inf), spheres=4, visibility_rays=0
    ),
    "black": lambda ball: Scene(ball, Material(diffuse=(0, 0, 0)), spheres=0, visibility_rays=0),
    "glowing": lambda ball: Scene(
        ball, Material(diffuse=(0, 0, 0), emission=(1e9, 1e9, 1e9)), spheres=0, visibility_rays=0
    ),
    "all of it": lambda ball: Scene(ball, Material.pbr((1, 1, 1), 0.5, 0.5), spheres=4, visibility_rays=8),
}


@cache
def _scene(name: str) -> Scene:
    return _MAKERS[name](ball_mesh(steps=8))


def cases() -> Iterator[Case]:
    for name, budget in itertools.product(_MAKERS, (0.0, 1e-30, 1e-3, 0.5, 1.0)):
        yield Case(
            "plan",
            f"{name}, an error of {budget:g}",
            "every pass is in it, or has a reason",
            partial(_complete, name, error=budget),
        )
    for name, budget in itertools.product(("matte", "all of it"), (1e-30, 1e-3, 1e30)):
        yield Case(
            "plan",
            f"{name}, {budget:g} ms",
            "every pass is in it, or has a reason",
            partial(_complete, name, milliseconds=budget),
        )
    for name in MAPS:
        yield Case(
            "plan",
            f"{name}: errors and bounds",
            "finite, never negative",
            partial(_of_map, name),
        )
    yield Case(
        "plan",
        "errors of 0.002 to 0.5, a map and an object that hides a part of itself",
        "what is chosen keeps to them or says that it does not; the less is allowed, the nearer and the longer",
        _budgets_choose,
    )
    for name in _MAKERS:
        yield Case(
            "plan",
            f"{name}: every state of the products",
            "nothing is due twice; what is fresh is not made",
            partial(_due, name),
        )
    for name, value in (("NaN", np.nan), ("negative", -1.0), ("infinite", np.inf)):
        yield Case(
            "plan",
            f"an error that is {name}",
            "a plan, or ValueError",
            partial(result_or_refusal, partial(_complete, "matte", error=value)),
        )
    for what, call in (
        ("an unknown method", lambda: resolve_methods("magic")),
        ("an unknown step", lambda: resolve_methods({"magic": "auto"})),
        ("a method of another step", lambda: resolve_methods({"diffuse": "mip"})),
        ("an unknown setting", lambda: Method("sh9-lobes", magic=1)),
        ("a setting of 1.5", lambda: Method("sh9-lobes", lobes=1.5)),
        ("a setting of NaN", lambda: Method("sh9-lobes", lobes=np.nan)),
        ("a setting of 1e30", lambda: make_plan(_scene("matte"), methods={"diffuse": Method("sh9-lobes", lobes=1e30)})),
        ("-2 lobes", lambda: make_plan(_scene("matte"), methods={"diffuse": Method("sh9-lobes", lobes=-2)})),
    ):
        yield Case("plan", what, "an error that says what there is", partial(_refused, call))


def _refused(call: Callable[[], object]) -> Outcome:
    return refused(call, (ValueError, TypeError, OverflowError))


def _complete(scene: str, environment: CubeMap | None = None, **budget: Any) -> Outcome:
    plan = make_plan(_scene(scene), environment, **budget)
    silent = [p.name for p in plan.passes if not p.included and not p.reason]
    some = [plan.omission_bound, *(n for p in plan.passes for n in (p.bound, p.error))]
    numbers = [plan.expected_error, *(n for n in some if n is not None)]
    bad = [n for n in numbers if not (n >= 0 and np.isfinite(n))]
    included = sum(p.included for p in plan.passes)
    return Outcome(
        not silent and not bad and bool(str(plan)),
        f"{included} of {len(plan.passes)} passes"
        + (f", no reason: {silent}" if silent else "")
        + (f", numbers {bad}" if bad else ""),
    )


def _of_map(name: str) -> Outcome:
    return _complete("all of it", map_named(name), error=0.02)


def _budgets_choose() -> Outcome:
    scene, cube = Scene(ball_mesh(steps=8), spheres=4, visibility_rays=16), map_named("blue and red lamps")
    budgets = (0.002, 0.02, 0.1, 0.5)
    plans = [make_plan(scene, cube, error=budget) for budget in budgets]
    kept = all(p.meets_error == (p.assured_error <= b) for p, b in zip(plans, budgets, strict=True))
    errors, times = [p.expected_error for p in plans], [p.milliseconds for p in plans]
    ordered = errors == sorted(errors) and times == sorted(times, reverse=True)
    return Outcome(
        kept and ordered and errors[-1] > 2 * errors[0],
        ", ".join(f"{100 * e:.2g} % in {t:.2g} ms" for e, t in zip(errors, times, strict=True))
        + ("" if kept else "; says what does not hold"),
    )


def _due(scene: str) -> Outcome:
    plan = make_plan(_scene(scene))
    products = sorted({product for p in plan.passes for product in p.writes | p.reads | p.needs})
    rng = np.random.default_rng(0)
    states = [set(), set(products)] + [set(rng.choice(products, rng.integers(1, len(products)))) for _ in range(500)]
    inputs = set(products) - {product for p in plan.passes for product in p.writes}
    for stale in states:
        wanted = set(rng.choice(products, 3))
        names, left = due_passes(plan, wanted, stale)
        if not stale and names:
            return Outcome(False, f"{names} ran though nothing was stale")
        again, _ = due_passes(plan, wanted, left - inputs)
        if again:
            return Outcome(False, f"{again} are due again")
    return Outcome(True, f"{len(states)} states")
