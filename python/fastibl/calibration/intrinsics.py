"""A camera's lens from pictures of the board."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Board, Camera, Pose, Response
from ..expected import expect
from .bundle import adjust, neighbours
from .corners import Seen, find_corners, size_of, what_is_seen

_LEAST_TAGS = 3  # in a picture, for it to count
_LEAST_PICTURES = 5
_CELLS = (8, 6)  # cells of the picture, to see which parts of the lens were looked through
_LEAST_CELLS = 0.5  # share of the cells that must have corners
_MOST_DEVIATION = 0.01  # share of the focal lengths
_MOST_RESIDUAL = 2.0  # pixels
_WORTH = 0.98  # three more terms must reduce the residual to this share of it, or they count as not told
_TILT = "tilt the board by 30 to 45 degrees to the camera, in different directions"
_HOLD = "the camera moved while its rows were taken: hold it still, or calibrate by a film"
_LEAST_TILT = 25  # degrees between the boards of two pictures, at least
_NO_FISHEYE = "no fisheye lens fits these pictures: is it one, and do they show the board at all tilts, near and far?"
_OUTLIER = 6  # times the median residual of the pictures: one beyond this is shaken or bent


@dataclass(frozen=True)
class CameraCalibration:
    """A camera, and how well it is known.

    deviations: standard deviation of fx, fy, cx, cy (pixels) and of each distortion coefficient, for corners whose
    errors are independent. Where the pictures do not tell k4, k5 and k6, these are 0 with an infinite deviation.
    residual: RMS of corners, pixels.
    pictures: indices of those used.
    poses: camera_from_marker of each.
    bend: metres between the print's lowest and highest corners, from a fit in which the print is free to bend; stretch:
    its height relative to its width (1.002: 0.2 % too high).
    moved: pixels by which corners move between the first and the last row of a picture, because of a rolling shutter,
    the median of the pictures; 0 where no motion is to be seen.
    readout: seconds from the first to the last row, and their standard deviation, where times tell it; camera has it,
    too.
    Where the pictures can tell a bent print from a flat one, or a motion from a camera at rest, everything else comes
    from the fit that includes it, and poses are those of the middle row.
    """

    camera: Camera
    deviations: dict[str, float]
    residual: float
    pictures: tuple[int, ...]
    poses: tuple[Pose, ...]
    bend: float = 0.0
    stretch: float = 1.0
    moved: float = 0.0
    readout: tuple[float, float] | None = None

    def __str__(self) -> str:
        c, d = self.camera, self.deviations
        lines = [f"{n} {getattr(c, n):9.3f} +- {d[n]:.3f} px" for n in ("fx", "fy", "cx", "cy")]
        lines += [f"{n} {v:9.5f} +- {d[n]:.5f}" for n, v in zip(list(d)[4:], c.distortion, strict=True)]
        lines.append(f"residual {self.residual:.3f} px of {len(self.pictures)} pictures")
        lines.append(f"print flat within {1000 * self.bend:.2f} mm, stretch {self.stretch:.5f}")
        if self.moved:
            lines.append(f"corners moved by {self.moved:.1f} px while the rows were taken, which the lens allows for")
        if self.readout:
            lines.append("rows taken in {:.2f} +- {:.2f} ms".format(*(1000 * t for t in self.readout)))
        return "\n".join(lines)


def calibrate_camera(
    pictures: Sequence[ArrayLike],
    board: Board,
    *,
    model: str = "perspective",
    terms: int = 5,
    response: Response | None = None,
    times: Sequence[float] | None = None,
) -> CameraCalibration:
    """Finds focal lengths, principal point and distortion from pictures of a flat board (Zhang 2000, by OpenCV).

    pictures: (h, w, 3) uint8 or uint16 RGB, of one size, showing the board at different places and tilts.
    model: "perspective", with terms = 4 (k1 k2 p1 p2), 5 (and k3) or 8 coefficients; or "fisheye", always with four.
    response: of the camera, for corners in linear light; sRGB by default.
    times: seconds, for pictures from a film, at least three in a row for each place: they tell how the camera moved
    while a rolling shutter took its rows.
    Raises ValueError where pictures show too little of the board or of the lens, or do not tell the focal length within
    1 %.
    Warns of a print that is bent or stretched, and widens the stated deviations accordingly.
    Where a camera with a rolling shutter moved, its motion is fitted with the lens: from times, or else as a separate
    motion per picture, which leaves the lens far less certain.
    """
    if model not in ("perspective", "fisheye") or terms not in (4, 5, 8):
        raise ValueError(f"expected a perspective model of 4, 5 or 8 terms or a fisheye, got {model} of {terms}")
    expect(board, Board, "board")
    if times is not None:
        times = [float(t) for t in times]
        if len(times) != len(pictures) or not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
            raise ValueError(f"times must be one of each picture, increasing, got {len(times)} of {len(pictures)}")
    width, height = size_of(pictures)
    guess = Camera(width, height, 0.9 * width, 0.9 * width, width / 2, height / 2, response=response)
    solve = _solve_fisheye if model == "fisheye" else _solve
    lens, bends = guess, model == "fisheye"
    for round_ in range(3 if bends else 2):  # corners are found again with the lens of the round before
        seen = [find_corners(p, board, lens, refine=round_ > 0 or not bends) for p in pictures]
        least = min(_LEAST_TAGS, len(board.tags))
        used = [k for k, s in enumerate(seen) if len(s.ids) >= least]
        if len(used) < _LEAST_PICTURES:
            raise ValueError(
                f"{len(used)} of {len(pictures)} pictures show {least} tag{'s' * (least > 1)} or more; expected at "
                f"least {_LEAST_PICTURES}{what_is_seen(pictures, sorted({*range(len(seen))} - {*used}), board, lens)}"
            )
        _check_views([seen[k] for k in used], (width, height))
        found = solve([seen[k] for k in used], used, (width, height), terms, response)
        lens = found.camera
    _check_tilts(found.poses)
    found, fault = _adjusted(found, seen, board, times)
    _check_fit(found, fault or (_HOLD if found.moved else _TILT))
    if fault:
        warnings.warn(f"{fault} (the lens allows for it as far as the pictures tell)", stacklevel=2)
    return found


def _adjusted(
    found: CameraCalibration, seen: Sequence[Seen], board: Board, times: Sequence[float] | None
) -> tuple[CameraCalibration, str | None]:
    """With the lens that goes with the print's shape and with the rows' motion, where pictures tell them from a flat
    print as it was said to be and from a camera at rest; and what to do about the print. seen, times: of all pictures.
    """
    if times is not None:
        told = [k for k, three in enumerate(neighbours([times[k] for k in found.pictures])) if three]
        if len(told) < _LEAST_PICTURES:
            times = None
        else:
            used = tuple(found.pictures[k] for k in told)
            found = replace(found, pictures=used, poses=tuple(found.poses[k] for k in told))
            times = [times[k] for k in used]
    seen = [seen[k] for k in found.pictures]
    names = [name for name, deviation in found.deviations.items() if np.isfinite(deviation)]
    known = (seen, found.poses, found.camera, board, len(names))
    still, moving = adjust(*known), adjust(*known, moves=True, times=times)
    moves = moving.tells_motion(still)
    if not moves:
        _check_fit(found, _TILT)  # no motion explains a bad fit
    best = moving if moves else still
    found = replace(found, bend=best.bend, stretch=best.stretch, moved=best.moved)
    fault = best.fault(board)
    if moves and not best.bent:
        best = adjust(*known, bends=False, moves=True, times=times)
    elif not best.bent:
        return found, None
    lens, old = best.lens, found.camera
    camera = Camera.from_opencv(
        np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]]),
        lens[4 : 4 + len(old.distortion)].tolist(),
        (old.width, old.height),
        response=old.response,
        model=old.model,
        readout=max(0.0, best.readout[0]) if best.readout else 0.0,
    )
    deviations = found.deviations | dict(zip(names, best.deviations.tolist(), strict=True))
    found = replace(
        found, camera=camera, deviations=deviations, residual=best.residual, poses=best.poses, readout=best.readout
    )
    return found, fault


def _check_views(seen: Sequence[Seen], size: tuple[int, int]) -> None:
    cells = set()
    for s in seen:
        at = s.pixels.reshape(-1, 2) / size * _CELLS
        cells |= set(map(tuple, np.clip(at.astype(int), 0, np.array(_CELLS) - 1)))
    share = len(cells) / (_CELLS[0] * _CELLS[1])
    if share < _LEAST_CELLS:
        raise ValueError(
            f"the board covered {share:.0%} of the picture's parts; expected {_LEAST_CELLS:.0%}: show it near, in the "
            "corners too"
        )


def _check_tilts(poses: Sequence[Pose]) -> None:
    # If all boards face the camera, a wrong focal length agrees with a wrong distance.
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    widest = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1).min())))
    if widest < _LEAST_TILT:
        raise ValueError(f"the board was turned by {widest:.0f} degrees only, expected {_LEAST_TILT}: {_TILT}")


def _check_fit(found: CameraCalibration, advice: str) -> None:
    if not found.residual <= _MOST_RESIDUAL:
        raise ValueError(
            f"corners are {found.residual:.1f} px off a {found.camera.model} lens, expected at most {_MOST_RESIDUAL}: "
            "is the board flat and the right one, are pictures sharp?"
        )
    for name in ("fx", "fy"):
        deviation = found.deviations[name] / getattr(found.camera, name)
        if not deviation <= _MOST_DEVIATION:
            raise ValueError(f"the pictures tell {name} only within {deviation:.1%}: {advice}")


def _poses(rotations: Any, translations: Any) -> tuple[Pose, ...]:
    return tuple(
        Pose.from_rotation_vector(np.ravel(r), np.ravel(t)) for r, t in zip(rotations, translations, strict=True)
    )


def _solve(
    seen: Sequence[Seen], used: Sequence[int], size: tuple[int, int], terms: int, response: Response | None
) -> CameraCalibration:
    import cv2

    flags = cv2.CALIB_FIX_K3 if terms == 4 else 0
    while True:
        points, pixels = [s.points() for s in seen], [s.opencv_pixels() for s in seen]
        found = cv2.calibrateCameraExtended(points, pixels, size, None, None, flags=flags)
        if terms == 8:  # from a start without a lens, the fit ends anywhere
            more = cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_USE_INTRINSIC_GUESS
            padded = np.pad(np.ravel(found[2])[:5], (0, 3))
            rational = cv2.calibrateCameraExtended(points, pixels, size, found[1].copy(), padded.copy(), flags=more)
            if rational[0] < _WORTH * found[0]:
                found = rational
            else:  # numerator and denominator cancel out, and their terms could be anything
                known = np.concatenate([np.ravel(found[5])[:9], np.full(3, np.inf)])
                found = (*found[:2], padded, *found[3:5], known, *found[6:])
        residual, K, lens, rotations, translations, deviations, _, by_picture = found
        good = np.ravel(by_picture) <= _OUTLIER * np.median(by_picture)
        if good.all() or good.sum() < _LEAST_PICTURES:
            break
        seen = [s for s, g in zip(seen, good, strict=True) if g]
        used = [k for k, g in zip(used, good, strict=True) if g]
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")[: 4 + terms]
    return CameraCalibration(
        Camera.from_opencv(K, np.ravel(lens)[:terms].tolist(), size, response=response),
        dict(zip(names, np.ravel(deviations)[: len(names)].tolist(), strict=True)),
        float(residual),
        tuple(used),
        _poses(rotations, translations),
    )


def _solve_fisheye(
    seen: Sequence[Seen], used: Sequence[int], size: tuple[int, int], terms: int, response: Response | None
) -> CameraCalibration:
    import cv2

    points = [s.points()[None].astype(np.float64) for s in seen]
    pixels = [s.opencv_pixels()[None].astype(np.float64) for s in seen]
    flags = _flag("CALIB_RECOMPUTE_EXTRINSIC") | _flag("CALIB_FIX_SKEW") | _flag("CALIB_USE_INTRINSIC_GUESS")
    focal = max(size) / np.pi  # focal length for a circle that sees 180 degrees
    start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    try:
        residual, K, lens, rotations, translations = cv2.fisheye.calibrate(
            points, pixels, size, start, np.zeros((4, 1)), flags=flags
        )
    except cv2.error as error:
        raise ValueError(f"{_NO_FISHEYE} ({str(error).strip().splitlines()[-1]})") from None
    if not (K[0, 0] > 0 and K[1, 1] > 0 and np.isfinite(K).all() and np.isfinite(lens).all()):
        raise ValueError(f"{_NO_FISHEYE} (the focal lengths come out as {K[0, 0]:.0f} and {K[1, 1]:.0f})")
    # OpenCV states no deviations for a fisheye: they follow from the derivative of all corners by all parameters.
    blocks = []
    for p, r, t in zip(points, rotations, translations, strict=True):
        _, j = cv2.fisheye.projectPoints(p, r, t, K, lens)
        blocks.append((j[:, :8], j[:, 8:14]))
    deviations = _deviations(blocks, float(residual))
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
    return CameraCalibration(
        Camera.from_opencv(K, np.ravel(lens).tolist(), size, response=response, model="fisheye"),
        dict(zip(names, deviations.tolist(), strict=True)),
        float(residual),
        tuple(used),
        _poses(rotations, translations),
    )


def _flag(name: str) -> int:
    """A flag of cv2.fisheye, which OpenCV 5 keeps in cv2."""
    import cv2

    return int(getattr(cv2.fisheye, name, None) or getattr(cv2, name))


def _deviations(blocks: Sequence[tuple[NDArray, NDArray]], residual: float) -> NDArray[np.float64]:
    """Deviations of the parameters that all pictures share, with each picture's pose eliminated. residual: RMS length,
    pixels."""
    information = 0.0
    for shared, own in blocks:
        within = own @ np.linalg.lstsq(own, shared, rcond=None)[0]
        information = information + shared.T @ (shared - within)
    return residual / np.sqrt(2) * np.sqrt(np.diag(np.linalg.inv(information)))
