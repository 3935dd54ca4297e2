"""Writes a folder with a three.js page, the light of a map and a figurine; see README.md."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import numpy as np
import trimesh

import fastibl

PAGE = ("index.html", "scene.js", "light.js", "material.js", "decode.js")


def make_scene(environment: fastibl.CubeMap, folder: Path, size: int = 128) -> None:
    """Light in glTF's axes, the figurine with y up, and the page."""
    fastibl.export_light(environment, folder, axes="gltf", size=size, layout="strip", format="hdr")
    mesh = fastibl.shapes.figurine(0.9)
    y_up = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    figurine = trimesh.Trimesh(
        mesh.vertices @ y_up.T, mesh.triangles, vertex_normals=mesh.normals @ y_up.T, process=False
    )
    figurine.export(folder / "figurine.glb", include_normals=True)
    for name in PAGE:
        shutil.copy(Path(__file__).parent / name, folder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("environment", type=Path, nargs="?", help=".hdr or .exr (default: the built-in room)")
    parser.add_argument("--out", type=Path, default=Path("scene"), help="folder to write (default: %(default)s)")
    parser.add_argument("--size", type=int, default=256, help="face edge of the sharpest level (default: %(default)s)")
    given = parser.parse_args()
    if given.environment is None:
        from fastibl.room import Room

        cube = Room().truth(size=given.size)
    else:
        cube = fastibl.read_environment(given.environment, size=given.size)
    make_scene(cube, given.out, given.size)
    print(f"wrote {given.out}: python -m http.server --directory {given.out}")


if __name__ == "__main__":
    main()
