"""Writes a folder with a three.js page, the light of a map and a figurine; see README.md."""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import numpy as np
import trimesh

import fastibl

PAGE = ("index.html", "scene.js", "light.js", "material.js", "decode.js")


def albedo_table(size: int = 24) -> np.ndarray:
    """(size, size, 2): directional albedo of GGX by roughness, sqrt(0.02) to 1, and by the cosine's square root."""
    cosine = np.linspace(0, 1, size) ** 2
    views = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=-1)
    return fastibl.ggx_albedo(np.tile(views, (size, 1, 1)), np.linspace(np.sqrt(0.02), 1, size)[:, None])


def make_scene(environment: fastibl.CubeMap, folder: Path, size: int = 128) -> None:
    """Light in glTF's axes, the figurine with y up, and the page."""
    fastibl.export_light(environment, folder, axes="gltf", size=size, layout="strip", format="hdr")
    (folder / "ggx_albedo.json").write_text(json.dumps(np.round(albedo_table().astype(float), 5).tolist()))
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
