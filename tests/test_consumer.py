"""Projects outside use the C++ library: from a prefix, from the build tree, and as a part of their own build."""

import math
import os
import platform
import re
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

import fastibl

ROOT = Path(__file__).resolve().parents[1]
CONSUMER = ROOT / "examples" / "cpp_consumer"
CLANG = next((path for n in ("-16", "", "-19", "-17", "-15", "-14") if (path := shutil.which("clang++" + n))), None)
CORE_ONLY = [f"-DFASTIBL_{part}=OFF" for part in ("TRACKING", "GL", "PYTHON", "DEMO", "TESTS")]
PUBLIC = {"tracking": "tracking/opencv/opencv_detector.h", "gl": "render/gl/gl_renderer.h"}

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


# What the examples do


def read_ppm(path):
    data = path.read_bytes()
    assert data.startswith(b"P6\n320 240\n255\n") and len(data) == 15 + 320 * 240 * 3
    return np.frombuffer(data[15:], np.uint8).reshape(240, 320, 3).astype(int)


def check_light(program, folder):
    name, *values = run(program).split()
    assert name == "irradiance"
    assert [float(v) for v in values] == pytest.approx([math.pi] * 3, abs=2e-5)


def check_picture(program, folder):
    run(program, folder / "picture.ppm")
    image = read_ppm(folder / "picture.ppm")
    assert image[2, 2].tolist() == [255, 255, 255]  # nothing there
    r, g, b = image[140, 160]  # the object, in its material's order
    assert r < g < b
    assert max(image[140, 110]) < 200  # shadow on the side away from the light


def check_relight(program, folder):
    said = run(program, folder)
    assert said.count("irradiance of the plane") == 4
    images = [read_ppm(folder / f"relit-{k}.ppm") for k in range(4)]
    table = np.s_[115:160]  # rows around the foot
    # The sun in +x, +y, −x, −y: the shadow falls to the left, to the camera, to the right, away from it.
    left, _, right, _ = (im[table, :120].mean() - im[table, 200:].mean() for im in images)
    assert left < -5 and right > 5
    assert images[1][165:185, 150:170].mean() < images[3][165:185, 150:170].mean() - 20
    assert all((im[4, 4] == 150).all() for im in images)  # far from it the photograph is as it was


def check_own_renderer(program, folder):
    done = subprocess.run([program, folder / "own.ppm"], capture_output=True, text=True, timeout=300)
    if re.search("no EGL|no OpenGL ES|eglGetPlatformDisplayEXT", done.stderr):
        print(f"own_renderer was not run: {done.stderr.strip()}")
        return
    assert done.returncode == 0, done.stderr
    plane = [float(v) for v in re.search(r"irradiance of the plane ([\d.]+) ([\d.]+) ([\d.]+)", done.stdout).groups()]
    image = read_ppm(folder / "own.ppm")
    assert image[85:125, 190].mean() > image[85:125, 130].mean() + 15  # the ball is lit from +x
    assert image[150, 90].mean() < image[150, 230].mean() - 10  # and its shadow falls to −x
    # Far from it the table has the light of the map: albedo ½ of E(z)/π, encoded with 1/2.2.
    assert image[230, 310] == pytest.approx(255 * (0.5 * np.array(plane) / math.pi) ** (1 / 2.2), abs=2)


def check_live(program, folder):
    film = fastibl.simulate(seconds=1, fps=15, size=(320, 240), hand=False, lamp=False)
    path = folder / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (320, 240))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no MJPG")
    for frame in film:
        writer.write(np.ascontiguousarray(frame.back[..., ::-1]))
    writer.release()
    said = run(program, path, film.rig.back.fx, folder / "live.ppm")
    seen, frames = map(int, re.search(r"board seen in (\d+) of (\d+) frames", said).groups())
    assert frames == len(film) and seen >= frames - 2, said
    with_object, without = read_ppm(folder / "live.ppm"), film[len(film) - 1].back.astype(int)
    changed = (np.abs(with_object - without).max(axis=-1) > 40).mean()
    assert 0.01 < changed < 0.5, changed  # the object, and not the whole picture
    assert "does not open" in run(program, folder / "none.avi", 300, fails=True)


CHECKS = {
    "light": check_light,
    "picture": check_picture,
    "relight": check_relight,
    "own_renderer": check_own_renderer,
    "live": check_live,
}


def check_examples(build, folder):
    """Runs what was built; names of the examples that were left out for want of a library."""
    missing = [name for name in CHECKS if not (build / name).is_file()]
    assert not {"light", "picture", "relight"} & set(missing)
    for name in CHECKS.keys() - missing:
        CHECKS[name](build / name, folder)
    return missing


def test_examples_build_and_run(package, tmp_path):
    configure(CONSUMER, tmp_path, package)
    run("cmake", "--build", tmp_path)
    missing = check_examples(tmp_path, tmp_path)
    if missing:
        print(f"not built here: {', '.join(missing)}")


def test_examples_with_clang(package, tmp_path):
    """Clang's programs on the library as it was built."""
    if CLANG is None:
        pytest.skip("needs clang++")
    configure(CONSUMER, tmp_path, package, f"-DCMAKE_CXX_COMPILER={CLANG}")
    run("cmake", "--build", tmp_path)
    check_light(tmp_path / "light", tmp_path)


@pytest.mark.parametrize("clang", [False, True], ids=["default", "clang"])
def test_as_a_part_of_another_build(clang, build_tree, tmp_path):
    """FetchContent of the sources. Where ccache has the library it is built, else only the examples' objects."""
    if clang and CLANG is None:
        pytest.skip("needs clang++")
    parts = [f"-DFASTIBL_{p.upper()}={'ON' if (build_tree / f'libfastibl_{p}.a').is_file() else 'OFF'}" for p in PUBLIC]
    cached = not clang and "ccache" in (build_tree / "CMakeCache.txt").read_text() and shutil.which("ccache")
    # The flags of build/cpp.
    options = ["-DFASTIBL_WERROR=ON", "-DCMAKE_CXX_COMPILER_LAUNCHER=ccache"] if cached else []
    if clang:
        options.append(f"-DCMAKE_CXX_COMPILER={CLANG}")
    configure(CONSUMER, tmp_path, f"-DFASTIBL_SOURCE={ROOT}", *parts, *options)
    names = [name for name in CHECKS if f"{name}.dir" in (tmp_path / "build.ninja").read_text()]
    assert {"light", "picture", "relight"} <= set(names)
    if cached:
        run("cmake", "--build", tmp_path, "--target", *names)
        check_light(tmp_path / "light", tmp_path)
    else:
        run("cmake", "--build", tmp_path, "--target", *(f"CMakeFiles/{n}.dir/{n}.cpp.o" for n in names))


def test_builds_that_are_not_optimized(tmp_path):
    """A project that chose no build type gets an optimized library; a debugger's has no clones of functions, where
    wide vectors would be passed in other registers than lambdas expect. ./dev goals product runs such a build.
    """
    configure(CONSUMER, tmp_path, f"-DFASTIBL_SOURCE={ROOT}", *CORE_ONLY, "-DCMAKE_BUILD_TYPE=")
    assert re.search(r"FLAGS = .*-O3", (tmp_path / "build.ninja").read_text())
    configure(CONSUMER, tmp_path, "-DCMAKE_BUILD_TYPE=Debug")
    assert not re.search(r"FLAGS = .*-O", (tmp_path / "build.ninja").read_text())
    (tmp_path / "clones.cpp").write_text('#include "fastibl/core/simd.h"\nFASTIBL_CLONES void f() {}\n')
    seen = [
        "target_clones" in run("g++", option, "-E", f"-I{ROOT / 'cpp'}", tmp_path / "clones.cpp")
        for option in ("-O2", "-O0", "-Os")
    ]
    assert seen == [platform.machine() == "x86_64", False, False]


@pytest.mark.parametrize("clang", [False, True], ids=["default", "clang"])
@pytest.mark.parametrize("fast", ["-O3 -ffast-math", "-Ofast"])
def test_fast_math_of_the_project_around(fast, clang, tmp_path):
    """Its flags come before ours, which keep the checks for NaN."""
    if clang and CLANG is None:
        pytest.skip("needs clang++")
    compiler = CLANG if clang else shutil.which("c++")
    configure(
        CONSUMER,
        tmp_path,
        f"-DFASTIBL_SOURCE={ROOT}",
        *CORE_ONLY,
        f"-DCMAKE_CXX_COMPILER={compiler}",
        f"-DCMAKE_CXX_FLAGS_RELEASE={fast}",
    )
    (tmp_path / "nothing.cpp").write_text("")

    def macros(target):
        rule = re.search(rf"CXX_COMPILER__{target}_.*?FLAGS = (.*?)\n", (tmp_path / "build.ninja").read_text(), re.S)
        return run(compiler, *rule[1].split(), "-dM", "-E", tmp_path / "nothing.cpp")

    assert "__FINITE_MATH_ONLY__ 1" in macros("light")  # as the project wants it
    ours = macros("fastibl_core")
    assert "__FINITE_MATH_ONLY__ 0" in ours and "__FAST_MATH__" not in ours


def test_instructions_of_the_project_around(tmp_path):
    """-march=native, or conda's nocona: loops are compiled for several processors, into which GCC inlines nothing that
    has more instructions. A unity build puts files together whose helpers have the same names."""
    flags = "-march=haswell -fno-inline" if platform.machine() == "x86_64" else "-fno-inline"
    options = (f"-DCMAKE_CXX_FLAGS={flags}", "-DCMAKE_UNITY_BUILD=ON", "-DCMAKE_BUILD_TYPE=Release")
    configure(CONSUMER, tmp_path, f"-DFASTIBL_SOURCE={ROOT}", *CORE_ONLY, *options)
    rules = (tmp_path / "build.ninja").read_text()
    places = {name: re.search(rf"build (\S*/{name}\.cpp\.o):", rules)[1] for name in ("harmonic_sums", "light_sums")}
    run("cmake", "--build", tmp_path, "--target", *places.values())
    (tmp_path / "clones.cpp").write_text('#include "fastibl/core/simd.h"\nFASTIBL_CLONES void f() {}\n')
    if platform.machine() == "x86_64":
        for option in ("-maes", "-mavx512f", "-mpclmul"):  # which -march= does not take back
            assert "target_clones" not in run("g++", "-O2", option, "-E", f"-I{ROOT / 'cpp'}", tmp_path / "clones.cpp")


def test_glm_of_the_project_around(tmp_path):
    """A project that has GLM and Threads already, and finds fastibl's targets in a folder beside."""
    (tmp_path / "app").mkdir()
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(around LANGUAGES CXX)\nset(CMAKE_CXX_STANDARD 20)\n"
        "find_package(Threads REQUIRED)\nfind_package(glm REQUIRED)\n"
        f"add_subdirectory({ROOT} fastibl EXCLUDE_FROM_ALL)\nadd_subdirectory(app)\n"
    )
    (tmp_path / "app" / "CMakeLists.txt").write_text(
        "find_package(glm REQUIRED)\nadd_executable(app app.cpp)\n"
        "target_link_libraries(app PRIVATE fastibl::core glm::glm)\n"
    )
    (tmp_path / "app" / "app.cpp").write_text("#include <fastibl/core/pose.h>\nint main() {}\n")
    configure(tmp_path, tmp_path / "build", *CORE_ONLY)
    run("cmake", "--build", tmp_path / "build", "--target", "app/CMakeFiles/app.dir/app.cpp.o")


@pytest.mark.parametrize(
    "part, use", [("tracking", "fastibl::opencv_detector()"), ("gl", "fastibl::make_gl_renderer()")]
)
def test_optional_component(part, use, build_tree, package, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(part LANGUAGES CXX)\n"
        f"find_package(fastibl CONFIG REQUIRED COMPONENTS core {part})\n"
        f"add_executable(part part.cpp)\ntarget_link_libraries(part PRIVATE fastibl::{part})\n"
    )
    (tmp_path / "part.cpp").write_text(
        f"#include <fastibl/{PUBLIC[part]}>\nint main(int count, char**) {{ return count > 1 && {use}; }}\n"
    )
    built = (build_tree / f"fastibl_{part}_targets.cmake").is_file()
    options = "-S", tmp_path, "-B", tmp_path / "build", "-G", "Ninja", package
    text = run("cmake", *options, fails=not built)
    if not built:
        assert f"without its component {part}" in " ".join(text.split())
        return
    run("cmake", "--build", tmp_path / "build")
    run(tmp_path / "build" / "part")


def test_variables_of_the_project_stay(build_tree, package, tmp_path):
    """Those that it has from OpenCV, too, of which fastibl needs other parts."""
    if not (build_tree / "fastibl_tracking_targets.cmake").is_file():
        pytest.skip("needs the component tracking")
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(part LANGUAGES CXX)\n"
        "find_package(OpenCV REQUIRED COMPONENTS core)\nset(needs mine)\nset(component mine)\n"
        'set(before "${needs} ${component} ${OpenCV_LIBS}")\n'
        "find_package(fastibl CONFIG REQUIRED COMPONENTS core tracking)\n"
        'set(after "${needs} ${component} ${OpenCV_LIBS}")\n'
        'if(NOT before STREQUAL after)\n  message(FATAL_ERROR "${before} became ${after}")\nendif()\n'
    )
    run("cmake", "-S", tmp_path, "-B", tmp_path / "build", "-G", "Ninja", package)


def test_a_part_of_another_build_installs_nothing(build_tree, tmp_path):
    if not (build_tree / "cpp/demo/fastibl-demo").is_file():
        pytest.skip("the native program was not built")
    configure(CONSUMER, tmp_path, f"-DFASTIBL_SOURCE={ROOT}", "-DFASTIBL_TRACKING=ON", "-DFASTIBL_DEMO=ON")
    assert "fastibl-demo" in (tmp_path / "build.ninja").read_text()
    scripts = list(tmp_path.rglob("cmake_install.cmake"))
    assert scripts and not [path for path in scripts if "file(INSTALL" in path.read_text()]


def test_shared_libraries_are_not_promised(tmp_path):
    said = configure(CONSUMER, tmp_path, f"-DFASTIBL_SOURCE={ROOT}", *CORE_ONLY, "-DBUILD_SHARED_LIBS=ON")
    assert "static libraries all the same" in said
    assert "static libraries" not in configure(CONSUMER, tmp_path, "-DBUILD_SHARED_LIBS=OFF")


@pytest.mark.parametrize(
    "asked, fits", [("0.1", True), ("0.1.0", True), ("0.0.9", False), ("0.2", False), ("1.0", False)]
)
def test_versions_that_fit(asked, fits, build_tree, tmp_path):
    """Minor versions may break while there is no 1.0."""
    assert fastibl.__version__.startswith("0.1."), "the versions that are asked for here are of 0.1"
    version = build_tree / "fastiblConfigVersion.cmake"
    script = tmp_path / "ask.cmake"
    script.write_text(
        f"set(PACKAGE_FIND_VERSION {asked})\nset(PACKAGE_FIND_VERSION_MAJOR {asked.split('.')[0]})\n"
        f"set(PACKAGE_FIND_VERSION_MINOR {asked.split('.')[1]})\nset(CMAKE_SIZEOF_VOID_P 8)\n"
        f'include("{version}")\nmessage("version ${{PACKAGE_VERSION}} fits: ${{PACKAGE_VERSION_COMPATIBLE}}")\n'
    )
    said = run("cmake", "-P", script)
    assert f"version {fastibl.__version__}" in said
    assert ("fits: TRUE" in said) == fits


def test_one_version_everywhere():
    """CMake's, Python's, and the newest release in the changelog, where there is one."""
    stated = re.search(r"project\(fastibl VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]
    assert fastibl.__version__ == stated
    from importlib import metadata

    try:
        assert metadata.version("fastibl") == stated
    except metadata.PackageNotFoundError:
        pass  # the tree, not installed
    # What the wheel's metadata takes its version by.
    pattern = re.search(r"regex = '(.*)'", (ROOT / "pyproject.toml").read_text())[1]
    assert re.search(pattern, (ROOT / "CMakeLists.txt").read_text())["value"] == stated
    headings = re.findall(r"^## \[?([^\]\s]+)\]?", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert headings[0] == "Unreleased"
    releases = [tuple(map(int, h.split("."))) for h in headings[1:]]
    assert releases == sorted(releases, reverse=True)
    assert not releases or tuple(map(int, stated.split("."))) >= releases[0]


@pytest.mark.skipif(not (ROOT / "docs" / "embedding.md").is_file(), reason="needs docs/")
def test_the_blocks_of_the_documentation(build_tree, tmp_path):
    text = (ROOT / "docs" / "embedding.md").read_text()
    listing = re.findall(r"```cmake\n(.*?)```", text, re.S)[0]
    head = "cmake_minimum_required(VERSION 3.25)\nproject(docs LANGUAGES CXX)\n"
    (tmp_path / "CMakeLists.txt").write_text(head + listing)
    shutil.copy(CONSUMER / "light.cpp", tmp_path)
    configure(tmp_path, tmp_path / "build", f"-Dfastibl_DIR={build_tree}")
    if Path("/usr/include/epoxy/gl.h").is_file():
        block = re.search(r"```cpp\n(.*?)```", text, re.S)[1]
        head = "#include <epoxy/gl.h>\n#include <fastibl/scene/cube_map.h>\n"
        compile_block(head + "void upload(const fastibl::CubeLevel& level, int mip) {\n" + block + "}\n", tmp_path)
    calls = re.findall(r"`(\w+\([^`]+\)[\w.]*)`", text[text.index("## A renderer of one's own") :])
    calls += re.findall(r"`(renderer->\w+\([^`]*\))`", text)
    assert len(calls) >= 3
    head = "".join(f"#include <fastibl/{header}>\n" for header in ("lighting/fit_lighting.h", PUBLIC["gl"]))
    head += "#include <fastibl/lighting/dominant_lights.h>\n#include <fastibl/lighting/prefilter.h>\n"
    head += "using namespace fastibl;\nvoid calls(std::shared_ptr<const CubeMap> map, "
    head += "const std::vector<PrefilterLevel>& levels, const Lighting& lighting, "
    head += "const std::unique_ptr<GlRenderer>& renderer, unsigned framebuffer, int width, int height) {\n"
    compile_block(head + "".join(f"static_cast<void>({call});\n" for call in calls) + "}\n", tmp_path)
    text = (ROOT / "docs" / "how-to" / "own-renderer.md").read_text()
    includes, block = re.search(r"```cpp\n(.*?)\n\n(const.*?)```", text, re.S).groups()
    compile_block(includes + "\nvoid block() {\n" + block + "}\n", tmp_path)


def compile_block(text, folder):
    (folder / "block.cpp").write_text(text)
    flags = ["-std=c++20", "-fsyntax-only", "-Wall", "-Wextra", "-Werror"]
    for compiler in filter(None, (shutil.which("c++"), CLANG)):
        run(compiler, *flags, f"-I{ROOT / 'cpp'}", folder / "block.cpp")


# Headers


def public_headers(part="core"):
    if part != "core":
        return [f"fastibl/{PUBLIC[part]}"]
    headers = sorted(p.relative_to(ROOT / "cpp").as_posix() for p in (ROOT / "cpp" / "fastibl").rglob("*.h"))
    private = "/tracking/opencv/|/render/gl/|/(shared_formulas|seen_lights|check).h$"
    return [h for h in headers if not re.search(private, h)]


def compile_headers(compiler, folder, *options, headers=None):
    source = folder / "all.cpp"
    source.write_text("".join(f"#include <{h}>\n" for h in headers or public_headers() + public_headers("gl")))
    flags = ["-std=c++20", "-fsyntax-only", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror"]
    return subprocess.run(
        [compiler, *flags, *options, f"-I{ROOT / 'cpp'}", source], capture_output=True, text=True, timeout=300
    )


COMPILERS = [
    pytest.param(shutil.which("g++"), id="gcc", marks=pytest.mark.skipif(not shutil.which("g++"), reason="no g++")),
    pytest.param(CLANG, id="clang", marks=pytest.mark.skipif(not CLANG, reason="no clang++")),
]


def test_every_public_header_compiles_alone(build_tree):
    """A header that a source of the library includes before all else has compiled alone there, as there are no
    precompiled headers in this tree. CMake's check compiles the others.
    """
    first = set()
    for source in (ROOT / "cpp" / "fastibl").rglob("*.cpp"):
        included = re.search(r'^\s*#include ["<](.+)[">]', source.read_text(), re.M)
        first.update(included.groups() if included else ())
    ninja = (build_tree / "build.ninja").read_text()
    assert "cmake_pch" not in ninja
    objects = re.findall(r"^build (\S+_verify_interface_header_sets/(fastibl/\S+\.h)\.cxx\.o):", ninja, re.M)
    assert set(public_headers()) <= {header for _, header in objects}
    others = [path for path, header in objects if header not in first]
    assert len(others) > 20
    run("cmake", "--build", build_tree, "--target", *others)


@pytest.mark.parametrize("compiler", COMPILERS)
def test_public_headers_go_together_without_warnings(compiler, tmp_path):
    """All in one file: no name is there twice. GLM's macros that change no layout do no harm."""
    done = compile_headers(compiler, tmp_path)
    assert done.returncode == 0, done.stderr[:4000]
    for macros in (["-DGLM_FORCE_INTRINSICS", "-mavx2"], ["-DGLM_FORCE_SWIZZLE"], ["-DGLM_FORCE_ALIGNED_GENTYPES"]):
        done = compile_headers(compiler, tmp_path, *macros, "-DGLM_ENABLE_EXPERIMENTAL")
        assert done.returncode == 0, f"{macros}\n{done.stderr[:4000]}"


@pytest.mark.skipif(not shutil.which("nm"), reason="no nm")
def test_library_hides_what_it_defines():
    """Two plugins of one program, with a library each, would call each other's functions."""
    done = subprocess.run(
        ["nm", "-D", "-C", "--defined-only", fastibl._fastibl.__file__], capture_output=True, text=True, check=True
    )
    names = [line.split(maxsplit=2)[2] for line in done.stdout.splitlines()]
    assert "PyInit__fastibl" in names
    assert [name for name in names if name.startswith("fastibl::")] == []


@pytest.mark.parametrize("compiler", COMPILERS)
def test_public_headers_fit_into_game_engines(compiler, tmp_path):
    """Unreal's macro `check`, those of windows.h, and no exceptions."""
    macros = ["-Dcheck(holds)=static_assert(false)", "-Dnear=", "-Dfar=", "-Dsmall=char"]
    done = compile_headers(compiler, tmp_path, *macros, "-fno-exceptions", "-fno-rtti")
    assert done.returncode == 0, done.stderr[:4000]


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    "macros, said",
    [
        (["-mavx2", "-DGLM_FORCE_INTRINSICS", "-DGLM_FORCE_DEFAULT_ALIGNED_GENTYPES"], "packed vectors"),
        (["-DGLM_FORCE_CTOR_INIT"], "trivially copied vectors"),
    ],
    ids=["aligned", "initialised"],
)
def test_other_layouts_of_glm_are_refused(compiler, macros, said, tmp_path):
    done = compile_headers(compiler, tmp_path, *macros, "-w", headers=["fastibl/core/pose.h"])
    assert done.returncode != 0 and "fastibl needs GLM's" in done.stderr and said in done.stderr, done.stderr[:2000]


def test_glm_comes_by_one_header():
    """core/vector.h, which checks its layout."""
    for header in public_headers():
        if header != "fastibl/core/vector.h":
            assert "<glm/" not in (ROOT / "cpp" / header).read_text(), header


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
