"""The board out of view, with the rotation followed by the surroundings; and the board turned by hand."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.expected import present
from fastibl.recording import truth_of
from fastibl.simulator import DistantPlace, HandPath, simulate

from .. import inputs, measure
from ..goals import Goal, percent, row, skipped
from .recordings import ROOM, recorded
from .turning_path import ABOUT, turning, turning_after_moving

SECONDS, FPS = 10.0, 20.0
GYRO = 0.001  # rad per root of a second: that of a phone, without the bias that its driver removes


@dataclass(frozen=True)
class Sweep:
    """What a session made of a sweep. errors: degrees, of each frame whose rotation the surroundings told."""

    errors: NDArray
    seconds: NDArray  # CPU time of the tracking pass in these frames
    missing: int  # frames without a pose of either kind
    coverage: float  # of the sphere, but for the directions in which the map's centre sees the board's page
    above: float  # of the half above the horizon
    returned: float  # degrees between the board's pose and the last one by the surroundings, each against the truth


def _angle(a: fastibl.Pose, b: fastibl.Pose) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(a.rotation @ b.rotation.T) - 1) / 2, -1, 1))))


def _page(board: fastibl.Board, directions: NDArray, centre: NDArray) -> NDArray[np.bool_]:
    """Whether the board's page is seen from the map's centre. It is a fifth of the sphere, because it lies close below;
    what it shows is no light of the place, and is filled from around."""
    down = np.maximum(-directions[..., 2], 1e-12)
    at = centre[:2] + directions[..., :2] * (centre[2] / down)[..., None]
    return (directions[..., 2] < 0) & (np.abs(at) < (board.width / 2, board.height / 2)).all(axis=-1)


@cache
def swept(place: str, gyro: float | None = None, path: Callable[[float], fastibl.Pose] = turning) -> Sweep:
    film = recorded(
        place,
        seconds=SECONDS + (path is not turning) * ABOUT,
        fps=FPS,
        seed=0,
        hand=False,
        lamp=False,
        auto_exposure=True,
        gyro=gyro,
        path=path,
    )
    session = fastibl.Session(inputs.scene(), film.rig, film.board)
    errors, seconds, missing = [], [], 0
    for frame in film:
        begin = time.process_time()
        result = session.process(frame)
        spent = time.process_time() - begin
        if result.turned is not None:
            errors.append(_angle(result.turned.back_from_marker, truth_of(film).pose(frame.time)))
            seconds.append(spent * result.timings["track"] / result.timings["total"])
        missing += result.turned is None and result.back_from_marker is None
    size = session.capture.last_seen.shape[-1]
    seen = np.isfinite(session.capture.last_seen)
    angles = np.broadcast_to(fastibl.texel_solid_angles(size), seen.shape)
    directions = fastibl.texel_directions(size)
    up, page = directions[..., 2] > 0, _page(film.board, directions, np.array(present(result.environment).centre))
    return Sweep(
        np.array(errors),
        np.array(seconds),
        missing,
        float(angles[seen & ~page].sum() / angles[~page].sum()),
        float(angles[seen & up].sum() / angles[up].sum()),
        errors[-1] if errors else float("nan"),
    )


@row("capture", "board out of view")
def out_of_view() -> Iterator[Goal]:
    films = [(name, turning) for name in (*inputs.MAPS, ROOM)] + [(ROOM, turning_after_moving)]
    for gyro, (name, path) in product((None, GYRO), films):
        s = swept(name, gyro, path)
        most = float(np.percentile(s.errors, 95)) if s.errors.size else float("inf")
        middle = float(np.median(s.errors)) if s.errors.size else float("inf")
        goal = name != ROOM
        yield Goal(
            f"10 s sweep, board in view at start and end, {name}"
            f"{', after moving about the board' if path is not turning else ''}{', a gyroscope' if gyro else ''}: "
            "seen above the horizon, rotation (95 %)",
            f"{percent(s.above)}, {most:.3f} degrees",
            ">= 95 %, <= 0.3 degrees",
            bool(s.above >= 0.95 and most <= 0.3) if goal else None,
            (
                f"rotation: median {middle:.3f}, worst {max(s.errors, default=float('inf')):.3f} degrees, "
                f"{s.returned:.3f} as the board comes back; "
                f"{len(s.errors)} frames by the surroundings, {s.missing} without any pose",
            ),
        )
    if not inputs.MAPS:
        yield skipped("10 s sweep, board in view at start and end", inputs.NO_MAPS)
        return
    whole = {name: swept(name).coverage for name in inputs.MAPS}
    yield Goal(
        f"10 s sweep, board in view at start and end, {len(whole)} maps: seen of the sphere without the board's page, "
        "median, least",
        f"{percent(float(np.median(list(whole.values()))))}, {percent(min(whole.values()))}",
        ">= 95 %",
        min(whole.values()) >= 0.95,
        ("not seen: the zenith, and a rim of 1 cm around the page, which is left out with it",),
    )


@row("capture", "cost of a turned frame")
def cost() -> Iterator[Goal]:
    name = "potsdamer_platz" if "potsdamer_platz" in inputs.MAPS else ROOM
    with measure.one_core():
        swept.cache_clear()
        seconds = float(np.median(swept(name).seconds))
    yield Goal(
        "two 640 x 480 pictures against the map, with the search for the board that is not there: CPU time",
        f"{1e3 * seconds:.2f} ms",
        "for information",
        None,
    )


def _about_z(angle: float) -> NDArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class _TurnedPlace(DistantPlace):
    """A place in which the marker lies turned by `angle` radians about z."""

    angle = 0.0

    def _sky(self, d: NDArray) -> NDArray:
        return super()._sky(np.ascontiguousarray(d @ _about_z(self.angle).T.astype(np.float32)))


@dataclass(frozen=True)
class Move:
    when: list[float]  # seconds at which the move was noticed
    error: float  # at the end: median over the seen texels, divided by the true mean


@cache
def moved(
    name: str, degrees: float, seconds: float = 5.0, begin: float = 2.0, took: float = 0.6, gyro: float | None = None
) -> Move:
    """A hand holds the cameras while the board is turned about z. 320 x 240."""
    place, hand = _TurnedPlace(inputs.real_maps()[name]), HandPath(np.random.default_rng(0), 12.0)

    def path(moment: float) -> fastibl.Pose:
        place.angle = np.radians(degrees) * np.clip((moment - begin) / took, 0, 1)
        turn = np.eye(4)
        turn[:3, :3] = _about_z(place.angle)
        return hand.back_from_marker(moment) @ fastibl.Pose(turn)

    film = simulate(place, seconds=seconds, fps=15, hand=False, lamp=False, path=path, size=(320, 240))
    session = fastibl.Session(inputs.scene(), film.rig, film.board)
    rng, off, results = np.random.default_rng(1), np.eye(3), []
    for frame in film:
        if gyro is not None:  # relative to the place, not to the board
            off = (
                off
                @ fastibl.Pose.from_rotation_vector(gyro / np.sqrt(15) * rng.standard_normal(3), np.zeros(3)).rotation
            )
            frame = replace(frame, attitude=hand.back_from_marker(frame.time).rotation @ off)
        results.append((frame.time, session.process(frame)))
    d = fastibl.texel_directions(128).astype(np.float64)
    # The place's own truth does not include the turn.
    true = place.truth((0, 0, 0.1), 128).sample(d @ _about_z(np.radians(degrees)).T)
    seen = np.isfinite(session.capture.last_seen) & (d[..., 2] > 0.1)
    got = results[-1][1].environment.radiance.faces[seen]
    error = float(np.median(np.abs(got - true[seen]).mean(axis=-1)) / true[seen].mean())
    return Move([moment for moment, result in results if result.board_moved], error)


@row("capture", "board moved by hand")
def board_moved() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("board turned by hand", inputs.NO_MAPS)
        return
    for gyro, degrees in product((None, GYRO), (30.0, -8.0, 0.0)):
        found = {name: moved(name, degrees, gyro=gyro) for name in inputs.MAPS}
        right = sum(len(m.when) == (degrees != 0) for m in found.values())
        what = "with a gyroscope, " if gyro else ""
        yield Goal(
            f"board turned by {degrees:g} degrees within 0.6 s at 2 s, {what}{len(found)} maps: noticed"
            if degrees
            else f"board left where it is, {what}{len(found)} maps: not taken for moved",
            f"{right} of {len(found)}",
            "all" if not degrees else "for information",
            right == len(found) if not degrees else None,
            (
                "at: "
                + ", ".join(f"{name} {'/'.join(f'{w:.2f} s' for w in m.when) or '-'}" for name, m in found.items()),
                "median error of seen texels, of the mean: "
                + ", ".join(f"{name} {percent(m.error)}" for name, m in found.items()),
            ),
        )
