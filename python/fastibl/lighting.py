"""Lighting: what a map does to surfaces, by named methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ._fastibl import CubeMap, Environment, _diffuse_methods, _glossy_methods, _Lighting

_DEFAULT = {"diffuse": "sh9", "glossy": "mip", "shadow": "cap-product", "tracking": "board"}
_PAPER = {"diffuse": "six-face", "glossy": "mip", "shadow": "cap-product", "tracking": "frame-marker"}


@dataclass(frozen=True)
class Method:
    """A method of a step by its public name, with its settings and, where known, its relative error."""

    name: str
    settings: Mapping[str, float] = field(default_factory=dict)
    error: float | None = field(default=None, compare=False)

    def __str__(self) -> str:
        settings = ", ".join(f"{key}={value:g}" for key, value in self.settings.items())
        error = "" if self.error is None else f" (error {100 * self.error:.2g} %)"
        return self.name + (f" [{settings}]" if settings else "") + error


def methods(step: str) -> list[Method]:
    """Every method (and setting) of a step: "diffuse", "glossy", "shadow" or "tracking".

    Raises ValueError for another step.
    """
    names = {
        "diffuse": _diffuse_methods,
        "glossy": _glossy_methods,
        "shadow": lambda: ["cap-sum", "cap-product"],
        "tracking": lambda: ["frame-marker", "board"],
    }
    if step not in names:
        raise ValueError(f"no step {step!r}; there are: {', '.join(names)}")
    return [Method(name) for name in names[step]()]


def method_name(step: str, method: str | Method) -> str:
    """Name of a given method, with "auto" and "paper" resolved. Raises ValueError, naming all, if there is none."""
    name = method.name if isinstance(method, Method) else method
    name = _DEFAULT[step] if name == "auto" else _PAPER[step] if name == "paper" else name
    known = [m.name for m in methods(step)]
    if name not in known:
        raise ValueError(f'no {step} method "{name}"; there are: {", ".join(known)}')
    return name


class Lighting(_Lighting):
    """What a map does to surfaces.

    cube: CubeMap or Environment. diffuse, glossy: Method, its name, "auto" (the default) or "paper". Raises ValueError
    for an unknown name.
    """

    def __init__(self, cube: CubeMap | Environment, diffuse: str | Method = "auto", glossy: str | Method = "auto"):
        radiance = cube.radiance if isinstance(cube, Environment) else cube
        super().__init__(radiance, method_name("diffuse", diffuse), method_name("glossy", glossy))

    @property
    def methods(self) -> dict[str, Method]:
        """The method of each step, with the error of its irradiance as measured on this map."""
        return {"diffuse": Method(self._diffuse, error=self._irradiance_error), "glossy": Method(self._glossy)}

    def __repr__(self) -> str:
        return f"<fastibl.Lighting diffuse {self.methods['diffuse']}, glossy {self.methods['glossy']}>"
