"""Explains in words why a picture gives no pose of the board, or none of its corners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import Board, Camera, _grey
from .tracking import find_tags

if TYPE_CHECKING:
    from .tracking import Tracker

_FAMILY = "APRILTAG_36h11"
_DARK, _BRIGHT = 40, 250  # of 255: what a twentieth of the picture exceeds; the median
_SMALL = 20.0  # pixels along a tag's side, from where on it is read reliably
_MISFIT = 0.1  # pixels; of a flat board and the right lens 0.01
_ENLARGED = 3  # times, in which tags are found that are too small otherwise
# Families that a person may have printed, by OpenCV's names, and how many tags of them are no mistake: short codes are
# read by chance.
_OTHERS = {
    "APRILTAG_36h10": 1,
    "ARUCO_MIP_36h12": 1,
    "7X7_1000": 1,
    "6X6_1000": 1,
    "APRILTAG_25h9": 2,
    "5X5_1000": 2,
    "ARUCO_ORIGINAL": 3,
    "4X4_1000": 3,
    "APRILTAG_16h5": 3,
}

_Tags = Sequence[tuple[int, NDArray[np.float64]]]


def explain(image: ArrayLike, tracker: Tracker) -> str:
    """See Tracker.explain."""
    board, camera = tracker.board, tracker.camera
    pose = type(tracker)(board, camera, tracker.method, tracker.refine).track(image)
    if pose is not None:
        seen = [(tag.id, tag.corners) for tag in pose.tags]
        text = f"The board is seen: {_named(seen).lower()}, {_side(seen):.0f} pixels a side."
        if pose.misfit_px > _MISFIT:
            text += (
                f" Its parts lie {pose.misfit_px:.1f} pixels beside their places: the print is bent or not to scale, "
                "or the camera's calibration is another."
            )
        return text
    return why_no_pose(image, board, camera)


def why_no_pose(image: ArrayLike, board: Board, camera: Camera) -> str:
    """The explanation for a picture in which no pose was found, see Tracker.explain."""
    grey = _grey(image, camera)
    return explain_tags(grey, board) or (
        f"{seen_tags(grey, board)} are seen, but not where the board has them: is it the board that was printed, flat, "
        "and the camera calibrated for pictures of this size?"
    )


def explain_tags(grey: NDArray[np.uint8], board: Board) -> str | None:
    """What is wrong with the tags in a picture, whatever its camera; None where several of the board's tags are seen.

    grey: (height, width) uint8, encoded values.
    """
    tags = find_tags(grey, border_bits=board.border_bits, subpixel=False)
    ids = {tag.id for tag in board.tags}
    mine = [tag for tag in tags if tag[0] in ids]
    if mine:
        return _of_the_board(mine, board)
    if tags:
        return (
            f"{_named(tags)} of the family 36h11 {_are(tags)} seen, but the board has {runs(ids)}: the print and the "
            "board that is looked for are not the same."
        )
    return next(_no_tags(grey, board))


def seen_tags(grey: NDArray[np.uint8], board: Board) -> str:
    """ "Tags 0 to 3, 7": the board's tags that are seen in a picture, of which there must be some."""
    ids = {tag.id for tag in board.tags}
    return _named([tag for tag in find_tags(grey, border_bits=board.border_bits, subpixel=False) if tag[0] in ids])


def _of_the_board(mine: _Tags, board: Board) -> str | None:
    """What is wrong where tags of the board are seen."""
    twice = [id for id, count in Counter(id for id, _ in mine).items() if count > 1]
    if twice:
        return f"{_named(mine)} {_are(mine)} seen, {runs(twice)} more than once: one print alone may be in view."
    small = _side(mine)
    if small < _SMALL:
        return _too_small(mine, small)
    if len(mine) == 1:
        return (
            f"{_named(mine)} alone is seen of {len(board.tags)}, and one does not tell which way it is tilted, or its "
            "edges are blurred: let more of the board be in view."
        )
    return None


def _no_tags(grey: NDArray[np.uint8], board: Board) -> Iterator[str]:
    """What may be wrong where no tag of the family is read; the likeliest cause first."""
    border = board.border_bits
    for bits in {1, 2} - {border}:
        if tags := find_tags(grey, border_bits=bits, subpixel=False):
            yield (
                f"{_named(tags)} with a border of {bits} modules {_are(tags)} seen, but the board's have {border}: see "
                "border_bits."
            )
    if tags := find_tags(np.ascontiguousarray(grey[:, ::-1]), border_bits=border, subpixel=False):
        yield (
            f"{_named(tags)} {_are(tags)} seen in a mirror: the picture is flipped, as front cameras often do. Flip "
            "it back."
        )
    if tags := find_tags(255 - grey, border_bits=border, subpixel=False):
        yield f"{_named(tags)} {_are(tags)} seen, but white on black: print the board black on white."
    brightest = float(np.percentile(grey, 95))
    if brightest < _DARK:
        yield (
            f"The picture is too dark: 95 % of it is below {max(100 * brightest / 255, 1):.0f} % of white. More light, "
            "or a longer exposure."
        )
    if np.median(grey) >= _BRIGHT:
        yield "The picture is too bright: half of it is white. Expose it less."
    if tags := find_tags(_enlarged(grey), border_bits=border, subpixel=False):
        yield _too_small(tags, _side(tags) / _ENLARGED)
    for family, least in _OTHERS.items():
        tags = find_tags(grey, family, subpixel=False)
        if len(tags) >= least:
            yield f"{len(tags)} tags of the family {family.removeprefix('APRILTAG_')} are seen: fastibl reads 36h11."
    yield (
        f"No tag of the family 36h11 is seen. The board has {runs(tag.id for tag in board.tags)}; each must be whole, "
        "sharp, with white around it and no glare on it, and 20 pixels or more a side."
    )


def _too_small(tags: _Tags, side: float) -> str:
    return f"{_named(tags)} {_are(tags)} seen, but only {side:.0f} pixels a side: come nearer, or use a larger picture."


def _enlarged(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    import cv2  # slow to import, and not needed to import fastibl

    return cv2.resize(grey, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_CUBIC).astype(np.uint8)


def _side(tags: _Tags) -> float:
    """The length of a tag's side in pixels: the median over the tags' means."""
    return float(np.median([np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).mean() for _, quad in tags]))


def _are(tags: _Tags) -> str:
    return "is" if len({id for id, _ in tags}) == 1 else "are"


def _named(tags: _Tags) -> str:
    ids = {id for id, _ in tags}
    return f"Tag{'s' if len(ids) > 1 else ''} {runs(ids)}"


def runs(ids: Iterable[int]) -> str:
    """Such as "0 to 3, 7"."""
    runs: list[list[int]] = []
    for id in sorted(set(ids)):
        if runs and id == runs[-1][1] + 1:
            runs[-1][1] = id
        else:
            runs.append([id, id])
    return ", ".join(str(a) if a == b else f"{a} to {b}" if b > a + 1 else f"{a}, {b}" for a, b in runs)
