"""Wavefront .obj files with their materials (.mtl): one mesh with its material.

A material is glTF's model: Kd and map_Kd are its base colour (Kd linear, as the format calls it a reflectance; beside a
picture one of 0, or none, counts as 1), Ke and map_Ke its emission, Pm and map_Pm how metallic it is, Pr and map_Pr its
roughness, without them that of a lobe as wide as Ns tells (matte where Ks is 0 or illum below 2); norm is a normal map.
In files that Blender wrote, Ns is its roughness and map_Bump its normal map. Of pictures -s, -o and -clamp are read;
where a path leads out of the .obj's folder, the file of that name in it is meant. What map_d (or map_opacity) makes
invisible is cut away (fastibl.cutouts) where it is an outline. Several materials become one: see fastibl.one_material.
Left out, with a warning that names them: other transparency (d, Tr), bumps (map_Bump), colours and shapes of highlights
(Ks, map_Ks, map_Ns), pictures that are neither PNG nor JPEG, and files that are not there.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Material, Mesh, _read_obj, _read_obj_materials
from .file_limits import FolderFiles, OutsideFolder, file_bytes
from .one_material import joined
from .parts import Part, alike, cut_away, mesh_of
from .pictures import unit
from .rounded_places import Offset
from .surfaces import Cutout, Lie, Picture, Pictures, Surface, Texture

_ARGUMENTS = {  # number of arguments of a picture's options; where it is 3, one to three numbers may follow
    "-blendu": 1, "-blendv": 1, "-boost": 1, "-mm": 2, "-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-clamp": 1, "-bm": 1,
    "-imfchan": 1, "-cc": 1, "-type": 1, "-colorspace": 1,
}  # fmt: skip
_LEFT_OUT = {
    "map_bump": "bumps", "bump": "bumps", "map_ks": "highlights of a colour",
    "map_ns": "highlights of several shapes", "map_refl": "reflection maps",
    "disp": "displacement", "refl": "reflection maps",
}  # fmt: skip
_NAMING = {"norm", "bump", "disp", "refl"}  # lines that end in the name of a picture, as those of map_
_OTHER_PICTURES = {".bmp", ".dds", ".exr", ".gif", ".hdr", ".psd", ".tga", ".tif", ".tiff", ".webp"}
_READ_MAPS = {"map_kd", "map_ke", "map_pm", "map_pr", "map_d", "map_opacity", "map_ka"}  # Ka: light that is not there
_LAYERS = {"pc": "clear coat", "ps": "sheen"}
_BLENDER = "# blender"  # in the lines of materials that Blender wrote
_GREY = 0.8  # of parts without a material
_MOST_TEXT = 2**24  # bytes of a .mtl


def read(path: Path) -> tuple[Mesh, Material | None, Offset]:
    """Mesh in the file's frame, with its colours; material, None where none is defined; and what was subtracted from
    the mesh's places.

    Raises ValueError for what cannot be read, and says why.
    """
    data = file_bytes(path)
    if b"mtllib" not in data:  # parsed once
        return _plain(data)
    mesh, libraries, names, of_triangles, offset = _read_obj_materials(data)
    library = _Library(path, len(data))
    for line in libraries:
        library.read(line)
    if not library.materials:
        library.warn()
        return _plain(data)
    parts = _parts(mesh, of_triangles)
    surfaces = {part.material: library.surface(names[part.material] if part.material >= 0 else "") for part in parts}
    surfaces = alike(parts, surfaces)
    for part in parts:
        if not part.lay(surfaces[part.material]):
            library.leave("textures of what has no vt")
    parts, left_out = cut_away(parts, surfaces)
    library.warn(left_out)
    material = joined(path, parts, surfaces, stacklevel=4)
    return mesh_of(parts), material, Offset(offset)


def _plain(data: bytes) -> tuple[Mesh, None, Offset]:
    mesh, offset = _read_obj(data, colors=True)
    return mesh, None, Offset(offset)


def _parts(mesh: Mesh, of_triangles: NDArray[np.int32]) -> list[Part]:
    """The triangles of each material, with vertices of their own."""
    parts, colors = [], mesh.colors
    for material in np.unique(of_triangles):
        triangles = mesh.triangles[of_triangles == material]
        used, places = np.unique(triangles, return_inverse=True)
        sets = {} if mesh.uvs is None else {0: mesh.uvs[used] * [1, -1] + [0, 1]}
        part = Part(mesh.vertices[used], places.reshape(-1, 3), mesh.normals[used], sets, int(material))
        part.colors = None if colors is None else colors[used]
        parts.append(part)
    return parts


class _Library:
    """The content of the .mtl files that an .obj names: for each material, its lines as words, by their first word in
    lower case."""

    def __init__(self, path: Path, size: int):
        self._path, self._files = path, FolderFiles(path, size)
        self.materials: dict[str, dict[str, list[str]]] = {}
        self._pictures, self._decoder = dict[str, Picture | None](), Pictures()
        self._left_out = dict[str, None]()  # a dict keeps their order

    def warn(self, more: Iterable[str] = ()) -> None:
        left_out = [*self._left_out, *more]
        if left_out:
            warnings.warn(f"{self._path}: left out are {', '.join(left_out)}", stacklevel=5)

    def leave(self, what: str) -> None:
        self._left_out[what] = None

    def read(self, line: str) -> None:
        """Reads the files of an mtllib line: one name, which may contain spaces, or several names without spaces."""
        texts = {line: self._text(line)}
        if texts[line] is None:
            line = _uncommented(line)[-1]
            texts = {line: self._text(line)}
        if texts[line] is None and len(line.split()) > 1:
            texts = {name: self._text(name) for name in line.split()}
        for name, text in texts.items():
            if text is None:
                self.leave(f"{name} (not there)")
            elif not self._add(text):
                self.leave(f"{name} (defines no material)")

    def _add(self, text: str) -> bool:
        """Returns whether there are materials in it."""
        found = False
        material: dict[str, list[str]] = {}
        own: dict[str, list[str]] = {_BLENDER: []} if text.lstrip().lower().startswith(_BLENDER) else {}
        for row in text.replace("\\\n", " ").splitlines():
            kind, *rest = row.split(maxsplit=1) or [""]
            if kind.startswith("#"):
                continue
            told = "".join(rest).strip()
            if kind.lower() == "newmtl":
                found = True
                material = self.materials.setdefault(told, dict(own))
            elif kind.lower() in _NAMING or kind.lower().startswith("map_"):
                material[kind.lower()] = [told]  # names keep their spaces
            else:
                material[kind.lower()] = told.split("#")[0].split()
        return found

    def _text(self, name: str) -> str | None:
        try:
            data = self._bytes(_here(name))
        except FileNotFoundError:
            return None
        if len(data) > _MOST_TEXT:
            raise ValueError(f"{name} has {len(data)} bytes; such files of up to {_MOST_TEXT} bytes are read")
        return data.decode("utf-8-sig", "replace").replace("\r\n", "\n")

    def _bytes(self, name: str) -> bytes:
        """Of a file that lies in the folder, with the name's folders or without: files name those of other machines.
        Raises FileNotFoundError."""
        for own in (name, PurePosixPath(name).name):
            try:
                return self._files.bytes(own)
            except (FileNotFoundError, OutsideFolder):
                pass
        raise FileNotFoundError(name)

    def surface(self, name: str) -> Surface:
        """How a material of this name looks; grey where none is defined."""
        if name not in self.materials:
            defined = (n for n in self.materials if name in _uncommented(n))
            name = next((n for n in (*_uncommented(name), *defined) if n in self.materials), name)
        if name not in self.materials:
            if name:
                self.leave(f"material {name} (not defined)")
            return Surface(base_color=(_GREY,) * 3, metallic=0.0)
        lines = self.materials[name]
        bumps = "map_bump" if _BLENDER in lines else "norm"  # Blender writes its normal maps so
        for kind in lines:
            if kind not in _READ_MAPS | {bumps} and (kind in _LEFT_OUT or kind.startswith("map_")):
                self.leave(_LEFT_OUT.get(kind, kind))
        for kind, what in _LAYERS.items():
            if _number(lines, kind, 0.0) > 0:
                self.leave(what)
        if _number(lines, "d", 1.0) < 1 or _number(lines, "tr", 0.0) > 0:
            self.leave("transparency")
        cutout = self._cutout(lines)
        color, emission = _colour(lines, "kd", 1.0 if "map_kd" in lines else _GREY), _colour(lines, "ke", 0.0)
        base_color = self._texture(lines, "map_kd", color if any(color) else (1.0,) * 3, srgb=True)
        if base_color is not None and cutout is not None:
            base_color = cutout.filled(base_color)
        emitting = self._texture(lines, "map_ke", emission if any(emission) else (1.0,) * 3, srgb=True)
        return Surface(
            base_color=base_color or color,
            metallic=self._texture(lines, "map_pm", 1.0, channel=0) or _share(lines, "pm", 0.0),
            roughness=self._texture(lines, "map_pr", 1.0, channel=0) or _share(lines, "pr", _roughness(lines)),
            emission=emitting or emission,
            normal=self._texture(lines, bumps),
            cutout=cutout,
        )

    def _cutout(self, lines: dict[str, list[str]]) -> Cutout | None:
        """What the picture of map_d leaves of a surface: its alpha, where it has one, else its grey."""
        texture = self._texture(lines, "map_d") or self._texture(lines, "map_opacity")
        if texture is None:
            return None
        name = list(self._pictures)[texture.source]
        alpha = self._decoder.alpha(name, lambda: self._bytes(name), name)
        if alpha is None or (alpha == 1).all():
            alpha = unit(texture.picture.pixels).mean(axis=-1, dtype=np.float32)
        cutout = Cutout(texture.source, alpha, 0.5, texture.wrap, texture.lie)
        if not cutout.is_outline:
            self.leave("transparency")
            return None
        return self._decoder.shared(cutout)

    def _found(self, names: Sequence[str]) -> str:
        """Which of these names a picture has; it is then among the pictures."""
        for name in names:
            if name not in self._pictures:
                try:
                    self._pictures[name] = self._picture(name, self._bytes(name))
                except FileNotFoundError:
                    continue
            return name
        self.leave(f"{names[-1]} (not there)")
        self._pictures[names[-1]] = None
        return names[-1]

    def _picture(self, name: str, data: bytes) -> Picture | None:
        if PurePosixPath(name).suffix.lower() in _OTHER_PICTURES:
            self.leave(f"{name} (neither PNG nor JPEG)")
            return None
        return self._decoder.picture(data, name)

    def _texture(
        self, lines: dict[str, list[str]], kind: str, factor: Any = 1.0, srgb: bool = False, channel: int | None = None
    ) -> Texture | None:
        if kind not in lines:
            return None
        rest, options = " ".join(lines[kind]), dict[str, list[str]]()
        while (word := _first(rest))[0] in _ARGUMENTS:
            option, rest = word
            count, given = _ARGUMENTS[option], list[str]()
            while len(given) < count and (word := _first(rest))[0] and (count < 3 or _is_number(word[0])):
                given.append(word[0])
                rest = word[1]
            options[option] = given
        name = self._found([_here(n.strip().strip('"')) for n in _uncommented(rest.strip())])
        picture = self._pictures[name]
        if picture is None:
            return None
        (su, sv), (u, v) = _pair(options.get("-s", []), 1.0), _pair(options.get("-o", []), 0.0)
        # v goes upwards here, but downwards in a Lie.
        lie = Lie(0, (u, 1 - sv - v), 0.0, (su, sv))
        wrap = "clamp" if options.get("-clamp") == ["on"] else "repeat"
        source = list(self._pictures).index(name)
        return Texture(source, picture, (wrap, wrap), lie, srgb=srgb, channel=channel, factor=factor)


def _first(line: str) -> tuple[str, str]:
    """The first word of a line, and the rest."""
    word, *rest = line.split(maxsplit=1) or [""]
    return word, "".join(rest)


def _uncommented(name: str) -> list[str]:
    """A name, and what is left of it where it ends in comments, the longest first: names may hold a #, too."""
    ends = [len(name), *(match.start() for match in reversed(list(re.finditer(r"\s+#", name))))]
    return [name[:end] for end in ends]


def _here(name: str) -> str:
    """A path as this system writes it: many files were written on Windows."""
    return PureWindowsPath(name).as_posix()


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def _numbers(lines: dict[str, list[str]], kind: str) -> list[float]:
    words = lines.get(kind, [])
    if words[:1] == ["-halo"]:  # of d: more transparent where a surface faces the viewer
        words = words[1:]
    return [float(w) for w in words] if all(map(_is_number, words)) else []


def _number(lines: dict[str, list[str]], kind: str, default: float) -> float:
    return (_numbers(lines, kind) or [default])[0]


def _share(lines: dict[str, list[str]], kind: str, default: float) -> float:
    return float(np.clip(_number(lines, kind, default), 0, 1))


def _colour(lines: dict[str, list[str]], kind: str, default: float) -> tuple[float, ...]:
    """A colour; one number stands for all three channels, and other descriptions (spectral, xyz) give the default."""
    numbers = _numbers(lines, kind) or [default]
    values = np.array(numbers[:3] if len(numbers) >= 3 else numbers[:1] * 3, np.float32)
    return tuple(values.clip(0, None if kind == "ke" else 1).tolist())


def _pair(words: list[str], default: float) -> tuple[float, float]:
    numbers = [float(w) for w in words] + [default] * 2
    return numbers[0], numbers[1]


def _roughness(lines: dict[str, list[str]]) -> float:
    """Roughness of a GGX lobe that is about as wide as the lobe with the exponent Ns: alpha^2 = 2 / (Ns + 2); or what
    Blender had, which writes 1000 (1 - roughness)^2."""
    shines = any(_colour(lines, "ks", 1.0 if "map_ks" in lines else 0.0)) and _number(lines, "illum", 2) >= 2
    if shines and _BLENDER in lines:
        return float(1 - np.sqrt(np.clip(_number(lines, "ns", 0.0) / 1000, 0, 1)))
    return float((2 / (max(_number(lines, "ns", 0.0), 0.0) + 2)) ** 0.25) if shines else 1.0
