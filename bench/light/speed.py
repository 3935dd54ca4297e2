"""Speed of rebuilding a map, following frames and conversions; times are relative to the yardstick of the same run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.expected import present
from fastibl.viewpoint import looking

from .. import inputs, measure
from ..goals import Goal, percent, row

SIZE = 256
FRAMES = 320
PASSES = 8


def cpu_times(calls: list[Callable[[], object]], repetitions: int) -> NDArray[np.float64]:
    """CPU seconds (repetitions, calls + 1) of each call, run five times in a row, and of the yardstick beside them."""
    times = []
    for _ in range(repetitions):
        line = [measure.measure(lambda _, call=call: call(), [None], 5, 1).cpu for call in calls]
        times.append([*line, measure.yardstick(5).cpu])
    return np.array(times)


def in_yardsticks(times: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Medians over repetitions, in yardsticks; and the yardstick in seconds."""
    medians = np.median(times, axis=0)
    return medians[:-1] / medians[-1], float(medians[-1])


def noise_map(size: int = SIZE, seed: int = 0) -> fastibl.CubeMap:
    return fastibl.CubeMap(np.random.default_rng(seed).random((6, size, size, 3), np.float32) ** 4)


@row("light", "speed of a full rebuild")
def full_rebuild() -> Iterator[Goal]:
    cube = noise_map()
    faces = np.ascontiguousarray(cube.faces)
    with measure.one_core():
        times = cpu_times(
            [
                cube._rebuild,
                lambda: fastibl.Lighting(cube, diffuse="sh9", glossy="mip"),
                lambda: fastibl.Lighting(cube, glossy="mip"),
                lambda: fastibl.CubeMap(faces),
            ],
            11,
        )
    (chain, sh9, auto, whole), yard = in_yardsticks(times)
    yield Goal(
        "full rebuild at 6 x 256^2: all MIP levels and borders, then sh9 and E(z)",
        f"{chain + sh9:.3f} yardsticks",
        "<= 0.075 yardsticks (0.3 ms of 4.0)",
        chain + sh9 <= 0.075,
        (
            f"levels {chain:.3f}, sh9 {sh9:.3f}, the automatic method {auto:.3f} yardsticks of "
            f"{1e3 * yard:.2f} ms CPU; from clean linear float faces in the map's own storage",
            f"a new map from an array, with cleaning and fresh memory: {whole:.3f} yardsticks",
        ),
    )


# Frames


def place(name: str | None) -> Callable[[NDArray], NDArray]:
    """Radiance by direction, of a real map scaled to mid exposure or of a made-up place with a lamp."""
    if name:
        cube = fastibl.read_environment(inputs.MAPS[name], size=SIZE)
        scale = 0.25 / float(np.mean(cube.mean()))
        return lambda d: scale * cube.sample(d)

    def radiance(d: NDArray) -> NDArray:
        x, y, z = np.moveaxis(d, -1, 0)
        light = (
            0.25 + 0.1 * np.sin(7 * x + 2 * y) + 0.08 * np.sin(11 * y - 5 * z) + 0.05 * np.sin(40 * x) * np.sin(35 * y)
        )
        light[d @ (np.array([0.5, 0.6, 0.8]) / np.sqrt(1.25)) > 0.995] = 5.0
        return np.maximum(light, 0.01)[..., None] * (1, 0.8, 0.6)

    return radiance


def lens(degrees: float, distorted: bool) -> fastibl.Camera:
    f = 320 / np.tan(np.radians(degrees / 2))
    return fastibl.Camera(640, 480, f, f, 320, 240, distortion=(-0.15, 0.02, 0, 0) if distorted else ())


def film(
    camera: fastibl.Camera, radiance: Callable, lowest: float, highest: float
) -> list[tuple[NDArray, fastibl.Pose]]:
    """Pictures of a turning camera, and its poses."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    rays = camera.unproject(np.stack([x, y], axis=-1))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    pictures = []
    for k in range(FRAMES):
        turn, up = 0.035 * k, lowest + (highest - lowest) * (0.5 + 0.5 * np.sin(0.011 * k))
        pose = looking(
            np.array([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)]),
            np.array([0.1 * np.sin(turn), -0.25, 0.35]),
        )
        light = np.clip(radiance((rays @ pose.rotation).astype(np.float32)), 0, 1)
        codes = 255 * camera.response.encode(light) + rng.normal(size=(480, 640, 1))
        pictures.append((np.clip(codes, 0, 255).round().astype(np.uint8), pose))
    return pictures


def follow(camera: fastibl.Camera, pictures: list[tuple[NDArray, fastibl.Pose]]) -> tuple[NDArray, NDArray, float]:
    """CPU seconds (frames, 3) of add, environment and irradiance; the yardsticks beside them; and the last coverage."""
    capture, times, yards, env = fastibl.Capture(size=SIZE), [], [], None
    for k, (image, pose) in enumerate(pictures):
        begin = time.process_time()
        capture.add(image, camera, pose, time=k / 30)
        added = time.process_time()
        env = capture.environment()
        mapped = time.process_time()
        lighting = fastibl.Lighting(env, diffuse="sh9", glossy="mip")
        times.append((added - begin, mapped - added, time.process_time() - mapped))
        del lighting
        if k % 40 == 0:
            yards.append(measure.yardstick(3).cpu)
    return np.array(times), np.array(yards), present(env).coverage


@row("light", "speed of following frames")
def frames() -> Iterator[Goal]:
    name = "potsdamer_platz" if "potsdamer_platz" in inputs.MAPS else None
    radiance = place(name)
    cases = (
        ("60 degrees", lens(60, False), 0.15, 0.9, True),
        ("75 degrees, distorted", lens(75, True), 0.15, 0.9, True),
        ("75 degrees, on the table", lens(75, False), -0.9, -0.5, False),
    )
    for what, camera, lowest, highest, judged in cases:
        with measure.one_core():
            # Every pass does the same work. Its least time is its own; what comes on top was taken by others on the
            # machine.
            pictures = film(camera, radiance, lowest, highest)
            passes = [follow(camera, pictures) for _ in range(PASSES)]
        times = np.min([times for times, _, _ in passes], axis=0)
        yards = np.min([yards for _, yards, _ in passes], axis=0)
        coverage = passes[0][2]
        yard = float(np.median(yards))
        total = times.sum(axis=1) / yard
        parts = np.median(times, axis=0) / yard
        middle, high = float(np.median(total)), float(np.percentile(total, 99))
        yield Goal(
            f"one 640 x 480 frame into 6 x 256^2, {what}: median and 99th percentile",
            f"{middle:.3f}, {high:.3f} yardsticks",
            "<= 0.125, <= 0.25 yardsticks" if judged else "(no goal of its own)",
            (middle <= 0.125 and high <= 0.25) if judged else None,
            (
                f"medians: splat {parts[0]:.3f}, map with dirty levels {parts[1]:.3f}, sh9 {parts[2]:.3f} "
                f"yardsticks of {1e3 * yard:.2f} ms; CPU time of {len(total)} frames, the least of {PASSES} passes "
                "each, as of the yardsticks beside them",
                f"{name or 'a made-up place'}, 2 degrees a frame; coverage at the end {percent(coverage)}; worst frame "
                f"{total.max():.2f}",
            ),
        )


@row("light", "speed of reading a panorama")
def panorama() -> Iterator[Goal]:
    image = np.random.default_rng(0).random((512, 1024, 3), np.float32)
    with measure.one_core():
        times = cpu_times(
            [
                lambda: fastibl.cubemap_from_equirect(image, SIZE),
                lambda: fastibl.cubemap_from_equirect(image, SIZE, filter="point"),
            ],
            7,
        )
    (area, point), yard = in_yardsticks(times)
    note = (f"with all MIP levels, one-off: nothing is kept between calls; yardstick {1e3 * yard:.2f} ms CPU",)
    yield Goal(
        "equirect 1024 x 512 to 6 x 256^2, area-exact",
        f"{area:.2f} yardsticks",
        "<= 3.75 yardsticks",
        area <= 3.75,
        note,
    )
    yield Goal(
        "equirect 1024 x 512 to 6 x 256^2, point-sampled", f"{point:.2f} yardsticks", "<= 1 yardstick", point <= 1, note
    )
