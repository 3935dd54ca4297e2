"""Rooms with near walls and lamps: a box, and lights that are triangulated."""

from __future__ import annotations

import numpy as np
import pytest

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.demo import demo_scene
from views import exposed, looking, picture_of

CENTRE = np.array([0.0, 0.0, 0.1])
LAMP, RADIUS = np.array([0.9, 0.7, 1.1]), 0.12  # metres
LOWER, UPPER = np.array([-2.0, -2.4, -0.01]), np.array([2.2, 1.9, 2.5])
CAMERA = fastibl.Camera(320, 240, 200.0, 200.0, 160.0, 120.0)


def wall_radiance(points):
    """Smooth, other in each direction."""
    x, y, z = np.moveaxis(points, -1, 0)
    return 0.3 + 0.15 * np.sin(2 * x + 1) * np.cos(1.5 * y) + 0.1 * np.sin(3 * z)


def seen_from(eye, directions, lamp=True):
    """Radiance (..., 3) of a box with a globe in it."""
    d = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    with np.errstate(divide="ignore"):
        t = np.where(d > 0, (UPPER - eye) / d, (LOWER - eye) / d).min(axis=-1)
    light = wall_radiance(eye + t[..., None] * d)
    if lamp:
        along = (LAMP - eye) @ np.moveaxis(d, -1, -2) if d.ndim == 2 else d @ (LAMP - eye)
        miss = np.sum((LAMP - eye) ** 2) - along**2
        light = np.where((along > 0) & (miss < RADIUS**2), 60.0, light)
    return np.repeat(light[..., None], 3, axis=-1)


def picture(eye, pose, exposure, lamp=True):
    light = picture_of(lambda d: seen_from(eye, d, lamp), CAMERA, pose, split=2)
    return exposed(light, CAMERA, exposure)


def film(capture, frames=30, lamp=lambda k: True, after=None, exposures=(1.5, 1 / 90)):
    """A camera that is carried past the lamp, 0.8 m, and looks at it and beside it."""
    for k in range(frames):
        a = k / (frames - 1)
        eye = np.array([-0.4 + 0.8 * a, -0.25 + 0.2 * np.sin(4 * a), 0.3])
        pose = looking(LAMP + [0.3 * np.sin(9 * a), 0.1, 0.2 * np.cos(7 * a)] - eye, eye)
        exposure = exposures[k % len(exposures)]
        capture.add(picture(eye, pose, exposure, lamp(k)), CAMERA, pose, exposure=exposure, time=k / 15)
        if after:
            after(k)


def truth(size=128, lamp=True):
    d = fastibl.texel_directions(size).astype(np.float64)
    return seen_from(CENTRE, d, lamp)


def test_a_lamp_is_found_where_it_hangs():
    capture = fastibl.Capture(size=64, centre=CENTRE)
    film(capture)
    (light,) = fastibl.main_lights(capture.environment())
    error = np.linalg.norm(np.array(light.position) - LAMP)
    sigma = np.sqrt(np.diag(light.covariance))
    true = (LAMP - CENTRE) / np.linalg.norm(LAMP - CENTRE)
    angle = np.degrees(np.arccos(min(1, np.dot(light.direction, true))))
    flux = 60 * np.pi * RADIUS**2 / np.sum((LAMP - CENTRE) ** 2)
    print(f"{1e3 * error:.0f} mm off, stated {1e3 * np.linalg.norm(sigma):.0f} mm; {angle:.2f} degrees")
    print(f"irradiance {light.irradiance[0]:.3f}, true {flux:.3f}")
    assert error < 0.12
    assert error < 3.5 * np.linalg.norm(sigma)
    assert angle < 1
    assert light.irradiance[0] == pytest.approx(flux, rel=0.1)


def test_a_lamp_is_as_wide_from_wherever_it_is_seen():
    """From aside, 60 degrees and more from where the centre looks at it, it was drawn out: up to 2.9 of its light."""
    capture = fastibl.Capture(size=64, centre=CENTRE)
    film(capture)
    true = truth(128)
    flux = float((true[..., 0] * (true[..., 0] > 5) * fastibl.texel_solid_angles(128)).sum())
    out = (LAMP - CENTRE) / np.linalg.norm(LAMP - CENTRE)
    aside = np.cross(out, [0, 0, 1]) / np.linalg.norm(np.cross(out, [0, 0, 1]))
    for k, turn in enumerate(np.radians([60, -70, 80])):
        eye = LAMP - 0.8 * (np.cos(turn) * out + np.sin(turn) * aside)
        pose = looking(LAMP - eye, eye)
        for exposure in (1.5, 1 / 90):
            capture.add(picture(eye, pose, exposure), CAMERA, pose, exposure=exposure, time=3.0 + k)
        faces = capture.environment().radiance.faces[..., 0]
        got = float((faces * (faces > 5) * fastibl.texel_solid_angles(64)).sum())
        print(f"seen {np.degrees(turn):.0f} degrees from aside: {got / flux:.2f} of the lamp's light")
        assert got == pytest.approx(flux, rel=0.12)


@pytest.mark.parametrize("size", [64, 128])
def test_a_lamp_does_not_go_out_while_its_place_is_found(size):
    """The map moves it to where it is, also before a picture in which it clips: that alone would leave half of it."""
    capture = fastibl.Capture(size=size, centre=CENTRE)
    flux, placed, angles = [], [], fastibl.texel_solid_angles(size)

    def look(_):
        environment = capture.environment()
        radiance = environment.radiance
        faces = radiance.faces[..., 0]
        flux.append(float((faces * (faces > 2) * angles).sum()))
        placed.append(len(environment.light_positions) > 0)
        anew = fastibl.CubeMap(radiance.faces)
        for level in range(radiance.level_count):
            np.testing.assert_array_equal(radiance.level(level), anew.level(level))

    film(capture, after=look, exposures=(1.5, 1 / 30, 1 / 90))
    seen = np.array(flux[2:])  # from the first picture on in which it does not clip
    steps = seen[1:] / seen[:-1]
    print(f"{size}: placed at picture {placed.index(True)}; steps {steps.min():.2f} to {steps.max():.2f}")
    assert not placed[2] and placed[-1]
    assert steps.min() > 0.7 and steps.max() < 1.4


@pytest.mark.parametrize("order", [("near", "far"), ("far", "near")])
def test_a_360_camera_beside_the_object_counts_more_than_one_across_the_room(order):
    """Walls and lamp are seen elsewhere from 2.2 m away: the last picture made that 11 % off, stated 0.3 %."""
    camera = fastibl.Camera.equirectangular(256, 128)
    eyes = {"near": CENTRE + [0, 0, 0.1], "far": CENTRE + [1.6, -1.4, 0.6]}
    capture = fastibl.Capture(size=32, centre=CENTRE, locate_lights=False)
    for k, place in enumerate(order):
        pose = looking(np.array([0.0, 1.0, 0.0]), eyes[place])
        light = picture_of(lambda d, eye=eyes[place]: seen_from(eye, d), camera, pose, split=2)
        for exposure in (1.5, 1 / 90):
            capture.add(exposed(light, camera, exposure), camera, pose, exposure=exposure, time=float(k))
    environment = capture.environment()
    error = irradiance_error(environment.radiance, fastibl.CubeMap(truth(64).astype(np.float32)))
    print(f"{order}: irradiance {100 * error:.1f} % off, stated up to {100 * environment.predicted_interval[1]:.1f} %")
    assert error < min(0.05, environment.predicted_interval[1])


def test_without_it_the_lamp_is_beside_itself():
    capture = fastibl.Capture(size=64, centre=CENTRE, locate_lights=False)
    film(capture)
    lights = fastibl.main_lights(capture.environment())
    true = (LAMP - CENTRE) / np.linalg.norm(LAMP - CENTRE)
    angles = [np.degrees(np.arccos(min(1, np.dot(light.direction, true)))) for light in lights]
    print(f"degrees off: {angles}")
    assert angles and min(angles) > 3
    assert all(light.position is None and light.covariance is None for light in lights)


def test_a_lamp_that_is_switched_off_is_forgotten():
    capture = fastibl.Capture(size=64, centre=CENTRE)
    film(capture, 40, lamp=lambda k: k < 20)
    assert fastibl.main_lights(capture.environment()) == []
    assert capture.environment().radiance.faces.max() < 5


def test_distant_lights_have_no_position():
    d = fastibl.texel_directions(64).astype(np.float64)
    towards = LAMP / np.linalg.norm(LAMP)
    faces = np.full((6, 64, 64, 3), 0.2, np.float32)
    faces[d @ towards > np.cos(0.08)] = 40
    place = fastibl.CubeMap(faces)
    capture = fastibl.Capture(size=64, centre=CENTRE)
    for k in range(20):
        eye = np.array([-0.4 + 0.04 * k, -0.2, 0.3])
        pose = looking(towards + [0.1 * np.sin(k), 0, 0], eye)
        exposure = (1.5, 1 / 90)[k % 2]
        codes = exposed(picture_of(place.sample, CAMERA, pose), CAMERA, exposure)
        capture.add(codes, CAMERA, pose, exposure=exposure, time=k / 15)
    (light,) = fastibl.main_lights(capture.environment())
    assert light.position is None or np.linalg.norm(light.position) > 8
    # Seen from 0.8 m of places, it is far: so the place is, as far as is known.
    knowledge = capture.environment().knowledge
    assert 0 <= knowledge["parallax_doubt"] < 0.01 and 0 <= knowledge["parallax"] < 0.01


def test_the_interval_allows_for_near_things_until_they_are_known():
    """No lamp is to be seen, and whoever says that the walls are far may be wrong."""
    film(unsure := fastibl.Capture(size=64, centre=CENTRE, distance=np.inf), 12, lamp=lambda k: False)
    film(told := fastibl.Capture(size=64, centre=CENTRE, box=(LOWER, UPPER)), 12, lamp=lambda k: False)
    a, b = unsure.environment(), told.environment()
    print(a.knowledge, a.predicted_interval, b.predicted_interval)
    assert a.knowledge["parallax_doubt"] > 0.01 and b.knowledge["parallax_doubt"] == 0
    assert a.predicted_interval[1] > a.predicted_error + 0.5 * a.knowledge["parallax_doubt"]
    film(found := fastibl.Capture(size=64, centre=CENTRE))  # the lamp is, and is near
    knowledge = found.environment().knowledge
    assert knowledge["parallax_doubt"] == 0 and knowledge["parallax"] > 0


def turn_about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def film_around(capture, yaw=0.0, first=0):
    """A camera that is carried around the centre and looks across it, in a room whose walls are turned."""
    turned = turn_about_z(yaw)
    for k in range(24):
        a, up = k * 0.62, 0.25 + 0.8 * (k % 3) / 2
        eye = CENTRE + [0.4 * np.cos(a), 0.4 * np.sin(a), 0.35]
        towards = np.array([-np.cos(a) * np.cos(up), -np.sin(a) * np.cos(up), np.sin(up)])
        pose = looking(towards, eye)
        codes = picture(eye, pose, 1.0, lamp=False)
        capture.add(codes, CAMERA, looking(turned @ towards, turned @ eye), time=first + k / 10)


def error_in_room(environment, yaw=0.0):
    d = fastibl.texel_directions(64).astype(np.float64)
    seen = (np.asarray(environment.confidence) > 0) & (d[..., 2] > 0)
    true = seen_from(CENTRE, d @ turn_about_z(yaw), lamp=False)
    return float(np.median(np.abs(np.asarray(environment.radiance.faces) - true)[seen] / true[seen]))


def test_a_box_puts_walls_where_they_are():
    errors = {}
    told = {"infinity": {"distance": np.inf}, "3 m": {"distance": 3.0}, "box": {"box": (LOWER, UPPER)}}
    for name, options in told.items():
        capture = fastibl.Capture(size=64, centre=CENTRE, **options)
        film_around(capture)
        errors[name] = error_in_room(capture.environment())
    print(errors)
    assert errors["box"] < 0.01
    assert errors["box"] < errors["3 m"] / 3 < errors["infinity"] / 3
    true = truth(64, lamp=False)
    assert irradiance_error(true, true) == 0


@pytest.mark.parametrize("degrees", [30.0, -75.0, 200.0])
def test_walls_at_an_angle_to_the_marker(degrees):
    yaw = np.radians(degrees)
    errors = {}
    for name, options in {"told": {"box_yaw": yaw}, "not told": {}}.items():
        capture = fastibl.Capture(size=64, centre=CENTRE, box=(LOWER, UPPER), **options)
        film_around(capture, yaw)
        errors[name] = error_in_room(capture.environment(), yaw)
    print(errors)
    assert errors["told"] < 0.01
    assert errors["told"] < errors["not told"] / 3


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0, -75.0])
def test_walls_that_nobody_told_are_found(degrees):
    """At any angle; which of them is which, nobody knows."""
    yaw = np.radians(degrees)
    errors = {}
    for name, options in {
        "found": {},
        "3 m": {"distance": 3.0},
        "told": {"box": (LOWER, UPPER), "box_yaw": yaw},
    }.items():
        capture = fastibl.Capture(size=64, centre=CENTRE, **options)
        film_around(capture, yaw)
        errors[name] = error_in_room(capture.environment(), yaw)
        if name == "found":
            box, turn = capture.box, np.degrees(capture.box_yaw)
            assert capture.environment().box is None  # it is capture's own: nobody told it
        assert (capture.box is None) == (name == "3 m")
    off = (turn - degrees + 45) % 90 - 45
    quarter = round((turn - degrees - off) / 90) % 2
    true = np.array([UPPER - LOWER, (UPPER - LOWER)[[1, 0, 2]]])[quarter]
    print(f"{degrees} degrees: {box.round(2).tolist()}, {off:.1f} degrees off; errors {errors}")
    assert abs(off) < 6 and abs(box[1, 2] / UPPER[2] - 1) < 0.03
    np.testing.assert_allclose((box[1] - box[0])[:2], true[:2], rtol=0.15)
    assert errors["found"] < errors["3 m"] / 2


def test_walls_turn_with_a_marker_that_is_turned():
    """They stayed where they were against the marker, and what was captured from then on was put elsewhere."""
    yaw = np.radians(50)
    capture = fastibl.Capture(size=64, centre=CENTRE, box=(LOWER, UPPER))
    film_around(capture)
    capture.turn(fastibl.Pose.from_rotation_vector((0, 0, yaw), (0, 0, 0)))
    film_around(capture, yaw, first=10)
    fresh = fastibl.Capture(size=64, centre=CENTRE, box=(LOWER, UPPER), box_yaw=yaw)
    film_around(fresh, yaw)
    turned, told = capture.environment(), fresh.environment()
    print(f"turned {error_in_room(turned, yaw):.4f}, told {error_in_room(told, yaw):.4f}")
    assert error_in_room(turned, yaw) < 0.01
    assert turned.box_yaw == pytest.approx(told.box_yaw) == yaw
    np.testing.assert_array_equal(turned.box, [LOWER, UPPER])


@pytest.mark.parametrize(
    "box",
    [
        ((-1, -1, 0.2), (1, 1, 2)),  # the centre lies below
        ((1, 1, 1), (-1, -1, -1)),
        ((-1, -1, 0), (1, np.nan, 2)),
        ((-1, -1, 0), (1, np.inf, 2)),
    ],
)
def test_bad_boxes_are_refused(box):
    with pytest.raises(ValueError, match="box must be finite and hold the centre"):
        fastibl.Capture(size=16, centre=CENTRE, box=box)


@pytest.mark.parametrize("yaw", [np.nan, np.inf])
def test_a_bad_yaw_is_refused(yaw):
    with pytest.raises(ValueError, match="yaw of the room's box must be finite"):
        fastibl.Capture(size=16, centre=CENTRE, box=(LOWER, UPPER), box_yaw=yaw)


@pytest.mark.parametrize(
    "make",
    [
        lambda: fastibl.Capture(size=16, centre=CENTRE, box_yaw=0.3),
        lambda: fastibl.Environment(fastibl.CubeMap(np.ones((6, 4, 4, 3), np.float32)), box_yaw=0.3),
        lambda: fastibl.Session(demo_scene(), fastibl.Rig(CAMERA), fastibl.Board.default(), box_yaw=0.3),
    ],
    ids=["capture", "environment", "session"],
)
def test_a_yaw_without_a_box_is_refused(make):
    with pytest.raises(ValueError, match="box_yaw turns a box, and no box was given"):
        make()


def test_the_centre_is_looked_for_along_the_walls():
    """A long, narrow room holds it only as it stands."""
    box = ((-0.2, -0.2, 0), (3, 0.2, 2))
    fastibl.Capture(size=16, centre=(1, 1, 0.1), box=box, box_yaw=np.pi / 4)
    with pytest.raises(ValueError, match="hold the centre, got -0.2 to 0.2 along axis 1 around 1"):
        fastibl.Capture(size=16, centre=(1, 1, 0.1), box=box)
