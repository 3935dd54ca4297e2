"""What a picture is put together from, by plain NumPy once more; the file that a compositing program reads."""

import numpy as np
import pytest
import trimesh
from scenes import scene_of

import fastibl
from conftest import same_error
from fastibl.gl_device import gl_device

NO_GL = gl_device()[1]
BACKENDS = ["cpu", pytest.param("gl", marks=pytest.mark.skipif(bool(NO_GL), reason=NO_GL or "-"))]
CURVE = fastibl.Response.srgb().between(16 / 255, 235 / 255)


def ball():
    mesh = trimesh.creation.icosphere(2, 0.04)
    return fastibl.Mesh(np.float32(mesh.vertices + (0, 0, 0.06)), mesh.faces)


def composed(plate, layers):
    """plate: linear. By float64, without the library."""
    o = np.asarray(layers.object, np.float64)
    return plate * np.asarray(layers.ratio, np.float64) * (1 - o[..., 3:]) + o[..., :3]


def picture_and_layers(marked, backend, exposure=0.3):
    """Of a camera with a lens, vignetting, a gain and a curve of its own; a real object before the virtual one."""
    camera = fastibl.Camera(
        160, 120, 150, 150, 80, 60, [-0.2, 0.05, 0, 0], response=CURVE, gain=1.5, vignetting=[-0.3, 0.05, 0]
    )
    scene = fastibl.Scene(ball(), fastibl.Material([0.7] * 3, [0.2] * 3, 40))
    corners = np.array([[0.04, -0.1, 0], [0.08, -0.08, 0], [0.06, -0.09, 0.08]], np.float32)
    scene.holdouts = [fastibl.Mesh(corners, np.array([[0, 1, 2]]))]
    session = fastibl.Session(
        scene, fastibl.Rig(camera), environment=fastibl.Environment(marked), backend=backend, methods="paper"
    )
    plate = np.random.default_rng(0).integers(16, 236, (120, 160, 3)).astype(np.uint8)
    eye = np.array([0.25, -0.3, 0.3])
    pose = fastibl.Pose.look_at(eye, (0, 0, 0.04))
    result = session.process(fastibl.Frame(time=0.0, back=plate, back_exposure=exposure, back_from_marker=pose))
    return plate, result.image, session.layers


@pytest.mark.parametrize("backend", BACKENDS)
def test_layers_make_the_picture(marked, backend):
    plate, image, layers = picture_and_layers(marked, backend)
    assert layers.object.shape == (120, 160, 4) and layers.ratio.shape == (120, 160, 3)
    linear = CURVE.decode(plate / np.float32(255)).astype(np.float64)
    codes = 255 * CURVE.encode(composed(linear, layers))
    off = np.abs(codes - image)
    print(f"{backend}: at most {off.max():.2f} codes")
    assert (np.abs(image.astype(int) - plate).max(-1) > 3).mean() > 0.1  # the object, and its shadow
    assert layers.object[..., 3].max() > 0.99 and layers.ratio.min() < 0.8
    assert (off <= (0.6 if backend == "cpu" else 1.6)).mean() > 0.9999


def test_layers_follow_the_exposure(marked):
    dim, bright = (picture_and_layers(marked, "cpu", exposure)[2] for exposure in (0.25, 0.5))
    assert np.allclose(2 * dim.object[..., :3], bright.object[..., :3], rtol=1e-6)
    assert np.array_equal(dim.object[..., 3], bright.object[..., 3]) and np.array_equal(dim.ratio, bright.ratio)


def test_without_a_board_nothing_is_laid_over(marked):
    recording = fastibl.simulate(seconds=0.2, fps=10, size=(160, 120), lamp=False, hand=False)
    session = fastibl.Session(scene_of(ball()), recording.rig, recording.board)
    for frame in recording:
        session.process(frame)
    assert session.layers.object.any()
    session.process(fastibl.Frame(time=9.0, back=np.full((120, 160, 3), 90, np.uint8)))
    assert not session.layers.object.any() and (session.layers.ratio == 1).all()
    assert session.object.rgba.size == 0 and session.holdout.rgba.size == 0


def test_a_file_of_layers(marked, tmp_path):
    exr = pytest.importorskip("OpenEXR")
    plate, image, layers = picture_and_layers(marked, "cpu")
    fastibl.write_layers(tmp_path / "a.exr", layers, plate, CURVE)
    with exr.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: np.array(c.pixels) for name, c in file.channels().items()}
    assert sorted(channels) == sorted([*"RGBA", *(f"{part}.{c}" for part in ("ratio", "plate") for c in "RGB")])
    assert {c.dtype for c in channels.values()} == {np.dtype(np.float16)}
    r = {part: np.stack([channels[f"{part}{c}"] for c in "RGB"], -1).astype(float) for part in ("", "ratio.", "plate.")}
    linear = r["plate."] * r["ratio."] * (1 - channels["A"][..., None].astype(float)) + r[""]
    off = np.abs(255 * CURVE.encode(linear) - image)
    print(f"at most {off.max():.2f} codes, of half floats")
    assert off.max() <= 0.8
    fastibl.write_layers(tmp_path / "LARGE.EXR", layers)  # as other writers take large letters
    assert (tmp_path / "LARGE.EXR").stat().st_size > 1000
    # 16 bits and floats are the same plate.
    for other in (plate.astype(np.uint16) * 257, CURVE.decode(plate / np.float32(255))):
        fastibl.write_layers(tmp_path / "b.exr", layers, other, CURVE)
        with exr.File(str(tmp_path / "b.exr"), separate_channels=True) as file:
            assert np.array_equal(np.array(file.channels()["plate.G"].pixels), channels["plate.G"])


def test_files_that_cannot_be(marked, tmp_path):
    layers = picture_and_layers(marked, "cpu")[2]
    same_error(lambda: fastibl.write_layers(tmp_path / "a.png", layers), ValueError, ".exr")
    same_error(lambda: fastibl.write_layers(tmp_path / "a.exr", 3), TypeError, "layers", "PictureLayers")
    small = np.zeros((8, 8, 3), np.uint8)
    same_error(
        lambda: fastibl.write_layers(tmp_path / "a.exr", layers, small), ValueError, "(120, 160, 3)", "(8, 8, 3)"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_plate_beyond_white_stays_white_in_the_shade(marked, backend):
    """Linear plates are multiplied before they are clipped."""
    camera = fastibl.Camera(160, 120, 150, 150, 80, 60)
    session = fastibl.Session(scene_of(ball()), fastibl.Rig(camera), environment=marked, backend=backend)
    pose = fastibl.Pose.look_at((0.25, -0.3, 0.3), (0, 0, 0.04))
    for time, level in enumerate((0.5, 2.0, 4.0)):
        plate = np.full((120, 160, 3), level, np.float32)
        image = session.process(fastibl.Frame(time=float(time), back=plate, back_from_marker=pose)).image
        ratio = np.asarray(session.layers.ratio, np.float64)
        beside = session.layers.object[..., 3] == 0
        true = 255 * fastibl.Response.srgb().encode(np.minimum(level * ratio, 1).astype(np.float32))
        off = np.abs(true - image)[beside]
        print(f"a plate of {level}: at most {off.max():.2f} codes; darkest {level * ratio[beside].min():.2f}")
        assert off.max() <= 1 and ratio[beside].min() < 0.8
