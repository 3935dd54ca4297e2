"""The paper's shadow in hand-written AVX code: one cone and one light fetch per sphere and pixel, without a shadow map.

It is compiled on first use with the system's C++ compiler into the cache folder; `load` says what is missing. The table
of the light, which a captured map would need anew for every frame, is made beforehand and not timed.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference

from ..brute import CACHE

FINEST = 7  # the largest level of the table is 2^7 texels wide: 16384 over the half sphere
_SOURCE = Path(__file__).with_suffix(".cpp")
_FLAGS = ("-std=c++17", "-O3", "-march=native", "-fPIC", "-shared", "-fno-math-errno", "-Wno-ignored-attributes")


@cache
def load() -> ctypes.CDLL:
    """The compiled code. Raises RuntimeError where there is no compiler, or no AVX2."""
    names = [n for n in (os.environ.get("CXX"), "g++", "clang++", "c++") if n and shutil.which(n.split()[0])]
    compiler = names[0] if names else None
    if compiler is None:
        raise RuntimeError("the per-pixel cone sum needs a C++ compiler (apt install g++)")
    version = subprocess.run([*compiler.split(), "--version"], capture_output=True, text=True).stdout
    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    key = hashlib.sha256("".join([_SOURCE.read_text(), version, *_FLAGS, *flags.split("\n\n")[:1]]).encode())
    path = CACHE / f"cone_sum-{key.hexdigest()[:16]}.so"
    if not path.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}.part")
        done = subprocess.run([*compiler.split(), *_FLAGS, _SOURCE, "-o", part], capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"the per-pixel cone sum does not compile here: {done.stderr.strip()[:300]}")
        part.replace(path)
    return ctypes.CDLL(str(path))


class ConeSum:
    """Call it with points x, y (n,) float32, n a multiple of 16; returns the ratio's channels (3, n)."""

    def __init__(self, cube: fastibl.CubeMap, spheres: NDArray):
        self._code = load()
        self.table, self.scale = light_table(cube)
        x, y, z, r = np.asarray(spheres, np.float32).T
        keep = (r > 0) & (z > 0)
        x, y, z, r = x[keep], y[keep], z[keep], r[keep]
        ready = [x + y, x - y, z, 2 * z * z, 4 * r * r, 2**1.5 * np.pi * z * r * r]
        self.spheres = np.ascontiguousarray(np.stack(ready, axis=1), np.float32)
        self.out = np.empty((3, 0), np.float32)

    @property
    def width(self) -> int:
        """Pixels in a register."""
        return self._code.cone_sum_width()

    def __call__(self, x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
        if x.dtype != np.float32 or y.dtype != np.float32 or len(x) != len(y) or len(x) % 16:
            raise ValueError("x and y must be float32 of one length, a multiple of 16")
        if self.out.shape[1] != len(x):
            self.out = np.empty((3, len(x)), np.float32)
        arrays = (self.table, self.scale, *self.out)
        table, scale, red, green, blue = (ctypes.c_void_p(a.ctypes.data) for a in arrays)
        self._code.cone_sum(
            ctypes.c_void_p(x.ctypes.data),
            ctypes.c_void_p(y.ctypes.data),
            len(x),
            ctypes.c_void_p(self.spheres.ctypes.data),
            len(self.spheres),
            table,
            FINEST,
            scale,
            red,
            green,
            blue,
        )
        return self.out


def light_table(cube: fastibl.CubeMap) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """The pyramid of packed texels, and the factor by which the sums of their floats are multiplied, by channel."""
    n = 1 << FINEST
    split = 4
    axis = (np.arange(n * split) + 0.5) / (n * split) * 2 - 1
    u, v = np.meshgrid(axis, axis)  # column, row
    x, y = (u + v) / 2, (u - v) / 2
    z = 1 - np.abs(x) - np.abs(y)
    d = np.stack([x, y, z], axis=-1)
    length = np.linalg.norm(d, axis=-1)
    angle = length**-3.0  # solid angle divided by the area of the square, up to a constant
    texel = np.sqrt(4 * np.pi / (6 * cube.size**2))
    level = max(0.0, float(np.log2(np.sqrt(2 * np.pi) / (n * split) / texel)))
    light = cube.sample(d, level).astype(np.float64) * angle[..., None]

    def halved(a: NDArray, by: int) -> NDArray:
        m = a.shape[0] // by
        return a.reshape(m, by, m, by, *a.shape[2:]).sum(axis=(1, 3))

    light, angle = halved(light, split), halved(angle, split)
    irradiance = reference.irradiance(cube, [(0.0, 0.0, 1.0)])[0]
    levels = []
    for _ in range(FINEST + 1):
        levels.append((light / angle[..., None]).reshape(-1, 3))
        light, angle = (halved(light, 2), halved(angle, 2)) if len(light) > 1 else (light, angle)
    # The level of 4^k texels begins at 4^k; what lies between levels is never read.
    means = np.zeros((2 << 2 * FINEST, 3))
    for level_means in levels:
        means[len(level_means) : 2 * len(level_means)] = level_means
    scale = np.where(irradiance > 0, means.max(axis=0) / 6e4, 1)  # floats of 5 bits of exponent reach 65024
    inverse = np.where(irradiance > 0, scale / np.where(irradiance > 0, irradiance, 1), 0)
    return _packed(means / scale), (inverse * 2.0**112).astype(np.float32)


def _packed(colours: NDArray) -> NDArray[np.uint32]:
    """Floats of 11, 11 and 10 bits packed into 32 bits. When read back, green and blue have their neighbours' bits
    below their last one. So green and blue are cut while red is rounded, which makes none of them too large or too
    small in the mean."""
    halves = np.minimum(colours, 6.5e4).astype(np.float16).view(np.uint16).astype(np.uint32)
    red = (halves[:, 0] + 8) >> 4
    return np.ascontiguousarray(red | halves[:, 1] >> 4 << 11 | halves[:, 2] >> 5 << 22, np.uint32)
