"""Reading meshes."""

from __future__ import annotations

import os
from numbers import Real
from pathlib import Path

import numpy as np

from ._fastibl import Material, Mesh
from .expected import expect
from .file_limits import check_file_size

_MESHES = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")


def read_mesh(path: str | os.PathLike[str], up: str = "y") -> Mesh:
    """Triangle mesh of a file (.obj, .ply, .glb, .gltf, .stl, .off), turned so that +z is up.

    up: the file's upward axis, "y" (most files) or "z". Vertices at the same place are merged, so that normals
    are smooth across texture seams. Raises FileNotFoundError; ValueError for a file that is no such mesh, damaged, or
    larger than fastibl.file_limits allows.
    """
    import trimesh

    from . import gltf_container

    path = Path(path)
    if up not in ("y", "z"):
        raise ValueError(f'up must be "y" or "z", got {up!r}')
    if not path.is_file():
        raise FileNotFoundError(f"no mesh at {path}")
    if path.suffix.lower() not in _MESHES:  # others of trimesh's are archives, or fetch what they name
        raise ValueError(f"{path} is no mesh that is read; those end in {', '.join(_MESHES)}")
    check_file_size(path)
    try:
        if path.suffix.lower() in (".glb", ".gltf"):
            gltf_container.check(path)
        loaded = trimesh.load(path, force="mesh", process=False, skip_materials=True)
        if len(getattr(loaded, "faces", ())) > 0:
            loaded.merge_vertices(merge_tex=True, merge_norm=True)
    except Exception as error:  # trimesh raises what its loaders raise
        raise ValueError(f"{path} is not a mesh that can be read: {error}") from error
    if len(getattr(loaded, "faces", ())) == 0:
        raise ValueError(f"{path} holds no triangles")
    vertices = np.asarray(loaded.vertices, np.float64)
    if vertices.shape[1:] != (3,):
        raise ValueError(f"{path} must have vertices of 3 coordinates, got {vertices.shape[1:]}")
    if up == "y":
        vertices = vertices[:, [0, 2, 1]] * [1, -1, 1]
    return Mesh(vertices, np.asarray(loaded.faces, np.int64))


def read_object(path: str | os.PathLike[str], up: str = "y") -> tuple[Mesh, Material]:
    """Mesh and material of a glTF 2.0 file (.glb, .gltf), turned so that +z is up.

    up: the file's upward axis, "y" (glTF's) or "z". The mesh keeps the file's uvs and normals; the material is
    Material.pbr with the file's textures. Several meshes and materials become one: see fastibl.gltf for how and for
    what is left out. Raises FileNotFoundError, or ValueError for a file that cannot be read.
    """
    from . import gltf

    path = Path(path)
    if up not in ("y", "z"):
        raise ValueError(f'up must be "y" or "z", got {up!r}')
    if not path.is_file():
        raise FileNotFoundError(f"no object at {path}")
    if path.suffix.lower() not in (".glb", ".gltf"):
        raise ValueError(f"{path} is no .glb or .gltf; read_mesh reads the mesh of other files")
    try:
        mesh, material = gltf.read(path)
    except ValueError as error:
        raise ValueError(f"{path} is not an object that can be read: {error}") from error
    if up == "y":
        turned = [a[:, [0, 2, 1]] * np.float32([1, -1, 1]) for a in (mesh.vertices, mesh.normals)]
        mesh = Mesh(turned[0], mesh.triangles, mesh.uvs, turned[1])
    return mesh, material


def stand(mesh: Mesh, height: float) -> Mesh:
    """The mesh in the marker frame: scaled to `height` metres, centred on the z axis, lowest point on z = 0.

    Raises ValueError for a height that is not positive and finite, or a flat mesh.
    """
    expect(mesh, Mesh, "mesh")
    expect(height, Real, "height", "metres")
    if not (np.isfinite(height) and height > 0):
        raise ValueError(f"height must be positive and finite (metres), got {height}")
    vertices = mesh.vertices.astype(np.float64)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    if not upper[2] > lower[2]:
        raise ValueError("a mesh without extent along z cannot be scaled to a height")
    origin = np.array([(lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2, lower[2]])
    return Mesh((vertices - origin) * (height / (upper[2] - lower[2])), mesh.triangles, mesh.uvs, mesh._given_normals)
