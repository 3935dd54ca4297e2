"""The library's main task on the built-in room, with the truth beside it: what `fastibl demo` runs and measures."""

from __future__ import annotations

import platform
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from . import shapes
from ._fastibl import CubeMap, Environment, FrameResult, Material, Pose, Scene, set_threads, texel_directions, threads
from .comparison import irradiance_over_sphere, relative_errors
from .expected import present
from .files import stand
from .lighting import Lighting
from .machine import cpu
from .panorama import panorama_rays, seen_map
from .recording import Frame, Recording, truth_of
from .session import Session
from .truth import TruePicture, TrueRenderer, picture_error, texels_that_count
from .video import VideoWriter

HEIGHT = 0.2  # height of the object, metres
POSITION = (0.0, 0.0, HEIGHT / 2)  # where the object's light is measured
METHODS = {"default": "auto", "paper": "paper"}  # methods of the two runs
PANEL = (480, 360)  # size of each panel of the four-panel video, pixels
_SHOWN_EVERY = 15  # frames after which picture.jpg is written again, so that there is something to see before the end


@dataclass
class Still:
    """One moment: its title, the picture from each run, and the true picture if they are to be compared with it."""

    title: str
    index: int
    compared: bool = True
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    true: TruePicture | None = None


@dataclass
class Run:
    """The results of one choice of methods on the recording, frame by frame."""

    name: str
    plan: str = ""
    pose_degrees: list[float] = field(default_factory=list)  # NaN where the board was not found
    pose_millimetres: list[float] = field(default_factory=list)
    irradiance_error: list[float] = field(default_factory=list)  # median over normals
    predicted_error: list[float] = field(default_factory=list)
    coverage: list[float] = field(default_factory=list)
    timings: list[dict[str, float]] = field(default_factory=list)
    distance: float = float("inf")  # metres to the walls, as found
    # The error of the final picture and of the shadow, by the name of the still.
    image_error: dict[str, float] = field(default_factory=dict)
    shadow_error: dict[str, float] = field(default_factory=dict)
    map_error: float = float("nan")  # median over the texels that count, at the end of the recording
    map_share: float = float("nan")  # share of the texels that count among those that were seen
    method_error: dict[str, float] = field(default_factory=dict)  # error of a step alone, given the true map

    def milliseconds(self, name: str) -> float:
        values = [t[name] for t in self.timings if name in t]
        return 1000 * float(np.median(values)) if values else 0.0


@dataclass
class DemoResult:
    recording: Recording
    scene: Scene
    times: list[float]
    runs: dict[str, Run]
    stills: list[Still]
    maps: dict[str, NDArray[np.uint8]]  # pictures of the captured and the true map at the end
    machine: str


def demo_scene() -> Scene:
    material = Material(diffuse=(0.62, 0.6, 0.57), glossy=(0.16, 0.16, 0.16), exponent=80.0)
    return Scene(stand(shapes.figurine(), HEIGHT), material)


def picture_of_map(source: CubeMap | Environment, scale: float, height: int = 240) -> NDArray[np.uint8]:
    """Equirectangular picture (h, 2h, 3) uint8 of a map; what was never seen is dimmed."""
    directions = panorama_rays(height)
    cube = source.radiance if isinstance(source, Environment) else source
    linear = cube.sample(directions, float(np.log2(max(cube.size / height, 1)))) * scale
    encoded = np.clip(linear, 0, 1) ** (1 / 2.2) * 255
    if isinstance(source, Environment):
        encoded *= 0.35 + 0.65 * seen_map(source).sample(directions)
    return encoded.astype(np.uint8)


def write_label(picture: NDArray[np.uint8], text: str) -> None:
    """Writes a name into the picture's upper left corner."""
    for colour, shift in (((0, 0, 0), 1), ((255, 255, 255), 0)):  # both have the same weight: text widths follow it
        cv2.putText(picture, text, (10 + shift, 24 + shift), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 1, cv2.LINE_AA)


def _labelled(picture: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """The picture, fitted into a panel, with its name in the corner."""
    w, h = PANEL
    scale = min(w / picture.shape[1], h / picture.shape[0])
    size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    panel = np.zeros((h, w, 3), np.uint8)
    y, x = (h - size[1]) // 2, (w - size[0]) // 2
    panel[y : y + size[1], x : x + size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    write_label(panel, text)
    return panel


def _run(
    name: str,
    recording: Recording,
    scene: Scene,
    stills: list[Still],
    truths: dict[int, NDArray],
    panels: tuple[VideoWriter, VideoWriter, Path] | None,
    scale: float,
) -> tuple[Run, Session, dict[str, FrameResult]]:
    run, results_at = Run(name), {}
    session = Session(scene, recording.rig, recording.board, methods=METHODS[name])
    truth = truth_of(recording)
    last, true_pictures = None, {}
    for index, frame in enumerate(
        tqdm(recording, desc=f"{name} methods", total=len(recording), leave=False, disable=None)
    ):
        result = last = session.process(frame)
        true_pose, pose = truth.pose(frame.time), result.back_from_marker
        run.pose_degrees.append(np.nan if pose is None else float(np.degrees(pose.angle_to(true_pose))))
        run.pose_millimetres.append(np.nan if pose is None else _offset(pose, true_pose))
        environment = result.environment
        state = id(truth.environment(frame.time))
        if state not in truths:
            truths[state] = irradiance_over_sphere(truth.environment(frame.time))
        errors = relative_errors(irradiance_over_sphere(environment), truths[state])
        run.irradiance_error.append(float(np.median(errors)))
        run.predicted_error.append(result.predicted_error)
        run.coverage.append(environment.coverage)
        run.timings.append(result.timings)
        for still in stills:
            if still.index == index:
                still.pictures[name] = result.image
                results_at[still.title] = result
        if panels is not None:
            composite, four, path = panels
            composite.add(result.image)
            top = [_labelled(frame.back, "back camera"), _labelled(result.image, "composite")]
            seen = f"captured light, {100 * environment.coverage:.0f} % seen"
            if state not in true_pictures:
                true_pictures[state] = _labelled(picture_of_map(truth.environment(frame.time), scale), "true light")
            bottom = [
                _labelled(picture_of_map(environment, scale), seen),
                true_pictures[state],
            ]
            panel = np.vstack([np.hstack(top), np.hstack(bottom)])
            four.add(panel)
            if index % _SHOWN_EVERY == 0 or index == len(recording) - 1:
                cv2.imwrite(str(path), panel[..., ::-1])
    run.plan = str(last.plan) if last is not None else ""
    run.distance = session.capture.distance
    return run, session, results_at


def _offset(pose: Pose, true: Pose) -> float:
    return float(1000 * np.linalg.norm(pose.inverse().translation - true.inverse().translation))


def run_demo(recording: Recording, out: Path) -> DemoResult:
    """Runs the default and the paper's methods on a recording with truth; writes two videos and a picture to `out`."""
    scene = demo_scene()
    truth, frames = truth_of(recording), list(recording)
    times = [frame.time for frame in frames]

    def nearest(time: float) -> int:
        return int(np.argmin(np.abs(np.array(times) - time)))

    stills = []
    if truth.hand is not None:
        stills.append(Still("before the hand", nearest(truth.hand[0] - 0.15)))
        stills.append(Still("a hand over the front camera", nearest(truth.hand[1] - 0.2), compared=False))
    if truth.lamp_time is not None:
        stills.append(Still("before the lamp", nearest(truth.lamp_time - 0.1)))
    stills.append(Still("at the end", len(frames) - 1))

    scale = 0.28 / float(np.mean(truth.environment(0).mean()))  # scale for the pictures of maps
    true_irradiance: dict[int, NDArray] = {}
    runs, kept = {}, {}
    fps = (len(frames) - 1) / max(times[-1] - times[0], 1e-6)
    with VideoWriter(out / "composite.webm", fps) as composite, VideoWriter(out / "four-panel.webm", fps) as four:
        for name in METHODS:
            panels = (composite, four, out / "picture.jpg") if name == "default" else None
            run, session, results = _run(name, recording, scene, stills, true_irradiance, panels, scale)
            runs[name], kept[name] = run, (session, results)

    # The sessions above are timed on the caller's threads; brute force takes all cores.
    count = threads()
    set_threads(0)
    try:
        _compare_with_truth(recording, scene, frames, stills, runs, kept)
    finally:
        set_threads(count)
    maps = {
        "captured": picture_of_map(kept["default"][1]["at the end"].environment, scale, 300),
        "captured by the paper's method": picture_of_map(kept["paper"][1]["at the end"].environment, scale, 300),
        "true": picture_of_map(truth.environment(times[-1]), scale, 300),
    }
    return DemoResult(
        recording,
        scene,
        times,
        runs,
        stills,
        maps,
        f"{cpu()}, {threads()} used, {platform.system()} {platform.machine()}",
    )


def _compare_with_truth(
    recording: Recording, scene: Scene, frames: list[Frame], stills: list[Still], runs: dict[str, Run], kept: dict
) -> None:
    """Adds the true pictures to the stills, and to the runs how far their pictures are from the true ones."""
    truth = truth_of(recording)
    renderer = TrueRenderer(scene)
    response = recording.rig.back.response
    for still in tqdm([s for s in stills if s.compared], desc="true pictures", leave=False, disable=None):
        frame: Frame = frames[still.index]
        back, exposure = present(frame.back), present(frame.back_exposure)
        true_map = truth.environment(frame.time)
        still.true = renderer.render(back, exposure, recording.rig.back, truth.pose(frame.time), true_map)
        ratio = renderer.plane_ratio(true_map)
        for name, run in runs.items():
            run.image_error[still.title] = picture_error(still.pictures[name], still.true, back, response)
            run.shadow_error[still.title] = renderer.shadow_error(kept[name][1][still.title].shadow_map, ratio)
    true_map = truth.environment(frames[-1].time)
    faces, exact = np.asarray(true_map.faces, np.float64), irradiance_over_sphere(true_map)
    ratio, normals = renderer.plane_ratio(true_map), texel_directions(8)
    for name, run in runs.items():
        session, results = kept[name]
        last_seen = session.capture.last_seen
        counts, unclipped = texels_that_count(recording, last_seen)
        errors = relative_errors(np.asarray(results["at the end"].environment.radiance.faces, np.float64), faces)
        if unclipped.any():
            run.map_error = float(np.median(errors[unclipped]))
            run.map_share = float(counts.sum() / np.isfinite(last_seen).sum())
        # The steps alone: the same methods, given the true map.
        lighting = Lighting(true_map, diffuse=METHODS[name])
        run.method_error["irradiance"] = float(np.median(relative_errors(lighting.irradiance(normals), exact)))
        alone = Session(scene, recording.rig, None, true_map, methods=METHODS[name])
        given = alone.process(Frame(0.0, back=frames[-1].back, back_from_marker=truth.pose(frames[-1].time)))
        run.method_error["shadow"] = renderer.shadow_error(given.shadow_map, ratio)
