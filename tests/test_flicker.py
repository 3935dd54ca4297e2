"""Lamps on the mains in exposures shorter than their swing: pictures that differ up and down are averaged."""

import numpy as np
import pytest

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.exposure import AdaptiveExposure, whole_periods
from views import camera_of, exposed, looking, picture_of

CAMERA = camera_of()


def light(d):
    x, y, z = np.moveaxis(np.asarray(d, np.float64), -1, 0)
    rings = 0.15 * np.sin(9 * x) * np.cos(7 * y)
    return np.stack([0.4 + 0.15 * x + rings, 0.4 - 0.1 * y + rings, 0.35 + 0.1 * z + rings], axis=-1)


def film(gains, exposure=0.8, fps=15.0, turn=6.0, doubt=True):
    """Pictures of a camera that turns by `turn` degrees a picture, of light `gains` times as strong. Returns the
    capture, how each was taken, and the true map."""
    capture = fastibl.Capture(size=32, doubt_exposures=doubt)
    taken = []
    for k, gain in enumerate(gains):
        a = np.radians(turn * k)
        pose = looking((np.cos(a), np.sin(a), 0.5))
        picture = exposed(gain * picture_of(light, CAMERA, pose), CAMERA, exposure)
        taken.append(capture.add(picture, CAMERA, pose, exposure=exposure, time=k / fps))
    return capture, taken, fastibl.CubeMap(light(fastibl.texel_directions(64)).astype(np.float32))


def level(capture):
    """The map's brightness by the true one: median over what was seen above the horizon."""
    env = capture.environment()
    d = fastibl.texel_directions(32)
    seen = (env.confidence > 0) & (d[..., 2] > 0.1)
    return float(np.median(env.radiance.faces[seen] / light(d[seen])))


def swings(count, hertz=100.0, fps=15.0, depth=0.5):
    return 1 + depth * np.cos(2 * np.pi * hertz * np.arange(count) / fps)


@pytest.mark.parametrize("fps", [15.0, 13.0, 30.0, 24.0])
def test_a_swing_is_averaged(fps):
    gains = swings(60, fps=fps)
    ours, taken, true = film(gains, fps=fps)
    blind, _, _ = film(gains, fps=fps, doubt=False)
    print(
        f"{fps} pictures a second: level {level(ours):.3f}, believed {level(blind):.3f}; irradiance "
        f"{irradiance_error(ours.environment(), true):.1%}, believed {irradiance_error(blind.environment(), true):.1%}"
    )
    averaged = [t for t in taken if t.how == "averaged"]
    assert len(averaged) > 40 and all(t.flicker > 0.2 for t in averaged)
    assert np.median([t.flicker for t in averaged]) == pytest.approx(gains.std(), rel=0.25)
    assert level(ours) == pytest.approx(gains.mean(), abs=0.06)


def test_steady_light_is_told():
    _, taken, _ = film(np.ones(40))
    assert all(t.how == "told" and t.flicker == 0 for t in taken)


def test_small_swings_do_not_matter():
    ours, _, _ = film(swings(40, depth=0.02))
    assert level(ours) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("gain", [0.5, 1.5])
def test_a_light_that_is_switched_is_no_flicker(gain):
    ours, taken, _ = film(np.where(np.arange(50) < 25, 1.0, gain))
    assert not any(t.how == "averaged" for t in taken)
    assert taken[-1].how == "told"


def test_a_few_wrong_exposures_are_no_flicker():
    gains = np.ones(60)
    gains[[20, 24, 33, 38, 47]] = [2.0, 0.5, 1.7, 0.4, 2.2]
    ours, taken, _ = film(gains)
    assert not any(t.how == "averaged" for t in taken)
    assert level(ours) == pytest.approx(1, abs=0.03)


def test_a_swing_that_every_picture_catches_alike_is_not_seen():
    ours, taken, _ = film(swings(40, hertz=120.0, fps=15.0))
    assert not any(t.how == "averaged" for t in taken)
    assert level(ours) == pytest.approx(1.5, abs=0.05)  # what only longer exposures help against


@pytest.mark.parametrize(
    ("exposure", "flicker", "expected"),
    [(3.7, 100, 3.0), (1.0, 100, 1.0), (0.99, 100, 0.99), (3.7, 120, 10 / 3), (3.7, 0, 3.7), (2.0, 100, 2.0)],
)
def test_whole_periods(exposure, flicker, expected):
    assert whole_periods(exposure, flicker) == pytest.approx(expected)


def test_exposures_that_are_chosen_last_whole_periods():
    capture, _, _ = film(np.ones(5))
    schedule = AdaptiveExposure(CAMERA, 0.01, 8.3, flicker=100)
    plain = AdaptiveExposure(CAMERA, 0.01, 8.3)
    for s in (schedule, plain):
        s.update(capture, looking((-1.0, 0.0, 0.5)))
    assert schedule(1.0) == whole_periods(plain(1.0), 100)
    with pytest.raises(ValueError, match="0 Hz or more"):
        AdaptiveExposure(CAMERA, 0.01, 8.0, flicker=-1)
