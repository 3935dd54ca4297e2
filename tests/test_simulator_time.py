"""What time does to simulated pictures: rolling shutter, motion blur, flicker, glare, clocks that differ."""

import numpy as np
import pytest
from standin import Page, centroid_of, centroid_seen, disc_rim

import fastibl
from fastibl import Camera, Pose, Recording, Rig
from fastibl.recording import RecordingWriter, Truth, read_rig, write_rig
from fastibl.shutter import Shutter, bands, row_times
from fastibl.simulator import FRONT_STEPS, DistantPlace, HandPath, _Eye, _PrintedBoard, default_rig, simulate

TURN = np.radians(60)  # a second
FOCAL = 260.0  # pixels
WIDE = Camera(320, 240, fx=FOCAL, fy=FOCAL, cx=160, cy=120)
SMALL = {"size": (160, 120), "truth_size": 8}
TIME = {"readout": 0.03, "shutter": 0.008, "flicker": 100.0, "glare": 0.02, "clock_offset": 0.02}


def linear(picture):
    return fastibl.Response.srgb().decode(picture.astype(np.float32) / 255)


def edge_map(height=1024):
    """Dark to the left of +y, bright to the right."""
    image = np.full((height, 2 * height, 3), 0.2, np.float32)
    image[:, height:] = 1.0
    return image


def looking(azimuth, elevation=0.0):
    """camera_from_marker of a camera 0.3 m above the board; azimuth from +y to +x."""
    forward = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(forward, right), forward
    matrix[:3, 3] = -matrix[:3, :3] @ [0.0, 0.0, 0.3]
    return Pose(matrix)


def turning(time):
    return looking(TURN * (time - 0.015))


def picture_of(environment, path, rig=None, **arguments):
    rig = Rig(WIDE) if rig is None else rig
    one = {"seconds": 0.1, "fps": 10, "board": False, "albedo": (0.9, 0.9, 0.9), "truth_size": 8, "rig": rig}
    return simulate(environment, path=path, **{**one, **arguments})[0]


def edge_columns(light, rows, expected, reach=25):
    """Where each row changes from dark to bright, pixels."""
    found = []
    for row, x in zip(rows, expected, strict=True):
        first = round(x) - reach
        window = light[row, first : first + 2 * reach].mean(axis=-1)
        dark, bright = light[row, :40].mean(), light[row, -40:].mean()
        found.append(first + 2 * reach - (window - dark).sum() / (bright - dark))
    return np.array(found)


def test_a_moving_edge_is_skewed_by_the_readout():
    rows = np.arange(110)  # above the horizon
    readout = 0.03
    slopes = {}
    for given in (0.0, readout):
        light = linear(picture_of(edge_map(), turning, readout=given).back)
        # A level camera sees a meridian as a vertical line.
        azimuth = TURN * (rows / 240 * given - 0.015)
        expected = WIDE.cx - FOCAL * np.tan(azimuth)
        found = edge_columns(light, rows, expected)
        slopes[given] = np.polyfit(rows, found, 1)[0] * 240
        error = found - expected
        print(f"readout {given}: edge {error.mean():.3f} +- {error.std():.3f} px, skew {slopes[given]:.2f} px")
        assert abs(error.mean()) < 0.15
        assert abs(slopes[given] + TURN * given * FOCAL) < 0.4
    assert slopes[readout] < -7.5


def test_each_row_of_the_page_is_where_its_time_puts_it():
    path = HandPath(np.random.default_rng([0, 0]), 0.5)
    readout, worst, still = 0.03, 0.0, 0.0
    recording = simulate(
        np.ones((16, 32, 3)), seconds=0.5, fps=4, board=Page(), hand=False, truth_size=8, readout=readout,
        path=path.back_from_marker, glare=0.0,
    )  # fmt: skip
    camera = recording.rig.back
    assert camera.readout == readout
    for frame in recording:
        light = linear(frame.back).mean(axis=-1)
        for centre in Page.discs:
            rim = disc_rim(centre)
            outlines = []
            for row_time in (frame.time, None):
                outline = camera.project(path.back_from_marker(frame.time) @ rim)
                if row_time is None:  # each point at the time of the row it is found on
                    for _ in range(3):
                        times = frame.time + (outline[:, 1] - 0.5) / camera.height * readout
                        outline = np.array(
                            [camera.project(path.back_from_marker(t) @ p) for t, p in zip(times, rim, strict=True)]
                        )
                outlines.append(centroid_of(outline))
            start, expected = outlines
            found = centroid_seen(light, expected)
            worst = max(worst, np.linalg.norm(found - expected))
            still = max(still, np.linalg.norm(start - expected))
    print(f"worst centroid {worst:.3f} px; {still:.2f} px moved")
    assert worst < 0.15 and still > 1


def test_an_exposure_blurs_by_the_way_that_it_sees():
    widths = {}
    for shutter in (0.0, 0.01, 0.02):
        light = linear(picture_of(edge_map(), turning, shutter=shutter).back)[:110].mean(axis=(0, 2))
        slope = np.diff(light[100:220])
        x = np.arange(slope.size)
        middle = (x * slope).sum() / slope.sum()
        near = np.abs(x - middle) < 14
        share = slope[near] / slope[near].sum()
        middle = (x[near] * share).sum()
        widths[shutter] = (share * (x[near] - middle) ** 2).sum()
        assert 100 + middle + 1 == pytest.approx(WIDE.cx - FOCAL * np.tan(-TURN * 0.015), abs=0.2)
    for shutter in (0.01, 0.02):  # of a box: width^2 / 12
        width = np.sqrt(12 * (widths[shutter] - widths[0.0]))
        print(f"shutter {shutter}: blur {width:.2f} px, expected {TURN * shutter * FOCAL:.2f}")
        assert width == pytest.approx(TURN * shutter * FOCAL, rel=0.1)


def test_blur_is_the_mean_of_linear_light():
    """Half of an exposure sees white, half black."""
    environment = np.zeros((16, 32, 3), np.float32)
    environment[:, 16:] = 1.0

    def jump(time):
        return looking(np.pi / 2 if time >= 0 else -np.pi / 2, 0.9)

    light = linear(picture_of(environment, jump, shutter=0.02).back)[:100, 120:200].mean()
    white = linear(picture_of(environment, jump).back)[:100, 120:200].mean()
    assert light == pytest.approx(0.5 * white, rel=0.02)


def test_flicker_shows_in_rows_and_whole_periods_average_out():
    def zenith(_):
        return looking(0.0, np.pi / 2)

    rows = {}
    for shutter in (0.0, 0.001, 0.0075, 0.01, 0.02):
        light = linear(picture_of(np.ones((16, 32, 3)), zenith, readout=0.03, shutter=shutter, flicker=100.0).back)
        rows[shutter] = light.mean(axis=(1, 2))
    steady = linear(picture_of(np.ones((16, 32, 3)), zenith, readout=0.03).back).mean(axis=(1, 2))
    times = np.arange(240) / 240 * 0.03
    for shutter, light in rows.items():
        # The mean over the exposure, added up and not by its formula.
        moments = times[:, None] + (np.arange(1000) + 0.5 - 500) / 1000 * shutter
        expected = (1 + 0.5 * np.cos(2 * np.pi * 100 * moments)).mean(axis=1)
        swing = np.ptp(light / steady)
        print(f"exposure {shutter * 1e3} ms: rows swing by {swing:.3f}")
        np.testing.assert_allclose(light / steady, expected, atol=0.012)
    assert np.ptp(rows[0.01] / steady) < 0.012 and np.ptp(rows[0.0] / steady) > 0.9


def test_darker_front_pictures_have_shorter_exposures():
    def front(**arguments):
        recording = simulate(
            np.ones((16, 32, 3)), seconds=0.3, fps=10, board=False, hand=False, readout=0.04, shutter=0.01,
            path=lambda _: looking(0.0, -np.pi / 2), **SMALL, **arguments,
        )  # fmt: skip
        exposures = [frame.front_exposure / recording[0].front_exposure for frame in recording]
        np.testing.assert_allclose(exposures, FRONT_STEPS)
        return [linear(frame.front)[:, 60:100].mean(axis=(1, 2)) for frame in recording]

    swings = []
    for lit, steady in zip(front(flicker=100.0), front(), strict=True):
        ratio = lit / steady
        # Frames are whole periods apart, so row 30 r / 120 * 0.04 = 10 ms is the brightest and row 15 the darkest.
        swings.append((ratio[25:35].mean() - ratio[10:20].mean()) / 2)
    print(f"between dark and bright rows {np.round(swings, 3)}")
    assert abs(swings[0]) < 0.01
    assert swings[1] == pytest.approx(0.5 * np.sinc(1 / 16) * np.sinc(1 / 3), rel=0.05)  # of ten rows


def test_no_exposure_lasts_longer_than_a_frame():
    """Beyond that, cameras amplify."""
    asked = []

    def path(time):
        asked.append(time)
        return looking(0.0, -np.pi / 2 + time)

    simulate(
        np.ones((16, 32, 3)), seconds=0.4, fps=5, board=False, hand=False, shutter=0.2, path=path,
        front_exposures=lambda e: 50 * e, **SMALL,
    )  # fmt: skip
    assert -0.11 < min(asked) and max(asked) < 0.4


def test_glare_keeps_the_light_and_lifts_the_dark():
    camera = Camera(64, 48, fx=60, fy=60, cx=32, cy=24)
    eye, rng = _Eye(camera), np.random.default_rng(0)
    light = np.full((48, 64, 3), 0.02, np.float32)
    light[10:20, 10:20] = (0.8, 0.6, 0.4)
    pictures = {}
    for share in (0.0, 0.05):
        pictures[share] = np.mean([linear(eye.expose(light.copy(), 1.0, rng, share)) for _ in range(300)], axis=0)
    assert pictures[0.05].mean(axis=(0, 1)) == pytest.approx(pictures[0.0].mean(axis=(0, 1)), rel=0.005)
    dark = slice(30, 45), slice(30, 60)
    lifted = pictures[0.05][dark].mean(axis=(0, 1))
    expected = 0.95 * 0.02 + 0.05 * light.mean(axis=(0, 1))
    np.testing.assert_allclose(lifted, expected, rtol=0.02)
    assert (lifted > 1.02 * pictures[0.0][dark].mean(axis=(0, 1))).all()


def test_glare_counts_light_that_is_clipped():
    camera = Camera(64, 48, fx=60, fy=60, cx=32, cy=24)
    eye, rng = _Eye(camera), np.random.default_rng(0)
    light = np.zeros((48, 64, 3), np.float32)
    light[24, 32] = 3000.0
    picture = np.mean([linear(eye.expose(light.copy(), 1.0, rng, 0.1)) for _ in range(100)], axis=0)
    assert picture[:10].mean() == pytest.approx(0.1 * 3000 / (48 * 64), rel=0.01)


def test_the_clock_offset_moves_pictures_and_not_the_truth():
    path = HandPath(np.random.default_rng([5, 0]), 0.4)
    common = {"seconds": 0.4, "fps": 5, "board": Page(), "seed": 5, **SMALL}
    late = simulate(np.ones((16, 32, 3)), path=path.back_from_marker, clock_offset=0.02, hand=False, **common)
    moved = simulate(np.ones((16, 32, 3)), path=lambda t: path.back_from_marker(t + 0.02), hand=False, **common)
    assert late.times == moved.times == [0.0, 0.2]
    assert list(late) == list(moved)
    for time in late.times:
        assert late.truth.pose(time) == path.back_from_marker(time)
        assert late.truth.pose(time + 0.02) == path.back_from_marker(time + 0.02)
    assert late.truth.clock_offset == 0.02
    # By the truth's clock the lamp is on when the later picture is taken.
    lamp = simulate(clock_offset=0.02, **{**common, "seconds": 0.41, "hand": False})
    early = simulate(**{**common, "seconds": 0.41, "hand": False})
    assert lamp.truth.lamp_time == pytest.approx(0.205)
    assert linear(lamp[1].back)[:8].mean() > 1.2 * linear(early[1].back)[:8].mean()


def test_the_lamp_comes_on_between_two_rows():
    recording = simulate(
        seconds=0.1, fps=10, board=False, hand=False, path=lambda t: looking(0.2 + 2 * t, -0.9), readout=0.1, **SMALL
    )
    dark = simulate(
        seconds=0.1, fps=10, board=False, hand=False, path=lambda t: looking(0.2 + 2 * t, -0.9), readout=0.1,
        lamp=False, **SMALL,
    )  # fmt: skip
    ratio = linear(recording[0].back).mean(axis=(1, 2)) / linear(dark[0].back).mean(axis=(1, 2))
    assert recording.truth.lamp_time == pytest.approx(0.05)
    assert ratio[:55] == pytest.approx(1, abs=0.05) and (ratio[65:] > 1.15).all()


def test_truth_holds_poses_of_the_first_and_the_last_row():
    path = HandPath(np.random.default_rng([1, 0]), 0.2)
    recording = simulate(
        np.ones((8, 16, 3)), path=path.back_from_marker, seconds=0.2, fps=10, board=False, readout=0.03,
        clock_offset=-0.01, **SMALL,
    )  # fmt: skip
    for time in recording.times:
        for step in (0.0, -0.01, 0.02):
            assert recording.truth.pose(time + step) == path.back_from_marker(time + step)


def test_what_is_left_out_changes_no_byte():
    """The pictures are those of one pose, one look-up and one draw of noise."""
    environment = edge_map(64)
    default = simulate(environment, seed=4, seconds=0.4, fps=5, board=Page(), hand=False, **SMALL)
    zero = simulate(
        environment, seed=4, seconds=0.4, fps=5, board=Page(), hand=False, readout=0.0, shutter=0.0, flicker=0.0,
        glare=0.0, clock_offset=0.0, **SMALL,
    )  # fmt: skip
    assert list(default) == list(zero)
    place, noise = DistantPlace(environment), np.random.default_rng([4, 1])
    path, page = HandPath(np.random.default_rng([4, 0]), 0.4), _PrintedBoard(Page(), place)
    rig = default_rig((160, 120))
    assert [time for time, _ in default.truth.poses] == default.times
    for frame in default:
        back = path.back_from_marker(frame.time)
        for name, pose in (("back", back), ("front", rig.front_from_back @ back)):
            eye, marker_from_camera = _Eye(getattr(rig, name)), pose.inverse()
            directions = np.einsum("ij,hwj->hwi", marker_from_camera.rotation, eye.rays).astype(np.float32)
            light = place.radiance(marker_from_camera.translation, directions, False, unit=True)
            page.lay(light, eye, pose, False)
            picture = eye.expose(light, getattr(frame, f"{name}_exposure"), noise)
            off = np.abs(picture.astype(int) - getattr(frame, name))
            assert (off > 1).mean() < 1e-3  # the products' last bit may differ


def test_same_seed_same_bytes(tmp_path):
    def files(seed, folder):
        out = tmp_path / folder
        simulate(edge_map(64), seed, seconds=0.2, fps=10, board=Page(), out=out, **TIME, **SMALL)
        return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()}

    one, two, other = files(1, "one"), files(1, "two"), files(2, "other")
    assert one == two
    assert one["back/00000.png"] != other["back/00000.png"]
    opened = Recording.open(tmp_path / "one")
    assert opened.rig.back.readout == opened.rig.front.readout == 0.03
    assert opened.truth.clock_offset == 0.02


def test_readout_is_kept_and_older_recordings_open(tmp_path):
    rig = default_rig((160, 120))
    write_rig(tmp_path / "rig.yaml", rig)
    assert b"readout" not in (tmp_path / "rig.yaml").read_bytes()
    assert read_rig(tmp_path / "rig.yaml").back.readout == 0
    slow = Rig(Camera(8, 6, fx=8, fy=8, cx=4, cy=3, readout=0.025))
    write_rig(tmp_path / "slow.yaml", slow)
    assert read_rig(tmp_path / "slow.yaml") == slow
    assert slow != Rig(Camera(8, 6, fx=8, fy=8, cx=4, cy=3))
    with RecordingWriter(tmp_path / "one", slow) as writer:
        writer.write_truth(Truth())
    assert b"clock_offset" not in (tmp_path / "one" / "truth" / "events.json").read_bytes()
    assert Recording.open(tmp_path / "one").truth.clock_offset == 0


def test_a_still_camera_needs_one_band():
    parts = list(bands(WIDE, lambda _: looking(0.0), 1.0, 0.01))
    assert len(parts) == 1 and len(parts[0].poses) == 1 and parts[0].rows == slice(0, 240)


def test_bands_cover_all_rows_once():
    slow = Camera(320, 240, fx=FOCAL, fy=FOCAL, cx=160, cy=120, readout=0.03)
    parts = list(bands(slow, turning, 1.0, 0.004))
    assert [p.rows.start for p in parts[1:]] == [p.rows.stop for p in parts[:-1]]
    assert parts[0].rows.start == 0 and parts[-1].rows.stop == 240
    times = row_times(slow, 1.0)
    for part in parts:
        assert np.mean([t for t, _ in part.poses]) == pytest.approx(times[part.rows].mean())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"readout": -0.01}, "readout"),
        ({"readout": np.nan}, "readout"),
        ({"readout": 0.2}, "between frames"),
        ({"shutter": -1.0}, "shutter"),
        ({"shutter": 0.2}, "between frames"),
        ({"flicker": -50.0}, "flicker"),
        ({"flicker": 100.0, "flicker_depth": 1.5}, "flicker_depth"),
        ({"glare": 1.5}, "glare"),
        ({"glare": np.inf}, "glare"),
        ({"clock_offset": np.nan}, "clock_offset"),
        ({"path": "nowhere"}, "path"),
    ],
)
def test_errors(arguments, message):
    with pytest.raises(ValueError, match=message):
        simulate(np.ones((8, 16, 3)), **{"seconds": 0.1, "fps": 10, "board": False, **SMALL, **arguments})


def test_a_shutter_by_itself():
    with pytest.raises(ValueError, match="flicker_depth"):
        Shutter(flicker_depth=-0.1)
    assert Shutter(flicker=100.0).lamps(np.array([0.0, 0.005]), 0.0) == pytest.approx([1.5, 0.5])
