"""Steadiness of the shadow: when the light changes a little, the shadow must change by as much as it should."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.expected import present

from .. import inputs
from ..goals import Goal, row, skipped
from ..light.stability import texel_directions
from . import truth
from .sky import Sky, behind_mesh, behind_spheres, pieces, rays, texels

_GOAL = truth.Errors(0.0005, 0.003)
_SPLIT = 4  # pieces of a near light's texel along an edge


class Visibility:
    """What points (n, 2) see past an object that stays, under successive maps of one size.

    hide: behind_mesh or behind_spheres of the object; meet: its rays, for near lights. A direction is a texel, however
    bright, because only changes are compared.
    """

    def __init__(
        self,
        hide: Callable[[Sky], Callable[[NDArray, NDArray], None]],
        points: NDArray,
        size: int,
        meet: Callable[[NDArray, NDArray], NDArray[np.bool_]] | None = None,
    ):
        self._points, self._meet = points, meet
        self._size = size
        directions, angles = texels(size)
        self._upper = np.flatnonzero(directions[:, 2] > 0)
        self._directions, self._angles = directions[self._upper], angles[self._upper, None]
        self._weight = self._angles * self._directions[:, 2:]
        sky = Sky([fastibl.CubeMap(np.ones((6, size, size, 3), np.float32))], largest=1)
        behind = hide(sky)
        hidden = np.zeros((len(points), *sky.directions.shape[:2]), np.float32)
        for point, mine in zip(points, hidden, strict=True):
            behind(np.array([*point, 0.0]), mine)
        # From the order of directions in the sky's blocks to that of texels.
        where = {tuple(d): i for i, d in enumerate(sky.directions.reshape(-1, 3))}
        order = [where[tuple(d)] for d in directions[self._upper]]
        self._hidden = np.ascontiguousarray(hidden.reshape(len(points), -1)[:, order])

    def ratio(
        self, cube: fastibl.CubeMap, lights: Sequence[fastibl.Light] = (), centre: Sequence[float] = (0, 0, 0)
    ) -> NDArray[np.float64]:
        """True ratio (n, 3) under a map as seen from the centre; lights: those with a position are taken as near."""
        flux = cube.faces.reshape(-1, 3)[self._upper] * self._weight
        near = self._near([light for light in lights if light.position is not None], np.array(centre), flux)
        for chosen, _, _ in near:
            flux[chosen] = 0
        total = np.broadcast_to(flux.sum(axis=0), (len(self._points), 3)).astype(np.float64)
        lost = (self._hidden @ flux.astype(np.float32)).astype(np.float64)
        for chosen, at, angles in near:
            sent = cube.faces.reshape(-1, 3)[self._upper][chosen].repeat(angles.shape[1], axis=0)
            sent = sent * angles.reshape(-1, 1) * ((at - np.array(centre)) ** 2).sum(axis=1, keepdims=True)
            for i, point in enumerate(np.pad(self._points, ((0, 0), (0, 1)), constant_values=truth.ABOVE)):
                to = at - point
                given = sent * np.maximum(to[:, 2:], 0) / np.linalg.norm(to, axis=1, keepdims=True) ** 3
                total[i] += given.sum(axis=0)
                lost[i] += given[present(self._meet)(point, to)].sum(axis=0)
        return np.where(total > 0, 1 - lost / np.where(total > 0, total, 1), 1)

    def _near(
        self, lights: Sequence[fastibl.Light], centre: NDArray, flux: NDArray
    ) -> list[tuple[NDArray, NDArray, NDArray]]:
        """The texels of each near light, the places of their pieces, and the pieces' solid angles. Pieces are as far
        away as the light's middle, and so small that none holds much light, because they come out of the object's
        shadow one by one. Texels of less than a thousandth of the light's brightest count as distant, because they show
        other things."""
        found, left, brightness = [], np.ones(len(flux), bool), flux.sum(axis=1)
        for light in lights:
            angle = np.arccos(np.clip(self._directions @ np.array(light.direction), -1, 1))
            own = left & (angle < 1.5 * light.angular_radius + 0.05)
            chosen = np.flatnonzero(own & (brightness > 1e-3 * brightness[own].max(initial=0)))
            left[chosen] = False
            distance = np.linalg.norm(np.array(light.position) - centre)
            directions, angles = pieces(self._size, self._upper[chosen], _SPLIT)
            found.append((chosen, centre + distance * directions.reshape(-1, 3), angles))
        return found


def brighter(cube: fastibl.CubeMap) -> Iterator[fastibl.CubeMap]:
    """The brightest hundredth of the sphere, then one half of the sphere, 2 % brighter."""
    faces = cube.faces
    brightness = faces.sum(axis=-1)
    half = (texel_directions(cube.size) @ (0.6, 0.64, 0.48) > 0).reshape(brightness.shape)
    for changed in (brightness > np.quantile(brightness, 0.99), half):
        yield fastibl.CubeMap(np.where(changed[..., None], np.float32(1.02) * faces, faces))


@row("shadow", "flicker: 2 % of the light")
def light_change() -> Iterator[Goal]:
    if not inputs.MAPS or "spot" not in truth.meshes():
        yield skipped("a light change of 2 %", inputs.NO_MAPS)
        return
    points = truth.grid(32)
    spheres = truth.spheres("spot")
    seen = Visibility(lambda sky: behind_spheres(sky, spheres), points, truth.SIZE)
    followed: dict[str, truth.Errors] = {}
    anew: dict[str, truth.Errors] = {}
    size: dict[str, float] = {}
    where: dict[str, Any] = {"extent": truth.EXTENT, "centre": (0.0, 0.0), "resolution": 128}
    for name, light in truth.lights().items():
        before, first = seen.ratio(light.cube), fastibl.cast_shadow(light.cube, spheres, "directions", **where)
        for k, cube in enumerate(brighter(light.cube)):
            change = seen.ratio(cube) - before
            what = f"{name}, {('its lights', 'a half')[k]}"
            size[what] = truth.errors(change, np.zeros_like(change)).rms
            shadow = fastibl.DirectionShadow()
            start = shadow.cast(light.cube, spheres, **where)
            then = shadow.cast(cube, spheres, **where)
            followed[what] = truth.errors(then.sample(points).astype(np.float64) - start.sample(points), change)
            then = fastibl.cast_shadow(cube, spheres, "directions", **where)
            anew[what] = truth.errors(then.sample(points).astype(np.float64) - first.sample(points), change)
    worst = truth.Errors(max(e.rms for e in followed.values()), max(e.worst for e in followed.values()))
    yield Goal(
        "flicker, K = 256: error of the change after a 2 % light change, RMS of the worst light and largest",
        f"{worst.rms:.5f}, {worst.worst:.4f}",
        f"<= {_GOAL.rms}, <= {_GOAL.worst}",
        worst.rms <= _GOAL.rms and worst.worst <= _GOAL.worst,
        (
            f"{len(followed)} changes of {len(truth.lights())} lights, directions kept from the shadow before; true "
            f"changes RMS {min(size.values()):.5f} to {max(size.values()):.5f}; worst: "
            f"{max(followed, key=lambda n: followed[n].rms)}",
            f"with directions chosen anew: RMS {max(e.rms for e in anew.values()):.5f}, largest "
            f"{max(e.worst for e in anew.values()):.4f}",
        ),
    )


def under(mesh: fastibl.Mesh, points: NDArray) -> NDArray[np.bool_]:
    """Whether points of the plane (n, 2) lie under a mesh."""
    origins = np.pad(points, ((0, 0), (0, 1)), constant_values=truth.ABOVE).astype(np.float32)
    return fastibl.Bvh(mesh).occluded(origins, np.broadcast_to(np.array([0, 0, 1], np.float32), origins.shape).copy())


@row("shadow", "flicker: a recording")
def recording() -> Iterator[Goal]:
    """300 frames in the built-in room: the captured map changes, and with it the shadow; nothing else may change.

    Only steps are judged in which at most 2 % of the plane's light changes, at points on which the object does not
    stand: a person could take such changes for flicker. The true change is that of the mesh, whose shadow a session
    bakes, under the map with its near lights where the session has them.
    """
    scene = inputs.scene("figurine")
    try:
        meet = rays(scene.mesh)
    except ImportError as reason:
        yield skipped("flicker, 300-frame recording", str(reason))
        return
    film = fastibl.simulate(seconds=20, fps=15, seed=0, position=inputs.OBJECT)
    session = fastibl.Session(scene, film.rig, film.board)
    seen = last = None
    everywhere: list[truth.Errors] = []
    steps: list[tuple[float, truth.Errors, truth.Errors]] = []  # light that changed; error of the change; true change
    for frame in film:
        result = session.process(frame)
        if result.lighting is None:
            continue
        shadow, cube = result.shadow_map, result.environment.radiance
        if seen is None:
            # Without a coarse map around it, a map fades towards its border; that has nothing to do with light.
            points = truth.grid(20, 0.7 * shadow.extent) + shadow.centre
            seen = Visibility(lambda sky: behind_mesh(sky, scene.mesh), points, cube.size, meet)
            covered = under(scene.mesh, points)
            weight = np.maximum(texels(cube.size)[0][:, 2:], 0) * texels(cube.size)[1][:, None]
        flux = cube.faces.reshape(-1, 3) * weight
        true = seen.ratio(cube, result.lighting.lights, result.environment.centre)
        now = true, shadow.sample(points).astype(np.float64), flux
        if last is not None:
            moved = float((np.abs(flux - last[2]).sum(axis=0) / np.maximum(flux.sum(axis=0), 1e-9)).max())
            change = now[0] - last[0]
            given = now[1] - last[1]
            steps.append((moved, truth.errors(given[~covered], change[~covered]), truth.errors(change, 0 * change)))
            everywhere.append(truth.errors(given, change))
        last = now

    def worst(most: float) -> tuple[int, truth.Errors]:
        some = [e for moved, e, _ in steps if moved <= most]
        return len(some), truth.Errors(max((e.rms for e in some), default=0), max((e.worst for e in some), default=0))

    count, judged = worst(0.02)
    hidden = max(e.worst for e, (moved, _, _) in zip(everywhere, steps, strict=True) if moved <= 0.02)
    more = [(most, *worst(most)) for most in (0.01, 0.05)]
    yield Goal(
        "flicker, 300-frame recording: error of the change from frame to frame, largest RMS and largest of all points",
        f"{judged.rms:.5f}, {judged.worst:.4f}",
        f"<= {_GOAL.rms}, <= {_GOAL.worst}",
        bool(count and judged.rms <= _GOAL.rms and judged.worst <= _GOAL.worst),
        (
            f"{count} of {len(steps)} steps change at most 2 % of the light; "
            + "; ".join(f"at most {100 * m:g} %: {n} steps {e.rms:.5f}, {e.worst:.4f}" for m, n, e in more),
            f"under the object, too: largest {hidden:.4f}",
            f"over all steps: largest {worst(np.inf)[1].worst:.4f}, mean RMS of the error "
            f"{np.mean([e.rms for _, e, _ in steps]):.5f}, of the true change "
            f"{np.mean([t.rms for _, _, t in steps]):.5f}",
        ),
    )
