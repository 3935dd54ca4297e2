"""Lights that are near: 20 cm away, in the object, on the plane, at a vertex."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np

from .._fastibl import DirectionShadow, Environment, Material, Rig, Scene
from ..lighting import Lighting
from ..recording import Frame
from ..session import Session
from .case import Case, Outcome, alike, both, is_light, is_ratio, refused
from .worlds import FRONT, PICTURE, ball_mesh, map_named, two_balls

CENTRE = (0.0, 0.0, 0.06)
PLACES = {
    "20 cm away": (0.06, 0.04, 0.25, 0.06),
    "2 cm above the object": (0.0, 0.0, 0.13, 0.005),
    "in the object": (0.0, 0.01, 0.08, 0.01),
    "on the plane": (0.2, 0.0, 0.0, 0.02),
    "below the plane": (0.2, 0.0, -0.3, 0.02),
    "at a vertex": (0.05, 0.0, 0.06, 0.01),
    "of no radius": (0.06, 0.04, 0.25, 0.0),
    "of negative radius": (0.06, 0.04, 0.25, -1.0),
    "around the centre": (0.0, 0.0, 0.06, 1.0),
    "at the centre": (0.0, 0.0, 0.06, 0.0),
    "of NaN": (np.nan, 0.0, 0.25, 0.06),
    "at infinity": (np.inf, 0.0, np.inf, 0.06),
    "1e30 m away": (3e29, 2e29, 1e30, 1e28),
    "1e-30 m away": (0.0, 0.0, 0.06 + 1e-30, 1e-31),
    "where the map is dark": (-0.3, -0.2, -0.2, 0.05),
}
# Rays to where a light is, from every pixel.
BY_RAYS = (("traced-lights", "cpu"), ("traced", "cpu"), ("traced-lights", "gl"))


def cases() -> Iterator[Case]:
    for name, place in PLACES.items():
        for backend in ("cpu", "gl"):
            yield Case(
                "near light",
                f"a lamp {name}: picture",
                "finite; no more than from half of all directions",
                partial(_drawn, place, backend),
                backend,
            )
        yield Case("near light", f"a lamp {name}: shadow", "ratios in [0, 1]", partial(_shadow, place))
        for method, backend in BY_RAYS:
            yield Case(
                "near light",
                f"a lamp {name}: own shadow, {method}",
                "finite; nowhere brighter than 1.1 times the brightest place with nothing hidden",
                partial(_hidden, place, method, backend),
                backend,
            )
        yield Case(
            "near light",
            f"a lamp {name}: own shadow, GL against CPU",
            "99 % of pixels within 1 % of the brightest",
            partial(_agree, place),
            "gl",
        )
    for name, options in (
        ("a box that does not hold the centre", {"box": [(1, 1, 1), (2, 2, 2)]}),
        ("a box of NaN", {"box": [(np.nan, -1, -1), (1, 1, 1)]}),
        ("a box inside out", {"box": [(1, 1, 1), (-1, -1, -1)]}),
        ("a box turned by NaN", {"box": [(-1, -1, -1), (1, 1, 1)], "box_yaw": np.nan}),
        ("a turned box that is not given", {"box_yaw": 0.5}),
        ("a centre of NaN", {"centre": (np.nan, 0, 0)}),
        ("lights of three numbers", {"lights": [(0.0, 0.0, 1.0)]}),
    ):
        yield Case(
            "near light",
            name,
            "ValueError",
            partial(_refused, options),
        )
    for name, box in (("a narrow box", ((-0.2, -0.2, 0), (0.2, 0.2, 0.3))), ("a huge box", ((-1e9,) * 3, (1e9,) * 3))):
        yield Case("near light", name, "finite light", partial(_boxed, box))


def _refused(options: dict[str, Any]) -> Outcome:
    return refused(lambda: Environment(map_named("lamp 20 cm away"), **options))


def _environment(place) -> Environment:
    return Environment(map_named("lamp 20 cm away"), centre=CENTRE, lights=[place])


@cache  # sessions use copies of it
def _scene() -> Scene:
    material = Material(diffuse=(0.6, 0.6, 0.6), glossy=(0.3, 0.3, 0.3), exponent=200)
    return Scene(ball_mesh(steps=12), material, spheres=4, visibility_rays=8)


def _drawn(place, backend: str) -> Outcome:
    session = Session(
        _scene(), Rig(PICTURE), environment=_environment(place), methods={"shadow": "directions"}, backend=backend
    )
    session.process(Frame(time=0.0, back_from_marker=FRONT))
    gain = session.plane_gain
    # A lamp gives most where it fills half of all directions.
    return both(
        is_light(session.object.rgba[..., :3], 100 * 400.0, "light"),
        is_light(gain.image, 10.0, "gain of the plane"),
    )


@cache
def _balls(method: str, backend: str) -> Session:
    methods = {"diffuse": "irradiance-cube", "self_shadow": method, "bounce": "none"}
    material = Material(diffuse=(0.6, 0.6, 0.6), glossy=(0.2, 0.2, 0.2), exponent=50)
    scene = Scene(two_balls(), material, spheres=0)
    return Session(scene, Rig(PICTURE), methods=methods, backend=backend)


@cache
def _balls_layer(place, method: str, backend: str) -> np.ndarray:
    session = _balls(method, backend)
    session.set_environment(_environment(place))
    session.process(Frame(time=0.0, back_from_marker=FRONT))
    return session.object.rgba


def _hidden(place, method: str, backend: str) -> Outcome:
    rgba, bare = _balls_layer(place, method, backend), _balls_layer(place, "none", backend)
    # A tenth more: without rays, a lamp's light is interpolated between vertices.
    return both(is_light(rgba, what="object"), is_light(rgba[..., :3], 1.1 * float(bare[..., :3].max()), "brightest"))


def _agree(place) -> Outcome:
    cpu, gl = (_balls_layer(place, "traced-lights", backend) for backend in ("cpu", "gl"))
    return alike("traced-lights", cpu, gl, 0.01)


def _shadow(place) -> Outcome:
    shadow = DirectionShadow(64).cast(_environment(place), [(0, 0, 0.06, 0.05)], resolution=24)
    return both(is_ratio(shadow.image), is_ratio(shadow.sample([(0.0, 0.0), (0.3, 0.1), (1e6, 0)])))


def _boxed(box) -> Outcome:
    environment = Environment(map_named("3 x 3 faces"), centre=CENTRE, box=box)
    scene = Scene(ball_mesh(steps=12), Material(glossy=(1, 1, 1), exponent=1e9), spheres=0, visibility_rays=0)
    session = Session(scene, Rig(PICTURE), environment=environment)
    session.process(Frame(time=0.0, back_from_marker=FRONT))
    lighting = Lighting(environment)
    return both(
        is_light(session.object.rgba, what="picture"),
        is_light(lighting.glossy([[0.0, 0, 1]], [[0.0, 0, 1]], 1e9), what="light"),
    )
