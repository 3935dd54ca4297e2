"""The white furnace: in a room of one colour, everything white must have that colour, whatever the method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import (
    CubeMap,
    Lighting,
    MeshShadow,
    SelfShadow,
    ambient_occlusion,
    cast_shadow,
    methods,
    shapes,
)
from ..expected import present
from ..measuring import Row, label, one_core, row
from ..measuring.samples import pairs, units
from .inputs import Inputs
from .section import Section, Table, signed
from .steps import setting_of

_WHAT = """A room of one colour everywhere lights everything evenly, so every right method gives exactly 1 for a white
surface, whatever its shape and gloss. What departs from 1 is light that a method makes up or loses. The smallest and the
largest answer over many surfaces and views."""
_EXPONENTS = (0.0, 1.0, 8.0, 64.0, 1e3, 1e6)
_ALPHAS = ((0.02, 0.02), (0.1, 0.4), (0.5, 0.5), (1.0, 1.0))


@one_core()
def measure(inputs: Inputs) -> Section:
    white = CubeMap(np.ones((6, 64, 64, 3), np.float32))
    section = Section("furnace", "White furnace: no light made up or lost", _WHAT)
    table: list[list[str]] = []
    off_of: dict[tuple[str, ...], float] = {}
    worst = ("", 0.0)

    def add(step: str, method: str, values: NDArray, setting: str = "") -> None:
        nonlocal worst
        low, high = float(np.min(values)) - 1, float(np.max(values)) - 1
        off = max(abs(low), abs(high))
        table.append([step, label(method, setting), signed(low), signed(high), _verdict(off)])
        off_of[step, label(method, setting)] = off
        section.rows.append(_row(step, method, setting, off))
        if step == "diffuse" and method in ("six-face", "nearest-face"):  # the paper's fit: known to lose light
            return
        worst = max(worst, (f"{step}, {method}", off), key=lambda w: w[1])

    normals = units(400, 5)
    for m in methods("diffuse"):
        add("diffuse", m.name, Lighting(white, diffuse=m).irradiance(normals) / np.pi, setting_of(m))
    n, v = pairs(20)
    for m in methods("glossy"):
        lit = Lighting(white, glossy=m)
        add("glossy", m.name, np.stack([lit.glossy(n, v, s) for s in _EXPONENTS]), setting_of(m))
    lit = Lighting(white)
    for taps in (1, 8, 16):
        given = [lit.ggx(n, v, alpha=np.array(a), taps=taps) for a in _ALPHAS]
        add("anisotropic", "taps", np.stack(given), f"taps={taps}")
    add("prefiltered maps", "ggx", np.concatenate([present(c).faces.reshape(-1) for c in lit.prefiltered(32, 5)]))
    ball = shapes.surface_net(lambda p: np.linalg.norm(p, axis=1) - 1, np.full(3, -1.3), np.full(3, 1.3), 0.2)
    plain = Lighting(white).irradiance(ball.normals)
    add("self-shadow of a ball", "transfer", SelfShadow(ball).irradiance(lit) / plain)
    add("self-shadow of a ball", "ambient-occlusion", ambient_occlusion(ball))
    far = np.array([[50.0, 50.0, 0.5, 0.01]], np.float32)
    for method in ("directions", "cap-sum", "cap-product"):
        shadow = cast_shadow(white, far, method, resolution=16, extent=0.3, centre=(0.0, 0.0), outer=False)
        add("shadow of something far away", method, shadow.image)
    table.append(_colour(inputs, white))
    off_of[tuple(table[-1][:2])] = 0.0
    worst_of: dict[str, list[str]] = {}
    for line in table:
        if line[0] not in worst_of or off_of[tuple(line[:2])] > off_of[tuple(worst_of[line[0]][:2])]:
            worst_of[line[0]] = line
    counts = {what: sum(line[0] == what for line in table) for what in worst_of}
    short = [[what, str(counts[what]), *line[1:]] for what, line in worst_of.items()]
    section.tables.append(Table(["what", "methods and settings", "worst of them", "least", "most", ""], short))
    head = ["what", "method", "least", "most", ""]
    section.tables.append(Table(head, table, note="Least and most: departures from 1. ✓ within 0.5 %, ~ within 5 %."))
    section.seen.append(
        f"Besides the paper's own fit, nothing departs from 1 by more than {100 * worst[1]:.2g} % ({worst[0]})."
    )
    return section


def _colour(inputs: Inputs, white: CubeMap) -> list[str]:
    """The shadow in a white room must have no colour: all channels are the same."""
    image = MeshShadow(inputs.mesh).cast(white).image
    off = float(np.abs(image - image.mean(axis=-1, keepdims=True)).max())
    return ["colour of a shadow in white light", "mesh", signed(-off), signed(off), _verdict(off)]


def _verdict(off: float) -> str:
    return "✓" if off <= 0.005 else "~" if off <= 0.05 else "✗"


def _row(step: str, method: str, setting: str, off: float) -> Row:
    return row(method, step, "largest departure in a white room", off, setting=setting, step="furnace")
