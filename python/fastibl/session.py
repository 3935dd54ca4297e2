"""The whole, frame by frame, and the plan behind it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Any
from weakref import WeakKeyDictionary, ref

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import Board as _CoreBoard
from ._fastibl import (
    Camera,
    CubeMap,
    Environment,
    FrameResult,
    Plan,
    Pose,
    Rig,
    Scene,
    _judge_light,
    _JudgedLight,
    _make_plan,
    _Methods,
    _sample_scene,
    _SceneSamples,
    _Session,
    with_gl,
)
from .expected import expect, present
from .given_poses import GivenPoses
from .lighting import Lighting, Method, resolve_methods
from .mesh_shadow import MeshShadow
from .recording import Frame
from .tracking import detect

Methods = str | Mapping[str, str | Method] | _Methods
_FAR = 1e6  # seconds from one frame to the next, 11 days, that are rather nanoseconds or a slip
_MOST_AT_ONCE = 30  # frames after another of the same time


def make_plan(
    scene: Scene,
    environment: Environment | CubeMap | None = None,
    *,
    error: float = 0.0,
    milliseconds: float = 0.0,
    methods: Methods = "auto",
    track: bool = True,
    capture: bool | None = None,
    cast_shadow: bool = True,
    costs: Mapping[str, float] | None = None,
    offline: bool = False,
    camera: Camera | None = None,
    camera_from_marker: Pose | ArrayLike | None = None,
) -> Plan:
    """Makes the plan of a frame; print it to see what each pass costs.

    With a budget and an environment, each step whose method is "auto" gets the cheapest method within the budget. All
    methods are tried on this light, at places of this scene whose true light is known from rays; their times come from
    `costs`.

    environment: what is known of the light; a CubeMap counts as known everywhere.
    error, milliseconds: budgets, None or 0 for none; error is at most 1.
    methods: "auto", "paper", a mapping from step to method, or another plan's.
    track, capture: whether the poses and the map come from pictures; by default capture is True when no environment is
    given.
    cast_shadow: False leaves the shadow on the plane out.
    costs: this machine's costs in nanoseconds by name, see fastibl.costs.machine_costs; a built-in table by default.
    offline: True for pictures rather than a live view: "auto" may then choose methods that take tenths of a second per
    picture.
    camera, camera_from_marker: those of the planned picture, Camera and Pose or (4, 4); errors are those of this
    picture. Without them, or where the picture shows nothing of the object, the frame has 640 x 480 pixels, errors are
    those of eight views all round, and what is promised holds for the worst view.
    A scene without a baked_shadow gets one, as in Session.
    Raises ValueError for unknown names, budgets out of range, or a camera without its pose.
    """
    if (camera is None) != (camera_from_marker is None):
        raise ValueError("camera and camera_from_marker must both be given, or neither")
    expect(scene, Scene, "scene")
    budgets = _budgets(error, milliseconds)
    resolved = resolve_methods(methods)
    if cast_shadow:
        bake_shadow(scene, resolved.shadow)
    known = _known(environment)
    if capture is None:
        capture = known is None
    shown = None if camera is None or camera_from_marker is None else _shown(scene, camera, camera_from_marker)
    judged = None
    if environment is not None and known is not None:
        budget, hurried = any(budgets), budgets[1] > 0
        asked = resolved, capture, cast_shadow, budget, hurried, bool(offline), shown
        judged = _judged(scene, environment, known, asked)
    return _make_plan(
        scene,
        known,
        judged,
        resolved,
        track,
        capture,
        cast_shadow,
        *budgets,
        _table(costs),
        camera.width if camera else 640,
        camera.height if camera else 480,
        shown,
    )


# For each scene, the last picture that was planned, and the places that it shows.
_SHOWN: WeakKeyDictionary[Scene, tuple[tuple[Camera, Pose], _SceneSamples | None]] = WeakKeyDictionary()


def _shown(scene: Scene, camera: Camera, camera_from_marker: Pose | ArrayLike) -> _SceneSamples | None:
    pose = camera_from_marker if isinstance(camera_from_marker, Pose) else Pose(camera_from_marker)
    picture = camera, pose
    if scene not in _SHOWN or _SHOWN[scene][0] != picture:
        _SHOWN[scene] = picture, _sample_scene(scene, *picture)
    return _SHOWN[scene][1]


# For each scene, the light that was judged last, what was asked for, and the judgement: another budget needs no other.
_JUDGED: WeakKeyDictionary[Scene, tuple[ref[Environment | CubeMap], tuple, _JudgedLight]] = WeakKeyDictionary()


def _judged(scene: Scene, given: Environment | CubeMap, known: Environment, asked: tuple) -> _JudgedLight:
    """given: the light as the program gave it, which never changes. asked: all arguments of _judge_light after it."""
    state = (*asked, scene.material, scene.baked_shadow, scene.shadow_strength, tuple(scene.shadow_color))
    if scene not in _JUDGED or _JUDGED[scene][0]() is not given or _JUDGED[scene][1] != state:
        _JUDGED[scene] = ref(given), state, _judge_light(scene, known, *asked)
    return _JUDGED[scene][2]


def bake_shadow(scene: Scene, method: str = "auto") -> None:
    """Gives a scene its baked_shadow where it has none and this shadow method draws with it ("auto" does where the
    scene has spheres); takes seconds for a mesh that was not baked before."""
    if scene.baked_shadow is None and (method == "mesh" or (method == "auto" and len(scene.spheres))):
        scene.baked_shadow = MeshShadow(scene.mesh)


def _number(value: float, name: str) -> float:
    expect(value, Real, name)
    return float(value)


def _table(costs: Mapping[str, float] | None) -> dict[str, float]:
    expect(costs, (Mapping, type(None)), "costs", "names and nanoseconds, as of fastibl.costs.machine_costs")
    return dict(costs or {})


def _budgets(error: float | None, milliseconds: float | None) -> tuple[float, float]:
    """The budgets as numbers; 0 for none."""
    for name, number in (("error", error), ("milliseconds", milliseconds)):
        expect(number, (Real, type(None)), name)
    return float(error or 0), float(milliseconds or 0)


def _numbers(values: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numbers of shape {shape}, got {values!r}") from None
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    return array


def _known(environment: Environment | CubeMap | None) -> Environment | None:
    expect(environment, (Environment, CubeMap, type(None)), "environment")
    return Environment(environment) if isinstance(environment, CubeMap) else environment


class Session(_Session):
    """Track, capture, light, shadow, shade and composite, frame by frame.

    scene: Scene.
    rig: Rig (or only its back camera's).
    board: Board, or None if every frame comes with its pose.
    environment: Environment or CubeMap to use instead of capturing.
    error, milliseconds: budgets of the plan, None or 0 for none: error as a share of the picture's light, at most 1
    (0.02 is 2 %), and processor time per frame. With a time budget one thread does the work, because several take more
    processor time in all.
    methods: "auto", "paper" or a mapping from step to method.
    backend: "cpu", "gl", or "auto" (the CPU).
    detector: function (grey, board, camera) -> (tags, start), OpenCV's by default.
    size: face edge of the captured map.
    distance: rough distance of the walls in metres; infinite treats all light as distant. None (the default): found
    from how pictures taken from several places differ (capture.distance), and then the walls of a room (capture.box).
    box: the room's walls, floor and ceiling instead of a distance: two corners (2, 3), metres, marker frame.
    box_yaw: angle of the walls to the marker's axes, radians, counter-clockwise from above; the corners are given along
    the walls then, from the marker's origin.
    doubt_exposures: whether a picture that differs from the map by one factor everywhere is at first taken to be
    wrongly exposed, see Capture.
    front_ratio: per channel, the front camera's value for a light divided by the back camera's, see fastibl.white.
    follow_surroundings: whether the surroundings are used to tell how the cameras turn while the board is out of view
    (FrameResult.turned; the map is captured on), and whether the board was turned by hand (FrameResult.board_moved).
    prior: CubeMap of the place from an earlier time.
    paper_albedo: albedo of the board's white.
    most_boost: largest factor on lights that clip in a camera's shortest exposure; None: with cameras that bracket. The
    last three are as in Capture.
    cast_shadow: False draws no shadow on the plane; set_cast_shadow changes it.
    adapt: whether frames that take longer than `milliseconds`, or much less, change the methods; switch it off for a
    replay that gives the same bits. Choices by `error` alone never depend on time.
    costs: this machine's costs in nanoseconds by name, used for `milliseconds`, see fastibl.costs.machine_costs; a
    built-in table by default.
    offline: True for pictures rather than a live view: "auto" may then choose methods that take tenths of a second per
    picture.
    supersampling: how many times as large along each axis the object is drawn and then averaged, 1 to 8: its pixels
    have 4 supersampling^2 samples. For shiny, curved objects in small pictures. A GPU takes less where a texture cannot
    be so large.
    A scene that has spheres but no baked_shadow gets one, for the shadow methods "auto" and "mesh": its mesh is baked,
    or the result is read from the cache on disk.
    Raises ValueError for unknown names and values out of range, RuntimeError where the GL back end cannot start.
    """

    def __init__(
        self,
        scene: Scene,
        rig: Rig,
        board: _CoreBoard | None = None,
        environment: Environment | CubeMap | None = None,
        error: float | None = 0.02,
        milliseconds: float | None = None,
        methods: Methods = "auto",
        backend: str = "auto",
        *,
        detector: Callable[..., Any] = detect,
        size: int = 128,
        cast_shadow: bool = True,
        distance: float | None = None,
        box: Sequence[Sequence[float]] | None = None,
        box_yaw: float = 0.0,
        doubt_exposures: bool = True,
        front_ratio: Sequence[float] = (1.0, 1.0, 1.0),
        follow_surroundings: bool = True,
        prior: CubeMap | None = None,
        paper_albedo: float = 0.85,
        most_boost: float | None = None,
        adapt: bool = True,
        costs: Mapping[str, float] | None = None,
        offline: bool = False,
        supersampling: int = 1,
    ):
        expect(scene, Scene, "scene")
        expect(rig, Rig, "rig")
        expect(board, (_CoreBoard, type(None)), "board", "light that is known is given as environment=")
        budgets = _budgets(error, milliseconds)
        environment = _known(environment)
        resolved = resolve_methods(methods)
        self._drawn, self._shadow, self._casts = scene, resolved.shadow, bool(cast_shadow)
        self._given_poses = GivenPoses(rig.back, board)
        self._meters, self._told_of_exposure = board is not None, False
        self._last_time: float | None = None  # of a frame
        self._same_times = 0  # frames after another of that time
        self._captures = environment is None
        if cast_shadow:
            bake_shadow(scene, resolved.shadow)
        super().__init__(
            scene,
            rig,
            board,
            environment,
            detector if board is not None else None,
            "cpu" if backend == "auto" else backend,
            resolved,
            *budgets,
            size,
            cast_shadow,
            None if distance is None else _number(distance, "distance"),
            None if box is None else _numbers(box, (2, 3), "box").tolist(),
            _number(box_yaw, "box_yaw"),
            bool(doubt_exposures),
            _numbers(front_ratio, (3,), "front_ratio").tolist(),
            bool(follow_surroundings),
            prior,
            _number(paper_albedo, "paper_albedo"),
            None if most_boost is None else _number(most_boost, "most_boost"),
            bool(adapt),
            _table(costs),
            bool(offline),
            supersampling,
        )

    def process(self, frame: Frame) -> FrameResult:
        """Processes one frame: pictures, exposures and, optionally, the pose and the attitude measured by a gyroscope.

        Raises ValueError for pictures of another size than the camera's, exposures that are not positive, time that
        runs backwards (see `restart_clock`), an attitude that is no rotation, or a frame with neither picture nor pose;
        TypeError for other dtypes. Warns of a time that is days after the last frame's, and of many equal ones
        where the light is captured, and of exposures that are not told where the light is given and no board would tell
        them.
        """
        expect(frame, Frame, "frame")
        untold = frame.back is not None and frame.back_exposure is None
        if untold and not (self._meters or self._captures or self._told_of_exposure):
            self._told_of_exposure = True
            warnings.warn(
                "the exposure of a back picture is not told, and there is no board whose white would show it: it is "
                "taken to be the last one that was told, or 1",
                stacklevel=2,
            )
        result = self._process(
            frame.time,
            frame.back,
            frame.front,
            frame.back_exposure,
            frame.front_exposure,
            frame.back_from_marker,
            frame.back_last_row,
            frame.attitude,
        )
        self._watch_times(frame.time)
        if frame.back_from_marker is not None and self._given_poses.due:
            mesh = self._drawn.mesh
            vertices = mesh.vertices[np.unique(mesh.triangles)]
            middle = 0.5 * (vertices.min(axis=0).astype(float) + vertices.max(axis=0))
            places = np.array([(0.0, 0.0, 0.0), self.scene.marker_from_object @ middle])
            drawn = bool(self.object.rgba[..., 3].any())
            self._given_poses.ask(present(result.back_from_marker), frame.back, places, drawn)
        return result

    def _watch_times(self, time: float) -> None:
        """Warns of times that cannot be seconds. To be called by process(), whose caller is told."""
        last, self._last_time = self._last_time, time
        self._same_times = self._same_times + 1 if time == last else 0
        if last is not None and time - last > _FAR:
            warnings.warn(
                f"the frame's time is {time - last:.3g} s after the last one's: times are in seconds; where this one "
                "was wrong, session.restart_clock() takes others again",
                stacklevel=3,
            )
        if self._same_times == _MOST_AT_ONCE and self._captures:
            warnings.warn(
                f"{_MOST_AT_ONCE + 1} frames in a row have the time {time:g} s: what lasts, such as a lamp that was "
                "switched on, is not told from what passes",
                stacklevel=3,
            )

    def restart_clock(self) -> None:
        """Let the next frame have any time: a camera's clock was set, or one frame had a wrong time.

        The map is kept; what was captured counts as a second older.
        """
        super().restart_clock()
        self._last_time = None

    def set_scene(self, scene: Scene) -> None:
        """Draw another object from the next frame on, in the light captured so far; the map's centre stays.

        A scene that has spheres but no baked_shadow gets one, as in the constructor; where a frame must not wait for
        that, give a scene that already has it. Raises ValueError for a scene that cannot be drawn.
        """
        expect(scene, Scene, "scene")
        if self._casts:
            bake_shadow(scene, self._shadow)
        self._set_scene(scene)
        self._drawn = scene

    def set_environment(self, environment: Environment | CubeMap | None) -> None:
        """Use the given light from the next frame on, a CubeMap as a map known everywhere; None to capture instead.

        Light that is set in every frame counts as moving light from the fourth frame on: shadows and lights then follow
        it, and methods are judged again when a tenth of the light is new.
        """
        self._set_environment(_known(environment))
        self._captures = environment is None

    def set_methods(self, methods: Methods) -> None:
        """Use other methods from the next frame on; bakes the mesh as the constructor does. What was captured by
        another method stays: its light, and how far things were found to be. Raises ValueError for unknown names."""
        resolved = resolve_methods(methods)
        self._bake(self._casts, resolved.shadow)  # first: it may be interrupted
        self._set_methods(resolved)
        self._shadow = resolved.shadow

    def set_budgets(  # type: ignore[override]
        self, error: float | None = None, milliseconds: float | None = None
    ) -> None:
        """Keep to other budgets from the next frame on; None or 0 means no budget. Raises ValueError for values that
        are negative or not finite and for an error above 1, TypeError for what is not a number."""
        super().set_budgets(*_budgets(error, milliseconds))

    def set_cast_shadow(self, cast: bool) -> None:
        """Switch the shadow on or off; bakes the mesh as the constructor does."""
        self._bake(cast, self._shadow)
        self._set_cast_shadow(cast)
        self._casts = cast

    def _bake(self, casts: bool, shadow: str) -> None:
        """Gives the session the scene's baked shadow, whoever baked it: it may have been baked after the session took
        the scene."""
        if casts:
            bake_shadow(self._drawn, shadow)
            self._set_baked_shadow(self._drawn.baked_shadow)

    def set_backend(self, backend: str) -> None:
        """Render with another back end ("cpu", "gl", "auto") from the next frame on.

        Raises ValueError for another name, RuntimeError where the GL back end cannot start.
        """
        self._set_backend("cpu" if backend == "auto" else backend)


def _lighting(result: FrameResult) -> Lighting | None:
    core = result._lighting
    return None if core is None else Lighting._wrap(core)


FrameResult.lighting = property(  # type: ignore[method-assign, assignment]
    _lighting, doc="Lighting of the frame, or None before there is any."
)

__all__ = ["Frame", "FrameResult", "Session", "make_plan", "with_gl"]
