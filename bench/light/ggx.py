"""GGX: isotropic and anisotropic, with compensation of multiple scattering.

Tuned on adams, dikhololo, potsdamer and studio: how many widths the parts span, where they begin to share a direction,
and the factor on their widths. empty_warehouse, kiara and venice were left out.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.measuring.samples import VIEWS, surfaces

from .. import brute, inputs
from ..goals import Goal, by_map, largest, percent, row, skipped

ANISOTROPIC = (0.1, 0.4)
ISOTROPIC = (0.05, 0.1, 0.25, 0.5, 1.0)
COUNT = 50
TUNED = ("adams", "dikhololo", "potsdamer", "studio")


def side_by_side() -> NDArray:
    """Faces of all maps as channels of one map, so that the lobe is computed once for all."""
    return np.concatenate([cube.faces for cube in inputs.real_maps().values()], axis=-1)


def truth(alpha: tuple[float, float], split: int | None = None) -> dict[str, NDArray]:
    """True light (4 COUNT, 3) of each real map."""
    faces = side_by_side()

    def make() -> NDArray:
        n, t, v = surfaces(COUNT)

        def some(part: NDArray) -> NDArray:
            return reference.ggx(faces, n[part], v[part], tangents=t[part], alpha=alpha, split=split)

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return np.concatenate(list(pool.map(some, np.array_split(np.arange(len(n)), 8))))

    array = brute.kept(f"ggx {alpha} {split} {COUNT} {VIEWS}", make)
    return {name: array[:, 3 * k : 3 * k + 3] for k, name in enumerate(inputs.real_maps())}


@cache
def lighting_of(name: str, glossy: str, lights: int) -> fastibl.Lighting:
    method = fastibl.Method(glossy) if glossy == "mip" else fastibl.Method(glossy, lights=lights)
    return fastibl.Lighting(inputs.real_maps()[name], glossy=method)


def error_by_map(
    alpha: tuple[float, float], glossy: str = "stretched", lights: int = 8, **options: Any
) -> tuple[dict[str, float], list[float]]:
    """The mean error for each map, and for each view angle over all maps. glossy: the method whose chain is read."""
    n, t, v = surfaces(COUNT)
    means, angles = {}, []
    for name, true in truth(alpha).items():
        lighting = lighting_of(name, glossy, lights)
        errors = brute.errors(lighting.ggx(n, v, tangents=t, alpha=alpha, **options), true, true.mean())
        means[name] = float(errors.mean())
        angles.append(errors.reshape(len(VIEWS), COUNT).mean(axis=1))
    return means, list(np.mean(angles, axis=0))


def goal_of(what: str, alpha: tuple[float, float], goal: float | None, **options: Any) -> Goal:
    means, angles = error_by_map(alpha, **options)
    mean = float(np.mean(list(means.values())))
    tuned = [m for name, m in means.items() if name.startswith(TUNED)]
    other = [m for name, m in means.items() if not name.startswith(TUNED)]
    notes = (
        *by_map(means),
        f"maps tuned on: {percent(float(np.mean(tuned)))}; the others: {percent(float(np.mean(other)))}",
        "by view angle: " + ", ".join(f"{d} deg {percent(e)}" for d, e in zip(VIEWS, angles, strict=True)),
    )
    if goal is None:
        return Goal(what, percent(mean), "(no goal of its own)", None, notes)
    return Goal(what, percent(mean), f"at most {percent(goal)}", mean <= goal, notes)


@row("light", "ggx, anisotropic")
def anisotropic() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("anisotropic GGX", inputs.NO_MAPS)
        return
    name = f"GGX {ANISOTROPIC}"
    for taps, goal in ((1, None), (4, None), (8, 0.12), (16, 0.08)):
        yield goal_of(f"{name}, {taps} look-ups and at most 8 lights: mean error", ANISOTROPIC, goal, taps=taps)
        yield goal_of(f"{name}, {taps} look-ups without lights: mean error", ANISOTROPIC, goal, taps=taps, lights=0)
        yield goal_of(f"{name}, {taps} look-ups in the MIP levels", ANISOTROPIC, None, taps=taps, glossy="mip")
    yield goal_of(
        f"{name}, gradient (the paper's suggestion), at most 16 look-ups in the MIP levels",
        ANISOTROPIC, None, taps=16, method="gradient", glossy="mip",
    )  # fmt: skip
    for taps in (64, 1024):
        what = f"{name}, {taps} samples: mean error"
        yield goal_of(what, ANISOTROPIC, None, taps=taps, method="sampled", glossy="mip")


@row("light", "ggx, isotropic")
def isotropic() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("isotropic GGX", inputs.NO_MAPS)
        return
    for alpha in ISOTROPIC:
        for taps, lights in ((4, 8), (8, 8), (8, 0)):
            what = f"GGX alpha {alpha:g}, {taps} look-ups, at most {lights} lights: mean error"
            yield goal_of(what, (alpha, alpha), None, taps=taps, lights=lights)


@row("light", "ggx, energy")
def energy() -> Iterator[Goal]:
    white = fastibl.CubeMap(np.ones((6, 16, 16, 3), np.float32))
    rng = np.random.default_rng(2)
    v = rng.normal(size=(20000, 3))
    v[:, 2] = np.abs(v[:, 2])
    v[:2000, 2] *= 1e-3  # grazing
    up, tangent = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    for chain in ("mip", "centroid", "prefiltered", "sampled"):
        lighting = fastibl.Lighting(white, glossy=chain)
        for method in ("taps", "sampled", "gradient"):
            worst = largest(
                np.abs(lighting.ggx(up, v, roughness, anisotropy, tangent, method=method) - 1).max()
                for roughness in (0.02, 0.1, 0.2, 0.4, 0.7, 1.0)
                for anisotropy in (0.0, 0.5, 1.0)
            )
            yield Goal(
                f"white furnace of GGX with compensation, {method} on {chain}, roughness 0.02 to 1, anisotropy 0 to 1, "
                "all angles",
                f"{worst:.2g}", "at most 1e-3", worst <= 1e-3,
            )  # fmt: skip
    off = []
    for alpha in ((0.02, 0.02), (0.1, 0.1), (0.1, 0.4), (0.02, 1.0), (1.0, 1.0)):
        for degrees in (0, 30, 60, 75, 85):
            c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            view = np.array([s * np.cos(0.8), s * np.sin(0.8), c])
            ours = fastibl.ggx_albedo(view, alpha=alpha).sum()
            off.append(abs(float(ours) - reference.ggx_albedo(c, alpha, 0.8)))
    worst = largest(off)
    yield Goal(
        "directional albedo of single scattering against the oracle's quadrature",
        f"{worst:.2g}", "at most 1e-3", worst <= 1e-3,
    )  # fmt: skip


@row("light", "ggx, convergence of the oracle")
def convergence() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("convergence of the GGX oracle", inputs.NO_MAPS)
        return
    n, t, v = (array[::20] for array in surfaces(COUNT))
    faces = side_by_side()
    for alpha in (ANISOTROPIC, (0.05, 0.05)):
        a = reference.ggx(faces, n, v, tangents=t, alpha=alpha)
        b = reference.ggx(faces, n, v, tangents=t, alpha=alpha, split=12)
        worst = float((np.abs(a - b) / b.mean(axis=0)).max())
        yield Goal(f"GGX oracle {alpha}: default pieces of a texel against 12 x 12, worst", f"{worst:.1e}",
                   "at most 2e-3", worst <= 2e-3)  # fmt: skip
