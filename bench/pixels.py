"""What the number of samples a pixel leaves of the object's picture, and what it costs: Session(supersampling=)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.expected import present

from . import inputs
from .measure import Row, row, timing

FINEST = 8  # 256 samples a pixel: the truth
TRIED = (1, 2, 3, 4)
MATERIALS = {
    "satin, exponent 32": fastibl.Material((0.5, 0.5, 0.5), (0.2, 0.2, 0.2), 32),
    "metal, exponent 128": fastibl.Material((0, 0, 0), (0.8, 0.8, 0.8), 128),
    "mirror": fastibl.Material((0, 0, 0), (0.8, 0.8, 0.8), np.inf),
}
METRIC = "RMS of the drawn object; seconds of shading"
_WHITE = 0.35 / (0.5 / np.pi)  # irradiances of the plane: a table of albedo 0.5 lies at 0.35 of white


def poses() -> list[fastibl.Pose]:
    around = np.arange(4) * 2.1
    return [
        fastibl.Pose.look_at((0.6 * np.cos(a), 0.6 * np.sin(a), 0.2 + 0.1 * k), inputs.OBJECT)
        for k, a in enumerate(around)
    ]


@dataclass
class Pictures:
    """layers: radiance times coverage (h, w, 3), in units of white, of each pose."""

    layers: list[NDArray[np.float64]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


def draw(scene: fastibl.Scene, light: fastibl.CubeMap, supersampling: int, rounds: int) -> Pictures:
    camera = fastibl.Camera(320, 240, 330.0, 330.0, 160.0, 120.0)
    session = fastibl.Session(
        scene,
        fastibl.Rig(camera),
        environment=light,
        methods={"glossy": "stretched"},
        cast_shadow=False,
        supersampling=supersampling,
    )
    white = _WHITE * fastibl.Lighting(light).irradiance([[0, 0, 1.0]]).mean()
    made = Pictures()
    for number in range(rounds):
        for pose in poses():
            session.restart_clock()
            result = session.process(fastibl.Frame(0.0, back_from_marker=pose))
            made.seconds.append(result.timings["shade"])
            if number == 0:
                made.layers.append(np.clip(present(session.layers.object)[..., :3] / white, 0, 1).astype(float))
    return made


def error(made: Pictures, true: Pictures) -> float:
    """Of all poses together, relative to the truth's mean."""
    off, sums = [], []
    for one, other in zip(made.layers, true.layers, strict=True):
        where = (one.max(axis=-1) > 0) | (other.max(axis=-1) > 0)
        off.append(((one - other)[where] ** 2).ravel())
        sums.append(other[where].ravel())
    return float(np.sqrt(np.concatenate(off).mean()) / np.concatenate(sums).mean())


def rows() -> list[Row]:
    found = []
    maps = {name: inputs.real_maps()[name] for name in ("studio_small_03", "venice_sunset") if inputs.real_maps()}
    maps = maps or {"built-in room": present(inputs.short_recording().truth).environment(0.0)}
    for light_name, light in maps.items():
        for label, material in MATERIALS.items():
            scene = fastibl.Scene(fastibl.shapes.figurine(inputs.HEIGHT), material, spheres=1)
            true = draw(scene, light, FINEST, 1)
            for n in TRIED:
                made = draw(scene, light, n, 3)
                found.append(
                    row(
                        f"supersampling={n}",
                        f"320x240, figurine, {label}, {light_name}",
                        METRIC,
                        error(made, true),
                        timing(made.seconds, made.seconds),
                    )
                )
    return found
