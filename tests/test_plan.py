"""The plan: what is left out and why, which passes are due, and that nothing is ever old."""

import numpy as np
import pytest
from test_place import ball

import fastibl
from conftest import same_error
from views import camera_of, looking

LIGHT_PASSES = ["track", "capture", "mips", "irradiance", "shadow", "self_shadow"]
PASSES = [*LIGHT_PASSES, "near_light", "bounce", "plane", "holdout", "shade", "composite"]
# Of what is known to hide light, of lights known to be near, and of real objects.
ROUND = {"self_shadow", "near_light", "bounce", "plane", "holdout"}
ABSENT = {"near_light", "holdout"}
CONVEX = [p for p in PASSES if p not in ROUND]
INPUTS = {"back_picture", "light_pictures", "placement", "material"}
MATTE = fastibl.Material()
SHINY = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.9, 0.8, 0.7), exponent=32.0)
BOTH = fastibl.Material(diffuse=(0.5, 0.4, 0.3), glossy=(0.2, 0.2, 0.2))
BLUNT = fastibl.Material(diffuse=(0, 0, 0), glossy=(0.9, 0.8, 0.7), exponent=0.0)
GLOWING = fastibl.Material(diffuse=(0, 0, 0), emission=(1, 0.5, 0.2))


def cube_mesh(half=0.03):
    x = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (0, 2)], float) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return fastibl.Mesh(x, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


def hollow_mesh():
    """Two cubes side by side: each hides the light of the other."""
    one = cube_mesh()
    return fastibl.Mesh(
        np.concatenate([one.vertices, one.vertices + [0.07, 0, 0]]),
        np.concatenate([one.triangles, one.triangles + len(one.vertices)]),
    )


def scene_of(material=MATTE, spheres=8):
    return fastibl.Scene(cube_mesh(), material, spheres=spheres, visibility_rays=0)


@pytest.fixture(scope="module")
def scenes():
    return {
        "matte": scene_of(),
        "shiny": scene_of(SHINY),
        "both": scene_of(BOTH),
        "blunt": scene_of(BLUNT),
        "glowing": scene_of(GLOWING),
        "hollow": fastibl.Scene(hollow_mesh(), BOTH, spheres=8),
        "shiny hollow": fastibl.Scene(hollow_mesh(), SHINY, spheres=8),
        "no spheres": scene_of(spheres=0),
        "shiny, no spheres": scene_of(SHINY, 0),
        "blunt, no spheres": scene_of(BLUNT, 0),
        "glowing, no spheres": scene_of(GLOWING, 0),
    }


def left_out(plan):
    return {p.name: p.reason for p in plan.passes if not p.included}


def test_what_a_scene_does_not_need_is_left_out(scenes, marked):
    def out(name, environment=None, **options):
        plan = fastibl.make_plan(scenes[name], environment, **options)
        assert [p.name for p in plan.passes] == PASSES
        for p in plan.passes:
            unknown = ("not worked out", "asked for", "no spheres", "there is no shadow to go with")
            assert p.included or (p.reason and (p.bound == 0 or any(words in p.reason for words in unknown)))
            assert p.included or p.bound in (0, None)
            assert not (p.included and p.reason)
        assert plan.omission_bound == (None if any(p.bound is None for p in plan.passes) else 0)
        out = left_out(plan)
        assert ("self_shadow" not in out) == (name == "hollow" and "methods" not in options)
        assert ("bounce" not in out) == ("plane" not in out) == (name == "hollow" and "methods" not in options)
        assert out["holdout"] == "no real objects were given"
        return {name: reason for name, reason in out.items() if name not in ROUND}

    assert out("matte") == out("shiny") == out("both") == {}
    assert out("hollow") == out("shiny hollow") == {}
    assert out("matte", track=False) == {"track": "poses are given"}
    given = out("matte", marked)
    assert set(given) == {"capture", "mips"} and "environment is given" in given["capture"]
    assert out("matte", marked, capture=True) == {}
    assert out("matte", cast_shadow=False) == {"shadow": "no shadow was asked for"}
    assert out("no spheres") == {"shadow": "the object has no spheres"}
    # k_L = 0: irradiance is for the shadow alone, and for a lobe of exponent 0.
    assert set(out("shiny, no spheres")) == {"shadow", "irradiance"}
    assert "k_L = 0" in out("shiny", cast_shadow=False)["irradiance"]
    assert set(out("glowing, no spheres")) == {"shadow", "irradiance"}
    assert set(out("blunt, no spheres")) == {"shadow"}
    everything = out("glowing, no spheres", marked, track=False)
    assert set(everything) == {"track", "capture", "mips", "irradiance", "shadow"}


def test_an_object_that_hides_nothing_of_itself_needs_no_self_shadow(scenes):
    def reason(scene, **options):
        return left_out(fastibl.make_plan(scene, **options)).get("self_shadow")

    assert reason(scenes["hollow"]) is None
    assert reason(scenes["hollow"], methods={"self_shadow": "transfer"}) is None
    assert "P_V" in reason(scenes["hollow"], methods="paper")
    assert "P_V" in reason(scenes["hollow"], methods={"self_shadow": "ambient-occlusion"})
    assert "no self-shadow was asked for" in reason(scenes["hollow"], methods={"self_shadow": "none"})
    assert "k_L = 0" in reason(scenes["shiny hollow"])
    assert "not worked out" in reason(scenes["matte"])
    assert "hides nothing of itself" in reason(fastibl.Scene(cube_mesh(), MATTE, spheres=0))


def test_what_nobody_worked_out_is_not_stated_as_nothing(scenes, marked):
    """Without rays the object's own shadow and the bounce are missing, by nobody knows how much."""

    def bounds(scene, **options):
        plan = fastibl.make_plan(scene, marked, **options)
        return {p.name: p.bound for p in plan.passes if not p.included}, plan

    blind = fastibl.Scene(hollow_mesh(), MATTE, spheres=8, visibility_rays=0)
    found, plan = bounds(blind)
    assert found["self_shadow"] is None and found["bounce"] is None and plan.omission_bound is None
    assert "not known by how much: what the object hides was not worked out" in str(plan)
    assert bounds(scenes["hollow"])[1].omission_bound == 0
    glowing = fastibl.Material(diffuse=(0, 0, 0), glossy=(0, 0, 0), emission=(1, 1, 1))
    assert bounds(fastibl.Scene(hollow_mesh(), glowing, spheres=8, visibility_rays=0))[0]["self_shadow"] == 0
    # Nor by how much the paper's picture lacks them, until it is judged for a budget: by the truth that has them.
    found, plan = bounds(scenes["hollow"], methods="paper")
    assert found["self_shadow"] is None and found["bounce"] is None and plan.omission_bound is None
    found, plan = bounds(scenes["hollow"], methods="paper", error=0.02)
    assert found["self_shadow"] > 0.01 and found["bounce"] > 0.01
    full = bounds(scenes["hollow"], methods={"self_shadow": "transfer", "bounce": "one-bounce"}, error=0.02)[1]
    assert plan.expected_error > full.expected_error + 0.01 and full.omission_bound == 0


def test_a_bounce_that_cannot_matter_is_left_out(scenes, marked):
    def line(scene, environment=None, name="bounce", **options):
        plan = fastibl.make_plan(scene, environment, **options)
        return next(p for p in plan.passes if p.name == name)

    hollow = scenes["hollow"]
    assert line(hollow).included and line(hollow, marked, error=0.02).method == "one-bounce"
    assert "no bounce was asked for" in line(hollow, methods="paper").reason
    assert "no bounce was asked for" in line(hollow, methods={"bounce": "none"}).reason
    assert "no shadow" in line(hollow, cast_shadow=False).reason
    assert "not worked out" in line(scenes["matte"]).reason
    mirror = line(scenes["shiny hollow"], marked)
    assert "no diffuse light" in mirror.reason and mirror.bound == 0
    dark = fastibl.Scene(hollow_mesh(), fastibl.Material(diffuse=(0.0001, 0.0001, 0)), spheres=8)
    assert line(dark).included and line(dark, marked).included  # nothing is known of the light, or no error allowed
    assert line(dark, marked, error=0.0005, methods={"bounce": "one-bounce"}).included
    out = line(dark, marked, error=0.02)
    assert "too dark" in out.reason and 0.0001 <= out.bound <= 0.002
    assert "drawn as it is" in line(dark, marked, "plane", error=0.02).reason
    strong = line(dark, marked, error=1.0).bound
    assert strong == pytest.approx(out.bound)


def test_shading_reads_what_its_material_needs(scenes):
    def reads(name):
        return {p.name: p.reads for p in fastibl.make_plan(scenes[name]).passes}["shade"] & {
            "irradiance",
            "radiance",
            "self_shadow",
            "bounce",
        }

    assert reads("matte") == {"irradiance", "self_shadow", "bounce"}
    assert reads("shiny") == {"radiance"}
    assert reads("both") == {"irradiance", "radiance", "self_shadow", "bounce"}
    assert reads("blunt") == {"irradiance", "self_shadow", "bounce"}
    assert reads("glowing") == set()


def test_the_plan_reads_like_a_bill(scenes, marked):
    plan = fastibl.make_plan(scenes["both"], marked, error=0.5, cast_shadow=False)
    text = str(plan)
    print(text)
    for name in PASSES:
        assert any(line.startswith(name) for line in text.splitlines()), name
    assert "no shadow was asked for" in text and "sh9" in text and "mip" in text
    assert "within the error budget of 50 %" in text.replace("NOT within", "")
    assert repr(plan) == text
    # A sun in one texel is more than SH9 can do.
    faces = np.full((6, 32, 32, 3), 0.01)
    faces[4, 3, 3] = 1e4
    tight = fastibl.make_plan(scenes["both"], fastibl.CubeMap(faces), error=0.01, methods={"diffuse": "sh9"})
    assert "NOT within the error budget of 1 %" in str(tight) and tight.expected_error > 0.01
    assert "budget" not in str(fastibl.make_plan(scenes["both"], marked))
    assert fastibl.make_plan(scenes["both"], marked, methods="paper").methods.diffuse == "six-face"
    line = next(p for p in plan.passes if p.name == "irradiance")
    assert line.error == pytest.approx(fastibl.Lighting(marked).methods["diffuse"].error)
    assert repr(line) == "<fastibl.PlannedPass irradiance>"


def test_bad_input_is_refused(scenes, marked):
    def make(**options):
        return lambda: fastibl.make_plan(scenes["matte"], marked, **options)

    same_error(make(error=-0.1), ValueError, "error budget", "-0.1")
    same_error(make(error=float("nan")), ValueError, "error budget", "nan")
    same_error(make(milliseconds=-1), ValueError, "time budget", "-1")
    same_error(make(methods="best"), ValueError, '"auto"', "best")
    same_error(make(methods={"light": "sh9"}), ValueError, "light", "diffuse")
    same_error(make(methods={"diffuse": "sh8"}), ValueError, "sh8", "sh9")
    same_error(make(methods={"normalization": "none"}), ValueError, "none", "energy")
    plan = fastibl.make_plan(scenes["matte"])
    same_error(lambda: fastibl.due_passes(plan, {"picture"}, set()), ValueError, "picture")
    same_error(lambda: fastibl.due_passes(plan, set(), {"light"}), ValueError, "light")


def test_due_passes_of_usual_frames(scenes, marked):
    def due(plan, stale, wanted=("image",)):
        return fastibl.due_passes(plan, set(wanted), set(stale))[0]

    plan = fastibl.make_plan(scenes["both"])
    everything = {"pose", "texels", "radiance", "irradiance", "shadow", "object", "image"}
    assert due(plan, everything | INPUTS) == CONVEX
    assert due(plan, set()) == []
    assert due(plan, {"light_pictures"}) == CONVEX[1:]
    assert due(plan, {"placement"}) == ["shadow", "shade", "composite"]
    assert due(plan, {"material"}) == ["shade", "composite"]
    assert due(plan, {"back_picture"}) == ["track", "shade", "composite"]
    assert due(plan, {"light_pictures"}, wanted=("texels",)) == ["capture"]
    assert due(plan, {"light_pictures"}, wanted=("irradiance",)) == ["capture", "mips", "irradiance"]
    assert due(plan, {"back_picture"}, wanted=("shadow",)) == ["track"]  # pictures of light need a pose
    fixed = fastibl.make_plan(scenes["both"], marked, track=False)
    assert due(fixed, {"back_picture", "pose"}) == ["shade", "composite"]
    assert due(fixed, {"radiance"}) == ["irradiance", "shadow", "shade", "composite"]
    assert due(fixed, {"light_pictures"}) == []
    hollow = fastibl.make_plan(scenes["hollow"])
    assert due(hollow, everything | ROUND | INPUTS) == [p for p in PASSES if p not in ABSENT]
    assert due(hollow, {"placement"}) == [p for p in PASSES[4:] if p not in ABSENT]
    assert due(hollow, {"back_picture"}) == ["track", "shade", "composite"]
    assert due(hollow, {"material"}) == ["bounce", "plane", "shade", "composite"]


def test_a_shadow_switched_off_while_the_light_moved_is_old_when_it_comes_back(scenes):
    on, off = (fastibl.make_plan(scenes["hollow"], cast_shadow=cast) for cast in (True, False))
    _, stale = fastibl.due_passes(on, {"image"}, {"light_pictures"})
    assert stale == ABSENT  # nobody makes it
    due, stale = fastibl.due_passes(off, {"image"}, stale | {"image"})
    assert due == ["composite"]
    due, stale = fastibl.due_passes(off, {"image"}, stale | {"light_pictures"})
    assert "shadow" not in due and stale == {"shadow", "near_light", "bounce", "holdout"}
    assert fastibl.due_passes(off, {"image"}, stale) == ([], stale)  # nothing changed: nothing runs
    back = ["shadow", "bounce", "plane", "shade", "composite"]
    assert fastibl.due_passes(on, {"image"}, stale) == (back, ABSENT)


class Model:
    """Products with the versions of what they were made from, made by due_passes alone."""

    GIVEN = {"track": "pose", "capture": "texels", "mips": "radiance"}  # by their pass, if it is left out

    def __init__(self, plan):
        self.plan, self.version, self.products = plan, dict.fromkeys(INPUTS, 0), {}
        self.given = dict.fromkeys(self.GIVEN.values(), 0)
        self.stale = {"pose", "texels", "radiance", "irradiance", "shadow", *ROUND, "object", "image"}
        self.runs = 0

    def value(self, product, plan=None):
        """What a full recomputation gives, down to the inputs."""
        if product in INPUTS:
            return product, self.version[product]
        line = next(p for p in self.plan.passes if product in p.writes)
        if not line.included:
            return (product, self.given[product]) if line.name in self.GIVEN else (product, "none")
        return product, tuple(self.value(p) for p in sorted(line.reads))

    def held(self, product):
        if product in INPUTS:
            return product, self.version[product]
        line = next(p for p in self.plan.passes if product in p.writes)
        if not line.included:
            return self.value(product)
        return self.products.get(product)

    def step(self, wanted):
        due, self.stale = fastibl.due_passes(self.plan, wanted, self.stale)
        assert due == [p for p in PASSES if p in due]
        for p in self.plan.passes:
            if p.name not in due:
                continue
            (product,) = p.writes
            made = product, tuple(self.held(r) for r in sorted(p.reads))
            assert made != self.products.get(product) or product in self.forced, f"{p.name} ran for nothing"
            self.products[product] = made
            self.forced.discard(product)
            self.runs += 1
        for product in wanted:
            assert self.held(product) == self.value(product), f"{product} is old"


@pytest.mark.parametrize("seed", range(12))
def test_nothing_is_ever_old_nor_made_twice(scenes, marked, seed):
    rng = np.random.default_rng(seed)
    plans = [
        fastibl.make_plan(scenes["hollow"], cast_shadow=cast, track=track, capture=capture)
        for cast in (True, False)
        for track in (True, False)
        for capture in (True, False)
    ] + [fastibl.make_plan(scenes[name], cast_shadow=False) for name in ("shiny", "both", "glowing", "blunt")]
    model = Model(plans[0])
    model.forced = set(model.stale)
    wants = [{"image"}, {"image"}, {"texels"}, {"irradiance"}, {"shadow", "object"}, {"image", "texels"}, set()]
    kept = 0
    for _ in range(150):
        for name in INPUTS:
            if rng.random() < 0.2:
                model.version[name] += 1
                model.stale.add(name)
        for p in model.plan.passes:
            if p.name in model.GIVEN and not p.included and rng.random() < 0.2:
                (product,) = p.writes
                model.given[product] += 1
                model.stale.add(product)
        if seed % 2 and rng.random() < 0.15:  # other needs: what shading and the picture are made of
            before, model.plan = model.plan, plans[rng.integers(len(plans))]
            changed = {"object", "image"}
            for old, new in zip(before.passes, model.plan.passes, strict=True):
                if old.included != new.included and new.name in model.GIVEN:
                    changed |= new.writes
            model.stale |= changed
            # A change of where a product comes from makes everything after it old.
            model.forced |= changed | {"texels", "radiance", "irradiance", "shadow", *ROUND, "object", "image"}
        kept += not model.stale
        model.step(wants[rng.integers(len(wants))])
    print(f"{model.runs} runs of passes in 150 steps; {150 * len(PASSES)} without a plan")
    assert model.runs < 0.7 * 150 * len(PASSES)


def lit_map(seed):
    rng = np.random.default_rng(seed)
    faces = 0.3 + rng.random((6, 8, 8, 3))
    faces[4, rng.integers(8), rng.integers(8)] = 30
    return fastibl.Environment(fastibl.CubeMap(faces))


MATERIALS = [MATTE, SHINY, BOTH, BLUNT, GLOWING]
CHOICES = [
    "auto",
    "paper",
    {"diffuse": "six-face-exact", "shadow": "cap-sum"},
    {"diffuse": "nearest-face"},
    {"normalization": "paper", "self_shadow": "none"},
]


def placed(k):
    return fastibl.Pose.from_rotation_vector(np.array([0.0, 0.0, 0.3 * k]), np.array([0.01 * k, -0.01 * k, 0.0]))


@pytest.mark.parametrize("seed", range(4))
def test_a_session_equals_a_fresh_one_after_any_changes(seed):
    rng = np.random.default_rng(seed)
    camera = camera_of(64, 48, 50.0)
    rig, base = fastibl.Rig(camera), fastibl.Scene(hollow_mesh(), spheres=8)
    environments = [lit_map(k) for k in range(3)]
    back = rng.integers(0, 256, (48, 64, 3), np.uint8)
    state = dict(material=0, place=0, methods=0, cast=True, environment=0)
    session = fastibl.Session(base, rig, environment=environments[0])
    time, skipped, shown_again = 0.0, 0, 0
    for step in range(60):
        for _ in range(rng.integers(1, 4)):
            what = rng.integers(5)
            if what == 0:
                state["material"] = int(rng.integers(len(MATERIALS)))
                session.set_material(MATERIALS[state["material"]])
            elif what == 1:
                state["place"] = int(rng.integers(4))
                session.move(placed(state["place"]))
            elif what == 2:
                state["methods"] = int(rng.integers(len(CHOICES)))
                session.set_methods(CHOICES[state["methods"]])
            elif what == 3:
                state["cast"] = bool(rng.integers(2))
                session.set_cast_shadow(state["cast"])
            else:
                state["environment"] = int(rng.integers(3))
                session.set_environment(environments[state["environment"]])
        if rng.random() < 0.3:  # changes alone, or a frame in which nothing can be seen
            if rng.random() < 0.5:
                time += 0.1
                assert np.array_equal(session.process(fastibl.Frame(time, back=back)).image, back)
            continue
        eye = (0.05 * rng.integers(2), -0.25, 0.2 + 0.1 * rng.integers(2))  # often the one before
        for repeat in range(rng.integers(1, 3)):  # again: what is reused must be the same
            time += 0.1
            pose = looking(np.array([0, 0, 0.03]) - eye, eye)
            frame = fastibl.Frame(time, back=None if step % 7 == 0 else back, back_from_marker=pose, back_exposure=0.4)
            result = session.process(frame)
            skipped += repeat and "shadow" not in result.passes and "irradiance" not in result.passes
            shown_again += result.passes == ["composite"]
        fresh = fastibl.Session(
            base,
            rig,
            environment=environments[state["environment"]],
            methods=CHOICES[state["methods"]],
            cast_shadow=state["cast"],
        )
        fresh.set_material(MATERIALS[state["material"]])
        fresh.move(placed(state["place"]))
        expected = fresh.process(frame)
        np.testing.assert_array_equal(result.image, expected.image, err_msg=str(state))
        assert result.shadow_map == expected.shadow_map, state
        np.testing.assert_array_equal(session.object.rgba, fresh.object.rgba, err_msg=str(state))
        assert str(result.plan) == str(expected.plan)
        assert result.predicted_error == expected.predicted_error, state
    assert skipped > 3
    assert shown_again > 3  # a camera that stays, and light that does: the object is not shaded anew


@pytest.mark.parametrize("seed", range(3))
def test_a_capturing_session_equals_one_that_never_changed(seed):
    """Whatever was switched between the frames: the next picture is that of a session which saw the same frames.

    Without an error budget: with one, what is used stays while other methods are hardly better.
    """
    rng = np.random.default_rng(seed)
    camera = camera_of(64, 48, 50.0)
    rig, base = fastibl.Rig(camera), fastibl.Scene(hollow_mesh(), spheres=8)
    choices = [c for c in CHOICES if c != "paper"]  # it captures other frames
    state = dict(material=0, place=0, methods=0, cast=True)
    session, frames = fastibl.Session(base, rig, size=16, error=None), []
    for step in range(24):
        if rng.random() < 0.4:
            state["material"] = int(rng.integers(len(MATERIALS)))
            session.set_material(MATERIALS[state["material"]])
        if rng.random() < 0.3:
            state["place"] = int(rng.integers(4))
            session.move(placed(state["place"]))
        if rng.random() < 0.3:
            state["methods"] = int(rng.integers(len(choices)))
            session.set_methods(choices[state["methods"]])
        if rng.random() < 0.4:
            state["cast"] = bool(rng.integers(2))
            session.set_cast_shadow(state["cast"])
        eye = (0.1 * rng.random(), -0.25, 0.2)
        pose = looking(np.array([0, 0.1 * rng.random(), 0.03]) - eye, eye)
        back = rng.integers(0, 200, (48, 64, 3), np.uint8)
        kind = rng.integers(4)
        frames.append(
            fastibl.Frame(0.1 * step, back=None if kind == 0 else back, back_from_marker=None if kind == 1 else pose)
        )
        result = session.process(frames[-1])
        if step % 4 != 3:
            continue
        fresh = fastibl.Session(
            base, rig, size=16, error=None, methods=choices[state["methods"]], cast_shadow=state["cast"]
        )
        fresh.set_material(MATERIALS[state["material"]])
        fresh.move(placed(state["place"]))
        for frame in frames:
            expected = fresh.process(frame)
        # The directions of light stay where they were, so those of a session that saw less of the light are others.
        difference = np.abs(result.image.astype(int) - expected.image)
        assert difference.max() <= 4 and (difference > 1).mean() < 0.02, state
        if frames[-1].back_from_marker is not None:
            assert (result.shadow_map.image.shape, result.shadow_map.no_light) == (
                expected.shadow_map.image.shape,
                expected.shadow_map.no_light,
            )
            assert np.abs(result.shadow_map.image - expected.shadow_map.image).max(initial=0) < 0.06, state
            if state["cast"] or MATERIALS[state["material"]] != GLOWING:  # else nothing reads the map
                assert result.environment.radiance == expected.environment.radiance


def test_what_only_glows_needs_no_light():
    """No map is made, and none is missed."""
    session = fastibl.Session(scene_of(GLOWING, 0), fastibl.Rig(camera_of(64, 48, 50.0)), size=16)
    result = session.process(fastibl.Frame(0.0, back_from_marker=looking((0, 1, -0.7), (0.0, -0.25, 0.2))))
    assert result.passes == ["shade", "composite"] and result.environment is None and result.lighting is None
    rgba = session.object.rgba
    np.testing.assert_allclose(rgba[rgba[..., 3] == 1][:, :3].mean(axis=0), GLOWING.emission, rtol=1e-5)
    session.set_material(BOTH)
    later = session.process(fastibl.Frame(0.1, back_from_marker=looking((0, 1, -0.7), (0.0, -0.25, 0.2))))
    assert later.passes == ["mips", "irradiance", "shade", "composite"] and later.environment.coverage == 0


def test_between_given_and_captured_light():
    """Switching to capture and back: the picture is that of a session that never had the other."""
    camera = camera_of(64, 48, 50.0)
    rig, base, given = fastibl.Rig(camera), scene_of(BOTH), lit_map(0)
    back = np.random.default_rng(3).integers(0, 256, (48, 64, 3), np.uint8)
    pose = looking((0, 1, -0.7), (0.0, -0.25, 0.2))
    frames = [fastibl.Frame(0.1 * k, back=back, back_from_marker=pose) for k in range(6)]
    fixed, captured = fastibl.Session(base, rig, environment=given), fastibl.Session(base, rig)
    mixed = fastibl.Session(base, rig)
    for k, frame in enumerate(frames):
        mixed.set_environment(given if k % 2 else None)
        result = mixed.process(frame)
        expected = (fixed if k % 2 else captured).process(frame)
        if k == 0 or k % 2:
            np.testing.assert_array_equal(result.image, expected.image)
            assert result.shadow_map == expected.shadow_map
        assert (result.environment is given) == bool(k % 2) or result.environment.coverage == given.coverage
        assert ("capture" in result.passes) == (k % 2 == 0)


def test_a_plan_with_passes_left_out_gives_the_picture_of_the_full_one():
    """What is left out has a bound of 0 here, so the bytes are equal."""
    camera = camera_of(64, 48, 50.0)
    rig = fastibl.Rig(camera)
    back = np.random.default_rng(3).integers(0, 256, (48, 64, 3), np.uint8)
    pose = looking((0, 1, -0.7), (0.0, -0.25, 0.2))
    nothing = 1e-30  # a share of light that no byte shows, but that needs every pass
    cases = {
        "k_G = 0": (MATTE, fastibl.Material(glossy=(nothing,) * 3)),
        "k_L = 0": (SHINY, fastibl.Material(diffuse=(nothing,) * 3, glossy=SHINY.glossy, exponent=32.0)),
        "both 0": (
            GLOWING,
            fastibl.Material(diffuse=(nothing,) * 3, glossy=(nothing,) * 3, emission=GLOWING.emission),
        ),
    }
    for name, (pruned, full) in cases.items():
        images, plans = [], []
        for material in (pruned, full):
            session = fastibl.Session(scene_of(material, 0), rig, environment=lit_map(1))
            result = session.process(fastibl.Frame(0.0, back=back, back_from_marker=pose, back_exposure=0.4))
            images.append(result.image)
            plans.append(result.plan)
        difference = np.abs(images[0].astype(int) - images[1]).max()
        print(f"{name}: {len(left_out(plans[0]))} passes left out, difference {difference}")
        more = set(left_out(plans[0])) - set(left_out(plans[1]))
        assert difference == 0 and all(p.bound == 0 for p in plans[0].passes if p.name in more)
        assert set(left_out(plans[1])) <= set(left_out(plans[0]))


def test_unchanged_light_and_pose_reuse_shadow_and_object(marked):
    camera = camera_of(64, 48, 50.0)
    session = fastibl.Session(scene_of(BOTH), fastibl.Rig(camera), environment=marked)
    pose, other = (looking((0, 1, -0.7), (x, -0.25, 0.2)) for x in (0.0, 0.01))
    back, poses = np.zeros((48, 64, 3), np.uint8), [pose, pose, other, other, None, other, pose]
    ran = [session.process(fastibl.Frame(0.1 * k, back, back_from_marker=p)).passes for k, p in enumerate(poses)]
    assert ran[0] == ["irradiance", "shadow", "shade", "composite"]
    assert ran[1:] == [["composite"], ["shade", "composite"], ["composite"], [], ["composite"], ["shade", "composite"]]
    session.move(placed(1))
    assert session.process(fastibl.Frame(1.0, back_from_marker=pose)).passes == ["shadow", "shade", "composite"]


def test_samples_of_a_lobe_are_chosen_where_walls_are_near():
    """As where they are far: they see them where they are, so a smaller budget gives no worse a picture."""
    d = fastibl.texel_directions(64).astype(np.float64)
    stripes = 0.5 + 0.45 * np.sin(14 * d[..., :1]) * np.cos(11 * d[..., 1:2]) * np.cos(9 * d[..., 2:])
    cube = fastibl.CubeMap((stripes * [1, 0.9, 0.8]).astype(np.float32))
    scene = fastibl.Scene(ball(), fastibl.Material.pbr((1, 1, 1), 1.0, 0.3))
    rig, pose = fastibl.Rig(camera_of(96, 72, 50.0)), looking((0, 0.25, -0.2), (0, -0.25, 0.25))
    chosen = {}
    for box in (None, [(-1, -1, 0), (1, 1, 2)]):
        light = fastibl.Environment(cube, centre=(0, 0, 0.05), box=box)
        session = fastibl.Session(scene, rig, environment=light, error=0.001, cast_shadow=False)
        result = session.process(fastibl.Frame(0.0, back_from_marker=pose))
        chosen[box is not None] = result.plan.methods.glossy
    print("glossy, with a box or without:", chosen)
    assert chosen[False] == "sampled" == chosen[True]


def test_a_light_is_judged_once_for_all_budgets(monkeypatch):
    """Whatever was planned before, a plan is that of a fresh scene; another budget alone needs no other judgement."""
    judged = []

    def counted(*arguments):
        judged.append(arguments)
        return fastibl._fastibl._judge_light(*arguments)

    monkeypatch.setattr("fastibl.session._judge_light", counted)
    one, other = lit_map(0), lit_map(1).radiance
    camera, pose = camera_of(64, 48, 50.0), looking((0, 1, -0.7), (0.0, -0.25, 0.2))
    baked = fastibl.MeshShadow(hollow_mesh(), progress=False)
    steps = [
        ({}, one, dict(error=0.02), True),
        ({}, one, dict(error=0.02), False),
        ({}, one, dict(error=0.3, track=False), False),
        ({}, one, dict(error=0.02, milliseconds=3), True),
        ({}, one, dict(milliseconds=5, costs={"mip": 20.0}), False),
        ({}, one, {}, True),
        ({}, other, dict(error=0.02), True),
        ({}, other, dict(error=0.1), False),
        ({}, other, dict(error=0.1, methods={"diffuse": "sh9"}), True),
        ({}, other, dict(error=0.1, cast_shadow=False), True),
        ({}, other, dict(error=0.1, capture=True), True),
        ({}, other, dict(error=0.1, offline=True), True),
        ({}, other, dict(error=0.1, camera=camera, camera_from_marker=pose), True),
        ({}, other, dict(error=0.05, camera=camera, camera_from_marker=pose), False),
        (dict(material=SHINY), other, dict(error=0.05), True),
        (dict(shadow_strength=0.5), other, dict(error=0.05), True),
        (dict(shadow_color=(0.2, 0.1, 0.1)), other, dict(error=0.05), True),
        (dict(baked_shadow=baked), other, dict(error=0.05), True),
    ]
    kept, state = fastibl.Scene(hollow_mesh(), BOTH, spheres=8), {}
    for change, light, asked, anew in steps:
        state |= change
        fresh = fastibl.Scene(hollow_mesh(), BOTH, spheres=8)
        for name, value in state.items():
            setattr(fresh, name, value)
        for name, value in change.items():
            setattr(kept, name, value)
        judged.clear()
        plan = fastibl.make_plan(kept, light, **asked)
        assert len(judged) == anew, (change, asked)
        assert str(plan) == str(fastibl.make_plan(fresh, light, **asked)), (change, asked)


def test_a_pose_may_be_a_matrix():
    camera = fastibl.Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
    pose = fastibl.Pose.look_at((0.3, 0.0, 0.3), (0.0, 0.0, 0.0))
    scene = fastibl.Scene(fastibl.shapes.figurine(0.1), spheres=0, visibility_rays=0)
    white = fastibl.CubeMap(np.ones((6, 8, 8, 3)))
    plans = [
        fastibl.make_plan(scene, white, error=0.02, cast_shadow=False, camera=camera, camera_from_marker=given)
        for given in (pose, pose.matrix, pose.matrix)
    ]
    assert plans[0].methods == plans[1].methods == plans[2].methods
    assert plans[0].expected_error == plans[1].expected_error == plans[2].expected_error
