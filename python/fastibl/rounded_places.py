"""Places of files whose origin is far away, as those of scans in a map's coordinates: float32, with its 24 bits, would
round them too much. A common offset is subtracted from them in float64 first."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Mesh, _offset_before_rounding

_ROUNDING = 2.0**-24  # of float32


class Offset(NamedTuple):
    """What was subtracted from a file's places, in the file's axes."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rounded: bool = False  # whether the file itself holds places that are rounded to float32


def offset_of(places: Sequence[NDArray]) -> Offset:
    """Of all places (n, 3) of a file together; nothing where float32 keeps them well."""
    every = [p for p in places if len(p)]
    if not every:
        return Offset()
    lower, upper = (np.min([p.min(axis=0) for p in every], axis=0), np.max([p.max(axis=0) for p in every], axis=0))
    xyz = _offset_before_rounding(lower, upper)
    if not any(xyz):
        return Offset()
    # Whole numbers are kept by float32 as well.
    rounded = all((p.astype(np.float32) == p).all() for p in every) and any((np.round(p) != p).any() for p in every)
    return Offset(xyz, rounded)


def warn_of_offset(path: Path, mesh: Mesh, offset: Offset, stacklevel: int) -> None:
    """mesh: as read, in the file's axes."""
    if not any(offset.xyz):
        return
    places = mesh.vertices.astype(np.float64)
    size, away = np.ptp(places, axis=0).max(), np.abs(places + offset.xyz).max()
    x, y, z = (f"{value:.15g}" for value in offset.xyz)
    told = "; the file holds them rounded so already" if offset.rounded else ""
    warnings.warn(
        f"{path} is {size:g} wide and {away:g} away from its origin, where float32 rounds places to "
        f"{away * _ROUNDING:.1g}: ({x}, {y}, {z}) is subtracted from them{told}",
        stacklevel=stacklevel + 1,
    )
