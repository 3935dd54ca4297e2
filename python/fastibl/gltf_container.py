"""The parts of a glTF 2.0 file (.glb, .gltf): JSON, bytes, and the tree of nodes; bounded, whatever the file claims."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .file_limits import FolderFiles, file_bytes

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
# What is raised while reading a file whose JSON is not as glTF defines it.
DAMAGES = (
    KeyError, IndexError, TypeError, AttributeError, OverflowError, RecursionError, struct.error, UnicodeDecodeError,
    OSError,
)  # fmt: skip


class NotThere(ValueError):
    """A file that is named does not exist."""


class Container:
    """json: the file's content. chunk: bytes of a .glb's second part. Raises ValueError for what is not glTF 2."""

    def __init__(self, path: Path):
        self.path, data = path, file_bytes(path)
        self.chunk = b""
        self._files = FolderFiles(path, len(data))
        if data[:4] == b"glTF":
            data, self.chunk = _chunks(data)
        self.json = json.loads(data)
        if not isinstance(self.json, dict):
            raise ValueError("it is no glTF file")
        version = self.json.get("asset", {}).get("version", "")
        if not str(version).startswith("2"):
            raise ValueError(f"expected glTF 2, got version {version}")

    def bytes(self, uri: str | None) -> bytes:
        """Bytes of a uri: without one, the chunk of a .glb; else data in the uri itself, or a file in the folder.

        Raises ValueError for a uri that leaves the folder, and for more than fastibl.file_limits allows.
        """
        if uri is None:
            return self.chunk
        if uri.startswith("data:"):
            return base64.b64decode(unquote(uri.partition(",")[2]))
        try:
            return self._files.bytes(unquote(uri))
        except FileNotFoundError as error:  # if the file itself is missing, another error is raised
            raise NotThere(str(error)) from None

    def nodes(self) -> Iterator[tuple[int, dict[str, Any], NDArray[np.float64]]]:
        """Nodes of the scene, each once, by number, with the matrix (4, 4) that takes it to the scene.

        Raises ValueError where they do not form a tree: glTF forbids it, and nodes that share children would double the
        work at every step.
        """
        every, scenes = self.json.get("nodes", []), self.json.get("scenes")
        if scenes:
            roots = scenes[self.json.get("scene", 0)].get("nodes", [])
        else:
            roots = sorted(set(range(len(every))) - {c for node in every for c in node.get("children", ())})
        todo, seen = [(root, np.eye(4)) for root in roots], set()
        while todo:
            index, parent = todo.pop()
            if index in seen:
                raise ValueError("its nodes form a ring, or one has two parents")
            seen.add(index)
            here = parent @ _transform(every[index])
            todo += [(child, here) for child in every[index].get("children", ())]
            yield index, every[index], here


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """The JSON chunk and the binary chunk of a .glb."""
    length, kind = struct.unpack_from("<II", data, 12)
    if kind != 0x4E4F534A:
        raise ValueError("its first chunk is not JSON")
    at = 20 + length
    if at + 8 > len(data):
        return data[20:at], b""
    size, _ = struct.unpack_from("<II", data, at)
    return data[20:at], data[at + 8 : at + 8 + size]


def _transform(node: dict[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    return transform(**{k: node[k] for k in ("translation", "rotation", "scale") if k in node})


def transform(
    translation: ArrayLike = (0, 0, 0), rotation: ArrayLike = (0, 0, 0, 1), scale: ArrayLike = (1, 1, 1)
) -> NDArray[np.float64]:
    """Matrices (..., 4, 4) of T R S. rotation: (..., 4), quaternions x y z w, of any length; others (..., 3)."""
    t, s = np.asarray(translation, np.float64), np.asarray(scale, np.float64)
    q = np.asarray(rotation, np.float64)
    x, y, z, w = np.moveaxis(q / np.maximum(np.linalg.norm(q, axis=-1, keepdims=True), 1e-30), -1, 0)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    out = np.zeros((*np.broadcast_shapes(t.shape[:-1], s.shape[:-1], x.shape), 4, 4))
    out[..., :3, :3] = np.moveaxis(turn, (0, 1), (-2, -1)) * s[..., None, :]
    out[..., :3, 3], out[..., 3, 3] = t, 1
    return out
