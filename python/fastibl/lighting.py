"""Lighting: what a map does to surfaces, by named methods."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from types import MappingProxyType
from typing import Any, SupportsIndex

from ._fastibl import (
    CubeMap,
    Environment,
    Light,
    _level_parameters,
    _Lighting,
    _method_names,
    _method_settings,
    _Methods,
    _prefilter,
)
from .axes import radiance_of
from .expected import expect

STEPS = ("tracking", "capture", "diffuse", "glossy", "shadow", "self_shadow", "bounce")
AUTO, PAPER = _Methods._auto(), _Methods._paper()
_LARGEST = 8192  # texels along a face of a prefiltered level


@dataclass(frozen=True, init=False)
class Method:
    """A method of a step, by its public name, with its settings and, where known, its relative error.

    Settings are whole numbers given by keyword: Method("irradiance-cube", size=32). The method chooses those that are
    not given. Raises ValueError for a name that no step has, a setting that the method does not have, or a value that
    is not a whole number.
    """

    name: str
    settings: Mapping[str, int]
    error: float | None

    def __init__(self, name: str, /, error: float | None = None, **settings: float):
        _check_known(name, settings)
        expect(error, (Real, type(None)), "error")
        object.__setattr__(self, "name", name)
        whole = {key: _whole(key, value) for key, value in settings.items()}
        object.__setattr__(self, "settings", MappingProxyType(whole))
        object.__setattr__(self, "error", error)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Method):
            return NotImplemented
        return (self.name, self.settings) == (other.name, other.settings)

    def __reduce__(self) -> tuple[Any, ...]:
        return _method, (self.name, self.error, dict(self.settings))  # the mapping itself cannot be pickled

    def __hash__(self) -> int:
        return hash((self.name, frozenset(self.settings.items())))

    def __str__(self) -> str:
        settings = ", ".join(f"{key}={value}" for key, value in self.settings.items())
        error = "" if self.error is None else f" (error {100 * self.error:.2g} %)"
        return self.name + (f" [{settings}]" if settings else "") + error

    def __repr__(self) -> str:
        settings = "".join(f", {key}={value}" for key, value in self.settings.items())
        error = "" if self.error is None else f", error={self.error:.4g}"
        return f"Method({self.name!r}{settings}{error})"


def _method(name: str, error: float | None, settings: Mapping[str, int]) -> Method:
    return Method(name, error, **settings)


_MOST = 10**9  # of any setting


def _whole(key: str, value: float) -> int:
    try:
        whole = int(value)
    except (TypeError, ValueError, OverflowError):
        whole = None
    if whole is None or isinstance(value, str) or whole != value or abs(whole) > _MOST:
        raise ValueError(f"setting {key} must be a whole number of at most {_MOST}, got {value!r}")
    return whole


def _check_known(name: str, settings: Mapping[str, float]) -> None:
    """Raises ValueError where no step has that method, or where the method lacks one of these settings."""
    known: set[str] | None = set() if name in ("auto", "paper") else None
    for step in STEPS:
        if name in _method_names(step):
            known = set(_method_settings(step, name))
    if known is None:
        every = ", ".join(dict.fromkeys(name for step in STEPS for name in _method_names(step)))
        raise ValueError(f'no method "{name}"; there are: {every}')
    for key in settings:
        if key not in known:
            raise ValueError(f'{name} has no setting "{key}"; there are: {", ".join(sorted(known)) or "none"}')


def methods(step: str) -> list[Method]:
    """Lists every method of a step, with every setting that is worth comparing.

    step: "tracking", "capture", "diffuse", "glossy", "shadow", "self_shadow" or "bounce". Raises ValueError
    for another.
    """
    names = _method_names(step)
    if not names:
        raise ValueError(f"no step {step!r}; there are: {', '.join(STEPS)}")
    found = []
    for name in names:
        found.append(Method(name))
        for key, values in _method_settings(step, name).items():
            found += [Method(name, **{key: value}) for value in values]
    return found


def method_name(step: str, method: str | Method) -> str:
    """Name of a given method, with "paper" resolved. Raises ValueError, naming all methods, if the step has none of
    that name."""
    name = method.name if isinstance(method, Method) else method
    if name in ("auto", "paper"):
        return str(getattr(AUTO if name == "auto" else PAPER, step))
    known = _method_names(step)
    if name not in known:
        raise ValueError(f'no {step} method "{name}"; there are: {", ".join(known)}')
    return name


def method_settings(method: str | Method) -> dict[str, int]:
    return dict(method.settings) if isinstance(method, Method) else {}


def resolve_methods(given: str | Mapping[str, str | Method] | _Methods) -> _Methods:
    """The methods of all steps from "auto", "paper", a plan's methods, or a mapping from step (or "normalization") to
    method; steps that the mapping leaves out are "auto"."""
    expect(given, (str, Mapping, _Methods), "methods", '"auto", "paper", a plan\'s methods, or {step: method}')
    if isinstance(given, _Methods):
        return given
    if isinstance(given, str):
        if given not in ("auto", "paper"):
            raise ValueError(f'methods must be "auto", "paper" or a mapping, got {given!r}')
        return AUTO if given == "auto" else PAPER
    unknown = set(given) - set(STEPS) - {"normalization"}
    if unknown:
        raise ValueError(f"no step {sorted(unknown)[0]!r}; there are: {', '.join(STEPS)}")
    chosen: dict[str, Any] = {step: method_name(step, given.get(step, "auto")) for step in STEPS}
    settings: dict[str, Any] = {
        f"{step}_settings": method_settings(given.get(step, "auto")) for step in ("diffuse", "glossy", "shadow")
    }
    return _Methods(normalization=str(given.get("normalization", "energy")), **chosen, **settings)


class Lighting(_Lighting):
    """What a map does to surfaces.

    cube: CubeMap or Environment. diffuse, glossy: Method, its name, "auto" (the default) or "paper". previous: Lighting
    of the map a moment ago; its lobes and lights are moved along instead of being searched anew, which keeps them
    steady. Raises ValueError for an unknown name, an unknown setting or a value out of range.
    """

    def __init__(
        self,
        cube: CubeMap | Environment,
        diffuse: str | Method = "auto",
        glossy: str | Method = "auto",
        *,
        previous: Lighting | None = None,
    ):
        expect(previous, (Lighting, type(None)), "previous")
        super().__init__(
            radiance_of(cube),
            method_name("diffuse", diffuse),
            method_settings(diffuse),
            method_name("glossy", glossy),
            method_settings(glossy),
            previous,
            cube if isinstance(cube, Environment) else None,
        )

    @classmethod
    def _wrap(cls, core: _Lighting) -> Lighting:
        lighting = cls.__new__(cls)
        _Lighting.__init__(lighting, core)
        return lighting

    @property
    def methods(self) -> dict[str, Method]:
        """What "auto" chose for each step, its settings, and the error of the irradiance measured on this map."""
        return {
            "diffuse": Method(self._diffuse, error=self._irradiance_error, **self._diffuse_settings),
            "glossy": Method(self._glossy, **self._glossy_settings),
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
        mapping: how level k of n sets the parameter. "gltf" (default of ggx): perceptual roughness r = k/(n - 1),
        alpha = r^2, so a shader reads level r (n - 1). "filament": 2r - r^2 = k/(n - 1). "unity": r (1.7 - 0.7 r) =
        k/(n - 1). "cmft" (default of phong): p = 1 + 2^(1 + 8 (1 - k/n)). Level 0 is the map itself, except of "cmft".
        parameters: one per level instead of a mapping (needed for "blinn"); alpha 0 and exponent infinity give the map.
        wanted: indices of the levels to make; the others are None, and cost nothing. error: the mean error of a level,
        relative to its mean, that real maps stay below; a smaller one takes longer. Raises ValueError for other values.
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
            expect(parameters, Iterable, "parameters", "one number for each level")
            given = [float(p) for p in parameters]
            levels = len(given)
        expect(size, SupportsIndex, "size")
        if not 1 <= size <= _LARGEST:
            raise ValueError(f"size must be 1 to {_LARGEST} texels, got {size}")
        expect(wanted, (Iterable, type(None)), "wanted", "numbers of levels")
        chosen = set(range(levels) if wanted is None else wanted)
        for k in chosen:
            expect(k, SupportsIndex, "a level in wanted")
            if not 0 <= k < levels:
                raise ValueError(f"wanted holds level {k}; there are {levels}")
        asked = [(parameter, max(1, size >> k), k in chosen) for k, parameter in enumerate(given)]
        made = _prefilter(self, asked, model, error)
        return [cube if k in chosen else None for k, cube in enumerate(made)]

    def __reduce__(self) -> Any:
        raise TypeError("a Lighting is not pickled; pickle its map, and make Lighting(...) of that there")

    def __repr__(self) -> str:
        return f"<fastibl.Lighting diffuse {self.methods['diffuse']}, glossy {self.methods['glossy']}>"


def without_lights(cube: CubeMap | Environment) -> tuple[CubeMap, list[Light]]:
    """The map without its dominant lights, and these lights: together they give a surface the same light as the map.

    The lights are those of Lighting(cube).lights; map and lights together hold every photon once. This is for renderers
    that light with a map and, for their shadows, with lamps beside it. Where a light was, the map keeps up to about
    four times its mean radiance. The returned map has the same size where that is 64, 128, 256, ... texels along a
    face, otherwise 64. Raises TypeError for what is not a map.
    """
    lighting = Lighting(cube)
    return lighting._without_lights, lighting.lights
