"""A type checker finds nothing in the package and in bench/."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
if not (ROOT / "bench").is_dir():
    pytest.skip("needs the source tree", allow_module_level=True)


def test_types():
    # Earlier ones know less of lambdas, and of NumPy's arrays.
    pytest.importorskip("mypy.version", "2")
    pytest.importorskip("numpy", "2")
    # By pyproject.toml, which names the tree's folders: the tree is checked where the package is installed, too.
    command = [sys.executable, "-m", "mypy", f"--cache-dir={os.devnull}"]  # writing one takes seconds
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    clean = re.search(r"no issues found in (\d+) source files", done.stdout)
    assert clean, done.stdout[-4000:] + done.stderr
    assert int(clean[1]) > 200
