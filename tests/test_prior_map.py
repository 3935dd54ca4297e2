"""A map from before stands for what no picture has seen."""

import numpy as np
import pytest
from scenes import scene_of

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.simulator import PAPER
from views import camera_of, exposed, looking, picture_of, place_light, place_map

SIZE = 64
UP = fastibl.texel_directions(SIZE)[..., 2] > 0.02


def sweep(capture, towards, radiance=place_light, time=0.0):
    camera = camera_of(320, 240, 70)
    for i, d in enumerate(towards):
        pose = looking(d, (0, 0, 0.3))
        linear = picture_of(radiance, camera, pose, split=2)
        for k, exposure in enumerate((1.0, 1 / 16, 1 / 256)):
            codes = exposed(linear, camera, exposure)
            capture.add(codes, camera, pose, exposure=exposure, time=time + 0.1 * (3 * i + k))
    return capture


def test_a_prior_fills_the_sky_and_is_said_to():
    prior = fastibl.CubeMap(place_map(SIZE))
    env = fastibl.Capture(size=SIZE, prior=prior).environment()
    assert np.array_equal(env.radiance.faces[UP], prior.faces[UP])
    assert env.coverage == 0 and not np.asarray(env.confidence).any()
    # Below the horizon is the table, lit by the prior: albedo E / pi.
    below = env.radiance.faces[fastibl.texel_directions(SIZE)[..., 2] < -0.05]
    expected = 0.5 * fastibl.Lighting(prior).irradiance(np.array([[0.0, 0, 1]]))[0] / np.pi
    print(f"table under a prior: {below.mean(axis=0)}, expected {expected}")
    np.testing.assert_allclose(below, np.broadcast_to(expected, below.shape), rtol=0.02)
    assert env.knowledge["prior_flux"] > 0.5 and env.predicted_error > 0.5


def test_what_is_seen_goes_before_the_prior_and_tells_its_brightness():
    """The place is now 2.5 times as bright, and redder, than when the prior was made."""
    now = np.array([3.0, 2.5, 2.2])
    prior, true = fastibl.CubeMap(place_map(SIZE)), fastibl.CubeMap((place_map(SIZE) * now).astype(np.float32))
    towards = [(1, 0.3, 0.5), (0.2, -1, 0.4)]
    errors = {}
    for name, known in (("nothing", None), ("prior", prior)):
        capture = sweep(fastibl.Capture(size=SIZE, prior=known), towards, lambda d: place_light(d) * now)
        env = capture.environment()
        seen = np.isfinite(capture.last_seen) & UP
        filled = env.radiance.faces * UP[..., None] + true.faces * ~UP[..., None]
        errors[name] = irradiance_error(fastibl.CubeMap(filled.astype(np.float32)), true)
        ratio = np.median(env.radiance.faces[UP & ~seen] / true.faces[UP & ~seen])
        share = seen.sum() / UP.sum()
        print(f"{name}: {share:.0%} of the sky seen, irradiance {errors[name]:.1%} off, unseen x{ratio:.2f}")
        if known:
            assert abs(ratio - 1) < 0.02
            assert 0.2 < env.knowledge["prior_flux"] < env.knowledge["unseen_flux"]
    assert errors["prior"] < 0.02 < 0.3 * errors["nothing"]


def test_a_prior_is_matched_by_what_does_not_clip():
    """The place is 4 times as bright as before, and clips but for a dark part, as one exposure may show it."""
    directions = fastibl.texel_directions(SIZE)

    def before(d):
        return np.where(d[..., :1] > -0.3, 0.5, 0.1) * np.ones(3)

    capture, camera = fastibl.Capture(size=SIZE, prior=fastibl.CubeMap(before(directions))), camera_of(160, 120, 70)
    for k, towards in enumerate([(0.2, 1, 0.6), (-1, 0.6, 0.5), (1, 0.3, 0.5), (1, -0.8, 0.5)]):
        pose = looking(towards, (0, 0, 0.3))
        codes = exposed(picture_of(lambda d: 4 * before(d), camera, pose), camera, 1.0)
        capture.add(codes, camera, pose, time=0.1 * k)
    env = capture.environment()
    unseen = ~np.isfinite(capture.last_seen) & UP & (directions[..., 0] < -0.4)
    filled = np.median(env.radiance.faces[unseen])
    print(f"{env.clipped:.0%} clips; the unseen dark part is {filled:.3f}, true 0.4")
    assert env.clipped > 0.5 and unseen.sum() > 500
    assert filled == pytest.approx(0.4, rel=0.02)


def test_maps_stay_consistent_where_tiles_are_partly_seen():
    """MIP levels of a map that was updated in place are those of the same texels built anew."""
    capture = fastibl.Capture(size=SIZE, prior=fastibl.CubeMap(place_map(SIZE)))
    capture.environment()
    sweep(capture, [(1, 0.3, 0.5)])
    map_ = capture.environment().radiance
    fresh = fastibl.CubeMap(np.array(map_.faces))
    d = np.random.default_rng(1).normal(size=(500, 3))
    for level in (1.0, 3.0, 5.0):
        np.testing.assert_allclose(map_.sample(d, level=level), fresh.sample(d, level=level), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("size", [16, 48, 256])
def test_priors_of_other_sizes(size):
    prior = fastibl.CubeMap(place_map(size))
    env = fastibl.Capture(size=SIZE, prior=prior).environment()
    error = irradiance_error(
        env.radiance, fastibl.CubeMap(np.where(UP[..., None], place_map(SIZE), env.radiance.faces))
    )
    print(f"prior of {size} texels in a map of {SIZE}: irradiance {error:.2%} off")
    assert error < 0.03


def test_a_black_prior():
    capture = fastibl.Capture(size=SIZE, prior=fastibl.CubeMap(np.zeros((6, SIZE, SIZE, 3), np.float32)))
    sweep(capture, [(1, 0.3, 0.5)])
    assert np.isfinite(capture.environment().radiance.faces).all()


def test_a_session_starts_with_its_prior():
    film = fastibl.simulate(seconds=0.2, fps=10, size=(320, 240), hand=False, lamp=False)
    scene = scene_of(fastibl.shapes.figurine(detail=0.9))
    prior = film.truth.environment(0)
    session = fastibl.Session(scene, film.rig, film.board, prior=prior, size=64, paper_albedo=PAPER)
    result = session.process(film[0])
    assert result.environment.knowledge["prior_flux"] > 0.2
    error = irradiance_error(result.environment, prior)
    print(f"after one frame the irradiance is {error:.2%} off")
    assert error < 0.1


@pytest.mark.parametrize("scale", [1e-3, 10.0, 1e4])
@pytest.mark.parametrize("cameras", ["back", "both"])
def test_a_prior_of_another_scale_is_as_bright_as_the_board_says(scale, cameras):
    """A photograph's units, or a network's: before eight tiles of the sky were seen whole, from the first frame on."""
    film = fastibl.simulate(seconds=0.5, fps=10, size=(320, 240), hand=False, lamp=False)
    truth = film.truth.environment(0)
    prior = fastibl.CubeMap(truth.faces * np.float32(scale))
    scene = fastibl.Scene(fastibl.shapes.figurine(detail=0.9), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, film.rig, film.board, prior=prior, size=64, paper_albedo=PAPER)
    errors = []
    for frame in film:
        frame.front = None if cameras == "back" else frame.front
        errors.append(irradiance_error(session.process(frame).environment, truth))
    print(f"x{scale}, {cameras}: irradiance {errors[0]:.1%} off in the first frame, {errors[-1]:.1%} in the last")
    assert max(errors) < 0.12
