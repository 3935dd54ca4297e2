"""What the peers are compared with: sums over every texel of the cube with which a peer itself started."""

from __future__ import annotations

import resource
import subprocess
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fastibl import reference

from ..light.prefilter import height
from ..measure import Row, Timing, row, timing

DIRECTIONS = 200  # texels of a level that are compared


def normals(count: int = 500) -> NDArray[np.float64]:
    v = np.random.default_rng(7).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def nmae(given: NDArray, true: NDArray) -> float:
    """Mean absolute error divided by the mean of the truth."""
    return float(np.abs(np.asarray(given, np.float64) - true).mean() / true.mean())


def irradiance_of(sh: NDArray, n: NDArray) -> NDArray:
    """Irradiance from radiance coefficients (9, 3) in the basis of Lighting.sh9."""
    x, y, z = n.T
    basis = [0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z]
    basis += [0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y)]
    cosine = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)
    return (np.stack(basis) * cosine[:, None]).T @ sh


def some_texels(size: int) -> NDArray[np.int_]:
    return np.sort(np.random.default_rng(size).permutation(6 * size * size)[:DIRECTIONS])


def convolved(sources: Sequence[NDArray], size: int, alpha: float) -> NDArray:
    """GGX of `some_texels` of a level, by source: (maps, texels, 3). sources: faces of the same size."""
    d, angles, _ = reference.samples(np.zeros_like(sources[0]))
    radiance = np.hstack([np.asarray(s, np.float64).reshape(-1, 3) for s in sources])
    to = reference.samples(np.zeros((6, size, size, 3)))[0][some_texels(size)]
    out = np.empty((len(to), radiance.shape[1]))
    for i, direction in enumerate(to):
        weight = height("ggx", alpha, d @ direction) * angles
        out[i] = weight @ radiance / weight.sum()
    return out.reshape(len(to), len(sources), 3).transpose(1, 0, 2)


def over_maps(
    method: str, metric: str, errors: dict[str, float], time: Timing | None = None, setting: str = ""
) -> list[Row]:
    """A row for each map, and rows for their median and worst."""
    out = [row(method, name, metric, value, setting=setting) for name, value in errors.items()]
    values = list(errors.values())
    out.append(row(method, f"median of {len(values)} maps", metric, float(np.median(values)), time, setting=setting))
    out.append(row(method, f"worst of {len(values)} maps", metric, max(values), setting=setting))
    return out


def run(command: Sequence[object], **options) -> tuple[str, float, float]:
    """A program's standard output, and its wall and CPU seconds. Raises RuntimeError where it fails."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=600, **options)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]} failed: {(done.stderr or done.stdout).strip()[-300:]}")
    return done.stdout, wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def cpu_timing(seconds: Sequence[float]) -> Timing:
    """CPU seconds of a program, taken as those of one thread."""
    return timing(seconds, seconds)
