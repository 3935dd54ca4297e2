"""Nine spherical harmonics in files, as other renderers take them."""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import CubeMap, Environment
from .axes import radiance_of, to_axes
from .lighting import Lighting
from .whole_file import path_ending, write_whole

CONVENTIONS = ("filament", "three.js")

NAMES = ("L00", "L1-1", "L10", "L11", "L2-2", "L2-1", "L20", "L21", "L22")
# Factors of the real orthonormal basis 1; y, z, x; xy, yz, 3 z^2 - 1, xz, x^2 - y^2.
BASIS = np.sqrt(np.array([1 / 4, 3 / 4, 3 / 4, 3 / 4, 15 / 4, 15 / 4, 5 / 16, 15 / 4, 15 / 16]) / np.pi)
# Factors of the clamped cosine, by order: they turn radiance into irradiance. Ramamoorthi and Hanrahan 2001, Eq. 8.
COSINE = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)


def spherical_harmonics(cube: CubeMap | Environment, convention: str, axes: str = "gltf") -> NDArray[np.float64]:
    """Nine coefficients (9, 3) of a map in a renderer's convention, in the order L00, L1-1, L10, L11, L2-2, ..., L22.

    convention: "filament", as cmgen writes and `IndirectLight::Builder::irradiance` and shaders take them: irradiance
    over pi, by the bare polynomials 1; y, z, x; xy, yz, 3 z^2 - 1, xz, x^2 - y^2. "three.js", as in
    `SphericalHarmonics3` of a `LightProbe`: radiance, by the orthonormal basis. Axes are those of write_environment.
    Raises ValueError for another convention or other axes.
    """
    if convention not in CONVENTIONS:
        raise ValueError(f"convention must be one of {', '.join(CONVENTIONS)}, got {convention!r}")
    radiance = Lighting(to_axes(radiance_of(cube), axes)).sh9.astype(np.float64)
    if convention == "three.js":
        return radiance
    return radiance * (BASIS * COSINE / np.pi)[:, None]


def write_sh(
    path: str | os.PathLike[str], cube: CubeMap | Environment, convention: str = "filament", axes: str = "gltf"
) -> None:
    """Writes nine spherical harmonics of a map as .txt or .json, in a renderer's convention.

    convention: see `spherical_harmonics`. "filament" as .txt is like cmgen's sh.txt; "three.js" as .json is a
    LightProbe for THREE.ObjectLoader. The other combinations are nine rows of three numbers; .json holds them as "sh",
    with the convention and axes beside them. Raises ValueError for another convention, other axes or another ending.
    """
    path = path_ending(path, ".txt", ".json")
    rows = spherical_harmonics(cube, convention, axes)
    if path.suffix.lower() == ".txt":
        write_whole(path, _text(rows, convention))
        return
    content = _light_probe(rows) if convention == "three.js" else _named(rows, convention, axes)
    write_whole(path, json.dumps(content, indent=1) + "\n")


def _text(rows: NDArray[np.float64], convention: str) -> str:
    if convention == "filament":  # cmgen's own format, which Filament's samples parse
        lines = (f"({', '.join(f'{v:18.15f}' for v in row)}); // {name}, irradiance, pre-scaled base" for row, name in
                 zip(rows, NAMES, strict=True))  # fmt: skip
    else:
        lines = (" ".join(f"{v:.9g}" for v in row) for row in rows)
    return "\n".join(lines) + "\n"


def _named(rows: NDArray[np.float64], convention: str, axes: str) -> dict[str, object]:
    return {"convention": convention, "axes": axes, "order": NAMES, "sh": rounded(rows)}


def _light_probe(rows: NDArray[np.float64]) -> dict[str, object]:
    # three.js' JSON Object format 4, as LightProbe.toJSON writes it and ObjectLoader parses it.
    light = {"type": "LightProbe", "name": "fastibl", "color": 0xFFFFFF, "intensity": 1, "sh": sum(rounded(rows), [])}
    return {"metadata": {"version": 4.6, "type": "Object", "generator": "fastibl"}, "object": light}


def rounded(rows: NDArray[Any]) -> list[list[float]]:
    """Rows rounded to nine significant digits, which float32 has at most, so that dim maps keep their digits."""
    return [[float(f"{v:.9g}") for v in row] for row in rows]
