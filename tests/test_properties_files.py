"""Files of anything: meshes, maps, calibrations and recordings give a result, or a clear error."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fastibl
from fastibl.environment_files import write_environment
from fastibl.recording import read_board, read_rig, write_board, write_rig
from hostile import MORE, is_light, mutated, outcome

OBJ = (
    b"# box\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvn 0 0 1\n"
    b"f 1 2 3\nf 1/1 2/2 4/1\nf 2//1 3//1 4//1\nf -1 -2 -3\n"
)
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 2 3\n"
)


def _triangle_gltf():
    import base64

    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], "<f4").tobytes() + np.array([0, 1, 2], "<u2").tobytes()
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [0, 0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.2, 1], "roughnessFactor": 0.4}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "buffers": [
            {"byteLength": 42, "uri": "data:application/octet-stream;base64," + base64.b64encode(points).decode()}
        ],
    }


GLTF = json.dumps(_triangle_gltf(), indent=0).encode()


def _glb():
    import struct

    text = json.dumps(_triangle_gltf()).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<II", len(text), 0x4E4F534A) + text
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk


def check_mesh(mesh):
    assert np.isfinite(mesh.vertices).all() and len(mesh.triangles) > 0
    assert (mesh.triangles >= 0).all() and (mesh.triangles < len(mesh.vertices)).all()
    assert np.isfinite(mesh.normals).all()


@pytest.mark.parametrize("ending, content", [(".obj", OBJ), (".ply", PLY), (".glb", _glb()), (".gltf", GLTF)])
def test_meshes(ending, content, tmp_path_factory):
    path = tmp_path_factory.mktemp("mesh") / f"some{ending}"
    read = 0

    @MORE
    @given(mutated(content))
    def check(data):
        nonlocal read
        path.write_bytes(data)
        mesh = outcome(lambda: fastibl.read_mesh(path))
        if mesh is not None:
            check_mesh(mesh)
            read += 1
        if ending in (".glb", ".gltf"):
            found = outcome(lambda: fastibl.read_object(path))
            if found is not None:
                check_mesh(found[0])

    check()
    print(f"{ending}: {read} meshes were read")
    assert read > 0


@pytest.mark.parametrize("ending", [".hdr", ".exr", ".ktx2"])
def test_maps(ending, tmp_path_factory):
    if ending == ".exr":
        pytest.importorskip("OpenEXR")
    path = tmp_path_factory.mktemp("map") / f"some{ending}"
    write_environment(path, fastibl.CubeMap(np.random.default_rng(0).random((6, 4, 4, 3))))

    @MORE
    @given(mutated(path.read_bytes()))
    def check(data):
        path.write_bytes(data)
        cube = outcome(lambda: fastibl.read_environment(path, size=8))
        if cube is not None:
            is_light(cube.faces)

    check()


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A recording of three frames of both cameras."""
    folder = tmp_path_factory.mktemp("recording")
    back = fastibl.Camera(32, 24, 30, 30, 16, 12, [0.1, 0, 0, 0], vignetting=[-0.1])
    front = fastibl.Camera(
        16, 16, 5, 5, 8, 8, model="fisheye", response=fastibl.Response.from_curve([0, 0.2, 1]), readout=0.02
    )
    write_rig(folder / "rig.yaml", fastibl.Rig(back, front, np.eye(4)))
    write_board(folder / "board.yaml", fastibl.Board.grid(1, 2, 0.03, 0.01))
    rows = ["time,camera,file,exposure"]
    rng = np.random.default_rng(0)
    for k in range(3):
        for name, camera in (("back", back), ("front", front)):
            cv2.imwrite(
                str(folder / f"{name}{k}.png"), rng.integers(0, 256, (camera.height, camera.width, 3), np.uint8)
            )
            rows.append(f"{k / 30},{name},{name}{k}.png,{'' if k == 1 else 0.5}")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    (folder / "truth").mkdir()
    np.save(folder / "truth" / "map0.npy", np.ones((6, 2, 2, 3), np.float32))
    (folder / "truth" / "maps.csv").write_text("time,file\n0.0,map0.npy\n")
    pose = ",".join(f"{v:g}" for v in np.eye(4)[:3].ravel())
    (folder / "truth" / "poses.csv").write_text(f"time,{','.join('abcdefghijkl')}\n0.0,{pose}\n")
    (folder / "truth" / "events.json").write_text('{"lamp": 1.0, "hand": [0.1, 0.2], "position": [0, 0, 0.1]}')
    return folder


def read_all(folder):
    recording = fastibl.Recording.open(folder)
    for frame in recording:
        assert np.isfinite(frame.time)
        for picture in (frame.back, frame.front):
            assert picture is None or (picture.dtype == np.uint8 and picture.shape[2:] == (3,))
    if recording.truth is not None and recording.truth.maps:
        is_light(recording.truth.environment(0.0).faces)
    return recording


def test_the_recording_itself(calibrated):
    recording = read_all(calibrated)
    assert len(recording) == 3 and recording.rig.front is not None and recording.truth.lamp_time == 1.0


FILES = ["rig.yaml", "board.yaml", "frames.csv", "back1.png", "truth/maps.csv", "truth/poses.csv", "truth/events.json"]


@pytest.mark.parametrize("name", [*FILES, "truth/map0.npy"])
def test_recordings(name, calibrated):
    path = calibrated / name
    content = path.read_bytes()

    @MORE
    @given(mutated(content))
    def check(data):
        path.write_bytes(data)
        outcome(lambda: read_all(calibrated))
        if name == "rig.yaml":
            outcome(lambda: read_rig(path))
        if name == "board.yaml":
            outcome(lambda: read_board(path))

    try:
        check()
    finally:
        path.write_bytes(content)


@MORE
@given(st.text(max_size=200))
def test_words_in_every_file(words):
    """What no format allows."""
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        for name in ("a.obj", "a.ply", "a.glb", "a.gltf", "a.stl", "a.hdr", "rig.yaml"):
            path = Path(folder) / name
            path.write_text(words, encoding="utf-8", errors="replace")
            if name == "rig.yaml":
                outcome(lambda p=path: read_rig(p))
            elif name == "a.hdr":
                outcome(lambda p=path: fastibl.read_environment(p))
            else:
                outcome(lambda p=path: fastibl.read_mesh(p))
