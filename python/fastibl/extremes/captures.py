"""Capture: exposures far apart, suns clipped in every picture, hands over the lens, long runs."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial

import numpy as np

from .._fastibl import Camera, Capture, Environment, Pose, texel_directions, texel_solid_angles
from .case import Case, Outcome, at_most, both, is_light, refused
from .views import all_around, camera_of, exposed, looking, picture_of, place_light, place_map
from .worlds import MAPS, map_named

SUN = np.array([0.0, 0.6, 0.8])
_LAMP, _CENTRE = np.array([0.1, 0.05, 0.21]), np.array([0.0, 0.0, 0.05])  # a small lamp, and the object


def cases() -> Iterator[Case]:
    for size in (1, 2, 3, 17, 64, 256):
        yield Case(
            "capture",
            f"a map of {size} x {size} faces",
            f"clean; the place's mean within {5 if size > 3 else 10} %",
            partial(_sized, size),
        )
    for name in MAPS:
        yield Case("capture", f"prior: {name}", "a clean map", partial(_prior, name))
    for stops in (0, 5, 10, 20):
        yield Case(
            "capture",
            f"exposures {stops} stops apart",
            "the place's mean within 5 %, lamp included where an exposure shows it",
            partial(_stops, stops),
        )
    yield Case(
        "capture", "a sun clipped in every exposure", "a lower bound: no dimmer than white, said to be clipped", _sun
    )
    yield Case("capture", "a finger over half the lens, masked", "the rest of the place within 5 %", _finger)
    yield Case(
        "capture", "a finger over half the lens for three pictures", "the place is back when it is gone", _finger_gone
    )
    yield Case("capture", "a real shadow on the table", "kept: the plane stays darker there", _real_shadow)
    yield Case("capture", "a lamp 20 cm away", "a clean map; its light within a factor of 2", _near_lamp)
    yield Case("capture", "a lamp between the cameras and the object", "a clean map", _lamp_between)
    for what, picture in (
        ("black", lambda c: np.zeros((c.height, c.width, 3), np.uint8)),
        ("white", lambda c: np.full((c.height, c.width, 3), 255, np.uint8)),
        ("floats of NaN", lambda c: np.full((c.height, c.width, 3), np.nan)),
        ("floats of 1e30", lambda c: np.full((c.height, c.width, 3), 1e30)),
        ("floats of -1", lambda c: np.full((c.height, c.width, 3), -1.0)),
        ("16-bit noise", lambda c: np.random.default_rng(0).integers(0, 65536, (c.height, c.width, 3), np.uint16)),
    ):
        yield Case("capture", f"pictures: {what}", "a clean map", partial(_content, picture))
    for exposure in (1e-300, 1e-30, 1e-6, 1e6, 1e30, 1e300):
        yield Case("capture", f"an exposure of {exposure:g}", "a clean map", partial(_odd_exposure, exposure))
    for seconds in (1e-9, 1e3, 1e9, 1e30):
        yield Case("capture", f"{seconds:g} s between pictures", "a clean map", partial(_later, seconds))
    for name, camera in CAMERAS.items():
        yield Case("capture", f"camera: {name}", "a clean map", partial(_odd_camera, camera))
    for name, pose in POSES.items():
        yield Case("capture", f"pose: {name}", "a clean map", partial(_odd_pose, pose))
    yield Case("capture", "nothing", "a clean map, predicted_error 1, interval 0 to 1", _nothing)
    yield Case("capture", "1000 pictures of one place", "no drift, no growth of memory", _long)
    for what, call in BAD.items():
        yield Case("capture", what, "ValueError or TypeError", partial(refused, call, (ValueError, TypeError)))


CAMERAS = {
    "1 x 1": Camera(1, 1, 1, 1, 0.5, 0.5),
    "1 x 300": Camera(1, 300, 200, 200, 0.5, 150),
    "a focal length of 1e5": Camera(32, 24, 1e5, 1e5, 16, 12),
    "a focal length of 0.1": Camera(32, 24, 0.1, 0.1, 16, 12),
    "a lens that folds over": Camera(64, 48, 20, 20, 32, 24, [-0.6, 0.2, 0, 0]),
    "a fisheye": Camera(64, 64, 20, 20, 32, 32, model="fisheye"),
    "a fisheye that folds over": Camera(64, 64, 20, 20, 32, 32, [-0.5, 0, 0, 0], model="fisheye"),
    "360 degrees": Camera.equirectangular(64, 32),
    "a vignette that turns negative": Camera(64, 48, 20, 20, 32, 24, vignetting=[-5.0]),
    "a gain of 1e-30": Camera(64, 48, 40, 40, 32, 24, gain=1e-30),
    "a gain of 1e30": Camera(64, 48, 40, 40, 32, 24, gain=1e30),
}
POSES = {
    "in the plane": looking((1.0, 0, 0), (0, 0, 0)),
    "below the plane": looking((0.0, 0, 1), (0, 0, -1)),
    "in the centre": looking((1.0, 0, 0), (0, 0, 0.05)),
    "on the centre, looking down": looking((0.0, 0, -1), (0, 0, 0.05)),
    "1e9 m away": looking((1.0, 1, 0), (-1e9, -1e9, 0.3)),
    "1e-9 m above the plane": looking((1.0, 0, -0.1), (0, 0, 1e-9)),
}
BAD = {
    "a map of 0 x 0": lambda: Capture(size=0),
    "a map of 5000 x 5000": lambda: Capture(size=5000),
    "a centre below the plane": lambda: Capture(centre=(0, 0, -0.1)),
    "a centre of NaN": lambda: Capture(centre=(0, 0, np.nan)),
    "a distance of 0": lambda: Capture(distance=0),
    "a distance of NaN": lambda: Capture(distance=np.nan),
    "an albedo of 2": lambda: Capture(paper_albedo=2),
    "an exposure of 0": lambda: _add(exposure=0.0),
    "an exposure of NaN": lambda: _add(exposure=np.nan),
    "an infinite exposure": lambda: _add(exposure=np.inf),
    "a time of NaN": lambda: _add(time=np.nan),
    "a tint of 0": lambda: _add(tint=(1, 0, 1)),
    "a mask of another size": lambda: _add(mask=np.ones((3, 3), np.uint8)),
    "a pose that is none": lambda: _add(pose=np.ones((4, 4))),
    "an exposure range of none": lambda: Capture().next_exposure(camera_of(), looking((1.0, 0, 0)), 1.0, 0.5),
}


def _add(pose=None, **options) -> None:
    camera = camera_of(32, 24)
    pose = looking((1.0, 0, 0)) if pose is None else pose
    Capture(size=8).add(np.zeros((24, 32, 3), np.uint8), camera, pose, **options)


def _clean(environment: Environment) -> Outcome:
    low, high = environment.predicted_interval
    predicted = 0 <= low <= high and np.isfinite([environment.predicted_error, high]).all()
    return both(
        is_light(environment.radiance.faces, 1.001e9, "map"),
        Outcome(bool(predicted), f"predicted {environment.predicted_error:.2g} in {low:.2g} to {high:.2g}"),
        Outcome(bool(((environment.confidence >= 0) & (environment.confidence <= 1)).all()), "confidence in [0, 1]"),
    )


@cache
def _sweep(exposures: tuple[float, ...]) -> list[tuple[np.ndarray, Camera, Pose, float]]:
    """8-bit pictures of the place in all directions, with the exposures in turn."""
    camera = camera_of(64, 48)
    views = [
        (exposed(picture_of(place_light, camera, looking(d)), camera, e), camera, looking(d), e)
        for d in all_around()
        for e in exposures
    ]
    return views


def _captured(views, size: int = 32, **options) -> Capture:
    capture = Capture(size=size, **options)
    for k, (picture, camera, pose, exposure) in enumerate(views):
        capture.add(picture, camera, pose, exposure=exposure, time=k / 30)
    return capture


def _sky_error(environment: Environment, below: float = 2.0) -> float:
    """Relative error of the mean over texels of the sky that are no brighter than `below`, away from the lamp."""
    size = environment.radiance.size
    true = place_map(size)
    d = texel_directions(size)
    some = (true.max(axis=-1) <= below) & (d[..., 2] > 0.05) & (d @ SUN < np.cos(np.radians(20)))
    if not some.any():
        return 0.0
    return float(abs(environment.radiance.faces[some].mean() / true[some].mean() - 1))


def _sized(size: int) -> Outcome:
    environment = _captured(_sweep((0.5,)), size).environment()
    error = _sky_error(environment)
    return both(_clean(environment), at_most(error, 0.05 if size > 3 else 0.1, "mean off by", percent=True))


def _prior(name: str) -> Outcome:
    capture = Capture(size=16, prior=map_named(name))
    before = _clean(capture.environment())
    for k, (picture, camera, pose, exposure) in enumerate(_sweep((0.5,))[:5]):
        capture.add(picture, camera, pose, exposure=exposure, time=k / 30)
    return both(before, _clean(capture.environment()))


def _stops(stops: int) -> Outcome:
    environment = _captured(_sweep((0.5, 0.5 * 2.0**-stops) if stops else (0.5,))).environment()
    found = both(_clean(environment), at_most(_sky_error(environment), 0.05, "dark parts off by", percent=True))
    if stops in (5, 10):  # 20 stops show nothing of it
        lamp = environment.radiance.sample(np.array([SUN]), 0.0).max() / 60
        return both(found, Outcome(0.8 < lamp < 1.2, f"lamp {lamp:.2f} of what it is"))
    return found


def _sun() -> Outcome:
    """A disc of 1 degree with radiance 1e6; even in the shortest exposure it shows 100 times white."""

    def light(d: np.ndarray) -> np.ndarray:
        disc = (d @ SUN > np.cos(np.radians(1.0)))[..., None]
        return np.where(disc, 1e6, place_light(d))

    camera = camera_of(64, 48)
    views = [
        (exposed(picture_of(light, camera, looking(d), 2), camera, e), camera, looking(d), e)
        for d in [*all_around(), SUN]
        for e in (0.5, 1e-4)
    ]
    environment = _captured(views).environment()
    value = float(environment.radiance.faces.max())
    return both(
        _clean(environment),
        Outcome(
            0.2 / 1e-4 < value <= 1e6 and environment.clipped > 0, f"{value:.3g}, clipped {environment.clipped:.2g}"
        ),
    )


def _finger() -> Outcome:
    capture = Capture(size=32)
    for k, (picture, camera, pose, exposure) in enumerate(_sweep((0.5,))):
        mask, covered = np.ones(picture.shape[:2], np.uint8), picture.copy()
        mask[:, : camera.width // 2] = 0
        covered[:, : camera.width // 2] = (90, 40, 30)
        capture.add(covered, camera, pose, exposure=exposure, time=k / 30, mask=mask)
    environment = capture.environment()
    return both(_clean(environment), at_most(_sky_error(environment), 0.05, "mean off by", percent=True))


def _finger_gone() -> Outcome:
    capture, time = _captured(_sweep((0.5,))), 1.0
    views = _sweep((0.5,))
    for picture, camera, pose, exposure in views[:3]:
        covered = picture.copy()
        covered[:, : camera.width // 2] = (90, 40, 30)
        capture.add(covered, camera, pose, exposure=exposure, time=(time := time + 1 / 30))
    worst = _sky_error(capture.environment())
    for _ in range(3):
        for picture, camera, pose, exposure in views:
            capture.add(picture, camera, pose, exposure=exposure, time=(time := time + 1 / 30))
    environment = capture.environment()
    error = _sky_error(environment)
    return both(_clean(environment), Outcome(error < 0.05, f"off by {100 * worst:.1f} %, then {100 * error:.1f} %"))


def _real_shadow() -> Outcome:
    """A dark square on the table, 20 cm beside the middle."""
    camera, eye = camera_of(96, 72), np.array([0.0, -0.35, 0.4])
    pose = looking(np.array([0.1, 0.0, 0.0]) - eye, eye)

    def light(d: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore"):
            p = eye + d * (-eye[2] / d[..., 2])[..., None]
        dark = (np.abs(p[..., 0] - 0.2) < 0.08) & (np.abs(p[..., 1]) < 0.08) & (d[..., 2] < 0)
        return np.where(dark, 0.05, 0.4)[..., None] * np.ones(3)

    picture = exposed(picture_of(light, camera, pose, 2), camera, 1.0)
    capture = Capture(size=32, centre=(0.0, 0.0, 0.1))
    for k in range(10):
        capture.add(picture, camera, pose, time=k / 30)
    environment = capture.environment()
    at = np.array([(0.2, 0.0, -0.1), (-0.1, 0.0, -0.1)])
    dark, bright = environment.radiance.sample(at, 0.0).mean(axis=1)
    return both(_clean(environment), Outcome(bool(dark < 0.6 * bright), f"{dark:.2f} beside {bright:.2f}"))


def _lamp_seen_from(eyes: Iterable[np.ndarray]) -> Environment:
    """A sphere of 3 cm about _LAMP, 20 times white, in a dim place; eyes: the cameras, which look at it."""
    capture, camera = Capture(size=32, centre=tuple(_CENTRE)), camera_of(64, 48)
    for k, eye in enumerate(eyes):
        pose = looking(_LAMP - eye, eye)

        def light(d: np.ndarray, eye=eye) -> np.ndarray:
            along = d @ (_LAMP - eye)
            miss = np.sum((_LAMP - eye) ** 2) - along**2
            return np.where((along > 0) & (miss < 0.03**2), 20.0, 0.2)[..., None] * np.ones(3)

        for j, exposure in enumerate((1.0, 0.02)):
            picture = exposed(picture_of(light, camera, pose, 2), camera, exposure)
            capture.add(picture, camera, pose, exposure=exposure, time=(2 * k + j) / 30)
    return capture.environment()


def _around(centre: np.ndarray, radius: float) -> Iterator[np.ndarray]:
    for turn in np.linspace(0, 2 * np.pi, 24):
        yield centre + radius * np.array([np.cos(turn), np.sin(turn), 0.4])


def _near_lamp() -> Outcome:
    """Cameras at the object. The lamp's light: that within 25 degrees of it, less the place's."""
    environment = _lamp_seen_from(_around(_CENTRE, 0.02))
    to, size = _LAMP - _CENTRE, environment.radiance.size
    distance = float(np.linalg.norm(to))
    near = texel_directions(size) @ (to / distance) > np.cos(np.radians(25))
    angles = np.broadcast_to(texel_solid_angles(size), near.shape)[near]
    found = float(((environment.radiance.faces.mean(axis=-1)[near] - 0.2) * angles).sum())
    times = found / (19.8 * 2 * np.pi * (1 - np.sqrt(1 - (0.03 / distance) ** 2)))
    return both(_clean(environment), Outcome(0.5 < times < 2, f"its light {times:.2f} of what it is"))


def _lamp_between() -> Outcome:
    """Each picture has it elsewhere in the map."""
    return _clean(_lamp_seen_from(_around(_LAMP, 0.4)))


def _content(picture: Callable[[Camera], np.ndarray]) -> Outcome:
    camera = camera_of(32, 24)
    return _clean(_captured([(picture(camera), camera, looking(d), 1.0) for d in all_around(4)], 16).environment())


def _odd_exposure(exposure: float) -> Outcome:
    views = [(p, c, pose, exposure) for p, c, pose, _ in _sweep((0.5,))[:6]]
    return _clean(_captured(views, 16).environment())


def _later(seconds: float) -> Outcome:
    capture = Capture(size=16)
    for k, (picture, camera, pose, exposure) in enumerate(_sweep((0.5,))[:12]):
        capture.add(picture, camera, pose, exposure=exposure, time=k * seconds)
        capture.add(picture, camera, pose, exposure=exposure, time=k * seconds)
    return _clean(capture.environment())


def _odd_camera(camera: Camera) -> Outcome:
    picture = np.random.default_rng(0).integers(0, 256, (camera.height, camera.width, 3), np.uint8)
    views = [(picture, camera, looking(d), 0.5) for d in all_around(4)]
    return _clean(_captured(views, 16).environment())


def _odd_pose(pose) -> Outcome:
    picture, camera, _, exposure = _sweep((0.5,))[0]
    capture = Capture(size=16, distance=2.0)
    for k in range(3):
        capture.add(picture, camera, pose, exposure=exposure, time=k / 30)
    return _clean(capture.environment())


def _nothing() -> Outcome:
    environment = Capture(size=16).environment()
    held = environment.predicted_error == 1 and tuple(environment.predicted_interval) == (0, 1)
    return both(_clean(environment), Outcome(held and environment.coverage == 0, f"{environment.predicted_error:g}"))


def _long() -> Outcome:
    """Adds each of 26 pictures of a still place 38 times; watches the memory of Python objects and of the process."""
    views = _sweep((0.5,))
    capture = _captured(views)
    begin, mean = memory(), float("nan")
    tracemalloc.start()
    try:
        kept = tracemalloc.get_traced_memory()[0]
        for k in range(1000):
            picture, camera, pose, exposure = views[k % len(views)]
            capture.add(picture, camera, pose, exposure=exposure, time=1 + k / 30)
            if k % 10 == 0:
                environment = capture.environment()
            if k == 100:
                mean, begin, kept = _mean(environment), memory(), tracemalloc.get_traced_memory()[0]
        grown = (memory() - begin, tracemalloc.get_traced_memory()[0] - kept)
    finally:
        tracemalloc.stop()
    drift = abs(_mean(capture.environment()) / mean - 1)
    return both(
        _clean(capture.environment()),
        at_most(drift, 0.005, "drift", percent=True),
        Outcome(grown[0] < 8 << 20 and grown[1] < 1 << 20, f"grown by {grown[0] >> 10} KiB"),
    )


def _mean(environment: Environment) -> float:
    return float(np.mean(environment.radiance.mean()))


def memory() -> int:
    """Bytes of the process in memory; 0 where they cannot be read."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096
    except OSError:
        return 0
