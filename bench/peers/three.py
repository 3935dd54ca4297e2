"""three.js' light probe on the CPU, run by Node."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

import numpy as np

import fastibl

from .. import brute, inputs
from ..measure import Row, measure, timing
from .shared import irradiance_of, nmae, over_maps, run

VERSION = "0.187.0"
_SCRIPT = Path(__file__).with_name("light_probe.mjs")


def _folder() -> Path:
    """A folder that contains three.js, which is fetched once."""
    if not (shutil.which("node") and shutil.which("npm")):
        raise FileNotFoundError("no node and npm")
    folder = brute.CACHE / f"three-{VERSION}"
    if not (folder / "node_modules" / "three").is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "package.json").write_text('{"private": true}')
        run(["npm", "install", "--silent", "--no-audit", "--no-fund", f"three@{VERSION}"], cwd=folder)
    return folder


def light_probe() -> list[Row]:
    """LightProbeGenerator.fromCubeRenderTarget on float faces, which are handed over as if they had been read back."""
    folder = _folder()
    shutil.copy(_SCRIPT, folder)  # beside node_modules, where it finds its imports
    maps = inputs.real_maps()
    metric = "nMAE of the irradiance; seconds a map of 128^2"
    errors, walls = {}, []
    with tempfile.TemporaryDirectory() as temporary:
        for name, cube in maps.items():
            rgba = np.ones((*cube.faces.shape[:3], 4), np.float32)
            rgba[..., :3] = cube.faces
            path = Path(temporary) / f"{name}.bin"
            path.write_bytes(rgba.tobytes())
            text, _, _ = run(["node", folder / _SCRIPT.name, path, cube.size])
            made = json.loads(text)
            walls += made["seconds"]
            true = brute.irradiance()[name]
            errors[name] = nmae(np.maximum(irradiance_of(np.array(made["sh"]), brute.normals()), 0), true)
    out = over_maps("three.js LightProbe", metric, errors, timing(walls, walls), f"r{VERSION.split('.')[1]}, Node")
    errors = {
        name: nmae(fastibl.Lighting(cube, diffuse="sh9").irradiance(brute.normals()), brute.irradiance()[name])
        for name, cube in maps.items()
    }
    time = measure(lambda cube: fastibl.Lighting(cube, diffuse="sh9", glossy="mip"), list(maps.values()), 9).of_cpu
    return out + over_maps("fastibl sh9", metric, errors, time)
