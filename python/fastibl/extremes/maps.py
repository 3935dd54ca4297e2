"""Environment maps as arrays and files: what is cleaned, what is refused, and what is kept."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .. import reference
from .._fastibl import CubeMap, cubemap_from_equirect, equirect_from_cubemap, texel_solid_angles
from ..environment_files import read_environment, write_environment
from .case import Case, Outcome, both, equal, is_light, refused
from .worlds import MAPS, map_named

STEP = "maps"


def cases() -> Iterator[Case]:
    for size in (1, 2, 3, 7, 64, 333, 1024, 2048):
        yield Case(STEP, f"solid angles of {size} x {size} faces", "sum to 4 pi", partial(_angles, size))
    for size in (1, 2, 3, 5, 31, 2048):
        yield Case(STEP, f"levels of {size} x {size} faces", "each has the mean of the map", partial(_levels, size))
    for name in MAPS:
        yield Case(STEP, f"{name}: all levels", "clean: finite and never negative", partial(_clean, name))
    for what, value, key in (
        ("NaN", np.nan, "nan"),
        ("infinity", np.inf, "capped"),
        ("minus infinity", -np.inf, "negative"),
        ("negative", -1e-30, "negative"),
        ("1e10", 1e10, "capped"),
    ):
        yield Case(STEP, f"a value that is {what}", f"is counted as {key}", partial(_counted, value, key))
    for name, (array, kind) in BAD.items():
        yield Case(
            STEP,
            f"array: {name}",
            f"{kind.__name__} that says what was expected",
            partial(_refused, array, kind),
        )
    for name, array in GOOD.items():
        yield Case(STEP, f"array: {name}", "taken as it is", partial(_taken, array))
    for shape in ((1, 1), (1, 2), (2, 1), (3, 5), (1, 4096), (64, 128)):
        yield Case(
            STEP,
            f"equirectangular picture of {shape[0]} x {shape[1]}",
            "keeps its energy",
            partial(_equirect, shape),
        )
    for value in (1e-30, 1e-8, 1.0, 1e8):
        yield Case(STEP, f".hdr of {value:g}", "read back within 1/256", partial(_file, value, ".hdr"))
    for name, content in FILES.items():
        yield Case(STEP, f"file: {name}", "an error that names the file", partial(_broken_file, name, content))


BAD: dict[str, tuple[Callable[[], Any], type[Exception]]] = {
    "integers": (lambda: np.ones((6, 2, 2, 3), int), TypeError),
    "objects": (lambda: np.full((6, 2, 2, 3), None), TypeError),
    "strings": (lambda: np.full((6, 2, 2, 3), "a"), TypeError),
    "complex numbers": (lambda: np.ones((6, 2, 2, 3), complex), TypeError),
    "a bare number": (lambda: 1.0, TypeError),
    "no texels": (lambda: np.zeros((6, 0, 0, 3)), ValueError),
    "five faces": (lambda: np.zeros((5, 2, 2, 3)), ValueError),
    "faces that are no squares": (lambda: np.zeros((6, 2, 3, 3)), ValueError),
    "four channels": (lambda: np.zeros((6, 2, 2, 4)), ValueError),
}
GOOD: dict[str, Callable[[], np.ndarray]] = {
    "float16": lambda: np.linspace(0, 9, 72).reshape(6, 2, 2, 3).astype(np.float16),
    "float64": lambda: np.linspace(0, 9, 72).reshape(6, 2, 2, 3),
    "long double": lambda: np.linspace(0, 9, 72).reshape(6, 2, 2, 3).astype(np.longdouble),
    "big-endian": lambda: np.linspace(0, 9, 72).reshape(6, 2, 2, 3).astype(">f4"),
    "strides backwards": lambda: np.linspace(0, 9, 72).reshape(6, 2, 2, 3)[::-1, ::-1],
    "every second texel": lambda: np.linspace(0, 9, 288).reshape(6, 4, 4, 3)[:, ::2, ::2],
    "one number for all (stride 0)": lambda: np.broadcast_to(np.float32(2), (6, 4, 4, 3)),
}
_HEADER = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n"
FILES = {
    "nothing in it": b"",
    "text": b"no picture at all\n" * 20,
    "header alone": _HEADER,
    "pixels cut off": _HEADER + b"\x80\x80\x80\x80" * 7,
    "a size of 1e9": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000000 +X 2000000000\n",
    "a negative size": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y -4 +X 8\n",
    "a square that is no face": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 4\n" + b"\x80\x80\x80\x80" * 16,
}


def _angles(size: int) -> Outcome:
    return equal(6 * texel_solid_angles(size).sum(), 4 * np.pi, 1e-12, "sum")


def _levels(size: int) -> Outcome:
    faces = np.random.default_rng(size).random((6, size, size, 3), np.float32) ** 8
    cube = CubeMap(faces)
    true = (texel_solid_angles(size)[..., None] * faces.astype(np.float64)).sum(axis=(0, 1, 2)) / (4 * np.pi)
    outcomes = []
    for k in range(cube.level_count):
        level = cube.level(k).astype(np.float64)
        angles = texel_solid_angles(level.shape[1])[..., None]
        # Levels of odd sizes cut texels along straight lines of a face; the parts' solid angles are not exact.
        limit = 2e-6 if size & (size - 1) == 0 else 5e-3
        outcomes.append(equal((angles * level).sum(axis=(0, 1, 2)) / (4 * np.pi), true, limit, "mean"))
    worst = max(outcomes, key=lambda o: float(o.text.split()[-1]))
    return Outcome(all(o.held for o in outcomes), worst.text, worst.lost)


def _clean(name: str) -> Outcome:
    cube = map_named(name)
    return both(*(is_light(cube.level(k), what="texels") for k in range(cube.level_count)))


def _counted(value: float, key: str) -> Outcome:
    faces = np.ones((6, 4, 4, 3))
    faces[2, 1, 3, 1] = value
    cube = CubeMap(faces)
    held = cube.cleaned[key] == 1 and sum(cube.cleaned.values()) == 1
    return both(is_light(cube.faces, 1e9, "texels"), Outcome(held, f"cleaned {cube.cleaned}"))


def _refused(make: Callable[[], Any], kind: type[Exception]) -> Outcome:
    return refused(lambda: CubeMap(make()), kind)


def _taken(make: Callable[[], np.ndarray]) -> Outcome:
    array = make()
    return equal(CubeMap(array).faces, array.astype(np.float32), 0, "texels")


def _equirect(shape: tuple[int, int]) -> Outcome:
    rng = np.random.default_rng(3)
    image = (rng.random((*shape, 3), np.float32) ** 6 * 1e4).astype(np.float32)
    _, angles, radiance = reference.samples(image)
    true = (angles[:, None] * radiance).sum(axis=0) / (4 * np.pi)
    cube = cubemap_from_equirect(image, size=16)
    back = equirect_from_cubemap(cube, height=8)
    return both(equal(cube.mean(), true, 2e-6, "mean"), is_light(back, what="picture"))


def _file(value: float, ending: str) -> Outcome:
    cube = CubeMap(np.full((6, 4, 4, 3), value, np.float32))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"map{ending}"
        write_environment(path, cube, layout="strip")
        return equal(read_environment(path).faces, cube.faces, 1 / 256, "texels")


def _broken_file(name: str, content: bytes) -> Outcome:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.hdr"
        path.write_bytes(content)
        return refused(lambda: read_environment(path), (ValueError, OSError), "map.hdr")
