"""How cost grows with the map, the spheres, the picture, the lights and the object."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import Camera, CubeMap, Environment, Frame, Lighting, Mesh, Rig, SelfShadow, Session, ShadowMap, cast_shadow
from ..lighting import PAPER
from ..measuring import one_core, row, seconds_text, side_by_side
from ..measuring.samples import units
from .inputs import Inputs, pose_around
from .plots import Lines
from .section import Section, Table

_WHAT = """The time of a step against the size of what it works on, on one core, both axes logarithmic: a line that
rises with slope 1 doubles when the size doubles."""
_SPHERES = (4, 16, 64, 256)
_LIGHTS = (0, 1, 2, 4, 8, 16)
_DETAIL = (2, 3, 4, 5)  # subdivisions of an icosahedron


@one_core()
def measure(inputs: Inputs) -> Section:
    section = Section("growth", "How cost grows", _WHAT)
    rounds = max(3, inputs.effort.rounds // 2)
    table: list[list[str]] = []
    for name, title, label, calls in (
        ("map", "Preparing the light, by size of the map", "texels along a cube face", _maps(inputs)),
        ("spheres", "A shadow map, by number of spheres", "spheres", _spheres(inputs)),
        ("pixels", "Shading and compositing, by picture", "pixels of the picture", _pixels(inputs)),
        ("lights", "Lighting 1000 surfaces, by number of lamps", "small bright lights", _lights(inputs)),
        ("vertices", "Self-shadow when the light changed, by object", "vertices", _vertices(inputs)),
    ):
        flat = {f"{m} {x}": call for m, each in calls.items() for x, call in each.items()}
        # A look-up of lights takes microseconds.
        timings, yard = side_by_side(flat, rounds, each_at_least=5e-3 if name == "lights" else 0.0)
        lines = {}
        for m, each in calls.items():
            seconds = [timings[f"{m} {x}"].cpu for x in each]
            for x in each:
                time = timings[f"{m} {x}"].of_cpu
                section.rows.append(row(m, f"{x} {label}", time=time, step=f"growth {name}", yard=yard))
            at = [max(x, 0.5) for x in each]  # a log axis has no place for 0
            lines[m] = (at, seconds)
            sizes = list(each)
            table.append([title, m, f"{sizes[0]}: {seconds_text(seconds[0])}", f"{sizes[-1]}: {seconds_text(seconds[-1])}",
                          f"n^{_slope(at, seconds):.2f}"])  # fmt: skip
        section.charts.append(Lines(f"growth-{name}", title, label, "", lines, unit="s"))
    head = ["what", "method", "smallest", "largest", "grows as"]
    section.tables.append(Table(head, table, note="Grows as: fitted over the upper half of the sizes."))
    return section


def _slope(x: Sequence[float], y: Sequence[float]) -> float:
    half = max(2, len(x) // 2)
    return float(np.polyfit(np.log(x[-half:]), np.log(y[-half:]), 1)[0])


Calls = Mapping[str, Mapping[int, Callable[[int], object]]]


def _room(inputs: Inputs) -> CubeMap:
    return next(iter(inputs.places.values()))


def _maps(inputs: Inputs) -> Calls:
    cube = _room(inputs)
    made = {}
    for n in inputs.effort.map_sizes:
        if n <= cube.size:
            faces = cube.level(int(np.log2(cube.size // n)))
        else:
            faces = np.repeat(np.repeat(cube.faces, n // cube.size, axis=1), n // cube.size, axis=2)
        # Two different maps in turn, so that nothing can be reused from the last call.
        made[n] = (CubeMap(np.ascontiguousarray(faces)), CubeMap(np.ascontiguousarray(faces[:, :, ::-1])))
    return {
        "default": {n: lambda k, c=c: Lighting(c[k % 2]) for n, c in made.items()},
        "the paper's": {
            n: lambda k, c=c: Lighting(c[k % 2], diffuse=PAPER.diffuse, glossy=PAPER.glossy) for n, c in made.items()
        },
    }


def _spheres(inputs: Inputs) -> Calls:
    cubes = list(inputs.places.values())
    where: dict[str, Any] = {"resolution": 64, "extent": 0.2, "centre": (0.0, 0.0), "outer": False}
    fitted = [inputs.spheres(n) for n in _SPHERES]
    given = {len(s): s for s in fitted}  # there may be fewer than were asked for

    def cast(method: str, spheres: NDArray, k: int) -> ShadowMap:
        return cast_shadow(cubes[k % len(cubes)], spheres, method, **where)

    return {m: {n: partial(cast, m, s) for n, s in given.items()} for m in ("directions", PAPER.shadow)}


def _pixels(inputs: Inputs) -> Calls:
    cube = _room(inputs)
    out: dict[str, dict[int, Callable[[int], object]]] = {"default": {}, "the paper's": {}}
    for width in inputs.effort.pixels:
        height = width * 3 // 4
        camera = Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2)
        back = np.full((height, width, 3), 128, np.uint8)
        for name, methods in (("default", "auto"), ("the paper's", "paper")):
            session = Session(inputs.scene, Rig(camera), None, cube, methods=methods)
            out[name][width * height] = partial(_next_picture, session, back)
    return out


def _next_picture(session: Session, back: NDArray, k: int) -> NDArray:
    return session.process(Frame(float(k + 1), back=back, back_from_marker=pose_around(0.01 * k))).image


def _lights(inputs: Inputs) -> Calls:
    n, v = units(1000, 1), units(1000, 2)
    made = {}
    for count in _LIGHTS:
        faces = np.ones((6, 64, 64, 3), np.float32)
        where = np.random.default_rng(4).permutation(6 * 64 * 64)[:count]
        faces.reshape(-1, 3)[where] = 2e3
        made[count] = Lighting(CubeMap(faces))
    return {
        "matte": {c: lambda k, l=l: l.irradiance(n) for c, l in made.items()},
        "glossy": {c: lambda k, l=l: l.glossy(n, v, 64.0) for c, l in made.items()},
    }


def _vertices(inputs: Inputs) -> Calls:
    import trimesh

    lights = [Lighting(Environment(cube)) for cube in inputs.places.values()]
    out: dict[int, Callable] = {}
    for detail in _DETAIL[: 4 if inputs.effort.name == "full" else 3]:
        ball = trimesh.creation.icosphere(detail, 1.0)
        baked = SelfShadow(Mesh(ball.vertices, ball.faces))
        out[len(ball.vertices)] = lambda k, b=baked: b.irradiance(lights[k % len(lights)])
    return {"transfer": out}
