"""How bright a map is: pictures of one time, cameras without told exposures, marker turns, priors."""

import numpy as np
import pytest
from test_capture_masks import board_picture
from test_exposure_untold import BACK, BACK_POSE, BOARD, Still, cube

import fastibl
from fastibl import Capture
from views import camera_of, looking

CAMERA = camera_of(160, 120, 80.0)
UP = fastibl.texel_directions(32)[..., 2] > 0


def flat(value, camera=CAMERA, dtype=np.float32):
    return np.full((camera.height, camera.width, 3), value, dtype)


def up(env):
    return float(fastibl.Lighting(env).irradiance([[0.0, 0.0, 1.0]])[0, 0])


def turned(angle, axis="z"):
    turn, (i, j) = np.eye(4), ((0, 1) if axis == "z" else (1, 2))
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
    return turn


def test_levels_follow_a_map_that_is_made_brighter():
    """As the board's white says, of which a told camera's exposure changes."""
    still = Still({"front"})
    still.run(1)
    still.run(4, lambda share: 0.1**share)
    assert still.capture.mended
    radiance = still.capture.environment().radiance
    anew = fastibl.CubeMap(radiance.faces.copy())
    for level in range(1, 7):
        np.testing.assert_allclose(radiance.level(level), anew.level(level), rtol=2e-5, atol=1e-7)


@pytest.mark.parametrize("order", ["back first", "front first"])
def test_two_cameras_of_one_time_tell_the_unseen_sky_together(order):
    """A dark table and a bright sky in one frame: what was not seen of the sky is as bright as its seen part."""
    table, sky = (flat(0.1), looking((1, 0, -1), (0, 0, 0.3))), (flat(5.0), looking((1, 0, 1)))
    capture = Capture(size=32, distance=np.inf)
    for number, (image, pose) in enumerate((table, sky) if order == "back first" else (sky, table)):
        capture.add(image, CAMERA, pose, 1.0, 0.0, number=number)
    env = capture.environment()
    np.testing.assert_allclose(env.radiance.faces[UP], 5.0, rtol=1e-4)
    np.testing.assert_allclose(up(env), 5 * np.pi, rtol=2e-3)


@pytest.mark.parametrize("tint", [1.0, 2.0, 4.0])
def test_an_assumed_exposure_allows_for_the_tint(tint):
    capture = Capture(size=32, board=BOARD, centre=(0, 0, 0.1))
    capture.add(board_picture(), BACK, BACK_POSE, 0.5, 0.0)
    capture.add(flat(100, dtype=np.uint8), CAMERA, looking((1, 0, 1)), None, 0.1, tint=[tint] * 3)
    env = capture.environment()
    seen = (env.confidence > 0) & UP
    np.testing.assert_allclose(env.radiance.faces[seen], env.plane_irradiance[0] / np.pi, rtol=0.05)


def test_an_assumed_exposure_is_that_of_what_a_picture_shows():
    """Not of the black around a fisheye's circle, nor of what is masked."""

    def assumed(camera, mask=None, shown=None):
        capture = Capture(size=32, board=BOARD, centre=(0, 0, 0.1))
        capture.add(board_picture(), BACK, BACK_POSE, 0.5, 0.0)
        image = flat(100, camera, np.uint8) if shown is None else shown
        taken = capture.add(image, camera, looking((0, 0.01, 1), (0, 0, 0.3)), None, 0.1, mask=mask)
        assert taken.how == "assumed"
        return taken.exposure

    plain, half = assumed(CAMERA), np.ones((120, 160), bool)
    half[:, :96] = False
    np.testing.assert_allclose(assumed(CAMERA, half, flat(100, dtype=np.uint8) * half[..., None]), plain, rtol=1e-6)
    for width in (200, 356, 600):
        f = 200 / np.pi
        fisheye = fastibl.Camera(width, 200, f, f, width / 2, 100, model="fisheye", field_of_view=180)
        y, x = np.mgrid[0:200, 0:width] + 0.5
        inside = np.hypot(x - width / 2, y - 100) < 100
        shown = flat(100, fisheye, np.uint8) * inside[..., None].astype(np.uint8)
        np.testing.assert_allclose(assumed(fisheye, None, shown), plain, rtol=0.01)


def test_the_white_of_a_told_camera_gives_an_untold_ones_exposure():
    """Both see the board; the untold one shows far less light than the white would."""
    capture = Capture(size=32, board=BOARD, centre=(0, 0, 0.1))
    capture.add(board_picture(), BACK, BACK_POSE, 0.5, 0.0)
    told = capture.environment().plane_irradiance
    taken = capture.add(board_picture(0.25), BACK, BACK_POSE, None, 1.0, number=1)
    assert taken.how in ("assumed", "estimated")
    np.testing.assert_allclose(taken.exposure, 0.25, rtol=0.03)
    np.testing.assert_allclose(capture.environment().plane_irradiance, told, rtol=0.03)


def test_what_was_shown_at_an_assumed_exposure_stays_doubtful():
    capture = Capture(size=32)
    capture.add(flat(100, dtype=np.uint8), CAMERA, looking((1, 0, 1)), None, 0.0)
    assert capture.environment().knowledge["scale"] == 1
    capture.add(flat(100, dtype=np.uint8), CAMERA, looking((-1, 0, 1)), 0.01, 1.0)
    env = capture.environment()
    assert env.knowledge["scale"] == 1 and env.predicted_error > 0.5
    capture.add(flat(100, dtype=np.uint8), CAMERA, looking((1, 0, 1)), 0.01, 2.0)
    assert capture.environment().knowledge["scale"] == 0


def test_a_turn_of_the_marker_leaves_an_untold_camera_in_its_scale():
    """Dusk that the white tells, of which the front camera tells nothing, after a turn."""
    levels = []
    for turn in (False, True):
        still = Still({"front"})
        still.run(1)
        if turn:
            still.capture.turn(fastibl.Pose(np.eye(4)))
            still.run(1)
        still.levels()
        still.run(4, lambda share: 0.1**share)
        still.run(1, lambda share: 0.1)
        levels.append(still.levels()[0])
    print(levels)
    np.testing.assert_allclose(levels, 0.1, rtol=0.35)


@pytest.mark.parametrize(("axis", "angle", "kept"), [("z", 0.3, True), ("z", 3.1, True), ("x", 0.3, False)])
def test_a_turn_keeps_what_the_white_said_of_the_sky(axis, angle, kept):
    """A little of a dim sky was seen, and a board that much light falls on; the plane may turn, but not tilt."""
    capture = Capture(size=32, board=BOARD, centre=(0, 0, 0.1))
    for k in range(20):
        capture.add(board_picture(), BACK, BACK_POSE, 0.05, k / 30)
        capture.add(flat(100, dtype=np.uint8), CAMERA, looking((1, 0, 1)), 1.0, k / 30)
    before = capture.environment()
    capture.turn(turned(angle, axis))
    after = capture.environment()
    assert (after.plane_irradiance is not None) == kept
    if kept:
        np.testing.assert_allclose(up(after), up(before), rtol=0.05)


def test_a_prior_turns_with_the_marker():
    faces = np.full((6, 32, 32, 3), 0.5, np.float32)
    faces[0] = 2.0
    capture = Capture(size=32, prior=cube(faces))
    capture.turn(turned(np.pi / 2))
    env = capture.environment()
    assert env.knowledge["prior_flux"] > 0.5
    expected = fastibl.rotate_map(cube(faces), turned(np.pi / 2)[:3, :3])
    np.testing.assert_allclose(env.radiance.faces[UP], expected.faces[UP], atol=0.02)


def test_a_prior_of_a_place_that_is_dark_now():
    """Lamps off: what is seen is black, and so is what stands for the rest."""
    capture = Capture(size=32, prior=cube(np.ones((6, 32, 32, 3))))
    for k in range(8):
        capture.add(flat(0, dtype=np.uint8), CAMERA, looking((np.cos(k), np.sin(k), 1)), 1.0, float(k))
    assert capture.environment().radiance.faces[UP].max() == 0
    for k in range(8):
        capture.add(flat(2.0), CAMERA, looking((np.cos(k), np.sin(k), 1)), 1.0, 10.0 + k)
    np.testing.assert_allclose(capture.environment().radiance.faces[UP], 2.0, rtol=1e-3)


def test_a_prior_without_blue_is_scaled_in_the_other_channels():
    capture = Capture(size=32, prior=cube(np.ones((6, 32, 32, 3)) * [1, 1, 0]))
    for k in range(4):
        capture.add(flat(20.0), CAMERA, looking((np.cos(k), np.sin(k), 1)), 1.0, float(k))
    env = capture.environment()
    unseen = (env.confidence <= 0) & UP
    assert unseen.any()
    np.testing.assert_allclose(env.radiance.faces[unseen], np.broadcast_to([20, 20, 0], (unseen.sum(), 3)), rtol=1e-3)


def test_a_session_sees_that_its_capture_was_turned():
    recording = fastibl.simulate(seconds=0.5, fps=8, size=(160, 120))
    scene = fastibl.Scene(fastibl.shapes.figurine(), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, recording.rig, recording.board)
    for frame in recording:
        session.process(frame)
    session.capture.turn(turned(1.0))
    result = session.process(fastibl.Frame(frame.time + 0.1, back_from_marker=fastibl.Pose(np.eye(4))))
    assert result.environment.radiance == session.capture.environment().radiance
