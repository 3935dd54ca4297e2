"""Memory: of what is kept for a scene, and of the whole process."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

from .. import CubeMap, Environment, Lighting, SelfShadow, Session
from ..measuring import row
from .inputs import Inputs
from .section import Section, Table

_MIB = 1024 * 1024


def resident() -> int | None:
    """Bytes of this process that lie in memory; None where the system does not tell.

    First, freed memory that the allocator still holds is given back, so that new things do not hide in it.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):  # the C library is not GNU's
        pass
    else:
        trim(0)
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return None


def largest() -> int | None:
    """The largest number of bytes that this process ever used."""
    try:
        import resource
        import sys

        # Kilobytes on Linux, bytes on macOS.
        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    except ImportError:
        return None


def measure(inputs: Inputs) -> Section:
    section = Section(
        "memory", "Memory", "What a running session keeps, beside the pictures that come and go. Sizes in MiB."
    )
    cube = next(iter(inputs.places.values()))
    map_bytes = sum(cube.level(k).nbytes for k in range(cube.level_count))
    self_shadow = SelfShadow(inputs.mesh)
    found: dict[str, float] = {
        f"map of {cube.size} squared texels a face, with its levels": map_bytes,
        f"baked self-shadow of {len(inputs.mesh.vertices)} vertices": self_shadow.nbytes,
        "baked shadow on the plane": inputs.scene.baked_shadow.bytes if inputs.scene.baked_shadow else 0,
        f"mesh of {len(inputs.mesh.triangles)} triangles": inputs.mesh.vertices.nbytes + inputs.mesh.triangles.nbytes,
    }
    before = resident()
    kept = [(Lighting(c), Environment(CubeMap(c.faces))) for c in [cube] * 8]
    after = resident()
    if before is not None and after is not None:
        found["one Environment and its Lighting (mean of 8)"] = max(after - before, 0) / len(kept)
    del kept
    before = resident()
    sessions = []
    for _ in range(4):
        session = Session(inputs.scene, inputs.follow.rig, inputs.follow.board)
        for frame in list(inputs.follow)[:3]:
            session.process(frame)
        sessions.append(session)
    after = resident()
    if before is not None and after is not None:
        found["one running Session with its own captured map (mean of 4)"] = max(after - before, 0) / len(sessions)
    del sessions
    if (most := largest()) is not None:
        found["the process that wrote this report, at most (Python, OpenCV, truths by brute force)"] = most
    section.tables.append(Table(["what", "MiB"], [[name, f"{b / _MIB:.3g}"] for name, b in found.items()]))
    section.rows += [row("memory", name, "MiB", b / _MIB, step="memory") for name, b in found.items()]
    return section
