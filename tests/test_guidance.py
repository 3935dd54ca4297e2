"""The picture that tells a user where to turn."""

import numpy as np
import pytest

import fastibl
from views import camera_of, exposed, looking, picture_of, place_light

CAMERA = camera_of(160, 120, 78)
EYE = (0.0, 0.0, 0.3)


def see(capture, direction, time):
    pose = looking(direction, EYE)
    for k, exposure in enumerate((1.0, 1 / 16, 1 / 256)):
        codes = exposed(picture_of(place_light, CAMERA, pose), CAMERA, exposure)
        capture.add(codes, CAMERA, pose, exposure=exposure, time=time + 0.1 * k)


def ring(left_out, elevation=0.45):
    turns = np.radians(np.arange(0, 360, 30))
    away = [np.array([np.cos(a), np.sin(a), elevation]) for a in turns if abs(a - left_out) > np.radians(50)]
    return [*away, np.array([0.05, 0.0, 1.0])]


@pytest.mark.parametrize("left_out", [60, 150, 240])
def test_it_points_at_what_was_left_out(left_out):
    capture = fastibl.Capture(size=64)
    for k, d in enumerate(ring(np.radians(left_out))):
        see(capture, d, 0.5 * k)
    found = fastibl.guide(capture.environment())
    azimuth = np.degrees(np.arctan2(found.direction[1], found.direction[0])) % 360
    print(f"left out {left_out}, pointed at {azimuth:.0f}, share {found.share:.2f}")
    assert abs(azimuth - left_out) < 30 and 0.02 < found.share < 0.5


def test_a_few_texels_are_not_worth_a_turn():
    around, mask = fastibl.Camera.equirectangular(512, 256), np.ones((256, 512), bool)
    mask[62, 258] = False
    capture = fastibl.Capture(size=64)
    capture.add(np.full((256, 512, 3), 99, np.uint8), around, looking((0, 1, 0), EYE), mask=mask)
    env = capture.environment()
    assert (env.confidence[fastibl.texel_directions(64)[..., 2] > 0] == 0).any()
    found = fastibl.guide(env)
    assert found.direction is None and found.share == 0 and str(found) == "all of the sky was seen"


@pytest.mark.parametrize("side", [1, -1])
def test_of_two_places_alike_it_points_at_the_nearer_one(side):
    around, pose = fastibl.Camera.equirectangular(256, 128), looking((0, 1, 0), EYE)
    columns, rows = np.meshgrid(np.arange(256) + 0.5, np.arange(128) + 0.5)
    rays = around.unproject(np.stack([columns, rows], axis=-1)) @ pose.rotation
    mask = np.abs(rays[..., 0]) + 0.85 * rays[..., 2] < 1.17  # all but a circle at each side
    capture = fastibl.Capture(size=32)
    capture.add(np.full((128, 256, 3), 99, np.uint8), around, pose, mask=mask)
    found = fastibl.guide(capture.environment(), CAMERA, looking((side, 0.2, 0.3), EYE))
    assert found.direction[0] * side > 0.5 and abs(found.right) < 30


def test_following_it_sees_the_whole_sky():
    capture, pose, turns = fastibl.Capture(size=64), looking((1, 0, 0.4), EYE), 0
    while turns < 40:
        see(capture, pose.rotation[2], 0.5 * turns)
        found = fastibl.guide(capture.environment(), CAMERA, pose)
        if found.direction is None:
            break
        pose, turns = looking(found.direction, EYE), turns + 1
    sky = fastibl.texel_directions(64)[..., 2] > 0.02
    seen = np.isfinite(capture.last_seen)[sky].mean()
    print(f"{turns} turns: {seen:.1%} of the sky seen; {found}")
    assert found.direction is None and str(found) == "all of the sky was seen"
    assert turns <= 25 and seen > 0.99


def test_turns_are_the_cameras():
    capture = fastibl.Capture(size=64)
    see(capture, (0, 1, 0.5), 0)
    pose = looking((0, 1, 0.5), EYE)
    found = fastibl.guide(capture.environment(), CAMERA, pose)
    x, y, z = pose.rotation @ found.direction
    assert np.sign(found.right) == np.sign(x) and np.sign(found.up) == -np.sign(y)
    assert str(found).startswith("turn ")
    matrix = fastibl.guide(capture.environment(), CAMERA, pose.matrix)
    assert (matrix.right, matrix.up) == (found.right, found.up)
    assert matrix != found and found in [matrix, found]  # arrays have no single answer


def test_the_picture_stripes_what_is_unseen():
    capture = fastibl.Capture(size=64)
    direction = np.array([0, 1, 0.5])
    see(capture, direction, 0)
    found = fastibl.guide(capture.environment(), CAMERA, looking(direction, EYE), height=128)
    assert found.image.shape == (128, 256, 3) and found.image.dtype == np.uint8
    grey = np.ptp(found.image[8:56].astype(int), axis=-1) < 12
    assert grey[:, :40].mean() > 0.8  # behind the camera
    assert grey[20:44, 118:138].mean() < 0.7  # +y is in the middle


def test_bad_input_is_refused():
    env = fastibl.Capture(size=16).environment()
    with pytest.raises(ValueError, match="both a camera and its pose"):
        fastibl.guide(env, CAMERA)
    with pytest.raises(ValueError, match="at least 16"):
        fastibl.guide(env, height=2)


@pytest.mark.parametrize("size", [1, 5, 48])
def test_any_size_of_map(size):
    found = fastibl.guide(fastibl.Capture(size=size).environment())
    assert found.image.shape == (256, 512, 3)


@pytest.mark.parametrize("light", [0, 1])
def test_a_black_or_unseen_map_has_a_way_to_go(light):
    capture = fastibl.Capture(size=32)
    pose = looking((1, 0, 0.4), EYE)
    capture.add(np.full((120, 160, 3), 255 * light // 2, np.uint8), CAMERA, pose)
    found = fastibl.guide(capture.environment(), CAMERA, pose)
    assert np.isfinite(found.direction).all() and 0 < found.share < 1 and np.isfinite(found.right)
    assert found.direction @ pose.rotation[2] < np.cos(np.radians(28)), "elsewhere than it looks"


def test_sizes_that_are_no_power_of_two():
    found = []
    for size in (64, 100):
        capture = fastibl.Capture(size=size)
        for k, d in enumerate(ring(np.radians(150))):
            see(capture, d, 0.5 * k)
        found.append(fastibl.guide(capture.environment()))
    assert found[0].direction @ found[1].direction > np.cos(np.radians(30))
    assert found[0].share == pytest.approx(found[1].share, rel=0.25)
