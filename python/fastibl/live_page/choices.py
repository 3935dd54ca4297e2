"""What the page's controls offer, and what they may be set to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import shapes
from .._fastibl import Material, Mesh, with_gl
from ..files import mesh_and_material, stand
from ..lighting import STEPS, method_name, methods

OWN = "its own"  # the material in the object's file, or that of the command line
_MOST_ERROR, _MOST_MILLISECONDS = 1.0, 1000.0
_ACTIONS, _SWITCHES = ("step", "restart"), ("freeze", "record", "shadow")


def materials() -> dict[str, Material]:
    """The built-in materials by name."""
    return {
        "white plaster": Material((0.75, 0.75, 0.75)),
        "grey clay": Material((0.3, 0.28, 0.26)),
        "porcelain": Material((0.62, 0.6, 0.57), (0.16, 0.16, 0.16), 80.0),
        "red plastic": Material.pbr((0.6, 0.03, 0.02), 0.0, 0.25),
        "gold": Material.pbr((1.0, 0.77, 0.34), 1.0, 0.25),
        "brushed steel": Material.pbr((0.56, 0.57, 0.58), 1.0, 0.35, anisotropy=0.8),
        "chrome": Material.pbr((0.55, 0.56, 0.55), 1.0, 0.05),
    }


def _ball() -> Mesh:
    import trimesh

    made = trimesh.creation.icosphere(4)
    return Mesh(made.vertices, made.faces)


def _cube() -> Mesh:
    import trimesh

    made = trimesh.creation.box()
    return Mesh(made.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3))  # corners apart: flat sides


def _ring() -> Mesh:
    import trimesh

    made = trimesh.creation.torus(1.0, 0.36, major_sections=64)
    return Mesh(made.vertices[:, [0, 2, 1]] * [1, -1, 1], made.faces)  # turns it upright


_BUILT_IN: dict[str, Callable[[], Mesh]] = {"figurine": shapes.figurine, "ball": _ball, "cube": _cube, "ring": _ring}


class Choices:
    """Objects, materials, methods and back ends to choose from.

    files: meshes besides the built-in ones; the page begins with the first. up: the files' up axis. height: that of all
    objects, metres. Raises ValueError where two files have the same name.
    """

    def __init__(self, files: Sequence[Path] = (), up: str = "y", height: float = 0.15):
        self._files = {path.name: path for path in files}
        if len(self._files) != len(files):
            raise ValueError(f"objects are chosen by name, but two of these have one: {', '.join(map(str, files))}")
        self._up, self._height = up, height
        self.objects = [*self._files, *_BUILT_IN]
        self.materials = materials()
        self.backends = ["cpu", "gl"] if with_gl else ["cpu"]
        self.methods = {step: list(dict.fromkeys(m.name for m in methods(step))) for step in STEPS}

    def mesh(self, name: str) -> tuple[Mesh, Material]:
        """An object as it stands on the board, and its own material. Raises whatever reading its file raises."""
        path = self._files.get(name)
        if path is None:
            return stand(_BUILT_IN[name](), self._height), Material()
        mesh, material = mesh_and_material(path, self._up)
        return stand(mesh, self._height), material or Material()

    def describe(self) -> dict[str, Any]:
        """The choices as the page reads them."""
        return {
            "objects": self.objects,
            "materials": [OWN, *self.materials],
            "methods": self.methods,
            "paper": {step: method_name(step, "paper") for step in STEPS},
            "backends": self.backends,
        }

    def read(self, changes: Any) -> dict[str, Any]:
        """Checks changes that a page sends. Raises ValueError that names what was expected and what came."""
        if not isinstance(changes, Mapping) or not changes:
            raise ValueError("expected an object of changes by name")
        return {name: self._read(name, value) for name, value in changes.items()}

    def _read(self, name: str, value: Any) -> Any:
        if name in _ACTIONS:
            return _one_of(name, value, (True,))
        if name in _SWITCHES:
            return _one_of(name, value, (True, False))
        if name == "object":
            return _one_of(name, value, self.objects)
        if name == "material":
            return _one_of(name, value, [OWN, *self.materials])
        if name == "backend":
            return _one_of(name, value, self.backends)
        if name == "error":
            return _number(name, value, 0, _MOST_ERROR)
        if name == "milliseconds":
            return _number(name, value, 0, _MOST_MILLISECONDS)
        if name == "turn":
            return _number(name, value, -360, 360)
        if name == "methods":
            return self._read_methods(value)
        raise ValueError(f"there is no control {str(name)[:40]!r}")

    def _read_methods(self, value: Any) -> str | dict[str, str]:
        if isinstance(value, str):
            return _one_of("methods", value, ("auto", "paper"))
        if not isinstance(value, Mapping):
            raise ValueError('methods must be "auto", "paper" or an object from step to method')
        for step, name in value.items():
            _one_of("step", step, STEPS)
            _one_of(step, name, ("auto", *self.methods[step]))
        return dict(value)


def _one_of(name: str, value: Any, choices: Sequence[Any]) -> Any:
    if isinstance(value, (str, bool)) and value in choices:
        return value
    raise ValueError(f"{name} must be one of {', '.join(map(str, choices))}; got {str(value)[:40]!r}")


def _number(name: str, value: Any, least: float, most: float) -> float:
    good = isinstance(value, (int, float)) and not isinstance(value, bool)  # NaN lies in no range
    if not (good and least <= value <= most):
        raise ValueError(f"{name} must be a number from {least:g} to {most:g}, got {str(value)[:40]!r}")
    return float(value)
