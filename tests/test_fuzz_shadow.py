"""The C++ of the shadow under sanitizers, with hostile spheres, grids and light: `fuzz_shadow 1000000` runs all."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = [
    *(
        f"cpp/fastibl/shadow/{name}.cpp"
        for name in (
            "plane_bits sky_energy light_directions direction_shadow steady_light ratio_at shadow_options".split()
        )
    ),
    *(f"cpp/fastibl/scene/{name}.cpp" for name in ("shadow_map", "methods", "cube_map", "cube_reduction")),
    "cpp/fastibl/core/parallel.cpp",
    "tests/cpp/fuzz_shadow.cpp",
]
FLAGS = "-std=c++20 -O1 -fsanitize=address,undefined -fno-sanitize-recover=undefined -ffp-contract=off -Wno-psabi"


@pytest.mark.skipif(
    "FASTIBL_FUZZ" not in os.environ, reason="set FASTIBL_FUZZ to a number of cases: builds for a minute"
)
def test_hostile_shadows_under_sanitizers(tmp_path):
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no g++")
    program = tmp_path / "fuzz_shadow"
    command = [compiler, *FLAGS.split(), f"-I{ROOT / 'cpp'}", f"-I{ROOT}", *SOURCES, "-lpthread", "-o", str(program)]
    subprocess.run(command, check=True, cwd=ROOT)
    done = subprocess.run([program, os.environ["FASTIBL_FUZZ"]], capture_output=True, text=True)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
