"""Maps captured by fisheye and 360° front cameras from a second of film."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import fastibl
from fastibl.comparison import irradiance_error
from fastibl.recording import truth_of
from fastibl.room import LOWER, UPPER

from .. import inputs
from ..goals import Goal, percent, row, skipped
from .recordings import ROOM

_BACK = fastibl.Camera(64, 48, fx=52, fy=52, cx=32, cy=24)
_TURN = fastibl.Pose.from_rotation_vector([0.0, np.pi, 0.0], [0.0, 0.0, 0.0])
CAMERAS = {
    "360 degrees, 1024x512": fastibl.Camera.equirectangular(1024, 512),
    "fisheye of 185 degrees, 640x640": fastibl.Camera(
        640, 640, 198, 198, 320, 320, distortion=[0.01, -0.004, 0.0, 0.0], model="fisheye", field_of_view=185
    ),  # fmt: skip
}


def captured(place: str, camera: fastibl.Camera) -> tuple[float, float]:
    """Error of the irradiance, and share of the sky that was seen, after six pictures: two brackets of three."""
    path = None if place == ROOM else inputs.MAPS[place]
    rig = fastibl.Rig(_BACK, camera, _TURN)
    film = fastibl.simulate(path, rig=rig, seconds=0.4, fps=15, hand=False, lamp=False, board=False)
    box = (tuple(LOWER), tuple(UPPER)) if place == ROOM else None
    capture = fastibl.Capture(size=128, centre=truth_of(film).position, box=box)
    for f in film:
        pose = rig.front_from_back @ truth_of(film).pose(f.time)
        capture.add(f.front, camera, pose, exposure=f.front_exposure, time=f.time)
    sky = fastibl.texel_directions(128)[..., 2] > 0
    error = irradiance_error(capture.environment(), truth_of(film).environment(0))
    return error, float(np.isfinite(capture.last_seen)[sky].mean())


@row("capture", "wide cameras")
def wide_cameras() -> Iterator[Goal]:
    places = [ROOM, *inputs.MAPS]
    for what, camera in CAMERAS.items():
        found = {place: captured(place, camera) for place in places}
        errors = [e for e, _ in found.values()]
        middle, worst = float(np.median(errors)), max(errors)
        around = camera.model == "equirectangular"
        yield Goal(
            f"front camera: {what}, 6 pictures, {len(places)} places: error of the irradiance, median, worst",
            f"{percent(middle)}, {percent(worst)}",
            "<= 1 %, <= 3 %" if around else "reported",
            middle <= 0.01 and worst <= 0.03 if around else None,
            (
                ", ".join(f"{place} {percent(e)}" for place, (e, _) in found.items()),
                "seen of the sky: " + ", ".join(percent(s) for _, s in found.values()),
            ),
        )
    if not inputs.MAPS:
        yield skipped("the same of the 7 maps", inputs.NO_MAPS)
