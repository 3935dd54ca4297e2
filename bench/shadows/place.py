"""The object in its place: one bounce of light to and from the plane, compared with rays, and its time.

The truth is for a matte object of albedo 0.8. Its light at each vertex is the sum over directions of what the map has
there, times the true shadow ratio where a ray meets the plane. The light that it sends to the plane is the sum over the
rays from a point of the plane that meet it. Visibility is Embree's; sums are in float64. In large meshes, some vertices
stand for those near them. As in the product, light goes each way once, and parts of the object send each other none.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.comparison import level_at_most

from .. import inputs, measure
from ..brute import Part, stored
from ..goals import Goal, by_map, percent, row, skipped
from ..light.speed import cpu_times, in_yardsticks
from . import truth
from .sky import ABOVE, NO_EMBREE, rays

ALBEDO = 0.8
VERTICES = 3000  # of each mesh, at most
POINTS = 48  # of the plane along an edge, over the extent of the truth's grid
SIZE = 32  # face edge of the level whose texels are the directions
PLANE, OBJECT, WORST = 0.1, 0.02, 0.04


def _directions() -> tuple[NDArray, NDArray]:
    return reference.samples(np.zeros((6, SIZE, SIZE, 3)))[:2]


@cache
def chosen(name: str) -> NDArray:
    """The vertices whose light is computed."""
    count = len(truth.meshes()[name].vertices)
    return np.arange(0, count, -(-count // VERTICES))


@cache
def points() -> NDArray:
    return truth.grid(POINTS)


def _nearest_chosen(name: str) -> NDArray:
    """For each vertex, the number of the chosen one that is nearest and faces the same side."""
    mesh, some = truth.meshes()[name], chosen(name)
    if len(some) == len(mesh.vertices):
        return some
    places = np.hstack([mesh.vertices, 0.1 * mesh.normals])
    out = np.empty(len(places), int)
    for i in range(0, len(places), 512):
        out[i : i + 512] = ((places[i : i + 512, None] - places[some]) ** 2).sum(axis=-1).argmin(axis=1)
    return out


@cache
def true_bounce(name: str) -> tuple[NDArray, NDArray, NDArray]:
    """Irradiance of the chosen vertices without and with the shadow below (v, lights, 3), and what the object adds to
    the plane's light, divided by the light without it (points, lights, 3); kept on disk. ImportError without
    embreex."""
    mesh, lights = truth.meshes()[name], truth.lights()
    ratios = np.stack([truth.mesh_truth(name, light) for light in lights], axis=1)
    levels = [level_at_most(light.cube, SIZE) for light in lights.values()]
    key: list[Part] = ["bounce", mesh.vertices, mesh.triangles, ratios, *levels, Path(__file__)]
    made = stored(key, lambda: _true_bounce(name, ratios, levels))
    count = len(chosen(name))
    return made[:count], made[count : 2 * count], made[2 * count :]


def _true_bounce(name: str, ratios: NDArray, levels: list[NDArray]) -> NDArray:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise ImportError(NO_EMBREE) from error
    mesh, some = truth.meshes()[name], chosen(name)
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.vertices[mesh.triangles], np.float32))
    d, angle = _directions()
    flux = np.stack([np.asarray(level, np.float64).reshape(-1, 3) * angle[:, None] for level in levels], axis=1)
    lost = np.ascontiguousarray((1 - ratios).reshape(truth.POINTS, truth.POINTS, -1), np.float32)
    down = np.flatnonzero(d[:, 2] < 0)
    radius = np.linalg.norm(np.ptp(mesh.vertices, axis=0)) / 2
    plain, shadowed = (np.empty((len(some), len(levels), 3)) for _ in range(2))
    for k, v in enumerate(some):
        n = mesh.normals[v].astype(np.float64)
        origin = mesh.vertices[v] + 1e-4 * radius * n
        towards = np.flatnonzero(d @ n > 0)
        starts = np.broadcast_to(origin.astype(np.float32), (len(towards), 3)).copy()
        free = scene.run(starts, d[towards].astype(np.float32), query="OCCLUDED") < 0
        weight = np.zeros(len(d))
        weight[towards[free]] = d[towards[free]] @ n
        plain[k] = np.tensordot(weight, flux, 1)
        below = down[weight[down] > 0]
        at = origin[:2] - max(origin[2], 0) / d[below, 2:] * d[below, :2]
        at = np.clip((at / truth.EXTENT + 1) / 2 * truth.POINTS - 0.5, -9, truth.POINTS + 9).astype(np.float32)
        taken = _bilinear(lost, at).reshape(len(below), len(levels), 3)
        shadowed[k] = plain[k] - (weight[below, None, None] * flux[below] * taken).sum(axis=0)
    of_vertex = shadowed[_nearest_chosen(name)] if len(some) < len(mesh.vertices) else shadowed
    sent = ALBEDO / np.pi * of_vertex[mesh.triangles].mean(axis=1)  # radiance of each triangle
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    facing = np.cross(b - a, c - a)
    up = np.flatnonzero(d[:, 2] > 0)
    total = np.maximum((flux[up] * d[up, 2][:, None, None]).sum(axis=0), 1e-300)
    added = np.zeros((len(points()), len(levels), 3))
    for k, point in enumerate(points()):
        origin = np.array([*point, ABOVE], np.float32)
        met = scene.run(np.broadcast_to(origin, (len(up), 3)).copy(), d[up].astype(np.float32))
        hit = np.flatnonzero(met >= 0)
        hit = hit[(facing[met[hit]] * d[up[hit]]).sum(axis=1) < 0]
        weight = d[up[hit], 2] * angle[up[hit]]
        added[k] = np.tensordot(weight, sent[met[hit]], 1) / total
    return np.concatenate([plain, shadowed, added])


def _bilinear(image: NDArray, at: NDArray) -> NDArray:
    """(n, channels) at texel positions (n, 2); 0 outside."""
    if not len(at):
        return np.zeros((0, image.shape[2]), np.float32)
    channels = [
        cv2.remap(
            np.ascontiguousarray(image[..., k : k + 3]),
            at[:, None, 0],
            at[:, None, 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
        )  # fmt: skip
        for k in range(0, image.shape[2], 3)
    ]
    return np.concatenate(channels, axis=-1)[:, 0]


@cache
def scene_of(name: str) -> fastibl.Scene:
    return fastibl.Scene(truth.meshes()[name], fastibl.Material(diffuse=(ALBEDO,) * 3))


@cache
def baked(name: str) -> fastibl.MeshShadow:
    return fastibl.MeshShadow(truth.meshes()[name])


def _missing() -> str:
    if not inputs.MAPS or len(truth.meshes()) < len(truth.MESHES):
        return inputs.NO_MAPS
    try:
        import embreex  # noqa: F401
    except ImportError:
        return NO_EMBREE
    return ""


def measured(name: str) -> dict[str, tuple[float, float, float, float]]:
    """By light: the error of the object's light with and without the bounce, divided by its mean; the error of what the
    object adds to the plane outside its footprint, and the size of that, RMS of the ratio of light."""
    _, shadowed, added = true_bounce(name)
    bounce, scene = fastibl.Bounce(scene_of(name)), scene_of(name)
    normals, own = scene.mesh.normals[chosen(name)], fastibl.SelfShadow(scene.mesh)
    origins = np.pad(points(), ((0, 0), (0, 1)), constant_values=ABOVE).astype(np.float32)
    up = np.tile(np.array([0, 0, 1], np.float32), (len(origins), 1))
    outside = ~fastibl.Bvh(scene.mesh).occluded(origins, up)
    found = {}
    for k, (light, given) in enumerate(truth.lights().items()):
        lighting, shadow = fastibl.Lighting(given.cube), baked(name).cast(given.cube)
        bounce.update(lighting, shadow)
        irradiance, true = lighting.irradiance(normals), shadowed[:, k]
        with_bounce, without = (
            float(np.sqrt(((share[chosen(name)] * irradiance - true) ** 2).mean(axis=-1)).mean() / true.mean())
            for share in (bounce.shares, own.shares(lighting))
        )
        made = bounce.plane_gain.sample(points()) - shadow.sample(points())
        off = float(np.sqrt(((made - added[:, k])[outside] ** 2).mean()))
        found[light] = (with_bounce, without, off, float(np.sqrt((added[outside, k] ** 2).mean())))
    return found


@row("shadow", "place: one bounce against rays")
def against_rays() -> Iterator[Goal]:
    if missing := _missing():
        yield skipped("one bounce against rays", missing)
        return
    for name in truth.JUDGED:
        found = measured(name)
        means = np.mean(list(found.values()), axis=0)
        real = {light: v for light, v in found.items() if light in inputs.MAPS}
        worst = max(found, key=lambda light: found[light][0])
        yield Goal(
            f"{name}: light of a matte object with what its shadow takes from below, mean over vertices and 10 lights",
            f"{percent(means[0])} (without the bounce {percent(means[1])}); worst {percent(found[worst][0])}, {worst}",
            f"{percent(OBJECT)}; worst {percent(WORST)}",
            bool(means[0] <= OBJECT and found[worst][0] <= WORST),
            by_map({light: v[0] for light, v in real.items()}),
        )
        share = means[2] / means[3]
        yield Goal(
            f"{name}: light that the object sends to the plane, RMS over the grid, by its size",
            f"{percent(share)} of {means[3]:.4f} (without the bounce 100 %)",
            percent(PLANE),
            bool(share <= PLANE),
            by_map({light: v[2] / v[3] for light, v in real.items()}),
        )


@row("shadow", "place: time of one bounce")
def times() -> Iterator[Goal]:
    if missing := _missing():
        yield skipped("time of one bounce", missing)
        return
    cube = truth.lights()["venice_sunset"].cube
    with measure.one_core():
        for name in truth.JUDGED:
            scene = scene_of(name)
            bounce, lighting, shadow = fastibl.Bounce(scene), fastibl.Lighting(cube), baked(name).cast(cube)
            own = fastibl.SelfShadow(scene.mesh, size=64 if len(scene.mesh.vertices) <= 10000 else 32)
            taken = cpu_times(
                [
                    partial(bounce.update, lighting, shadow),
                    partial(own.shares, lighting),
                    partial(fastibl.Bounce, scene),
                ],
                7,
            )
            found, second = in_yardsticks(taken)
            less = found[0] - found[1]
            yield Goal(
                f"{name}, {len(scene.mesh.vertices)} vertices: both ways and the plane's map, after a change of light",
                f"{less:.3f} yardsticks ({1e3 * less * second:.2f} ms)",
                "(no goal of its own)",
                None,
                (f"form factors, where the object is new, tilted or lifted: {1e3 * found[2] * second:.0f} ms",),
            )


# Real objects

_FACE = (-0.55, 0.35, 1.0, 0.62)  # of a wall behind the object: x from, x to, height, y; the object's extent is 1
RATIO, RATIO_WORST = 0.02, 0.06


def _wall() -> fastibl.Mesh:
    x0, x1, z, y = _FACE
    return fastibl.Mesh(np.array([(x0, y, 0), (x1, y, 0), (x1, y, z), (x0, y, z)]), np.array([(0, 1, 2), (0, 2, 3)]))


def _wall_points() -> NDArray:
    x0, x1, z, _ = _FACE
    a = (np.arange(24) + 0.5) / 24
    x, height = np.meshgrid(x0 + (x1 - x0) * a, z * a)
    return np.stack([x, np.full_like(x, _FACE[3]), height], axis=-1).reshape(-1, 3)


def _true_on_wall(name: str, levels: list[NDArray]) -> NDArray:
    """(points, lights, 3) by rays to every texel of a level of the maps."""
    meet = rays(truth.meshes()[name])
    d, angle = reference.samples(np.zeros((6, 64, 64, 3)))[:2]
    towards = np.flatnonzero(d[:, 1] < 0)
    d, weight = d[towards].astype(np.float32), -(d[:, 1] * angle)[towards]
    flux = np.stack([np.asarray(level, np.float64).reshape(-1, 3)[towards] for level in levels], axis=1)
    flux *= weight[:, None, None]
    out = []
    for point in _wall_points() - (0, ABOVE, 0):
        met = meet(point, d)
        out.append(1 - flux[met].sum(axis=0) / np.maximum(flux.sum(axis=0), 1e-300))
    return np.array(out)


@cache
def _behind(name: str) -> fastibl.Scene:
    scene = fastibl.Scene(truth.meshes()[name])
    scene.holdouts = [_wall()]
    return scene


def wall_ratios(name: str, cube: fastibl.CubeMap) -> NDArray:
    """(points, 3): what the session draws there."""
    scene = _behind(name)
    x0, x1, z, y = _FACE
    # The camera looks straight at the wall from in front of it, so near that the object is behind the camera.
    camera = fastibl.Camera(240, 240, 240 / (x1 - x0) * 0.05, 240 / z * 0.05, 120, 120)
    eye = np.array([(x0 + x1) / 2, y - 0.05, z / 2])
    pose = np.eye(4)
    pose[:3, :3] = (1, 0, 0), (0, 0, -1), (0, 1, 0)
    pose[:3, 3] = -pose[:3, :3] @ eye
    session = fastibl.Session(scene, fastibl.Rig(camera), environment=cube)
    session.process(fastibl.Frame(0.0, back_from_marker=fastibl.Pose(pose)))
    layer = session.holdout
    pixel = np.floor(camera.project((_wall_points() - eye) @ pose[:3, :3].T)).astype(int)
    return layer.rgba[pixel[:, 1] - layer.y, pixel[:, 0] - layer.x, :3]


@row("shadow", "place: shadow on a real object against rays")
def on_a_wall() -> Iterator[Goal]:
    if missing := _missing():
        yield skipped("shadow on a real object against rays", missing)
        return
    lights = truth.lights()
    levels = [level_at_most(light.cube, 64) for light in lights.values()]
    for name in truth.JUDGED:
        mesh = truth.meshes()[name]
        key: list[Part] = ["wall", mesh.vertices, mesh.triangles, np.array(_FACE), *levels, Path(__file__)]
        true = stored(key, partial(_true_on_wall, name, levels))
        found = {
            light: truth.errors(wall_ratios(name, given.cube), true[:, k])
            for k, (light, given) in enumerate(lights.items())
        }
        soft = [found[light].rms for light in found if lights[light].soft]
        worst = max(found, key=lambda light: found[light].rms)
        yield Goal(
            f"{name}: ratio on a wall behind it, RMS, mean of the soft lights; worst of all",
            f"{np.mean(soft):.4f}; {found[worst].rms:.4f}, {worst}",
            f"{RATIO}; {RATIO_WORST}",
            bool(np.mean(soft) <= RATIO and found[worst].rms <= RATIO_WORST),
            ("by light: " + ", ".join(f"{light} {e.rms:.4f} ({e.worst:.2f})" for light, e in found.items()),),
        )
