"""The report: its own time; and a whole frame compared with a path tracer, which takes minutes.

Mitsuba renders the same mesh under the same map by the same camera: without plane and bounces where the object is
judged, with a white plane where its shadow is. Its noise falls with the square root of time: from two pictures with
different random numbers, the time for 1 % of noise (RMS over the object's pixels, divided by their mean) at 640 x 480
is extrapolated.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl import reference
from fastibl.measuring import one_core, side_by_side
from fastibl.report.inputs import HEIGHT, pose_around

from .. import inputs, mitsuba_scene
from ..goals import Goal, percent, row, skipped
from ..processes import python
from .cases import beside

_WIDTH, _HEIGHT = 160, 120
_SAMPLES = 128
_SIZE = 640 * 480
_ALBEDO = (0.7, 0.6, 0.5)
_ALPHA = 0.3
_FRAME_MS = 10.0
_YARDSTICK = 0.004  # seconds, nominal


@row("plan", "report: time")
def own_time() -> Iterator[Goal]:
    for options, limit in (("--quick", 60.0), ("", 900.0)):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            arguments = ["report", *options.split(), "--out", folder]
            done = python("-m", "fastibl", *arguments, limit=3 * limit)
            spent = time.perf_counter() - begin
            made = (Path(folder) / "report.html").is_file() and done.returncode == 0
            yield Goal(
                f"fastibl report {options}".strip(),
                f"{spent:.0f} s" if made else f"exit code {done.returncode}: {done.stderr[-200:]}",
                f"at most {limit:.0f} s on 2 cores",
                made and spent <= limit,
            )


@dataclass
class Scene:
    cube: fastibl.CubeMap
    mesh: fastibl.Mesh
    camera: fastibl.Camera
    pose: fastibl.Pose
    folder: Path

    def theirs(self, bsdf: dict, seed: int, plane: bool = False) -> tuple[NDArray, float]:
        """Mitsuba's picture (h, w, 3), linear, and its seconds."""
        import mitsuba as mi

        scene = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
            "sensor": mitsuba_scene.sensor_of(self.camera, self.pose, _SAMPLES),
            "emitter": mitsuba_scene.emitter_of(self.cube),
            "object": mitsuba_scene.shape_of(self.mesh, self.folder, bsdf),
        }
        if plane:
            scene["plane"] = {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(20.0),
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
            }
        loaded = mi.load_dict(scene)
        begin = time.process_time()
        picture = np.array(mi.render(loaded, seed=seed), np.float64)  # type: ignore[arg-type]
        return picture, time.process_time() - begin

    def ours(
        self, material: fastibl.Material, methods: Mapping[str, str] | None = None
    ) -> tuple[NDArray, fastibl.Session]:
        """Our object (h, w, 4), without bounces."""
        scene = fastibl.Scene(self.mesh, material)
        chosen = {**(methods or {}), "bounce": "none"}
        session = fastibl.Session(scene, fastibl.Rig(self.camera), None, self.cube, methods=chosen)
        session.process(fastibl.Frame(0.0, back_from_marker=self.pose))
        layer, out = session.object, np.zeros((_HEIGHT, _WIDTH, 4))
        h, w = layer.rgba.shape[:2]
        out[layer.y : layer.y + h, layer.x : layer.x + w] = layer.rgba
        return out, session


def _scene(folder: str) -> Scene:
    name = "potsdamer_platz"
    path = inputs.MAPS.get(name)
    cube = fastibl.read_environment(path, size=64) if path else fastibl.report.inputs.built_in_places()["room"]
    camera = fastibl.Camera(_WIDTH, _HEIGHT, 2.4 * _WIDTH, 2.4 * _WIDTH, _WIDTH / 2, _HEIGHT / 2)
    return Scene(cube, fastibl.shapes.figurine(HEIGHT), camera, pose_around(0.5), Path(folder))


@row("plan", "whole frame against Mitsuba")
def against_mitsuba() -> Iterator[Goal]:
    try:
        import mitsuba as mi
    except ImportError:
        yield skipped("whole frame against Mitsuba", "needs mitsuba: pip install mitsuba")
        return
    mi.set_variant("scalar_rgb")
    with tempfile.TemporaryDirectory() as folder:
        scene = _scene(folder)
        diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(_ALBEDO)}}
        metal = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": _ALPHA}
        first, seconds = scene.theirs(diffuse, 1)
        second, again = scene.theirs(diffuse, 2)
        ours, _ = scene.ours(fastibl.Material(diffuse=_ALBEDO))
        inside = ours[..., 3] == 1
        true = (first + second) / 2
        noise = float(np.sqrt(((first - second)[inside] ** 2).mean() / 2) / true[inside].mean())
        needed = (seconds + again) / 2 * (noise / 0.01) ** 2 * _SIZE / (_WIDTH * _HEIGHT)
        (still, spent, anew), yard = _frame_seconds(scene)
        goal = _FRAME_MS * 1e-3 / _YARDSTICK
        yield Goal(
            "whole frame of 640 x 480, light unchanged, one core",
            f"{1e3 * still:.1f} ms, {still / yard:.2f} yardsticks",
            f"at most {_FRAME_MS:.0f} ms: {goal:g} yardsticks",
            still / yard <= goal,
        )
        yield Goal(
            "the same where the light changes a little in every frame",
            f"{1e3 * spent:.1f} ms, {spent / yard:.2f} yardsticks",
            f"at most {_FRAME_MS:.0f} ms: {goal:g} yardsticks",
            spent / yard <= goal,
            (
                f"Mitsuba: {percent(noise)} of noise after {seconds:.1f} s of {_WIDTH} x {_HEIGHT} pixels with "
                f"{_SAMPLES} samples each; for 1 % at 640 x 480: {needed:.0f} s of CPU time, "
                f"{needed / spent:.0f} times as long",
                f"the first frame under another place's light, for which methods are judged and chosen anew: "
                f"{1e3 * anew:.1f} ms, {anew / yard:.2f} yardsticks",
            ),
        )
        yield _term("diffuse light with self-shadow", ours[inside, :3], true[inside], noise / np.sqrt(2))
        without, _ = scene.ours(fastibl.Material(diffuse=_ALBEDO), {"self_shadow": "none"})
        yield _term("the same without self-shadow", without[inside, :3], true[inside], noise / np.sqrt(2))
        theirs, _ = scene.theirs(metal, 3)
        glossy, _ = scene.ours(_metal())
        yield _term("rough metal (alpha 0.3) with what it hides of itself", glossy[inside, :3], theirs[inside], None)
        yield from _plane(scene, diffuse)
        yield _ball(scene, metal)


def _metal() -> fastibl.Material:
    return fastibl.Material.pbr((1.0, 1.0, 1.0), 1.0, float(np.sqrt(_ALPHA)))


def _ball(scene: Scene, metal: dict) -> Goal:
    """Here nothing hides anything. Our light includes what scatters more than once, which Mitsuba's single scattering
    loses."""
    import trimesh

    ball = trimesh.creation.icosphere(5, HEIGHT / 2)
    alone = replace(scene, mesh=fastibl.Mesh(ball.vertices + [0, 0, HEIGHT / 2], ball.faces))
    ours, _ = alone.ours(_metal())
    inside = ours[..., 3] == 1
    theirs = (alone.theirs(metal, 5)[0] + alone.theirs(metal, 6)[0]) / 2
    term = _term("ball of rough metal (alpha 0.3)", ours[inside, :3], theirs[inside], None)
    facing = np.linspace(0.05, 1, 50)
    views = np.stack([np.sqrt(1 - facing**2), 0 * facing, facing], axis=-1)
    lost = 1 - fastibl.ggx_albedo(views, alpha=np.array([_ALPHA, _ALPHA])).sum(axis=-1).mean()
    return replace(term, notes=(f"single scattering loses {percent(float(lost))} of the light, which ours gives back",))


def _term(what: str, ours: NDArray, theirs: NDArray, noise: float | None) -> Goal:
    """Bias and mean difference over the object's fully covered pixels."""
    bias = float(ours.mean() / theirs.mean() - 1)
    apart = float(np.abs(ours - theirs).mean() / theirs.mean())
    told = f", noise of theirs {percent(noise)}" if noise is not None else ""
    return Goal(
        what, f"bias {100 * bias:+.2f} %, mean difference {percent(apart)}{told}", "(stated, no goal of its own)", None
    )


def _plane(scene: Scene, bsdf: dict) -> Iterator[Goal]:
    """The ratio on the plane: Mitsuba's white plane, divided by the light that it gets without the object."""
    theirs, _ = scene.theirs(bsdf, 4, plane=True)
    ours, session = scene.ours(fastibl.Material(diffuse=_ALBEDO))
    eye = scene.pose.inverse().translation
    x, y = np.meshgrid(np.arange(_WIDTH) + 0.5, np.arange(_HEIGHT) + 0.5)
    rays = scene.camera.unproject(np.stack([x, y], axis=-1)) @ scene.pose.rotation
    points = eye[:2] - eye[2] * rays[..., :2] / rays[..., 2:]
    open_ = (ours[..., 3] == 0) & (rays[..., 2] < -1e-3) & (np.abs(points) < 0.3).all(axis=-1)
    # Pixels at the object's edge are partly covered in Mitsuba's picture.
    around = ours[..., 3] > 0
    for axis in (0, 1):
        around |= np.roll(around, 1, axis) | np.roll(around, -1, axis)
    open_ &= ~around
    whole = reference.irradiance(mitsuba_scene.equirect_of(scene.cube, 192), [0.0, 0.0, 1.0]) / np.pi
    true = theirs[open_] / whole
    given = session.shadow_map.sample(points[open_]).astype(np.float64)
    lost = float((1 - given).sum() / (1 - true).sum() - 1)
    rms = float(np.sqrt(((given - true) ** 2).mean()))
    smooth = float(np.abs(given.mean() - true.mean()))
    yield Goal(
        "shadow on the plane",
        f"bias {100 * lost:+.2f} % of the light that is kept away",
        "(stated, no goal of its own)",
        None,
        (f"RMS of the ratio {rms:.4f} with their noise; means differ by {smooth:.4f}; {open_.sum()} pixels",),
    )


@one_core()
def _frame_seconds(scene: Scene) -> tuple[tuple[float, float, float], float]:
    """CPU time of a frame with given pose, default methods and a picture behind, and of the yardstick beside them.

    The three times are for constant light, for light that changes a little in every frame, as captured light does, and
    for light of another place.
    """
    camera = fastibl.Camera(640, 480, 2.4 * 640, 2.4 * 640, 320, 240)
    back = np.full((480, 640, 3), 128, np.uint8)
    faces = scene.cube.faces
    brighter = np.concatenate([1.02 * faces[:3], faces[3:]])
    lights = {
        "same": [],
        "changed": [fastibl.CubeMap(faces), fastibl.CubeMap(brighter)],
        "another": [fastibl.CubeMap(faces), fastibl.CubeMap(1.5 * faces[:, :, ::-1])],
    }
    poses = scene.pose, beside(scene.pose)
    material = fastibl.Material(diffuse=_ALBEDO)
    sessions = {
        name: fastibl.Session(fastibl.Scene(scene.mesh, material), fastibl.Rig(camera), None, scene.cube)
        for name in lights
    }

    def one(name: str, k: int) -> None:
        if lights[name]:
            sessions[name].set_environment(lights[name][k % 2])
        frame = fastibl.Frame(0.1 * k, back=back, back_from_marker=poses[k % 2])
        sessions[name].process(frame).image  # noqa: B018 - the picture has to arrive

    timings, yard = side_by_side({name: partial(one, name) for name in lights}, rounds=31, warm=6)
    return (timings["same"].cpu, timings["changed"].cpu, timings["another"].cpu), yard
