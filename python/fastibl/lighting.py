"""Lighting: what a map does to surfaces, by named methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ._fastibl import CubeMap, Environment, _level_parameters, _Lighting, _method_names, _Methods, _prefilter

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

    def prefiltered(
        self,
        size: int = 128,
        levels: int = 7,
        model: str = "ggx",
        *,
        mapping: str | None = None,
        parameters: Sequence[float] | None = None,
        wanted: Sequence[int] | None = None,
        error: float = 0.002,
    ) -> list[CubeMap | None]:
        """Maps convolved with a lobe, from sharp to rough, for renderers that look them up by roughness.

        Level k is a CubeMap of faces max(1, size >> k) wide; each texel is the lobe's average around its direction,
        with the view along it (n = v = r), so that a constant map stays as it is.

        model: "ggx", D(theta/2) cos(theta) with parameter alpha, as Filament, three.js and glTF viewers store it;
        "phong", cos^p(theta); or "blinn", cos^s(theta/2) cos(theta), Eq. 3 seen along the normal.
        mapping: how level k of n becomes the parameter. "gltf" (default of ggx): perceptual roughness r = k/(n - 1),
        alpha = r^2, so a shader reads level r (n - 1). "filament": 2r - r^2 = k/(n - 1). "cmft" (default of phong):
        p = 1 + 2^(1 + 8 (1 - k/n)). Level 0 of the first two is the map itself.
        parameters: one a level instead of a mapping (needed for "blinn"); alpha 0 and exponent infinity give the map.
        wanted: indices of the levels to make; the others are None, and cost nothing.
        error: mean error of a level by its mean that real maps stay below; smaller takes longer.
        Raises ValueError for what is none of these.
        """
        if parameters is None:
            if mapping is None and model == "blinn":
                raise ValueError('model "blinn" needs parameters: an exponent for each level')
            given = _level_parameters(mapping or ("cmft" if model == "phong" else "gltf"), levels)
            if mapping is not None and (mapping == "cmft") != (model == "phong"):
                raise ValueError(f'mapping "{mapping}" is not one of model "{model}"')
        else:
            if mapping is not None:
                raise ValueError("give a mapping or parameters, not both")
            given = [float(p) for p in parameters]
            levels = len(given)
        if size < 1:
            raise ValueError(f"size must be at least 1, got {size}")
        chosen = range(levels) if wanted is None else sorted(set(wanted))
        for k in chosen:
            if not 0 <= k < levels:
                raise ValueError(f"wanted holds level {k}; there are {levels}")
        made = _prefilter(self, [(given[k], max(1, size >> k)) for k in chosen], model, error)
        out: list[CubeMap | None] = [None] * levels
        for k, cube in zip(chosen, made, strict=True):
            out[k] = cube
        return out

    def __repr__(self) -> str:
        return f"<fastibl.Lighting diffuse {self.methods['diffuse']}, glossy {self.methods['glossy']}>"
