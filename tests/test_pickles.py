"""What a worker process hands back: results of sessions and of maps survive a pickle and a copy, bit for bit."""

import copy
import multiprocessing
import pickle

import numpy as np
import pytest
from test_material import sphere

import fastibl
from conftest import same_error

VALUES = ("coverage", "clipped", "predicted_error", "predicted_interval", "plane_irradiance", "knowledge", "centre")


@pytest.fixture(scope="module")
def result():
    """Of a session that captured a room with a near lamp for a second, and the session."""
    recording = fastibl.simulate(seconds=1.5, fps=8, size=(320, 240))
    mesh = fastibl.stand(fastibl.shapes.figurine(), 0.15)
    session = fastibl.Session(fastibl.Scene(mesh, fastibl.Material()), recording.rig, recording.board)
    for frame in recording:
        made = session.process(frame)
    return made, session, recording


def pickled(value):
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize("copied", [pickled, copy.deepcopy])
def test_a_captured_environment(result, copied):
    """Another session is lit by it as by the first: its image has the same bits."""
    environment, recording = result[0].environment, result[2]
    got = copied(environment)
    for name in VALUES:
        assert getattr(got, name) == getattr(environment, name), name
    for name in ("confidence", "age", "light_positions"):
        np.testing.assert_array_equal(getattr(got, name), getattr(environment, name))
    assert 0 < environment.coverage < 1 and len(np.unique(environment.age)) > 10
    assert got.radiance == environment.radiance
    frame = list(recording)[-1]
    images = []
    for light in (environment, got):
        scene = fastibl.Scene(sphere(12), fastibl.Material(), spheres=0)
        session = fastibl.Session(scene, recording.rig, recording.board, environment=light)
        images.append(session.process(frame).image)
    np.testing.assert_array_equal(*images)


def test_a_given_environment():
    rng = np.random.default_rng(0)
    cube = fastibl.CubeMap(rng.random((6, 16, 16, 3)).astype(np.float32))
    lights = [(0.5, 0.2, 1.0, 0.05), (-1.0, 0.0, 2.0, 0.1)]
    given = fastibl.Environment(cube, centre=(0.1, 0, 0.2), lights=lights, box=((-2, -2, 0), (2, 2, 3)), box_yaw=0.4)
    got = pickled(given)
    np.testing.assert_array_equal(got.light_positions, lights)
    assert got.centre == given.centre and got.radiance == cube and got.predicted_error == given.predicted_error
    normal, eye = [[0.0, 0.6, 0.8]], [[0.6, 0.0, 0.8]]
    np.testing.assert_array_equal(got.box, given.box)
    assert got.box_yaw == 0.4
    for make in (lambda e: fastibl.Lighting(e).glossy(normal, eye, exponent=50), lambda e: fastibl.Lighting(e).sh9):
        np.testing.assert_array_equal(make(got), make(given))
    state = given.__getstate__()
    other = fastibl.Environment(fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32))).__getstate__()
    damaged = (*state[:7], np.zeros((3, 4)), *state[8:])
    blank = fastibl.Environment.__new__(fastibl.Environment)
    same_error(lambda: blank.__setstate__(damaged), ValueError, "times", "(3, 4)")
    assert len(other) == len(state)


def test_lights_and_layers(result):
    made, session, _ = result
    for light in fastibl.main_lights(made.environment):
        got = pickled(light)
        for name in ("direction", "solid_angle", "angular_radius", "irradiance", "share", "position", "covariance"):
            assert getattr(got, name) == getattr(light, name), name
    faces = np.full((6, 64, 64, 3), 0.1, np.float32)
    faces[2, 20:24, 30:34] = 500
    lights = fastibl.Lighting(fastibl.CubeMap(faces)).lights
    assert lights and [pickled(light) for light in lights] == list(lights)
    assert pickled(session.shadow_map) == session.shadow_map and pickled(session.plane_gain) == session.plane_gain
    layer, got = session.object, pickled(session.object)
    np.testing.assert_array_equal(got.rgba, layer.rgba)
    assert (got.x, got.y) == (layer.x, layer.y) and layer.rgba.size > 0
    for name in ("object", "ratio"):
        np.testing.assert_array_equal(getattr(pickled(session.layers), name), getattr(session.layers, name))


def captured(seed):
    recording = fastibl.simulate(seconds=0.5, fps=4, size=(320, 240), seed=seed)
    scene = fastibl.Scene(sphere(12), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, recording.rig, recording.board)
    return [session.process(frame) for frame in recording][-1].environment


def test_a_response():
    for response in (fastibl.Response.srgb(), fastibl.Response.gamma(2.2), fastibl.Response.srgb().between(0.1, 0.9)):
        assert pickled(response) == response
    blank = fastibl.Response.__new__(fastibl.Response)
    same_error(lambda: blank.__setstate__(([0.0, 0.6, 0.4, 1.0],)), ValueError, "increase strictly")


def test_a_pool_hands_environments_back():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (environment,) = pool.map(captured, [3])
    assert environment.radiance == captured(3).radiance


@pytest.mark.parametrize("protocol", [0, 1])
def test_old_protocols_are_refused(protocol):
    """pybind11 would end the process."""
    camera = fastibl.Camera(64, 48, 50, 50, 32, 24)
    cube = fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32))
    framed = fastibl.Frame(0.0, back_from_marker=fastibl.Pose(np.eye(4)))
    own = (fastibl.Pose(np.eye(4)), camera, cube, fastibl.Rig(camera), fastibl.Board.default(), fastibl.Material())
    for value in (*own, framed, fastibl.Environment(cube), sphere(4)):
        with pytest.raises(TypeError, match="protocol 2 and later"):
            pickle.dumps(value, protocol)
    assert pickle.loads(pickle.dumps(camera, 2)) == camera == copy.copy(camera)


def test_what_is_not_pickled_says_what_to_pickle():
    same_error(
        lambda: pickle.dumps(fastibl.Lighting(fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32)))), TypeError, "its map"
    )
    scene = fastibl.Scene(sphere(8), spheres=0, visibility_rays=0)
    same_error(lambda: pickle.dumps(scene), TypeError, "mesh", "material")
