"""Expected times of passes against measured ones, by this machine's cost table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import fastibl

from ..goals import Goal, percent, row
from ..measure import one_core
from . import cases
from .left_out import _session

PASSES = ("irradiance", "shadow", "self_shadow", "bounce", "shade", "composite")


def measured(session: fastibl.Session, frames: int = 10) -> dict[str, float]:
    """Least milliseconds of each pass under light that changes every frame, 640 x 480."""
    lights = [fastibl.Environment(cases.environment(name)) for name in ("venice_sunset", "kiara_1_dawn")]
    back, found = np.full((480, 640, 3), 120, np.uint8), {}
    for k in range(frames):
        session.set_environment(lights[k % 2])
        frame = fastibl.Frame(0.1 * k, back=back, back_from_marker=cases.pose(), back_exposure=0.4)
        timings = session.process(frame).timings
        if k > 1:
            for name, seconds in timings.items():
                found[name] = min(found.get(name, np.inf), 1e3 * seconds)
    return found


@row("plan", "predicted time")
@one_core()
def predicted() -> Iterator[Goal]:
    costs, ratios, notes = fastibl.machine_costs(), [], []
    materials = {
        "white": cases.MATERIALS["white"],
        "plastic": cases.MATERIALS["plastic"],
        "pbr": cases.MATERIALS["pbr"],
    }
    for name, material in materials.items():
        for diffuse in ("sh9", "irradiance-cube"):
            for glossy in ("centroid", "mip", "stretched") if name == "plastic" else ("centroid",):
                methods = {"diffuse": diffuse, "glossy": glossy}
                session = _session(material, methods=methods, costs=costs)
                found = measured(session)
                for line in session.plan.passes:
                    if line.name not in PASSES or line.milliseconds is None or line.name not in found:
                        continue
                    ratio = found[line.name] / line.milliseconds
                    ratios.append(ratio)
                    notes.append(
                        f"{name}, {diffuse}, {glossy}, {line.name}: {found[line.name]:.2f} ms, "
                        f"expected {line.milliseconds:.2f}"
                    )
    share = float(np.mean([0.75 <= r <= 1.25 for r in ratios]))
    yield Goal(
        "expected time of a pass against measured, within 25 %",
        f"{percent(share)} of {len(ratios)}, median {np.median(ratios):.2f}",
        ">= 90 %",
        share >= 0.9,
        tuple(notes),
    )
