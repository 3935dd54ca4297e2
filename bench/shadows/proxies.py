"""What stands in for an object: spheres for its shadow, P_V for its self-shadow."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl

from .. import inputs, measure
from ..goals import Goal, by_map, percent, row, skipped
from . import truth
from .plane import ratio

_YARDSTICK_MS = 4.0  # of the machine on which goals in milliseconds were set
_VIEWS, _PIXELS = 24, 128
_RAYS = 1024  # rays per vertex, for the true P_V
_VERTICES = 1000  # vertices of a mesh, for the error of P_V
_FINE = 512  # points along an edge of the plane, to find where a hard edge lies
_NO_MESHES = "no meshes beside the project"


def _yardsticks(call, repetitions: int = 5) -> tuple[float, float]:
    """Least CPU seconds of a call, and the same in yardsticks that were measured in between."""
    times, sticks = [], []
    for _ in range(repetitions):
        sticks.append(measure.yardstick(5).cpu)
        times.append(measure.measure(lambda _: call(), [None], 1, 0).cpu)
    return min(times), min(times) / min(sticks)


# Spheres


@row("shadow", "fit_spheres: time")
@measure.one_core()
def fit_time() -> Iterator[Goal]:
    if not truth.meshes():
        yield skipped("time of fit_spheres", _NO_MESHES)
        return
    for name, mesh in truth.meshes().items():
        seconds, sticks = _yardsticks(lambda mesh=mesh: fastibl.fit_spheres(mesh, 50))
        limit = 500 / _YARDSTICK_MS
        yield Goal(
            f"50 spheres for {name}, {len(mesh.triangles)} triangles",
            f"{seconds:.3f} s, {sticks:.0f} yardsticks",
            f"<= {limit:.0f} yardsticks (0.5 s)",
            sticks <= limit,
        )


def damaged(mesh: fastibl.Mesh, damage: str) -> fastibl.Mesh:
    """A mesh whose triangles are missing or flipped at random, or that lacks 40 % of those in its upper half."""
    rng, triangles = np.random.default_rng(0), mesh.triangles.copy()
    chance = rng.random(len(triangles))
    if damage == "half flipped":
        triangles[chance < 0.5] = triangles[chance < 0.5, ::-1]
    elif damage == "40 % of the upper half missing":
        heights = mesh.vertices[triangles].mean(axis=1)[:, 2]
        triangles = triangles[(heights < 0.5 * mesh.vertices[:, 2].max()) | (chance >= 0.4)]
    else:
        triangles = triangles[chance >= {"10 % missing": 0.1, "30 % missing": 0.3}[damage]]
    return fastibl.Mesh(mesh.vertices, triangles)


DAMAGES = ("10 % missing", "30 % missing", "half flipped", "40 % of the upper half missing")


def views() -> NDArray[np.float64]:
    """(24, 3) directions of the upper hemisphere, cosine-distributed."""
    k = np.arange(_VIEWS)
    z, turn = np.sqrt(1 - (k + 0.5) / _VIEWS), k * np.pi * (3 - 5**0.5)
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=-1)


def _across(d: NDArray) -> tuple[NDArray, NDArray]:
    t = np.cross(d, [1, 0, 0] if abs(d[0]) < 0.7 else [0, 1, 0])
    t /= np.linalg.norm(t)
    return t, np.cross(d, t)


@cache
def outlines(name: str) -> tuple[NDArray, float, list[NDArray]]:
    """Middle and reach of the pictures of a mesh from `views`, and the pictures (128, 128) bool."""
    mesh = truth.meshes()[name]
    lower, upper = mesh.vertices.min(axis=0).astype(float), mesh.vertices.max(axis=0).astype(float)
    middle, reach = (lower + upper) / 2, 0.525 * float(np.linalg.norm(upper - lower))
    bvh, axis = fastibl.Bvh(mesh), ((np.arange(_PIXELS) + 0.5) / _PIXELS * 2 - 1) * reach
    pictures = []
    for d in views():
        t, b = _across(d)
        origins = (middle - 2 * reach * d + axis[:, None, None] * t + axis[:, None] * b).astype(np.float32)
        pictures.append(bvh.occluded(origins, np.broadcast_to(d.astype(np.float32), origins.shape).copy()))
    return middle, reach, pictures


def outline_error(name: str, spheres: NDArray) -> float:
    """Area of the symmetric difference from the outline of the whole mesh, divided by the outline's area; mean over
    `views`."""
    middle, reach, pictures = outlines(name)
    axis, errors = ((np.arange(_PIXELS) + 0.5) / _PIXELS * 2 - 1) * reach, []
    for d, picture in zip(views(), pictures, strict=True):
        at = (spheres[:, :3].astype(float) - middle) @ np.stack(_across(d), axis=1)
        covered = np.zeros_like(picture)
        for (x, y), r in zip(at, spheres[:, 3].astype(float), strict=True):
            covered |= ((axis - x) ** 2)[:, None] + (axis - y) ** 2 < r * r
        errors.append((covered != picture).sum() / picture.sum())
    return float(np.mean(errors))


@row("shadow", "fit_spheres: silhouettes")
def silhouettes() -> Iterator[Goal]:
    if not truth.meshes():
        yield skipped("silhouettes of spheres", _NO_MESHES)
        return
    for name, mesh in truth.meshes().items():
        whole = outline_error(name, truth.spheres(name))
        torn = {damage: outline_error(name, fastibl.fit_spheres(damaged(mesh, damage), 50)) for damage in DAMAGES}
        judged = name == "spot"
        yield Goal(
            f"silhouettes of 50 spheres for {name}: whole, 30 % of the triangles missing",
            f"{percent(whole)}, {percent(torn['30 % missing'])}",
            "<= 5 %, <= 5 %" if judged else "(no goal of its own)",
            max(whole, torn["30 % missing"]) <= 0.05 if judged else None,
            ("; ".join(f"{damage} {percent(e)}" for damage, e in torn.items()),),
        )


def edge_displacement(name: str) -> tuple[float, float]:
    """Mean and 95th percentile of the distance between the edges of the sun's shadow from spheres and from the mesh."""
    points = truth.grid(_FINE)
    elevation, azimuth = np.radians(35), np.radians(140)
    d = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    origins = np.pad(points, ((0, 0), (0, 1)), constant_values=1e-5).astype(np.float32)
    of_mesh = fastibl.Bvh(truth.meshes()[name]).occluded(
        origins, np.broadcast_to(d.astype(np.float32), origins.shape).copy()
    )
    of_spheres = np.zeros(len(points), bool)
    for *centre, r in truth.spheres(name).astype(float):
        away: NDArray = np.array(centre) - np.pad(points, ((0, 0), (0, 1)))
        along = away @ d
        of_spheres |= ((away**2).sum(axis=1) - along**2 < r * r) & (along > 0)
    edges = []
    for shadow in (of_mesh, of_spheres):
        picture = shadow.reshape(_FINE, _FINE).astype(np.uint8)
        edges.append(cv2.morphologyEx(picture, cv2.MORPH_GRADIENT, np.ones((2, 2), np.uint8)) > 0)
    off = []
    for one, other in (edges, edges[::-1]):
        distance = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        off.append(distance[one] * 2 * truth.EXTENT / _FINE)
    both = np.concatenate(off)
    return float(both.mean()), float(np.percentile(both, 95))


@row("shadow", "50 spheres against the mesh: hard edges")
def hard_edges() -> Iterator[Goal]:
    if not truth.meshes():
        yield skipped("displacement of hard edges", _NO_MESHES)
        return
    for name in truth.meshes():
        mean, far = edge_displacement(name)
        yield Goal(
            f"displacement of the sun's shadow edges, {name}, mean, of the object's size",
            percent(mean),
            "<= 2 %",
            mean <= 0.02,
            (f"95th percentile {percent(far)}; sun at 35 degrees",),
        )


@row("shadow", "50 spheres against the mesh: ratio")
def against_the_mesh() -> Iterator[Goal]:
    if not truth.meshes() or not inputs.MAPS:
        yield skipped("ratio of 50 spheres against the mesh", _NO_MESHES if inputs.MAPS else inputs.NO_MAPS)
        return
    for name in truth.meshes():
        exact, errors = {}, {}
        for light_name, light in truth.lights().items():
            try:
                true = truth.mesh_truth(name, light_name)
            except ImportError:
                yield skipped("ratio of 50 spheres against the mesh", truth.NO_EMBREE)
                return
            spheres = truth.spheres(name)
            exact[light_name] = truth.errors(truth.sphere_truth(spheres, light_name), true).rms
            errors[light_name] = truth.errors(ratio(light.cube, spheres, truth.grid(), 256), true).rms
        thin = name in ("stanford-bunny", "suzanne")
        for kind, limit in (("soft", 0.015 if thin else 0.008), ("hard", 0.03)):
            chosen = {k: e for k, e in errors.items() if truth.lights()[k].soft == (kind == "soft")}
            if not chosen:
                continue
            worst = max(chosen, key=lambda light: chosen[light])
            judged = name in truth.JUDGED
            yield Goal(
                f"50 spheres, K = 256, against {name}{' (thin parts)' if thin else ''}, {kind} lights, worst RMS",
                f"{chosen[worst]:.4f} ({worst})",
                f"<= {limit}" if judged else "(no goal of its own)",
                chosen[worst] <= limit if judged else None,
                (
                    "by light: " + ", ".join(f"{k} {e:.4f}" for k, e in chosen.items()),
                    by_map(chosen)[1],
                    "of the spheres alone, their shadow taken as exact: "
                    + ", ".join(f"{k} {exact[k]:.4f}" for k in chosen),
                ),
            )


# P_V


@cache
def true_visibility(name: str) -> tuple[NDArray, NDArray]:
    """Some vertices (1000,) of a mesh, and their P_V by stratified random rays, cosine-distributed."""
    mesh, rng = truth.meshes()[name], np.random.default_rng(0)
    vertices, normals = mesh.vertices, mesh.normals.astype(float)
    chosen = rng.choice(len(vertices), min(_VERTICES, len(vertices)), replace=False)
    bvh, radius = fastibl.Bvh(mesh), np.linalg.norm(np.ptp(vertices, axis=0)) / 2
    values = []
    for i in chosen:
        k = np.arange(_RAYS)
        r, turn = np.sqrt((k + rng.random(_RAYS)) / _RAYS), 2 * np.pi * (k * 0.6180339887498949 + rng.random())
        t, b = _across(normals[i])
        d = (r * np.cos(turn))[:, None] * t + (r * np.sin(turn))[:, None] * b + np.sqrt(1 - r * r)[:, None] * normals[i]
        origin = np.broadcast_to((vertices[i] + 1e-4 * radius * normals[i]).astype(np.float32), d.shape)
        values.append(1 - bvh.occluded(origin.copy(), d.astype(np.float32)).mean())
    return chosen, np.array(values)


@row("shadow", "P_V: error and time")
@measure.one_core()
def visibility() -> Iterator[Goal]:
    if not truth.meshes():
        yield skipped("P_V", _NO_MESHES)
        return
    for name, mesh in truth.meshes().items():
        chosen, true = true_visibility(name)
        off = fastibl.ambient_occlusion(mesh)[chosen] - true
        by_spheres = fastibl.ambient_occlusion(mesh, 64, spheres=truth.spheres(name))[chosen] - true
        error = float(np.sqrt((off**2).mean()))
        scale = 1e4 / len(mesh.vertices)
        seconds, sticks = (v * scale for v in _yardsticks(lambda mesh=mesh: fastibl.ambient_occlusion(mesh)))
        fast, _ = _yardsticks(lambda mesh=mesh, name=name: fastibl.ambient_occlusion(mesh, 64, truth.spheres(name)))
        limit = 200 / _YARDSTICK_MS
        yield Goal(
            f"P_V of {name} from the mesh: RMS; 10 k vertices",
            f"{error:.4f}; {seconds:.3f} s, {sticks:.1f} yardsticks",
            f"<= 0.012; <= {limit:.0f} yardsticks (0.2 s)",
            error <= 0.012 and sticks <= limit,
            (
                f"largest {np.abs(off).max():.3f}; without P_V {np.sqrt(((1 - true) ** 2).mean()):.3f}; the tree is "
                "built each time",
                f"50 spheres: RMS {np.sqrt((by_spheres**2).mean()):.4f}, 10 k vertices {1e3 * fast * scale:.1f} ms",
            ),
        )
