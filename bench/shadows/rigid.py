"""The baked shadow of a rigid mesh: error compared with rays, time of a change of light and of a bake, steadiness,
memory."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

import fastibl

from .. import inputs, measure
from ..goals import Goal, largest, row, skipped
from ..light.speed import cpu_times
from . import truth

_MEAN, _EACH, _WORST = 0.003, 0.006, 0.04


def _missing() -> str:
    return "" if inputs.MAPS and all(m in truth.meshes() for m in truth.JUDGED) else inputs.NO_MAPS


def fresh(mesh: str, resolution: int) -> fastibl.MeshShadow:
    """A shadow that has followed no light yet."""
    return fastibl.MeshShadow(truth.meshes()[mesh], resolution, extent=truth.EXTENT, progress=False)


baked = cache(fresh)


@cache
def _map(mesh: str, light: str, resolution: int, directions: int = 128) -> fastibl.ShadowMap:
    shadow = baked(mesh, resolution)
    if directions != 128:
        shadow = fastibl.MeshShadow(
            truth.meshes()[mesh], resolution, extent=truth.EXTENT, directions=directions, progress=False
        )
    return shadow.cast(truth.lights()[light].cube)


def _ratio(mesh: str, light: str, resolution: int, directions: int = 128) -> NDArray:
    """The ratio at the truth's points, which are texel centres of a map of 64, or of 192, texels."""
    return _map(mesh, light, resolution, directions).sample(truth.grid())


def _errors(mesh: str, resolution: int, directions: int = 128) -> dict[str, truth.Errors]:
    return {
        light: truth.errors(_ratio(mesh, light, resolution, directions), truth.mesh_truth(mesh, light))
        for light in truth.lights()
    }


def _by_light(mesh: str, errors: dict[str, truth.Errors]) -> str:
    parts = ", ".join(f"{light} {e.rms:.4f}/{e.worst:.3f}" for light, e in errors.items())
    return f"{mesh}: mean {np.mean([e.rms for e in errors.values()]):.4f}; RMS/max {parts}"


@row("shadow", "rigid mesh: error against rays")
def error() -> Iterator[Goal]:
    if _missing():
        yield skipped("rigid path against the mesh", _missing())
        return
    try:
        found = {mesh: _errors(mesh, truth.POINTS) for mesh in truth.JUDGED}
    except ImportError as reason:
        yield skipped("rigid path against the mesh", str(reason))
        return
    every = [e for by_light in found.values() for e in by_light.values()]
    mean, each, worst = float(np.mean([e.rms for e in every])), max(e.rms for e in every), max(e.worst for e in every)
    yield Goal(
        "rigid path against the mesh, whole grid: RMS mean / worst light / max",
        f"{mean:.4f} / {each:.4f} / {worst:.3f}",
        f"<= {_MEAN} / {_EACH} / {_WORST}",
        bool(mean <= _MEAN and each <= _EACH and worst <= _WORST),
        tuple(_by_light(mesh, errors) for mesh, errors in found.items()),
    )
    for resolution, directions, what in (
        (192, 128, "texels of 192^2, of which every third is a point of the grid"),
        (128, 128, "128^2, bilinear between texels: the sharp edges of suns and lamps are lost"),
        (256, 128, "256^2, bilinear"),
        (64, 0, "no directions for lights"),
        (64, 64, "64 directions"),
        (64, 256, "256 directions"),
    ):
        found = {mesh: _errors(mesh, resolution, directions) for mesh in truth.JUDGED}
        every = [e for by_light in found.values() for e in by_light.values()]
        yield Goal(
            f"the same, {what}",
            f"{np.mean([e.rms for e in every]):.4f} / {max(e.rms for e in every):.4f} / "
            f"{max(e.worst for e in every):.3f}",
            "for information",
            None,
            tuple(_by_light(mesh, errors) for mesh, errors in found.items()),
        )


def _follow(shadow: fastibl.MeshShadow, cubes: Iterator[fastibl.CubeMap]) -> None:
    shadow.cast(next(cubes), follow=True)


@row("shadow", "rigid mesh: a map of its own for a sun")
def fine_map() -> Iterator[Goal]:
    """Errors between texels, under the compact lights; the others have no such map and stay as they are."""
    if _missing():
        yield skipped("a map of its own for a sun", _missing())
        return
    names = ("dawn and sun", "studio_small_03")
    found: dict[int, list[truth.Errors]] = {}
    times: dict[int, float] = {}
    for fine in (0, 256, 512):
        for mesh in truth.JUDGED:
            shadow = fastibl.MeshShadow(truth.meshes()[mesh], extent=truth.EXTENT, fine=fine, progress=False)
            for name in names:
                cube = truth.lights()[name].cube
                off = truth.errors(shadow.cast(cube).sample(truth.grid()), truth.mesh_truth(mesh, name))
                found.setdefault(fine, []).append(off)
                cubes = itertools.cycle([cube, fastibl.CubeMap(cube.faces * np.float32(1.01))])
                shadow.cast(cube, follow=True)
                with measure.one_core():
                    time_, yard = np.median(cpu_times([partial(_follow, shadow, cubes)], 7), axis=0)
                times[fine] = max(times.get(fine, 0), 4 * time_ / yard)
    rms = {fine: max(e.rms for e in some) for fine, some in found.items()}
    yield Goal(
        "rigid path, 128^2, bilinear, sun and studio: largest RMS with a fine map of 512^2 where their shadow falls",
        f"{rms[512]:.4f}",
        "for information",
        None,
        tuple(
            f"fine map of {fine}^2: " * (fine > 0)
            + "none: " * (fine == 0)
            + f"largest RMS {rms[fine]:.4f}, largest {max(e.worst for e in found[fine]):.3f}; a change of the light "
            f"{times[fine]:.2f} ms of a 4.0 ms yardstick"
            for fine in found
        ),
    )


@row("shadow", "rigid mesh: error where a shadow is seen")
def seen() -> Iterator[Goal]:
    if _missing():
        yield skipped("rigid path, visible shadow", _missing())
        return
    try:
        found = {
            mesh: {
                light: truth.errors_in_shadow(
                    _ratio(mesh, light, truth.POINTS), truth.mesh_truth(mesh, light), truth.covered(mesh)
                )
                for light in truth.lights()
            }
            for mesh in truth.JUDGED
        }
    except ImportError as reason:
        yield skipped("rigid path, visible shadow", str(reason))
        return
    every = [e for by_light in found.values() for e in by_light.values()]
    yield Goal(
        "rigid path, points outside the footprint where 1 - ratio > 0.01: RMS mean / worst light / max",
        f"{np.mean([e.rms for e in every]):.4f} / {max(e.rms for e in every):.4f} / {max(e.worst for e in every):.3f}",
        "for information",
        None,
        tuple(_by_light(mesh, errors) for mesh, errors in found.items()),
    )


@row("shadow", "rigid mesh: time of a light change")
def change() -> Iterator[Goal]:
    """Time from the cube map to the shadow map; the directions stay, as they do from frame to frame."""
    if _missing():
        yield skipped("light change at 128^2", _missing())
        return
    values, first, notes = [], [], []
    for mesh in truth.JUDGED:
        for name, light in truth.lights().items():
            shadow = fresh(mesh, 128)
            faces = light.cube.faces
            cubes = [fastibl.CubeMap(faces * np.float32(1 + 0.01 * k) * [1, 1, 1 - 0.002 * k]) for k in range(4)]
            turn = iter(range(1 << 30))

            def step(shadow=shadow, cubes=cubes, turn=turn):
                return shadow.cast(cubes[next(turn) % len(cubes)], follow=True)

            with measure.one_core():
                begin = time.thread_time()
                step()
                first.append(time.thread_time() - begin)
                times = cpu_times([step], 15)
            values.append(np.median(times[:, 0] / times[:, 1]))
            notes.append(f"{mesh}, {name}: {4 * values[-1]:.2f} ms, {1e3 * first[-1]:.1f} ms with new directions")
    worst = max(values)
    yield Goal(
        "rigid path, change of the light at 128^2: mean / worst light and mesh",
        f"{4 * np.mean(values):.2f} / {4 * worst:.2f} ms of a 4.0 ms yardstick",
        "<= 0.5 ms (0.125 yardsticks)",
        bool(worst <= 0.125),
        (f"CPU medians from Python, cube map to shadow map; {worst:.3f} yardsticks at worst", *notes),
    )


@row("shadow", "rigid mesh: flicker")
def steadiness() -> Iterator[Goal]:
    """Light that changes by 2 % from step to step, unevenly over the sky. The truth for the change comes from the same
    method, with a new choice of many directions."""
    if _missing():
        yield skipped("rigid path, flicker", _missing())
        return
    squares, most, count = [], [], 0
    mesh = truth.meshes()["spot"]
    for light in truth.lights(128).values():
        shadow = fresh("spot", truth.POINTS)
        exact = fastibl.MeshShadow(mesh, truth.POINTS, extent=truth.EXTENT, rings=16, directions=1024, progress=False)
        size = light.cube.size
        d = fastibl.texel_directions(size)
        before = None
        for k in range(30):
            gain = 1 + 0.02 * np.sin(0.7 * k + 3 * d[..., :1] + 2 * d[..., 1:2])
            cube = fastibl.CubeMap((light.cube.faces * gain).astype(np.float32))
            now = shadow.cast(cube, follow=True).image, exact.cast(cube, follow=True).image
            if before is not None:
                off = (now[0] - before[0]) - (now[1] - before[1])
                squares.append(np.sqrt((off**2).mean()))
                most.append(np.abs(off).max())
            before = now
        count += 1
    rms, worst = largest(squares), largest(most)
    yield Goal(
        "rigid path, flicker: error of the change under a 2 % change of the light, RMS / max",
        f"{rms:.5f} / {worst:.4f}",
        "<= 0.0005 / 0.003",
        bool(rms <= 0.0005 and worst <= 0.003),
        (f"worst of {count} lights, 30 steps each; against 1024 directions and 1024 cells that stay, too",),
    )


@row("shadow", "rigid mesh: bake")
def bake() -> Iterator[Goal]:
    if _missing():
        yield skipped("rigid path, bake", _missing())
        return
    notes, times = [], []
    with measure.one_core():
        for mesh in truth.JUDGED:
            begin = time.thread_time()
            shadow = fastibl.MeshShadow(truth.meshes()[mesh], 128, extent=truth.EXTENT, cache=False, progress=False)
            times.append(time.thread_time() - begin)
            notes.append(
                f"{mesh}: {times[-1]:.2f} s, {len(truth.meshes()[mesh].triangles)} triangles, "
                f"{shadow.bytes / 2**20:.2f} MiB"
            )
    scale = 0.004 / measure.yardstick_seconds()
    yield Goal(
        "rigid path, bake at 128^2 on one core",
        ", ".join(f"{scale * t:.2f}" for t in times) + " s of a 4.0 ms yardstick",
        "spot <= 2 s, bunny <= 5 s",
        bool(scale * times[0] <= 2 and scale * times[1] <= 5),
        tuple(notes),
    )
