"""What it costs to add a picture to the map."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import fastibl

from .. import inputs, measure
from ..goals import Goal, percent, row
from ..light.speed import film, lens, place


@row("capture", "cost of a picture")
def cost() -> Iterator[Goal]:
    name = "potsdamer_platz" if "potsdamer_platz" in inputs.MAPS else None
    radiance = place(name)
    for degrees in (60, 80):
        camera = lens(degrees, False)
        with measure.one_core():
            pictures = film(camera, radiance, 0.15, 0.9)
            passes = []
            for _ in range(3):  # the same work each time; the least time is that of the work alone
                capture, times = fastibl.Capture(size=128), []
                for k, (image, pose) in enumerate(pictures):
                    begin = time.process_time()
                    capture.add(image, camera, pose, time=k / 30)
                    times.append(time.process_time() - begin)
                passes.append(times)
            yard = measure.yardstick(3).cpu
        hits = np.mean([_hits(camera, pose) for _, pose in pictures[::16]])
        each = float(np.median(np.min(passes, axis=0))) / hits
        yield Goal(
            f"one 640 x 480 picture, {degrees} degrees, into 6 x 128^2: CPU time per texel that it shows",
            f"{1e9 * each:.1f} ns",
            "<= 10 ns",
            bool(each <= 10e-9),
            (
                f"{hits:.0f} texels of {6 * 128**2} ({percent(float(hits / (6 * 128**2)))}); every pixel is read, "
                f"{640 * 480 / hits:.0f} a texel; {1e3 * each * hits:.3f} ms a picture, yardstick {1e3 * yard:.2f} ms",
            ),
        )


def _hits(camera: fastibl.Camera, pose: fastibl.Pose) -> int:
    d = fastibl.texel_directions(128).reshape(-1, 3).astype(np.float64)
    d = d[d[:, 2] > 0]
    seen = camera.project(d @ pose.rotation.T)
    with np.errstate(invalid="ignore"):
        inside = (seen >= 0).all(axis=1) & (seen[:, 0] < camera.width) & (seen[:, 1] < camera.height)
    return int(inside.sum())
