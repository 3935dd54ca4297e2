"""Vertices that no triangle uses are no part of an object: they change nothing of its light."""

import numpy as np
import pytest
from test_session import RIG, given
from test_session_changes import lit_from_above

import fastibl

FAR = [[1000.0, 0.0, 0.0]]


def with_stray(mesh):
    return fastibl.Mesh(np.vstack([mesh.vertices, FAR]).astype(np.float32), mesh.triangles)


@pytest.fixture(scope="module")
def mesh():
    given_mesh = fastibl.shapes.figurine(0.12)
    return fastibl.Mesh(given_mesh.vertices, given_mesh.triangles)


def test_self_shadow(mesh):
    cube, n = lit_from_above(), len(mesh.vertices)
    plain = fastibl.SelfShadow(mesh).shares(fastibl.Lighting(cube))
    stray = fastibl.SelfShadow(with_stray(mesh)).shares(fastibl.Lighting(cube))
    np.testing.assert_array_equal(stray[:n], plain)
    assert plain.min() < 0.5


def test_plane_exchange(mesh):
    plain, stray = fastibl.PlaneExchange(mesh), fastibl._fastibl.PlaneExchange(with_stray(mesh))
    assert stray.extent == plain.extent and stray.centre == plain.centre
    light = [
        e.onto_plane(np.ones((len(m.vertices), 3), np.float32)) for e, m in ((plain, mesh), (stray, with_stray(mesh)))
    ]
    np.testing.assert_allclose(light[1], light[0], rtol=1e-6, atol=1e-7)
    assert light[0].max() > 0.1


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_plane_exchange_of_what_is_not_finite_is_refused(mesh, value):
    exchange = fastibl.PlaneExchange(mesh, cells=8)
    light = np.ones((len(mesh.vertices), 3), np.float32)
    light[3, 1] = value
    with pytest.raises(ValueError, match="exitance must be finite, got"):
        exchange.onto_plane(light)
    with pytest.raises(ValueError, match="exitance must be finite, got"):
        exchange.onto_object(np.full((8, 8, 3), value, np.float32))


def test_real_objects():
    """A wall beside a sphere on the plane, whose shadow falls on it."""
    import trimesh

    wall = trimesh.creation.box((0.02, 0.3, 0.2), trimesh.transformations.translation_matrix((0.08, 0, 0.1)))
    floor = trimesh.creation.box((0.2, 0.3, 0.01), trimesh.transformations.translation_matrix((0.19, 0, 0.005)))
    both = trimesh.util.concatenate([wall, floor])
    real = fastibl.Mesh(both.vertices.astype(np.float32), both.faces)
    ball = trimesh.creation.icosphere(3, 0.04)
    layers = []
    for holdouts in (
        [real],
        [with_stray(real)],
        [real, fastibl.Mesh(np.add(real.vertices, [3.0, 0, 0]), real.triangles)],
    ):
        scene = fastibl.Scene(fastibl.Mesh(ball.vertices + [0, 0, 0.04], ball.faces), visibility_rays=0)
        scene.holdouts = holdouts
        session = fastibl.Session(scene, RIG, environment=lit_from_above(), error=0)
        session.process(given())
        layers.append(session.holdout.rgba)
    assert (layers[0][..., 3] > 0).mean() > 0.1
    np.testing.assert_array_equal(layers[1], layers[0])
    np.testing.assert_allclose(layers[2], layers[0], atol=2e-3)
