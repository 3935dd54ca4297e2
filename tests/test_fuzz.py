"""The fuzz targets under sanitizers: seeds and random inputs. `./dev fuzz` looks for new ones where there is Clang."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TARGETS = sorted(p.stem for p in (ROOT / "tests" / "fuzz").glob("*.cpp") if p.stem not in ("entry", "replay"))

SHARE = {"session": 4}  # of the inputs: one takes a second


@pytest.fixture(scope="module")
def programs():
    if "FASTIBL_FUZZ" not in os.environ:
        pytest.skip("set FASTIBL_FUZZ to a number of random inputs a target: builds the core once more, for minutes")
    compiler = shutil.which("g++")
    if compiler is None or shutil.which("cmake") is None:
        pytest.skip("needs g++ and cmake")
    tree = ROOT / "build" / "replay"
    # -Og has the sanitizers' checks of -O1, and compiles in two thirds of its time.
    options = ["-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_CXX_FLAGS_RELEASE=-Og", "-DFASTIBL_FUZZ=ON"]
    ninja = ["-G", "Ninja"] if shutil.which("ninja") else []
    for command in (
        ["cmake", "-S", ROOT, "-B", tree, *ninja, *options, f"-DCMAKE_CXX_COMPILER={compiler}"],
        ["cmake", "--build", tree, "-j2"],
    ):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert done.returncode == 0, done.stdout[-4000:]
    return tree / "tests" / "fuzz"


def test_every_target_has_seeds():
    assert len(TARGETS) == 9
    for target in TARGETS:
        assert any((ROOT / "tests" / "fuzz" / "seeds" / target).iterdir()), target


@pytest.mark.parametrize("target", TARGETS)
def test_no_finding(target, programs):
    seeds = ROOT / "tests" / "fuzz" / "seeds" / target
    inputs = int(os.environ["FASTIBL_FUZZ"]) // SHARE.get(target, 1)
    command = [programs / f"fuzz_{target}", seeds, str(inputs)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=programs)
    print(target, done.stdout)
    assert done.returncode == 0, done.stderr[-4000:]
