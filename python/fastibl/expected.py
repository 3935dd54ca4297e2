"""Errors that name what was expected and what came, for arguments that are not arrays."""

from __future__ import annotations

from numbers import Real
from typing import Any, SupportsIndex, TypeVar

from ._fastibl import Rig

_T = TypeVar("_T")

_NAMES = {Real: "a number", SupportsIndex: "a whole number", type(None): "None"}

# How to get a thing of this type, for the error where something else was given.
_HINTS = {
    "Camera": "Camera(width, height, fx, fy, cx, cy) is one without distortion",
    "CubeMap": "read_environment reads files, CubeMap(faces) takes (6, n, n, 3) floats",
    "Frame": "Frame(time, back=picture) is one of a picture",
    "Material": "Material(diffuse, glossy, exponent) makes one",
    "Mesh": "read_mesh reads files",
    "Rig": "Rig(camera) is one of a back camera alone, recording.read_rig reads files",
    "Scene": "Scene(mesh, material) makes one",
}


def present(value: _T | None) -> _T:
    """The value, where it is known not to be None although its type allows it. Raises ValueError if it is None after
    all."""
    if value is None:
        raise ValueError("expected a value, got None")
    return value


def wrong_type(value: Any, kinds: tuple[type, ...], what: str, hint: str = "") -> str:
    """The message that `what` must be one of these types, and what came. hint: what to do, in a few words, if not the
    usual."""
    names = [_NAMES.get(kind, kind.__name__.lstrip("_")) for kind in kinds]
    expected = " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
    got = "None" if value is None else type(value).__name__
    hint = hint or next((_HINTS[name] for name in names if name in _HINTS), "")
    return f"{what} must be {expected}, got {got}{': ' + hint if hint else ''}"


def expect(value: Any, kinds: type | tuple[type, ...], what: str, hint: str = "") -> None:
    """Raises TypeError unless `value` is of one of these types."""
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    if not isinstance(value, kinds):
        raise TypeError(wrong_type(value, kinds, what, hint))


def expect_source(value: Any) -> None:
    """Raises TypeError unless `value` gives frames and has the rig they come from, as sources and recordings do."""
    if not (hasattr(value, "__iter__") and isinstance(getattr(value, "rig", None), Rig)):
        got = "None" if value is None else type(value).__name__
        raise TypeError(f"source must be a Source, got {got}: fastibl.Recording(path) is one of a folder")
