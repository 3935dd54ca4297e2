"""The board's white as a light meter, and what it says of the unseen sky."""

import numpy as np
import pytest
from board_pictures import look_at, render

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.simulator import PAPER
from views import looking, place_light, place_map

BOARD = fastibl.Board.default()
CAMERA = fastibl.Camera(480, 360, 396.0, 396.0, 240.0, 180.0)
WHITE = 0.4  # radiance of white in these pictures


def measured(pose, board=BOARD, exposure=1.0, albedo=0.85, **options):
    picture = render(board, CAMERA, pose, exposure=exposure, white=WHITE, fine=2, **options)
    capture = fastibl.Capture(size=16, board=board, paper_albedo=albedo)
    capture.add(picture, CAMERA, fastibl.Pose(pose), exposure=exposure)
    return capture.environment().plane_irradiance


@pytest.mark.parametrize("board", [BOARD, fastibl.Board.grid(3, 4, 0.04, 0.012), fastibl.Board.kalibr(3, 3, 0.05, 0.3)])
@pytest.mark.parametrize("tilt", [0, 40, 70])
def test_the_irradiance_of_a_board_in_even_light(board, tilt):
    found = measured(look_at(tilt, 0.35, 30), board)
    print(f"tilt {tilt}: {np.array(found) * 0.85 / np.pi / WHITE} of the true radiance of white")
    np.testing.assert_allclose(found, np.pi / 0.85 * WHITE, rtol=0.03)


def test_exposure_and_albedo_count():
    pose = look_at(30, 0.35)
    np.testing.assert_allclose(measured(pose, exposure=0.5), np.pi / 0.85 * WHITE, rtol=0.03)
    np.testing.assert_allclose(measured(pose, albedo=0.7), np.pi / 0.7 * WHITE, rtol=0.03)


def test_broken_pixels_of_linear_pictures_count_as_dark():
    pose = look_at(30, 0.35)
    srgb = fastibl.Response.srgb().decode(render(BOARD, CAMERA, pose, exposure=1.0, white=WHITE, fine=2) / 255)
    picture = np.asarray(srgb, np.float32)
    rng = np.random.default_rng(0)
    picture[rng.random(picture.shape[:2]) < 0.1] = np.nan
    picture[rng.random(picture.shape[:2]) < 0.1] = -np.inf
    capture = fastibl.Capture(size=16, board=BOARD)
    capture.add(picture, CAMERA, fastibl.Pose(pose))
    np.testing.assert_allclose(capture.environment().plane_irradiance, np.pi / 0.85 * WHITE, rtol=0.03)


def test_what_tells_nothing():
    assert measured(look_at(30, 0.35), exposure=4.0) is None  # white is clipped
    assert measured(look_at(85, 0.35)) is None  # paper shines at grazing views
    assert measured(look_at(30, 12.0)) is None  # too far
    with pytest.raises(ValueError, match=r"albedo must be in \(0, 1\]"):
        fastibl.Capture(board=BOARD, paper_albedo=0)


def lit(share):
    """Error of the irradiance with the first `share` of a film, metered and not."""
    place = fastibl.CubeMap(place_map(64))
    film = fastibl.simulate(place, seconds=3, fps=10, size=(320, 240), hand=False, seed=5)
    errors, plane = [], None
    for albedo in (PAPER, None):
        board = film.board if albedo else None
        capture = fastibl.Capture(size=64, board=board, centre=film.truth.position, paper_albedo=albedo or 0.85)
        for frame in list(film)[: round(share * len(film))]:
            pose = film.truth.pose(frame.time)
            capture.add(frame.back, film.rig.back, pose, exposure=frame.back_exposure, time=frame.time)
            turned = film.rig.front_from_back @ pose
            capture.add(frame.front, film.rig.front, turned, exposure=frame.front_exposure, time=frame.time)
        env = capture.environment()
        plane = plane or env.plane_irradiance
        errors.append(irradiance_error(env.radiance, film.truth.environment(0)))
    return errors, plane, env.coverage


def test_unseen_parts_are_as_bright_as_the_board_says():
    (with_board, without), plane, coverage = lit(0.15)
    d = fastibl.texel_directions(64)
    weight = fastibl.texel_solid_angles(64) * np.maximum(d[..., 2], 0)
    true = (weight[..., None] * place_light(d)).sum(axis=(0, 1, 2))
    print(f"{coverage:.0%} seen: irradiance {with_board:.1%} off with the board's white, {without:.1%} without")
    print(f"plane {np.array(plane) / true} of its true irradiance")
    np.testing.assert_allclose(plane, true, rtol=0.06)
    assert with_board < 0.7 * without


@pytest.mark.parametrize("low", [0.0, 0.002, 0.2])
def test_a_dark_sliver_says_nothing_of_the_sky_above(low):
    """What was seen of the sky is dark, and what was not lights the board: its light was 0.03 of what that says."""
    d = fastibl.texel_directions(64)
    sky = np.where(d[..., 2:] > 0.35, 2.0, low) * np.ones(3)
    up = [[0.0, 0, 1]]

    def rising(time):  # to where it sees a little of the sky
        heading, elevation = 0.1 * np.sin(3 * time), np.radians(-40 + 14 * min(time, 2))
        across = np.cos(elevation)
        forward = np.array([np.sin(heading) * across, np.cos(heading) * across, np.sin(elevation)])
        return looking(forward, (0.0, -0.35, 0.3))

    place = fastibl.CubeMap(sky.astype(np.float32))
    film = fastibl.simulate(place, seconds=3, fps=5, size=(320, 240), path=rising, hand=False, lamp=False)
    true = film.truth.environment(0.0)
    capture, found, seen = fastibl.Capture(size=64, board=film.board, paper_albedo=PAPER), [], 0.0
    for frame in film:
        capture.add(frame.back, film.rig.back, film.truth.pose(frame.time), frame.back_exposure, frame.time)
        environment = capture.environment()
        found.append(fastibl.Lighting(environment).irradiance(up)[0, 1] / fastibl.Lighting(true).irradiance(up)[0, 1])
        seen = max(seen, 1 - environment.knowledge["unseen_sky"])
    low_end, high_end = environment.predicted_interval
    error = irradiance_error(environment, true)
    print(f"light of the board by what is true: {min(found):.2f} to {max(found):.2f}, {seen:.0%} of the sky seen")
    print(f"irradiance {error:.1%} off, stated {low_end:.1%} to {high_end:.1%}")
    assert seen > 0.03 and min(found) > 0.9 and max(found) < 1.1
    assert error <= high_end


def test_a_tinted_camera_reads_the_same_light():
    """What a camera makes of each channel is told as its tint: the board's white is read with it."""
    film = fastibl.simulate(seconds=1, fps=4, size=(320, 240), lamp=False, hand=False)
    read = []
    for tint in ((1.0, 1.0, 1.0), (2.0, 1.0, 0.5)):
        capture = fastibl.Capture(size=32, board=film.board)
        for frame in film:
            linear = film.rig.back.response.decode(frame.back / np.float32(255)) * np.float32(tint)
            pose = film.truth.pose(frame.time)
            capture.add(linear.astype(np.float32), film.rig.back, pose, frame.back_exposure, frame.time, tint=tint)
        env = capture.environment()
        up = fastibl.texel_directions(32)[..., 2] > 0
        read.append(np.concatenate([env.plane_irradiance, env.radiance.faces[up & (env.confidence == 0)].mean(axis=0)]))
    print("irradiance of the plane, and what is unseen:", *np.round(read, 2), sep="\n")
    np.testing.assert_allclose(read[1], read[0], rtol=0.02)
