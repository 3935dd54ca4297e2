"""fastibl export: light for one's own renderer."""

from __future__ import annotations

import argparse
from pathlib import Path

from ._arguments import parser


def add(commands: argparse._SubParsersAction) -> None:
    p = parser(
        commands,
        "export",
        run,
        "write spherical harmonics, irradiance and prefiltered levels of a map for another renderer",
        "fastibl export venice_sunset_1k.hdr --out light --size 256 --format exr",
    )
    p.add_argument("environment", type=Path, metavar="MAP", help="equirectangular .hdr or .exr, or cube faces")
    p.add_argument("--out", type=Path, default=Path("light"), help="folder to write (default: %(default)s)")
    p.add_argument("--axes", choices=("gltf", "marker"), default="gltf", help="y up or z up (default: %(default)s)")
    p.add_argument(
        "--map-axes", choices=("marker", "gltf"), default="marker", help="those of the map (default: %(default)s)"
    )
    p.add_argument("--size", type=int, default=128, help="face edge of the sharpest level (default: %(default)s)")
    p.add_argument("--levels", type=int, default=7, help="of the GGX set (default: %(default)s)")
    p.add_argument(
        "--mapping", choices=("gltf", "filament"), default="gltf", help="of levels to roughness (default: %(default)s)"
    )
    p.add_argument("--irradiance", type=int, default=16, help="face edge of the irradiance (default: %(default)s)")
    p.add_argument("--format", choices=("hdr", "exr"), default="hdr", help="default: %(default)s")
    p.add_argument("--layout", choices=("strip", "faces", "cross"), default="strip", help="default: %(default)s")
    p.add_argument("--error", type=float, default=0.002, help="of a level that maps stay below (default: %(default)s)")


def run(arguments: argparse.Namespace) -> int:
    from ..environment_files import read_environment
    from ..export import export_light

    if arguments.size < 1:
        raise ValueError(f"size must be at least 1, got {arguments.size}")
    cube = read_environment(arguments.environment, size=arguments.size, axes=arguments.map_axes)
    manifest = export_light(
        cube,
        arguments.out,
        axes=arguments.axes,
        size=arguments.size,
        levels=arguments.levels,
        mapping=arguments.mapping,
        irradiance=arguments.irradiance,
        format=arguments.format,
        layout=arguments.layout,
        error=arguments.error,
    )
    levels = manifest["prefiltered"]["levels"]
    print(
        f"wrote {arguments.out / 'light.json'}: 9 spherical harmonics, irradiance at {arguments.irradiance}^2, "
        f"{len(levels)} GGX levels from {levels[0]['size']}^2, {len(manifest['lights'])} lights"
    )
    return 0
