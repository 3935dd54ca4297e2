"""How much of a disk is left to other programs."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

LEAST_FREE = 200 * 2**20  # bytes


def check_free(path: str | os.PathLike[str], least: int = LEAST_FREE) -> None:
    """Raises OSError where fewer bytes than `least` are free on the disk where `path` is, or is to be."""
    path = Path(path)
    folder = next(p for p in (path, *path.absolute().parents) if p.exists())
    free = shutil.disk_usage(folder).free
    if free < least:
        raise OSError(f"{free / 2**20:.0f} MiB are free where {path} is, recording ends at {least / 2**20:.0f}")
