"""The light that an object keeps from itself: error by vertex compared with rays to every texel of the map, and time.

The error is that of a vertex's diffuse light: RMS over RGB, divided by the mean truth of the map and mesh, mean over
vertices. The truth is the sum over all texels of L V cos, with V by Embree towards the texel's centre from just above
the vertex. There is no plane: below the horizon the map holds the table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference

from .. import brute, inputs, measure
from ..goals import Goal, by_map, percent, row, skipped
from ..light.speed import cpu_times, in_yardsticks
from . import truth
from .sky import NO_EMBREE

JUDGED = ("spot", "teapot", "suzanne")
VERTICES = 600  # of each mesh, chosen at random
EXPONENTS = (8, 32, 128, 512)
MEAN, WORST = 0.02, 0.03
UPDATE_YARDSTICKS = 0.2 / 4  # 0.2 ms where the yardstick takes 4


@cache
def chosen(name: str) -> NDArray:
    count = len(truth.meshes()[name].vertices)
    return np.sort(np.random.default_rng(0).permutation(count)[:VERTICES])


@cache
def points(name: str) -> tuple[NDArray, NDArray]:
    """Points just above the chosen vertices, and their unit normals (v, 3), float64."""
    mesh = truth.meshes()[name]
    normals = mesh.normals[chosen(name)].astype(np.float64)
    radius = np.linalg.norm(np.ptp(mesh.vertices, axis=0)) / 2
    return mesh.vertices[chosen(name)] + 1e-4 * radius * normals, normals


def blocked(name: str, origins: NDArray, directions: NDArray) -> NDArray[np.bool_]:
    """(n,): whether each origin's ray along its direction meets the mesh. ImportError without embreex."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise ImportError(NO_EMBREE) from error
    mesh = truth.meshes()[name]
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.vertices[mesh.triangles], np.float32))
    return scene.run(origins.astype(np.float32), directions.astype(np.float32), query="OCCLUDED") >= 0


@cache
def texels() -> tuple[NDArray, NDArray]:
    size = next(iter(inputs.real_maps().values())).size
    return reference.samples(np.zeros((6, size, size, 3)))[:2]


@cache
def visibility(name: str) -> NDArray[np.bool_]:
    """(v, texels): whether each chosen vertex sees each texel; kept on disk."""
    origins, normals = points(name)
    directions, _ = texels()

    def trace() -> NDArray:
        rows = []
        for origin, normal in zip(origins, normals, strict=True):
            free = directions @ normal > 0
            up = np.flatnonzero(free)
            free[up] = ~blocked(name, np.broadcast_to(origin, (len(up), 3)), directions[up])
            rows.append(np.packbits(free))
        return np.stack(rows)

    key = ("self-shadow", directions, origins, normals, truth.meshes()[name].vertices, truth.meshes()[name].triangles)
    return np.unpackbits(brute.stored((*key, Path(__file__)), trace), axis=1)[:, : len(directions)].astype(bool)


@cache
def irradiance(name: str) -> dict[str, tuple[NDArray, NDArray]]:
    """True irradiance (v, 3) of the chosen vertices, with and without self-shadow, for each map."""
    directions, angles = texels()
    weights = np.maximum(points(name)[1] @ directions.T, 0) * angles
    radiance = {m: cube.faces.reshape(-1, 3).astype(np.float64) for m, cube in inputs.real_maps().items()}
    shadowed = weights * visibility(name)
    return {m: (shadowed @ r, weights @ r) for m, r in radiance.items()}


@cache
def lighting(map_name: str) -> fastibl.Lighting:
    return fastibl.Lighting(inputs.real_maps()[map_name])


@cache
def self_shadow(name: str, size: int = 64) -> fastibl.SelfShadow:
    mesh = truth.meshes()[name]
    if size == 0:
        return fastibl.SelfShadow.from_spheres(mesh, truth.spheres(name))
    return fastibl.SelfShadow(mesh, size=size)


def estimate(method: str, name: str, map_name: str, size: int) -> NDArray:
    """Irradiance (v, 3) of the chosen vertices, as the library computes it."""
    light = lighting(map_name)
    if method == "transfer":
        return self_shadow(name, size).irradiance(light)[chosen(name)]
    full = light.irradiance(points(name)[1])
    return full * occlusion(name)[chosen(name), None] if method == "ambient-occlusion" else full


@cache
def occlusion(name: str) -> NDArray[np.float32]:
    return fastibl.ambient_occlusion(truth.meshes()[name])


def errors(method: str, name: str, size: int = 64) -> dict[str, float]:
    """The mean over vertices, for each map."""
    return {
        m: float(brute.errors(estimate(method, name, m, size), true, true.mean()).mean())
        for m, (true, _) in irradiance(name).items()
    }


def missing() -> str:
    if not inputs.MAPS:
        return inputs.NO_MAPS
    try:
        import embreex  # noqa: F401
    except ImportError:
        return NO_EMBREE
    return "" if all(name in truth.meshes() for name in JUDGED) else f"no meshes under {inputs.SHARED}"


def _figures(means: dict[str, float]) -> str:
    worst = max(means, key=lambda m: means[m])
    return f"{percent(float(np.mean(list(means.values()))))}, worst map {percent(means[worst])} ({worst})"


@row("shadow", "self-shadow: diffuse object against rays")
def diffuse() -> Iterator[Goal]:
    what = "irradiance of the vertices with self-shadow, mean over vertices and maps"
    if reason := missing():
        yield skipped(what, reason)
        return
    for name in truth.meshes():
        means = errors("transfer", name)
        mean, worst = float(np.mean(list(means.values()))), max(means.values())
        others = {
            "none": errors("none", name),
            "P_V": errors("ambient-occlusion", name),
            "transfer, 32 cells": errors("transfer", name, 32),
            "transfer, 16 cells": errors("transfer", name, 16),
            "transfer, 50 spheres": errors("transfer", name, 0),
        }
        yield Goal(
            f"{name}: {what}",
            _figures(means),
            f"{percent(MEAN)} mean, {percent(WORST)} worst map",
            (mean <= MEAN and worst <= WORST) if name in JUDGED else None,
            (*by_map(means), *(f"{method}: {_figures(e)}" for method, e in others.items())),
        )


def eyes(name: str) -> NDArray[np.float64]:
    """Eight points (8, 3) around an object, above the plane."""
    turn = np.arange(8) * np.pi / 4
    height = np.where(np.arange(8) % 2, 0.5, 1.5)
    return np.stack([2 * np.cos(turn), 2 * np.sin(turn), height], axis=-1)


def _lobe(normal: NDArray, view: NDArray, exponent: float) -> NDArray:
    """Weights (texels,) of (n·h)^s max(n·l, 0); they sum to 1."""
    directions, angles = texels()
    half = directions + view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    weights = np.maximum(half @ normal, 0) ** exponent * np.maximum(directions @ normal, 0) * angles
    return weights / weights.sum()


@cache
def glossy_errors(name: str, exponent: float) -> dict[str, float]:
    """Error of the glossy light without shadow, with P_V, and with the lobe's free share; mean over all maps."""
    radiance = np.hstack([c.faces.reshape(-1, 3).astype(np.float64) for c in inputs.real_maps().values()])
    origins, normals = points(name)
    seen, open_, lit, found = visibility(name), [], [], []
    for eye in eyes(name):
        view = eye - origins
        view /= np.linalg.norm(view, axis=1, keepdims=True)
        towards = np.flatnonzero((view * normals).sum(axis=1) > 0)
        towards = towards[~blocked(name, origins[towards], view[towards])][::4]
        weights = np.stack([_lobe(normals[i], view[i], exponent) for i in towards])
        open_.append(weights @ radiance)
        lit.append((weights * seen[towards]) @ radiance)
        places = chosen(name)[towards]
        by_map = [self_shadow(name).glossy_shares(lighting(m), eye, exponent)[places] for m in inputs.real_maps()]
        found.append(np.stack([np.ones_like(by_map), [occlusion(name)[places]] * len(by_map), by_map]))
    full, true, shares = np.concatenate(open_), np.concatenate(lit), np.concatenate(found, axis=-1)

    def error(share: NDArray) -> float:
        """share: (maps, points)."""
        of = [slice(3 * k, 3 * k + 3) for k in range(len(share))]
        return float(
            np.mean(
                [
                    brute.errors(full[:, m] * s[:, None], true[:, m], true[:, m].mean())
                    for m, s in zip(of, share, strict=True)
                ]
            )
        )

    return {method: error(share) for method, share in zip(("none", "P_V", "transfer"), shares, strict=True)}


@row("shadow", "self-shadow: glossy light against rays")
def glossy() -> Iterator[Goal]:
    what = "glossy light with the object's own occlusion, mean over exponents 8 to 512 and maps"
    if reason := missing():
        yield skipped(what, reason)
        return
    for name in ("spot", "suzanne"):
        found = {s: glossy_errors(name, s) for s in EXPONENTS}
        means = {method: float(np.mean([e[method] for e in found.values()])) for method in ("none", "P_V", "transfer")}
        yield Goal(
            f"{name}: {what}",
            percent(means["transfer"]),
            f"better than P_V ({percent(means['P_V'])}) and none ({percent(means['none'])})",
            means["transfer"] < min(means["none"], means["P_V"]),
            tuple(
                f"exponent {s}: none {percent(e['none'])}, P_V {percent(e['P_V'])}, transfer {percent(e['transfer'])}"
                for s, e in found.items()
            ),
        )


def _bake(mesh: fastibl.Mesh, sizes: Sequence[int]) -> str:
    seconds = {n: measure.measure(lambda _, n=n: fastibl.SelfShadow(mesh, size=n), [None], 1, 0).cpu for n in sizes}
    return ", ".join(f"{s:.2f} s of {n} cells" for n, s in seconds.items())


@row("shadow", "self-shadow: time of a change of light")
def times() -> Iterator[Goal]:
    what = "shares of the irradiance after a change of light"
    if reason := missing():
        yield skipped(what, reason)
        return
    light = lighting("venice_sunset")
    with measure.one_core():
        for name in ("spot", "stanford-bunny"):
            mesh, count = truth.meshes()[name], len(truth.meshes()[name].vertices)
            default = 64 if count <= 10000 else 32  # as a Scene chooses it
            shadow, spheres = self_shadow(name, default), truth.spheres(name)
            taken = cpu_times(
                [
                    partial(shadow.shares, light),
                    partial(shadow.glossy_shares, light, (0.5, 0.2, 0.8), 64.0),
                    partial(fastibl.SelfShadow.from_spheres, mesh, spheres),
                ],
                7,
            )
            found, second = in_yardsticks(taken)
            yield Goal(
                f"{name}, {count} vertices, {default} cells: {what}",
                f"{found[0]:.3f} yardsticks ({1e3 * found[0] * second:.2f} ms)",
                f"{UPDATE_YARDSTICKS:.3g} yardsticks" if name == "spot" else "(no goal of its own)",
                bool(found[0] <= UPDATE_YARDSTICKS) if name == "spot" else None,
                (
                    f"glossy shares of another view: {1e3 * found[1] * second:.2f} ms",
                    f"directions from {len(spheres)} spheres, 16 cells: {1e3 * found[2] * second:.1f} ms",
                    f"directions from the mesh, once: {_bake(mesh, (16, default))}; "
                    f"{shadow.nbytes / count:.0f} bytes a vertex",
                ),
            )
