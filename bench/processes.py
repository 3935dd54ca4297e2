"""Fresh processes: Python code, and tests that are goals in themselves."""

from __future__ import annotations

import os
import subprocess
import sys

from .goals import Goal, skipped
from .measure import ROOT


def python(*arguments: str, limit: float = 400) -> subprocess.CompletedProcess[str]:
    """Runs Python, which sees the same packages as this process, in the repository root."""
    path = os.pathsep.join(p for p in sys.path if p)
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=limit,
    )


def tests(what: str, names: list[str], select: str = "") -> Goal:
    """Runs test files that exist."""
    files = [name for name in names if (ROOT / "tests" / name).is_file()]
    if not files:
        return skipped(what, f"tests/{names[0]} is not there")
    chosen = [f"tests/{f}" for f in files] + (["-k", select] if select else [])
    ran = python("-m", "pytest", "-q", "-p", "no:cacheprovider", "--no-header", *chosen)
    last = ran.stdout.strip().splitlines()[-1].strip("= ") if ran.stdout.strip() else ran.stderr.strip()[-200:]
    counted = last.split(" in ")[0]
    if ran.returncode == 0 and "passed" not in counted:
        return skipped(what, counted)
    return Goal(what, counted, "all pass", ran.returncode == 0)
