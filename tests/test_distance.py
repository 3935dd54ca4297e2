"""How far away the surroundings are, found from how pictures taken from several places differ."""

from __future__ import annotations

import numpy as np
import pytest
from test_near_lights import CAMERA, CENTRE, LOWER, UPPER, seen_from

import fastibl
from views import exposed, looking, picture_of

# Directions over the sky, and how far the walls are there.
_UP = (d := fastibl.texel_directions(32).reshape(-1, 3).astype(np.float64))[d[:, 2] > 0]
MEAN = 1 / (1 / np.where(_UP > 0, (UPPER - CENTRE) / _UP, (LOWER - CENTRE) / _UP).min(axis=1)).mean()


def room(eye, directions):
    return seen_from(eye, directions, lamp=False)


def far(eye, directions):
    """The same walls a hundred times as far away."""
    return room(CENTRE + 0.01 * (eye - CENTRE), directions)


def views(count, radius=0.35):
    """Poses all round, looking outwards past the object."""
    for k in range(count):
        a, up = 0.31 * k, 0.35 + 0.5 * (k % 3) / 2
        eye = CENTRE + [radius * np.cos(a), radius * np.sin(a), 0.2 + 0.1 * np.sin(0.9 * k)]
        yield looking([-np.cos(a) * np.cos(up), -np.sin(a) * np.cos(up), np.sin(up)], eye), eye


def film(capture, place, poses, camera=CAMERA, **options):
    for k, (pose, eye) in enumerate(poses):
        light = picture_of(lambda d, eye=eye: place(eye, d), camera, pose, split=2)
        capture.add(exposed(light, camera, 1.0), camera, pose, time=k / 10, **options)
        yield k


def after(capture, place, poses, **options):
    for _ in film(capture, place, poses, **options):
        pass
    return capture


def sky_error(environment):
    """Median over the seen sky of the relative error of radiance."""
    size = environment.radiance.size
    d = fastibl.texel_directions(size).astype(np.float64)
    seen = (np.asarray(environment.confidence) > 0) & (d[..., 2] > 0)
    true = seen_from(CENTRE, d, lamp=False)
    return float(np.median(np.abs(environment.radiance.faces - true)[seen] / true[seen]))


def test_walls_are_found_at_their_distance():
    capture = fastibl.Capture(size=64, centre=CENTRE)
    distances = [capture.distance for _ in film(capture, room, views(24))]
    told = after(fastibl.Capture(size=64, centre=CENTRE, distance=MEAN), room, views(24))
    distant = after(fastibl.Capture(size=64, centre=CENTRE, distance=np.inf), room, views(24))
    errors = [sky_error(c.environment()) for c in (capture, told, distant)]
    first = next(k for k, x in enumerate(distances) if np.isfinite(x))
    print(f"after {first + 1} pictures; {distances[-1]:.2f} m, mean of the walls {MEAN:.2f} m; errors {errors}")
    assert first < 6
    assert capture.distance == pytest.approx(MEAN, rel=0.2)
    assert errors[0] < 1.2 * errors[1] and errors[0] < 0.6 * errors[2]
    assert told.distance == pytest.approx(MEAN) and distant.distance == np.inf


def test_what_is_far_stays_so():
    capture = fastibl.Capture(size=64, centre=CENTRE)
    assert all(capture.distance == np.inf and capture.box is None for _ in film(capture, far, views(24)))
    told = after(fastibl.Capture(size=64, centre=CENTRE, distance=np.inf), far, views(24))
    assert np.array_equal(capture.environment().radiance.faces, told.environment().radiance.faces)


def test_without_parallax_nothing_is_found():
    """A camera that only turns, and walls without anything on them."""
    poses = [
        (looking([np.cos(0.3 * k), np.sin(0.3 * k), 0.4], CENTRE + [0, 0, 0.2]), CENTRE + [0, 0, 0.2])
        for k in range(20)
    ]
    assert after(fastibl.Capture(size=32, centre=CENTRE), room, poses).distance == np.inf
    blank = after(fastibl.Capture(size=32, centre=CENTRE), lambda _, d: np.full_like(d, 0.3), views(20))
    assert blank.distance == np.inf


def test_what_was_recorded_before_is_moved():
    """The first pictures are all that show one side; the distance is learned from the other."""
    capture = fastibl.Capture(size=64, centre=CENTRE)
    eye = CENTRE + [-0.3, 0.1, 0.3]
    pose = looking([-0.5, 0.85, 0.35], eye)
    after(capture, room, [(pose, eye)])
    before, held = capture.environment(), np.asarray(capture.environment().confidence) > 0
    assert capture.distance == np.inf
    poses = [(looking([1, -0.9, 0.5], e), e) for e in CENTRE + [[0.1 * k - 0.3, -0.07 * k, 0.3] for k in range(8)]]
    for k, (pose, e) in enumerate(poses):
        light = picture_of(lambda d, e=e: room(e, d), CAMERA, pose, split=2)
        capture.add(exposed(light, CAMERA, 1.0), CAMERA, pose, time=1 + k / 10)
    assert np.isfinite(capture.distance)
    moved = capture.environment()
    d = fastibl.texel_directions(64).astype(np.float64)
    side = (d @ [-0.5, 0.85, 0.35] > 0.5) & (d[..., 2] > 0)
    kept = side & (np.asarray(moved.confidence) > 0)
    true = seen_from(CENTRE, d, lamp=False)
    error = [
        float(np.median(np.abs(e.radiance.faces - true)[m] / true[m]))
        for e, m in ((before, held & side), (moved, kept))
    ]
    print(f"{held[side].sum()} texels, {kept.sum()} after; error {error[0]:.3f} before, {error[1]:.3f} after")
    assert kept.sum() > 0.8 * (held & side).sum()
    assert error[1] < 0.5 * error[0]


def test_the_plane_stays_as_it_was():
    capture = fastibl.Capture(size=32, centre=CENTRE)
    down = CENTRE + [0.3, 0.1, 0.5]
    after(capture, room, [(looking([-0.3, -0.1, -0.8], down), down)])
    d = fastibl.texel_directions(32)
    below = (d[..., 2] < 0) & (np.asarray(capture.environment().confidence) > 0)
    before = capture.environment().radiance.faces[below].copy()
    for k, (pose, eye) in enumerate(views(8)):
        light = picture_of(lambda d, eye=eye: room(eye, d), CAMERA, pose, split=2)
        looked_up = np.zeros((CAMERA.height, CAMERA.width), bool)
        looked_up[: CAMERA.height // 3] = True
        capture.add(exposed(light, CAMERA, 1.0), CAMERA, pose, time=1 + k / 10, mask=looked_up)
    assert np.isfinite(capture.distance) and below.any()
    assert np.array_equal(capture.environment().radiance.faces[below], before)


def test_a_wide_camera_finds_it_too():
    wide = fastibl.Camera.equirectangular(512, 256)
    capture = after(fastibl.Capture(size=64, centre=CENTRE), room, views(6), camera=wide)
    assert capture.distance == pytest.approx(MEAN, rel=0.25)


def rolled(eye, pose, turn, way, bands=12):
    """What a camera sees that turns and moves by this while it reads a picture, and its last pose."""
    height, rows = CAMERA.height // bands, []
    for band in range(bands):
        share = (band + 0.5) / bands
        at = eye + share * np.asarray(way)
        rotation = np.asarray((fastibl.Pose.from_rotation_vector(share * np.asarray(turn), [0, 0, 0]) @ pose).rotation)
        posed = fastibl.Pose(np.vstack([np.column_stack([rotation, -rotation @ at]), [0, 0, 0, 1]]))
        light = picture_of(lambda d, at=at: room(at, d), CAMERA, posed)
        rows.append(light[band * height : (band + 1) * height])
    rotation = np.asarray((fastibl.Pose.from_rotation_vector(turn, [0, 0, 0]) @ pose).rotation)
    last = fastibl.Pose(np.vstack([np.column_stack([rotation, -rotation @ (eye + way)]), [0, 0, 0, 1]]))
    return np.concatenate(rows), last


def test_a_rolling_shutter_finds_it_too():
    capture = fastibl.Capture(size=64, centre=CENTRE)
    for k, (pose, eye) in enumerate(views(8)):
        light, last = rolled(eye, pose, np.radians([0, 15, 2]), np.array([0.02, 0, 0.01]))
        capture.add(exposed(light, CAMERA, 1.0), CAMERA, pose, time=k / 10, last_row=last)
    assert capture.distance == pytest.approx(MEAN, rel=0.2)


def test_a_turned_map_keeps_its_distance():
    capture = after(fastibl.Capture(size=64, centre=CENTRE), room, views(12))
    found = capture.distance
    capture.turn(fastibl.Pose.from_rotation_vector([0, 0, 0.7], [0, 0, 0]))
    assert capture.distance == pytest.approx(found)


def test_a_prior_map_still_stands_for_what_is_unseen():
    true = seen_from(CENTRE, fastibl.texel_directions(64).astype(np.float64), False).astype(np.float32)
    prior = fastibl.CubeMap(2 * true)
    above = fastibl.texel_directions(64)[..., 2] > 0
    error = {}
    for distance in (None, MEAN):
        capture = after(fastibl.Capture(size=64, centre=CENTRE, prior=prior, distance=distance), room, views(5))
        assert np.isfinite(capture.distance)
        environment = capture.environment()
        unseen = above & (np.asarray(environment.confidence) == 0)
        error[distance] = float(np.abs(environment.radiance.faces / true - 1)[unseen].max())
        print(f"{unseen.sum()} texels of the sky unseen, at most {100 * error[distance]:.1f} % off")
    assert error[None] < 0.05


def test_the_papers_capture_knows_of_no_distance():
    rig = fastibl.Rig(CAMERA)
    scene = fastibl.Scene(fastibl.shapes.figurine())
    for methods, distance, expected in (("paper", None, np.inf), ("paper", 2.0, 2.0), ("auto", None, np.inf)):
        session = fastibl.Session(scene, rig, methods=methods, distance=distance, cast_shadow=False)
        assert session.capture.distance == pytest.approx(expected)
