"""Faults of cameras: each comes out as it is meant, and a session outlives all of them."""

from dataclasses import replace

import numpy as np
import pytest

import fastibl
from fastibl import Frame, Recording
from fastibl.comparison import irradiance_error
from fastibl.faults import KINDS, Faulty
from fastibl.live import play

CAMERA = fastibl.Camera(64, 48, 50, 50, 32, 24)
RIG = fastibl.Rig(CAMERA, CAMERA, fastibl.Pose.from_rotation_vector([0, np.pi, 0], [0, 0, 0]))


def noise(k):
    return np.random.default_rng(k).integers(1, 255, (48, 64, 3), np.uint8)


def film(count=400):
    return Recording(RIG, [Frame(k / 30, noise(2 * k), noise(2 * k + 1), 0.5, 0.25) for k in range(count)])


@pytest.mark.parametrize("kind", KINDS)
def test_each_fault_is_what_it_says(kind):
    given = list(film())
    source = Faulty(Recording(RIG, given), seed=3, kinds={kind: 0.1})
    times, spoiled, last = {f.time: f for f in given}, 0, None
    before = {}  # shown last, by camera
    for frame in source:
        if kind == "time":
            spoiled += frame.time == last
            last = frame.time
            continue
        true = times[frame.time]
        for name in ("back", "front"):
            shown, sound = getattr(frame, name), getattr(true, name)
            last, before[name] = before.get(name), shown
            tag, true_tag = getattr(frame, f"{name}_exposure"), getattr(true, f"{name}_exposure")
            if source.happened.get(name) != kind:
                assert shown is sound and tag == true_tag
                continue
            spoiled += 1
            assert (tag != true_tag) == (kind == "exposure")
            if kind in ("dropped", "unplugged"):
                assert shown is None
            elif kind == "black":
                assert not shown.any()
            elif kind == "frozen":
                assert shown is last
            elif kind == "torn":
                assert np.array_equal(shown[0], sound[0]) and np.array_equal(shown[-1], last[-1])
            elif kind == "resized":
                assert shown.shape == (24, 32, 3)
            elif kind == "mirrored":
                assert np.array_equal(shown[:, ::-1], sound)
            elif kind in ("white balance", "zoom"):
                assert shown.shape == sound.shape and not np.array_equal(shown, sound)
    print(f"{kind}: {spoiled} pictures of {2 * len(given)}; {source.counts[kind]} counted")
    assert spoiled >= 20 and source.counts[kind] >= spoiled


def test_the_seed_decides():
    a, b, c = (list(Faulty(film(100), seed, 0.3)) for seed in (1, 1, 2))
    assert a == b and a != c
    assert list(Faulty(film(20), 1, 0.0)) == list(film(20))


def test_an_exposure_that_no_camera_told_stays_unknown():
    given = [fastibl.Frame(k / 30, np.zeros((48, 64, 3), np.uint8), back_exposure=None) for k in range(20)]
    source = Faulty(Recording(RIG, given), 0, {"exposure": 0.9})
    assert all(f.back_exposure is None and not source.happened for f in source)
    assert source.counts["exposure"] == 0  # nothing happened


def test_what_cannot_be_repeated_does_not_happen():
    source = Faulty(film(30), 0, {"time": 1.0})
    happened = [dict(source.happened) for _ in source]
    assert happened[0] == {} and all(happened[1:])
    assert sum(Faulty(film(1), kinds=1.0)._kinds.values()) == pytest.approx(1)


def test_wrong_faults():
    with pytest.raises(ValueError, match="'fire'"):
        Faulty(film(1), kinds={"fire": 0.1})
    with pytest.raises(ValueError, match="at most 1"):
        Faulty(film(1), kinds={"black": 0.6, "torn": 0.6})


def test_what_cannot_be_used_is_named_and_passed_over():
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, RIG, environment=fastibl.CubeMap(np.ones((6, 8, 8, 3))), cast_shadow=False)
    pose = fastibl.Pose(np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.5], [0, 0, 0, 1.0]]))

    def frame(time, **others):
        return Frame(time, **{"back": noise(int(100 * time)), "back_from_marker": pose, **others})

    same = noise(77)
    frames = [
        frame(0.0),
        frame(0.1, back=noise(1)[::2]),
        frame(0.2, back_exposure=-1.0),
        frame(0.3, back=same),
        frame(0.4, back=same.copy()),
        frame(0.1),
        frame(0.4, front=noise(3)),
        frame(0.5, back=noise(2)[::2], front=noise(4)),
        frame(0.6, back="no picture"),
        frame(0.7, back=noise(9).astype(np.int32)),
    ]
    played = list(play(session, Recording(RIG, frames)))
    assert [p.result is not None for p in played] == [True, False, False, True, False, False, True, True, False, False]
    words = {1: "(48, 64, 3)", 2: "positive", 4: "froze", 7: "(24, 64, 3)", 8: "str"}
    for k, word in words.items():
        assert word in played[k].refused["back"], played[k].refused
    assert "backwards" in played[5].refused["frame"] and "int32" in played[9].refused["frame"]
    assert played[7].frame.back is None and played[7].frame.front is not None


@pytest.mark.parametrize("code", [0, 255])
def test_a_covered_camera_did_not_freeze(code):
    """Black and white pictures repeat themselves: they are what the room looks like now."""
    film = fastibl.simulate(seconds=3, fps=10, size=(160, 120), path="sweep", hand=False, lamp=False, seed=1)
    dark = [replace(f, front=np.full_like(f.front, code)) if f.time > 1.5 else f for f in film]
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=0, visibility_rays=0)
    lit = []
    for frames in (list(film), dark):
        session = fastibl.Session(scene, film.rig, film.board, cast_shadow=False, methods={"self_shadow": "none"})
        played = list(play(session, Recording(film.rig, frames)))
        assert not any(p.refused for p in played)
        lit.append(played[-1].result.environment.radiance.faces.mean())
    print(f"light: {lit[0]:.2f}, with pictures of {code} {lit[1]:.2f}")
    assert lit[1] < 0.7 * lit[0] if code == 0 else lit[1] > 1.5 * lit[0]


def test_a_source_that_uses_its_memory_again_did_not_freeze():
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, RIG, environment=fastibl.CubeMap(np.ones((6, 8, 8, 3))), cast_shadow=False)
    pose = fastibl.Pose(np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.5], [0, 0, 0, 1.0]]))
    buffer = noise(0).copy()

    def frames():
        for k in (0, 1, 2, 2, 3):
            buffer[:] = noise(k)
            yield Frame(k / 10, buffer, back_from_marker=pose)

    class Source:
        rig, board = RIG, None

        def __iter__(self):
            return frames()

    assert ["back" in p.refused for p in play(session, Source())] == [False, False, False, True, False]


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_white_balance_jumps_in_pictures_of_any_kind(dtype):
    white = 65535 if dtype == np.uint16 else 1.0
    frames = [Frame(k / 10, (white * np.full((48, 64, 3), 0.4)).astype(dtype)) for k in range(40)]
    changed = list(Faulty(Recording(RIG, frames), seed=1, kinds={"white balance": 1}))
    ratios = [f.back.mean(axis=(0, 1)) / (0.4 * white) for f in changed]
    assert all(f.back.dtype == dtype for f in changed) and np.ptp(ratios) > 0.2


def test_a_clock_that_was_set_back():
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, RIG, environment=fastibl.CubeMap(np.ones((6, 8, 8, 3))), cast_shadow=False)
    pose = fastibl.Pose(np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.5], [0, 0, 0, 1.0]]))
    frames = [Frame(t, noise(k), back_from_marker=pose) for k, t in enumerate((7200.0, 7200.1, 3600.0, 3600.1, 3599.9))]
    played = list(play(session, Recording(RIG, frames)))
    assert [p.result is not None for p in played] == [True, True, True, True, False]
    assert "3.6e+03 s" in played[2].refused["time"] and "backwards" in played[4].refused["frame"]


def test_a_session_outlives_everything():
    sound = fastibl.simulate(seconds=3, fps=10, size=(320, 240), path="sweep", hand=False, lamp=False, seed=1)
    frames, true = list(sound), sound.truth.environment(0.0)
    laps = [replace(f, time=f.time + 3 * lap) for lap in range(7) for f in frames]
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=0, visibility_rays=0)
    session = fastibl.Session(scene, sound.rig, sound.board, cast_shadow=False, methods={"self_shadow": "none"})

    def error(part):
        return irradiance_error([p for p in part if p.result is not None][-1].result.environment, true)

    def run(part):
        return Recording(sound.rig, part, sound.board)

    before = error(list(play(session, run(laps[:60]))))
    source = Faulty(run(laps[60:150]), seed=5, kinds=0.3)
    poses, played = 0, []
    for p in play(session, source):
        played.append(p)
        pose = p.result.back_from_marker if p.result is not None else None
        if source.happened.get("back") in ("dropped", "unplugged", "black", "frozen", "mirrored", "resized"):
            assert pose is None, source.happened
        poses += pose is not None
        if p.result is not None:
            assert np.isfinite(p.result.environment.radiance.faces).all()
    during = error(played)
    after = error(list(play(session, run(laps[150:]))))
    print(f"{poses} poses; irradiance error {before:.4f}, at the end of the faults {during:.4f}, after {after:.4f}")
    assert poses > 20 and after < before + 0.01
