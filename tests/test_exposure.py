"""Exposures that are wrong or not told, judged by what the map knows; and which exposure a camera takes next."""

import board_pictures
import numpy as np
import pytest

import fastibl
from fastibl import Capture, Pose
from fastibl.comparison import irradiance_error
from fastibl.exposure import Bracket

RNG = np.random.default_rng(2)
CAMERA = fastibl.Camera(160, 120, 110, 110, 80, 60)
OTHER = fastibl.Camera(160, 120, 100, 100, 80, 60)


def place():
    """Light with structure everywhere, 0.1 to 1."""
    d = fastibl.texel_directions(64)
    waves = sum(np.sin(k * d @ axis)[..., None] for k, axis in ((3, (1, 0.3, 0)), (5, (0, 1, 0.5)), (4, (0.2, 0, 1))))
    return fastibl.CubeMap((np.exp(0.4 * waves) * [0.35, 0.3, 0.25]).astype(np.float32))


PLACE = place()


def looking_at(azimuth, up=0.5):
    forward = np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.array([right, np.cross(forward, right), forward])
    return Pose(np.vstack([np.column_stack([turn, -turn @ [0, 0, 0.05]]), [0, 0, 0, 1]]))


def picture(pose, exposure, camera=CAMERA, light=PLACE, dtype=np.uint8):
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = camera.unproject(np.stack([x, y], axis=-1))
    linear = light.sample(rays @ pose.rotation) * exposure
    linear += RNG.normal(size=linear.shape) * np.sqrt(np.maximum(linear, 0) / 4000 + (6 / 4000) ** 2)
    if dtype == np.float32:
        return linear.astype(np.float32)
    most = np.iinfo(dtype).max
    return np.round(most * camera.response.encode(np.clip(linear, 0, 1))).astype(dtype)


def warmed(**options):
    """A capture that knows an azimuth of 0 to 0.6 well, the time after, and how to go on."""
    capture = Capture(size=64, **{"doubt_exposures": True, **options})
    for k in range(12):
        pose = looking_at(0.05 * k)
        assert capture.add(picture(pose, 0.8), CAMERA, pose, 0.8, time=k / 30).how == "told"
    return capture, 12 / 30


def seen_error(capture, light=PLACE):
    env = capture.environment()
    seen = env.confidence > 0
    return float(np.median(np.abs(env.radiance.faces[seen] / light.faces[seen] - 1)))


@pytest.mark.parametrize("factor", [1 / 64, 1 / 4, 4.0, 64.0])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_wrong_tag_is_corrected(factor, dtype):
    capture, time = warmed()
    pose = looking_at(0.4)
    before = seen_error(capture)
    taken = capture.add(picture(pose, 0.8, dtype=dtype), CAMERA, pose, 0.8 * factor, time)
    print(f"{taken}, deviation {taken.deviation:.4f}; error of the map {before:.4f}, then {seen_error(capture):.4f}")
    assert taken.how == "corrected" and taken.exposure == pytest.approx(0.8, rel=0.02)
    np.testing.assert_allclose(taken.tint, 1, atol=0.02)
    assert seen_error(capture) < before + 0.005
    trusting, time = warmed(doubt_exposures=False)
    assert trusting.add(picture(pose, 0.8), CAMERA, pose, 0.8 * factor, time).how == "told"
    assert seen_error(trusting) > 0.1, "the map takes what it is told"


def test_white_balance_that_jumps_is_corrected():
    capture, time = warmed()
    before, pose = seen_error(capture), looking_at(0.4)
    gains = np.array([1.5, 1.0, 0.6])
    tinted = fastibl.CubeMap(PLACE.faces * gains.astype(np.float32))
    taken = capture.add(picture(pose, 0.5, light=tinted), CAMERA, pose, 0.5, time)
    assert taken.how == "corrected"
    np.testing.assert_allclose(taken.exposure / 0.5 * np.array(taken.tint), gains, rtol=0.02)
    assert seen_error(capture) < before + 0.005


def test_a_change_of_all_the_light_is_believed_when_it_stays():
    capture, begin = warmed()
    dimmed, hows = fastibl.CubeMap(PLACE.faces * np.float32(0.3)), []
    for k in range(12):
        pose = looking_at(0.3 + 0.002 * k)
        hows.append(capture.add(picture(pose, 0.8, light=dimmed), CAMERA, pose, 0.8, begin + k / 30).how)
    believed = hows.index("told")
    print(f"believed after {believed} pictures, {believed / 30:.2f} s")
    assert believed / 30 == pytest.approx(0.2, abs=0.04) and set(hows[believed:]) == {"told"}
    ray = np.asarray(looking_at(0.3).rotation)[2]
    np.testing.assert_allclose(capture.environment().radiance.sample(ray), 0.3 * PLACE.sample(ray), rtol=0.1)


def test_a_change_is_believed_by_four_pictures_however_far_apart():
    capture, begin = warmed()
    half = fastibl.CubeMap(PLACE.faces * np.float32(0.5))
    shown = [capture.add(picture(looking_at(0.3), 0.8, light=half), CAMERA, looking_at(0.3), 0.8, begin + k).how
             for k in range(5)]  # fmt: skip
    assert shown == ["corrected"] * 3 + ["told"] * 2


def test_what_was_seen_before_the_light_changed_is_as_unsure_as_it_changed():
    capture, begin = warmed()
    before, half = np.array(capture.environment().confidence), fastibl.CubeMap(PLACE.faces * np.float32(0.5))
    for k in range(12):
        capture.add(picture(looking_at(0.3), 0.8, light=half), CAMERA, looking_at(0.3), 0.8, begin + k / 15)
    old = (before > 0.5) & (capture.last_seen < begin)
    variance = [0.1**2 * (1 / np.asarray(c)[old] - 1) for c in (before, capture.environment().confidence)]
    added = np.median(variance[1] - variance[0])
    print(f"{old.sum()} texels: relative variance {added:.3f} more, ln(2)^2 is {np.log(2) ** 2:.3f}")
    assert old.sum() > 500 and added == pytest.approx(np.log(2) ** 2, rel=0.05)


def turned(strength, tag, turns=2):
    """Brackets of a camera that turns by 57 degrees a second, up and down: the error of what it saw in the end."""
    capture, how = Capture(size=64, doubt_exposures=True), []
    for k in range(63 * turns):
        pose, exposure = looking_at(0.1 * k, (0.25, 0.75)[k // 3 % 2]), (1.0, 1 / 4, 1 / 16)[k % 3]
        light = fastibl.CubeMap(PLACE.faces * np.float32(strength(k)))
        how.append(capture.add(picture(pose, exposure, light=light), CAMERA, pose, exposure * tag(k), time=k / 10).how)
    return seen_error(capture, light), how


@pytest.mark.parametrize("factor", [0.25, 1.6, 4.0])
def test_all_the_light_changes_while_the_camera_turns(factor):
    """What was painted while it was doubted, and what is older, is not compared with."""
    error, how = turned(lambda k: factor if k >= 63 else 1.0, lambda k: 1.0)
    print(f"x{factor}: {error:.2%}, corrected {how.count('corrected')}, averaged {how.count('averaged')}")
    assert error < 0.02 and how.count("corrected") <= 8 and how.count("averaged") <= 4
    assert set(how[-30:]) == {"told"}


@pytest.mark.parametrize("factor", [1 / 8, 2.0, 8.0])
@pytest.mark.parametrize("count", [1, 3])
def test_first_pictures_with_wrong_tags(factor, count):
    """The first picture sets the scale, and those that follow tell that it was wrong."""
    error, how = turned(lambda k: 1.0, lambda k: factor if k < count else 1.0, turns=1)
    print(f"{count} x{factor}: {error:.2%}, corrected {how.count('corrected')}, averaged {how.count('averaged')}")
    assert error < 0.02 and set(how[-30:]) == {"told"}


def test_a_scale_that_was_assumed_is_said_to_be():
    """No exposure at all: as the board's white says, and wrong by what that tells."""
    film = fastibl.simulate(seconds=1, fps=8, size=(320, 240), hand=False, lamp=False, path="sweep")
    truth = film.truth.environment(0)
    session = fastibl.Session(fastibl.Scene(fastibl.shapes.figurine(detail=0.9)), film.rig, film.board, size=64)
    for frame in film:
        frame.front_exposure = None
        env = session.process(frame).environment
    error, (low, high) = irradiance_error(env, truth), env.predicted_interval
    print(f"irradiance {error:.1%} off, stated {env.predicted_error:.1%}, {low:.1%} to {high:.1%}; {env.knowledge}")
    assert error < 0.6 and low < error < high and env.knowledge["scale"] >= 0.08
    told = Capture(size=64)
    pose = looking_at(0.0)
    told.add(picture(pose, 0.8), CAMERA, pose, 0.8, time=0)
    assert told.environment().knowledge["scale"] == 0


def test_a_scale_that_was_assumed_is_mended_by_the_boards_white():
    """The front camera's pictures come before any of the board; then the white says how bright they are."""
    options = {"seconds": 3, "fps": 10, "size": (320, 240), "hand": False, "lamp": False, "path": "sweep"}
    film = fastibl.simulate(PLACE, **options, front_exposures=lambda last: last)
    truth = film.truth.environment(0)
    for units in (1.0, 8.0, 1 / 8):  # of the back camera's exposures
        capture = Capture(size=64, board=film.board, centre=(0, 0, 0.1))
        scale, mended = [], []
        for k, frame in enumerate(film):
            pose = film.truth.pose(frame.time)
            front = film.rig.front_from_back @ pose
            assert capture.add(frame.front, film.rig.front, front, None, frame.time, number=1).how != "left out"
            if k >= 6:
                capture.add(frame.back, film.rig.back, pose, frame.back_exposure * units, frame.time)
            light = fastibl.Lighting(capture.environment()).irradiance((0, 0, 1)).mean()
            scale.append(light * units / fastibl.Lighting(truth).irradiance((0, 0, 1)).mean())
            mended.append(capture.mended)
        print(f"units {units:g}: x{scale[5]:.2f}, x{scale[10]:.2f}, x{scale[-1]:.2f}; mended after {mended}")
        assert abs(np.log(scale[-1])) < 0.15 and 1 <= mended[-1] <= 3
        assert abs(np.log(scale[5])) > 0.5, "wrong before, or nothing is shown"


def test_a_scale_is_mended_by_as_much_of_the_sky_as_was_seen():
    """An even sky, of which two thirds were seen, lights the board by two thirds of what it would light it by whole."""
    camera, board = fastibl.Camera(480, 360, 330, 330, 240, 180), fastibl.Board.default()
    capture, wide = Capture(size=32, board=board, centre=(0, 0, 0.1)), fastibl.Camera(160, 120, 80, 80, 80, 60)
    for k in range(6):
        capture.add(np.full((120, 160, 3), 60, np.uint8), wide, looking_at(0.5 * k, 0.6), None, 0.1 * k, number=1)
    pose = board_pictures.look_at(20, 0.45, 40)
    page = board_pictures.render(board, camera, pose)
    for k in range(3):
        capture.add(page, camera, pose, 1.0, 0.51 + 0.11 * k)
    environment, sky = capture.environment(), fastibl.texel_directions(32)[..., 2] > 0.02
    seen = np.isfinite(capture.last_seen) & sky
    shown, expected = np.median(environment.radiance.faces[seen]), np.mean(environment.plane_irradiance) / np.pi
    print(f"{seen.sum() / sky.sum():.0%} seen: {shown:.3f} for {expected:.3f}")
    assert capture.mended == 1 and 0.5 < seen.sum() / sky.sum() < 0.8
    assert shown == pytest.approx(expected, rel=0.02)


def test_an_assumed_exposure_allows_for_the_cameras_gain():
    camera, board = fastibl.Camera(480, 360, 330, 330, 240, 180), fastibl.Board.default()
    pose, up = board_pictures.look_at(20, 0.45, 40), looking_at(2.4, 1.2)
    page, exposures = board_pictures.render(board, camera, pose), []
    for gain in (1.0, 4.0):
        capture = Capture(size=64, board=board, centre=(0, 0, 0.1))
        capture.add(page, camera, pose, 1.0, 0.0)
        other = fastibl.Camera(160, 120, 110, 110, 80, 60, gain=gain)
        taken = capture.add(picture(up, 0.3), other, up, None, 0.1, number=1)
        assert taken.how == "assumed"
        exposures.append(taken.exposure)
    assert exposures[0] == pytest.approx(4 * exposures[1], rel=0.02)


def test_the_camera_that_shows_the_white_is_in_its_scale():
    """One that tells no exposure at first: nothing of what it showed before the board is scaled."""
    camera, board = fastibl.Camera(480, 360, 330, 330, 240, 180), fastibl.Board.default()
    capture = Capture(size=64, board=board, centre=(0, 0, 0.1))
    for k in range(24):
        up = looking_at(0.26 * k, (0.25, 0.75)[k % 2])
        assert capture.add(picture(up, 0.3, camera), camera, up, None, 0.1 * k).how in ("assumed", "estimated")
    pose = board_pictures.look_at(20, 0.45, 40)
    capture.add(board_pictures.render(board, camera, pose), camera, pose, 40.0, 7.0)
    environment = capture.environment()
    seen = environment.confidence[fastibl.texel_directions(64)[..., 2] > 0] > 0
    assert environment.plane_irradiance is not None and seen.mean() > 0.5 and capture.mended == 0


def test_cameras_of_the_same_parameters_are_told_apart():
    """Of two cameras of one make the second sets its own scale."""
    capture, away = Capture(size=64), looking_at(2.4, 0.2)
    pose = looking_at(0.0)
    assert capture.add(picture(pose, 0.8), CAMERA, pose, None, 0.0).how == "assumed"
    assert capture.add(picture(away, 0.8), CAMERA, away, None, 0.0).how == "left out"
    assert capture.add(picture(away, 0.8), CAMERA, away, None, 0.0, number=1).how == "assumed"


def test_a_zoom_does_not_forget_that_a_scale_was_assumed():
    capture, pose = Capture(size=64), looking_at(0.0)
    for k in range(6):
        zoomed = fastibl.Camera(160, 120, 110 + k, 110 + k, 80, 60)
        capture.add(picture(pose, 0.8, zoomed), zoomed, pose, None, 0.1 * k)
        assert capture.environment().knowledge["scale"] == 1, k


def test_the_camera_that_was_used_longest_ago_is_forgotten():
    """One stays and one zooms: what is known of the first, here its scale, is kept."""
    capture, pose, away = Capture(size=64), looking_at(0.0), looking_at(2.4, 0.2)
    for k in range(6):
        assert capture.add(picture(pose, 0.8), CAMERA, pose, None, 0.1 * k).how == ("estimated" if k else "assumed")
        zoomed = fastibl.Camera(160, 120, 110 + k, 100, 80, 60)
        capture.add(picture(pose, 0.8, zoomed), zoomed, pose, 0.8, 0.1 * k, number=1)
    assert capture.add(picture(away, 0.8), CAMERA, away, None, 1.0).how == "left out", "it has a scale"


def test_what_changes_in_a_part_of_the_picture_comes_at_once():
    capture, time = warmed()
    pose = looking_at(0.3)
    shown = picture(pose, 0.8)
    shown[:, 80:] = picture(pose, 0.8 * 0.2)[:, 80:]
    assert capture.add(shown, CAMERA, pose, 0.8, time).how == "told"


def test_an_exposure_is_not_read_from_what_is_masked():
    capture, time = warmed()
    pose, mask = looking_at(0.3), np.zeros((120, 160), bool)
    mask[:, :60] = True
    shown = picture(pose, 0.8)
    shown[:, 60:] = picture(pose, 0.16)[:, 60:]  # something that shades most of it
    taken = capture.add(shown, CAMERA, pose, None, time, mask=mask)
    assert taken.how == "estimated" and taken.exposure == pytest.approx(0.8, rel=0.02)


def test_black_pictures_are_left_out():
    capture, time = warmed()
    pose, before = looking_at(0.3), capture.environment().radiance.faces.copy()
    black = np.zeros((120, 160, 3), np.uint8)
    assert capture.add(black, CAMERA, pose, 0.8, time).how == "left out"
    np.testing.assert_array_equal(capture.environment().radiance.faces, before)
    assert capture.add(black, CAMERA, pose, 0.8 / 1000, time + 0.03).how == "told", "a short exposure is dark"


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_exposures_that_are_not_told(dtype):
    capture = Capture(size=64)
    pose = looking_at(0)
    first = capture.add(picture(pose, 0.5, dtype=dtype), CAMERA, pose, None, 0.0)
    assert (first.how, first.exposure) == ("assumed", 1.0)
    errors, stated = [], []
    for k in range(1, 40):
        pose, exposure = looking_at(0.1 * k), 0.5 * 2 ** (0.8 * np.sin(k / 5))  # as a camera's automatic goes
        taken = capture.add(picture(pose, exposure, dtype=dtype), CAMERA, pose, None, k / 15)
        assert taken.how == "estimated"
        errors.append(np.log(taken.exposure / (exposure / 0.5))), stated.append(taken.deviation)
    error = seen_error(capture, fastibl.CubeMap(PLACE.faces * np.float32(0.5)))
    print(
        f"errors of the exposure: median {np.median(np.abs(errors)):.4f}, worst {np.max(np.abs(errors)):.4f}, stated "
        f"{np.median(stated):.4f}; of the map {error:.4f}"
    )
    assert np.max(np.abs(errors)) < 0.04 and error < 0.03
    # What is stated is how well a picture agrees with the map, whose scale drifts from picture to picture.
    steps = np.sqrt(np.mean(np.diff(errors) ** 2)) / np.sqrt(np.mean(np.square(stated)))
    print(f"from picture to picture {steps:.2f} of what is stated")
    assert 0.25 < steps < 1


def test_what_the_map_cannot_tell_is_left_out():
    capture, time = warmed()
    away = looking_at(2.4, 0.2)
    assert capture.add(picture(away, 0.5, OTHER), OTHER, away, None, time).how == "assumed", (
        "a new camera sets its scale"
    )
    away = looking_at(4.6, 0.2)
    assert capture.add(picture(away, 0.5, OTHER), OTHER, away, None, time).how == "left out"
    pose = looking_at(0.3)
    assert capture.add(picture(pose, 0.5, OTHER), OTHER, pose, None, time).how == "estimated"
    assert capture.add(np.zeros((120, 160, 3), np.uint8), CAMERA, pose, None, time).how == "left out"
    clipped = np.full((120, 160, 3), 255, np.uint8)
    assert capture.add(clipped, CAMERA, pose, None, time).how == "left out"


def test_a_360_degree_camera_that_does_not_tell():
    wide = fastibl.Camera.equirectangular(256, 128)
    y, x = np.mgrid[:128, :256] + 0.5
    rays = wide.unproject(np.stack([x, y], axis=-1))
    pose = looking_at(0.2)
    capture = Capture(size=64)
    for k, exposure in enumerate((0.5, 0.8, 0.3)):
        linear = PLACE.sample(rays @ pose.rotation) * exposure
        shown = np.round(255 * wide.response.encode(np.clip(linear, 0, 1))).astype(np.uint8)
        taken = capture.add(shown, wide, pose, None, k / 30)
        assert taken.exposure == pytest.approx(exposure / 0.5, rel=0.02), taken
        assert taken.how == ("estimated" if k else "assumed")


def test_bracket():
    bracket = Bracket((1, 1 / 4))
    assert [bracket(0.8), bracket(0.2), bracket(0.8)] == pytest.approx([0.2, 0.8, 0.2])
    with pytest.raises(ValueError, match="positive"):
        Bracket((1, 0))
