"""What is saved by leaving passes out, and whether the picture stays the same within the bound."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import fastibl

from .. import inputs
from ..goals import Goal, largest, percent, row, skipped
from ..measure import one_core
from . import cases, render
from .promise import QUICK

_TINY = 1e-6  # a reflectance that requires every pass but cannot be seen
_LESS = 0.95  # share of the full time, at most, that counts as less


def _lights(kind: str) -> list[fastibl.Environment]:
    """Light for a session that takes them in turn: none for light that stays."""
    if kind == "stays":
        return []
    faces = cases.environment("venice_sunset").faces if kind == "changes" else np.ones((6, cases.SIZE, cases.SIZE, 3))
    scale = 1.02 if kind == "changes" else 1.01
    every, half = np.float32(scale) * faces, np.concatenate([np.float32(scale) * faces[:3], faces[3:]])
    changed = half if kind == "changes" else every
    return [fastibl.Environment(fastibl.CubeMap(np.float32(f))) for f in (faces, changed)]


class Asked(NamedTuple):
    """light: "stays", "changes" a little from frame to frame, or is "uniform" and changes. moves: whether the camera
    does."""

    session: fastibl.Session
    light: str
    pose: fastibl.Pose
    moves: bool = True


class Played(NamedTuple):
    """seconds: median CPU time of a frame. passes: those of the last frame. picture: of a last frame whose back picture
    is not seen."""

    seconds: float
    passes: list[str]
    picture: NDArray


def played(asked: Asked, frames: int = 14) -> Played:
    """Frames of 640 x 480."""
    session, light, pose, moves = asked
    lights, out = _lights(light), []
    back = np.full((480, 640, 3), 120, np.uint8)
    for k in range(frames):
        if lights:
            session.set_environment(lights[k % 2])
        begin = time.process_time()
        at = cases.beside(pose) if moves and k % 2 else pose
        result = session.process(fastibl.Frame(0.1 * k, back=back, back_from_marker=at, back_exposure=0.4))
        result.image  # noqa: B018 - the picture has to arrive
        if k > 5:
            out.append(time.process_time() - begin)
    passes = list(result.passes)
    if lights:
        session.set_environment(lights[0])
    last = session.process(fastibl.Frame(9.0, back_from_marker=pose, back_exposure=0.4))
    return Played(float(np.median(out)), passes, last.image[..., :3].astype(float))


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
    lit = ("irradiance", "shadow", "self_shadow", "bounce", "plane")
    # What is asked; the session that leaves something out, and one that does not; whether both draw the same; and the
    # passes that a frame then need not run.
    rows: tuple[tuple[str, Asked, Asked, bool, tuple[str, ...]], ...] = (
        ("matte: no glossy chain", Asked(_session(matte, methods=named), "changes", pose),
         Asked(_session(matte_full, methods=named), "changes", pose), True, ()),
        ("mirror: no diffuse light", Asked(_session(mirror, methods=named), "changes", pose),
         Asked(_session(mirror_full, methods=named), "changes", pose), True, ("self_shadow", "bounce")),
        ("no shadow asked for", Asked(_session(both, cast_shadow=False), "changes", pose),
         Asked(_session(both), "changes", pose), False, ("shadow", "plane")),
        ("light that stays", Asked(_session(both), "stays", pose), Asked(_session(both), "changes", pose), True, lit),
        ("camera that stays, too", Asked(_session(both), "stays", pose, moves=False),
         Asked(_session(both), "stays", pose), True, (*lit, "shade")),
        ("uniform light, budget of 2 %", Asked(_session(both, error=0.02), "uniform", pose),
         Asked(_session(both, error=0.02), "changes", pose), False, ()),
        ("object out of view", Asked(_session(both), "changes", _away()), Asked(_session(both), "changes", pose),
         False, (*lit[1:], "shade", "composite")),
    )  # fmt: skip
    for what, without, whole, same, needless in rows:
        a, b = played(without), played(whole)
        plan = without.session.plan
        out = [p.name for p in plan.passes if not p.included]
        told, passed = "", a.seconds <= _LESS * b.seconds and not set(needless) & set(a.passes)
        if same:
            off = float(np.sqrt(((a.picture - b.picture) ** 2).mean()) / max(b.picture.mean(), 1e-9))
            bound = (np.nan if plan.omission_bound is None else plan.omission_bound) + 1 / 255
            told, passed = f", picture differs by {percent(off)}, bound {percent(bound)}", passed and off <= bound
        yield Goal(
            f"{what}: time without and with",
            f"{1e3 * a.seconds:.2f}, {1e3 * b.seconds:.2f} ms{told}",
            f"at most {percent(_LESS)} of it"
            + (f", without {', '.join(needless)}" if needless else "")
            + (", the picture equal within the bound" if same else ""),
            passed,
            (f"left out: {', '.join(out)}", f"passes of a frame: {', '.join(a.passes)}; with: {', '.join(b.passes)}"),
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
        yield line.name, line.bound, largest(off)


@row("plan", "stated bounds")
def stated_bounds() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("self-shadow and bounce that budgets leave out", inputs.NO_MAPS)
        return
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
