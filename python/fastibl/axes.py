"""Axes by name: the marker frame (z up), glTF's (y up) and those of engines; and cube maps turned to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._fastibl import CubeMap, Environment, texel_directions
from .expected import expect

# The matrices take a direction in the marker frame to one in the named axes. glTF: x stays, up becomes y, and what lies
# up the board (marker +y) lies along -z, where a glTF or three.js camera looks. Godot's axes are those of glTF. Unity's
# are left-handed: its importers of glTF (UnityGLTF, glTFast) reverse x.
_AXES = {
    "marker": np.eye(3, dtype=int),
    "gltf": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "godot": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "unity": np.array([[-1, 0, 0], [0, 0, 1], [0, -1, 0]]),
}
# The same, but to the frame in which an equirectangular picture has u = 1/2 + atan2(x, y)/2 pi, v = acos(z)/pi. In the
# named axes, and from the top, v = acos(y)/pi and
# - glTF: u = 1/2 + atan2(z, x)/2 pi, as three.js and Khronos' viewer read it;
# - Godot: u = atan2(x, -z)/2 pi, as its PanoramaSkyMaterial reads it;
# - Unity: u = 1/2 - atan2(z, x)/2 pi, as its shader Skybox/Panoramic reads it.
_PICTURE = {
    "marker": np.eye(3, dtype=int),
    "gltf": np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "godot": np.array([[-1, 0, 0], [0, -1, 0], [0, 0, 1]]),
    "unity": np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}
_QUARTER = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # moves a picture right by a quarter of its width
NAMES = tuple(_AXES)
HANDEDNESS = ("left", "right")

# The major axis, s axis (right) and t axis (down) of each face.
_FACES = np.array(
    [
        [(1, 0, 0), (0, 0, -1), (0, -1, 0)],
        [(-1, 0, 0), (0, 0, 1), (0, -1, 0)],
        [(0, 1, 0), (1, 0, 0), (0, 0, 1)],
        [(0, -1, 0), (1, 0, 0), (0, 0, -1)],
        [(0, 0, 1), (1, 0, 0), (0, -1, 0)],
        [(0, 0, -1), (-1, 0, 0), (0, -1, 0)],
    ]
)


def radiance_of(cube: CubeMap | Environment) -> CubeMap:
    """The CubeMap itself, or that of an Environment. Raises TypeError for what is neither."""
    radiance = cube.radiance if isinstance(cube, Environment) else cube
    expect(radiance, CubeMap, "cube")
    return radiance


def matrix(axes: str, picture: bool = False) -> NDArray[np.int_]:
    """(3, 3): a direction in the named axes is this matrix times the one in the marker frame.

    picture: whether to use the frame of an equirectangular picture instead. Raises ValueError for another name.
    """
    if axes not in _AXES:
        raise ValueError(f"axes must be one of {', '.join(NAMES)}, got {axes!r}")
    return (_PICTURE if picture else _AXES)[axes]


def turned(cube: CubeMap, turn: NDArray[np.int_]) -> CubeMap:
    """The map with each of its directions d moved to turn @ d; turn is a signed permutation, so that no value
    changes."""
    n = cube.size
    # The texel centres in whole numbers: n along the major axis, 2 x + 1 - n across.
    to = texel_directions(n).astype(np.float64)
    to = np.rint(to / np.abs(to).max(axis=-1, keepdims=True) * n).astype(int)
    there = to @ turn
    along = there @ _FACES[:, 0].T
    face = np.argmax(along, axis=-1)
    column = (np.einsum("...i,...i", there, _FACES[face, 1]) + n - 1) // 2
    row = (np.einsum("...i,...i", there, _FACES[face, 2]) + n - 1) // 2
    result = CubeMap(cube.faces[face, row, column])
    result._count_cleaned_of(cube)
    return result


def to_axes(cube: CubeMap, axes: str) -> CubeMap:
    """Turns a map of the marker frame into a map whose cube coordinates are the named axes."""
    return turned(cube, matrix(axes))


def from_axes(cube: CubeMap, axes: str) -> CubeMap:
    """The reverse of `to_axes`."""
    return turned(cube, matrix(axes).T)


def picture_shift(axes: str, to: str) -> int:
    """By how many quarters of its width an equirectangular picture in the named axes moves right to be one in `to`."""
    turn = matrix(to, picture=True) @ matrix(axes, picture=True).T
    return next(k for k in range(4) if (np.linalg.matrix_power(_QUARTER, k) == turn).all())


def handedness_of(axes: str) -> str:
    """Of the axes themselves, "right" or "left"."""
    return "left" if np.linalg.det(matrix(axes)) < 0 else "right"


def handed(cube: CubeMap, handedness: str, axes: str = "gltf") -> CubeMap:
    """A map of the named axes as one whose cube coordinates are left-handed or right-handed, or the reverse.

    Where the axes are not so, x is mirrored: "left", as three.js and Babylon.js look up cube textures, with each face
    as seen from inside. Raises ValueError for another name.
    """
    if handedness not in HANDEDNESS:
        raise ValueError(f"handedness must be one of {', '.join(HANDEDNESS)}, got {handedness!r}")
    return cube if handedness == handedness_of(axes) else turned(cube, np.diag([-1, 1, 1]))
