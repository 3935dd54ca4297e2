"""The object's own shadow in pictures under lamps: error of whole pixels against rays, and time, by method.

Two lights: the studio's lamps, and the dawn with a sun that carries 75 % of the plane's irradiance, each above a table.
A direction of the truth is the middle of a texel of 64 squared; texels with more than 1/2000 of the light are cut
into 8 x 8. The light of a pixel is the mean over the renderer's four samples, each with its own normal and rays.
Errors are those of pixels cut at white, where the table has 0.35 of white.

A third light is a lamp that hangs near the object in even light; it is where it is, with rays to places all over it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.gl_device import gl_device
from fastibl.room import truth_map

from .. import brute, inputs, measure
from ..capture.near import Lamp
from ..goals import Goal, percent, row, skipped
from ..light.speed import cpu_times
from ..shadows import truth as lit
from ..shadows.self_shadow import missing
from ..shadows.sky import pieces
from . import cases, render, truth

MESHES = ("spot", "stanford-bunny", "teapot", "suzanne")
_BY_GL = "traced-lights by GL"
METHODS = ("none", "ambient-occlusion", "transfer", "pixel-transfer", "traced-lights", "traced")
MATTE = fastibl.Material(diffuse=(0.8, 0.8, 0.8))
METAL = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.8, 0.8), exponent=64)
PIXELS = 250  # of each mesh, chosen at random
_COARSE, _SPLIT, _BRIGHT = 64, 8, 1 / 2000
_VERSION = "1"  # of what is kept on disk: raise it when the truth changes


@cache
def lights() -> dict[str, fastibl.CubeMap]:
    size = cases.SIZE
    dawn, studio = (fastibl.read_environment(inputs.MAPS[m], size=size) for m in ("kiara_1_dawn", "studio_small_03"))
    return {"studio": cases.above_a_table(studio), "dawn and sun": cases.above_a_table(lit.with_sun(dawn))}


def sky(cube: fastibl.CubeMap) -> tuple[NDArray, NDArray, NDArray]:
    """Directions (k, 3), solid angles (k,) and radiance (k, 3)."""
    n, factor = _COARSE, cube.size // _COARSE
    d, angles, radiance = reference.samples(cube.faces.astype(np.float64))
    blocks = np.arange(6 * cube.size**2).reshape(6, n, factor, n, factor).transpose(0, 1, 3, 2, 4)
    blocks = blocks.reshape(6 * n * n, -1)
    flux = (radiance[blocks] * angles[blocks][..., None]).sum(axis=1)
    bright = (flux > _BRIGHT * flux.sum(axis=0)).any(axis=1)
    whole = angles[blocks].sum(axis=1)
    split = blocks[bright].ravel()
    fine, fine_angles = pieces(cube.size, split, _SPLIT)
    middle, _, _ = reference.samples(np.zeros((6, n, n, 3)))
    return (
        np.concatenate([middle[~bright], fine.reshape(-1, 3)]),
        np.concatenate([whole[~bright], fine_angles.ravel()]),
        np.concatenate([flux[~bright] / whole[~bright, None], radiance[split].repeat(_SPLIT**2, axis=0)]),
    )


@cache
def chosen(name: str) -> tuple[NDArray, NDArray]:
    """Pixels (p,) that the object covers, and their samples (p, 4) among those that see it."""
    at = truth.seen(name).pixel
    order = np.argsort(at, kind="stable")
    pixel, first, count = np.unique(at[order], return_index=True, return_counts=True)
    whole = np.flatnonzero(count == 4)
    whole = np.sort(np.random.default_rng(0).permutation(whole)[:PIXELS])
    return pixel[whole], order[first[whole, None] + np.arange(4)]


def true_light(name: str, light: str) -> NDArray[np.float64]:
    """(2, p, 3): radiance of the pixels of the matte object and of the metal."""
    s, (_, samples) = truth.seen(name), chosen(name)
    d, angles, radiance = sky(lights()[light])

    def make() -> NDArray:
        embree, scale = truth.embree_scene(s.mesh), float(np.ptp(s.mesh.vertices, axis=0).max())
        found = np.zeros((2, samples.size, 3))
        flux = radiance * angles[:, None]
        for k, i in enumerate(samples.ravel()):
            n, v = s.normal[i], s.view[i]
            up = np.flatnonzero(d @ n > 0)
            start = np.broadcast_to(s.start[i] + 2e-4 * scale * n, (len(up), 3)).astype(np.float32)
            free = embree.run(start, d[up].astype(np.float32), query="OCCLUDED") < 0
            cosine = d[up] @ n
            found[0, k] = (cosine * free) @ flux[up] / np.pi
            half = d[up] + v
            half /= np.linalg.norm(half, axis=1, keepdims=True)
            lobe = np.maximum(half @ n, 0) ** METAL.exponent * cosine
            found[1, k] = (lobe * free) @ flux[up] / (lobe @ angles[up])
        return found.reshape(2, *samples.shape, 3).mean(axis=2)

    key = ("lamps", s.mesh.vertices, s.mesh.triangles, d, radiance, samples.astype(np.int64), _VERSION)
    return brute.stored(key, make) * np.array([MATTE.diffuse[0], METAL.glossy[0]])[:, None, None]


_FACING = 3.0  # what the lamp nearby gives at the map's centre to what faces it, by what the even light gives
DISTANCES = (0.4, 0.8)  # metres from there
_RADIUS = 0.03
_TOWARDS = np.array([0.5, -0.45, 0.74]) / np.linalg.norm([0.5, -0.45, 0.74])


@dataclass(frozen=True)
class NearLamp:
    """A lamp at a distance from the middle of a mesh."""

    name: str
    distance: float

    @property
    def centre(self) -> NDArray[np.float64]:
        v = truth.seen(self.name).mesh.vertices
        return (v.min(axis=0) + v.max(axis=0)).astype(np.float64) / 2

    @property
    def lamp(self) -> Lamp:
        return Lamp(self.centre + self.distance * _TOWARDS, _RADIUS, _FACING * (self.distance / _RADIUS) ** 2)

    def environment(self, known: bool) -> fastibl.Environment:
        """known: that the lamp is near."""

        def light(d: NDArray) -> NDArray:
            unit = d / np.linalg.norm(d, axis=-1, keepdims=True)
            found = np.ones(d.shape)
            found[self.lamp.seen(self.centre, unit)] += self.lamp.radiance
            return found

        lights = [[*self.lamp.position, _RADIUS]] if known else None
        return fastibl.Environment(truth_map(light, cases.SIZE, 4), centre=self.centre, lights=lights)

    def true_light(self) -> NDArray[np.float64]:
        """(2, p, 3): radiance of the pixels of the matte object and of the metal."""
        s, (_, samples) = truth.seen(self.name), chosen(self.name)
        d, angles, _ = reference.samples(np.zeros((6, 64, 64, 3)))

        def make() -> NDArray:
            embree, scale = truth.embree_scene(s.mesh), float(np.ptp(s.mesh.vertices, axis=0).max())
            found = np.zeros((2, samples.size))
            for k, i in enumerate(samples.ravel()):
                n, v = s.normal[i], s.view[i]
                start = s.start[i] + 2e-4 * scale * n
                towards, angle = self.lamp.disc(start)
                directions = np.concatenate([d, towards])
                flux = np.concatenate([angles, np.full(len(towards), self.lamp.radiance * angle)])
                up = np.flatnonzero(directions @ n > 0)
                origins = np.broadcast_to(start, (len(up), 3)).astype(np.float32)
                free = embree.run(origins, directions[up].astype(np.float32), query="OCCLUDED") < 0
                cosine = directions[up] @ n
                found[0, k] = (cosine * free) @ flux[up] / np.pi
                half = directions[up] + v
                half /= np.linalg.norm(half, axis=1, keepdims=True)
                lobe = np.maximum(half @ n, 0) ** METAL.exponent * cosine
                sky = up < len(d)
                found[1, k] = (lobe * free) @ flux[up] / (lobe[sky] @ angles[up[sky]])
            return np.repeat(found.reshape(2, *samples.shape).mean(axis=2)[..., None], 3, axis=2)

        key = ("lamp nearby", s.mesh.vertices, s.mesh.triangles, samples.astype(np.int64), str(self), _VERSION)
        return brute.stored(key, make) * np.array([MATTE.diffuse[0], METAL.glossy[0]])[:, None, None]


def session(
    name: str,
    light: str | fastibl.Environment,
    material: fastibl.Material,
    method: str,
    camera: fastibl.Camera,
    taps: int,
    backend: str = "cpu",
) -> fastibl.Session:
    methods: dict[str, str | fastibl.Method] = {
        "self_shadow": method,
        "bounce": "none",
        "diffuse": fastibl.Method("irradiance-cube", size=32, source=32),
        # Samples of the map do not know where a lamp is.
        "glossy": fastibl.Method("sampled", taps=taps) if isinstance(light, str) else "stretched",
    }
    made = fastibl.Session(
        cases.scene(name),
        fastibl.Rig(camera),
        None,
        lights()[light] if isinstance(light, str) else light,
        methods=methods,
        backend=backend,
    )
    made.set_material(material)
    return made


def drawn(
    name: str, light: str | fastibl.Environment, material: fastibl.Material, method: str, backend: str = "cpu"
) -> NDArray[np.float64]:
    """(p, 3): radiance of the pixels."""
    made = session(name, light, material, method, cases.camera(), 1024, backend)
    made.process(fastibl.Frame(0.0, back_from_marker=cases.pose()))
    return render.picture(made).object.reshape(-1, 4)[chosen(name)[0], :3]


def large_camera() -> fastibl.Camera:
    """What the judged pictures show, by 640 x 480 pixels."""
    c = cases.camera()
    return fastibl.Camera(4 * c.width, 4 * c.height, 4 * c.fx, 4 * c.fy, 4 * c.cx, 4 * c.cy)


def times(name: str, light: str, material: fastibl.Material) -> dict[str, float]:
    """Milliseconds of a 4 ms yardstick for what each method adds to a picture of 640 x 480 that moves."""
    poses = cases.pose(), cases.beside(cases.pose())

    def draw(made: fastibl.Session, turn: list[int]) -> None:
        turn[0] += 1
        made.process(fastibl.Frame(float(turn[0]), back_from_marker=poses[turn[0] % 2]))

    calls: list[Callable[[], object]] = []
    for method in METHODS:
        made, turn = session(name, light, material, method, large_camera(), 4), [0]
        draw(made, turn)
        calls.append(partial(draw, made, turn))
    with measure.one_core():
        *mine, yard = np.median(cpu_times(calls, 5), axis=0)
    return {m: 4 * (t - mine[0]) / yard for m, t in zip(METHODS, mine, strict=True)}


@row("shadow", "self-shadow: pictures under lamps")
def lamps() -> Iterator[Goal]:
    pixels = "pixels with the object's own shadow under lamps, RMS by their mean"
    if reason := missing():
        yield skipped(pixels, reason)
        return
    _, no_gl = gl_device()
    for k, (kind, material) in enumerate((("matte", MATTE), ("metal, exponent 64", METAL))):
        error: dict[str, list[float]] = {m: [] for m in (*METHODS, _BY_GL)}
        notes = []
        for light in lights():
            for name in MESHES:
                white = float(lights()[light].faces[5].mean()) / cases.TABLE
                true = np.minimum(true_light(name, light)[k], white)
                mine = {m: np.minimum(drawn(name, light, material, m), white) for m in METHODS}
                if not no_gl:
                    mine[_BY_GL] = np.minimum(drawn(name, light, material, "traced-lights", "gl"), white)
                off = {m: float(np.sqrt(((p - true) ** 2).mean()) / true.mean()) for m, p in mine.items()}
                for m, e in off.items():
                    error[m].append(e)
                notes.append(f"{name}, {light}: " + ", ".join(f"{m} {percent(e)}" for m, e in off.items()))
        mean = {m: float(np.mean(e)) for m, e in error.items() if e}
        cost = {light: times("spot", light, material) for light in lights()}
        yield Goal(
            f"{kind}: {pixels}, mean of {len(MESHES)} meshes and {len(lights())} lights: traced-lights",
            percent(mean["traced-lights"]),
            f"half of transfer's ({percent(mean['transfer'])})",
            mean["traced-lights"] <= 0.5 * mean["transfer"],
            (
                "mean: " + ", ".join(f"{m} {percent(e)}" for m, e in mean.items()),
                *notes,
                *(
                    f"added to a picture of 640 x 480 of spot, {light}: "
                    + ", ".join(f"{m} {t:.1f} ms" for m, t in of.items())
                    + " of a 4.0 ms yardstick"
                    for light, of in cost.items()
                ),
            ),
        )
        what = f"{kind}: the same by the GL back end"
        if no_gl:
            yield skipped(what, no_gl)
            continue
        yield Goal(
            what,
            percent(mean[_BY_GL]),
            f"within 2 % of the CPU's ({percent(mean['traced-lights'])})",
            abs(mean[_BY_GL] / mean["traced-lights"] - 1) <= 0.02,
        )


@row("shadow", "self-shadow: a lamp nearby")
def near_lamp() -> Iterator[Goal]:
    pixels = "pixels with the object's own shadow, RMS by their mean, four meshes"
    if reason := missing():
        yield skipped(pixels, reason)
        return
    _, no_gl = gl_device()
    for k, (kind, material) in enumerate((("matte", MATTE), ("metal, exponent 64", METAL))):
        for distance in DISTANCES:
            error: dict[str, list[float]] = {}
            for name in MESHES:
                near = NearLamp(name, distance)
                true = near.true_light()[k]
                drawings = {m: drawn(name, near.environment(True), material, m) for m in METHODS}
                drawings["transfer, taken as distant"] = drawn(name, near.environment(False), material, "transfer")
                if not no_gl:
                    drawings[_BY_GL] = drawn(name, near.environment(True), material, "traced-lights", "gl")
                for m, light in drawings.items():
                    error.setdefault(m, []).append(float(np.sqrt(((light - true) ** 2).mean()) / true.mean()))
            mean = {m: float(np.mean(e)) for m, e in error.items()}
            part = 0.5 if material is MATTE else 1.0  # lobes of vertices know where it is, too
            each = ((n, {m: e[i] for m, e in error.items()}) for i, n in enumerate(MESHES))
            yield Goal(
                f"lamp at {distance:g} m, {_FACING:g} times as strong as the sky, {kind}: {pixels}: traced-lights",
                percent(mean["traced-lights"]),
                f"<= {part:g} of transfer's ({percent(mean['transfer'])})",
                max(mean[m] for m in mean if m.startswith("traced-lights")) <= part * mean["transfer"],
                tuple(
                    f"{what}: " + ", ".join(f"{m} {percent(e)}" for m, e in of.items())
                    for what, of in (("mean", mean), *each)
                ),
            )
