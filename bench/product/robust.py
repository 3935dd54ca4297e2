"""Findings of sanitizers over the C++ suites, and of the tests of faults."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator

from ..goals import Goal, row, skipped
from ..measure import ROOT
from ..processes import tests

_SUITES = re.compile(r"(\d+) tests failed out of (\d+)")


@row("product", "sanitizers")
def sanitizers() -> Iterator[Goal]:
    for name in ("address", "undefined", "thread"):
        what = f"C++ suites under the {name} sanitizer"
        if not (ROOT / "build" / f"sanitize-{name}" / "build.ninja").is_file():
            yield skipped(what, f"./dev sanitize {name} builds and runs them, in some minutes")
            continue
        done = subprocess.run(["./dev", "sanitize", name], cwd=ROOT, capture_output=True, text=True)
        failed, count = map(int, found.groups()) if (found := _SUITES.search(done.stdout)) else (1, 0)
        findings = len(re.findall("SUMMARY: |runtime error: ", done.stdout + done.stderr))
        yield Goal(
            what,
            f"{count - failed} of {count} pass, {findings} findings",
            "all, 0",
            done.returncode == 0 and failed == 0 and count > 0 and findings == 0,
        )


@row("product", "faults")
def faults() -> Iterator[Goal]:
    yield tests("tests of faults and of untrusted files", ["test_faults.py", "test_product_faults.py"])
