"""Degenerate meshes: what is computed once for them, and the light that they hide from themselves."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from .._fastibl import Bvh, Mesh, PlaneExchange, SelfShadow, ambient_occlusion, fit_spheres
from ..files import read_mesh, read_object, stand
from ..measuring.samples import units
from ..mesh_shadow import MeshShadow
from .case import Case, Outcome, both, equal, is_light, is_ratio, refused, result_or_refusal
from .worlds import DEGENERATE, MAPS, ball_mesh, degenerate, map_named

BAD = {
    "no vertices": (np.zeros((0, 3)), np.zeros((0, 3), int)),
    "no triangles": (np.eye(3), np.zeros((0, 3), int)),
    "an index too large": (np.eye(3), [(0, 1, 3)]),
    "an index of 2 000 000 000": (np.eye(3), [(0, 1, 2_000_000_000)]),
    "an index of 2^40": (np.eye(3), np.array([(0, 1, 1 << 40)])),
    "a negative index": (np.eye(3), [(0, 1, -1)]),
    "a vertex of NaN": (np.array([(np.nan, 0, 0), (0, 1, 0), (0, 0, 1)]), [(0, 1, 2)]),
    "an infinite vertex": (np.array([(np.inf, 0, 0), (0, 1, 0), (0, 0, 1)]), [(0, 1, 2)]),
    "a vertex beyond float32": (np.array([(1e39, 0, 0), (0, 1, 0), (0, 0, 1)]), [(0, 1, 2)]),
    "vertices of two numbers": (np.zeros((3, 2)), [(0, 1, 2)]),
    "triangles of four": (np.eye(3), [(0, 1, 2, 0)]),
    "too few uvs": (np.eye(3), [(0, 1, 2)], np.zeros((2, 2))),
    "a uv of NaN": (np.eye(3), [(0, 1, 2)], np.full((3, 2), np.nan)),
    "a normal of NaN": (np.eye(3), [(0, 1, 2)], None, np.full((3, 3), np.nan)),
}
FILES = {
    "nothing.obj": b"",
    "no-triangles.obj": b"v 0 0 0\nv 1 0 0\n",
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "nan.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "text.ply": b"ply\nformat ascii 1.0\nelement vertex 99\nend_header\n1 2 3\n",
    "cut.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n",
    "noise.glb": bytes(range(256)) * 4,
    "header.glb": b"glTF\x02\x00\x00\x00\xff\xff\xff\x7f",
    "empty.glb": b"",
    "empty.gltf": b"{}",
    "cut.gltf": b'{"meshes": [{"primitives"',
}


def cases() -> Iterator[Case]:
    for name in BAD:
        yield Case(
            "objects",
            f"mesh with {name}",
            "an error that says what was expected",
            partial(_refused, name),
        )
    for name, content in FILES.items():
        yield Case("objects", f"file {name}", "an error that names the file", partial(_file, name, content))
    for name in DEGENERATE:
        yield Case("objects", f"{name}: normals, tangents", "unit length", partial(_frame, name))
        yield Case("objects", f"{name}: rays", "hits are real; packets as single rays", partial(_rays, name))
        yield Case(
            "objects",
            f"{name}: spheres",
            "finite, at least one, or a ValueError",
            partial(result_or_refusal, partial(_spheres, name)),
        )
        yield Case("self_shadow", f"{name}: occlusion, shares", "in [0, 1]", partial(_self_shadow, name))
        yield Case(
            "self_shadow", f"{name}: exchange with the plane", "finite, never negative", partial(_exchange, name)
        )
        yield Case("shadow", f"mesh: {name}", "ratios in [0, 1], or a ValueError", partial(_cast, name))
    for name in MAPS:
        yield Case("self_shadow", f"{name}: light of a ball", "shares in [0, 1], light finite", partial(_lit, name))
        yield Case("shadow", f"mesh of a ball, {name}", "ratios in [0, 1]", partial(_ball, name))
    yield Case("self_shadow", "a convex mesh", "keeps nothing from itself", _convex)
    yield Case(
        "self_shadow",
        "a vertex within spheres, spheres of NaN",
        "shares in [0, 1]",
        lambda: is_ratio(
            ambient_occlusion(ball_mesh(), 16, [(0, 0, 0.06, 0.2), (np.nan, 0, 0, 1), (0, 0, 0, -1)]), "share"
        ),
    )
    for height in (0.0, -1.0, np.nan, np.inf):
        yield Case(
            "objects",
            f"stand at a height of {height}",
            "ValueError",
            partial(_refused_height, height),
        )
    yield Case(
        "objects",
        "stand of a flat mesh",
        "ValueError",
        lambda: refused(lambda: stand(degenerate("flat on the plane"), 1)),
    )


def _refused(name: str) -> Outcome:
    return refused(lambda: Mesh(*_arrays(BAD[name])), (ValueError, TypeError, OverflowError))


def _refused_height(height: float) -> Outcome:
    return refused(lambda: stand(ball_mesh(), height))


def _arrays(given: tuple) -> list:
    with np.errstate(over="ignore"):
        return [None if a is None else np.asarray(a) for a in given]


def _file(name: str, content: bytes) -> Outcome:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        found = [refused(lambda: read_mesh(path), ValueError)]
        if path.suffix in (".glb", ".gltf"):
            found.append(refused(lambda: read_object(path), ValueError, name))
        return both(*found)


def _frame(name: str) -> Outcome:
    mesh = degenerate(name)
    return both(
        equal(np.linalg.norm(mesh.normals.astype(np.float64), axis=1), 1, 1e-5, "normals"),
        equal(np.linalg.norm(mesh.tangents[:, :3].astype(np.float64), axis=1), 1, 1e-5, "tangents"),
    )


def _rays(name: str) -> Outcome:
    mesh, bvh = degenerate(name), Bvh(degenerate(name))
    d = np.concatenate([units(200, 4), [(0, 0, 1.0), (0, 0, -1), (1, 0, 0), (0, 0, 0), (np.nan, 0, 1)]])
    origin = mesh.vertices.mean(axis=0, dtype=np.float64)
    origins = np.broadcast_to(origin, d.shape)
    triangle, t, uv = bvh.nearest(origins, d)
    hit = triangle >= 0
    single, packet = bvh.occluded(origins, d), bvh.occluded(origin, d)
    return both(
        is_light(t[hit], what=f"{hit.sum()} hits at"),
        Outcome(bool((triangle < len(mesh.triangles)).all()), "triangles there are"),
        Outcome(bool((np.abs(uv[hit] - 0.5) < 0.501).all()), "within their triangles"),
        Outcome(bool((single == hit).all()), f"{(single != hit).sum()} rays disagree"),
        Outcome(float((single != packet).mean()) <= 0.01, f"{(single != packet).sum()} of packets disagree"),
    )


def _spheres(name: str) -> Outcome:
    spheres = fit_spheres(degenerate(name), 8, resolution=16)
    held = len(spheres) >= 1 and bool(np.isfinite(spheres).all() and (spheres[:, 3] > 0).all())
    return Outcome(held, f"{len(spheres)} spheres, radius {spheres[:, 3].min():.3g} to {spheres[:, 3].max():.3g}")


def _self_shadow(name: str) -> Outcome:
    mesh = degenerate(name)
    from ..lighting import Lighting

    shadow = SelfShadow(mesh, size=16)
    lighting = Lighting(map_named("blue and red lamps"))
    return both(
        is_ratio(ambient_occlusion(mesh, 32), "occlusion"),
        is_ratio(shadow.shares(lighting), "share"),
        is_ratio(shadow.glossy_shares(lighting, (0.0, 0.0, 1.0), 1e9), "glossy share"),
        is_light(shadow.irradiance(lighting), what="E"),
    )


def _exchange(name: str) -> Outcome:
    exchange = PlaneExchange(degenerate(name), cells=8)
    up = exchange.onto_plane(np.ones((len(degenerate(name).vertices), 3)))
    down = exchange.onto_object(np.ones((8, 8, 3)))
    return both(is_light(up, what="on the plane"), is_light(down, np.pi * 1.05, "on the object"))


def _cast(name: str) -> Outcome:
    def run() -> Outcome:
        baked = MeshShadow(degenerate(name), 16, rings=4, samples=2, cache=False, progress=False)
        shadow = baked.cast(map_named("sun of 1e6 in one texel"))
        return both(is_ratio(shadow.image), is_ratio(shadow.outer, "outer ratio"))

    return result_or_refusal(run)


def _ball(name: str) -> Outcome:
    global _baked
    if _baked is None:
        _baked = MeshShadow(ball_mesh(), 24, rings=6, samples=2, cache=False, progress=False)
    shadow = _baked.cast(map_named(name))
    if name in ("black", "light from below only"):
        return both(Outcome(shadow.no_light, "no light"), equal(shadow.image, 1, 0, "ratio"))
    return both(is_ratio(shadow.image), is_ratio(shadow.sample([(0.0, 0.0), (1e9, 0), (np.nan, 0)])))


_baked: MeshShadow | None = None


def _lit(name: str) -> Outcome:
    from .light import _lighting

    mesh = ball_mesh(steps=8)
    shadow = SelfShadow(mesh, size=16)
    lighting = _lighting(name)
    most = np.pi * 1.5 * np.maximum(map_named(name).faces.max(axis=(0, 1, 2)), 1e-37)
    return both(is_ratio(shadow.shares(lighting), "share"), is_light(shadow.irradiance(lighting), most, "E"))


def _convex() -> Outcome:
    return equal(ambient_occlusion(ball_mesh(), 96), 1, 0.03, "occlusion")
