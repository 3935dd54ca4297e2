"""What changes while a session runs: another object, other budgets."""

import numpy as np
import pytest
from test_session import RIG, WHITE, ball, given

import fastibl
from views import camera_of


def lit_from_above():
    faces = np.full((6, 16, 16, 3), 0.2, np.float32)
    faces[4, 6:10, 6:10] = 40.0
    return fastibl.CubeMap(faces)


@pytest.mark.parametrize("backend", ["cpu", "gl"])
def test_another_object_is_drawn_as_in_a_session_of_its_own(backend):
    if backend == "gl" and not fastibl.session.with_gl:
        pytest.skip("built without the GL back end")
    options = {"environment": lit_from_above(), "backend": backend}
    try:
        session = fastibl.Session(ball(), RIG, **options)
    except RuntimeError as error:
        pytest.skip(f"no GL context: {error}")
    session.process(given())
    other = fastibl.Material(diffuse=(0.5, 0.1, 0.1))
    session.set_scene(ball(other, radius=0.02))
    changed = session.process(given(1.0))
    own = fastibl.Session(ball(other, radius=0.02), RIG, **options).process(given(1.0))
    first = fastibl.Session(ball(), RIG, **options).process(given(1.0))
    assert np.array_equal(changed.image, own.image) and not np.array_equal(changed.image, first.image)
    assert changed.shadow_map == own.shadow_map


def test_budgets_change_the_plan():
    session = fastibl.Session(ball(), RIG, environment=WHITE, error=0.02)
    assert session.process(given()).plan.error_budget == 0.02
    session.set_budgets(0.1, 5)
    plan = session.process(given(1.0)).plan
    assert (plan.error_budget, plan.milliseconds_budget) == (0.1, 5)
    session.set_budgets()
    assert session.process(given(2.0)).plan.error_budget == 0
    for wrong in ((-0.1, 0), (0, -1), (float("nan"), 0), (0, float("inf"))):
        with pytest.raises(ValueError, match="budget"):
            session.set_budgets(*wrong)


def test_light_that_is_given_frame_after_frame_moves():
    """What is seen of it fades, as of captured light; light that is given once is shown as it is at once."""

    def lit(face: int, height: float, beside: float = 0.2) -> fastibl.CubeMap:
        faces = np.full((6, 16, 16, 3), 0.2, np.float32)
        faces[face, 6:10, 6:10] = height
        faces[face, 2:4, 2:4] = beside
        return fastibl.CubeMap(faces)

    def session(cube: fastibl.CubeMap) -> fastibl.Session:
        return fastibl.Session(ball(), RIG, environment=cube, methods={"shadow": "directions"}, error=0.02)

    stream, maps = session(WHITE), [lit(4, 40, 2.0 * k) for k in range(8)]
    steps = []
    for cube in maps:
        stream.set_environment(cube)
        steps.append(stream.process(given()).shadow_map.image.copy())
    off = np.abs(steps[-1] - session(maps[-1]).process(given()).shadow_map.image).max()
    step = np.abs(steps[-1] - steps[-2]).max()
    print(f"off by {off:.4f}, last step {step:.4f}")
    assert 0 < off < 0.04 and step < 0.02  # its directions stay
    place = lit(1, 4000.0)
    stream.set_environment(place)
    assert stream.process(given()).shadow_map == session(place).process(given()).shadow_map


def test_the_same_light_given_again_changes_nothing():
    place = lit_from_above()
    given_again = fastibl.Session(ball(), RIG, environment=place)
    first = given_again.process(given())
    for k in range(8):
        given_again.set_environment(fastibl.CubeMap(place.faces))
        result = given_again.process(given(1.0 + k))
    assert np.array_equal(result.image, first.image) and str(result.plan.methods) == str(first.plan.methods)


def test_light_that_has_come_to_rest_is_light_that_stays():
    """After 30 frames without new light, methods are those of light that was never anything else."""
    stream, rng = fastibl.Session(ball(), RIG, environment=lit_from_above(), error=0.05), np.random.default_rng(0)
    for k in range(6):
        last = fastibl.CubeMap(lit_from_above().faces * (1 + 0.01 * rng.random()))
        stream.set_environment(last)
        stream.process(given(float(k)))
    for k in range(80):
        result = stream.process(given(10.0 + k))
    fresh = fastibl.Session(ball(), RIG, environment=last, error=0.05).process(given())
    assert str(result.plan.methods) == str(fresh.plan.methods)


@pytest.mark.parametrize("change", ["methods", "cast_shadow"])
def test_a_shadow_that_is_asked_for_later_is_baked_then(change):
    if change == "methods":
        session = fastibl.Session(ball(), RIG, environment=lit_from_above(), methods={"shadow": "directions"})
    else:
        session = fastibl.Session(ball(), RIG, environment=lit_from_above(), cast_shadow=False)
    session.process(given())
    if change == "methods":
        session.set_methods({"shadow": "mesh"})
    else:
        session.set_cast_shadow(True)
    changed = session.process(given(1.0))
    own = fastibl.Session(ball(), RIG, environment=lit_from_above(), methods={"shadow": "mesh"}).process(given(1.0))
    assert "mesh" in str(changed.plan) and changed.shadow_map == own.shadow_map
    assert changed.shadow_map.image.min() < 0.9


def test_no_shadow_is_baked_for_a_session_without():
    scene = ball()
    session = fastibl.Session(scene, RIG, environment=WHITE, cast_shadow=False)
    session.set_methods("auto")
    assert scene.baked_shadow is None
    for spheres in (0, 10):  # the constructor and set_scene agree
        other, first = ball(spheres=spheres), ball(spheres=spheres)
        session = fastibl.Session(first, RIG, environment=WHITE)
        session.set_scene(other)
        assert (other.baked_shadow is None) == (first.baked_shadow is None) == (spheres == 0)


def test_a_shadow_that_another_session_baked_is_cast_too():
    scene = ball()
    session = fastibl.Session(scene, RIG, environment=lit_from_above(), cast_shadow=False)
    session.process(given())
    other = fastibl.Session(scene, RIG, environment=lit_from_above()).process(given())
    session.set_cast_shadow(True)
    assert session.process(given(1.0)).shadow_map == other.shadow_map


def test_light_that_pauses_goes_on_as_light_that_moves():
    """The same map twice in a stream is no new place, for which all would be judged anew."""
    stream, rng, plans = fastibl.Session(ball(), RIG, environment=lit_from_above()), np.random.default_rng(0), []
    for k in range(12):
        cube = fastibl.CubeMap(lit_from_above().faces * (1 + 0.01 * rng.random()))
        for j in range(2):
            stream.set_environment(fastibl.CubeMap(cube.faces))
            plans.append(str(stream.process(given(k + 0.5 * j)).plan.methods))
    assert len(set(plans[10:])) == 1


def test_a_bake_that_is_interrupted_leaves_the_session_as_it_was(monkeypatch):
    session = fastibl.Session(ball(), RIG, environment=lit_from_above(), methods={"shadow": "directions"})
    before = session.process(given())

    def interrupted(*_):
        raise KeyboardInterrupt

    for change in (lambda: session.set_methods({"shadow": "mesh"}), lambda: session.set_cast_shadow(True)):
        with monkeypatch.context() as patch:
            patch.setattr(fastibl.session, "bake_shadow", interrupted)
            with pytest.raises(KeyboardInterrupt):
                change()
        assert np.array_equal(session.process(given()).image, before.image)


@pytest.mark.parametrize(
    "change", [lambda s, scene: s.move(scene.marker_from_object), lambda s, scene: s.set_scene(scene)]
)
def test_an_object_that_was_moved_is_drawn_with_the_pose_of_its_own_row(change):
    """Of a rolling shutter, whose rows have different poses."""
    camera = camera_of(192, 144, 50.0).replace(readout=0.03)
    first, last = (fastibl.Pose.look_at((x, -0.02, 0.5), (x, 0.0, 0.0)) for x in (0.0, 0.02))
    frame = fastibl.Frame(1.0, np.full((144, 192, 3), 150, np.uint8), back_from_marker=first, back_last_row=last)
    for y in (0.1, -0.1):
        place = fastibl.Pose.from_rotation_vector((0, 0, 0), (0, y, 0))
        moved = fastibl.Scene(ball(radius=0.02).mesh, spheres=10, visibility_rays=0, marker_from_object=place)
        own = fastibl.Session(moved, fastibl.Rig(camera), environment=lit_from_above(), error=None).process(frame)
        session = fastibl.Session(ball(radius=0.02), fastibl.Rig(camera), environment=lit_from_above(), error=None)
        session.process(frame)
        change(session, moved)
        assert np.array_equal(session.process(frame).image, own.image)


@pytest.mark.parametrize("error", [0.02, 0.1])
def test_the_same_material_again_changes_nothing(error):
    """Nor does where the object was placed when its form factors were found."""
    mesh = fastibl.shapes.figurine(0.06)
    tilted = fastibl.Pose.from_rotation_vector((0.3, 0.2, 0.0), (0.01, 0.0, 0.02))
    faces = np.random.default_rng(2).uniform(0, 1, (6, 16, 16, 3)).astype(np.float32) ** 4
    for material in (fastibl.Material((0.8, 0.7, 0.6)), fastibl.Material((0.5, 0.5, 0.5), (0.2, 0.2, 0.2), 32)):
        scene = fastibl.Scene(mesh, material, spheres=12)
        session = fastibl.Session(scene, RIG, environment=fastibl.CubeMap(faces), error=error)
        session.move(tilted)
        results = [session.process(given(0.0))]
        for k in (1, 2):
            session.set_material(material)
            results.append(session.process(given(float(k))))
        assert len({str(r.plan.methods) for r in results}) == 1
        assert all(np.array_equal(r.image, results[0].image) for r in results)


@pytest.mark.parametrize("methods", ["auto", "paper"])
def test_pictures_that_are_added_to_the_capture_are_seen(methods):
    wide = camera_of(96, 72, 94.0)
    session = fastibl.Session(ball(), fastibl.Rig(wide), size=16, distance=np.inf, methods=methods, error=None)
    picture = np.full((72, 96, 3), 120, np.uint8)
    session.process(given(0.0, back=picture, back_exposure=1.0))
    for k in range(8):
        a = np.pi * k / 4
        pose = fastibl.Pose.look_at((0, 0, 0.2), (np.cos(a), np.sin(a), 0.5))
        session.capture.add(picture, wide, pose, exposure=1.0, time=0.1)
    result = session.process(given(1.0, back=None))
    assert result.environment.coverage == session.capture.environment().coverage > 0.4
    assert "mips" not in session.process(given(2.0, back=None)).passes, "once"
