"""What the benchmarks run on: real maps and meshes beside the project, generated ones, and recordings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import fastibl
from fastibl.expected import present

from .goals import SkipError

T = TypeVar("T")
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


class ByMap(dict[str, T]):
    """A dictionary by the names of maps."""

    def __missing__(self, name: str) -> T:
        raise SkipError(f"needs the map {name}")


MAPS: ByMap[Path] = ByMap()  # the real HDR maps that goals are measured on
SUN_MAP = SHARED / "hdri-sun" / "immenstadter_horn_1k.hdr"
NO_MAPS = f"no real HDR maps under {SHARED / 'hdri'}"
OBJECT = (0.0, 0.0, 0.1)  # the middle of an object that is 0.2 m high
HEIGHT = 0.2


def use_maps(folder: Path) -> None:
    """Measures from now on with the .hdr and .exr maps of a folder."""
    files = sorted(p for p in folder.glob("*") if p.suffix in (".hdr", ".exr"))
    MAPS.clear()
    MAPS.update((p.stem.removesuffix("_1k"), p) for p in files)
    real_maps.cache_clear()


@cache
def real_maps() -> ByMap[fastibl.CubeMap]:
    """The real HDR maps as cube maps of 128 squared texels, by name; empty if the maps are not there."""
    return ByMap({name: fastibl.read_environment(path, size=128) for name, path in MAPS.items()})


@cache
def scene(name: str = "figurine", spheres: int = 50) -> fastibl.Scene:
    """A scene of the generated figurine, or of a mesh file beside the project, 0.2 m high."""
    if name == "figurine":
        return fastibl.Scene(fastibl.shapes.figurine(HEIGHT), spheres=spheres)
    return fastibl.Scene(fastibl.stand(fastibl.read_mesh(mesh_path(name)), HEIGHT), spheres=spheres)


def mesh_path(name: str) -> Path:
    return SHARED / "meshes" / f"{name}.obj"


@cache
def short_recording() -> fastibl.Recording:
    """Two seconds in the built-in room, with the board always in view."""
    return fastibl.simulate(seconds=2, fps=10, seed=0, position=OBJECT)


@cache
def sweep() -> fastibl.Recording:
    """The demo's sweep through the built-in room: 12 s at 15 fps."""
    return fastibl.simulate(seconds=12, fps=15, seed=0, position=OBJECT)


@dataclass
class Processed:
    """A session's results for a recording. poses: (time, back_from_marker or None). timings: those of each frame,
    seconds."""

    session: fastibl.Session
    poses: list[tuple[float, fastibl.Pose | None]]
    timings: list[dict[str, float]]
    last: fastibl.FrameResult


def process(recording: fastibl.Recording, scene: fastibl.Scene, **options) -> Processed:
    """Runs a recording through a new session with these options."""
    session = fastibl.Session(scene, recording.rig, recording.board, **options)
    poses, timings, last = [], [], None
    for frame in recording:
        last = session.process(frame)
        poses.append((frame.time, last.back_from_marker))
        timings.append(dict(last.timings))
    return Processed(session, poses, timings, present(last))


@cache
def swept(distance: float) -> Processed:
    """The demo's sweep, processed with the walls at this distance."""
    return process(sweep(), scene(), distance=distance)


use_maps(SHARED / "hdri")
