"""A lamp that is switched on and off in view, and one whose place is found."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.comparison import irradiance_over_sphere, relative_errors
from fastibl.room import Room

from .. import inputs
from ..goals import Goal, percent, row
from ..light.speed import looking
from .merge import fine_rays, picture

FPS = 30
BRACKET = (1.0, 1 / 16, 1 / 256)
_ON, _OFF, _END = 1.0, 2.0, 3.0  # seconds
_ROOM_LAMP = 30.0  # radiance that, on its side of the room, only the lamp has
_LAMP = np.array([0.25, 0.75, 0.62]) / np.linalg.norm([0.25, 0.75, 0.62])


@cache
def places() -> tuple[fastibl.CubeMap, fastibl.CubeMap]:
    """A room-like gradient, without and with a lamp of 6 degrees that doubles the irradiance."""
    d = fastibl.texel_directions(128).astype(np.float64)
    dark = (0.25 + 0.1 * d[..., 2:] + 0.05 * np.sin(7 * d[..., :1]) * np.cos(5 * d[..., 1:2])) * np.array([1, 0.9, 0.8])
    lit = dark.copy()
    radius = np.radians(6)
    lit[d @ _LAMP > np.cos(radius)] += 0.25 / np.sin(radius) ** 2
    return fastibl.CubeMap(dark.astype(np.float32)), fastibl.CubeMap(lit.astype(np.float32))


def film(capture: fastibl.Capture) -> Iterator[tuple[float, float, fastibl.Environment]]:
    """(time, the brightest radiance that the picture can hold, the map after it), from a hand-held camera that sees the
    lamp."""
    camera = fastibl.Camera(320, 240, 200.0, 200.0, 160.0, 120.0)
    rng, rays = np.random.default_rng(0), fine_rays(camera)
    for k in range(round(_END * FPS)):
        time = k / FPS
        lit = _ON <= time < _OFF
        sway = 0.06 * np.array([np.sin(1.7 * time), np.cos(2.3 * time), np.sin(3.1 * time)])
        pose = looking((_LAMP + sway) / np.linalg.norm(_LAMP + sway), np.array([0, 0, 0.05]))
        light = places()[lit].sample(rays @ pose.rotation).astype(np.float64)
        light = cv2.resize(light, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
        exposure = 1.6 * BRACKET[k % 3]
        capture.add(picture(light, camera, exposure, rng), camera, pose, exposure=exposure, time=time)
        yield time, 1 / exposure, capture.environment()


@row("capture", "a lamp switched in view")
def switched() -> Iterator[Goal]:
    d = fastibl.texel_directions(128).astype(np.float64)
    inner = d @ _LAMP > np.cos(np.radians(5))
    capture = fastibl.Capture(size=128)
    begun = {"on": _ON, "off": _OFF}
    first: dict[str, float] = {}
    settled: dict[str, float | None] = {"on": None, "off": None}
    errors = {"on": 0.0, "off": 0.0}
    for time, white, env in film(capture):
        state = "on" if _ON <= time < _OFF else "off" if time >= _OFF else None
        if state is None:
            continue
        truth = places()[state == "on"]
        seen = np.asarray(env.confidence) > 0
        ours = np.asarray(env.radiance.faces, np.float64)
        lamp = ours[inner].mean(axis=0)
        # What the picture can tell about the lamp: no more than white.
        shown = np.minimum(np.asarray(truth.faces, np.float64)[inner].mean(axis=0), white)
        first.setdefault(state, float((lamp / shown).min() if state == "on" else (shown / lamp).min()))
        a, b = (fastibl.CubeMap(np.where(seen[..., None], faces, 0)) for faces in (ours, truth.faces))
        error = float(np.median(relative_errors(irradiance_over_sphere(a), irradiance_over_sphere(b))))
        if error > 0.05:
            settled[state] = None
        elif settled[state] is None:
            settled[state] = time - begun[state] + 1 / FPS
        errors[state] = error
    for state in ("on", "off"):
        yield Goal(
            f"lamp switched {state} in view: share of it in the map after the first picture of it",
            percent(first[state]),
            ">= 90 %",
            first[state] >= 0.9,
            ("of what that picture can tell: white, where the lamp is brighter",),
        )
        late = settled[state]
        yield Goal(
            f"lamp switched {state} in view: irradiance of what is seen within 5 % after",
            "never" if late is None else f"{late:.3f} s",
            "<= 0.25 s",
            late is not None and late <= 0.25,
            (
                f"{FPS} pictures a second, exposures {', '.join(f'{b:g}' for b in BRACKET)} in turn; in the end "
                f"{percent(errors[state])}",
            ),
        )


@row("capture", "a lamp while its place is found")
def placed() -> Iterator[Goal]:
    """The built-in room, whose lamp is switched on at half-time: the map has it on a wall that is farther away until it
    is triangulated, and moves it then. Two of three pictures of it clip."""
    off, on = (Room().truth(inputs.OBJECT, 64, lamp).faces for lamp in (False, True))
    lamp = fastibl.texel_directions(64)[np.unravel_index((on - off).mean(axis=-1).argmax(), off.shape[:3])]
    d = fastibl.texel_directions(128).astype(np.float64)
    around = d @ lamp > np.cos(0.4) * np.linalg.norm(d, axis=-1) * np.linalg.norm(lamp)
    angles = fastibl.texel_solid_angles(128) * around
    recording = fastibl.simulate(seconds=20, fps=15, seed=0, position=inputs.OBJECT)
    session = fastibl.Session(inputs.scene(), recording.rig, recording.board)
    flux: list[float] = []
    moves = 0
    last: NDArray | None = None
    for frame in recording:
        env = session.process(frame).environment
        if env is None:
            continue
        light = np.asarray(env.radiance.faces, np.float64).mean(axis=-1)
        flux.append(float((light * (light > _ROOM_LAMP) * angles).sum()))
        places_now = np.asarray(env.light_positions)
        moves += last is not None and not np.array_equal(last, places_now)
        last = places_now
    begun = next(k for k, f in enumerate(flux) if f > 0.5 * flux[-1])
    steps = np.array(flux[begun + 1 :]) / np.array(flux[begun:-1])
    yield Goal(
        "a lamp in the room while its place is found: least light of it, by that in the picture before",
        f"{steps.min():.2f}",
        ">= 0.75",
        bool(steps.min() >= 0.75),
        (f"{len(steps)} pictures, from the first with half of its light on; places of lights changed in {moves}",),
    )
