"""C++ projects outside the tree: four examples, with each way to get fastibl and with each compiler."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ..goals import Goal, row, skipped

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ("light", "live", "own_renderer", "relight")
MINGW = "x86_64-w64-mingw32-g++-posix"


def _run(*command: object, env: dict[str, str] | None = None) -> None:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, errors="replace", env=env)
    if done.returncode:
        lines = (done.stdout + done.stderr).strip().splitlines()
        said = next((line for line in lines if "error" in line), lines[-1] if lines else "nothing was said")
        raise RuntimeError(f"{Path(str(command[0])).name} ended with {done.returncode}: {said}")


def _ways(tree: Path, prefix: Path, compiler: str) -> dict[str, list[str]]:
    """Options for building the examples, by the way in which they get fastibl."""
    launcher = ["-DCMAKE_CXX_COMPILER_LAUNCHER=ccache"] if shutil.which("ccache") else []
    return {
        "build tree": [f"-Dfastibl_DIR={tree}"],
        "install tree": [f"-DCMAKE_PREFIX_PATH={prefix}"],
        "subproject": [f"-DFASTIBL_SOURCE={ROOT}", "-DFASTIBL_TRACKING=ON", "-DFASTIBL_GL=ON", "-DFASTIBL_WERROR=ON"]
        + launcher,
    }


@row("product", "consumers")
def consumers() -> Iterator[Goal]:
    if not (shutil.which("cmake") and shutil.which("ninja")):
        yield skipped("C++ consumers", "needs cmake and ninja")
        return
    compilers = {"GCC": "g++", "Clang": next((c for c in ("clang++-16", "clang++") if shutil.which(c)), "")}
    tree = ROOT / "build" / "cpp"
    options = ["-DCMAKE_BUILD_TYPE=Release", "-DFASTIBL_TRACKING=ON", "-DFASTIBL_GL=ON"]
    if not (tree / "build.ninja").is_file():
        _run("cmake", "-S", ROOT, "-B", tree, "-G", "Ninja", *options)
    _run("cmake", "--build", tree, "--target", "fastibl_core", "fastibl_tracking", "fastibl_gl")
    for name, compiler in compilers.items():
        if not shutil.which(compiler):
            yield skipped(f"4 examples by {name}", "the compiler is not here")
            continue
        with tempfile.TemporaryDirectory() as folder:
            prefix = Path(folder) / "prefix"
            _run("cmake", "--install", tree, "--prefix", prefix, "--component", "development")
            for way, package in _ways(tree, prefix, compiler).items():
                build = Path(folder) / way.replace(" ", "-")
                source = ROOT / "examples" / "cpp_consumer"
                _run("cmake", "-S", source, "-B", build, "-G", "Ninja", f"-DCMAKE_CXX_COMPILER={compiler}", *package)
                _run("cmake", "--build", build, "--target", *EXAMPLES)
                ran = []
                for example, arguments in (
                    ("light", ()),
                    ("own_renderer", (build / "own.ppm",)),
                    ("relight", (build,)),
                ):
                    _run(build / example, *arguments)
                    ran.append(example)
                built = [e for e in EXAMPLES if (build / e).is_file()]
                yield Goal(
                    f"examples by {name} from the {way}",
                    f"{len(built)} built without warnings, {len(ran)} run here (live: in the tests, with a film)",
                    "4 built",
                    len(built) == 4 and len(ran) == 3,
                )
    yield from _debug()
    yield from _windows()


def _debug() -> Iterator[Goal]:
    """A build for a debugger: nothing is inlined, and no function is compiled for several processors."""
    with tempfile.TemporaryDirectory() as folder:
        options = [f"-DFASTIBL_SOURCE={ROOT}", "-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_CXX_FLAGS_DEBUG=-O0"]
        _run("cmake", "-S", ROOT / "examples" / "cpp_consumer", "-B", folder, "-G", "Ninja", *options)
        _run("cmake", "--build", folder, "--target", "light", "relight")
        _run(Path(folder) / "light")
        _run(Path(folder) / "relight", folder)
    yield Goal("two examples and the core without optimization, by the default compiler", "2 run", "2 run", True)


def _windows() -> Iterator[Goal]:
    what = "core, and two examples, cross-compiled for Windows"
    if not shutil.which(MINGW):
        yield skipped(what, "needs Debian's g++-mingw-w64-x86-64-posix")
        return
    build, source = ROOT / "build" / "windows", ROOT / "examples" / "cpp_consumer"
    toolchain = f"-DCMAKE_TOOLCHAIN_FILE={ROOT / 'cmake' / 'mingw-w64.cmake'}"
    options = ["-DCMAKE_BUILD_TYPE=Release", "-DFASTIBL_WERROR=ON", f"-DFASTIBL_SOURCE={ROOT}"]
    _run("cmake", "-S", source, "-B", build, "-G", "Ninja", toolchain, *options)
    _run("cmake", "--build", build, "--target", "light", "relight")
    made, ran = [e for e in ("light", "relight") if (build / f"{e}.exe").is_file()], "not run: Wine is not here"
    if shutil.which("wine"):
        names = ("libstdc++-6.dll", "libgcc_s_seh-1.dll", "libwinpthread-1.dll")
        found = [subprocess.check_output([MINGW, f"-print-file-name={name}"], text=True).strip() for name in names]
        beside = {**os.environ, "WINEPATH": ";".join("Z:" + str(Path(f).parent) for f in found), "WINEDEBUG": "-all"}
        with tempfile.TemporaryDirectory() as folder:
            _run("wine", build / "light.exe", env=beside)
            _run("wine", build / "relight.exe", f"Z:{folder}", env=beside)
        ran = "both run under Wine"
    yield Goal(what, f"{len(made)} built without warnings, {ran}", "2 built", len(made) == 2)
