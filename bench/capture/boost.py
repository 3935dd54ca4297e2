"""Light that clips in the shortest exposure: only a lower bound; the board's white says how much is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.expected import present
from fastibl.recording import truth_of

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .predicted import BANDS, TUNED
from .recordings import FRESH, ROOM, Stated, every_place, recorded
from .sweep import mean_error

MOST = 1000.0  # times the value that clipped
_EXPOSED = 0.4  # mean of the darker nine tenths of the sky, as a share of white: 7 to 22 % of the sphere clip
_ALL = (0.5, 2.0)  # times that exposure


@dataclass(frozen=True)
class Same:
    """The same exposure for ever."""

    exposure: float

    def __call__(self, last: float) -> float:
        return self.exposure


@dataclass(frozen=True)
class Alternate:
    """An exposure and one of four stops less, in turn."""

    longer: float

    def __call__(self, last: float) -> float:
        return self.longer / 16 if last > self.longer / 4 else self.longer


@dataclass(frozen=True)
class Moment(Stated):
    """A frame of a sweep. mean: of the error over normals. plane: relative error of the irradiance on the plane."""

    mean: float
    plane: float
    clipped: float
    boosted: float


def true_map(place: str) -> fastibl.CubeMap:
    if place == ROOM:
        film = recorded(ROOM, seconds=0.1, fps=10, seed=0, size=(32, 24), hand=False, lamp=False)
        return truth_of(film).environment(0.0)
    return fastibl.read_environment(inputs.SUN_MAP if place == FRESH else inputs.MAPS[place], size=64)


def one_exposure(cube: fastibl.CubeMap) -> float:
    """The exposure that a camera would choose: bright enough for the darker nine tenths of the sky."""
    above = fastibl.texel_directions(cube.size)[..., 2] > 0
    values = np.asarray(cube.faces, np.float64).mean(axis=-1)[above]
    return _EXPOSED / max(values[values <= np.quantile(values, 0.9)].mean(), 1e-12)


def on_plane(cube: fastibl.CubeMap) -> np.ndarray:
    """Irradiance (3,) on the plane."""
    weight = np.maximum(fastibl.texel_directions(cube.size)[..., 2], 0) * fastibl.texel_solid_angles(cube.size)
    return (np.asarray(cube.faces, np.float64) * weight[..., None]).sum(axis=(0, 1, 2))


@cache
def moments(
    place: str, brighter: float, path: str, seed: int, most: float | None, taken: Callable[[float], Any] = Same
) -> list[Moment]:
    """Moments of every third frame of 6 s in which the front camera keeps one exposure, `brighter` times the usual one,
    or takes others (taken: from that one) as well; of the last frame alone where nothing is boosted."""
    film = recorded(
        place,
        seconds=6,
        fps=10,
        seed=seed,
        size=(320, 240),
        position=inputs.OBJECT,
        path=path,
        hand=False,
        lamp=False,
        front_exposures=taken(brighter * one_exposure(true_map(place))),
    )
    capture = fastibl.Capture(size=128, board=film.board, centre=inputs.OBJECT, most_boost=most)
    true = truth_of(film).environment(0.0)
    plane, out = on_plane(true), []
    for index, frame in enumerate(film):
        pose = truth_of(film).pose(frame.time)
        capture.add(frame.back, film.rig.back, pose, exposure=frame.back_exposure, time=frame.time)
        if index:  # the first picture has another exposure
            turned = film.rig.front_from_back @ pose
            capture.add(frame.front, present(film.rig.front), turned, exposure=frame.front_exposure, time=frame.time)
        last = index == len(film) - 1
        if not last and (index % 3 or most == 1):
            continue
        environment = capture.environment()
        low, high = environment.predicted_interval
        off = on_plane(environment.radiance) / plane - 1
        out.append(
            Moment(
                environment.coverage,
                low,
                high,
                irradiance_error(environment, true),
                mean_error(environment, true),
                float(np.sqrt((off**2).mean())),
                environment.clipped,
                environment.knowledge["boosted_flux"],
            )
        )
    return out


def _row(places: list[str], brighter: float) -> tuple[list[str], dict[str, tuple[Moment, Moment]]]:
    ends = {p: (moments(p, brighter, "sweep", 0, 1.0)[-1], moments(p, brighter, "sweep", 0, MOST)[-1]) for p in places}
    return [
        f"{p} {percent(a.error)} to {percent(b.error)} (plane {percent(a.plane)} to {percent(b.plane)}; "
        f"{percent(a.clipped)} of what was seen clips, {percent(b.boosted)} of the light put back; "
        f"stated {percent(b.low)} to {percent(b.high)})"
        for p, (a, b) in ends.items()
    ], ends


@row("capture", "boost of what clips")
def boost() -> Iterator[Goal]:
    what = "one exposure for 60 frames, what clips boosted by the board's white"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    places = every_place()
    for brighter in _ALL:
        notes, ends = _row(places, brighter)
        clipped, ours = (np.array([pair[k].error for pair in ends.values()]) for k in (0, 1))
        planes = [[pair[k].plane for pair in ends.values()] for k in (0, 1)]
        yield Goal(
            f"{what}, sky exposed to {brighter * _EXPOSED:.1f} of white: irradiance, mean, median and worst of "
            f"{len(places)} places, against clipped maps",
            " against ".join(
                f"{percent(float(e.mean()))}, {percent(float(np.median(e)))}, {percent(e.max())}"
                for e in (ours, clipped)
            ),
            "mean <= 0.7 of clipped",
            bool(ours.mean() <= 0.7 * clipped.mean()),
            (
                f"on the plane: median {percent(float(np.median(planes[1])))} against "
                f"{percent(float(np.median(planes[0])))}; without studio: median "
                + " against ".join(
                    percent(float(np.median([pair[k].error for p, pair in ends.items() if not p.startswith("studio")])))
                    for k in (1, 0)
                ),
                *notes,
            ),
        )
    films = {
        p: [m for path, b in (*(("sweep", b) for b in _ALL), ("hand", _ALL[1])) for m in moments(p, b, path, 0, MOST)]
        for p in places
    }
    for low, high in BANDS:
        some = {p: [m for m in film if low <= m.coverage < high] for p, film in films.items()}
        every = [m for film in some.values() for m in film]
        if not every:
            continue
        inside = {p: [m.inside for m in film] for p, film in some.items()}
        share = float(np.mean([x for film in inside.values() for x in film]))
        tuned = [x for p, film in inside.items() if p in TUNED for x in film]
        others = [x for p, film in inside.items() if p not in TUNED for x in film]
        width, error = np.median([m.high - m.low for m in every]), np.median([m.error for m in every])
        yield Goal(
            f"one exposure, boosted, {percent(low)} to {percent(high)} of the sphere seen: share of frames whose error "
            "lies in the stated 90 % interval",
            percent(share),
            "85 to 95 %",
            0.85 <= share <= 0.95,
            (
                f"{len(every)} frames; median width {percent(float(width))}, median error {percent(float(error))}; "
                f"fitted to: {percent(float(np.mean(tuned)))}, the others: {percent(float(np.mean(others)))}",
            ),
        )


@row("capture", "a sun that every exposure clips")
def bracket() -> Iterator[Goal]:
    what = "two exposures 4 stops apart for 60 frames, lights that clip in both as bright as the board's white says"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    places = every_place()
    ends = {p: [moments(p, _ALL[0], "sweep", 0, most, Alternate)[-1] for most in (1.0, None)] for p in places}
    clip = {p: pair for p, pair in ends.items() if pair[0].clipped > 0}
    before, after = (np.array([pair[k].mean for pair in clip.values()]) for k in (0, 1))
    yield Goal(
        f"{what}: irradiance, mean over normals, {len(clip)} of {len(places)} places where any do, against clipped",
        f"{percent(float(after.mean()))} against {percent(float(before.mean()))}",
        "<= 0.7 of clipped",
        bool(after.mean() <= 0.7 * before.mean()),
        tuple(
            f"{p}: {percent(a.mean)} to {percent(b.mean)} (median {percent(a.error)} to {percent(b.error)}, "
            f"stated {percent(b.low)} to {percent(b.high)}; plane {percent(a.plane)} to {percent(b.plane)}; "
            f"{percent(a.clipped)} of what was seen clips, {percent(b.boosted)} of the light put back)"
            for p, (a, b) in clip.items()
        ),
    )
