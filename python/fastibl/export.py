"""Light for one's own renderer, in files: spherical harmonics, irradiance, prefiltered levels, lights."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from ._fastibl import CubeMap, Environment, _level_parameters
from .axes import matrix, to_axes
from .environment_files import FACES, write_environment, write_faces
from .lighting import Lighting

SH_BASIS = (
    "real, orthonormal, no Condon-Shortley phase: 0.282095; 0.488603 y, z, x; 1.092548 xy, 1.092548 yz, "
    "0.315392 (3 z^2 - 1), 1.092548 xz, 0.546274 (x^2 - y^2); irradiance is the sum times pi, 2 pi/3, pi/4 by order"
)


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
) -> dict[str, Any]:
    """Writes what a renderer needs to be lit by a map, and light.json, which says what is in the files; returns it.

    axes: "gltf" (y up, as three.js and Filament) or "marker" (z up); everything is turned to them. size, levels,
    mapping, error: of the GGX set, see Lighting.prefiltered. irradiance: face edge of the irradiance cube, which holds
    E(n) (pi for radiance 1). format: "hdr" or "exr". layout: of all cube files, see write_environment. The map
    itself is written as environment.<format>, equirectangular. Raises ValueError for what is none of these.
    """
    if format not in ("hdr", "exr"):
        raise ValueError(f'format must be "hdr" or "exr", got {format!r}')
    if irradiance < 1:
        raise ValueError(f"irradiance must be at least 1 texel wide, got {irradiance}")
    radiance = cube.radiance if isinstance(cube, Environment) else cube
    alphas = _level_parameters(mapping, levels)
    turned = to_axes(radiance, axes)
    lighting = Lighting(turned)
    made = lighting.prefiltered(size, levels, mapping=mapping, error=error)
    diffuse = lighting.irradiance_cube(irradiance)

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)

    def written(name: str, cube: CubeMap) -> list[str]:
        return [path.name for path in write_faces(folder / f"{name}.{format}", cube, layout)]

    write_environment(folder / f"environment.{format}", radiance, axes=axes)
    manifest = {
        "axes": axes,
        "axes_from_marker": matrix(axes).tolist(),
        "faces": list(FACES),
        "layout": layout,
        "environment": f"environment.{format}",
        "sh9": {"basis": SH_BASIS, "radiance": np.round(lighting.sh9.astype(np.float64), 8).tolist()},
        "irradiance": {"size": irradiance, "files": written("irradiance", diffuse)},
        "prefiltered": {
            "model": "D(theta/2) cos(theta) of GGX, normalised, view along the normal",
            "mapping": mapping,
            "levels": [
                {
                    "size": level.size,
                    "alpha": alpha,
                    "roughness": float(np.sqrt(alpha)),
                    "files": written(f"prefiltered_{k}", level),
                }
                for k, (level, alpha) in enumerate(zip(made, alphas, strict=True))
            ],
        },
        "lights": [_light(light) for light in getattr(lighting, "lights", ())],
    }
    (folder / "light.json").write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return manifest


def _light(light: Any) -> dict[str, Any]:
    return {
        "direction": [float(v) for v in light.direction],
        "angular_radius": float(light.angular_radius),
        "irradiance": [float(v) for v in light.irradiance],
    }
