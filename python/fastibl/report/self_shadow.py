"""What an object hides from itself: the light at its vertices, by every method."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .. import Lighting, SelfShadow, ambient_occlusion
from ..lighting import AUTO, PAPER
from ..measuring import measure as time_of
from ..measuring import one_core, seconds_text, side_by_side
from .inputs import Inputs
from .section import Section
from .steps import CHOSEN, Result, compared, step_section
from .steps import PAPER as BY_PAPER
from .visibility import Sky

_WHAT = """An arm keeps light from a body: how much light reaches each vertex of the object ({name}, {vertices}
vertices), with what the object itself hides. Truth: rays from {count} vertices to every texel of the map. “none” leaves
it out; “ambient-occlusion” multiplies by one number a vertex, whatever the light (the paper's P_V); “transfer” knows
which directions are free. The error is that of the vertex's light, by the mean truth of its place. Time is that of
lighting all vertices, on one core, in each frame in which the light changed."""


_Light = Callable[[Lighting], NDArray]
_Candidate = tuple[_Light, Callable[[], "SelfShadow | NDArray"] | None]


def _candidates(inputs: Inputs) -> dict[tuple[str, str], _Candidate]:
    """By method and setting: a function from lighting to the light at all vertices (v, 3), and one that prepares it."""
    mesh = inputs.mesh
    normals = mesh.normals
    out: dict[tuple[str, str], _Candidate] = {("none", ""): (lambda l: l.irradiance(normals), None)}
    sizes = (16, 32, 64, 128) if inputs.effort.name == "full" else (16, 32, 64)
    spheres = inputs.spheres(50)
    prepared: dict[tuple[str, str], Callable[[], SelfShadow | NDArray]] = {
        ("ambient-occlusion", ""): lambda: ambient_occlusion(mesh),
        ("ambient-occlusion", "spheres=50"): lambda: ambient_occlusion(mesh, spheres=spheres),
        ("transfer", "spheres=50"): lambda: SelfShadow.from_spheres(mesh, spheres),
        **{("transfer", f"size={n}"): partial(SelfShadow, mesh, size=n) for n in sizes},
    }

    def dimmed(part: NDArray, lighting: Lighting) -> NDArray:
        return lighting.irradiance(normals) * part

    for key, prepare in prepared.items():
        made = prepare()
        if isinstance(made, SelfShadow):
            out[key] = (made.irradiance, prepare)
        else:
            out[key] = (partial(dimmed, made[:, None]), prepare)
    return out


@one_core()
def measure(inputs: Inputs) -> Section:
    mesh, effort = inputs.mesh, inputs.effort
    total = len(mesh.vertices)
    chosen = np.sort(np.random.default_rng(0).permutation(total)[: effort.vertices])
    normals = mesh.normals[chosen].astype(np.float64)
    radius = np.linalg.norm(np.ptp(mesh.vertices, axis=0)) / 2
    seen, _ = Sky(inputs).without(mesh, mesh.vertices[chosen] + 1e-4 * radius * normals, normals)
    truths = inputs.by_place(seen)
    what = _WHAT.format(name=inputs.mesh_name, vertices=total, count=len(chosen))
    section = Section("self-shadow", "Shadow of the object on itself", what)
    lit = {name: Lighting(cube) for name, cube in inputs.places.items()}
    lights = list(lit.values())
    found = _candidates(inputs)

    def call(light: _Light, k: int) -> NDArray:
        return light(lights[k % len(lights)])

    timings, yard = side_by_side(
        {f"{m} {s}": partial(call, light) for (m, s), (light, _) in found.items()}, effort.rounds
    )
    results = []
    for (method, setting), (light, prepare) in found.items():
        estimates: dict[str, NDArray] = {name: light(l)[chosen] for name, l in lit.items()}
        errors, biases = compared(estimates, truths)
        mark = CHOSEN if (method, setting) == (_default(), "size=64") else ""
        mark = BY_PAPER if (method, setting) == (PAPER.self_shadow, "") else mark
        baking = "–" if prepare is None else seconds_text(time_of(lambda _, p=prepare: p(), [None], 1, 0).cpu)
        extra = {"once for an object": baking}
        time = timings[f"{method} {setting}"].of_cpu
        results.append(Result(method, setting, errors, biases, time, mark, extra))
    return step_section(
        section, "self-shadow", "mean error of the light at a vertex", "time of all vertices", results, yard
    )


def _default() -> str:
    return "transfer" if AUTO.self_shadow == "auto" else AUTO.self_shadow
