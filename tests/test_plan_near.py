"""Lamps near the object: methods are judged by where the lamps are, and anew where the object comes close to one."""

import numpy as np
import pytest
from test_near_shading import AMBIENT, CAMERA, TOWARDS, lamp_map, placed, true_glossy
from test_place import ball

import fastibl
from fastibl._fastibl import _measured_errors
from fastibl.lighting import resolve_methods
from views import looking

RADIUS, HEIGHT = 0.03, 0.031
MIDDLE = np.array([0.0, 0.0, HEIGHT])
LAMP = 0.015  # radius of the lamp, metres


def judged(scene, environment, step, method, **options):
    """Squared error of the step's method alone."""
    (error,) = _measured_errors(scene, environment, resolve_methods({step: method}), **options)[step][1]
    return error


@pytest.mark.parametrize("exponent", [60.0, 700.0])
def test_what_knows_no_places_is_judged_so(exponent):
    """`prefiltered` sees a lamp in the same direction from everywhere: its error as judged, against sums."""
    distance = 0.15
    cube = lamp_map(LAMP, distance, size=128)
    shiny = fastibl.Material((0, 0, 0), (1, 1, 1), exponent)
    scene = fastibl.Scene(ball(RADIUS, HEIGHT, around=64), shiny, spheres=1)
    rng = np.random.default_rng(3)  # what eyes from afar see, each pixel equally often
    normals = rng.normal(size=(6000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lighting = fastibl.Lighting(cube, glossy="prefiltered")
    off, stated = {}, {}
    for known in (False, True):
        environment = placed(cube, [*(MIDDLE + distance * TOWARDS), LAMP] if known else np.zeros((0, 4)), MIDDLE)
        squares, means = [], []
        for azimuth in np.arange(8) * np.pi / 4:
            view = np.array([np.cos(azimuth) * np.cos(0.65), np.sin(azimuth) * np.cos(0.65), np.sin(0.65)])
            some = normals[rng.random(len(normals)) < normals @ view][:400]
            true = true_glossy(some, view, exponent, distance, LAMP, RADIUS if known else 0)
            white = max(AMBIENT / 0.35, np.median(true) / 0.7)
            given = lighting.glossy(some, np.broadcast_to(view, some.shape), exponent)[:, 0]
            squares.append(((np.minimum(given, white) - np.minimum(true, white)) ** 2).mean())
            means.append(np.minimum(true, white).mean())
        off[known] = np.sqrt(np.mean(squares)) / np.mean(means)
        stated[known] = np.sqrt(judged(scene, environment, "glossy", "prefiltered", cast_shadow=False))
        print(f"lamp {'in its place' if known else 'as distant'}: {off[known]:.4f}, stated {stated[known]:.4f}")
    placing = np.sqrt(judged(scene, environment, "glossy", "stretched", cast_shadow=False))
    print(f"what knows places: {placing:.4f}")
    assert stated[True] == pytest.approx(off[True], rel=0.3)  # at other points of the ball
    assert off[True] > 1.5 * off[False] and stated[True] > 1.5 * max(stated[False], placing / 2)


def test_a_lamp_known_to_be_far_is_judged_like_light_without_a_place():
    mesh = fastibl.shapes.figurine(0.12)
    scene = fastibl.Scene(
        mesh, fastibl.Material(diffuse=(0.4, 0.4, 0.4), glossy=(0.3, 0.3, 0.3), exponent=64), spheres=20
    )
    scene.baked_shadow = fastibl.MeshShadow(mesh)
    cube = lamp_map(0.05, 0.5)
    methods = resolve_methods({"glossy": "stretched"})
    far = _measured_errors(scene, placed(cube, [*(5e3 * TOWARDS), 500.0]), methods)
    none = _measured_errors(scene, fastibl.Environment(cube), methods)
    for step in ("diffuse", "glossy", "self_shadow", "shadow", "bounce"):
        assert far[step][0] == none[step][0]
        worst = np.abs(np.sqrt(far[step][1]) - np.sqrt(none[step][1])).max()
        print(f"{step}: differs by up to {worst:.2g} of the picture")
        # Near lights are discs, and what hides them is found for these, not for cells of the map.
        assert worst < (4e-3 if step == "self_shadow" else 1e-3)


def test_methods_are_judged_anew_where_the_object_comes_close_to_a_lamp():
    """Though no texel of the map changes. At once: with the next frame, so that nothing depends on where it was."""
    mesh = fastibl.shapes.figurine(0.12)
    scene = fastibl.Scene(mesh, fastibl.Material(diffuse=(0.8, 0.8, 0.8)), spheres=20)
    lamp = np.array([1.0, 0.0, 0.3])
    centre = np.array([0.0, 0.0, 0.06])
    towards = (lamp - centre) / np.linalg.norm(lamp - centre)
    cube = lamp_map(0.05, float(np.linalg.norm(lamp - centre)), facing=1.0, towards=towards)
    environment = placed(cube, [*lamp, 0.05], centre)
    plans = []
    for shift in ((0.0,), (0.0, 0.8), (0.8,)):
        session = fastibl.Session(scene, fastibl.Rig(CAMERA), None, environment, error=0.02)
        for k, x in enumerate(shift):
            at = fastibl.Pose.from_rotation_vector([0, 0, 0], [x, 0, 0])
            session.move(at)
            eye = np.array([0.1, -0.4, 0.3])
            pose = looking(centre - eye, eye) @ at.inverse()
            plan = session.process(fastibl.Frame(float(k), back_from_marker=pose)).plan
        plans.append(plan)
    beside, moved, close = plans
    print(*(f"{p.expected_error:.4f}" for p in plans))
    assert moved.expected_error == pytest.approx(close.expected_error, rel=1e-6)
    assert close.expected_error != pytest.approx(beside.expected_error, rel=0.02)
