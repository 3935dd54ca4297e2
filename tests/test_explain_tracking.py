"""Where a picture gives no pose, Tracker.explain says what is the matter, with what to do."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import fastibl

CAMERA = fastibl.Camera(640, 480, 620, 620, 320, 240)
BOARD = fastibl.Board.default()


def page(board=BOARD, mirrored=False, inverted=False):
    image = board.image(dpi=150)
    image = image[:, ::-1] if mirrored else image
    return 255 - image if inverted else image


def view(image, distance=0.5, beside=0.0, grey=110):
    """A page on a grey table, as the camera sees it from there, tilted by 30 degrees."""
    h, w = image.shape
    down = np.diag([1.0, -1, -1])  # from above
    tilt = cv2.Rodrigues(np.array([0.5, 0, 0.1]))[0] @ down
    metres = 150 / 0.0254
    page_from_pixels = np.array([[1 / metres, 0, -w / metres / 2], [0, -1 / metres, h / metres / 2], [0, 0, 1]])
    to = CAMERA.opencv_matrix @ np.stack([tilt[:, 0], tilt[:, 1], [beside, 0, distance]], 1) @ page_from_pixels
    fine = cv2.warpPerspective(image, np.diag([4, 4, 1.0]) @ to, (2560, 1920), flags=cv2.INTER_AREA, borderValue=grey)
    return np.repeat(cv2.resize(fine, (640, 480), interpolation=cv2.INTER_AREA)[..., None], 3, -1)


def two_prints():
    left, right = view(page(), 0.8, -0.2), view(page(), 0.8, 0.2)
    return np.where(np.arange(640)[None, :, None] < 320, left, right)


def of_another_family():
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    sheet = np.full((1200, 1200), 255, np.uint8)
    for k in range(4):
        y, x = 100 + 550 * (k // 2), 100 + 550 * (k % 2)
        sheet[y : y + 400, x : x + 400] = cv2.aruco.generateImageMarker(family, k, 400)
    return view(sheet)


def board(ids=None, border_bits=1):
    """The board's tags by other ids."""
    tags = [(tag.id if ids is None else ids(tag.id), tag.corners) for tag in BOARD.tags]
    return fastibl.Board(tags, BOARD.width, BOARD.height, border_bits)


@pytest.mark.parametrize(
    ("name", "picture", "says"),
    [
        ("seen", lambda: view(page()), "The board is seen"),
        ("grey", lambda: np.full((480, 640, 3), 120, np.uint8), "No tag of the family 36h11"),
        ("black", lambda: np.zeros((480, 640, 3), np.uint8), "too dark"),
        ("dim", lambda: (view(page()) * 0.012).astype(np.uint8), "too dark"),
        ("white", lambda: np.full((480, 640, 3), 255, np.uint8), "too bright"),
        ("mirrored", lambda: view(page(mirrored=True)), "mirror"),
        ("inverted", lambda: view(page(inverted=True)), "white on black"),
        ("far", lambda: view(page(), 4.0), "come nearer"),
        ("two", two_prints, "more than once"),
        ("other ids", lambda: view(page(board(lambda id: id + 100))), "board has 0 to"),
        ("border", lambda: view(page(board(border_bits=2))), "border of 2"),
        ("family", of_another_family, "4X4_1000"),
        ("shuffled", lambda: view(page(board(lambda id: (id + 2) % len(BOARD.tags)))), "not where the board has them"),
    ],
)
def test_says_what_is_the_matter(name, picture, says):
    tracker = fastibl.Tracker(BOARD, CAMERA)
    image = np.ascontiguousarray(picture())
    text = tracker.explain(image)
    print(f"{name}: {text}")
    assert says in text
    assert (tracker.track(image) is None) == (name != "seen")


def test_tells_a_wrong_lens():
    wrong = fastibl.Camera(640, 480, 620, 620, 335, 240)
    text = fastibl.Tracker(BOARD, wrong).explain(view(page()))
    assert "beside their places" in text and "beside" not in fastibl.Tracker(BOARD, CAMERA).explain(view(page()))


def test_keeps_nothing():
    """What was tracked before does not count, and is not changed."""
    asked, other = fastibl.Tracker(BOARD, CAMERA), fastibl.Tracker(BOARD, CAMERA)
    image = view(page())
    assert asked.track(image, 1.0) == other.track(image, 1.0)
    assert "too dark" in asked.explain(np.zeros_like(image))
    assert asked.track(image, 1.1) == other.track(image, 1.1)


def test_refuses_as_track_does():
    tracker = fastibl.Tracker(BOARD, CAMERA)
    with pytest.raises(ValueError, match="640"):
        tracker.explain(np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(TypeError):
        tracker.explain(np.zeros((480, 640, 3), np.int32))
