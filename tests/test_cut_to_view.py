"""What reaches behind the camera, or beyond its lens, keeps the part that is seen: against rays through the samples."""

import numpy as np
import pytest
from test_gl import HALF_ERROR, needs_gl

import fastibl
from conftest import in_picture
from views import camera_of, looking

# Parts of what is drawn are seen: no pose is doubted.
pytestmark = pytest.mark.filterwarnings("error:back_from_marker shows neither")

BACKENDS = ["cpu", pytest.param("gl", marks=needs_gl)]
LENSES = [(), (-0.25, 0.05, 0.001, -0.002), (0.2, 0.1, 0, 0), (-0.6, 0, 0, 0)]  # the last ends within the picture
DARK = fastibl.CubeMap(np.zeros((6, 1, 1, 3)))
SIZE = 30.0  # metres, half of the floor's side
SAMPLES = np.array([(96, 32), (224, 96), (32, 160), (160, 224)]) / 256
VIEWS = [
    ((0.0, 0.0, 1.0), (0.0, 1.0, -0.2)),
    ((3.0, 2.0, 0.4), (1.0, 1.0, -0.6)),
    ((0.0, 0.0, 2.0), (0.3, 0.2, -1.0)),
    ((1.0, 1.0, 0.05), (0.0, 1.0, -0.02)),
]


def grid(corners, uvs, steps=1):
    """A quad in steps x steps squares."""
    s, t = np.meshgrid(*2 * [np.linspace(0, 1, steps + 1)])
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], -1).reshape(-1, 4)
    a = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).ravel()
    quads = np.stack([a, a + 1, a + steps + 2, a + steps + 1], 1)
    return fastibl.Mesh(
        weights @ np.array(corners, float),
        np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
        uvs=weights @ np.array(uvs, float),
    )


def floor(steps=1):
    corners = [(-SIZE, -SIZE, 0), (SIZE, -SIZE, 0), (SIZE, SIZE, 0), (-SIZE, SIZE, 0)]
    return grid(corners, [(0, 0), (1, 0), (1, 1), (0, 1)], steps)


def with_place():
    """Emits its place on the texture: red u, green v, from the second texel to the last but one."""
    place = (np.arange(256) + 0.5) / 256
    image = np.zeros((256, 256, 3), np.float32)
    image[..., 0], image[..., 1] = place, place[::-1, None]
    return fastibl.Material.pbr(base_color=(0, 0, 0), emission=image)


def shown(mesh, material, camera, pose, backend, environment=DARK):
    """The whole picture's layer (h, w, 4)."""
    scene = fastibl.Scene(mesh, material, spheres=0, visibility_rays=0, refine=False)
    session = fastibl.Session(
        scene, fastibl.Rig(camera), environment=environment, backend=backend, methods={"self_shadow": "none"}
    )
    session.process(fastibl.Frame(0.0, back_from_marker=pose))
    return in_picture(session.object, camera)


def rays_through(camera, pose, samples):
    """Directions (h, w, samples, 3), marker frame, NaN beyond the lens model; and the eye."""
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([x, y], -1)[:, :, None, :] + samples
    return camera.unproject(pixels) @ pose.rotation, pose.inverse().translation


def on_floor(camera, pose, samples):
    """Whether each ray (h, w, samples) meets the floor, and where in its uvs."""
    rays, eye = rays_through(camera, pose, samples)
    with np.errstate(invalid="ignore", divide="ignore"):
        at = eye[:2] - rays[..., :2] * (eye[2] / rays[..., 2:])
        hit = (rays[..., 2] < 0) & (np.abs(at) < SIZE).all(axis=-1)
    return hit, at / (2 * SIZE) + 0.5


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("lens", LENSES, ids=str)
def test_a_floor_that_the_camera_stands_on(lens, backend):
    """Two triangles of 30 m, of which at least two corners are behind the camera."""
    camera = camera_of(192, 144, 70.0, distortion=lens)
    for eye, direction in VIEWS:
        pose = looking(direction, eye)
        layer = shown(floor(), with_place(), camera, pose, backend)
        hit, _ = on_floor(camera, pose, SAMPLES)
        off = np.abs(layer[..., 3] - hit.mean(axis=2))
        _, place = on_floor(camera, pose, np.array([(0.5, 0.5), (1.5, 0.5), (0.5, 1.5)]))
        pixel = np.abs(place[:, :, 1:] - place[:, :, :1]).max(axis=(2, 3))  # wide on the texture
        inner = (layer[..., 3] == 1) & hit.all(axis=2) & np.isfinite(pixel)
        inner &= np.abs(place[:, :, 0] - 0.5).max(axis=-1) < 0.45
        error = np.abs(layer[..., :2] - place[:, :, 0]).max(axis=-1)
        if backend == "gl":  # textures are stored in half floats
            error = np.maximum(error - HALF_ERROR, 0)
        error = (error / pixel)[inner]
        print(
            f"{backend}, lens {lens}, from {eye}: {hit.mean():.3f} covered, {(off > 0).mean():.5f} of the pixels "
            f"differ; place off by {np.percentile(error, 99):.4f} pixels in one of 100, {error.mean():.4f} in the mean"
        )
        assert hit.mean() > 0.2 and inner.sum() > 500
        assert (off > 0).mean() < (0.01 if lens else 0.001) and (off > 0.5).mean() < 0.001
        assert np.percentile(error, 99) < 0.5 and error.mean() < 0.1


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("lens", LENSES[:3], ids=str)
def test_a_room_around_the_camera_has_no_cracks(lens, backend):
    """Twelve triangles, and the same at random in many: every sample of every picture sees one of them."""
    corners = np.array([(x, y, z) for x in (-2.0, 3.0) for y in (-1.5, 2.5) for z in (0.0, 2.2)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    rng = np.random.default_rng(3)
    rooms = []
    for inner in (0, 4, 30):
        vertices, triangles = list(corners), []
        for quad in quads:
            pieces = [(quad[0], quad[1], quad[2]), (quad[0], quad[2], quad[3])]
            for _ in range(inner):  # a point within one of the pieces so far
                a, b, c = pieces.pop(rng.integers(len(pieces)))
                vertices.append(rng.dirichlet((1, 1, 1)) @ np.array([vertices[a], vertices[b], vertices[c]]))
                n = len(vertices) - 1
                pieces += [(a, b, n), (b, c, n), (c, a, n)]
            triangles += pieces
        rooms.append(fastibl.Mesh(np.array(vertices), np.array(triangles)))
    camera = camera_of(160, 120, 75.0, distortion=lens)
    glow, open_samples = fastibl.Material(diffuse=(0, 0, 0), emission=(1, 1, 1)), []
    for room in rooms:
        for _ in range(12):
            pose = looking(rng.normal(size=3), rng.uniform((-1.5, -1, 0.3), (2.5, 2, 1.9)))
            layer = shown(room, glow, camera, pose, backend)
            np.testing.assert_array_equal(layer[..., 0], layer[..., 3])
            open_samples.append(int((4 * (1 - layer[..., 3])).sum()))
    print(f"{backend}, lens {lens}: of {len(open_samples)} pictures' samples at most {max(open_samples)} see nothing")
    assert max(open_samples) == 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_light_shares_and_normals_go_on_over_the_cut(backend):
    """A matte floor under light from one side: two triangles are lit as 2500 that hardly reach behind the camera."""
    faces = np.full((6, 8, 8, 3), 0.5, np.float32)
    faces[0] = 4
    camera = camera_of(160, 120, 70.0)
    material = fastibl.Material(diffuse=(0.6, 0.5, 0.4), glossy=(0.3, 0.3, 0.3), exponent=4)
    pose = looking((0.1, 1, -0.35), (0, -0.5, 1.2))

    def lit(steps):
        mesh = floor(steps)
        tilted = np.array(mesh.vertices) / SIZE * (0.4, 0.4, 0) + (0, 0, 1)
        mesh = fastibl.Mesh(mesh.vertices, mesh.triangles, normals=tilted / np.linalg.norm(tilted, axis=1)[:, None])
        return shown(mesh, material, camera, pose, backend, fastibl.CubeMap(faces))

    few, many = lit(1), lit(50)
    both = (few[..., 3] == 1) & (many[..., 3] == 1)
    error = np.abs(few - many)[both][:, :3]
    print(f"{backend}: {both.mean():.2f} of the picture, off by {error.max():.5f} of {many[both].mean():.3f}")
    assert both.mean() > 0.4 and np.ptp(many[both][:, 0]) > 0.1
    assert error.max() < 0.002


def through_box(lower, upper, rays, eye):
    """Whether rays (h, w, samples, 3) meet a box: slabs."""
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = (lower - eye) / rays, (upper - eye) / rays
        return np.minimum(a, b).max(axis=-1) < np.maximum(a, b).min(axis=-1)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("lens", LENSES[1:], ids=str)
def test_long_edges_are_bent_as_the_lens_bends_them(lens, backend):
    """A box of twelve triangles, all in view: drawn straight, its edges lie some pixels off."""
    lower, upper = np.array([-0.1, -0.06, 0]), np.array([0.1, 0.06, 0.15])
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    box = fastibl.Mesh(lower + corners * (upper - lower), triangles)
    camera = camera_of(320, 240, 75.0, distortion=lens)
    glow = fastibl.Material(diffuse=(0, 0, 0), emission=(1, 1, 1))
    for eye, at in (
        ((0.25, -0.2, 0.2), (0, 0, 0.07)),
        ((0.02, -0.3, 0.1), (0.1, 0, 0.02)),
        ((0, 0.01, 0.45), (0, 0, 0)),
    ):
        pose = looking(np.subtract(at, eye), eye)
        rays, place = rays_through(camera, pose, SAMPLES)
        true = through_box(lower, upper, rays, place).mean(axis=2)
        off = np.abs(shown(box, glow, camera, pose, backend)[..., 3] - true)
        edge = (true > 0) & (true < 1)
        print(
            f"{backend}, lens {lens}, from {eye}: off by {off.sum():.1f} pixels in all, at most {off.max():.2f}; "
            f"{edge.sum()} pixels of the outline, {true.mean():.2f} covered"
        )
        assert edge.sum() > 200
        assert off.sum() < 0.12 * edge.sum() and (off == 1).sum() == 0
