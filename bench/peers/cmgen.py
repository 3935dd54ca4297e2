"""Filament's cmgen from Debian's libfilament-tools, on its own cubes of 256 squared."""

from __future__ import annotations

import re
import shutil
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.environment_files import FACES
from fastibl.pictures import read_picture

from .. import inputs
from ..measure import Row, measure
from .shared import convolved, cpu_timing, nmae, normals, over_maps, run, some_texels

SIZE, LEVELS = 256, 5


def _program() -> str:
    found = shutil.which("cmgen")
    if found is None:
        raise FileNotFoundError("no cmgen: apt install libfilament-tools")
    return found


def _faces(folder: Path, prefix: str = "") -> NDArray:
    return np.stack([read_picture(folder / f"{prefix}{face}.hdr") for face in FACES])


@cache
def _made() -> tuple[dict[str, list[NDArray]], list[float]]:
    """For each map, cmgen's own cube followed by its GGX levels from 1 on; and the CPU seconds of each run."""
    made, seconds = {}, []
    for name, path in inputs.MAPS.items():
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            command = [_program(), "--quiet", "--no-mirror", f"--size={SIZE}", "--format=hdr"]
            _, _, time = run([*command, f"--ibl-ld={folder}", str(path)])
            seconds.append(time)
            run([*command, f"--extract={folder}", str(path)])
            there = folder / path.stem
            made[name] = [_faces(there), *(_faces(there, f"m{k}_") for k in range(1, LEVELS))]
    return made, seconds


def _harmonics(window: str) -> tuple[dict[str, NDArray], list[float]]:
    """Polynomial coefficients of E/pi by map, as Filament's shader reads them, and CPU seconds."""
    out, seconds = {}, []
    for name, path in inputs.MAPS.items():
        with tempfile.TemporaryDirectory() as temporary:
            text = Path(temporary) / "sh.txt"
            command = [_program(), "--quiet", "--no-mirror", f"--size={SIZE}", "--sh=3", "--sh-shader"]
            _, _, time = run([*command, f"--sh-window={window}", f"--sh-output={text}", str(path)])
            seconds.append(time)
            lines = re.findall(r"\(([^()]*)\);", text.read_text())
            out[name] = np.array([[float(v) for v in line.split(",")] for line in lines])
    return out, seconds


def harmonics() -> list[Row]:
    """Irradiance by cmgen's nine harmonics, and by ours, on cmgen's own cubes."""
    cubes = {name: levels[0] for name, levels in _made()[0].items()}
    n = normals()
    x, y, z = n.T
    basis = np.stack([1 + 0 * x, y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y])
    true = {name: reference.irradiance(cube, n) for name, cube in cubes.items()}
    metric = "nMAE of the irradiance; seconds a map"
    out = []
    for window in ("no", "auto"):
        made, seconds = _harmonics(window)
        errors = {name: nmae(np.pi * np.maximum(basis.T @ sh, 0), true[name]) for name, sh in made.items()}
        setting = f"--sh=3 --sh-window={window}, picture to coefficients"
        out += over_maps("cmgen", metric, errors, cpu_timing(seconds), setting)
    maps = [fastibl.CubeMap(cube) for cube in cubes.values()]
    for method in (fastibl.Method("sh9"), fastibl.Method("irradiance-cube", size=32, source=32)):
        errors = {
            name: nmae(fastibl.Lighting(cube, diffuse=method).irradiance(n), true[name])
            for name, cube in zip(cubes, maps, strict=True)
        }
        # "mip" makes nothing besides: the default would find lights and filter the map for lobes, too.
        time = measure(lambda cube, m=method: fastibl.Lighting(cube, diffuse=m, glossy="mip"), maps, 9).of_cpu
        setting = "cube to light" if method.name == "sh9" else "size=32, source=32, cube to light"
        out += over_maps(f"fastibl {method.name}", metric, errors, time, setting)
    return out


def ggx() -> list[Row]:
    """cmgen's five GGX levels, and ours, compared with sums over every texel of cmgen's own cubes."""
    made, seconds = _made()
    cubes = [levels[0] for levels in made.values()]
    lightings = [fastibl.Lighting(fastibl.CubeMap(cube), diffuse="sh9", glossy="mip") for cube in cubes]
    settings = {"error=0.002": 0.002, "error=0.005": 0.005}
    ours, times = {}, {}
    for setting, error in settings.items():

        def prefilter(lighting, error=error):
            return lighting.prefiltered(SIZE, LEVELS, mapping="filament", error=error)

        ours[setting] = [prefilter(lighting) for lighting in lightings]
        times[setting] = measure(prefilter, lightings, len(lightings), warm=0).of_cpu
    out = []
    for k in range(1, LEVELS):
        roughness = 1 - np.sqrt(1 - k / (LEVELS - 1))  # lodToPerceptualRoughness
        size, alpha = SIZE >> k, float(roughness**2)
        true = convolved(cubes, size, alpha)
        some = some_texels(size)
        metric = f"nMAE of the GGX level alpha={alpha:.3g} at {size}^2; seconds all {LEVELS} levels"
        errors = {name: nmae(made[name][k].reshape(-1, 3)[some], true[i]) for i, name in enumerate(made)}
        out += over_maps("cmgen", metric, errors, cpu_timing(seconds), "1024 samples, picture to levels")
        for setting in settings:
            errors = {
                name: nmae(ours[setting][i][k].faces.reshape(-1, 3)[some], true[i]) for i, name in enumerate(made)
            }
            out += over_maps("fastibl prefiltered", metric, errors, times[setting], f"{setting}, cube to levels")
    return out
