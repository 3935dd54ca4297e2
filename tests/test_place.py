"""The object in its place: one bounce to and from the plane, the look of the shadow, real objects as holdouts."""

import itertools

import numpy as np
import pytest
from test_gl import look_at, marked_map, needs_gl, torus

import fastibl
from conftest import same_error
from fastibl import reference
from fastibl.truth import TrueRenderer
from fastibl.viewpoint import looking
from views import camera_of

BACKENDS = ["cpu", pytest.param("gl", marks=needs_gl)]
CAMERA = camera_of(160, 120, 40.0)
VIEW = fastibl.Pose(look_at((0.12, -0.3, 0.2)))
GREY = np.full((120, 160, 3), 120, np.uint8)
EXPOSURE = 0.3


def ball(radius=0.03, height=0.031, around=32, centre=(0.0, 0.0)):
    u = np.arange(around) * 2 * np.pi / around
    v = (np.arange(around // 2 + 1)) * np.pi / (around // 2)
    x = np.stack(
        [np.outer(np.sin(v), np.cos(u)), np.outer(np.sin(v), np.sin(u)), np.outer(np.cos(v), np.ones(around))], -1
    )
    i, j = (k.ravel() for k in np.meshgrid(np.arange(around // 2), np.arange(around), indexing="ij"))
    a, b = i * around + j, i * around + (j + 1) % around
    triangles = np.concatenate([np.stack([a, a + around, b], -1), np.stack([b, a + around, b + around], -1)])
    return fastibl.Mesh(x.reshape(-1, 3) * radius + [*centre, height], triangles)


def scene_of(mesh=None, material=None, **options):
    return fastibl.Scene(mesh or torus(), material or fastibl.Material(diffuse=(0.8, 0.5, 0.2)), spheres=20, **options)


def session_of(scene, source, backend="cpu", methods=None, **options):
    return fastibl.Session(
        scene, fastibl.Rig(CAMERA), environment=source, backend=backend, methods=methods or "auto", **options
    )


def shown(session, time=0.0, back=GREY, exposure=EXPOSURE, pose=VIEW):
    return session.process(fastibl.Frame(time, back=back, back_exposure=exposure, back_from_marker=pose))


def uniform(radiance=1.0):
    return fastibl.CubeMap(np.full((6, 32, 32, 3), radiance, np.float32))


# --- one bounce


@pytest.mark.parametrize("light", ["marked", "uniform"])
def test_the_bounce_against_brute_force(light):
    source = marked_map() if light == "marked" else uniform()
    scene = scene_of()
    true = TrueRenderer(scene, extent=0.15)
    session = session_of(scene, source)
    shown(session)
    points, outside = true.plane_points, true.outside_footprint
    added = session.plane_gain.sample(points) - session.shadow_map.sample(points)
    true_added = true.plane_gain(source) - true.plane_ratio(source)
    off = np.sqrt(((added - true_added)[outside] ** 2).mean())
    size = np.sqrt((true_added[outside] ** 2).mean())
    print(f"{light}: light from the object to the plane off by {off:.4f} RMS, {off / size:.1%} of {size:.4f}")
    assert size > 0.003 and off < 0.1 * size
    # What the vertices lose, in the picture: much nearer to the truth that has it.
    ours, without = (shown(session_of(scene, source, methods=m)).image for m in ("auto", {"bounce": "none"}))
    truth = true.render(GREY, EXPOSURE, CAMERA, VIEW, source).image.astype(int)
    errors = [np.sqrt(((image - truth)[truth.max(axis=-1) != 120] ** 2).mean()) for image in (ours, without)]
    print(f"{light}: picture off by {errors[0]:.2f} codes with the bounce, {errors[1]:.2f} without")
    assert errors[0] < 0.75 * errors[1]


def test_a_white_ball_near_the_plane_under_a_uniform_sky():
    """Under the ball the plane is dark and the ball's underside with it; beside a glowing ball the plane is brighter
    than without: the gain exceeds 1 and the ratio does not."""
    mesh = ball(around=64)
    below = np.array([[0.0, 0.0]])
    glow = session_of(scene_of(mesh, fastibl.Material(diffuse=(0, 0, 0), emission=(5, 5, 5))), uniform())
    shown(glow)
    gain, ratio = glow.plane_gain, glow.shadow_map
    # A sphere of radiance L, radius r, centred h above: form factor of its disc, r^2/h^2 at the point below.
    expected = 5 * (0.03 / 0.031) ** 2
    print(f"below a glowing ball: gain {gain.sample(below)[0, 0]:.3f}, expected about {expected:.3f}")
    assert gain.sample(below)[0, 0] == pytest.approx(expected, rel=0.1)
    assert gain.image.max() > 1 and ratio.image.max() <= 1 and ratio.image.min() >= 0
    far = np.array([[0.08, 0.0]])
    d2 = 0.08**2 + 0.031**2
    expected = 5 * 0.03**2 * 0.031 / d2**1.5  # a sphere wholly above the horizon: (r/d)^2 cos
    added = (gain.sample(far) - ratio.sample(far))[0, 0]
    print(f"5 cm beside it: {added:.4f}, expected {expected:.4f}")
    assert added == pytest.approx(expected, rel=0.05)
    # Beyond the cells, at 9 cm, it goes on without a step.
    away = np.stack([np.arange(0.08, 0.185, 0.0025), np.zeros(42)], -1)
    d2 = away[:, 0] ** 2 + 0.031**2
    expected = 5 * 0.03**2 * 0.031 / d2**1.5
    added = (gain.sample(away.astype(np.float32)) - ratio.sample(away.astype(np.float32)))[:, 0]
    off = added / expected - 1
    print(f"8 to 18 cm beside it: off by {np.abs(off).max():.1%}; largest step {-np.diff(added).min():.4f}")
    assert np.abs(off).max() < 0.12 and (np.diff(added) <= 1e-6).all()
    # Nothing glows and nothing reflects: no bounce, and the gain is the ratio.
    black = session_of(scene_of(mesh, fastibl.Material(diffuse=(0, 0, 0), glossy=(0.5, 0.5, 0.5))), uniform())
    assert "bounce" not in shown(black).passes
    assert black.plane_gain == black.shadow_map


def test_no_vertex_sends_the_plane_less_than_nothing():
    """Near the contact the plane loses more, by its coarse cells, than a vertex there has."""
    scene = scene_of(ball(0.03, 0.0301), fastibl.Material(diffuse=(0.9, 0.9, 0.9)))
    methods = {"diffuse": "sh9", "shadow": "directions", "self_shadow": "transfer", "bounce": "one-bounce"}
    session = session_of(scene, marked_map(), methods=methods, error=0)
    assert "bounce" in shown(session).passes
    added = session.plane_gain.image - session.shadow_map.image
    print(f"the bounce adds {added.min():.4f} to {added.max():.4f}")
    assert added.min() >= 0


def test_the_underside_darkens_towards_contact():
    source = uniform()
    scene = scene_of(ball(), fastibl.Material(diffuse=(0.8, 0.8, 0.8)))
    view = fastibl.Pose(look_at((0.0, -0.3, 0.03), (0, 0, 0.03)))
    dark = {}
    for bounce in ("none", "one-bounce"):
        session = session_of(scene, source, methods={"bounce": bounce})
        shown(session, pose=view)
        layer = session.object
        full = layer.rgba[..., 3] == 1
        column = layer.rgba[:, layer.rgba.shape[1] // 2, 0][full[:, layer.rgba.shape[1] // 2]]
        dark[bounce] = column
    assert np.ptp(dark["none"]) < 0.02  # a uniform world, above and below
    lit = dark["one-bounce"]
    print(f"bottom {lit[-1]:.3f}, top {lit[0]:.3f} of {dark['none'][0]:.3f}")
    assert lit[-1] < 0.4 * lit[0] and lit[0] == pytest.approx(dark["none"][0], rel=0.02)
    assert (np.diff(lit) < 0.01).all()  # ever darker downwards


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_bounce_runs_when_light_place_or_material_change_and_not_else(backend):
    session = session_of(scene_of(), marked_map(), backend)
    assert {"bounce", "plane"} <= set(shown(session).passes)
    assert not {"bounce", "plane"} & set(shown(session, 0.1, pose=fastibl.Pose(look_at((0.2, -0.2, 0.2)))).passes)
    session.set_material(fastibl.Material(diffuse=(0.1, 0.5, 0.9)))
    assert {"bounce", "plane"} <= set(shown(session, 0.2).passes)
    session.move(fastibl.Pose.from_rotation_vector(np.array([0, 0, 0.5]), np.array([0.02, 0.01, 0.0])))
    assert {"bounce", "plane"} <= set(shown(session, 0.3).passes)
    session.set_environment(fastibl.Environment(uniform()))
    assert {"bounce", "plane"} <= set(shown(session, 0.4).passes)
    fresh = scene_of(material=fastibl.Material(diffuse=(0.1, 0.5, 0.9)))
    again = session_of(fresh, uniform(), backend)
    again.move(session.scene.marker_from_object)
    assert np.array_equal(shown(session, 0.5).image, shown(again).image)


def test_a_turned_object_takes_its_bounce_along_and_a_tilted_one_gets_another():
    mesh, source = torus(), uniform()
    plain = session_of(scene_of(mesh), source)
    shown(plain)
    points = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 21), np.linspace(-0.1, 0.1, 21)), -1).reshape(-1, 2)

    def added(session, at):
        return session.plane_gain.sample(at) - session.shadow_map.sample(at)

    turn, shift = 0.7, np.array([0.05, -0.03])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = session_of(scene_of(mesh), source)
    moved.move(fastibl.Pose.from_rotation_vector(np.array([0, 0, turn]), np.array([*shift, 0.0])))
    shown(moved)
    off = np.abs(added(moved, points @ rotation.T + shift) - added(plain, points)).max()
    print(f"turned and moved: off by {off:.4f} of at most {added(plain, points).max():.4f}")
    assert off < 0.15 * added(plain, points).max()
    # Lifted by 3 cm: as a mesh that was made there.
    lifted = session_of(scene_of(mesh), source)
    lifted.move(fastibl.Pose.from_rotation_vector(np.array([0.4, 0, 0]), np.array([0, 0, 0.03])))
    shown(lifted)
    tilt = fastibl.Pose.from_rotation_vector(np.array([0.4, 0, 0]), np.array([0, 0, 0.03]))
    made = fastibl.Mesh(tilt @ mesh.vertices, mesh.triangles)
    there = session_of(scene_of(made), source, methods={"shadow": "directions"})
    shown(there)
    off = np.abs(added(lifted, points) - added(there, points)).max()
    print(f"tilted: off by {off:.4f} of {added(there, points).max():.4f}")
    assert off < 0.1 * added(there, points).max()


@pytest.mark.parametrize(
    "source", [fastibl.CubeMap(np.zeros((6, 8, 8, 3))), uniform(1e-12), uniform(1e5), "one texel", "below"]
)
def test_extreme_light_gives_finite_gain(source):
    if isinstance(source, str):
        faces = np.zeros((6, 16, 16, 3))
        faces[4 if source == "one texel" else 5, 3, 4] = 1e5
        source = fastibl.CubeMap(faces)
    session = session_of(scene_of(), source)
    image = shown(session).image
    gain = session.plane_gain
    assert np.isfinite(gain.image).all() and (gain.image >= 0).all() and np.isfinite(session.object.rgba).all()
    assert (session.object.rgba >= 0).all() and image.shape == (120, 160, 3)


@pytest.mark.parametrize("shadow", ["auto", "directions", "cap-sum"])
def test_light_of_a_lamp_fades_over_the_plane_as_it_should(shadow):
    """Under an even sky, all around and as far as it is seen: a ball's light is that of a point in its middle."""
    radius, height, emission, sky = 0.03, 0.08, 20.0, 0.2
    scene = scene_of(ball(radius, height), fastibl.Material((0, 0, 0), emission=(emission,) * 3))
    session = session_of(scene, uniform(sky), methods={"shadow": shadow})
    result = shown(session)
    along = np.array([0.12, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0, 3.0])
    for turn in (0.0, np.pi / 8, np.pi / 4, 2.0):
        points = along[:, None] * [np.cos(turn), np.sin(turn)]
        square = along**2 + height**2
        added = emission * radius**2 * height / square**1.5 / sky
        own = result.shadow_map.sample(points)[:, 0]
        gain = session.plane_gain.sample(points)[:, 0]
        off = (gain - own) / added - 1
        print(
            f"{shadow}, {np.degrees(turn):.0f} degrees: gain {gain[0]:.2f} to {gain[-1]:.4f}, its light off by",
            off.round(3),
        )
        assert np.abs(off[:4]).max() < 0.05  # the rest fades below a hundredth
        assert np.abs(gain - own - added).max() < 0.05 * added[0] and abs(gain[-1] - 1) < 1e-4


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("emission", [(300.0,) * 3, (1e4,) * 3, (1e6, 1e-3, 0.0), (1e9,) * 3])
def test_an_object_that_outshines_the_room_leaves_the_plane_what_it_is(emission, backend):
    """Where its light does not come, the plane's factor is exactly 1."""
    scene = scene_of(ball(0.03, 0.08), fastibl.Material((0.3, 0.3, 0.3), emission=emission))
    session = session_of(scene, uniform((0.2, 0.01, 2e-5)), backend)
    image = shown(session).image
    ratio = session.layers.ratio
    gain = session.plane_gain
    far = np.array([[1e3, 1e3], [-1e4, 0.0]])
    print(f"gain up to {gain.image.max():.3g}; least factor of the picture {ratio.min():.4f}")
    assert np.array_equal(gain.sample(far), np.ones((2, 3))) and np.isfinite(gain.image).all()
    assert ratio.min() > 0.3 and np.percentile(image, 20) > 60
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (4000, 2))
    assert np.array_equal(gain.sample(points), np.concatenate([gain.sample(p[None]) for p in points]))


@needs_gl
@pytest.mark.parametrize("shadow", ["mesh", "directions", "cap-product"])
@pytest.mark.parametrize("with_back", [True, False])
def test_the_back_ends_agree_on_the_bounce(shadow, with_back):
    made = []
    for backend in ("cpu", "gl"):
        scene = scene_of()
        scene.shadow_strength, scene.shadow_color = 0.8, (0.1, 0.0, 0.3)
        session = session_of(scene, marked_map(), backend, {"shadow": shadow})
        made.append(shown(session, back=GREY if with_back else None).image.astype(int))
    changed = (made[0] != (120 if with_back else 0)).any(axis=-1)
    off = np.abs(made[0] - made[1]).max(axis=-1)[changed]
    print(f"{shadow}: {(off <= 2).mean():.2%} of {changed.sum()} pixels within 2/255, worst {off.max()}")
    assert changed.sum() > 2000 and (off <= 2).mean() >= 0.999


# --- the look of the shadow


def test_the_default_look_changes_no_byte():
    source = marked_map()
    for methods in ("paper", {"bounce": "none"}, "auto"):
        one = session_of(scene_of(), source, methods=methods)
        scene = scene_of()
        scene.shadow_strength, scene.shadow_color = 1.0, (0, 0, 0)
        other = session_of(scene, source, methods=methods)
        assert np.array_equal(shown(one).image, shown(other).image)
        if methods != "auto":
            assert "plane" not in one.process(fastibl.Frame(0.1, back=GREY, back_from_marker=VIEW)).passes
            assert one.plane_gain == one.shadow_map


@pytest.mark.parametrize("backend", BACKENDS)
def test_strength_and_colour(backend):
    source, none, scene = marked_map(), {"bounce": "none"}, scene_of()
    plain = session_of(scene, source, backend, none)
    dark = shown(plain).image
    for strength, color in itertools.product((0.0, 0.4, 1.0), ((0, 0, 0), (0.5, 0, 0.25), (1, 1, 1))):
        scene.shadow_strength, scene.shadow_color = strength, color
        assert scene.shadow_strength == pytest.approx(strength) and scene.shadow_color == pytest.approx(color)
        session = session_of(scene, source, backend, none)
        image = shown(session).image
        ratio, drawn = plain.shadow_map.image, session.plane_gain.image
        np.testing.assert_allclose(session.shadow_map.image, ratio)  # what is measured stays
        np.testing.assert_allclose(drawn, 1 - strength * (1 - ratio) * (1 - np.array(color)), atol=1e-6)
        assert drawn.min() >= 0 and drawn.max() <= 1
        beside = np.ones(image.shape[:2], bool)
        layer = session.object
        h, w = layer.rgba.shape[:2]
        beside[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba[..., 3] == 0
        assert (image[beside].astype(int) >= dark[beside].astype(int) - 1).all()
        if strength == 0 or color == (1, 1, 1):
            assert (image[beside] == 120).all()
    # Changed while it runs.
    plain.set_shadow_look(0.4, (0.5, 0, 0.25))
    scene.shadow_strength, scene.shadow_color = 0.4, (0.5, 0, 0.25)
    assert np.array_equal(shown(plain, 0.1).image, shown(session_of(scene, source, backend, none)).image)
    plain.set_shadow_look()
    assert np.array_equal(shown(plain, 0.2).image, dark)


def test_a_look_that_is_none():
    scene = scene_of()
    session = session_of(scene, uniform())
    for bad in (-0.1, 1.1, float("nan"), float("inf")):
        same_error(lambda bad=bad: setattr(scene, "shadow_strength", bad), ValueError, "strength", "0 to 1")
        same_error(lambda bad=bad: setattr(scene, "shadow_color", (0, bad, 0)), ValueError)
        same_error(lambda bad=bad: session.set_shadow_look(bad), ValueError, "strength", "0 to 1")
        same_error(lambda bad=bad: session.set_shadow_look(1, (0, 0, bad)), ValueError)
    same_error(lambda: setattr(scene, "shadow_color", (0, 1)), ValueError)
    assert scene.shadow_strength == 1 and scene.shadow_color == (0, 0, 0)


# --- real objects


def box(lower, upper):
    lower, upper = np.array(lower, float), np.array(upper, float)
    x = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * (upper - lower) + lower
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return fastibl.Mesh(x, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


BEFORE, BEHIND = box((0.0, -0.1, 0), (0.05, -0.07, 0.05)), box((-0.05, 0.07, 0), (0.08, 0.09, 0.07))


def with_holdouts(*holdouts, **options):
    scene = scene_of(**options)
    scene.holdouts = list(holdouts)
    return scene


def layer_picture(layer):
    """(h, w, 4) over the whole picture."""
    out = np.zeros((120, 160, 4))
    h, w = layer.rgba.shape[:2]
    out[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba
    return out


def rays():
    """Directions (120, 160, 3) in the marker frame, and the eye."""
    x, y = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
    marker = VIEW.inverse()
    return CAMERA.unproject(np.stack([x, y], -1)) @ marker.rotation.T, marker.translation


def true_ratio(source, object_mesh, holdouts, points, normals):
    """By rays to the texels: the light of both by that of the real objects alone, (n, 3)."""
    d, angle, radiance = reference.samples(source)
    both = [fastibl.Bvh(mesh) for mesh in (object_mesh, *holdouts)]
    out = np.empty((len(points), 3))
    for i, (point, n) in enumerate(zip(points, normals, strict=True)):
        up = np.flatnonzero(d @ n > 0)
        starts = np.broadcast_to(point + 1e-5 * n, (len(up), 3)).astype(np.float32)
        hidden = [bvh.occluded(starts, d[up].astype(np.float32)) for bvh in both]
        flux = radiance[up] * (angle[up] * (d[up] @ n))[:, None]
        real = ~np.any(hidden[1:], axis=0)
        out[i] = (flux * (real & ~hidden[0])[:, None]).sum(axis=0) / (flux * real[:, None]).sum(axis=0)
    return out


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_nearer_hides_what_is_farther(backend):
    source = uniform()
    alone = session_of(scene_of(), source, backend)
    shown(alone)
    object_alone = layer_picture(alone.object)
    session = session_of(with_holdouts(BEFORE, BEHIND), source, backend)
    image = shown(session).image.astype(int)
    object_, real = layer_picture(session.object), layer_picture(session.holdout)
    d, eye = rays()
    origins = np.broadcast_to(eye.astype(np.float32), d.shape).copy()

    def reach(mesh):
        triangle, t, _ = fastibl.Bvh(mesh).nearest(origins, d.astype(np.float32))
        return np.where(triangle >= 0, t, np.inf)

    virtual, before, behind = reach(torus()), reach(BEFORE), reach(BEHIND)
    inner = np.ones((120, 160), bool)  # not beside an edge of anything
    nearest = np.argmin([virtual, before, behind], axis=0) + 10 * np.isinf([virtual, before, behind]).all(axis=0)
    for dy, dx in itertools.product((-1, 0, 1), (-1, 0, 1)):
        inner &= np.roll(nearest, (dy, dx), (0, 1)) == nearest
    hides = inner & (before < virtual) & np.isfinite(virtual)
    hidden = inner & (virtual < behind) & np.isfinite(behind)
    assert hides.sum() > 50 and hidden.sum() > 50
    assert (object_[hides] == 0).all() and (real[hides][:, 3] == 1).all()
    np.testing.assert_array_equal(object_[hidden], object_alone[hidden])
    assert (real[hidden] == 0).all()
    beside = inner & np.isfinite(virtual) & (virtual < before)
    np.testing.assert_array_equal(object_[beside], object_alone[beside])
    # The real object before the virtual one keeps its picture, darkened by its own ratio alone.
    linear = CAMERA.response.decode(np.float32([120 / 255]))[0]
    ratio = real[hides][:, :3]
    expected = np.round(CAMERA.response.encode((ratio * linear).astype(np.float32)) * 255)
    assert np.abs(image[hides] - expected).max() <= 1
    # It is lit from the front: nothing of the virtual object's shadow shows there.
    front = hides & (np.abs(eye[1] + before * d[..., 1] + 0.1) < 1e-4)
    assert front.sum() > 20 and (image[front] == 120).all()
    np.testing.assert_allclose((object_ + real)[..., 3].max(), 1)


@pytest.mark.parametrize("light", ["marked", "uniform"])
def test_the_shadow_on_a_real_object_against_rays(light):
    source = marked_map(32) if light == "marked" else uniform()
    session = session_of(with_holdouts(BEHIND, BEFORE), source)
    shown(session)
    real = layer_picture(session.holdout)
    d, eye = rays()
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (0.07 - eye[1]) / d[..., 1]  # the face of the farther box that looks at the camera
    at = eye + t[..., None] * d
    inside = (at[..., 0] > -0.048) & (at[..., 0] < 0.078) & (at[..., 2] > 0.002) & (at[..., 2] < 0.068)
    seen = np.argwhere(inside & (real[..., 3] == 1) & np.isclose(at[..., 1], 0.07))[::7]
    assert len(seen) > 100
    points = at[seen[:, 0], seen[:, 1]]
    normals = np.broadcast_to([0.0, -1.0, 0.0], points.shape)
    true = true_ratio(source, torus(), [BEHIND, BEFORE], points, normals)
    off = real[seen[:, 0], seen[:, 1], :3] - true
    rms = np.sqrt((off**2).mean())
    worst = np.abs(off).max()
    print(f"{light}: ratio from {true.min():.3f} to {true.max():.3f}, off by {rms:.4f} RMS, {worst:.4f} at most")
    assert true.min() < 0.85 and rms < 0.02 and np.abs(off).max() < 0.08
    assert (real[..., :3] <= real[..., 3:] + 1e-6).all() and (real >= 0).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_real_objects_change_no_byte(backend):
    source = marked_map()
    plain, empty = (session_of(scene, source, backend) for scene in (scene_of(), with_holdouts()))
    a, b = shown(plain), shown(empty)
    assert np.array_equal(a.image, b.image) and a.passes == b.passes
    assert empty.holdout.rgba.size == 0 and empty.scene.holdouts == ()
    # Nor does one that the camera does not see.
    away = session_of(with_holdouts(box((5, 5, 5), (5.1, 5.1, 5.1))), source, backend)
    assert np.array_equal(shown(away).image, a.image)


@needs_gl
@pytest.mark.parametrize("with_back", [True, False])
@pytest.mark.parametrize("distortion", [(), (-0.2, 0.05, 0.0, 0.0)])
def test_the_back_ends_agree_on_real_objects(with_back, distortion):
    made, layers = [], []
    camera = camera_of(160, 120, 40.0, distortion=distortion)
    for backend in ("cpu", "gl"):
        scene = with_holdouts(BEFORE, BEHIND)
        scene.shadow_strength = 0.9
        session = fastibl.Session(scene, fastibl.Rig(camera), environment=marked_map(), backend=backend)
        made.append(shown(session, back=GREY if with_back else None).image.astype(int))
        layers.append(layer_picture(session.holdout))
    changed = (made[0] != (120 if with_back else 0)).any(axis=-1)
    off = np.abs(made[0] - made[1]).max(axis=-1)[changed]
    same = np.abs(layers[0] - layers[1]).max(axis=-1) < 1e-3
    print(
        f"{(off <= 2).mean():.2%} of {changed.sum()} pixels within 2/255, worst {off.max()}; layers {same.mean():.3%}"
    )
    assert changed.sum() > 2000 and (off <= 2).mean() >= 0.999 and same.mean() >= 0.999


@pytest.mark.parametrize("backend", BACKENDS)
def test_real_objects_follow_what_changes(backend):
    # By name: that of the self-shadow, all but a tie, is chosen anew with the tilted object's bounce.
    methods = {"self_shadow": "transfer"}
    session = session_of(with_holdouts(BEHIND), uniform(), backend, methods)
    first = shown(session)
    assert "holdout" in first.passes and "holdout" not in shown(session, 0.1).passes
    place = fastibl.Pose.from_rotation_vector(np.array([0.3, 0, 0.5]), np.array([0.02, 0.02, 0.01]))
    session.move(place)
    moved = shown(session, 0.2)
    assert "holdout" in moved.passes
    fresh = session_of(with_holdouts(BEHIND), uniform(), backend, methods)
    fresh.move(place)
    assert np.array_equal(shown(fresh).image, moved.image)
    session.set_cast_shadow(False)
    bare = shown(session, 0.3)
    assert "holdout" not in bare.passes
    layer = layer_picture(session.holdout)
    np.testing.assert_allclose(layer[..., 0], layer[..., 3], atol=1e-6)  # it hides, and nothing darkens it
    session.set_cast_shadow(True)
    assert np.array_equal(shown(session, 0.4).image, moved.image)


def test_real_objects_that_are_none():
    scene = scene_of()
    bad = BEHIND.vertices.copy()
    bad[0, 0] = np.nan
    same_error(lambda: setattr(scene, "holdouts", [fastibl.Mesh(bad, BEHIND.triangles)]), ValueError, "finite")
    with pytest.raises(TypeError):
        scene.holdouts = [1.0]
    assert scene.holdouts == ()
    scene.holdouts = [BEHIND]
    assert len(scene.holdouts) == 1 and np.array_equal(scene.holdouts[0].vertices, BEHIND.vertices)
    # A wall of metres is cut no finer than its size allows; one around everything is drawn as it is seen.
    huge = with_holdouts(box((-50, 0.2, -1), (50, 0.3, 40)), box((-1, -1, -1), (1, 1, 1)))
    image = shown(session_of(huge, uniform())).image
    assert image.shape == (120, 160, 3)


def ratio_picture(scene, pose, backend="cpu", move=None):
    """What is left of the holdouts' light (h, w), NaN where none is seen whole."""
    session = session_of(scene, marked_map(), backend, {"self_shadow": "transfer"})
    if move is not None:
        session.move(move)
    shown(session, pose=pose)
    layer = layer_picture(session.holdout)
    return np.where(layer[..., 3] >= 1, layer[..., 1], np.nan)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("away", [0.5, 3.0])
def test_real_objects_are_cut_where_the_object_is_moved_to(away, backend):
    place = fastibl.Pose.from_rotation_vector((0, 0, 0), (away, 0, 0))
    pose = fastibl.Pose.look_at((away + 0.25, -0.3, 0.3), (away, 0, 0.03))
    floor = wall_and_floor(5.0)[1:]
    here = ball(height=0.06)
    scene, made = (scene_of(fastibl.Mesh(here.vertices + np.float32([x, 0, 0]), here.triangles)) for x in (0, away))
    scene.holdouts = made.holdouts = floor
    moved, fresh = ratio_picture(scene, pose, backend, place), ratio_picture(made, pose, backend)
    known = ~np.isnan(moved + fresh)
    off = np.abs(moved - fresh)[known]
    print(f"{away} m away, {backend}: within {off.max():.4f}, RMS {off.std():.5f}; ratios from {np.nanmin(fresh):.2f}")
    assert known.sum() > 5000 and np.nanmin(fresh) < 0.7 and off.max() < 0.02


def test_an_open_holdout_faces_the_object():
    pose = fastibl.Pose.look_at((0.25, -0.3, 0.3), (0, 0, 0.03))
    (floor,) = wall_and_floor(0.5)[1:]
    turned = fastibl.Mesh(floor.vertices, floor.triangles[:, ::-1])
    one, other = (ratio_picture(with_holdouts(m), pose) for m in (floor, turned))
    assert np.nanmin(one) < 0.7
    np.testing.assert_allclose(one, other, atol=1e-5)


def test_the_scene_of_a_session_is_a_copy():
    session = session_of(with_holdouts(BEHIND), uniform())
    before = shown(session)
    session.scene.shadow_strength = 0.0
    session.scene.holdouts = [BEFORE]
    assert np.array_equal(shown(session, 0.1).image, before.image)
    assert session.scene.shadow_strength == 1 and len(session.scene.holdouts) == 1


def test_methods_of_the_bounce():
    assert [str(m) for m in fastibl.methods("bounce")] == ["none", "one-bounce"]
    same_error(lambda: session_of(scene_of(), uniform(), methods={"bounce": "two"}), ValueError, "two", "one-bounce")


def test_a_new_look_casts_no_shadow_anew():
    session = session_of(with_holdouts(BEHIND), marked_map())
    shown(session)
    session.set_shadow_look(0.5)
    assert shown(session, 0.1).passes == ["plane", "holdout", "shade", "composite"]
    scene = with_holdouts(BEHIND)
    scene.shadow_strength = 0.5
    assert np.array_equal(shown(session, 0.2).image, shown(session_of(scene, marked_map())).image)


def standing_cube(shared):
    """A cube of 4 cm that stands on the plane, of 8 vertices, or of 24 with a normal a face."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) * 0.02
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    if not shared:
        corners, quads = corners[np.ravel(quads)], np.arange(24).reshape(6, 4)
    return fastibl.Mesh(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def pyramid():
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1.2)]) * 0.03
    return fastibl.Mesh(corners, [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 2, 1), (0, 3, 2)])


@pytest.mark.parametrize(
    "mesh, steep",
    [(standing_cube(True), True), (standing_cube(False), True), (pyramid(), False)],
    ids=["8 corners", "24 corners", "pyramid"],
)
def test_few_vertices_on_the_plane_make_no_bright_spots(mesh, steep):
    """In light that is the same from everywhere, an object that absorbs some of it can only darken the plane."""
    scene = fastibl.Scene(mesh, fastibl.Material(diffuse=(0.8, 0.8, 0.8)))
    camera = fastibl.Camera(160, 120, 220, 220, 80, 60)
    sky = fastibl.CubeMap(np.full((6, 8, 8, 3), 0.5))
    grey = np.full((120, 160, 3), 150, np.uint8)
    for eye in ((0.15, -0.2, 0.15), (-0.2, -0.1, 0.1)):
        pose = looking(-np.array(eye), eye)
        pictures = {}
        for bounce in ("one-bounce", "none"):
            session = fastibl.Session(scene, fastibl.Rig(camera), environment=sky, methods={"bounce": bounce})
            pictures[bounce] = session.process(fastibl.Frame(0.0, back=grey, back_from_marker=pose)).image
        alpha = np.zeros((120, 160))
        layer = session.object
        h, w = layer.rgba.shape[:2]
        alpha[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba[..., 3]
        plane, faces = alpha == 0, alpha == 1
        with_, without = (pictures[k].astype(int) for k in ("one-bounce", "none"))
        print(f"plane at most {with_[plane].max()} of 150, object at most {np.abs(with_ - without)[faces].max()} off")
        assert faces.sum() > 500 and with_[plane].max() <= 153
        assert steep or np.abs(with_ - without)[faces].max() < 12
        # Where a wall meets the plane it sees half plane, whose light the wall halves there: a quarter is lost; 6 % of
        # that is what the bounce is taken to be wrong by, and a code is 1.7 %.
        linear = [camera.response.decode((k[faces] / 255).astype(np.float32)) for k in (with_, without)]
        lost = 1 - linear[0] / linear[1]
        print(f"from {lost.min():.3f} to {lost.max():.3f} of the object's light lost")
        assert lost.min() > -0.02 and lost.max() < 0.25 * 1.06 + 0.017


def wall_and_floor(half=0.0):
    """A box beside the object, and a floor under all."""
    lower, upper = np.float32((0.06, -0.2, 0)), np.float32((0.08, 0.2, 0.2))
    corners = np.array(list(itertools.product(*zip(lower, upper, strict=True))))
    sides = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    sides += [[2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3], [0, 2, 6], [0, 6, 4]]
    meshes = [fastibl.Mesh(corners, sides)]
    if half:
        square = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half - [0, 0, 0.001]
        meshes.append(fastibl.Mesh(square, [[0, 1, 2], [0, 2, 3]]))
    return meshes


def test_a_large_holdout_takes_no_shadow_from_a_small_one():
    faces = np.zeros((6, 32, 32, 3), np.float32)
    d = fastibl.texel_directions(32).astype(float)
    faces[d[..., 2] > 0] = 0.3  # a floor hides nothing of it
    faces[d @ [-0.9, -0.1, 0.42] > 0.98 * np.linalg.norm(d, axis=-1)] = 50.0  # over the object, onto the wall
    pose = fastibl.Pose.look_at((-0.25, -0.25, 0.25), (0.03, 0, 0.05))
    ratios = {}
    for half in (0.0, 0.5, 5.0, 100.0):
        scene = scene_of(ball(radius=0.05, height=0.06))
        scene.holdouts = wall_and_floor(half)
        session = session_of(scene, fastibl.CubeMap(faces))
        shown(session, pose=pose)
        layer = session.holdout
        full = np.zeros((CAMERA.height, CAMERA.width, 2))
        h, w = layer.rgba.shape[:2]
        full[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba[..., [0, 3]]
        ratios[half] = full
    wall = ratios[0.0][..., 1] >= 1
    alone = ratios[0.0][wall, 0]
    assert alone.min() < 0.5, "no shadow on the wall"
    for half, full in list(ratios.items())[1:]:
        wrong = np.sqrt(((full[wall, 0] - alone) ** 2).mean())
        print(
            f"with a floor of {2 * half:g} m: the wall's ratio down to {full[wall, 0].min():.2f}, {wrong:.3f} RMS off"
        )
        assert wrong < 0.01


@pytest.mark.parametrize("roughness", [0.0, 0.5, 1.0])
def test_a_dielectric_sends_the_plane_what_leaves_its_surface(roughness):
    """In a white furnace: of what a matte object of its colour sends, 1 less its albedo, mean over views."""
    white = fastibl.CubeMap(np.ones((6, 8, 8, 3)))
    mesh = fastibl.stand(fastibl.shapes.figurine(), 0.1)
    shadow, added = fastibl.MeshShadow(mesh, progress=False).cast(white), []
    for material in (fastibl.Material(diffuse=(1, 1, 1)), fastibl.Material.pbr((1, 1, 1), 0.0, roughness)):
        bounce = fastibl.Bounce(fastibl.Scene(mesh, material))
        bounce.update(fastibl.Lighting(white), shadow)
        points = np.array([(0.05, 0.0), (0.0, 0.07)])
        added.append(bounce.plane_gain.sample(points) - shadow.sample(points))
    cosines = np.sqrt((np.arange(2000) + 0.5) / 2000)  # weighted by themselves
    views = np.stack([np.sqrt(1 - cosines**2), np.zeros(2000), cosines], axis=-1)
    a, c = fastibl.ggx_albedo(views, roughness=roughness).T.astype(np.float64)
    kept = ((0.04 * a + c) * (1 + 0.04 * (1 / (a + c) - 1))).mean()
    print(
        f"roughness {roughness}: {added[1].mean() / added[0].mean():.4f} of a matte one, {1 - kept:.4f} by its albedo"
    )
    np.testing.assert_allclose(added[1] / added[0], 1 - kept, atol=0.004)
