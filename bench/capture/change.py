"""A lamp that is switched on and off in view."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import cv2
import numpy as np

import fastibl
from fastibl.comparison import irradiance_over_sphere, relative_errors

from ..goals import Goal, percent, row
from ..light.speed import looking
from .merge import fine_rays, picture

FPS = 30
BRACKET = (1.0, 1 / 16, 1 / 256)
_ON, _OFF, _END = 1.0, 2.0, 3.0  # seconds
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
