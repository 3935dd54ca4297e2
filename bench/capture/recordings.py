"""Recordings that rows share, kept between runs, and what capture made of them."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import fastibl
from fastibl import recording, room, shutter, simulator
from fastibl.comparison import irradiance_error
from fastibl.expected import present
from fastibl.recording import truth_of

from .. import inputs
from ..brute import CACHE

FRESH = "immenstadter_horn"  # a place with a sun
ROOM = "room"  # the built-in room, with walls, windows and a ceiling light at 1 to 3 m
LIT_ROOM = "room with its lamp"  # the same while a lamp 2.5 m away is on
_SOURCES = tuple(Path(inspect.getfile(module)) for module in (recording, room, shutter, simulator))


class LitRoom(room.Room):
    """The built-in room while its lamp is on."""

    def irradiance(self, points: ArrayLike, lamp: bool = False, reflected: bool = True) -> NDArray[np.float32]:
        return super().irradiance(points, True, reflected)

    def radiance(
        self, position: ArrayLike, directions: ArrayLike, lamp: bool = False, unit: bool = False
    ) -> NDArray[np.float32]:
        return super().radiance(position, directions, True, unit)


def every_place() -> list[str]:
    """The maps, the room, and the place with a sun, as far as they are there."""
    return [*inputs.MAPS, ROOM, *([FRESH] if inputs.SUN_MAP.is_file() else [])]


def recorded(place: str, **options) -> fastibl.Recording:
    """fastibl.simulate(...) in a place given by name; kept by its options and by the sources that make it."""
    path = {ROOM: None, LIT_ROOM: None, FRESH: inputs.SUN_MAP}.get(place, inputs.MAPS.get(place))
    named = {name: getattr(value, "__qualname__", value) for name, value in options.items()}
    parts = hashlib.sha256(repr((place, fastibl.__version__, sorted(named.items()))).encode())
    given = [value if inspect.isfunction(value) else type(value) for value in options.values() if callable(value)]
    code = [Path(inspect.getfile(each)) for each in (*given, recorded)]
    for source in (*_SOURCES, *code, *([path] if path else [])):
        parts.update(source.read_bytes())
    folder = CACHE / f"recording-{parts.hexdigest()[:20]}"
    if not folder.is_dir():
        made = folder.with_suffix(f".{os.getpid()}.part")  # other processes may make the same one
        shutil.rmtree(made, ignore_errors=True)
        fastibl.simulate(LitRoom() if place == LIT_ROOM else path, out=made, **options)
        with contextlib.suppress(OSError):  # another process was first
            made.rename(folder)
        shutil.rmtree(made, ignore_errors=True)
    return fastibl.Recording.open(folder)


def sweep_film(place: str, **options) -> fastibl.Recording:
    """A sweep of both cameras all round, in constant light."""
    return recorded(place, position=inputs.OBJECT, path="sweep", hand=False, lamp=False, **options)


@dataclass(frozen=True)
class Stated:
    """What a captured map says of its error, and that error: a median over normals, of the irradiance."""

    coverage: float
    low: float
    high: float
    error: float

    @property
    def inside(self) -> bool:
        return self.low <= self.error <= self.high


@dataclass(frozen=True)
class Moment(Stated):
    """A frame of a sweep. pushed: the error where unseen texels are filled by push and pull."""

    predicted: float
    pushed: float


def moment_of(environment: fastibl.Environment, true: fastibl.CubeMap) -> Moment:
    low, high = environment.predicted_interval
    error, pushed = irradiance_error(environment, true), irradiance_error(push_pull(environment), true)
    return Moment(environment.coverage, low, high, error, environment.predicted_error, pushed)


def push_pull(environment: fastibl.Environment) -> fastibl.CubeMap:
    """What was seen, and elsewhere the mean of the smallest square around that was seen at all; of all faces where
    nothing of a face was."""
    weight = (environment.confidence > 0).astype(np.float64)[..., None]
    levels = [(environment.radiance.faces * weight, weight)]
    while levels[-1][0].shape[1] > 1:
        n = levels[-1][0].shape[1] // 2
        levels.append(tuple(x.reshape(6, n, 2, n, 2, -1).sum(axis=(2, 4)) for x in levels[-1]))
    light, weight = (x.sum(axis=0, keepdims=True) for x in levels[-1])
    filled = np.broadcast_to(light / np.maximum(weight, 1), (6, 1, 1, 3))
    for light, weight in reversed(levels):
        step = light.shape[1] // filled.shape[1]
        coarser = filled.repeat(step, axis=1).repeat(step, axis=2)
        filled = np.where(weight > 0, light / np.maximum(weight, 1), coarser)
    return fastibl.CubeMap(filled.astype(np.float32))


@dataclass(frozen=True)
class Sweep:
    """What is known at the end of a sweep."""

    moment: Moment
    environment: fastibl.Environment
    true: fastibl.CubeMap
    tracked: int  # number of frames


@cache
def sweep(place: str, **known: Any) -> Sweep:
    """60 frames in 6 s by both cameras (63 and 78 degrees wide) with brackets, tracked. known: what the session is told
    of distances."""
    film = sweep_film(place, seconds=6, fps=10, seed=0)
    session = fastibl.Session(inputs.scene(), film.rig, film.board, **known)
    true = truth_of(film).environment(0.0)
    tracked, result = 0, None
    for frame in film:
        result = session.process(frame)
        tracked += result.tracked is not None
    environment = present(result).environment
    return Sweep(moment_of(environment, true), environment, true, tracked)


def sweeps() -> Iterator[tuple[str, Sweep]]:
    """The sweeps of all maps at infinity."""
    for name in inputs.MAPS:
        yield name, sweep(name)


def followed(place: str, frames_a_second: float, path: str, seed: int, **options) -> Iterator[tuple]:
    """(capture, map, true map) after each frame of 6 s of small pictures with their true poses."""
    film = recorded(
        place,
        seconds=6,
        fps=frames_a_second,
        seed=seed,
        size=(320, 240),
        position=inputs.OBJECT,
        path=path,
        hand=False,
        lamp=False,
    )
    capture = fastibl.Capture(size=128, board=film.board, centre=inputs.OBJECT, **options)
    true = truth_of(film).environment(0.0)
    for frame in film:
        pose = truth_of(film).pose(frame.time)
        capture.add(frame.back, film.rig.back, pose, exposure=frame.back_exposure, time=frame.time)
        turned = film.rig.front_from_back @ pose
        capture.add(frame.front, present(film.rig.front), turned, exposure=frame.front_exposure, time=frame.time)
        yield capture, capture.environment(), true


@cache
def moments(place: str, path: str, seed: int) -> list[Moment]:
    """The moments of each frame of a film by `path`, "hand" or "sweep"."""
    return [moment_of(environment, true) for _, environment, true in followed(place, 10, path, seed)]
