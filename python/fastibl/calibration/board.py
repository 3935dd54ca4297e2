"""The printed board as it is: where its tags are, how flat it lies, whether the printer kept its scale."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Board, Camera
from ..expected import expect
from .bundle import FLATTEN, most_bend, smooth_bend
from .corners import Seen, find_corners, size_of, what_is_seen

_LEAST_PICTURES = 5
_MOST_SCALE = 1.1  # largest scale of a print against its stated size; "fit to page" is 3 to 6 % off
_MOST_DEVIATION = 0.001  # largest deviation of a corner's place, as a share of the board's size


@dataclass(frozen=True, eq=False)
class BoardCalibration:
    """A board, and how well it is known.

    board: Board with its tags where they were found. Its overall size is the stated one, or follows from `measured`.
    stretch: its height relative to its width (1.002: printed 0.2 % too high).
    flatness: (tags, 4) metres by which corners lie above the mean plane; deviation: standard deviation of a corner's
    place, metres.
    residual: RMS of corners in pictures, pixels.
    scale: size of the board relative to its stated size.
    """

    board: Board
    stretch: float
    flatness: NDArray[np.float64]
    deviation: float
    residual: float
    scale: float

    def __str__(self) -> str:
        bend = 1000 * float(np.ptp(self.flatness))
        return (
            f"height against width {self.stretch:.5f}, scale {self.scale:.5f}; flat within {bend:.2f} mm; corners "
            f"+- {1e6 * self.deviation:.0f} um; residual {self.residual:.3f} px"
        )


def _check_measured(measured: tuple[int, int, float], ids: Sequence[int], middles: NDArray) -> None:
    try:
        a, b, metres = measured
    except (TypeError, ValueError):
        raise ValueError(f"measured must be two tags' ids and metres between them, got {measured!r}") from None
    if a == b:
        raise ValueError(f"measured must name two tags, got {a} twice")
    if not {a, b} <= {*ids}:
        raise ValueError(f"measured must name two tags; {a} and {b} are not both on the board")
    said = float(np.linalg.norm(middles[ids.index(a)] - middles[ids.index(b)]))
    if not said / _MOST_SCALE <= metres <= said * _MOST_SCALE:
        raise ValueError(
            f"measured says {metres} m between the centres of tags {a} and {b}, but on the board they are {said:.4f} m "
            f"apart; expected {said / _MOST_SCALE:.4f} to {said * _MOST_SCALE:.4f} m: is it in metres, from centre to "
            "centre, of these tags? A print of another size is a board of its own: give its board.yaml"
        )


def calibrate_board(
    pictures: Sequence[ArrayLike], board: Board, camera: Camera, *, measured: tuple[int, int, float] | None = None
) -> BoardCalibration:
    """Finds where a printed board's tags are (Strobl and Hirzinger 2011, by OpenCV).

    pictures: (h, w, 3) uint8 or uint16 RGB of the camera's size, each showing all of the board, from different sides.
    camera: the camera found by calibrate_camera(); its lens is fitted again together with the board.
    measured: the ids of two tags and the distance of their centres in metres, measured with a ruler, within 10 % of the
    board's: pictures alone cannot tell a scale, and without it the board keeps its stated width.
    Warns of a print that is not flat (0.3 mm for the default board): a Board is flat, so poses from it are then off.
    Raises ValueError for fewer than five pictures of the whole board, unknown ids, another distance, or a board known
    worse than within 0.1 % of its size.
    """
    expect(board, Board, "board")
    expect(camera, Camera, "camera")
    size = size_of(pictures)
    if size != (camera.width, camera.height):
        raise ValueError(
            f"the pictures must be the camera's {camera.width} x {camera.height}, got {size[0]} x {size[1]}"
        )
    ids = [tag.id for tag in board.tags]
    nominal = np.array([tag.corners for tag in board.tags], np.float64)
    if measured is not None:
        _check_measured(measured, ids, nominal.mean(axis=1))
    seen = [find_corners(p, board, camera) for p in pictures]
    whole = [s for s in seen if len(s.ids) == len(ids)]
    if len(whole) < _LEAST_PICTURES:
        partly = [k for k, s in enumerate(seen) if len(s.ids) != len(ids)]
        raise ValueError(
            f"{len(whole)} of {len(pictures)} pictures show all {len(ids)} tags; expected at least {_LEAST_PICTURES}"
            f"{what_is_seen(pictures, partly, board, camera)}"
        )
    found, residual, deviation = _release(whole, ids, camera)
    found = _aligned(found.reshape(-1, 3), nominal.reshape(-1, 2)).reshape(nominal.shape[0], 4, 3)
    across, up = _extent(found, nominal)
    scale = 1 / across  # as wide as it is stated to be
    if measured is not None:
        a, b = (found[ids.index(i)].mean(axis=0) for i in measured[:2])
        scale = measured[2] / float(np.linalg.norm(a - b))
    largest = float(np.ptp(nominal.reshape(-1, 2), axis=0).max())
    if not deviation <= _MOST_DEVIATION * largest:
        raise ValueError(
            f"corners are known within {1000 * deviation:.2f} mm only; expected "
            f"{1000 * _MOST_DEVIATION * largest:.2f}: more pictures, nearer, from all sides"
        )
    bend = scale * smooth_bend(nominal.reshape(-1, 2), found[..., 2].reshape(-1))
    if bend > most_bend(board):
        warnings.warn(f"the print is bent by about {1000 * bend:.1f} mm, and is kept as flat: {FLATTEN}", stacklevel=2)
    tags = [(i, scale * found[k, :, :2]) for k, i in enumerate(ids)]
    return BoardCalibration(
        Board(tags, scale * across * board.width, scale * up * board.height, board.border_bits),
        up / across,
        scale * found[..., 2],
        scale * deviation,
        residual,
        scale * across,
    )


def _release(whole: Sequence[Seen], ids: Sequence[int], camera: Camera) -> tuple[NDArray[np.float64], float, float]:
    """The corners (tags, 4, 3), the residual, and the standard deviation of the corners' places."""
    import cv2

    order = [[s.ids.index(i) for i in ids] for s in whole]
    points = [s.points().reshape(-1, 4, 3)[o].reshape(-1, 3) for s, o in zip(whole, order, strict=True)]
    pixels = [s.opencv_pixels().reshape(-1, 4, 2)[o].reshape(-1, 2) for s, o in zip(whole, order, strict=True)]
    # A second point of the board that is held fixed, far from the first: the farther, the better conditioned.
    fixed = int(np.argmax(np.abs(points[0] - points[0][0]).sum(axis=1)))
    residual, *_, found, _, _, deviations, _ = cv2.calibrateCameraROExtended(
        points,
        pixels,
        (camera.width, camera.height),
        fixed,
        camera.opencv_matrix.copy(),
        np.array([*camera.distortion, *5 * [0.0]][:5], np.float64),
        # OpenCV 5 counts parameters wrongly where it eliminates the poses.
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | getattr(cv2, "CALIB_DISABLE_SCHUR_COMPLEMENT", 0),
    )
    return np.asarray(found, np.float64).reshape(-1, 4, 3), float(residual), float(np.median(np.ravel(deviations)))


def _aligned(found: NDArray, nominal: NDArray) -> NDArray[np.float64]:
    """The corners found, moved, turned and scaled as a whole onto the nominal plane (Umeyama 1991)."""
    to = np.pad(nominal, ((0, 0), (0, 1)))
    a, b = found - found.mean(axis=0), to - to.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    signs = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = (s * np.diag(signs)).sum() / (a**2).sum()
    return scale * a @ (u @ signs @ vt).T + to.mean(axis=0)


def _extent(found: NDArray, nominal: NDArray) -> tuple[float, float]:
    """The size found relative to the nominal size, across and up."""
    f, n = found.reshape(-1, 3)[:, :2], nominal.reshape(-1, 2)
    f, n = f - f.mean(axis=0), n - n.mean(axis=0)
    return tuple(((f * n).sum(axis=0) / (n * n).sum(axis=0)).tolist())  # type: ignore[return-value]
