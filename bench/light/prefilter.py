"""Sets of prefiltered levels for other renderers, compared with cmft and cmgen."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.expected import present
from fastibl.measuring.samples import pairs

from .. import brute, inputs
from ..goals import Goal, by_map, largest, percent, row, skipped
from ..measure import measure, one_core, yardstick

# nMAE of cmft on the same seven maps, median and worst, by level (research: peers, measured): p = 513 ... 5.4.
CMFT = ((0.09, 0.9), (0.13, 0.8), (0.15, 0.6), (0.20, 0.5), (0.26, 0.7), (0.29, 0.8), (0.29, 1.1))
CMGEN_ALPHA = (0.0, 0.01795, 0.08579, 0.25, 1.0)  # of the mapping "filament", five levels
DIRECTIONS = 300  # random texels of a level that are compared with brute force


@cache
def maps(size: int) -> dict[str, fastibl.CubeMap]:
    return {name: fastibl.read_environment(path, size=size) for name, path in inputs.MAPS.items()}


@cache
def _texels(size: int) -> tuple[NDArray, NDArray]:
    directions, angles, _ = reference.samples(np.zeros((6, size, size, 3)))
    return directions, angles


def height(model: str, parameter: float, cosine: NDArray) -> NDArray:
    """A lobe seen along the normal, by its definition, relative to its peak."""
    c = np.maximum(cosine, 0)
    if model == "phong":
        return c**parameter * (cosine > 0)
    if model == "blinn":
        return np.sqrt((1 + c) / 2) ** parameter * c
    a = parameter * parameter
    return (a / ((1 + c) / 2 * (a - 1) + 1)) ** 2 * c


def chosen(size: int) -> NDArray:
    """Texels of a level that are compared: all texels of a small level, else DIRECTIONS at random."""
    count = 6 * size * size
    return np.sort(np.random.default_rng(size).permutation(count)[:DIRECTIONS])


def truth(source: int, size: int, model: str, parameter: float) -> NDArray:
    """The sum over every texel of the source, with its exact solid angle and the exact lobe: (chosen, maps, 3)."""
    what = f"prefiltered {source} {size} {model} {parameter:.6g} {DIRECTIONS}"

    def make() -> NDArray:
        radiance = np.hstack([cube.faces.reshape(-1, 3) for cube in maps(source).values()]).astype(np.float64)
        d, angles = _texels(source)
        out = np.empty((len(chosen(size)), radiance.shape[1]))
        for i, o in enumerate(_texels(size)[0][chosen(size)]):
            weight = height(model, parameter, d @ o) * angles
            some = np.flatnonzero(weight > 1e-14 * weight.max())
            out[i] = weight[some] @ radiance[some] / weight[some].sum()
        return out.reshape(len(out), -1, 3)

    return brute.kept(what, make)


def compare(level: int, sets: dict[str, list], source: int, model: str, parameter: float) -> tuple[dict, dict, dict]:
    """nMAE, largest relative error, and relative error of the energy of one level (its worst channel), by map."""
    nmae, relative, energy = {}, {}, {}
    for k, (name, cubes) in enumerate(sets.items()):
        size = cubes[level].size
        true = truth(source, size, model, parameter)[:, k]
        off = np.abs(cubes[level].faces.reshape(-1, 3)[chosen(size)].astype(np.float64) - true)
        nmae[name] = float(off.mean() / true.mean())
        relative[name] = float((off / (true + 0.01 * true.mean())).max())
        every = np.array(cubes[level].mean()) / np.array(maps(source)[name].mean()) - 1
        energy[name] = float(every[np.abs(every).argmax()])
    return nmae, relative, energy


@one_core()
def timed(size: int, levels: int, model: str, **options) -> tuple[dict[str, list], float, dict[str, float]]:
    """The sets of all maps; CPU time on one core in yardsticks, for the median map; and that for each map."""
    sets, times = {}, {}
    for name, cube in maps(size).items():
        lighting = fastibl.Lighting(cube, diffuse="sh9", glossy="mip")
        sets[name] = lighting.prefiltered(size, levels, model, **options)
        times[name] = (
            measure(lambda _, l=lighting: l.prefiltered(size, levels, model, **options), [0], 3, warm=0).cpu_low
            / yardstick(9).cpu_low
        )
    return sets, float(np.median(list(times.values()))), times


def _timed_goal(what: str, median: float, times: dict[str, float], most: float, peer: str) -> Goal:
    return Goal(
        f"{what}, one core: yardsticks, median (slowest) map",
        f"{median:.2f} ({max(times.values()):.2f})",
        f"<= {most:g} ({peer})",
        median <= most,
        ("yardsticks by map: " + ", ".join(f"{name} {t:.1f}" for name, t in times.items()),),
    )


@row("light", "prefiltered Phong set against cmft, 128^2")
def phong() -> Iterator[Goal]:
    yield from _phong(128, 11.25, "cmft 220")


@row("light", "prefiltered Phong set, 256^2")
def phong_large() -> Iterator[Goal]:
    yield from _phong(256, 67.5, "cmft 3400")  # its error at 256^2 was never measured: that at 128^2 has to be reached


def _phong(size: int, most: float, peer: str) -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped(f"prefiltered Phong set at {size}^2, seven levels", inputs.NO_MAPS)
        return
    sets, median, times = timed(size, 7, "phong")
    yield _timed_goal(f"Phong set of 7 levels at {size}^2", median, times, most, peer)
    yield from _phong_levels(sets, size)


def _phong_levels(sets: dict[str, list], source: int) -> Iterator[Goal]:
    studio: list[float] = []
    for level, (middle, worst) in enumerate(CMFT):
        p = 1 + 2 ** (1 + 8 * (1 - level / 7))
        nmae, relative, _ = compare(level, sets, source, "phong", p)
        studio += [v for name, v in relative.items() if "studio" in name]
        yield Goal(
            f"Phong p={p:.3g} at {sets[next(iter(sets))][level].size}^2 from {source}^2: nMAE median, worst",
            f"{percent(float(np.median(list(nmae.values()))))}, {percent(largest(nmae.values()))}",
            f"<= {middle}, {worst} % (cmft)",
            np.median(list(nmae.values())) <= middle / 100 and largest(nmae.values()) <= worst / 100,
            by_map(nmae),
        )
    yield Goal(
        f"Phong set from {source}^2, studio map: largest relative error",
        f"{largest(studio):.3f}",
        "<= 0.1 (cmft 0.89)",
        largest(studio) <= 0.1,
    )


@row("light", "prefiltered GGX set against cmgen, 256^2")
def ggx() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("prefiltered GGX set at 256^2", inputs.NO_MAPS)
        return
    sets, median, times = timed(256, 5, "ggx", mapping="filament", error=0.005)
    yield _timed_goal("GGX set of 5 levels at 256^2, error=0.005", median, times, 15, "cmgen 1475")
    for level, alpha in enumerate(CMGEN_ALPHA):
        if level == 0:
            worst = largest(float(np.abs(s[0].faces - maps(256)[name].faces).max()) for name, s in sets.items())
            yield Goal("GGX alpha=0 at 256^2: difference from the map", f"{worst:.2g}", "0", worst == 0)
            continue
        nmae, relative, energy = compare(level, sets, 256, "ggx", alpha)
        yield Goal(
            f"GGX alpha={alpha:.3g} at {256 >> level}^2: worst nMAE, energy",
            f"{percent(largest(nmae.values()))}, {percent(largest(abs(e) for e in energy.values()))}",
            "<= 1 %, 0.2 % (cmgen 15-24 %, 24 %)",
            largest(nmae.values()) <= 0.01 and largest(abs(e) for e in energy.values()) <= 0.002,
            (*by_map(nmae), f"largest relative error: {largest(relative.values()):.3f}"),
        )


@row("light", "prefiltered white furnace")
def furnace() -> Iterator[Goal]:
    chosen_by: dict[str, dict[str, Any]] = {"ggx": {}, "phong": {}, "blinn": {"parameters": (2048, 128, 8, 1, 0)}}
    for model, options in chosen_by.items():
        off = []
        for value in (1.0, 1e-8, 1e8):
            cube = fastibl.CubeMap(np.full((6, 64, 64, 3), value, np.float32))
            for level in fastibl.Lighting(cube, diffuse="sh9").prefiltered(64, 7, model, **options):
                off.append(np.abs(present(level).faces / np.float32(value) - 1).max())
        worst = largest(off)
        yield Goal(
            f"{model}: white furnace, worst of all levels, 1e-8 ... 1e8", f"{worst:.1e}", "<= 1e-6", worst <= 1e-6
        )


@row("light", "prefiltered, a map that nothing was tuned on")
def held_out() -> Iterator[Goal]:
    """The error option's scale was set on the seven maps; the eighth, with a bare sun, only verifies it."""
    paths = sorted((inputs.SHARED / "hdri-sun").glob("*.hdr"))
    if not paths:
        yield skipped("GGX set of another map", f"no map under {inputs.SHARED / 'hdri-sun'}")
        return
    cube = fastibl.read_environment(paths[0], size=128)
    d, angles = _texels(128)
    radiance = cube.faces.reshape(-1, 3).astype(np.float64)
    for error in (0.005, 0.002):
        means, most = [], []
        for level, alpha in zip(
            fastibl.Lighting(cube, diffuse="sh9", glossy="mip").prefiltered(
                64, parameters=(0.05, 0.2, 0.5, 1), error=error
            ),
            (0.05, 0.2, 0.5, 1),
            strict=True,
        ):
            made = present(level)
            some = chosen(made.size)[:100]
            true = np.empty((len(some), 3))
            for i, o in enumerate(_texels(made.size)[0][some]):
                weight = height("ggx", alpha, d @ o) * angles
                true[i] = weight @ radiance / weight.sum()
            off = np.abs(made.faces.reshape(-1, 3)[some] - true)
            means.append(off.mean() / true.mean())
            most.append((off / (true + 0.01 * true.mean())).max())
        worst = largest(means)
        yield Goal(
            f"{paths[0].stem.removesuffix('_1k')}, error={error}: worst nMAE of four GGX levels",
            percent(worst),
            f"<= {percent(error)}",
            worst <= error,
            (f"largest relative error: {largest(most):.3f}",),
        )


@row("light", "sampled glossy by number of taps")
def sampled() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("sampled, mean error over s = 2 ... 2048", inputs.NO_MAPS)
        return
    n, v = pairs(20)
    last = np.inf
    for taps in (4, 16, 64, 256, 1024, 4096):
        means = {}
        for name, cube in inputs.real_maps().items():
            lighting = fastibl.Lighting(cube, diffuse="sh9", glossy=fastibl.Method("sampled", taps=taps))
            errors = []
            for s in brute.EXPONENTS:
                true = brute.glossy(20)[name][s]
                errors.append(brute.errors(lighting.glossy(n, v, float(s)), true, true.mean()).mean())
            means[name] = float(np.mean(errors))
        mean = float(np.mean(list(means.values())))
        yield Goal(
            f"sampled, {taps} taps: mean error over s = 2 ... 2048",
            percent(mean),
            "falls by half or more" if last < np.inf else "(start)",
            mean <= 0.5 * last,
            by_map(means),
        )
        last = mean
