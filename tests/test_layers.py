"""Includes point down; the steps of a frame never include each other; core names no outside library but GLM."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ROOT / "cpp" / "fastibl"
STEPS = {"tracking", "capture", "lighting", "shadow", "shading", "plan"}
MAY_INCLUDE = {"core": {"core"}, "scene": {"core", "scene"}}
MAY_INCLUDE |= {step: {"core", "scene", step} for step in STEPS}
MAY_INCLUDE["render"] = {"core", "scene", "render"} | STEPS


def includes():
    for path in sorted(ROOMS.rglob("*.h")) + sorted(ROOMS.rglob("*.cpp")):
        for name in re.findall(r'^\s*#\s*include\s*[<"]([^">]+)[">]', path.read_text(), re.M):
            yield path.relative_to(ROOMS), name


def test_includes_point_down():
    seen = 0
    for path, name in includes():
        if name.startswith("fastibl/"):
            seen += 1
            assert name.split("/")[1] in MAY_INCLUDE[path.parts[0]], f"{path} must not include {name}"
    assert seen > 20


def test_one_outside_library_one_room():
    rooms = {"opencv2": "tracking/opencv", "epoxy": "render/gl", "EGL": "render/gl"}
    for path, name in includes():
        library = name.split("/")[0]
        if library in rooms:
            assert path.as_posix().startswith(rooms[library]), f"{path} must not include {name}"


def test_render_cpu_and_gl_do_not_include_each_other():
    for path, name in includes():
        assert not (path.parts[:2] == ("render", "cpu") and name.startswith("fastibl/render/gl"))
        assert not (path.parts[:2] == ("render", "gl") and name.startswith("fastibl/render/cpu"))
