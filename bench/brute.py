"""Errors of shading methods against brute force, on many maps at once.

The weights of a lobe do not depend on the map, so they are computed once for all maps. Texels and solid angles are
those of fastibl.reference, and `check` compares the sums with it. Truths are kept between runs, in the user's cache
folder, under a name that depends on the maps and on this code.
"""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fastibl import reference
from fastibl.measuring import samples
from fastibl.measuring.samples import pairs, units

from .inputs import real_maps

EXPONENTS = (2, 8, 32, 128, 512, 2048)
NORMALS = 2000
_SPLIT = {512: 4, 2048: 8}  # pieces of a texel along each axis, by exponent


def errors(estimated: NDArray, true: NDArray | float, mean: float | NDArray) -> NDArray:
    """RMS over RGB of the difference, divided by the mean of the truth; (n,). Raises ValueError for what is not
    finite."""
    return np.sqrt((finite(np.asarray(estimated, np.float64) - true) ** 2).mean(axis=-1)) / mean


def finite(differences: NDArray) -> NDArray:
    """The differences; ValueError if one is NaN or infinite: a row fails with it, whatever it would make of them."""
    if not np.isfinite(differences).all():
        count = int((~np.isfinite(differences)).sum())
        raise ValueError(f"{count} of {differences.size} values differ by what is no finite number")
    return differences


CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fastibl-bench"


def kept(what: str, make: Callable[[], NDArray]) -> NDArray:
    """make(), kept between runs; the key is `what` it is, the maps, and the code that makes it."""
    return stored([what, _radiance(), Path(samples.__file__)], make)


Part = str | NDArray | Path  # part of a key


def stored(key: Iterable[Part], make: Callable[[], NDArray]) -> NDArray:
    """make(), kept between runs; the key is the contents of what it was made from: texts, arrays, files. The code of
    `make`, of this file and of the oracle, and NumPy's version are always part of it."""
    parts = hashlib.sha256(np.__version__.encode())
    code = [make.func if isinstance(make, partial) else make, stored, reference]
    for part in (*key, *(Path(inspect.getfile(each)) for each in code)):
        parts.update(
            part.encode() if isinstance(part, str) else part.read_bytes() if isinstance(part, Path) else part.tobytes()
        )
    path = CACHE / f"{parts.hexdigest()[:24]}.npy"
    if path.exists():
        return np.load(path)
    array = make()
    CACHE.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.part")
    with part.open("wb") as file:
        np.save(file, array)
    part.replace(path)
    return array


@cache
def _texels(size: int) -> tuple[NDArray, NDArray]:
    directions, angles, _ = reference.samples(np.zeros((6, size, size, 3)))
    return directions, angles


@cache
def _radiance() -> NDArray:
    """(texels, 3 maps): all maps side by side."""
    return np.hstack([cube.faces.reshape(-1, 3).astype(np.float64) for cube in real_maps().values()])


@cache
def normals() -> NDArray:
    return units(NORMALS, seed=7)


@cache
def irradiance() -> dict[str, NDArray]:
    """True irradiance (NORMALS, 3) of each real map at `normals`."""
    return _by_map(kept("irradiance", _irradiance))


def _by_map(array: NDArray) -> dict[str, NDArray]:
    """(..., 3 maps) to (..., 3) by name."""
    return {name: array[..., 3 * k : 3 * k + 3] for k, name in enumerate(real_maps())}


def _irradiance() -> NDArray:
    size = next(iter(real_maps().values())).size
    d, angles = _texels(size)
    flux = _radiance() * angles[:, None]
    out = np.empty((NORMALS, flux.shape[1]))
    for i in range(0, NORMALS, 64):
        out[i : i + 64] = np.maximum(normals()[i : i + 64] @ d.T, 0) @ flux
    for name, cube in real_maps().items():
        check(_by_map(out)[name][:2], reference.irradiance(cube, normals()[:2]))
    return out


def _cosines(n: NDArray, v: NDArray, d: NDArray) -> tuple[NDArray, NDArray]:
    """n.h and n.w of directions d (k, 3) for one pair."""
    nd, half = d @ n, np.sqrt(np.maximum(2 + 2 * (d @ v), 1e-300))
    return np.clip((nd + n @ v) / half, 0, 1), np.maximum(nd, 0)


@cache
def glossy(count: int) -> dict[str, dict[int, NDArray]]:
    """True normalised glossy radiance (5 count, 3) of each real map, by exponent, at `pairs(count)`.

    For the sharper lobes, those texels are split that hold all but 1e-8 of the lobe's height.
    """
    array = kept(f"glossy {count}", lambda: _glossy(count))
    return {name: dict(zip(EXPONENTS, values, strict=True)) for name, values in _by_map(array).items()}


def _glossy(count: int) -> NDArray:
    size = next(iter(real_maps().values())).size
    d, angles = _texels(size)
    radiance = _radiance()
    n, v = pairs(count)
    fine = {}
    for split in set(_SPLIT.values()):
        sub, sub_angles = _texels(size * split)
        shape = (6, size, split, size, split)
        fine[split] = (
            np.ascontiguousarray(sub.reshape(*shape, 3).transpose(0, 1, 3, 2, 4, 5)).reshape(-1, split * split, 3),
            np.ascontiguousarray(sub_angles.reshape(shape).transpose(0, 1, 3, 2, 4)).reshape(-1, split * split),
        )
    _texels.cache_clear()
    out = {s: np.empty((len(n), radiance.shape[1])) for s in EXPONENTS}

    def one(i: int) -> None:
        nh, nd = _cosines(n[i], v[i], d)
        log = np.log(np.maximum(nh, 1e-300))
        for s in EXPONENTS:
            split = _SPLIT.get(s, 1)
            if split == 1:
                chosen: slice | NDArray = slice(None)
                weight = np.exp(s * log) * nd * angles
            else:
                # A texel is up to 0.02 wide, so n.h changes by less than that from its centre to its corners.
                chosen = np.flatnonzero((nh > 10 ** (-8 / s) - 0.03) & (d @ n[i] > -0.03))
                sub, sub_angles = fine[split][0][chosen], fine[split][1][chosen]
                a, b = _cosines(n[i], v[i], sub.reshape(-1, 3))
                weight = (a**s * b * sub_angles.reshape(-1)).reshape(len(sub), -1).sum(axis=1)
            out[s][i] = weight @ radiance[chosen] / weight.sum()

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(one, range(len(n))))
    cube = next(iter(real_maps().values()))
    for s in (2, 128, 2048):
        k = count  # one pair, at 30 degrees
        check(out[s][k, :3], reference.glossy(cube, n[k], v[k], s, split=_SPLIT.get(s, 1)))
    return np.stack([out[s] for s in EXPONENTS])


def check(ours: NDArray, theirs: NDArray, tolerance: float = 1e-5) -> None:
    """Raises AssertionError where these sums differ from those of fastibl.reference."""
    worst = float(np.abs(ours - theirs).max() / max(np.abs(theirs).max(), 1e-12))
    if not worst <= tolerance:
        raise AssertionError(f"the benchmark's brute force differs from fastibl.reference by {worst:.2g}")
