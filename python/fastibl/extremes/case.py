"""One extreme case: the input, the outcome that is expected in words, and the real outcome."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Outcome:
    """Whether the expectation holds, the outcome in words, and the decimal digits lost against float64."""

    held: bool
    text: str
    lost: float | None = None


@dataclass(frozen=True)
class Case:
    """step: of a frame. backend: "cpu", or "gl" for a case that runs there. long: whether it takes seconds."""

    step: str
    name: str
    expectation: str
    measure: Callable[[], Outcome]
    backend: str = "cpu"
    long: bool = False

    @property
    def title(self) -> str:
        return f"{self.step}: {self.name}" + (" [gl]" if self.backend == "gl" else "")


@dataclass(frozen=True)
class Row:
    """A case that was run; seconds of processor time."""

    step: str
    name: str
    backend: str
    expectation: str
    outcome: str
    held: bool
    lost: float | None
    seconds: float

    def as_dict(self) -> dict:
        return asdict(self)


def run_case(case: Case) -> Row:
    """Runs a case; anything that it raises breaks the expectation."""
    begin = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # extreme input may cause warnings; what counts is what comes out
            outcome = case.measure()
    except Exception as error:  # of any kind: only a refusal that was expected may be raised
        outcome = Outcome(False, f"{type(error).__name__}: {error}")
    return Row(
        case.step,
        case.name,
        case.backend,
        case.expectation,
        outcome.text,
        bool(outcome.held),
        outcome.lost,
        time.process_time() - begin,
    )


# --- outcomes


def alike(name: str, cpu: np.ndarray, gl: np.ndarray, limit: float = 2e-3) -> Outcome:
    """Pictures of both back ends. limit: by the brightest value, for 99 of 100 pixels."""
    if cpu.shape != gl.shape:
        return Outcome(False, f"{name}: {cpu.shape} and {gl.shape}")
    largest = max(float(cpu.max()), 1e-20)
    worst = float(np.quantile(np.abs(cpu - gl).max(axis=-1), 0.99)) / largest
    return Outcome(worst <= limit, f"{name}: {worst:.1e}" if worst > limit else f"within {limit:g}")


def both(*outcomes: Outcome) -> Outcome:
    """All outcomes as one, with the words of those that are broken, or else of all."""
    broken = [o for o in outcomes if not o.held]
    lost = [o.lost for o in outcomes if o.lost is not None]
    return Outcome(
        not broken, "; ".join(dict.fromkeys(o.text for o in broken or outcomes)), max(lost) if lost else None
    )


def each(values: Iterable[Any], outcome: Callable[..., Outcome], *arguments: Any) -> Outcome:
    """The outcomes of all values as one; all get the same arguments."""
    return both(*(outcome(value, *arguments) for value in values))


def at_most(value: float, limit: float, what: str, percent: bool = False) -> Outcome:
    shown = f"{100 * value:.2g} %" if percent else f"{value:.3g}"
    return Outcome(bool(value <= limit), f"{what} {shown}")


def is_light(values: ArrayLike, most: float | NDArray | None = None, what: str = "light") -> Outcome:
    """Holds if the values are finite, never negative, and at most `most` if that is given."""
    values = np.asarray(values)
    bad = int((~np.isfinite(values)).sum() + (values < 0).sum())
    if bad:
        return Outcome(False, f"{bad} of {values.size} values of {what} not finite or negative")
    if most is not None and (values > most).any():
        return Outcome(False, f"{what} up to {values.max():.3g}, expected at most {float(np.max(most)):.3g}")
    return Outcome(True, f"{what} {values.min():.3g} to {values.max():.3g}" if values.size else f"no {what}")


def is_ratio(values: ArrayLike, what: str = "ratio") -> Outcome:
    values = np.asarray(values)
    held = bool(((values >= 0) & (values <= 1)).all())
    return Outcome(held, f"{what} {values.min():.3g} to {values.max():.3g}" if values.size else f"no {what}")


def equal(value: ArrayLike, expected: ArrayLike, tolerance: float = 0.0, what: str = "value") -> Outcome:
    """Holds if the value is equal within a tolerance relative to the largest expected value; digits are lost relative
    to that value, too."""
    value, expected = np.asarray(value, np.float64), np.asarray(expected, np.float64)
    scale = max(float(np.abs(expected).max()), 1e-300)
    error = float(np.abs(value - expected).max()) / scale if np.isfinite(value).all() else math.inf
    # Where a formula may be off by this much, its error says nothing about digits lost.
    return Outcome(error <= tolerance, f"{what} within {error:.1e}", digits_lost(error) if tolerance < 1e-4 else None)


def digits_lost(relative_error: float) -> float:
    """Decimal digits by which a result is less exact than float32 stores it; 0 if it is as exact."""
    if not math.isfinite(relative_error):
        return math.inf
    return max(0.0, math.log10(max(relative_error, 1e-30) / 2.0**-24))


def refused(
    call: Callable[[], object], kinds: type[Exception] | tuple[type[Exception], ...] = ValueError, *words: str
) -> Outcome:
    """Holds if the call raises one of the kinds, with a message that contains all words."""
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    try:
        call()
    except kinds as error:
        missing = [w for w in words if w not in str(error)]
        said = str(error).splitlines()[0] if str(error) else ""
        return Outcome(bool(said) and not missing, f"{type(error).__name__}: {said}"[:120])
    return Outcome(False, f"accepted, expected {' or '.join(k.__name__ for k in kinds)}")


def result_or_refusal(call: Callable[[], Outcome]) -> Outcome:
    """An outcome, or a clear ValueError in its place."""
    try:
        return call()
    except ValueError as error:
        return Outcome(bool(str(error)), f"ValueError: {error}".splitlines()[0][:120])


# --- tables


def table(rows: Iterable[Row]) -> str:
    """For people: one line per case, with broken ones marked."""
    lines = []
    step = None
    for row in rows:
        if row.step != step:
            step = row.step
            lines.append(f"\n{step}")
        mark = "ok    " if row.held else "BROKEN"
        lost = "" if row.lost is None else f"  [{row.lost:.1f} digits lost]"
        name = row.name + (" [gl]" if row.backend == "gl" else "")
        lines.append(f"  {mark} {name:<58} {row.outcome}{lost}")
        if not row.held:
            lines.append(f"         expected: {row.expectation}")
    return "\n".join(lines).lstrip("\n")
