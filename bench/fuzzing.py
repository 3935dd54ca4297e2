"""Findings of the fuzz targets under AddressSanitizer and UndefinedBehaviorSanitizer.

FASTIBL_FUZZ_SECONDS sets for how long each target runs, at most (1800 for the goals); `./dev fuzz` builds the targets.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from .goals import Goal, row, skipped
from .measure import ROOT

PROGRAMS = ROOT / "build" / "fuzz" / "tests" / "fuzz"
SEEDS = ROOT / "tests" / "fuzz" / "seeds"
SECONDS, INPUTS = 1800.0, 10_000_000  # of these, a target has to reach one
CASES = 1_000_000  # of hostile geometry and light
_COUNT = re.compile(r"stat::number_of_executed_units: +(\d+)")


def targets() -> list[str]:
    return sorted(folder.name for folder in SEEDS.iterdir())


def _missing() -> str:
    if not all((PROGRAMS / f"fuzz_{name}").is_file() for name in targets()):
        return "./dev fuzz builds the targets, with Clang and libFuzzer"
    return "" if os.environ.get("FASTIBL_FUZZ_SECONDS") else f"FASTIBL_FUZZ_SECONDS={SECONDS:g} runs each that long"


def fuzzed(target: str, inputs: int, seconds: float) -> tuple[int, float, str]:
    """Number of inputs run, seconds, and what was found ("" for nothing)."""
    with tempfile.TemporaryDirectory() as corpus:
        command: list[str | Path] = [
            PROGRAMS / f"fuzz_{target}", corpus, SEEDS / target, f"-runs={inputs}", f"-max_total_time={seconds:g}",
            "-len_control=0", "-max_len=2048", "-timeout=60", "-rss_limit_mb=4096", "-print_final_stats=1",
            f"-artifact_prefix={ROOT / 'build' / 'fuzz' / target}-",
        ]  # fmt: skip
        begin = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
        spent = time.perf_counter() - begin
    count = _COUNT.search(done.stderr)
    return int(count.group(1)) if count else 0, spent, "" if done.returncode == 0 else done.stderr.strip()[-300:]


def _goal(what: str, target: str, inputs: int, enough_seconds: float) -> Goal:
    seconds = float(os.environ["FASTIBL_FUZZ_SECONDS"])
    count, spent, finding = fuzzed(target, inputs, seconds)
    enough = count >= inputs or spent >= enough_seconds
    stated = f"no finding in {inputs:.0e} inputs" + (f" or {enough_seconds:.0f} s" if enough_seconds < 1e9 else "")
    return Goal(
        what,
        f"{count} inputs in {spent:.0f} s, {'a finding' if finding else 'no finding'}",
        stated,
        False if finding else True if enough else None,
        (finding,) if finding else (),
    )


@row("plan", "fuzzing")
def every_target() -> Iterator[Goal]:
    for target in targets():
        what = f"fuzz target {target} under ASan and UBSan"
        yield skipped(what, _missing()) if _missing() else _goal(what, target, INPUTS, SECONDS)


@row("shadow", "hostile geometry and light, fuzzed")
def hostile() -> Iterator[Goal]:
    what = "hostile geometry and light under ASan and UBSan"
    yield skipped(what, _missing()) if _missing() else _goal(what, "shadow", CASES, 1e9)
