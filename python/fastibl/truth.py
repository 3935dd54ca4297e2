"""The picture that a perfect system would make: a recording's true pose and map, visibility by rays, sums over the map.

It shares only the mesh and its ray queries with the fast path, and GGX's directional albedo, which is compared with a
quadrature; light, shadow and coverage are computed independently.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import reference
from ._fastibl import (
    Bvh,
    Camera,
    CubeMap,
    Environment,
    Material,
    Pose,
    Response,
    Scene,
    ShadowMap,
    ggx_albedo,
    texel_directions,
)
from .comparison import level_at_most
from .expected import expect, present
from .recording import Recording, truth_of

_DIRECTIONS = 32  # face edge of the map level whose texels are the light directions
_MIRROR = 1e5  # exponent from which a lobe is narrower than a texel, and shows one
_SPLIT = 4  # rays per pixel and axis, for coverage; light is computed once a quarter, or once where all are alike
_ALIKE = 0.9995  # cosine between a pixel's normals above which one place stands for all four quarters


@dataclass(eq=False)
class TruePicture:
    """image: (h, w, 3) uint8. linear: (h, w, 3) radiance times exposure before encoding. coverage: (h, w) of the
    object. ratio: (h, w, 3) true shadow ratio where there is no object, and gain: (h, w, 3) the same with the light
    that the object sends to the plane."""

    image: NDArray[np.uint8]
    linear: NDArray[np.float64]
    coverage: NDArray[np.float64]
    ratio: NDArray[np.float64]
    gain: NDArray[np.float64]


def picture_error(picture: NDArray[np.uint8], true: TruePicture, back: NDArray[np.uint8], response: Response) -> float:
    """RMS over RGB and over the pixels that the object covers or its shadow changes by more than 1/255, in linear
    light, relative to the truth's mean there. 0 where there are none, infinite where only the picture is not black."""
    where = (true.coverage > 0) | (np.abs(true.image.astype(int) - back).max(axis=-1) > 1)
    truth = np.clip(true.linear[where], 0, 1)
    difference = response.decode(picture / 255.0)[where] - truth
    if not (difference != 0).any():
        return 0.0
    mean = truth.mean()
    return float(np.sqrt((difference**2).mean()) / mean) if mean > 0 else np.inf


def texels_that_count(recording: Recording, last_seen: NDArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Texels (6, n, n) by which a captured map is judged at a recording's end, and those of them that never clipped.

    last_seen: Capture.last_seen. Texels count if they were seen since the lamp was switched on, and not last while a
    hand covered the front camera. Whether a texel clips is decided by what the darkest exposure can hold: the front
    camera's above the horizon, the back camera's below it.
    """
    truth, rig = truth_of(recording), recording.rig
    begin, end = truth.hand or (np.inf, -np.inf)
    counts = np.isfinite(last_seen) & (last_seen >= (truth.lamp_time or 0))
    counts &= ~((last_seen >= begin) & (last_seen <= end))
    front = min(present(f.front_exposure) for f in recording) * present(rig.front).gain
    back = min(present(f.back_exposure) for f in recording) * rig.back.gain
    true = np.asarray(truth.environment(recording.times[-1]).faces, np.float64)
    up = texel_directions(true.shape[1])[..., 2] > 0
    return counts, counts & (true.max(axis=-1) * np.where(up, front, back) < 0.95)


def _samples(source: CubeMap | Environment, most: int = _DIRECTIONS) -> tuple[NDArray, NDArray, NDArray]:
    """Directions, solid angles and radiances of a map's level of at most `most` texels along an edge: see
    reference.samples. Texels of maps with fewer of them than there are rays are split. ValueError where these do not
    fit."""
    faces = level_at_most(source, most)
    if faces.shape[1] < _DIRECTIONS:
        split, rest = divmod(_DIRECTIONS, faces.shape[1])
        if rest:
            raise ValueError(
                f"faces must be {_DIRECTIONS} texels wide, a power of two less, or have a MIP level that is, got "
                f"{faces.shape[1]}"
            )
        faces = faces.repeat(split, axis=1).repeat(split, axis=2)
    return reference.samples(faces)


@dataclass
class _Seen:
    """What a camera sees of the object, place by place. pixel (n,): number of the pixel in the picture; part (n,):
    share of it that the place covers; start (n, 3): where rays start; hidden: packed bits (n, directions / 8). tangent
    (n, 4) and uv (n, 2) may be None. colour: the mesh's, (n, 3), or 1."""

    pixel: NDArray
    part: NDArray
    normal: NDArray
    view: NDArray
    start: NDArray
    tangent: NDArray | None
    uv: NDArray | None
    hidden: NDArray[np.uint8]
    colour: NDArray | float


@dataclass(eq=False)
class PbrSurface:
    """A pbr material at n points: base_color, emission (n, 3), metallic (n,), alpha (n, 2), and frame (n, 3, 3), whose
    rows are tangent, bitangent and normal."""

    base_color: NDArray
    emission: NDArray
    metallic: NDArray
    alpha: NDArray
    frame: NDArray


def pbr_surface(material: Material, normals: NDArray, tangents: NDArray, uvs: NDArray | None) -> PbrSurface:
    """The material at the places where uvs (n, 2) read its textures: bilinear, without MIP levels. tangents: (n, 4)."""
    count = len(normals)

    def texels(i: NDArray, n: int, wrap: str) -> NDArray:
        if wrap == "clamp":
            return np.clip(i, 0, n - 1)
        return i % n if wrap == "repeat" else np.minimum(i % (2 * n), 2 * n - 1 - i % (2 * n))

    def at(value: object, channels: int) -> NDArray:
        array = np.asarray(value, np.float64)
        if array.ndim < 2:
            return np.broadcast_to(array, (count, channels)) if channels > 1 else np.full(count, float(array))
        h, w = array.shape[:2]
        u, v = present(uvs).T
        x, y = u * w - 0.5, (1 - v) * h - 0.5
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        f, g = x - i, y - j
        if channels > 1:
            f, g = f[:, None], g[:, None]
        along_u, along_v = material.wrap
        left, right = texels(i, w, along_u), texels(i + 1, w, along_u)
        top, bottom = texels(j, h, along_v), texels(j + 1, h, along_v)
        upper = (1 - f) * array[top, left] + f * array[top, right]
        return (1 - g) * upper + g * ((1 - f) * array[bottom, left] + f * array[bottom, right])

    def frame_of(n: NDArray, t: NDArray) -> NDArray:
        b = np.cross(n, t)
        bad = np.linalg.norm(b, axis=1) < 1e-4
        b[bad] = np.cross(n[bad], np.eye(3)[np.abs(n[bad]).argmin(axis=1)])
        b /= np.linalg.norm(b, axis=1, keepdims=True)
        return np.stack([np.cross(b, n), b, n], axis=1)

    side = np.where(tangents[:, 3] < 0, -1.0, 1.0)
    frame = frame_of(normals, tangents[:, :3])
    if material.normal is not None:
        bend = (at(material.normal, 3) * 2 - 1) * [material.normal_scale, material.normal_scale, 1]
        bend[:, 1] *= side
        bent = np.einsum("nk,nkc->nc", bend, frame)
        frame = frame_of(bent / np.linalg.norm(bent, axis=1, keepdims=True), tangents[:, :3])
    turn = material.anisotropy_rotation
    frame = frame_of(frame[:, 2], np.cos(turn) * frame[:, 0] + (np.sin(turn) * side)[:, None] * frame[:, 1])
    across = at(material.roughness, 1) ** 2
    alpha = np.clip(np.stack([across + (1 - across) * material.anisotropy**2, across], axis=1), 0.02, 1)
    return PbrSurface(at(material.base_color, 3), at(material.emission, 3), at(material.metallic, 1), alpha, frame)


def dielectric_of(material: Material) -> NDArray[np.float64]:
    """What is not metal of a pbr material reflects along the normal (3,), without its strength."""
    ratio = (material.ior - 1) / (material.ior + 1)
    return np.minimum(ratio**2 * np.asarray(material.specular_color, np.float64), 1)


def transmitted(a: NDArray, c: NDArray, material: Material) -> NDArray:
    """The share of its body's light that a dielectric's surface lets out, from ggx_albedo's two parts (n,)."""
    f0 = dielectric_of(material).max()  # as little of every colour
    return np.maximum(1 - material.specular * (f0 * a + c) * (1 + f0 * (1 / np.maximum(a + c, 1e-4) - 1)), 0)


def _coarse(count: int) -> NDArray:
    """For each texel of a map, the number of the texel of the coarser map for which visibility is known."""
    n = round((count / 6) ** 0.5)
    k = np.arange(n) * _DIRECTIONS // n
    return (np.arange(6)[:, None, None] * _DIRECTIONS**2 + k[:, None] * _DIRECTIONS + k).reshape(-1)


class TrueRenderer:
    """Brute force for one object on the plane; visibility is computed once and used for every map.

    One bounce is included: the plane sends out the map's light below the horizon, times the true ratio where a ray
    meets it, and receives the light that the object sends out diffusely. Light between parts of the object, light that
    goes to and fro more than once, and glossy light that the object sends to the plane are not included. bounce=False
    leaves the bounce out.

    extent: half the edge in metres of the plane grid on which shadows are computed; grid: its points along an edge.
    Maps are taken at the level of 32 texels along a face, 6144 directions; texels of smaller maps are split. Between
    the grid's points a sharp shadow is less exact than that of a session (studio: ratio off by 0.1 RMS, by 0.05 with
    grid=192); `fastibl.reference.shadow_ratio` is exact where it is asked.
    """

    def __init__(self, scene: Scene, extent: float = 0.3, grid: int = 64, bounce: bool = True):
        expect(scene, Scene, "scene")
        self.scene, self.bounce = scene, bounce
        self.bvh = Bvh(scene.mesh)
        self.extent, self.grid = extent, grid
        directions, _, _ = reference.samples(np.zeros((6, _DIRECTIONS, _DIRECTIONS, 3)))
        self.directions = directions.astype(np.float32)
        vertices, normals = scene.mesh.vertices, scene.mesh.normals
        self._lift = 2e-4 * float(np.ptp(vertices, axis=0).max())  # how far rays start off the surface
        self.hidden_at_vertex = self._hidden(vertices + self._lift * normals, normals)
        axis = ((np.arange(grid) + 0.5) / grid * 2 - 1) * extent
        x, y = np.meshgrid(axis, axis)
        points = np.stack([x, y, np.full_like(x, 1e-5)], axis=-1).reshape(-1, 3)
        up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        self.hidden_at_plane = self._hidden(points, up)
        self.plane_points = np.stack([x, y], axis=-1)
        self.outside_footprint = ~self.bvh.occluded(points, up.copy()).reshape(grid, grid)
        self._points = points.astype(np.float32)
        self._seen: tuple[NDArray, NDArray, NDArray] | None = None
        self._view: tuple[Camera, Pose, _Seen] | None = None
        self._ratio: tuple[CubeMap | Environment, NDArray] | None = None  # for the last map

    def _hidden(self, points: NDArray, normals: NDArray) -> NDArray[np.uint8]:
        """Whether the object hides each direction from each point: packed bits (points, directions / 8).

        Directions below a point's horizon do not count and are not tested.
        """
        out = np.empty((len(points), len(self.directions) // 8), np.uint8)
        for i, (point, normal) in enumerate(zip(points.astype(np.float32), normals.astype(np.float32), strict=True)):
            hidden = self.directions @ normal > 0
            hidden[hidden] = self.bvh.occluded(point, self.directions[hidden])
            out[i] = np.packbits(hidden)
        return out

    def vertex_irradiance(self, source: CubeMap | Environment) -> NDArray:
        """Irradiance (v, 3) at the vertices, without the part of the map that the object hides."""
        mesh = self.scene.mesh
        return self._irradiance(source, mesh.vertices, mesh.normals, self.hidden_at_vertex)

    def _irradiance(
        self, source: CubeMap | Environment, points: NDArray, normals: NDArray, hidden: NDArray[np.uint8]
    ) -> NDArray:
        """Irradiance (n, 3) without the part of the map that the object hides."""
        d, angle, radiance = _samples(source)
        normals = normals.astype(np.float64)
        flux, out = radiance * angle[:, None], np.empty((len(normals), 3))
        for i in range(0, len(normals), 512):
            free = 1 - np.unpackbits(hidden[i : i + 512], axis=1)
            out[i : i + 512] = (np.maximum(normals[i : i + 512] @ d.T, 0) * free) @ flux
        return out - self.lost_below(source, points, normals, hidden) if self.bounce else out

    def lost_below(
        self, source: CubeMap | Environment, points: NDArray, normals: NDArray, hidden: NDArray[np.uint8]
    ) -> NDArray:
        """Irradiance (n, 3) that points of the object lose because of the shadow on the plane."""
        import cv2

        d, angle, radiance = _samples(source)
        down = np.flatnonzero(d[:, 2] < 0)
        d, flux = d[down], (radiance * angle[:, None])[down].astype(np.float32)
        normals, points = normals.astype(np.float64), points.astype(np.float64)
        lost, out = (1 - self.plane_ratio(source)).astype(np.float32), np.empty((len(normals), 3))
        for i in range(0, len(normals), 512):
            part = slice(i, i + 512)
            free = 1 - np.unpackbits(hidden[part], axis=1)[:, down]
            point = points[part, None, :2] - points[part, None, 2:] / d[:, 2:] * d[:, :2]
            at = np.clip((point / self.extent + 1) / 2 * self.grid - 0.5, -10, self.grid + 10).astype(np.float32)
            at_point = cv2.remap(lost, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
            weight = np.maximum(normals[part] @ d.T, 0) * free
            out[part] = np.einsum("vd,vdc,dc->vc", weight.astype(np.float32), at_point, flux)
        return out

    def _seen_from_plane(self) -> tuple[NDArray, NDArray, NDArray]:
        """What points of the plane see of the object: point (k,), vertices (k, 3) and their shares of the form
        factor."""
        if self._seen is not None:
            return self._seen
        _, angle, _ = reference.samples(np.zeros((6, _DIRECTIONS, _DIRECTIONS, 3)))
        mesh, found = self.scene.mesh, []
        for i in range(0, len(self._points), 512):
            row, column = np.nonzero(np.unpackbits(self.hidden_at_plane[i : i + 512], axis=1))
            towards = self.directions[column]
            triangle, _, uv = self.bvh.nearest(self._points[i : i + 512][row], towards)
            corner = mesh.triangles[triangle]
            a, b, c = (mesh.vertices[corner[:, k]] for k in range(3))
            front = (triangle >= 0) & ((np.cross(b - a, c - a) * towards).sum(axis=1) < 0)
            weights = np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1)
            weights = weights * (towards[:, 2] * angle[column] / np.pi)[:, None]
            found.append((row[front] + i, corner[front], weights[front]))
        point, corners, weight = (np.concatenate(part) for part in zip(*found, strict=True))
        self._seen = point, corners, weight
        return self._seen

    def exitance(self, source: CubeMap | Environment) -> NDArray:
        """Light (v, 3) that the vertices send out diffusely: its radiance is exitance / pi."""
        material, mesh = self.scene.material, self.scene.mesh
        if material.model == "pbr":
            p = pbr_surface(material, mesh.normals, mesh.tangents, mesh.uvs)
            through = np.zeros(len(p.alpha))  # over all directions
            for square in (np.arange(16) + 0.5) / 16:
                across = np.sqrt((1 - square) / 2)
                view = np.broadcast_to([across, across, np.sqrt(square)], (len(through), 3))
                a, c = ggx_albedo(view, alpha=p.alpha).T.astype(np.float64)
                through += transmitted(a, c, material) / 16
            base_color = p.base_color if mesh.colors is None else p.base_color * mesh.colors
            reflectance, emission = (through * (1 - p.metallic))[:, None] * base_color, p.emission
        else:
            reflectance, emission = np.asarray(material.diffuse, np.float64), np.asarray(material.emission)
            if mesh.colors is not None:
                reflectance = reflectance * mesh.colors
            if material.exponent == 0:
                reflectance = reflectance + np.asarray(material.glossy)
        return reflectance * self.vertex_irradiance(source) + np.pi * emission

    def plane_gain(self, source: CubeMap | Environment) -> NDArray:
        """The true ratio plus the light that the object adds, relative to the plane's light without it (grid, grid,
        3)."""
        ratio = self.plane_ratio(source)
        if not self.bounce:
            return ratio
        d, angle, radiance = _samples(source)
        plane = (radiance * (angle * np.maximum(d[:, 2], 0))[:, None]).sum(axis=0)
        point, vertex, weights = self._seen_from_plane()
        sent, added = self.exitance(source), np.empty((len(self._points), 3))
        for c in range(3):
            light = (sent[vertex, c] * weights).sum(axis=1)
            # A plane that nothing else lights is as dark in the picture as the camera shows it.
            added[:, c] = np.bincount(point, light, len(self._points)) / plane[c] if plane[c] > 1e-12 else 0
        return ratio + added.reshape(ratio.shape)

    def plane_ratio(self, source: CubeMap | Environment) -> NDArray:
        """True shadow ratio (grid, grid, 3) on the plane; row 0 is y min."""
        if self._ratio is not None and self._ratio[0] is source:
            return self._ratio[1]
        d, angle, radiance = _samples(source)
        flux = radiance * (angle * np.maximum(d[:, 2], 0))[:, None]
        total = np.maximum(flux.sum(axis=0), 1e-12)
        lost = np.empty((len(self.hidden_at_plane), 3))
        for i in range(0, len(lost), 1024):
            lost[i : i + 1024] = np.unpackbits(self.hidden_at_plane[i : i + 1024], axis=1).astype(np.float32) @ flux
        self._ratio = source, (1 - lost / total).reshape(self.grid, self.grid, 3)
        return self._ratio[1]

    def shadow_error(self, shadow: ShadowMap, true_ratio: NDArray) -> float:
        """RMS of the ratio over plane points outside the footprint where the true 1 - ratio exceeds 0.01."""
        where = self.outside_footprint & ((1 - true_ratio).max(axis=-1) > 0.01)
        return float(np.sqrt(((shadow.sample(self.plane_points) - true_ratio)[where] ** 2).mean()))

    def _glossy(self, source: CubeMap | Environment, seen: _Seen, exponent: float) -> NDArray:
        """The average (n, 3) of the map under the lobe (n.h)^s max(n.w, 0), summed over its texels, of which a mirror
        shows one; what the object hides is dark."""
        if exponent >= _MIRROR:
            mirror = 2 * (seen.normal * seen.view).sum(axis=1, keepdims=True) * seen.normal - seen.view
            faces, of = level_at_most(source, 1 << 16), reference.texel_of(mirror, _DIRECTIONS)
            shown = np.asarray(faces, np.float64).reshape(-1, 3)[reference.texel_of(mirror, faces.shape[1])]
            hidden = seen.hidden[np.arange(len(of)), of // 8] >> (7 - of % 8) & 1
            return np.where((hidden == 0) & ((seen.normal * seen.view).sum(axis=1) > 0), shown.T, 0).T
        d, angle, radiance = _samples(source, _DIRECTIONS if exponent < 150 else 64)
        d32, light, of = d.astype(np.float32), radiance.astype(np.float32), _coarse(len(d))
        out = np.empty((len(seen.normal), 3))
        for i in range(0, len(out), 256):
            n, v = seen.normal[i : i + 256].astype(np.float32), seen.view[i : i + 256].astype(np.float32)
            nd, vd = n @ d32.T, v @ d32.T
            half = (nd + (n * v).sum(axis=1, keepdims=True)) / np.sqrt(np.maximum(2 + 2 * vd, 1e-6))
            weight = np.exp(exponent * np.log(np.clip(half, 1e-9, 1))) * np.maximum(nd, 0) * angle.astype(np.float32)
            free = 1 - np.unpackbits(seen.hidden[i : i + 256], axis=1)[:, of]
            out[i : i + 256] = (weight * free) @ light / np.maximum(weight.sum(axis=1, keepdims=True), 1e-20)
        return out

    def _pbr(self, source: CubeMap | Environment, p: PbrSurface, views: NDArray, light: NDArray, hidden: NDArray):
        """The colour (n, 3) of glTF's model. light: irradiance (n, 3) for the mapped normals; hidden: as in _Seen.

        The Fresnel term is integrated together with the lobe, over the texels of the map. Light that scatters more than
        once has the lobe's average colour.
        """
        sharp = p.alpha.min() < 0.15
        d, angle, radiance = _samples(source, 64 if sharp else _DIRECTIONS)
        d32, angle32, of = d.astype(np.float32), angle.astype(np.float32), _coarse(len(d))
        flux = radiance.astype(np.float32) * angle32[:, None]
        out = np.empty((len(views), 3))
        for i in range(0, len(views), 256):
            part = slice(i, i + 256)
            free = 1 - np.unpackbits(hidden[part], axis=1)[:, of]
            t, b, n = (p.frame[part, k].astype(np.float32) for k in range(3))
            v, alpha = views[part].astype(np.float32), p.alpha[part].astype(np.float32)
            lx, ly, lz = t @ d32.T, b @ d32.T, n @ d32.T
            vx, vy, vz = ((a * v).sum(axis=1, keepdims=True) for a in (t, b, n))
            vz = np.maximum(vz, 1e-3)
            size = np.sqrt(np.maximum((lx + vx) ** 2 + (ly + vy) ** 2 + (lz + vz) ** 2, 1e-12))
            ax, ay = alpha[:, :1], alpha[:, 1:]
            height = ((lx + vx) / size / ax) ** 2 + ((ly + vy) / size / ay) ** 2 + ((lz + vz) / size) ** 2
            below = np.sqrt(lz**2 + (ax * lx) ** 2 + (ay * ly) ** 2) * vz
            below += np.sqrt(vz**2 + (ax * vx) ** 2 + (ay * vy) ** 2) * np.maximum(lz, 0)
            lobe = np.maximum(lz, 0) / (height**2 * np.maximum(below, 1e-9))
            rest = (1 - np.clip((1 + lx * vx + ly * vy + lz * vz) / size, 0, 1)) ** 5
            edge_lobe = lobe * rest
            front_lobe = lobe - edge_lobe
            seen = np.hstack([vx, vy, vz])
            a, c = ggx_albedo(seen / np.linalg.norm(seen, axis=1, keepdims=True), alpha=alpha).T.astype(np.float64)
            front, edge = (
                (lobe * free) @ flux / np.maximum(lobe @ angle32, 1e-20)[:, None] * albedo[:, None]
                for lobe, albedo in ((front_lobe, a), (edge_lobe, c))
            )
            more = 1 / np.maximum(a + c, 1e-4)[:, None] - 1

            def reflected(f0: NDArray | float, front=front, edge=edge, more=more) -> NDArray:
                return (f0 * front + edge) * (1 + f0 * more)

            m, base = p.metallic[part, None], p.base_color[part]
            through = transmitted(a, c, self.scene.material)[:, None]
            out[part] = p.emission[part] + (1 - m) * base * through * light[part] / np.pi
            other = self.scene.material.specular * reflected(dielectric_of(self.scene.material))
            out[part] += (1 - m) * other + m * reflected(base)
        return out

    def _seen_by(self, camera: Camera, back_from_marker: Pose) -> _Seen:
        """Keeps what the last camera and pose saw, because it is the same for every map."""
        if self._view is not None and self._view[:2] == (camera, back_from_marker):
            return self._view[2]
        seen = self._look(camera, back_from_marker)
        self._view = camera, back_from_marker, seen
        return seen

    def _look(self, camera: Camera, back_from_marker: Pose) -> _Seen:
        mesh, s = self.scene.mesh, _SPLIT
        marker_from_back = back_from_marker.inverse()
        eye = marker_from_back.translation
        # The part of the picture around the vertices; the whole picture where a vertex has no place in it.
        corners = camera.project(back_from_marker @ mesh.vertices.astype(np.float64))
        x0, y0, x1, y1 = 0, 0, camera.width, camera.height
        if np.isfinite(corners).all():
            low, high = np.floor(corners.min(axis=0)) - 2, np.ceil(corners.max(axis=0)) + 2
            x0, y0 = (int(v) for v in np.clip(low, 0, (x1, y1)))
            x1, y1 = (int(v) for v in np.clip(high, (x0, y0), (x1, y1)))
        w, h = x1 - x0, y1 - y0
        x, y = np.meshgrid(x0 + (np.arange(w * s) + 0.5) / s, y0 + (np.arange(h * s) + 0.5) / s)

        def meet(x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
            rays = (camera.unproject(np.stack([x, y], axis=-1)) @ marker_from_back.rotation.T).reshape(-1, 3)
            origins = np.broadcast_to(eye, rays.shape).astype(np.float32)
            triangle, _, uv = self.bvh.nearest(origins.copy(), np.nan_to_num(rays).astype(np.float32))
            return triangle, uv

        triangle, uv = meet(x, y)

        def by_quarter(of: NDArray) -> NDArray:
            """(pixels, 4, rays of a quarter)"""
            half = s // 2
            return of.reshape(h, 2, half, w, 2, half).transpose(0, 3, 1, 4, 2, 5).reshape(h * w, 4, half * half)

        number = by_quarter(np.arange(len(triangle)))
        met = by_quarter(triangle >= 0)
        count = met.sum(axis=2)
        pixel, quarter = np.nonzero(count)
        # Looks along the middle of a quarter's rays that meet the object; where that misses, along one of these rays.
        rank = np.cumsum(met, axis=2)[pixel, quarter]
        at = number[pixel, quarter, (rank > (count[pixel, quarter][:, None] - 1) // 2).argmax(axis=1)]
        triangle, uv = triangle[at], uv[at]
        new_triangle, new_uv = meet(
            *(((by_quarter(v) * met).sum(axis=2) / np.maximum(count, 1))[pixel, quarter] for v in (x, y))
        )
        there = new_triangle >= 0
        triangle[there], uv[there] = new_triangle[there], new_uv[there]
        corner = mesh.triangles[triangle]
        weights = np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1)[..., None].astype(np.float64)

        def of(by_vertex: NDArray) -> NDArray:
            return (np.asarray(by_vertex, np.float64)[corner] * weights).sum(axis=1)

        def unit(v: NDArray) -> NDArray:
            return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)

        position = of(mesh.vertices)
        a, b, c = (mesh.vertices[corner[:, k]].astype(np.float64) for k in range(3))
        side = np.where((np.cross(b - a, c - a) * (eye - position)).sum(axis=1) < 0, -1.0, 1.0)[:, None]
        normal = unit(of(mesh.normals)) * side
        # Rays start on the round surface that the normals describe. Flat triangles would be hidden by their own
        # neighbours: Hanika 2021, Hacking the Shadow Terminator.
        around = np.asarray(mesh.normals, np.float64)[corner] * side[:, None]
        below = np.minimum(((position[:, None] - np.stack([a, b, c], axis=1)) * around).sum(axis=2, keepdims=True), 0)
        start = position - (weights * below * around).sum(axis=1)
        textured = self.scene.material.model == "pbr"
        tangent = of(mesh.tangents) if textured else None
        uvs = of(mesh.uvs) if textured and mesh.uvs is not None else None
        colour = 1.0 if mesh.colors is None else of(mesh.colors)
        part = count[pixel, quarter] / s**2
        pixel = (pixel // max(w, 1) + y0) * camera.width + pixel % max(w, 1) + x0
        if not textured and len(pixel):  # one place stands for four quarters that are whole and alike
            of_pixel = np.unique(pixel, return_inverse=True)[1]
            first = np.unique(pixel, return_index=True)[1]
            near = (normal * normal[first][of_pixel]).sum(axis=1) > _ALIKE
            alike = np.bincount(of_pixel, (part == 0.25) & near) == 4
            alone = ~alike[of_pixel]
            whole = np.flatnonzero(alike)

            def means(v: NDArray) -> NDArray:
                sums = np.stack([np.bincount(of_pixel, v[:, k]) for k in range(3)], axis=1)
                return np.concatenate([v[alone], sums[whole] / 4])

            # The start must not lie below the surface, which is round between the four places.
            middle, up = means(start), unit(means(normal))
            above = np.zeros(len(up))
            behind = np.empty(len(of_pixel), int)  # the new place of each old one
            behind[alone] = np.arange(alone.sum())
            behind[~alone] = (np.cumsum(alike) - 1 + alone.sum())[of_pixel[~alone]]
            np.maximum.at(above, behind, ((start - middle[behind]) * up[behind]).sum(axis=1))
            position, start, normal = means(position), middle + above[:, None] * up, up
            colour = means(colour) if isinstance(colour, np.ndarray) else colour
            pixel = np.concatenate([pixel[alone], pixel[first[whole]]])
            part = np.concatenate([part[alone], np.ones(len(whole))])
        hidden = self._hidden(start + self._lift * normal, normal) if len(pixel) else np.empty((0, 0), np.uint8)
        return _Seen(pixel, part, normal, unit(eye - position), start, tangent, uvs, hidden, colour)

    def render(
        self,
        back: NDArray[np.uint8],
        exposure: float,
        camera: Camera,
        back_from_marker: Pose,
        source: CubeMap | Environment,
    ) -> TruePicture:
        """The true composite over a back picture (h, w, 3) uint8 for the map `source`."""
        h, w = camera.height, camera.width
        marker_from_back = back_from_marker.inverse()
        eye = marker_from_back.translation
        seen, material = self._seen_by(camera, back_from_marker), self.scene.material
        flat = np.zeros((h * w, 4))
        if len(seen.pixel):
            if material.model == "pbr":
                surface = pbr_surface(material, seen.normal, present(seen.tangent), seen.uv)
                surface.base_color = surface.base_color * seen.colour
                light = self._irradiance(source, seen.start, surface.frame[:, 2], seen.hidden)
                colour = self._pbr(source, surface, seen.view, light, seen.hidden)
            else:
                light = self._irradiance(source, seen.start, seen.normal, seen.hidden)
                colour = np.asarray(material.emission) + np.asarray(material.diffuse) * seen.colour * light / np.pi
                if any(material.glossy):
                    colour = colour + np.asarray(material.glossy) * self._glossy(source, seen, material.exponent)
            for c in range(3):
                flat[:, c] = np.bincount(seen.pixel, colour[:, c] * seen.part, h * w)
            flat[:, 3] = np.bincount(seen.pixel, seen.part, h * w)
        layer = flat.reshape(h, w, 4)
        # The ratio at the plane point of each pixel, bilinear on the grid, 1 outside it.
        x, y = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
        ray = camera.unproject(np.stack([x, y], axis=-1))
        ray = ray @ marker_from_back.rotation.T
        with np.errstate(divide="ignore", invalid="ignore"):
            point = eye[:2] - eye[2] * ray[..., :2] / ray[..., 2:]
        import cv2

        at = (point / self.extent + 1) / 2 * self.grid - 0.5
        at[~(ray[..., 2] < 0)] = -10
        at = at.astype(np.float32)
        ratio, gain = (
            cv2.remap(
                on_plane, at[..., 0], at[..., 1], cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT, borderValue=(1, 1, 1),
            )
            for on_plane in (self.plane_ratio(source), self.plane_gain(source))
        )  # fmt: skip
        radius = np.hypot((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy)
        vignette = 1 + sum(v * radius ** (2 * k + 2) for k, v in enumerate(camera.vignetting))
        under = camera.response.decode(back / 255.0).astype(np.float64) * gain
        over = layer[..., :3] * (exposure * camera.gain * np.asarray(vignette))[..., None]
        linear = over + (1 - layer[..., 3:]) * under
        image = np.round(camera.response.encode(np.clip(linear, 0, 1)) * 255).astype(np.uint8)
        untouched = (layer[..., 3] == 0) & (gain == 1).all(axis=-1)
        image[untouched] = back[untouched]
        return TruePicture(image, linear, layer[..., 3], ratio, gain)
