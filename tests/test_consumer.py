"""The CMake package serves a project outside, from a prefix and from the build tree."""

import math
import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CONSUMER = ROOT / "examples" / "cpp_consumer"
CORE_ONLY = [f"-DFASTIBL_{part}=OFF" for part in ("TRACKING", "GL", "PYTHON", "DEMO", "TESTS")]

if not (shutil.which("cmake") and shutil.which("ninja")):
    pytest.skip("needs cmake and ninja", allow_module_level=True)
if not (ROOT / "CMakeLists.txt").is_file():
    pytest.skip("needs the source tree", allow_module_level=True)


def run(*command, fails=False):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=900)
    text = done.stdout + done.stderr
    assert (done.returncode != 0) == fails, f"{' '.join(map(str, command))}\n{text[-6000:]}"
    return text


def configure(source, build, *options):
    return run("cmake", "-S", source, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", *options)


@pytest.fixture(scope="module")
def build_tree(tmp_path_factory):
    """build/cpp, brought up to date, or where there is none a build of the core alone."""
    tree = ROOT / "build" / "cpp"
    if not (tree / "build.ninja").is_file():
        tree = tmp_path_factory.mktemp("core")
        configure(ROOT, tree, *CORE_ONLY)
    parts = [part for part in ("core", "tracking", "gl") if (tree / f"fastibl_{part}_targets.cmake").is_file()]
    run("cmake", "--build", tree, "--target", *(f"fastibl_{part}" for part in parts))
    return tree


@pytest.fixture(scope="module")
def prefix(build_tree, tmp_path_factory):
    path = tmp_path_factory.mktemp("prefix")
    run("cmake", "--install", build_tree, "--prefix", path, "--component", "development")
    return path


@pytest.fixture(scope="module", params=["prefix", "build tree"])
def package(request, build_tree):
    """Options that let find_package find fastibl."""
    if request.param == "build tree":
        return f"-Dfastibl_DIR={build_tree}"
    return f"-DCMAKE_PREFIX_PATH={request.getfixturevalue('prefix')}"


def test_consumer_builds_and_runs(package, tmp_path):
    configure(CONSUMER, tmp_path, package)
    run("cmake", "--build", tmp_path)
    name, *values = run(tmp_path / "light").split()
    assert name == "irradiance"
    assert [float(v) for v in values] == pytest.approx([math.pi] * 3, abs=2e-5)

    run(tmp_path / "picture", tmp_path / "picture.ppm")
    data = (tmp_path / "picture.ppm").read_bytes()
    header, pixels = data[:15], data[15:]
    assert header == b"P6\n320 240\n255\n" and len(pixels) == 320 * 240 * 3

    def pixel(x, y):
        return tuple(pixels[3 * (320 * y + x) :][:3])

    assert pixel(2, 2) == (255, 255, 255)  # nothing there
    r, g, b = pixel(160, 140)  # the object, in its material's order
    assert r < g < b
    assert max(pixel(110, 140)) < 200  # shadow on the side away from the light


@pytest.mark.parametrize(
    "part, header, use",
    [
        ("tracking", "tracking/opencv/opencv_detector.h", "fastibl::opencv_detector()"),
        ("gl", "render/gl/gl_renderer.h", "fastibl::make_gl_renderer()"),
    ],
)
def test_optional_component(part, header, use, build_tree, package, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(part LANGUAGES CXX)\n"
        f"find_package(fastibl CONFIG REQUIRED COMPONENTS core {part})\n"
        f"add_executable(part part.cpp)\ntarget_link_libraries(part PRIVATE fastibl::{part})\n"
    )
    (tmp_path / "part.cpp").write_text(
        f"#include <fastibl/{header}>\nint main(int count, char**) {{ return count > 1 && {use}; }}\n"
    )
    built = (build_tree / f"fastibl_{part}_targets.cmake").is_file()
    options = "-S", tmp_path, "-B", tmp_path / "build", "-G", "Ninja", package
    text = run("cmake", *options, fails=not built)
    if not built:
        assert f"without its component {part}" in " ".join(text.split())
        return
    run("cmake", "--build", tmp_path / "build")
    run(tmp_path / "build" / "part")


def test_every_public_header_compiles_alone(build_tree):
    run("cmake", "--build", build_tree, "--target", "all_verify_interface_header_sets")


def test_installed_files_name_nothing_private(prefix):
    """No path of the source or build tree, and no header that reads files which are not installed."""
    headers = {path.relative_to(prefix / "include") for path in prefix.rglob("*.h")}
    assert Path("fastibl/render/session.h") in headers and len(headers) > 20
    for path in prefix.rglob("*"):
        if path.suffix in (".h", ".cmake"):
            assert os.fspath(ROOT) not in path.read_text(), path
    for header in headers:
        for line in (prefix / "include" / header).read_text().splitlines():
            if line.startswith('#include "'):
                assert Path(line.split('"')[1]) in headers, f"{header}: {line}"
