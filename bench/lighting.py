"""Diffuse and glossy methods: their error against brute force on the real maps, and their time."""

from __future__ import annotations

import numpy as np

import fastibl
from fastibl.measuring.samples import pairs, units

from . import brute, inputs
from .measure import Row, Timing, measure, one_core, row

_NORMALS = 1_000_000
_PAIRS = 200_000
_GLOSSY_PAIRS = 40  # pairs at each angle that are compared with brute force
_TIMED_EXPONENT = 64.0


@one_core()
def rows() -> list[Row]:
    return diffuse() + glossy()


def _maps() -> dict[str, fastibl.CubeMap]:
    """The real maps; if they are not there, one of noise for measuring times."""
    if inputs.MAPS:
        return inputs.real_maps()
    noise = np.random.default_rng(0).lognormal(sigma=2, size=(6, 128, 128, 3))
    return {"noise": fastibl.CubeMap(noise.astype(np.float32))}


def _mean_and_each(method: str, metric: str, setting: str, means: dict[str, float], time: Timing) -> list[Row]:
    out = [row(method, name, metric, value, setting=setting) for name, value in means.items()]
    every = float(np.mean(list(means.values())))
    others = float(np.mean([v for name, v in means.items() if "studio" not in name]))
    out.append(row(method, f"mean of {len(means)} maps", metric, every, time, setting=setting))
    out.append(row(method, "mean without studio", metric, others, setting=setting))
    return out


def _setting(method: fastibl.Method) -> str:
    return " ".join(f"{key}={value}" for key, value in method.settings.items())


def diffuse() -> list[Row]:
    """Mean error of each method and its time for one normal; also the time to fit a map of 128 squared."""
    out = []
    maps = _maps()
    batches = [units(_NORMALS, seed).astype(np.float32) for seed in (0, 1)]
    for method in fastibl.methods("diffuse"):
        setting = _setting(method)
        lighting = fastibl.Lighting(next(iter(maps.values())), diffuse=method)
        time = measure(lighting.irradiance, batches, repetitions=7, warm=1).of_cpu.scaled(_NORMALS)
        metric = "mean error of the irradiance; seconds a normal"
        if not inputs.MAPS:
            out.append(row(method.name, "noise", metric, time=time, setting=setting))
        else:
            worst, means = 0.0, {}
            for name, cube in maps.items():
                true = brute.irradiance()[name]
                given = fastibl.Lighting(cube, diffuse=method).irradiance(brute.normals())
                error = brute.errors(given, true, true.mean())
                means[name], worst = float(error.mean()), max(worst, float(error.max()))
            out += _mean_and_each(method.name, metric, setting, means, time)
            out.append(
                row(method.name, f"worst of {len(means)} maps", "worst error of the irradiance", worst, setting=setting)
            )
        build = measure(lambda cube, m=method: fastibl.Lighting(cube, diffuse=m), list(maps.values())).of_cpu
        out.append(row(method.name, "fit to a map of 128^2", time=build, setting=setting))
    return out


def glossy() -> list[Row]:
    """Mean error of the normalised lobe by exponent, and time of one pair."""
    out = []
    maps = _maps()
    normals, views = units(_PAIRS, 2).astype(np.float32), units(_PAIRS, 3).astype(np.float32)
    views *= np.sign((normals * views).sum(axis=1, keepdims=True))
    batches = [(normals, views), (normals[::-1].copy(), views[::-1].copy())]
    for method in fastibl.methods("glossy"):
        lighting = fastibl.Lighting(next(iter(maps.values())), glossy=method)
        time = measure(lambda b, l=lighting: l.glossy(*b, _TIMED_EXPONENT), batches, repetitions=7, warm=1).of_cpu
        time = time.scaled(_PAIRS)
        metric = "mean error of the normalised lobe; seconds a pair"
        if not inputs.MAPS:
            out.append(row(method.name, "noise", metric, time=time))
            continue
        n, v = pairs(_GLOSSY_PAIRS)
        for s in brute.EXPONENTS:
            means = {}
            for name, cube in maps.items():
                true = brute.glossy(_GLOSSY_PAIRS)[name][s]
                given = fastibl.Lighting(cube, glossy=method).glossy(n, v, float(s))
                means[name] = float(brute.errors(given, true, true.mean()).mean())
            out += _mean_and_each(method.name, metric, f"exponent={s} {_setting(method)}".strip(), means, time)
    return out
