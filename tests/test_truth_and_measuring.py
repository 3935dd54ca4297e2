"""What judges the library, judged by cases whose answer is known: the true renderer, the timer, rows."""

import warnings

import numpy as np
import pytest

import fastibl
from fastibl import faults, measuring, reference, truth


@pytest.fixture(scope="module")
def white():
    return fastibl.CubeMap(np.ones((6, 32, 32, 3)))


@pytest.fixture(scope="module")
def renderer():
    """A ball of 4 cm that hovers 4 cm above the table."""
    import trimesh

    ball = trimesh.creation.icosphere(2, 0.02)
    mesh = fastibl.Mesh(ball.vertices + [0, 0, 0.06], ball.faces)
    return truth.TrueRenderer(fastibl.Scene(mesh, fastibl.Material(diffuse=(0.5, 0.5, 0.5))), grid=16, bounce=False)


def test_a_ball_in_even_light_keeps_nothing_from_itself(renderer, white):
    light = renderer.vertex_irradiance(white)
    assert light.shape == (162, 3) and np.allclose(light, np.pi, rtol=0.03)
    assert np.allclose(renderer.exitance(white), 0.5 * light, rtol=1e-6)


def test_shadow_error_is_that_of_the_ratio(renderer, white):
    true = renderer.plane_ratio(white)
    spheres = np.array([[0, 0, 0.06, 0.02]], np.float32)
    good = fastibl.cast_shadow(white, spheres, extent=0.3, resolution=256, directions=1024)
    none = fastibl.cast_shadow(white, np.zeros((0, 4), np.float32), extent=0.3)
    assert renderer.shadow_error(good, true) < 0.02
    where = renderer.outside_footprint & ((1 - true).max(axis=-1) > 0.01)
    assert renderer.shadow_error(none, true) == pytest.approx(np.sqrt(((1 - true)[where] ** 2).mean()), rel=1e-5)


@pytest.mark.parametrize("size", [4, 16, 64])
def test_maps_of_any_power_of_two(renderer, size):
    light = fastibl.CubeMap(np.full((6, size, size, 3), 0.5, np.float32))
    assert np.allclose(renderer.plane_gain(light), renderer.plane_gain(fastibl.CubeMap(np.full((6, 32, 32, 3), 0.5))))
    with pytest.raises(ValueError, match="32 texels wide, .* got 24"):
        renderer.vertex_irradiance(fastibl.CubeMap(np.ones((6, 24, 24, 3))))


def test_small_maps_are_what_they_are_in_finer_texels():
    """For every part of the light."""
    import trimesh

    ball = trimesh.creation.icosphere(2, 0.02)
    mesh = fastibl.Mesh(ball.vertices + [0, 0, 0.06], ball.faces)
    faces = np.random.default_rng(1).uniform(0, 2, (6, 8, 8, 3)).astype(np.float32)
    small, fine = fastibl.CubeMap(faces), fastibl.CubeMap(faces.repeat(4, axis=1).repeat(4, axis=2))
    camera = fastibl.Camera(32, 24, 80, 80, 16, 12)
    pose = fastibl.Pose(np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.4], [0, 0, 0, 1.0]]))
    back = np.full((24, 32, 3), 120, np.uint8)
    for material in (fastibl.Material((0.2,) * 3, (0.5,) * 3, 200), fastibl.Material.pbr((1, 1, 1), 1.0, 0.3)):
        renderer = truth.TrueRenderer(fastibl.Scene(mesh, material), grid=8)
        pictures = [renderer.render(back, 1.0, camera, pose, light).linear for light in (small, fine)]
        np.testing.assert_allclose(*pictures, rtol=1e-4, atol=1e-6)


def test_picture_error(renderer, white):
    camera = fastibl.Camera(64, 48, 80, 80, 32, 24)
    pose = fastibl.Pose(np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.4], [0, 0, 0, 1.0]]))
    back = np.full((48, 64, 3), 120, np.uint8)
    true = renderer.render(back, 1.0, camera, pose, white)
    assert truth.picture_error(true.image, true, back, camera.response) < 0.01  # 8 bits
    brighter = np.clip(true.linear * 1.1, 0, 1)
    encoded = np.rint(255 * camera.response.encode(brighter)).astype(np.uint8)
    assert truth.picture_error(encoded, true, back, camera.response) == pytest.approx(0.1, abs=0.03)


def test_texels_that_count():
    """What was last seen before the lamp or under the hand does not count; what no exposure can hold clips."""
    recording = fastibl.simulate(seconds=1, fps=6, size=(64, 48), truth_size=16, lamp=True, hand=True)
    last_seen = np.full((6, 16, 16), recording.times[-1])
    last_seen[0] = -np.inf
    last_seen[1] = recording.truth.lamp_time - 0.1
    last_seen[2] = np.mean(recording.truth.hand)
    counts, unclipped = truth.texels_that_count(recording, last_seen)
    assert not counts[0].any() and not counts[1].any() and not counts[2].any() and counts[3:].all()
    assert not (unclipped & ~counts).any() and unclipped[3:].mean() > 0.9
    everywhere = np.full((6, 16, 16), recording.times[-1])
    counts, unclipped = truth.texels_that_count(recording, everywhere)
    faces = np.array(recording.truth.environment(recording.times[-1]).faces)
    lamp = np.unravel_index(faces.max(axis=-1).argmax(), faces.shape[:3])
    darkest = min(f.front_exposure for f in recording) * recording.rig.front.gain
    assert counts.all() and unclipped[lamp] == (faces[lamp].max() * darkest < 0.95)
    faces[lamp] = 2 / darkest
    recording.truth.maps = [(0.0, fastibl.CubeMap(faces))]
    unclipped[lamp] = False
    np.testing.assert_array_equal(truth.texels_that_count(recording, everywhere)[1], unclipped)


def test_pbr_surface_reads_textures_between_texels():
    texture = np.zeros((2, 2, 3), np.float32)
    texture[:, 1] = 1  # u = 0.25 is black, u = 0.75 white
    material = fastibl.Material.pbr(texture, 0.5, 0.4)
    normals, tangents = np.tile([0.0, 0, 1], (3, 1)), np.tile([1.0, 0, 0, 1], (3, 1))
    surface = truth.pbr_surface(material, normals, tangents, np.array([[0.25, 0.5], [0.5, 0.5], [0.75, 0.5]]))
    assert isinstance(surface, truth.PbrSurface)
    assert np.allclose(surface.base_color, [[0] * 3, [0.5] * 3, [1] * 3]) and np.allclose(surface.metallic, 0.5)
    assert np.allclose(surface.alpha, reference.ggx_alpha(0.4)) and np.allclose(surface.frame, np.eye(3))


def test_a_pose_from_a_rotation_vector_is_finite():
    for rotation, translation in (([np.nan, 0, 0], [0.0, 0, 0]), ([0.0, 0, 0], [0.0, np.inf, 0])):
        with pytest.raises(ValueError, match="finite"):
            fastibl.Pose.from_rotation_vector(rotation, translation)


def test_ggx_alpha_is_gltfs():
    assert reference.ggx_alpha(0.5) == (0.25, 0.25) and reference.ggx_alpha(0.0) == (0.02, 0.02)
    assert reference.ggx_alpha(0.5, 1.0) == (1.0, 0.25)


def test_timings():
    timing = measuring.Timing(2.0, 1.0, 3.0, 0.2, 0.1, 0.3, 5)
    assert timing.of_cpu == measuring.Timing(0.2, 0.1, 0.3, 0.2, 0.1, 0.3, 5)
    assert timing.scaled(10).median == 0.2 and timing.scaled(10).count == 5
    done = []
    timings, yardstick = measuring.side_by_side({"a": done.append, "b": lambda _: sum(range(30000))}, rounds=3)
    assert len(done) >= 4 and timings["b"].cpu > timings["a"].cpu and yardstick > 0  # one round to warm up


def test_threads_while_measuring():
    before = fastibl.threads()
    with measuring.one_core():
        assert fastibl.threads() == 1
        with measuring.all_cores():
            assert fastibl.threads() >= 1
        assert fastibl.threads() == 1
    assert fastibl.threads() == before


def test_threads_of_a_function_that_yields():
    """As rows of goals do: the number is that until the last value, and of each call."""

    @measuring.one_core()
    def seen():
        yield fastibl.threads()
        yield fastibl.threads()

    before = fastibl.threads()
    fastibl.set_threads(2)
    try:
        assert list(seen()) == [1, 1] == list(seen())
        assert fastibl.threads() == 2
    finally:
        fastibl.set_threads(before)


def test_commit_is_a_short_hash_or_nothing():
    text = measuring.commit()
    assert text == "" or all(c in "0123456789abcdef" for c in text.rstrip("+"))


def test_what_results_say_of_themselves():
    recording = fastibl.simulate(seconds=0.5, fps=8, size=(160, 120), truth_size=16)
    scene = fastibl.Scene(fastibl.stand(fastibl.shapes.figurine(), 0.1))
    session = fastibl.Session(scene, recording.rig, recording.board, size=32)
    for frame in faults.Faulty(recording, kinds=0.0):
        result = session.process(frame)
    assert result.back_taken.how in ("told", "corrected") and result.front_taken.exposure > 0
    assert result.back_taken.probes >= 0
    capture = next(p for p in result.plan.passes if p.name == "capture")
    assert "pose" in " ".join(capture.needs) and capture.writes
    assert fastibl.Material.pbr((1, 1, 1), 0.0, 0.5).normal_scale == 1.0


def test_the_reference_knows_mirrors_and_refuses_what_it_cannot_do(marked):
    n = np.array([0.1, 0.2, 0.97])
    v = np.array([[0.3, 0.1, 0.9], [-0.2, 0.4, 0.8]])
    n, v = n / np.linalg.norm(n), v / np.linalg.norm(v, axis=1, keepdims=True)
    mirror = 2 * (v @ n)[:, None] * n - v
    directions, _, radiance = reference.samples(marked)
    np.testing.assert_array_equal(
        reference.glossy(marked, n, v, np.inf), radiance[np.argmax(mirror @ directions.T, axis=1)]
    )
    np.testing.assert_allclose(
        reference.glossy(marked, n, v, 1e7, split=64), reference.glossy(marked, n, v, np.inf), rtol=0.02
    )
    assert reference.irradiance(marked, np.zeros((0, 3))).shape == (0, 3)
    for wrong in (np.nan, -1.0):
        with pytest.raises(ValueError, match="exponent must be at least 0"):
            reference.glossy(marked, n, v, wrong)
        with pytest.raises(ValueError, match="exponent must be at least 0"):
            reference.directional_albedo(0.5, wrong)
    with pytest.raises(ValueError, match=r"spheres \(m, 4\), got \(2, 2\)"):
        reference.shadow_ratio(marked, np.zeros((2, 2)), [[0, 0]])


def test_the_light_that_a_wholly_dark_plane_keeps_away(renderer, white, monkeypatch):
    """From just above it, that of half the sphere; from its other side, none."""
    monkeypatch.setattr(renderer, "plane_ratio", lambda source: np.zeros((renderer.grid, renderer.grid, 3)))
    points = np.array([[0.0, 0.0, 0.005], [0.0, 0.0, 0.005]])
    open_ = np.zeros((2, len(renderer.directions) // 8), np.uint8)
    lost = renderer.lost_below(white, points, np.array([[0.0, 0, -1], [0, 0, 1]]), open_)
    np.testing.assert_allclose(lost, np.pi * np.array([[1] * 3, [0] * 3]), rtol=0.02, atol=1e-12)


def test_what_a_dielectric_reflects_and_lets_out():
    glass = fastibl.Material.pbr((0.5, 0.5, 0.5), 0.0, 0.5)
    np.testing.assert_allclose(truth.dielectric_of(glass), 0.04, rtol=1e-6)  # of an index of 1.5
    smooth, dull = truth.transmitted(np.array([1.0, 0.5]), np.array([0.0, 0.0]), glass)
    assert smooth == pytest.approx(0.96) and dull == pytest.approx(1 - 0.04 * 0.5 * (1 + 0.04))


def test_the_head_of_a_file_of_rows(tmp_path):
    path = measuring.write_rows(str(tmp_path / "rows.json"), [measuring.row("sh9", "a map")], {"command": "a"})
    head = measuring.read_head(str(path))
    assert head["command"] == "a" and head["yardstick_seconds"] > 0 and "rows" not in head
    assert [r.method for r in measuring.read_rows(str(path))] == ["sh9"]


@pytest.mark.parametrize("fx, fy", [(80, 80), (80, 120), (120, 80)])
def test_vignetting_of_pixels_that_are_not_square(white, fx, fy):
    """An object that shines: its layer in the picture is exposure, gain and vignetting alone."""
    camera = fastibl.Camera(64, 48, fx, fy, 30, 25, vignetting=(-0.5,))
    pose = fastibl.Pose(np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.4], [0, 0, 0, 1.0]]))
    scene = fastibl.Scene(fastibl.shapes.figurine(0.2), fastibl.Material((0,) * 3, emission=(0.5,) * 3))
    true = truth.TrueRenderer(scene, grid=8, bounce=False).render(
        np.zeros((48, 64, 3), np.uint8), 1.0, camera, pose, white
    )
    y, x = np.nonzero(true.coverage > 0.999)
    radius = ((x + 0.5 - 30) / fx) ** 2 + ((y + 0.5 - 25) / fy) ** 2
    assert len(x) > 100
    np.testing.assert_allclose(true.linear[y, x, 0], 0.5 * (1 - 0.5 * radius), rtol=1e-6)


@pytest.mark.parametrize("exponent", [2e4, 1e6, np.inf])
def test_sharp_lobes_and_mirrors_have_a_truth(exponent):
    """In even light, the light of the lobe but for what the object hides."""
    even = fastibl.CubeMap(np.full((6, 32, 32, 3), 0.5))
    camera = fastibl.Camera(64, 48, 80, 80, 32, 24)
    pose = fastibl.Pose(np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.4], [0, 0, 0, 1.0]]))
    scene = fastibl.Scene(fastibl.shapes.figurine(0.2), fastibl.Material((0,) * 3, (0.8,) * 3, exponent))
    renderer = truth.TrueRenderer(scene, grid=8, bounce=False)
    true = renderer.render(np.zeros((48, 64, 3), np.uint8), 1.0, camera, pose, even)
    shown = true.linear[true.coverage > 0.999]
    assert np.isfinite(true.linear).all() and shown.max() == pytest.approx(0.4, rel=1e-3)
    assert np.median(shown) == pytest.approx(0.4, rel=1e-3) and shown.mean() > 0.3


def test_an_object_out_of_view_is_no_error(renderer, white):
    camera = fastibl.Camera(64, 48, 80, 80, 32, 24)
    away = fastibl.Pose(np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -0.4], [0, 0, 0, 1.0]]))  # looks up
    back = np.full((48, 64, 3), 120, np.uint8)
    true = renderer.render(back, 1.0, camera, away, white)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert truth.picture_error(true.image, true, back, camera.response) == 0


def test_times_and_points_are_told_as_they_are():
    told = {0.9996: "1 s", 9.996e-4: "1 ms", 0.9994: "999 ms", 1234.0: "1234 s", 12.34: "12.3 s", 2e-9: "2 ns"}
    assert {s: measuring.rows.seconds_text(s) for s in told} == told

    def row(seconds, threads=1, backend="cpu", case="a"):
        time = measuring.timing([seconds], [seconds])
        return measuring.row("sh9", case, "error", 0.1, time, threads=threads, backend=backend)

    (point,) = measuring.points([row(1.0), row(3.0, case="b"), row(0.5, 2), row(9.0, backend="gl")])["error"]
    assert point.seconds == 2
    (point,) = measuring.points([row(9.0, backend="gl")])["error"]
    assert point.seconds == 9
