"""Files of light for your own renderer: spherical harmonics, irradiance, prefiltered levels, lights."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import CubeMap, Environment, Light, _level_parameters
from .axes import HANDEDNESS, from_axes, handed, matrix, radiance_of, to_axes
from .environment_files import FACES, write_environment, write_faces
from .gltf_light import write_gltf_light
from .ktx2 import write_ktx2
from .lighting import Lighting, without_lights
from .pictures import write_picture
from .sh_files import CONVENTIONS, rounded, write_sh
from .usd import write_usd

FORMATS = ("hdr", "exr", "ktx2")
_SH_FILES = {"filament": ("sh.txt", "sh.json"), "three.js": ("probe.txt", "probe.json")}

SH_BASIS = (
    "real, orthonormal, no Condon-Shortley phase: 0.282095; 0.488603 y, z, x; 1.092548 xy, 1.092548 yz, "
    "0.315392 (3 z^2 - 1), 1.092548 xz, 0.546274 (x^2 - y^2); irradiance is the sum times pi, 2 pi/3, pi/4 by order"
)
_MANIFEST = "light.json"
# Axes of the files that are not in the axes that were asked for.
_AXES_OF = {"light.glb": "gltf", "light_dome.hdr": "dome of light.usda", "light_dome.exr": "dome of light.usda"}


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
    handedness: str | None = None,
    sh: Sequence[str] = (),
    gltf: bool = False,
    usd: bool = False,
    lights_apart: bool = False,
    picture: NDArray[np.float32] | None = None,
) -> dict[str, Any]:
    """Writes what a renderer needs to light with a map, and light.json, which describes the files; returns its content.

    axes: "gltf" (y up, as three.js and Filament) or "marker" (z up); everything is turned to these axes except
    light.glb, which is y up as glTF asks, and light.usda's picture, which is in the frame of its dome: light.json says
    each file's axes.
    size, levels, mapping, error: of the GGX set, see Lighting.prefiltered.
    irradiance: face edge of the irradiance cube, which holds E(n) (pi for radiance 1).
    format: "hdr" or "exr": the map as an equirectangular picture environment.<format>, cubes laid out as `layout` says,
    see write_environment. "ktx2": environment.ktx2, irradiance.ktx2, and all levels in one prefiltered.ktx2.
    handedness: that of all cubes, as in write_environment.
    sh: which conventions of `write_sh` to write, as sh.txt and sh.json ("filament"), probe.txt and probe.json
    ("three.js").
    gltf: whether to write light.glb, see `write_gltf_light`; usd: whether to write light.usda, see `write_usd`.
    lights_apart: by default the lights of light.json are also in all maps, for renderers that take no lights beside
    them; adding them would count their light twice. True takes them out of all files but environment.<format>, the map
    as it is seen, and writes environment_without_lights.<format>: as with `without_lights`, the rest of the map and the
    lights together are all of the light. light.json says which ("lights_in_maps").
    picture: equirectangular picture (h, 2 h, 3) of the same light in those axes, to be written unchanged as
    environment.<format>: a picture made from the map is 2 face edges high, and its small lights are blurred.
    Raises ValueError for other values, ImportError for "exr" without OpenEXR.
    """
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}, got {format!r}")
    if irradiance < 1:
        raise ValueError(f"irradiance must be at least 1 texel wide, got {irradiance}")
    for convention in (sh := (sh,) if isinstance(sh, str) else tuple(sh)):
        if convention not in CONVENTIONS:
            raise ValueError(f"sh must be of {', '.join(CONVENTIONS)}, got {convention!r}")
    if handedness is None:
        handedness = "left" if format == "ktx2" else "right"
    if handedness not in HANDEDNESS:
        raise ValueError(f"handedness must be one of {', '.join(HANDEDNESS)}, got {handedness!r}")
    if picture is not None and (format == "ktx2" or np.shape(picture)[1:] != (2 * len(picture), 3)):
        raise ValueError(f"picture must be (h, 2 h, 3), of format hdr or exr, got {np.shape(picture)}, {format}")
    radiance = radiance_of(cube)
    alphas = _level_parameters(mapping, levels)
    placed = _placed(cube, radiance, axes)
    rest, lights = without_lights(placed)
    if lights_apart:
        lit, lighting = from_axes(rest, axes), Lighting(rest)
    else:
        lit, lighting = radiance, Lighting(placed)
    made = [level for level in lighting.prefiltered(size, levels, mapping=mapping, error=error) if level is not None]
    diffuse = lighting.irradiance_cube(irradiance)
    manifest = {
        "axes": axes,
        "axes_from_marker": matrix(axes).tolist(),
        "faces": list(FACES),
        "layout": layout if format != "ktx2" else "ktx2",
        "handedness": handedness,
        "environment": f"environment.{format}",
        "sh9": {"basis": SH_BASIS, "radiance": rounded(lighting.sh9)},
        "lights": [_light(light) for light in lights],
        "lights_in_maps": not lights_apart,
        "environment_without_lights": f"environment_without_lights.{format}" if lights_apart else None,
        "centre": list(placed.centre) if isinstance(placed, Environment) else None,
    }
    written: dict[str, Any] = {"handedness": handedness} if format == "ktx2" else {"height": 2 * radiance.size}
    diffuse, *made = (handed(level, handedness) for level in (diffuse, *made))
    with _written_whole(Path(folder)) as part:
        if picture is None:
            write_environment(part / f"environment.{format}", radiance, axes=axes, **written)
        else:
            write_picture(part / f"environment.{format}", _clean(picture))
        if lights_apart:
            write_environment(part / f"environment_without_lights.{format}", lit, axes=axes, **written)
        write_cubes = _write_ktx2 if format == "ktx2" else partial(_write_pictures, format=format, layout=layout)
        cubes = write_cubes(part, diffuse, made)
        manifest["irradiance"] = {"size": irradiance, "files": cubes[0]}
        manifest["prefiltered"] = {
            "model": "D(theta/2) cos(theta) of GGX, normalised, view along the normal",
            "mapping": mapping,
            "levels": [
                {"size": level.size, "alpha": alpha, "roughness": float(np.sqrt(alpha)), "files": files}
                for level, alpha, files in zip(made, alphas, cubes[1:], strict=True)
            ],
        }
        manifest["also"] = _write_others(part, lit, axes, size, error, format, sh, gltf, usd)
        manifest["axes_of_files"] = {path.name: _AXES_OF.get(path.name, axes) for path in sorted(part.iterdir())}
        (part / _MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return manifest


@contextmanager
def _written_whole(folder: Path) -> Iterator[Path]:
    """A temporary folder whose files move to `folder` together once all of them are written; the manifest moves
    last."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as unfinished:
        yield Path(unfinished)
        (folder / _MANIFEST).unlink(missing_ok=True)  # it would list files that no longer exist
        for path in sorted(Path(unfinished).iterdir(), key=lambda path: path.name == _MANIFEST):
            os.replace(path, folder / path.name)


def _write_pictures(folder: Path, diffuse: CubeMap, made: list[CubeMap], format: str, layout: str) -> list[list[str]]:
    """Writes the maps; returns the names of the irradiance's files and of each level's."""
    names = ["irradiance", *(f"prefiltered_{k}" for k in range(len(made)))]
    return [
        [path.name for path in write_faces(folder / f"{name}.{format}", cube, layout)]
        for name, cube in zip(names, (diffuse, *made), strict=True)
    ]


def _write_ktx2(folder: Path, diffuse: CubeMap, made: list[CubeMap]) -> list[list[str]]:
    write_ktx2(folder / "irradiance.ktx2", [diffuse.faces])
    write_ktx2(folder / "prefiltered.ktx2", [level.faces for level in made])
    return [["irradiance.ktx2"]] + [["prefiltered.ktx2"]] * len(made)


def _write_others(
    folder: Path, radiance: CubeMap, axes: str, size: int, error: float, format: str, sh: Sequence[str], gltf: bool,
    usd: bool,
) -> list[str]:  # fmt: skip
    """Writes what was asked for besides the maps; returns the names."""
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


def _clean(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """As a CubeMap is on entry."""
    return np.clip(np.nan_to_num(np.asarray(picture, np.float32), nan=0, posinf=1e9), 0, 1e9)


def _placed(cube: CubeMap | Environment, radiance: CubeMap, axes: str) -> CubeMap | Environment:
    """The map in the named axes, with the place where it was seen from and its near lights, if these are known."""
    turned = to_axes(radiance, axes)
    if not isinstance(cube, Environment):
        return turned
    turn, lights = matrix(axes), cube.light_positions
    placed = np.concatenate([lights[:, :3] @ turn.T, lights[:, 3:]], axis=1)
    return Environment(turned, centre=turn @ np.array(cube.centre), lights=placed)


def _light(light: Light) -> dict[str, Any]:
    return {
        "direction": [float(v) for v in light.direction],
        "angular_radius": float(light.angular_radius),
        "irradiance": [float(v) for v in light.irradiance],
        "position": None if light.position is None else [float(v) for v in light.position],
    }
