"""glTF 2.0 files (.glb, .gltf): one mesh with its material.

All nodes of the file's scene are merged; skins show their rest pose; without normals triangles are flat, as glTF
requires. Several materials become one. Materials that look the same share their textures; the textures of the others
are laid side by side in an atlas (fastibl.atlas), and triangles across their borders are cut (fastibl.uv_borders). A
warning says what has to be shrunk there. Vertices' colours (COLOR_0) become the mesh's. What a texture's alpha makes
invisible is cut away (fastibl.cutouts): below the cutoff of MASK, and of BLEND below one half where the alpha is an
outline. Left out, with a warning that names them: other transparency, morphs, and extensions that add to a material
(clear coat, sheen, ...). Left out without a warning: occlusion maps (P_V takes their place), points and lines,
doubleSided (everything is seen from both sides), further sets of colours. Tangents are derived from the uvs; a warning
tells where a file's own differ. Refused by name: specular-glossiness materials, compressed meshes, and a material whose
textures lie in different ways on its mesh.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import Material, Mesh
from .file_limits import MOST_TRIANGLES, MOST_VERTICES
from .gltf_container import DAMAGES, WIDTHS, Container, NotThere, transform
from .one_material import joined
from .parts import Part, alike, cut_away, mesh_of
from .rounded_places import Offset, offset_of
from .surfaces import Cutout, Lie, Picture, Pictures, Surface, Texture

_TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_KNOWN = {
    "EXT_mesh_gpu_instancing", "KHR_materials_anisotropy", "KHR_materials_emissive_strength", "KHR_materials_ior",
    "KHR_materials_specular", "KHR_mesh_quantization", "KHR_texture_transform",
}  # fmt: skip
_EFFECTS = {  # what is 0, by default, where an extension changes nothing
    f"KHR_materials_{name}": factor
    for name, factor in {
        "clearcoat": "clearcoatFactor", "sheen": "sheenColorFactor", "transmission": "transmissionFactor",
        "iridescence": "iridescenceFactor", "volume": "thicknessFactor", "dispersion": "dispersion",
        "diffuse_transmission": "diffuseTransmissionFactor",
    }.items()
}  # fmt: skip
_OTHER_MODEL = "KHR_materials_pbrSpecularGlossiness"
_COMPRESSED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
_OF_MESHES = {"morphs", "instances of a skin"}  # parts of meshes that are left out
_MOST_INSTANCES = 2**20
_LONGEST_NAME = 60  # characters of a material's name that a warning shows
_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}


class _File(Container):
    def __init__(self, path: Path, with_tangents: bool = False):
        super().__init__(path)
        self.with_tangents = with_tangents
        required = set(self.json.get("extensionsRequired", ())) - _KNOWN
        unknown = {name for name in required if not name.startswith("KHR_materials_")}  # those are left out
        if unknown:
            raise ValueError(f"it requires the extension {sorted(unknown)[0]}")
        self.buffers = [self.bytes(b.get("uri")) for b in self.json.get("buffers", ())]
        self.vertices = self.triangles = self.instances = 0
        self._decoder, self.pictures = Pictures(), dict[int, Picture]()
        self._faint = set[int]()  # materials of vertices whose colours have an alpha below 1
        self._left_out: dict[str, list[str]] = {}  # with the names of materials

    def leave(self, what: str, material: dict[str, Any] | None = None) -> None:
        names = self._left_out.setdefault(what, [])
        name = str((material or {}).get("name", ""))[:_LONGEST_NAME]
        if name and name not in names:
            names.append(name)

    def left_out(self, of: Iterable[str] | None = None) -> list[str]:
        """What is left out, in words; of: of these things."""
        return [
            what + (f" (of {', '.join(names[:3])}{', ...' if len(names) > 3 else ''})" if names else "")
            for what, names in sorted(self._left_out.items())
            if of is None or what in of
        ]

    def _view(self, index: int) -> tuple[bytes, int, int, int | None]:
        view = self.json["bufferViews"][index]
        _refuse_compressed(view)
        return self.buffers[view["buffer"]], view.get("byteOffset", 0), view["byteLength"], view.get("byteStride")

    def array(self, index: int) -> NDArray:
        """The values (n, width) of an accessor; normalised integers become floats."""
        a = self.json["accessors"][index]
        kind: np.dtype[Any] = np.dtype(_TYPES[a["componentType"]]).newbyteorder("<")
        width = WIDTHS[a["type"]]
        if a["count"] < 1 or a["count"] > MOST_VERTICES:
            raise ValueError(f"one of its accessors has {a['count']} values; there may be 1 to {MOST_VERTICES}")
        if "bufferView" in a:
            out = self._values(a, kind, width, a["count"]).copy()
        else:
            if "sparse" not in a:
                raise ValueError("one of its accessors has no values")
            held = max(map(len, self.buffers), default=0)
            if a["count"] > held:  # zeros take no bytes, but what they belong to does
                raise ValueError(f"one of its accessors has {a['count']} zeros; its buffers hold {held} bytes")
            out = np.zeros((a["count"], width), kind)
        if "sparse" in a:
            changed, at = a["sparse"], a["sparse"]["indices"]
            index_kind = np.dtype(_TYPES[at["componentType"]]).newbyteorder("<")
            where = self._values(at, index_kind, 1, changed["count"])[:, 0]
            out[where] = self._values(changed["values"], kind, width, changed["count"])
        if a.get("normalized") and kind.kind in "iu":
            return np.maximum(out.astype(np.float32) / np.iinfo(kind).max, -1)
        return out

    def _values(self, place: dict[str, Any], kind: np.dtype, width: int, count: int) -> NDArray:
        buffer, offset, _, stride = self._view(place["bufferView"])
        offset += place.get("byteOffset", 0)
        step = stride or kind.itemsize * width
        if count < 1 or offset + step * (count - 1) + kind.itemsize * width > len(buffer):
            raise ValueError("one of its accessors reaches beyond its buffer")
        return np.ndarray((count, width), kind, buffer, offset, (step, kind.itemsize))

    def texture(self, reference: dict[str, Any], factor: Any = 1.0, **reading: Any) -> Texture | None:
        """The texture that a material names: its picture times `factor`; None where its file is not there. reading:
        other fields of Texture."""
        texture = self.json["textures"][reference["index"]]
        sampler = self.json["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wrap = _WRAPS[sampler.get("wrapS", 10497)], _WRAPS[sampler.get("wrapT", 10497)]
        source = texture.get("source")
        if source is None:
            raise ValueError("a texture has no picture of a kind that glTF 2 itself knows")
        if source not in self.pictures:
            try:
                self.pictures[source] = self._decoder.picture(self._encoded(source), f"texture {source}")
            except NotThere:
                self.leave(f"{self.json['images'][source]['uri']} (not there)")
                return None
        return Texture(source, self.pictures[source], wrap, _lie_of(reference), factor=factor, **reading)

    def _encoded(self, source: int) -> bytes:
        image = self.json["images"][source]
        if "bufferView" not in image:
            return self.bytes(image["uri"])
        buffer, offset, length, _ = self._view(image["bufferView"])
        return buffer[offset : offset + length]

    def _cutout(self, index: int, m: dict[str, Any], color: Any) -> Cutout | None:
        """What a material's alpha leaves of its surface: None where that is all of it."""
        mode = m.get("alphaMode", "OPAQUE")
        if mode == "OPAQUE":
            return None
        if index in self._faint:
            self.leave("transparency of vertices", m)
        factor = float(m.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1, 1])[3])
        least = float(m.get("alphaCutoff", 0.5)) if mode == "MASK" else 0.5
        cutout = Cutout(-1, np.ones((1, 1), np.float32), least / max(factor, 1e-6))
        if isinstance(color, Texture):
            source = color.source
            alpha = self._decoder.alpha(source, lambda: self._encoded(source), f"texture {source}")
            if alpha is not None:
                cutout = Cutout(source, alpha, cutout.cutoff, color.wrap, color.lie)
        if mode == "BLEND" and not (factor > 0.99 and cutout.is_outline):
            if (factor * cutout.alpha < 1).any():
                self.leave("transparency", m)
            return None
        return self._decoder.shared(cutout)

    def surface(self, index: int) -> Surface:
        if index < 0:
            return Surface()
        m = self.json["materials"][index]
        pbr = m.get("pbrMetallicRoughness", {})
        extensions = m.get("extensions", {})
        if _OTHER_MODEL in extensions:
            raise ValueError(f"its materials are of {_OTHER_MODEL}, not of metal and roughness")
        for name in extensions.keys() - _KNOWN:
            changes = np.any(extensions[name].get(_EFFECTS[name], 0)) if name in _EFFECTS else True
            if name.startswith("KHR_materials_") and changes:
                self.leave(name, m)
        look: dict[str, Any] = {}
        factor: Any
        factor = look["base_color"] = _colour(pbr.get("baseColorFactor", [1, 1, 1, 1])[:3])
        if "baseColorTexture" in pbr:
            look["base_color"] = self.texture(pbr["baseColorTexture"], factor, srgb=True) or factor
        look["cutout"] = cutout = self._cutout(index, m, look["base_color"])
        if cutout is not None and isinstance(look["base_color"], Texture):
            look["base_color"] = cutout.filled(look["base_color"])
        for k, name in ((1, "roughness"), (2, "metallic")):
            factor = look[name] = float(pbr.get(f"{name}Factor", 1))
            if "metallicRoughnessTexture" in pbr:
                look[name] = self.texture(pbr["metallicRoughnessTexture"], factor, channel=k) or factor
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0)
        factor = look["emission"] = _colour(np.asarray(m.get("emissiveFactor", [0, 0, 0]), np.float32) * strength)
        if "emissiveTexture" in m and any(factor):
            look["emission"] = self.texture(m["emissiveTexture"], factor, srgb=True) or (0.0, 0.0, 0.0)
        if "normalTexture" in m:
            look["normal"] = self.texture(m["normalTexture"])
            look["normal_scale"] = float(m["normalTexture"].get("scale", 1))
        anisotropy = extensions.get("KHR_materials_anisotropy", {})
        if "anisotropyTexture" in anisotropy:
            raise ValueError("it has a texture of anisotropy")
        specular = extensions.get("KHR_materials_specular", {})
        if {"specularTexture", "specularColorTexture"} & specular.keys():
            self.leave("textures of KHR_materials_specular", m)
        look["specular"] = float(specular.get("specularFactor", 1))
        look["specular_color"] = _colour(specular.get("specularColorFactor", [1, 1, 1]))
        look["ior"] = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
        return Surface(
            **look, anisotropy=float(anisotropy.get("anisotropyStrength", 0)),
            anisotropy_rotation=float(anisotropy.get("anisotropyRotation", 0)),
        )  # fmt: skip

    def parts(self) -> list[Part]:
        out: list[Part] = []
        places = list(self.nodes())
        for _, node, here in places:
            if "mesh" in node:
                joints = (
                    self._joints(node["skin"], {index: there for index, _, there in places}) if "skin" in node else None
                )
                instances = here @ self._instances(node)
                for primitive in self.json["meshes"][node["mesh"]]["primitives"]:
                    out += self._part(primitive, instances, joints)
        if not out:
            raise ValueError("it holds no triangles")
        return out

    def _joints(self, index: int, places: dict[int, NDArray]) -> NDArray:
        """Matrices (n, 4, 4) that take a skin's vertices to the scene, in the skin's rest pose."""
        skin = self.json["skins"][index]
        joints = np.array([places[joint] for joint in skin["joints"]])
        if "inverseBindMatrices" not in skin:
            return joints
        inverse = self.array(skin["inverseBindMatrices"])[: len(joints)].astype(np.float64)
        return joints @ inverse.reshape(-1, 4, 4).transpose(0, 2, 1)

    def _instances(self, node: dict[str, Any]) -> NDArray:
        """Matrices (n, 4, 4) that take a node's mesh to the node; just one, except with EXT_mesh_gpu_instancing."""
        extension = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {})
        names = {"TRANSLATION", "ROTATION", "SCALE"}.intersection(extension.get("attributes", ()))
        if not names:
            return np.eye(4)[None]
        if "skin" in node:
            self.leave("instances of a skin")
            return np.eye(4)[None]
        accessors = {name: extension["attributes"][name] for name in names}
        counts = {self.json["accessors"][a]["count"] for a in accessors.values()}
        if len(counts) > 1:
            raise ValueError("the values of its instances are not as many as each other")
        self.instances += counts.pop()
        if self.instances > _MOST_INSTANCES:
            raise ValueError(f"it has more than {_MOST_INSTANCES} instances of meshes")
        return transform(**{name.lower(): self.array(a) for name, a in accessors.items()})

    def _attribute(self, index: int, width: int, count: int | None = None) -> NDArray[np.float64]:
        """Values (count, width) of a primitive's vertices. Raises ValueError for another shape; count=None allows any
        count."""
        values = self.array(index).astype(np.float64)
        expected = len(values) if count is None else count, width
        if values.shape != expected:
            raise ValueError(f"accessor {index} has values of shape {values.shape}, its vertices need {expected}")
        return values

    def _part(self, primitive: dict[str, Any], instances: NDArray, joints: NDArray | None) -> list[Part]:
        if primitive.get("mode", 4) not in (4, 5, 6):
            return []  # points or lines
        _refuse_compressed(primitive)
        attributes = primitive["attributes"]
        vertices = self._attribute(attributes["POSITION"], 3)
        if not {"JOINTS_0", "WEIGHTS_0"} <= attributes.keys():
            joints = None
        count = len(instances) if joints is None else 1
        index = self.array(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertices))
        triangles = _triangles(index.astype(np.int64), primitive.get("mode", 4))
        self.triangles += count * len(triangles)
        if self.triangles > MOST_TRIANGLES:
            raise ValueError(f"it has more than {MOST_TRIANGLES} triangles")
        if len(triangles) == 0:
            return []
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise ValueError(f"a triangle names vertex {triangles.max()} of {len(vertices)}")
        used, named = np.unique(triangles, return_inverse=True)
        triangles = named.reshape(-1, 3)  # primitives may share a buffer, of which each names a part
        self.vertices += count * len(used)
        if self.vertices > MOST_VERTICES:
            raise ValueError(f"it has more than {MOST_VERTICES} vertices")
        if "targets" in primitive:
            self.leave("morphs")
        normals = self._attribute(attributes["NORMAL"], 3, len(vertices)) if "NORMAL" in attributes else None
        names = {k: f"TEXCOORD_{k}" for k in range(4)}
        sets = {k: self._attribute(attributes[n], 2, len(vertices)) for k, n in names.items() if n in attributes}
        material = primitive.get("material", -1)
        colors = None
        if "COLOR_0" in attributes:
            colors = self._colors(attributes["COLOR_0"], len(vertices))
            self._faint |= {material} if (colors[:, 3:] < 1).any() else set()
            colors = colors[:, :3]
        placing = instances[:, None] if joints is None else self._blended(attributes, joints)[None, used]
        linear = placing[..., :3, :3]
        tangents = None
        if self.with_tangents and normals is not None and "TANGENT" in attributes:  # without normals they are void
            given = self._attribute(attributes["TANGENT"], 4, len(vertices))[used]
            sides = np.broadcast_to(given[:, 3] * np.sign(np.linalg.det(linear)), (count, len(given)))
            along = np.einsum("...ij,...j->...i", linear, given[:, :3])
            tangents = np.concatenate([along, sides[..., None]], axis=-1).reshape(-1, 4)
        vertices = vertices[used]
        normals = None if normals is None else normals[used]
        sets, colors = {k: uvs[used] for k, uvs in sets.items()}, None if colors is None else colors[used]
        mirrors = np.linalg.det(linear).mean(axis=1) < 0
        placed = (np.einsum("...ij,...j->...i", linear, vertices) + placing[..., :3, 3]).reshape(-1, 3)
        sets = {k: np.tile(uvs, (count, 1)) for k, uvs in sets.items()}
        colors = None if colors is None else np.tile(colors, (count, 1))
        triangles = np.concatenate(
            [(triangles[:, ::-1] if mirror else triangles) + k * len(vertices) for k, mirror in enumerate(mirrors)]
        )
        if normals is None:
            placed, sets = placed[triangles.reshape(-1)], {k: uvs[triangles.reshape(-1)] for k, uvs in sets.items()}
            colors = None if colors is None else colors[triangles.reshape(-1)]
            triangles = np.arange(len(placed)).reshape(-1, 3)
            normals = np.cross(placed[1::3] - placed[::3], placed[2::3] - placed[::3]).repeat(3, axis=0)
        else:
            normals = np.einsum("...ji,...j->...i", np.linalg.pinv(linear), normals).reshape(-1, 3)
        return [Part(placed, triangles, normals, sets, material, tangents=tangents, colors=colors)]

    def _colors(self, index: int, count: int) -> NDArray[np.float64]:
        """Linear colours (count, 3) or, with alpha, (count, 4) from 0 to 1."""
        values = self.array(index)
        if len(values) != count or values.shape[1] not in (3, 4) or not np.isfinite(values).all():
            raise ValueError(
                f"accessor {index} must hold finite colours, {(count, 3)} or {(count, 4)}; its shape is {values.shape}"
            )
        return values.astype(np.float64).clip(0, 1)

    def _blended(self, attributes: dict[str, int], joints: NDArray) -> NDArray:
        """Matrices (n, 4, 4) for a skin's vertices: weighted means of joints, of which each attribute set names
        four; without weight, that of the first one, as in three.js."""
        matrices: Any = 0.0
        whole: Any = 0.0
        first: Any = None
        for k in range(len(attributes)):
            if f"JOINTS_{k}" not in attributes or f"WEIGHTS_{k}" not in attributes:
                break
            weights = self.array(attributes[f"WEIGHTS_{k}"]).astype(np.float64)
            named = self.array(attributes[f"JOINTS_{k}"])
            named = joints[
                np.where((weights == 0) & (named >= len(joints)), 0, named)
            ]  # what fills up may be any number
            first = named[:, 0] if k == 0 else first
            matrices = matrices + np.einsum("nk,nkij->nij", weights, named)
            whole = whole + weights.sum(axis=1)
        whole = whole[:, None, None]
        return np.where(whole > 0, matrices / np.maximum(whole, 1e-9), first)


def _lie_of(reference: dict[str, Any]) -> Lie:
    """How a texture lies according to its texCoord and its KHR_texture_transform."""
    own = reference.get("texCoord", 0)
    t = reference.get("extensions", {}).get("KHR_texture_transform")
    if t is None:
        return Lie(int(own))
    (x, y), (u, v) = t.get("offset", (0, 0)), t.get("scale", (1, 1))
    return Lie(int(t.get("texCoord", own)), (float(x), float(y)), float(t.get("rotation", 0)), (float(u), float(v)))


def _refuse_compressed(part: dict[str, Any]) -> None:
    compressed = _COMPRESSED.intersection(part.get("extensions", ()))
    if compressed:
        raise ValueError(f"its meshes use {min(compressed)}")


def _triangles(index: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Triangles (n, 3) of a list (mode 4), a strip (5) or a fan (6)."""
    if mode == 4:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    k = np.arange(max(len(index) - 2, 0))
    if mode == 5:
        return index[np.stack([k, k + 1 + k % 2, k + 2 - k % 2], axis=1)]
    return index[np.stack([k + 1, k + 2, 0 * k], axis=1)]


def _colour(values: ArrayLike) -> tuple[float, ...]:
    return tuple(np.asarray(values, np.float32).tolist())


def _turned_tangents(parts: list[Part], surfaces: dict[int, Surface], mesh: Mesh) -> float:
    """The share of a file's tangents that are more than 15 degrees, or half a turn around the normal, from those that
    follow from its uvs. Only parts whose materials need tangents count."""
    off = []
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    for part, start in zip(parts, starts, strict=False):
        surface = surfaces[part.material]
        if part.tangents is None or (surface.normal is None and not surface.anisotropy):
            continue
        used = np.unique(part.triangles)
        ours, n, t = mesh.tangents[start + used], mesh.normals[start + used], part.tangents[used]
        along = t[:, :3] - (t[:, :3] * n).sum(axis=1, keepdims=True) * n
        length = np.linalg.norm(along, axis=1)
        near = (along * ours[:, :3]).sum(axis=1) > np.cos(np.radians(15)) * length
        off.append((~near | (t[:, 3] * ours[:, 3] < 0))[length > 0])
    return float(np.concatenate(off).mean()) if sum(map(len, off)) else 0.0


def _warn_of(path: Path, left_out: list[str], stacklevel: int) -> None:
    if left_out:
        warnings.warn(f"{path}: left out are {', '.join(left_out)}", stacklevel=stacklevel)


def _subtract_offset(parts: list[Part]) -> Offset:
    offset = offset_of([part.vertices for part in parts])
    if any(offset.xyz):
        for part in parts:
            part.vertices = part.vertices - offset.xyz
    return offset


def read_geometry(path: Path) -> tuple[Mesh, Offset]:
    """Reads the mesh alone, in the file's frame (y up), and what was subtracted from its places.

    Raises ValueError for what cannot be read, and says why.
    """
    try:
        file = _File(path)
        parts = file.parts()
        offset = _subtract_offset(parts)
        mesh = mesh_of(parts)
    except DAMAGES as error:
        raise ValueError(f"it is damaged ({type(error).__name__}: {error})") from error
    _warn_of(path, file.left_out(_OF_MESHES), stacklevel=5)
    return mesh, offset


def read(path: Path) -> tuple[Mesh, Material, Offset]:
    """Reads mesh, in the file's frame (y up), and material, and what was subtracted from the mesh's places.

    Raises ValueError for what cannot be read, and says why.
    """
    try:
        file = _File(path, with_tangents=True)
        parts = file.parts()
        offset = _subtract_offset(parts)
        surfaces = alike(parts, {m: file.surface(m) for m in sorted({p.material for p in parts})})
        for part in parts:
            if not part.lay(surfaces[part.material]):
                file.leave("textures of what has no uvs", file.json["materials"][part.material])
        parts, more = cut_away(parts, surfaces)
        _warn_of(path, file.left_out() + sorted(more), stacklevel=5)
        material = joined(path, parts, surfaces, stacklevel=4)
        mesh = mesh_of(parts)
        share = _turned_tangents(parts, surfaces, mesh)
    except DAMAGES as error:
        raise ValueError(f"it is damaged ({type(error).__name__}: {error})") from error
    if share > 0.1:
        warnings.warn(
            f"{path}: its tangents are left out, and those of its uvs are turned against {100 * share:.0f} % of them: "
            "bumps look lit from elsewhere",
            stacklevel=4,
        )
    return mesh, material, offset
