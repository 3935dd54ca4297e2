"""What a frame leaves out: passes that a scene does not need, with the reason, the bound, and the time saved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .. import CubeMap, Frame, Material, Plan, Pose, Rig, Session
from ..measuring import one_core, row, seconds_text, side_by_side
from .inputs import MATERIAL, STREAM, Inputs, pose_around
from .section import Section, Table, percent

_WHAT = """Most scenes do not need every step. Before a frame, a plan strikes out what cannot be seen, and says why and
how large the error of leaving it out can be at most. The same object and picture ({width} × {height} pixels) with fewer
needs; light and pose are given, and the light changes a little in every frame unless it says otherwise. One core."""
_WIDTH, _HEIGHT = 640, 480


@one_core()
def measure(inputs: Inputs) -> Section:
    section = Section("left-out", "What is left out", _WHAT.format(width=_WIDTH, height=_HEIGHT))
    from .. import Camera

    rig = Rig(Camera(_WIDTH, _HEIGHT, 0.9 * _WIDTH, 0.9 * _WIDTH, _WIDTH / 2, _HEIGHT / 2))
    back = np.full((_HEIGHT, _WIDTH, 3), 128, np.uint8)
    cases = {
        "everything": (MATERIAL, True, "changes", 0.0),
        "matte object": (Material(MATERIAL.diffuse), True, "changes", 0.0),
        "mirror-like object": (Material((0, 0, 0), (0.9, 0.9, 0.9), 2000.0), True, "changes", 0.0),
        "no shadow": (MATERIAL, False, "changes", 0.0),
        "light stays": (MATERIAL, True, "stays", 0.0),
        "light and camera stay": (MATERIAL, True, "all stays", 0.0),
        "uniform light": (MATERIAL, True, "uniform", 0.0),
        "object out of view": (MATERIAL, True, "changes", 50.0),
    }
    calls, plans, passes = {}, {}, {}
    for name, (material, shadow, light, away) in cases.items():
        session = Session(inputs.scene, rig, None, inputs.stream(0), cast_shadow=shadow)
        session.set_material(material)
        if away:
            matrix = np.eye(4)
            matrix[1, 3] = -away  # behind the camera
            session.move(Pose(matrix))
        last: list = [None, 0]

        def call(k: int, session=session, light=light, name=name, last=last) -> None:
            if light == "changes":
                session.set_environment(inputs.stream(k))
            if light == "uniform":
                session.set_environment(CubeMap(np.full((6, 128, 128, 3), 1 + 0.01 * (k % 2), np.float32)))
            last[1] += 1
            pose = pose_around(0.0 if light == "all stays" else 0.01 * last[1])
            frame = Frame(float(last[1]), back=back, back_from_marker=pose)
            result = session.process(replace(frame))
            result.image  # noqa: B018 - the picture has to arrive
            plans[name], passes[name] = result.plan, result.passes

        calls[name] = call
    timings, yard = side_by_side(calls, inputs.effort.rounds, warm=STREAM)
    whole = timings["everything"].cpu
    table = []
    for name in cases:
        plan: Plan = plans[name]
        left = {p.name: p for p in plan.passes if not p.included}
        spent = timings[name].of_cpu
        section.rows.append(row("auto", name, time=spent, step="left-out", yard=yard))
        percents = round(100 * (1 - spent.median / whole))
        saved = f"{percents} %" if percents >= 0 else f"none, takes {-percents} % more"
        if name == "everything":
            saved = "–"
        bound = plan.omission_bound
        stated = "not known" if bound is None else percent(bound) if bound else "0"
        table.append([name, ", ".join(left) or "–", stated, ", ".join(passes[name]),
                      seconds_text(spent.median), saved])  # fmt: skip
    head = ["scene", "struck out by the plan", "error of it, at most", "ran in the last frame", "time", "saved"]
    section.tables.append(Table(head, table))
    section.text.append(("The plan of a frame with everything", str(plans["everything"])))
    section.text.append(("The plan for the matte object", str(plans["matte object"])))
    parts = {name: 1 - timings[name].cpu / whole for name in list(cases)[1:]}
    most = max(parts, key=lambda name: parts[name])
    section.seen.append(f"Most is saved where “{most}”: {100 * parts[most]:.0f} % of the time.")
    return section
