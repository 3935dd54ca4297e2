"""The white of the board as a light meter: it ties the scale and the white balance of the two cameras together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import Board, Camera, Environment, Pose, texel_directions, texel_solid_angles

_MARGIN = 0.004  # metres to the next ink, and to the page's edge: blur, and the pose's error
_STEP = 0.006  # metres between points that are looked at
_LEAST_POINTS = 8  # of a picture
_DARKEST, _BRIGHTEST = 0.02, 0.85  # linear values that are trusted
_DPI = 50


@dataclass(frozen=True)
class CameraRatio:
    """ratio: (3,) what the front camera makes of a radiance by what the back one makes of it, by channel. spread:
    standard deviation of its logarithm over the pictures of the white. unseen: share of the light on the board that
    rests on what no camera saw."""

    ratio: NDArray[np.float64]
    spread: float
    unseen: float


class WhiteReference:
    """Measures the light on the board by its white.

    board: lies on the plane. reflectance: of its white, diffuse: office paper has 0.8 to 0.9.
    """

    def __init__(self, board: Board, reflectance: float = 0.8):
        if not 0 < reflectance <= 1:
            raise ValueError(f"the reflectance must be in (0, 1], got {reflectance}")
        self.board, self.reflectance = board, float(reflectance)
        self._points = _white_points(board)
        self._radiances: list[NDArray[np.float64]] = []

    def add(self, image: ArrayLike, camera: Camera, camera_from_marker: Pose, exposure: float) -> bool:
        """Takes a picture; False where it shows too little white that is neither clipped nor dark.

        image: (h, w, 3) uint8. Raises ValueError for another size than the camera's, TypeError for another dtype.
        """
        picture = np.asarray(image)
        if picture.shape != (camera.height, camera.width, 3):
            raise ValueError(f"expected a picture of {(camera.height, camera.width, 3)}, got {picture.shape}")
        if picture.dtype != np.uint8:
            raise TypeError(f"expected a uint8 picture, got {picture.dtype}")
        pixels = camera.project(camera_from_marker @ self._points)
        inside = ((pixels >= 1) & (pixels < [camera.width - 1, camera.height - 1])).all(axis=-1)  # NaN is not
        pixels = pixels[inside]
        if len(pixels) < _LEAST_POINTS:
            return False
        x, y = pixels.astype(int).T
        linear = camera.response.decode((picture[y, x] / 255).astype(np.float32)).astype(np.float64)
        good = ((linear > _DARKEST) & (linear < _BRIGHTEST)).all(axis=-1)
        if good.sum() < max(_LEAST_POINTS, len(pixels) / 2):
            return False
        r2 = ((pixels[:, 0] - camera.cx) / camera.fx) ** 2 + ((pixels[:, 1] - camera.cy) / camera.fy) ** 2
        vignette = 1 + sum(v * r2 ** (k + 1) for k, v in enumerate(camera.vignetting))
        radiance = linear[good] / (exposure * camera.gain * np.reshape(vignette * np.ones(len(pixels)), (-1, 1))[good])
        self._radiances.append(np.median(radiance, axis=0))
        return True

    @property
    def pictures(self) -> int:
        return len(self._radiances)

    @property
    def irradiance(self) -> NDArray[np.float64]:
        """(3,) on the board, from all pictures so far, in the units of their camera. LookupError without."""
        if not self._radiances:
            raise LookupError("no picture showed enough of the board's white")
        return np.pi / self.reflectance * np.median(self._radiances, axis=0)

    def ratio(self, environment: Environment) -> CameraRatio:
        """What the front camera makes of light by what the back camera makes of it.

        environment: captured; what lies above the horizon by the front camera, and the pictures of the white by the
        back one. Give the ratio to a Session as `front_ratio`, or to Capture.add as `tint`. It rests on all light above
        the horizon: first look all around. Raises LookupError without pictures, ValueError for a dark map.
        """
        measured = self.irradiance
        direction = texel_directions(environment.radiance.size)
        weight = np.maximum(direction[..., 2], 0) * texel_solid_angles(environment.radiance.size)[None]
        light = np.asarray(environment.radiance.faces, np.float64) * weight[..., None]
        total = light.sum(axis=(0, 1, 2))
        if not (total > 0).all():
            raise ValueError("the map holds no light above the horizon")
        unseen = light[environment.confidence <= 0].sum() / light.sum()
        spread = np.std(np.log(self._radiances), axis=0).mean() if self.pictures > 1 else 0.0
        return CameraRatio(total / measured, float(spread), float(unseen))


def _white_points(board: Board) -> NDArray[np.float64]:
    """Points (n, 3) of the page around which all is white, metres, marker frame."""
    page = np.asarray(board.image(_DPI))
    height, width = page.shape
    margin = int(np.ceil(_MARGIN / board.width * width))
    import cv2

    ink = (page < 250).astype(np.uint8)
    near = cv2.dilate(cv2.copyMakeBorder(ink, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1), np.ones((2 * margin + 1,) * 2))
    white = near[1:-1, 1:-1] == 0
    step = max(1, round(_STEP / board.width * width))
    y, x = np.nonzero(white[::step, ::step])
    across, up = (x * step + 0.5) / width - 0.5, 0.5 - (y * step + 0.5) / height
    return np.stack([across * board.width, up * board.height, np.zeros(len(x))], axis=-1)


__all__ = ["CameraRatio", "WhiteReference"]
