"""Recordings that the rows share, kept between runs, and what capture made of them."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import fastibl
from fastibl import recording, room, simulator
from fastibl.comparison import irradiance_error

from .. import inputs
from ..brute import CACHE

ROOM = "room"  # the built-in one, with walls and lamps at 1 to 3 m
_SOURCES = tuple(Path(module.__file__) for module in (recording, room, simulator))


def recorded(place: str, **options) -> fastibl.Recording:
    """fastibl.simulate(...) in a place by name, kept by its options and by the sources that make it."""
    path = None if place == ROOM else inputs.MAPS[place]
    parts = hashlib.sha256(repr((place, fastibl.__version__, sorted(options.items()))).encode())
    for source in (*_SOURCES, *([path] if path else [])):
        parts.update(source.read_bytes())
    folder = CACHE / f"recording-{parts.hexdigest()[:20]}"
    if not folder.is_dir():
        made = folder.with_suffix(".part")
        shutil.rmtree(made, ignore_errors=True)
        fastibl.simulate(path, out=made, **options)
        made.rename(folder)
    return fastibl.Recording.open(folder)


@dataclass(frozen=True)
class Moment:
    """A frame of a sweep. error: median over normals, of the irradiance of the map captured so far."""

    time: float
    coverage: float
    predicted: float
    error: float
    tracked: bool


@dataclass(frozen=True)
class Sweep:
    recording: fastibl.Recording
    moments: list[Moment]
    environment: fastibl.Environment  # in the end
    lighting: fastibl.Lighting
    true: fastibl.CubeMap  # in the end


@cache
def sweep(place: str, distance: float = float("inf"), seed: int = 0) -> Sweep:
    """60 frames in 6 s by both cameras (63 and 78 degrees wide) with brackets, tracked."""
    film = recorded(place, seconds=6, fps=10, seed=seed, position=inputs.OBJECT, path="sweep", hand=False, lamp=False)
    session = fastibl.Session(inputs.scene(), film.rig, film.board, distance=distance)
    true = film.truth.environment(0.0)
    moments, result = [], None
    for frame in film:
        result = session.process(frame)
        env = result.environment
        error = irradiance_error(env, true)
        moments.append(Moment(frame.time, env.coverage, env.predicted_error, error, result.tracked is not None))
    return Sweep(film, moments, result.environment, result.lighting, true)


def sweeps() -> Iterator[tuple[str, Sweep]]:
    """Of all maps at infinity."""
    for name in inputs.MAPS:
        yield name, sweep(name)
