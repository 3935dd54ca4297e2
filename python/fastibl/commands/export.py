"""fastibl export: light for one's own renderer."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..axes import HANDEDNESS, NAMES
from ..environment_files import LAYOUTS
from ..export import FORMATS
from ..sh_files import CONVENTIONS
from ._arguments import add_colours_of_map, parser


def add(commands: argparse._SubParsersAction) -> None:
    p = parser(
        commands,
        "export",
        run,
        "write spherical harmonics, irradiance and prefiltered levels of a map for another renderer",
        "fastibl export venice_sunset_1k.hdr --out light --format ktx2 --sh filament --gltf --usd",
    )
    p.add_argument(
        "environment", type=Path, metavar="MAP", help=".hdr, .exr, .ktx2, .dds, or .png, .jpg with --response"
    )
    p.add_argument("--out", type=Path, default=Path("light"), help="folder to write (default: %(default)s)")
    p.add_argument(
        "--axes", choices=NAMES, default="gltf",
        help="z up (marker), y up, or as these engines have them (default: %(default)s)",
    )  # fmt: skip
    p.add_argument("--map-axes", choices=NAMES, default="marker", help="those of the map (default: %(default)s)")
    add_colours_of_map(p)
    p.add_argument("--irradiance", type=int, default=16, help="face edge of the irradiance (default: %(default)s)")

    levels = p.add_argument_group("prefiltered levels")
    levels.add_argument("--size", type=int, default=128, help="face edge of the sharpest (default: %(default)s)")
    levels.add_argument("--levels", type=int, default=7, help="of the GGX set (default: %(default)s)")
    levels.add_argument(
        "--mapping",
        choices=("gltf", "filament", "unity"),
        default="gltf",
        help="of levels to roughness (default: %(default)s)",
    )
    levels.add_argument("--error", type=float, default=0.002, help="that maps stay below (default: %(default)s)")

    files = p.add_argument_group("files", "light.json, which is always written, says what is in them")
    files.add_argument(
        "--format",
        choices=FORMATS,
        default="hdr",
        help="pictures, or cubes of half floats with their levels (default: hdr)",
    )
    files.add_argument("--layout", choices=LAYOUTS[1:], default="strip", help="of cubes in pictures (default: strip)")
    files.add_argument(
        "--handedness", choices=HANDEDNESS,
        help="of cubes' coordinates; left is as three.js and Babylon.js look them up (default: left of ktx2 and dds, "
        "the axes' own of pictures)",
    )  # fmt: skip
    files.add_argument(
        "--sh", nargs="+", choices=CONVENTIONS, default=(), help="also nine spherical harmonics as these take them"
    )
    files.add_argument(
        "--lights-apart", action="store_true",
        help="take the lights of light.json out of all maps but environment, for renderers that add them as lamps",
    )  # fmt: skip
    files.add_argument("--gltf", action="store_true", help="also light.glb, a glTF scene with EXT_lights_image_based")
    files.add_argument("--usd", action="store_true", help="also light.usda, an OpenUSD dome light")


def _face_edge(size: int, width: int) -> int:
    """Face edge of the map that a picture becomes. Four faces around keep the picture's resolution; it is a power of
    two, so that all MIP levels are whole. More than 2048 would take seconds and gigabytes."""
    return max(size, 128, min(1 << (width // 4 - 1).bit_length(), 2048))


def run(arguments: argparse.Namespace) -> int:
    from ..environment_files import from_equirect, read_environment, read_equirect, turn_equirect
    from ..export import export_light
    from ..pictures import LINEAR

    if arguments.size < 1:
        raise ValueError(f"size must be at least 1, got {arguments.size}")
    picture = read_equirect(arguments.environment, arguments.response, arguments.primaries)
    if picture is None:
        cube = read_environment(
            arguments.environment, axes=arguments.map_axes, response=arguments.response, primaries=arguments.primaries
        )
    else:
        cube = from_equirect(picture, _face_edge(arguments.size, picture.shape[1]), arguments.map_axes)
        is_picture = f".{arguments.format}" in LINEAR
        picture = turn_equirect(picture, arguments.map_axes, arguments.axes) if is_picture else None
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
        handedness=arguments.handedness,
        sh=arguments.sh,
        gltf=arguments.gltf,
        usd=arguments.usd,
        lights_apart=arguments.lights_apart,
        picture=picture,
    )
    levels = manifest["prefiltered"]["levels"]
    print(
        f"wrote {arguments.out / 'light.json'}: 9 spherical harmonics, irradiance at {arguments.irradiance}^2, "
        f"{len(levels)} GGX levels from {levels[0]['size']}^2, {len(manifest['lights'])} lights "
        + ("(also in the maps)" if manifest["lights_in_maps"] else "(not in the maps)")
        + "".join(f", {name}" for name in manifest["also"])
    )
    return 0
