"""Cameras, their responses, and poses: lens models against OpenCV, round trips, what is refused."""

import copy
import pickle

import cv2
import numpy as np
import pytest

import fastibl
from conftest import same_error, units

SIZE = 640, 480
RATIONAL = (0.12, -0.35, 2e-4, -3e-4, 0.05, 0.3, -0.4, 0.02)
LENSES = {
    "none": (),
    "barrel": (-0.3, 0.0, 0.0, 0.0),
    "pincushion": (0.1, 0.0, 0.0, 0.0),
    "five": (-0.28, 0.09, 1e-3, -5e-4, -0.01),
    "rational": RATIONAL,
}


def camera_with(distortion=(), **others):
    return fastibl.Camera(*SIZE, 500.0, 510.0, 322.0, 238.0, distortion=distortion, **others)


def pixel_grid(step=8.0):
    x, y = np.meshgrid(np.arange(0, SIZE[0] + 1, step), np.arange(0, SIZE[1] + 1, step))
    return np.stack([x, y], axis=-1)


@pytest.mark.parametrize("name", LENSES)
def test_project_undoes_unproject(name):
    camera = camera_with(LENSES[name])
    pixels = pixel_grid()
    if name == "barrel":  # grows up to r = 1 / sqrt(0.9); no direction meets pixels further out
        radius = np.hypot((pixels[..., 0] - camera.cx) / camera.fx, (pixels[..., 1] - camera.cy) / camera.fy)
        reached = radius < 2 / 3 / np.sqrt(0.9) - 1e-5
        assert np.isnan(camera.unproject(pixels[radius > 2 / 3 / np.sqrt(0.9) + 1e-5])).all() and not reached.all()
        pixels = pixels[reached][None]
    rays = camera.unproject(pixels)
    assert np.isfinite(rays).all() and (rays[..., 2] == 1).all()
    error = np.abs(camera.project(rays * np.linspace(0.1, 30, 3)[:, None, None, None]) - pixels).max()
    print(f"{name}: project(unproject(pixel)) within {error:.1e} px")
    assert error < 1e-6


@pytest.mark.parametrize("name", LENSES)
def test_projection_is_that_of_opencv(name):
    camera = camera_with(LENSES[name])
    points = camera.unproject(pixel_grid(40.0)).reshape(-1, 3) * 0.7
    points = points[np.isfinite(points[:, 0])]
    distortion = np.array(LENSES[name] or (0.0,) * 4)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.opencv_matrix, distortion)
    error = np.abs(camera.project(points) - (expected[:, 0] + 0.5)).max()
    print(f"{name}: within {error:.1e} px of cv2.projectPoints")
    assert error < 1e-6


def test_a_lens_does_not_fold():
    """k1 = -0.3 stops growing at 46.5 degrees; OpenCV's model would put 61 degrees onto the centre."""
    camera = camera_with((-0.3, 0.0, 0.0, 0.0))
    angle = np.radians(np.arange(0, 90, 0.25))
    for turn in np.radians(np.arange(0, 360, 30)):
        ray = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=-1)
        pixels = camera.project(ray)
        seen = np.isfinite(pixels).all(axis=-1)
        assert seen[np.degrees(angle) < 46.2].all() and not seen[np.degrees(angle) > 46.8].any()
        radius = np.hypot(*(pixels[seen] - (camera.cx, camera.cy)).T)
        assert (np.diff(radius) > 0).all()
    folded = np.array([np.sin(np.radians(61.3)), 0, np.cos(np.radians(61.3))])
    assert np.isnan(camera.project(folded)).all()
    assert abs(cv2.projectPoints(folded[None], np.zeros(3), np.zeros(3), camera.opencv_matrix,
                                 np.array(camera.distortion))[0][0, 0, 0] - 321.5) < 6  # fmt: skip
    assert np.isnan(camera.unproject(np.array([2000.0, 238.0]))).all()  # no direction meets this pixel
    assert np.isnan(camera.unproject(np.array([np.nan, 238.0]))).any()


def test_behind_the_camera_is_nowhere():
    camera = camera_with()
    assert np.isnan(camera.project(np.array([[0.1, 0.1, -1], [0.1, 0.1, 0], [np.nan, 0, 1]]))[:2]).all()
    np.testing.assert_allclose(camera.project(np.array([0.0, 0.0, 2.0])), (322, 238))


def test_opencv_counts_from_the_middle_of_a_pixel():
    K = np.array([[500.0, 0, 321.5], [0, 510.0, 237.5], [0, 0, 1]])
    camera = fastibl.Camera.from_opencv(K, RATIONAL, SIZE)
    assert (camera.cx, camera.cy) == (322.0, 238.0)
    assert camera == camera_with(RATIONAL)
    np.testing.assert_array_equal(camera.opencv_matrix, K)


def test_cameras_are_values():
    camera = camera_with(RATIONAL, response=fastibl.Response.gamma(2.2), gain=1.5, vignetting=(-0.2, 0.01))
    assert pickle.loads(pickle.dumps(camera)) == camera == copy.deepcopy(camera)
    assert camera != camera_with(RATIONAL)
    assert camera.distortion == RATIONAL and camera.vignetting == (-0.2, 0.01) and camera.gain == 1.5


def test_what_is_no_camera_is_refused():
    good = dict(width=64, height=48, fx=50.0, fy=50.0, cx=32.0, cy=24.0)

    def make(**changed):
        return lambda: fastibl.Camera(**{**good, **changed})

    make()()
    same_error(make(width=0), ValueError, "1 × 1", "0 × 48")
    same_error(make(height=-1), ValueError, "64 × -1")
    same_error(make(fx=0.0), ValueError, "focal", "0")
    same_error(make(fy=float("nan")), ValueError, "focal", "nan")
    same_error(make(fx=float("inf")), ValueError, "focal", "inf")
    same_error(make(cx=float("nan")), ValueError, "principal point", "nan")
    same_error(make(distortion=(0.1,) * 3), ValueError, "0, 4, 5 or 8", "3")
    same_error(make(distortion=(0.1, 0.0, float("inf"), 0.0)), ValueError, "distortion", "inf")
    same_error(make(vignetting=(float("nan"),)), ValueError, "vignetting")
    same_error(make(gain=0.0), ValueError, "gain", "0")
    same_error(make(gain=float("inf")), ValueError, "gain", "inf")
    same_error(lambda: fastibl.Camera.from_opencv(np.eye(4), (), (4, 4)), ValueError, "(3, 3)", "(4, 4)")
    skewed = np.array([[30.0, 5, 2], [0, 30, 2], [0, 0, 1]])
    same_error(lambda: fastibl.Camera.from_opencv(skewed, (), (4, 4)), ValueError, "skew of 5")
    same_error(lambda: fastibl.Camera.from_opencv(2 * np.eye(3), (), (4, 4)), ValueError, "[0, 0, 1]")
    same_error(lambda: fastibl.Camera.from_opencv(np.eye(3, dtype=int), (), (4, 4)), TypeError, "floats", "int64")
    camera = fastibl.Camera(**good)
    same_error(lambda: camera.project(np.ones((4, 2))), ValueError, "(..., 3)", "(4, 2)")
    same_error(lambda: camera.unproject(np.ones((4, 3))), ValueError, "(..., 2)", "(4, 3)")
    same_error(lambda: camera.project(np.ones((4, 3), int)), TypeError, "floats")
    turned = fastibl.Rig(camera, camera, fastibl.Pose.from_rotation_vector([0, 3, 0], [0, 0, 0.01]))
    for rig in (turned, fastibl.Rig(camera)):
        assert pickle.loads(pickle.dumps(rig)) == rig == copy.deepcopy(rig)
    same_error(lambda: fastibl.Rig(camera, camera), ValueError, "both front and front_from_back")
    same_error(lambda: fastibl.Rig(camera, None, np.eye(4)), ValueError, "both front and front_from_back")


CURVE = np.array([0, 0.01, 0.05, 0.2, 0.45, 0.8, 1.0])
RESPONSES = {
    "srgb": fastibl.Response.srgb(),
    "gamma": fastibl.Response.gamma(2.2),
    "linear": fastibl.Response.gamma(1.0),
    "steep": fastibl.Response.gamma(3.5),
    "curve": fastibl.Response.from_curve(CURVE),
    "video": fastibl.Response.srgb().between(16 / 255, 235 / 255),
}


def srgb(encoded):
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("name", RESPONSES)
def test_response_round_trip(name):
    response = RESPONSES[name]
    encoded = np.linspace(0, 1, 4097)
    linear = response.decode(encoded)
    assert linear[0] == 0 and linear[-1] == 1 and (np.diff(linear) >= 0).all()
    kept = encoded.clip(response.black, response.white)
    error = np.abs(response.encode(linear) - kept).max()
    print(f"{name}: encode(decode(e)) within {error:.1e}")
    assert error < 2e-6
    expected = {
        "srgb": srgb(encoded),
        "gamma": encoded**2.2,
        "linear": encoded,
        "steep": encoded**3.5,
        "curve": np.interp(encoded, np.linspace(0, 1, len(CURVE)), CURVE),
        "video": srgb(((255 * encoded - 16) / 219).clip(0, 1)),
    }[name]
    np.testing.assert_allclose(linear, expected, atol=2e-6)
    ends = np.float32([response.black, response.white])
    np.testing.assert_array_equal(response.encode(np.array([-1, np.nan, 2.0, np.inf])), ends[[0, 0, 1, 1]])
    np.testing.assert_allclose(ends, (16 / 255, 235 / 255) if name == "video" else (0, 1), atol=1e-7)
    np.testing.assert_array_equal(response.decode(np.array([-1, 2.0])), (0, 1))
    assert pickle.loads(pickle.dumps(response)) == response


def test_what_is_no_response_is_refused():
    same_error(lambda: fastibl.Response.gamma(0.0), ValueError, "gamma", "0")
    same_error(lambda: fastibl.Response.gamma(float("nan")), ValueError, "gamma", "nan")
    same_error(lambda: fastibl.Response.from_curve(np.array([0.0])), ValueError, "at least 2", "1")
    same_error(lambda: fastibl.Response.from_curve(np.array([0.1, 1])), ValueError, "0 to 1", "0.1")
    same_error(lambda: fastibl.Response.from_curve(np.array([0, 0.9])), ValueError, "0 to 1", "0.9")
    same_error(lambda: fastibl.Response.from_curve(np.array([0, 0.5, 0.5, 1])), ValueError, "increase", "at 2")
    same_error(lambda: fastibl.Response.from_curve(np.array([0, np.nan, 1])), ValueError, "increase")
    for black, white in ((0.5, 0.5), (-0.1, 1), (0, 1.1), (float("nan"), 1), (0.1, 0.1001)):
        same_error(lambda b=black, w=white: fastibl.Response.srgb().between(b, w), ValueError, "levels", str(black))
    assert fastibl.Response.srgb().between(0, 1) == fastibl.Response.srgb()
    same_error(lambda: fastibl.Response.srgb().decode(np.array([1, 2])), TypeError, "floats", "int64")


def every_code(height=48, width=64):
    codes = (np.arange(height * width) % 256).astype(np.uint8).reshape(height, width)
    return np.stack([codes, codes[::-1], 255 - codes], axis=-1)


def lit_quad(emission=(0.0, 0.0, 0.0)):
    """A square of 4 cm, standing 1 cm above the plane, that only emits."""
    vertices = np.array([[-0.02, -0.02, 0.01], [0.02, -0.02, 0.01], [0.02, 0.02, 0.01], [-0.02, 0.02, 0.01]])
    material = fastibl.Material(diffuse=(0, 0, 0), emission=emission)
    return fastibl.Scene(fastibl.Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]])), material, spheres=0)


LOOKING_DOWN = fastibl.Pose(np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.3], [0, 0, 0, 1]]))


@pytest.mark.parametrize("name", RESPONSES)
def test_bytes_survive_the_composite(name):
    """Where nothing covers a pixel its byte comes out; a covered one encodes to the code whose light it emits."""
    camera = fastibl.Camera(64, 48, 60.0, 60.0, 32.0, 24.0, response=RESPONSES[name])
    session = fastibl.Session(lit_quad(), fastibl.Rig(camera), environment=fastibl.CubeMap(np.ones((6, 4, 4, 3))))
    back = every_code()
    for code in range(256):
        light = camera.response.decode(np.full(3, code / 255.0)) / 1.7
        session.set_material(fastibl.Material(diffuse=(0, 0, 0), emission=light))
        frame = fastibl.Frame(code / 30, back=back, back_exposure=1.7, back_from_marker=LOOKING_DOWN)
        result = session.process(frame)
        layer = session.object
        alpha = np.zeros((48, 64))
        h, w = layer.rgba.shape[:2]
        alpha[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba[..., 3]
        assert 0 < (alpha == 1).sum() < 1000
        np.testing.assert_array_equal(result.image[alpha == 0], back[alpha == 0])
        levels = np.rint(255 * np.array([camera.response.black, camera.response.white])).astype(int)
        assert (result.image[alpha == 1] == np.clip(code, *levels)).all()


def test_pose_chain_is_composition():
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(200):
        a, b = (fastibl.Pose.from_rotation_vector(rng.normal(size=3), rng.normal(size=3)) for _ in range(2))
        points = rng.normal(size=(7, 3))
        worst = max(worst, np.abs((a @ b) @ points - a @ (b @ points)).max())
        worst = max(worst, np.abs((a @ b).matrix - a.matrix @ b.matrix).max())
        worst = max(worst, np.abs((a @ a.inverse()).matrix - np.eye(4)).max())
        worst = max(worst, np.abs(a.rotation - cv2.Rodrigues(cv2.Rodrigues(a.rotation)[0])[0]).max())
        assert a.angle_to(a) < 1e-7
    print(f"pose chain within {worst:.1e}")
    assert worst < 1e-12


def test_pose_from_a_rotation_vector():
    for axis in units(20):
        for angle in (0.0, 1e-9, 1e-5, 0.3, np.pi - 1e-6):
            pose = fastibl.Pose.from_rotation_vector(axis * angle, np.array([1.0, 2, 3]))
            np.testing.assert_allclose(pose.rotation, cv2.Rodrigues(axis * angle)[0], atol=1e-10)
            assert abs(fastibl.Pose().angle_to(pose) - angle) < 1e-9
    np.testing.assert_array_equal(pose.translation, (1, 2, 3))


def test_poses_are_values():
    pose = fastibl.Pose.from_rotation_vector(np.array([0.1, 0.2, 0.3]), np.array([1.0, 2, 3]))
    assert pickle.loads(pickle.dumps(pose)) == pose == copy.copy(pose) == copy.deepcopy(pose)
    assert fastibl.Pose(pose) == pose == fastibl.Pose(pose.matrix) and pose != fastibl.Pose()
    np.testing.assert_array_equal(np.asarray(pose), pose.matrix)
    np.testing.assert_array_equal(fastibl.Pose(pose.matrix.tolist()).matrix, pose.matrix)


def test_what_is_no_pose_is_refused():
    def changed(row, column, value):
        matrix = np.eye(4)
        matrix[row, column] = value
        return lambda: fastibl.Pose(matrix)

    same_error(lambda: fastibl.Pose(np.diag([1.0, 1, -1, 1])), ValueError, "mirror")
    same_error(changed(0, 0, 1.001), ValueError, "orthonormal within 1e-6", "0.002")
    same_error(changed(0, 1, 1e-4), ValueError, "orthonormal")
    same_error(changed(1, 3, np.nan), ValueError, "finite", "row 1", "column 3")
    same_error(changed(2, 3, np.inf), ValueError, "finite", "inf")
    same_error(changed(3, 0, 0.5), ValueError, "last row")
    same_error(lambda: fastibl.Pose(np.eye(3)), ValueError, "(4, 4)", "(3, 3)")
    same_error(lambda: fastibl.Pose(np.eye(4, dtype=int)), TypeError, "floats", "int64")
    same_error(lambda: fastibl.Pose(3.0), TypeError, "array")
    same_error(lambda: fastibl.Pose() @ np.ones((2, 2)), ValueError, "(..., 3)")
    same_error(lambda: fastibl.Pose.from_rotation_vector(np.ones(4), np.ones(3)), ValueError, "(3,)")


def test_replace_changes_what_is_named():
    camera = camera_with(LENSES["five"], gain=2.0, vignetting=[0.1], readout=0.02, response=fastibl.Response.gamma(2.0))
    changed = camera.replace(readout=0.03)
    assert changed.readout == 0.03 and changed != camera and changed.replace(readout=0.02) == camera
    with pytest.raises(ValueError, match="readout"):
        camera.replace(readout=-1.0)
    with pytest.raises(TypeError):
        camera.replace(shutter=0.1)


def test_opencvs_distortion_as_opencv_returns_it():
    """cv2.calibrateCamera returns a row, cv2.fisheye.calibrate a column."""
    K = camera_with().opencv_matrix
    plain = fastibl.Camera.from_opencv(K, LENSES["five"], SIZE)
    for shape in ((5,), (1, 5), (5, 1)):
        assert fastibl.Camera.from_opencv(K, np.reshape(LENSES["five"], shape), SIZE) == plain
    assert fastibl.Camera.from_opencv(K, np.zeros(4, int), SIZE) == fastibl.Camera.from_opencv(K, [0, 0, 0, 0], SIZE)
    with pytest.raises(ValueError, match=r"distortion must have shape \(n,\), \(1, n\) or \(n, 1\), got \(2, 2\)"):
        fastibl.Camera.from_opencv(K, np.zeros((2, 2)), SIZE)
    with pytest.raises(TypeError, match="distortion must be an array of floats, got NoneType"):
        fastibl.Camera.from_opencv(K, None, SIZE)
    with pytest.raises(TypeError, match="distortion must hold numbers, got dtype object"):
        fastibl.Camera.from_opencv(K, np.array([None] * 4), SIZE)


def test_a_curve_has_one_axis():
    assert fastibl.Response.from_curve(fastibl.Response.srgb().curve) == fastibl.Response.srgb()
    with pytest.raises(ValueError, match=r"curve must have shape \(n,\), got \(1, 3\)"):
        fastibl.Response.from_curve([[0.0, 0.5, 1.0]])
