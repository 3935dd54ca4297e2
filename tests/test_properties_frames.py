"""Frames, plans and options of anything: pictures that are finite, or a clear error, after which all goes on."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import fastibl
from fastibl.extremes.views import camera_of, looking
from fastibl.extremes.worlds import ball_mesh
from hostile import MORE, anything, arrays, filled, is_light, is_ratio, numbers, outcome

CAMERA = camera_of(24, 16, 60.0)
EYE = (0.0, -0.25, 0.12)
POSE = looking((0.0, 0.25, -0.06), EYE)
SCENE = fastibl.Scene(ball_mesh(steps=5), fastibl.Material(glossy=(0.2, 0.2, 0.2)), spheres=2, visibility_rays=0)
LIGHT = fastibl.CubeMap(np.random.default_rng(0).random((6, 4, 4, 3)))

steps = st.sampled_from(
    ["tracking", "capture", "diffuse", "glossy", "shadow", "self_shadow", "bounce", "normalization"]
)
names = st.sampled_from(sorted({m.name for s in ("diffuse", "glossy", "shadow", "bounce") for m in fastibl.methods(s)}))
methods = st.one_of(
    st.sampled_from(["auto", "paper", "magic"]),
    st.dictionaries(steps, st.one_of(names, st.just("auto")), max_size=3),
    st.dictionaries(st.text(max_size=5), anything, max_size=2),
)
budgets = st.one_of(st.none(), numbers)


@MORE
@given(methods, budgets, budgets, st.booleans(), st.booleans(), st.booleans(), st.sampled_from([None, LIGHT]))
def test_plans(methods, error, milliseconds, track, capture, cast_shadow, light):
    plan = outcome(
        lambda: fastibl.make_plan(
            SCENE,
            light,
            error=error,
            milliseconds=milliseconds,
            methods=methods,
            track=track,
            capture=capture,
            cast_shadow=cast_shadow,
        )
    )
    if plan is None:
        return
    assert str(plan) and all(p.included or p.reason for p in plan.passes)
    assert plan.expected_error >= 0 and (plan.omission_bound is None or plan.omission_bound >= 0)


@MORE
@given(
    st.sets(st.sampled_from(["image", "object", "shadow", "radiance", "pose", "magic", ""])),
    st.sets(st.text(max_size=9)),
)
def test_due_passes(wanted, stale):
    plan = fastibl.make_plan(SCENE)
    outcome(lambda: fastibl.due_passes(plan, wanted, stale))


pictures = st.one_of(st.none(), filled((16, 24, 3), np.uint8, st.integers(0, 255)), arrays((16, 24, 3)))
poses = st.one_of(st.just(POSE), st.just(POSE), st.none(), arrays((4, 4)))
frames = st.tuples(st.one_of(st.floats(0, 1), numbers), pictures, budgets, poses)


@MORE
@given(st.lists(frames, min_size=1, max_size=4), methods, st.booleans())
def test_sessions(given_frames, methods, fixed):
    if isinstance(methods, dict):
        methods.setdefault("shadow", "directions")
    session = outcome(
        lambda: fastibl.Session(
            SCENE, fastibl.Rig(CAMERA), environment=LIGHT if fixed else None, methods=methods, size=8
        )
    )
    if session is None:
        return
    for time, picture, exposure, pose in given_frames:
        result = outcome(
            lambda t=time, p=picture, e=exposure, q=pose: session.process(
                fastibl.Frame(t, back=p, back_exposure=e, back_from_marker=q)
            )
        )
        if result is None:
            continue
        assert result.image.shape[:2] == (16, 24)
        is_light(session.object.rgba)
        is_ratio(session.shadow_map.image)
        if result.environment is not None:
            is_light(result.environment.radiance.faces, 1.01e9)
    after = fastibl.Frame(1e30, back=np.zeros((16, 24, 3), np.uint8), back_from_marker=POSE)
    assert session.process(after).image.shape == (16, 24, 3)


@MORE
@given(
    st.lists(st.tuples(pictures, budgets, st.floats(0, 3), poses), min_size=1, max_size=4), numbers, numbers, numbers
)
def test_captures(shots, distance, albedo, height):
    capture = outcome(lambda: fastibl.Capture(8, centre=(0, 0, height), distance=distance, paper_albedo=albedo))
    capture = capture or fastibl.Capture(8)
    time = 0.0
    for picture, exposure, later, pose in shots:
        time += later
        if picture is not None:
            outcome(lambda p=picture, q=pose, e=exposure, t=time: capture.add(p, CAMERA, q, e, t))
    environment = capture.environment()
    is_light(environment.radiance.faces, 1.01e9)
    is_ratio(environment.confidence)
    low, high = environment.predicted_interval
    assert 0 <= low <= high < np.inf and 0 <= environment.predicted_error < np.inf
    exposure = outcome(lambda: capture.next_exposure(CAMERA, POSE, abs(distance), abs(albedo)))
    assert exposure is None or abs(distance) <= exposure <= abs(albedo)


BOARD = fastibl.Board.grid(2, 2, 0.04, 0.01)


@MORE
@given(
    st.lists(st.tuples(pictures, st.one_of(st.none(), numbers)), min_size=1, max_size=3),
    st.sampled_from(["edges", "board"]),
)
def test_trackers(shots, method):
    tracker = fastibl.Tracker(BOARD, CAMERA, method)
    for picture, time in shots:
        tracked = outcome(lambda p=picture, t=time: tracker.track(p, t))
        if tracked is not None:
            assert np.isfinite(tracked.camera_from_marker.matrix).all() and np.isfinite(tracked.covariance).all()


@MORE
@given(
    st.lists(st.tuples(st.one_of(st.integers(0, 600), anything), arrays((4, 2))), max_size=3),
    numbers,
    numbers,
    anything,
)
def test_boards(tags, width, height, border):
    board = outcome(lambda: fastibl.Board(tags, width, height, border))
    if board is not None and max(board.width, board.height) < 1:
        assert outcome(lambda: board.image(20)) is not None
