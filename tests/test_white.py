"""The board's white as a light meter between the two cameras."""

import numpy as np
import pytest

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.simulator import PAPER, default_rig
from fastibl.white import camera_ratio

TINT = np.array([1.6, 1.25, 1.0])  # of the front camera, with its scale; below 1 what is clipped would seem not to be


def tinted(picture, camera):
    """What a camera of another white balance and scale makes of the same light."""
    linear = camera.response.decode((picture / 255).astype(np.float32)) * TINT.astype(np.float32)
    return np.round(255 * camera.response.encode(np.clip(linear, 0, 1))).astype(np.uint8)


@pytest.fixture(scope="module")
def film():
    return fastibl.simulate(seconds=5, fps=8, rig=default_rig((320, 240)), path="sweep", hand=False, lamp=False, seed=2)


def captured(film, tint, ratio=(1, 1, 1)):
    capture = fastibl.Capture(size=64, board=film.board, centre=film.truth.position, paper_albedo=PAPER)
    for frame in film:
        pose = film.truth.pose(frame.time)
        capture.add(frame.back, film.rig.back, pose, frame.back_exposure, frame.time)
        front = tinted(frame.front, film.rig.front) if tint else frame.front
        turned = film.rig.front_from_back @ pose
        taken = capture.add(front, film.rig.front, turned, frame.front_exposure, frame.time, tint=ratio)
        np.testing.assert_allclose(taken.tint, ratio)
    return capture.environment()


def test_the_white_tells_what_the_front_camera_makes_of_light(film):
    true = film.truth.environment(0.0)
    spoiled, sound = captured(film, True), captured(film, False)
    found, known = camera_ratio(spoiled), camera_ratio(sound)
    wrong, best = irradiance_error(spoiled, true), irradiance_error(sound, true)
    right = irradiance_error(captured(film, True, found.ratio), true)
    print(
        f"ratios {found.ratio} for {TINT}, {known.ratio} for 1; unseen {found.unseen:.3f}; irradiance off by "
        f"{wrong:.3f}, then {right:.4f} ({best:.4f})"
    )
    np.testing.assert_allclose(found.ratio, TINT, rtol=0.08)
    np.testing.assert_allclose(known.ratio, 1, rtol=0.06)
    assert right < best + 0.05 < wrong


def test_white_without_a_channel_is_refused(film):
    capture = fastibl.Capture(size=16, board=film.board)
    for frame in film:
        purple, pose = frame.back * np.array([1, 0, 1], np.uint8), film.truth.pose(frame.time)
        capture.add(purple, film.rig.back, pose, frame.back_exposure, frame.time)
        capture.add(frame.front, film.rig.front, film.rig.front_from_back @ pose, frame.front_exposure, frame.time)
    assert capture.environment().plane_irradiance[1] == 0
    with pytest.raises(ValueError, match="without any light in a channel"):
        camera_ratio(capture.environment())


def test_what_shows_no_white_is_refused(film):
    with pytest.raises(LookupError, match="no picture"):
        camera_ratio(fastibl.Environment(fastibl.CubeMap(np.ones((6, 8, 8, 3)))))
    capture = fastibl.Capture(size=16, board=film.board)
    capture.add(np.zeros_like(film[0].back), film.rig.back, film.truth.pose(film[0].time))
    with pytest.raises(LookupError, match="no picture"):
        camera_ratio(capture.environment())


def test_light_that_clips_in_all_pictures_is_told(film):
    """A lamp of which the front camera's only exposure shows the outline alone."""
    recording = fastibl.simulate(seconds=2, fps=8, size=(320, 240), front_exposures=lambda last: last)
    session = fastibl.Session(fastibl.Scene(fastibl.shapes.figurine(), spheres=0), recording.rig, recording.board)
    for frame in recording:
        result = session.process(frame)
    known = result.environment.knowledge
    share = known["boosted_flux"] + known["bound_flux"]
    print(f"{share:.3f} of the light clips")
    assert share > 0.1
    with pytest.warns(UserWarning, match="of the light clips in all pictures"):
        assert fastibl.white.camera_ratio(result.environment).clipped == pytest.approx(share)
