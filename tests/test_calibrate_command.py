"""The command that measures a rig, from pictures to rig.yaml and board.yaml."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_pictures import held, look_at, render
from test_calibration import BOARD, CAMERA, VIEWS, board_pictures, off_by

import fastibl
from fastibl.__main__ import main
from fastibl.recording import RecordingWriter, read_board, read_rig, write_board, write_rig

ROOT = Path(__file__).parents[1]
FRONT = fastibl.Camera(400, 300, 330.0, 330.0, 200.0, 150.0)
FRONT_FROM_BACK = fastibl.Pose.from_rotation_vector([0.02, np.pi - 0.04, 0.01], [0.01, -0.003, -0.008])
BASE = fastibl.Pose.from_rotation_vector([np.pi, 0.0, 0.0], [0.0, 0.0, 0.3])  # above the middle of a board


def write(folder, pictures):
    folder.mkdir()
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k}.png"), np.ascontiguousarray(picture[..., ::-1]))
    return [str(p) for p in sorted(folder.iterdir())]


def test_lens_board_and_response(tmp_path, capsys):
    shots = write(tmp_path / "shots", board_pictures(views=VIEWS[:8]))
    rig, board = str(tmp_path / "rig.yaml"), str(tmp_path / "board.yaml")
    write_board(board, BOARD)
    assert main(["calibrate", "camera", *shots, "--board", board, "--terms", "4", "--rig", rig]) == 0
    said = capsys.readouterr().out
    assert "fx" in said and "+-" in said
    assert read_rig(rig).back.fx == pytest.approx(CAMERA.fx, rel=2e-3)
    whole = [(20 + 5 * (k % 4), 0.3, 60 * k, 45 * k) for k in range(6)]
    shots = write(tmp_path / "whole", [render(BOARD, CAMERA, look_at(*v), seed=k, fine=2) for k, v in enumerate(whole)])
    out = str(tmp_path / "measured.yaml")
    assert main(["calibrate", "board", *shots, "--board", board, "--rig", rig, "--out", out]) == 0
    assert len(read_board(out).tags) == len(BOARD.tags)
    rng = np.random.default_rng(0)
    scene = np.geomspace(0.01, 2, 300 * 200).reshape(200, 300, 1) * np.ones(3)
    exposures = [0.25, 1.0, 4.0]
    light = [np.clip(scene * e + 0.002 * rng.standard_normal(scene.shape), 0, 1) for e in exposures]
    shots = write(tmp_path / "exposures", [np.rint(255 * x ** (1 / 1.8)).astype(np.uint8) for x in light])
    assert main(["calibrate", "response", *shots, "--exposures", *map(str, exposures), "--rig", rig]) == 0
    x = np.linspace(0.1, 0.9, 9).astype(np.float32)
    np.testing.assert_allclose(read_rig(rig).back.response.decode(x), x**1.8, atol=0.015)
    assert read_rig(rig).back.fx == pytest.approx(CAMERA.fx, rel=2e-3)  # the lens stayed


def test_linear_pictures_of_16_bits(tmp_path):
    """Dark ones, as raw converters write them: their 8 upper bits hold nothing."""
    board, rig = str(tmp_path / "board.yaml"), str(tmp_path / "rig.yaml")
    write_board(board, BOARD)
    light = [fastibl.Response.srgb().decode(p / np.float32(255)) / 60 for p in board_pictures(views=VIEWS[:8])]
    shots = write(tmp_path / "shots", [np.rint(65535 * x).astype(np.uint16) for x in light])
    arguments = ["calibrate", "camera", *shots, "--board", board, "--terms", "4", "--rig", rig, "--response", "1"]
    assert main(arguments) == 0
    assert read_rig(rig).back.fx == pytest.approx(CAMERA.fx, rel=2e-3)
    assert read_rig(rig).back.response == fastibl.Response.gamma(1.0)


@pytest.mark.parametrize("other", [3, 6])
def test_a_telephone_held_both_ways_is_one_camera(tmp_path, other):
    """Its sensor's pixels are the same, whatever EXIF says of how they are to be shown."""
    board = str(tmp_path / "board.yaml")
    write_board(board, BOARD)
    rigs = []
    for name, orientations in (("as it lies", (1, 1)), ("both ways", (1, other))):
        (tmp_path / name).mkdir()
        for k, picture in enumerate(board_pictures(views=VIEWS[:8])):
            jpeg = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            (tmp_path / name / f"{k}.jpg").write_bytes(held(jpeg, orientations[k % 2]))
        shots, rig = [str(p) for p in sorted((tmp_path / name).iterdir())], str(tmp_path / f"{name}.yaml")
        assert main(["calibrate", "camera", *shots, "--board", board, "--terms", "4", "--rig", rig]) == 0
        rigs.append(read_rig(rig).back)
    found = [(c.width, c.height, c.fx, c.fy, c.cx, c.cy, *c.distortion) for c in rigs]
    assert found[0] == pytest.approx(found[1], rel=1e-4) and rigs[0].fx == pytest.approx(CAMERA.fx, rel=3e-3)


def all_around(camera, pose):
    """BOARD on grey, in a picture of 360 degrees."""
    fine, dpi = 3, 200
    x, y = np.meshgrid(*(np.arange(fine * n) + 0.5 for n in (camera.width, camera.height)))
    rays = camera.unproject(np.stack([x, y], axis=-1).reshape(-1, 2) / fine)
    from_camera = pose.inverse().matrix
    origin, rays = from_camera[:3, 3], rays @ from_camera[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        away = -origin[2] / rays[:, 2]
        at = origin[:2] + away[:, None] * rays[:, :2]
    at = np.where(away[:, None] > 0, at, 10.0)
    pixels = ((at * [1, -1] + [BOARD.width / 2, BOARD.height / 2]) * dpi / 0.0254 - 0.5).astype(np.float32)
    pixels = pixels.reshape(*x.shape, 2)
    page = cv2.GaussianBlur(BOARD.image(dpi), (0, 0), 2)
    drawn = cv2.remap(page, pixels, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=110)
    drawn = cv2.resize(drawn, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.repeat(drawn[..., None], 3, axis=-1)


@pytest.mark.parametrize(
    "front",
    [
        FRONT,
        fastibl.Camera(400, 400, 140.0, 140.0, 200.0, 200.0, distortion=[0.02, -0.01, 0.0, 0.0], model="fisheye"),
        fastibl.Camera.equirectangular(1000, 500),
    ],
    ids=lambda camera: camera.model,
)
def test_rig_from_a_recording(tmp_path, capsys, front):
    away = fastibl.Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    nearer = 0.3 if front is FRONT else 0.12  # metres: wide cameras show things small
    base = fastibl.Pose.from_rotation_vector([np.pi, 0.0, 0.0], [0.0, 0.0, nearer])
    boards = base.inverse() @ FRONT_FROM_BACK @ BASE  # front board from back board
    writer = RecordingWriter(tmp_path / "film", fastibl.Rig(CAMERA, front, away), BOARD)
    for k in range(10):
        turn = [0.25 * np.sin(1.9 * k), 0.25 * np.cos(2.3 * k), 0.2 * np.sin(k)]
        pose = fastibl.Pose.from_rotation_vector(turn, [0.0, 0.0, 0.0]) @ BASE
        seen = FRONT_FROM_BACK @ pose @ boards.inverse()
        back = render(BOARD, CAMERA, pose.matrix, seed=k, fine=2)
        wide = front.model == "equirectangular"
        other = all_around(front, seen) if wide else render(BOARD, front, seen.matrix, seed=k, fine=2)
        writer.add(fastibl.Frame(0.5 * k, back, other))
    writer.close()
    rig, board = str(tmp_path / "rig.yaml"), str(tmp_path / "board.yaml")
    write_rig(rig, fastibl.Rig(CAMERA, front, away)), write_board(board, BOARD)
    arguments = ["calibrate", "rig", str(tmp_path / "film"), "--board", board, "--front-board", board, "--rig", rig]
    assert main(arguments) == 0, capsys.readouterr().err
    degrees, metres = off_by(read_rig(rig).front_from_back, FRONT_FROM_BACK)
    print(f"{capsys.readouterr().out}off by {degrees:.3f} degrees, {1000 * metres:.2f} mm")
    assert degrees < (0.05 if front is FRONT else 0.1) and metres < 0.001


def test_what_a_board_does_not_tell_stays(tmp_path):
    """Gain, vignetting and readout of a rig whose lens is measured again; of 20 pictures as many as were asked for."""
    known = CAMERA.replace(gain=2.0, vignetting=(-0.3, 0.08), readout=0.03)
    film, rig, board = tmp_path / "film", str(tmp_path / "rig.yaml"), str(tmp_path / "board.yaml")
    write_rig(rig, fastibl.Rig(known)), write_board(board, BOARD)
    with RecordingWriter(film, fastibl.Rig(known), BOARD) as writer:
        for k, picture in enumerate(board_pictures(views=VIEWS[:10])):
            writer.add(fastibl.Frame(0.1 * k, picture))
    arguments = ["calibrate", "camera", str(film), "--board", board, "--terms", "4", "--rig", rig]
    assert main([*arguments, "--most", "8"]) == 0
    back = read_rig(rig).back
    assert (back.gain, back.vignetting, back.readout) == (2.0, (-0.3, 0.08), 0.03)
    assert back.fx == pytest.approx(CAMERA.fx, rel=3e-3) and back.fx != CAMERA.fx


@pytest.mark.parametrize(
    "more, message", [(["--most", "0"], "--most must be at least 1"), (["--fisheye"], "goes with --camera front")]
)
def test_bad_options_of_a_camera(tmp_path, capsys, more, message):
    film = tmp_path / "film"
    with RecordingWriter(film, fastibl.Rig(CAMERA), BOARD) as writer:
        writer.add(fastibl.Frame(0.0, board_pictures(views=VIEWS[:1])[0]))
    assert main(["calibrate", "camera", str(film), "--rig", str(tmp_path / "rig.yaml"), *more]) != 0
    assert message in capsys.readouterr().err


def test_the_documented_distance_is_that_of_the_default_board():
    centres = {tag.id: np.mean(tag.corners, axis=0) for tag in fastibl.Board.default().tags}
    told = 0
    for path in ("docs/how-to/own-cameras.md", "python/fastibl/commands/calibrate.py"):
        for a, b, metres in re.findall(r"--measured (\d+) (\d+) ([\d.]+)", (ROOT / path).read_text()):
            told += 1
            assert float(metres) == pytest.approx(np.linalg.norm(centres[int(a)] - centres[int(b)]), rel=0.005)
    assert told == 2


def test_warnings_are_for_a_person(monkeypatch, tmp_path, capfd):
    import warnings

    from fastibl.commands import calibrate

    monkeypatch.setattr(calibrate, "_known_camera", lambda arguments: warnings.warn("the print is bent", stacklevel=2))
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        monkeypatch.setattr(warnings, "showwarning", lambda *a: print(warnings.formatwarning(*a), end=""))
        main(["calibrate", "response", str(tmp_path / "1.png"), "--exposures", "1"])
    assert "fastibl: warning: the print is bent\n" in capfd.readouterr().out


def test_errors_name_what_is_missing(tmp_path, capsys):
    rig = str(tmp_path / "rig.yaml")
    assert main(["calibrate", "camera", str(tmp_path / "none.png"), "--rig", rig]) == 2
    assert "none.png" in capsys.readouterr().err
    (picture,) = write(tmp_path / "one", [np.zeros((48, 64, 3), np.uint8)])
    assert main(["calibrate", "camera", picture, "--rig", rig]) == 2
    assert "expected at least 5" in capsys.readouterr().err
    assert main(["calibrate", "response", picture, "--exposures", "1", "--rig", rig]) == 2
    assert "rig.yaml" in capsys.readouterr().err
    write_rig(rig, fastibl.Rig(CAMERA))
    assert main(["calibrate", "rig", str(tmp_path), "--front-board", rig, "--rig", rig]) == 2
    assert "no front camera" in capsys.readouterr().err
