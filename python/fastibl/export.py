"""Light for one's own renderer, in files: spherical harmonics, irradiance, prefiltered levels, lights."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ._fastibl import CubeMap, Environment, _level_parameters
from .axes import handed, matrix, radiance_of, to_axes
from .environment_files import FACES, write_environment, write_faces
from .gltf_light import write_gltf_light
from .ktx2 import write_ktx2
from .lighting import Lighting
from .sh_files import CONVENTIONS, write_sh
from .usd import write_usd

FORMATS = ("hdr", "exr", "ktx2")
_SH_FILES = {"filament": ("sh.txt", "sh.json"), "three.js": ("probe.txt", "probe.json")}

SH_BASIS = (
    "real, orthonormal, no Condon-Shortley phase: 0.282095; 0.488603 y, z, x; 1.092548 xy, 1.092548 yz, "
    "0.315392 (3 z^2 - 1), 1.092548 xz, 0.546274 (x^2 - y^2); irradiance is the sum times pi, 2 pi/3, pi/4 by order"
)
_MANIFEST = "light.json"


def export_light(
    cube: CubeMap | Environment,
    folder: str | os.PathLike[str],
    *,
    axes: str = "gltf",
    size: int = 128,
    levels: int = 7,
    mapping: str = "gltf",
    irradiance: int = 16,
    format: str = "hdr",
    layout: str = "strip",
    error: float = 0.002,
    handedness: str = "left",
    sh: Sequence[str] = (),
    gltf: bool = False,
    usd: bool = False,
) -> dict[str, Any]:
    """Writes what a renderer needs to be lit by a map, and light.json, which says what is in the files; returns it.

    axes: "gltf" (y up, as three.js and Filament) or "marker" (z up); everything is turned to them. size, levels,
    mapping, error: of the GGX set, see Lighting.prefiltered. irradiance: face edge of the irradiance cube, which holds
    E(n) (pi for radiance 1).
    format: "hdr" or "exr": the map as an equirectangular picture environment.<format>, cubes laid out as `layout` says,
    see write_environment. "ktx2": environment.ktx2, irradiance.ktx2, and all levels in one prefiltered.ktx2, with
    `handedness` as in write_environment.
    sh: conventions of `write_sh` to write, as sh.txt and sh.json ("filament"), probe.txt and probe.json ("three.js").
    gltf: whether to write light.glb, see `write_gltf_light`; usd: light.usda, see `write_usd`.
    Raises ValueError for what is none of these, ImportError for "exr" without OpenEXR.
    """
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, got {format!r}")
    if irradiance < 1:
        raise ValueError(f"irradiance must be at least 1 texel wide, got {irradiance}")
    for convention in (sh := (sh,) if isinstance(sh, str) else tuple(sh)):
        if convention not in CONVENTIONS:
            raise ValueError(f"sh must be of {', '.join(CONVENTIONS)}, got {convention!r}")
    radiance = radiance_of(cube)
    alphas = _level_parameters(mapping, levels)
    turned = to_axes(radiance, axes)
    lighting = Lighting(turned)
    made = [level for level in lighting.prefiltered(size, levels, mapping=mapping, error=error) if level is not None]
    diffuse = lighting.irradiance_cube(irradiance)
    manifest = {
        "axes": axes,
        "axes_from_marker": matrix(axes).tolist(),
        "faces": list(FACES),
        "layout": layout if format != "ktx2" else "ktx2",
        "handedness": handedness if format == "ktx2" else "right",
        "environment": f"environment.{format}",
        "sh9": {"basis": SH_BASIS, "radiance": np.round(lighting.sh9.astype(np.float64), 8).tolist()},
        "lights": [_light(light) for light in getattr(lighting, "lights", ())],
    }
    with _written_whole(Path(folder)) as part:
        write_environment(part / f"environment.{format}", radiance, axes=axes, handedness=handedness)
        if format == "ktx2":
            cubes = _write_ktx2(part, diffuse, made, handedness)
        else:
            cubes = _write_pictures(part, diffuse, made, format, layout)
        manifest["irradiance"] = {"size": irradiance, "files": cubes[0]}
        manifest["prefiltered"] = {
            "model": "D(theta/2) cos(theta) of GGX, normalised, view along the normal",
            "mapping": mapping,
            "levels": [
                {"size": level.size, "alpha": alpha, "roughness": float(np.sqrt(alpha)), "files": files}
                for level, alpha, files in zip(made, alphas, cubes[1:], strict=True)
            ],
        }
        manifest["also"] = _write_others(part, radiance, axes, size, error, format, sh, gltf, usd)
        (part / _MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return manifest


@contextmanager
def _written_whole(folder: Path) -> Iterator[Path]:
    """A folder whose files go into `folder` together, if all could be written; the manifest last."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as unfinished:
        yield Path(unfinished)
        (folder / _MANIFEST).unlink(missing_ok=True)  # it would speak of files that are there no more
        for path in sorted(Path(unfinished).iterdir(), key=lambda path: path.name == _MANIFEST):
            os.replace(path, folder / path.name)


def _write_pictures(folder: Path, diffuse: CubeMap, made: list[CubeMap], format: str, layout: str) -> list[list[str]]:
    """Names of the irradiance's files, and of each level's."""
    names = ["irradiance", *(f"prefiltered_{k}" for k in range(len(made)))]
    return [
        [path.name for path in write_faces(folder / f"{name}.{format}", cube, layout)]
        for name, cube in zip(names, (diffuse, *made), strict=True)
    ]


def _write_ktx2(folder: Path, diffuse: CubeMap, made: list[CubeMap], handedness: str) -> list[list[str]]:
    write_ktx2(folder / "irradiance.ktx2", [handed(diffuse, handedness).faces])
    write_ktx2(folder / "prefiltered.ktx2", [handed(level, handedness).faces for level in made])
    return [["irradiance.ktx2"]] + [["prefiltered.ktx2"]] * len(made)


def _write_others(
    folder: Path, radiance: CubeMap, axes: str, size: int, error: float, format: str, sh: Sequence[str], gltf: bool,
    usd: bool,
) -> list[str]:  # fmt: skip
    """Writes what was asked for beside the maps; returns the names."""
    also = []
    for convention in sh:
        for name in _SH_FILES[convention]:
            write_sh(folder / name, radiance, convention, axes)
            also.append(name)
    if gltf:
        write_gltf_light(folder / "light.glb", radiance, size, error)
        also.append("light.glb")
    if usd:
        picture = "exr" if format == "exr" else "hdr"
        also += [path.name for path in write_usd(folder / "light.usda", radiance, axes, picture)]
    return also


def _light(light: Any) -> dict[str, Any]:
    return {
        "direction": [float(v) for v in light.direction],
        "angular_radius": float(light.angular_radius),
        "irradiance": [float(v) for v in light.irradiance],
    }
