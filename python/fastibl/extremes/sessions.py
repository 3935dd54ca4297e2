"""Sessions: frames with any content in any order, and long runs without drift or growth."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial

import numpy as np

from .._fastibl import Material, Rig, Scene
from ..faults import KINDS, Faulty
from ..recording import Frame
from ..session import Session
from .captures import _sweep, memory
from .case import Case, Outcome, at_most, both, is_light, is_ratio, refused
from .views import camera_of, looking
from .worlds import FRONT, MAPS, PICTURE, ball_mesh, map_named, seen_from

CAMERA = camera_of(64, 48, 60.0)
POSE = seen_from((0.0, -0.25, 0.12), (0.0, 0.0, 0.06))
METHODS = {"shadow": "directions"}


def cases() -> Iterator[Case]:
    for backend in ("cpu", "gl"):
        yield Case(
            "session",
            "1000 frames, all that can change changes",
            "pictures finite, no growth of memory, the last as the first",
            partial(_long, backend),
            backend,
            long=True,
        )
        yield Case(
            "session", "light that jumps from map to map", "as a fresh session", partial(_jumps, backend), backend
        )
        yield Case(
            "session",
            "an object that leaves the plane and comes back",
            "the same picture as before",
            partial(_away, backend),
            backend,
        )
        yield Case("session", "no map yet", "a picture", partial(_no_map, backend), backend)
    yield Case("session", "1000 frames captured", "no drift of the map, no growth", _long_capture, long=True)
    for kind in KINDS:
        yield Case("session", f"fault: {kind}", "a result for every frame, its map clean", partial(_fault, kind))
    for what, frame in (
        ("without picture or pose", dict(time=0.0)),
        ("at time NaN", dict(time=np.nan, back_from_marker=POSE)),
        ("at an infinite time", dict(time=np.inf, back_from_marker=POSE)),
        ("of another size", dict(time=0.0, back=np.zeros((3, 3, 3), np.uint8), back_from_marker=POSE)),
        ("of integers", dict(time=0.0, back=np.zeros((48, 64, 3), int), back_from_marker=POSE)),
        ("with an exposure of 0", dict(time=0.0, back_exposure=0.0, back_from_marker=POSE)),
        ("with an exposure of NaN", dict(time=0.0, front_exposure=np.nan, back_from_marker=POSE)),
        ("with a front picture that no camera took", dict(time=0.0, front=np.zeros((48, 64, 3), np.uint8))),
        ("with a pose that is none", dict(time=0.0, back_from_marker=np.zeros((4, 4)))),
        ("with a last row of a global shutter", dict(time=0.0, back_from_marker=POSE, back_last_row=POSE)),
    ):
        yield Case("session", f"a frame {what}", "ValueError or TypeError; the session goes on", partial(_bad, frame))


@cache  # sessions use copies of it
def _scene(matte: bool = False) -> Scene:
    material = Material() if matte else Material(glossy=(0.2, 0.2, 0.2))
    return Scene(ball_mesh(steps=8), material, spheres=4, visibility_rays=8)


def _session(backend: str = "cpu", environment="blue and red lamps", **options) -> Session:
    light = map_named(environment) if isinstance(environment, str) else environment
    return Session(_scene(), Rig(CAMERA), environment=light, methods=METHODS, backend=backend, **options)


def _back() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)


_MATERIALS = (
    Material(glossy=(0.2, 0.2, 0.2)),
    Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=np.inf),
    Material.pbr((1, 1, 1), 1.0, 0.1),
    Material(),
)
_LIGHTS = ("blue and red lamps", "black", "sun of 1e6 in one texel", "1 x 1 faces", "huge (1e30)")


def _long(backend: str) -> Outcome:
    from .._fastibl import Environment

    lights = {name: Environment(map_named(name)) for name in _LIGHTS}
    session, back, rng = _session(backend), _back(), np.random.default_rng(1)
    first = session.process(Frame(0.0, back=back, back_from_marker=POSE)).image
    held = []
    for k in range(1000):
        if k in (200, 600):
            held.append(memory())
        change = k % 25
        if change == 5:
            session.set_material(_MATERIALS[rng.integers(len(_MATERIALS))])
        elif change == 10:
            session.set_environment(lights[_LIGHTS[rng.integers(len(_LIGHTS))]])
        elif change == 15:
            session.set_cast_shadow(bool(rng.integers(2)))
        elif change == 20:
            pose = np.eye(4)
            pose[:2, 3] = rng.uniform(-0.05, 0.05, 2)
            session.move(pose)
        image = session.process(Frame(k / 30, back=back, back_from_marker=POSE)).image
        if k % 50 == 0 and not is_light(session.object.rgba).held:
            return Outcome(False, f"frame {k}: object not finite")
    held.append(memory())
    # Memory that is lost in every frame is lost in both halves of the run; that of a driver's new shader is not.
    grown = 2 * min(held[1] - held[0], held[2] - held[1])
    session.set_material(_MATERIALS[0])
    session.set_environment(lights[_LIGHTS[0]])
    session.set_cast_shadow(True)
    session.move(np.eye(4))
    image = session.process(Frame(40.0, back=back, back_from_marker=POSE)).image
    different = int((np.abs(image.astype(int) - first) > 1).sum())
    return both(
        Outcome(different == 0, f"{different} values of the picture differ"),
        Outcome(grown < 16 << 20, f"grown by {grown >> 10} KiB"),
    )


def _jumps(backend: str) -> Outcome:
    from .._fastibl import Environment

    session, back, worst = _session(backend), _back(), 0
    for k, name in enumerate([*MAPS, "blue and red lamps"]):
        if name in ("1024 x 1024 faces", "dim (1e-8)", "bright (1e8)", "3 x 3 faces"):
            continue
        session.set_environment(Environment(map_named(name)))
        image = session.process(Frame(k / 30, back=back, back_from_marker=POSE)).image
        fresh = _session(backend, name).process(Frame(0.0, back=back, back_from_marker=POSE)).image
        worst = max(worst, int(np.abs(image.astype(int) - fresh).max()))
    return Outcome(worst <= 1, f"at most {worst} codes apart")


def _away(backend: str) -> Outcome:
    session, back = _session(backend), _back()
    first = session.process(Frame(0.0, back=back, back_from_marker=POSE)).image
    for k, shift in enumerate(((0, 0, 5.0), (0, 0, -5.0), (1e6, 0, 0), (0, 0, -0.06), (0, 0, 1e-6))):
        pose = np.eye(4)
        pose[:3, 3] = shift
        session.move(pose)
        session.process(Frame(1.0 + k, back=back, back_from_marker=POSE))
        if not (is_light(session.object.rgba).held and is_ratio(session.shadow_map.image).held):
            return Outcome(False, f"moved by {shift}: not finite")
    session.move(np.eye(4))
    last = session.process(Frame(9.0, back=back, back_from_marker=POSE)).image
    worst = int(np.abs(last.astype(int) - first).max())
    return Outcome(worst <= 1, f"{worst} codes apart")


def _no_map(backend: str) -> Outcome:
    session = Session(_scene(), Rig(PICTURE), methods=METHODS, backend=backend)
    result = session.process(Frame(0.0, back_from_marker=FRONT))
    return both(
        Outcome(result.image.shape == (64, 64, 4), f"picture {result.image.shape}"),
        is_light(session.object.rgba, what="object"),
    )


def _long_capture() -> Outcome:
    views = _sweep((0.5,))
    camera = views[0][1]
    methods = {**METHODS, "diffuse": "sh9", "bounce": "none", "self_shadow": "none"}
    session = Session(_scene(matte=True), Rig(camera), methods=methods, size=32)
    begin, mean = 0, 0.0
    for k in range(1000):
        picture, _, pose, exposure = views[k % len(views)]
        result = session.process(Frame(k / 30, back=picture, back_exposure=exposure, back_from_marker=pose))
        if k == 300:
            begin, mean = memory(), float(np.mean(result.environment.radiance.mean()))
    drift = abs(float(np.mean(result.environment.radiance.mean())) / mean - 1)
    grown = memory() - begin
    return both(
        at_most(drift, 0.005, "drift", percent=True),
        is_light(result.environment.radiance.faces, 1e9, "map"),
        Outcome(grown < 8 << 20, f"grown by {grown >> 10} KiB"),
    )


class _Film:
    """A source of 60 frames that show the place to both cameras."""

    def __init__(self) -> None:
        views = _sweep((0.5,))
        self.rig = Rig(views[0][1], views[0][1], np.diag([-1.0, 1, -1, 1]))
        self.board, self._views = None, views

    def __iter__(self) -> Iterator[Frame]:
        for k in range(60):
            picture, _, pose, exposure = self._views[k % len(self._views)]
            yield Frame(k / 30, picture, self._views[-k % len(self._views)][0], exposure, exposure, pose)


def _fault(kind: str) -> Outcome:
    source, frames, refusals = Faulty(_Film(), 3, {kind: 0.2}), 0, 0
    session = Session(_scene(), source.rig, methods=METHODS, size=16)
    for frame in source:
        try:
            result = session.process(frame)
            frames += 1
        except ValueError:  # a picture of another size is refused, and the session goes on with the next one
            refusals += 1
    happened = source.counts[kind]
    return both(
        Outcome(frames > 10 and happened > 0, f"{happened} faults, {frames} frames, {refusals} refused"),
        is_light(result.environment.radiance.faces, 1e9, "map"),
    )


def _bad(frame: dict) -> Outcome:
    session = _session()
    found = refused(lambda: session.process(Frame(**frame)), (ValueError, TypeError))
    result = session.process(Frame(0.0, back=_back(), back_from_marker=looking((0.0, 0.3, -0.1), (0, -0.3, 0.15))))
    return both(found, Outcome(result.image.shape == (48, 64, 3), "goes on"))
