"""Whole pictures on both back ends: extreme maps, materials, objects, cameras and views."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial

import numpy as np

from .._fastibl import Camera, CubeMap, Environment, Material, Mesh, Pose, Rig, Scene
from ..recording import Frame
from ..session import Session
from .case import Case, Outcome, alike, both, each, equal, is_light, is_ratio, refused, result_or_refusal
from .worlds import (
    CONSTANT,
    DEGENERATE,
    FRONT,
    MAPS,
    PICTURE,
    ball_mesh,
    degenerate,
    map_named,
    seen_from,
    two_balls,
)

MATERIALS = {
    "matte": Material(diffuse=(1, 1, 1)),
    "rough": Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=3),
    "glossy": Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=500),
    "exponent 1e9": Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=1e9),
    "mirror": Material(diffuse=(0, 0, 0), glossy=(1, 1, 1), exponent=np.inf),
    "metal of roughness 0": Material.pbr((1, 1, 1), 1.0, 0.0),
    "plastic of roughness 1": Material.pbr((1, 1, 1), 0.0, 1.0),
    "brushed metal": Material.pbr((1, 1, 1), 1.0, 0.1, anisotropy=1.0),
}
# By name: for these it is known what they show in a constant map of 1.
WHITE = ("matte", "rough", "glossy", "exponent 1e9", "mirror")

CAMERAS = {
    "grazing the plane": (PICTURE, seen_from((0.0, -0.25, 0.002), (0, 0, 0.05))),
    "straight above": (PICTURE, seen_from((0.0, 0.0, 0.4), (0, 0, 0))),
    "in the object": (PICTURE, seen_from((0.0, 0.0, 0.06), (0.1, 0, 0.06))),
    "on its surface": (PICTURE, seen_from((0.0, -0.05, 0.06), (0, 0, 0.06))),
    "below the plane": (PICTURE, seen_from((0.0, -0.25, -0.1), (0, 0, 0.05))),
    "object behind it": (PICTURE, seen_from((0.0, -0.25, 0.1), (0, -1, 0.1))),
    "1 km away": (PICTURE, seen_from((0.0, -1000, 100), (0, 0, 0))),
    "1e6 m away": (PICTURE, seen_from((0.0, -1e6, 1e5), (0, 0, 0))),
    "1 x 1 pixels": (Camera(1, 1, 1, 1, 0.5, 0.5), FRONT),
    "2000 x 1 pixels": (Camera(2000, 1, 1000, 1000, 1000, 0.5), FRONT),
    "a focal length of 1e6": (Camera(64, 64, 1e6, 1e6, 32, 32), FRONT),
    "a focal length of 1 pixel": (Camera(64, 64, 1, 1, 32, 32), FRONT),
    "a lens that folds over": (Camera(64, 64, 20, 20, 32, 32, [-0.6, 0.2, 0, 0]), FRONT),
}
BY_PIXEL = ("pixel-transfer", "traced-lights")  # self-shadow that both back ends find for each pixel
EXPOSURES = (1e-30, 1e-6, 1.0, 1e6, 1e30)


def cases() -> Iterator[Case]:
    for backend in ("cpu", "gl"):
        for name in MAPS:
            for material in MATERIALS:
                yield Case(
                    "render",
                    f"{name}, {material}",
                    "finite, never negative; a white object in an even map as bright as that",
                    partial(_lit, name, material, backend),
                    backend,
                )
        for name in DEGENERATE:
            yield Case(
                "render",
                f"object: {name}",
                "a picture, finite, or a ValueError",
                partial(result_or_refusal, partial(_object, "auto", name, backend)),
                backend,
            )
            yield Case(
                "self_shadow",
                f"{name}, by pixel",
                "a picture, finite, or a ValueError",
                partial(result_or_refusal, partial(each, BY_PIXEL, _object, name, backend)),
                backend,
            )
        for name in MAPS:
            yield Case(
                "self_shadow",
                f"{name}: one ball above another, by pixel",
                "finite, no brighter than without",
                partial(each, BY_PIXEL, _by_pixel, name, backend),
                backend,
            )
        for name, (camera, pose) in CAMERAS.items():
            yield Case(
                "render",
                f"camera: {name}",
                "a picture of its size, finite",
                partial(_camera, camera, pose, backend),
                backend,
            )
        yield Case(
            "render",
            "four triangles of 100 km around the camera",
            "every sample sees one",
            partial(_around, backend),
            backend,
        )
        for exposure in EXPOSURES:
            yield Case(
                "composite",
                f"exposure {exposure:g}",
                "pixels without object and shadow keep their bytes",
                partial(_bytes, exposure, backend),
                backend,
            )
        for strength, colour in ((0.0, (0, 0, 0)), (1.0, (1, 1, 1)), (1.0, (0, 0, 0))):
            yield Case(
                "composite",
                f"shadow of strength {strength:g}, colour {colour[0]}",
                "the picture unchanged where nothing of it is left to draw",
                partial(_look, strength, colour, backend),
                backend,
            )
        yield Case(
            "composite",
            "a holdout that covers everything",
            "the picture unchanged but for its shadow",
            partial(_holdout, backend),
            backend,
        )
    for name in ("matte", "mirror", "brushed metal"):
        yield Case(
            "render",
            f"{name}, all maps: GL against CPU",
            "99 % of the pixels within 2e-3 of the largest value",
            partial(each, MAPS, _agree, name),
            "gl",
        )
    yield Case(
        "self_shadow",
        "one ball above another by pixel, all maps: GL against CPU",
        "99 % of the pixels within 2e-3 of the largest value",
        partial(each, MAPS, _by_pixel_agree),
        "gl",
    )
    for what, arguments in (
        ("negative", {"diffuse": (-1, 0, 0)}),
        ("of NaN", {"diffuse": (np.nan, 0, 0)}),
        ("infinite", {"glossy": (np.inf, 0, 0)}),
        ("of a negative exponent", {"exponent": -1}),
        ("of exponent NaN", {"exponent": np.nan}),
        ("of negative emission", {"emission": (0, 0, -1e-30)}),
    ):
        yield Case("render", f"a material {what}", "ValueError", partial(refused, partial(Material, **arguments)))


def _session(name_or_map, scene: Scene, backend: str, camera: Camera = PICTURE, methods=None) -> Session:
    """Has no error budget: within one, the CPU shades pixels together that hardly differ, and GL does not."""
    light = map_named(name_or_map) if isinstance(name_or_map, str) else name_or_map
    methods = methods or {"shadow": "directions"}
    return Session(scene, Rig(camera), environment=light, methods=methods, backend=backend, error=0)


def _layer(name: str, material: str, backend: str) -> np.ndarray:
    session = _lit_session(material, backend)
    session.set_environment(Environment(map_named(name)))
    session.process(Frame(time=0.0, back_from_marker=FRONT))
    return session.object.rgba


@cache
def _lit_session(material: str, backend: str) -> Session:
    """One session for all maps, so that shaders are compiled once."""
    return _session("black", Scene(_ball(), MATERIALS[material], spheres=0, visibility_rays=0), backend)


@cache
def _ball() -> Mesh:
    return ball_mesh(steps=16)


def _lit(name: str, material: str, backend: str) -> Outcome:
    rgba = _layer(name, material, backend)
    full = rgba[rgba[..., 3] == 1][:, :3]
    most = 1.5 * map_named(name).faces.max()
    found = both(Outcome(len(full) > 300, f"{len(full)} pixels"), is_light(full, max(most, 1e-30), "pixels"))
    if found.held and name in CONSTANT and material in WHITE:
        # GL keeps maps in half floats that are scaled by the maps' mean; 1e-30 is smaller than it can scale.
        return equal(full, CONSTANT[name], 2e-5 if CONSTANT[name] > 1e-20 or backend == "cpu" else 1.0, "pixels")
    return Outcome(found.held, found.text.split("; ")[-1]) if found.held else found


def _agree(name: str, material: str) -> Outcome:
    return alike(name, _layer(name, material, "cpu"), _layer(name, material, "gl"))


@cache
def _balls(method: str, backend: str) -> Session:
    return _session(
        "black",
        Scene(two_balls(), Material(glossy=(0.2, 0.2, 0.2)), spheres=0),
        backend,
        methods={"diffuse": "irradiance-cube", "self_shadow": method, "bounce": "none"},
    )


def _balls_layer(method: str, name: str, backend: str) -> np.ndarray:
    session = _balls(method, backend)
    session.set_environment(Environment(map_named(name)))
    session.process(Frame(time=0.0, back_from_marker=FRONT))
    return session.object.rgba


def _by_pixel(method: str, name: str, backend: str) -> Outcome:
    rgba, bare = _balls_layer(method, name, backend), _balls_layer("none", name, backend)
    brighter = float((rgba - bare)[..., :3].max()) / max(float(bare.max()), 1e-30)
    return both(is_light(rgba, what="object"), Outcome(brighter <= 1e-5, f"{brighter:.1e} brighter"))


def _by_pixel_agree(name: str) -> Outcome:
    cpu, gl = (_balls_layer("traced-lights", name, backend) for backend in ("cpu", "gl"))
    return alike(name, cpu, gl)


@cache  # sessions use copies of it
def _degenerate_scene(name: str) -> Scene:
    return Scene(degenerate(name), Material(glossy=(0.2, 0.2, 0.2)), spheres=4, visibility_rays=8)


def _object(self_shadow: str, name: str, backend: str) -> Outcome:
    methods = {"shadow": "directions", "self_shadow": self_shadow}
    session = _session("sun of 1e6 in one texel", _degenerate_scene(name), backend, methods=methods)
    result = session.process(Frame(time=0.0, back=_back(PICTURE), back_from_marker=FRONT))
    return both(
        Outcome(result.image.shape == (64, 64, 3), f"picture {result.image.shape}"),
        is_light(session.object.rgba, what="object"),
        is_ratio(session.shadow_map.image),
        is_light(session.plane_gain.image, what="gain"),
    )


@cache
def _glossy_scene() -> Scene:
    return Scene(_ball(), Material(glossy=(0.2, 0.2, 0.2)), spheres=4, visibility_rays=0)


def _camera(camera: Camera, pose: Pose, backend: str) -> Outcome:
    session = _session("blue and red lamps", _glossy_scene(), backend, camera)
    result = session.process(Frame(time=0.0, back=_back(camera), back_from_marker=pose))
    return both(
        Outcome(result.image.shape == (camera.height, camera.width, 3), f"picture {result.image.shape}"),
        is_light(session.object.rgba, what="object"),
    )


def _around(backend: str) -> Outcome:
    corners = 1e5 * np.array([(1.0, 1, 1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1)])
    mesh = Mesh(corners, [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
    scene = Scene(mesh, Material(diffuse=(0, 0, 0), emission=(1, 1, 1)), spheres=0, visibility_rays=0, refine=False)
    open_samples = 0.0
    for lens in ([], [-0.3, 0.05, 0, 0]):
        camera = Camera(64, 64, 50, 50, 32, 32, lens)
        session = _session("black", scene, backend, camera, {"self_shadow": "none"})
        for target in (*np.eye(3), *-np.eye(3)):
            session.process(Frame(time=0.0, back_from_marker=seen_from((0, 0, 0), target)))
            layer = session.object.rgba
            open_samples += 4 * (64 * 64 - float(layer[..., 3].sum()))
    return Outcome(open_samples == 0, f"{open_samples:g} samples of 12 pictures see nothing")


def _back(camera: Camera) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (camera.height, camera.width, 3), np.uint8)


def _bytes(exposure: float, backend: str) -> Outcome:
    scene = Scene(_ball(), spheres=0, visibility_rays=0)
    session = _session("blue and red lamps", scene, backend)
    back = _back(PICTURE)
    result = session.process(Frame(time=0.0, back=back, back_exposure=exposure, back_from_marker=FRONT))
    layer, free = session.object, np.ones((64, 64), bool)
    h, w = layer.rgba.shape[:2]
    free[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba[..., 3] == 0
    changed = int((result.image[free] != back[free]).any(axis=-1).sum())
    return Outcome(changed == 0 and 0 < free.sum() < 4096, f"{changed} of {free.sum()} pixels changed")


def _look(strength: float, colour, backend: str) -> Outcome:
    scene = Scene(_ball(), spheres=6, visibility_rays=0)
    scene.shadow_strength, scene.shadow_color = strength, colour
    session = _session("sun of 1e6 in one texel", scene, backend, methods={"shadow": "directions", "bounce": "none"})
    back = _back(PICTURE)
    result = session.process(Frame(time=0.0, back=back, back_from_marker=FRONT))
    layer, free = session.object, np.ones((64, 64), bool)
    h, w = layer.rgba.shape[:2]
    free[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba[..., 3] == 0
    changed = int((result.image[free] != back[free]).any(axis=-1).sum())
    nothing = strength == 0 or min(colour) == 1
    brighter = int((result.image[free].astype(int) - back[free] > 1).any(axis=-1).sum())
    return Outcome((changed == 0) == nothing and brighter == 0, f"{changed} pixels changed, {brighter} brighter")


def _holdout(backend: str) -> Outcome:
    scene = Scene(_ball(), spheres=0, visibility_rays=0)
    wall = np.array([(-1, -0.12, 0), (1, -0.12, 0), (1, -0.12, 1), (-1, -0.12, 1.0)])
    scene.holdouts = [Mesh(wall, np.array([(0, 1, 2), (0, 2, 3)]))]
    light = CubeMap(np.ones((6, 4, 4, 3)))
    session = _session(light, scene, backend, methods={"shadow": "directions", "bounce": "none"})
    back = _back(PICTURE)
    result = session.process(Frame(time=0.0, back=back, back_from_marker=FRONT))
    visible = float(session.object.rgba[..., 3].max()) if session.object.rgba.size else 0.0
    change = result.image.astype(int) - back
    return Outcome(
        bool(visible == 0 and -40 < change.min() < 0 and change.max() <= 1),
        f"object's coverage {visible:g}, values change by {change.min()} to {change.max()}",
    )
