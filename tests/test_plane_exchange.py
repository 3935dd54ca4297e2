"""One bounce of diffuse light between an object and the plane, against sums in float64."""

import numpy as np
import pytest

import fastibl


def plate(count, side, height, facing=-1):
    """A horizontal square of count x count squares around (0.1, -0.05)."""
    axis = np.linspace(-side / 2, side / 2, count + 1)
    x, y = np.meshgrid(axis + 0.1, axis - 0.05)
    vertices = np.stack([x, y, np.full_like(x, height)], axis=-1).reshape(-1, 3)
    i = np.arange(count * (count + 1)).reshape(count, count + 1)[:, :-1].reshape(-1)
    n = count + 1
    triangles = np.concatenate([np.stack([i, i + 1, i + n], -1), np.stack([i + 1, i + n + 1, i + n], -1)])
    return fastibl.Mesh(vertices, triangles[:, ::-1] if facing < 0 else triangles)


def cell_middles(exchange):
    axis = ((np.arange(exchange.cells) + 0.5) / exchange.cells * 2 - 1) * exchange.extent
    return np.stack(np.meshgrid(axis + exchange.centre[0], axis + exchange.centre[1]), axis=-1)


def by_plate(points, side, height, count=200):
    """Irradiance on the plane by a plate of exitance 1: cos cos' / (pi d^2) over its area."""
    axis = ((np.arange(count) + 0.5) / count - 0.5) * side
    x, y = np.meshgrid(axis + 0.1, axis - 0.05)
    out = np.empty(points.shape[:-1])
    for index in np.ndindex(out.shape):
        d2 = (x - points[index][0]) ** 2 + (y - points[index][1]) ** 2 + height**2
        out[index] = (height**2 / (np.pi * d2**2)).sum() * (side / count) ** 2
    return out


def test_a_plate_lights_the_plane_below():
    side, height = 0.4, 0.2
    mesh = plate(24, side, height)
    exchange = fastibl.PlaneExchange(mesh, cells=16)
    given = exchange.onto_plane(np.ones((len(mesh.vertices), 3)) * (1, 0.5, 0))
    true = by_plate(cell_middles(exchange), side, height)
    error = np.abs(given[..., 0] - true).mean() / true.mean()
    print(f"plate of 0.4 m, 0.2 m above: mean error {error:.2%} of the mean, brightest {true.max():.3f}")
    assert error < 0.04
    np.testing.assert_allclose(given[..., 1], given[..., 0] / 2, rtol=1e-5)
    assert (given[..., 2] == 0).all()


def test_nothing_shines_through_the_object():
    lower, upper = plate(8, 0.6, 0.1), plate(8, 0.2, 0.3)
    both = fastibl.Mesh(
        np.concatenate([lower.vertices, upper.vertices]),
        np.concatenate([lower.triangles, upper.triangles + len(lower.vertices)]),
    )
    exchange = fastibl.PlaneExchange(both)
    exitance = np.zeros((len(both.vertices), 3))
    exitance[len(lower.vertices) :] = 1  # the upper one sees the lower one's back
    hidden = exchange.onto_plane(exitance)
    middle = np.abs(cell_middles(exchange) - exchange.centre).max(axis=-1) < 0.15
    print(f"behind another plate: {hidden[middle].max():.4f}, beside it {hidden.max():.4f}")
    assert hidden[middle].max() < 1e-3 and hidden.max() > 0.005  # visibility is known by cells of 5 degrees


def test_both_ways_are_one_table():
    """What leaves the object and meets the plane is what the plane would send back: areas by form factors. Where the
    object lies on the plane nothing comes out."""
    mesh = fastibl.shapes.figurine(0.2)
    exchange = fastibl.PlaneExchange(mesh)
    v, t = mesh.vertices.astype(float), mesh.triangles
    areas = np.zeros(len(v))
    thirds = np.linalg.norm(np.cross(v[t[:, 1]] - v[t[:, 0]], v[t[:, 2]] - v[t[:, 0]]), axis=1) / 6
    for k in range(3):
        np.add.at(areas, t[:, k], thirds)
    areas[(v[:, 2] <= 1e-3 * np.ptp(v, axis=0).max()) & (mesh.normals[:, 2] < 0)] = 0
    rng = np.random.default_rng(0)
    sent, asked = rng.random((len(v), 3)), rng.random((exchange.cells, exchange.cells, 3))
    cell_area = (2 * exchange.extent / exchange.cells) ** 2
    there = (exchange.onto_plane(sent) * asked).sum() * cell_area
    back = (exchange.onto_object(asked) * sent * areas[:, None]).sum()
    assert there == pytest.approx(back, rel=1e-4)
    flux = exchange.onto_plane(np.ones((len(v), 3))).sum(axis=(0, 1))[0] * cell_area
    print(f"the figurine sends {flux / areas.sum():.3f} of its light to the plane")
    assert 0 < flux < areas.sum()
    shares = exchange.onto_object(np.ones_like(asked))
    assert (shares >= 0).all() and shares.max() <= 1.02


@pytest.mark.parametrize("own", [False, True], ids=["shared vertices", "own vertices"])
@pytest.mark.parametrize("count", [1, 8])
def test_a_copy_of_a_triangle_adds_no_light(count, own):
    """Merged scans hold faces twice. Turned over, a copy is the surface's other side, and sends light of its own."""
    mesh = plate(count, 0.3, 0.2)
    v, t = mesh.vertices, mesh.triangles
    once = fastibl.PlaneExchange(mesh)
    copies = np.roll(t, 1, axis=1)
    twice = fastibl.PlaneExchange(
        fastibl.Mesh(np.concatenate([v, v]), np.concatenate([t, copies + len(v)]))
        if own else fastibl.Mesh(v, np.concatenate([t, copies]))
    )  # fmt: skip
    both = np.ones((len(v) * (1 + own), 3))
    assert once.onto_plane(np.ones((len(v), 3))).max() > 0.1
    np.testing.assert_allclose(twice.onto_plane(both), once.onto_plane(both[: len(v)]), rtol=0.01, atol=1e-3)
    asked = np.ones((once.cells, once.cells, 3))
    np.testing.assert_allclose(twice.onto_object(asked)[: len(v)], once.onto_object(asked), rtol=0.01, atol=1e-3)
    over = fastibl.PlaneExchange(fastibl.Mesh(np.concatenate([v, v]), np.concatenate([t, t[:, ::-1] + len(v)])))
    np.testing.assert_allclose(
        over.onto_plane(np.ones((2 * len(v), 3))), once.onto_plane(np.ones((len(v), 3))), rtol=0.02, atol=1e-3
    )


def test_what_does_not_fit():
    mesh = plate(2, 0.1, 0.1, facing=1)
    exchange = fastibl.PlaneExchange(mesh)
    assert (exchange.onto_plane(np.ones((9, 3))) == 0).all()  # it looks up
    assert (exchange.onto_object(np.ones((32, 32, 3))) == 0).all()
    below = fastibl.PlaneExchange(plate(2, 0.1, -0.1))
    assert (below.onto_plane(np.ones((9, 3))) == 0).all()
    with pytest.raises(ValueError, match="9 vertices"):
        exchange.onto_plane(np.ones((8, 3)))
    with pytest.raises(ValueError, match=r"\(32, 32, 3\)"):
        exchange.onto_object(np.ones((16, 16, 3)))
    with pytest.raises(ValueError, match="1 to 128"):
        fastibl.PlaneExchange(mesh, cells=0)
