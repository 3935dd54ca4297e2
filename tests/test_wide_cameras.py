"""Fisheye and 360° cameras: where directions meet their pictures, and the maps that they measure."""

import pickle

import cv2
import numpy as np
import pytest
from scenes import scene_of

import fastibl
from fastibl import recording
from fastibl.comparison import irradiance_error
from fastibl.room import LOWER, UPPER
from fastibl.shapes import figurine
from views import exposed, looking, picture_of, place_light, place_map

FISHEYE = fastibl.Camera(240, 220, 78, 80, 121, 108, distortion=[0.02, -0.01, 0.001, 0.0005], model="fisheye")
AROUND = fastibl.Camera.equirectangular(512, 256)
EYE = (0.0, 0.0, 0.3)


def directions(n=2000):
    d = np.random.default_rng(0).normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


@pytest.mark.parametrize("camera", [FISHEYE, AROUND], ids=["fisheye", "equirectangular"])
def test_unproject_undoes_project(camera):
    d = directions()
    pixels = camera.project(d * np.linspace(0.1, 9, len(d))[:, None])
    error = np.abs(camera.unproject(pixels) - d).max()
    print(f"{camera.model}: within {error:.1e} of a direction")
    assert np.isfinite(pixels).all() and error < 1e-12  # also behind the camera


def test_a_fisheye_is_that_of_opencv():
    d = directions()
    d = d[d[:, 2] > 0.1]
    seen, _ = cv2.fisheye.projectPoints(
        d[None], np.zeros(3), np.zeros(3), FISHEYE.opencv_matrix, np.array(FISHEYE.distortion)
    )
    error = np.abs(seen[0] + 0.5 - FISHEYE.project(d)).max()
    print(f"{error:.1e} px from cv2.fisheye")
    assert error < 1e-9


def test_a_360_picture_has_its_seam_behind_and_y_down():
    np.testing.assert_allclose(AROUND.project(np.array([0.0, 0, 1])), (256, 128))
    np.testing.assert_allclose(AROUND.project(np.array([1.0, 0, 0])), (384, 128))
    np.testing.assert_allclose(AROUND.project(np.array([0.0, 1, 1e-9]))[1], 256)
    assert np.isnan(AROUND.unproject(np.array([256.0, 300.0]))).all()
    assert np.isnan(AROUND.project(np.zeros(3))).all() and np.isnan(FISHEYE.project(np.array([np.nan, 0, 1]))).all()


def test_a_lens_that_folds_back_ends_there():
    camera = fastibl.Camera(300, 300, 90, 90, 150, 150, distortion=[-0.2, 0, 0, 0], model="fisheye")
    limit = np.sqrt(1 / 0.6)  # where θ − 0.2 θ³ stops growing
    angles = np.array([0.99, 1.01]) * limit
    pixels = camera.project(np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1))
    assert np.isfinite(pixels[0]).all() and np.isnan(pixels[1]).all()


@pytest.mark.parametrize("camera", [FISHEYE, AROUND], ids=["fisheye", "equirectangular"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_maps_from_wide_pictures(camera, dtype):
    size = 64
    pose = looking((0.3, 0.5, 0.8), EYE)
    capture = fastibl.Capture(size=size)
    linear = picture_of(lambda d: place_light(np.nan_to_num(d)), camera, pose, split=3)
    for k, exposure in enumerate((1.0, 1 / 16, 1 / 256)):
        codes = exposed(linear, camera, exposure)
        if dtype == np.uint16:
            codes = codes.astype(np.uint16) * 257
        elif dtype == np.float32:
            codes = (linear * exposure).astype(np.float32)
        capture.add(codes, camera, pose, exposure=exposure, time=k / 10)
    env = capture.environment()
    up = fastibl.texel_directions(size)[..., 2] > 0.05
    seen = np.isfinite(capture.last_seen) & up
    inside = fastibl.texel_directions(size) @ pose.rotation.T
    pixels = camera.project(inside.astype(np.float64))
    shown = (pixels >= 8).all(-1) & (pixels < [camera.width - 8, camera.height - 8]).all(-1)
    true = place_map(size)
    filled = fastibl.CubeMap(np.where(seen[..., None], env.radiance.faces, true))
    error = irradiance_error(filled, fastibl.CubeMap(true))
    print(f"{camera.model} {np.dtype(dtype)}: {seen[up].mean():.1%} of the sky seen, irradiance {error:.2%} off")
    if camera.model == "fisheye":
        assert not seen[up & ~shown & (pixels < -4).any(-1)].any()
        assert seen[up & shown].mean() > 0.97
    else:
        assert seen[up].all()
    assert error < 0.01


def test_outside_a_fisheyes_circle_there_is_nothing():
    """Pictures are black there, and the lens model goes on."""
    size, pose = 64, looking((0.3, 0.5, 0.8), EYE)
    camera = fastibl.Camera(240, 240, 80, 80, 120, 120, model="fisheye", field_of_view=120)
    whole = camera.replace(field_of_view=360)
    y, x = np.mgrid[:240, :240] + 0.5
    black = np.hypot(x - 120, y - 120) > 80 * np.radians(60.5)  # half a pixel of the rim is grey
    linear = picture_of(lambda d: place_light(np.nan_to_num(d)), whole, pose, split=3)
    linear[black] = 0
    true = place_map(size)
    errors, seen = {}, {}
    for known in (camera, whole):
        capture = fastibl.Capture(size=size)
        for k, exposure in enumerate((1.0, 1 / 16, 1 / 256)):
            capture.add(exposed(linear, known, exposure), known, pose, exposure=exposure, time=k / 10)
        seen[known.field_of_view] = np.isfinite(capture.last_seen)
        filled = np.where(seen[known.field_of_view][..., None], capture.environment().radiance.faces, true)
        filled[fastibl.texel_directions(size)[..., 2] < 0.05] = 0
        errors[known.field_of_view] = irradiance_error(
            fastibl.CubeMap(filled), fastibl.CubeMap(np.where(fastibl.texel_directions(size)[..., 2:] < 0.05, 0, true))
        )
    print(f"irradiance {errors[120]:.2%} off, where the black is taken for the place {errors[360]:.1%}")
    assert errors[120] < 0.01 < 0.05 < errors[360]
    d = fastibl.texel_directions(size)
    angle = np.degrees(np.arccos(np.clip((d @ pose.rotation.T)[..., 2], -1, 1)))
    up = d[..., 2] > 0.05
    # Footprints must not reach beyond the rim: two texels, of 1.4 degrees, and 4 pixels.
    assert not seen[120][up & (angle > 60)].any() and seen[120][up & (angle < 52)].all()
    rim = np.radians([59.9, 60.1])
    pixels = camera.project(np.stack([np.sin(rim), 0 * rim, np.cos(rim)], axis=-1))
    assert np.isfinite(pixels[0]).all() and np.isnan(pixels[1]).all()
    assert np.isnan(camera.unproject([120 + 80 * rim[1], 120.0])).all()


def test_vignetting_of_a_fisheye():
    camera = fastibl.Camera(240, 240, 80, 80, 120, 120, model="fisheye", vignetting=[-0.12])
    pose = looking((0.0, 0.3, 1.0), EYE)
    capture = fastibl.Capture(size=32)
    capture.add(exposed(np.full((240, 240, 3), 0.5), camera), camera, pose)
    seen = np.isfinite(capture.last_seen) & (fastibl.texel_directions(32)[..., 2] > 0.1)
    values = capture.environment().radiance.faces[seen]
    print(f"a grey place with a vignetted fisheye: {values.min():.3f} to {values.max():.3f}, true 0.5")
    assert np.abs(values - 0.5).max() < 0.01


def test_a_mask_is_of_the_wide_picture():
    pose = looking((0.0, 0.3, 1.0), EYE)
    mask = np.zeros((256, 512), bool)
    mask[:, 256:] = True  # what lies to the camera's right
    capture = fastibl.Capture(size=32)
    capture.add(np.full((256, 512, 3), 99, np.uint8), AROUND, pose, mask=mask)
    right = fastibl.texel_directions(32) @ pose.rotation.T
    seen, up = np.isfinite(capture.last_seen), fastibl.texel_directions(32)[..., 2] > 0.05
    assert not seen[up & (right[..., 0] < -0.05)].any()
    assert seen[up & (right[..., 0] > 0.1)].all()  # what is read for a texel reaches beyond it


def test_wide_pictures_from_afar_do_not_replace_what_nearer_ones_showed():
    """Of one that lies beside the object and one at the ceiling the nearer one knows better; alone, each does."""
    up = fastibl.texel_directions(32)[..., 2] > 0.1

    def sky(*shown):
        capture = fastibl.Capture(size=32)
        for time, (height, light) in enumerate(shown):
            picture = np.full((64, 128, 3), light, np.float32)
            capture.add(picture, fastibl.Camera.equirectangular(128, 64), looking((0, 1, 0), (0, 0, height)), time=time)
        return capture.environment().radiance.faces[up]

    near, far = (0.3, 1.0), (3.0, 0.3)
    np.testing.assert_allclose(sky(near, far, far), 1, rtol=1e-5)
    np.testing.assert_allclose(sky(far), 0.3, rtol=1e-5)
    np.testing.assert_allclose(sky(far, near), 1, rtol=1e-5)


def test_simulated_360_front_camera_lights_a_map_at_once(tmp_path):
    back = fastibl.Camera(480, 360, 390, 390, 240, 180)
    turn = fastibl.Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    rig = fastibl.Rig(back, AROUND, turn)
    film = fastibl.simulate(rig=rig, seconds=0.6, fps=10, out=tmp_path / "film", hand=False, lamp=False)
    assert film.rig == rig
    capture = fastibl.Capture(size=64, centre=film.truth.position, board=film.board, box=(LOWER, UPPER))
    for frame in film:
        pose = rig.front_from_back @ film.truth.pose(frame.time)
        capture.add(frame.front, rig.front, pose, exposure=frame.front_exposure, time=frame.time)
    sky = fastibl.texel_directions(64)[..., 2] > 0.02
    seen = np.isfinite(capture.last_seen)[sky].mean()
    error = irradiance_error(capture.environment(), film.truth.environment(0.4))
    print(f"{seen:.1%} of the sky seen after {len(film)} frames, irradiance {error:.2%} off")
    assert seen == 1 and error < 0.03
    session = fastibl.Session(scene_of(figurine(detail=0.9)), film.rig, film.board, box=(LOWER, UPPER))
    for frame in film:
        result = session.process(frame)
    assert result.tracked is not None
    error = irradiance_error(result.environment, film.truth.environment(0.4))
    print(f"and {error:.2%} off in a session that tracks the board")
    assert error < 0.03


def test_wide_cameras_do_not_track_or_draw():
    board = fastibl.Board.default()
    with pytest.raises(ValueError, match=r"perspective.*fisheye"):
        fastibl.Tracker(board, FISHEYE)
    scene = scene_of(figurine(detail=0.9))
    for options in ({"board": board}, {"environment": fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32))}):
        with pytest.raises(ValueError, match=r"perspective.*fisheye"):  # before the first frame
            fastibl.Session(scene, fastibl.Rig(FISHEYE), **options)


def test_bad_wide_cameras_are_refused():
    for arguments, words in (
        ({"model": "orthographic"}, "perspective, fisheye or equirectangular"),
        ({"model": "fisheye", "distortion": [0.1] * 5}, "0 or 4"),
        ({"model": "equirectangular", "distortion": [0.1] * 4}, "no distortion"),
        ({"model": "fisheye", "field_of_view": 361}, "1 to 360 degrees, got 361"),
        ({"model": "fisheye", "field_of_view": np.nan}, "1 to 360 degrees"),
        ({"field_of_view": 90}, "told of fisheyes, got 90 degrees of a camera that is perspective"),
    ):
        with pytest.raises(ValueError, match=words):
            fastibl.Camera(100, 100, 50, 50, 50, 50, **arguments)


def test_wide_cameras_are_kept(tmp_path):
    narrower = FISHEYE.replace(field_of_view=183.5)
    assert narrower != FISHEYE and "field_of_view=183.5" in repr(narrower)
    for fisheye in (FISHEYE, narrower):
        rig = fastibl.Rig(fastibl.Camera(64, 48, 60, 60, 32, 24), fisheye, fastibl.Pose(np.eye(4)))
        recording.write_rig(tmp_path / "rig.yaml", rig)
        assert recording.read_rig(tmp_path / "rig.yaml") == rig
        assert pickle.loads(pickle.dumps(fisheye)) == fisheye and "fisheye" in repr(fisheye)
    assert pickle.loads(pickle.dumps(AROUND)) == AROUND
