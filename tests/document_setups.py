"""What the code blocks of a page may take for granted: names and files, by page."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import pytest

import fastibl


@cache
def recorded() -> fastibl.Recording:
    """A short walk around the board, small pictures."""
    return fastibl.simulate(seconds=1.2, fps=10, size=(240, 180), path="sweep")


@cache
def small_scene() -> fastibl.Scene:
    return fastibl.Scene(fastibl.stand(fastibl.shapes.figurine(), 0.12))


def map_file(path: Path) -> None:
    cv2.imwrite(str(path), np.random.default_rng(0).random((32, 64, 3)).astype(np.float32))


def common() -> dict:
    """A session that has seen a recording, and its parts by the names that the pages use."""
    recording = recorded()
    scene, rig, board = small_scene(), recording.rig, recording.board
    session = fastibl.Session(scene, rig, board, size=32)
    for frame in recording:
        result = session.process(frame)
    environment = result.environment
    return dict(
        fastibl=fastibl, np=np, recording=recording, scene=scene, mesh=scene.mesh, rig=rig, board=board,
        session=session, frame=frame, result=result, environment=environment, cube=environment.radiance,
        camera=rig.back, back=rig.back, front_from_back=rig.front_from_back, picture=frame.back, image=frame.back,
        capture=fastibl.Capture(size=32), lighting=result.lighting, exposure=1.0, time=frame.time,
        first_row_pose=result.back_from_marker, last_row_pose=result.back_from_marker,
        K=rig.back.opencv_matrix, matrix=np.asarray(result.back_from_marker),
    )  # fmt: skip


def _tracking(names, folder, monkeypatch):
    """Pictures of a rolling shutter that is turned briskly, and its poses by another clock."""
    from bench.capture.rolling_film import PATHS, ROLLING, film

    path = PATHS["sideways"](0)
    shots = list(film(names["board"], path, ROLLING, 30, 0))
    times = [time for time, _ in shots]
    names.update(times=[t - 0.02 for t in times], poses=[fastibl.Pose(path(t)) for t in times], camera=ROLLING)
    names["recording"] = [fastibl.Frame(time=t, back=image) for t, image in shots]
    names.update(picture=shots[-1][1], time=0.0, capture=fastibl.Capture(size=32))


def _capture(names, folder, monkeypatch):
    names["session"].process(names["frame"])
    map_file(folder / "yesterday.hdr")


def _report(names, folder, monkeypatch):
    """A report of one step by a few samples: tests/test_report.py makes all of it."""
    from fastibl import report

    tiny = replace(
        report.QUICK, name="tiny", normals=20, rounds=1, batch=500, follow=(0.4, 10), sweep=(0.5, 4),
        sweep_size=(160, 120), picture=8,
    )  # fmt: skip
    monkeypatch.setattr(report, "QUICK", tiny)
    monkeypatch.setattr(report, "STEPS", [part for part in report.STEPS if "diffuse" in part[0] or "matte" in part[0]])
    monkeypatch.setattr(report, "MORE", [])
    given = {"one": names["cube"]}, ("figurine", names["mesh"])  # in place of what is built in, which takes seconds
    monkeypatch.setattr(report, "gathered", partial(report.gathered, *given))
    assert len(report.STEPS) == 1


def _own_cameras(names, folder, monkeypatch):
    shown = []
    names.update(dict.fromkeys(("k1", "k2", "k3", "k4"), 0.0))
    names.update(columns=np.eye(4).ravel())
    fastibl.recording.write_rig(folder / "rig.yaml", names["rig"])
    names["my_camera"] = lambda: [(f.time, f.back) for f in names["recording"]]
    names["show"] = shown.append


def _getting_started(names, folder, monkeypatch):
    recorder = fastibl.recording.RecordingWriter(folder / "my-recording", names["rig"], names["board"])
    with recorder:
        for frame in list(recorded())[:2]:
            recorder.add(frame)


def _torch(names, folder, monkeypatch):
    pytest.importorskip("torch", reason="the blocks of this page need PyTorch")


def _files(names, folder, monkeypatch):
    pytest.importorskip("OpenEXR", reason="pip install OpenEXR")
    picture = np.random.default_rng(0).integers(0, 255, (32, 64, 3), dtype=np.uint8)
    cv2.imwrite(str(folder / "panorama.jpg"), picture)


def _photographs(names, folder, monkeypatch):
    cv2.imwrite(str(folder / "table.jpg"), next(iter(names["recording"])).back[..., ::-1])


# C++ blocks that are parts of a function: what stands before them, by page.
CPP_PRELUDES = {
    "docs/embedding.md": """
#include <epoxy/gl.h>
#include <fastibl/render/gl/gl_renderer.h>
#include <fastibl/render/session.h>
#include <fastibl/scene/cube_map.h>
#include <fastibl/tracking/opencv/opencv_detector.h>
using namespace fastibl;
void block(const CubeLevel& level, int mip, const Scene& scene, const Rig& rig, const Board& board, const Frame& frame,
           FrameResult& result, const Camera& texture_camera, const glm::mat3& uv_from_picture, const float* m,
           glm::vec2 a, glm::vec2 b, glm::vec2 c, unsigned texture, unsigned framebuffer, int width, int height) {
""",
}

SETUPS = {
    "docs/files.md": _files,
    "docs/getting-started.md": _getting_started,
    "docs/how-to/pytorch.md": _torch,
    "docs/capture.md": _capture,
    "docs/tracking.md": _tracking,
    "docs/report.md": _report,
    "docs/how-to/own-cameras.md": _own_cameras,
    "docs/how-to/photographs.md": _photographs,
}


def namespace_of(page: str, folder: Path, monkeypatch) -> dict:
    """Names for the blocks of a page, which run in `folder`. The README's run with nothing but a map beside them."""
    map_file(folder / "room.hdr")
    if page == "README.md":
        return {}
    names = common()
    SETUPS.get(page, lambda *_: None)(names, folder, monkeypatch)
    return names
