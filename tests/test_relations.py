"""Two inputs of the same meaning give the same result: no oracle is needed for that."""

import numpy as np
import pytest
from scenes import scene_of

import fastibl
from fastibl.extremes.views import camera_of, looking
from fastibl.extremes.worlds import ball_mesh, box_mesh

CAMERA = camera_of(96, 72, 60.0)
POSE = looking((-0.1, 0.3, -0.16), (0.1, -0.3, 0.2))
BACK = np.random.default_rng(3).integers(20, 200, (72, 96, 3)).astype(np.uint8)
METHODS = {"diffuse": "irradiance-cube", "glossy": "stretched", "shadow": "mesh"}
TEAL = fastibl.Material((0.3, 0.4, 0.2), (0.4, 0.5, 0.3), 60)


def faces(size=16):
    """Uneven light: a sky, a sun and a coloured lamp, and noise so that no two texels are alike."""
    d = fastibl.texel_directions(size)
    light = 0.1 + np.clip(d @ np.float32([0.3, 0.5, 0.8]), 0, 1)[..., None] * np.float32([0.4, 0.6, 0.9])
    for towards, cosine, radiance in (((0.5, -0.3, 0.8), 0.98, (60, 50, 35)), ((-0.9, 0.2, 0.35), 0.95, (3, 9, 14))):
        light[d @ np.float32(towards) > cosine] = radiance
    return light * (0.8 + 0.4 * np.random.default_rng(0).random(light.shape).astype(np.float32))


FACES = faces()


def lump(scale=1.0):
    """A ball with dents, of which no two sides are alike; it stands on the plane."""
    mesh = ball_mesh(steps=12)
    v = mesh.vertices.astype(np.float64)
    v = (v - v.mean(axis=0)) / np.abs(v - v.mean(axis=0)).max()
    v *= (1 + 0.3 * np.sin(3 * v[:, 0] + 1) * np.cos(2 * v[:, 1] - v[:, 2]) + 0.25 * v[:, 0] * v[:, 2])[:, None]
    v *= 0.05
    return fastibl.Mesh((v - [0, 0, v[:, 2].min()]) * scale, mesh.triangles)


def drawn(
    mesh=None,
    light=FACES,
    material=TEAL,
    camera=CAMERA,
    pose=POSE,
    back=BACK,
    exposure=1.0,
    backend="cpu",
    standing=None,
    holdouts=(),
):
    """The picture, and the object alone as the camera takes it."""
    environment = fastibl.CubeMap(light) if isinstance(light, np.ndarray) else light
    scene = scene_of(mesh or lump(), material, standing)
    scene.holdouts = holdouts
    try:
        session = fastibl.Session(scene, fastibl.Rig(camera), environment=environment, methods=METHODS, backend=backend)
    except RuntimeError as error:
        pytest.skip(f"no GL context: {error}")
    result = session.process(fastibl.Frame(0.0, back=back, back_exposure=exposure, back_from_marker=pose))
    return result.image, session.layers.object


def same(one, other, most=1, light=2e-4):
    """Pictures that differ by `most` of 255, and objects whose light differs by this share of its mean (RMS)."""
    (image, rgba), (other_image, other_rgba) = one, other
    off = np.abs(image.astype(int) - other_image).max()
    mean = rgba[..., :3].mean() / (rgba[..., 3] > 0).mean()
    rms = np.sqrt(((rgba - other_rgba)[..., :3] ** 2).mean()) / mean
    print(f"off by {off} of 255, {rms:.1e} of the light")
    assert off <= most and rms <= light
    assert np.abs(rgba - other_rgba)[..., 3].max() < 1e-3


@pytest.fixture(scope="module", params=["cpu", "gl"])
def backend(request):
    if request.param == "gl" and not fastibl.session.with_gl:
        pytest.skip("built without the GL back end")
    return request.param


@pytest.fixture(scope="module")
def plain(backend):
    return drawn(backend=backend)


def test_light_and_exposure(plain, backend):
    """Twice the light at half the exposure is the same picture, bit for bit."""
    for power in (-12, 20):
        image, rgba = drawn(light=FACES * np.float32(2.0**power), exposure=2.0**-power, backend=backend)
        np.testing.assert_array_equal(image, plain[0])
        np.testing.assert_array_equal(rgba, plain[1])


@pytest.mark.parametrize("scale", [1e-3, 1000.0])
def test_metres(plain, backend, scale):
    """A ring of 0.1 mm and a tower of 100 m look like the lump of 10 cm."""
    pose = np.array(POSE.matrix)
    pose[:3, 3] *= scale
    same(plain, drawn(lump(scale), pose=fastibl.Pose(pose), backend=backend))


def test_channels(plain, backend):
    """Colours are lit each by itself."""
    order = [2, 0, 1]
    material = fastibl.Material(np.array(TEAL.diffuse)[order], np.array(TEAL.glossy)[order], TEAL.exponent)
    image, rgba = drawn(light=FACES[..., order], material=material, back=BACK[..., order], backend=backend)
    np.testing.assert_array_equal(image, plain[0][..., order])
    np.testing.assert_array_equal(rgba, plain[1][..., [*order, 3]])


def test_a_crop(plain, backend):
    """A part of the picture is the picture of a camera with a smaller sensor."""
    x, y, w, h = 19, 11, 60, 50
    camera = fastibl.Camera(w, h, CAMERA.fx, CAMERA.fy, CAMERA.cx - x, CAMERA.cy - y)
    part = drawn(camera=camera, back=BACK[y : y + h, x : x + w], backend=backend)
    same(tuple(p[y : y + h, x : x + w] for p in plain), part)


def test_the_order_of_a_mesh(plain, backend):
    mesh, rng = lump(), np.random.default_rng(1)
    order = rng.permutation(len(mesh.vertices))
    turned = np.array([np.roll(t, k % 3) for k, t in enumerate(np.argsort(order)[mesh.triangles])])
    shuffled = fastibl.Mesh(mesh.vertices[order], turned[rng.permutation(len(turned))])
    same(plain, drawn(shuffled, backend=backend), light=5e-4)


@pytest.mark.parametrize("far", [0.5, 100.0])
def test_vertices_that_no_triangle_uses(plain, backend, far):
    """They are no part of the object, however far off they lie."""
    mesh = lump()
    more = fastibl.Mesh(np.append(mesh.vertices, np.float32([[0, far / 2, far]]), axis=0), mesh.triangles)
    same(plain, drawn(more, backend=backend))
    if backend == "cpu" and far > 1:
        leaning = fastibl.Pose.from_rotation_vector((0.5, 0.2, 0.0), (0.0, 0.0, 0.02))
        same(drawn(mesh, standing=leaning), drawn(more, standing=leaning))
        np.testing.assert_array_equal(fastibl.fit_spheres(more, 8), fastibl.fit_spheres(mesh, 8))
        np.testing.assert_array_equal(fastibl.ambient_occlusion(more)[:-1], fastibl.ambient_occlusion(mesh))
        assert fastibl.MeshShadow(more).extent == fastibl.MeshShadow(mesh).extent
        np.testing.assert_array_equal(fastibl.stand(more, 0.2).vertices[:-1], fastibl.stand(mesh, 0.2).vertices)


def test_real_objects(backend):
    """Their order, and which way a closed one's triangles run, say nothing."""
    corners, sides = box_mesh(0.06)
    near, beside = corners + (0.05, -0.1, 0), corners * (0.5, 0.5, 1) + (-0.07, -0.03, 0)
    order = drawn(holdouts=[fastibl.Mesh(near, sides), fastibl.Mesh(beside, sides)], backend=backend)
    other = drawn(holdouts=[fastibl.Mesh(beside, sides[:, ::-1]), fastibl.Mesh(near, sides[::-1])], backend=backend)
    same(order, other)
    assert np.abs(order[0].astype(int) - drawn(backend=backend)[0]).max() > 50


def test_a_marker_that_is_turned(plain, backend):
    """The same board, object, light and camera, all told in a frame turned by a right angle. The cells of the sky in
    which shadows are baked do not turn with it."""
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mesh = lump()
    pose = np.array(POSE.matrix)
    pose[:3, :3] = pose[:3, :3] @ turn.T
    light = fastibl.CubeMap(FACES)
    directions = fastibl.texel_directions(16).astype(np.float64) @ turn
    turned = drawn(
        fastibl.Mesh(mesh.vertices @ turn.T, mesh.triangles),
        light.sample(directions),
        pose=fastibl.Pose(pose),
        backend=backend,
    )
    same(plain, turned, most=8, light=1e-3)


@pytest.fixture(scope="module")
def film():
    made = fastibl.simulate(seed=1, seconds=1.0, fps=6, size=(160, 120), truth_size=16, hand=False)
    return made.rig, made.board, [(frame, made.truth.pose(frame.time)) for frame in made]


def captured(film, scale=1.0, tint=1.0, **options):
    """A capture of the film with all its metres times `scale`. tint: of the exposure, the part that is told as tint."""
    rig, board, frames = film
    tags = [(tag.id, tag.corners * scale) for tag in board.tags]
    board = fastibl.Board(tags, board.width * scale, board.height * scale, board.border_bits)
    capture = fastibl.Capture(32, board, (0, 0, 0.05 * scale), **options)
    for frame, back_from_marker in frames:
        for camera, picture, exposure, pose in (
            (rig.back, frame.back, frame.back_exposure, back_from_marker),
            (rig.front, frame.front, frame.front_exposure, rig.front_from_back @ back_from_marker),
        ):
            moved = np.array(pose.matrix)
            moved[:3, 3] *= scale
            capture.add(picture, camera, moved, exposure / tint, frame.time, tint=(tint,) * 3)
    return capture.environment()


@pytest.mark.parametrize("tint", [0.125, 4.0])
def test_a_tint_without_colour_is_exposure(film, tint):
    """A front camera that is four times as bright may say so by its exposure or by its ratio to the back camera."""
    exposure, told = captured(film), captured(film, tint=tint)
    np.testing.assert_array_equal(told.radiance.faces, exposure.radiance.faces)
    np.testing.assert_array_equal(told.confidence, exposure.confidence)


@pytest.mark.parametrize("scale", [4.0, 20.0])
def test_a_large_board(film, scale):
    """Boards of 1.2 and 6 m, as seen from as many times farther off: their white and what lies around them."""
    page, poster = captured(film, distance=np.inf), captured(film, scale, distance=np.inf)
    seen = page.confidence > 0
    np.testing.assert_array_equal(poster.confidence > 0, seen)
    np.testing.assert_allclose(poster.radiance.faces[seen], page.radiance.faces[seen], rtol=1e-5)
    off = np.abs(np.divide(poster.plane_irradiance, page.plane_irradiance) - 1).max()
    print(f"the board's white reads {100 * off:.1f} % off")
    assert off < 0.02
