"""Capture from pictures whose rows are taken one after the other."""

import numpy as np
import pytest

from fastibl import Camera, Capture, Rig, texel_directions
from fastibl.room import OBJECT
from fastibl.simulator import DistantPlace, simulate
from views import looking

READOUT, TURN = 0.03, np.radians(60)
WIDE = Camera(320, 240, fx=260, fy=260, cx=160, cy=120)
SIZE = 128


def textured(height=512):
    """Waves down to about 5 degrees from crest to crest."""
    v, u = np.mgrid[:height, : 2 * height]
    polar, azimuth = (v + 0.5) / height * np.pi, ((u + 0.5) / (2 * height) - 0.5) * 2 * np.pi
    d = np.stack([np.sin(polar) * np.sin(azimuth), np.sin(polar) * np.cos(azimuth), np.cos(polar)], axis=-1)
    rng = np.random.default_rng(0)
    waves = rng.normal(size=(40, 3)) * rng.uniform(5, 40, size=(40, 1))
    light = 0.5 + sum(np.sin(d @ w + p) for w, p in zip(waves, rng.uniform(0, 7, 40), strict=True)) * 0.03
    return np.clip(light, 0.1, 1.0)[..., None] * np.array([1.0, 0.9, 0.8])


def towards(azimuth, elevation):
    return np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)


def yaw(time):
    return looking(towards(TURN * time, 0.6), eye=(0.0, 0.0, 0.3))


def pitch(time):
    """Up and down at up to 60 degrees a second, while it turns."""
    return looking(towards(0.5 * time, 0.8 + 0.3 * np.sin(TURN / 0.3 * time)), eye=(0.0, 0.0, 0.3))


def circle(time):
    """Around the board while it looks at the table: place and turn change together."""
    eye = np.array([0.3 * np.cos(TURN * time), 0.3 * np.sin(TURN * time), 0.4])
    return looking(-eye, eye)


def captured(recording, last_row):
    capture, camera = Capture(SIZE, centre=OBJECT), recording.rig.back
    for frame in recording:
        first = recording.truth.pose(frame.time)
        last = recording.truth.pose(frame.time + camera.readout) if last_row else None
        capture.add(frame.back, camera, first, frame.back_exposure, frame.time, last_row=last)
    return capture.environment().radiance.faces, np.isfinite(capture.last_seen)


@pytest.mark.parametrize("path", [yaw, pitch, circle])
def test_the_map_is_as_good_as_without_rolling(path):
    environment, rig = textured(), Rig(WIDE)
    truth = DistantPlace(environment, (0.9, 0.9, 0.9)).truth(OBJECT, SIZE).faces
    common = {"seconds": 1.5, "fps": 10, "board": False, "albedo": (0.9, 0.9, 0.9), "rig": rig, "truth_size": 8}
    films = {
        name: simulate(environment, path=path, readout=r, **common) for name, r in (("still", 0), ("rolling", READOUT))
    }
    side = texel_directions(SIZE)[..., 2] * (-1 if path is circle else 1) > 0.05
    maps = {
        "still": captured(films["still"], False),
        "rolling": captured(films["rolling"], True),
        "ignored": captured(films["rolling"], False),
    }
    seen = side & np.all([seen for _, seen in maps.values()], axis=0)
    errors = {
        name: np.sqrt(((faces - truth)[seen] ** 2).mean()) / truth[seen].mean() for name, (faces, _) in maps.items()
    }
    print(f"{path.__name__}: {seen.sum()} texels, " + ", ".join(f"{k} {v:.4f}" for k, v in errors.items()))
    assert seen.sum() > 8000
    assert errors["rolling"] <= 1.2 * errors["still"]
    assert errors["ignored"] > (1.1 if path is circle else 1.5) * errors["rolling"]  # grain is finer than texels
    # As much is seen.
    assert maps["rolling"][1].sum() > 0.97 * maps["still"][1].sum()


def test_the_same_pose_twice_is_a_global_shutter():
    recording = simulate(textured(64), path=yaw, seconds=0.3, fps=10, board=False, rig=Rig(WIDE), truth_size=8)
    one, two = Capture(32), Capture(32)
    for frame in recording:
        pose = recording.truth.pose(frame.time)
        one.add(frame.back, WIDE, pose, frame.back_exposure, frame.time)
        two.add(frame.back, WIDE, pose, frame.back_exposure, frame.time, last_row=pose)
    np.testing.assert_array_equal(one.environment().radiance.faces, two.environment().radiance.faces)


def test_last_row_must_be_a_pose():
    with pytest.raises((TypeError, ValueError), match="last_row"):
        Capture(8).add(np.zeros((240, 320, 3), np.uint8), WIDE, np.eye(4), last_row=np.ones((2, 2)))
