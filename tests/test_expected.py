"""What is no array, or not the one that belongs there: errors that name what was expected and what came."""

import warnings

import numpy as np
import pytest

import fastibl
from conftest import same_error
from fastibl import costs
from fastibl.calibration import calibrate_board
from fastibl.expected import present
from fastibl.plain_text import tell
from fastibl.recording import truth_of, write_board, write_rig
from fastibl.truth import TrueRenderer
from fastibl.white import camera_ratio

FACES = np.ones((6, 8, 8, 3), np.float32)
CUBE = fastibl.CubeMap(FACES)
MESH = fastibl.shapes.figurine(0.1)
SCENE = fastibl.Scene(MESH)
CAMERA = fastibl.Camera(96, 72, 110.0, 110.0, 48.0, 36.0)
RIG = fastibl.Rig(CAMERA)


def session(**options):
    return fastibl.Session(SCENE, RIG, environment=CUBE, **options)


@pytest.mark.parametrize(
    "call, told",
    [
        (lambda: fastibl.write_environment("x.hdr", FACES), "CubeMap.*got ndarray"),
        (lambda: fastibl.Session(SCENE, RIG, CUBE), "board must be Board or None, got CubeMap: .*environment="),
        (lambda: fastibl.Session(SCENE, CAMERA), r"rig must be Rig, got Camera: Rig\(camera\)"),
        (lambda: fastibl.Session(MESH, RIG), r"scene must be Scene, got Mesh: Scene\(mesh"),
        (lambda: fastibl.Session(SCENE, RIG, environment=FACES), "environment must be .*got ndarray.*CubeMap"),
        (lambda: fastibl.Session(SCENE, RIG, environment="room.hdr"), "environment .*got str.*read_environment"),
        (lambda: session(milliseconds="8"), "milliseconds must be a number or None, got str"),
        (lambda: session().set_environment(3), "environment .*got int"),
        (lambda: session().set_scene(MESH), "scene must be Scene, got Mesh"),
        (lambda: session().process(FACES[0]), "frame must be Frame, got ndarray"),
        (lambda: fastibl.make_plan(SCENE, "x"), "environment .*got str"),
        (lambda: fastibl.make_plan(MESH), "scene must be Scene, got Mesh"),
        (lambda: fastibl.Lighting(FACES), "cube must be CubeMap, got ndarray"),
        (lambda: fastibl.stand("spot.obj", 0.2), "mesh must be Mesh, got str: read_mesh"),
        (lambda: fastibl.stand(MESH, "20 cm"), "height must be a number, got str: metres"),
        (lambda: fastibl.guide(CUBE), "environment must be Environment, got CubeMap"),
        (lambda: fastibl.simulate(rig=CAMERA), "rig must be Rig or None, got Camera"),
        (lambda: fastibl.Frame("now"), "time must be a number, got str: seconds"),
        (lambda: fastibl.simulate(size=640), r"size must be tuple or list, got int: \(width, height\)"),
        (lambda: write_rig("rig.yaml", CAMERA), r"rig must be Rig, got Camera"),
        (lambda: write_board("board.yaml", RIG), "board must be Board, got Rig"),
        (lambda: fastibl.faults.Faulty(CAMERA), "source must be a Source, got Camera: .*Recording"),
        (lambda: fastibl.sources.Paced([]), "source must be a Source, got list"),
        (lambda: fastibl.sources.BackAndForth(None, 0.1), "source must be a Source, got None"),
        (lambda: fastibl.sources.CameraSource(CAMERA), "rig must be Rig, got Camera"),
        (lambda: fastibl.live.play(session(), "walk.mp4"), "source must be a Source, got str"),
        (lambda: fastibl.live.play(SCENE, []), "session must be Session, got Scene"),
        (lambda: TrueRenderer(MESH), "scene must be Scene, got Mesh"),
        (lambda: calibrate_board([FACES], RIG, CAMERA), "board must be Board, got Rig"),
    ],
)
def test_what_came_is_named(call, told):
    with pytest.raises(TypeError, match=told) as error:
        call()
    assert len(str(error.value)) < 200


class Odd:
    """What nothing takes."""


def public_callables():
    for name in fastibl.__all__:
        thing = getattr(fastibl, name)
        if callable(thing):
            yield name, thing
        for method, function in vars(thing).items() if isinstance(thing, type) else ():
            if type(function).__name__ == "instancemethod" and not method.startswith("_"):
                yield f"{name}.{method}", function


def test_no_call_is_answered_with_signatures(monkeypatch):
    """pybind11 answers with all that would fit."""
    monkeypatch.setattr(costs, "_measure_costs", costs.default_costs)  # which takes seconds
    monkeypatch.setattr(costs, "costs_path", lambda: None)
    asked = 0
    for name, function in public_callables():
        for args in ((), (Odd(),), (Odd(),) * 9):
            if name in ("simulate", "Session") and not args:
                continue
            try:
                function(*args)
            except Exception as error:  # noqa: BLE001 - whatever it is, it is to be read
                asked += isinstance(error, TypeError)
                method = "." in name  # without an object of its class: no call that anybody makes
                assert method or "argument types are supported" not in str(error), f"{name}: {error}"
                assert method or len(str(error)) < 400, f"{name}: {error}"
    assert asked > 150


@pytest.mark.parametrize(
    "call, told",
    [
        (lambda: fastibl.Rig("rig.yaml"), r"back must be Camera, got str: Camera\(width"),
        (lambda: fastibl.Scene("spot.obj"), "mesh must be Mesh, got str: read_mesh reads files"),
        (lambda: fastibl.Scene(MESH, None, None, "50"), "spheres must be a whole number, got str"),
        (lambda: fastibl.Environment("room.hdr"), "radiance must be CubeMap, got str: read_environment"),
        (lambda: fastibl.cast_shadow(CUBE, np.zeros((1, 4)), resolution=2.5), "resolution .*whole number, got float"),
        (lambda: fastibl.fit_spheres(MESH, seed=-1), "seed .*from 0 to .*got -1"),
        (lambda: fastibl.Material(color=3), "Material takes no color: diffuse, glossy, exponent, emission"),
        (lambda: fastibl.Mesh([[0.0, 0, 0]]), "Mesh needs triangles: vertices, triangles"),
        (lambda: fastibl.CubeMap(FACES, 8), r"CubeMap takes at most 1 \(faces\), got 2"),
        (lambda: fastibl.Rig(CAMERA, back=CAMERA), "Rig got back twice"),
        (lambda: fastibl.Environment(CUBE, (0, 0, 0)), "at most 1 without a name .radiance, centre"),
        (lambda: fastibl.Environment(CUBE, box=[[1, 2, 3]]), r"box must be \(2 \(3 numbers\)\).*got \[\[1, 2, 3\]\]"),
        (lambda: fastibl.Pose().angle_to(30), "other must be Pose, got int"),
        (lambda: CUBE.sample(), "sample needs directions: directions, level"),
        (lambda: fastibl.due_passes(fastibl.make_plan(SCENE), {"pose"}, {1}), "stale must be Set of str, got {1}"),
        (lambda: fastibl.set_threads(np.zeros(3)), "count must be a whole number.*got array"),
        (
            lambda: fastibl.DirectionShadow(16).cast(None, np.zeros((1, 4))),
            "cube must be CubeMap or Environment, got N",
        ),
        (lambda: fastibl.main_lights(FACES), "map must be CubeMap or Environment, got ndarray"),
        (lambda: fastibl.Lighting(CUBE, previous=3), "previous must be Lighting or None, got int"),
        (lambda: camera_ratio(CUBE), "environment must be Environment, got CubeMap"),
        (lambda: fastibl.simulate(board=3), r"board must be a page with image\(dpi\), .*got 3"),
    ],
)
def test_the_argument_that_does_not_fit_is_named(call, told):
    with pytest.raises(TypeError, match=told) as error:
        call()
    assert len(str(error.value)) < 200


@pytest.mark.parametrize("index", [3, 2**31, 2**32 + 1, -(2**40)])
def test_the_vertex_that_is_not_there_is_named(index):
    """Large ones were said to be -1."""
    with pytest.raises(ValueError, match=f"triangle 1 has vertex index {index}, expected 0 to 2"):
        fastibl.Mesh(np.eye(3), np.array([[0, 1, 2], [0, 1, index]]))


def test_what_is_no_time_and_no_cost_is_named():
    with pytest.raises(ValueError, match="finite seconds, got nan"):
        session().process(fastibl.Frame(float("nan"), back_from_marker=fastibl.Pose()))
    with pytest.raises(ValueError, match='no "rastre"'):
        fastibl.make_plan(SCENE, CUBE, milliseconds=8, costs={"rastre": 1.0})


def test_an_error_budget_is_a_share():
    with pytest.raises(ValueError, match="0.02 is 2 %.*got 2"):
        fastibl.make_plan(SCENE, CUBE, error=2)
    running = session()
    with pytest.raises(ValueError, match="share"):
        running.set_budgets(1.5, 0)
    running.set_budgets(1.0, 0)


def test_a_camera_looks_at_a_point():
    for eye, target in (
        ((0.1, -0.4, 0.3), (0.0, 0.0, 0.05)),
        ((0.2, 0.1, 0.5), (0.2, 0.1, 0.0)),
        ((0, 0, 0), (0, 0, 1.0)),
    ):
        eye, target = np.float64(eye), np.float64(target)
        pose = fastibl.Pose.look_at(eye, target)
        x, y, z = pose.rotation @ target + pose.translation
        np.testing.assert_allclose((x, y, z), (0, 0, np.linalg.norm(target - eye)), atol=1e-12)
        np.testing.assert_allclose(pose.inverse().translation, eye, atol=1e-12)
        np.testing.assert_allclose(np.linalg.det(pose.rotation), 1)
        if abs(target[0] - eye[0]) > 0:  # the marker's up is up in the picture, whose y runs down
            assert (pose.rotation @ np.float64([0, 0, 1]))[1] < 0
            assert abs((pose.rotation @ np.float64([0, 0, 1]))[0]) < 1e-12
    for bad in (((0.0, 0, 0), (0.0, 0, 0)), ((0.0, 0, np.nan), (0.0, 0, 1))):
        with pytest.raises(ValueError):
            fastibl.Pose.look_at(*bad)


def test_before_anything_is_judged_no_budget_is_said_to_be_kept():
    text = str(session().plan)
    assert "not judged yet" in text and "\nwithin" not in text
    pose = fastibl.Pose()
    after = session()
    result = after.process(fastibl.Frame(0.0, back_from_marker=pose))
    assert "not judged" not in str(result.plan) and " once\n" in str(result.plan)


def test_the_command_line_says_what_cannot_be_done_without_a_traceback(tmp_path, capsys):
    from fastibl.__main__ import main

    path = tmp_path / "map.hdr"
    fastibl.write_environment(path, CUBE)
    assert main(["export", str(path), "--size", "100000000", "--out", str(tmp_path / "out")]) == 2
    assert "fastibl: error:" in capsys.readouterr().err


def test_what_files_say_reaches_no_terminal_raw(tmp_path, capsys):
    """Names could clear the screen, or say in colour that all is well."""
    from fastibl.__main__ import _plain_warnings, main

    told = "\x1b[2J\x1b[32mfastibl: all good\x1b[0m\x9b2J"
    (tmp_path / "frames.csv").write_text(f"time,camera,file,exposure\n0,{told},a.png,\n", encoding="utf-8")
    write_rig(tmp_path / "rig.yaml", fastibl.Rig(fastibl.Camera(8, 6, 9.0, 9.0, 4.0, 3.0)))
    assert main(["render", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "\\x1b[2J" in said and "\x1b" not in said and "\x9b" not in said
    tell("a\x1b[2J")
    assert capsys.readouterr().err == "fastibl: a\\x1b[2J\n"
    with _plain_warnings():
        assert warnings.formatwarning("\x1b[2J", UserWarning, "a.py", 1) == "fastibl: warning: \\x1b[2J\n"


def test_what_is_known_to_be_there():
    assert present(0.0) == 0.0
    with pytest.raises(ValueError, match="got None"):
        present(None)


def test_a_recording_of_which_nothing_is_known():
    known = fastibl.simulate(seconds=0.1, fps=10, size=(32, 24), truth_size=8)
    assert truth_of(known) is known.truth
    with pytest.raises(LookupError, match="no true environment map"):
        truth_of(fastibl.Recording(RIG)).environment(0.0)


def test_trackers_are_of_a_camera():
    board, camera = fastibl.Board.default(), fastibl.Camera(64, 48, 50, 50, 32, 24)
    same_error(lambda: fastibl.Tracker(board, fastibl.Rig(camera)), TypeError, "camera must be Camera", "Rig")
    same_error(lambda: fastibl.Tracker(None, camera), TypeError, "board must be Board")
