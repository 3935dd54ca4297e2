"""Calibration against pictures and poses whose truth is known."""

import importlib
import warnings

import cv2
import numpy as np
import pytest
from board_pictures import look_at, project_tag, render, srgb

import fastibl
from bench.capture import board_film, rolling_film
from fastibl.__main__ import main
from fastibl.calibration import calibrate_board, calibrate_camera, calibrate_response, calibrate_rig
from fastibl.calibration.corners import Seen, find_corners
from fastibl.commands import calibrate
from fastibl.recording import RecordingWriter, read_rig

BOARD = fastibl.Board.grid(3, 4, 0.040, 0.012)
CAMERA = fastibl.Camera(480, 360, 396.0, 399.0, 243.5, 176.0, distortion=[0.08, -0.12, 0.0008, -0.0005])
VIEWS = [(25 + 4 * (k % 4), 0.2 + 0.01 * (k % 3), 47 * k, 80 * k) for k in range(12)]
AIMS = [(0.04 * np.cos(2.4 * k), 0.03 * np.sin(2.4 * k)) for k in range(12)]


def board_pictures(board=BOARD, camera=CAMERA, views=VIEWS, noise=0.004):
    return [
        render(board, camera, look_at(t, d, a, r, aim), seed=k, noise=noise, fine=3)
        for k, ((t, d, a, r), aim) in enumerate(zip(views, AIMS, strict=False))
    ]


@pytest.fixture(scope="module")
def pictures():
    return board_pictures()


def test_tags_that_are_too_small_to_be_refined_count_for_nothing(pictures):
    """One that is left as it was detected is as much off as a hundred others."""
    camera = fastibl.Camera(480, 360, 396.0, 399.0, 243.5, 176.0)
    pose = look_at(45, 0.75, 20)
    far = render(BOARD, camera, pose, fine=3)
    seen, raw = find_corners(far, BOARD, camera), find_corners(far, BOARD, camera, refine=False)
    true = {tag.id: project_tag(tag, camera, pose) for tag in BOARD.tags}
    errors = [
        [float(np.linalg.norm(p - true[i], axis=1).max()) for i, p in zip(s.ids, s.pixels, strict=True)]
        for s in (seen, raw)
    ]
    print(
        f"{len(seen.ids)} of {len(raw.ids)} tags refined, off by {np.round(errors[0], 2)}, of {np.round(errors[1], 2)}"
    )
    assert len(seen.ids) < len(raw.ids) and max(errors[1]) > 0.5
    assert all(e < 0.3 for e in errors[0])


def test_eight_terms_that_pictures_do_not_tell_are_zero(pictures):
    five, eight = (calibrate_camera(pictures, BOARD, terms=n) for n in (5, 8))
    print(f"{five}\n{eight}")
    errors = pixel_errors(eight.camera, CAMERA)
    assert eight.residual <= five.residual * 1.0001
    assert np.median(errors) < 0.1 and errors.max() < 1
    if np.isinf(eight.deviations["k6"]):
        assert list(eight.camera.distortion[5:]) == [0, 0, 0]


def test_a_fisheye_is_found_in_pictures():
    """Lines are bent in them, also within a tag: corners are refined by the lens that was found."""
    lens = [0.03, -0.01, 0.003, -0.001]
    camera = fastibl.Camera(480, 360, 150.0, 151.0, 241.0, 178.0, distortion=lens, model="fisheye")
    board = fastibl.Board.default()
    views = [(15 + 9 * (k % 4), 0.15 + 0.02 * (k % 3), 47 * k, 80 * k) for k in range(10)]
    shots = [
        render(board, camera, look_at(t, d, a, r, aim), seed=k, fine=3)
        for k, ((t, d, a, r), aim) in enumerate(zip(views, AIMS, strict=False))
    ]
    found = calibrate_camera(shots, board, model="fisheye")
    errors = pixel_errors(found.camera, camera, margin=60)
    print(f"{found}\npixels within {np.median(errors):.3f} px (median), {errors.max():.2f} px (worst)")
    assert abs(found.camera.fx / camera.fx - 1) < 2e-3 and np.median(errors) < 0.2 and found.residual < 0.15


def pixel_errors(found, true, margin=20, step=9):
    """By how far the found camera puts points of the picture's directions elsewhere than the true one."""
    at = np.mgrid[margin : true.width - margin : step, margin : true.height - margin : step].reshape(2, -1).T
    return np.linalg.norm(found.project(true.unproject(at.astype(float))) - at, axis=1)


@pytest.fixture(scope="module")
def calibrated(pictures):
    return calibrate_camera(pictures, BOARD, terms=4)


def test_a_lens_is_found_within_its_stated_deviations(calibrated):
    found = calibrated
    true = {n: getattr(CAMERA, n) for n in ("fx", "fy", "cx", "cy")} | dict(
        zip(("k1", "k2", "p1", "p2"), CAMERA.distortion, strict=True)
    )
    values = {n: getattr(found.camera, n) for n in ("fx", "fy", "cx", "cy")} | dict(
        zip(("k1", "k2", "p1", "p2"), found.camera.distortion, strict=True)
    )
    print(found)
    off = {n: (values[n] - true[n]) / found.deviations[n] for n in true}
    print("in deviations: " + ", ".join(f"{n} {o:+.1f}" for n, o in off.items()))
    assert max(map(abs, off.values())) < 5 and np.sqrt(np.mean(np.square(list(off.values())))) < 3
    assert abs(values["fx"] / true["fx"] - 1) < 1e-3 and found.residual < 0.15
    error = pixel_errors(found.camera, CAMERA)
    print(f"pixels within {np.median(error):.3f} px (median), {error.max():.2f} px (worst)")
    assert np.median(error) < 0.1 and error.max() < 1


def test_a_fisheye_is_found():
    camera = fastibl.Camera(480, 480, 170.0, 171.0, 242.0, 238.0, distortion=[0.02, -0.01, 0.001, 0.0], model="fisheye")
    rng = np.random.default_rng(0)
    on_board = np.array([tag.corners for tag in BOARD.tags])
    from fastibl.calibration.intrinsics import _solve_fisheye

    seen = []
    for k in range(14):
        pose = look_at(
            20 + 2 * k % 25, 0.16 + 0.01 * (k % 3), 51 * k, 30 * k, (0.06 * np.cos(2.0 * k), 0.06 * np.sin(k))
        )
        points = np.pad(on_board.reshape(-1, 2), ((0, 0), (0, 1))) @ pose[:3, :3].T + pose[:3, 3]
        pixels = camera.project(points) + 0.05 * rng.standard_normal((len(points), 2))
        assert np.isfinite(pixels).all()
        seen.append(Seen(tuple(range(len(on_board))), on_board, pixels.reshape(-1, 4, 2)))
    found = _solve_fisheye(seen, list(range(14)), (480, 480), 4, None)
    off = [(getattr(found.camera, n) - getattr(camera, n)) / found.deviations[n] for n in ("fx", "fy", "cx", "cy")]
    off += [
        (a - b) / found.deviations[f"k{i}"]
        for i, (a, b) in enumerate(zip(found.camera.distortion, camera.distortion, strict=True), 1)
    ]
    print(found, np.round(off, 1))
    assert np.abs(off).max() < 4 and np.abs(off).max() > 0.1
    assert found.residual == pytest.approx(0.05 * np.sqrt(2), rel=0.1)


def test_what_cannot_tell_a_lens_is_refused(pictures):
    with pytest.raises(ValueError, match="expected at least 5"):
        calibrate_camera(pictures[:3], BOARD)
    with pytest.raises(ValueError, match="in the corners too"):
        far = [(30, 0.75, 60 * k, 0) for k in range(6)]
        calibrate_camera([render(BOARD, CAMERA, look_at(*v), seed=1, fine=2) for v in far], BOARD)
    with pytest.raises(ValueError, match="one size"):
        calibrate_camera([*pictures[:5], pictures[0][:100]], BOARD)
    with pytest.raises(ValueError, match="5 or 8 terms"):
        calibrate_camera(pictures, BOARD, terms=3)


def test_flat_views_do_not_tell_the_focal_length():
    flat = [(0, 0.2, 0, 90 * k) for k in range(8)]
    with pytest.raises(ValueError, match="tilt the board"):
        calibrate_camera(board_pictures(views=flat), BOARD, terms=4)


def test_a_board_that_was_printed_wrong_is_found(calibrated):
    """1 % too high, and the last tag half a millimetre to the right."""
    tags = [(t.id, np.array(t.corners) * [1, 1.01]) for t in BOARD.tags]
    tags[-1] = (tags[-1][0], tags[-1][1] + [0.0005, 0])
    printed = fastibl.Board(tags, BOARD.width, BOARD.height * 1.01, BOARD.border_bits)
    views = [(20 + 5 * (k % 4), 0.3, 60 * k, 45 * k) for k in range(10)]
    shots = [render(printed, CAMERA, look_at(*v), seed=k, fine=3, dpi=600) for k, v in enumerate(views)]
    found = calibrate_board(shots, BOARD, CAMERA)
    print(found)
    moved = np.array([np.mean(t.corners, axis=0) for t in found.board.tags])
    true = np.array([np.mean(c, axis=0) for _, c in tags])
    moved, true = moved - moved.mean(axis=0), true - true.mean(axis=0)
    turn = np.arctan2((true[:, 0] * moved[:, 1] - true[:, 1] * moved[:, 0]).sum(), (true * moved).sum())
    c, s = np.cos(turn), np.sin(turn)
    off = np.abs(moved @ np.array([[c, -s], [s, c]]) - true)
    print(f"tags within {1e6 * np.median(off):.0f} um (median), {1e6 * off.max():.0f} um (worst)")
    assert abs(found.stretch - 1.01) < 0.0012 and off.max() < 0.0003
    assert np.ptp(found.flatness) < 0.001
    a, b = BOARD.tags[0].id, BOARD.tags[3].id
    ruled = calibrate_board(shots, BOARD, CAMERA, measured=(a, b, 0.165))
    centres = {t.id: np.mean(t.corners, axis=0) for t in ruled.board.tags}
    assert np.linalg.norm(centres[a] - centres[b]) == pytest.approx(0.165, rel=1e-3)
    assert ruled.scale == pytest.approx(0.165 / 0.156, rel=0.01)
    with pytest.raises(ValueError, match="not both on the board"):
        calibrate_board(shots, BOARD, CAMERA, measured=(a, 999, 0.3))
    with pytest.raises(ValueError, match="expected at least 5"):
        calibrate_board(shots[:3], BOARD, CAMERA)


def s_curve(linear):
    """sRGB with a toe and a shoulder, as telephones have."""
    e = srgb(linear)
    return e + 0.08 * np.sin(2 * np.pi * (e - 0.5)) * e * (1 - e)


def exposed(exposures, curve, black=0.0, white=255.0):
    """Pictures of one noisy place, whose codes are those of `curve` between two levels."""
    rng = np.random.default_rng(1)
    scene = np.exp(cv2.GaussianBlur(rng.normal(size=(120, 160, 1)), (0, 0), 6).reshape(120, 160, 1) * 14)
    scene = 0.2 * scene / np.median(scene) * np.array([1.0, 0.8, 0.6])
    shots = []
    for e in exposures:
        light = np.clip(scene * e, 0, 2)
        light = light + np.sqrt(light / 4000 + (6 / 4000) ** 2) * rng.standard_normal(light.shape)
        shots.append(np.rint(black + (white - black) * curve(np.clip(light, 0, 1))).astype(np.uint8))
    return shots


EXPOSURES = [1 / 16, 1 / 4, 1.0, 4.0, 16.0]


@pytest.mark.parametrize(
    ("curve", "name"), [(srgb, "srgb"), (lambda x: np.clip(x, 0, 1) ** (1 / 2.2), "2.2"), (s_curve, "s")]
)
@pytest.mark.parametrize(("black", "white"), [(0, 255), (7, 255), (16, 235)])
def test_a_response_is_found_within_one_percent(curve, name, black, white):
    shots = exposed(EXPOSURES, curve, black, white)
    dark = np.rint(black + np.random.default_rng(2).normal(size=(120, 160, 3))).astype(np.uint8) if black else None
    found = calibrate_response(shots, EXPOSURES, dark)
    assert 255 * found.response.black == pytest.approx(black, abs=0.07)
    assert 255 * found.response.white == pytest.approx(white)
    codes = np.arange(int(black) + 1, 243 if white == 255 else 223)
    x = np.linspace(0, 1, 200001)
    true = np.interp(codes / 255, (black + (white - black) * curve(x)) / 255, x)
    got = found.response.decode((codes / 255).astype(np.float32))
    error = np.abs(got - true)
    print(f"{name}: {found}; curve within {error.mean():.2%} of white (mean), {error.max():.2%} (worst)")
    assert error.max() < 0.01


def test_a_response_of_few_exposures_says_how_far_it_is_off():
    """Of three exposures three stops apart smoothness tells much, and fits that agree tell nothing of what it does."""
    few = [1 / 8, 1.0, 8.0]
    found = calibrate_response(exposed(few, srgb), few)
    codes = np.arange(13, 243)
    got, true = (r.decode(np.float32(np.append(codes, 229.5) / 255)) for r in (found.response, fastibl.Response.srgb()))
    off = np.abs((got / got[-1]) / (true / true[-1]) - 1)[:-1]
    times = off / np.maximum(found.deviations[codes], 1e-3)
    print(
        f"{found}; off by {np.median(off):.2%}, by what is stated {np.median(times):.2f}, {np.quantile(times, 0.9):.2f}"
    )
    assert np.median(times) < 1.5 and np.quantile(times, 0.9) < 3


def flat_at_its_end(linear):
    e = srgb(linear)
    return 3 * e**2 - 2 * e**3


@pytest.mark.parametrize(("black", "white"), [(0, 255), (16, 235)])
def test_a_response_that_is_flat_at_white(black, white):
    """Its last codes tell nothing by themselves: from darker pictures, and white is stated less sure."""
    shots = exposed(EXPOSURES, flat_at_its_end, black, white)
    dark = np.full((120, 160, 3), black, np.uint8) if black else None
    found = calibrate_response(shots, EXPOSURES, dark)
    steep = calibrate_response(exposed(EXPOSURES, srgb), EXPOSURES)
    x = np.linspace(0.001, 0.999, 5000)
    code = flat_at_its_end(x)
    middle = (code > 0.05) & (code < 0.95)
    got = found.response.decode(((black + (white - black) * code) / 255).astype(np.float32))[middle]
    scale = np.median(got / x[middle])
    error, shape = np.abs(got - x[middle]).max(), np.abs(got / scale - x[middle]).max()
    print(f"{found}; within {error:.2%} of white, {shape:.2%} but for white's light, which is off by {scale - 1:.2%}")
    assert error < 0.03 and shape < 0.012 and abs(scale - 1) < 2.5 * found.white_deviation
    assert found.white_deviation > 2 * steep.white_deviation


def test_a_response_whose_fit_is_flat_has_values_that_increase(monkeypatch):
    """Noise can leave the fit without a rise over many codes; a response has to be turned round."""
    linear = fastibl.Response.srgb().decode(np.arange(256, dtype=np.float32) / 255).astype(float)
    level = np.clip(linear / linear[230], 0.001, 1)
    monkeypatch.setattr("fastibl.calibration.response._fit", lambda *_: np.stack([level] * 3))
    monkeypatch.setattr("fastibl.calibration.response._with_top", lambda curve, pixels, times: (curve, 0.01))
    found = calibrate_response(exposed(EXPOSURES, srgb, 16, 235), EXPOSURES, np.full((120, 160, 3), 16, np.uint8))
    light = found.response.decode(np.linspace(17, 234, 4000, dtype=np.float32) / 255)
    assert (np.diff(light) > 0).all() and (np.diff(found.response.encode(light)) >= 0).all()


def test_what_cannot_tell_a_response_is_refused():
    grey = [np.full((20, 20, 3), v, np.uint8) for v in (40, 90, 200)]
    with pytest.raises(ValueError, match="of the codes"):
        calibrate_response(grey, [1, 2, 4])
    with pytest.raises(ValueError, match="different exposures"):
        calibrate_response(grey, [1, 1, 4])
    with pytest.raises(ValueError, match="positive"):
        calibrate_response(grey, [1, -2, 4])
    with pytest.raises(ValueError, match="lens covered: its mean is 90"):
        calibrate_response(exposed(EXPOSURES, srgb), EXPOSURES, grey[1])
    with pytest.raises(ValueError, match="dark picture .* float"):
        calibrate_response(exposed(EXPOSURES, srgb), EXPOSURES, grey[1] / 255)


def test_an_even_part_is_no_white():
    """A wall at 90 % of white's code that is brighter than all else does not clip."""
    exposures = [1 / 64, 1 / 16, 1 / 4, 1.0]
    shots = exposed(exposures, lambda x: np.clip(x, 0, 1) ** (1 / 2.2))
    for shot, exposure in zip(shots, exposures, strict=True):
        wall = round(255 * 0.9 * exposure ** (1 / 2.2))
        shot[:] = np.minimum(shot, wall)
        shot[:12, :20] = wall
    found = calibrate_response(shots, exposures)
    print(found)
    assert 255 * found.response.white == pytest.approx(255)


FRONT_FROM_BACK = fastibl.Pose.from_rotation_vector([0.03, np.pi - 0.05, 0.02], [0.012, -0.004, -0.009])
BOARDS = fastibl.Pose.from_rotation_vector([2.8, 0.3, 0.4], [0.2, 0.1, 1.4])  # front board from back board


def moments(count, noise_degrees=0.02, noise_metres=0.0003, about=(0, 1, 2), seed=0):
    rng = np.random.default_rng(seed)
    back, front = [], []
    for _ in range(count):
        turn = np.zeros(3)
        turn[list(about)] = rng.uniform(-0.5, 0.5, len(about))
        pose = fastibl.Pose.from_rotation_vector(turn, [0, 0, 0]) @ fastibl.Pose.from_rotation_vector(
            [np.pi, 0, 0], [*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.4, 0.7)]
        )
        seen = FRONT_FROM_BACK @ pose @ BOARDS.inverse()
        noisy = [
            fastibl.Pose.from_rotation_vector(np.radians(noise_degrees) * rng.standard_normal(3), [0, 0, 0]) @ p
            for p in (pose, seen)
        ]
        for list_, p in zip((back, front), noisy, strict=True):
            matrix = np.array(p.matrix)
            matrix[:3, 3] += noise_metres * rng.standard_normal(3)
            list_.append(fastibl.Pose(matrix))
    return back, front


def off_by(pose, truth):
    turn = cv2.Rodrigues(np.ascontiguousarray(pose.rotation @ truth.rotation.T))[0]
    return np.degrees(np.linalg.norm(turn)), np.linalg.norm(pose.translation - truth.translation)


def test_a_rig_is_found_within_its_stated_deviations():
    ratios = []
    for seed in range(12):
        back, front = moments(25, seed=seed)
        back[3] = front[7] = None
        found = calibrate_rig(back, front)
        degrees, metres = off_by(found.front_from_back, FRONT_FROM_BACK)
        ratios.append((degrees / found.degrees, metres / found.metres))
    print(found)
    ratios = np.array(ratios)
    print(f"{degrees:.3f} degrees, {1000 * metres:.2f} mm off; in deviations: median {np.median(ratios, axis=0)}")
    assert degrees < 0.05 and metres < 0.001
    assert (np.median(ratios, axis=0) < 2.5).all() and (np.median(ratios, axis=0) > 0.3).all()


@pytest.mark.parametrize("count", [4, 5, 8])
def test_a_rig_from_few_moments_states_what_it_does_not_know(count):
    """Robust weights may meet three moments of four exactly, and would then state next to nothing."""
    ratios, refused = [], 0
    for seed in range(150):
        try:
            found = calibrate_rig(*moments(count, np.degrees(1e-3), 1e-3, seed=seed))
        except ValueError:
            refused += 1
            continue
        degrees, metres = off_by(found.front_from_back, FRONT_FROM_BACK)
        ratios.append((degrees / found.degrees, metres / found.metres))
    beyond = [np.mean(np.array(ratios) > k, axis=0) for k in (3, 5)]
    print(f"{count} moments: beyond 3 deviations {beyond[0]}, beyond 5 {beyond[1]}; {refused} of 150 refused")
    assert beyond[0].max() <= 0.12 and np.max(ratios) < 10 and refused < 50


def test_the_order_of_moments_does_not_count():
    """One moment that was turned about a second axis does not tell what 99 about one axis cannot."""
    back, front = moments(99, about=(1,))
    odd = moments(1, seed=4)
    for order in (slice(None), slice(None, None, -1)):
        with pytest.raises(ValueError, match="one axis"):
            calibrate_rig((back + odd[0])[order], (front + odd[1])[order])


def test_poses_without_noise_give_the_rig_exactly():
    found = calibrate_rig(*moments(8, 0, 0))
    degrees, metres = off_by(found.front_from_back, FRONT_FROM_BACK)
    assert degrees < 1e-6 and metres < 1e-8 and found.degrees < 1e-4


def test_one_moment_that_is_wrong_does_not_spoil_a_rig():
    back, front = moments(25)
    front[4] = fastibl.Pose.from_rotation_vector([0.5, 0.2, 0], [0.1, 0, 0]) @ front[4]
    degrees, metres = off_by(calibrate_rig(back, front).front_from_back, FRONT_FROM_BACK)
    print(f"{degrees:.3f} degrees, {1000 * metres:.2f} mm off")
    assert degrees < 0.1 and metres < 0.002


def test_what_cannot_tell_a_rig_is_refused():
    with pytest.raises(ValueError, match="one axis"):
        calibrate_rig(*moments(20, about=(1,)))
    with pytest.raises(ValueError, match="at least 4"):
        calibrate_rig(*moments(3))
    with pytest.raises(ValueError, match="only: more moments"):
        calibrate_rig(*moments(5, 3.0, 0.02))


@pytest.mark.parametrize(
    "change, board, says",
    [
        (lambda p: np.ascontiguousarray(p[:, ::-1]), BOARD, r"5\. In picture 0 \(and alike in 1, 2\): .* in a mirror"),
        (lambda p: p // 16, BOARD, "too dark"),
        (lambda p: p, fastibl.Board.kalibr(3, 4, 0.04, 0.3), "with a border of 1 modules are seen"),
        (lambda p: p, fastibl.Board([(t.id + 100, t.corners) for t in BOARD.tags], 0.2, 0.2), "board has 100 to 111"),
        (lambda p: np.where(np.arange(480)[:, None] < 90, p, 200).astype(np.uint8), BOARD, "In picture"),
    ],
)
def test_pictures_that_show_no_board_are_explained(pictures, change, board, says):
    shots = [change(p) for p in pictures[:6]]
    with pytest.raises(ValueError, match=says) as error:
        calibrate_camera(shots, board)
    print(error.value)
    with pytest.raises(ValueError, match="show all 12 tags.* In picture"):
        calibrate_board(shots, board, CAMERA)


@pytest.mark.parametrize(("blur", "most"), [(0.3, 0.005), (0.8, 0.045), (1.2, 0.13)])
def test_blur_moves_no_corner_outwards(blur, most):
    """White modules behind a narrow border lift its black where the picture is blurred: that was 0.06 and 0.18 px."""
    outwards = []
    board = fastibl.Board.default()
    for k, (tilt, azimuth) in enumerate([(10, 30), (30, 140), (40, 250)]):
        pose = look_at(tilt, 0.4, azimuth, 15 * k)
        seen = find_corners(render(board, CAMERA, pose, blur=blur, noise=0, seed=k), board, CAMERA)
        for tag_id, corners in zip(seen.ids, seen.pixels, strict=True):
            (tag,) = (tag for tag in board.tags if tag.id == tag_id)
            true = project_tag(tag, CAMERA, pose)
            aside = true - true.mean(axis=0)
            outwards += list(((corners - true) * aside).sum(axis=1) / np.linalg.norm(aside, axis=1))
    print(f"blur of {blur} px: corners of {len(outwards) // 4} tags are {np.mean(outwards):+.4f} px outwards")
    assert len(outwards) > 40 and abs(np.mean(outwards)) < most


def bent_pictures(bend, views=VIEWS, aims=AIMS, stretch=1.0, noise=0.05, seed=0):
    """What find_corners would find of a print that is bent to a cylinder by that many metres, and stretched."""
    rng = np.random.default_rng(seed)
    on_board = np.array([tag.corners for tag in BOARD.tags])
    x = on_board.reshape(-1, 2)
    points = np.column_stack([x * [1, stretch], bend * (x[:, 0] / np.abs(x[:, 0]).max()) ** 2])
    for (tilt, distance, azimuth, roll), aim in zip(views, aims, strict=False):
        pose = look_at(tilt, distance, azimuth, roll, aim)
        pixels = CAMERA.project(points @ pose[:3, :3].T + pose[:3, 3]) + noise * rng.standard_normal((len(x), 2))
        inside = ((pixels > 4) & (pixels < [CAMERA.width - 4, CAMERA.height - 4])).reshape(-1, 8).all(axis=1)
        ids = tuple(int(i) for i in np.flatnonzero(inside))
        yield Seen(ids, on_board[inside], pixels.reshape(-1, 4, 2)[inside])


@pytest.fixture
def shown(monkeypatch):
    """calibrate_camera and calibrate_board of corners that are given as pictures."""

    def give(corners):
        found = list(corners)
        for module in ("intrinsics", "board"):
            module = importlib.import_module(f"fastibl.calibration.{module}")
            monkeypatch.setattr(module, "find_corners", lambda picture, *_, **__: found[int(picture[0, 0, 0])])
        return [np.full((CAMERA.height, CAMERA.width, 3), k, np.uint8) for k in range(len(found))]

    return give


def off(found):
    """fx, fy, cx, cy in stated deviations."""
    return {n: (getattr(found.camera, n) - getattr(CAMERA, n)) / found.deviations[n] for n in ("fx", "fy", "cx", "cy")}


def swinging(seed):
    """A hand with a camera before the board, 70 degrees a second."""
    p = np.random.default_rng(seed).uniform(0, 6, 4)

    def pose(time):
        tilt, distance = 20 + 25 * np.sin(1.3 * time + p[0]) ** 2, 0.27 + 0.06 * np.sin(1.1 * time + p[1])
        heading, roll = np.degrees(2.0 * np.sin(0.9 * time + p[2])), 15 * np.sin(0.7 * time + p[3])
        at = np.array(look_at(tilt, distance, heading, roll))
        at[:2, 3] += 0.05 * np.sin(2.1 * time), 0.04 * np.cos(1.7 * time)
        return at

    return pose


@pytest.fixture(scope="module")
def swung():
    """Three pictures in a row of ten places, with 18 ms of readout: times, pictures."""
    rng, path, camera = np.random.default_rng(1), swinging(1), board_film.CAMERA.replace(readout=0.018)
    times = [place + step / 30 for place in np.linspace(0.1, 8, 10) for step in (-1, 0, 1)]
    look = board_film.Look()
    return times, [
        board_film.picture(rolling_film.board_light(fastibl.Board.default(), path, t, camera), look, rng) for t in times
    ]


def test_a_lens_from_a_film_of_a_moving_hand(swung):
    """The focal length was 13 and 19 px off with 2 stated, and the print said to be bent."""
    times, pictures = swung
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = calibrate_camera(pictures, fastibl.Board.default(), terms=4, times=times)
    true = board_film.CAMERA
    errors = {n: (getattr(found.camera, n) - getattr(true, n), found.deviations[n]) for n in ("fx", "fy", "cx", "cy")}
    print(found, {n: f"{e:.2f} off, {d:.2f} stated" for n, (e, d) in errors.items()}, sep="\n")
    assert all(abs(e) < 1.5 and abs(e) < 3 * d for e, d in errors.values())
    assert 3 < found.moved < 8 and found.bend < 2e-4 and "while the rows were taken" in str(found)
    assert found.camera.readout == found.readout[0] == pytest.approx(0.018, abs=3e-4) and found.readout[1] < 2e-4
    # Of pictures by themselves the motion is told as well, and that the lens is not.
    with pytest.raises(ValueError, match="hold it still, or calibrate by a film"):
        calibrate_camera(pictures, fastibl.Board.default(), terms=4)
    with pytest.raises(ValueError, match="times must be one of each picture, increasing"):
        calibrate_camera(pictures, fastibl.Board.default(), times=times[::-1])


def test_a_film_or_recording_calibrates_a_camera(swung, tmp_path, capsys):
    """A film of pictures at 30 a second is read as it is; so is a recording."""
    times, pictures = swung
    with RecordingWriter(tmp_path / "r", fastibl.Rig(board_film.CAMERA)) as out:
        for time, picture in zip(times, pictures, strict=True):
            out.add(fastibl.Frame(time, picture))
    rig = tmp_path / "rig.yaml"
    assert main(["calibrate", "camera", str(tmp_path / "r"), "--rig", str(rig)]) == 0
    assert "while the rows were taken" in capsys.readouterr().out
    assert abs(read_rig(rig).back.fx / board_film.CAMERA.fx - 1) < 3e-3
    assert read_rig(rig).back.readout == pytest.approx(0.018, abs=3e-4)
    film = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*"MJPG"), 30, (640, 480))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no MJPG")
    for picture in pictures:
        writer.write(np.ascontiguousarray(picture[..., ::-1]))
    writer.release()
    read = list(calibrate._of_film(film, 9, 3))
    numbers = [round(30 * time) for time, _ in read]
    print(numbers)
    assert numbers == [0, 1, 2, 13, 14, 15, 27, 28, 29]
    assert all(np.abs(p.astype(int) - pictures[k]).mean() < 8 for k, (_, p) in zip(numbers, read, strict=True))
    assert main(["calibrate", "camera", str(film), str(film)]) == 2
    assert "is a film: expected pictures, or one film" in capsys.readouterr().err
    film.write_bytes(b"no film")
    assert main(["calibrate", "camera", str(film)]) == 2
    assert "holds no picture" in capsys.readouterr().err


@pytest.mark.parametrize("bend", [0.0003, 0.0005, 0.001, 0.002, 0.005])
def test_a_bent_print_is_told_and_allowed_for(shown, bend):
    """A millimetre made the focal length 0.7 % wrong, and corners only 0.2 pixels."""
    with pytest.warns(UserWarning, match=rf"bent by about {1000 * bend:.1f} mm.*something flat"):
        found = calibrate_camera(shown(bent_pictures(bend)), BOARD, terms=4)
    print(f"{found}\nin deviations: {off(found)}")
    assert found.bend == pytest.approx(bend, rel=0.1)
    assert max(map(abs, off(found).values())) < 3 and abs(found.camera.fx / CAMERA.fx - 1) < 2e-3
    assert found.residual == pytest.approx(0.05 * np.sqrt(2), rel=0.1)


def test_a_stretched_print_is_told(shown):
    with pytest.warns(UserWarning, match=r"0\.[45]\d% too high: measure it"):
        found = calibrate_camera(shown(bent_pictures(0.0, stretch=1.005)), BOARD, terms=4)
    print(f"{found}\nin deviations: {off(found)}")
    assert found.stretch == pytest.approx(1.005, abs=2e-4) and max(map(abs, off(found).values())) < 2


@pytest.mark.filterwarnings("error")
def test_a_flat_print_is_not_warned_of(shown):
    for seed in range(6):
        found = calibrate_camera(shown(bent_pictures(0.0, seed=seed)), BOARD, terms=4)
        assert found.bend < 0.0002 and abs(found.stretch - 1) < 3e-4
        assert found.deviations["fx"] / CAMERA.fx < 2e-3


def test_a_bent_print_is_told_of_a_fisheye():
    camera = fastibl.Camera(480, 480, 170.0, 171.0, 242.0, 238.0, distortion=[0.02, -0.01, 0.001, 0.0], model="fisheye")
    from fastibl.calibration.bundle import adjust
    from fastibl.calibration.intrinsics import _solve_fisheye

    shapes = []
    for bend in (0.0, 0.001):
        rng, seen = np.random.default_rng(0), []
        on_board = np.array([tag.corners for tag in BOARD.tags])
        x = on_board.reshape(-1, 2)
        points = np.column_stack([x, bend * (x[:, 0] / np.abs(x[:, 0]).max()) ** 2])
        for k in range(14):
            aim = (0.06 * np.cos(2.0 * k), 0.06 * np.sin(k))
            pose = look_at(20 + 2 * k % 25, 0.16 + 0.01 * (k % 3), 51 * k, 30 * k, aim)
            pixels = camera.project(points @ pose[:3, :3].T + pose[:3, 3]) + 0.05 * rng.standard_normal((len(x), 2))
            seen.append(Seen(tuple(range(len(on_board))), on_board, pixels.reshape(-1, 4, 2)))
        found = _solve_fisheye(seen, list(range(14)), (480, 480), 4, None)
        shapes.append(adjust(seen, found.poses, found.camera, BOARD, 8))
        corrected = shapes[-1].lens[0]
        print(f"{bend}: {shapes[-1]}, fx {found.camera.fx:.2f}, with a print that bends {corrected:.2f}")
        assert abs(corrected / camera.fx - 1) < 2e-3
    assert not shapes[0].bent and shapes[1].bent and shapes[1].bend == pytest.approx(0.001, rel=0.15)


def test_a_measured_board_that_is_bent_is_told(shown):
    views = [(20 + 5 * (k % 4), 0.3, 60 * k, 45 * k) for k in range(10)]
    pictures = shown(bent_pictures(0.0008, views=views, aims=[(0.0, 0.0)] * 10))
    with pytest.warns(UserWarning, match=r"bent by about 0\.[78] mm, and is kept as flat"):
        calibrate_board(pictures, BOARD, CAMERA)


def test_a_board_is_measured_by_a_camera_without_distortion():
    views = [(20 + 5 * (k % 4), 0.3, 60 * k, 45 * k) for k in range(6)]
    plain = fastibl.Camera(CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    found = calibrate_board([render(BOARD, plain, look_at(*v), seed=k) for k, v in enumerate(views)], BOARD, plain)
    assert len(found.board.tags) == len(BOARD.tags)


@pytest.mark.parametrize(
    "measured, message",
    [
        ((1, 26, 0.2), "not both on the board"),
        ((1, 1, 0.2), "1 twice"),
        ((0, 3), "ids and metres"),
        ((0, 3, np.nan), "nan m between the centres of tags 0 and 3, but on the board they are 0.1560 m"),
        ((0, 3, 0.208), r"0.208 m .* they are 0.1560 m apart; expected 0.1418 to 0.1716 m"),
        ((0, 3, 0.140), r"0.14 m .* expected 0.1418"),
        ((0, 3, 156.0), "is it in metres"),
        ((0, 3, -0.156), "is it in metres"),
    ],
)
def test_a_length_that_was_not_measured_is_refused(pictures, measured, message):
    with pytest.raises(ValueError, match=message):
        calibrate_board(pictures, BOARD, CAMERA, measured=measured)


def test_byte_order_does_not_count(pictures):
    """Dark pictures of 16 bits, which are brightened."""
    dark = [(p.astype(np.uint16) * 16) for p in pictures]
    found = [calibrate_camera([p.astype(order) for p in dark], BOARD).camera for order in ("<u2", ">u2")]
    np.testing.assert_allclose(found[0].opencv_matrix, found[1].opencv_matrix, rtol=1e-9)


def test_a_board_of_one_tag_needs_one():
    blank = [np.full((480, 640, 3), 200, np.uint8)] * 6
    with pytest.raises(ValueError, match="0 of 6 pictures show 1 tag or more"):
        calibrate_camera(blank, fastibl.Board([(0, BOARD.tags[0].corners)], BOARD.width, BOARD.height))


def test_what_is_no_picture_board_or_pose_is_named(pictures):
    with pytest.raises(ValueError, match="picture 2 must have shape .*, got None"):
        calibrate_camera([*pictures[:2], None], BOARD)
    with pytest.raises(TypeError, match="board must be Board, got None"):
        calibrate_camera(pictures, None)
    with pytest.raises(TypeError, match=r"front\[1\] must be Pose or None, got ndarray"):
        calibrate_rig([fastibl.Pose()] * 2, [None, np.eye(4)])


def test_half_a_turn_has_a_vector():
    from fastibl.rotations import rotation_vectors, rotations_from

    axes = np.random.default_rng(0).normal(size=(100, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for angle in (0.0, 1e-9, 1.0, np.pi - 1e-5, np.pi - 1e-8, np.pi):
        turns = rotations_from(angle * axes)
        vectors = rotation_vectors(turns)
        np.testing.assert_allclose(rotations_from(vectors), turns, atol=1e-7)
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), angle, atol=1e-9)


def test_pictures_that_no_fisheye_took_are_refused():
    with pytest.raises(ValueError, match="fisheye"):
        calibrate_camera(board_pictures(views=VIEWS[:8]), BOARD, model="fisheye")
