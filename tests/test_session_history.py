"""A session's pictures follow from what is set now, not from what was set before."""

import numpy as np
import pytest
from test_near_shading import TOWARDS, lamp_map, placed
from test_session import BACK, RIG, WHITE, ball, given
from test_session_changes import lit_from_above

import fastibl
from conftest import same_error


def turned(yaw, tilt=0.0, lift=0.0, x=0.0):
    """Turned about x, and then about z."""
    turn, over = np.eye(4), np.eye(4)
    turn[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    over[1:3, 1:3] = [[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]]
    over[2, 3], turn[0, 3] = lift, x
    return turn @ over


def composed(session):
    """The picture that a compositing program makes of the session's layers."""
    response, layers = RIG.back.response, session.layers
    linear = response.decode(BACK.astype(np.float32) / 255) * layers.ratio * (1 - layers.object[..., 3:])
    return np.round(255 * np.clip(response.encode(np.clip(linear + layers.object[..., :3], 0, 1)), 0, 1))


CHANGES = {
    "material": lambda s: s.set_material(fastibl.Material(diffuse=(0.1, 0.1, 0.1))),
    "look": lambda s: s.set_shadow_look(0.5, (0.1, 0.0, 0.0)),
    "methods": lambda s: s.set_methods({"bounce": "none"}),
    "budgets": lambda s: s.set_budgets(error=0.05),
    "shadow": lambda s: s.set_cast_shadow(False),
    "environment": lambda s: s.set_environment(WHITE),
    "pose": lambda s: s.move(turned(1.0, x=0.02)),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_layers_are_those_of_the_last_picture_whatever_is_set_after_it(change, backend):
    if backend == "gl" and not fastibl.session.with_gl:
        pytest.skip("built without the GL back end")
    try:
        session = fastibl.Session(ball(), RIG, environment=lit_from_above(), backend=backend)
    except RuntimeError as error:
        pytest.skip(f"no GL context: {error}")
    image = session.process(given()).image
    gain = session.plane_gain.image.copy()
    assert np.abs(composed(session) - image).max() <= 1
    CHANGES[change](session)
    assert np.abs(composed(session) - image).max() <= 1
    np.testing.assert_array_equal(session.plane_gain.image, gain)
    other = session.process(given(1.0)).image
    assert np.abs(composed(session) - other).max() <= 1
    assert np.array_equal(other, image) == (change in ("methods", "budgets"))  # there, nothing is to be seen of it


@pytest.mark.parametrize("change", ["scene", "backend"])
def test_another_object_or_back_end_leaves_no_layers(change):
    session = fastibl.Session(ball(), RIG, environment=lit_from_above())
    session.process(given())
    session.set_scene(ball(radius=0.02)) if change == "scene" else session.set_backend("cpu")
    assert (session.layers.ratio == 1).all() and not session.layers.object.any()


def test_the_exposure_of_a_frame_without_a_back_picture_is_not_remembered():
    """It is 1 unless another is told."""
    frames = [given(0.0, back_exposure=0.25), given(1.0, back=None), given(2.0, back_exposure=None)]
    images = []
    for chosen in (frames, frames[::2]):
        session = fastibl.Session(ball(), RIG, environment=WHITE)
        with pytest.warns(UserWarning, match="exposure of a back picture is not told"):
            images.append([session.process(frame).image for frame in chosen][-1])
    np.testing.assert_array_equal(*images)


@pytest.mark.parametrize("kind", ["near", "box"])
def test_the_same_light_given_again_is_no_new_light(kind):
    if kind == "near":
        cube = lamp_map(0.015, 0.15, size=32)
        light = placed(cube, [*(np.array([0, 0, 0.031]) + 0.15 * TOWARDS), 0.015], (0, 0, 0.031))
    else:
        light = fastibl.Environment(lit_from_above(), box=[[-0.5, -0.4, -0.01], [0.6, 0.7, 0.9]], centre=(0, 0, 0.03))
    session = fastibl.Session(ball(), RIG, environment=light)
    passes = []
    for k in range(5):
        session.set_environment(light)
        passes.append(session.process(given(float(k))).passes)
    assert passes[2:] == [["composite"]] * 3


@pytest.mark.parametrize("yaw", [0.4, 2.5])
def test_the_bounce_does_not_depend_on_earlier_poses(yaw):
    """An object that touches the plane, in a coloured place."""
    pose, pictures = turned(yaw, x=0.02), []
    for before in ([], [np.eye(4)], [turned(2.0)], [np.eye(4), turned(1.7, 0.5, 0.02)]):
        scene = ball(fastibl.Material(diffuse=(0.9, 0.5, 0.1)))
        session = fastibl.Session(scene, RIG, environment=lit_from_above(), error=0)
        for k, other in enumerate([*before, pose]):
            session.move(other)
            image = session.process(given(float(k))).image
        pictures.append((image.astype(int), session.plane_gain.image))
    for image, gain in pictures[1:]:
        assert np.abs(image - pictures[0][0]).max() <= 1
        np.testing.assert_allclose(gain, pictures[0][1], atol=1e-4)


@pytest.mark.parametrize("methods", ["auto", "paper"])
def test_the_way_of_capturing_may_be_set_before_the_first_frame(methods):
    recording = fastibl.simulate(seconds=1.5, fps=8, size=(160, 120))
    made = []
    for first in ("auto", "paper"):
        session = fastibl.Session(ball(), recording.rig, recording.board, methods=first)
        session.set_methods(methods)
        for frame in recording:
            result = session.process(frame)
        made.append((session.capture.distance, result.environment.radiance, result.environment.knowledge))
    assert made[0] == made[1] and (made[0][0] < np.inf) == (methods == "auto")


def test_irradiance_does_not_depend_on_a_glossy_material_before():
    recording = fastibl.simulate(seconds=1, fps=8, size=(160, 120))
    normals = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.8, 0.6]]
    frames, found = list(recording), []
    for first in (True, False):
        glossy = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.8, 0.8), exponent=64)
        scene = ball(glossy if first else fastibl.Material())
        session = fastibl.Session(scene, recording.rig, recording.board, error=0, cast_shadow=False)
        for k, frame in enumerate(frames[:4]):
            if first and k == 3:
                session.set_material(fastibl.Material())
            result = session.process(frame)
        found.append(result.lighting.irradiance(normals))
        exact = fastibl.Lighting(result.environment, diffuse="irradiance-cube").irradiance(normals)
    print(np.abs(found[0] / exact - 1).max(), np.abs(found[1] / exact - 1).max())
    np.testing.assert_allclose(found[0], exact, rtol=1e-3)


def test_pictures_of_the_cameras_that_there_are_are_billed():
    small = fastibl.Camera(160, 120, 150, 150, 80, 60)
    usual = fastibl.Camera(640, 480, 600, 600, 320, 240)
    turn = fastibl.Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    cost = []
    for rig in (fastibl.Rig(usual), fastibl.Rig(usual, small, turn), fastibl.Rig(usual, usual, turn)):
        session = fastibl.Session(ball(), rig, fastibl.Board.default())
        cost.append(next(p.milliseconds for p in session.plan.passes if p.name == "capture"))
    np.testing.assert_allclose(np.array(cost) / cost[0], [1, 1 + 1 / 16, 2], rtol=1e-6)


def test_the_bill_is_that_of_the_methods_it_names():
    scene = ball()
    scene.baked_shadow = fastibl.MeshShadow(scene.mesh)
    environment = fastibl.Environment(lit_from_above())
    auto = {p.name: p for p in fastibl.make_plan(scene, environment).passes}
    named = {p.name: p for p in fastibl.make_plan(scene, environment, methods={"shadow": "mesh"}).passes}
    for name in ("shadow", "plane", "composite"):
        assert auto[name].method == named[name].method and auto[name].milliseconds == named[name].milliseconds


@pytest.mark.parametrize("name", ["distance", "most_boost", "paper_albedo", "box_yaw"])
def test_options_of_another_type_are_named(name):
    board = fastibl.Board.default()
    same_error(lambda: fastibl.Session(ball(), RIG, board, **{name: "x"}), TypeError, name, "a number", "str")


def test_costs_of_another_type_are_named():
    same_error(lambda: fastibl.make_plan(ball(), costs=[1]), TypeError, "costs", "list", "machine_costs")
    same_error(lambda: fastibl.Session(ball(), RIG, environment=WHITE, costs=[1]), TypeError, "costs", "list")
