"""Shadow of a rigid object on the marker plane, from its triangles; baked results are kept on disk."""

from __future__ import annotations

import hashlib
import os
import warnings
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._fastibl import BakedShadow, CubeMap, Environment, Mesh, MeshShadowLight, Pose, ShadowMap
from .expected import expect
from .progress import reporting
from .whole_file import whole_file

_FORMAT = 4  # version of the files and of how a table is baked: another number makes older files stale
_Options = tuple[int, float, int, int]  # resolution, extent, rings, samples
_ARRAYS = tuple(table + array for table in ("", "outer_") for array in ("begin", "cells", "cover", "run_begin", "runs"))
# What reading a damaged file raises; MemoryError if its header claims an impossibly large array.
_BROKEN = (
    OSError, EOFError, KeyError, TypeError, ValueError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
_MOST_BYTES = 256 << 20  # of all files together; those that were not used for longest are removed first


def cache_folder() -> Path | None:
    """Where baked shadows are kept: $XDG_CACHE_HOME/fastibl or ~/.cache/fastibl.

    The variable FASTIBL_CACHE may name another folder. None where it is 0, or the user has no home.
    """
    chosen = os.environ.get("FASTIBL_CACHE", "")
    if chosen == "0":
        return None
    if chosen:
        return Path(chosen)
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if given.is_absolute():  # the XDG Base Directory Specification says to ignore relative paths
        return given / "fastibl"
    try:
        return Path.home() / ".cache" / "fastibl"
    except RuntimeError:
        return None


class MeshShadow:
    """Shadow of a rigid object on the marker plane, for any light.

    How much of each cell of the sky the object hides is computed once, and kept in `cache_folder()` under the content
    of the mesh. The shadow under a light is then a sum of products; for up to `directions` of the light's brightest
    parts, shadows are drawn from the triangles themselves.

    mesh: as it stands on the plane z = 0, metres; parts below it cast no shadow, triangles hide from both sides.
    resolution: texels along an edge of the map, 8 to 1024.
    extent: half the map's edge in metres, by default 1.5 times the object's largest extent; a coarse map of the same
    texels, 6 times as large, lies around it.
    rings, samples: the sky has 4 rings^2 cells, each made of `samples` directions (1 to 63).
    directions: largest number of a light's brightest parts to draw, 0 for none.
    fine: texels along an edge of one more map where a compact light, a sun or lamp of a few degrees with a tenth of the
    irradiance, casts its shadow; 0 for none.
    progress: whether to show a bar on stderr if that is a terminal and the work takes long; or a function that is given
    the part done, and ends the work with KeyboardInterrupt by returning False.
    cache: whether to keep the work on disk and to take it from there.

    Raises ValueError for a mesh without triangles or with values that are not finite, and for options out of range.
    """

    def __init__(
        self,
        mesh: Mesh,
        resolution: int = 128,
        *,
        extent: float | None = None,
        rings: int = 16,
        samples: int = 9,
        directions: int = 128,
        fine: int = 0,
        cache: bool = True,
        progress: bool | Callable[[float], bool] = True,
    ) -> None:
        expect(mesh, Mesh, "mesh")
        if extent is not None and not 0 < extent < np.inf:
            raise ValueError(f"extent must be above 0 metres, got {extent}")
        options = (int(resolution), float(extent or 0), int(rings), int(samples))
        self._options = options
        self._settings = {"directions": int(directions), "fine": int(fine)}
        self._light = MeshShadowLight(**self._settings)
        path = _path(mesh, options) if cache else None
        baked = _read(path, mesh, options) if path else None
        if baked is None:
            baked = _baked(mesh, options, progress)
            if path:
                _write(path, baked)
        self._baked = baked

    @property
    def baked(self) -> BakedShadow:
        """The baked result, for Scene.baked_shadow."""
        return self._baked

    @property
    def bytes(self) -> int:
        """Memory of the tables, bytes."""
        return self._baked.bytes

    @property
    def extent(self) -> float:
        """Half the map's edge in metres."""
        return self._baked.extent

    def fits(self, marker_from_object: Pose | ArrayLike) -> bool:
        """Whether an object at this pose still stands as it was baked: only shifted on the plane and turned about z."""
        return self._baked.fits(marker_from_object)

    def cast(
        self,
        cube: CubeMap | Environment,
        marker_from_object: Pose | ArrayLike | None = None,
        *,
        follow: bool = False,
    ) -> ShadowMap:
        """The shadow under this light; lights of an Environment whose place is known cast the shadow from there.

        follow: whether to keep the directions of lights of the last call with `follow` while they suit, which is steady
        from frame to frame, and 20 to 100 times faster than choosing them anew. Raises ValueError for a pose that
        `fits` refuses.
        """
        light = self._light if follow else MeshShadowLight(**self._settings)
        environment = cube if isinstance(cube, Environment) else None
        return self._baked.cast(_cube(cube), marker_from_object, light, environment)

    def ratio(self, cube: CubeMap | Environment, points: ArrayLike) -> NDArray[np.float32]:
        """Ratio (..., 3) of the light at plane points (..., 2) in metres, with and without the object.

        In [0, 1]; bilinear between the texels of the map, 1 outside both maps and in a channel without light. Raises
        ValueError for another shape.
        """
        return self.cast(cube).sample(points)

    def __repr__(self) -> str:
        texels = self._options[0]
        return f"<fastibl.MeshShadow of {texels} x {texels}, extent {self.extent:.3g} m, {self.bytes >> 10} KiB>"


def _cube(light: CubeMap | Environment) -> CubeMap:
    return light.radiance if isinstance(light, Environment) else light


def _baked(mesh: Mesh, options: _Options, progress: bool | Callable[[float], bool]) -> Any:
    with reporting(progress, "bake shadow") as report:
        baked = BakedShadow.bake(mesh, *options, report)
    if baked is None:
        raise KeyboardInterrupt("baking a shadow was ended")
    return baked


# Files hold the arrays of both tables, compressed.


def _path(mesh: Mesh, options: _Options) -> Path | None:
    folder = cache_folder()
    if folder is None:
        return None
    key = hashlib.sha256(f"mesh shadow {_FORMAT} {options!r} {len(mesh.vertices)}".encode())
    key.update(np.ascontiguousarray(mesh.vertices, np.float32).tobytes())
    key.update(np.ascontiguousarray(mesh.triangles, np.int32).tobytes())
    return folder / f"shadow-{key.hexdigest()[:32]}.npz"


def _read(path: Path, mesh: Mesh, options: _Options) -> Any:
    """The tables in a file, or None where there is no file; warns of a file that cannot be read."""
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            tables = [file[name] for name in _ARRAYS]
            if int(file["checksum"]) != _checksum(tables):
                raise ValueError("its checksum is another")
        baked = BakedShadow.from_tables(mesh, *options, tables)
    except _BROKEN as error:
        warnings.warn(f"{path} is broken and will be made anew: {error}", RuntimeWarning, stacklevel=4)
        return None
    with suppress(OSError):
        path.touch()
    return baked


def _checksum(tables: list[NDArray]) -> int:
    total = 0
    for array in tables:
        total = zlib.crc32(np.ascontiguousarray(array).tobytes(), total)
    return total


def _write(path: Path, baked: Any) -> None:
    """Writes the tables; where the disk is full or not writable, it only warns."""
    tables = baked.tables
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(file, checksum=np.int64(_checksum(tables)), **dict(zip(_ARRAYS, tables, strict=True)))
        _forget(path.parent)
    except OSError as error:
        warnings.warn(f"the shadow could not be kept in {path.parent}: {error}", RuntimeWarning, stacklevel=4)


def _forget(folder: Path) -> None:
    """Removes the files that were not used for longest until all of them together are small enough."""
    files = []
    for path in folder.glob("shadow-*.npz"):
        with suppress(OSError):
            status = path.stat()
            files.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in files)
    for _, size, path in sorted(files)[:-1]:
        if total <= _MOST_BYTES:
            break
        with suppress(OSError):
            path.unlink()
        total -= size
