"""Tracking: poses at the limits of what shows a board, hands over the lens, glossy paper, long runs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np

from .._fastibl import Board, Camera, Pose, Response, Tracked
from ..tracking import Tracker
from .case import Case, Outcome, both, refused

CAMERA = Camera(320, 240, 280.0, 280.0, 160.0, 120.0)
# Expected are the largest error in degrees, and whether there must be a pose; the other poses may be None.
POSES: dict[str, tuple[dict[str, Any], float, bool]] = {
    "head-on": (dict(tilt_degrees=0, distance=0.4), 0.3, True),
    "nearly head-on": (dict(tilt_degrees=0.01, distance=0.4), 0.3, True),
    "45 degrees": (dict(tilt_degrees=45, distance=0.4, azimuth_degrees=30), 0.3, True),
    "75 degrees": (dict(tilt_degrees=75, distance=0.35), 1.0, False),
    "85 degrees": (dict(tilt_degrees=85, distance=0.35), 3.0, False),
    "edge-on": (dict(tilt_degrees=89.9, distance=0.35), 3.0, False),
    "from behind": (dict(tilt_degrees=120, distance=0.35), 0.0, False),
    "6 cm away": (dict(tilt_degrees=20, distance=0.06), 1.0, False),
    "2 m away": (dict(tilt_degrees=30, distance=2.0), 3.0, False),
    "10 m away": (dict(tilt_degrees=30, distance=10.0), 3.0, False),
    "turned by 180 degrees": (dict(tilt_degrees=30, distance=0.4, roll_degrees=180), 0.3, True),
    "turned by 90 degrees": (dict(tilt_degrees=30, distance=0.4, roll_degrees=90), 0.3, True),
    "at the picture's corner": (dict(tilt_degrees=30, distance=0.4, aim=(0.12, 0.09)), 0.5, False),
}
METHODS = ("edges", "board", "frame-marker")


def cases() -> Iterator[Case]:
    for name, (view, most, must) in POSES.items():
        for method in METHODS:
            wanted = must and method != "frame-marker"
            yield Case(
                "tracking",
                f"{name}, {method}",
                (f"a pose within {most:g} degrees" if wanted else f"None, or a pose within {most:g} degrees")
                + ", or flagged ambiguous",
                partial(_pose, view, method, most, wanted),
            )
    for name in PICTURES:
        yield Case("tracking", f"picture: {name}", PICTURES[name][1], partial(_picture, name))
    for exposure in (1e-4, 1e-2, 0.1, 3.0, 30.0):
        yield Case(
            "tracking",
            f"exposed {exposure:g} times",
            "None, or a pose within 1 degree",
            partial(_exposed, exposure),
        )
    yield Case("tracking", "a board on a wall, gravity known", "the pose of the wall, not its mirror", _on_a_wall)
    yield Case("tracking", "exposures 20 stops apart in turn", "poses of the good pictures, none of the black", _stops)
    yield Case(
        "tracking", "1000 frames, still", "no drift: the pose at the end that of the beginning", _long_still, long=True
    )
    yield Case("tracking", "1000 frames, moving to and fro", "no drift, lost in none", _long_moving, long=True)
    yield Case(
        "tracking", "another picture in every frame", "None, or the pose in the picture: never an old one", _jumps
    )
    for what, arguments in (
        ("a picture of another size", dict(shape=(100, 320, 3))),
        ("one channel", dict(shape=(240, 320))),
        ("four channels", dict(shape=(240, 320, 4))),
        ("an empty picture", dict(shape=(0, 0, 3))),
        ("32-bit integers", dict(shape=(240, 320, 3), dtype=np.int32)),
    ):
        yield Case("tracking", what, "ValueError or TypeError", partial(_bad_picture, **arguments))
    for what, call in (
        ("a board without tags", lambda: Board([], 0.2, 0.2)),
        ("a tag of NaN", lambda: Board([(0, np.full((4, 2), np.nan))], 0.2, 0.2)),
        ("id 587", lambda: Board([(587, _corners())], 0.2, 0.2)),
        ("an id twice", lambda: Board([(1, _corners()), (1, _corners())], 0.2, 0.2)),
        ("a board of width 0", lambda: Board([(1, _corners())], 0.0, 0.2)),
        ("a grid of 0 rows", lambda: Board.grid(0, 2, 0.03, 0.01)),
        ("a grid of 1000 tags", lambda: Board.grid(25, 40, 0.03, 0.01)),
        ("tags of size NaN", lambda: Board.grid(2, 2, np.nan, 0.01)),
        ("tags of size -1", lambda: Board.grid(2, 2, -1.0, 0.01)),
        ("a camera of focal length 0", lambda: Camera(10, 10, 0, 1, 5, 5)),
        ("a camera of focal length NaN", lambda: Camera(10, 10, np.nan, 1, 5, 5)),
        ("a camera of focal length 1e300", lambda: Camera(10, 10, 1e300, 1e300, 5, 5)),
        ("a camera of 0 x 0", lambda: Camera(0, 0, 1, 1, 0, 0)),
        ("a camera of 100000 x 100000", lambda: Camera(100000, 100000, 1000, 1000, 0, 0)),
        ("3 distortion coefficients", lambda: Camera(10, 10, 9, 9, 5, 5, [0.1, 0.2, 0.3])),
        ("a distortion of NaN", lambda: Camera(10, 10, 9, 9, 5, 5, [np.nan, 0, 0, 0])),
        ("a gain of 0", lambda: Camera(10, 10, 9, 9, 5, 5, gain=0)),
        ("a readout of -1 s", lambda: Camera(10, 10, 9, 9, 5, 5, readout=-1)),
        ("an unknown lens model", lambda: Camera(10, 10, 9, 9, 5, 5, model="magic")),
        ("a response that falls", lambda: Response.from_curve([0, 0.6, 0.5, 1])),
        ("a response of NaN", lambda: Response.from_curve([0, np.nan, 1])),
        ("a gamma of 0", lambda: Response.gamma(0)),
        ("a pose that is a mirror", lambda: Pose(np.diag([-1.0, 1, 1, 1]))),
        ("a pose that scales", lambda: Pose(np.diag([2.0, 2, 2, 1]))),
        ("a pose of NaN", lambda: Pose(np.full((4, 4), np.nan))),
        ("a pose of infinite translation", lambda: Pose(_shifted(np.inf))),
    ):
        yield Case("cameras", what, "ValueError or TypeError", partial(refused, call, (ValueError, TypeError)))


def _corners() -> np.ndarray:
    return np.array([(-0.02, 0.02), (0.02, 0.02), (0.02, -0.02), (-0.02, -0.02)])


def _shifted(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


@cache
def _board() -> Board:
    from ..board import Board as PrintedBoard

    return PrintedBoard.default()


@cache
def _shot(tilt: float, distance: float, azimuth: float = 0.0, roll: float = 0.0, aim=(0.0, 0.0), seed: int = 0, **how):
    from .board_pictures import look_at, render

    pose = look_at(tilt, distance, azimuth, roll, aim)
    return render(_board(), CAMERA, pose, seed=seed, fine=2, dpi=150, **how), pose


def _view(view: dict, **how):
    return _shot(
        view["tilt_degrees"],
        view["distance"],
        view.get("azimuth_degrees", 0.0),
        view.get("roll_degrees", 0.0),
        view.get("aim", (0.0, 0.0)),
        **how,
    )


def _degrees(tracked: Tracked, pose: np.ndarray) -> float:
    return float(np.degrees(tracked.camera_from_marker.angle_to(Pose(pose))))


def _whole(tracked: Tracked) -> Outcome:
    held = np.isfinite(tracked.covariance).all() and (np.diag(tracked.covariance) >= 0).all()
    return Outcome(bool(held) and np.isfinite(tracked.residual_px), "covariance finite")


def _pose(view: dict, method: str, most: float, must: bool) -> Outcome:
    picture, pose = _view(view)
    tracked = Tracker(_board(), CAMERA, method).track(picture)
    if tracked is None:
        return Outcome(not must, "None")
    error = _degrees(tracked, pose)
    text = f"{error:.2f} degrees" + (", ambiguous" if tracked.ambiguous else "")
    return both(Outcome(error <= most or tracked.ambiguous, text), _whole(tracked))


# --- pictures that are not valid


def _usual() -> np.ndarray:
    return _view(POSES["45 degrees"][0])[0]


def _finger() -> np.ndarray:
    picture = _usual().copy()
    picture[:, :160] = (90, 40, 30)
    return picture


def _glossy() -> np.ndarray:
    """A white glare over a third of the board."""
    y, x = np.mgrid[:240, :320]
    glare = 255 * np.exp(-((x - 190) ** 2 + (y - 100) ** 2) / 1600)[..., None]
    return np.clip(_usual() + glare, 0, 255).astype(np.uint8)


def _shadowed() -> np.ndarray:
    """A hard shadow across the board."""
    picture = _usual().astype(float)
    y, x = np.mgrid[:240, :320]
    picture[x + 0.7 * y > 250] *= 0.35
    return picture.astype(np.uint8)


def _blurred() -> np.ndarray:
    import cv2

    return cv2.blur(_usual(), (25, 1))


PICTURES = {
    "black": (lambda: np.zeros((240, 320, 3), np.uint8), "None"),
    "white": (lambda: np.full((240, 320, 3), 255, np.uint8), "None"),
    "noise": (lambda: np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8), "None"),
    "checks": (
        lambda: np.tile(np.kron([[0, 255], [255, 0]], np.ones((8, 8)))[..., None], (15, 20, 3)).astype(np.uint8),
        "None",
    ),
    "floats of NaN": (lambda: np.full((240, 320, 3), np.nan, np.float32), "None"),
    "floats of 1e30": (lambda: np.full((240, 320, 3), 1e30, np.float32), "None"),
    "mirrored": (lambda: np.ascontiguousarray(_usual()[:, ::-1]), "None"),
    "upside down": (lambda: np.ascontiguousarray(_usual()[::-1]), "None"),
    "negative": (lambda: 255 - _usual(), "None"),
    "a finger over half the lens": (_finger, "None, or a pose within 1 degree"),
    "a glossy board": (_glossy, "None, or a pose within 1 degree"),
    "a hard shadow on the board": (_shadowed, "a pose within 1 degree"),
    "motion blur of 25 pixels": (_blurred, "None, or a pose within 3 degrees"),
    "torn in the middle": (
        lambda: np.concatenate([_usual()[:120], _usual()[100:220]]),
        "None, or a pose within 6 degrees",
    ),
}


def _picture(name: str) -> Outcome:
    make, expected = PICTURES[name]
    picture, pose = make(), _view(POSES["45 degrees"][0])[1]
    outcomes = []
    for method in METHODS:
        tracked = Tracker(_board(), CAMERA, method).track(picture)
        if tracked is None:
            outcomes.append(Outcome(not expected.startswith("a pose") or method == "frame-marker", f"{method}: None"))
            continue
        if expected == "None":
            outcomes.append(Outcome(False, f"{method}: a pose"))
            continue
        error, most = _degrees(tracked, pose), float(expected.split("within ")[1].split()[0])
        held = error <= most or tracked.ambiguous or (method == "frame-marker" and error <= 3 * most)
        outcomes.append(both(Outcome(held, f"{method}: {error:.2f} degrees"), _whole(tracked)))
    return both(*outcomes)


def _exposed(exposure: float) -> Outcome:
    picture, pose = _view(POSES["45 degrees"][0], exposure=exposure)
    found = []
    for method in ("edges", "board"):
        tracked = Tracker(_board(), CAMERA, method).track(picture)
        error = 0.0 if tracked is None else _degrees(tracked, pose)
        found.append(Outcome(error <= 1, f"{method}: " + ("None" if tracked is None else f"{error:.2f} degrees")))
    return both(*found)


def _on_a_wall() -> Outcome:
    """A board seen from far away, so that both minima fit; down lies along the board, not into it."""
    camera = Camera(320, 240, 280.0, 280.0, 160.0, 120.0)
    picture, pose = _shot(15.0, 0.55, 90.0, 0.0, (0.0, 0.0))
    down = pose[:3, :3] @ np.array([0.0, -1, 0])
    tracker = Tracker(_board(), camera, gravity_in_marker=(0.0, -1.0, 0.0))
    tracked = tracker.track(picture, 0.0, gravity=down)
    if tracked is None:
        return Outcome(False, "None")
    error = _degrees(tracked, pose)
    return Outcome(error < 2, f"{error:.2f} degrees")


def _stops() -> Outcome:
    tracker, found, worst = Tracker(_board(), CAMERA), 0, 0.0
    good, pose = _view(POSES["45 degrees"][0])
    dark, _ = _view(POSES["45 degrees"][0], exposure=2.0**-20)
    for k in range(20):
        tracked = tracker.track(dark if k % 2 else good, k / 30)
        if tracked is None:
            found += 0 if k % 2 else -100
            continue
        found += 1
        worst = max(worst, _degrees(tracked, pose))
        if k % 2:
            return Outcome(False, "a pose from a black picture")
    return Outcome(found == 10 and worst < 0.5, f"{found} poses of 10, worst {worst:.2f} degrees")


def _long_still() -> Outcome:
    tracker = Tracker(_board(), CAMERA)
    picture, _ = _view(POSES["45 degrees"][0])
    poses = []
    for k in range(1000):
        tracked = tracker.track(picture, k / 30)
        if tracked is None:
            return Outcome(False, f"lost in frame {k}")
        poses.append(tracked.camera_from_marker)
    drift = float(np.degrees(poses[-1].angle_to(poses[5])))
    return Outcome(drift < 0.01, f"{drift:.1e} degrees")


def _long_moving() -> Outcome:
    shots = [
        _shot(25 + 10 * float(np.sin(t)), 0.4 + 0.05 * float(np.cos(t))) for t in np.linspace(0, 2 * np.pi, 40)[:-1]
    ]
    order = [*shots, *shots[-2:0:-1]]
    tracker, errors = Tracker(_board(), CAMERA), np.zeros(1000)
    for k in range(len(errors)):
        picture, pose = order[k % len(order)]
        tracked = tracker.track(picture, k / 30)
        errors[k] = np.nan if tracked is None else _degrees(tracked, pose)
    lost = int(np.isnan(errors).sum())
    begin, end = np.nanmean(errors[:200]), np.nanmean(errors[-200:])
    return Outcome(
        bool(lost == 0 and end < 1.5 * begin + 0.01 and np.nanmax(errors) < 0.5),
        f"lost in {lost}, mean {begin:.3f} then {end:.3f}, worst {np.nanmax(errors):.2f} degrees",
    )


def _jumps() -> Outcome:
    tracker, worst, poses = Tracker(_board(), CAMERA), 0.0, 0
    views = [POSES[n][0] for n in ("head-on", "45 degrees", "turned by 180 degrees", "turned by 90 degrees")]
    for k in range(24):
        picture, pose = _view(views[k % len(views)])
        tracked = tracker.track(picture, k / 30)
        if tracked is not None:
            poses += 1
            worst = max(worst, 0.0 if tracked.ambiguous else _degrees(tracked, pose))
    return Outcome(worst < 0.5, f"{poses} poses of 24, worst {worst:.2f} degrees")


def _bad_picture(shape, dtype=np.uint8) -> Outcome:
    tracker = Tracker(_board(), CAMERA)
    return refused(lambda: tracker.track(np.zeros(shape, dtype)), (ValueError, TypeError))
