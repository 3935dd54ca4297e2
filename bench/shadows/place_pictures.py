"""Pictures of the object in its place, by `./dev bench shadow-pictures`: the bounce, real objects as holdouts, and the
object's own shadow under a sun.

The table is grey in the back picture in any light, because exposures make it so. Below the horizon the maps hold that
table, as a captured map does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.comparison import level_at_most
from fastibl.truth import TrueRenderer

from ..brute import stored
from ..measure import ROOT
from . import truth

IMAGES = ROOT / "docs" / "images"
HEIGHT_OF_OBJECT = 0.12
ALBEDO = 0.5  # of the table
_TABLE = 0.25  # linear light of the table in the picture
_GAIN = 5  # factor on the differences
_CAMERA = fastibl.Camera(232, 174, 330.0, 330.0, 116.0, 87.0)
_COLOURS = {"spot": (0.75, 0.35, 0.2), "teapot": (0.8, 0.8, 0.75)}
_REAL = (0.25, 0.35, 0.5)  # albedo of the real boxes


def _view(eye: Sequence[float], target: Sequence[float]) -> fastibl.Pose:
    """camera_from_marker of an upright camera."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = right, np.cross(forward, right), forward
    pose[:3, 3] = -pose[:3, :3] @ np.array(eye)
    return fastibl.Pose(pose)


def _on_table(cube: fastibl.CubeMap) -> tuple[fastibl.CubeMap, float]:
    """The map in grey light, with a table below the horizon, and the exposure that shows that table."""
    d, angle, radiance = reference.samples(cube.faces)
    light = np.maximum((radiance * (angle * np.maximum(d[:, 2], 0))[:, None]).sum(axis=0), 1e-12)
    radiance = radiance / light  # irradiance 1 in every channel
    radiance[d[:, 2] < 0] = ALBEDO / np.pi
    return fastibl.CubeMap(radiance.reshape(cube.faces.shape)), _TABLE * np.pi / ALBEDO


def _mesh(name: str) -> fastibl.Mesh:
    mesh = truth.meshes()[name]
    return fastibl.stand(mesh, HEIGHT_OF_OBJECT * float(np.ptp(mesh.vertices[:, 2])))


def _box(centre: Sequence[float], size: Sequence[float], turn: float) -> fastibl.Mesh:
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (0, 1)]) * size
    c, s = np.cos(turn), np.sin(turn)
    corners = corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [*centre, 0]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return fastibl.Mesh(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


def _off(ours: NDArray, true: NDArray) -> NDArray[np.uint8]:
    return np.clip(128 + _GAIN * (ours.astype(float) - true), 0, 255).astype(np.uint8)


def bounce_rows() -> list[list[tuple[str, NDArray]]]:
    """Panels of each row with their captions: without the bounce, with it, the truth, and the error of the second."""
    view = _view((0.13, -0.36, 0.17), (0, 0, 0.045))
    renderers: dict[str, TrueRenderer] = {}
    rows = []
    for name, light in (("spot", "venice_sunset"), ("teapot", "kiara_1_dawn"), ("spot", "uniform")):
        cube, exposure = _on_table(truth.lights(128)[light].cube)
        scene = fastibl.Scene(_mesh(name), fastibl.Material(diffuse=_COLOURS[name]))
        if name not in renderers:
            renderers[name] = TrueRenderer(scene)
        back = _encoded(np.full((_CAMERA.height, _CAMERA.width, 3), _TABLE))
        made = [
            fastibl.Session(scene, fastibl.Rig(_CAMERA), environment=cube, methods={"bounce": bounce})
            .process(fastibl.Frame(0.0, back=back, back_exposure=exposure, back_from_marker=view))
            .image
            for bounce in ("none", "one-bounce")
        ]
        true = renderers[name].render(back, exposure, _CAMERA, view, cube).image
        captions = ("without", f"with one bounce, {light}", "truth by rays", f"{_GAIN} x off")
        rows.append(list(zip(captions, (*made, true, _off(made[1], true)), strict=True)))
    return rows


def _encoded(linear: NDArray) -> NDArray[np.uint8]:
    return np.round(_CAMERA.response.encode(np.clip(linear, 0, 1).astype(np.float32)) * 255).astype(np.uint8)


def _traced(
    meshes: Sequence[fastibl.Mesh], albedos: Sequence[Sequence[float]], cube: fastibl.CubeMap, view: fastibl.Pose
) -> NDArray:
    """Radiance (h, w, 3) of matte meshes on the table, each in the light that all of them let through: rays by Embree
    from what each pixel's middle sees to every texel of a level of the map. ImportError without embreex."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    first = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes]).astype(np.float32)
    TriangleMesh(scene, np.ascontiguousarray(first))
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes])
    face = np.cross(first[:, 1] - first[:, 0], first[:, 2] - first[:, 0]).astype(np.float64)
    face /= np.maximum(np.linalg.norm(face, axis=1, keepdims=True), 1e-20)
    smooth = [len(mesh.vertices) > 100 for mesh in meshes]  # boxes have edges
    marker = view.inverse()
    x, y = np.meshgrid(np.arange(_CAMERA.width) + 0.5, np.arange(_CAMERA.height) + 0.5)
    d = (_CAMERA.unproject(np.stack([x, y], -1)) @ marker.rotation.T).reshape(-1, 3)
    eye = np.broadcast_to(marker.translation, d.shape)
    hit = scene.run(eye.astype(np.float32).copy(), d.astype(np.float32), output=1)
    to, angle, radiance = reference.samples(level_at_most(cube, 32))
    flux = radiance * angle[:, None]
    out = np.empty((len(d), 3))
    for i in range(len(d)):
        t = hit["primID"][i]
        if t >= 0:
            n, k = face[t], owner[t]
            u, v = float(hit["u"][i]), float(hit["v"][i])
            weights = np.array([1 - u - v, u, v])
            point = weights @ first[t].astype(np.float64)
            if smooth[k]:
                corners = meshes[k].triangles[t - np.searchsorted(owner, k)]
                n = weights @ meshes[k].normals[corners].astype(np.float64)
                n /= np.linalg.norm(n)
            albedo = np.array(albedos[k])
        else:
            point, n, albedo = eye[i] - d[i] * (eye[i, 2] / d[i, 2]), np.array([0.0, 0, 1]), np.full(3, ALBEDO)
        up = np.flatnonzero(to @ n > 0)
        starts = np.broadcast_to((point + 2e-5 * n).astype(np.float32), (len(up), 3)).copy()
        free = scene.run(starts, to[up].astype(np.float32), query="OCCLUDED") < 0
        out[i] = albedo / np.pi * (((to[up] @ n) * free) @ flux[up])
    return out.reshape(_CAMERA.height, _CAMERA.width, 3)


def holdout_rows() -> list[list[tuple[str, NDArray]]]:
    """Panels: the back picture with real boxes, without their meshes, with them, the truth, and the error."""
    view = _view((0.16, -0.4, 0.2), (0.0, 0, 0.04))
    real = [_box((-0.1, 0.07), (0.12, 0.05, 0.1), 0.35), _box((0.045, -0.085), (0.07, 0.035, 0.045), -0.2)]
    mesh, rows = _mesh("spot"), []
    for light in ("venice_sunset", "dawn and sun"):
        cube, exposure = _on_table(truth.lights(128)[light].cube)

        def traced(meshes: list[fastibl.Mesh], albedos: list, cube: fastibl.CubeMap = cube) -> NDArray:
            key = ["traced", cube.faces, Path(__file__), *(a for m in meshes for a in (m.vertices, m.triangles))]
            return stored(key, lambda: _traced(meshes, albedos, cube, view))

        back = _encoded(exposure * traced(real, [_REAL] * 2))
        true = _encoded(exposure * traced([*real, mesh], [*[_REAL] * 2, _COLOURS["spot"]]))
        made = []
        for holdouts in ([], real):
            scene = fastibl.Scene(mesh, fastibl.Material(diffuse=_COLOURS["spot"]))
            scene.holdouts = holdouts
            session = fastibl.Session(scene, fastibl.Rig(_CAMERA), environment=cube, methods={"bounce": "none"})
            frame = fastibl.Frame(0.0, back=back, back_exposure=exposure, back_from_marker=view)
            made.append(session.process(frame).image)
        captions = ("back picture", "no holdouts", f"holdouts, {light}", "truth by rays", f"{_GAIN} x off")
        rows.append(list(zip(captions, (back, *made, true, _off(made[1], true)), strict=True)))
    return rows


def lamp_rows() -> list[list[tuple[str, NDArray]]]:
    """Panels: the object's own shadow under a sun by vertex, with rays to the brightest light, with rays to all of it,
    and what the second is off the third."""
    view, rows = _view((0.1, -0.26, 0.2), (0, 0, 0.05)), []
    cube, exposure = _on_table(truth.lights(128)["dawn and sun"].cube)
    back = _encoded(np.full((_CAMERA.height, _CAMERA.width, 3), _TABLE))
    for name in ("spot", "suzanne", "stanford-bunny"):
        scene = fastibl.Scene(_mesh(name), fastibl.Material(diffuse=_COLOURS["teapot"]))
        made = [
            fastibl.Session(scene, fastibl.Rig(_CAMERA), environment=cube, methods={"self_shadow": method})
            .process(fastibl.Frame(0.0, back=back, back_exposure=exposure, back_from_marker=view))
            .image
            for method in ("transfer", "traced-lights", "traced")
        ]
        captions = ("by vertex", "rays to the sun", "rays to all light", f"{_GAIN} x off")
        rows.append(list(zip(captions, (*made, _off(made[1], made[2])), strict=True)))
    return rows


def _sheet(rows: list[list[tuple[str, NDArray]]]) -> NDArray[np.uint8]:
    lines = []
    for row in rows:
        panels = []
        for caption, image in row:
            panel = image.copy()
            for colour, shift in (((0, 0, 0), 1), ((255, 255, 255), 0)):
                at = (5 + shift, _CAMERA.height - 6 + shift)
                cv2.putText(panel, caption, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, colour, 1, cv2.LINE_AA)
            panels += [panel, np.full((_CAMERA.height, 4, 3), 255, np.uint8)]
        line = np.concatenate(panels[:-1], axis=1)
        lines += [line, np.full((4, line.shape[1], 3), 255, np.uint8)]
    return np.concatenate(lines[:-1])


def draw() -> list[Path]:
    """Draws all sheets; returns the paths of what was written."""
    made: dict[str, Callable[[], list]] = {
        "place-bounce": bounce_rows,
        "place-holdout": holdout_rows,
        "self-shadow-lamps": lamp_rows,
    }
    written = []
    for name, rows in made.items():
        path = IMAGES / f"{name}.jpg"
        cv2.imwrite(str(path), _sheet(rows())[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
        written.append(path)
    return written
