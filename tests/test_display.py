"""What notebooks and fastibl.plot show of maps, light, shadows, frames, plans and comparisons."""

import sys

import cv2
import numpy as np
import pytest

import fastibl
from conftest import same_error
from fastibl import display

PICTURES = ("map", "environment", "light", "shadow", "frame", "guidance")


@pytest.fixture(scope="module")
def shown(marked):
    environment = fastibl.Environment(marked)
    mesh = fastibl.stand(fastibl.shapes.figurine(), 0.1)
    camera = fastibl.Camera(64, 48, 60, 60, 32, 24)
    session = fastibl.Session(fastibl.Scene(mesh), fastibl.Rig(camera), environment=environment)
    pose = fastibl.Pose(np.diag([1.0, -1, -1, 1]) + np.array([[0, 0, 0, 0]] * 2 + [[0, 0, 0, 0.4], [0, 0, 0, 0]]))
    frame = session.process(fastibl.Frame(time=0.0, back_from_marker=pose))
    return {
        "map": marked, "environment": environment, "light": frame.lighting, "shadow": frame.shadow_map, "frame": frame,
        "guidance": fastibl.guide(environment), "plan": frame.plan, "comparison": fastibl.compare(marked, environment),
    }  # fmt: skip


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_show_themselves(shown, name):
    encoded = shown[name]._repr_png_()
    image = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(image, display.picture(shown[name])) and image.std() > 5


@pytest.mark.parametrize("kind", ["map", "environment", "light"])
def test_one_exposure_shows_several_on_one_scale(shown, kind):
    def made(faces):
        cube = fastibl.CubeMap(faces)
        return {"map": cube, "environment": fastibl.Environment(cube), "light": fastibl.Lighting(cube)}[kind]

    one, dark = made(shown["map"].faces), made(0.25 * shown["map"].faces)
    exposure = display.auto_exposure(one, 64)
    assert np.array_equal(display.picture(one, 64), display.picture(one, 64, exposure))
    assert np.abs(display.picture(dark, 64).astype(int) - display.picture(one, 64)).max() <= 1
    values = display.picture(dark, 64, exposure) / 255
    other = display.picture(dark, 64, 4 * exposure)
    assert np.abs(other.astype(int) - display.picture(one, 64)).max() <= 1
    inside = (other < 250) & (other > 40) & (values > 0.02)
    decode = fastibl.Response.srgb().decode
    np.testing.assert_allclose(decode(values)[inside], decode(other / 255)[inside] / 4, rtol=0.12)
    axes = fastibl.plot(dark, exposure=exposure)
    np.testing.assert_array_equal(axes.images[0].get_array(), display.picture(dark, 256, exposure))


@pytest.mark.parametrize("exposure", [0, -1.0, np.nan, np.inf])
def test_an_exposure_that_is_none_is_refused(shown, exposure):
    same_error(lambda: display.picture(shown["map"], exposure=exposure), ValueError, "exposure", str(exposure))


@pytest.mark.parametrize("name", ["shadow", "frame", "guidance", "plan", "comparison"])
def test_what_has_no_exposure_says_so(shown, name):
    same_error(lambda: fastibl.plot(shown[name], exposure=1.0), ValueError, "CubeMap, Environment or Lighting")


def test_a_map_stands_upright(shown):
    """z at the top, +y in the middle, x to the right of it: the marked map's faces are where they must be."""
    image = display.picture(shown["map"], 64).astype(int)
    means = {"+z": (2, 64), "+y": (32, 64), "+x": (32, 96), "-x": (32, 32), "-y": (32, 2), "-z": (61, 64)}
    faces = dict(zip(("+x", "-x", "+y", "-y", "+z", "-z"), range(6), strict=True))
    for name, (row, column) in means.items():
        colour = shown["map"].faces[faces[name], 20, 20]
        pixel = image[row, column]
        assert pixel[colour > 0.5].min(initial=255) > pixel[colour < 0.5].max(initial=0), (name, pixel, colour)


def test_the_unseen_is_dimmed():
    capture = fastibl.Capture(size=16)
    camera = fastibl.Camera(32, 32, 16, 16, 16, 16)
    capture.add(np.full((32, 32, 3), 0.5), camera, np.eye(4))  # looks along z: the sky's middle
    environment = capture.environment()
    seen, plain = display.picture(environment, 64), display.picture(environment.radiance, 64)
    assert np.array_equal(seen[0], plain[0]) and (seen[20] < 0.5 * plain[20]).all()


def test_the_lit_spheres_are_lit_from_above(shown):
    """A lamp at the zenith: all three spheres are brightest at the top."""
    faces = np.full((6, 16, 16, 3), 0.1)
    faces[4, 4:12, 4:12] = 20
    image = display.picture(fastibl.Lighting(fastibl.CubeMap(faces)), 64).astype(float)
    for k in range(3):
        sphere = image[:, 64 * k : 64 * (k + 1)]
        assert sphere[12, 32].mean() > sphere[54, 32].mean() + 20


def test_a_shadow_lies_as_the_board_is_looked_at():
    """A ball at (+x, +y) keeps light from the upper right."""
    cube = fastibl.CubeMap(np.ones((6, 16, 16, 3)))
    shadow = fastibl.cast_shadow(cube, [[0.1, 0.1, 0.05, 0.05]], extent=0.2, centre=(0.0, 0.0))
    image = display.picture(shadow, 64)
    assert image[16, 48].mean() < 150 < image[48, 16].mean()


def test_transparent_frames_are_shown_over_white(shown):
    assert (display.picture(shown["frame"])[0, 0] == 255).all()


def test_a_budget_that_is_not_met_is_told_in_the_table():
    light = fastibl.CubeMap(np.random.default_rng(0).random((6, 16, 16, 3)).astype(np.float32))
    scene = fastibl.Scene(fastibl.shapes.figurine(detail=0.9), spheres=8)
    for error, said in ((1e-6, "<b>Not within</b> the error budget"), (0.5, "Within the error budget of 50 %")):
        assert said in fastibl.display.table(fastibl.make_plan(scene, light, error=error))


@pytest.mark.parametrize(
    "name, words", [("plan", ("irradiance", "left out", "in all", "%")), ("comparison", ("matte", "mirror"))]
)
def test_tables_show_themselves(shown, name, words):
    text = shown[name]._repr_html_()
    assert text.startswith("<table>") and all(word in text for word in words), text
    assert text.count("<tr>") == text.count("</tr>") > 2


@pytest.mark.parametrize("name", [*PICTURES, "plan", "comparison"])
def test_plots(shown, name):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    axes = fastibl.plot(shown[name], title=name)
    assert axes.get_title() == name and (axes.images or axes.patches)
    figure = axes.figure
    assert fastibl.plot(shown[name], axes) is axes
    figure.canvas.draw()
    matplotlib.pyplot.close(figure)


def test_what_cannot_be_shown_is_refused(shown):
    same_error(lambda: fastibl.plot(3), TypeError, "int", "CubeMap")
    same_error(lambda: display.picture("map"), TypeError, "str")
    same_error(lambda: display.table(shown["map"]), TypeError, "CubeMap", "Plan")
    same_error(lambda: display.picture(shown["map"], 2), ValueError, "height", "2")
    same_error(lambda: display.picture(shown["shadow"], 7), ValueError, "height", "7")


def test_plot_names_what_is_missing(shown, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    same_error(lambda: fastibl.plot(shown["map"]), ImportError, "pip install matplotlib")


def test_modules_come_when_they_are_asked_for():
    assert fastibl.calibration.calibrate_rig and fastibl.white.camera_ratio and "sources" in dir(fastibl)
    with pytest.raises(AttributeError, match="nothing_such"):
        _ = fastibl.nothing_such
