"""What a report measures with: places, an object, recordings, and how much effort goes into each number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import shapes
from .._fastibl import CubeMap, Material, Mesh, Pose, Scene, fit_spheres, texel_directions
from ..mesh_shadow import MeshShadow
from ..recording import Recording
from ..viewpoint import looking

SIZE = 128  # face edge of the maps, texels
HEIGHT = 0.12  # height of the object, metres
POSITION = (0.0, 0.0, HEIGHT / 2)
STREAM = 4  # frames after which a session takes changing light for such, see Inputs.stream
MATERIAL = Material(diffuse=(0.62, 0.6, 0.57), glossy=(0.16, 0.16, 0.16), exponent=80.0)


@dataclass(frozen=True)
class Effort:
    """How many samples and repetitions stand behind each number."""

    name: str
    normals: int  # normals of the diffuse truth
    pairs: int  # pairs of normal and view, at each of five angles
    exponents: tuple[int, ...]
    alphas: tuple[tuple[float, float], ...]
    lobes: int  # normals for each pair of alphas
    grid: int  # points along an edge of the shadow
    vertices: int
    rounds: int  # rounds of timing
    batch: int  # normals in a timed call
    follow: tuple[float, float]  # seconds, and pictures a second, of the recording that is tracked
    sweep: tuple[float, float]  # the same for the recording that is captured from
    sweep_size: tuple[int, int]
    frame_maps: int  # places in which whole frames are compared
    picture: int  # pixels along an edge of a picture of a sphere
    suns: tuple[float, ...]  # strengths: radiance divided by the sky's mean
    map_sizes: tuple[int, ...]
    pixels: tuple[int, ...]  # widths of pictures
    limit: float  # seconds that the report may take on two cores


QUICK = Effort(
    "quick", 300, 4, (8, 64), ((0.1, 0.4), (0.3, 0.3)), 12, 20, 72, 5, 50_000, (1.0, 8), (8.0, 2), (320, 240), 1, 32,
    (1, 1e2, 1e4, 1e6, 1e8), (16, 32, 64, 128, 256), (320, 640), 60,
)  # fmt: skip
FULL = Effort(
    "full", 2000, 8, (8, 32, 128, 512), ((0.05, 0.3), (0.1, 0.4), (0.25, 0.6), (0.1, 0.1), (0.3, 0.3)), 60, 48, 500, 11,
    200_000, (2.0, 15), (12.0, 8), (480, 360), 7, 72, (1, 10, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8),
    (16, 32, 64, 128, 256, 512), (160, 320, 640, 1280), 900,
)  # fmt: skip


def sun_and_sky(strength: float = 3e4, texels: int = 1, size: int = SIZE) -> CubeMap:
    """A clear sky over grey ground, and a sun of `texels` texels that is `strength` times as bright as the sky's mean
    of 1."""
    d = texel_directions(size).astype(np.float64)
    up = np.clip(d[..., 2], 0, 1)[..., None]
    sky = (1 - up) * [1.25, 1.2, 1.1] + up * [0.45, 0.75, 1.3]
    faces = np.where(d[..., 2:] > 0, sky, [0.34, 0.31, 0.27])
    towards = np.array([0.52, -0.46, 0.72]) / np.linalg.norm([0.52, -0.46, 0.72])
    brightest = np.argsort(-(d @ towards).reshape(-1))[:texels]
    faces.reshape(-1, 3)[brightest] = strength * np.array([1.05, 1.0, 0.92])
    return CubeMap(faces.astype(np.float32))


def built_in_places() -> dict[str, CubeMap]:
    """The built-in room by day and with its lamp on, and a sun in a clear sky."""
    from ..room import Room

    room = Room()
    return {
        "room": room.truth(POSITION, SIZE),
        "room with lamp": room.truth(POSITION, SIZE, lamp=True),
        "sun and sky": sun_and_sky(),
    }


@dataclass
class Inputs:
    """places: maps by name. follow: a recording that is tracked; sweep: one that is captured from; both may lack truth.

    built_in: whether the places are the built-in ones.
    """

    places: Mapping[str, CubeMap]
    mesh: Mesh
    mesh_name: str
    follow: Recording
    sweep: Recording
    recording_name: str
    effort: Effort
    built_in: bool

    @cached_property
    def scene(self) -> Scene:
        scene = Scene(self.mesh, MATERIAL)
        scene.baked_shadow = MeshShadow(self.mesh)
        return scene

    def spheres(self, count: int) -> NDArray[np.float32]:
        if count not in self._spheres:
            self._spheres[count] = fit_spheres(self.mesh, count)
        return self._spheres[count]

    @cached_property
    def _spheres(self) -> dict[int, NDArray[np.float32]]:
        return {}

    @cached_property
    def channels(self) -> NDArray[np.float32]:
        """Faces (6, n, n, 3 k) of all places, side by side, so that a lobe's weights are computed once for all of
        them."""
        return np.concatenate([cube.faces for cube in self.places.values()], axis=-1)

    def stream(self, frame: int) -> CubeMap:
        """Light that changes a little in every frame, as captured light does: the first place with a half of it 1 %
        brighter.

        Each call gives a new map; after STREAM frames a session takes them for light that changes like this.
        """
        faces = next(iter(self.places.values())).faces
        return CubeMap(np.concatenate([faces[:3] * np.float32(1 + 0.01 * (frame % 2)), faces[3:]]))

    def by_place(self, values: NDArray) -> dict[str, NDArray]:
        """Splits (..., 3 k) into (..., 3) by name."""
        return {name: values[..., 3 * k : 3 * k + 3] for k, name in enumerate(self.places)}


def built_in_mesh(effort: Effort = FULL) -> Mesh:
    """The figurine; for a quick report, with the fewest triangles that it can have."""
    return shapes.figurine(HEIGHT, 0.9 if effort.name != "full" else 1.0)


def pose_around(turn: float = 0.0) -> Pose:
    """The pose of a camera half a metre away that looks down at the object, turned around it."""
    eye = np.array([0.5 * np.sin(turn), -0.5 * np.cos(turn), 0.35])
    return looking(np.array([0.0, 0.0, 0.05]) - eye, eye)


def beginning(recording: Recording, effort: Effort) -> Recording:
    """The first frames of a recording, as many as a simulated recording has for tracking."""
    count = max(2, round(effort.follow[0] * effort.follow[1]))
    frames = [recording[k] for k in range(min(count, len(recording)))]
    return Recording(recording.rig, frames, recording.board, recording.truth)


def thinned(recording: Recording, effort: Effort) -> Recording:
    """Frames from all over a recording, as many as a simulated recording has for capture."""
    count = max(2, round(effort.sweep[0] * effort.sweep[1]))
    chosen = np.unique(np.linspace(0, len(recording) - 1, min(count, len(recording))).round().astype(int))
    return Recording(recording.rig, [recording[int(k)] for k in chosen], recording.board, recording.truth)


def simulated(effort: Effort, environment: CubeMap | None = None) -> tuple[Recording, Recording]:
    """The recordings for tracking and for capture, in the built-in room or another place."""
    from ..simulator import simulate

    common: dict[str, Any] = {"seed": 0, "position": POSITION, "lamp": False, "hand": False}
    follow = simulate(environment, seconds=effort.follow[0], fps=effort.follow[1], **common)
    seconds, fps = effort.sweep
    sweep = simulate(environment, seconds=seconds, fps=fps, size=effort.sweep_size, path="sweep", **common)
    return follow, sweep
