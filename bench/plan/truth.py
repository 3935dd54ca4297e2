"""True pictures of the cases: light and shadow by Embree's rays to every part of the sky.

A direction is the centre of a texel of the 64 squared level, or of the 128 squared one where a texel holds more than
1/2000 of the light of any map. Light is computed at four samples per pixel, with the interpolated normal, on the side
that is seen; what the object hides from itself is dark. The ratio is computed at every pixel of the plane. One bounce
between plane and object, which is small, is that of fastibl.truth. The four samples are those of the renderer, because
a plan does not choose how edges are sampled.
"""

from __future__ import annotations

from functools import cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.truth import TrueRenderer, dielectric_of, pbr_surface, transmitted

from .. import inputs
from ..brute import Part, stored
from ..shadows.sky import NO_EMBREE
from .cases import EYE, HEIGHT, MATERIALS, WIDTH, Picture, environment, plane_points, rays, scene

_VERSION = "2"  # version of what is kept on disk: raise it when what follows changes
_COARSE, _BRIGHT = 64, 1 / 2000
_SAMPLES = ((0.375, 0.125), (0.875, 0.375), (0.125, 0.625), (0.625, 0.875))  # of a pixel, as in shading/rasterize.cpp
_GRID, _EXTENT = 64, 0.4  # points and extent of the plane where the bounce is computed, metres


@cache
def sky() -> tuple[NDArray, NDArray, NDArray]:
    """Directions (k, 3), solid angles (k,), and the radiance (k, 3 maps) of all maps side by side."""
    maps = [environment(name) for name in inputs.MAPS]
    fine_d, fine_a, _ = reference.samples(np.zeros((6, 128, 128, 3)))
    fine = np.hstack([m.faces.reshape(-1, 3).astype(np.float64) for m in maps])
    n = _COARSE
    blocks = np.arange(6 * 128 * 128).reshape(6, n, 2, n, 2).transpose(0, 1, 3, 2, 4).reshape(-1, 4)
    angles = fine_a[blocks]
    flux = (fine[blocks] * angles[..., None]).sum(axis=1)
    bright = (flux > _BRIGHT * flux.sum(axis=0)).any(axis=1)
    d, a, _ = reference.samples(np.zeros((6, n, n, 3)))
    split = blocks[bright].ravel()
    keep = ~bright
    return (
        np.concatenate([d[keep], fine_d[split]]),
        np.concatenate([angles.sum(axis=1)[keep], fine_a[split]]),
        np.concatenate([(flux / angles.sum(axis=1)[:, None])[keep], fine[split]]),
    )


def embree_scene(mesh: fastibl.Mesh):
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise ImportError(NO_EMBREE) from error
    embree = EmbreeScene()
    TriangleMesh(embree, np.ascontiguousarray(mesh.vertices[mesh.triangles], np.float32))
    return embree


def _free(embree, mesh: fastibl.Mesh, origins: NDArray, normals: NDArray, chunk: int = 128):
    """Yields slices, and whether each direction is above the horizon and free, as seen from these points (chunk, k)."""
    d32 = sky()[0].astype(np.float32)
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    radius = 1.001 * np.linalg.norm(mesh.vertices - middle, axis=1).max()
    for i in range(0, len(origins), chunk):
        part = slice(i, i + chunk)
        free = normals[part].astype(np.float32) @ d32.T > 0
        towards = middle - origins[part]
        distance = np.linalg.norm(towards, axis=1, keepdims=True)
        cosine = np.sqrt(np.maximum(1 - (radius / np.maximum(distance, radius)) ** 2, 0)) * (distance > radius)
        may = np.where(distance > radius, (towards / distance).astype(np.float32) @ d32.T >= cosine, True)
        row, column = np.nonzero(free & may)
        met = embree.run(origins[part].astype(np.float32)[row], d32[column], query="OCCLUDED") >= 0
        free[row, column] = ~met
        yield part, free


class Seen:
    """What the samples of all pixels see of the object: pixel (p,), corners (p, 3), weights (p, 3, 1), position,
    normal, view, the start of rays, and whether the back of the triangle is seen."""

    def __init__(self, mesh: str):
        given = scene(mesh).mesh
        d = np.stack([rays(*place) for place in _SAMPLES]).reshape(len(_SAMPLES), -1, 3)
        origins = np.broadcast_to(EYE, d.shape).astype(np.float32).copy()
        triangle, _, uv = fastibl.Bvh(given).nearest(origins, d.astype(np.float32))
        _, self.pixel = np.nonzero(triangle >= 0)
        uv, self.corner = uv[triangle >= 0], given.triangles[triangle[triangle >= 0]]
        self.weights = np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1)[..., None].astype(np.float64)
        self.position, self.normal = self.of(given.vertices), self.of(given.normals)
        self.normal /= np.linalg.norm(self.normal, axis=1, keepdims=True)
        self.view = EYE - self.position
        self.view /= np.linalg.norm(self.view, axis=1, keepdims=True)
        a, b, c = (given.vertices[self.corner[:, k]].astype(np.float64) for k in range(3))
        self.behind = (np.cross(b - a, c - a) * self.view).sum(axis=1) < 0
        side = np.where(self.behind, -1.0, 1.0)[:, None]
        self.normal *= side
        # Rays start on the round surface that the normals describe. Flat triangles would be hidden by their own
        # neighbours: Hanika 2021, Hacking the Shadow Terminator.
        corners, normals = (np.asarray(x, np.float64)[self.corner] for x in (given.vertices, given.normals))
        normals = normals * side[:, None]
        below = np.minimum(((self.position[:, None] - corners) * normals).sum(axis=2, keepdims=True), 0)
        self.start = self.position - (self.weights * below * normals).sum(axis=1)
        self.mesh = given

    def of(self, by_vertex: NDArray) -> NDArray:
        return (np.asarray(by_vertex, np.float64)[self.corner] * self.weights).sum(axis=1)


@cache
def seen(mesh: str) -> Seen:
    return Seen(mesh)


@cache
def _all(mesh: str) -> dict[str, NDArray]:
    """Everything from which the materials' colours are made, for all maps at once; kept on disk."""
    given = scene(mesh).mesh
    names = ["irradiance", "gain", "sent", *(k for k, m in MATERIALS.items() if m.model == "pbr" or any(m.glossy))]
    light = [environment(name).faces for name in inputs.MAPS]
    text = repr([_VERSION, EYE, [(k, repr(m)) for k, m in MATERIALS.items()]])
    made: dict[str, NDArray] = {}

    def make(name: str) -> NDArray:
        if not made:
            made.update(_work_out(mesh))
        return made[name]

    key: list[Part] = [given.vertices, given.triangles, *light, text]
    return {name: stored(["plan", name, *key], partial(make, name)) for name in names}


def _work_out(mesh: str) -> dict[str, NDArray]:
    s, (d, angle, radiance) = seen(mesh), sky()
    embree, scale = embree_scene(s.mesh), float(np.ptp(s.mesh.vertices, axis=0).max())
    flux = radiance * angle[:, None]
    out = {}
    # The plane.
    ground = plane_points().reshape(-1, 2)
    up, above = np.broadcast_to([0.0, 0, 1], (len(ground), 3)), d[:, 2] > 0
    ratio = np.empty((len(ground), flux.shape[1]))
    plane_flux = flux * np.maximum(d[:, 2:], 0)
    for part, free in _free(embree, s.mesh, np.pad(ground, ((0, 0), (0, 1)), constant_values=1e-5 * scale), up):
        ratio[part] = free @ plane_flux / plane_flux[above].sum(axis=0)
    # The bounce: what the shadow takes from the vertices, and what the object sends to the plane at reflectance 1.
    white = fastibl.Scene(s.mesh, fastibl.Material(diffuse=(1.0, 1.0, 1.0)), spheres=0, visibility_rays=0)
    rough = TrueRenderer(white, extent=_EXTENT, grid=_GRID)
    used, back = np.unique(s.corner, return_inverse=True)
    lost, sent = np.empty((len(used), flux.shape[1])), np.empty_like(ratio)
    at = ((plane_points() / _EXTENT + 1) / 2 * _GRID - 0.5).astype(np.float32)
    for k, name in enumerate(inputs.MAPS):
        cube, three = environment(name), slice(3 * k, 3 * k + 3)
        lost[:, three] = rough.lost_below(cube, s.mesh.vertices, s.mesh.normals, rough.hidden_at_vertex)[used]
        added = (rough.plane_gain(cube) - rough.plane_ratio(cube)).astype(np.float32)
        here = cv2.remap(added, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        sent[:, three] = here.reshape(-1, 3)
    out["gain"], out["sent"] = ratio, sent
    out["irradiance"] = -(lost[back.reshape(s.corner.shape)] * s.weights).sum(axis=1)
    direct = _at_samples(mesh, np.arange(len(s.pixel)))
    out["irradiance"] += direct.pop("irradiance")
    return {**out, **direct}


def _at_samples(mesh: str, which: NDArray) -> dict[str, NDArray]:
    """Direct irradiance, and the averages under the lobes, of these samples."""
    s, (d, angle, radiance) = seen(mesh), sky()
    embree, scale = embree_scene(s.mesh), float(np.ptp(s.mesh.vertices, axis=0).max())
    flux = radiance * angle[:, None]
    out = {"irradiance": np.zeros((len(which), flux.shape[1]))}
    for name, material in MATERIALS.items():
        if material.model == "pbr" or any(material.glossy):
            out[name] = np.zeros((len(which), flux.shape[1] * (2 if material.model == "pbr" else 1)))
    normal, view = s.normal[which], s.view[which]
    for part, free in _free(embree, s.mesh, s.start[which] + 2e-4 * scale * normal, normal):
        n, v = normal[part], view[part]
        nd, vd = n @ d.T, v @ d.T
        out["irradiance"][part] += (np.maximum(nd, 0) * free) @ flux
        half = (nd + (n * v).sum(axis=1, keepdims=True)) / np.sqrt(np.maximum(2 + 2 * vd, 1e-9))
        for name, m in MATERIALS.items():
            if name not in out:
                continue
            if m.model != "pbr":
                weight = np.exp(m.exponent * np.log(np.clip(half, 1e-9, 1))) * np.maximum(nd, 0)
                out[name][part] = (weight * free) @ flux / np.maximum(weight @ angle, 1e-300)[:, None]
                continue
            alpha2, nv = (m.roughness**2) ** 2, np.maximum((n * v).sum(axis=1, keepdims=True), 1e-3)
            c = np.maximum(nd, 0)
            d_ggx = 1 / (np.clip(half, 0, 1) ** 2 * (alpha2 - 1) + 1) ** 2
            mask = np.sqrt(alpha2 + (1 - alpha2) * c**2) * nv + np.sqrt(alpha2 + (1 - alpha2) * nv**2) * c
            lobe = c * d_ggx / np.maximum(mask, 1e-9)
            rest = lobe * (1 - np.clip((1 + vd) / np.sqrt(np.maximum(2 + 2 * vd, 1e-9)), 0, 1)) ** 5
            front, count = lobe - rest, flux.shape[1]
            out[name][part, :count] = (front * free) @ flux / np.maximum(front @ angle, 1e-20)[:, None]
            out[name][part, count:] = (rest * free) @ flux / np.maximum(rest @ angle, 1e-20)[:, None]
    return out


def truth(map_name: str, mesh: str, material_name: str) -> Picture:
    """The true picture."""
    every, s, material = _all(mesh), seen(mesh), MATERIALS[material_name]
    k = list(inputs.MAPS).index(map_name)
    three = slice(3 * k, 3 * k + 3)
    light = every["irradiance"][:, three]
    if material.model == "pbr":
        tangent = s.of(s.mesh.tangents)
        p = pbr_surface(material, s.normal, tangent, None)
        seen_from = np.einsum("nkc,nc->nk", p.frame, s.view)
        a, c = fastibl.ggx_albedo(seen_from, alpha=p.alpha).T.astype(np.float64)
        count = every[material_name].shape[1] // 2
        front = every[material_name][:, three] * a[:, None]
        edge = every[material_name][:, count:][:, three] * c[:, None]
        more = 1 / np.maximum(a + c, 1e-4)[:, None] - 1
        m, base = p.metallic[:, None], p.base_color
        through = transmitted(a, c, material)[:, None]
        colour = (1 - m) * base * through * light / np.pi
        for share, f0 in ((material.specular * (1 - m), dielectric_of(material)), (m, base)):
            colour = colour + share * (f0 * front + edge) * (1 + f0 * more)
        sends = (1 - p.metallic[0]) * p.base_color[0]
    else:
        colour = np.asarray(material.diffuse) * light / np.pi
        if any(material.glossy):
            colour = colour + np.asarray(material.glossy) * every[material_name][:, three]
        sends = np.asarray(material.diffuse)
    gain = every["gain"][:, three] + sends * every["sent"][:, three]
    return Picture(_layer(s, colour), gain.reshape(HEIGHT, WIDTH, 3))


def _layer(s: Seen, colour: NDArray) -> NDArray:
    """Mean over the samples of each pixel (h, w, 4), premultiplied by coverage."""
    out = np.zeros((HEIGHT * WIDTH, 4))
    for c in range(3):
        out[:, c] = np.bincount(s.pixel, colour[:, c], len(out))
    out[:, 3] = np.bincount(s.pixel, minlength=len(out))
    return out.reshape(HEIGHT, WIDTH, 4) / len(_SAMPLES)
