"""Main lights of captured maps, compared with regions of the true maps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.comparison import level_at_most

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .recordings import sweeps

_BRIGHT, _SHARE = 8.0, 0.1  # times the map's mean; share of the irradiance on a plane that faces the region
_REACH = np.cos(np.radians(10.0))  # a light further than this from a region belongs to something else


@dataclass(frozen=True)
class Region:
    """Connected texels above 8 times the map's mean. irradiance: RGB, on a plane that faces the region's centre."""

    direction: NDArray
    irradiance: NDArray
    directions: NDArray  # those of its texels


def regions(cube: fastibl.CubeMap) -> list[Region]:
    """The regions that carry a tenth of the irradiance on a plane that faces them; brightest first."""
    faces = level_at_most(cube, 64)  # coarse enough that bars of a window split nothing
    n = faces.shape[1]
    d = fastibl.texel_directions(n).astype(np.float64)
    flux = faces * np.broadcast_to(fastibl.texel_solid_angles(n)[..., None], faces.shape[1:])
    brightness = faces.mean(axis=-1)
    mean = flux.sum() / 3 / (4 * np.pi)
    bright = (brightness > _BRIGHT * mean) & (d[..., 2] > 0)
    labels = np.zeros(bright.shape, np.int64)
    count = 0
    for face in range(6):
        found, part = cv2.connectedComponents(bright[face].astype(np.uint8), connectivity=8)
        labels[face] = np.where(part > 0, part + count, 0)
        count += found - 1
    # Regions that meet across an edge of the cube are one: they have texels less than 1.5 texels apart.
    owner = list(range(count + 1))

    def root(k: int) -> int:
        while owner[k] != k:
            k = owner[k]
        return k

    rim = np.zeros(bright.shape, bool)
    rim[:, [0, -1], :] = rim[:, :, [0, -1]] = True
    at = np.flatnonzero((bright & rim).ravel())
    edge, names = d.reshape(-1, 3)[at], labels.ravel()[at]
    near = edge @ edge.T > np.cos(1.5 * 2 / n)
    for i, j in zip(*np.nonzero(near), strict=True):
        owner[root(int(names[i]))] = root(int(names[j]))
    roots = np.array([root(k) for k in range(count + 1)])[labels]
    out = []
    for k in np.unique(roots[bright]):
        mask = roots == k
        mask &= bright
        centre = (d[mask] * flux[mask].sum(axis=-1)[:, None]).sum(axis=0)
        centre /= np.linalg.norm(centre)
        cosine = np.maximum(d @ centre, 0)[..., None]
        own, whole = (flux * cosine)[mask].sum(axis=0), (flux * cosine).sum(axis=(0, 1, 2))
        if own.sum() >= _SHARE * whole.sum():
            out.append(Region(centre, own, d[mask]))
    return sorted(out, key=lambda r: -r.irradiance.sum())


@dataclass(frozen=True)
class Found:
    angle: float  # degrees
    energy: float  # relative error of the irradiance, mean over RGB


def match(lights: list, truth: list[Region]) -> tuple[list[Found | None], int]:
    """What was found for each region: the nearest light, but no light twice; and the number of lights that are left."""
    left = list(lights)
    out: list[Found | None] = []
    for region in truth:
        nearest = max(left, key=lambda light: np.dot(light.direction, region.direction), default=None)
        if nearest is None or np.dot(nearest.direction, region.direction) < _REACH:
            out.append(None)
            continue
        left.remove(nearest)
        cosine = np.clip(np.dot(nearest.direction, region.direction), -1, 1)
        error = abs(np.sum(nearest.irradiance) / region.irradiance.sum() - 1)
        out.append(Found(float(np.degrees(np.arccos(cosine))), float(error)))
    return out, len(left)


@row("capture", "main lights")
def main_lights() -> Iterator[Goal]:
    what = "lights with a tenth of the irradiance that faces them"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    angles, energies, notes, missed, invented, count = [], [], [], 0, 0, 0
    for name, swept in sweeps():
        truth = regions(swept.true)
        lights = fastibl.main_lights(swept.environment)
        found, extra = match(lights, truth)
        count, missed, invented = count + len(truth), missed + found.count(None), invented + extra
        angles += [f.angle for f in found if f]
        energies += [f.energy for f in found if f]
        said = ", ".join("missed" if f is None else f"{f.angle:.2f} degrees, {percent(f.energy, 2)}" for f in found)
        notes.append(f"{name}: {len(truth)} true, {len(lights)} listed, {extra} invented: {said or 'none'}")
    yield Goal(
        f"{what}, after a sweep: missed, invented, worst direction, worst energy",
        f"{missed} of {count}, {invented}, {max(angles, default=0):.2f} degrees, {percent(max(energies, default=0))}",
        "0, 0, <= 2 degrees, <= 5 %",
        missed == 0 and invented == 0 and max(angles, default=0) <= 2 and max(energies, default=0) <= 0.05,
        tuple(notes),
    )
