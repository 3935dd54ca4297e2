"""Recordings by a hand-held rig in a place whose light is known: a room, or any map at infinity."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn, Protocol, cast

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import (
    Board,
    Camera,
    CubeMap,
    Environment,
    Pose,
    Rig,
    cubemap_from_equirect,
    texel_directions,
    texel_solid_angles,
)
from .environment_files import read_environment
from .expected import expect
from .pictures import LINEAR, read_picture
from .recording import Frame, Recording, RecordingWriter, Truth
from .room import OBJECT, TABLE, Room, _look_up, table_albedo, truth_map, wood
from .shutter import Shutter, bands, row_times

PAPER, INK = 0.80, 0.045  # albedo of the printed page's white and black
FRONT_STEPS = (1.0, 1 / 16, 1 / 256)  # the front camera's exposures, which it takes in turn

_FULL_WELL, _READ_NOISE = 4000, 6  # electrons
_BLUR = 0.55  # standard deviation of the lens's blur, in pixels
_TABLE_LEVEL = 0.30  # mean of the table in the back pictures, as a share of white
_FRONT_LEVEL = 0.18  # mean of all that the front camera can see, as a share of white: cameras meter like this
# For a camera that sets its exposure by its last picture: which share of the pixels is to lie below which level, the
# least and largest factor from one picture to the next, and how many times longer than the table's exposure it may
# become.
_METERED_SHARE, _METERED_LEVEL, _METERED_STEPS, _METERED_MOST = 0.97, 0.7, (0.5, 1.4), 8.0
_HAND_FADE = 0.12  # seconds in which the hand appears and disappears


class Place(Protocol):
    """What the simulator asks of a place; Room and DistantPlace are such places."""

    def radiance(self, position: ArrayLike, directions: ArrayLike, lamp: bool, unit: bool) -> NDArray: ...

    def irradiance(self, points: ArrayLike, lamp: bool) -> NDArray: ...

    def truth(self, position: ArrayLike, size: int, lamp: bool) -> CubeMap: ...


class DistantPlace:
    """An environment map at infinity above the horizon, and below it an opaque wooden table that it lights.

    environment: CubeMap, or equirectangular picture (h, 2h, 3) of any float dtype. albedo: of the table, a number or
    RGB; far from the marker the table looks plain.
    """

    _DENSITY = 500  # texels per metre of the table
    _PLAIN = (1.2, 2.5)  # distances from the marker, in metres, between which the grain fades

    def __init__(self, environment: CubeMap | ArrayLike, albedo: ArrayLike | None = None):
        if isinstance(environment, CubeMap):
            self._cube, self._equirect = environment, None
        else:
            image = np.asarray(environment)
            if image.ndim != 3 or image.shape[2] != 3 or image.shape[1] != 2 * image.shape[0]:
                raise ValueError(f"an equirectangular picture must have shape (height, 2 height, 3), got {image.shape}")
            if not np.issubdtype(image.dtype, np.floating):
                raise TypeError(f"an environment map holds linear radiance in floats, got {image.dtype}")
            self._cube = cubemap_from_equirect(image, size=128)
            image = np.nan_to_num(image.astype(np.float32), nan=0, posinf=1e9, neginf=0).clip(0, 1e9)
            # One more column on each side, so that interpolation continues across the seam.
            self._equirect = cv2.copyMakeBorder(image, 0, 0, 1, 1, cv2.BORDER_WRAP)
        self.albedo = table_albedo(albedo)
        up = texel_directions(self._cube.size)[..., 2:].astype(np.float64)
        angles = texel_solid_angles(self._cube.size)[None, ..., None]
        self._light = np.sum(self._cube.faces * np.maximum(up, 0) * angles, axis=(0, 1, 2)).astype(np.float32)
        sent = self._light / np.float32(np.pi)
        self._plain = self.albedo * sent
        self._table = wood(2 * TABLE[0], 2 * TABLE[1], self._DENSITY, self.albedo) * sent

    def irradiance(self, points: ArrayLike, lamp: bool = False) -> NDArray[np.float32]:
        """Irradiance (..., 3) of the table at points (..., 2); the same everywhere."""
        return np.broadcast_to(self._light, (*np.shape(points)[:-1], 3))

    def radiance(
        self, position: ArrayLike, directions: ArrayLike, lamp: bool = False, unit: bool = False
    ) -> NDArray[np.float32]:
        """Radiance (..., 3) float32 that arrives at `position` (3,), z > 0, from `directions` (..., 3)."""
        o = np.asarray(position, np.float32)
        d = np.asarray(directions, np.float32)
        if o.shape != (3,) or d.shape[-1:] != (3,):
            raise ValueError(f"expected position (3,) and directions (..., 3), got {o.shape} and {d.shape}")
        if not (np.isfinite(o).all() and o[2] > 0):
            raise ValueError(f"position must be finite and lie above the table, got {o.tolist()}")
        if not unit:
            d = d / np.linalg.norm(d, axis=-1, keepdims=True)
        below = d[..., 2] < 0
        if below.all():
            return self._table_radiance(o, d)
        if not below.any():
            return self._sky(d)
        out = np.empty(d.shape, np.float32)
        out[below] = self._table_radiance(o, d[below])
        out[~below] = self._sky(d[~below])
        return out

    def _sky(self, d: NDArray) -> NDArray:
        if self._equirect is None:
            return self._cube.sample(d)
        height, width = self._equirect.shape[0], self._equirect.shape[1] - 2
        x = (0.5 + np.arctan2(d[..., 0], d[..., 1]) * np.float32(0.5 / np.pi)) * width + 0.5
        y = np.arccos(np.clip(d[..., 2], -1, 1)) * np.float32(height / np.pi) - 0.5
        return _look_up(self._equirect, x, y, cv2.BORDER_REPLICATE)

    def _table_radiance(self, o: NDArray, d: NDArray) -> NDArray:
        t = o[2] / np.maximum(-d[..., 2], 1e-6)
        x, y = o[0] + t * d[..., 0], o[1] + t * d[..., 1]
        far = np.sqrt(x * x + y * y)
        near, plain = self._PLAIN
        share = np.clip((plain - far) / (plain - near), 0, 1)[..., None]
        column = np.clip((x + np.float32(TABLE[0])) * self._DENSITY - 0.5, -16000, 16000)
        row = np.clip((np.float32(TABLE[1]) - y) * self._DENSITY - 0.5, -16000, 16000)
        grain = _look_up(self._table, column, row, cv2.BORDER_REFLECT)
        return self._plain + (grain - self._plain) * share

    def truth(self, position: ArrayLike = OBJECT, size: int = 128, lamp: bool = False, samples: int = 4) -> CubeMap:
        """The true environment map at a place: the given one above the horizon, below it the table.

        For the printed board see Room.truth.
        """
        faces = truth_map(lambda d: self.radiance(position, d), size, samples).faces.copy()
        if size % 2 == 0:  # no texel lies across the horizon: take over the given map as it is
            above = texel_directions(size)[..., 2] > 0
            if self._equirect is not None:
                faces[above] = cubemap_from_equirect(self._equirect[:, 1:-1], size=size).faces[above]
            elif size == self._cube.size:
                faces[above] = self._cube.faces[above]
        return CubeMap(faces)


def default_rig(size: tuple[int, int] = (640, 480)) -> Rig:
    """A telephone's two cameras: back 63 degrees wide, front 78, looking the opposite way; pictures of 4:3.

    size: (width, height) in pixels.
    """
    width, height = size
    s = width / 640
    back = Camera(
        width,
        height,
        fx=522.0 * s,
        fy=521.5 * s,
        cx=width / 2 + 3.25 * s,
        cy=height / 2 - 2.5 * s,
        distortion=(0.06, -0.11, 0.0006, -0.0004, 0.0),
        vignetting=(-0.30, 0.08),
    )
    front = Camera(
        width,
        height,
        fx=395.5 * s,
        fy=395.0 * s,
        cx=width / 2 - 4.5 * s,
        cy=height / 2 + 1.75 * s,
        distortion=(-0.08, 0.012, -0.0003, 0.0005, 0.0),
        vignetting=(-0.34, 0.09),
    )
    turn = Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
    misfit = Pose.from_rotation_vector([0.012, -0.018, 0.007], [0.021, 0.013, 0.004])
    return Rig(back, front, misfit @ turn)


class HandPath:
    """Where a hand holds the back camera: around the board, 0.45 to 0.6 m away, tilted by 25 to 61 degrees.

    The path has smooth slow sweeps and a small tremor, drawn from the seed, and depends on time alone, whatever the
    frame rate.
    """

    def __init__(self, rng: np.random.Generator, seconds: float):
        self._start = rng.uniform(0, 2 * np.pi)
        self._seconds = max(seconds, 1e-9)
        # Twice around, so that each half of the time sees the whole place, but no faster than a hand moves.
        turn = min(4.2 * np.pi, np.radians(65) * seconds)
        self._speed = rng.choice([-1, 1]) * turn / self._seconds
        self._slow = rng.uniform(0, 2 * np.pi, (5, 2))
        self._tremor = rng.uniform(0, 2 * np.pi, (6, 3)), rng.uniform(2.5, 8, (6, 3))

    def back_from_marker(self, time: float) -> Pose:
        phases, waves = self._tremor
        tremor = (np.sin(2 * np.pi * waves * time + phases) / (waves / 2.5)).sum(axis=1) / 3
        azimuth, tilt = self._around(time)
        distance = 0.525 + 0.07 * self._wave(2, time, 0.19, 0.43)
        away = np.array([np.sin(tilt) * np.sin(azimuth), -np.sin(tilt) * np.cos(azimuth), np.cos(tilt)])
        eye = distance * away + 0.0012 * tremor[:3]
        aim = np.array([0.018 * self._wave(3, time, 0.23, 0.47), 0.018 * self._wave(4, time, 0.29, 0.57), 0.0])
        forward = (aim - eye) / np.linalg.norm(aim - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        look = np.eye(4)
        look[:3, :3] = right, np.cross(forward, right), forward
        look[:3, 3] = -look[:3, :3] @ eye
        roll = 0.05 * self._wave(3, time, 0.37, 0.71)
        shake = Pose.from_rotation_vector(np.array([0, 0, roll]) + 0.0022 * tremor[3:], np.zeros(3))
        return shake @ Pose(look)

    def _wave(self, k: int, time: float, first: float, second: float) -> float:  # about -1 to 1; waves in Hz
        a, b = self._slow[k]
        return 0.65 * np.sin(2 * np.pi * first * time + a) + 0.35 * np.sin(2 * np.pi * second * time + b)

    def _around(self, time: float) -> tuple[float, float]:
        """The camera's azimuth and its tilt from the board's normal, radians."""
        azimuth = self._start + self._speed * time + 0.06 * self._wave(0, time, 0.31, 0.53)
        return azimuth, np.radians(43 + 18 * self._wave(1, time, 0.27, 0.61))


class SweepPath(HandPath):
    """The same hand when it looks for light: once around with the front camera on the horizon, and once above it."""

    _LOW, _HIGH = np.radians(63), np.radians(24)  # tilt; the front camera looks 90 degrees minus this above the horizon
    _LOW_SHARE = 0.6  # share of the time at the tilt _LOW

    def _around(self, time: float) -> tuple[float, float]:
        turns = time / self._seconds
        low = min(turns / self._LOW_SHARE, 1.0)
        high = np.clip((turns - self._LOW_SHARE) / (1 - self._LOW_SHARE), 0, 1)
        share = 0.5 - 0.5 * np.cos(np.pi * np.clip((turns - self._LOW_SHARE) / 0.1 + 0.5, 0, 1))
        tilt = self._LOW + (self._HIGH - self._LOW) * share + np.radians(1.5) * self._wave(1, time, 0.27, 0.61)
        around = 2.1 * np.pi * (low + high) * np.sign(self._speed)
        return self._start + around + 0.02 * self._wave(0, time, 0.31, 0.53), tilt


PATHS = {"hand": HandPath, "sweep": SweepPath}


class _Eye:
    """A camera with its rays computed in advance; makes pictures from the radiance along them."""

    def __init__(self, camera: Camera):
        self.camera = camera
        y, x = np.mgrid[: camera.height, : camera.width].astype(np.float64) + 0.5
        rays = camera.unproject(np.stack([x, y], axis=-1))
        reached = ~np.isnan(rays).any(axis=-1)
        if camera.model == "perspective" and not reached.all():
            raise ValueError("the lens model does not reach the picture's corners")
        rays[~reached] = [0, 0, 1]  # these are black: they lie around a fisheye's circle
        self.rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)
        y, x = (np.mgrid[: 2 * camera.height, : 2 * camera.width].astype(np.float64) + 0.5) / 2
        self.fine = np.nan_to_num(camera.unproject(np.stack([x, y], axis=-1))).astype(np.float32)  # 2 x 2 rays a pixel
        offsets = (np.mgrid[: camera.height, : camera.width] + 0.5).astype(np.float64)
        r2 = ((offsets[1] - camera.cx) / camera.fx) ** 2 + ((offsets[0] - camera.cy) / camera.fy) ** 2
        factor = 1 + sum(v * r2 ** (k + 1) for k, v in enumerate(camera.vignetting))
        self.factor = (camera.gain * np.maximum(factor, 1e-3) * reached).astype(np.float32)[..., None]
        codes = camera.response.encode(np.linspace(0, 1, 65536, dtype=np.float32))
        self.codes = np.round(codes * 255).astype(np.uint8)

    def expose(
        self,
        radiance: NDArray,
        exposure: float,
        rng: np.random.Generator,
        glare: float = 0.0,
        lamps: NDArray | None = None,
    ) -> NDArray[np.uint8]:
        """Adds lens blur, vignetting, veiling glare, shot noise and read noise, and applies the response. lamps: factor
        of each row."""
        light = cv2.GaussianBlur(radiance, (0, 0), _BLUR, borderType=cv2.BORDER_REPLICATE)
        light *= self.factor * np.float32(exposure)
        if glare:
            veil = glare * light.mean(axis=(0, 1), dtype=np.float64)
            light *= np.float32(1 - glare)
            light += veil.astype(np.float32)
        if lamps is not None:
            light *= lamps.astype(np.float32)[:, None, None]
        np.clip(light, 0, 2, out=light)
        noise = rng.standard_normal(light.shape, np.float32)
        noise *= np.sqrt(light * np.float32(1 / _FULL_WELL) + np.float32((_READ_NOISE / _FULL_WELL) ** 2))
        light += noise
        np.clip(light, 0, 1, out=light)
        return self.codes[np.round(light * 65535).astype(np.uint16)]


class _PrintedBoard:
    """The page on the table, as pictures of radiance and of coverage for each state of the lamp."""

    _TEXEL = 0.0003  # metres; a third of a pixel of the back camera at its nearest

    def __init__(self, board: Any, place: Place):
        self.width, self.height = float(board.width), float(board.height)
        page = np.asarray(board.image(254))  # ten pixels a millimetre: pages of whole millimetres fit
        if page.ndim != 2 or page.dtype != np.uint8:
            raise ValueError(f"board.image must give a grey (h, w) uint8 page, got {page.shape} {page.dtype}")
        shape = max(8, round(self.width / self._TEXEL)), max(8, round(self.height / self._TEXEL))
        page = cv2.resize(page.astype(np.float32), shape, interpolation=cv2.INTER_AREA)
        albedo = INK + (PAPER - INK) * page[..., None] / 255
        self.albedo = float(albedo.mean())
        x = (np.arange(shape[0]) + 0.5) / shape[0] * self.width - self.width / 2
        y = self.height / 2 - (np.arange(shape[1]) + 0.5) / shape[1] * self.height
        points = np.stack(np.meshgrid(x, y), axis=-1)
        self.pictures = {}
        for lamp in (False, True):
            radiance = albedo * place.irradiance(points, lamp) / np.float32(np.pi)
            full = np.concatenate([radiance, np.ones_like(albedo)], axis=-1).astype(np.float32)
            self.pictures[lamp] = cv2.copyMakeBorder(full, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        self.scale = np.float32(shape[0] / self.width), np.float32(shape[1] / self.height)

    def lay(self, picture: NDArray, eye: _Eye, camera_from_marker: Pose, lamp: bool, top: int = 0) -> None:
        """Draws the page over a picture of radiance, in place, from 2 x 2 rays per pixel.

        picture: the camera's rows from `top` on.
        """
        ends = np.linspace(-0.5, 0.5, 17)
        sides = [(e, s) for e in ends for s in (-0.5, 0.5)] + [(s, e) for e in ends for s in (-0.5, 0.5)]
        outline = np.array([(a * self.width, b * self.height, 0.0) for a, b in sides])
        seen = eye.camera.project(camera_from_marker @ outline)
        height, width = picture.shape[:2]
        least, most = (0, top), (width, top + height)
        if np.isnan(seen).any() or eye.camera.model != "perspective":
            (x0, y0), (x1, y1) = least, most
        else:
            x0, y0 = np.clip(np.floor(seen.min(axis=0)).astype(int) - 2, least, most)
            x1, y1 = np.clip(np.ceil(seen.max(axis=0)).astype(int) + 2, least, most)
        if x1 <= x0 or y1 <= y0:
            return
        marker_from_camera = camera_from_marker.inverse()
        rays = eye.fine[2 * y0 : 2 * y1, 2 * x0 : 2 * x1]
        d = cv2.transform(rays, marker_from_camera.rotation)
        o = marker_from_camera.translation.astype(np.float32)
        t = np.where(d[..., 2] < -1e-6, -o[2] / np.minimum(d[..., 2], -1e-6), np.float32(1e6))
        x = (o[0] + t * d[..., 0] + np.float32(self.width / 2)) * self.scale[0] + np.float32(0.5)
        y = (np.float32(self.height / 2) - o[1] - t * d[..., 1]) * self.scale[1] + np.float32(0.5)
        image = self.pictures[lamp]
        np.clip(x, -9, image.shape[1] + 9, out=x), np.clip(y, -9, image.shape[0] + 9, out=y)
        page = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        page = cv2.resize(page, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
        part = picture[y0 - top : y1 - top, x0:x1]
        part *= 1 - page[..., 3:]
        part += page[..., :3]


class _Hand:
    """A dark hand, out of focus, that comes from below and covers the whole front picture."""

    def __init__(self, begin: float, end: float, light: float, shape: tuple[int, int]):
        self.begin, self.end = begin, end
        self.fade = min(_HAND_FADE, (end - begin) / 4)
        rows = np.linspace(1, 0, shape[0], dtype=np.float32)[:, None]
        self._height = np.broadcast_to(rows, shape)
        x = np.linspace(-1, 1, shape[1], dtype=np.float32)
        folds = 1 + 0.25 * np.cos(3 * np.pi * x + 0.6) * np.cos(1.2 * np.pi * rows) - 0.3 * rows
        self._skin = folds[..., None] * (np.array([0.60, 0.36, 0.26], np.float32) * np.float32(0.10 * light))

    def cover(self, picture: NDArray, time: float, rows: slice = slice(None)) -> NDArray:
        """The picture with the hand in front of it. rows: those of the camera that the picture holds."""
        if not self.begin - self.fade < time < self.end + self.fade:
            return picture
        risen = min(1.0, (time - self.begin) / self.fade + 1, (self.end - time) / self.fade + 1)
        share = np.clip((2 * risen - self._height[rows] - 0.5) * 2 + 0.5, 0, 1)[..., None]
        skin = self._skin[rows]
        return picture + (skin - picture) * share if risen < 1 else skin


def _place_of(environment: Any, albedo: ArrayLike | None) -> tuple[Place, bool]:
    if environment is None:
        return Room(albedo), True
    if isinstance(environment, Environment):
        return DistantPlace(environment.radiance, albedo), False
    if hasattr(environment, "radiance") and hasattr(environment, "truth"):
        if albedo is not None:
            raise ValueError("albedo is that of a table under a map or in the room; a place of your own has its own")
        return environment, False
    if isinstance(environment, (str, os.PathLike)):
        path = Path(environment)
        if path.suffix.lower() in LINEAR:
            picture = read_picture(path)
            if picture.shape[1] == 2 * picture.shape[0]:
                return DistantPlace(picture, albedo), False  # as sharp as it is
        return DistantPlace(read_environment(path), albedo), False
    return DistantPlace(environment, albedo), False


def simulate(
    environment: CubeMap | Environment | ArrayLike | str | os.PathLike[str] | Place | None = None,
    seed: int = 0,
    seconds: float = 8.0,
    fps: float = 15.0,
    out: str | os.PathLike[str] | None = None,
    *,
    size: tuple[int, int] = (640, 480),
    board: Any = None,
    albedo: ArrayLike | None = None,
    lamp: bool = True,
    hand: bool = True,
    position: ArrayLike = OBJECT,
    rig: Rig | None = None,
    path: str | Callable[[float], Pose] = "hand",
    readout: float | None = None,
    shutter: float = 0.0,
    flicker: float = 0.0,
    flicker_depth: float = 0.5,
    glare: float = 0.0,
    clock_offset: float = 0.0,
    front_exposures: Callable[[float], float] | None = None,
    auto_exposure: bool = False,
    gyro: float | None = None,
    live: bool = False,
    video: bool = False,
    truth_size: int = 128,
    progress: bool = False,
) -> Recording:
    """Makes a recording of a place whose light is known.

    environment: None is the built-in room. A CubeMap, an Environment, an equirectangular picture (h, 2h, 3) of floats,
    or the path of a file that `read_environment` reads (.hdr, .exr, .ktx2, .dds) is a map at infinity, above an opaque
    table at z = 0 that it lights; or a Place of your own.
    albedo: the table's mean albedo, a number or RGB; by default about that of the printed page. Not for a Place.
    board: the printed page (`.image(dpi)` grey uint8, `.width`, `.height` in metres); None is Board.default(), False is
    no board.
    seed: of the path's wandering and of the noise. seconds, fps: length, and frames per second.
    size: width and height of the pictures.
    rig: cameras of your own; `size` is then ignored.
    truth_size: texels along a face of the true maps.

    The back camera circles the board as if held by a hand, at constant exposure; the front camera, which looks the
    other way, takes one in three pictures 16 times darker and one in three 256 times darker.
    path: "hand" wanders, "sweep" looks all around once with the front camera at the horizon, and once above; or
    back_from_marker as a function of the time in seconds.
    lamp: whether, in the room, a lamp is switched on at half-time.
    hand: whether a hand covers the front camera for one second after 30 % of the time.
    front_exposures: instead of these three exposures in turn, a function from the exposure of a front picture to that
    of the next, such as Bracket or AdaptiveExposure.
    auto_exposure: whether the back camera exposes by what its last picture shows, as most do where nothing stops them,
    and not for the table.
    gyro: frames then have the back camera's attitude (Frame.attitude), which drifts by this many radians per root of a
    second; phones have about 0.001, and 0 is exact.
    `truth` holds the maps at `position` (the object: 6 cm above the board's centre), the poses, and the times of the
    lamp and the hand.

    Effects of time on pictures are left out unless you ask for them:

    - readout: seconds from a picture's first row to its last, of both cameras; row r of a picture of `time` is
      exposed around time + r / height * readout. The recording's cameras state it. None takes it from `rig`, or 0.
    - shutter: exposure time in seconds, over which poses are averaged in linear light. The front camera's darker
      pictures take 16 and 256 times less, brighter ones of its front_exposures more, up to 1 / fps. 0: an instant.
    - flicker: Hz at which lamps on the mains, and with them all light, flicker: 100 or 120; each row takes the mean
      over its exposure time. flicker_depth: 0 to 1, the swing around the mean; the truth holds the mean.
    - glare: share of a picture's light, 0 to 1, that lenses spread evenly over all of it; 0.01 is good, 0.03 common.
    - clock_offset: seconds; a picture stamped `time` begins at `time` + clock_offset of the truth's clock.

    The truth's poses are those at the stated times, and, where these differ, when the first and the last row are taken.
    Exposures and readouts longer than 1 / fps raise ValueError.

    live: whether to make each picture when the recording is iterated, and keep none; each iteration asks
    front_exposures anew. out: folder for the recording; None keeps it in memory (2 MB a frame). video: FFV1 videos, of
    even width and height, instead of PNG pictures. progress: whether to show a bar. The same arguments give the same
    bytes. Raises ValueError for arguments that make no recording.
    """
    if not (np.isfinite(seconds) and seconds > 0 and np.isfinite(fps) and fps > 0):
        raise ValueError(f"seconds and fps must be positive and finite, got {seconds} and {fps}")
    expect(rig, (Rig, type(None)), "rig")
    expect(size, (tuple, list), "size", "(width, height), pixels")
    if len(size) != 2 or min(size) < 16:
        raise ValueError(f"size must be (width, height), each at least 16 pixels, got {size}")
    timing = Shutter(shutter, flicker, flicker_depth, glare, clock_offset)
    rig = default_rig((size[0], size[1])) if rig is None else rig
    rig = rig if readout is None else with_readout(rig, readout)
    longest = max(shutter, *(camera.readout for camera in (rig.back, rig.front) if camera is not None))
    if longest > 1 / fps:
        raise ValueError(f"shutter and readout must not exceed the {1 / fps:g} s between frames, got {longest} s")
    if gyro is not None and not (np.isfinite(gyro) and gyro >= 0):
        raise ValueError(f"gyro must be None or a finite noise of 0 or more, got {gyro}")
    if truth_size < 1:
        raise ValueError(f"truth_size must be at least 1 texel, got {truth_size}")
    if live and out is not None:
        raise ValueError("live frames are not kept: leave out away, or record them with a RecordingWriter")
    place, has_lamp = _place_of(environment, albedo)
    board = Board.default() if board is None else (board or None)
    if board is not None and not callable(getattr(board, "image", None)):
        raise TypeError(f"board must be a page with image(dpi), width and height, None or False, got {board!r}")
    if not callable(path) and path not in PATHS:
        raise ValueError(f"path must be one of {', '.join(PATHS)}, or a function of time, got {path!r}")
    path_rng, noise = (np.random.default_rng([seed, k]) for k in (0, 1))
    pose_at = path if callable(path) else PATHS[path](path_rng, seconds).back_from_marker
    times = [k / fps for k in range(max(1, round(seconds * fps)))]

    at = cast("tuple[float, float, float]", tuple(float(x) for x in np.asarray(position, np.float64)))
    if len(at) != 3 or not np.isfinite(at).all():
        raise ValueError(f"position must be 3 finite coordinates in metres, got {position!r}")
    truth = Truth(position=at, clock_offset=clock_offset)
    truth.maps = [(0.0, place.truth(truth.position, truth_size, False))]
    if lamp and has_lamp:
        truth.lamp_time = seconds / 2
        truth.maps.append((truth.lamp_time, place.truth(truth.position, truth_size, True)))
    later = {0.0, clock_offset, *(clock_offset + c.readout for c in (rig.back, rig.front) if c is not None)}
    truth.poses = [(time, pose_at(time)) for time in sorted({time + step for time in times for step in later})]
    if hand:
        begin = 0.3 * seconds
        truth.hand = (begin, begin + min(1.0, 0.2 * seconds))

    make = _Pictures(
        place, rig, board, truth, noise, pose_at, timing, 1 / fps, front_exposures, auto_exposure, gyro, seed
    )
    if live:
        return Recording(rig, _LiveFrames(make, times, seed), board, truth)
    writer = RecordingWriter(out, rig, board, video=video) if out is not None else None
    frames: list[Frame] = []
    steps = enumerate(times)
    if progress:
        from tqdm import tqdm

        steps = tqdm(steps, total=len(times), desc="simulate", unit="frame", disable=None)
    try:
        if writer is not None:
            writer.write_truth(truth)  # first, so that a run that is broken off leaves a shorter recording
        for index, time in steps:
            frame = make.frame(index, time)
            frames.append(frame) if writer is None else writer.add(frame)
    finally:
        if writer is not None:
            writer.close()
    if writer is not None:
        return Recording.open(writer.path)
    return Recording(rig, frames, board, truth)


def with_readout(rig: Rig, readout: float) -> Rig:
    """The same rig with rolling shutters. readout: seconds from a picture's first row to its last."""
    back = rig.back.replace(readout=readout)
    return Rig(back) if rig.front is None else Rig(back, rig.front.replace(readout=readout), rig.front_from_back)


class _LiveFrames(Sequence[Frame]):
    """Frames that are taken in order, each when it is asked for."""

    def __init__(self, make: _Pictures, times: list[float], seed: int):
        self._make, self.times, self._seed = make, times, seed

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Frame]:
        make = copy.copy(self._make)  # so that exposures, noise and drift belong to this iteration alone
        make.noise = np.random.default_rng([self._seed, 1])
        for index, time in enumerate(self.times):
            yield make.frame(index, time)

    def __getitem__(self, index: Any) -> NoReturn:
        raise TypeError("live frames come in order: iterate")


class _Pictures:
    """Takes the pictures of both cameras."""

    def __init__(
        self,
        place: Place,
        rig: Rig,
        board: Any,
        truth: Truth,
        noise: np.random.Generator,
        pose_at: Callable[[float], Pose],
        timing: Shutter,
        longest: float,
        front_exposures: Callable[[float], float] | None = None,
        auto_exposure: bool = False,
        gyro: float | None = None,
        seed: int = 0,
    ):
        self.front_exposures, self.auto_exposure = front_exposures, auto_exposure
        self.gyro, self.seed = gyro, seed
        self.place, self.rig, self.truth, self.noise = place, rig, truth, noise
        self.pose_at, self.timing = pose_at, timing
        self._longest = longest  # exposure time in seconds: beyond it, cameras amplify
        self.back = _Eye(rig.back)
        self.front = _Eye(rig.front) if rig.front is not None else None
        self.page = _PrintedBoard(board, place) if board is not None else None
        middle = place.truth(OBJECT, 32, False)
        up = texel_directions(32)[..., 2]
        brightness = middle.faces.mean(axis=-1)
        table, place_mean = brightness[up < -0.5].mean(), brightness[up > 0].mean()
        # Exposures stay finite even in a dark place.
        self.back_exposure = float(_TABLE_LEVEL / max(table, 1e-9))
        self.front_exposure = float(_FRONT_LEVEL / max(place_mean, 1e-9))
        self._metered, self._last_front = 1.0, self.front_exposure
        self.hand = None
        if truth.hand is not None and self.front is not None:
            shape = self.front.rays.shape[:2]
            self.hand = _Hand(*truth.hand, float(np.median(brightness[up > 0])), shape)

    def frame(self, index: int, time: float) -> Frame:
        share = self._metered if self.auto_exposure and index > 0 else 1.0
        exposure = self.back_exposure * share
        frame = Frame(time, back_exposure=exposure)
        if self.gyro is not None:
            frame.attitude = self._attitude(index, time, self.gyro)
        lasts = self.timing.exposure_time * min(share, 1.0)  # beyond that, cameras amplify
        frame.back = self._take(self.back, self.pose_at, time, exposure, lasts)
        if self.auto_exposure:
            self._metered = self._after(frame.back, share)
        if self.front is not None:
            share = FRONT_STEPS[index % len(FRONT_STEPS)]
            if self.front_exposures is not None:
                share = 1.0 if index == 0 else self._asked(self.front_exposures) / self.front_exposure
            frame.front_exposure = self._last_front = self.front_exposure * share
            frame.front = self._take(
                self.front,
                lambda t: self.rig.front_from_back @ self.pose_at(t),
                time,
                frame.front_exposure,
                min(self.timing.exposure_time * share, self._longest),
                self.hand,
            )
        return frame

    def _asked(self, front_exposures: Callable[[float], float]) -> float:
        exposure = float(front_exposures(self._last_front))
        if not (exposure > 0 and np.isfinite(exposure)):
            raise ValueError(f"front_exposures must give positive and finite exposures, got {exposure}")
        return exposure

    def _attitude(self, index: int, time: float, noise: float) -> NDArray:
        """The attitude by a gyroscope: right at first, then off by a random walk."""
        rotation = self.pose_at(time).rotation
        if index == 0:
            self._walk, self._told = np.random.default_rng([self.seed, 2]), time
            self._off = np.eye(3)
        step = noise * np.sqrt(time - self._told) * self._walk.standard_normal(3)
        self._off = self._off @ cv2.Rodrigues(step)[0]
        self._told = time
        return rotation @ self._off

    def _after(self, picture: NDArray[np.uint8], share: float) -> float:
        """The back camera's next exposure, as a multiple of the table's, after a picture that had `share` times the
        table's."""
        brightest = picture[::4, ::4].max(axis=-1).astype(np.float32) / 255
        level = float(np.quantile(self.rig.back.response.decode(brightest), _METERED_SHARE))
        least, most = _METERED_STEPS
        # Where pixels are clipped, nobody knows how bright they are.
        step = np.clip(_METERED_LEVEL / max(level, 1e-3), least, most) if level < 0.97 else least
        return float(min(share * step, _METERED_MOST))

    def _take(
        self,
        eye: _Eye,
        pose_at: Callable[[float], Pose],
        time: float,
        exposure: float,
        exposure_time: float,
        hand: _Hand | None = None,
    ) -> NDArray[np.uint8]:
        """Takes the picture stamped `time`. pose_at: camera_from_marker at a time."""
        begin = time + self.timing.clock_offset
        parts = []
        for band in bands(eye.camera, pose_at, begin, exposure_time):
            total: Any = 0
            for moment, pose in band.poses:
                light = self._radiance(eye, pose, moment, band.rows)
                if hand is not None:
                    light = hand.cover(light, moment, band.rows)
                total = light if len(band.poses) == 1 else total + light * np.float32(1 / len(band.poses))
            parts.append(total)
        light = parts[0] if len(parts) == 1 else np.concatenate(parts)
        lamps = None
        if self.timing.flicker:
            lamps = self.timing.lamps(row_times(eye.camera, begin), exposure_time)
        return eye.expose(light, exposure, self.noise, self.timing.glare, lamps)

    def _radiance(self, eye: _Eye, camera_from_marker: Pose, time: float, rows: slice) -> NDArray:
        lamp = self.truth.lamp_time is not None and time >= self.truth.lamp_time
        marker_from_camera = camera_from_marker.inverse()
        directions = cv2.transform(eye.rays[rows], marker_from_camera.rotation)
        light = self.place.radiance(marker_from_camera.translation, directions, lamp, unit=True)
        if self.page is not None:
            self.page.lay(light, eye, camera_from_marker, lamp, rows.start)
        return light
