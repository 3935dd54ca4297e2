"""fastibl extremes: stiff and extreme cases for every step, each with what is expected of it."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from ._arguments import parser


def add(commands: argparse._SubParsersAction) -> None:
    p = parser(
        commands,
        "extremes",
        run,
        "run stiff and extreme cases of every step and print what came out (exit code 1 on a broken expectation)",
        "fastibl extremes --only sun --json extremes.json",
    )
    p.add_argument("--only", default="", metavar="WORD", help="only cases that have this in their title")
    p.add_argument("--backend", choices=("cpu", "gl", "all"), default="all", help="default: %(default)s")
    p.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")


def _number_or_null(value: Any) -> Any:
    """JSON has no infinity and no NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def run(arguments: argparse.Namespace) -> int:
    from tqdm import tqdm

    from .. import __version__, extremes
    from ..gl_device import gl_device
    from ..machine import cpu
    from ..whole_file import write_whole

    if arguments.json and not arguments.json.absolute().parent.is_dir():
        raise FileNotFoundError(f"no folder {arguments.json.absolute().parent} for {arguments.json.name}")
    backend, device, missing = arguments.backend, "", ""
    if backend != "cpu":
        device, missing = gl_device()
        if missing and backend == "gl":
            raise ValueError(f"the GL back end cannot run: {missing}")
    cases = extremes.all_cases(arguments.only, "cpu" if missing else backend)
    rows = []
    with tqdm(cases, unit="case", leave=False, disable=None) as bar:
        for case in bar:
            bar.set_description(case.step)
            rows.append(extremes.run_case(case))
    print(extremes.table(rows))
    broken = [row for row in rows if not row.held]
    seconds = sum(row.seconds for row in rows)
    print(f"\n{len(rows) - len(broken)} of {len(rows)} expectations hold; {seconds:.0f} s of processor time")
    if backend != "cpu":
        print(f"not run on GL: {missing}" if missing else f"GL: {device}")
    if arguments.json:
        found = {
            "version": __version__,
            "machine": cpu(),
            "gl": missing or "run",
            "device": device,
            "cases": [{k: _number_or_null(v) for k, v in row.as_dict().items()} for row in rows],
        }
        write_whole(arguments.json, json.dumps(found, indent=1, allow_nan=False) + "\n")
        print(f"wrote {arguments.json}")
    for row in broken:
        print(f"broken: {row.step}: {row.name} [{row.backend}]: expected {row.expectation}; {row.outcome}")
    return 1 if broken else 0
