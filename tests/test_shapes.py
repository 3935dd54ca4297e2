"""Generated objects: closed, smooth, the same every time."""

import numpy as np
import pytest

from fastibl import Bvh, shapes


def edges(mesh):
    t = mesh.triangles
    return np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])


@pytest.mark.parametrize("detail", [0.9, 1.0, 1.4])
def test_figurine_is_one_closed_surface(detail):
    mesh = shapes.figurine(detail=detail)
    e = edges(mesh)
    directed = {tuple(edge) for edge in e}
    assert len(directed) == len(e)  # each directed edge once ...
    assert all((b, a) in directed for a, b in directed)  # ... and its opposite too
    assert len(np.unique(e)) == len(mesh.vertices)
    assert len(mesh.vertices) - len(e) // 2 + len(mesh.triangles) == 0  # one piece with one handle
    label = np.arange(len(mesh.vertices))
    for _ in range(len(label)):
        lowest = label.copy()
        np.minimum.at(lowest, e[:, 0], label[e[:, 1]])
        lowest = lowest[lowest]
        if np.array_equal(lowest, label):
            break
        label = lowest
    assert (label == 0).all()


def test_figurine_stands_on_the_marker_and_is_well_made():
    mesh = shapes.figurine(height=0.2)
    assert 3000 <= len(mesh.triangles) <= 8000
    v = mesh.vertices
    assert v[:, 2].min() == pytest.approx(0, abs=1e-7)
    assert v[:, 2].max() == pytest.approx(0.2, rel=1e-5)
    a, b, c = (v[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0  # faces look outwards
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert area.min() > 0.02 * np.median(area)
    flat = np.cross(b - a, c - a) / area[:, None]
    smooth = mesh.normals[mesh.triangles]
    assert np.percentile(np.einsum("ij,ikj->ik", flat, smooth), 2) > 0.8
    assert shapes.figurine(height=0.2) == mesh


def test_figurine_has_hollows_and_thin_parts():
    mesh = shapes.figurine(height=0.12)
    bvh = Bvh(mesh)
    out = mesh.vertices + 1e-4 * mesh.normals
    hidden = bvh.occluded(out, mesh.normals.copy())
    assert 0.02 < hidden.mean() < 0.6  # looks at itself
    _, inside, _ = bvh.nearest(mesh.vertices - 1e-5 * mesh.normals, -mesh.normals)
    assert np.percentile(inside, 10) < 0.1 * 0.12  # thin
    assert np.percentile(inside, 90) > 0.2 * 0.12  # and stout


def test_surface_net_of_a_sphere():
    ball = shapes.surface_net(lambda p: np.linalg.norm(p, axis=1) - 1, np.full(3, -1.3), np.full(3, 1.3), 0.13)
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 1, atol=1e-5)
    assert np.min(np.sum(ball.normals * ball.vertices, axis=1)) > 0.99
    assert len(ball.vertices) - len(edges(ball)) // 2 + len(ball.triangles) == 2


@pytest.mark.parametrize("arguments", [{"height": 0}, {"height": np.nan}, {"detail": 0.5}, {"detail": 5}])
def test_figurine_refuses(arguments):
    with pytest.raises(ValueError):
        shapes.figurine(**arguments)
