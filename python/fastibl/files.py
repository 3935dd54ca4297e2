"""Reading meshes."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Sequence
from numbers import Real
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import gltf, obj_object, plain_meshes
from ._fastibl import Material, Mesh, Response, _polygon_triangles, _read_obj
from .expected import expect
from .file_limits import MOST_CORNERS, check_file_size, file_bytes
from .parts import Part, normals_of
from .rounded_places import Offset, offset_of, warn_of_offset

_MOST_HEADER = 2**20  # bytes of the header of a .ply
_COLOURED = (".obj", ".ply")  # endings of files whose vertices may have colours
_Found = tuple[Mesh, Offset]
_MOST_OF_ONE = 1.5  # colours whose white is 1 hardly exceed it, as in the reader of .obj
_COLOUR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))  # in a .ply


def read_mesh(path: str | os.PathLike[str], up: str = "y", uvs: bool = False, colors: bool = False) -> Mesh:
    """Triangle mesh of a file (.obj, .ply, .glb, .gltf, .stl, .off), turned so that +z is up.

    up: the file's upward axis, "y" (most files) or "z". Vertices with the same place and normal become one. Normals are
    the file's own; where it has none, they are smooth, across texture seams as well, but flat in glTF, as that format
    requires. uvs: whether to keep those of an .obj, for textures of Material.pbr; vertices are divided at seams,
    corners without uvs get (0, 0), and a file without uvs gives Mesh.uvs None. colors: whether to keep the vertices'
    colours of an .obj (as MeshLab writes them) or .ply, which are taken as sRGB; a file without colours gives
    Mesh.colors None. Polygons are cut into triangles. Of a mesh that lies so far from its origin that float32 would
    round it, a common offset is subtracted, with a warning. Raises FileNotFoundError; ValueError for a file that is not
    such a mesh, is damaged, or is larger than fastibl.file_limits allows, and for the uvs or colours of other files.
    """
    path = _existing(path, up, "mesh")
    if path.suffix.lower() not in _READERS:
        raise ValueError(f"{path} is no mesh that is read; those end in {', '.join(_READERS)}")
    if uvs and path.suffix.lower() != ".obj":
        raise ValueError(f"uvs are read of .obj files, got {path}; read_object keeps those of .glb and .gltf")
    if colors and path.suffix.lower() not in _COLOURED:
        raise ValueError(
            f"colours are read of {' and '.join(_COLOURED)} files, got {path}; read_object keeps those of .glb, .gltf"
        )
    check_file_size(path)
    try:
        found = _READERS[path.suffix.lower()](path, uvs, colors)
    except Exception as error:  # plyfile may raise anything
        raise ValueError(f"{path} is not a mesh that can be read: {error}") from error
    if found is None or len(found[0].triangles) == 0:
        raise ValueError(f"{path} holds no triangles")
    mesh, offset = found
    warn_of_offset(path, mesh, offset, stacklevel=2)
    return _turned(mesh, up)


def read_object(path: str | os.PathLike[str], up: str = "y") -> tuple[Mesh, Material]:
    """Mesh and material of a glTF 2.0 file (.glb, .gltf), or of an .obj with its .mtl, turned so that +z is up.

    up: the file's upward axis, "y" (most files) or "z". The mesh keeps the file's uvs, normals and colours; the
    material is Material.pbr with the file's textures. Several meshes and materials become one: see fastibl.gltf and
    fastibl.obj_object for how and for what is left out. An .obj without materials gets Material(diffuse=(1, 1, 1))
    where it has colours, else Material(). Raises FileNotFoundError, or ValueError for a file that cannot be read.
    """
    path = _existing(path, up, "object")
    if path.suffix.lower() not in _OBJECTS:
        raise ValueError(f"{path} is none of {', '.join(_OBJECTS)}; read_mesh reads the mesh of other files")
    mesh, material = mesh_and_material(path, up)
    return mesh, material or Material()


def mesh_and_material(path: str | os.PathLike[str], up: str = "y") -> tuple[Mesh, Material | None]:
    """A mesh as read_mesh reads it, with its colours; and its own material, or one that shows the colours, or None."""
    path = Path(path)
    reader = _OBJECTS.get(path.suffix.lower())
    if reader is None:
        mesh, material = read_mesh(path, up, colors=path.suffix.lower() in _COLOURED), None
    else:
        _existing(path, up, "object")
        try:
            mesh, material, offset = reader(path)
        except ValueError as error:
            raise ValueError(f"{path} is not an object that can be read: {error}") from error
        warn_of_offset(path, mesh, offset, stacklevel=3)
        mesh = _turned(mesh, up)
    if material is None and mesh.colors is not None:
        material = Material(diffuse=(1, 1, 1))
    return mesh, material


def _existing(path: str | os.PathLike[str], up: str, what: str) -> Path:
    if up not in ("y", "z"):
        raise ValueError(f'up must be "y" or "z", got {up!r}')
    if not Path(path).is_file():
        raise FileNotFoundError(f"no {what} at {path}")
    return Path(path)


def _turned(mesh: Mesh, up: str) -> Mesh:
    if up == "z":
        return mesh
    turn = lambda a: None if a is None else a[:, [0, 2, 1]] * np.array([1, -1, 1], np.float32)  # noqa: E731
    return Mesh(turn(mesh.vertices), mesh.triangles, mesh.uvs, turn(mesh._given_normals), mesh.colors)


def _merged(
    vertices: NDArray, triangles: NDArray, normals: NDArray | None = None, colors: NDArray | None = None
) -> tuple[Mesh, Offset]:
    """Vertices at one place with the same normal and colour become one vertex; vertices of no triangle are dropped."""
    if vertices.shape[1:] != (3,):
        raise ValueError(f"expected vertices of 3 coordinates, got {vertices.shape[1:]}")
    used, named = np.unique(triangles, return_inverse=True)
    offset = offset_of([vertices[used]])
    both = np.asarray(vertices - offset.xyz if any(offset.xyz) else vertices, np.float32) + 0.0  # turns -0 into 0
    for more in (normals, colors):
        if more is not None:
            both = np.hstack([both, np.asarray(more, np.float32) + 0.0])
    _, first, same = np.unique(both[used], axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # keeps the order of the file
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    kept = both[used[first[order]]]
    mesh = Mesh(
        kept[:, :3], number[same.reshape(-1)][named.reshape(-1)].reshape(-1, 3), None,
        None if normals is None else kept[:, 3:6], None if colors is None else kept[:, -3:],
    )  # fmt: skip
    return mesh, offset


def _read_obj_file(path: Path, uvs: bool, colors: bool) -> _Found:
    mesh, offset = _read_obj(file_bytes(path), uvs, colors)
    return mesh, Offset(offset)


def _read_gltf(path: Path, *_: bool) -> _Found:
    mesh, offset = gltf.read_geometry(path)
    return _merged(mesh.vertices, mesh.triangles, mesh.normals)[0], offset


def _read_ply(path: Path, _: bool, colors: bool) -> _Found | None:
    from plyfile import PlyData

    content = _without_remarks(file_bytes(path))
    data = PlyData.read(io.BytesIO(content), mmap=False, known_list_len={})  # of text, it leaves files open
    if "face" not in data or len(data["face"]) == 0:
        return None
    vertex = data["vertex"].data
    places = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(np.float64)
    named = {"nx", "ny", "nz"} <= set(vertex.dtype.names)
    normals = np.stack([vertex[axis] for axis in ("nx", "ny", "nz")], axis=1) if named else None
    faces = data["face"].data
    corners = faces["vertex_indices" if "vertex_indices" in faces.dtype.names else "vertex_index"]
    triangles = _triangles_of(corners, places)
    if triangles is None:
        return None
    return _merged(places, triangles, _filled(normals, places, triangles), _colours_of(vertex) if colors else None)


def _filled(normals: NDArray | None, places: NDArray, triangles: NDArray) -> NDArray | None:
    """A file's normals with smooth ones where it has none that is one; None where it has none at all."""
    if normals is None:
        return None
    finite = np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, 0).astype(np.float64)
    return normals_of(Part(places, triangles, finite, {}, 0)) if finite.any() else None


def _triangles_of(polygons: Sequence[NDArray], places: NDArray) -> NDArray[np.int64] | None:
    """Polygons cut into triangles; without those of fewer than three corners."""
    polygons = [polygon for polygon in polygons if len(polygon) > 2]
    if not polygons:
        return None
    most = max(len(polygon) for polygon in polygons)
    if most > MOST_CORNERS:
        raise ValueError(f"a face may have {MOST_CORNERS} corners, got {most}")
    named = np.concatenate(polygons).astype(np.int64)
    if named.min() < 0 or named.max() >= len(places):
        raise ValueError(f"a face names vertex {named.min() if named.min() < 0 else named.max()} of {len(places)}")
    three = [polygon for polygon in polygons if len(polygon) == 3]
    triangles = [np.stack(three)] if three else []
    triangles += [polygon[_polygon_triangles(places[polygon])] for polygon in polygons if len(polygon) > 3]
    return np.concatenate(triangles).astype(np.int64)


def _colours_of(vertex: NDArray) -> NDArray | None:
    """Linear colours (v, 3) of a .ply's vertices; whole numbers range to 255 (or 65535), others to 1, or to 255 where
    one exceeds 1.5, as in an .obj."""
    names = next((n for n in _COLOUR_NAMES if set(n) <= set(vertex.dtype.names or ())), None)
    if names is None:
        return None
    encoded = np.stack([vertex[name] for name in names], axis=1)
    to_255 = encoded.dtype.kind == "i" or (encoded > _MOST_OF_ONE).any()
    white = np.iinfo(encoded.dtype).max if encoded.dtype.kind == "u" else 255 if to_255 else 1
    return Response.srgb().decode((encoded / white).astype(np.float32))


def _without_remarks(content: bytes) -> bytes:
    """A .ply without its remarks, which plyfile reads as ASCII only. Raises ValueError for one that is shorter than its
    header claims: plyfile reads elements that take no bytes as often as the header says."""
    newline = b"\r\n" if content[3:5] == b"\r\n" else content[3:4] or b"\n"
    kept: list[bytes] = []
    counts: list[list[int]] = []  # numbers of rows and properties of each element
    end = 0
    for line in content[:_MOST_HEADER].split(newline):
        words, end = line.split(), end + len(line + newline)
        if words[:1] not in ([b"comment"], [b"obj_info"]):
            kept.append(line)
        if words[:1] == [b"element"] and len(words) == 3:
            counts.append([max(int(words[2]), 0), 0])
        elif words[:1] == [b"property"] and counts:
            counts[-1][1] += 1
        elif words[:1] == [b"end_header"]:
            break
    else:
        raise ValueError(f"its header does not end within {_MOST_HEADER} bytes")
    least = sum(rows * max(properties, 1) for rows, properties in counts)
    if least > len(content):
        raise ValueError(f"its header counts elements of {least} bytes or more; it has {len(content)}")
    return newline.join(kept) + content[end - len(newline) :]


def _read_off(path: Path, *_: bool) -> _Found | None:
    places, polygons, normals = plain_meshes.read_off(path)
    triangles = _triangles_of(polygons, places)
    return None if triangles is None else _merged(places, triangles, _filled(normals, places, triangles))


def _read_stl(path: Path, *_: bool) -> _Found | None:
    corners = plain_meshes.read_stl(path)
    return None if len(corners) == 0 else _merged(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


_OBJECTS: dict[str, Callable[[Path], tuple[Mesh, Material | None, Offset]]] = {
    ".glb": gltf.read, ".gltf": gltf.read, ".obj": obj_object.read,
}  # fmt: skip
# The reader of each kind of file; its arguments are the path, whether uvs are wanted, and whether colours are.
_READERS: dict[str, Callable[[Path, bool, bool], _Found | None]] = {
    ".obj": _read_obj_file, ".ply": _read_ply, ".glb": _read_gltf, ".gltf": _read_gltf,
    ".stl": _read_stl, ".off": _read_off,
}  # fmt: skip


def stand(mesh: Mesh, height: float | None = None, *, width: float | None = None, scale: float | None = None) -> Mesh:
    """The mesh in the marker frame: scaled, centred on the z axis, lowest point on z = 0.

    One of three says how large it becomes: height along z in metres; width in metres, the longer of its extents along x
    and y, as for a rug; or scale, metres of a unit of the mesh: 1 keeps the size of a glTF file, 0.01 is for
    centimetres. Raises ValueError for none or several of them, one that is not positive and finite, or a mesh without
    extent along what is given; TypeError for what is no number.
    """
    expect(mesh, Mesh, "mesh")
    given = {k: v for k, v in (("height", height), ("width", width), ("scale", scale)) if v is not None}
    if len(given) != 1:
        raise ValueError(f"one of height, width and scale must be given, got {' and '.join(given) or 'none'}")
    ((name, size),) = given.items()
    expect(size, Real, name, "metres of a unit of the mesh" if name == "scale" else "metres")
    if not (np.isfinite(size) and size > 0):
        unit = "" if name == "scale" else " (metres)"
        raise ValueError(f"{name} must be positive and finite{unit}, got {size}")
    vertices = mesh.vertices.astype(np.float64)
    used = vertices[np.unique(mesh.triangles)]
    lower, upper = used.min(axis=0), used.max(axis=0)
    x, y, z = upper - lower
    extent = {"height": z, "width": max(x, y), "scale": 1.0}[name]
    if not extent > 0:
        along, others = ("z", "width or scale") if name == "height" else ("x and y", "height or scale")
        raise ValueError(f"a mesh without extent along {along} cannot be scaled to a {name}; give its {others}")
    origin = np.array([(lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2, lower[2]])
    placed = (vertices - origin) * (size / extent)
    return Mesh(placed, mesh.triangles, mesh.uvs, mesh._given_normals, mesh.colors)
