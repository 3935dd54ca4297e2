"""Where the board is: detection by OpenCV, then refinement, pose and edge tracking by fastibl's own core."""

from __future__ import annotations

import math
import threading

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import (
    Board,
    Camera,
    DetectedTag,
    Environment,
    Pose,
    Rig,
    Tracked,
    Turned,
    _EdgeTracker,
    _grey,
    _RotationTracker,
    _track,
)
from .expected import expect
from .lighting import method_name


def detect(
    grey: NDArray[np.uint8], board: Board, camera: Camera, subpixel: bool = True
) -> tuple[list[tuple[int, NDArray[np.float64]]], Pose | None]:
    """Finds tags of family 36h11 in a grey picture, and a pose to start from: what a Session expects of a detector.

    grey: (height, width) uint8, encoded values. Returns ([(id, corners (4, 2))], camera_from_marker or None);
    corners are in pixels whose centres are at + 0.5, in the order of Tag.corners. Ids that are not on the board are
    reported too. The start pose is computed by SQPnP, not IPPE, which fails on a board seen exactly fronto-parallel.
    """
    tags = find_tags(grey, border_bits=board.border_bits, subpixel=subpixel)
    return tags, _start(tags, board, camera) if tags else None


def find_tags(
    grey: NDArray[np.uint8], family: str = "APRILTAG_36h11", border_bits: int = 1, subpixel: bool = True
) -> list[tuple[int, NDArray[np.float64]]]:
    """Finds the tags in a grey picture, in the form of detect(). family: name of one of OpenCV's dictionaries."""
    import cv2  # slow to import, and not needed to import fastibl

    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border_bits
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX if subpixel else cv2.aruco.CORNER_REFINE_NONE
    # Later versions of OpenCV shrink the refinement window to 0.3 of a module, which leaves the corners of small tags
    # at whole pixels. 3 px for modules of any size did best of the windows tried, and is the same in all versions.
    parameters.cornerRefinementWinSize = 3
    if hasattr(parameters, "relativeCornerRefinmentWinSize"):  # (sic)
        parameters.relativeCornerRefinmentWinSize = 100.0
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family}"))
    quads, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
    if ids is None:
        return []
    # OpenCV counts from the centre of the upper left pixel, fastibl from that pixel's corner.
    return [(int(i), quad[0].astype(np.float64) + 0.5) for i, quad in zip(np.ravel(ids), quads, strict=True)]


def _start(tags, board: Board, camera: Camera) -> Pose | None:
    import cv2

    on_board = {tag.id: tag.corners for tag in board.tags}
    known = [(on_board[i], corners) for i, corners in tags if i in on_board]
    if not known:
        return None
    points = np.pad(np.concatenate([p for p, _ in known]), ((0, 0), (0, 1)))
    pixels = np.concatenate([q for _, q in known]) - 0.5
    lens = np.array(camera.distortion, np.float64)
    try:
        found, rotation, translation = cv2.solvePnP(
            points, pixels, camera.opencv_matrix, lens, flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:  # degenerate points; the tracker finds starts of its own
        return None
    if not found or not np.isfinite(rotation).all() or not np.isfinite(translation).all():
        return None
    return Pose.from_rotation_vector(np.ravel(rotation), np.ravel(translation))


class Tracker:
    """Tracks a board in the pictures of one camera.

    method: "edges" (what "auto" chooses) follows the tags' edges from picture to picture, and detects tags only to
    start and to recover; "board" detects all tags anew in every picture; "frame-marker" (the paper of 2014) uses the
    largest tag alone. The last two keep nothing between pictures.
    refine: for these two, whether to measure the corners again along the tags' sides, in linear light (uses
    camera.response).
    smoothing: for "edges", time constant in seconds of a low-pass filter on the returned poses, which then lag behind a
    steady motion by that time; 0, the default, for no filter.
    gravity_in_marker: (3,) direction of down in the marker frame, used where track() is given gravity; the default is a
    board lying on a table.
    Raises ValueError for another method, a smoothing below 0, a camera that is not perspective, or a gravity_in_marker
    that is no direction.
    """

    def __init__(
        self,
        board: Board,
        camera: Camera,
        method: str = "auto",
        refine: bool = True,
        *,
        smoothing: float = 0.0,
        gravity_in_marker: ArrayLike = (0.0, 0.0, -1.0),
    ):
        expect(board, Board, "board")
        expect(camera, Camera, "camera")
        self.board, self.camera, self.refine = board, camera, bool(refine)
        self.method = method_name("tracking", method)
        if camera.model != "perspective":
            raise ValueError(f"a board is tracked with perspective cameras alone, got a camera that is {camera.model}")
        self._edges, self._lock, self._time = None, threading.Lock(), -math.inf
        if self.method in ("auto", "edges"):
            gravity = np.asarray(gravity_in_marker, np.float64)
            if not np.isfinite(gravity).all() or not gravity.any():
                raise ValueError(f"gravity_in_marker must be finite and not 0, got {str(gravity_in_marker)}")
            self._edges = _EdgeTracker(board, camera, smoothing=float(smoothing), gravity_in_marker=gravity)

    def track(
        self,
        image: ArrayLike,
        time: float | None = None,
        *,
        turn: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> Tracked | None:
        """Finds the pose of the board in one picture; None where the board is not seen.

        image: (height, width, 3) RGB, uint8 or uint16 (encoded) or float (linear), of the camera's size. time: seconds,
        not decreasing; None means 1/30 s after the last picture. If other sensors tell them, for "edges" alone and in
        the camera frame: turn, rotation vector (3,) of the camera since the last picture with a pose, as integrated by
        a gyroscope (now_from_before); gravity, (3,) downwards. Raises ValueError for another size or shape, for time
        that runs backwards and for what is not finite, TypeError for another dtype.
        """
        for name, vector in (("turn", turn), ("gravity", gravity)):
            if vector is not None and not np.isfinite(np.asarray(vector, np.float64)).all():
                raise ValueError(f"{name} must be finite, got {str(vector)}")
        with self._lock:  # pictures are tracked one after the other, whichever threads ask
            if time is not None and not (math.isfinite(time) and time >= self._time):
                raise ValueError(f"time must not run backwards: {time} s after {self._time} s")
            found = self._track(image, time, turn, gravity)
            self._time = self._time if time is None else time
            return found

    def _track(
        self, image: ArrayLike, time: float | None, turn: ArrayLike | None, gravity: ArrayLike | None
    ) -> Tracked | None:
        if self._edges is not None:
            return self._edges.track(image, time, detect, turn, gravity)
        grey = _grey(image, self.camera)
        tags, start = detect(grey, self.board, self.camera)
        return _track(tags, start, self.board, self.camera, self.method, grey if self.refine else None)

    def explain(self, image: ArrayLike) -> str:
        """Says in a sentence or two why track() finds no pose in a picture, and what to do about it.

        image: as for track(). It recognises a picture that is too dark or too bright, and tags that are not the
        board's, of another family or border, mirrored, printed white on black, too small, seen twice, not where the
        board has them, or too few to tell which way they are tilted. Where there is a pose it says what is seen. The
        picture is searched by itself, whatever came before. Takes some tenths of a second where no tag is seen. Raises
        as track() does.
        """
        from .explain_tracking import explain

        return explain(image, self)

    def reset(self) -> None:
        """Forgets the last pose: the whole next picture is searched."""
        with self._lock:
            self._time = -math.inf
            if self._edges is not None:
                self._edges.reset()

    def __repr__(self) -> str:
        return f"Tracker({self.board!r}, {self.camera!r}, method={self.method!r}, refine={self.refine})"


class RotationTracker:
    """Follows how a rig turns from what its cameras see of distant surroundings, starting from known poses.

    rig: Rig, or a Camera for its back camera alone. Options, all keyword: acceleration (rad/s^2, standard deviation of
    a hand's motion), largest_error (degrees of stated deviation beyond which there is no result), largest_residual and
    least_agreeing (limits on those values of Turned), longest_gap (seconds without a result after which the rotation is
    lost until the next start), wander (metres per square root of a second that the camera's place is assumed to change
    unseen), sure (degrees; pictures less sure than this give nothing to follow later), and for a gyroscope's turns
    gyro_noise (rad per square root of a second by which they drift) and gyro_scale (share by which they are too long or
    too short). Raises ValueError for options out of range, TypeError for others.
    """

    _OPTIONS = (
        "acceleration",
        "largest_error",
        "largest_residual",
        "least_agreeing",
        "longest_gap",
        "wander",
        "sure",
        "gyro_noise",
        "gyro_scale",
    )

    def __init__(self, rig: Rig | Camera, **options: float):
        unknown = sorted(set(options) - set(self._OPTIONS))
        if unknown:
            raise TypeError(f"expected options of {', '.join(self._OPTIONS)}, got {', '.join(unknown)}")
        self._core, self._lock = (
            _RotationTracker(Rig(rig) if isinstance(rig, Camera) else rig, options),
            threading.Lock(),
        )

    def start(
        self,
        back_from_marker: Pose | ArrayLike,
        time: float,
        back: ArrayLike | None = None,
        front: ArrayLike | None = None,
        back_exposure: float = 1.0,
        front_exposure: float = 1.0,
    ) -> None:
        """Takes a known pose and, if given, the pictures at that time. time: seconds, not decreasing."""
        with self._lock:
            self._core.start(back_from_marker, time, back, front, back_exposure, front_exposure)

    def track(
        self,
        environment: Environment,
        time: float,
        back: ArrayLike | None = None,
        front: ArrayLike | None = None,
        back_exposure: float = 1.0,
        front_exposure: float = 1.0,
        *,
        turn: ArrayLike | None = None,
    ) -> Turned | None:
        """The pose under which the pictures agree with what was seen before and with the map, or None.

        environment: the map as it was before these pictures were added. turn: rotation vector (3,) of the back camera
        since the last call, as integrated by a gyroscope; what the pictures do not tell rests on it alone. Raises
        ValueError for pictures of another size, exposures that are not positive, time that runs backwards, or a turn
        that is not finite; TypeError for other dtypes.
        """
        with self._lock:
            step = None if turn is None else [float(x) for x in np.asarray(turn, np.float64).reshape(3)]
            return self._core.track(environment, back, front, back_exposure, front_exposure, time, step)

    def reset(self) -> None:
        """Forgets the rotation."""
        with self._lock:
            self._core.reset()

    @property
    def following(self) -> bool:
        """Whether there is a known rotation to continue from."""
        return self._core.following


__all__ = ["DetectedTag", "RotationTracker", "Tracked", "Tracker", "Turned", "detect"]
