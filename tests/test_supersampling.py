"""Pictures drawn larger and averaged."""

from functools import cache

import numpy as np
import pytest

import fastibl
from conftest import same_error
from fastibl.expected import present
from fastibl.gl_device import gl_device
from views import camera_of

DISTORTED = (-0.2, 0.05, 0.001, 0.002)
POSE = fastibl.Pose.look_at((0.3, -0.35, 0.25), (0.02, 0.0, 0.08))


def room():
    faces = np.full((6, 32, 32, 3), 0.3, np.float32)
    faces[:, :8] += np.float32([0.1, 0.2, 0.3])
    faces[4, 10:13, 16:19] += 40.0
    return fastibl.CubeMap(faces)


@cache
def scene_of():
    metal = fastibl.Material((0.1, 0.1, 0.1), (0.8, 0.7, 0.6), 100)
    wall = fastibl.Mesh([[0.05, -0.1, 0], [0.15, -0.1, 0], [0.1, -0.1, 0.15]], [[0, 1, 2]])
    scene = fastibl.Scene(fastibl.shapes.figurine(0.2), metal, spheres=1)
    scene.holdouts = [wall]
    return scene


def session_of(scene, camera, pose=POSE, **options):
    methods = {"diffuse": "irradiance-cube", "glossy": "stretched", "self_shadow": "transfer"}
    session = fastibl.Session(scene, fastibl.Rig(camera), environment=room(), methods=methods, **options)
    session.process(fastibl.Frame(0.0, back_from_marker=pose))
    return session


def whole(layer, camera):
    """A layer (h, w, 4) of the whole picture."""
    rgba = np.zeros((camera.height, camera.width, 4))
    h, w = layer.rgba.shape[:2]
    rgba[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba
    return rgba


def larger(camera, n):
    return camera.replace(
        width=n * camera.width,
        height=n * camera.height,
        fx=n * camera.fx,
        fy=n * camera.fy,
        cx=n * camera.cx,
        cy=n * camera.cy,
    )


def check_is_mean(camera, n, backend):
    if backend == "gl" and gl_device()[1]:
        pytest.skip(gl_device()[1])
    fine_camera = larger(camera, n)
    made = session_of(scene_of(), camera, supersampling=n, backend=backend)
    fine = session_of(scene_of(), fine_camera, backend=backend)
    for name in ("object", "holdout"):
        mean = whole(getattr(fine, name), fine_camera).reshape(camera.height, n, camera.width, n, 4).mean(axis=(1, 3))
        off = np.abs(whole(getattr(made, name), camera) - mean).max()
        print(f"{name}: {off:.1e} of {mean.max():.2f}")
        assert mean.max() > 0.2 and off < 2e-6 * mean.max()


@pytest.mark.parametrize("n, distortion", [(2, ()), (3, DISTORTED), (8, DISTORTED)])
def test_it_is_the_mean_of_a_larger_picture(n, distortion):
    """Also over the ends of the strips in which it is drawn: 8 times as large, this picture takes three."""
    check_is_mean(camera_of(256, 192, 60.0, distortion=distortion), n, "cpu")


@pytest.mark.parametrize("n, distortion", [(2, DISTORTED), (3, ())])
def test_it_is_the_mean_of_a_larger_picture_on_the_gpu(n, distortion):
    check_is_mean(camera_of(256, 192, 60.0, distortion=distortion), n, "gl")


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_an_object_that_reaches_beyond_the_picture(backend):
    check_is_mean(camera_of(64, 48, 12.0), 4, backend)


def test_both_back_ends_draw_the_same_picture():
    if gl_device()[1]:
        pytest.skip(gl_device()[1])
    camera = camera_of(96, 72, 40.0)
    back = np.full((72, 96, 3), 90, np.uint8)
    images = []
    for backend in ("cpu", "gl"):
        session = session_of(scene_of(), camera, supersampling=3, backend=backend)
        images.append(session.process(fastibl.Frame(0.1, back=back, back_exposure=1.0, back_from_marker=POSE)).image)
    off = np.abs(images[0].astype(int) - images[1])
    print(f"largest difference {off.max()}, mean {off.mean():.4f}")
    assert off.max() <= 3 and off.mean() < 0.02 and np.ptp(images[0]) > 100


def test_an_object_that_is_not_in_the_picture():
    away = fastibl.Pose.look_at((0.3, -0.35, 0.25), (0.6, -0.7, 0.5))
    session = session_of(scene_of(), camera_of(64, 48), away, supersampling=4)
    assert not present(session.object).rgba.any() and not present(session.holdout).rgba.any()


def test_a_shiny_object_is_less_wrong_at_the_price_of_its_samples():
    camera, scene = camera_of(160, 120, 40.0), scene_of()
    pictures, expected = {}, {}
    for n in (1, 2, 8):
        session = session_of(scene, camera, supersampling=n)
        pictures[n] = np.clip(whole(session.object, camera)[..., :3], 0, 1)
        second = session.process(fastibl.Frame(0.1, back_from_marker=POSE))  # the bill of what the first one showed
        expected[n] = next(p.milliseconds for p in second.plan.passes if p.name == "shade")
    true = pictures[8]
    where = true.max(axis=-1) > 0
    one, two = (np.sqrt(((pictures[n] - true)[where] ** 2).mean()) / true[where].mean() for n in (1, 2))
    print(f"4 samples a pixel: {one:.2%} off, 16: {two:.2%}; expected {expected[1]:.2f} and {expected[2]:.2f} ms")
    assert two < 0.6 * one
    assert expected[1] < expected[2] < expected[8] and expected[8] > 2 * expected[1]


def test_a_plan_of_one_picture_says_what_its_pixels_leave():
    """By the four samples alone, against 256. Without a camera nothing is known of pixels."""
    scene, ratios = scene_of(), []
    bare = fastibl.Scene(scene.mesh, scene.material, spheres=1)
    for size in ((96, 72), (320, 240)):
        camera = camera_of(*size, 40.0)
        plan = fastibl.make_plan(bare, room(), error=0.02, camera=camera, camera_from_marker=POSE, cast_shadow=False)
        pictures = [session_of(bare, camera, supersampling=n, cast_shadow=False) for n in (1, 8)]
        white = 0.3 / 0.35  # the plane, of radiance 0.3, lies at 0.35 of it
        one, true = (np.clip(whole(s.object, camera) / [white, white, white, 1], 0, 1).astype(float) for s in pictures)
        over = [layer[..., :3] + (1 - layer[..., 3:]) * 0.35 for layer in (one, true)]
        where = (one[..., 3] > 0) | (true[..., 3] > 0)
        measured = np.sqrt(((over[0] - over[1])[where] ** 2).mean()) / over[1][where].mean()
        print(f"{size}: {measured:.2%}, stated {plan.sampling_error:.2%}")
        ratios.append(plan.sampling_error / measured)
        assert f"four samples a pixel leave {100 * plan.sampling_error:.2g} %" in str(plan)
    assert 0.6 < min(ratios) and max(ratios) < 1.7
    assert fastibl.make_plan(bare, room(), error=0.02).sampling_error is None


@pytest.mark.parametrize("n", [0, -1, 9])
def test_numbers_out_of_range_are_refused(n):
    camera = camera_of()
    same_error(
        lambda: fastibl.Session(scene_of(), fastibl.Rig(camera), environment=room(), supersampling=n),
        ValueError,
        "supersampling",
        str(n),
    )
