"""The board's white as a light meter between the two cameras."""

import numpy as np
import pytest

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.simulator import default_rig
from fastibl.white import WhiteReference

TINT = np.array([1.6, 1.25, 1.0])  # of the front camera, with its scale; below 1 what is clipped would seem not to be


def tinted(picture, camera):
    """What a camera of another white balance and scale makes of the same light."""
    linear = camera.response.decode((picture / 255).astype(np.float32)) * TINT.astype(np.float32)
    return np.round(255 * camera.response.encode(np.clip(linear, 0, 1))).astype(np.uint8)


@pytest.fixture(scope="module")
def film():
    return fastibl.simulate(seconds=5, fps=8, rig=default_rig((320, 240)), path="sweep", hand=False, lamp=False, seed=2)


def captured(film, tint, ratio=(1, 1, 1), white=None):
    capture = fastibl.Capture(size=64, board=film.board, centre=film.truth.position)
    for frame in film:
        pose = film.truth.pose(frame.time)
        if white is not None:
            white.add(frame.back, film.rig.back, pose, frame.back_exposure)
        capture.add(frame.back, film.rig.back, pose, frame.back_exposure, frame.time)
        front = tinted(frame.front, film.rig.front) if tint else frame.front
        turned = film.rig.front_from_back @ pose
        taken = capture.add(front, film.rig.front, turned, frame.front_exposure, frame.time, tint=ratio)
        np.testing.assert_allclose(taken.tint, ratio)
    return capture.environment()


def test_the_white_tells_what_the_front_camera_makes_of_light(film):
    true = film.truth.environment(0.0)
    white = WhiteReference(film.board, 0.8)  # the simulator's paper
    wrong = irradiance_error(captured(film, True, white=white), true)
    ratio = white.ratio(captured(film, True))
    sound = white.ratio(captured(film, False))
    right = irradiance_error(captured(film, True, ratio.ratio), true)
    best = irradiance_error(captured(film, False), true)
    print(
        f"{white.pictures} pictures of the white; ratios {ratio.ratio} for {TINT}, {sound.ratio} for 1; spread "
        f"{ratio.spread:.4f}, unseen {ratio.unseen:.3f}; irradiance off by {wrong:.3f}, then {right:.4f} ({best:.4f})"
    )
    assert white.pictures > 30
    np.testing.assert_allclose(ratio.ratio, TINT, rtol=0.08)
    np.testing.assert_allclose(sound.ratio, 1, rtol=0.06)
    assert right < best + 0.05 < wrong


def test_what_shows_no_white_is_refused(film):
    white = WhiteReference(film.board)
    frame = film[0]
    pose = film.truth.pose(frame.time)
    back = film.rig.back
    assert not white.add(np.zeros_like(frame.back), back, pose, 1.0)
    assert not white.add(np.full_like(frame.back, 255), back, pose, 1.0)
    away = fastibl.Pose.from_rotation_vector([0, np.pi, 0], [0, 0, 0]) @ pose
    assert not white.add(frame.back, back, away, 1.0)
    with pytest.raises(LookupError, match="no picture"):
        white.ratio(fastibl.Environment(fastibl.CubeMap(np.ones((6, 8, 8, 3)))))
    with pytest.raises(ValueError, match="240, 320"):
        white.add(frame.back[:10], back, pose, 1.0)
    with pytest.raises(TypeError, match="float64"):
        white.add(frame.back.astype(float), back, pose, 1.0)
    with pytest.raises(ValueError, match="reflectance"):
        WhiteReference(film.board, 1.2)
    assert white.add(frame.back, back, pose, frame.back_exposure)
    with pytest.raises(ValueError, match="no light"):
        white.ratio(fastibl.Environment(fastibl.CubeMap(np.zeros((6, 8, 8, 3)))))
