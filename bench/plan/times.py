"""Expected times of passes, by this machine's cost table, compared with measured times."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import fastibl
from fastibl._fastibl import _measure_costs
from fastibl.expected import present
from fastibl.measuring.frames import steady

from .. import inputs
from ..goals import Goal, percent, row
from ..measure import one_core
from ..shadows.self_shadow import missing
from . import cases, lamps
from .left_out import spot

PLASTIC = cases.MATERIALS["plastic"]
RAYS = ("spot", "stanford-bunny", "suzanne")  # meshes that are drawn with rays to the brightest light
PASSES = ("capture", "irradiance", "shadow", "self_shadow", "bounce", "shade", "composite")


@row("plan", "predicted time")
@one_core()
def predicted() -> Iterator[Goal]:
    """Medians over a recording, for a session that tracks, captures, and draws with the named methods.

    The cost table is measured at the same time, so that other work of the machine affects both.
    """
    recording = inputs.short_recording()
    ratios, notes = [], []
    for name in ("white", "plastic", "pbr"):
        scene, costs = spot(cases.MATERIALS[name]), _measure_costs()
        for diffuse in ("sh9", "irradiance-cube"):
            for glossy in ("centroid", "mip", "stretched") if name == "plastic" else ("centroid",):
                methods = {"diffuse": diffuse, "glossy": glossy}
                session = fastibl.Session(scene, recording.rig, recording.board, methods=methods, costs=costs)
                _, passes, _ = steady(session, recording, 1, 2)
                for line in session.plan.passes:
                    ran = [1e3 * p[line.name] for p in passes if line.name in p]
                    if line.name not in PASSES or line.milliseconds is None or not ran:
                        continue
                    found = float(np.median(ran))
                    ratios.append(found / line.milliseconds)
                    notes.append(
                        f"{name}, {diffuse}, {glossy}, {line.name}: {found:.2f} ms, expected {line.milliseconds:.2f}"
                    )
    if not missing():
        for what, found, expected in by_rays():
            ratios.append(found / expected)
            notes.append(f"{what}: {found:.2f} ms, expected {expected:.2f}")
    share = float(np.mean([0.75 <= r <= 1.25 for r in ratios]))
    yield Goal(
        "expected time of a pass against measured, within 25 %",
        f"{percent(share)} of {len(ratios)}, median {np.median(ratios):.2f}",
        ">= 90 %",
        share >= 0.9,
        tuple(notes),
    )


def by_rays() -> Iterator[tuple[str, float, float]]:
    """What is drawn, milliseconds, and what was expected, of 640 x 480 pixels under lamps and a sun."""
    rig = fastibl.Rig(lamps.large_camera())
    methods = {"self_shadow": "traced-lights", "diffuse": "irradiance-cube", "glossy": "centroid", "bounce": "none"}
    poses = cases.pose(), cases.beside(cases.pose())
    for light, cube in lamps.lights().items():
        costs = _measure_costs()
        for name in RAYS:
            for kind, material in (("matte", lamps.MATTE), ("metal", lamps.METAL), ("plastic", PLASTIC)):
                session = fastibl.Session(cases.scene(name), rig, None, cube, methods=methods, costs=costs, error=0.02)
                session.set_material(material)
                times = []
                for k in range(12):
                    result = session.process(fastibl.Frame(k / 30, back_from_marker=poses[k % 2]))
                    times.append(1e3 * result.timings["shade"])
                expected = next(p.milliseconds for p in session.plan.passes if p.name == "shade")
                yield f"{name}, {kind}, {light}, shade with rays", float(np.median(times[6:])), present(expected)
