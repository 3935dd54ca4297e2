"""The white of the board ties the scale and the white balance of the two cameras together."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Environment, texel_directions, texel_solid_angles
from .expected import expect

_MOST_CLIPPED = 0.1  # of the light


@dataclass(frozen=True, eq=False)
class CameraRatio:
    """ratio: (3,) the front camera's value for a radiance divided by the back camera's, per channel. unseen: share of
    the light on the board that comes from where no camera looked. clipped: share of the sky's light that clips in all
    pictures: how bright it is follows from the board's white at best, and tells nothing of the ratio."""

    ratio: NDArray[np.float64]
    unseen: float
    clipped: float = 0.0


def camera_ratio(environment: Environment) -> CameraRatio:
    """Measures the front camera's value for a light, divided by the back camera's.

    environment: captured with a board, all around: what is above the horizon by the front camera, and the board's white
    by the back camera (`environment.plane_irradiance`). Give the ratio to a Session as `front_ratio`, or to Capture.add
    as `tint`. It is as exact as the albedo of the paper, see Capture. Warns where more than a tenth of the light
    clips: shorter exposures tell more. Raises LookupError where no picture showed enough of the board's white,
    ValueError for a dark map, and for white that is black in a channel.
    """
    expect(environment, Environment, "environment")
    measured = environment.plane_irradiance
    if measured is None:
        raise LookupError("no picture showed enough of the board's white")
    direction = texel_directions(environment.radiance.size)
    weight = np.maximum(direction[..., 2], 0) * texel_solid_angles(environment.radiance.size)[None]
    light = np.asarray(environment.radiance.faces, np.float64) * weight[..., None]
    total = light.sum(axis=(0, 1, 2))
    if not (total > 0).all():
        raise ValueError("the map holds no light above the horizon")
    if not (np.array(measured) > 0).all():
        raise ValueError(f"the board's white was seen without any light in a channel: {tuple(measured)}")
    unseen = light[environment.confidence <= 0].sum() / light.sum()
    clipped = min(environment.knowledge["boosted_flux"] + environment.knowledge["bound_flux"], 1.0)
    if clipped > _MOST_CLIPPED:
        warnings.warn(
            f"{clipped:.0%} of the light clips in all pictures, so the ratio may be off by as much; shorter exposures "
            "of the front camera tell more",
            stacklevel=2,
        )
    return CameraRatio(total / np.array(measured), float(unseen), clipped)


__all__ = ["CameraRatio", "camera_ratio"]
