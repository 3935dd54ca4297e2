"""A suite of stiff and extreme cases for every step and both back ends, each with its expectation.

`run` gives a row per case; `fastibl extremes` prints them. A broken expectation is a bug.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from .case import Case, Outcome, Row, run_case, table

BACKENDS = ("cpu", "gl", "all")


def all_cases(only: str = "", backend: str = "all") -> list[Case]:
    """The cases of a back end whose title ("shadow: two that touch, directions [gl]") contains the word.

    Raises ValueError for another back end, and where no title contains the word.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend must be one of {', '.join(BACKENDS)}, got {backend!r}")
    from . import boards, captures, light, maps, near, objects, pictures, plans, sessions, shadow

    every = [
        case
        for module in (maps, light, shadow, objects, near, pictures, plans, boards, captures, sessions)
        for case in module.cases()
    ]
    found = [c for c in every if only.lower() in c.title.lower() and backend in ("all", c.backend)]
    if not found:
        raise ValueError(
            f"no case has {only!r} in its title; steps are: {', '.join(dict.fromkeys(c.step for c in every))}"
        )
    return found


def run(only: str = "", backend: str = "all", progress: Callable[[Case], object] | None = None) -> Iterator[Row]:
    """Runs the cases in order. progress: called with each case before it runs."""
    for case in all_cases(only, backend):
        if progress:
            progress(case)
        yield run_case(case)


__all__ = ["BACKENDS", "Case", "Outcome", "Row", "all_cases", "run", "run_case", "table"]
