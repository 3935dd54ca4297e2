"""Diffuse light: error and time per normal, the irradiance cube, and what must never be negative."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import Method, _fastibl, reference
from fastibl.measuring.samples import units

from .. import brute, inputs
from ..goals import Goal, by_map, percent, row, skipped
from ..measure import yardstick_seconds

FAST, FINE = Method("sh9-lobes", lobes=2), Method("sh9-lobes", lobes=10)  # by which the goals by time are judged
PAPER = ("nearest-face", "six-face", "six-face-exact")
EXACT = (Method("sh9"), Method("sh9-lobes"), Method("irradiance-cube", size=32))
_NORMALS = 4096  # one batch: a mesh of that many vertices fits in the cache
_SUN = inputs.SHARED / "hdri-sun" / "immenstadter_horn_1k.hdr"


@cache
def seconds_a_normal() -> dict[Method, float]:
    """The least time of the C++ kernel for each method; methods take turns, on random unit normals and one thread."""
    normals = units(_NORMALS).astype(np.float32)
    faces = np.random.default_rng(0).lognormal(sigma=2, size=(6, 64, 64, 3))
    cube = next(iter(inputs.real_maps().values()), None) or fastibl.CubeMap(faces)
    lightings = {m: fastibl.Lighting(cube, diffuse=m) for m in (*fastibl.methods("diffuse"), FINE)}
    best = dict.fromkeys(lightings, np.inf)
    for _ in range(20):
        for method, lighting in lightings.items():
            repetitions = 50 if method.name.startswith("s") and method.name != "six-face-exact" else 2
            best[method] = min(best[method], *_fastibl._seconds_to_evaluate(lighting, normals, repetitions))
    return {method: seconds / _NORMALS for method, seconds in best.items()}


def errors(method: Method) -> dict[str, NDArray]:
    """The error of every sample of every real map."""
    out = {}
    for name, cube in inputs.real_maps().items():
        true = brute.irradiance()[name]
        out[name] = brute.errors(fastibl.Lighting(cube, diffuse=method).irradiance(brute.normals()), true, true.mean())
    return out


def gradient(method: Method, axis: int = 0) -> tuple[float, float]:
    """Slope and offset of E/pi over a normal's part along an axis, in a map of radiance 2 + that part of directions."""
    d = fastibl.texel_directions(128).astype(np.float64)
    radiance = 2 + d[..., axis, None] / np.linalg.norm(d, axis=-1, keepdims=True)
    n = units(2000)
    e = fastibl.Lighting(fastibl.CubeMap(np.repeat(radiance, 3, -1)), diffuse=method).irradiance(n)[:, 0] / np.pi
    slope, offset = np.linalg.lstsq(np.stack([n[:, axis], np.ones(len(n))], 1), e, rcond=None)[0]
    return float(slope), float(offset)


@row("light", "diffuse methods against brute force")
def methods() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("mean error of the irradiance", inputs.NO_MAPS)
        return
    times = seconds_a_normal()
    eq9 = times[Method("six-face")]
    for method in (*fastibl.methods("diffuse"), FINE):
        by_name = errors(method)
        means = {name: float(e.mean()) for name, e in by_name.items()}
        worst = max(float(e.max()) for e in by_name.values())
        yield Goal(
            f"{method}: mean and worst error of the irradiance; time a normal",
            f"{percent(float(np.mean(list(means.values()))))}, {percent(worst)}; "
            f"{1e9 * times[method]:.2f} ns, {times[method] / eq9:.2f} of Eq. 9",
            "(no goal of its own)",
            None,
            by_map(means),
        )


@row("light", "diffuse at the time of Eq. 9")
def by_time() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("diffuse at the time of Eq. 9", inputs.NO_MAPS)
        return
    times = seconds_a_normal()
    for method, time_goal, mean_goal, worst_goal, studio_goal in (
        (FAST, 1.1, 9e-3, 0.08, 5e-3),
        (FINE, 2, 3e-3, 0.025, 1),
    ):
        by_name = errors(method)
        means = {name: float(e.mean()) for name, e in by_name.items()}
        mean, worst = float(np.mean(list(means.values()))), max(float(e.max()) for e in by_name.values())
        studio = max((v for name, v in means.items() if "studio" in name), default=0.0)
        ratio = times[method] / times[Method("six-face")]
        wanted = f"time <= {time_goal}, mean <= {percent(mean_goal)}, worst <= {percent(worst_goal)}"
        yield Goal(
            f"{method} against Eq. 9",
            f"{ratio:.2f} of its time, mean {percent(mean)}, worst {percent(worst)}, studio {percent(studio)}",
            wanted + (f", studio <= {percent(studio_goal)}" if studio_goal < 1 else ""),
            ratio <= time_goal and mean <= mean_goal and worst <= worst_goal and studio <= studio_goal,
            (*by_map(means), "time: C++ kernel, 4096 random normals, one thread, least of many, methods in turn"),
        )


@cache
def cube_truth() -> tuple[NDArray, dict[str, NDArray]]:
    """Directions of 16 squared texels per face, and each map's true irradiance there."""
    directions = reference.samples(np.zeros((6, 16, 16, 3)))[0]
    size = next(iter(inputs.real_maps().values())).size

    def make() -> NDArray:
        texels, angles, _ = reference.samples(np.zeros((6, size, size, 3)))
        flux = [c.faces.reshape(-1, 3).astype(np.float64) * angles[:, None] for c in inputs.real_maps().values()]
        every = np.hstack(flux)
        parts = np.array_split(directions, 24)
        return np.concatenate([np.maximum(p @ texels.T, 0) @ every for p in parts])

    sums = brute.kept("irradiance at 16 squared texels", make)
    return directions, {name: sums[:, 3 * k : 3 * k + 3] for k, name in enumerate(inputs.real_maps())}


def _fetch_errors(size: int, source: int) -> list[float]:
    """nMAE of each map's irradiance by one look-up of the method's own cube."""
    method, errors = Method("irradiance-cube", size=size, source=source), []
    for name, radiance in inputs.real_maps().items():
        true = brute.irradiance()[name]
        found = fastibl.Lighting(radiance, diffuse=method).irradiance(brute.normals())
        errors.append(float(np.abs(found - true).mean() / true.mean()))
    return errors


@row("light", "diffuse cube")
def cube() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("diffuse cube", inputs.NO_MAPS)
        return
    _, truths = cube_truth()
    limits = {16: (1e-3, 4e-3, 0.025), 32: (2e-4, 1e-3, 0.25)}
    for source, (median_goal, worst_goal, time_goal) in limits.items():
        wrong = {}
        for name, radiance in inputs.real_maps().items():
            made = fastibl.Lighting(radiance, diffuse="sh9").irradiance_cube(16, source).faces.reshape(-1, 3)
            wrong[name] = float(np.abs(made - truths[name]).mean() / truths[name].mean())
        some = next(iter(inputs.real_maps().values()))
        times = {n: min(_fastibl._seconds_to_sum_cube(some, n, source, 100)) for n in (8, 16, 32)}
        median, worst = float(np.median(list(wrong.values()))), max(wrong.values())
        yardsticks = times[16] / yardstick_seconds()
        fetched = {n: _fetch_errors(n, source) for n in (16, 32)}
        yield Goal(
            f"irradiance cube 16^2 from {source}^2: nMAE median, worst; time to build",
            f"{percent(median)}, {percent(worst)}; {yardsticks:.4f} yardsticks",
            f"<= {percent(median_goal)}, {percent(worst_goal)}; {time_goal} yardsticks",
            median <= median_goal and worst <= worst_goal and yardsticks <= time_goal,
            (
                *by_map(wrong),
                "built: " + ", ".join(f"{n}^2 {1e3 * t:.3f} ms" for n, t in times.items()),
                "the method irradiance-cube between texels, one bilinear look-up at random normals: "
                + "; ".join(f"{n}^2 {percent(float(np.median(e)))}, {percent(max(e))}" for n, e in fetched.items()),
            ),
        )


@row("light", "diffuse linear gradient")
def linear() -> Iterator[Goal]:
    for method in (*fastibl.methods("diffuse"), FINE):
        judged = method.name not in PAPER
        (slope, offset), *others = (gradient(method, axis) for axis in range(3))
        yield Goal(
            f"{method}: E/pi in radiance 2 + x",
            f"{offset:.6f} + {slope:.6f} n.x",
            "2 + (2/3) n.x within 1e-4" if judged else "(no goal of its own)",
            (abs(slope - 2 / 3) <= 1e-4 and abs(offset - 2) <= 1e-4) if judged else None,
            ("along y and z: " + ", ".join(f"{o:.6f} + {s:.6f}" for s, o in others),),
        )


@row("light", "diffuse furnace and sign")
def sign() -> Iterator[Goal]:
    normals = units(100_000)
    white = fastibl.CubeMap(np.ones((6, 64, 64, 3)))
    for method in (*(m for m in fastibl.methods("diffuse") if m.name not in PAPER), FINE):
        off = float(np.abs(fastibl.Lighting(white, diffuse=method).irradiance(normals) / np.pi - 1).max())
        least = [float(fastibl.Lighting(c, diffuse=method).irradiance(normals).min()) for c in _all_maps().values()]
        yield Goal(
            f"{method}: white furnace; least irradiance of {len(least)} maps, 1e5 normals",
            f"{off:.1e}; {min(least, default=0.0):.2g}",
            "<= 1e-6; >= 0",
            off <= 1e-6 and min(least, default=0.0) >= 0,
        )


def _all_maps() -> dict[str, fastibl.CubeMap]:
    maps = dict(inputs.real_maps())
    if _SUN.exists():
        maps["sun"] = fastibl.read_environment(_SUN, size=128)
    return maps


@row("light", "diffuse under the sun")
def sun() -> Iterator[Goal]:
    if not _SUN.exists():
        yield skipped("diffuse under the sun", f"no map {_SUN}")
        return
    radiance = fastibl.read_environment(_SUN, size=128)
    normals = brute.normals()[:500]
    truth = reference.irradiance(radiance, normals)
    for method in (Method("six-face"), *EXACT, FAST, FINE):
        wrong = brute.errors(fastibl.Lighting(radiance, diffuse=method).irradiance(normals), truth, truth.mean())
        yield Goal(
            f"{method}: mean and worst error under the sun",
            f"{percent(float(wrong.mean()))}, {percent(float(wrong.max()))}",
            "(no goal of its own)",
            None,
        )


@row("light", "diffuse fit")
def fit() -> Iterator[Goal]:
    """Time to fit a map that is there with its chain, without what it is judged by."""
    some = next(iter(inputs.real_maps().values()), None)
    if some is None:
        yield skipped("diffuse fit", inputs.NO_MAPS)
        return
    for method in (Method("sh9"), Method("sh9-lobes"), FAST, FINE, Method("irradiance-cube")):
        seconds = min(_fastibl._seconds_to_fit(some, fastibl.Lighting(some, diffuse=method), False, 50))
        text = f"{1e3 * seconds:.3f} ms, {seconds / yardstick_seconds():.3f} yardsticks"
        yield Goal(f"{method}: time to fit, anew", text, "(no goal of its own)", None)
