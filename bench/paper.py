"""Goals of the paper's methods and of the whole: table "paper"."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl.comparison import irradiance_error, relative_errors
from fastibl.gl_device import draws_in_software, gl_device
from fastibl.measuring.samples import ANGLES, pairs, units
from fastibl.recording import truth_of
from fastibl.truth import texels_that_count

from . import brute, inputs
from .frame import frame_times, meshes
from .goals import Goal, by_map, percent, row, skipped
from .measure import ROOT, Timing, yardstick
from .processes import python, tests

_GLOSSY_PAIRS = 100  # pairs at each angle
# Words in the names of those tests that give bad or extreme input.
BAD = ("bad", "refuse", "extreme", "error", "missing", "degenerate", "ignored", "broken", "cleaning", "invalid")


def _within(value: float, low: float, high: float) -> bool:
    return 0.9 * low <= value <= 1.1 * high


# Shading against brute force


@row("paper", "diffuse methods against brute force")
def diffuse() -> Iterator[Goal]:
    goals = {
        "nearest-face": (0.47, 0.47, "47 %"),
        "six-face": (0.24, 0.26, "24-26 %"),
        "sh9": (0.028, 0.028, "2.8 %"),
    }
    if not inputs.MAPS:
        for method in goals:
            yield skipped(f"{method}: mean error of the irradiance", inputs.NO_MAPS)
        return
    truths = brute.irradiance()
    for method, (low, high, text) in goals.items():
        samples = {}
        for name, cube in inputs.real_maps().items():
            true = truths[name]
            given = fastibl.Lighting(cube, diffuse=method).irradiance(brute.normals())
            samples[name] = brute.errors(given, true, true.mean())
        means = {name: float(e.mean()) for name, e in samples.items()}
        every = np.concatenate(list(samples.values()))
        deviation = np.sqrt(sum(e.var() / len(e) for e in samples.values())) / len(samples)
        value = float(np.mean(list(means.values())))
        yield Goal(
            f"{method}: mean error of the irradiance, {len(means)} maps",
            f"{percent(value)} +- {percent(deviation, 2)}",
            f"{text}, within a tenth",
            _within(value, low, high),
            (
                *by_map(means),
                f"95th percentile {percent(float(np.percentile(every, 95)))}, worst {percent(float(every.max()))}",
            ),
        )


@row("paper", "glossy method against brute force")
def glossy() -> Iterator[Goal]:
    what = "mip: mean error of the normalised lobe"
    if not inputs.MAPS:
        yield skipped(what, inputs.NO_MAPS)
        return
    truths = brute.glossy(_GLOSSY_PAIRS)
    n, v = pairs(_GLOSSY_PAIRS)
    lightings = {name: fastibl.Lighting(cube, glossy="mip") for name, cube in inputs.real_maps().items()}
    table = np.empty((len(lightings), len(brute.EXPONENTS), len(n)))
    for i, (name, lighting) in enumerate(lightings.items()):
        for j, s in enumerate(brute.EXPONENTS):
            true = truths[name][s]
            table[i, j] = brute.errors(lighting.glossy(n, v, float(s), normalization="energy"), true, true.mean())
    # The pairs are the samples: at each of them, all maps and exponents are averaged first.
    by_pair = table.mean(axis=(0, 1)).reshape(len(ANGLES), -1)
    deviation = float(np.sqrt((by_pair.var(axis=1, ddof=1) / by_pair.shape[1]).sum()) / len(ANGLES))
    value = float(table.mean())
    by_exponent = ", ".join(f"{s}: {percent(table[:, j].mean())}" for j, s in enumerate(brute.EXPONENTS))
    by_angle = ", ".join(f"{a}: {percent(by_pair[k].mean())}" for k, a in enumerate(ANGLES))
    means = {name: float(table[i].mean()) for i, name in enumerate(lightings)}
    yield Goal(
        f"{what}, {len(means)} maps",
        f"{percent(value)} +- {percent(deviation, 2)}",
        "38 %, within a tenth",
        _within(value, 0.38, 0.38),
        (*by_map(means), f"by exponent: {by_exponent}", f"by degrees of the view: {by_angle}"),
    )


# Closed forms


def face_weights(normals: NDArray, nodes: int = 40) -> NDArray:
    """W_F (n, 6) by Gauss-Legendre quadrature of n.w over each face, cut along the horizon so that it stays smooth."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    directions = fastibl.texel_directions(2).astype(np.float64).mean(axis=(1, 2))
    out = np.zeros((len(normals), 6))
    for face, axis in enumerate(np.round(directions)):
        across, along = np.eye(3)[np.flatnonzero(axis == 0)]
        for i, n in enumerate(normals):
            a, b, c = n @ axis, n @ across, n @ along  # n.p = a + b s + c t on the face, s and t in [-1, 1]
            cuts = [-1.0, 1.0]
            if abs(b) > 1e-12:
                cuts += [s for s in ((-a - c) / b, (-a + c) / b, -a / b) if -1 < s < 1]
            ordered = np.unique(cuts)
            total = 0.0
            for s0, s1 in zip(ordered[:-1], ordered[1:], strict=True):
                s = (s0 + s1) / 2 + (s1 - s0) / 2 * x
                low, high = np.full_like(s, -1.0), np.full_like(s, 1.0)
                if abs(c) > 1e-12:
                    edge = np.clip(-(a + b * s) / c, -1, 1)
                    low, high = (edge, high) if c > 0 else (low, edge)
                t = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * x
                value = np.maximum(a + b * s[:, None] + c * t, 0) / (1 + s[:, None] ** 2 + t * t) ** 2
                total += (s1 - s0) / 2 * w @ ((value * w).sum(axis=1) * (high - low) / 2)
            out[i, face] = total
    return out


@row("paper", "closed form of W_F")
def closed_form() -> Iterator[Goal]:
    axes = np.array([(1, 0, 0), (0, 1, 0), (0, 0, -1), (1, 1, 0), (1, 1, 1), (-1, 1, 2), (1, -1e-4, 0)], np.float64)
    normals = np.vstack([axes / np.linalg.norm(axes, axis=1, keepdims=True), units(400, seed=11)])
    true = face_weights(normals)
    ours = np.empty_like(true)
    for face in range(6):
        lit = np.zeros((6, 4, 4, 3), np.float32)
        lit[face] = 1
        ours[:, face] = fastibl.Lighting(fastibl.CubeMap(lit), diffuse="six-face-exact").irradiance(normals)[:, 0]
    worst = float(np.abs(ours - true).max())
    sums = float(np.abs(ours.sum(axis=1) - np.pi).max() / np.pi)
    quadrature = float(np.abs(true.sum(axis=1) - np.pi).max())
    note = (f"{len(normals)} normals; the quadrature's own sums are within {quadrature:.1g} of pi",)
    yield Goal("W_F: closed form against quadrature, worst", f"{worst:.2g}", "<= 1e-6", worst <= 1e-6, note)
    yield Goal("W_F: sum over six faces against pi, worst", f"{sums:.2g}", "<= 1e-6", sums <= 1e-6)


@row("paper", "white furnace")
def furnace() -> Iterator[Goal]:
    white = fastibl.CubeMap(np.ones((6, 32, 32, 3), np.float32))
    normals = units(20000, seed=5)
    for method in ("sh9", "six-face-exact"):
        shares = fastibl.Lighting(white, diffuse=method).irradiance(normals).astype(np.float64) / np.pi
        worst = float(np.abs(shares - 1).max())
        yield Goal(f"white furnace, {method}: worst of E / pi - 1", f"{worst:.2g}", "<= 1e-6", worst <= 1e-6)
    shares = fastibl.Lighting(white, diffuse="six-face").irradiance(normals).astype(np.float64) / np.pi
    low, high = float(shares.min()), float(shares.max())
    yield Goal(
        "white furnace, six-face: E / pi as the paper's fit has it",
        f"{low:.4f} to {high:.4f}",
        "0.966 to 0.978",
        abs(low - 0.966) < 6e-4 and abs(high - 0.978) < 6e-4,
    )


# Whole frames


def _frame_goal(what: str, methods: str, time: Timing, passes: dict[str, Timing]) -> Goal:
    """The goal is the paper's: its methods must reach the frame rate that it reports. The default's time stands beside
    it."""
    judged = methods == "paper"
    shares = ", ".join(f"{name} {1e3 * t.median:.1f}" for name, t in passes.items())
    return Goal(
        what,
        f"{1 / time.median:.1f} fps",
        ">= 25 fps" if judged else "for comparison",
        1 / time.median >= 25 if judged else None,
        (
            f"wall {1e3 * time.median:.1f} ms (10th to 90th percentile {1e3 * time.low:.1f} to {1e3 * time.high:.1f}), "
            f"CPU {1e3 * time.cpu:.1f} ms ({1e3 * time.cpu_low:.1f} to {1e3 * time.cpu_high:.1f}), {time.count} "
            f"frames; {time.median / yardstick().median:.1f} yardsticks",
            f"ms by pass: {shares}",
        ),
    )


@row("paper", "whole frame on the CPU")
def frame_cpu() -> Iterator[Goal]:
    for mesh in meshes():
        scene = inputs.scene(mesh)
        case = f"frame 640x480, {len(scene.spheres)} spheres, {mesh}, one thread"
        yield _frame_goal(f'{case}, "paper"', "paper", *frame_times(scene, "paper"))
        yield _frame_goal(f'{case}, "auto", new light each frame', "auto", *frame_times(scene, "auto"))


@row("paper", "whole frame on GL")
def frame_gl() -> Iterator[Goal]:
    threads = int(os.environ.get("LP_NUM_THREADS", "2"))
    device, reason = gl_device()
    where = "GL in software" if reason or draws_in_software(device) else f"GL on {device}"
    for mesh in meshes():
        what = f"frame 640x480, {mesh}, {where}, {threads} threads"
        if reason:
            yield skipped(what, reason)
            continue
        for methods in ("paper", "auto"):
            times = frame_times(inputs.scene(mesh), methods, backend="gl", threads=threads)
            yield _frame_goal(f'{what}, "{methods}"', methods, *times)


@row("paper", "GL against CPU")
def gl_against_cpu() -> Iterator[Goal]:
    what = "GL against CPU: changed pixels that agree within 2/255"
    _, reason = gl_device()
    if reason:
        yield skipped(what, reason)
        return
    glossy_material = fastibl.Material(diffuse=(0.5, 0.4, 0.3), glossy=(0.3, 0.3, 0.3), exponent=64.0)
    recording = inputs.short_recording()
    for methods in ("paper", "auto"):
        for name, material in (("matte", fastibl.Material()), ("glossy", glossy_material)):
            scene = fastibl.Scene(inputs.scene().mesh, material)
            sessions = [
                fastibl.Session(scene, recording.rig, recording.board, methods=methods, backend=b)
                for b in ("cpu", "gl")
            ]
            agree = changed = worst = 0
            for frame in recording:
                ours, theirs = (s.process(frame).image.astype(int) for s in sessions)
                touched = (ours != frame.back).any(axis=-1) | (theirs != frame.back).any(axis=-1)
                difference = np.abs(ours - theirs).max(axis=-1)[touched]
                agree, changed = agree + int((difference <= 2).sum()), changed + int(touched.sum())
                worst = max(worst, int(difference.max(initial=0)))
            share = agree / max(changed, 1)
            yield Goal(
                f'{what}, {name}, "{methods}"',
                f"{100 * share:.3f} %",
                ">= 99.9 %",
                share >= 0.999,
                (f"{changed} pixels that object or shadow changes in {len(recording)} frames; worst {worst}/255",),
            )


# Capture


@row("paper", "captured map in the demo's room")
def captured_map() -> Iterator[Goal]:
    recording, processed = inputs.sweep(), inputs.swept(3.0)
    truth = truth_of(recording)
    last = recording.times[-1]
    true = truth.environment(last).faces.astype(np.float64)
    environment = processed.last.environment
    ours = environment.radiance.faces.astype(np.float64)
    seen_at = processed.session.capture.last_seen
    seen = np.isfinite(seen_at)
    counts, unclipped = texels_that_count(recording, seen_at)
    share = float(counts.sum() / seen.sum())
    yield Goal(
        "sweep: seen texels that count (seen since the lamp was switched on)",
        percent(share),
        ">= 80 %",
        share >= 0.8,
        (f"coverage {percent(environment.coverage)}, of it only a lower bound {percent(environment.clipped, 2)}",),
    )
    up = fastibl.texel_directions(true.shape[1])[..., 2] > 0
    error = relative_errors(ours, true)[unclipped]
    median = float(np.median(error))
    parts = {"above the horizon": unclipped & up, "below it": unclipped & ~up}
    notes = ", ".join(
        f"{name} {percent(float(np.median(relative_errors(ours, true)[mask])))}" for name, mask in parts.items()
    )
    yield Goal(
        "sweep: median error of a captured texel where nothing clipped, walls at 3 m",
        percent(median),
        "<= 3 %",
        median <= 0.03,
        (
            f"{unclipped.sum()} of {seen.sum()} seen texels; quartiles {percent(float(np.percentile(error, 25)))} and "
            f"{percent(float(np.percentile(error, 75)))}; {notes}",
        ),
    )


@row("paper", "pose in the demo's room")
def pose() -> Iterator[Goal]:
    truth, poses = truth_of(inputs.sweep()), inputs.swept(3.0).poses
    found = [(t, p) for t, p in poses if p is not None]
    angles = np.degrees([p.angle_to(truth.pose(t)) for t, p in found])
    shifts = [1e3 * np.linalg.norm(p.translation - truth.pose(t).translation) for t, p in found]
    median = float(np.median(angles)) if found else float("inf")
    yield Goal(
        "sweep: median error of the pose's rotation",
        f"{median:.3f} degrees",
        "<= 0.2 degrees",
        median <= 0.2,
        (
            f"found in {len(found)} of {len(poses)} frames; 95th percentile {np.percentile(angles, 95):.3f}, worst "
            f"{angles.max():.3f} degrees; median shift {np.median(shifts):.2f} mm",
        ),
    )


@row("paper", "irradiance of the captured map in the demo's room")
def captured_irradiance_room() -> Iterator[Goal]:
    recording = inputs.sweep()
    true = truth_of(recording).environment(recording.times[-1])
    for distance in (3.0, float("inf")):
        last = inputs.swept(distance).last
        error = irradiance_error(last.environment, true)
        where = "at infinity" if np.isinf(distance) else f"at {distance:g} m"
        yield Goal(
            f"sweep: median error of the irradiance, walls taken {where}",
            percent(error),
            "<= 15 %",
            error <= 0.15,
            (
                f"predicted {percent(last.environment.predicted_error)}; with the method's own error "
                f"{percent(last.predicted_error)}",
            ),
        )


@row("paper", "irradiance of captured maps at infinity")
def captured_irradiance_maps() -> Iterator[Goal]:
    if not inputs.MAPS:
        yield skipped("captured irradiance on the real maps", inputs.NO_MAPS)
        return
    for name, path in inputs.MAPS.items():
        recording = fastibl.simulate(path, seconds=10, fps=8, seed=0, size=(320, 240), position=inputs.OBJECT)
        processed = inputs.process(recording, inputs.scene())
        environment = processed.last.environment
        found = sum(p is not None for _, p in processed.poses)
        true = truth_of(recording).environment(recording.times[-1])
        front = min(f.front_exposure for f in recording) * recording.rig.front.gain
        angles = fastibl.texel_solid_angles(true.size)[..., None]
        beyond = float((np.maximum(true.faces - 1 / front, 0) * angles).sum() / (true.faces * angles).sum())
        error = irradiance_error(environment, true)
        yield Goal(
            f"{name}: median error of the captured irradiance",
            percent(error),
            "<= 8 %",
            error <= 0.08,
            (
                f"predicted {percent(environment.predicted_error)}; coverage {percent(environment.coverage)}, of it "
                f"only a lower bound {percent(environment.clipped, 2)}; board found in {found} of "
                f"{len(recording)} frames",
                f"{percent(beyond, 2)} of the place's light is brighter than the darkest exposure can hold",
            ),
        )


# Replay


def replay(threads: int) -> str:
    """Hash of all composites and of the final map for a short recording that is simulated here."""
    fastibl.set_threads(threads)
    recording = fastibl.simulate(seconds=1.5, fps=8, seed=3, size=(320, 240), position=inputs.OBJECT)
    session = fastibl.Session(inputs.scene(), recording.rig, recording.board)
    digest = hashlib.sha256()
    for frame in recording:
        result = session.process(frame)
        digest.update(result.image.tobytes())
    digest.update(np.ascontiguousarray(result.environment.radiance.faces).tobytes())
    return digest.hexdigest()


@row("paper", "replay")
def replays() -> Iterator[Goal]:
    hashes = []
    for threads in (1, 2, 2):
        ran = python("-c", f"from bench.paper import replay; print(replay({threads}))")
        if ran.returncode != 0:
            raise RuntimeError(ran.stderr.strip().splitlines()[-1])
        hashes.append(ran.stdout.strip())
    same = len(set(hashes)) == 1
    yield Goal(
        "replay: bits in fresh processes with 1, 2 and 2 threads",
        "the same" if same else "different",
        "the same",
        same,
        (f"sha256 of all pictures and the map: {', '.join(h[:12] for h in hashes)}",),
    )


# Tests that are goals in themselves


@row("paper", "bad input")
def bad_input() -> Iterator[Goal]:
    names = sorted(p.name for p in (ROOT / "tests").glob("test_*.py") if p.name != "test_bench.py")
    yield tests("bad input: tests of what is refused or has a defined result", names, " or ".join(BAD))


@row("paper", "layers of the sources")
def layers() -> Iterator[Goal]:
    yield tests("includes point down, steps never include each other", ["test_layers.py"])


@row("paper", "Mitsuba")
def mitsuba() -> Iterator[Goal]:
    yield tests("pictures against Mitsuba 3", ["test_mitsuba.py"])
