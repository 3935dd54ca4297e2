"""Shadows on the plane: hostile spheres, suns, lights on the horizon and below it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from .._fastibl import CubeMap, DirectionShadow, cast_shadow, light_directions, shadow_ratio
from .case import Case, Outcome, both, equal, is_ratio, refused
from .worlds import MAPS, map_named, sun

METHODS = ("directions", "cap-sum", "cap-product")
_USUAL = (0.0, 0.0, 0.1, 0.08)

SPHERES = {
    "none": np.zeros((0, 4)),
    "one of NaN": [(np.nan, 0, 0.1, 0.05)],
    "one of radius NaN": [(0, 0, 0.1, np.nan)],
    "one of infinite radius": [(0, 0, 0.1, np.inf)],
    "one of radius 0": [(0, 0, 0.1, 0)],
    "one of negative radius": [(0, 0, 0.1, -0.05)],
    "one below the plane": [(0, 0, -0.2, 0.1)],
    "one that touches the plane from below": [(0, 0, -0.1, 0.1)],
    "one that touches the plane from above": [(0, 0, 0.1, 0.1)],
    "one cut by the plane": [(0, 0, 0, 0.1)],
    "one nearly sunken": [(0, 0, -0.0999, 0.1)],
    "one hovering 100 m up": [(0, 0, 100, 1)],
    "a speck": [(0, 0, 0.1, 1e-9)],
    "one as large as the Earth": [(0, 0, 6.4e6, 6.4e6)],
    "one of 1e30 m": [(0, 0, 0.5e30, 1e30)],
    "two the same": [_USUAL, _USUAL],
    "two that touch": [(-0.05, 0, 0.05, 0.05), (0.05, 0, 0.05, 0.05)],
    "one inside another": [(0, 0, 0.1, 0.1), (0, 0, 0.1, 0.04)],
    "two that overlap": [(-0.03, 0, 0.1, 0.08), (0.03, 0, 0.1, 0.08)],
    "two thousand": np.concatenate(
        [np.random.default_rng(0).uniform(-0.1, 0.1, (2000, 3)) + (0, 0, 0.2), np.full((2000, 1), 0.01)], axis=1
    ),
    "one that vanishes far away": [(1e9, -1e9, 0.1, 0.05)],
}
_IGNORED = {
    "none", "one of NaN", "one of radius NaN", "one of infinite radius", "one of radius 0", "one of negative radius",
    "one below the plane", "one that touches the plane from below",
}  # fmt: skip


def cases() -> Iterator[Case]:
    for name in SPHERES:
        for method in METHODS:
            yield Case(
                "shadow",
                f"spheres: {name}, {method}",
                "ratios in [0, 1]; 1 where none is above the plane",
                partial(_spheres, name, method),
            )
    for name in MAPS:
        for method in METHODS:
            yield Case(
                "shadow",
                f"{name}, {method}",
                "ratios in [0, 1]; 1 where nothing lights the plane",
                partial(_light, name, method),
            )
    for radiance in (1.0, 1e4, 1e8):
        for texels in (1, 100):
            yield Case(
                "shadow",
                f"sun of {radiance:g} in {texels} texels",
                "within 0.02 RMS of all texels summed",
                partial(_sun, radiance, texels),
            )
    for what, points, expected in (
        ("inside the sphere's foot", [(0.0, 0.0)], 0.0),
        ("1e9 m away", [(1e9, 1e9)], 1.0),
        ("at infinity", [(np.inf, 0)], 1.0),
        ("of NaN", [(np.nan, np.nan)], 1.0),
    ):
        yield Case("shadow", f"a point {what}", f"ratio {expected:g}", partial(_point, points, expected))
    for count in (8, 4096):
        yield Case("shadow", f"{count} directions", "ratios in [0, 1]; shares sum to 1", partial(_directions, count))
    for name, options in (
        ("7 directions", {"directions": 7}),
        ("5000 directions", {"directions": 5000}),
        ("an unknown method", {"method": "magic"}),
    ):
        yield Case("shadow", name, "ValueError", partial(refused, partial(_ratio, **options), ValueError))
    for name, given in (
        ("an extent of 0", {"extent": -1.0}),
        ("an extent of NaN", {"extent": np.nan}),
        ("a resolution of 1", {"resolution": 1}),
        ("a resolution of 100000", {"resolution": 100000}),
        ("a centre of NaN", {"centre": (np.nan, 0.0)}),
    ):
        yield Case(
            "shadow",
            f"map with {name}",
            "ValueError",
            partial(_refused_map, given),
        )
    yield Case("shadow", "light that comes and goes", "ratios in [0, 1] in every frame; the same at the end", _flicker)


def _refused_map(options: dict[str, Any]) -> Outcome:
    return refused(lambda: cast_shadow(map_named("3 x 3 faces"), [_USUAL], **options), ValueError)


def _points() -> np.ndarray:
    grid = np.linspace(-0.5, 0.5, 9)
    return np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)


def _spheres(name: str, method: str) -> Outcome:
    spheres = np.asarray(SPHERES[name], float).reshape(-1, 4)
    cube = map_named("sun of 1e6 in one texel")
    points = shadow_ratio(cube, spheres, _points(), method)
    image = cast_shadow(cube, spheres, method, resolution=24)
    found = both(is_ratio(points), is_ratio(image.image))
    if name in _IGNORED:
        return both(found, equal(points, 1, 0, "ratio"), equal(image.image, 1, 0, "map"))
    return found


def _light(name: str, method: str) -> Outcome:
    cube = map_named(name)
    if cube.size > 256:
        cube = CubeMap(cube.level(4))
    points = shadow_ratio(cube, [_USUAL], _points(), method)
    shadow = cast_shadow(cube, [_USUAL], method, resolution=24)
    found = both(is_ratio(points), is_ratio(shadow.image), is_ratio(shadow.sample(_points())))
    if name in ("black", "light from below only"):
        unlit = Outcome(shadow.no_light, "no light" if shadow.no_light else "not said to be without light")
        outside = points[np.hypot(*_points().T) > 0.2]
        return both(found, unlit, equal(outside, 1, 0, "ratio"))
    return found


def _sun(radiance: float, texels: int) -> Outcome:
    from ..reference import shadow_ratio as truth

    cube = CubeMap(sun(radiance, texels, size=128))
    axis = np.linspace(-0.125, 0.125, 17)  # where its shadow falls
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    true = truth(cube, [_USUAL], points)
    error, shadow = (
        float(np.sqrt(((ratio - true) ** 2).mean())) for ratio in (shadow_ratio(cube, [_USUAL], points), 1.0)
    )
    return Outcome(error <= 0.02 and shadow > 0.1, f"{error:.4f} RMS of a shadow of {shadow:.2f}")


def _point(points, expected: float) -> Outcome:
    foot = (0.0, 0.0, 0.05, 0.1)
    return both(*(equal(_ratio(m, points, foot), expected, 0, m) for m in METHODS))


def _ratio(method: str = "directions", points=((0.1, 0.1),), sphere=_USUAL, **options) -> np.ndarray:
    return shadow_ratio(map_named("3 x 3 faces"), [sphere], np.asarray(points, float), method, **options)


def _directions(count: int) -> Outcome:
    cube = map_named("blue and red lamps")
    towards, shares = light_directions(cube, count)
    return both(
        is_ratio(shadow_ratio(cube, [_USUAL], _points(), directions=count)),
        equal(shares.astype(np.float64).sum(axis=0), 1, 1e-5, "shares"),
        equal(np.linalg.norm(towards, axis=1), 1, 1e-5, "directions"),
    )


def _flicker() -> Outcome:
    caster = DirectionShadow(64)
    names = ("sun of 1e6 in one texel", "black", "NaN, infinite, negative", "light from below only", "1 x 1 faces")
    found = [is_ratio(caster.cast(map_named(n), [_USUAL], resolution=16).image) for n in names * 3]
    last = map_named("sun of 1e6 in one texel")
    for _ in range(70):  # new directions fade in over 32 maps
        image = caster.cast(last, [_USUAL], resolution=16)
        found.append(is_ratio(image.image))
    again = DirectionShadow(64).cast(last, [_USUAL], resolution=16)
    error = float(np.sqrt(((image.image - again.image) ** 2).mean()))
    return both(*found, Outcome(error < 0.02, f"{error:.4f} RMS from one made anew"))
