"""Files of light for your own renderer: spherical harmonics, irradiance, prefiltered levels, lights."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from . import texels
from . import usd as usd_files
from ._fastibl import CubeMap, Environment, Light, _level_parameters
from .axes import HANDEDNESS, from_axes, handed, handedness_of, matrix, radiance_of, to_axes
from .environment_files import CUBE_WRITERS, FACES, check_face_layout, write_environment, write_faces
from .expected import expect
from .file_limits import check_face_edge
from .gltf_light import check_gltf_size, write_gltf_light
from .lighting import Lighting, without_lights
from .pictures import LINEAR, write_picture
from .sh_files import CONVENTIONS, rounded, write_sh

_CUBES = tuple(ending[1:] for ending in CUBE_WRITERS)  # of half floats, with their levels
FORMATS = (*(ending[1:] for ending in LINEAR), *_CUBES)
_USUAL = (2**-10, np.inf)  # mean radiance of maps that are written as half floats as they are
_SH_FILES = {"filament": ("sh.txt", "sh.json"), "three.js": ("probe.txt", "probe.json")}

SH_BASIS = (
    "real, orthonormal, no Condon-Shortley phase: 0.282095; 0.488603 y, z, x; 1.092548 xy, 1.092548 yz, "
    "0.315392 (3 z^2 - 1), 1.092548 xz, 0.546274 (x^2 - y^2); irradiance is the sum times pi, 2 pi/3, pi/4 by order"
)
_MANIFEST = "light.json"
_MOST_IRRADIANCE = 256  # texels along an edge
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

    axes: "gltf" (y up, as three.js and Filament), "marker" (z up), "unity" or "godot", see write_environment;
    everything is turned to these axes, harmonics and lights included, except light.glb, which is y up as glTF asks,
    light.usda, which is y up for axes that no stage can have, and its picture, which is in the frame of its dome:
    light.json says each file's axes.
    size, levels, mapping, error: of the GGX set, see Lighting.prefiltered.
    irradiance: face edge of the irradiance cube, which holds E(n) (pi for radiance 1).
    format: "hdr" or "exr": the map as an equirectangular picture environment.<format>, cubes laid out as `layout` says,
    see write_environment. "ktx2" or "dds", half floats: environment.ktx2, irradiance.ktx2, and all levels in one
    prefiltered.ktx2. Light that half floats cannot hold (brighter than 65504, or 1/1024 in the mean) is divided by a
    power of two, with a warning: the "intensity" of light.json, which a renderer multiplies these cubes by.
    handedness: that of all cubes' coordinates, as in write_environment; harmonics and lights are in the axes.
    sh: which conventions of `write_sh` to write, as sh.txt and sh.json ("filament"), probe.txt and probe.json
    ("three.js").
    gltf: whether to write light.glb, see `write_gltf_light`, for which `size` must be a power of two of 32 or more;
    usd: whether to write light.usda, see `write_usd`.
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
    check_face_edge("size", size)
    expect(irradiance, SupportsIndex, "irradiance")
    if not 1 <= irradiance <= _MOST_IRRADIANCE:
        raise ValueError(f"irradiance must be 1 to {_MOST_IRRADIANCE} texels wide, got {irradiance}")
    expect(sh, Iterable, "sh", f"names of conventions: {', '.join(CONVENTIONS)}")
    expect(picture, (np.ndarray, type(None)), "picture")
    for convention in (sh := (sh,) if isinstance(sh, str) else tuple(sh)):
        if convention not in CONVENTIONS:
            raise ValueError(f"sh must be of {', '.join(CONVENTIONS)}, got {convention!r}")
    if handedness is None:
        handedness = "left" if format in _CUBES else handedness_of(axes)
    if handedness not in HANDEDNESS:
        raise ValueError(f"handedness must be one of {', '.join(HANDEDNESS)}, got {handedness!r}")
    if format in _CUBES:
        texels.check_level_count(levels, size)
    else:
        check_face_layout(layout)
    if picture is not None and (
        format in _CUBES or not np.size(picture) or np.shape(picture)[1:] != (2 * len(picture), 3)
    ):
        raise ValueError(f"picture must be (h, 2 h, 3), of format hdr or exr, got {np.shape(picture)}, {format}")
    if gltf:
        check_gltf_size(size)
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
        "layout": format if format in _CUBES else layout,
        "handedness": handedness,
        "intensity": 1.0,
        "environment": f"environment.{format}",
        "sh9": {"basis": SH_BASIS, "radiance": rounded(lighting.sh9)},
        "lights": [_light(light) for light in lights],
        "lights_in_maps": not lights_apart,
        "environment_without_lights": f"environment_without_lights.{format}" if lights_apart else None,
        "centre": list(placed.centre) if isinstance(placed, Environment) else None,
    }
    diffuse, *made = (handed(level, handedness, axes) for level in (diffuse, *made))
    maps = {f"environment.{format}": radiance} | ({f"environment_without_lights.{format}": lit} if lights_apart else {})
    with _written_whole(Path(folder)) as part:
        if format in _CUBES:
            cubes_of_maps = {name: handed(to_axes(m, axes), handedness, axes) for name, m in maps.items()}
            cubes, manifest["intensity"] = _write_cubes(part, cubes_of_maps, diffuse, made, format)
        else:
            if picture is not None:
                write_picture(part / f"environment.{format}", _clean(picture))
                del maps[f"environment.{format}"]
            for name, m in maps.items():
                write_environment(part / name, m, axes=axes, height=2 * radiance.size)
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
        manifest["also"] = _write_others(part, lit, axes, size, error, format, sh, gltf, usd)
        axes_of = _AXES_OF | {"light.usda": _stage_axes(axes)}
        manifest["axes_of_files"] = {path.name: axes_of.get(path.name, axes) for path in sorted(part.iterdir())}
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


def _write_cubes(
    folder: Path, maps: dict[str, CubeMap], diffuse: CubeMap, made: list[CubeMap], format: str
) -> tuple[list[list[str]], float]:
    """Writes cubes of half floats; returns the names as `_write_pictures` does, and what the texels are divided by."""
    levels = {
        **{name: [cube] for name, cube in maps.items()},
        f"irradiance.{format}": [diffuse],
        f"prefiltered.{format}": made,
    }
    brightest = max(float(cube.faces.max()) for cubes in levels.values() for cube in cubes)
    mean = float(np.mean(next(iter(maps.values())).mean()))
    intensity = texels.intensity(mean, brightest, texels.HALF_MAX, _USUAL)
    if intensity != 1:
        warnings.warn(
            f"half floats do not hold this light, up to {brightest:.3g}, {mean:.3g} in the mean: all cubes hold it "
            f"divided by {intensity:g}, the intensity of light.json",
            stacklevel=3,
        )
    for name, cubes in levels.items():
        CUBE_WRITERS[f".{format}"](folder / name, [np.float32(1 / intensity) * cube.faces for cube in cubes])
    return [[f"irradiance.{format}"]] + [[f"prefiltered.{format}"]] * len(made), intensity


def _write_others(
    folder: Path, radiance: CubeMap, axes: str, size: int, error: float, format: str, sh: Sequence[str], gltf: bool,
    usd: bool,
) -> list[str]:  # fmt: skip
    """Writes what was asked for besides the maps; returns the names."""
    also: list[str] = []
    for convention in sh:
        for name in _SH_FILES[convention]:
            write_sh(folder / name, radiance, convention, axes)
            also.append(name)
    if gltf:
        write_gltf_light(folder / "light.glb", radiance, size, error)
        also.append("light.glb")
    if usd:
        picture = "exr" if format == "exr" else "hdr"
        also += [path.name for path in usd_files.write_usd(folder / "light.usda", radiance, _stage_axes(axes), picture)]
    return also


def _stage_axes(axes: str) -> str:
    return axes if axes in usd_files.AXES else "gltf"


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
