"""The built-in room: a box with windows, a ceiling light, a lamp and a table, ray-cast from any place in it.

Its light is computed once: the light that windows, ceiling light and lamp send directly to every surface (in closed
form), and a few reflections on a coarse grid of patches. Every surface is Lambertian, so its radiance does not depend
on the place from which it is seen: one picture of radiance is kept per surface and state of the lamp.

World = marker frame: the board's plane z = 0 is the table top, and the floor beyond it lies at the same
height.
"""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import CubeMap

LOWER = np.array([-2.6, -2.0, 0.0])  # corners of the room, metres
UPPER = np.array([3.4, 3.0, 2.6])
TABLE = np.array([1.0, 0.65])  # half sizes of the table top, metres
OBJECT = (0.0, 0.0, 0.06)  # where the middle of a virtual object is

_LAMP_CENTRE = np.array([0.9, -1.74, 1.25])  # a globe on the wall y = -2
_LAMP_RADIUS = 0.12
_LAMP_RADIANCE = np.array([1.0, 0.80, 0.55], np.float32) * 700

_DENSITY = 96  # texels per metre of walls, floor and ceiling
_TABLE_DENSITY = 500  # texels per metre of the table top
_TABLE_MARGIN = 0.04  # metres of floor around the table in the table's picture, so that its edge is smooth
_LIGHT_DENSITY = 20  # points per metre at which direct light is computed
_PATCHES = 16  # patches along each edge of a surface, for the reflections
_BOUNCES = 8
_PAD = 2  # texels around each surface in the atlas, so that interpolation never reads a neighbouring surface


def linear(colour: str) -> NDArray[np.float32]:
    """Linear RGB of "#rrggbb"."""
    encoded = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)


def wood(width: float, height: float, density: float, mean: ArrayLike, seed: int = 7) -> NDArray[np.float32]:
    """Albedo (h, w, 3) float32 of a table top of planks along x, with exactly this mean albedo.

    width, height: metres. density: texels a metre. mean: RGB.
    """
    rng = np.random.default_rng(seed)
    w, h = round(width * density), round(height * density)

    def noise(across: float, along: float) -> NDArray:  # stretched along the planks; in waves a metre
        coarse = rng.standard_normal((max(2, round(height * across)), max(2, round(width * along))))
        return cv2.resize(coarse.astype(np.float32), (w, h), interpolation=cv2.INTER_CUBIC)

    y = (np.arange(h, dtype=np.float32) / density)[:, None]
    planks = max(1, round(height / 0.13))
    plank = np.minimum((y * planks / height).astype(int), planks - 1)
    tone = rng.normal(0, 0.06, planks).astype(np.float32)[plank]
    rings = np.sin(2 * np.pi * (y * 55 + 1.3 * noise(9, 1.5) + 7 * rng.random(planks).astype(np.float32)[plank]))
    grain = 0.035 * rings + 0.03 * noise(220, 5) + 0.03 * noise(60, 2) + 0.02 * noise(500, 14)
    gap = np.abs(y * planks / height - np.round(y * planks / height)) * (height / planks)
    shade = (1 + tone + grain) * np.where((gap < 0.0012) & (y > 0.01) & (y < height - 0.01), 0.72, 1)
    shade = np.clip(shade, 0.5, 1.4).astype(np.float32)
    tint = np.stack([shade**0.85, shade, shade**1.25], axis=-1)  # darker wood is redder
    tint /= tint.mean(axis=(0, 1))
    mean = np.asarray(mean, np.float32)
    contrast = np.minimum(1, (1 / np.maximum(mean, 1e-6) - 1) / (tint.max(axis=(0, 1)) - 1))  # no texel exceeds 1
    return mean * (1 + contrast * (tint - 1))


class _Surface:
    """One side of the room. `u` grows to the right and `v` downwards, as seen from inside."""

    def __init__(self, origin: ArrayLike, u: ArrayLike, v: ArrayLike, size: tuple[float, float]):
        self.origin, self.u, self.v = (np.asarray(a, np.float64) for a in (origin, u, v))
        self.size = size  # metres along u and v
        self.normal = np.cross(self.v, self.u)  # points into the room
        self.density = 2 * _DENSITY  # painted at twice the density, then averaged
        shape = (round(size[1] * self.density), round(size[0] * self.density), 3)
        self.albedo = np.zeros(shape, np.float32)
        self.emission = np.zeros(shape, np.float32)
        self.emitters: list[tuple[float, float, float, float]] = []  # rectangles (u0, v0, u1, v1)

    def rectangle(self, u0, z0, u1, z1, colour, emission=False):
        """Fills a rectangle given in metres from the left and from the bottom."""
        rows, columns = self._slice(u0, z0, u1, z1)
        (self.emission if emission else self.albedo)[rows, columns] = (
            linear(colour) if isinstance(colour, str) else colour
        )

    def blend(self, u0, z0, u1, z1, factor):
        rows, columns = self._slice(u0, z0, u1, z1)
        self.albedo[rows, columns] *= np.asarray(factor, np.float32)

    def disc(self, u, z, radius, colour):
        d, h = self.density, self.size[1]
        cv2.circle(self.albedo, (round(u * d), round((h - z) * d)), round(radius * d), linear(colour).tolist(), -1)

    def polygon(self, points, colour):
        d, h = self.density, self.size[1]
        corners = np.round([(u * d, (h - z) * d) for u, z in points]).astype(np.int32)
        cv2.fillPoly(self.albedo, [corners], linear(colour).tolist())

    def _slice(self, u0, z0, u1, z1):
        d, h = self.density, self.size[1]
        return slice(round((h - z1) * d), round((h - z0) * d)), slice(round(u0 * d), round(u1 * d))

    def finish(self):
        def halve(image):
            h, w = image.shape[:2]
            return cv2.resize(image, (w // 2, h // 2), interpolation=cv2.INTER_AREA)

        self.albedo, self.emission = halve(self.albedo), halve(self.emission)
        self.density = _DENSITY

    def points(self, width: int, height: int) -> NDArray:
        """The middles (height, width, 3) of the cells of a grid over the surface, metres."""
        u = (np.arange(width) + 0.5) / width * self.size[0]
        v = (np.arange(height) + 0.5) / height * self.size[1]
        return self.origin + u[None, :, None] * self.u + v[:, None, None] * self.v

    def corners(self, u0, v0, u1, v1) -> NDArray:
        """The corners (4, 3) of a rectangle, clockwise as seen from inside."""
        return np.array([self.origin + u * self.u + v * self.v for u, v in ((u0, v0), (u1, v0), (u1, v1), (u0, v1))])


def _window(wall: _Surface, u0, z0, u1, z1, rng):
    """A window with four panes: sky, a few clouds, roofs and trees below."""
    rows, columns = wall._slice(u0, z0, u1, z1)
    height, width = rows.stop - rows.start, columns.stop - columns.start
    v = np.linspace(0, 1, height, dtype=np.float32)[:, None, None]
    sky = (1 - v) * np.array([32, 41, 56], np.float32) + v * np.array([52, 54, 55], np.float32)
    sky = np.broadcast_to(sky, (height, width, 3)).copy()
    clouds = sum(
        cv2.resize(rng.standard_normal((n, n + 1)).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
        * weight
        for n, weight in ((4, 1.0), (8, 0.5), (16, 0.25))
    )
    sky += np.clip(clouds - 0.7, 0, 1.2)[..., None] * np.array([110, 106, 100], np.float32)
    x = 0  # a row of houses and trees in front of it
    while x < width:
        step = int(rng.integers(width // 9, width // 5))
        top = int(height * rng.uniform(0.58, 0.75))
        sky[top:, x : x + step] = linear(str(rng.choice(["#b9a08a", "#a88672", "#c9bda9", "#8f8a88"]))) * 34
        for wy in range(top + 8, height, 16):
            for wx in range(x + 6, min(x + step, width) - 8, 14):
                sky[wy : wy + 8, wx : wx + 6] *= 0.45
        sky[top - 5 : top, x : x + step] = linear("#7a4a3c") * 22
        x += step
    for _ in range(9):
        at = (int(rng.integers(0, width)), int(height * rng.uniform(0.93, 1.05)))
        cv2.circle(sky, at, int(height * rng.uniform(0.09, 0.17)), (linear("#4c6b35") * 22).tolist(), -1)
    wall.rectangle(u0 - 0.08, z0 - 0.08, u1 + 0.08, z1 + 0.08, "#e9e6df")
    wall.rectangle(u0 - 0.13, z0 - 0.12, u1 + 0.13, z0 - 0.08, "#d8d4cb")
    wall.rectangle(u0, z0, u1, z1, "#000000")
    wall.emission[rows, columns] = sky
    bar, mu, mz = 0.025, (u0 + u1) / 2, z0 + 0.68 * (z1 - z0)
    for a, b, c, d in ((mu - bar, z0, mu + bar, z1), (u0, mz - bar, u1, mz + bar)):
        wall.rectangle(a, b, c, d, "#e9e6df")
        wall.rectangle(a, b, c, d, (0, 0, 0), emission=True)
    h, n = wall.size[1], 3
    for i in range(n):
        for j in range(n):
            wall.emitters.append(
                (
                    u0 + (u1 - u0) * i / n,
                    h - z1 + (z1 - z0) * j / n,
                    u0 + (u1 - u0) * (i + 1) / n,
                    h - z1 + (z1 - z0) * (j + 1) / n,
                )
            )
    for side in (u0 - 0.38, u1 + 0.12):  # curtains, with folds
        wall.rectangle(side, 0.12, side + 0.26, z1 + 0.2, "#c9962f")
        for k in range(5):
            wall.blend(side + 0.052 * k, 0.12, side + 0.052 * k + 0.018, z1 + 0.2, 0.7)
    wall.rectangle(u0 - 0.42, z1 + 0.19, u1 + 0.42, z1 + 0.22, "#4a3a2c")


def _picture(wall: _Surface, u0, z0, u1, z1, frame, background, shapes):
    wall.rectangle(u0 - 0.05, z0 - 0.05, u1 + 0.05, z1 + 0.05, frame)
    wall.rectangle(u0 - 0.02, z0 - 0.02, u1 + 0.02, z1 + 0.02, "#f2efe8")
    wall.rectangle(u0, z0, u1, z1, background)
    for kind, *numbers, colour in shapes:
        if kind == "disc":
            wall.disc(u0 + numbers[0], z0 + numbers[1], numbers[2], colour)
        else:
            wall.rectangle(u0 + numbers[0], z0 + numbers[1], u0 + numbers[2], z0 + numbers[3], colour)


def _paint_north(wall: _Surface, rng):
    """y = +3: bookshelf, sofa, a picture."""
    wall.albedo[:] = linear("#d9d2c4")
    wall.rectangle(0.5, 0, 2.7, 2.0, "#5a3d28")
    for shelf in range(5):
        z = 0.06 + shelf * 0.39
        wall.rectangle(0.55, z, 2.65, z + 0.35, "#2e2018")
        u = 0.57
        while u < 2.58:
            w = rng.uniform(0.022, 0.06)
            if rng.random() < 0.08:
                u += rng.uniform(0.05, 0.2)
                continue
            spine = str(
                rng.choice(["#9c2f2a", "#2f5b8a", "#3d7a4a", "#d6a93b", "#e4dcc8", "#6a4a7d", "#1f2d3d", "#c2643a"])
            )
            top = z + rng.uniform(0.2, 0.32)
            wall.rectangle(u, z, min(u + w, 2.64), top, spine)
            wall.blend(u, z, u + 0.004, top, 0.45)
            wall.blend(u, top - 0.07, min(u + w, 2.64), top - 0.055, 1.5)
            u += w
    wall.rectangle(3.2, 0.08, 5.5, 0.42, "#28518f")
    wall.rectangle(3.3, 0.42, 5.4, 0.8, "#2f5fa6")
    wall.rectangle(3.1, 0.08, 3.35, 0.6, "#234a85")
    wall.rectangle(5.35, 0.08, 5.6, 0.6, "#234a85")
    for u in (4.0, 4.7):
        wall.blend(u - 0.008, 0.42, u + 0.008, 0.8, 0.6)
    wall.polygon([(3.45, 0.42), (3.9, 0.46), (3.86, 0.78), (3.5, 0.74)], "#e0b13c")
    wall.polygon([(4.9, 0.44), (5.28, 0.42), (5.3, 0.76), (4.94, 0.76)], "#c8553d")
    _picture(
        wall,
        3.7,
        1.2,
        5.0,
        2.0,
        "#3b2a1e",
        "#f0b06a",
        [
            ("disc", 0.85, 0.42, 0.17, "#fbe6a2"),
            ("box", 0, 0, 1.3, 0.3, "#2b5f73"),
            ("box", 0, 0.3, 1.3, 0.36, "#d2693f"),
            ("box", 0.7, 0.1, 1.0, 0.13, "#f6d08f"),
        ],
    )


def _paint_east(wall: _Surface, rng):
    """x = +3.4: a warm wall with the door, a red poster, a plant."""
    wall.albedo[:] = linear("#cf9a6b")
    wall.rectangle(0.6, 0, 1.72, 2.16, "#ece8de")
    wall.rectangle(0.68, 0, 1.64, 2.08, "#7b5233")
    for z0, z1 in ((0.15, 0.85), (1.0, 1.95)):
        for u0 in (0.78, 1.2):
            wall.rectangle(u0, z0, u0 + 0.34, z1, "#5f3d25")
            wall.rectangle(u0 + 0.02, z0 + 0.02, u0 + 0.32, z1 - 0.02, "#855a39")
    wall.disc(1.56, 0.93, 0.035, "#e8cf7a")
    _picture(
        wall,
        2.35,
        0.75,
        3.15,
        1.9,
        "#1c1c1c",
        "#b3202a",
        [
            ("disc", 0.4, 0.72, 0.26, "#f4ead6"),
            ("disc", 0.5, 0.78, 0.2, "#b3202a"),
            ("box", 0.1, 0.12, 0.7, 0.2, "#f4ead6"),
            ("box", 0.1, 0.26, 0.5, 0.31, "#f4ead6"),
        ],
    )
    wall.polygon([(4.05, 0.0), (4.45, 0.0), (4.52, 0.38), (3.98, 0.38)], "#d8d4cc")
    for _ in range(46):
        angle, length = rng.uniform(0.35, np.pi - 0.35), rng.uniform(0.35, 0.95)
        tip = (4.25 + np.cos(angle) * length * 0.75, 0.38 + np.sin(angle) * length)
        side = 0.035 * np.array([-np.sin(angle), np.cos(angle)])
        middle = np.array([4.25 + np.cos(angle) * length * 0.4, 0.38 + np.sin(angle) * length * 0.55])
        green = str(rng.choice(["#2f6b35", "#3f8a44", "#245229", "#62a04f"]))
        wall.polygon([(4.25, 0.38), tuple(middle + side), tip, tuple(middle - side)], green)


def _paint_south(wall: _Surface, rng):
    """y = -2: a teal wall with the lamp's bracket, three small pictures, a clock, a sideboard."""
    wall.albedo[:] = linear("#3f8f8c")
    u = UPPER[0] - _LAMP_CENTRE[0]
    wall.rectangle(u - 0.025, 0.95, u + 0.025, 1.25, "#b08d4a")
    wall.disc(u, 0.95, 0.06, "#b08d4a")
    for k, (background, accent) in enumerate((("#f3d9c6", "#c2452d"), ("#dfe8c9", "#3d6b35"), ("#cfdcec", "#23406e"))):
        a = 0.45 + 0.6 * k
        _picture(
            wall,
            a,
            1.25,
            a + 0.4,
            1.8,
            "#f7f5f0",
            background,
            [("disc", 0.2, 0.3, 0.13, accent), ("box", 0.05, 0.06, 0.35, 0.1, accent)],
        )
    wall.disc(4.3, 1.75, 0.24, "#20242a")
    wall.disc(4.3, 1.75, 0.215, "#f4f1ea")
    for hour in range(12):
        a = hour * np.pi / 6
        wall.disc(4.3 + 0.18 * np.sin(a), 1.75 + 0.18 * np.cos(a), 0.013, "#20242a")
    wall.polygon([(4.29, 1.75), (4.31, 1.75), (4.36, 1.87)], "#20242a")
    wall.polygon([(4.3, 1.74), (4.3, 1.76), (4.14, 1.8)], "#c2452d")
    wall.rectangle(3.5, 0.0, 5.7, 0.7, "#e6dfd0")
    wall.rectangle(3.5, 0.66, 5.7, 0.7, "#a87b4f")
    for a in (3.55, 4.28, 5.01):
        wall.rectangle(a, 0.05, a + 0.66, 0.62, "#f1ece1")
        wall.disc(a + 0.33, 0.52, 0.018, "#5c5c5c")
    wall.polygon([(5.1, 0.7), (5.35, 0.7), (5.4, 0.98), (5.3, 1.05), (5.15, 1.05), (5.05, 0.98)], "#d0472f")


def _paint_west(wall: _Surface, rng):
    """x = -2.6: two windows with curtains, radiators below."""
    wall.albedo[:] = linear("#dcd8d0")
    for u0 in (0.65, 3.0):
        _window(wall, u0, 0.6, u0 + 1.2, 1.95, rng)
        wall.rectangle(u0 + 0.05, 0.08, u0 + 1.15, 0.44, "#f0eee9")
        for k in range(18):
            wall.blend(u0 + 0.08 + 0.06 * k, 0.12, u0 + 0.1 + 0.06 * k, 0.4, 0.72)


def _paint_ceiling(wall: _Surface, rng):
    wall.albedo[:] = linear("#ebe8e2")
    for u0 in (2.0,):
        v0, v1 = 2.2, 2.8
        wall.rectangle(u0 - 0.03, wall.size[1] - v1 - 0.03, u0 + 1.23, wall.size[1] - v0 + 0.03, "#b9b9b9")
        wall.rectangle(u0, wall.size[1] - v1, u0 + 1.2, wall.size[1] - v0, "#000000")
        wall.rectangle(u0, wall.size[1] - v1, u0 + 1.2, wall.size[1] - v0, (24.0, 23.0, 21.0), emission=True)
        wall.emitters.append((u0, v0, u0 + 1.2, v1))


def _paint_floor(wall: _Surface, rng):
    height, width = wall.albedo.shape[:2]
    wall.albedo[:] = linear("#57545c")
    wall.rectangle(0.9, 0.55, 5.1, 4.35, "#6b2f33")
    wall.rectangle(1.05, 0.7, 4.95, 4.2, "#b5a27c")
    wall.rectangle(1.12, 0.77, 4.88, 4.13, "#4d5a75")
    pile = rng.standard_normal((height // 3, width // 3)).astype(np.float32)
    pile = cv2.resize(pile, (width, height), interpolation=cv2.INTER_LINEAR)
    wall.albedo *= np.clip(1 + 0.09 * pile, 0.6, 1.4)[..., None]


def _rectangle_irradiance(points: NDArray, normal: NDArray, corners: NDArray) -> NDArray:
    """Irradiance (...) at points (..., 3) from a rectangle of radiance 1 that is wholly above their horizon.

    Lambert 1760: half the sum over the edges of the angle that an edge subtends, times the cosine between the normal
    and the normal of the plane through the edge and the point.
    """
    arrows = corners[:, None, :] - points.reshape(1, -1, 3)
    arrows /= np.maximum(np.linalg.norm(arrows, axis=-1, keepdims=True), 1e-9)
    total = 0
    for a, b in zip(arrows, np.roll(arrows, -1, axis=0), strict=True):
        across = np.cross(a, b)
        sine = np.linalg.norm(across, axis=-1)
        total += np.arctan2(sine, np.sum(a * b, axis=-1)) * (across @ normal) / np.maximum(sine, 1e-12)
    return np.maximum(total / 2, 0).reshape(points.shape[:-1])


def _sphere_irradiance(points: NDArray, normal: NDArray) -> NDArray:
    """Irradiance (...) at points from the lamp at radiance 1, if it is wholly above their horizon."""
    arrow = _LAMP_CENTRE - points
    squared = np.sum(arrow * arrow, axis=-1)
    return np.pi * _LAMP_RADIUS**2 * np.maximum(arrow @ normal, 0) / squared**1.5


class Room:
    """A furnished room of 6 x 5 x 2.6 m around the marker, with two windows, a ceiling light and a lamp.

    The plane z = 0 is a wooden table of 2.0 x 1.3 m with a darker floor around it. The lamp, 2.5 m from the
    marker, is on or off: every method takes `lamp`. albedo: the table's mean albedo, a number or RGB.
    """

    def __init__(self, albedo: ArrayLike | None = None):
        rng = np.random.default_rng(20140)
        (x0, y0, z0), (x1, y1, z1) = LOWER, UPPER
        w, d, h = UPPER - LOWER
        # In the order in which `_locate` numbers them: x+, x-, y+, y-, z+ (ceiling), z- (floor).
        self._surfaces = [
            _Surface((x1, y1, z1), (0, -1, 0), (0, 0, -1), (d, h)),
            _Surface((x0, y0, z1), (0, 1, 0), (0, 0, -1), (d, h)),
            _Surface((x0, y1, z1), (1, 0, 0), (0, 0, -1), (w, h)),
            _Surface((x1, y0, z1), (-1, 0, 0), (0, 0, -1), (w, h)),
            _Surface((x0, y0, z1), (1, 0, 0), (0, 1, 0), (w, d)),
            _Surface((x0, y1, z0), (1, 0, 0), (0, -1, 0), (w, d)),
        ]
        painters = (_paint_east, _paint_west, _paint_north, _paint_south, _paint_ceiling, _paint_floor)
        for surface, paint in zip(self._surfaces, painters, strict=True):
            paint(surface, rng)
            surface.finish()
        self.albedo = table_albedo(albedo)
        floor = self._surfaces[5]
        left, top = -TABLE[0] - x0, y1 - TABLE[1]  # the place of the table in the floor's coarse picture
        rows = slice(round(top * _DENSITY), round((top + 2 * TABLE[1]) * _DENSITY))
        columns = slice(round(left * _DENSITY), round((left + 2 * TABLE[0]) * _DENSITY))
        floor.albedo[rows, columns] = self.albedo
        self._direct = {False: self._light_of_rectangles(), True: self._light_of_lamp()}
        self._reflected = {source: self._reflections(self._direct[source]) for source in (False, True)}
        self._lay_out()

    # light

    def _light_of_rectangles(self) -> list[NDArray]:
        out = []
        for surface in self._surfaces:
            height, width = surface.albedo.shape[:2]
            small = [max(4, round(s * _LIGHT_DENSITY)) for s in surface.size]
            points = surface.points(*small)
            light = np.zeros((*points.shape[:2], 3))
            for other in self._surfaces:
                if other is surface:
                    continue
                d = other.density
                for u0, v0, u1, v1 in other.emitters:
                    pane = other.emission[round(v0 * d) : round(v1 * d), round(u0 * d) : round(u1 * d)]
                    radiance = pane.mean(axis=(0, 1), dtype=np.float64)
                    corners = other.corners(u0, v0, u1, v1)
                    light += _rectangle_irradiance(points, surface.normal, corners)[..., None] * radiance
            out.append(cv2.resize(light.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR))
        return out

    def _light_of_lamp(self) -> list[NDArray]:
        out = []
        for surface in self._surfaces:
            height, width = surface.albedo.shape[:2]
            shape = _sphere_irradiance(surface.points(width, height), surface.normal)
            out.append(shape[..., None].astype(np.float32) * _LAMP_RADIANCE)
        return out

    @cached_property
    def _form_factors(self) -> NDArray:
        """Share (n, n) of the light that patch i gets from patch j; rows sum to 1, as the room is closed."""
        middles = np.concatenate([s.points(_PATCHES, _PATCHES).reshape(-1, 3) for s in self._surfaces])
        normals = np.repeat([s.normal for s in self._surfaces], _PATCHES**2, axis=0)
        areas = np.repeat([s.size[0] * s.size[1] / _PATCHES**2 for s in self._surfaces], _PATCHES**2)
        squared = np.sum(middles**2, axis=1)
        squared = np.maximum(squared[:, None] + squared - 2 * middles @ middles.T, 1e-9)
        here = normals @ middles.T - np.sum(normals * middles, axis=1)[:, None]  # n_i . (x_j - x_i)
        factors = np.maximum(here, 0) * np.maximum(here.T, 0) / squared
        factors *= areas / (np.pi * squared + areas)  # as if the patch were a disc of the same area
        return factors / factors.sum(axis=1, keepdims=True)

    def _reflections(self, direct: list[NDArray]) -> list[NDArray]:
        def patches(images):
            small = [cv2.resize(i, (_PATCHES, _PATCHES), interpolation=cv2.INTER_AREA) for i in images]
            return np.stack(small).reshape(-1, 3).astype(np.float64)

        albedo = patches([s.albedo for s in self._surfaces])
        first = patches([s.albedo * light for s, light in zip(self._surfaces, direct, strict=True)])
        light = np.zeros_like(first)
        for _ in range(_BOUNCES):
            light = self._form_factors @ (first + albedo * light)
        grids = light.reshape(6, _PATCHES, _PATCHES, 3).astype(np.float32)
        return [
            np.maximum(cv2.resize(g, s.albedo.shape[1::-1], interpolation=cv2.INTER_CUBIC), 0)
            for g, s in zip(grids, self._surfaces, strict=True)
        ]

    def _irradiance_picture(self, index: int, lamp: bool, reflected: bool = True) -> NDArray:
        states = (False, True) if lamp else (False,)
        light = np.sum([self._direct[state][index] for state in states], axis=0)
        return light + np.sum([self._reflected[state][index] for state in states], axis=0) if reflected else light

    def irradiance(self, points: ArrayLike, lamp: bool = False, reflected: bool = True) -> NDArray[np.float32]:
        """Irradiance (..., 3) of the table and the floor at points (..., 2) in metres.

        reflected: False leaves out the light reflected by walls, floor or ceiling.
        """
        p = np.asarray(points, np.float32)
        x = (p[..., 0] - LOWER[0]) * _DENSITY - 0.5
        y = (UPPER[1] - p[..., 1]) * _DENSITY - 0.5
        return _look_up(self._irradiance_picture(5, lamp, reflected), x, y, cv2.BORDER_REPLICATE)

    # pictures

    def _lay_out(self):
        """Packs the radiance of all surfaces into one picture for each state of the lamp."""
        half = TABLE + _TABLE_MARGIN
        shape = tuple(np.round(2 * half * _TABLE_DENSITY).astype(int))[::-1]
        top = wood(2 * TABLE[0], 2 * TABLE[1], _TABLE_DENSITY, self.albedo)
        x = ((np.arange(shape[1]) + 0.5) / _TABLE_DENSITY - half[0]).astype(np.float32)
        y = (half[1] - (np.arange(shape[0]) + 0.5) / _TABLE_DENSITY).astype(np.float32)
        grid = np.stack(np.meshgrid(x, y), axis=-1)
        beyond = _look_up(
            self._surfaces[5].albedo,
            *(
                ((grid[..., 0] * (1 + 0.1) - LOWER[0]) * _DENSITY),  # looks beyond the table's blurred edge
                ((UPPER[1] - grid[..., 1] * (1 + 0.1)) * _DENSITY),
            ),
            cv2.BORDER_REPLICATE,
        )
        border = round(_TABLE_MARGIN * _TABLE_DENSITY)
        table = beyond
        table[border : border + top.shape[0], border : border + top.shape[1]] = top
        for k in range(4):  # a rounded edge
            table[border + k, border:-border] *= 0.7 + 0.07 * k
            table[-border - 1 - k, border:-border] *= 0.7 + 0.07 * k
            table[border:-border, border + k] *= 0.7 + 0.07 * k
            table[border:-border, -border - 1 - k] *= 0.7 + 0.07 * k
        tiles = [s.albedo for s in self._surfaces] + [table]
        width = max(t.shape[1] for t in tiles) + 2 * _PAD
        places, column, row, deepest = [], 0, 0, 0
        for tile in tiles:
            h, w = tile.shape[0] + 2 * _PAD, tile.shape[1] + 2 * _PAD
            if column + w > width:
                column, row, deepest = 0, row + deepest, 0
            places.append((row, column))
            column, deepest = column + w, max(deepest, h)
        self._atlas = {}
        for lamp in (False, True):
            atlas = np.zeros((row + deepest, width, 3), np.float32)
            light = [self._irradiance_picture(i, lamp) for i in range(6)]
            radiance = [s.albedo * e / np.pi + s.emission for s, e in zip(self._surfaces, light, strict=True)]
            radiance.append(table * self.irradiance(grid, lamp) / np.float32(np.pi))
            for (r, c), tile in zip(places, radiance, strict=True):
                padded = cv2.copyMakeBorder(tile, _PAD, _PAD, _PAD, _PAD, cv2.BORDER_REPLICATE)
                atlas[r : r + padded.shape[0], c : c + padded.shape[1]] = padded
            self._atlas[lamp] = atlas
        # Atlas column = scale * a + shift, where a is y on the x walls and x elsewhere. The row is found likewise, from
        # z on the walls and from y on floor and ceiling.
        table_frame = (np.array([-half[0], half[1], 0]), np.array([1, 0, 0]), np.array([0, -1, 0]))
        frames = [(s.origin, s.u, s.v) for s in self._surfaces] + [table_frame]
        columns, rows = [], []
        for k, ((origin, u, v), (r, c)) in enumerate(zip(frames, places, strict=True)):
            density = _DENSITY if k < 6 else _TABLE_DENSITY
            for axis, corner, out in ((u, c, columns), (v, r, rows)):
                scale = density * axis.sum()
                out.append((scale, corner + _PAD - 0.5 - density * (axis @ origin)))
        self._columns = np.array(columns, np.float32).T.copy()
        self._rows = np.array(rows, np.float32).T.copy()
        # When the lamp is off, its glass is about as bright as paper there.
        near = np.mean([self._irradiance_picture(3, False).mean(axis=(0, 1))], axis=0)
        self._glass = (0.8 * near / np.pi).astype(np.float32)

    def _locate(self, origin: tuple, dx: NDArray, dy: NDArray, dz: NDArray) -> tuple[NDArray, NDArray]:
        """Atlas coordinates (float32) of the points that rays from inside the room meet."""
        ox, oy, oz = origin
        with np.errstate(divide="ignore", invalid="ignore"):
            tx = (np.where(dx > 0, np.float32(UPPER[0]), np.float32(LOWER[0])) - ox) / dx
            ty = (np.where(dy > 0, np.float32(UPPER[1]), np.float32(LOWER[1])) - oy) / dy
            tz = (np.where(dz > 0, np.float32(UPPER[2]), np.float32(LOWER[2])) - oz) / dz
        for t, d in ((tx, dx), (ty, dy), (tz, dz)):  # no ray along a wall meets it, also from on it
            np.abs(t, out=t)
            t[d == 0] = np.inf
        t = np.minimum(np.minimum(tx, ty), tz)
        on_x, on_z = t == tx, t == tz
        px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
        index = np.where(on_z, 4 + (dz < 0), np.where(on_x, 0 + (dx < 0), 2 + (dy < 0)).astype(np.uint8))
        half = (TABLE + _TABLE_MARGIN).astype(np.float32)
        index[on_z & (dz < 0) & (np.abs(px) < half[0]) & (np.abs(py) < half[1])] = 6
        a = np.where(on_x & ~on_z, py, px)
        b = np.where(on_z, py, pz)
        return (
            self._columns[0][index] * a + self._columns[1][index],
            self._rows[0][index] * b + self._rows[1][index],
        )

    def radiance(
        self, position: ArrayLike, directions: ArrayLike, lamp: bool = False, unit: bool = False
    ) -> NDArray[np.float32]:
        """Radiance (..., 3) float32 that arrives at `position` from `directions` (..., 3), marker frame.

        position: (3,) or the shape of directions, metres, inside the room. unit: whether the directions have length 1
        already. Raises ValueError for a position outside.
        """
        p = np.asarray(position, np.float64)
        d = np.asarray(directions, np.float32)
        if d.ndim < 1 or d.shape[-1] != 3 or p.shape[-1:] != (3,):
            raise ValueError(f"position and directions must have shape (..., 3), got {p.shape} and {d.shape}")
        if not np.all((p >= LOWER) & (p <= UPPER)):
            raise ValueError(f"position must lie in the room, between {LOWER.tolist()} and {UPPER.tolist()}")
        if not unit:
            d = d / np.linalg.norm(d, axis=-1, keepdims=True)
        if d.ndim == 1:
            return self.radiance(p, d[None], lamp, unit=True)[0]
        dx, dy, dz = (np.ascontiguousarray(d[..., i]) for i in range(3))
        o = tuple(p[..., i].astype(np.float32) for i in range(3))
        columns, rows = self._locate(o, dx, dy, dz)
        out = _look_up(self._atlas[bool(lamp)], columns, rows, cv2.BORDER_REPLICATE)
        cx, cy, cz = (np.float32(c) - q for c, q in zip(_LAMP_CENTRE, o, strict=True))
        along = dx * cx + dy * cy + dz * cz
        squared = cx * cx + cy * cy + cz * cz
        inside = along * along - squared + np.float32(_LAMP_RADIUS**2)
        hit = (inside > 0) & (along > 0)
        if hit.any():
            if lamp:
                out[hit] = _LAMP_RADIANCE
            else:  # brighter towards the windows
                side = (cx - (along - np.sqrt(np.maximum(inside, 0))) * dx)[hit] / np.float32(_LAMP_RADIUS)
                out[hit] = self._glass * (1 + 0.35 * side)[:, None]
        return out

    def truth(self, position: ArrayLike = OBJECT, size: int = 128, lamp: bool = False, samples: int = 4) -> CubeMap:
        """The true environment map at a place: radiance averaged over each texel by samples x samples rays.

        position: (3,) metres, by default the middle of a virtual object on the board. Below the horizon the map holds
        the table as it is without the printed board. An object is really lit by the board, but its mean albedo and the
        table's agree to a few per cent, and measurements mask the board and fill it from around.
        """
        return truth_map(lambda d: self.radiance(position, d, lamp), size, samples)


def table_albedo(albedo: ArrayLike | None) -> NDArray[np.float32]:
    """RGB albedo of a table: None is light wood, a number is wood of that mean, RGB is taken as it is. Wood beyond 0.77
    is the less coloured the brighter it is, because no channel exceeds 1."""
    wooden = np.array([0.645, 0.50, 0.355], np.float32)
    if albedo is None:
        return wooden
    a = np.asarray(albedo, np.float32)
    if a.shape not in ((), (3,)) or not (np.all(a >= 0) and np.all(a <= 1)):
        raise ValueError(f"albedo must be a number or RGB with values in [0, 1], got {albedo!r}")
    if a.ndim == 0:
        tint = wooden * (a / wooden.mean()) - a
        a = a + tint * min(1, (1 - a) / max(tint.max(), 1e-6))
    return a


def truth_map(radiance, size: int, samples: int) -> CubeMap:
    """Cube map of a function of directions, averaged over samples x samples points of each texel."""
    if size < 1 or samples < 1:
        raise ValueError(f"size and samples must be at least 1, got {size} and {samples}")
    n = size * samples
    grid = ((np.arange(n, dtype=np.float32) + 0.5) / n * 2 - 1).astype(np.float32)
    s, t = np.meshgrid(grid, grid)
    one = np.ones_like(s)
    faces = np.empty((6, size, size, 3), np.float32)
    for face, (x, y, z) in enumerate(
        ((one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one))
    ):
        fine = radiance(np.stack([x, y, z], axis=-1))
        faces[face] = fine.reshape(size, samples, size, samples, 3).mean(axis=(1, 3))
    return CubeMap(faces)


def _look_up(image: NDArray, x: NDArray, y: NDArray, border: int) -> NDArray[np.float32]:
    """Bilinear look-up at columns x and rows y of any shape; whole numbers are the middles of texels."""
    shape = x.shape
    x, y = np.asarray(x, np.float32), np.asarray(y, np.float32)
    if x.ndim == 2 and max(x.shape) < 32767:  # shapes that cv2.remap takes
        return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=border)
    width = 1024
    padding = -x.size % width
    x = np.pad(x.reshape(-1), (0, padding), mode="edge" if x.size else "constant").reshape(-1, width)
    y = np.pad(y.reshape(-1), (0, padding), mode="edge" if y.size else "constant").reshape(-1, width)
    parts = [
        cv2.remap(image, x[i : i + 16384], y[i : i + 16384], cv2.INTER_LINEAR, borderMode=border)
        for i in range(0, len(x), 16384)
    ]
    flat = np.concatenate(parts).reshape(-1, 3) if parts else np.zeros((0, 3), np.float32)
    return flat[: flat.shape[0] - padding].reshape(*shape, 3)
