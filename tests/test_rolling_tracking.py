"""Poses by row: boards through a rolling shutter, sessions of it, and the calibration of when pictures are taken."""

import copy
import itertools
import pickle
from functools import cache

import numpy as np
import pytest

import fastibl
from bench.capture.board_film import CAMERA, HARD, Look, picture, small_turn
from bench.capture.rolling_film import FPS, PATHS, READOUT, ROLLING, board_light, film
from fastibl.__main__ import main
from fastibl._fastibl import _EdgeTracker
from fastibl.calibration import PosePath, calibrate_timing
from fastibl.calibration.timing import _where
from fastibl.extremes.board_pictures import look_at, rotation_error_degrees
from fastibl.recording import RecordingWriter, read_rig, write_rig
from fastibl.tracking import detect

BOARD = fastibl.Board.default()


@cache
def long_film(name, seed):
    return film(BOARD, PATHS[name](seed), ROLLING, 40, seed), []


def shots(name, seed=0, frames=20):
    """Made as far as any test asks."""
    coming, made = long_film(name, seed)
    while len(made) < frames:
        made.append(next(coming))
    return made[:frames]


def error(pose, truth):
    return rotation_error_degrees(pose.matrix, truth)


@pytest.mark.parametrize("name", PATHS)
def test_first_and_last_row(name):
    """Both poses are right, and the stated deviations too; one pose for all rows is off by degrees."""
    path, tracker, ignorant = PATHS[name](0), fastibl.Tracker(BOARD, ROLLING), fastibl.Tracker(BOARD, CAMERA)
    first, last, ignored, ratios = [], [], [], []
    for now, image in shots(name):
        tracked = tracker.track(image, now)
        first.append(error(tracked.camera_from_marker, path(now)))
        last.append(error(tracked.last_row, path(now + READOUT)))
        ignored.append(error(ignorant.track(image, now).camera_from_marker, path(now)))
        w = small_turn(path(now)[:3, :3] @ tracked.camera_from_marker.rotation.T)
        ratios.append(np.sqrt(w @ np.linalg.solve(tracked.covariance[:3, :3], w) / 3))
        assert (np.linalg.eigvalsh(tracked.covariance) > 0).all()
    print(
        f"\n{name}: p95 {np.percentile(first, 95):.4f}, last row {np.percentile(last, 95):.4f}, first picture "
        f"{first[0]:.3f}, ignored {np.percentile(ignored, 95):.2f} degrees; by stated {np.median(ratios):.2f}"
    )
    assert np.percentile(first[1:], 95) <= 0.05 and np.percentile(last[1:], 95) <= 0.1 and first[0] < 0.5
    assert np.percentile(ignored, 95) > 0.9
    assert 0.2 < np.median(ratios) < 2


def test_a_still_camera_is_as_good_as_with_a_global_shutter():
    pose = look_at(25, 0.45, 40, 10)
    light, rng = board_light(BOARD, lambda t: pose, 0.0, ROLLING), np.random.default_rng(0)
    rolling, still = fastibl.Tracker(BOARD, ROLLING), fastibl.Tracker(BOARD, CAMERA)
    off, moved = [], []
    for k in range(12):
        image = picture(light, Look(), rng)
        tracked = rolling.track(image, k / FPS)
        off.append(error(tracked.camera_from_marker, pose))
        moved.append(error(tracked.last_row, pose))
        assert still.track(image, k / FPS).last_row is None
    print(f"\nfirst row {max(off):.4f}, last row {max(moved):.4f} degrees at most")
    assert off[0] < 0.1 and max(off[1:]) < 0.01 and max(moved[1:]) < 0.03


@pytest.mark.parametrize("name", ["4 px motion", "30 % hidden", "cast shadow", "defocus 2 px", "JPEG 30"])
def test_hard_pictures(name):
    path, tracker = PATHS["around the board"](1), fastibl.Tracker(BOARD, ROLLING)
    off = [
        error(tracker.track(image, now).camera_from_marker, path(now))
        for now, image in film(BOARD, path, ROLLING, 12, 1, HARD[name])
    ]
    print(f"\n{name}: median {np.median(off):.4f}, worst after three pictures {max(off[3:]):.4f} degrees")
    assert max(off[3:]) < 0.2


def test_a_trembling_hand():
    """Turns of 0.13 degrees at 2.5 to 8 Hz about each axis: up to a quarter of a wave in a readout."""
    rng = np.random.default_rng(3)
    phase, waves = rng.uniform(0, 2 * np.pi, (3, 3)), rng.uniform(2.5, 8, (3, 3))

    def path(time):
        turn = 0.0022 * np.sin(2 * np.pi * waves * time + phase).sum(1)
        shake = fastibl.Pose.from_rotation_vector(turn, [0.0, 0.0, 0.0])
        return shake.matrix @ look_at(35, 0.45, 40 + 20 * time)

    tracker = fastibl.Tracker(BOARD, ROLLING)
    off = [
        error(tracker.track(image, now).camera_from_marker, path(now)) for now, image in film(BOARD, path, ROLLING, 14)
    ]
    print(f"\nmedian {np.median(off):.3f}, worst after the first picture {max(off[1:]):.3f} degrees")
    assert max(off[1:]) < 0.2


def test_recovers_with_the_first_picture_after_a_gap():
    path, tracker = PATHS["about the view"](0), fastibl.Tracker(BOARD, ROLLING)
    blank = picture(np.full((480, 640), 0.25, np.float32), Look(), np.random.default_rng(0))
    for k, (now, image) in enumerate(shots("about the view")):
        away = 5 <= k < 16
        tracked = tracker.track(blank if away else image, now)
        assert (tracked is None) == away
        if not away:
            assert error(tracked.camera_from_marker, path(now)) < 0.5


def test_goes_on_from_corners_where_edges_cannot_be_followed():
    """Pictures in which a detector alone finds tags: the next one is predicted from them, not from before."""
    path, tracker = PATHS["about the view"](0), _EdgeTracker(BOARD, ROLLING)
    blank = picture(np.full((480, 640), 0.25, np.float32), Look(), np.random.default_rng(0))
    for k, (now, image) in enumerate(shots("about the view")[:14]):
        middle = path(now + 0.5 * READOUT)

        def corners(grey, board, camera, pose=middle):
            at = [np.pad(tag.corners, ((0, 0), (0, 1))) @ pose[:3, :3].T + pose[:3, 3] for tag in board.tags]
            return [(tag.id, CAMERA.project(a)) for tag, a in zip(board.tags, at, strict=True)], None

        hidden = 3 <= k < 8
        tracked = tracker.track(blank if hidden else image, now, detect if k == 0 else corners if hidden else nothing)
        assert tracked is not None and (tracked.edges == 0) == hidden, k
        off = error(tracked.camera_from_marker, path(now))
        assert off < (2.5 if hidden else 0.2), (k, off)


def nothing(grey, board, camera):
    return [], None


@pytest.mark.parametrize("method", ["board", "frame-marker"])
def test_corners_by_rows(method):
    """One picture's corners tell less than edges: better than as if seen at once, where a motion can be told."""
    path, tracker = PATHS["about the view"](0), fastibl.Tracker(BOARD, ROLLING, method)
    plain, off, before = fastibl.Tracker(BOARD, CAMERA, method), [], []
    for now, image in shots("about the view"):
        tracked = tracker.track(image, now)
        off.append(error(tracked.camera_from_marker, path(now)))
        before.append(error(plain.track(image, now).camera_from_marker, path(now)))
        assert (tracked.last_row is None) == (method == "frame-marker")
    print(f"\n{method}: median {np.median(off):.3f}, as if seen at once {np.median(before):.3f} degrees")
    if method == "board":
        assert np.median(off) < 0.6 * np.median(before)
    else:
        assert off == before


def test_tracked_with_a_last_row_is_a_value():
    now, image = shots("sideways")[0]
    tracked = fastibl.Tracker(BOARD, ROLLING).track(image, now)
    assert pickle.loads(pickle.dumps(tracked)) == tracked == copy.copy(tracked)
    assert isinstance(tracked.last_row, fastibl.Pose)


def test_smoothing_keeps_the_motion_between_the_rows():
    plain, smooth = fastibl.Tracker(BOARD, ROLLING), fastibl.Tracker(BOARD, ROLLING, smoothing=0.1)
    for now, image in shots("around the board", frames=8):
        a, b = plain.track(image, now), smooth.track(image, now)
    for tracked in (a, b):
        turn = tracked.last_row.rotation @ tracked.camera_from_marker.rotation.T
        assert np.degrees(np.linalg.norm(small_turn(turn))) == pytest.approx(1.92, abs=0.15)
    assert error(b.camera_from_marker, a.camera_from_marker.matrix) > 1  # it lags


def rotations(name, offset, step=0.005, seed=0):
    """By a clock that shows `offset` more, of a thing mounted aslant."""
    mount = fastibl.Pose.from_rotation_vector([0.3, -1.0, 0.5], [0.1, 0.2, 0.3]).matrix
    times = np.arange(-0.3, 1.7, step)
    return times + offset, np.array([mount @ PATHS[name](seed)(t) for t in times])


@pytest.mark.parametrize("offset", [0.02, -0.07])
def test_readout_and_offset_are_found(offset):
    timing = calibrate_timing(
        shots("up and down", 1, 40), CAMERA, BOARD, poses=rotations("up and down", offset, seed=1)
    )
    print(f"\n{timing.readout} +- {timing.readout_deviation}, {timing.clock_offset} +- {timing.clock_offset_deviation}")
    assert abs(timing.readout - READOUT) < 2e-4 and timing.readout_deviation < 1e-3
    assert abs(timing.clock_offset - offset) < 1e-3
    assert abs(timing.clock_offset - offset) < 5 * timing.clock_offset_deviation
    assert timing.frames > 30 and len(timing.times) == len(timing.poses) == 40


MOUNT = np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])  # camera axes from those of a telephone held upright


def gyro_log(path, offset, began=0.0):
    """Times and rates about a telephone's axes, with a bias of a degree a second."""
    times = np.arange(-0.3, 1.7, 0.005)
    bodies = [path(t + 0.0) for t in times]
    steps = [small_turn(b[:3, :3] @ a[:3, :3].T) / 0.005 for a, b in itertools.pairwise(bodies)]
    return times[:-1] + 0.0025 + offset + began, -np.array(steps) @ MOUNT + np.radians(1.0)


def test_a_gyroscope_tells_the_offset_too():
    """Rates about its own axes. Turns about one axis do not tell how it lies in the camera."""
    timing = calibrate_timing(shots("sideways", 0, 40), CAMERA, BOARD, gyro=gyro_log(PATHS["sideways"](0), 0.02))
    print(f"\n{1e3 * timing.clock_offset:.2f} +- {1e3 * timing.clock_offset_deviation:.2f} ms")
    assert abs(timing.clock_offset - 0.02) < 1e-3 and timing.gyroscope.clock_offset == timing.clock_offset
    with pytest.raises(ValueError, match="about more than one axis"):
        timing.gyroscope.attitudes([0.0])


def about_three_axes(time):
    """A hand that turns 40 degrees a second."""
    turn = np.eye(4)
    w = np.array([0.12, 0.15, 0.2]) * np.sin(np.array([5.0, 4.0, 3.0]) * time + [0.0, 1.0, 2.0])
    turn[:3, :3] = fastibl.Pose.from_rotation_vector(w, np.zeros(3)).rotation
    return turn @ look_at(30, 0.5, 40)


@cache
def turned_all_ways():
    return list(film(BOARD, about_three_axes, ROLLING, 40, 3))


def test_a_telephone_clock_counts_from_its_start():
    """A log of hours after it, found by how fast both turn; and how the camera turned by it."""
    began, shown = 81234.5678, turned_all_ways()
    times, rates = gyro_log(about_three_axes, 0.02, began)
    with pytest.raises(ValueError, match="cover"):
        calibrate_timing(shown, CAMERA, BOARD, gyro=(times, rates))
    away = [(now, np.full_like(back, 90) if 14 <= k < 26 else back) for k, (now, back) in enumerate(shown)]
    found = calibrate_timing(away, CAMERA, BOARD, gyro=(times, rates), longest_offset=None)
    assert 15 < found.frames < 30, "the board was out of view"
    attitudes = found.gyroscope.attitudes([now for now, _ in shown])
    rest = [a.T @ about_three_axes(now)[:3, :3] for a, (now, _) in zip(attitudes, shown, strict=True)]
    off = [np.degrees(np.linalg.norm(small_turn(r @ rest[0].T))) for r in rest]
    mount = np.degrees(np.linalg.norm(small_turn(found.gyroscope.camera_from_gyro @ MOUNT.T)))
    stated = np.degrees(found.gyroscope.deviation)
    print(f"\n{found.gyroscope}: axes {mount:.2f} degrees off, {stated:.2f} stated, attitudes up to {max(off):.3f}")
    assert abs(found.clock_offset - began - 0.02) < 2e-3 and max(off) < 0.2 and mount < 1 and stated < 1
    assert found.gyroscope.attitudes([-5.0, 1e9]) == [None, None]
    other = rates[np.random.default_rng(0).permutation(len(rates))]
    for wrong in (other, rates[:40], 0 * rates):
        with pytest.raises(ValueError, match="nowhere .* does the gyroscope turn as the camera does"):
            _where(found, times[: len(wrong)], wrong)
    with pytest.raises(ValueError, match="log lasts .* expected at most 40000: are its times in seconds"):
        _where(found, 1e9 * times, rates)
    with pytest.raises(ValueError, match="give gyro or longest_offset"):
        calibrate_timing(shown, CAMERA, BOARD, longest_offset=None)


def test_the_command_writes_attitudes(tmp_path, capsys):
    rig, log, folder = str(tmp_path / "rig.yaml"), tmp_path / "log.csv", str(tmp_path / "film")
    write_rig(rig, fastibl.Rig(CAMERA))
    with RecordingWriter(folder, fastibl.Rig(CAMERA), BOARD) as writer:
        for now, back in turned_all_ways():
            writer.add(fastibl.Frame(now, back))
    with open(log, "w") as file:
        file.write("timestamp,gx,gy,gz\n")
        np.savetxt(file, np.column_stack(gyro_log(about_three_axes, 0.02, 4321.0)), delimiter=",", fmt="%.6f")
    timing = ["calibrate", "timing", folder, "--rig", rig]
    assert main([*timing, "--gyro", str(log), "--attitudes"]) == 0
    assert "attitudes of 40 of 40 frames" in capsys.readouterr().out
    frames = list(fastibl.Recording.open(folder))
    rest = [f.attitude.T @ about_three_axes(f.time)[:3, :3] for f in frames]
    assert max(np.linalg.norm(small_turn(r @ rest[0].T)) for r in rest) < np.radians(0.3)
    assert main([*timing, "--attitudes"]) == 2 and "--gyro LOG" in capsys.readouterr().err


def test_a_global_shutter_is_found_to_be_one():
    path = PATHS["sideways"](0)
    timing = calibrate_timing(tuple(film(BOARD, path, CAMERA, 24, 0)), ROLLING, BOARD)
    print(f"\n{1e3 * timing.readout:.3f} +- {1e3 * timing.readout_deviation:.3f} ms")
    assert timing.readout < 1e-4 and timing.clock_offset is None and timing.clock_offset_deviation is None


def test_clocks_of_a_global_shutter():
    """What tracking errs by is no picture that is upside down."""
    above = fastibl.Pose.look_at([0.05, -0.35, 0.4], [0, 0, 0])

    def path(t):
        turn = 0.5 * np.array([0.35, 0.3, 0.4]) * np.sin(2 * np.pi * np.array([0.7, 0.9, 1.1]) * t + np.arange(3))
        return fastibl.Pose.from_rotation_vector(turn, [0.02 * np.sin(2 * t), 0.01 * np.cos(3 * t), 0]) @ above

    made = fastibl.simulate(
        seconds=2, fps=20, hand=False, lamp=False, path=path, clock_offset=0.1, rig=fastibl.Rig(CAMERA), live=True
    )
    times = np.arange(-0.5, 3, 0.005)
    bodies = [path(t).rotation for t in times]
    rates = -np.array([small_turn(b @ a.T) / 0.005 for a, b in itertools.pairwise(bodies)])
    timing = calibrate_timing(
        [(frame.time, frame.back) for frame in made], CAMERA, made.board, gyro=(times[:-1] + 0.0025, rates)
    )
    print(f"\n{timing.readout_deviation * 1e3:.3f} ms, {1e3 * timing.clock_offset:.2f} ms")
    assert timing.readout < 1e-4 and abs(timing.clock_offset - 0.1) < 1e-3


def test_two_cameras_that_see_the_board_tell_their_clocks_apart():
    """Another camera, mounted aslant and 13 ms late, against the tracked poses of the first."""
    path = PATHS["about the view"](0)
    mount = fastibl.Pose.from_rotation_vector([0.05, -0.08, 0.4], [0.01, 0.02, 0.0]).matrix
    first = calibrate_timing(shots("about the view", 0, 40), CAMERA, BOARD)
    late = [(t + 0.013, i) for t, i in film(BOARD, lambda t: mount @ path(t), ROLLING, 36, 1)]
    late.insert(9, late[8])  # of one time, as cameras give them
    second = calibrate_timing(late, CAMERA, BOARD, poses=(first.times, first.poses))
    print(f"\n{1e3 * second.clock_offset:.2f} +- {1e3 * second.clock_offset_deviation:.2f} ms")
    assert abs(second.clock_offset + 0.013) < 1e-3


def test_refusals():
    still = [(now, image) for now, image in film(BOARD, lambda t: look_at(25, 0.45, 40, 10), ROLLING, 14)]
    with pytest.raises(ValueError, match="12 pictures or more, got 3"):
        calibrate_timing(still[:3], CAMERA, BOARD)
    with pytest.raises(ValueError, match="motion does not tell the readout|does not move"):
        calibrate_timing(still, CAMERA, BOARD)
    blank = picture(np.full((480, 640), 0.25, np.float32), Look(), np.random.default_rng(0))
    with pytest.raises(ValueError, match="has a pose in 0 pictures"):
        calibrate_timing([(now, blank) for now, _ in still], CAMERA, BOARD)
    steady = shots("around the board")  # turns at a constant speed about one axis: any offset fits
    with pytest.raises(ValueError, match="offset|repeats"):
        calibrate_timing(steady, CAMERA, BOARD, poses=rotations("around the board", 0.02))
    brisk = shots("sideways")
    with pytest.raises(ValueError, match="at the end of what was looked at"):
        calibrate_timing(brisk, CAMERA, BOARD, poses=rotations("sideways", 0.12), longest_offset=0.05)
    with pytest.raises(ValueError, match="not both"):
        calibrate_timing(brisk, CAMERA, BOARD, poses=([], []), gyro=([], []))
    with pytest.raises(ValueError, match="n poses, got"):
        calibrate_timing(brisk, CAMERA, BOARD, poses=([0.0, 1.0], np.eye(3)))
    with pytest.raises(ValueError, match="rates, got"):
        calibrate_timing(brisk, CAMERA, BOARD, gyro=([0.0, 1.0], np.zeros(3)))
    with pytest.raises(ValueError, match="positive seconds"):
        calibrate_timing(brisk, CAMERA, BOARD, longest_offset=0.0)


def test_pictures_that_are_read_from_the_last_row_up_are_refused():
    upside_down = fastibl.Camera(640, 480, 522.0, 522.0, 320.0, 240.0)
    path = PATHS["about the view"](0)
    # The last row first: the same picture at mirrored times.
    frames = [
        (k / FPS, picture(_from_below(path, k / FPS), Look(), np.random.default_rng(k))) for k in range(24)
    ]  # fmt: skip
    with pytest.raises(ValueError, match="upside down"):
        calibrate_timing(frames, upside_down, BOARD)


def _from_below(path, time):
    """Row r at time + (1 - r / height) * readout: rows of a camera whose time runs backwards."""
    return board_light(BOARD, lambda t: path(2 * time + READOUT - t), time, ROLLING)


def test_pose_path():
    turn = fastibl.Pose.from_rotation_vector([0.0, 0.2, 0.0], [0.0, 0.0, 0.0])
    path = PosePath([1.0, 2.0], [fastibl.Pose(np.eye(4)), turn])
    assert path(1.0) == fastibl.Pose(np.eye(4)) and np.allclose(path(2.0).matrix, turn.matrix)
    half = fastibl.Pose.from_rotation_vector([0.0, 0.1, 0.0], [0.0, 0.0, 0.0])
    assert np.allclose(path(1.5).matrix, half.matrix)
    with pytest.raises(ValueError, match="from 1 to 2 s, not at 2.1 s"):
        path(2.1)
    with pytest.raises(ValueError, match="increase"):
        PosePath([1.0, 1.0], [turn, turn])
    with pytest.raises(ValueError, match="two or more"):
        PosePath([1.0], [turn])


def scene():
    mesh = fastibl.Mesh(np.float32([[0, 0, 0.11], [0.01, 0, 0.13], [0, 0.01, 0.13]]), np.array([[0, 1, 2]]))
    return fastibl.Scene(mesh, fastibl.Material(), spheres=0, visibility_rays=0)


def test_session_gives_rows_their_poses():
    """Tracked, given with both rows, and given with one: the last row's pose is right, and stands in the result."""
    path, rig = PATHS["around the board"](0), fastibl.Rig(ROLLING)
    sessions = [fastibl.Session(scene(), rig, board) for board in (BOARD, None, None)]
    for k, (now, image) in enumerate(shots("around the board", frames=8)):
        first, last = fastibl.Pose(path(now)), fastibl.Pose(path(now + READOUT))
        given = (
            fastibl.Frame(now, back=image),
            fastibl.Frame(now, back=image, back_from_marker=first, back_last_row=last),
            fastibl.Frame(now, back=image, back_from_marker=first),
        )
        results = [s.process(f) for s, f in zip(sessions, given, strict=True)]
        off = [None if r.back_last_row is None else error(r.back_last_row, last.matrix) for r in results]
        assert off[1] < 1e-9 and (off[2] is None) == (k == 0)
        assert results[0].back_last_row == results[0].tracked.last_row
        if k > 2:
            assert off[0] < 0.1 and off[2] < 0.02
    with pytest.raises(ValueError, match="back camera with a readout"):
        fastibl.Session(scene(), fastibl.Rig(CAMERA), None).process(
            fastibl.Frame(0.0, back_from_marker=first, back_last_row=last)
        )


def test_the_object_is_drawn_by_the_row_that_shows_it():
    """A thing on the board: where it is drawn, against where the rows show that place."""
    path, now = PATHS["sideways"](0), 0.4
    middle = fastibl.Pose(path(now + 0.5 * READOUT))
    place = np.array([0.03, -0.02, 0.0])
    small = 0.002 * np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = fastibl.Mesh(small, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))
    for aim in (place, -5 * place):
        there = fastibl.Pose.from_rotation_vector([0, 0, 0], aim)
        thing = fastibl.Scene(mesh, fastibl.Material(emission=(1, 1, 1)), there, spheres=0, visibility_rays=0)
        session = fastibl.Session(thing, fastibl.Rig(ROLLING), None)
        blank = np.zeros((480, 640, 3), np.uint8)
        first, last = fastibl.Pose(path(now)), fastibl.Pose(path(now + READOUT))
        image = session.process(
            fastibl.Frame(now, back=blank, back_from_marker=first, back_last_row=last)
        ).image.astype(float)
        weight = image.sum(-1)
        y, x = np.mgrid[:480, :640] + 0.5
        drawn = np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
        point = aim + small.mean(0)
        true = middle
        for _ in range(5):  # the row that shows it
            seen = CAMERA.project(true @ point)
            true = fastibl.Pose(path(now + (seen[1] - 0.5) / 480 * READOUT))
        by_middle = CAMERA.project(middle @ point)
        off = [np.linalg.norm(p - seen) for p in (drawn, by_middle, CAMERA.project(first @ point))]
        print("\ndrawn {:.2f} px off, by the middle row {:.2f}, by the first {:.2f}".format(*off))
        assert off[0] < 1.0


def test_the_readout_reaches_the_front_camera():
    """A front camera with a readout and a back one without: rows by the motion of the frames before."""
    path = PATHS["around the board"](0)
    turn = fastibl.Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    rng = np.random.default_rng(0)
    light = np.kron(rng.uniform(20, 230, (30, 40, 3)), np.ones((16, 16, 1))).astype(np.uint8)
    maps = []
    for readout in (0.0, READOUT):
        rig = fastibl.Rig(CAMERA, CAMERA.replace(readout=readout), turn)
        session = fastibl.Session(scene(), rig, None)
        expected = fastibl.Capture(size=128, centre=(0.005, 0.005, 0.12))
        for k in range(5):
            now = k / FPS
            first, last = (fastibl.Pose(path(now + s)) for s in (0.0, readout))
            session.process(fastibl.Frame(now, front=light, back_from_marker=first))
            known = k > 0 and readout > 0
            expected.add(light, rig.front, turn @ first, time=now, last_row=turn @ last if known else None)
        mine, theirs = (c.environment().radiance.faces for c in (session.capture, expected))
        seen = np.isfinite(expected.last_seen)
        maps.append(mine)
        difference = np.abs(mine - theirs)[seen].mean() / theirs[seen].mean()
        print(f"\nreadout {readout}: {100 * difference:.3f} % from what Capture makes of the true rows")
        assert difference < 0.01
    moved = np.abs(maps[0] - maps[1])[seen].mean() / maps[0][seen].mean()
    print(f"rows taken as read at once: {100 * moved:.1f} %")
    assert moved > 0.03


def test_a_front_picture_alone_takes_the_predicted_pose():
    path = PATHS["around the board"](0)
    turn = fastibl.Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    light = np.kron(np.random.default_rng(0).uniform(20, 230, (30, 40, 3)), np.ones((16, 16, 1))).astype(np.uint8)
    session = fastibl.Session(scene(), fastibl.Rig(CAMERA, CAMERA, turn), None)
    for k in range(3):
        session.process(fastibl.Frame(k / FPS, back_from_marker=fastibl.Pose(path(k / FPS))))
    session.process(fastibl.Frame(3 / FPS, front=light))
    faces, seen = session.capture.environment().radiance.faces, np.isfinite(session.capture.last_seen)
    off = []
    for time in (3 / FPS, 2 / FPS):
        expected = fastibl.Capture(size=128, centre=(0.005, 0.005, 0.12))
        expected.add(light, CAMERA, turn @ fastibl.Pose(path(time)), time=3 / FPS)
        both = seen & np.isfinite(expected.last_seen)
        theirs = expected.environment().radiance.faces[both]
        off.append(np.abs(faces[both] - theirs).mean() / theirs.mean())
    print(f"\n{off[0]:.2%} from the true pose's map, {off[1]:.1%} from that of the last pose")
    assert off[0] < 0.01 < 0.1 < off[1]


def test_command(tmp_path, capsys):
    """Readout into rig.yaml, and the offset between the cameras of a rig that both see a board."""
    rig = str(tmp_path / "rig.yaml")
    write_rig(rig, fastibl.Rig(CAMERA, CAMERA, fastibl.Pose(np.eye(4))))
    writer = RecordingWriter(tmp_path / "film", fastibl.Rig(CAMERA, CAMERA, fastibl.Pose(np.eye(4))), BOARD)
    path = PATHS["about the view"](0)
    late = film(BOARD, lambda t: path(t + 0.01), CAMERA, 24, 1)  # the front camera's clock is 10 ms behind
    for (now, back), (_, front) in zip(shots("about the view", 0, 40)[:24], late, strict=True):
        writer.add(fastibl.Frame(now, back, front))
    writer.close()
    assert main(["calibrate", "timing", str(tmp_path / "film"), "--rig", rig]) == 0
    assert float(capsys.readouterr().out.split("readout ")[1].split()[0]) == pytest.approx(30, abs=0.2)
    assert read_rig(rig).back.readout == pytest.approx(READOUT, abs=2e-4) and read_rig(rig).back.fx == CAMERA.fx
    front = ["calibrate", "timing", str(tmp_path / "film"), "--rig", rig, "--camera", "front"]
    assert main([*front, "--against-back"]) == 0
    said = capsys.readouterr().out
    print(said)
    assert float(said.split("clock offset ")[1].split()[0]) == pytest.approx(10, abs=1)
    assert read_rig(rig).front.readout == 0
    bad = tmp_path / "gyro.csv"
    bad.write_text("0,1\n1,2\n")
    assert main([*front, "--gyro", str(bad)]) == 2 and "holds 2 lines" in capsys.readouterr().err
    assert main([*front[:-2], "--against-back"]) == 2 and "--camera front" in capsys.readouterr().err
