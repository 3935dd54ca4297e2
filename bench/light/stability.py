"""Seams, steadiness, extremes, rotations and mirrors."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.measuring.samples import ANGLES, pairs

from .. import brute, inputs
from ..goals import Goal, largest, percent, row, skipped
from ..processes import tests

_SEAM_STEP = np.radians(0.05)
_SEAM_EXPONENTS = (2.0, 16.0, 64.0, 256.0, 2048.0)
Evaluator = Callable[[NDArray, NDArray], NDArray]  # from normals and views (n, 3), of unit length, to light (n, 3)


def _irradiance(lighting: fastibl.Lighting, normals: NDArray, _: NDArray) -> NDArray:
    return lighting.irradiance(normals)


def evaluators(cube: fastibl.CubeMap, exponents: tuple[float, ...]) -> Iterator[tuple[str, Evaluator]]:
    """Every diffuse method, every glossy one at each exponent, and GGX on chains of each kind."""
    for method in fastibl.methods("diffuse"):
        lighting = fastibl.Lighting(cube, diffuse=method)
        yield str(method), partial(_irradiance, lighting)
    for method in fastibl.methods("glossy"):
        lighting = fastibl.Lighting(cube, glossy=method)
        for s in exponents:
            yield f"{method} s = {s:g}", partial(lighting.glossy, exponent=s)
    for chain in ("mip", "centroid", "prefiltered"):
        lighting = fastibl.Lighting(cube, glossy=chain)
        for roughness in (0.1, 0.3, 0.6, 1.0):
            yield f"GGX on {chain}, roughness {roughness:g}", partial(lighting.ggx, roughness=roughness)


def edges() -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """The 12 edges of the cube: the axes of the two faces that meet there, and the axis along the edge."""
    axes = np.eye(3)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        for a, b in product((1, -1), repeat=2):
            yield a * axes[i], b * axes[j], axes[k]


def seam_ratios(evaluate: Evaluator, paths: int = 100, steps: int = 6) -> NDArray:
    """(12,): the step of the light across each edge, divided by the largest of the equally long steps beside it.

    Steps are RMS over paths across the edge; views are along the normals.
    """
    ratios = []
    along = np.linspace(-0.95, 0.95, paths)[:, None]
    angles = (np.arange(-steps, steps) + 0.5)[:, None, None] * _SEAM_STEP
    for a, b, c in edges():
        middle = a + b + along * c
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        n = np.cos(angles) * middle + np.sin(angles) * (b - a) / np.sqrt(2)
        light = brute.finite(np.asarray(evaluate(n, n), np.float64))
        square = (np.diff(light, axis=0) ** 2).mean(axis=(1, 2))  # 2 steps - 1 steps; the middle one crosses it
        beside = np.delete(square, steps - 1).max()
        ratios.append(np.sqrt(square[steps - 1] / max(beside, 1e-30)))
    return np.array(ratios)


@row("light", "seams")
def seams() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("step across the edges of the cube", inputs.NO_MAPS)
        return
    found: dict[str, list[float]] = {}
    for cube in inputs.real_maps().values():
        for name, evaluate in evaluators(cube, _SEAM_EXPONENTS):
            found.setdefault(name, []).append(seam_ratios(evaluate).max())
    worst = {name: largest(ratios) for name, ratios in found.items()}
    known = {"nearest-face"}  # the paper's method, for comparison: its faces do not meet
    value = largest(v for name, v in worst.items() if name not in known)
    yield Goal(
        "step across each of 12 edges by the steps beside it, all methods, worst edge and map",
        f"{value:.3f}",
        "<= 1.05",
        value <= 1.05,
        tuple(f"{name}: {f'{v:.3g}' if v < 1e6 else 'a step, and none beside it'}" for name, v in worst.items()),
    )


# Rotation and mirror


def texel_directions(size: int) -> NDArray:
    return reference.samples(np.zeros((6, size, size, 3)))[0]


def turned_exactly(faces: NDArray, turn: NDArray) -> NDArray:
    """The map turned by a signed permutation, so that every texel lands on a texel. turn: new direction = turn @
    old."""
    size = faces.shape[1]
    d = texel_directions(size)
    order = {tuple(key): i for i, key in enumerate(np.round(d * 1e5).astype(int))}
    source = [order[tuple(key)] for key in np.round(d @ turn * 1e5).astype(int)]
    return faces.reshape(-1, 3)[source].reshape(faces.shape)


def cube_symmetries() -> Iterator[tuple[str, NDArray]]:
    """Rotations of the cube onto itself, and mirrors."""
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            yield ("rotation" if np.linalg.det(matrix) > 0 else "mirror"), matrix


@row("light", "rotation and mirror")
def rotation() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("rotated and mirrored maps", inputs.NO_MAPS)
        return
    exponents = (2.0, 64.0, 1024.0)
    n, v = (x[100:] for x in pairs(100, seed=5))  # views along the normal have no plane of incidence to turn
    found: dict[str, dict[str, list[float]]] = {"rotation": {}, "mirror": {}}
    for map_name in ("studio_small_03", "venice_sunset"):
        cube = fastibl.CubeMap(reduced(inputs.real_maps()[map_name].faces, 4))
        before = {name: evaluate(n, v) for name, evaluate in evaluators(cube, exponents)}
        for kind, turn in cube_symmetries():
            turned = fastibl.CubeMap(turned_exactly(cube.faces, turn))
            for name, evaluate in evaluators(turned, exponents):
                difference = brute.errors(evaluate(n @ turn.T, v @ turn.T), before[name], before[name].mean()).mean()
                found[kind].setdefault(name, []).append(float(difference))
    for kind, differences in found.items():
        by_method = {name: largest(each) for name, each in differences.items()}
        value = largest(by_method.values())
        yield Goal(
            f"map and normals, the 24 {kind}s of the cube: mean change of the light, worst method",
            percent(value, 2),
            "<= 0.01 %",
            value <= 1e-4,
            tuple(f"{name}: {percent(v, 2)}" for name, v in by_method.items() if v > 1e-5),
        )


def reduced(faces: NDArray, factor: int) -> NDArray:
    """Plain means over factor x factor texels."""
    n = faces.shape[1] // factor
    return faces.reshape(6, n, factor, n, factor, 3).mean(axis=(2, 4))


# Steadiness


def _weights(size: int, count: int, exponents: tuple[float, ...]) -> tuple[NDArray, NDArray, dict[float, NDArray]]:
    """Normals and views, and by exponent the weights of a map's texels; exponent 0 stands for the irradiance."""
    d, angles, _ = reference.samples(np.zeros((6, size, size, 3)))
    n, v = pairs(count // len(ANGLES), seed=11)
    weights = {}
    for s in exponents:
        rows_ = np.empty((len(n), len(d)), np.float32)
        for i in range(len(n)):
            cosine = np.maximum(d @ n[i], 0)
            if s == 0:
                rows_[i] = cosine * angles
                continue
            half = d + v[i]
            half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-300)
            lobe = np.clip(half @ n[i], 0, 1) ** s * cosine * angles
            rows_[i] = lobe / lobe.sum()
        weights[s] = rows_
    return n, v, weights


_STEADY_EXPONENTS = (0.0, 16.0, 128.0)
_STEADY_GOALS = {"irradiance": 1e-3, "glossy": 3e-3}


class _Changes:
    """Changes of the light from map to map: estimated and true."""

    def __init__(self, size: int, count: int = 100, at_most: float = np.inf):
        """count: number of pairs of normal and view; at_most: only changes of the true light by at most this share of
        its mean are kept."""
        self.at_most = at_most
        self.n, self.v, self.weights = _weights(size, count, _STEADY_EXPONENTS)
        self.last: dict[float, tuple[NDArray, NDArray]] = {}
        self.errors: dict[str, list[float]] = {"irradiance": [], "glossy": []}

    def add(self, cube: fastibl.CubeMap, lighting: fastibl.Lighting) -> None:
        """Takes the next map; errors of the change are divided by the mean of the truth."""
        radiance = cube.faces.reshape(-1, 3)
        for s, weight in self.weights.items():
            true = weight @ radiance
            given = lighting.irradiance(self.n) if s == 0 else lighting.glossy(self.n, self.v, s)
            if s in self.last:
                change = true - self.last[s][1]
                wrong = (given - self.last[s][0]) - change
                if brute.errors(change, 0, true.mean()).mean() <= self.at_most:
                    error = float(brute.errors(wrong, 0, true.mean()).mean())
                    self.errors["glossy" if s else "irradiance"].append(error)
            self.last[s] = given, true


def _steady(what: str, errors: dict[str, list[float]], judge: Callable[[NDArray], float], name: str) -> Iterator[Goal]:
    for step, goal in _STEADY_GOALS.items():
        values = np.array(errors[step])
        value = float(judge(values))
        yield Goal(
            f"{what}: {name} error of the change of {step}",
            percent(value, 2),
            f"<= {percent(goal)}",
            value <= goal,
            (f"{len(values)} changes: mean {percent(values.mean(), 2)}, largest {percent(values.max(), 2)}",),
        )


@row("light", "steadiness: 2 % of the light")
def light_change() -> Iterator[Goal]:
    """The brightest hundredth of the sphere, or one half of it, becomes 2 % brighter."""
    if not inputs.MAPS:
        yield skipped("a light change of 2 %", inputs.NO_MAPS)
        return
    total: dict[str, list[float]] = {"irradiance": [], "glossy": []}
    for cube in inputs.real_maps().values():
        faces = reduced(cube.faces, 2)
        brightness = faces.sum(axis=-1)
        half = (texel_directions(faces.shape[1]) @ (0.6, 0.64, 0.48) > 0).reshape(brightness.shape)
        for brighter in (brightness > np.quantile(brightness, 0.99), half):
            changes = _Changes(faces.shape[1])
            lighting = None
            for scale in (1, 1.02):
                changed = fastibl.CubeMap(np.where(brighter[..., None], scale * faces, faces))
                lighting = fastibl.Lighting(changed, previous=lighting)
                changes.add(changed, lighting)
            for step, errors in changes.errors.items():
                total[step] += errors
    yield from _steady("2 % light change, 7 maps", total, np.max, "worst map's mean")


@row("light", "steadiness: a recording")
def recording() -> Iterator[Goal]:
    """300 frames in the built-in room: the captured map changes, and with it the light; nothing else may change.

    Only frames are judged whose true light changes by at most 2 %, which a person could take for flicker. Other glossy
    methods stand beside the default. Samples of the lobe tend to the reference, so nothing but the lobe's shape is in
    its error: a look-up is wrong by a share of the light, and by about that share of a change.
    """
    changes = _Changes(128, at_most=0.02)
    others = {}
    for name, method in (
        ("stretched", fastibl.Method("stretched")),
        ("1024 samples", fastibl.Method("sampled", taps=1024)),
    ):
        other = copy.deepcopy(changes)
        other.weights.pop(0.0)  # glossy light only
        others[name] = method, other
    last = dict.fromkeys(others)
    scene = fastibl.Scene(inputs.scene("figurine").mesh, fastibl.Material(glossy=(0.2,) * 3, exponent=64))
    film = fastibl.simulate(seconds=20, fps=15, seed=0, position=inputs.OBJECT)
    session = fastibl.Session(scene, film.rig, film.board)
    for frame in film:
        result = session.process(frame)
        if result.lighting is not None:
            radiance = result.environment.radiance
            changes.add(radiance, result.lighting)
            for name, (method, other) in others.items():
                made = last[name] = fastibl.Lighting(radiance, diffuse="sh9", glossy=method, previous=last[name])
                other.add(radiance, made)
    notes = tuple(
        f"glossy by {name}: mean {percent(float(np.mean(other.errors['glossy'])), 2)}, "
        f"largest {percent(float(np.max(other.errors['glossy'])), 2)}"
        for name, (_, other) in others.items()
    )
    for goal in _steady("300-frame recording, map against light", changes.errors, np.max, "largest"):
        yield replace(goal, notes=goal.notes + notes) if "glossy" in goal.what else goal


@row("light", "extremes")
def extremes() -> Iterator[Goal]:
    yield tests("extreme maps, exponents and views, every method, both back ends", ["test_light_extremes.py"])
