"""Photographs of a board: the lens, the side up, and an object in them. Truth: the simulator's camera and map."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_pictures import held

import fastibl
from fastibl.__main__ import main
from fastibl.calibration import guess_camera
from fastibl.calibration.guess import LensSearch
from fastibl.guessed_rig import degrees_across, guessed_camera
from fastibl.photographs import Photographs

BOARD = fastibl.Board.default()
CAMERA = guessed_camera((640, 480), 52.0)


def picture(tilt, turn=0.0, seed=0):
    """RGB of the board from so many degrees off its middle, and the true map."""
    t, a = np.radians(tilt), np.radians(turn)
    eye = 0.5 * np.array([np.sin(t) * np.sin(a), -np.sin(t) * np.cos(a), np.cos(t)])
    pose = fastibl.Pose.look_at(eye=eye, target=(0.01, 0.02, 0.0))
    film = fastibl.simulate(
        seconds=0.1, fps=10, rig=fastibl.Rig(CAMERA), path=lambda _: pose, hand=False, lamp=False, seed=seed
    )
    return film[0].back, film.truth.environment(0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three photographs, and the map of their place."""
    path = tmp_path_factory.mktemp("photographs")
    for k in range(3):
        rgb, cube = picture(50, 40 * k, k)
        cv2.imwrite(str(path / f"{k}.png"), rgb[..., ::-1])
    fastibl.write_environment(path / "room.hdr", cube)
    return path


def test_the_board_shows_the_focal_length():
    """At a tilt; from above, the usual one counts, and the deviation says so."""
    stated = {}
    for tilt in (50, 1):
        found, stated[tilt] = guess_camera([picture(tilt)[0]], BOARD)
        off = abs(np.log(found.fx / CAMERA.fx))
        print(f"{tilt} degrees: off by {off:.4f}, stated {stated[tilt]:.4f}")
        assert off < 2 * stated[tilt] and found.fx == found.fy and (found.cx, found.cy) == (320, 240)
    assert stated[50] < 0.02 and 0.08 < stated[1] <= 0.12


@pytest.mark.parametrize("size", [(640, 480), (480, 640)])
def test_the_usual_lens_is_that_of_a_telephone_however_it_is_held(size):
    camera, _ = guess_camera([np.full((size[1], size[0], 3), 90, np.uint8)], BOARD)
    assert camera.fx == pytest.approx(320 / np.tan(np.radians(32.5))) and (camera.width, camera.height) == size
    assert degrees_across(camera) == pytest.approx(65)


def test_several_photographs_are_as_good_as_their_best():
    both = guess_camera([picture(1)[0], picture(50)[0]], BOARD)
    assert both[1] < 0.02 and abs(np.log(both[0].fx / CAMERA.fx)) < 2 * both[1]


def test_a_lens_that_nothing_tells_is_the_usual_one():
    blank = np.full((480, 640, 3), 90, np.uint8)
    found, deviation = guess_camera([blank], BOARD, degrees=70)
    assert found.fx == pytest.approx(320 / np.tan(np.radians(35))) and deviation == pytest.approx(0.12)
    with pytest.raises(ValueError, match="one size"):
        guess_camera([blank, blank[:, :-1]], BOARD)
    with pytest.raises(ValueError, match="5 to 150"):
        guess_camera([blank], BOARD, degrees=170)


def test_the_lens_of_a_camera_in_use():
    """From three views at a tilt; from above, none counts, and a view that was there only counts again later."""
    usual = guessed_camera((640, 480))
    search, tracker = LensSearch(usual, BOARD), fastibl.Tracker(BOARD, usual)
    views = [(3, 0), (45, 0), (45, 0), (50, 60), (40, -60)]
    for k, (tilt, turn) in enumerate(views):
        rgb = picture(tilt, turn, k)[0]
        found = search.add(rgb, tracker.track(rgb).camera_from_marker, 0.2 * k)
        assert (found is None) == (k < 4)
    camera, deviation = found
    print(f"off by {abs(camera.fx / CAMERA.fx - 1):.4f}, stated {deviation:.4f}; before {usual.fx / CAMERA.fx - 1:.2f}")
    assert abs(camera.fx / CAMERA.fx - 1) < 2 * deviation < 0.04
    again = LensSearch(usual, BOARD)
    found = [again.add(rgb, tracker.track(rgb).camera_from_marker, float(time)) for time in (0.0, 0.5, 1.1, 2.2)]
    assert [f is None for f in found] == [True, True, True, False]
    never, pose = LensSearch(usual, BOARD, enough=0.0), tracker.track(rgb).camera_from_marker
    views = [never.add(rgb, pose, 2.0 * k) for k in range(LensSearch._TRIES + 2)]
    assert not any(views) and never._tried == LensSearch._TRIES and never.best()[1] < 0.03


def test_photographs_stand_upright_unless_the_lens_is_the_sensors(tmp_path):
    jpeg = cv2.imencode(".jpg", picture(50)[0][..., ::-1])[1].tobytes()
    (tmp_path / "held.jpg").write_bytes(held(jpeg, 6))
    turned = Photographs([tmp_path / "held.jpg"], BOARD)
    assert next(iter(turned)).back.shape == (640, 480, 3) and turned.rig.back.width == 480
    assert turned.rig.back.fx == pytest.approx(CAMERA.fx, rel=0.04)
    given = Photographs([tmp_path / "held.jpg"], BOARD, fastibl.Rig(CAMERA))
    assert next(iter(given)).back.shape == (480, 640, 3) and given.lens_deviation is None
    np.testing.assert_array_equal(np.rot90(next(iter(given)).back, -1), next(iter(turned)).back)


def drawn(path, k):
    """The picture that was written, and where it is not the photograph's."""
    made = cv2.imread(str(path)).astype(int)
    return made, np.abs(made - k.astype(int)).max(-1) > 12


def test_an_object_in_one_photograph(folder, tmp_path, capsys):
    """As with the true camera, but for what two percent of focal length do."""
    out = tmp_path / "made.png"
    arguments = ["render", str(folder / "0.png"), "--environment", str(folder / "room.hdr"), "--height", "0.12"]
    assert main([*arguments, "--out", str(out)]) == 0
    assert "that the lens is 5" in capsys.readouterr().out
    photograph = cv2.imread(str(folder / "0.png"))
    made, changed = drawn(out, photograph)
    mesh = fastibl.stand(fastibl.shapes.figurine(), height=0.12)
    scene = fastibl.Scene(mesh, fastibl.Material([0.7] * 3, [0.1] * 3, 64))
    cube = fastibl.read_environment(folder / "room.hdr")
    session = fastibl.Session(scene, fastibl.Rig(CAMERA), BOARD, cube)
    right = session.process(fastibl.Frame(0.0, photograph[..., ::-1].copy(), back_exposure=None)).image[..., ::-1]
    as_it_is = np.abs(right.astype(int) - photograph.astype(int)).max(-1) > 12
    shared = (changed & as_it_is).sum() / (changed | as_it_is).sum()
    both = changed & as_it_is
    ratio = made[both].mean() / right[both].mean()
    print(f"pixels in common {shared:.3f}, brightness {ratio:.3f}")
    assert shared > 0.9 and 0.97 < ratio < 1.03 and 0.005 < changed.mean() < 0.2


def test_several_photographs_go_into_a_folder(folder, tmp_path, capsys):
    """Lit by what they show together; one without a board is named and left out."""
    blank = tmp_path / "blank.png"
    cv2.imwrite(str(blank), np.full((480, 640, 3), 90, np.uint8))
    out, layers = tmp_path / "out", []
    if pytest.importorskip("OpenEXR"):
        layers = ["--layers", str(tmp_path / "layers")]
    paths = [str(folder / "0.png"), str(blank), str(folder / "2.png")]
    assert main(["render", *paths, "--out", str(out), *layers]) == 0
    said = capsys.readouterr().out
    assert "blank.png: the board is not seen" in said and "predicted error" in said
    assert sorted(p.name for p in out.iterdir()) == ["0.png", "2.png"]
    for name in ("0.png", "2.png"):
        assert drawn(out / name, cv2.imread(str(folder / name)))[1].mean() > 0.002
    assert len(list((tmp_path / "layers").iterdir())) == 3


def test_a_calibrated_camera(folder, tmp_path, capsys):
    fastibl.recording.write_rig(tmp_path / "rig.yaml", fastibl.Rig(CAMERA))
    fastibl.recording.write_board(tmp_path / "board.yaml", BOARD)
    out = tmp_path / "made.jpg"
    arguments = ["render", str(folder / "0.png"), "--environment", str(folder / "room.hdr"), "--out", str(out)]
    assert main([*arguments, "--rig", str(tmp_path / "rig.yaml"), "--board", str(tmp_path / "board.yaml")]) == 0
    assert "lens is" not in capsys.readouterr().out and cv2.imread(str(out)).shape == (480, 640, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["0.png", "--out", "0.png"], "is a photograph that is read"),
        (["0.png", "--out", "made.webm"], r"must end in \.png"),
        (["0.png", "--rig", "rig.yaml", "--fov", "60"], "--fov is of a lens"),
        (["0.png", "--fov", "200"], "5 to 150"),
        (["0.png", "other/0.png", "--out", "out"], "names of their own"),
        (["blank.png"], "the board is not seen"),
        (["room.hdr"], "room.hdr"),
        (["0.png", "other"], "one recording, or photographs"),
        (["nowhere.jpg"], "nowhere.jpg"),
    ],
)
def test_what_cannot_be_done_is_said(folder, tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    cv2.imwrite("blank.png", np.full((480, 640, 3), 90, np.uint8))
    for path in (tmp_path / "0.png", tmp_path / "other" / "0.png"):
        path.write_bytes((folder / "0.png").read_bytes())
    (tmp_path / "room.hdr").write_bytes(b"no picture")
    before = sorted(p.name for p in tmp_path.rglob("*") if p.is_file())
    assert main(["render", *options]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert sorted(p.name for p in tmp_path.rglob("*") if p.is_file()) == before, "nothing is written"


def test_options_of_photographs_are_refused_with_a_recording(tmp_path, capsys):
    assert main(["render", str(tmp_path), "--fov", "60"]) == 2
    assert "--fov is of photographs" in capsys.readouterr().err


def test_without_a_path():
    with pytest.raises(ValueError, match="a photograph is needed"):
        Photographs([], BOARD)


@pytest.mark.parametrize("path", ["table.jpg", Path("table.jpg")])
def test_one_path_alone_is_no_list(path):
    with pytest.raises(TypeError, match=r"a list of photographs, as \['table.jpg'\]"):
        Photographs(path, BOARD)
