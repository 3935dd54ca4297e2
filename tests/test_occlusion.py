"""Ray queries against brute force, and ambient occlusion against closed forms and brute force."""

import numpy as np
import pytest

import fastibl


def soup(count, seed=0, size=0.4):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    return fastibl.Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def all_hits(mesh, origins, directions, t_min=0.0):
    """t (rays, triangles) of every hit, inf elsewhere: solves o + t d = a + u e1 + v e2 in float64."""
    a, b, c = np.moveaxis(mesh.vertices.astype(float)[mesh.triangles], 1, 0)
    matrix = np.stack(np.broadcast_arrays((b - a)[None], (c - a)[None], -directions[:, None]), -1)
    determinant = np.linalg.det(matrix)
    matrix[np.abs(determinant) < 1e-12] = np.eye(3)
    u, v, t = np.moveaxis(np.linalg.solve(matrix, (origins[:, None] - a)[..., None])[..., 0], -1, 0)
    met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > t_min) & (np.abs(determinant) >= 1e-12)
    return np.where(met, t, np.inf), u, v


@pytest.mark.parametrize("count", [1, 5, 80])
def test_bvh_against_brute_force(count):
    mesh, rng = soup(count), np.random.default_rng(count)
    origins = rng.uniform(-2, 2, (600, 3)).astype(np.float32)
    directions = (rng.normal(size=(600, 3)) * rng.uniform(0.1, 5, (600, 1))).astype(np.float32)
    directions[:60] = np.eye(3)[rng.integers(0, 3, 60)] * rng.choice([-1, 1], (60, 1))  # along axes
    bvh = fastibl.Bvh(mesh)
    for t_min in (0.0, 0.3):
        t, u, v = all_hits(mesh, origins.astype(float), directions.astype(float), t_min)
        first = t.argmin(1)
        rows = np.arange(len(t))
        met = np.isfinite(t[rows, first])
        triangle, got_t, uv = bvh.nearest(origins, directions, t_min)
        np.testing.assert_array_equal(bvh.occluded(origins, directions, t_min), met)
        np.testing.assert_array_equal(triangle, np.where(met, first, -1))
        np.testing.assert_allclose(got_t[met], t[rows, first][met], rtol=1e-4, atol=1e-5)
        expected = np.stack([u[rows, first], v[rows, first]], -1)[met]
        np.testing.assert_allclose(uv[met], expected, atol=1e-3)
        assert np.isinf(got_t[~met]).all()
    assert met.any()


@pytest.mark.parametrize("count", [1, 7, 80, 3000])
def test_many_directions_from_one_point(count):
    """Packets of rays find what single rays find, for any number of directions."""
    mesh, rng = soup(count, size=0.4 if count < 1000 else 0.03), np.random.default_rng(count)
    bvh, differ, rays = fastibl.Bvh(mesh), 0, 0
    for k in range(60):
        origin = rng.uniform(-2, 2, 3).astype(np.float32)
        directions = rng.normal(size=(1 + 7 * k % 65, 3)).astype(np.float32)
        directions[::9] = np.eye(3)[rng.integers(0, 3, len(directions[::9]))]  # along axes
        for t_min in (0.0, 0.4):
            single = bvh.occluded(np.broadcast_to(origin, directions.shape), directions, t_min)
            packets = bvh.occluded(origin, directions, t_min)
            assert packets.shape == single.shape and packets.dtype == bool
            differ, rays = differ + int((packets != single).sum()), rays + single.size
    print(f"{count} triangles: {differ} of {rays} rays differ")
    assert differ <= rays * 2e-4  # those that graze an edge
    assert bvh.occluded(np.zeros(3, np.float32), np.zeros((0, 3), np.float32)).shape == (0,)


def test_rays_in_the_faces_of_boxes():
    """Axis-parallel rays that start in the plane of a box's face: 0 times infinity in a slab test."""
    mesh = floor_and_wall(False, 1.0)[0]
    bvh = fastibl.Bvh(mesh)
    origins = np.array([[0.5, 0, 0], [0.5, 0, 0.5], [0.5, 100, 0.5], [0.5, -100, 1]], np.float32)
    to_wall = np.tile(np.array([-1, 0, 0], np.float32), (4, 1))
    np.testing.assert_array_equal(bvh.occluded(origins, to_wall), [True] * 4)
    for origin in origins:
        assert bvh.occluded(origin, to_wall).all()
        assert not bvh.occluded(origin, -to_wall).any()


def test_deep_and_degenerate_trees():
    """Centres in a geometric series make splits lopsided; many equal triangles cannot be split."""
    x = 2.0 ** -np.arange(100)
    corners = np.stack([np.stack([x, 0 * x, 0 * x], -1), np.stack([1.01 * x, 0 * x, 0 * x], -1),
                        np.stack([x, 0.01 * x, 0 * x], -1)], 1)  # fmt: skip
    same = np.repeat(np.array([[[0.0, 2, 0], [1, 2, 0], [0, 3, 0]]]), 500, 0)
    points = np.concatenate([corners, same, np.full((20, 3, 3), 7.0)]).reshape(-1, 3)
    mesh = fastibl.Mesh(points, np.arange(len(points)).reshape(-1, 3))
    bvh = fastibl.Bvh(mesh)
    at = corners.mean(1)[:40]  # smaller ones have no area in float32
    down = np.broadcast_to(np.array([0, 0, -1.0]), at.shape)
    assert bvh.occluded((at + [0, 0, 1]).astype(np.float32), down.astype(np.float32)).all()
    assert bvh.occluded(np.array([0.2, 2.2, 1], np.float32), np.array([[0, 0, -1.0]], np.float32)).all()
    assert np.isfinite(fastibl.ambient_occlusion(mesh)).all()


def test_convex_meshes_are_free():
    n = 24
    t, p = np.meshgrid(np.linspace(0, np.pi, n), np.arange(2 * n) / n * np.pi, indexing="ij")
    points = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(2 * n), indexing="ij")
    a, b = i * 2 * n + j, i * 2 * n + (j + 1) % (2 * n)
    c, d = a + 2 * n, b + 2 * n
    triangles = np.stack([a, c, b, b, c, d], -1).reshape(-1, 3)
    used = np.concatenate([np.arange(2 * n, (n - 1) * 2 * n)])  # poles are drawn as degenerate triangles
    for scale in (1e-3, 1.0, 1e3):
        visibility = fastibl.ambient_occlusion(fastibl.Mesh(points * scale, triangles))
        assert visibility.shape == (len(points),) and visibility.dtype == np.float32
        assert (visibility[used] == 1).all()


def test_inside_of_a_ball_sees_nothing():
    mesh = soup(1)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [
        (0, 2, 3, 1),
        (4, 5, 7, 6),
        (0, 1, 5, 4),
        (2, 6, 7, 3),
        (0, 4, 6, 2),
        (1, 3, 7, 5),
    ]  # facing inwards
    mesh = fastibl.Mesh(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    assert (fastibl.ambient_occlusion(mesh) == 0).all()


def floor_and_wall(shared, height, length=200.0):
    """Floor z = 0 with small triangles at x > 0, and a long wall at x = 0 of that height."""
    h = length / 2
    wall = [[0, -h, 0], [0, h, 0], [0, h, height], [0, -h, height]]
    if shared:  # one crease, vertices in common
        points = [[0, -h, 0], [0, 0, 0], [0, h, 0], [h, -h, 0], [h, h, 0], [0, -h, h], [0, h, h]]
        triangles = [[0, 3, 1], [3, 4, 1], [4, 2, 1], [0, 1, 5], [1, 6, 5], [1, 2, 6]]
        return fastibl.Mesh(np.array(points, float), triangles), 1
    distances = np.array([0.01, 0.1, 0.5, 1, 2, 5])
    points, triangles = list(wall), [[0, 1, 2], [0, 2, 3]]
    for x in distances:
        k = len(points)
        points += [[x, 0, 0], [x + 1e-3, 0, 0], [x, 1e-3, 0]]
        triangles.append([k, k + 1, k + 2])
    return fastibl.Mesh(np.array(points, float), triangles), distances


def test_inside_corner_against_closed_forms():
    # Floor at distance x from an endless wall of height h: 1 - (1 - x / sqrt(x^2 + h^2)) / 2.
    for height in (0.5, 2.0):
        mesh, x = floor_and_wall(False, height)
        got = fastibl.ambient_occlusion(mesh, rays=4096)[4::3]
        expected = 1 - (1 - x / np.hypot(x, height)) / 2
        print(f"wall of {height}: largest error {np.abs(got - expected).max():.4f} with 4096 rays")
        np.testing.assert_allclose(got, expected, atol=0.01)
    assert fastibl.ambient_occlusion(floor_and_wall(False, 60.0)[0], 1024)[4] == pytest.approx(0.5, abs=0.02)
    # In the crease the normal halves the right angle: a wedge of +-45 degrees, sin(45 degrees).
    mesh, crease = floor_and_wall(True, 1)
    np.testing.assert_allclose(mesh.normals[crease], [np.sqrt(0.5), 0, np.sqrt(0.5)], atol=1e-3)
    assert fastibl.ambient_occlusion(mesh, 4096)[crease] == pytest.approx(np.sqrt(0.5), abs=0.01)


def test_against_brute_force_rays():
    mesh, rng = soup(25, seed=3), np.random.default_rng(0)
    normals, vertices = mesh.normals.astype(float), mesh.vertices.astype(float)
    truth = np.empty(len(vertices))
    for i, (n, p) in enumerate(zip(normals, vertices, strict=True)):
        directions = rng.normal(size=(2000, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        directions += n  # a point of the sphere about the normal's tip: cosine-distributed
        origins = np.broadcast_to(p + 2e-4 * n, directions.shape)
        truth[i] = 1 - np.isfinite(all_hits(mesh, origins, directions)[0]).any(1).mean()
    for rays, limit in ((64, 0.035), (96, 0.03), (1024, 0.012)):
        error = fastibl.ambient_occlusion(mesh, rays) - truth
        print(f"{rays} rays: RMS {np.sqrt(np.mean(error**2)):.4f}, max {np.abs(error).max():.4f}")
        assert np.sqrt(np.mean(error**2)) < limit


def test_spheres_in_place_of_the_mesh():
    """Against NumPy over the whole hemisphere: containing spheres are left out, hostile ones ignored."""
    mesh, rng = soup(25, seed=3), np.random.default_rng(0)
    spheres = np.concatenate([rng.uniform(-1.2, 1.2, (12, 3)), rng.uniform(0.1, 0.5, (12, 1))], 1)
    hostile = [[0, 0, 0, -1], [0, 0, 0, 0], [np.nan, 0, 0, 1], [0, np.inf, 0, 1], [0, 0, 0, np.nan], [0, 0, 0, np.inf]]
    got = fastibl.ambient_occlusion(mesh, 4096, spheres=np.concatenate([spheres, hostile]).astype(np.float32))
    d = rng.normal(size=(4000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    expected = []
    for p, n in zip(mesh.vertices.astype(float), mesh.normals.astype(float), strict=True):
        directions = d + n
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        m = spheres[:, :3] - p
        squared = (m**2).sum(1) - spheres[:, 3] ** 2
        m, squared = m[squared > 0], squared[squared > 0]
        expected.append(1 - (directions @ m.T > np.sqrt(squared)).any(1).mean())
    error = got - np.array(expected)
    print(f"spheres: RMS {np.sqrt(np.mean(error**2)):.4f}, max {np.abs(error).max():.4f}, mean P_V {got.mean():.2f}")
    assert np.sqrt(np.mean(error**2)) < 0.012 and got.mean() < 0.95
    assert (fastibl.ambient_occlusion(mesh, spheres=np.zeros((0, 4), np.float32)) == 1).all()
    with pytest.raises(ValueError, match="spheres"):
        fastibl.ambient_occlusion(mesh, spheres=np.zeros((4, 3), np.float32))


def test_same_bits_for_any_threads_and_every_time():
    mesh, before = soup(60), fastibl.threads()
    try:
        results = []
        for count in (1, 2, 2):
            fastibl.set_threads(count)
            spheres = fastibl.ambient_occlusion(mesh, spheres=[[0.0, 0, 0, 1], [1, 0, 0, 0.5]])
            results.append(fastibl.ambient_occlusion(mesh).tobytes() + spheres.tobytes())
        assert results[0] == results[1] == results[2]
    finally:
        fastibl.set_threads(before)


def test_degenerate_and_refused():
    mesh = fastibl.Mesh(np.zeros((4, 3)), [[0, 1, 2]])  # no area, and a vertex of no triangle
    visibility = fastibl.ambient_occlusion(mesh)
    assert visibility.shape == (4,) and np.isfinite(visibility).all()
    for rays in (0, -5, 1 << 21):
        with pytest.raises(ValueError, match="rays"):
            fastibl.ambient_occlusion(mesh, rays=rays)
    with pytest.raises(TypeError):
        fastibl.ambient_occlusion(np.zeros((4, 3)))
