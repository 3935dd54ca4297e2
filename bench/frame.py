"""Whole frames in a steady state, and the time of each pass."""

from __future__ import annotations

import numpy as np

import fastibl
from fastibl.gl_device import gl_device
from fastibl.measuring.frames import steady

from . import inputs
from .measure import Row, Timing, row, timing


def frame_times(
    scene: fastibl.Scene, methods: str, backend: str = "cpu", threads: int = 1, rounds: int = 4
) -> tuple[Timing, dict[str, Timing]]:
    """Times of a session in a steady state on the short recording: the whole frame, tracking included, and the passes
    that most frames run.

    The first round warms up and is not counted.
    """
    recording = inputs.short_recording()
    session = fastibl.Session(scene, recording.rig, recording.board, methods=methods, backend=backend)
    whole, passes, _ = steady(session, recording, threads, rounds)
    names = sorted({name for p in passes for name in p} - {"total"})
    seconds = {name: [p.get(name, 0.0) for p in passes] for name in names}
    return whole, {name: timing(s, s) for name, s in seconds.items() if np.median(s) > 0}


def meshes() -> list[str]:
    return ["figurine"] + (["spot"] if inputs.mesh_path("spot").is_file() else [])


def rows() -> list[Row]:
    out = []
    for backend in ("cpu",) if gl_device()[1] else ("cpu", "gl"):
        for mesh in meshes():
            for methods in ("paper", "auto"):
                for threads in (1, 2):
                    whole, passes = frame_times(inputs.scene(mesh), methods, backend, threads)
                    case = f"640x480, {mesh}, "
                    for name, seconds in {"whole frame": whole, **passes}.items():
                        out.append(row(methods, case + name, time=seconds, threads=threads, backend=backend))
    return out
