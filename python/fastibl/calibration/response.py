"""A camera's response, from pictures of one still place at several exposures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._fastibl import Response
from .corners import size_of

_LEAST_PICTURES = 3
_LEAST_CODES = 0.9  # share of the codes from 5 to 95 % of white that pixels must show
_SAMPLES = 1000  # pixels in a fit
_FITS = 9  # fits of different pixels: the curve is their median
_SMOOTHNESS = 100.0  # Debevec and Malik's lambda for a fit of _OF_SAMPLES pixels
_OF_SAMPLES = 300
_SMOOTHER = 2.0  # factor on lambda: how much that changes the curve, and how the fits scatter, make the deviation
_MOST_DEVIATION = 0.05
_TRUSTED = slice(13, 243)  # codes from 5 to 95 % of white
_KNOWN = 230  # code at which curves are compared; the codes above it are known from other pictures
_LEAST_KNOWN = 25  # from this code on, a darker picture tells light well
_FIRST_OF_TOP = 205  # from this code on, the curve's end is fitted
_LEAST_SHOWN, _MOST_SHOWN = 20, 200_000  # values that a code needs; pixels that are used
_LEAST_STEP = 2e-6  # per code: so that curves increase strictly, in float32 and in a response's finer steps, too
_AGREES = 0.03  # share of white within which the end that follows from smoothness is kept: it is less noisy
_LEAST_TOP = 8  # codes of the end that must have values
_CLIPPED = 0.005  # share of the brightest picture's values that must clip, for its white to count
_EVEN = 12  # codes within which a part of one code is one that does not clip but is even
_DARK = 64  # highest mean code of a picture that counts as taken with the lens covered


@dataclass(frozen=True, eq=False)
class ResponseCalibration:
    """A camera's response, and how well it is known.

    deviations: (256,) relative standard deviation of the linear value at 256 even steps from the black to the white
    level, for values taken relative to the one at 90 % of white. white_deviation: relative standard deviation of the
    light of white itself, by which all values may be off together: a curve that is flat at its end hardly tells where
    it ends.
    """

    response: Response
    deviations: NDArray[np.float64]
    white_deviation: float = 0.0

    def __str__(self) -> str:
        middle = self.deviations[_TRUSTED]
        black, white = 255 * self.response.black, 255 * self.response.white
        levels = "" if (black, white) == (0, 255) else f"; black is {black:.1f} and white {white:.0f} of 255"
        return (
            f"response known within {np.median(middle):.2%} (worst {middle.max():.2%}) from 5 to 95 % of white, white "
            f"itself within {self.white_deviation:.1%}{levels}"
        )


def calibrate_response(
    pictures: Sequence[ArrayLike], exposures: Sequence[float], dark: ArrayLike | None = None
) -> ResponseCalibration:
    """Finds the curve from light to code (Debevec and Malik 1997), one for all channels.

    pictures: (h, w, 3) uint8 RGB of a still place by a still camera. exposures: that of each picture, in any unit.
    dark: (h, w, 3) uint8 with the lens covered, for the black level, which is assumed to be 0 without it; the white
    level is the code at which the brightest picture clips, 255 if it is not seen to clip. Raises ValueError for fewer
    than three exposures, a place that does not show nearly all codes, a dark picture that is not dark, or a curve on
    which the pixels do not agree.
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
    black, white = 0.0 if dark is None else _black(dark), _white(stack, times)
    if not white > black:
        raise ValueError(
            f"the pictures are no brighter than black: their largest code is {white:.0f}, black {black:.0f}"
        )
    levels = np.round((np.arange(256) - black) / (white - black) * 255).clip(0, 255).astype(np.uint8)
    pixels = levels[stack.reshape(len(stack), -1, 3)]
    share = np.isin(np.intersect1d(np.arange(256)[_TRUSTED], levels), pixels).mean()
    if not share >= _LEAST_CODES:
        raise ValueError(
            f"the pictures show {share:.0%} of the codes between 5 and 95 % of white; expected {_LEAST_CODES:.0%}: "
            "more exposures, 1 or 2 stops apart, of a place with bright and dark parts"
        )
    order = np.argsort(pixels.mean(axis=(0, 2)), kind="stable")
    rng = np.random.default_rng(0)
    chosen = [pixels[:, _spread(order, pixels, rng)] for _ in range(_FITS)]
    curves = np.concatenate([_fit(some, times) for some in chosen])
    curve = np.maximum.accumulate(np.median(curves, axis=0))  # each channel is a sample of the one curve
    curve, white_deviation = _with_top(curve, pixels, times)
    # Compared at a code where they are known: the last code's value follows from smoothness alone.
    compared = curves / curves[:, _KNOWN : _KNOWN + 1]
    smoother = _fit(np.concatenate(chosen, axis=1), times, _SMOOTHER)
    middle = np.median(compared, axis=0)
    scatter = 1.4826 * np.median(np.abs(compared - middle), axis=0) / np.sqrt(_FITS)
    least = 1e-4 / np.median(curves[:, _KNOWN])
    worst = float((scatter / np.maximum(middle, least))[_TRUSTED].max())
    if not worst <= _MOST_DEVIATION:
        raise ValueError(f"pixels disagree on the curve by up to {worst:.0%}: did camera or place move, or the light?")
    bias = np.median(smoother / smoother[:, _KNOWN : _KNOWN + 1], axis=0) - middle
    deviations = np.hypot(scatter, bias) / np.maximum(middle, least)
    curve[0] = 0
    least = _LEAST_STEP * np.arange(256)
    curve = np.maximum.accumulate(curve / curve[-1] - least) + least
    response = Response.from_curve((curve / curve[-1]).astype(np.float32))
    return ResponseCalibration(response.between(black / 255, white / 255), deviations, white_deviation)


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


def _white(stack: NDArray[np.uint8], times: NDArray[np.float32]) -> float:
    """The code at which the brightest picture clips: with less exposure, what shows it differs, or shows it still. 255
    if the picture does not clip, but its brightest part is an even one."""
    means = stack.mean(axis=(1, 2, 3))
    brightest = int(np.argmax(means))
    most = int(stack[brightest].max())
    at, less = stack[brightest] == most, times < times[brightest]
    if at.mean() < _CLIPPED or not less.any():
        return 255.0
    low, high = np.percentile(stack[np.argmax(np.where(less, means, -1))][at], [5, 95])
    return float(most) if high - low > _EVEN or high == most else 255.0


def _spread(order: NDArray, pixels: NDArray[np.uint8], rng: np.random.Generator) -> NDArray:
    """Random pixels whose brightness is spread evenly. order: the pixels in order of brightness."""
    mean = pixels.mean(axis=(0, 2))[order]
    levels = rng.uniform(mean[0], mean[-1], _SAMPLES)
    first, last = np.searchsorted(mean, levels - 1), np.searchsorted(mean, levels + 1)
    at = first + (rng.uniform(size=_SAMPLES) * (last - first)).astype(int)
    return order[at.clip(0, len(order) - 1)]


def _fit(pixels: NDArray[np.uint8], times: NDArray[np.float32], smoother: float = 1.0) -> NDArray[np.float64]:
    """Curves (3, 256) of these pixels, 1 at the last code: Debevec and Malik's Eq. 3, with lambda times `smoother`.

    The first and last code have no weight, because darker or brighter light shows them, too; OpenCV's CalibrateDebevec
    gives them one. The logarithms of the pixels' light are eliminated from the normal equations, which leaves 256
    unknowns.
    """
    hat = np.minimum(np.arange(256.0), 255 - np.arange(256.0))
    bend = np.diff(np.eye(256), 2, axis=0) * (_SMOOTHNESS * smoother * np.sqrt(pixels.shape[1] / _OF_SAMPLES))
    smooth = (bend.T * hat[1:-1] ** 2) @ bend
    smooth[128, 128] += 1  # logarithms are only known up to one constant
    log_times = np.log(times.astype(np.float64))[:, None]
    curves = []
    for codes in np.moveaxis(pixels, 2, 0):
        weights = hat[codes] ** 2
        shares = weights / np.maximum(weights.sum(axis=0), 1)
        matrix, to = smooth.copy(), np.zeros(256)
        np.add.at(matrix, (codes, codes), weights)
        np.add.at(matrix, (codes[:, None], codes[None]), -weights[:, None] * shares[None])
        np.add.at(to, codes, weights * (log_times - (shares * log_times).sum(axis=0)))
        curve = np.linalg.solve(matrix, to)
        curves.append(np.exp(curve - curve[-1]))
    return np.stack(curves)


def _with_top(
    curve: NDArray[np.float64], pixels: NDArray[np.uint8], times: NDArray[np.float32]
) -> tuple[NDArray[np.float64], float]:
    """The curve, and the relative deviation of its last value. Where the same pixels in darker pictures show something
    else for the last codes, these follow the darker pictures.

    Debevec and Malik give the last codes no weight: they follow from smoothness alone, 12 % off where a curve is flat
    at its end. What darker pictures tell is noisier. It is completed by a cubic of the square root of what is missing
    to white, which holds for curves that end steeply and for those that end flat.
    """
    pixels = pixels[:, :: max(1, pixels.shape[1] // _MOST_SHOWN)]
    order = np.argsort(times, kind="stable")
    light, codes = [], []
    for dark, bright in zip(order[:-1], order[1:], strict=True):
        told = (pixels[dark] >= _LEAST_KNOWN) & (pixels[dark] <= _KNOWN) & (pixels[bright] > _KNOWN)
        light.append(curve[pixels[dark][told]] * (times[bright] / times[dark]))
        codes.append(pixels[bright][told])
    values, shown = np.concatenate(light), np.concatenate(codes)
    known = [(c, curve[c]) for c in range(_FIRST_OF_TOP, _KNOWN + 1)]
    more = [(c, np.median(values[shown == c])) for c in range(_KNOWN + 1, 255) if (shown == c).sum() >= _LEAST_SHOWN]
    if len(more) < _LEAST_TOP:  # white is then as uncertain as the rest of the curve up to it
        return curve, float(1 - curve[254 - _LEAST_TOP] / curve[255])
    at, to = np.array(known + more, np.float64).T
    terms = _of_missing(at)
    solved = np.linalg.lstsq(terms, to, rcond=None)[0]
    variance = ((to - terms @ solved)[len(known) :] ** 2).mean()
    fitted = np.maximum.accumulate(_of_missing(np.arange(_KNOWN + 1, 256)) @ solved)
    # Where within the last step the codes clip cannot be seen: evenly spread, the deviation is 0.29 of the step.
    step = 0.29 * (fitted[-1] - fitted[-2])
    deviation = float(np.sqrt(variance * np.linalg.inv(terms.T @ terms)[0, 0] + step**2) / fitted[-1])
    if abs(fitted[-1] / curve[255] - 1) <= _AGREES:
        return curve, deviation
    return np.concatenate([curve[: _KNOWN + 1], np.maximum(fitted, curve[_KNOWN])]), deviation


def _of_missing(codes: NDArray) -> NDArray[np.float64]:
    missing = np.sqrt((255 - codes) / (255 - _FIRST_OF_TOP))
    return np.stack([np.ones_like(missing), missing, missing**2, missing**3], axis=1)
