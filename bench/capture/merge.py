"""Merging of exposures alone: a still camera with known poses, shot and read noise, 8 bits, no lens blur."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.recording import truth_of

from .. import inputs
from ..goals import Goal, percent, row, skipped
from ..light.speed import looking
from .sweep import mean_error

FULL_WELL, READ_NOISE = 4000.0, 6.0  # electrons
_EXPOSED = 0.4  # mean of the darker nine tenths, as a share of white
_STOPS, _MOST = 4, 5  # stops between exposures; most exposures
_SIZE, _WIDTH = 64, 256  # of the map, of the square pictures of 100 degrees


def views() -> list[fastibl.Pose]:
    """camera_from_marker of cameras at (0, 0, 0.05) that see the upper hemisphere."""
    rings = ((20, 6), (60, 4))  # degrees above the horizon, number of views around
    turns = [(2 * np.pi * (k + 0.25) / count, np.radians(up)) for up, count in rings for k in range(count)]
    return [
        looking(np.array([np.cos(a) * np.cos(u), np.sin(a) * np.cos(u), np.sin(u)]), np.array([0, 0, 0.05]))
        for a, u in turns
    ]


def fine_rays(camera: fastibl.Camera) -> NDArray:
    """Unit rays (2 h, 2 w, 3) of four points in each pixel."""
    x, y = np.meshgrid((np.arange(2 * camera.width) + 0.5) / 2, (np.arange(2 * camera.height) + 0.5) / 2)
    rays = camera.unproject(np.stack([x, y], axis=-1))
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def picture(light: NDArray, camera: fastibl.Camera, exposure: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """An 8-bit picture with shot and read noise."""
    y = light * exposure
    noise = rng.normal(size=y.shape) * np.sqrt(np.maximum(y, 0) / FULL_WELL + (READ_NOISE / FULL_WELL) ** 2)
    codes = 255 * camera.response.encode(np.clip(y + noise, 0, 1).astype(np.float32))
    return np.round(codes).astype(np.uint8)


def without_horizon(cube: fastibl.CubeMap) -> fastibl.CubeMap:
    """Makes the lower half mirror the upper one, so that no edge lies along the horizon: that is not what is
    measured."""
    d = fastibl.texel_directions(cube.size)
    above = np.concatenate([d[..., :2], np.abs(d[..., 2:])], axis=-1)
    return fastibl.CubeMap(cube.sample(above))


def glare(light: NDArray, share: float) -> NDArray:
    """Adds veiling glare: a share of the light spreads over the whole picture."""
    return light if share == 0 else (1 - share) * light + share * light.mean(axis=(0, 1))


def exposures(truth: fastibl.CubeMap, stops: int = _STOPS, most: int = _MOST) -> list[float]:
    """Exposures: the first suits the darker parts, and shorter ones follow while anything clips."""
    values = np.asarray(truth.faces, np.float64).mean(axis=-1).ravel()
    first = _EXPOSED / max(values[values <= np.quantile(values, 0.9)].mean(), 1e-12)
    brightest = float(np.asarray(truth.faces).max())
    count = 1 + int(np.ceil(max(0.0, np.log2(first * brightest)) / stops))
    return [first * 2.0 ** (-stops * k) for k in range(min(max(count, 2), most))]


def captured(truth: fastibl.CubeMap, steps: list[float], veil: float = 0.0) -> fastibl.Environment:
    """What a Capture makes of pictures of `truth` (above the horizon) from all views at all exposures."""
    rng = np.random.default_rng(0)
    f = _WIDTH / 2 / np.tan(np.radians(50))
    camera = fastibl.Camera(_WIDTH, _WIDTH, f, f, _WIDTH / 2, _WIDTH / 2)
    rays = fine_rays(camera)
    capture = fastibl.Capture(size=_SIZE)
    time = 0.0
    for pose in views():
        light = truth.sample(rays @ pose.rotation).astype(np.float64)
        light = glare(cv2.resize(light, (_WIDTH, _WIDTH), interpolation=cv2.INTER_AREA), veil)
        for exposure in steps:
            capture.add(picture(light, camera, exposure, rng), camera, pose, exposure=exposure, time=time)
            time += 0.03
    return capture.environment()


def error(truth: fastibl.CubeMap, env: fastibl.Environment) -> float:
    """Mean over normals of the irradiance's error, from what was seen above the horizon."""
    seen = (env.confidence > 0) & (fastibl.texel_directions(_SIZE)[..., 2] > 0)
    ours = np.where(seen[..., None], env.radiance.faces, 0)
    level = next(truth.level(k) for k in range(truth.level_count) if truth.level(k).shape[1] == _SIZE)
    return mean_error(fastibl.CubeMap(ours), fastibl.CubeMap(np.where(seen[..., None], level, 0)))


@row("capture", "merge of exposures")
def merge() -> Iterator[Goal]:
    what = "HDR merge on seen texels: error of the irradiance"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    for veil, judged in ((0.0, True), (0.01, False)):
        errors, notes = [], []
        for name, cube in inputs.real_maps().items():
            truth = without_horizon(cube)
            steps = exposures(cube)
            env = captured(truth, steps, veil)
            errors.append(error(truth, env))
            notes.append(f"{name} {percent(errors[-1], 2)} ({len(steps)} exposures, {percent(env.clipped, 2)} clipped)")
        middle, worst = float(np.median(errors)), max(errors)
        yield Goal(
            f"{what}, 2-5 exposures 4 stops apart, {f'{percent(veil)} veiling glare' if veil else 'no glare'}: "
            "median, worst map",
            f"{percent(middle)}, {percent(worst)}",
            "<= 0.2 %, <= 1 %" if judged else "reported",
            (middle <= 0.002 and worst <= 0.01) if judged else None,
            (", ".join(notes),),
        )


@row("capture", "merge of exposures 20 stops apart")
def far_apart() -> Iterator[Goal]:
    """A constant place with one lamp of a million: no fixed weight may leak its light."""
    faces = np.ones((6, 128, 128, 3), np.float32)
    d = fastibl.texel_directions(128)
    lamp = d @ (np.array([0.5, 0.3, 0.8]) / np.linalg.norm([0.5, 0.3, 0.8])) > np.cos(0.12)
    faces[lamp] = 1e6
    truth = fastibl.CubeMap(faces)
    for label, steps in (
        ("two exposures 20 stops apart", [0.4, 0.4 * 2.0**-20]),
        ("five exposures 5 stops apart", [0.4 * 2.0 ** (-5 * k) for k in range(5)]),
    ):
        env = captured(truth, steps)
        value = error(truth, env)
        dark = np.asarray(env.radiance.faces)[(env.confidence > 0) & (d[:, ::2, ::2, 2] > 0.05)]
        dark = dark[dark.mean(axis=-1) < 100]
        yield Goal(
            f"HDR merge of a lamp of 1e6 in a place of 1, {label}",
            percent(value),
            "<= 1 %",
            value <= 0.01,
            (f"median of the place {np.median(dark):.4f} of 1; clipped {percent(env.clipped, 2)}",),
        )


@row("capture", "merge of a room's exposures")
def room() -> Iterator[Goal]:
    """Two exposures: most of the room is black in the second, where noise that is cut off at 0 looks like light."""
    film = fastibl.simulate(seconds=0.1, fps=10, size=(64, 48), hand=False, lamp=False)
    cube = truth_of(film).environment(0.0)
    truth, first = without_horizon(cube), exposures(cube)[0]
    errors = {stops: error(truth, captured(truth, [first, first * 2.0**-stops])) for stops in (6, 8, 10, 12)}
    yield Goal(
        "HDR merge of the built-in room, two exposures 6, 8, 10 and 12 stops apart",
        ", ".join(percent(e) for e in errors.values()),
        "<= 0.5 % to 10 stops",
        max(e for stops, e in errors.items() if stops <= 10) <= 0.005,
    )
