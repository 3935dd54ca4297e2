"""Maps, objects and cameras that extreme cases and tests share."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import reference
from .._fastibl import Camera, CubeMap, Mesh, Pose, texel_directions
from ..measuring.samples import units

# --- directions


def grazing() -> tuple[NDArray, NDArray]:
    """Normals and views at 0 to 90 degrees and a little below the surface."""
    n = np.repeat(units(40, 1), 6, axis=0)
    t = np.cross(n, units(len(n), 2))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    angle = np.radians(np.tile([0, 45, 80, 89.9, 90, 91], 40))[:, None]
    return n, np.cos(angle) * n + np.sin(angle) * t


# --- maps


def sun(radiance: float, texels: int, size: int = 32, ground: float = 0.2) -> NDArray[np.float64]:
    """Faces of even light, with a square of `texels` texels of that radiance around one place of the sky."""
    faces = np.full((6, size, size, 3), ground)
    side = round(texels**0.5)
    faces[4, 8 : 8 + side, 10 : 10 + side] = radiance
    return faces


def one_channel() -> NDArray[np.float64]:
    faces = np.zeros((6, 16, 16, 3))
    faces[..., 0] = 0.3
    faces[4, 3, 5, 0] = 500
    return faces


def coloured_lamps() -> NDArray[np.float64]:
    """A saturated blue and a red lamp, on opposite sides."""
    faces = np.full((6, 32, 32, 3), 0.05)
    faces[0, 10:13, 10:13] = (0, 0, 400)
    faces[1, 10:13, 20:23] = (400, 0, 0)
    return faces


def broken() -> NDArray[np.float64]:
    faces = np.ones((6, 8, 8, 3))
    faces[0, 0, 0], faces[1, 2, 3], faces[2, 4, 5], faces[3, 1, 1] = np.nan, np.inf, -np.inf, -1e4
    return faces


def two_suns() -> NDArray[np.float64]:
    faces = np.zeros((6, 32, 32, 3))
    faces[0, 15, 16] = faces[1, 15, 16] = 1e5
    return faces


def lamp_near(radiance: float = 400.0, degrees: float = 17.0) -> NDArray[np.float64]:
    """A lamp of 6 cm, 20 cm away: a disc that appears that wide, overhead."""
    d = texel_directions(32).astype(np.float64)
    lit = d @ np.array([0.3, 0.2, np.sqrt(1 - 0.13)]) > np.cos(np.radians(degrees))
    return np.where(lit[..., None], radiance, 0.1) * np.ones(3)


def light_below() -> NDArray[np.float64]:
    """A place in which the only light shines straight up from below."""
    faces = np.zeros((6, 16, 16, 3))
    faces[5, 6:10, 6:10] = 50
    return faces


def light_on_horizon() -> NDArray[np.float64]:
    """A lamp whose middle lies on the horizon."""
    faces = np.zeros((6, 32, 32, 3))
    d = texel_directions(32)
    faces[d @ np.array([1.0, 0, 0]) > np.cos(np.radians(5))] = 100
    return faces


MAPS = {
    "black": lambda: np.zeros((6, 8, 8, 3)),
    "tiny (1e-30)": lambda: np.full((6, 8, 8, 3), 1e-30),
    "dim (1e-8)": lambda: np.full((6, 8, 8, 3), 1e-8),
    "bright (1e8)": lambda: np.full((6, 8, 8, 3), 1e8),
    "huge (1e30)": lambda: np.full((6, 8, 8, 3), 1e30, np.float32),
    "one channel": one_channel,
    "NaN, infinite, negative": broken,
    "sun of 1e6 in one texel": lambda: sun(1e6, 1),
    "two opposite suns": two_suns,
    "blue and red lamps": coloured_lamps,
    "lamp 20 cm away": lamp_near,
    "light from below only": light_below,
    "light on the horizon": light_on_horizon,
    "1 x 1 faces": lambda: np.arange(1.0, 19.0).reshape(6, 1, 1, 3),
    "3 x 3 faces": lambda: np.random.default_rng(0).random((6, 3, 3, 3)),
    "1024 x 1024 faces": lambda: np.broadcast_to(np.linspace(0.1, 1, 1024)[:, None], (6, 1024, 1024, 3)),
}
# The light of maps that are the same everywhere; values above 1e9 are cut to 1e9.
CONSTANT = {"black": 0.0, "tiny (1e-30)": 1e-30, "dim (1e-8)": 1e-8, "bright (1e8)": 1e8, "huge (1e30)": 1e9}


@cache
def map_named(name: str) -> CubeMap:
    return CubeMap(np.asarray(MAPS[name]()))


@cache
def true_irradiance(name: str, count: int = 40) -> NDArray[np.float64]:
    """True irradiance for the first normals of `grazing`, one of every six, by brute force."""
    source = map_named(name)
    faces = source.faces
    if source.size > 128:
        faces = source.level(int(np.log2(source.size // 64)))
    elif source.size < 16:  # into pieces so small that one direction stands for each
        faces = faces.repeat(32, axis=1).repeat(32, axis=2)
    return reference.irradiance(faces, units(40, 1)[:count])


# --- objects


def ball_mesh(radius: float = 0.05, height: float = 0.06, steps: int = 24) -> Mesh:
    """A sphere of latitudes and longitudes, its middle `height` above the plane."""
    n = steps
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), np.linspace(0.02, np.pi - 0.02, n))
    vertices = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], -1).reshape(-1, 3)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n - 1), np.arange(2 * n), indexing="ij"))
    a, b = i * 2 * n + j, i * 2 * n + (j + 1) % (2 * n)
    c, d = a + 2 * n, b + 2 * n
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)])
    return Mesh((radius * vertices + (0, 0, height)).astype(np.float32), triangles)


def two_balls() -> Mesh:
    """A small one hides the light from a large one, which it touches."""
    ball = ball_mesh(steps=16)
    vertices = np.concatenate([ball.vertices, 0.4 * ball.vertices + np.array([0.02, -0.03, 0.12])])
    return Mesh(vertices, np.concatenate([ball.triangles, ball.triangles + len(ball.vertices)]))


def box_mesh(size: float = 0.06, lowest: float = 0.0) -> tuple[NDArray, NDArray]:
    corners = np.array([(x, y, z) for z in (0, 1) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    triangles = [(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4)]
    triangles += [(2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6), (1, 3, 5), (3, 7, 5)]
    return corners * size + (0, 0, lowest), np.array(triangles)


def _needles() -> tuple[NDArray, NDArray]:
    at = np.linspace(0, 0.05, 20)
    vertices = np.concatenate([[(x, 0, 0), (x + 1e-7, 0, 0), (x, 1e-7, 0.1)] for x in at])
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


# Vertices and triangles of meshes that are valid, however bad they are.
DEGENERATE = {
    "a whole box": box_mesh,
    "one triangle": lambda: (np.array([(0, 0, 0.01), (0.05, 0, 0.01), (0, 0.05, 0.04)]), np.array([(0, 1, 2)])),
    "a triangle without area": lambda: (np.array([(0, 0, 0.02)] * 3), np.array([(0, 1, 2)])),
    "a triangle that is a line": lambda: (
        np.array([(0, 0, 0), (0.05, 0, 0.02), (0.1, 0, 0.04)]),
        np.array([(0, 1, 2)]),
    ),
    "one vertex three times": lambda: (np.array([(0, 0, 0.02), (1, 1, 1)]), np.array([(0, 0, 0)])),
    "every triangle twice": lambda: (box_mesh()[0], np.concatenate([box_mesh()[1]] * 2)),
    "flipped inside out": lambda: (box_mesh()[0], box_mesh()[1][:, ::-1]),
    "half of it flipped": lambda: (box_mesh()[0], np.concatenate([box_mesh()[1][:6], box_mesh()[1][6:, ::-1]])),
    "open: a lid is missing": lambda: (box_mesh()[0], box_mesh()[1][4:]),
    "flat on the plane": lambda: (box_mesh()[0] * (1, 1, 0), box_mesh()[1]),
    "below the plane": lambda: box_mesh(lowest=-0.2),
    "cut by the plane": lambda: box_mesh(lowest=-0.03),
    "hovering": lambda: box_mesh(lowest=0.5),
    "needles": _needles,
    "a micrometre wide": lambda: box_mesh(1e-6),
    "a kilometre wide": lambda: box_mesh(1e3),
    "vertices of 1e30": lambda: box_mesh(1e30),
    "vertices of 1e-30": lambda: box_mesh(1e-30),
    "vertices that no triangle uses": lambda: (np.concatenate([box_mesh()[0], [(1e6, 0, 0)]]), box_mesh()[1]),
}


@cache
def degenerate(name: str) -> Mesh:
    return Mesh(*DEGENERATE[name]())


# --- cameras


def seen_from(eye: ArrayLike, target: ArrayLike = (0, 0, 0.05)) -> Pose:
    """camera_from_marker of a camera at `eye` that looks at the target."""
    from .views import looking

    return looking(np.asarray(target, float) - np.asarray(eye, float), eye)


PICTURE = Camera(64, 64, 60, 60, 32, 32)
FRONT = seen_from((0.0, -0.25, 0.12), (0.0, 0.0, 0.06))
