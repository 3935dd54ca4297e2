"""Stiff and extreme cases: how many expectations hold, and how long the suite takes."""

from __future__ import annotations

from collections.abc import Iterator

from ..goals import Goal, row

LEAST_CASES = 300
LONGEST = 120.0  # seconds on two cores; most of it runs on one thread


@row("plan", "extreme cases")
def extreme_cases() -> Iterator[Goal]:
    from fastibl import extremes
    from fastibl.gl_device import gl_device

    missing = gl_device()[1]
    rows = list(extremes.run(backend="cpu" if missing else "all"))
    steps = dict.fromkeys(r.step for r in rows)
    for backend in ("cpu", "gl"):
        of = [r for r in rows if r.backend == backend]
        if backend == "gl" and missing:
            yield Goal("expectations that hold, GL", "skipped", missing, None)
            continue
        held = sum(r.held for r in of)
        broken = tuple(f"{r.step}: {r.name}: expected {r.expectation}; {r.outcome}" for r in of if not r.held)
        by_step = ", ".join(
            f"{step} {sum(r.step == step for r in of)}" for step in steps if any(r.step == step for r in of)
        )
        yield Goal(
            f"expectations that hold, {backend.upper()}",
            f"{held} of {len(of)}",
            "all",
            held == len(of),
            (by_step, *broken),
        )
    yield Goal("cases", f"{len(rows)}", f"at least {LEAST_CASES}", len(rows) >= LEAST_CASES)
    seconds = sum(r.seconds for r in rows)
    slow = sorted(rows, key=lambda r: -r.seconds)[:3]
    yield Goal(
        "processor time of the suite",
        f"{seconds:.0f} s",
        f"at most {LONGEST:.0f} s",
        seconds <= LONGEST,
        ("longest: " + ", ".join(f"{r.name} {r.seconds:.1f} s" for r in slow),),
    )
