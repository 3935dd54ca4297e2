"""`fastibl report`: every method of every step measured on this machine, as a page, rows and plots.

report = make_report(gathered(environments, mesh, recording, QUICK))
write_report(report, Path("report"))
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from .._fastibl import CubeMap, Mesh, __version__
from ..measuring import Row, commit, cpu, write_rows
from ..recording import Recording
from . import (
    anisotropic,
    capture,
    diffuse,
    extremes,
    frame,
    furnace,
    glossy,
    growth,
    left_out,
    memory,
    self_shadow,
    shadow,
    stiff,
    tracking,
)
from .compare import Comparison, comparison_section
from .inputs import FULL, QUICK, Effort, Inputs, beginning, built_in_mesh, built_in_places, simulated, thinned
from .machine import machine
from .overview import biases, overview
from .section import Section

STEPS: tuple[tuple[str, Callable[[Inputs], Section]], ...] = (
    ("whole frame", frame.measure),
    ("matte surfaces", diffuse.measure),
    ("glossy surfaces", glossy.measure),
    ("brushed metal", anisotropic.measure),
    ("shadow", shadow.measure),
    ("self-shadow", self_shadow.measure),
    ("capture", capture.measure),
    ("tracking", tracking.measure),
)
MORE: tuple[tuple[str, Callable[[Inputs], Section]], ...] = (
    ("left out", left_out.measure),
    ("white furnace", furnace.measure),
    ("stiff light", stiff.measure),
    ("extreme cases", extremes.measure),
    ("growth", growth.measure),
    ("memory", memory.measure),
)


@dataclass
class Report:
    """head: what was measured, where and when. seconds: wall time and CPU time of each part."""

    head: dict[str, Any]
    sections: list[Section]
    seconds: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def rows(self) -> list[Row]:
        return [r for section in self.sections for r in section.rows]


def gathered(
    places: Mapping[str, CubeMap] | None = None,
    mesh: tuple[str, Mesh] | None = None,
    recording: tuple[str, Recording] | None = None,
    effort: Effort = QUICK,
) -> Inputs:
    """What to measure with. What is not given is built in: the room, the figurine, a walk through the room."""
    if recording is None:
        follow, sweep = simulated(effort)
        name = "a simulated walk through the built-in room"
    else:
        name, given = recording
        follow, sweep = beginning(given, effort), thinned(given, effort)
    title, shape = mesh or ("figurine", built_in_mesh(effort))
    return Inputs(places or built_in_places(), shape, title, follow, sweep, name, effort, built_in=places is None)


def _contents(inputs: Inputs) -> dict[str, str]:
    """What tells a mesh or map from another one of the same name; equal on every machine."""
    mesh = inputs.mesh
    maps = {f"the map {n}": f"{c.size} texels, mean {float(c.faces.mean()):.3g}" for n, c in inputs.places.items()}
    return {"the mesh": f"{inputs.mesh_name}, {len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles", **maps}


def make_report(
    inputs: Inputs, command: str = "fastibl report", progress: Callable[[str], None] | None = None
) -> Report:
    """Measures everything. progress: called with the name of each part before it begins."""
    begin, seconds = time.perf_counter(), {}

    def run(parts: Sequence[tuple[str, Callable[[Inputs], Section]]]) -> list[Section]:
        out = []
        for name, measure in parts:
            if progress is not None:
                progress(name)
            started, cpu_started = time.perf_counter(), time.process_time()
            out.append(measure(inputs))
            seconds[name] = time.perf_counter() - started, time.process_time() - cpu_started
        return out

    steps, more = run(STEPS), run(MORE)
    sections = [overview(steps), *steps, biases(steps), *more, machine(seconds)]
    head = {
        "command": command,
        "version": __version__,
        "commit": commit(),
        "machine": cpu(),
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "effort": inputs.effort.name,
        "places": list(inputs.places),
        "mesh": inputs.mesh_name,
        "recording": inputs.recording_name,
        "contents": _contents(inputs),
        "seconds": round(time.perf_counter() - begin, 1),
    }
    return Report(head, sections, seconds)


def write_report(report: Report, out: str | os.PathLike[str], against: Comparison | None = None) -> Path:
    """Writes report.html, report.json and plots/ to `out`; returns the page's path. against: a comparison that the page
    shows, too."""
    from .page import write_page

    if against is not None:
        report.sections.insert(1, comparison_section(against))
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    write_rows(out / "report.json", report.rows, report.head)
    return write_page(report, out)


__all__ = ["FULL", "QUICK", "Effort", "Inputs", "Report", "gathered", "make_report", "write_report"]
