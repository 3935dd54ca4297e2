"""Sphere proxies: how well they match a mesh's volume and silhouette, and what torn meshes get."""

from pathlib import Path

import numpy as np
import pytest

import fastibl

MESHES = Path(__file__).resolve().parents[2] / "shared" / "data" / "meshes"


def grid_mesh(points, wrap_u, wrap_v):
    """Mesh of a grid of points (nu, nv, 3), joined round where asked."""
    nu, nv = points.shape[:2]
    i, j = np.meshgrid(np.arange(nu if wrap_u else nu - 1), np.arange(nv if wrap_v else nv - 1), indexing="ij")
    a, b = i * nv + j, (i + 1) % nu * nv + j
    c, d = (i + 1) % nu * nv + (j + 1) % nv, i * nv + (j + 1) % nv
    quads = np.stack([a, b, c, a, c, d], -1).reshape(-1, 3)
    return fastibl.Mesh(points.reshape(-1, 3), quads)


def ball(n=40, centre=(0.0, 0, 0), radius=1.0):
    t, p = np.meshgrid(np.linspace(0, np.pi, n), np.arange(2 * n) / n * np.pi, indexing="ij")
    points = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)
    return grid_mesh(np.asarray(centre) + radius * points, False, True)


def torus(big=1.0, small=0.35, n=48):
    u, v = np.meshgrid(np.arange(n) / n * 2 * np.pi, np.arange(n // 2) / (n // 2) * 2 * np.pi, indexing="ij")
    ring = big + small * np.cos(v)
    return grid_mesh(np.stack([ring * np.cos(u), ring * np.sin(u), small * np.sin(v)], -1), True, True)


def box(size=(1.0, 0.7, 0.5)):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return fastibl.Mesh(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


def silhouette_error(mesh, spheres, n=96, views=12):
    """Area of symmetric difference over area, mean over cosine-distributed views from above."""
    v = mesh.vertices.astype(float)
    lower, upper = v.min(0), v.max(0)
    centre, reach = (lower + upper) / 2, np.linalg.norm(upper - lower) / 2 * 1.1
    bvh, g = fastibl.Bvh(mesh), (np.arange(n) + 0.5) / n * 2 - 1
    errors = []
    for i in range(views):
        z, turn = np.sqrt(1 - (i + 0.5) / views), i * np.pi * (3 - 5**0.5)
        d = np.array([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
        t = np.cross(d, [1, 0, 0] if abs(d[0]) < 0.7 else [0, 1, 0])
        t /= np.linalg.norm(t)
        b = np.cross(d, t)
        origins = centre + reach * (g[:, None, None] * t + g[:, None] * b) - 2 * reach * d
        hit = bvh.occluded(origins, np.ascontiguousarray(np.broadcast_to(d, origins.shape)))
        at = (spheres[:, :3] - centre) @ np.stack([t, b], 1)
        across = (reach * g[:, None, None] - at[:, 0]) ** 2 + (reach * g[:, None] - at[:, 1]) ** 2
        errors.append(((across < spheres[:, 3] ** 2).any(-1) != hit).sum() / hit.sum())
    return float(np.mean(errors))


def volume_error(inside, lower, upper, spheres, n=48):
    """Volume of symmetric difference over volume; inside: function of points (..., 3)."""
    axes = [np.linspace(a - 0.1 * (b - a), b + 0.1 * (b - a), n) for a, b in zip(lower, upper, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    true, covered = inside(points), np.zeros((n, n, n), bool)
    for *c, r in spheres.astype(float):
        covered |= ((points - c) ** 2).sum(-1) < r * r
    return (true != covered).sum() / true.sum()


def test_ball_is_one_sphere():
    spheres = fastibl.fit_spheres(ball(centre=(3.0, -2, 0.5), radius=0.2), count=1)
    assert spheres.shape == (1, 4) and spheres.dtype == np.float32
    np.testing.assert_allclose(spheres[0], [3, -2, 0.5, 0.2], atol=0.012)


SHAPES = {
    "ball": (ball, lambda p: (p**2).sum(-1) < 1, (-1, -1, -1), (1, 1, 1), 0.02, 0.005),
    "box": (box, lambda p: ((p > 0) & (p < (1, 0.7, 0.5))).all(-1), (0, 0, 0), (1, 0.7, 0.5), 0.11, 0.05),
    "torus": (
        torus,
        lambda p: (np.hypot(p[..., 0], p[..., 1]) - 1) ** 2 + p[..., 2] ** 2 < 0.35**2,
        (-1.35, -1.35, -0.35),
        (1.35, 1.35, 0.35),
        0.03,
        0.015,
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_volume_and_silhouette(name):
    make, inside, lower, upper, volume_limit, silhouette_limit = SHAPES[name]
    mesh = make()
    spheres = fastibl.fit_spheres(mesh)
    assert 1 <= len(spheres) <= 50 and (spheres[:, 3] > 0).all()
    volume, silhouette = volume_error(inside, lower, upper, spheres), silhouette_error(mesh, spheres)
    print(f"{name}: {len(spheres)} spheres, volume error {volume:.3f}, silhouette error {silhouette:.3f}")
    assert volume < volume_limit and silhouette < silhouette_limit


def chair():
    """A seat, a back and four legs: corners (6, 2, 3) of boxes, and the mesh of them."""
    legs = [((x, y, 0), (x + 0.06, y + 0.06, 0.45)) for x in (0, 0.44) for y in (0, 0.44)]
    corners = np.array([((0, 0, 0.45), (0.5, 0.5, 0.5)), ((0, 0.45, 0.5), (0.5, 0.5, 1)), *legs])
    parts = [box(upper - lower) for lower, upper in corners]
    vertices = np.concatenate([p.vertices + lower for p, (lower, _) in zip(parts, corners, strict=True)])
    return corners, fastibl.Mesh(vertices, np.concatenate([p.triangles + 8 * i for i, p in enumerate(parts)]))


def test_shadow_on_the_plane_that_a_mesh_stands_on():
    """Suns at 35 degrees: area that is wrongly dark or light, of the shadow's; gaps and feet are in it."""
    corners, mesh = chair()
    spheres, errors = fastibl.fit_spheres(mesh).astype(float), []
    points = np.stack(np.meshgrid(np.linspace(-1.6, 2.1, 200), np.linspace(-1.6, 2.1, 200), [0.0]), -1).reshape(-1, 3)
    for turn in np.arange(6) * np.pi / 3 + 0.2:
        d = np.array([np.cos(turn), np.sin(turn), np.tan(np.radians(35))])
        d /= np.linalg.norm(d)
        dark, covered = np.zeros((2, len(points)), bool)
        for lower, upper in corners:
            a, b = (lower - points) / d, (upper - points) / d
            dark |= np.maximum(np.minimum(a, b).max(1), 0) < np.maximum(a, b).min(1)
        for *centre, r in spheres:
            away = centre - points
            beside = away - np.maximum(away @ d, 0)[:, None] * d
            covered |= (beside**2).sum(1) < r * r
        errors.append((dark != covered).sum() / dark.sum())
    print("a chair's shadows:", np.round(errors, 3))
    assert np.mean(errors) < 0.1


def test_more_spheres_are_closer():
    mesh = torus()
    errors = [silhouette_error(mesh, fastibl.fit_spheres(mesh, count=k)) for k in (4, 12, 50)]
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize("make", [ball, box, torus])
def test_flipped_and_missing_faces(make):
    mesh, rng = make(), np.random.default_rng(1)
    whole = silhouette_error(mesh, fastibl.fit_spheres(mesh))
    triangles = mesh.triangles.copy()
    flip = rng.random(len(triangles)) < 0.5
    flipped = fastibl.Mesh(mesh.vertices, np.where(flip[:, None], triangles[:, ::-1], triangles))
    np.testing.assert_array_equal(fastibl.fit_spheres(flipped), fastibl.fit_spheres(mesh))  # order cannot matter
    if len(triangles) < 20:
        return
    for share in (0.1, 0.3):
        torn = fastibl.Mesh(mesh.vertices, triangles[rng.random(len(triangles)) > share])
        error = silhouette_error(mesh, fastibl.fit_spheres(torn))
        print(f"{make.__name__}: silhouette error {whole:.3f}, {error:.3f} with {share} of the triangles gone")
        assert error < whole + 0.015


def test_open_shells_are_full():
    mesh = ball()
    bowl = fastibl.Mesh(mesh.vertices, mesh.triangles[mesh.vertices[mesh.triangles].mean(1)[:, 2] < 0.6])
    spheres = fastibl.fit_spheres(bowl)
    assert volume_error(lambda p: ((p**2).sum(-1) < 1) & (p[..., 2] < 0.6), (-1, -1, -1), (1, 1, 0.6), spheres) < 0.2


def test_flat_mesh_gets_spheres_on_its_surface():
    square = np.array([[0.0, 0, 1], [2, 0, 1], [2, 2, 1], [0, 2, 1]])
    mesh = fastibl.Mesh(square, [[0, 1, 2], [0, 2, 3]])
    spheres = fastibl.fit_spheres(mesh)
    assert 40 <= len(spheres) <= 50
    np.testing.assert_allclose(spheres[:, 2], 1, atol=1e-6)
    assert (spheres[:, :2] > 0).all() and (spheres[:, :2] < 2).all()
    assert (np.pi * spheres[:, 3] ** 2).sum() == pytest.approx(4, rel=1e-3)
    assert fastibl.fit_spheres(mesh, count=1)[0].tolist() == pytest.approx([1, 1, 1, np.sqrt(4 / np.pi)], rel=1e-3)


@pytest.mark.parametrize(
    "points",
    [[[1.0, 2, 3]] * 3, [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0.0, 0, 0], [1e-30, 0, 0], [0, 1e-30, 0]]],
)
def test_degenerate_meshes_are_not_empty(points):
    spheres = fastibl.fit_spheres(fastibl.Mesh(np.array(points), [[0, 1, 2]]))
    assert len(spheres) >= 1 and np.isfinite(spheres).all() and (spheres[:, 3] > 0).all()


def test_scale_moves_with_the_mesh():
    mesh = box()
    small = fastibl.Mesh(mesh.vertices * np.float32(2**-10), mesh.triangles)
    np.testing.assert_allclose(fastibl.fit_spheres(small) * 1024, fastibl.fit_spheres(mesh), rtol=1e-5, atol=1e-6)


def test_same_result_every_time_and_for_any_threads():
    mesh, before = torus(), fastibl.threads()
    try:
        results = []
        for count in (1, 2, 2):
            fastibl.set_threads(count)
            results.append(fastibl.fit_spheres(mesh, count=20).tobytes())
        assert results[0] == results[1] == results[2]
    finally:
        fastibl.set_threads(before)


def test_seeds_give_other_sets_that_are_as_good():
    mesh = torus()
    sets = [fastibl.fit_spheres(mesh, seed=seed) for seed in (0, 1, 2, 4_000_000_000)]
    assert len({s.tobytes() for s in sets}) == len(sets)
    np.testing.assert_array_equal(fastibl.fit_spheres(mesh, seed=1), sets[1])
    errors = [silhouette_error(mesh, s) for s in sets]
    print("silhouette errors of four seeds:", np.round(errors, 4))
    assert max(errors) < 0.015


@pytest.mark.parametrize("count", [1, 2, 7, 200])
def test_spheres_stay_in_and_around_the_mesh(count):
    """Two limbs with a gap: nothing outside the box but a little, and no sphere in the gap."""
    a, b = ball(centre=(0, 0, 0), radius=0.3), torus(1.0, 0.1)
    both = fastibl.Mesh(
        np.concatenate([a.vertices, b.vertices]), np.concatenate([a.triangles, b.triangles + len(a.vertices)])
    )
    spheres = fastibl.fit_spheres(both, count=count)
    assert np.isfinite(spheres).all() and len(spheres) <= count and (spheres[:, 3] > 0).all()
    assert (np.abs(spheres[:, :3]) + spheres[:, 3:] < np.array([1.1, 1.1, 0.3]) * 1.1).all()
    distance = np.linalg.norm(spheres[:, :2], axis=1)
    assert ((distance < 0.3) | (np.abs(distance - 1) < 0.15)).all()


def test_what_is_refused():
    for settings in ({"count": 0}, {"count": -1}, {"resolution": 7}, {"resolution": 129}):
        with pytest.raises(ValueError, match="spheres|resolution"):
            fastibl.fit_spheres(box(), **settings)
    with pytest.raises(TypeError):
        fastibl.fit_spheres(np.zeros((4, 3)))
    with pytest.raises(ValueError, match="narrower"):
        fastibl.fit_spheres(box((1e30, 1, 1)))


@pytest.mark.parametrize("name, limit", [("spot", 0.03), ("stanford-bunny", 0.045)])
def test_real_mesh(name, limit):
    path = MESHES / f"{name}.obj"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    mesh = fastibl.read_mesh(str(path))
    spheres = fastibl.fit_spheres(mesh)
    error = silhouette_error(mesh, spheres)
    print(f"{name}: {len(mesh.triangles)} triangles, silhouette error {error:.3f}")
    assert error < limit
    if name == "spot":
        keep = np.random.default_rng(0).random(len(mesh.triangles)) > 0.3
        torn = fastibl.fit_spheres(fastibl.Mesh(mesh.vertices, mesh.triangles[keep]))
        error = silhouette_error(mesh, torn)
        print(f"{name}: silhouette error {error:.3f} with 0.3 of the triangles gone")
        assert error < 0.035
