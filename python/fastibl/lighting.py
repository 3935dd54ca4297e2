"""Lighting: what a map does to surfaces, by named methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ._fastibl import CubeMap, Environment, _Lighting, _method_names, _Methods

STEPS = ("tracking", "capture", "diffuse", "glossy", "shadow")
AUTO, PAPER = _Methods._auto(), _Methods._paper()


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
    """Every method (and setting) of a step: "tracking", "capture", "diffuse", "glossy" or "shadow".

    Raises ValueError for another step.
    """
    names = _method_names(step)
    if not names:
        raise ValueError(f"no step {step!r}; there are: {', '.join(STEPS)}")
    return [Method(name) for name in names]


def method_name(step: str, method: str | Method) -> str:
    """Name of a given method, with "auto" and "paper" resolved. Raises ValueError, naming all, if there is none."""
    name = method.name if isinstance(method, Method) else method
    if name in ("auto", "paper"):
        return str(getattr(AUTO if name == "auto" else PAPER, step))
    known = [m.name for m in methods(step)]
    if name not in known:
        raise ValueError(f'no {step} method "{name}"; there are: {", ".join(known)}')
    return name


def resolve_methods(given: str | Mapping[str, str | Method]) -> _Methods:
    """All steps of "auto", "paper", or a mapping from step (or "normalization") to method; the rest is automatic."""
    if isinstance(given, str):
        if given not in ("auto", "paper"):
            raise ValueError(f'methods must be "auto", "paper" or a mapping, got {given!r}')
        return AUTO if given == "auto" else PAPER
    unknown = set(given) - set(STEPS) - {"normalization"}
    if unknown:
        raise ValueError(f"no step {sorted(unknown)[0]!r}; there are: {', '.join(STEPS)}")
    chosen = {step: method_name(step, given.get(step, "auto")) for step in STEPS}
    return _Methods(normalization=str(given.get("normalization", "energy")), **chosen)


class Lighting(_Lighting):
    """What a map does to surfaces.

    cube: CubeMap or Environment. diffuse, glossy: Method, its name, "auto" (the default) or "paper". Raises ValueError
    for an unknown name.
    """

    def __init__(self, cube: CubeMap | Environment, diffuse: str | Method = "auto", glossy: str | Method = "auto"):
        radiance = cube.radiance if isinstance(cube, Environment) else cube
        super().__init__(radiance, method_name("diffuse", diffuse), method_name("glossy", glossy))

    @classmethod
    def _wrap(cls, core: _Lighting) -> Lighting:
        lighting = cls.__new__(cls)
        _Lighting.__init__(lighting, core)
        return lighting

    @property
    def methods(self) -> dict[str, Method]:
        """The method of each step, with the error of its irradiance as measured on this map."""
        return {
            "diffuse": Method(self._diffuse, error=self._irradiance_error),
            "glossy": Method(self._glossy),
        }

    def __repr__(self) -> str:
        return f"<fastibl.Lighting diffuse {self.methods['diffuse']}, glossy {self.methods['glossy']}>"
