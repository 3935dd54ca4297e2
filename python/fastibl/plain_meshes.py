"""Meshes of .off and .stl files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .file_limits import file_bytes

_SHOWN = 60  # characters of a line in a message
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_HEAD = 84  # bytes of a binary .stl before its facets: a remark, and how many they are


def read_off(path: Path) -> tuple[NDArray, list[NDArray], NDArray | None]:
    """Places, polygons and normals of a text .off, which is OFF with any of C, N and ST before it: a vertex has its
    place, then N's normal, then what is not read, colours and uvs. http://www.geomview.org/docs/html/OFF.html"""
    rows = [words for line in file_bytes(path).splitlines() if (words := line.split(b"#", 1)[0].split())]
    keyword = rows[0].pop(0) if rows else b""
    if not re.fullmatch(rb"(C|N|ST)*OFF|off", keyword):
        raise ValueError(f"it must begin with OFF, COFF, NOFF or CNOFF, got {_shown([keyword])}")
    if not rows[0]:
        del rows[0]
    vertices, faces = (int(n) for n in _numbers(rows[0] if rows else [], 2, "its numbers of vertices and faces"))
    if vertices < 0 or faces < 0:
        raise ValueError(f"its numbers of vertices and faces must not be below 0, got {_shown(rows[0])}")
    if len(rows) - 1 < vertices + faces:
        raise ValueError(f"it says that it has {vertices} vertices and {faces} faces; {len(rows) - 1} lines follow")
    width = 6 if b"N" in keyword else 3
    given = [_numbers(row, width, f"vertex {k}") for k, row in enumerate(rows[1 : vertices + 1])]
    each = np.array(given, np.float64).reshape(-1, width)
    polygons = [_polygon(row, k) for k, row in enumerate(rows[vertices + 1 : vertices + 1 + faces])]
    return each[:, :3], polygons, each[:, 3:] if width == 6 else None


def _polygon(words: Sequence[bytes], number: int) -> NDArray[np.int64]:
    """A face's corners; its colour follows them."""
    try:
        corners = [int(word) for word in words[1 : int(words[0]) + 1]]
    except ValueError:
        corners = []
    if words[0] != b"%d" % len(corners):
        raise ValueError(f"face {number}: a number of corners and as many vertices expected, got {_shown(words)}")
    return np.array(corners, np.int64)


def read_stl(path: Path) -> NDArray:
    """Corners (n, 3, 3) of the facets of an .stl, binary or text. Its normals, which are those of the facets, are not
    read. A text's letters, in the place of the number of facets, would count more of them than any file has."""
    data = file_bytes(path)
    facets = int.from_bytes(data[_HEAD - 4 : _HEAD], "little")
    need = _HEAD + facets * _FACET.itemsize
    if _HEAD <= len(data) and need <= len(data):
        return np.frombuffer(data, _FACET, facets, _HEAD)["corners"].astype(np.float64)
    if not re.match(rb"(\xef\xbb\xbf)?\s*solid", data, re.IGNORECASE) or b"\0" in data[:_HEAD]:
        raise ValueError(f"it is cut off: {facets} facets need {need} bytes, it has {len(data)}")
    lines = enumerate(data.splitlines(), 1)
    vertices = [(words, n) for n, line in lines if (words := line.split()) and words[0].lower() == b"vertex"]
    if len(vertices) % 3:
        raise ValueError(f"it is cut off: its facets have 3 vertices each, it has {len(vertices)} vertices")
    corners = [_numbers(words[1:], 3, f"line {n}: a vertex") for words, n in vertices]
    return np.array(corners, np.float64).reshape(-1, 3, 3)


def _numbers(words: Sequence[bytes], count: int, what: str) -> list[float]:
    """The first numbers of a line."""
    try:
        found = [float(word) for word in words[:count]]
    except ValueError:
        found = []
    if len(found) < count:
        raise ValueError(f"{what}: {count} numbers expected, got {_shown(words)}")
    return found


def _shown(words: Sequence[bytes]) -> str:
    return f'"{b" ".join(words)[:_SHOWN].decode("latin-1")}"'
