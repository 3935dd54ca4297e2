"""Coverage of the object layer: areas, shared edges, silhouettes against rays, objects half outside."""

import numpy as np
import pytest
import trimesh

import fastibl
from conftest import in_picture
from fastibl import reference
from views import camera_of, looking, rays_of

CAMERA = fastibl.Camera(96, 72, 100.0, 100.0, 48.0, 36.0)
DOWN = fastibl.Pose(np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1.0], [0, 0, 0, 1]]))  # 1 m above the plane
GLOW = fastibl.Material(diffuse=(0, 0, 0), emission=(1, 1, 1))
DARK = fastibl.CubeMap(np.zeros((6, 1, 1, 3)))


def layer_of(mesh, camera=CAMERA, pose=DOWN, material=GLOW):
    """The whole picture's layer (h, w, 4) of an object that emits 1."""
    scene = fastibl.Scene(mesh, material, spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, fastibl.Rig(camera), environment=DARK)
    image = session.process(fastibl.Frame(0.0, back_from_marker=pose)).image
    assert image.shape == (camera.height, camera.width, 4)
    full = in_picture(session.object, camera)
    np.testing.assert_array_equal(full[..., 0], full[..., 3])  # colour is multiplied by coverage
    return full


def at_pixels(points, depth=1.0):
    """Marker-frame points whose pixels are these, `depth` metres below the camera of DOWN."""
    points = np.asarray(points, float)
    x, y = (points[:, 0] - 48) / 100 * depth, -(points[:, 1] - 36) / 100 * depth
    return np.stack([x, y, np.full(len(points), 1 - depth)], axis=-1)


def polygon_area(points):
    x, y = np.asarray(points, float).T
    return abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


def test_area_of_triangles_and_quads():
    rng = np.random.default_rng(0)
    ratios = []
    for _ in range(60):
        corners = rng.uniform((3, 3), (93, 69), (3, 2))
        area = polygon_area(corners)
        if area < 100:
            continue
        alpha = layer_of(fastibl.Mesh(at_pixels(corners), np.array([[0, 1, 2]])))[..., 3]
        assert set(np.unique(alpha * 4)) <= {0, 1, 2, 3, 4}
        perimeter = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum()
        assert abs(alpha.sum() - area) < 0.06 * perimeter
        ratios.append(alpha.sum() / area)
    print(f"{len(ratios)} triangles: covered {np.mean(ratios):.4f} of their area, spread {np.std(ratios):.4f}")
    assert len(ratios) > 30 and abs(np.mean(ratios) - 1) < 0.003
    quad = np.array([(20, 10), (70, 10), (70, 50), (20, 50)])
    alpha = layer_of(fastibl.Mesh(at_pixels(quad), np.array([[0, 1, 2], [0, 2, 3]])))[..., 3]
    expected = np.zeros((72, 96))
    expected[10:50, 20:70] = 1
    np.testing.assert_array_equal(alpha, expected)  # whole pixels: pixel centres lie at + 0.5


def test_half_a_pixel_is_half_covered():
    quad = np.array([(20.5, 10), (70.5, 10), (70.5, 50), (20.5, 50)])
    alpha = layer_of(fastibl.Mesh(at_pixels(quad), np.array([[0, 1, 2], [0, 2, 3]])))[..., 3]
    np.testing.assert_array_equal(alpha[20, [19, 20, 21, 69, 70, 71]], (0, 0.5, 1, 1, 0.5, 0))


@pytest.mark.parametrize("seed", range(6))
def test_shared_edges_cover_each_pixel_once(seed):
    """Triangles around points that lie anywhere, also exactly on samples: no cracks, and nothing twice."""
    rng = np.random.default_rng(seed)
    outer = np.array([(10.0, 8.0), (86.0, 8.0), (86.0, 64.0), (10.0, 64.0)])
    grid = [256, 8, 4, 2, 1, 1][seed]  # coarser grids put edges through samples
    middle = np.round(rng.uniform((20, 15), (76, 57)) * grid) / grid
    if seed == 5:
        middle = np.array([48.375, 36.125])  # exactly on a sample
    points = np.concatenate([outer, middle[None]])
    fan = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    fan[::2] = fan[::2, ::-1]  # either orientation
    depth = rng.uniform(0.8, 1.2)
    alpha = layer_of(fastibl.Mesh(at_pixels(points, depth), fan))[..., 3]
    expected = np.zeros((72, 96))
    expected[8:64, 10:86] = 1
    interior = expected.copy()
    interior[[8, 63], :] = interior[:, [10, 85]] = 0
    assert alpha.max() <= 1 and (alpha[interior == 1] == 1).all() and (alpha[expected == 0] < 0.5).all()
    # Each triangle by itself: their coverages add up to that of all.
    parts = sum(layer_of(fastibl.Mesh(at_pixels(points, depth), fan[k : k + 1]))[..., 3] for k in range(4))
    np.testing.assert_array_equal(parts, alpha)


def test_the_nearer_triangle_wins():
    near = at_pixels([(20, 10), (70, 10), (70, 50), (20, 50)], 0.9)
    far = at_pixels([(5, 5), (90, 5), (90, 66), (5, 66)], 1.0)
    two = np.array([[0, 1, 2], [0, 2, 3]])
    for order in (1, -1):
        triangles = np.concatenate([two, two + 4][::order])
        mesh = fastibl.Mesh(np.concatenate([near, far]), triangles)
        alpha = layer_of(mesh)[..., 3]
        assert alpha.max() == 1 and alpha.sum() == 85 * 61
    # What is seen in the middle is the near square: its mirror image of a marked sky tells its depth apart only by
    # its normal, so a tilted one is put behind.
    tilted = far.copy()
    tilted[:2, 2] -= 0.3
    mesh = fastibl.Mesh(np.concatenate([near, tilted]), np.concatenate([two + 4, two]))
    scene = fastibl.Scene(mesh, fastibl.Material(diffuse=(1, 1, 1)), spheres=0, visibility_rays=0)
    faces = np.zeros((6, 8, 8, 3))
    faces[4] = 1
    session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=fastibl.CubeMap(faces))
    session.process(fastibl.Frame(0.0, back_from_marker=DOWN))
    rgba = session.object.rgba
    alone = fastibl.Scene(fastibl.Mesh(near, two), fastibl.Material(diffuse=(1, 1, 1)), spheres=0, visibility_rays=0)
    other = fastibl.Session(alone, fastibl.Rig(CAMERA), environment=fastibl.CubeMap(faces))
    other.process(fastibl.Frame(0.0, back_from_marker=DOWN))
    y, x = 30 - session.object.y, 45 - session.object.x
    np.testing.assert_allclose(rgba[y, x], other.object.rgba[30 - other.object.y, 45 - other.object.x], atol=1e-6)


@pytest.mark.parametrize("distortion", [(), (-0.25, 0.06, 1e-3, -1e-3), (0.1, 0.0, 0.0, 0.0)])
def test_silhouette_is_that_of_rays(distortion):
    mesh = fastibl.shapes.figurine(0.12)
    camera = camera_of(160, 120, 45.0, distortion=distortion)
    bvh = fastibl.Bvh(mesh)
    worst = 1.0
    for eye in ((0.1, -0.25, 0.2), (-0.2, 0.1, 0.12), (0.02, -0.02, 0.4)):
        pose = looking(np.array([0.015, 0.01, 0.05]) - eye, eye)
        alpha = layer_of(mesh, camera, pose)[..., 3]
        rays = rays_of(camera, pose, split=2).astype(np.float32)
        origins = np.ascontiguousarray(np.broadcast_to(np.float32(eye), rays.shape))
        hit = bvh.nearest(origins, rays)[0] >= 0
        share = hit.reshape(120, 2, 160, 2).mean(axis=(1, 3))
        solid = (share == 0) | (share == 1)
        agree = ((alpha >= 0.5) == (share >= 0.5)).mean()
        worst = min(worst, agree)
        assert hit.mean() > 0.03
        assert (np.abs(alpha - share) < 0.51).mean() > 0.998
        assert ((alpha == share) | ~solid).mean() > 0.99
        assert abs(alpha.sum() / share.sum() - 1) < 0.01
    print(f"lens {distortion}: silhouettes agree on {100 * worst:.2f} % of the pixels")
    assert worst >= 0.995


@pytest.mark.filterwarnings("ignore:back_from_marker shows neither")
@pytest.mark.parametrize("distortion", [(), (-0.3, 0.0, 0.0, 0.0)])
def test_objects_partly_outside(distortion):
    """Half behind the camera, half out of the picture, around the camera, far outside: no crash, defined values."""
    mesh = fastibl.shapes.figurine(0.12, 0.95)
    camera = camera_of(96, 72, 60.0, distortion=distortion)
    eyes = [
        (0.0, -0.02, 0.06),
        (0.0, 0.0, 0.06),
        (0.0, -0.3, 0.06),
        (0.001, 0, 0.13),
        (0.0, -0.05, 0.06),
        (0, -1e6, 1e6),
    ]
    towards = [(0, 1, 0), (1, 0, 0), (0, 0, 1), (0, 0, -1), (1, 0.3, 0), (0.2, 1, -0.8)]
    for eye in eyes:
        for direction in towards:
            layer = layer_of(mesh, camera, looking(direction, eye))
            assert np.isfinite(layer).all() and layer.min() >= 0 and layer.max() <= 1


def test_what_is_out_of_the_picture_covers_nothing():
    away = looking((0, -1, 0.2), (0.0, -0.3, 0.1))
    assert not layer_of(fastibl.shapes.figurine(0.12, 0.95), CAMERA, away).any()
    corners = at_pixels([(-500, -500), (500, -500), (500, 500), (-500, 500)])
    alpha = layer_of(fastibl.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]])))[..., 3]
    assert (alpha == 1).all()  # a plane far beyond all edges covers everything
    huge = at_pixels([(-1e5, -1e5), (1e5, -1e5), (1e5, 1e5), (-1e5, 1e5)])
    assert (layer_of(fastibl.Mesh(huge, np.array([[0, 1, 2], [0, 2, 3]])))[..., 3] == 1).all()


def test_flat_triangles_cover_nothing():
    line = at_pixels([(10, 10), (50, 40), (90, 70)])
    assert not layer_of(fastibl.Mesh(line, np.array([[0, 1, 2]]))).any()


def test_both_sides_are_lit():
    """A sheet seen from its back is lit on the side that is seen."""
    faces = np.zeros((6, 8, 8, 3))
    faces[4] = 1  # light from above only
    quad = at_pixels([(20, 10), (70, 10), (70, 50), (20, 50)])
    values = []
    for triangles in ([[0, 1, 2], [0, 2, 3]], [[2, 1, 0], [3, 2, 0]]):
        scene = fastibl.Scene(
            fastibl.Mesh(quad, np.array(triangles)), fastibl.Material(diffuse=(1, 1, 1)), spheres=0, visibility_rays=0
        )
        session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=fastibl.CubeMap(faces))
        session.process(fastibl.Frame(0.0, back_from_marker=DOWN))
        values.append(session.object.rgba[20, 20, 0])
    assert values[0] == values[1] > 0.3


def test_one_pixel():
    camera = fastibl.Camera(1, 1, 1.0, 1.0, 0.5, 0.5)
    corners = np.array([(-5.0, -5, 0), (5, -5, 0), (0, 9, 0)])
    assert layer_of(fastibl.Mesh(corners, np.array([[0, 1, 2]])), camera)[0, 0, 3] == 1


def lit(mesh, pose, **options):
    """A matte object's layer in light that comes from everywhere and a bit more from above."""
    faces = np.full((6, 4, 4, 3), 1.0, np.float32)
    faces[4] = 3
    scene = fastibl.Scene(mesh, fastibl.Material(diffuse=(0.8, 0.6, 0.4)), spheres=0, **options)
    session = fastibl.Session(scene, fastibl.Rig(CAMERA), environment=fastibl.CubeMap(faces))
    session.process(fastibl.Frame(0.0, back_from_marker=pose))
    return in_picture(session.object, CAMERA)


def ball(radius, subdivisions=4):
    made = trimesh.creation.icosphere(subdivisions, radius)
    return fastibl.Mesh(made.vertices, made.faces, normals=made.vertices / radius)


def with_more(mesh, vertices, triangles):
    n = len(mesh.vertices)
    return fastibl.Mesh(np.vstack([mesh.vertices, vertices]), np.vstack([mesh.triangles, np.asarray(triangles) + n]))


def test_backs_of_a_closed_mesh_change_nothing():
    """With a triangle behind the camera the mesh is open and all of its backs are drawn: the picture stays."""
    made = trimesh.creation.torus(0.2, 0.08)
    torus = fastibl.Mesh(made.vertices, made.faces)
    behind = with_more(torus, [(0, 0, 3), (0.1, 0, 3), (0, 0.1, 3)], [(0, 1, 2)])
    options = {"refine": False, "visibility_rays": 0}
    for pose in (DOWN, looking((0.6, 0.5, 0.3), (0, 0, 0))):
        np.testing.assert_array_equal(lit(torus, pose, **options), lit(behind, pose, **options))


def test_parts_that_are_inside_out_stay_seen():
    right = ball(0.2)
    flipped = fastibl.Mesh(right.vertices, right.triangles[:, ::-1])
    there = lit(right, DOWN, visibility_rays=0)[..., 3]
    assert there.sum() > 500
    np.testing.assert_array_equal(lit(flipped, DOWN, visibility_rays=0)[..., 3], there)
    both = with_more(ball(0.05), right.vertices + (0.3, 0, 0), right.triangles[:, ::-1])
    assert lit(both, DOWN, visibility_rays=0)[..., 3].sum() > there.sum()


def test_from_inside_a_closed_mesh_its_backs_are_seen():
    assert (lit(ball(2.0), DOWN, visibility_rays=0)[..., 3] == 1).all()


MERGED = {
    "matte": fastibl.Material(diffuse=(0.8, 0.8, 0.8)),
    "glossy": fastibl.Material(diffuse=(0.3, 0.3, 0.3), glossy=(0.5, 0.5, 0.5), exponent=64),
    "sharp": fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.8, 0.8), exponent=2000),
    "metal": fastibl.Material.pbr((0.9, 0.7, 0.4), 1.0, 0.4),
}


@pytest.mark.parametrize("name", MERGED)
def test_what_hardly_differs_in_a_pixel_is_shaded_once_within_a_budget(name):
    """Along the edges of triangles: the layer is within two thousandths of what it is without a budget, where each of
    them is shaded by itself, and the same to the bit where the budget is too small for that."""
    camera = fastibl.Camera(320, 320, 1200.0, 1200.0, 160.0, 160.0)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    mesh = fastibl.Mesh(ball.vertices + (0, 0, 0.12), ball.faces)
    scene = fastibl.Scene(mesh, MERGED[name], spheres=0, visibility_rays=0)
    rng = np.random.default_rng(3)
    cube = fastibl.CubeMap(np.repeat(np.repeat(rng.uniform(0.1, 2, (6, 4, 4, 3)), 8, 1), 8, 2).astype(np.float32))
    methods = {"diffuse": "irradiance-cube", "glossy": "centroid"}
    layers = {}
    for error in (0, 0.004, 0.02):
        session = fastibl.Session(scene, fastibl.Rig(camera), environment=cube, methods=methods, error=error)
        session.process(fastibl.Frame(0.0, back_from_marker=DOWN))
        layers[error] = session.object.rgba
    np.testing.assert_array_equal(layers[0], layers[0.004])
    np.testing.assert_array_equal(layers[0][..., 3], layers[0.02][..., 3])
    seen = layers[0][..., 3] > 0
    off = np.abs(layers[0.02] - layers[0])[seen, :3].max(-1) / layers[0][seen, :3].mean()
    share = np.mean(off > 0)
    print(f"{name}: {off.mean():.1e} off in the mean, {off.max():.1e} at most, in {share:.0%} of the pixels")
    assert (name == "sharp" or share > 0.3) and off.mean() < 2e-4 and np.quantile(off, 0.99) < 2e-3


def _smooth_ring(radius=0.06, tube=0.015, around=24, sides=6):
    """A torus of few triangles, each of which bends its normals much."""
    a, b = np.meshgrid(np.arange(around), np.arange(sides), indexing="ij")
    x, y = 2 * np.pi * a / around, 2 * np.pi * b / sides
    out = radius + tube * np.cos(y)
    vertices = np.stack([out * np.cos(x), out * np.sin(x), 0.02 + tube * (1 + np.sin(y))], axis=-1).reshape(-1, 3)

    def at(i, j):
        return (i % around) * sides + j % sides

    quads = np.stack([at(a, b), at(a + 1, b), at(a + 1, b + 1), at(a, b + 1)], axis=-1).reshape(-1, 4)
    return fastibl.Mesh(vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def test_curved_triangles_are_shaded_at_each_sample():
    """A glossy tube of few triangles against the mean of 16 x 16 times as many pixels: shaded once a triangle and
    pixel, it is 14 % off."""
    d, _, _ = reference.samples(np.zeros((6, 64, 64, 3)))
    radiance = 0.3 + 0.2 * d[:, 2:] * np.ones(3)
    for axis in ((0.3, 0.4, 0.86), (-0.7, 0.1, 0.7)):
        radiance = radiance + (d @ axis / np.linalg.norm(axis) > 0.985)[:, None] * (20, 18, 15)
    environment = fastibl.CubeMap(radiance.reshape(6, 64, 64, 3))
    shiny = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.8, 0.8), exponent=64)
    scene = fastibl.Scene(_smooth_ring(), shiny, spheres=0, visibility_rays=0)
    eye = np.array([0.05, -0.25, 0.15])

    def draw(n):
        camera = fastibl.Camera(48 * n, 36 * n, 90.0 * n, 90.0 * n, 24.0 * n, 18.0 * n)
        session = fastibl.Session(scene, fastibl.Rig(camera), environment=environment)
        session.process(fastibl.Frame(0.0, back_from_marker=looking(np.array([0, 0, 0.03]) - eye, eye)))
        return in_picture(session.object, camera, np.float64)

    fine, few = 16, draw(1)
    many = draw(fine).reshape(36, fine, 48, fine, 4).mean(axis=(1, 3))
    inside = (many[..., 3] > 0.999) & (few[..., 3] == 1)
    error = np.sqrt(((few - many)[inside] ** 2).mean()) / many[inside].mean()
    print(f"{inside.sum()} pixels, {error:.2%} off")
    assert inside.sum() > 500 and error < 0.045
