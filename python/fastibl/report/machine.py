"""What the numbers were measured on."""

from __future__ import annotations

import platform

import cv2
import numpy as np

from .._fastibl import __version__
from ..gl_device import gl_device
from ..measuring import commit, cpu, yardstick
from .section import Section, Table

_WHAT = """Times hold for this machine. To compare machines, each time is also kept in yardsticks: how often OpenCV could
have turned a panorama of 1024 × 512 pixels into a cube map of 6 × 256² in that time, on one core."""


def memory() -> str:
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            return f"{int(file.readline().split()[1]) / 2**20:.0f} GiB"
    except (OSError, ValueError, IndexError):
        return "–"


def machine(seconds: dict[str, tuple[float, float]]) -> Section:
    """seconds: wall and CPU time of each part of the report."""
    stick = yardstick(15)
    device, missing = gl_device()
    rows = [
        ["processor", cpu()],
        ["memory", memory()],
        ["system", f"{platform.system()} {platform.release()} {platform.machine()}"],
        ["fastibl", f"{__version__} {commit()}".strip()],
        ["OpenGL ES back end", device or missing],
        ["Python, NumPy, OpenCV", f"{platform.python_version()}, {np.__version__}, {cv2.__version__}"],
        ["yardstick", f"{1e3 * stick.cpu:.2f} ms of CPU time, {1e3 * stick.cpu_low:.2f} to {1e3 * stick.cpu_high:.2f}"],
    ]
    section = Section("machine", "The machine", _WHAT, tables=[Table(["what", ""], rows)])
    taken = sorted(seconds.items(), key=lambda item: -item[1][1])
    section.tables.append(
        Table(
            ["part of this report", "took", "CPU time"],
            [[n, f"{wall:.1f} s", f"{cpu:.1f} s"] for n, (wall, cpu) in taken],
            title="Where the time went",
        )
    )
    return section
