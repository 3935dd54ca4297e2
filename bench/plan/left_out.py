"""What is saved by leaving passes out, and whether the picture stays the same within the bound."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import fastibl

from .. import inputs
from ..goals import Goal, percent, row
from ..measure import one_core
from . import cases, render
from .promise import QUICK

_TINY = 1e-6  # a reflectance that requires every pass but cannot be seen


def _seconds(session: fastibl.Session, change: bool, pose: fastibl.Pose, frames: int = 12) -> float:
    """Median CPU time of a frame at 640 x 480; change: whether every frame has other light."""
    lights = [fastibl.Environment(cases.environment("venice_sunset")) for _ in range(2)]
    back = np.full((480, 640, 3), 120, np.uint8)
    out = []
    for k in range(frames):
        if change:
            session.set_environment(lights[k % 2])
        begin = time.process_time()
        session.process(fastibl.Frame(0.1 * k, back=back, back_from_marker=pose, back_exposure=0.4))
        if k > 1:
            out.append(time.process_time() - begin)
    return float(np.median(out))


def spot(material: fastibl.Material) -> fastibl.Scene:
    """The mesh as it is, with its shadow."""
    scene = fastibl.Scene(inputs.scene("spot").mesh, material)
    scene.baked_shadow = cases.scene("spot").baked_shadow
    return scene


def _session(material: fastibl.Material, **options) -> fastibl.Session:
    f = cases.FOCAL * 640 / cases.WIDTH
    rig = fastibl.Rig(fastibl.Camera(640, 480, f, f, 320.0, 240.0))
    given = fastibl.Environment(cases.environment("venice_sunset"))
    return fastibl.Session(spot(material), rig, environment=given, **{"error": 0.0, **options})


def _away() -> fastibl.Pose:
    matrix = cases.pose().matrix.copy()
    matrix[:3, 3] += (5.0, 0.0, 0.0)
    return fastibl.Pose(matrix)


@row("plan", "left out")
@one_core()
def left_out() -> Iterator[Goal]:
    matte = fastibl.Material(diffuse=(0.6, 0.6, 0.6))
    matte_full = fastibl.Material(diffuse=(0.6, 0.6, 0.6), glossy=(_TINY,) * 3, exponent=64)
    mirror = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.8, 0.8), exponent=256)
    mirror_full = fastibl.Material(diffuse=(_TINY,) * 3, glossy=(0.8, 0.8, 0.8), exponent=256)
    both = fastibl.Material(diffuse=(0.4, 0.4, 0.4), glossy=(0.3, 0.3, 0.3), exponent=64)
    named = {"glossy": "centroid", "diffuse": "irradiance-cube"}
    pose = cases.pose()
    rows = (
        ("matte: no glossy chain", _session(matte, methods=named), _session(matte_full, methods=named), pose, True),
        ("mirror: no diffuse light", _session(mirror, methods=named), _session(mirror_full, methods=named), pose, True),
        ("no shadow asked for", _session(both, cast_shadow=False), _session(both), pose, True),
        ("light that stays", _session(both), None, pose, False),
        ("object out of view", _session(both), None, _away(), False),
    )  # fmt: skip
    for what, without, whole, at, change in rows:
        with_all = whole or _session(both)
        a = _seconds(without, change, at)
        b = _seconds(with_all, True, pose)
        plan = without.plan
        out = [p.name for p in plan.passes if not p.included]
        same = ""
        passed = a < b
        if whole is not None and "shadow" not in what:
            images = [
                s.process(fastibl.Frame(9.0, back_from_marker=at, back_exposure=0.4)).image for s in (without, whole)
            ]
            x, y = (i[..., :3].astype(float) for i in images)
            off = float(np.sqrt(((x - y) ** 2).mean()) / max(y.mean(), 1e-9))
            bound = (np.nan if plan.omission_bound is None else plan.omission_bound) + 1 / 255
            same, passed = f", picture differs by {percent(off)}, bound {percent(bound)}", passed and off <= bound
        yield Goal(
            f"{what}: time without and with",
            f"{1e3 * a:.2f}, {1e3 * b:.2f} ms{same}",
            "less, the picture equal within the bound",
            passed,
            (f"left out: {', '.join(out)}",),
        )


# Around the object, at two heights.
_EYES = tuple(
    (0.62 * float(np.cos(turn) * np.cos(height)), 0.62 * float(np.sin(turn) * np.cos(height)),
     0.62 * float(np.sin(height)) + 0.03)
    for turn in np.arange(8) * np.pi / 4
    for height in (0.35, 0.8)
)  # fmt: skip


def _steps_left_out(case: cases.Case) -> Iterator[tuple[str, float, float]]:
    """For steps that budgets leave out: the name, the stated bound, and the largest difference that the step makes in a
    view."""
    plan = fastibl.make_plan(render.scene(case), cases.environment(case.map), error=0.3, milliseconds=2.0)
    full = {"bounce": "one-bounce", "self_shadow": "transfer"}
    for line in plan.passes:
        if line.included or line.name not in full or not line.bound:
            continue
        without = {**full, line.name: getattr(plan.methods, line.name)}
        off = [
            cases.errors(render.render(case, without, eye), render.render(case, full, eye), case.map).whole
            for eye in _EYES
        ]
        yield line.name, line.bound, max(off)


@row("plan", "stated bounds")
def stated_bounds() -> Iterator[Goal]:
    lines = []
    for case in cases.cases(QUICK):
        if case.material in ("white", "satin", "metal"):
            lines += [(case, *line) for line in _steps_left_out(case)]
    shares = np.array([off / bound for _, _, bound, off in lines])
    worst = np.argsort(shares)[::-1][:5]
    yield Goal(
        f"self-shadow and bounce that budgets leave out: what it does in the worst of {len(_EYES)} views, by the bound",
        f"within in {percent(float((shares <= 1).mean()))} of {len(shares)}, median {np.median(shares):.2f}, "
        f"worst {shares.max():.2f}",
        "within in 95 %, never beyond 1.5",
        bool((shares <= 1).mean() >= 0.95 and shares.max() <= 1.5),
        tuple(
            f"{', '.join(lines[k][0])}, {lines[k][1]}: {percent(lines[k][3])} of {percent(lines[k][2])}" for k in worst
        ),
    )
