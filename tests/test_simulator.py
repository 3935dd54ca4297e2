"""Simulated pictures show what the cameras, the place and the exposures say they should."""

import inspect
from pathlib import Path

import numpy as np
import pytest
from standin import Page, centroid_of, centroid_seen, disc_rim

import fastibl
from fastibl import Camera, CubeMap, Pose, Recording, Rig, reference
from fastibl.room import OBJECT
from fastibl.simulator import (
    FRONT_STEPS,
    INK,
    PAPER,
    DistantPlace,
    HandPath,
    _Eye,
    _PrintedBoard,
    default_rig,
    simulate,
)

HDRI = Path(__file__).resolve().parents[1] / ".." / "shared" / "data" / "hdri"
SMALL = {"size": (160, 120), "truth_size": 16}  # quick


def marked_map(height=64):
    """Dim, with a bright spot 60 degrees from +y to +x and 45 high; the ground of another colour."""
    v, u = np.mgrid[:height, : 2 * height]
    polar, azimuth = (v + 0.5) / height * np.pi, ((u + 0.5) / (2 * height) - 0.5) * 2 * np.pi
    d = np.stack([np.sin(polar) * np.sin(azimuth), np.sin(polar) * np.cos(azimuth), np.cos(polar)], axis=-1)
    image = np.where(d[..., 2:] > 0, [0.3, 0.4, 0.5], [0.0, 5.0, 0.0]).astype(np.float32)
    image[d @ SPOT > np.cos(np.radians(6))] = (40, 30, 20)
    return image


SPOT = np.array([np.sin(np.pi / 3), np.cos(np.pi / 3), 1.0])
SPOT /= np.linalg.norm(SPOT)


@pytest.fixture(scope="module")
def room_recording():
    return simulate(seed=3, seconds=1.5, fps=8, board=Page(), **SMALL)


def linear(picture):
    return fastibl.Response.srgb().decode(picture.astype(np.float32) / 255)


def test_signature():
    names = list(inspect.signature(fastibl.simulate).parameters)
    assert names[:5] == ["environment", "seed", "seconds", "fps", "out"]


def test_the_page_is_where_the_camera_projects_it():
    recording = simulate(seconds=0.5, fps=4, board=Page(), hand=False, truth_size=16)
    camera, worst = recording.rig.back, 0
    for frame in recording:
        pose = recording.truth.pose(frame.time)
        light = linear(frame.back).mean(axis=-1)
        for centre in Page.discs:
            expected = centroid_of(camera.project(pose @ disc_rim(centre)))
            found = centroid_seen(light, expected)
            worst = max(worst, np.linalg.norm(found - expected))
    print(f"worst centroid {worst:.3f} px")
    assert worst < 0.1


def test_the_page_stays_in_the_picture_and_the_hand_is_steady():
    camera = default_rig().back
    corners = np.array([(x, y, 0.0) for x in (-0.1485, 0.1485) for y in (-0.105, 0.105)])
    for seed in range(8):
        path = HandPath(np.random.default_rng([seed, 0]), 8.0)
        last, azimuths = None, []
        for time in np.arange(0, 8, 1 / 15):
            pose = path.back_from_marker(time)
            pixels = camera.project(pose @ corners)
            assert (pixels > 0).all() and (pixels < [640, 480]).all(), (seed, time)
            inverse = pose.inverse()
            tilt = np.degrees(np.arccos(-inverse.rotation[2, 2]))
            distance = np.linalg.norm(inverse.translation)
            assert 15 < tilt < 64 and 0.35 < distance < 0.65
            azimuths.append(np.arctan2(*inverse.translation[1::-1]))
            if last is not None:
                assert pose.angle_to(last) < np.radians(9)
            last = pose
        assert abs(np.unwrap(azimuths)[-1] - azimuths[0]) > 1.8 * np.pi


def test_front_exposures_are_16_apart(room_recording):
    exposures = [frame.front_exposure for frame in room_recording]
    assert exposures[0] / exposures[1] == pytest.approx(16)
    assert exposures[1] / exposures[2] == pytest.approx(16)
    assert exposures[3] == exposures[0]
    assert len({frame.back_exposure for frame in room_recording}) == 1


def test_auto_exposure_follows_what_the_picture_shows():
    """From a table to a sky that is 20 times as bright: clipped in the first picture, and not for long."""
    sky = np.ones((6, 16, 16, 3), np.float32)
    directions = fastibl.texel_directions(16)
    sky[directions[..., 2] > 0.4] = 20.0

    def path(time):
        elevation = np.radians(60 if time > 0.2 else -60)
        down = [0, np.sin(elevation), -np.cos(elevation)]
        pose = np.eye(4)
        pose[:3, :3] = [1, 0, 0], down, np.cross([1, 0, 0], down)
        pose[:3, 3] = -pose[:3, :3] @ [0, 0, 0.5]
        return fastibl.Pose(pose)

    def film(**options):
        place = fastibl.CubeMap(sky)
        return list(simulate(place, seconds=1.5, fps=10, path=path, board=False, albedo=0.05, **options, **SMALL))

    fixed, metered = film(), film(auto_exposure=True)
    clipped = [(frame.back == 255).mean() for frame in metered]
    exposures = np.array([frame.back_exposure for frame in metered])
    assert exposures[0] == fixed[0].back_exposure and len({frame.back_exposure for frame in fixed}) == 1
    assert np.array_equal(metered[0].back, fixed[0].back)
    assert (fixed[-1].back == 255).mean() > 0.5 > 0.05 > clipped[-1]
    assert (exposures[1:] / exposures[:-1] >= 0.5 - 1e-9).all() and (exposures[1:] / exposures[:-1] <= 1.4 + 1e-9).all()
    # What it states is what it took.
    sky_light = np.median(linear(metered[-1].back)) / exposures[-1]
    assert sky_light == pytest.approx(20.0, rel=0.05)
    again = film(auto_exposure=True)
    assert all(np.array_equal(a.back, b.back) for a, b in zip(metered, again, strict=True))


def test_a_gyroscope_tells_how_the_back_camera_turned():
    def film(gyro, seed=3):
        return simulate(seed=seed, seconds=1, fps=8, board=False, hand=False, lamp=False, gyro=gyro, **SMALL)

    exact = film(0.0)
    frames = list(exact)
    for frame in frames:
        told = frame.attitude @ frames[0].attitude.T
        true = exact.truth.pose(frame.time).rotation @ exact.truth.pose(0.0).rotation.T
        np.testing.assert_allclose(told, true, atol=1e-6)
    noisy = list(film(0.01))
    off = [b.attitude.T @ a.attitude for a, b in zip(noisy, frames, strict=True)]
    np.testing.assert_allclose(off[0], np.eye(3), atol=1e-12)
    steps = [np.arccos((np.trace(before.T @ after) - 1) / 2) for before, after in zip(off, off[1:], strict=False)]
    assert np.sqrt(np.mean(np.square(steps))) == pytest.approx(0.01 * np.sqrt(3 / 8), rel=0.5)
    assert np.array_equal(noisy[-1].back, frames[-1].back)  # pictures know nothing of it
    assert np.array_equal(film(0.01)[7].attitude, noisy[-1].attitude)
    assert not np.array_equal(film(0.01, seed=4)[7].attitude, noisy[-1].attitude)


def test_exposure_response_and_noise():
    response = fastibl.Response.gamma(2.0)
    camera = Camera(64, 48, fx=60, fy=60, cx=32, cy=24, response=response, gain=1.5, vignetting=(-0.2,))
    eye, rng = _Eye(camera), np.random.default_rng(0)
    grey = np.full((48, 64, 3), 2.0, np.float32)
    means = []
    for exposure in (0.2, 0.2 / 16):
        pictures = [eye.expose(grey.copy(), exposure, rng) for _ in range(200)]
        assert pictures[0].dtype == np.uint8
        light = (np.stack(pictures)[:, 22:26, 30:34] / 255.0) ** 2
        expected = exposure * 1.5 * 2.0
        assert light.mean() == pytest.approx(expected, rel=0.01)
        noise = np.sqrt(expected / 4000 + (6 / 4000) ** 2)
        step = 2 * np.sqrt(expected) / 255  # of the 8-bit code
        assert light.std() == pytest.approx(np.hypot(noise, step / np.sqrt(12)), rel=0.1)
        means.append(light.mean())
    assert means[0] / means[1] == pytest.approx(16, rel=0.01)
    corner = (np.mean([eye.expose(grey.copy(), 0.2, rng)[0, 0] for _ in range(200)], axis=0) / 255) ** 2
    r2 = (31.5 / 60) ** 2 + (23.5 / 60) ** 2
    np.testing.assert_allclose(corner, 0.6 * (1 - 0.2 * r2), rtol=0.03)


def test_back_pictures_are_well_exposed(room_recording):
    for frame in room_recording:
        assert (frame.back == 255).mean() < 0.01
        assert 0.1 < linear(frame.back).mean() < 0.7


def test_lamp_and_hand_happen_when_the_truth_says(room_recording):
    truth, frames = room_recording.truth, list(room_recording)
    assert truth.lamp_time == pytest.approx(0.75)
    begin, end = truth.hand
    assert begin == pytest.approx(0.45) and end == pytest.approx(0.75)
    before, after = truth.environment(truth.lamp_time - 0.01), truth.environment(truth.lamp_time)
    assert after.faces.max() > 2 * before.faces.max()
    assert truth.environment(-1) == before and truth.environment(99) == after
    table = {f.time: linear(f.back)[:8].mean() for f in frames}
    off, on = (np.mean([v for t, v in table.items() if (t >= 0.75) == k]) for k in (False, True))
    assert on > 1.2 * off
    covered = [f for f in frames if begin <= f.time <= end]
    assert covered
    for frame in covered:  # dark everywhere, whatever stood there
        free = truth.environment(frame.time).faces.mean()
        assert linear(frame.front).max() < 0.5 * frame.front_exposure * free + 0.01


def test_a_long_recording_covers_the_hand_for_a_second():
    recording = simulate(np.ones((8, 16, 3)), seconds=6, fps=0.5, board=False, size=(32, 24), truth_size=8)
    begin, end = recording.truth.hand
    assert end - begin == pytest.approx(1)
    assert recording.truth.lamp_time is None
    assert len(recording) == 3 and recording.times == [0, 2, 4]


def test_same_seed_same_pictures_in_memory_and_on_disk(room_recording, tmp_path):
    again = simulate(seed=3, seconds=1.5, fps=8, board=Page(), out=tmp_path, **SMALL)
    assert len(again) == len(room_recording) == 12
    for one, two in zip(room_recording, again, strict=True):
        assert one == two
    assert again.truth.environment(0) == room_recording.truth.environment(0)


@pytest.mark.parametrize("video", [False, True])
def test_same_seed_same_bytes(tmp_path, video):
    def files(seed, folder):
        out = tmp_path / folder
        simulate(marked_map(), seed, seconds=0.3, fps=10, board=Page(), out=out, video=video, **SMALL)
        return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()}

    one, two, other = files(1, "one"), files(1, "two"), files(2, "other")
    assert len(one) == (2 if video else 6) + 7
    if not video:  # the container gives itself a random id
        assert one == two
    assert one["frames.csv"] == two["frames.csv"] == other["frames.csv"]
    assert one["truth/poses.csv"] != other["truth/poses.csv"]
    assert list(Recording.open(tmp_path / "one")) == list(Recording.open(tmp_path / "two"))


def test_front_pictures_show_the_place_where_the_rig_looks():
    """The map's bright spot is where poses, rig and lens put it."""
    recording = simulate(marked_map(), seconds=8, fps=4, board=False, hand=False, **SMALL)
    camera, seen = recording.rig.front, 0
    for frame in recording:
        if frame.front_exposure < recording[0].front_exposure / 20:
            continue
        front_from_marker = recording.rig.front_from_back @ recording.truth.pose(frame.time)
        pixel = camera.project(front_from_marker.rotation @ SPOT)
        light = linear(frame.front).mean(axis=-1)
        if np.isnan(pixel).any() or not ((pixel > 15) & (pixel < [145, 105])).all():
            continue
        seen += 1
        x, y = np.floor(pixel).astype(int)
        inside, outside = light[y - 2 : y + 3, x - 2 : x + 3].min(), np.median(light)
        assert inside > 3 * outside
    assert seen >= 2


def test_distant_place_truth_is_the_map_over_its_table():
    image = marked_map(128)
    place = DistantPlace(image, albedo=(0.5, 0.4, 0.3))
    truth = place.truth(size=64)
    given = fastibl.cubemap_from_equirect(image, size=64)
    up = fastibl.texel_directions(64)[..., 2] > 0
    np.testing.assert_array_equal(truth.faces[up], given.faces[up])
    upper = given.faces.copy()
    upper[~up] = 0
    light = reference.irradiance(upper, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(place.irradiance([0.1, 0.1]), light, rtol=0.01)
    below = truth.faces[5].mean(axis=(0, 1))
    np.testing.assert_allclose(below, np.array([0.5, 0.4, 0.3]) * light / np.pi, rtol=0.06)
    far = place.radiance(OBJECT, [1.0, 0.0, -0.01])  # plain far away
    np.testing.assert_allclose(far, np.array([0.5, 0.4, 0.3]) * light / np.pi, rtol=0.01)


def test_cube_map_and_its_picture_give_the_same_place():
    image = marked_map(128)
    cube = fastibl.cubemap_from_equirect(image, size=128)
    d = np.random.default_rng(0).normal(size=(3000, 3))
    a, b = DistantPlace(cube).radiance(OBJECT, d), DistantPlace(image).radiance(OBJECT, d)
    assert np.median(np.abs(a - b)) < 1e-3 and np.mean(np.abs(a - b)) < 0.05
    faces = DistantPlace(cube).truth(size=128).faces
    up = fastibl.texel_directions(128)[..., 2] > 0
    np.testing.assert_array_equal(faces[up], cube.faces[up])


def test_white_paper_under_a_uniform_sky():
    place = DistantPlace(np.ones((16, 32, 3)), albedo=0.5)
    page = _PrintedBoard(Page(), place).pictures[False][1:-1, 1:-1]
    assert page[..., :3].max() == pytest.approx(PAPER, rel=1e-3)  # E = pi, so radiance is the albedo
    assert page[..., :3].min() == pytest.approx(INK, rel=1e-3)
    assert (page[..., 3] == 1).all()


def test_table_and_printed_board_are_about_equally_bright():
    printed = _PrintedBoard(fastibl.Board.default(), DistantPlace(np.ones((16, 32, 3)))).albedo
    assert printed == pytest.approx(DistantPlace(np.ones((16, 32, 3))).albedo.mean(), rel=0.08)


def test_a_real_map():
    path = HDRI / "venice_sunset_1k.hdr"
    if not path.is_file():
        pytest.skip(f"needs the shared map {path.name}")
    recording = simulate(path, seconds=0.5, fps=4, board=Page(), **SMALL)
    assert len(recording) == 2
    assert all((frame.back == 255).mean() < 0.02 for frame in recording)


def test_a_rig_without_front_camera_and_one_of_ones_own():
    camera = Camera(100, 80, fx=90, fy=90, cx=50, cy=40)
    recording = simulate(np.ones((8, 16, 3)), seconds=0.2, fps=10, rig=Rig(camera), board=False)
    assert [(frame.front, frame.back.shape) for frame in recording] == 2 * [(None, (80, 100, 3))]
    pose = Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    recording = simulate(np.ones((8, 16, 3)), seconds=0.1, fps=10, rig=Rig(camera, camera, pose), board=False)
    assert recording[0].front.shape == (80, 100, 3)


def test_a_black_place_gives_black_pictures():
    frame = simulate(CubeMap(np.zeros((6, 4, 4, 3))), seconds=0.1, fps=10, board=Page(), **SMALL)[0]
    assert np.isfinite([frame.back_exposure, frame.front_exposure]).all()
    assert linear(frame.back).mean() < 0.01


def test_steps():
    assert FRONT_STEPS[0] / FRONT_STEPS[2] == 256


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"seconds": 0}, ValueError, "seconds and fps"),
        ({"fps": np.nan}, ValueError, "seconds and fps"),
        ({"size": (4, 4)}, ValueError, "size"),
        ({"environment": np.ones((8, 8, 3))}, ValueError, "2 height"),
        ({"environment": np.ones((8, 16, 3), np.uint8)}, TypeError, "floats"),
        ({"environment": "nowhere.hdr"}, FileNotFoundError, "nowhere.hdr"),
        ({"environment": __file__}, ValueError, r"end in \.hdr"),
        ({"albedo": -1}, ValueError, "albedo"),
        ({"albedo": 0.3, "environment": DistantPlace(np.ones((8, 16, 3)))}, ValueError, "has its own"),
        ({"position": (np.nan, 0, 0.1)}, ValueError, "finite coordinates"),
        ({"position": (0, 0.1)}, ValueError, "3 finite coordinates"),
        ({"gyro": -1}, ValueError, "gyro"),
    ],
)
def test_errors(arguments, error, message):
    with pytest.raises(error, match=message):
        simulate(**{"seconds": 0.1, "fps": 10, "board": False, **arguments})


def test_place_errors():
    place = DistantPlace(np.ones((8, 16, 3)))
    with pytest.raises(ValueError, match="above the table"):
        place.radiance((0, 0, 0), [0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="finite"):
        place.radiance((np.nan, 0, 1), [0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match=r"\(3,\)"):
        place.radiance((0, 0), [0.0, 0.0, 1.0])


def test_a_map_from_a_file_is_what_read_environment_reads(tmp_path):
    """Radiance's EXPOSURE is taken out: the same light whichever way a map comes in."""
    light = np.random.default_rng(0).uniform(0.1, 2, (16, 32, 3)).astype(np.float32)
    fastibl.write_environment(tmp_path / "plain.hdr", fastibl.cubemap_from_equirect(light, size=8), height=16)
    data = (tmp_path / "plain.hdr").read_bytes()
    (tmp_path / "exposed.hdr").write_bytes(data.replace(b"\n\n", b"\nEXPOSURE=4\n\n", 1))
    given = {"seconds": 0.1, "fps": 10, "size": (32, 24), "lamp": False}
    plain, exposed = (
        fastibl.simulate(tmp_path / name, **given).truth.environment(0) for name in ("plain.hdr", "exposed.hdr")
    )
    np.testing.assert_allclose(exposed.faces, plain.faces / 4, rtol=1e-4, atol=1e-6)
    cube = fastibl.cubemap_from_equirect(light, size=8)
    fastibl.write_environment(tmp_path / "kept.ktx2", cube)  # as `fastibl live --keep` writes it
    fastibl.write_environment(tmp_path / "faces.hdr", cube, layout="strip")
    from_faces = simulate(cube, **given).truth.environment(0)
    for name in ("kept.ktx2", "faces.hdr"):
        kept = simulate(tmp_path / name, **given).truth.environment(0)
        np.testing.assert_allclose(kept.faces, from_faces.faces, rtol=0.02, atol=0.02)


def test_live_frames_are_the_same_each_time_they_are_iterated():
    """Noise, exposures and the gyroscope's drift are each iteration's own, also of two at once."""
    frames = fastibl.simulate(seconds=0.4, fps=10, size=(64, 48), live=True, auto_exposure=True, gyro=0.1)
    alone = list(frames)
    assert len(alone) == 4
    for a, b, c in zip(frames, frames, alone, strict=True):
        assert a == b == c


def test_true_maps_have_texels():
    with pytest.raises(ValueError, match="truth_size must be at least 1 texel, got 0"):
        fastibl.simulate(seconds=0.1, fps=10, size=(64, 48), truth_size=0)
