"""Environment maps in files: equirectangular pictures and cube maps, with axes by name; see docs/files.md."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import dds, ktx2, texels
from ._fastibl import CubeMap, Environment, Response, cubemap_from_equirect, equirect_from_cubemap
from .axes import from_axes, handed, handedness_of, matrix, picture_shift, radiance_of, to_axes, turned
from .expected import expect
from .file_limits import check_face_edge
from .pictures import ENCODED, LINEAR, read_picture, write_picture
from .primaries import Given

LAYOUTS = ("equirect", "faces", "strip", "cross")
FACES = ("px", "nx", "py", "ny", "pz", "nz")
CUBE_WRITERS = {".ktx2": ktx2.write_ktx2, ".dds": dds.write_dds}
_CUBE_READERS = {".ktx2": ktx2.read_ktx2, ".dds": dds.read_dds}
_CROSS = ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3))  # row and column of each face in the cross


def read_environment(
    path: str | os.PathLike[str],
    size: int = 128,
    axes: str = "marker",
    *,
    response: Response | None = None,
    handedness: str | None = None,
    primaries: Given | None = None,
) -> CubeMap:
    """Environment map of a picture (.hdr, .exr, with a response .png, .jpg) or of a cube map (.ktx2, .dds).

    path: a picture may be equirectangular, twice as wide as high, or a cube map laid out as by `write_environment`: a
    strip, a cross, or the first of six faces (..._px.hdr, or px.hdr, as three.js' examples name them).
    axes: those in which the map was made, "marker" (z up, image centre along +y), "gltf" (y up, image centre along
    +x), "godot" or "unity", see `write_environment`.
    size: face edge in texels for an equirectangular picture; cube faces keep their own.
    response: the camera's response, or another encoding, for .png and .jpg, such as Response.srgb(); its white becomes
    radiance 1, and what was brighter is lost.
    handedness: that of cube maps, see `write_environment`; by default "left" for .ktx2 and .dds, for pictures that of
    the axes.
    primaries: those of the file's colours, "ACEScg", "ACES", "Rec. 2020", "Display P3", "DCI-P3", "Adobe RGB" or
    "Rec. 709", or x and y of red, green, blue and white. None, the default, takes those that the file states, or Rec.
    709's. The map's are always Rec. 709's; a warning tells how much of what these do not have is cut.
    Raises FileNotFoundError; ValueError for a file that is not such a map, is damaged, or is larger than
    fastibl.file_limits allows, and for a handedness given for an equirectangular picture; ImportError for .exr without
    OpenEXR, and for a .ktx2 packed by Zstandard without zstandard.
    """
    path = Path(path)
    expect(response, (Response, type(None)), "response", "Response.srgb() is that of most pictures")
    matrix(axes)  # raises ValueError for unknown names
    if path.suffix.lower() in _CUBE_READERS:
        if response is not None:
            raise ValueError(f"{path} holds linear radiance; a response goes with .png and .jpg")
        faces = _CUBE_READERS[path.suffix.lower()](path, primaries)[0]
        return from_axes(handed(CubeMap(faces), "left" if handedness is None else handedness, axes), axes)
    if path.is_file() and path.suffix.lower() not in (endings := (*LINEAR, *ENCODED, *_CUBE_READERS)):
        raise ValueError(f"{path} is no environment map that is read; those end in {', '.join(endings)}")
    image = read_picture(path, response, primaries)
    height, width = image.shape[:2]
    if width == 2 * height:
        _check_no_handedness(handedness, path)
        return from_equirect(image, size, axes)
    if height == 6 * width:
        faces = image.reshape(6, width, width, 3)
    elif 3 * width == 4 * height and height % 3 == 0:
        n = height // 3
        _check_cross(path, image, n)
        faces = np.stack([image[r * n : (r + 1) * n, c * n : (c + 1) * n] for r, c in _CROSS])
    elif width == height and (path.stem == FACES[0] or path.stem.endswith(f"_{FACES[0]}")):
        faces = _read_faces(path, image, response, primaries)
    else:
        raise ValueError(
            f"{path} is {width} x {height}; an equirectangular picture is twice as wide as high, a strip of cube faces "
            "1 x 6, a cross 4 x 3; of six square faces give the first, of _px, _nx, _py, _ny, _pz, _nz, or px, nx, ..."
        )
    handedness = handedness_of(axes) if handedness is None else handedness
    return from_axes(handed(CubeMap(faces), handedness, axes), axes)


def from_equirect(image: NDArray[np.float32], size: int, axes: str) -> CubeMap:
    """The map of an equirectangular picture in the named axes. Raises ValueError for a size beyond
    fastibl.file_limits."""
    check_face_edge("size", size)
    return turned(cubemap_from_equirect(image, size=size), matrix(axes, picture=True).T)


def read_equirect(path: Path, response: Response | None, primaries: Given | None = None) -> NDArray[np.float32] | None:
    """Reads an equirectangular picture as it is; None for a cube map. Raises what `read_environment` raises."""
    if path.suffix.lower() in _CUBE_READERS:
        return None
    image = read_picture(path, response, primaries)
    return image if image.shape[1] == 2 * image.shape[0] else None


def turn_equirect(image: NDArray[np.float32], axes: str, to: str) -> NDArray[np.float32] | None:
    """The picture in other axes, moved by whole pixels; None where a quarter turn is not a whole number of pixels."""
    shift, rest = divmod(picture_shift(axes, to) * image.shape[1], 4)
    return None if rest else np.roll(image, shift, axis=1) if shift else image


def _check_no_handedness(handedness: str | None, path: Path) -> None:
    if handedness is not None:
        raise ValueError(f"handedness goes with cube maps: {path.name} is an equirectangular picture, which has none")


def _check_cross(path: Path, image: NDArray[np.float32], n: int) -> None:
    """Checks that there is nothing between the arms of a cross: most photographs have 4 x 3 pixels, too."""
    empty = [
        image[r * n : (r + 1) * n, c * n : (c + 1) * n] for r in range(3) for c in range(4) if (r, c) not in _CROSS
    ]
    if max(float(np.std(cell, axis=(0, 1)).max()) for cell in empty) > 0.02 * float(np.mean(image)):
        raise ValueError(
            f"{path} is 4 x 3, as a cross of cube faces is, but its corners are not empty; an equirectangular picture "
            "is twice as wide as high"
        )


def write_environment(
    path: str | os.PathLike[str],
    cube: CubeMap | Environment,
    layout: str = "equirect",
    axes: str = "marker",
    height: int | None = None,
    *,
    handedness: str | None = None,
) -> list[Path]:
    """Writes an environment map and returns the files; the ending of the path sets the format.

    .hdr (to 1/256 of a pixel's brightest channel) or .exr (exactly): a picture, laid out as `layout` says. .ktx2, .dds:
    a cube map of half floats (to 1/2048, up to 65504); what is brighter is cut, with a warning.

    axes: "marker", z up: an equirectangular picture has z at the top, its centre along +y, and x to the right of the
    centre. "gltf", y up, as in three.js and Khronos' viewer: a direction (x, y, z) of the marker frame becomes (x, z,
    -y), and a picture has u = 1/2 + atan2(z, x)/2 pi, v = acos(y)/pi. "godot": the same axes, but u = atan2(x, -z)/
    2 pi, as its PanoramaSkyMaterial reads pictures. "unity", y up and left-handed: (-x, z, -y) of the marker frame,
    where UnityGLTF and glTFast put what a glTF file has there; u = 1/2 - atan2(z, x)/2 pi, as Skybox/Panoramic reads
    pictures.
    layout: "equirect", 2 height x height pixels, by default 4 x 2 face edges. Or cube faces in the axes' own order
    +x -x +y -y +z -z with OpenGL's orientation (row 0 of the side faces is y = +1, of +y z = -1, of -y z = +1):
    "faces", six files ..._px, _nx, _py, _ny, _pz, _nz; "strip", one below the other; "cross", -x +z +x -z in the middle
    row, +y above and -y below +z, the rest black.
    handedness: that of cube maps' coordinates. By default, those of pictures are the axes' own, (x, y, z) as described
    above; those of .ktx2 and .dds are "left", with faces as seen from inside, as these formats require. Where the axes
    are the other way round, a direction (x, y, z) is the cube coordinate (-x, y, z): so three.js and Babylon.js look up
    cube textures.
    Raises TypeError for what is not a map, ValueError for another layout, axes, handedness or ending, and for a
    handedness given for an equirectangular picture, ImportError for .exr without OpenEXR.
    """
    path = Path(path)
    radiance = radiance_of(cube)
    if layout not in LAYOUTS:
        raise ValueError(f"layout must be one of {', '.join(LAYOUTS)}, got {layout!r}")
    if layout != "equirect" and height is not None:
        raise ValueError(f'height goes with layout "equirect", not "{layout}"')
    ending = path.suffix.lower()
    if ending in CUBE_WRITERS:
        if height is not None or layout != "equirect":
            raise ValueError(f"layout and height go with pictures, not {path.name}: {ending} is a cube map as it is")
        faces = handed(to_axes(radiance, axes), "left" if handedness is None else handedness, axes).faces
        if (lost := _cut_share(faces)) > 0:
            warnings.warn(
                f"half floats end at {texels.HALF_MAX:.0f}, the map at {faces.max():.3g}: {path.name} lacks {lost:.2g} "
                "of its light; .exr and .hdr hold all of it",
                stacklevel=2,
            )
        CUBE_WRITERS[ending](path, [faces])
        return [path]
    if ending not in LINEAR:
        raise ValueError(f"{path} must end in {', '.join([*LINEAR, *CUBE_WRITERS])}")
    if layout == "equirect":
        _check_no_handedness(handedness, path)
        write_equirect(path, turned(radiance, matrix(axes, picture=True)), height)
        return [path]
    handedness = handedness_of(axes) if handedness is None else handedness
    return _write_faces(path, handed(to_axes(radiance, axes), handedness, axes).faces, layout)


def _cut_share(faces: NDArray[np.float32]) -> float:
    """Share of the light that half floats do not hold, of the channel that loses most."""
    cut, whole = (f.astype(np.float64).sum(axis=(0, 1, 2)) for f in (np.minimum(faces, texels.HALF_MAX), faces))
    return float((1 - cut[whole > 0] / whole[whole > 0]).max(initial=0))


def write_equirect(path: Path, cube: CubeMap, height: int | None) -> None:
    """Writes a cube already turned to a picture's axes as an equirectangular picture, by default 2 face edges high."""
    write_picture(path, equirect_from_cubemap(cube, 2 * cube.size if height is None else height))


def check_face_layout(layout: str) -> None:
    """Raises ValueError for what is no layout of write_faces()."""
    if layout not in LAYOUTS[1:]:
        raise ValueError(f"layout must be one of {', '.join(LAYOUTS[1:])}, got {layout!r}")


def write_faces(path: str | os.PathLike[str], cube: CubeMap, layout: str = "strip") -> list[Path]:
    """Writes the faces of a cube as they are, whatever its axes; layouts are those of `write_environment` except
    "equirect"."""
    check_face_layout(layout)
    return _write_faces(Path(path), cube.faces, layout)


def _write_faces(path: Path, faces: NDArray[np.float32], layout: str) -> list[Path]:
    n = faces.shape[1]
    if layout == "faces":
        paths = [_face_path(path, face) for face in FACES]
        for name, face in zip(paths, faces, strict=True):
            write_picture(name, face)
        return paths
    if layout == "strip":
        write_picture(path, faces.reshape(6 * n, n, 3))
    else:
        canvas = np.zeros((3 * n, 4 * n, 3), np.float32)
        for (r, c), face in zip(_CROSS, faces, strict=True):
            canvas[r * n : (r + 1) * n, c * n : (c + 1) * n] = face
        write_picture(path, canvas)
    return [path]


def _read_faces(
    path: Path, first: NDArray[np.float32], response: Response | None, primaries: Given | None
) -> NDArray[np.float32]:
    faces = [first]
    for name in FACES[1:]:
        other = path.with_stem(path.stem[: -len(name)] + name)
        faces.append(read_picture(other, response, primaries))
        if faces[-1].shape != first.shape:
            (height, width), n = faces[-1].shape[:2], len(first)
            raise ValueError(f"{other} is {width} x {height}, but {path.name} is {n} x {n}")
    return np.stack(faces)


def _face_path(path: Path, face: str) -> Path:
    return path.with_stem(f"{path.stem}_{face}")
