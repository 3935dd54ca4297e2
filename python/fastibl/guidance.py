"""Which parts of a place are still unseen, and where to turn to see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import Camera, CubeMap, Environment, Pose, _next_view
from .expected import expect
from .panorama import panorama_rays


@dataclass(frozen=True, eq=False)
class Guidance:
    """Where to look next.

    direction: unit vector (3,), marker frame, around which most light is thought to be unseen; None where the whole sky
    was seen. share: share of the sky's light that a picture there would add, as far as can be guessed. right, up:
    degrees by which the camera has to turn, None where its pose was not given. image: (h, 2h, 3) uint8 RGB, the map as
    an equirectangular picture (see docs/conventions.md), with unseen parts striped and the way to go.
    """

    direction: NDArray[np.float64] | None
    share: float
    right: float | None
    up: float | None
    image: NDArray[np.uint8]

    def __str__(self) -> str:
        if self.direction is None:
            return "all of the sky was seen"
        if self.right is None or self.up is None:
            return f"look towards {np.round(self.direction, 2)}"
        sides = ((self.right, "right", "left"), (self.up, "up", "down"))
        ways = [f"{abs(by):.0f} degrees {plus if by > 0 else minus}" for by, plus, minus in sides if abs(by) >= 5]
        return f"turn {' and '.join(ways)}" if ways else "hold still"


def guide(
    environment: Environment,
    camera: Camera | None = None,
    camera_from_marker: Pose | ArrayLike | None = None,
    height: int = 256,
) -> Guidance:
    """Says where to look next, with a picture that shows it.

    environment: what was captured so far. camera, camera_from_marker: the camera that is to be turned and its present
    pose; without them the best place of the whole sky is given. height: of the picture, pixels. Raises ValueError for a
    pose without a camera or the reverse, or a height below 16.
    """
    expect(environment, Environment, "environment", "what a Capture or a Session holds")
    if (camera is None) != (camera_from_marker is None):
        raise ValueError("guide() needs both a camera and its pose, or neither")
    if height < 16:
        raise ValueError(f"height must be at least 16 pixels, got {height}")
    if camera_from_marker is not None and not isinstance(camera_from_marker, Pose):
        camera_from_marker = Pose(np.asarray(camera_from_marker, np.float64))
    looking = camera_from_marker.rotation[2] if camera_from_marker is not None else None
    direction, share = _next_view(environment, looking)
    right = up = None
    if direction is not None and camera_from_marker is not None:
        x, y, z = camera_from_marker.rotation @ direction
        right, up = np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(-y, np.hypot(x, z)))
    image = _picture(environment, camera, camera_from_marker, direction, height)
    return Guidance(direction, share, right, up, image)


def _picture(
    environment: Environment,
    camera: Camera | None,
    camera_from_marker: Pose | None,
    target: NDArray | None,
    height: int,
) -> NDArray[np.uint8]:
    import cv2

    rays = panorama_rays(height)
    radiance = environment.radiance.sample(rays)
    middle = float(np.median(radiance[::4, ::4].mean(axis=-1)))
    shown = (radiance * np.float32(0.25 / middle if middle > 0 else 1)).clip(0, 1) ** np.float32(1 / 2.2)
    confidence = np.asarray(environment.confidence)
    known = CubeMap(np.repeat(confidence[..., None], 3, axis=-1)).sample(rays)[..., 0] > 0
    y, x = np.mgrid[:height, : 2 * height]
    stripes = ((x + y) // max(2, height // 32)) % 2
    hidden = ~known & (y < height / 2)  # below the horizon is the table, not the sky
    shown[hidden] = 0.25 * shown[hidden] + (0.25 + 0.2 * stripes[hidden])[:, None]
    image = np.ascontiguousarray((255 * shown).round().astype(np.uint8))
    if camera is not None and camera_from_marker is not None:
        frame = camera.unproject(_border(camera)) @ camera_from_marker.rotation
        _line(image, frame[np.isfinite(frame).all(axis=-1)], (255, 255, 255))
    if target is not None:
        if camera_from_marker is not None:
            from_, share = camera_from_marker.rotation[2], np.linspace(0, 1, 33)[:, None]
            _line(image, (1 - share) * from_ + share * target, (255, 160, 0))
        at = _pixels(target, height)
        cv2.circle(image, (int(at[0]), int(at[1])), max(3, height // 24), (255, 160, 0), 2, cv2.LINE_AA)
    return image


def _border(camera: Camera) -> NDArray[np.float64]:
    w, h, s = float(camera.width), float(camera.height), np.linspace(0.01, 0.99, 17)
    sides = [(s * w, 0 * s + 0.01 * h), (0 * s + 0.99 * w, s * h), (s[::-1] * w, 0 * s + 0.99 * h)]
    sides.append((0 * s + 0.01 * w, s[::-1] * h))
    ring = np.concatenate([np.stack(side, axis=-1) for side in sides])
    return np.concatenate([ring, ring[:1]])


def _pixels(directions: NDArray, height: int) -> NDArray[np.float64]:
    d = np.asarray(directions) / np.linalg.norm(directions, axis=-1, keepdims=True)
    u = 0.5 + np.arctan2(d[..., 0], d[..., 1]) / (2 * np.pi)
    return np.stack([u * 2 * height, np.arccos(np.clip(d[..., 2], -1, 1)) / np.pi * height], axis=-1)


def _line(image: NDArray[np.uint8], directions: NDArray, colour: tuple[int, int, int]) -> None:
    import cv2

    at = _pixels(directions, image.shape[0])
    for a, b in zip(at[:-1], at[1:], strict=True):
        if abs(a[0] - b[0]) < image.shape[1] / 2:  # leaves out lines that cross the picture's seam
            ends = [(round(float(p[0])), round(float(p[1]))) for p in (a, b)]
            cv2.line(image, ends[0], ends[1], colour, 2, cv2.LINE_AA)


__all__ = ["Guidance", "guide"]
