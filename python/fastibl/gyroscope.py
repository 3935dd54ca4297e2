"""Gyroscopes fixed to a camera: logs as telephones write them, and the attitudes of the camera derived from them."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .rotations import RotationPath, accumulated

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_MOST_DEVIATION = np.radians(2.0)  # of the axes
_HOLE, _HOLE_STEPS = 0.1, 5  # seconds, and usual steps, without readings: longer, and the turn meanwhile is not known
_MOST_A_SECOND, _LEAST_A_SECOND = 5000.0, 5.0  # readings a second
# Names of columns: those that are likely to be the time (likeliest first), and those of a gyroscope among several
# sensors.
_TIMES = ("elapsed", "seconds", "timestamp", "time", "t")
_RATES = re.compile(r"gyr|rot|omega|^w")
_UNIT = re.compile(r"[(\[]([^)\]]*)[)\]]")


def read_gyroscope(path: str | os.PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Reads a log: (times (n,) in seconds, rates (n, 3) in radians a second about the gyroscope's own axes).

    path: text in columns separated by commas, semicolons, tabs or spaces. With a header, the time and the columns whose
    names end in x, y and z are read (those of a gyroscope, if there are several sensors), in the units given in
    parentheses; without one, time and three rates. A time without a unit is in whichever of s, ms, us and ns makes 5 to
    5000 readings a second. Readings are sorted, and of those at the same time one is kept. A last line that is cut off
    is left out, with a warning. Raises ValueError that names what was found for anything else.
    """
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        every = file.readlines()
    numbers = [n for n, line in enumerate(every, 1) if line.strip() and not line.lstrip().startswith("#")]
    lines = [every[n - 1].strip() for n in numbers]
    if len(lines) < 3:
        raise ValueError(f"{path} holds {len(lines)} lines; expected readings of a gyroscope")
    separator = _separator(lines[1])
    rows = [_fields(line, separator) for line in lines]
    header = None if _numbers(rows[0]) is not None else rows.pop(0)
    if header is None and len(rows[0]) != 4:
        raise ValueError(f"{path} must have four columns, time and three rates, or a header; got {len(rows[0])}")
    columns = [0, 1, 2, 3] if header is None else _columns(header, rows[0], path)
    table = np.full((len(rows), 4), np.nan)
    for k, row in enumerate(rows):
        values = _numbers([row[c] for c in columns]) if len(row) > max(columns) else None
        if values is not None:
            table[k] = values
            continue
        line = k + (header is not None)
        where = f"{path} line {numbers[line]}"
        if k < len(rows) - 1 or every[-1].endswith("\n"):
            raise ValueError(f"{where}: expected numbers, got {lines[line][:60]!r}")
        warnings.warn(f"{where}, its last, is cut off and left out: {lines[line][:60]!r}", stacklevel=2)
    units = [_unit(header[c]) if header else "" for c in columns]
    table = table[np.isfinite(table).all(axis=1)]
    _, kept = np.unique(table[:, 0], return_index=True)
    times, rates = table[kept, 0], table[kept, 1:]
    rates = rates * [_radians_a_second(unit, path) for unit in units[1:]]
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    told = [_SECONDS[units[0]]] if units[0] in _SECONDS else list(dict.fromkeys(_SECONDS.values()))
    fitting = [s for s in told if step > 0 and _LEAST_A_SECOND <= 1 / (step * s) <= _MOST_A_SECOND]
    if not fitting:
        raise ValueError(f"{path}: times {step:g} apart are no gyroscope's, in seconds or in any other unit")
    return fitting[0] * times, rates


def _separator(reading: str) -> str | None:
    """What stands between the columns; None: spaces. Commas may be those of decimals."""
    for mark in ";\t":
        if mark in reading:
            return mark
    decimal = all("," in field.strip(",") or "," not in field for field in reading.split())
    return "," if "," in reading and not (decimal and _numbers(_fields(reading, None)) is not None) else None


def _fields(line: str, separator: str | None) -> list[str]:
    fields = [field.strip().strip('"') for field in line.split(separator)]
    return [field.replace(",", ".") for field in fields] if separator != "," else fields


def _numbers(fields: Sequence[str]) -> list[float] | None:
    try:
        return [float(field) for field in fields]
    except ValueError:
        return None


def _unit(name: str) -> str:
    found = _UNIT.search(name)
    return found[1].strip().lower() if found else ""


def _radians_a_second(unit: str, path: str | os.PathLike[str]) -> float:
    """Of a unit such as deg/s, mdps or "", which is rad/s."""
    if not unit:
        return 1.0
    found = re.match(r"(m|milli)?(rad|deg|dps|°|º|1/s|s\^?-1)", unit)
    if found is None:
        raise ValueError(f"{path}: rates in {unit!r}; expected rad/s or deg/s, or thousandths of them")
    return (1e-3 if found[1] else 1.0) * (np.pi / 180 if found[2] in ("deg", "dps", "°", "º") else 1.0)


def _columns(header: Sequence[str], first: Sequence[str], path: str | os.PathLike[str]) -> list[int]:
    """The numbers of the columns of the time and of the rates about x, y and z."""
    names = [_UNIT.sub("", name).strip().lower() for name in header]
    there = [k for k in range(min(len(names), len(first))) if _numbers([first[k]]) is not None]
    time = next((k for word in _TIMES for k in there if (names[k] == word if word == "t" else word in names[k])), None)
    rates = []
    for axis in "xyz":
        named = [k for k in there if k != time and names[k].endswith(axis)]
        rates.append(named if len(named) < 2 else [k for k in named if _RATES.search(names[k])])
    if time is None or any(len(found) != 1 for found in rates):
        raise ValueError(
            f"{path}: expected a column of the time and one each of the rates about x, y and z, got {', '.join(header)}"
        )
    return [time, *(found[0] for found in rates)]


@dataclass(frozen=True, eq=False)
class Gyroscope:
    """A gyroscope that is fixed to a camera, as calibrate_timing finds it.

    times: (n,) seconds of its own clock; rates: (n, 3) radians a second about its own axes. camera_from_gyro: (3, 3)
    from its axes to the camera's; deviation: its largest standard deviation about any axis, radians. drift: (3,)
    radians a second by which the camera's turns (as rotation vectors of now_from_before) exceed what the rates tell.
    clock_offset: seconds by which its clock is ahead of the camera's. Raises ValueError for times that do not increase,
    fewer than two readings, and other shapes.
    """

    times: NDArray[np.float64]
    rates: NDArray[np.float64]
    camera_from_gyro: NDArray[np.float64]
    deviation: float
    drift: NDArray[np.float64]
    clock_offset: float

    def __post_init__(self) -> None:
        n = np.size(self.times)
        shapes = {"times": (n,), "rates": (n, 3), "camera_from_gyro": (3, 3), "drift": (3,)}
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name), np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(f"{name} must be {shape} of finite numbers, got {value.shape}")
            object.__setattr__(self, name, value)
        if n < 2 or not (np.diff(self.times) > 0).all():
            raise ValueError(f"a gyroscope needs two readings or more at times that increase, got {n}")

    def attitudes(self, times: ArrayLike) -> list[NDArray[np.float64] | None]:
        """Attitudes of the camera at times of its own clock: Frame.attitude (3, 3), None where nothing was read.

        Across a hole in the log of more than 0.1 s, and of 5 of its usual steps, turns are not known: attitudes are
        then those of the part of the log in which most of the times are, and a warning says so.
        times: seconds. Raises ValueError where the turns from which the gyroscope was found do not tell how it lies in
        the camera within 2 degrees.
        """
        if not self.deviation < _MOST_DEVIATION:
            raise ValueError(
                f"how the gyroscope lies in the camera is known within {np.degrees(self.deviation):.0f} degrees only: "
                "turn the camera before the board about more than one axis"
            )
        turns = -0.5 * (self.rates[1:] + self.rates[:-1]) @ self.camera_from_gyro.T + self.drift
        path = RotationPath(self.times, accumulated(np.diff(self.times)[:, None] * turns))
        at = np.atleast_1d(np.asarray(times, np.float64)) + self.clock_offset
        known = (at >= self.times[0]) & (at <= self.times[-1])
        steps = np.diff(self.times)
        hole = steps > max(_HOLE, _HOLE_STEPS * np.median(steps))
        step = np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(steps) - 1)
        part, known = np.cumsum(hole)[step], known & ~hole[step]
        if known.any():
            known &= part == np.bincount(part[known]).argmax()
        if hole.any():
            warnings.warn(
                f"the gyroscope's log has {hole.sum()} holes of up to {steps.max():.2g} s: attitudes of "
                f"{known.sum()} of {len(at)} times are known together",
                stacklevel=2,
            )
        return [rotation if there else None for rotation, there in zip(path(at), known, strict=True)]

    def __repr__(self) -> str:
        return (
            f"Gyroscope({len(self.times)} readings of {self.times[-1] - self.times[0]:.1f} s, "
            f"clock_offset={self.clock_offset:.4f})"
        )
