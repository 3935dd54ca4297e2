"""The shadow of spheres on the plane: time compared with the paper's way, error of the method, steadiness, steps."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from typing import Any, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

import fastibl

from .. import inputs, measure
from ..brute import finite
from ..goals import Goal, largest, row, skipped
from ..light.speed import cpu_times
from ..light.stability import texel_directions
from ..peers import cone_sum
from ..processes import tests
from . import truth
from .sky import Sky, behind_spheres

_T = TypeVar("_T")
WIDTH, HEIGHT = 640, 480
RESOLUTION = 128
WHERE: dict[str, Any] = {"method": "directions", "extent": truth.EXTENT, "centre": (0.0, 0.0), "outer": False}


def ratio(cube: fastibl.CubeMap, spheres: ArrayLike, points: ArrayLike, directions: int) -> NDArray:
    return fastibl.shadow_ratio(cube, spheres, points, method="directions", directions=directions)


def cast(cube: fastibl.CubeMap, spheres: ArrayLike, directions: int, resolution: int = RESOLUTION) -> fastibl.ShadowMap:
    """One map over the truth's grid, without a coarse one around it."""
    return fastibl.cast_shadow(cube, spheres, directions=directions, resolution=resolution, **WHERE)


@cache
def seen() -> NDArray[np.float32]:
    """Points (640 * 480, 2) of the plane that a camera sees; all of them are on the shadow's map."""
    f = 0.5 * WIDTH / np.tan(np.radians(48) / 2)
    camera = fastibl.Camera(WIDTH, HEIGHT, f, f, WIDTH / 2, HEIGHT / 2)
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = camera.unproject(np.stack([x, y], axis=-1)).astype(np.float64)
    eye = np.array([0.0, -0.7, 2.2])
    forward = -eye / np.linalg.norm(eye)
    right = np.array([1.0, 0, 0])
    rays = rays[..., :1] * right + rays[..., 1:2] * np.cross(forward, right) + rays[..., 2:] * forward
    points = (eye[:2] - rays[..., :2] * (eye[2] / rays[..., 2:])).reshape(-1, 2)
    return np.ascontiguousarray(points, np.float32)


def random_spheres(count: int, seed: int = 0) -> NDArray[np.float32]:
    """Spheres within a ball of diameter 1 that stands on the plane; together they are as large as a fifth of the
    ball."""
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(count, 3))
    v *= 0.5 * (rng.random((count, 1)) ** (1 / 3)) / np.linalg.norm(v, axis=1, keepdims=True)
    size = rng.uniform(0.5, 1.5, count)
    size *= (0.2 * 0.5**3 / (size**3).sum()) ** (1 / 3)
    return np.column_stack([v + (0, 0, 0.5), size]).astype(np.float32)


def _missing() -> str:
    return "" if inputs.MAPS and len(truth.meshes()) == len(truth.MESHES) else inputs.NO_MAPS


def _cubes() -> list[fastibl.CubeMap]:
    return [light.cube for light in truth.lights().values()]


def _in_turn(call: Callable[[_T], object], each: Sequence[_T]) -> Callable[[], object]:
    """A function that passes the next light in every call."""
    turn = itertools.cycle(each)
    return lambda: call(next(turn))


def _looked_up(spheres: NDArray, points: NDArray, cube: fastibl.CubeMap) -> NDArray:
    return fastibl.cast_shadow(cube, spheres).sample(points)


class Moving:
    """Casts as a session does: the directions of a light stay, and the object is somewhere else in every picture.

    Choosing the directions belongs to a new light, as does making the table of cones.
    """

    def __init__(self, cube: fastibl.CubeMap, spheres: NDArray, directions: int, resolution: int = RESOLUTION):
        self.cube, self.resolution, self.turn = cube, resolution, 0
        self.spheres = spheres, spheres + np.array([1e-3, 0, 0, 0], np.float32)
        self.caster = fastibl.DirectionShadow(directions)
        self()

    def __call__(self, points: NDArray | None = None, out: NDArray | None = None) -> None:
        self.turn ^= 1
        where = {k: v for k, v in WHERE.items() if k != "method"}
        shadow = self.caster.cast(self.cube, self.spheres[self.turn], resolution=self.resolution, **where)
        if points is not None:
            shadow.sample(points, out)


# Time


@row("shadow", "time against a per-pixel cone sum")
def against_cones() -> Iterator[Goal]:
    if _missing():
        yield skipped("spheres against a per-pixel cone sum", _missing())
        return
    points, cubes = seen(), _cubes()
    x, y = (np.ascontiguousarray(c) for c in points.T)
    out = np.empty((len(points), 3), np.float32)  # one picture that is used again, as in a session
    for count, times_faster, milliseconds in ((50, 15, 1.0), (128, 20, None)):
        what = f"{count} spheres, K = 256, 128^2 map and 640 x 480 look-up, against a per-pixel cone sum"
        spheres = truth.spheres("spot", count)
        try:
            cones = [cone_sum.ConeSum(cube, spheres) for cube in cubes]
            moving = [Moving(cube, spheres, 256) for cube in cubes]
        except RuntimeError as reason:
            yield skipped(what, str(reason))
            continue
        with measure.one_core():
            times = cpu_times(
                [
                    _in_turn(lambda shadow: shadow(points, out), moving),
                    _in_turn(lambda shadow: shadow(), moving),
                    _in_turn(lambda cones: cones(x, y), cones),
                    _in_turn(partial(cast, spheres=spheres, directions=256), cubes),
                    _in_turn(partial(_looked_up, spheres, points), cubes),
                ],
                15,
            )
        ours, alone, theirs, chosen, default, yard = np.median(times, axis=0)
        faster = float(np.median(times[:, 2] / times[:, 0]))
        nominal = 4 * ours / yard
        goal = f">= {times_faster} x" + (f", <= {milliseconds:.1f} ms of a 4.0 ms yardstick" if milliseconds else "")
        yield Goal(
            what,
            f"{faster:.1f} x, {nominal:.2f} ms",
            goal,
            bool(faster >= times_faster and (milliseconds is None or nominal <= milliseconds)),
            (
                f"{len(spheres)} spheres that move, ten lights in turn: {1e3 * ours:.2f} ms, of which the map "
                f"{1e3 * alone:.2f} ms; a map with choosing directions {1e3 * chosen:.2f} ms; cone sum "
                f"{1e3 * theirs:.1f} ms, {cones[0].width} pixels a register; yardstick {1e3 * yard:.2f} ms CPU",
                f"by default, with the coarse map around it: {1e3 * default:.2f} ms",
            ),
        )


@row("shadow", "unchanged light and pose")
def look_up() -> Iterator[Goal]:
    """All that a frame then costs, because the plan leaves the pass out (tests/test_plan.py)."""
    points = seen()
    cube = truth.lights()["uniform"].cube
    shadow = cast(cube, random_spheres(50), 64)
    out = shadow.sample(points)
    with measure.one_core():
        times = cpu_times([lambda: shadow.sample(points, out)], 15)
    time, yard = np.median(times, axis=0)
    nominal = 4 * time / yard
    yield Goal(
        "unchanged light and pose: the look-up of 640 x 480 points alone",
        f"{nominal:.2f} ms",
        "<= 0.25 ms of a 4.0 ms yardstick",
        bool(nominal <= 0.25),
        (f"{1e3 * time:.2f} ms, yardstick {1e3 * yard:.2f} ms; from Python, into an array that is kept",),
    )


@row("shadow", "5000 spheres")
def many() -> Iterator[Goal]:
    spheres = random_spheres(5000)
    cubes = _cubes()
    with measure.one_core():
        time, yard = np.median(cpu_times([_in_turn(lambda cube: cast(cube, spheres, 64), cubes)], 5), axis=0)
    nominal = 4 * time / yard
    points = truth.grid(12)
    sky = Sky([truth.lights()["uniform"].cube])
    true = sky.ratios(points, behind_spheres(sky, spheres), False)[:, 0]
    off = truth.errors(ratio(truth.lights()["uniform"].cube, spheres, points, 64), true)
    yield Goal(
        "5000 spheres, K = 64, 128^2 map",
        f"{nominal:.1f} ms",
        "<= 8 ms of a 4.0 ms yardstick",
        bool(nominal <= 8),
        (
            f"{1e3 * time:.1f} ms, yardstick {1e3 * yard:.2f} ms; random spheres within a ball, "
            f"{len(cubes)} lights in turn; uniform light: RMS {off.rms:.4f} at {len(points)} points",
        ),
    )


@row("shadow", "growth with the map")
def growth() -> Iterator[Goal]:
    spheres = random_spheres(50) if _missing() else truth.spheres("spot")
    cubes = _cubes()
    sizes = (128, 256, 512, 1024)
    with measure.one_core():
        times = cpu_times([_in_turn(Moving.__call__, [Moving(c, spheres, 64, n) for c in cubes[:4]]) for n in sizes], 7)
    middle = np.median(times, axis=0)[:-1]
    factor = float(np.median(times[:, 3] / times[:, 0]))
    yield Goal(
        "128^2 to 1024^2 points (64 times as many), 50 spheres, K = 64",
        f"{factor:.1f} x",
        "<= 10 x",
        factor <= 10,
        ("; ".join(f"{n}^2 {1e3 * t:.2f} ms" for n, t in zip(sizes, middle, strict=True)),),
    )


# Error


def method_errors(directions: int) -> dict[str, dict[str, tuple[truth.Errors, truth.Errors]]]:
    """By mesh and light: errors over the whole grid, and where the shadow is seen."""
    found: dict[str, dict[str, tuple[truth.Errors, truth.Errors]]] = {}
    for mesh in truth.JUDGED:
        spheres = truth.spheres(mesh)
        for name, light in truth.lights().items():
            true = truth.sphere_truth(spheres, name)
            given = ratio(light.cube, spheres, truth.grid(), directions)
            seen_ = truth.errors_in_shadow(given, true, truth.covered(mesh))
            found.setdefault(mesh, {})[name] = truth.errors(given, true), seen_
    return found


@row("shadow", "error of the method")
def method() -> Iterator[Goal]:
    if _missing():
        yield skipped("error of the method", _missing())
        return
    for directions, mean, each, most in ((256, 0.004, 0.005, 0.03), (1024, 0.0015, None, 0.012)):
        found = method_errors(directions)
        whole = {(mesh, n): e for mesh, by in found.items() for n, (e, _) in by.items()}
        rms = float(np.mean([e.rms for e in whole.values()]))
        worst_light = max(whole, key=lambda k: whole[k].rms)
        largest_at = max(whole, key=lambda k: whole[k].worst)
        in_shadow = [e for by in found.values() for _, e in by.values()]
        by_light = {n: np.mean([found[m][n][0].rms for m in found]) for n in truth.lights()}
        yield Goal(
            f"error of the method, same 50 spheres, K = {directions}: RMS, worst light and object, largest",
            f"{rms:.4f}, {whole[worst_light].rms:.4f}, {whole[largest_at].worst:.3f}",
            f"<= {mean}, " + (f"<= {each}, " if each else "(-), ") + f"<= {most}",
            bool(rms <= mean and (each is None or whole[worst_light].rms <= each) and whole[largest_at].worst <= most),
            (
                "by light: " + ", ".join(f"{n} {v:.4f}" for n, v in by_light.items()),
                "by object: "
                + ", ".join(f"{m} {np.mean([e.rms for e, _ in by.values()]):.4f}" for m, by in found.items()),
                f"worst: {' under '.join(worst_light)}; largest: {' under '.join(largest_at)}; without studio "
                f"{np.mean([e.rms for (_, n), e in whole.items() if 'studio' not in n]):.4f}",
                f"where the shadow is seen (outside the footprint, 1 - ratio > 0.01): RMS "
                f"{np.mean([e.rms for e in in_shadow]):.4f}, worst light {max(e.rms for e in in_shadow):.4f}, largest "
                f"{max(e.worst for e in in_shadow):.3f}",
            ),
        )


def lamps(size: int = truth.SIZE) -> fastibl.CubeMap:
    """Saturated blue and red lamps of six degrees in a dim room; the blue one has a 20th of the luminance."""
    d = texel_directions(size)
    faces = np.full((len(d), 3), 0.01)
    for azimuth, elevation, colour in ((0.4, 0.9, (0.0, 0.0, 60.0)), (2.6, 0.7, (400.0, 0.0, 0.0))):
        axis = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        faces[d @ axis > np.cos(np.radians(3))] += colour
    return fastibl.CubeMap(faces.reshape(6, size, size, 3))


@row("shadow", "saturated lamps")
def coloured() -> Iterator[Goal]:
    if _missing():
        yield skipped("saturated blue and red lamps", _missing())
        return
    cube = lamps()
    squares, most = [], []
    for mesh in truth.JUDGED:
        spheres = truth.spheres(mesh)
        off = ratio(cube, spheres, truth.grid(), 256) - truth.kept_sphere_ratio([cube], spheres, truth.grid())[:, 0]
        squares.append((off**2).mean(axis=0))
        most.append(np.abs(off).max())
    by_channel = np.sqrt(np.array(squares)).max(axis=0)
    yield Goal(
        "saturated blue and red lamps together, K = 256: RMS of the worst channel, largest",
        f"{by_channel.max():.4f}, {largest(most):.3f}",
        "<= 0.005, <= 0.03",
        bool(by_channel.max() <= 0.005 and largest(most) <= 0.03),
        (
            "by channel, worst of three objects: "
            + ", ".join(f"{c} {v:.4f}" for c, v in zip("RGB", by_channel, strict=True)),
        ),
    )


# Steps in penumbrae


def encoded(linear: NDArray) -> NDArray:
    """sRGB of linear light, 0 to 255."""
    return 255 * np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    )


MID_GREY = 0.214  # linear light of sRGB 0.5


def scanlines(count: int = 6, length: int = 400) -> NDArray:
    """(count, length, 2): points that lie like neighbouring pixels of a display on which the plane is 640 pixels
    wide."""
    step = 2 * truth.EXTENT / WIDTH
    lines = []
    for k in range(count):
        angle = np.pi * (k + 0.3) / count
        along = np.array([np.cos(angle), np.sin(angle)])
        middle = (0.25 + 0.1 * k) * np.array([-along[1], along[0]])
        lines.append(middle + (np.arange(length) - length / 2)[:, None] * step * along)
    return np.array(lines)


@row("shadow", "banding in penumbrae")
def banding() -> Iterator[Goal]:
    if _missing():
        yield skipped("banding in penumbrae", _missing())
        return
    lines = scanlines()
    soft = {name: light for name, light in truth.lights().items() if light.soft}
    spheres = truth.spheres("spot")
    true = truth.kept_sphere_ratio([light.cube for light in soft.values()], spheres, lines.reshape(-1, 2))
    steps = np.abs(np.diff(encoded(MID_GREY * true.reshape(*lines.shape[:2], -1, 3)), axis=1))
    # Where the truth itself has an edge, a step is right; a texel of the map (five pixels) beside it belongs to the
    # edge.
    near = np.pad(steps, ((0, 0), (5, 5), (0, 0), (0, 0)))
    smooth = sliding_window_view(near, 11, axis=1).max(axis=-1) <= 1
    beyond: dict[str, float] = {}
    exact: dict[str, float] = {}
    edges = 0.0
    for k, (name, light) in enumerate(soft.items()):
        shadow = cast(light.cube, spheres, 256)
        at = lines.reshape(-1, 2)
        for found, given in ((beyond, shadow.sample(at)), (exact, ratio(light.cube, spheres, at, 256))):
            given = given.reshape(*lines.shape[:2], 3).astype(np.float64)
            off = finite(np.abs(np.diff(encoded(MID_GREY * given), axis=1)) - steps[:, :, k])
            found[name] = float(off[smooth[:, :, k]].max())
            if found is beyond:
                edges = max(edges, float(off[steps[:, :, k] <= 1].max()))
    value = largest(beyond.values())
    yield Goal(
        "banding at K = 256: largest step between display pixels of a smooth penumbra beyond the true one, mid-grey",
        f"{value:.2f} / 255",
        "<= 1 / 255",
        value <= 1,
        (
            "by light: " + ", ".join(f"{n} {v:.2f}" for n, v in beyond.items()),
            f"of a 128^2 map, {len(lines)} lines of {lines.shape[1]} pixels; beside edges, too: {edges:.2f}; "
            f"without a map, every pixel by itself: {max(exact.values()):.2f}",
        ),
    )


@row("shadow", "hostile geometry and light")
def hostile() -> Iterator[Goal]:
    files = sorted(p.name for p in (measure.ROOT / "tests").glob("test_shadow*.py"))
    yield tests("hostile geometry and light, every row of the notes: exact, finite, in [0, 1]", files)
