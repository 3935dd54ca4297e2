"""Pictures of the shadow under each light: the truth by rays, the paper's method, ours, and ten times the error of
ours.

    ./dev bench shadow-pictures     writes docs/images/shadow-<mesh>.jpg, place-bounce.jpg and place-holdout.jpg, and
                                    the table of docs/shadow.md

They show what a camera above a grey table sees, white-balanced on the table. The truth is evaluated at every pixel; the
methods draw with shadow maps, as in use. The object is shaded alike in all pictures: only its shadow is compared here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl

from ..goals import Goal, row
from ..measure import ROOT
from . import place_pictures, truth
from .plane import encoded

IMAGES = ROOT / "docs" / "images"
PAGE = ROOT / "docs" / "shadow.md"
WIDTH, HEIGHT = 208, 150
SIZE = 128  # face edge of the lights' maps
_EYE, _TARGET = np.array([2.3, 1.15, 1.95]), np.array([0.28, -0.18, 0.25])
_VIEW = np.radians(40)  # angle from left to right
_SPLIT = 3  # pieces of a pixel along each axis, at which the object is sampled
_TABLE = 0.45  # linear light of the table without a shadow
_OBJECT = 0.8  # brightness of the object relative to the table, both in the same light
_GAIN = 10  # factor on the differences


@dataclass(frozen=True)
class View:
    """Pixels of a camera: points of the plane (h, w, 2), the object's coverage (h, w), and where its pieces lie."""

    points: NDArray
    alpha: NDArray
    triangle: NDArray  # of the pieces of pixels; -1 for none
    barycentric: NDArray


def _rays(split: int) -> NDArray:
    """Directions (h split, w split, 3), unit length."""
    forward = (_TARGET - _EYE) / np.linalg.norm(_TARGET - _EYE)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    f = 0.5 * WIDTH / np.tan(_VIEW / 2)
    x = ((np.arange(WIDTH * split) + 0.5) / split - WIDTH / 2) / f
    y = ((np.arange(HEIGHT * split) + 0.5) / split - HEIGHT / 2) / f
    d = forward + x[None, :, None] * right + y[:, None, None] * down
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def view_of(mesh: fastibl.Mesh) -> View:
    d = _rays(1)
    points = _EYE[:2] - d[..., :2] * (_EYE[2] / d[..., 2:])
    fine = _rays(_SPLIT).astype(np.float32)
    triangle, _, uv = fastibl.Bvh(mesh).nearest(np.broadcast_to(_EYE.astype(np.float32), fine.shape).copy(), fine)
    alpha = _reduced((triangle >= 0).astype(np.float64)[..., None])[..., 0]
    return View(points, alpha, triangle, uv)


def _reduced(fine: NDArray) -> NDArray:
    return fine.reshape(HEIGHT, _SPLIT, WIDTH, _SPLIT, -1).mean(axis=(1, 3))


def object_light(mesh: fastibl.Mesh, view: View, cube: fastibl.CubeMap) -> NDArray:
    """Linear light (h, w, 3) of a white matte object with its ambient occlusion, divided by the plane's; 0 beside the
    object."""
    lighting = fastibl.Lighting(cube)
    corners = mesh.triangles[view.triangle]
    u, v = view.barycentric[..., :1], view.barycentric[..., 1:]
    weights = np.concatenate([1 - u - v, u, v], axis=-1)
    seen = view.triangle >= 0
    normals = np.einsum("...k,...kc->...c", weights, mesh.normals[corners])[seen]
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    d = np.broadcast_to(_rays(_SPLIT), (*view.triangle.shape, 3))[seen]
    normals = np.where((normals * d).sum(axis=-1, keepdims=True) > 0, -normals, normals)  # the back of an open shell
    visible = np.einsum("...k,...k->...", weights, fastibl.ambient_occlusion(mesh)[corners])[seen]
    plane = np.maximum(lighting.irradiance(np.array([[0.0, 0.0, 1.0]]))[0], 1e-9)
    out = np.zeros((*view.triangle.shape, 3))
    out[seen] = lighting.irradiance(normals) / plane * np.clip(visible, 0, 1)[:, None]
    out = _reduced(out)
    # Light from the side alone can make the object far brighter than the table; it is then dimmed, so that it does not
    # burn out.
    return out / max(1.0, _TABLE * _OBJECT * float(np.quantile(out, 0.99)))


def picture(ratio: NDArray, light: NDArray, alpha: NDArray) -> NDArray[np.uint8]:
    """The encoded picture (h, w, 3) of the table with a shadow, and the object over it."""
    linear = _TABLE * ((1 - alpha[..., None]) * ratio + _OBJECT * light)
    return np.clip(encoded(np.minimum(linear, 1.0)) + 0.5, 0, 255).astype(np.uint8)


def difference(ratio: NDArray, true: NDArray, alpha: NDArray) -> NDArray[np.uint8]:
    """Ten times the difference of displayed values, around mid-grey; where the object is, the picture is flat."""
    off = encoded(_TABLE * ratio) - encoded(_TABLE * true)
    return np.clip(128 + _GAIN * (1 - alpha[..., None]) * off + 0.5, 0, 255).astype(np.uint8)


Method = Callable[[fastibl.CubeMap, NDArray], NDArray]  # light and points to the ratio


def methods(mesh: fastibl.Mesh, spheres: NDArray) -> dict[str, Method]:
    """What is shown beside the truth, by its caption."""
    baked = fastibl.MeshShadow(mesh, 256, extent=2.2, directions=256)
    return {
        "cap-product (paper)": lambda cube, p: fastibl.cast_shadow(
            cube, spheres, "cap-product", resolution=256, extent=2.2
        ).sample(p),
        "directions, 50 spheres": lambda cube, p: fastibl.cast_shadow(
            cube, spheres, "directions", resolution=256
        ).sample(p),
        "mesh, rigid object": lambda cube, p: baked.cast(cube).sample(p),
    }


def sheet(name: str) -> tuple[NDArray[np.uint8], dict[str, dict[str, truth.Errors]]]:
    """All lights of one mesh in one picture, and the errors over its pixels by light and method."""
    mesh, spheres = truth.meshes()[name], truth.spheres(name)
    view = view_of(mesh)
    open_ = view.alpha < 1
    lights = truth.lights(SIZE)
    true = np.ones((HEIGHT, WIDTH, len(lights), 3))
    true[open_] = truth.kept_mesh_ratio([light.cube for light in lights.values()], mesh, view.points[open_])
    shown = methods(mesh, spheres)
    rows, errors = [], {}
    for k, (light_name, light) in enumerate(lights.items()):
        at = object_light(mesh, view, light.cube)
        ratios = {caption: np.asarray(method(light.cube, view.points)) for caption, method in shown.items()}
        errors[light_name] = {c: truth.errors(r[open_], true[open_][:, k]) for c, r in ratios.items()}
        panels = [picture(true[:, :, k], at, view.alpha)]
        panels += [picture(r, at, view.alpha) for r in ratios.values()]
        panels += [difference(r, true[:, :, k], view.alpha) for c, r in ratios.items() if "paper" not in c]
        captions = ["truth by rays", *shown, *(f"{_GAIN} x off: {c}" for c in shown if "paper" not in c)]
        rows.append(_row(panels, light_name, captions if k == 0 else None))
    return np.concatenate(rows), errors


def _row(panels: list[NDArray], light: str, captions: list[str] | None) -> NDArray[np.uint8]:
    gap = np.full((HEIGHT, 4, 3), 255, np.uint8)
    joined = np.concatenate([part for panel in panels for part in (panel, gap)][:-1], axis=1)
    _write(joined, light, (5, HEIGHT - 6), (255, 255, 255))
    below = np.full((4, joined.shape[1], 3), 255, np.uint8)
    if captions is None:
        return np.concatenate([joined, below])
    head = np.full((18, joined.shape[1], 3), 255, np.uint8)
    for k, caption in enumerate(captions):
        _write(head, caption, (k * (WIDTH + 4) + 3, 13), (0, 0, 0))
    return np.concatenate([head, joined, below])


def _write(image: NDArray[np.uint8], text: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, colour, 1, cv2.LINE_AA)


def error_table(errors: Mapping[str, Mapping[str, Mapping[str, truth.Errors]]]) -> str:
    """A table in Markdown: RMS and largest error of the ratio by mesh, light and method."""
    captions = list(next(iter(next(iter(errors.values())).values())))
    lines = ["| light | " + " | ".join(f"{c}" for c in captions) + " |", "|---" * (len(captions) + 1) + "|"]
    for name in next(iter(errors.values())):
        cells = []
        for c in captions:
            of = [by[name][c] for by in errors.values()]
            rms = np.sqrt(np.mean([e.rms**2 for e in of]))
            cells.append(f"{rms:.4f} ({max(e.worst for e in of):.2f})")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


BEGIN, END = "<!-- ./dev bench shadow-pictures writes from here -->", "<!-- to here -->"


@row("shadow", "pictures")
def kept() -> Iterator[Goal]:
    """What the page shows; ./dev bench shadow-pictures draws it."""
    there = [name for name in truth.JUDGED if (IMAGES / f"shadow-{name}.jpg").is_file()]
    table = PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    listed = [name for name in truth.lights(SIZE) if f"| {name} |" in table]
    count = len(truth.lights(SIZE))
    yield Goal(
        "pictures of truth, paper's method, ours and ten times the difference in the docs: objects, lights",
        f"{len(there)} of {len(truth.JUDGED)}, {len(listed)} of {count}",
        "all",
        len(there) == len(truth.JUDGED) and len(listed) == count,
    )


def main() -> list[Path]:
    """Draws all pictures; returns the paths of what was written. Raises RuntimeError without the maps and meshes."""
    if len(truth.meshes()) < len(truth.MESHES):
        raise RuntimeError("the pictures need the meshes and maps beside the project")
    written, errors = [], {}
    for name in truth.JUDGED:
        image, errors[name] = sheet(name)
        path = IMAGES / f"shadow-{name}.jpg"
        cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
        written.append(path)
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{error_table(errors)}\n\n{END}{after}", encoding="utf-8")
    return [*written, *place_pictures.draw(), PAGE]
