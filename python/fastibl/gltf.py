"""glTF 2.0 files (.glb, .gltf): one mesh with its material.

All nodes of the file's scene are merged. Several materials become one: their textures are laid side by side in an
atlas, each in a cell with a margin of 1/16, so that textures that repeat need a file of one material, and cells mix
where they are seen smaller than 1/16. Left out: transparency, occlusion maps (P_V takes their place), vertex colours,
skins and morphs. Refused by name: extensions that change what is read here, compressed meshes, a second set of uvs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Material, Mesh
from .file_limits import MOST_PIXELS, MOST_VERTICES
from .gltf_container import DAMAGES, WIDTHS, Container
from .picture_headers import jpeg_size, png_size
from .pictures import decode_picture

_TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_KNOWN = {"KHR_materials_anisotropy", "KHR_materials_emissive_strength", "KHR_mesh_quantization"}
_ATLAS = 4096  # texels along an edge, at most


@dataclass
class _Surface:
    """A material as arrays: linear floats, or constants. Maps are (h, w, 3), but metallic and roughness (h, w)."""

    base_color: NDArray = field(default_factory=lambda: np.ones(3, np.float32))
    metallic: Any = 1.0
    roughness: Any = 1.0
    emission: NDArray = field(default_factory=lambda: np.zeros(3, np.float32))
    normal: NDArray | None = None
    normal_scale: float = 1.0
    anisotropy: float = 0.0
    anisotropy_rotation: float = 0.0

    def maps(self) -> list[NDArray]:
        every = (self.base_color, self.metallic, self.roughness, self.emission, self.normal)
        return [m for m in every if m is not None and np.ndim(m) >= 2]

    def material(self) -> Material:
        return Material.pbr(
            self.base_color, self.metallic, self.roughness, self.normal, self.emission, anisotropy=self.anisotropy,
            anisotropy_rotation=self.anisotropy_rotation, normal_scale=self.normal_scale,
        )  # fmt: skip


@dataclass
class _Part:
    """A primitive in the file's frame; uvs with v upwards."""

    vertices: NDArray
    triangles: NDArray
    normals: NDArray
    uvs: NDArray | None
    material: int


class _File(Container):
    def __init__(self, path: Path):
        super().__init__(path)
        unknown = set(self.json.get("extensionsRequired", ())) - _KNOWN
        if unknown:
            raise ValueError(f"it requires the extension {sorted(unknown)[0]}")
        self.buffers = [self.bytes(b.get("uri")) for b in self.json.get("buffers", ())]
        self.pixels = self.vertices = 0

    def _view(self, index: int) -> tuple[bytes, int, int, int | None]:
        view = self.json["bufferViews"][index]
        return self.buffers[view["buffer"]], view.get("byteOffset", 0), view["byteLength"], view.get("byteStride")

    def array(self, index: int) -> NDArray:
        """Values (n, width) of an accessor; normalised integers as floats."""
        a = self.json["accessors"][index]
        if "sparse" in a or "bufferView" not in a:
            raise ValueError("it has sparse accessors")
        kind, width = np.dtype(_TYPES[a["componentType"]]).newbyteorder("<"), WIDTHS[a["type"]]
        buffer, offset, _, stride = self._view(a["bufferView"])
        offset += a.get("byteOffset", 0)
        step = stride or kind.itemsize * width
        if a["count"] < 1 or offset + step * (a["count"] - 1) + kind.itemsize * width > len(buffer):
            raise ValueError("an accessor reaches beyond its buffer")
        out = np.ndarray((a["count"], width), kind, buffer, offset, (step, kind.itemsize))
        if a.get("normalized") and kind.kind in "iu":
            return np.maximum(out.astype(np.float32) / np.iinfo(kind).max, -1)
        return out.copy()

    def picture(self, reference: dict[str, Any]) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 RGB of a texture that a material names."""
        if reference.get("texCoord", 0) != 0 or "KHR_texture_transform" in reference.get("extensions", {}):
            raise ValueError("its textures use a second set of uvs or KHR_texture_transform")
        source = self.json["textures"][reference["index"]].get("source")
        if source is None:
            raise ValueError("a texture has no picture of a kind that glTF 2 itself knows")
        image = self.json["images"][source]
        if "bufferView" in image:
            buffer, offset, length, _ = self._view(image["bufferView"])
            data = buffer[offset : offset + length]
        else:
            data = self.bytes(image["uri"])
        decoded = decode_picture(data, png_size if data[:1] == b"\x89" else jpeg_size, f"texture {source}")
        self.pixels += decoded.shape[0] * decoded.shape[1]
        if self.pixels > MOST_PIXELS:
            raise ValueError(f"its textures have more than {MOST_PIXELS} pixels together")
        return decoded if decoded.dtype == np.uint8 else (decoded >> 8).astype(np.uint8)

    def surface(self, index: int) -> _Surface:
        out = _Surface()
        if index < 0:
            return out
        m = self.json["materials"][index]
        pbr = m.get("pbrMetallicRoughness", {})
        extensions = m.get("extensions", {})
        out.base_color = np.asarray(pbr.get("baseColorFactor", [1, 1, 1, 1])[:3], np.float32)
        if "baseColorTexture" in pbr:
            out.base_color = out.base_color * _linear(self.picture(pbr["baseColorTexture"]))
        out.metallic, out.roughness = float(pbr.get("metallicFactor", 1)), float(pbr.get("roughnessFactor", 1))
        if "metallicRoughnessTexture" in pbr:
            picture = self.picture(pbr["metallicRoughnessTexture"]).astype(np.float32) / 255
            out.roughness, out.metallic = out.roughness * picture[..., 1], out.metallic * picture[..., 2]
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        out.emission = np.asarray(m.get("emissiveFactor", [0, 0, 0]), np.float32) * strength
        if "emissiveTexture" in m and out.emission.any():
            out.emission = out.emission * _linear(self.picture(m["emissiveTexture"]))
        if "normalTexture" in m:
            out.normal = self.picture(m["normalTexture"]).astype(np.float32) / 255
            out.normal_scale = float(m["normalTexture"].get("scale", 1))
        anisotropy = extensions.get("KHR_materials_anisotropy", {})
        if "anisotropyTexture" in anisotropy:
            raise ValueError("it has a texture of anisotropy")
        out.anisotropy = float(anisotropy.get("anisotropyStrength", 0))
        out.anisotropy_rotation = float(anisotropy.get("anisotropyRotation", 0))
        return out

    def parts(self) -> list[_Part]:
        out: list[_Part] = []
        for node, here in self.nodes():
            if "mesh" in node:
                for primitive in self.json["meshes"][node["mesh"]]["primitives"]:
                    out += self._part(primitive, here)
        return out

    def _part(self, primitive: dict[str, Any], transform: NDArray) -> list[_Part]:
        if primitive.get("mode", 4) != 4:
            return []  # points, lines; strips and fans are rare
        if primitive.get("extensions"):
            raise ValueError(f"its meshes use {sorted(primitive['extensions'])[0]}")
        attributes = primitive["attributes"]
        vertices = self.array(attributes["POSITION"]).astype(np.float64)
        self.vertices += len(vertices)
        if self.vertices > MOST_VERTICES:
            raise ValueError(f"it has more than {MOST_VERTICES} vertices")
        index = self.array(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertices))
        triangles = index[: len(index) // 3 * 3].reshape(-1, 3).astype(np.int64)
        linear = transform[:3, :3]
        if np.linalg.det(linear) < 0:
            triangles = triangles[:, ::-1]
        placed = vertices @ linear.T + transform[:3, 3]
        if "NORMAL" in attributes:
            normals = self.array(attributes["NORMAL"]).astype(np.float64) @ np.linalg.pinv(linear)
        else:  # smooth across vertices at one place
            places, same = np.unique(placed, axis=0, return_inverse=True)
            normals = Mesh(places, same.reshape(-1)[triangles]).normals[same.reshape(-1)]
        uvs = None
        if "TEXCOORD_0" in attributes:
            uvs = self.array(attributes["TEXCOORD_0"]).astype(np.float64) * [1, -1] + [0, 1]
        return [_Part(placed, triangles, normals, uvs, primitive.get("material", -1))]


def _linear(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    x = np.arange(256) / 255
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)[picture]


def _atlas(parts: list[_Part], surfaces: dict[int, _Surface]) -> _Surface:
    """One surface for all; the uvs of the parts are moved into the cells of its textures."""
    import cv2

    if len({(s.anisotropy, s.anisotropy_rotation) for s in surfaces.values()}) > 1:
        raise ValueError("its materials differ in anisotropy")
    columns = int(np.ceil(np.sqrt(len(surfaces))))
    largest = max((max(m.shape[:2]) for s in surfaces.values() for m in s.maps()), default=16)
    cell = int(min(2 ** np.ceil(np.log2(largest * 8 / 7)), _ATLAS // columns))
    margin = cell // 16
    inner, rows = cell - 2 * margin, -(-len(surfaces) // columns)
    width, height = columns * cell, rows * cell
    where = {m: divmod(k, columns) for k, m in enumerate(surfaces)}
    for part in parts:
        if surfaces[part.material].maps():
            if part.uvs is None:
                raise ValueError("a mesh with a texture has no uvs")
            uv = part.uvs - np.floor(part.uvs.min(axis=0) + 1e-4)
            if uv.max() > 1 + 1e-3:
                raise ValueError("a texture repeats, which is read from files of one material only")
        else:
            uv = np.full((len(part.vertices), 2), 0.5)
        row, column = where[part.material]
        part.uvs = np.stack(
            [(column * cell + margin + uv[:, 0] * inner) / width,
             1 - (row * cell + margin + (1 - uv[:, 1]) * inner) / height], axis=1,
        )  # fmt: skip

    def laid(name: str, channels: int, missing: Any) -> NDArray:
        sheet = np.zeros((height, width, channels), np.float32)
        for m, surface in surfaces.items():
            value = getattr(surface, name)
            value = np.asarray(missing if value is None else value, np.float32)
            if value.ndim < 2:
                value = np.broadcast_to(value, (1, 1, channels))
            value = value.reshape(*value.shape[:2], channels)
            if name == "normal":  # each its own scale: into the picture
                value = (value * 2 - 1) * [surface.normal_scale, surface.normal_scale, 1]
                value /= np.maximum(np.linalg.norm(value, axis=-1, keepdims=True), 1e-6)
                value = (value * 0.5 + 0.5).astype(np.float32)
            shrinks = max(value.shape[:2]) > inner
            value = cv2.resize(
                value, (inner, inner), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
            ).reshape(inner, inner, channels)  # fmt: skip
            row, column = where[m]
            sheet[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell] = np.pad(
                value, ((margin, margin), (margin, margin), (0, 0)), mode="edge"
            )
        return sheet if channels > 1 else sheet[..., 0]

    def joined(name: str, channels: int) -> Any:
        values = [getattr(s, name) for s in surfaces.values()]
        if all(np.ndim(v) < 2 and np.array_equal(v, values[0]) for v in values):
            return values[0]
        return np.clip(laid(name, channels, None), 0, None)

    first = next(iter(surfaces.values()))
    return _Surface(
        joined("base_color", 3), joined("metallic", 1), joined("roughness", 1), joined("emission", 3),
        laid("normal", 3, (0.5, 0.5, 1)) if any(s.normal is not None for s in surfaces.values()) else None,
        1.0, first.anisotropy, first.anisotropy_rotation,
    )  # fmt: skip


def read(path: Path) -> tuple[Mesh, Material]:
    """Mesh in the file's frame (y up) and material. Raises ValueError for what cannot be read, and says why."""
    try:
        file = _File(path)
        parts = file.parts()
        if not parts:
            raise ValueError("it holds no triangles")
        surfaces = {m: file.surface(m) for m in sorted({p.material for p in parts})}
    except DAMAGES as error:
        raise ValueError(f"it is damaged ({type(error).__name__}: {error})") from error
    surface = next(iter(surfaces.values())) if len(surfaces) == 1 else _atlas(parts, surfaces)
    if surface.maps() and any(p.uvs is None for p in parts):
        raise ValueError("a mesh with a texture has no uvs")
    # Flat triangles define no normal; any will do.
    normals = np.concatenate([p.normals for p in parts])
    normals[~np.isfinite(normals).all(axis=1)] = 0
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    mesh = Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.triangles + start for p, start in zip(parts, starts, strict=False)]),
        None if any(p.uvs is None for p in parts) else np.concatenate([p.uvs for p in parts]),
        normals,
    )
    return mesh, surface.material()
