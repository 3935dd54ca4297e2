"""rig.yaml and board.yaml: what is known of cameras and of the printed board, in the form of OpenCV's FileStorage.

They may come from anyone: content on which OpenCV's parser crashes or never ends is refused before it reads.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Board, Camera, Pose, Response, Rig
from .expected import expect, wrong_type
from .file_limits import check_pixels, text_of
from .whole_file import write_whole

if TYPE_CHECKING:
    import cv2

CAMERAS = ("back", "front")

_MOST_BYTES = 2**22
_DEEPEST = 32  # levels of nesting; a calibration has five
_BINARY = re.compile(r"!!binary|\$base64\$|[\"']binary")


def _nests(text: str) -> bool:
    """Whether YAML, JSON or XML nests deeper than _DEEPEST, judged by its indents, within a line, or by its brackets
    and tags."""
    if re.search(rf"^[ \t]{{{8 * _DEEPEST}}}", text, re.MULTILINE):
        return True
    if any(len(re.findall(r":|-[ \t]", part)) > _DEEPEST for part in re.split(r"[,\n{}\[\]]", text)):
        return True
    depth = 0
    for step in re.finditer(r"[\[{\]}]|</|/>|<(?![?!/])", text):
        depth += 1 if step[0] in ("[", "{", "<") else -1
        if depth > _DEEPEST:
            return True
    return False


def _check_plain(text: str, path: Path) -> None:
    """Raises ValueError for text that OpenCV's parser cannot stand: it calls itself for every level of nesting until
    memory runs out, and it may never finish reading some binary data. OpenCV's own writer of calibrations writes
    neither."""
    if _nests(text):
        raise ValueError(f"{path} nests more than {_DEEPEST} levels deep; a calibration has five")
    if _BINARY.search(text):
        raise ValueError(f"{path} holds binary data; expected numbers as text, as OpenCV's FileStorage writes them")


def _open_yaml(path: Path) -> cv2.FileStorage:
    import cv2

    text = text_of(path, _MOST_BYTES)
    _check_plain(text, path)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        raise ValueError(f"{path} is not a file that OpenCV's FileStorage reads: {error}") from None
    if not storage.isOpened():
        raise ValueError(f"{path} is not a file that OpenCV's FileStorage reads")
    return storage


@contextmanager
def _writing(path: Path) -> Iterator[cv2.FileStorage]:
    """An OpenCV file storage in memory. The file is written when the content is complete, because OpenCV's own writer
    does not notice a full disk."""
    import cv2

    mode = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    storage = cv2.FileStorage(path.name, mode)
    yield storage
    write_whole(path, storage.releaseAndGetString())


def _number(node: cv2.FileNode, name: str, path: Path) -> float:
    item = node.getNode(name)
    if item.empty() or not (item.isInt() or item.isReal()):
        raise ValueError(f"{path} has no number {name}")
    return item.real()


_MOST_VALUES = 1 << 14  # values of a matrix in a calibration: a board of 1000 tags has 12000


def _matrix(node: cv2.FileNode, name: str, path: Path) -> NDArray | None:
    """The values of an !!opencv-matrix as float64, read one by one: FileNode.mat() of a broken file may corrupt
    memory."""
    item = node.getNode(name)
    if item.empty():
        return None
    if not item.isMap():
        raise ValueError(f"{path}: {name} must be a matrix")
    rows, columns = _whole(item, "rows", path), _whole(item, "cols", path)
    data = item.getNode("data")
    if not 0 < rows * columns <= _MOST_VALUES:
        raise ValueError(f"{path}: {name} must be a matrix of 1 to {_MOST_VALUES} values, got {rows} x {columns}")
    if not data.isSeq() or data.size() != rows * columns:
        raise ValueError(f"{path}: {name} must be a matrix of {rows} x {columns} values")
    values = [data.at(i) for i in range(rows * columns)]  # OpenCV walks to each value from the first one
    if not all(v.isInt() or v.isReal() for v in values):
        raise ValueError(f"{path}: {name} must hold numbers")
    return np.array([v.real() for v in values]).reshape(rows, columns)


def _whole(node: cv2.FileNode, name: str, path: Path) -> int:
    value = _number(node, name, path)
    if not (abs(value) < 1 << 31 and value == int(value)):
        raise ValueError(f"{path}: {name} must be a whole number, got {value}")
    return int(value)


@contextmanager
def _reading(path: Path) -> Iterator[cv2.FileStorage]:
    """Opens an OpenCV file; OpenCV's own errors become ValueErrors that name the file."""
    import cv2

    storage = _open_yaml(path)
    try:
        yield storage
    except (cv2.error, SystemError, OverflowError) as error:
        said = str(error).strip().splitlines()[0]
        raise ValueError(f"{path} is not a file that OpenCV's FileStorage reads: {said}") from None
    finally:
        storage.release()


def write_rig(path: str | os.PathLike[str], rig: Rig) -> None:
    """Writes a rig in the form of OpenCV's FileStorage; camera matrices are in OpenCV's convention. Raises ValueError
    for a response of more than 16384 values, which read_rig would refuse."""
    import cv2

    expect(rig, Rig, "rig")
    for name in CAMERAS:
        camera = getattr(rig, name)
        if camera is not None and camera.response.curve.size > _MOST_VALUES:
            raise ValueError(
                f"the {name} camera's response has {camera.response.curve.size} values, and files hold up to "
                f"{_MOST_VALUES}: give Response.from_curve fewer"
            )
    with _writing(Path(path)) as storage:
        for name in CAMERAS:
            camera = getattr(rig, name)
            if camera is None:
                continue
            storage.startWriteStruct(name, cv2.FileNode_MAP)
            storage.write("width", camera.width)
            storage.write("height", camera.height)
            if camera.model != "perspective":
                storage.write("model", camera.model)
            if camera.field_of_view != 360:
                storage.write("field_of_view", float(camera.field_of_view))
            storage.write("camera_matrix", camera.opencv_matrix)
            if camera.distortion:
                storage.write("distortion", np.array([camera.distortion], np.float64))
            if camera.vignetting:
                storage.write("vignetting", np.array([camera.vignetting], np.float64))
            storage.write("gain", float(camera.gain))
            if camera.readout:
                storage.write("readout", float(camera.readout))
            if camera.response.curve.size:
                storage.write("response", np.atleast_2d(camera.response.curve))
            else:
                storage.write("response", "srgb")
            storage.endWriteStruct()
        if rig.front is not None:
            storage.write("front_from_back", rig.front_from_back.matrix)


def read_rig(path: str | os.PathLike[str]) -> Rig:
    """Reads the Rig of a rig.yaml. FileNotFoundError where there is none, ValueError that names what it lacks."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"the calibration {path} is missing")
    with _reading(path) as storage:
        root = storage.root()
        back = _read_camera(root.getNode("back"), "back", path)
        if back is None:
            raise ValueError(f"{path} has no back camera")
        front = _read_camera(root.getNode("front"), "front", path)
        if front is None:
            return Rig(back)
        pose = _matrix(root, "front_from_back", path)
        if pose is None:
            raise ValueError(f"{path} has a front camera, but no front_from_back")
        return Rig(back, front, Pose(pose))


def _read_camera(node: cv2.FileNode, name: str, path: Path) -> Camera | None:
    if node.empty():
        return None
    if not node.isMap():
        raise ValueError(f"{path}: {name} must be a map")
    matrix = _matrix(node, "camera_matrix", path)
    if matrix is None:
        raise ValueError(f"{path} has no camera_matrix of the {name} camera")
    distortion, vignetting = _matrix(node, "distortion", path), _matrix(node, "vignetting", path)
    response = node.getNode("response")
    curve = None if response.empty() or response.isString() else _matrix(node, "response", path)
    if response.isString() and response.string() != "srgb":
        raise ValueError(f'{path}: response must be "srgb" or a curve, got {response.string()!r}')
    width, height = _whole(node, "width", path), _whole(node, "height", path)
    check_pixels(f"{path}: the {name} camera", width, height)
    gain, readout, model = node.getNode("gain"), node.getNode("readout"), node.getNode("model")
    view = node.getNode("field_of_view")
    return Camera.from_opencv(
        matrix,
        [] if distortion is None else distortion.ravel().tolist(),
        (width, height),
        response=None if curve is None else Response.from_curve(curve.ravel()),
        gain=1.0 if gain.empty() else _number(node, "gain", path),
        vignetting=[] if vignetting is None else vignetting.ravel().tolist(),
        readout=0.0 if readout.empty() else _number(node, "readout", path),
        model=model.string() if model.isString() else "perspective" if model.empty() else "?",
        field_of_view=360.0 if view.empty() else _number(node, "field_of_view", path),
    )


def write_board(path: str | os.PathLike[str], board: Any) -> None:
    """Writes a board's page size, border_bits and tags (ids, and corners in metres, (4 tags, 2)).

    Another page, such as one that was simulated, is an object of a width and a height in metres; it has no tags.
    """
    if not (hasattr(board, "width") and hasattr(board, "height")):
        raise TypeError(wrong_type(board, (Board,), "board"))
    with _writing(Path(path)) as storage:
        storage.write("width", float(board.width))
        storage.write("height", float(board.height))
        storage.write("border_bits", int(getattr(board, "border_bits", 1)))
        tags = list(getattr(board, "tags", ()))
        if tags:
            storage.write("ids", np.array([[tag.id for tag in tags]], np.int32))
            storage.write("corners", np.concatenate([np.asarray(tag.corners, np.float64) for tag in tags]))


def read_board(path: str | os.PathLike[str]) -> Any:
    """Reads the Board of a board.yaml; None where it lists no tags."""
    path = Path(path)
    with _reading(path) as storage:
        root = storage.root()
        ids, corners = _matrix(root, "ids", path), _matrix(root, "corners", path)
        if ids is None:
            return None
        if corners is None or corners.size != 8 * ids.size:
            raise ValueError(f"{path}: expected four corners (x, y) for each of {ids.size} tags")
        if not ((np.abs(ids) < 1 << 31) & (ids == np.rint(ids))).all():
            raise ValueError(f"{path}: ids must be whole numbers")
        tags = [(int(i), np.asarray(c)) for i, c in zip(ids.ravel(), corners.reshape(-1, 4, 2), strict=True)]
        border = _whole(root, "border_bits", path)
        return Board(tags, _number(root, "width", path), _number(root, "height", path), border)
