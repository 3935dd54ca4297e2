"""A camera's response from pictures of one still place at several exposures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Response
from .corners import size_of

_LEAST_PICTURES = 3
_LEAST_CODES = 0.9  # share of the codes from 5 to 95 % of white that pixels must show
_SAMPLES = 300  # pixels a fit
_FITS = 9  # of different pixels: their median is the curve, their scatter the deviation
_SMOOTHNESS = 100.0  # Debevec and Malik's lambda
_MOST_DEVIATION = 0.05
_TRUSTED = slice(13, 243)  # codes from 5 to 95 % of white
_CLIPPED = 0.005  # share of the brightest picture that is at least at its white
_DARK = 64  # codes up to which a picture may have been taken with the lens covered


@dataclass(frozen=True)
class ResponseCalibration:
    """response, and deviations (256,): standard deviation of the linear value at 256 even steps from its black to its
    white level, relative to it."""

    response: Response
    deviations: NDArray[np.float64]

    def __str__(self) -> str:
        middle = self.deviations[_TRUSTED]
        black, white = 255 * self.response.black, 255 * self.response.white
        levels = "" if (black, white) == (0, 255) else f"; black is {black:.1f} and white {white:.0f} of 255"
        return (
            f"response known within {np.median(middle):.2%} (worst {middle.max():.2%}) from 5 to 95 % of white{levels}"
        )


def calibrate_response(
    pictures: Sequence[ArrayLike], exposures: Sequence[float], dark: ArrayLike | None = None
) -> ResponseCalibration:
    """The curve from light to code (Debevec and Malik 1997, by OpenCV), one for all channels.

    pictures: (h, w, 3) uint8 RGB of a still place by a still camera. exposures: of each, in any unit. dark: (h, w, 3)
    uint8 with the lens covered, for the black level, which is taken to be 0 without it; the white level is the code
    that the brightest picture clips at. Raises ValueError for fewer than three exposures, a place that does not show
    nearly all codes, a dark picture that is not dark, or a curve that pixels do not agree on.
    """
    size_of(pictures)
    times = np.asarray(exposures, np.float32)
    if len(pictures) != len(times) or len(set(times.tolist())) < _LEAST_PICTURES:
        raise ValueError(
            f"expected a picture for each of {_LEAST_PICTURES} or more different exposures, got {len(pictures)} "
            f"pictures and {len(set(times.tolist()))} exposures"
        )
    if not (np.isfinite(times).all() and (times > 0).all()):
        raise ValueError(f"exposures must be positive and finite, got {list(exposures)}")
    stack = np.stack([np.asarray(p) for p in pictures])
    if stack.dtype != np.uint8 or stack.ndim != 4 or stack.shape[3] != 3:
        raise ValueError(f"expected (h, w, 3) uint8 pictures, got {stack.shape[1:]} {stack.dtype}")
    black, white = 0.0 if dark is None else _black(dark), _white(stack)
    levels = np.round((np.arange(256) - black) / (white - black) * 255).clip(0, 255).astype(np.uint8)
    pixels = levels[stack.reshape(len(stack), -1, 3)]
    share = np.isin(np.intersect1d(np.arange(256)[_TRUSTED], levels), pixels).mean()
    if share < _LEAST_CODES:
        raise ValueError(
            f"the pictures show {share:.0%} of the codes between 5 and 95 % of white; expected {_LEAST_CODES:.0%}: "
            "more exposures, 1 or 2 stops apart, of a place with bright and dark parts"
        )
    order = np.argsort(pixels.mean(axis=(0, 2)), kind="stable")
    rng = np.random.default_rng(0)
    curves = np.concatenate([_fit(pixels[:, _spread(order, pixels, rng)], times) for _ in range(_FITS)])
    curve = np.median(curves, axis=0)  # channels are samples of the one curve
    scatter = 1.4826 * np.median(np.abs(curves - curve), axis=0) / np.sqrt(_FITS)
    deviations = scatter / np.maximum(curve, 1e-4)
    worst = float(deviations[_TRUSTED].max())
    if not worst <= _MOST_DEVIATION:
        raise ValueError(f"pixels disagree on the curve by up to {worst:.0%}: did camera or place move, or the light?")
    curve[0] = 0
    curve = np.maximum.accumulate(curve) + 1e-7 * np.arange(256)  # strictly increasing
    response = Response.from_curve((curve / curve[-1]).astype(np.float32))
    return ResponseCalibration(response.between(black / 255, white / 255), deviations)


def _black(dark: ArrayLike) -> float:
    picture = np.asarray(dark)
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
        raise ValueError(f"expected a dark picture (h, w, 3) uint8, got {picture.shape} {picture.dtype}")
    black = float(picture.mean())
    if black > _DARK:
        raise ValueError(
            f"the dark picture must be taken with the lens covered: its mean is {black:.0f} of 255, expected up to "
            f"{_DARK}"
        )
    return black


def _white(stack: NDArray[np.uint8]) -> float:
    """The code that the brightest picture clips at."""
    brightest = stack[int(np.argmax(stack.mean(axis=(1, 2, 3))))]
    most = int(brightest.max())
    return float(most) if (brightest == most).mean() >= _CLIPPED else 255.0


def _spread(order: NDArray, pixels: NDArray[np.uint8], rng: np.random.Generator) -> NDArray:
    """Random pixels whose brightness is spread evenly. order: of pixels by brightness."""
    mean = pixels.mean(axis=(0, 2))[order]
    levels = rng.uniform(mean[0], mean[-1], _SAMPLES)
    first, last = np.searchsorted(mean, levels - 1), np.searchsorted(mean, levels + 1)
    at = first + (rng.uniform(size=_SAMPLES) * (last - first)).astype(int)
    return order[at.clip(0, len(order) - 1)]


def _fit(pixels: NDArray[np.uint8], times: NDArray[np.float32]) -> NDArray[np.float64]:
    """Curves (3, 256) of these pixels, 1 at the last code."""
    import cv2

    tiles = [np.ascontiguousarray(p[None]) for p in pixels]
    solve = cv2.createCalibrateDebevec(samples=pixels.shape[1], lambda_=_SMOOTHNESS, random=True)
    curve = np.asarray(solve.process(tiles, times), np.float64).reshape(256, 3).T
    return curve / curve[:, -1:]
