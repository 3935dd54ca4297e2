"""The printed board: layout, drawing at true size, and agreement of what is drawn with what is detected."""

import builtins
import copy
import errno
import pickle
import re
import zlib

import cv2
import numpy as np
import pytest
from board_pictures import look_at, project_tag, render, rotation_error_degrees, vga

import fastibl
from fastibl.__main__ import main
from fastibl.board import tag_modules
from fastibl.recording import read_board, write_board
from fastibl.tracking import detect

BOARDS = {
    "default": fastibl.Board.default(),
    "grid": fastibl.Board.grid(3, 4, 0.03, 0.01),
    "two bits": fastibl.Board.grid(2, 3, 0.05, 0.02, border_bits=2),
    "kalibr": fastibl.Board.kalibr(4, 3, 0.04, 0.3),
}


@pytest.fixture(params=BOARDS)
def board(request):
    return BOARDS[request.param]


@pytest.mark.parametrize(
    "corners",
    [
        [(-1, -1), (1, -1), (1, 1), (-1, 1)],  # AprilTag's own order
        [(0, 0)] * 4,
        [(-1, 0), (0, 0), (1, 0), (2, 0)],
        [(-1, 1), (1, -1), (1, 1), (-1, -1)],
    ],
)
def test_tags_that_no_picture_can_show_are_refused(corners):
    with pytest.raises(ValueError, match="clockwise around an area, from the upper left"):
        fastibl.Board([(3, 0.02 * np.array(corners, float))], 0.1, 0.1)


def test_grid_counts_from_the_top_and_kalibr_from_the_bottom():
    grid = fastibl.Board.grid(3, 4, 0.03, 0.01)
    centre = {tag.id: tag.corners.mean(0) for tag in grid.tags}
    assert np.allclose(centre[0], [-0.06, 0.04]) and np.allclose(centre[1] - centre[0], [0.04, 0])
    assert np.allclose(centre[4] - centre[0], [0, -0.04])
    assert np.allclose(
        grid.tags[0].corners - centre[0], [[-0.015, 0.015], [0.015, 0.015], [0.015, -0.015], [-0.015, -0.015]]
    )
    kalibr = fastibl.Board.kalibr(3, 4, 0.1, 0.3)
    centre = {tag.id: tag.corners.mean(0) for tag in kalibr.tags}
    assert [tag.id for tag in kalibr.tags] == list(range(12)) and kalibr.border_bits == 2
    assert np.allclose(centre[0], [-0.195, -0.13]) and np.allclose(centre[4] - centre[0], [0, 0.13])
    # Turned by half a turn against OpenCV's dictionary: its first corner is the lower right one.
    assert np.allclose(kalibr.tags[0].corners[0] - centre[0], [0.05, -0.05])


def test_no_tag_leaves_the_page_or_touches_another(board):
    boxes = []
    for tag in board.tags:
        low, high = tag.corners.min(0), tag.corners.max(0)
        assert (np.abs([low, high]) < [board.width / 2, board.height / 2]).all()
        module = (high - low)[0] / (6 + 2 * board.border_bits)
        assert all((low - module > h).any() or (high + module < l).any() for l, h in boxes), tag
        boxes.append((low, high))


def test_drawn_corners_are_where_the_detector_reads_them(board):
    dpi = 120
    page = board.image(dpi)
    assert page.dtype == np.uint8
    assert page.shape == (round(board.height * dpi / 0.0254), round(board.width * dpi / 0.0254))
    scale = dpi / 0.0254
    camera = fastibl.Camera(page.shape[1], page.shape[0], 1000.0, 1000.0, page.shape[1] / 2, page.shape[0] / 2)
    found = dict(detect(page, board, camera)[0])
    assert sorted(found) == [tag.id for tag in sorted(board.tags, key=lambda tag: tag.id)]
    for tag in board.tags:
        expected = np.array([board.width / 2, board.height / 2]) * scale + tag.corners * [scale, -scale]
        assert np.abs(found[tag.id] - expected).max() < 1.0, tag


def test_ink_is_exact_and_scales_with_dpi(board):
    """The page's black area is that of the modules, at any resolution: edges carry coverage."""
    expected = sum(
        tag_modules(tag.id, board.border_bits).mean() * np.ptp(tag.corners, axis=0).prod() for tag in board.tags
    )
    for dpi in (47, 100, 211.5):
        page = board.image(dpi).astype(float)
        ink = 0.0
        for tag in board.tags:  # around the tags only: the caption is ink too
            centre = (tag.corners.mean(0) * [1, -1] + np.array([board.width, board.height]) / 2) * dpi / 0.0254
            half = (np.ptp(tag.corners, axis=0) / 2 * dpi / 0.0254) + 1
            low, high = np.floor(centre - half).astype(int), np.ceil(centre + half).astype(int)
            ink += (255 - page[low[1] : high[1], low[0] : high[0]]).sum() / 255
        assert ink * (0.0254 / dpi) ** 2 == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("turn_degrees", [90, 180, 270, 30])
def test_turned_tags_are_drawn_turned(turn_degrees):
    a = np.radians(turn_degrees)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    square = np.array([[-0.02, 0.02], [0.02, 0.02], [0.02, -0.02], [-0.02, -0.02]]) @ turn.T + [0.005, -0.004]
    board = fastibl.Board([(7, square)], width=0.1, height=0.08)
    page = board.image(150)
    camera = fastibl.Camera(page.shape[1], page.shape[0], 500.0, 500.0, page.shape[1] / 2, page.shape[0] / 2)
    ((id, corners),), _ = detect(page, board, camera)
    scale = 150 / 0.0254
    assert id == 7
    assert np.abs(corners - (np.array([0.05, 0.04]) + square * [1, -1]) * scale).max() < 1.0


def test_equality_repr_copy_pickle(board):
    for other in (copy.copy(board), copy.deepcopy(board), pickle.loads(pickle.dumps(board))):
        assert other == board and other is not board
    assert f"{len(board.tags)} tags" in repr(board)
    assert board != fastibl.Board.grid(2, 2, 0.03, 0.01)
    assert board.tags[0] == pickle.loads(pickle.dumps(board)).tags[0]
    rebuilt = fastibl.Board([(t.id, t.corners) for t in board.tags], board.width, board.height, board.border_bits)
    assert rebuilt == board


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fastibl.Board.grid(0, 4, 0.03, 0.01), "1 × 1"),
        (lambda: fastibl.Board.grid(3, 4, 0.0, 0.01), "tag size"),
        (lambda: fastibl.Board.grid(3, 4, 0.03, float("nan")), "spacing"),
        (lambda: fastibl.Board.grid(3, 4, 0.03, 0.01, 3), "border_bits"),
        (lambda: fastibl.Board.grid(30, 40, 0.03, 0.01), "at most 587 tags, got 30 × 40"),
        (lambda: fastibl.Board.kalibr(6, 6, 0.08, 0.0), "spacing ratio"),
        (lambda: fastibl.Board([], 0.1, 0.1), "at least one tag"),
        (lambda: fastibl.Board([(0, np.zeros((4, 3)))], 0.1, 0.1), r"\(4, 2\)"),
        (lambda: fastibl.Board([(0, np.zeros((4, 2))), (0, np.zeros((4, 2)))], 0.1, 0.1), "twice"),
        (lambda: fastibl.Board([(587, np.zeros((4, 2)))], 0.1, 0.1), "587"),
        (lambda: fastibl.Board([(0, np.full((4, 2), np.inf))], 0.1, 0.1), "not finite"),
        (lambda: fastibl.Board([(0, np.zeros((4, 2)))], 0.1, 0.0), "page"),
        (lambda: fastibl.Board.default().image(0), "dpi"),
        (lambda: fastibl.Board.default().save("board.gif"), "board.gif"),
    ],
)
def test_bad_boards_are_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_tag_must_be_a_pair():
    with pytest.raises(TypeError, match="id, corners"):
        fastibl.Board([5], 0.1, 0.1)


def test_png_says_its_true_size(board, tmp_path):
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / "board.png"
    board.save(path, dpi=200)
    with image.open(path) as png:
        assert np.allclose(png.info["dpi"], 200, rtol=1e-3)
        metres = np.array(png.size) / png.info["dpi"][0] * 0.0254
        assert np.allclose(metres, [board.width, board.height], atol=1e-4)
        assert (np.asarray(png) == board.image(200)).all()
    assert (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) == board.image(200)).all()


def no_room(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_pdf_is_vectors_at_true_size(board, tmp_path, monkeypatch):
    pytest.importorskip("reportlab")
    path = tmp_path / "board.pdf"
    board.save(str(path))
    data = path.read_bytes()
    with monkeypatch.context() as full:
        full.setattr("pathlib.Path.write_bytes", no_room)
        with pytest.raises(OSError, match="No space"):
            fastibl.Board.default().save(path)
    assert path.read_bytes() == data and list(tmp_path.iterdir()) == [path]
    box = re.search(rb"/MediaBox \[ ([\d. ]+) \]", data)
    assert np.allclose(
        [float(v) for v in box[1].split()[2:]], np.array([board.width, board.height]) / 0.0254 * 72, atol=0.01
    )
    assert b"/Subtype /Image" not in data
    content = _content(data)
    # Rasterise the paths by hand: they are the tags of the picture.
    dpi, ink = 100, 0
    page = np.full(board.image(dpi).shape, 255, np.uint8)
    for path in re.findall(r"((?:[\d.-]+ [\d.-]+ [ml]\s+)+h)", content):
        points = np.array([[float(v) for v in p] for p in re.findall(r"([\d.-]+) ([\d.-]+) [ml]", path)]) / 72 * dpi
        points[:, 1] = board.height / 0.0254 * dpi - points[:, 1]
        cv2.fillPoly(page, [np.rint((points - 0.5) * 16).astype(np.int32)], 0, shift=4)
        ink += 1
    assert ink > len(board.tags)
    camera = fastibl.Camera(page.shape[1], page.shape[0], 1000.0, 1000.0, page.shape[1] / 2, page.shape[0] / 2)
    drawn, found = dict(detect(board.image(dpi), board, camera)[0]), dict(detect(page, board, camera)[0])
    assert sorted(found) == sorted(drawn)
    assert max(np.abs(found[i] - drawn[i]).max() for i in found) < 1.5


def _content(data):
    import base64

    stream = re.search(rb"stream\r?\n(.*?)endstream", data, re.S)[1].strip()
    if stream.endswith(b"~>"):
        stream = base64.a85decode(stream[:-2])
    return zlib.decompress(stream).decode("latin-1")


def test_the_caption_states_a_true_line(tmp_path):
    pytest.importorskip("reportlab")
    path = tmp_path / "board.pdf"
    fastibl.Board.default().save(path)
    content = _content(path.read_bytes())
    assert "this line is 100 mm" in content and "ids 0-26" in content
    lines = re.findall(r"([\d.]+) ([\d.]+) m ([\d.]+) ([\d.]+) l S", content)
    longest = max(abs(float(x1) - float(x0)) for x0, _, x1, _ in lines)
    assert longest / 72 * 25.4 == pytest.approx(100, abs=0.01)


def test_the_check_line_is_printed():
    """Printers leave some 4 to 6 mm at the edges white; the tags need one module of white around them."""
    for board, least in ((fastibl.Board.default(), 5.95), (fastibl.Board.grid(3, 4, 0.04, 0.012), 5.95)):
        dpi = 600
        page = board.image(dpi)
        scale = dpi / 25.4  # pixels a mm
        lowest = max(board.height / 2 - tag.corners[:, 1].min() for tag in board.tags) * 1000
        module = min(np.ptp(tag.corners[:, 0]) for tag in board.tags) * 1000 / 8
        row = int(lowest * scale) + 2
        below = page[row:, : round((0.05 * board.width + 0.048) * 1000 * scale)] < 128  # the line, beside the text
        longest = row + int(np.argmax(below.sum(axis=1)))
        first = row + int(np.argmax(below.any(axis=1)))
        print(f"line {1000 * board.height - longest / scale:.2f} mm above the edge")
        assert 1000 * board.height - longest / scale >= least
        assert first / scale - lowest >= module - 0.05


def test_a_board_that_other_commands_can_use(tmp_path, capsys):
    page, listed = tmp_path / "board.png", tmp_path / "board.yaml"
    assert main(["board", str(page)]) == 0 and not listed.exists()
    assert "100 %" in capsys.readouterr().out
    assert main(["board", "--grid", "3x4", "--tag-size", "0.03", "--spacing", "0.01", str(page)]) == 0
    assert read_board(listed) == BOARDS["grid"] and f"--board {listed}" in capsys.readouterr().out
    assert main(["board", "--kalibr", "4x3", str(tmp_path / "april.png")]) == 0
    assert read_board(tmp_path / "april.yaml") == BOARDS["kalibr"]
    assert main(["board", "--paper", "letter", str(tmp_path / "letter.png")]) == 0
    letter = read_board(tmp_path / "letter.yaml")
    assert letter.tags == fastibl.Board.default().tags and (letter.width, letter.height) == (0.2794, 0.2159)
    assert main(["board", "--paper", "a4", str(tmp_path / "a4.png")]) == 0 and not (tmp_path / "a4.yaml").exists()


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--grid", "4x6", "--tag-size", "40", "--spacing", "12"], "sizes are in metres, 40 mm are 0.04"),
        (["--kalibr", "6x6", "--tag-size", "88"], "sizes are in metres"),
        (["--grid", "3"], "--grid must be ROWSxCOLUMNS, as 3x5, got '3'"),
        (["--kalibr", "axb"], "--kalibr must be ROWSxCOLUMNS"),
        (["--spacing", "0.01"], "go with --grid"),
        (["--kalibr", "3x4", "--border-bits", "1"], "go with --grid"),
        (["--grid", "3x4", "--spacing-ratio", "0.3"], "goes with --kalibr"),
        (["--grid", "3x4", "--paper", "letter"], "--paper goes with the default board"),
        (["--grid", "3x5"], "holds another board"),
    ],
)
def test_boards_that_are_not_written(tmp_path, capsys, arguments, message):
    page = tmp_path / "board.png"
    write_board(tmp_path / "board.yaml", BOARDS["grid"])
    assert main(["board", *arguments, str(page)]) == 2
    assert message in capsys.readouterr().err and not page.exists()
    assert read_board(tmp_path / "board.yaml") == BOARDS["grid"]


def test_pdf_without_reportlab_says_what_to_install(monkeypatch, tmp_path):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("reportlab"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"pip install reportlab"):
        fastibl.Board.default().save(tmp_path / "board.pdf")


def test_the_test_renderer_agrees_with_the_cameras_projection():
    """A dark tag lies where project() says: ties the tests' renderer to the conventions."""
    board, camera = fastibl.Board.grid(1, 1, 0.1, 0.05), vga()
    pose = look_at(30, 0.5, 70, 10)
    assert rotation_error_degrees(pose, pose) == pytest.approx(0, abs=1e-6)
    picture = render(board, camera, pose, noise=0, blur=0, encode=lambda x: x)[..., 0] / 255
    corners = project_tag(board.tags[0], camera, pose)
    area = 0.5 * abs(
        np.dot(corners[:, 0], np.roll(corners[:, 1], 1)) - np.dot(corners[:, 1], np.roll(corners[:, 0], 1))
    )
    mask = np.zeros(picture.shape, np.uint8)
    grown = corners + 6 * (corners - corners.mean(0)) / np.linalg.norm(corners - corners.mean(0), axis=1)[:, None]
    cv2.fillPoly(mask, [np.rint(grown - 0.5).astype(np.int32)], 1)
    share = tag_modules(0).mean()
    dark = ((0.85 - picture) / (0.85 - 0.04))[mask > 0].sum()
    assert dark / area == pytest.approx(share, rel=0.03)


def test_a_picture_that_is_too_large_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"save a \.pdf"):
        fastibl.Board.grid(4, 6, 2.0, 0.5).save(tmp_path / "board.png")
    assert not (tmp_path / "board.png").exists()
