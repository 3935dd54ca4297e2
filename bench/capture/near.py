"""Near lights: object and shadow compared with rays cast from each of their points, by the lamp's distance.

A lamp hangs in the built-in room, whose windows are near, too. Its power grows with the square of its distance, so that
its light at the map's centre stays the same. The truth is in float64 NumPy and knows nothing of the map: it casts rays
from each point into the room and to points of the lamp's disc.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.room import LOWER, UPPER, Room, truth_map
from fastibl.viewpoint import looking

from ..goals import Goal, percent, row

CENTRE = np.array([0.0, 0.0, 0.06])  # of the map: the middle of the object
HEIGHT = 0.12
DISTANCES = (0.3, 0.5, 1.0, 2.0, 4.0)  # metres from that centre
RADIUS = 0.04
TOWARDS = np.array([0.55, -0.35, 0.76]) / np.linalg.norm([0.55, -0.35, 0.76])
_STRENGTH = 1.5  # irradiance facing the lamp at the centre, divided by the room's mean over all normals
_RAYS, _SPLIT = 40, 3  # directions along a face's edge in which to look; parts of each, for its light
_POINTS = 200  # points of the lamp's disc
_PIXELS = 500


@cache
def room() -> Room:
    return Room()


@cache
def _directions(size: int = _RAYS) -> tuple[NDArray, NDArray]:
    d = fastibl.texel_directions(size).reshape(-1, 3).astype(np.float64)
    return d / np.linalg.norm(d, axis=1, keepdims=True), np.tile(
        np.asarray(fastibl.texel_solid_angles(size), np.float64).ravel(), 6
    )


def room_light(eye: NDArray, normal: NDArray) -> NDArray:
    """Irradiance (k, 3) from the room by each of the directions, summed over each direction's parts."""
    d, angles = _directions(_RAYS * _SPLIT)
    weight = angles * np.maximum(d @ normal, 0)
    light = np.zeros((len(d), 3))
    up = weight > 0
    light[up] = np.asarray(room().radiance(eye, d[up].astype(np.float32), unit=True)) * weight[up, None]
    return light.reshape(6, _RAYS, _SPLIT, _RAYS, _SPLIT, 3).sum(axis=(2, 4)).reshape(-1, 3)


@dataclass(frozen=True)
class Lamp:
    """A grey sphere of even radiance."""

    position: NDArray
    radius: float
    radiance: float

    def disc(self, point: NDArray) -> tuple[NDArray, float]:
        """Unit directions (k, 3) from a point to places spread evenly over the solid angle of the lamp, and the solid
        angle of each."""
        arrow = self.position - point
        sine2 = min(self.radius**2 / float(arrow @ arrow), 1.0)
        z = arrow / np.linalg.norm(arrow)
        x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.7 else [0, 1.0, 0])
        x /= np.linalg.norm(x)
        k = np.arange(_POINTS)
        span = sine2 / (1 + np.sqrt(1 - sine2))  # 1 - cosine of the angle to the edge
        cosine = 1 - span * (k + 0.5) / _POINTS
        sine, turn = np.sqrt(1 - cosine**2), k * np.pi * (3 - np.sqrt(5))
        d = cosine[:, None] * z + sine[:, None] * (np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(z, x))
        return d, 2 * np.pi * span / _POINTS

    def seen(self, eye: NDArray, directions: NDArray) -> NDArray:
        """Whether rays of unit length from a place meet the lamp."""
        arrow = self.position - eye
        along = directions @ arrow
        return (along > 0) & (arrow @ arrow - along**2 < self.radius**2)


@cache
def lamp_at(distance: float) -> Lamp:
    d, angles = _directions()
    mean = (np.asarray(room().radiance(CENTRE, d), np.float64).mean(axis=-1) * angles).sum() / 4  # E over all normals
    sine2 = (RADIUS / distance) ** 2
    return Lamp(CENTRE + distance * TOWARDS, RADIUS, _STRENGTH * mean / (np.pi * sine2))


def light_from(eye: NDArray, directions: NDArray, lamp: Lamp) -> NDArray:
    """Radiance (..., 3) of the room and the lamp."""
    d = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    light = np.array(room().radiance(eye, d))
    light[lamp.seen(eye, d)] = lamp.radiance
    return light


@cache
def true_map(distance: float) -> fastibl.CubeMap:
    lamp = lamp_at(distance)
    return truth_map(lambda d: light_from(CENTRE, d, lamp), 128, 4)


@dataclass(frozen=True)
class Surface:
    """Points with normals, and what the object hides from them."""

    points: NDArray
    normals: NDArray
    bvh: fastibl.Bvh

    def hidden(self, k: int, directions: NDArray) -> NDArray:
        start = self.points[k] + 1e-4 * self.normals[k]
        return self.bvh.occluded(start.astype(np.float32), directions.astype(np.float32))

    @cached_property
    def of_room(self) -> tuple[NDArray, NDArray]:
        """Irradiance (n, 3) from the room, with the object and without."""
        d, _ = _directions()
        out = np.zeros((2, len(self.points), 3))
        for k, (p, n) in enumerate(zip(self.points, self.normals, strict=True)):
            light = room_light(p + [0, 0, 1e-4], n)
            out[0, k], out[1, k] = light[~self.hidden(k, d)].sum(axis=0), light.sum(axis=0)
        return out[0], out[1]

    def of_lamp(self, lamp: Lamp) -> tuple[NDArray, NDArray]:
        out = np.zeros((2, len(self.points), 3))
        for k, (p, n) in enumerate(zip(self.points, self.normals, strict=True)):
            d, angle = lamp.disc(p)
            light = lamp.radiance * angle * np.maximum(d @ n, 0)
            out[0, k], out[1, k] = light[~self.hidden(k, d)].sum(), light.sum()
        return out[0], out[1]


@cache
def mesh() -> fastibl.Mesh:
    return fastibl.shapes.figurine(HEIGHT)


@cache
def bvh() -> fastibl.Bvh:
    return fastibl.Bvh(mesh())


@cache
def corner_normals() -> NDArray:
    """(triangles, 3, 3): by which it is drawn, of a file's or of sharp edges as of smooth ones."""
    drawn = fastibl.Scene(mesh()).mesh
    return np.asarray(drawn.normals, np.float64)[np.asarray(drawn.triangles)]


@cache
def camera() -> tuple[fastibl.Camera, fastibl.Pose]:
    eye = np.array([0.05, -0.42, 0.24])
    return fastibl.Camera(640, 640, 1680.0, 1680.0, 320.0, 320.0), looking(CENTRE - eye, eye)


@cache
def seen() -> tuple[NDArray, Surface]:
    """Pixels (n, 2: row, column) that show the object, and the surface that they show."""
    lens, pose = camera()
    rows, columns = np.meshgrid(np.arange(lens.height), np.arange(lens.width), indexing="ij")
    pixels = np.stack([rows, columns], axis=-1).reshape(-1, 2)
    d = lens.unproject(pixels[:, ::-1] + 0.5) @ pose.rotation
    eye = np.asarray(pose.inverse().translation)
    triangle, t, uv = bvh().nearest(np.broadcast_to(eye, d.shape).astype(np.float32), d.astype(np.float32))
    hit = np.flatnonzero(triangle >= 0)
    hit = hit[np.random.default_rng(0).permutation(len(hit))[:_PIXELS]]
    weights = np.concatenate([1 - uv[hit].sum(axis=1, keepdims=True), uv[hit]], axis=1)
    normals = (corner_normals()[triangle[hit]] * weights[..., None]).sum(axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = eye + t[hit, None] * d[hit]
    return pixels[hit], Surface(points, normals, bvh())


@cache
def plane() -> Surface:
    """Points of the marker plane around the object, but not under it."""
    grid = (np.arange(36) + 0.5) / 36 * 0.56 - 0.28
    p = np.stack([*np.meshgrid(grid, grid), np.zeros((36, 36))], axis=-1).reshape(-1, 3)
    up = np.tile(np.array([0, 0, 1], np.float32), (len(p), 1))
    p = p[~bvh().occluded((p + [0, 0, 1e-5]).astype(np.float32), up)]
    return Surface(p, np.tile([0.0, 0, 1], (len(p), 1)), bvh())


_EXPONENT = 32.0  # that of the glossy object
MATTE = fastibl.Material(diffuse=(1, 1, 1))
GLOSSY = fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=_EXPONENT)


def _lobe(directions: NDArray, normal: NDArray, view: NDArray, exponent: float) -> NDArray:
    half = directions + view
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-30)
    return np.maximum(half @ normal, 0) ** exponent * np.maximum(directions @ normal, 0)


@cache
def _views() -> NDArray:
    _, pose = camera()
    _, surface = seen()
    v = np.asarray(pose.inverse().translation) - surface.points
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@cache
def _glossy_of_room(exponent: float) -> tuple[NDArray, NDArray]:
    """Sum of room times lobe (n, 3) of each pixel, with nothing hidden, and of the lobe alone (n, 1)."""
    _, surface = seen()
    d, angles = _directions(_RAYS * _SPLIT)
    sums, whole = np.zeros((len(surface.points), 3)), np.zeros((len(surface.points), 1))
    for k, (p, n, v) in enumerate(zip(surface.points, surface.normals, _views(), strict=True)):
        weight = _lobe(d, n, v, exponent) * angles
        some = weight > 1e-6 * weight.max()
        light = np.asarray(room().radiance(p + [0, 0, 1e-4], d[some].astype(np.float32), unit=True), np.float64)
        sums[k], whole[k] = weight[some] @ light, weight.sum()
    return sums, whole


def _glossy(lamp: Lamp, exponent: float = _EXPONENT) -> NDArray:
    _, surface = seen()
    room_sum, whole = _glossy_of_room(exponent)
    own = np.zeros_like(whole)
    for k, (p, n, v) in enumerate(zip(surface.points, surface.normals, _views(), strict=True)):
        d, angle = lamp.disc(p)
        own[k] = lamp.radiance * angle * _lobe(d, n, v, exponent).sum()
    return (room_sum + own) / whole


@dataclass(frozen=True)
class Errors:
    """RMS over RGB and places. irradiance, pixels, glossy: divided by the true mean; shadow: error of the ratio where
    there is any shadow.

    irradiance, glossy: of the object as if it hid nothing from itself; pixels: of the object as it is.
    """

    irradiance: float
    pixels: float
    glossy: float
    shadow: float


def _rendered(
    environment: fastibl.Environment, material: fastibl.Material, self_shadow: str, backend: str
) -> tuple[NDArray, NDArray, fastibl.ShadowMap]:
    """Radiance (n, 3) of the pixels that are seen(), whether they are wholly covered, and the shadow.

    The light is looked up as a plan for the map with self-shadow does: one without self-shadow cannot meet its budget,
    and saves time where that makes no difference any more.
    """
    lens, pose = camera()
    scene = fastibl.Scene(mesh(), material)
    methods: dict[str, str | fastibl.Method] = {"bounce": "none", "self_shadow": self_shadow}
    if self_shadow == "none":
        far = fastibl.Environment(environment.radiance, centre=CENTRE)
        planned = fastibl.Session(scene, fastibl.Rig(lens), None, far, methods={"bounce": "none"}, backend=backend)
        chosen = planned.process(fastibl.Frame(0.0, back_from_marker=pose)).plan.methods
        for step in ("diffuse", "glossy"):
            settings = getattr(chosen, f"{step}_settings")
            methods[step] = fastibl.Method(getattr(chosen, step), **{k: v for k, v in settings.items() if v >= 0})
    session = fastibl.Session(scene, fastibl.Rig(lens), None, environment, methods=methods, backend=backend)
    result = session.process(fastibl.Frame(0.0, back_from_marker=pose))
    layer, (pixels, _) = session.object, seen()
    at = pixels - [layer.y, layer.x]
    inside = np.all((at >= 0) & (at < layer.rgba.shape[:2]), axis=1)
    rgba = layer.rgba[tuple(np.where(inside[:, None], at, 0).T)]
    return rgba[:, :3], inside & (rgba[:, 3] == 1), result.shadow_map  # partly covered pixels are another matter


def _relative(light: NDArray, true: NDArray, whole: NDArray) -> float:
    return float(np.sqrt(((light - true)[whole] ** 2).mean()) / true[whole].mean())


def errors(environment: fastibl.Environment, lamp: Lamp, backend: str = "cpu") -> Errors:
    """The errors of a white object, of a glossy one, and of their shadow."""
    _, surface = seen()
    shadowed, bare = ((a + b) / np.pi for a, b in zip(surface.of_room, surface.of_lamp(lamp), strict=True))
    matte, whole, shadow = _rendered(environment, MATTE, "auto", backend)
    alone, *_ = _rendered(environment, MATTE, "none", backend)
    glossy, *_ = _rendered(environment, GLOSSY, "none", backend)
    floor = plane()
    (room_with, room_without), (lamp_with, lamp_without) = floor.of_room, floor.of_lamp(lamp)
    ratio = (room_with + lamp_with) / (room_without + lamp_without)
    shaded = (1 - ratio).max(axis=1) > 0.01
    lost = shadow.sample(floor.points[shaded, :2].astype(np.float32)) - ratio[shaded]
    return Errors(
        _relative(alone, bare, whole),
        _relative(matte, shadowed, whole),
        _relative(glossy, _glossy(lamp), whole),
        float(np.sqrt((lost**2).mean())),
    )


def environments(distance: float) -> dict[str, fastibl.Environment]:
    """The true map, with the lamp as distant and as known."""
    lamp, cube = lamp_at(distance), true_map(distance)
    place = np.array([[*lamp.position, lamp.radius]])
    return {
        "distant": fastibl.Environment(cube, centre=CENTRE),
        "near": fastibl.Environment(cube, centre=CENTRE, lights=place),
    }


@cache
def captured(distance: float) -> NDArray:
    """Lights (m, 4) that capture triangulates from 30 frames of a camera that is carried half around the object."""
    lamp = lamp_at(distance)
    lens = fastibl.Camera(320, 240, 200.0, 200.0, 160.0, 120.0)
    x, y = np.meshgrid(np.arange(640) / 2 + 0.25, np.arange(480) / 2 + 0.25)
    rays = lens.unproject(np.stack([x, y], axis=-1))
    capture = fastibl.Capture(size=64, centre=tuple(CENTRE))
    away = np.arctan2(-TOWARDS[1], -TOWARDS[0])
    for k in range(30):
        turn = away + np.radians(-70 + 140 * k / 29)
        eye = CENTRE + [0.4 * np.cos(turn), 0.4 * np.sin(turn), 0.25 + 0.05 * np.sin(k)]
        towards = lamp.position + 0.1 * distance * np.sin([k, 2.0 * k, 3.0 * k]) - eye
        pose = looking(towards, eye)
        light = light_from(eye, rays @ pose.rotation, lamp).reshape(240, 2, 320, 2, 3).mean(axis=(1, 3))
        exposure = (0.02, 0.7 / lamp.radiance)[k % 2]
        codes = np.round(lens.response.encode(np.clip(light * exposure, 0, 1)) * 255).astype(np.uint8)
        capture.add(codes, lens, pose, exposure=exposure, time=k / 15)
    return np.asarray(capture.environment().light_positions)


# Relative to the error when the lamp is taken as distant, and absolute; for lamps up to half a metre away.
_GOALS = {"irradiance": (1 / 3, 0.03), "pixels": (0.5, 0.03), "glossy": (0.5, None), "shadow": (1 / 3, 0.03)}


@row("capture", "near light")
def near_light() -> Iterator[Goal]:
    for distance in DISTANCES:
        lamp, lights = lamp_at(distance), captured(distance)
        places = {
            **environments(distance),
            "captured": fastibl.Environment(true_map(distance), centre=CENTRE, lights=lights),
        }
        found = {name: errors(e, lamp) for name, e in places.items()}
        off = min((float(np.linalg.norm(p[:3] - lamp.position)) for p in lights), default=np.inf)
        where = f"the lamp {1e3 * off:.0f} mm off" if np.isfinite(off) else "not the lamp"
        for what, (share, most) in _GOALS.items():
            far, near, own = (getattr(found[name], what) for name in ("distant", "near", "captured"))
            limit = min(share * far, most or np.inf) if distance <= 0.5 else 1.05 * far
            yield Goal(
                f"lamp at {distance:g} m, {what}: taken as distant, where it is, where capture found it",
                f"{percent(far)}, {percent(near)}, {percent(own)}",
                f"<= {percent(limit)}",
                bool(max(near, own) <= limit),
                (f"triangulated: {len(lights)} lights, {where}",),
            )


@row("capture", "near walls")
def near_walls() -> Iterator[Goal]:
    """The same room with the lamp at 1 m, with its box known or not."""
    lamp, cube = lamp_at(1.0), true_map(1.0)
    place = np.array([[*lamp.position, lamp.radius]])
    box = [(LOWER - [0, 0, 0.001]).tolist(), UPPER.tolist()]
    for exponent in (32.0, 128.0, 512.0):
        material = fastibl.Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=exponent)
        true = _glossy(lamp, exponent)
        error = {}
        known: dict[str, dict[str, Any]] = {"far": {}, "lamp": {"lights": place}, "box": {"lights": place, "box": box}}
        for name, options in known.items():
            environment = fastibl.Environment(cube, centre=CENTRE, **options)
            light, whole, _ = _rendered(environment, material, "none", "cpu")
            error[name] = _relative(light, true, whole)
        yield Goal(
            f"glossy object of exponent {exponent:g}: all taken as distant, the lamp where it is, the walls, too",
            ", ".join(percent(e) for e in error.values()),
            "each less than the one before",
            error["box"] < error["lamp"] < error["far"],
        )
