"""What the plan is judged on: seven maps, four meshes, six materials, one pose each, and the picture's error.

Below the horizon, the map holds the table: a Lambertian plane of albedo 0.5 that the map above lights, as in a captured
map. The back picture shows that table, exposed so that the table has 0.35 of white.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.viewpoint import looking

from .. import inputs

SIZE = 128
MESHES = ("spot", "stanford-bunny", "teapot", "suzanne")
ALBEDO, TABLE = 0.5, 0.35
WIDTH, HEIGHT, FOCAL = 160, 120, 190.0
EYE, TARGET = np.array([0.25, -0.5, 0.42]), np.array([0.0, 0.0, 0.07])
Eye: TypeAlias = tuple[float, float, float]  # another eye than EYE
BUDGETS = (0.005, 0.01, 0.02, 0.05, 0.1)

MATERIALS = {
    "white": fastibl.Material(diffuse=(0.8, 0.8, 0.8)),
    "clay": fastibl.Material(diffuse=(0.6, 0.3, 0.15)),
    "satin": fastibl.Material(diffuse=(0.5, 0.5, 0.5), glossy=(0.2, 0.2, 0.2), exponent=32),
    "plastic": fastibl.Material(diffuse=(0.3, 0.35, 0.4), glossy=(0.3, 0.3, 0.3), exponent=256),
    "metal": fastibl.Material(diffuse=(0, 0, 0), glossy=(0.8, 0.7, 0.5), exponent=128),
    "pbr": fastibl.Material.pbr((0.6, 0.5, 0.4), metallic=0.3, roughness=0.35),
}
# The meshes with which, under all maps, the plan's two constants were chosen; the rest verifies them.
TUNED_MESHES = ("spot", "teapot", "suzanne")


class Case(NamedTuple):
    map: str
    mesh: str
    material: str

    @property
    def tuned(self) -> bool:
        return self.mesh in TUNED_MESHES


def cases(quick: bool = False) -> list[Case]:
    """All cases, or every eleventh; even then, each map, mesh and material is among them."""
    every = [Case(m, o, k) for o in MESHES for m in inputs.MAPS for k in MATERIALS]
    return every[::11] if quick else every


@cache
def environment(name: str) -> fastibl.CubeMap:
    return above_a_table(inputs.real_maps()[name])


def above_a_table(cube: fastibl.CubeMap) -> fastibl.CubeMap:
    """The map above the horizon, with the table below it."""
    faces = cube.faces.astype(np.float64)
    d, angles, radiance = reference.samples(faces)
    up = d[:, 2] > 0
    table = ALBEDO / np.pi * ((angles * d[:, 2])[up] @ radiance[up])
    out = radiance.copy()
    out[~up] = table
    return fastibl.CubeMap(out.reshape(faces.shape).astype(np.float32))


@cache
def table(name: str) -> NDArray[np.float64]:
    """Radiance (3,) of the table."""
    return environment(name).faces[5].reshape(-1, 3).mean(axis=0).astype(np.float64)


def exposure(name: str) -> float:
    return TABLE / float(table(name).mean())


@cache
def camera() -> fastibl.Camera:
    return fastibl.Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)


@cache
def pose(eye: Eye | None = None) -> fastibl.Pose:
    at = EYE if eye is None else np.array(eye)
    return looking(TARGET - at, at)


def beside(pose: fastibl.Pose) -> fastibl.Pose:
    """A pose a hair beside: from the same one, a session leaves the object as it is."""
    matrix = pose.matrix.copy()
    matrix[0, 3] += 1e-4
    return fastibl.Pose(matrix)


def rays(dx: float = 0.5, dy: float = 0.5, eye: Eye | None = None) -> NDArray[np.float64]:
    """Unit directions (h, w, 3) through a point of each pixel, in the marker frame; by default through its centre."""
    x, y = np.meshgrid(np.arange(WIDTH) + dx, np.arange(HEIGHT) + dy)
    d = camera().unproject(np.stack([x, y], axis=-1)) @ pose(eye).rotation
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


@cache
def plane_points(eye: Eye | None = None) -> NDArray[np.float64]:
    """Where the pixels' rays meet the plane (h, w, 2)."""
    d = rays(eye=eye)
    at = EYE if eye is None else np.array(eye)
    return at[:2] - at[2] / d[..., 2:] * d[..., :2]


@cache
def scene(mesh: str) -> fastibl.Scene:
    made = inputs.scene(mesh)
    if made.baked_shadow is None:
        made.baked_shadow = fastibl.MeshShadow(made.mesh)
    return made


class Picture(NamedTuple):
    """object: (h, w, 4) radiance times coverage, and coverage. gain: (h, w, 3), that of the plane."""

    object: NDArray[np.float64]
    gain: NDArray[np.float64]


def composite(picture: Picture, name: str) -> NDArray[np.float64]:
    """(h, w, 3) relative to white, in [0, 1]: what a picture can hold."""
    light = picture.object[..., :3] + (1 - picture.object[..., 3:]) * picture.gain * table(name)
    return np.clip(light * exposure(name), 0, 1)


class Errors(NamedTuple):
    """RMS over RGB, divided by the truth's mean, over the pixels that the object covers or that its shadow changes by
    more than 1/255; then the same for the object's pixels and for the shadow's alone, each divided by its own mean."""

    whole: float
    object: float
    shadow: float


def errors(estimate: Picture, truth: Picture, name: str) -> Errors:
    true = composite(truth, name)
    off = (composite(estimate, name) - true) ** 2
    covered = truth.object[..., 3] > 0
    encode = camera().response.encode
    bare = np.clip(table(name) * exposure(name), 0, 1)
    changed = np.abs(encode(true) - encode(np.broadcast_to(bare, true.shape))).max(axis=-1) > 1 / 255
    shadow = changed & ~covered

    def error(where: NDArray) -> float:
        return float(np.sqrt(off[where].mean()) / true[where].mean()) if where.any() else 0.0

    return Errors(error(covered | shadow), error(covered), error(shadow))
