"""Drawing a board at true size, as pixels or as vectors."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ._fastibl import Board, Tag
from .file_limits import MOST_PIXELS
from .whole_file import write_whole

DATA_MODULES = 6  # modules of a tag of family 36h11 along one side, without its border
METRES_PER_INCH = 0.0254
_UNPRINTED = 0.006  # metres along a page's edge that printers may leave white
_STROKE = 0.0002  # metres, at least half the width of a drawn line


def tag_modules(id: int, border_bits: int = 1) -> NDArray[np.bool_]:
    """Black modules (n, n) of a tag of 36h11 with its border, n = 6 + 2 border_bits, as OpenCV's dictionary
    reads it: row 0 on top, corner order as in Tag.corners."""
    import cv2  # slow to import, and not needed to import fastibl

    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    n = DATA_MODULES + 2 * border_bits
    return cv2.aruco.generateImageMarker(family, id, n, borderBits=border_bits) < 128


def _in_page(board: Board, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Takes points in the marker frame (x right, y up, origin at the centre) to the page (x right, y down, origin at
    the upper left corner), metres."""
    return np.stack([points[..., 0] + board.width / 2, board.height / 2 - points[..., 1]], -1)


def _coverage(edges: NDArray[np.float64], pixels: int) -> NDArray[np.float64]:
    """The share (intervals, pixels) of each pixel that is covered by each interval between ascending edges."""
    covered = np.clip(edges[:, None] - np.arange(pixels), 0, 1)
    return np.diff(covered, axis=0)


def _ink(corners: NDArray[np.float64], modules: NDArray[np.bool_], shape) -> NDArray[np.float64]:
    """The share of ink (height, width) of one tag; corners (4, 2) in pixels of the picture."""
    n = len(modules)
    across, down = corners[1] - corners[0], corners[3] - corners[0]
    if np.allclose(corners[2], corners[1] + down, atol=1e-9 * n) and min(abs(across)) < 1e-9 * n:
        # An upright tag, or one turned by quarter turns: module edges run along rows and columns, so each pixel is
        # exact.
        turns = int(np.argmin(corners.sum(1)))
        upright = np.rot90(modules, turns)
        low, high = corners.min(0), corners.max(0)
        columns = _coverage(np.linspace(low[0], high[0], n + 1), shape[1])
        rows = _coverage(np.linspace(low[1], high[1], n + 1), shape[0])
        return rows.T @ upright.astype(float) @ columns
    import cv2

    fine = 8
    unit = np.array([[0, 0], [n, 0], [n, n], [0, n]], np.float32)
    to_fine = cv2.getPerspectiveTransform((corners * fine).astype(np.float32), unit)
    y, x = np.mgrid[: shape[0] * fine, : shape[1] * fine] + 0.5
    at = np.einsum("ij,jhw->ihw", to_fine, np.stack([x, y, np.ones_like(x)]))
    u, v = at[0] / at[2], at[1] / at[2]
    inside = (u >= 0) & (u < n) & (v >= 0) & (v < n)
    black = modules[np.clip(v, 0, n - 1).astype(int), np.clip(u, 0, n - 1).astype(int)] & inside
    return black.reshape(shape[0], fine, shape[1], fine).mean((1, 3))


def _caption(board: Board) -> tuple[float, float, float, str] | None:
    """Baseline y and text height (page, metres), length of the check line, and text; None where there is no room for
    it.

    The caption stands in the margin below the lowest tag, one module away from it, because the detector needs white
    around the tag. The line is above the text, as far from the page's edge as printers leave white, or as the room
    allows.
    """
    lowest = max(_in_page(board, tag.corners)[:, 1].max() for tag in board.tags)
    sides = [np.linalg.norm(tag.corners[1] - tag.corners[0]) for tag in board.tags]
    clear = min(sides) / (DATA_MODULES + 2 * board.border_bits)
    room = board.height - lowest - clear
    if room < 0.002:
        return None
    height = min(0.0025, room / 2)
    line = next((m for m in (0.1, 0.05, 0.02) if m < 0.4 * board.width), None)
    if line is None:
        return None
    ids = sorted(tag.id for tag in board.tags)
    run = ids == list(range(ids[0], ids[-1] + 1))
    which = f"{ids[0]}-{ids[-1]}" if run else ", ".join(map(str, ids))
    text = f"this line is {1000 * line:.0f} mm. fastibl board, AprilTag 36h11, ids {which}: print at 100 %"
    top = max(lowest + clear + _STROKE, min(lowest + clear + (room - height) / 2, board.height - _UNPRINTED))
    return top + height, height, line, text


def draw_board(board: Board, dpi: float = 300.0) -> NDArray[np.uint8]:
    """See Board.image."""
    import cv2

    if not 10 <= dpi <= 2400:
        raise ValueError(f"dpi must be 10 to 2400, got {dpi}")
    scale = dpi / METRES_PER_INCH
    shape = max(1, round(board.height * scale)), max(1, round(board.width * scale))
    page = np.full(shape, 255.0)
    for tag in board.tags:
        corners = _in_page(board, tag.corners) * scale
        low = np.clip(np.floor(corners.min(0)).astype(int), 0, shape[::-1])
        high = np.clip(np.ceil(corners.max(0)).astype(int), 0, shape[::-1])
        part = np.s_[low[1] : high[1], low[0] : high[0]]
        ink = _ink(corners - low, tag_modules(tag.id, board.border_bits), page[part].shape)
        page[part] = np.minimum(page[part], 255 * (1 - ink))
    page = np.rint(page).astype(np.uint8)
    caption = _caption(board)
    if caption:
        y, height, line, text = caption
        left = board.width / 2 - 0.45 * board.width
        font, unit = cv2.FONT_HERSHEY_SIMPLEX, cv2.getTextSize("0", cv2.FONT_HERSHEY_SIMPLEX, 1, 1)[0][1]
        text_scale = height * scale / unit
        room = board.width - left - line - 0.004
        width = cv2.getTextSize(text, font, text_scale, 1)[0][0] / scale
        text_scale *= min(1, room / width)
        at = round((left + line + 0.003) * scale), round(y * scale)
        cv2.putText(page, text, at, font, text_scale, 0, max(1, round(dpi / 200)), cv2.LINE_AA)
        for x0, y0, x1, y1 in _check_line(left, y, height, line):
            a, b = (round(x0 * scale), round(y0 * scale)), (round(x1 * scale), round(y1 * scale))
            cv2.line(page, a, b, 0, max(1, round(dpi / 150)))
    return page


def _check_line(left: float, y: float, height: float, line: float):
    """The line and its end marks, as (x0, y0, x1, y1) on the page."""
    yield left, y - height, left + line, y - height
    yield left, y - height, left, y
    yield left + line, y - height, left + line, y


def save_board(board: Board, path: str | os.PathLike, dpi: float = 300.0) -> None:
    """See Board.save."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".png":
        pixels = board.width * board.height * (dpi / METRES_PER_INCH) ** 2
        if pixels > MOST_PIXELS:
            raise ValueError(
                f"a board of {board.width:.2f} x {board.height:.2f} m has {pixels:.3g} pixels at {dpi:g} dpi, "
                f"more than {MOST_PIXELS}: save a .pdf"
            )
        write_whole(path, _png(draw_board(board, dpi), dpi))
    elif ending == ".pdf":
        _save_pdf(board, path)
    else:
        raise ValueError(f"a board is saved as .pdf or .png, got {path.name!r}")


def _png(image: NDArray[np.uint8], dpi: float) -> bytes:
    """A PNG that says how large it is: OpenCV writes no pHYs chunk, so one is inserted after the header."""
    import cv2

    data = cv2.imencode(".png", image)[1].tobytes()
    per_metre = round(dpi / METRES_PER_INCH)
    chunk = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    header = 8 + 25  # the signature, then IHDR: length, name, 13 bytes, checksum
    physical = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return data[:header] + physical + data[header:]


def _save_pdf(board: Board, path: Path) -> None:
    try:
        from reportlab.pdfgen.canvas import Canvas
    except ImportError as error:
        raise ImportError("a PDF needs reportlab: pip install reportlab (or save a .png)") from error
    point = 72 / METRES_PER_INCH  # points in a metre
    size = board.width * point, board.height * point
    data = io.BytesIO()
    canvas = Canvas(data, pagesize=size, invariant=True)
    canvas.setTitle("fastibl board")

    def on_paper(points):  # PDF counts from the lower left corner, with y up
        page = _in_page(board, np.asarray(points))
        return page[..., 0] * point, size[1] - page[..., 1] * point

    for tag in board.tags:
        modules = tag_modules(tag.id, board.border_bits)
        n = len(modules)
        origin, across, down = (
            tag.corners[0],
            tag.corners[1] - tag.corners[0],
            tag.corners[3] - tag.corners[0],
        )
        path_of_tag = canvas.beginPath()
        for row, column, width in _runs(modules):
            box = np.array([[column, row], [column + width, row], [column + width, row + 1], [column, row + 1]])
            x, y = on_paper(origin + box[:, :1] / n * across + box[:, 1:] / n * down)
            path_of_tag.moveTo(x[0], y[0])
            for k in (1, 2, 3):
                path_of_tag.lineTo(x[k], y[k])
            path_of_tag.close()
        canvas.drawPath(path_of_tag, stroke=0, fill=1)
    caption = _caption(board)
    if caption:
        y, height, line, text = caption
        left = board.width / 2 - 0.45 * board.width
        font_size = height * point / 0.72  # capitals are 0.72 of Helvetica's size
        room = (board.width - left - line - 0.004) * point
        font_size *= min(1, room / canvas.stringWidth(text, "Helvetica", font_size))
        canvas.setFont("Helvetica", font_size)
        canvas.drawString((left + line + 0.003) * point, size[1] - y * point, text)
        canvas.setLineWidth(0.5)
        for x0, y0, x1, y1 in _check_line(left, y, height, line):
            canvas.line(x0 * point, size[1] - y0 * point, x1 * point, size[1] - y1 * point)
    canvas.showPage()
    canvas.save()
    write_whole(path, data.getvalue())


def _runs(modules: NDArray[np.bool_]):
    """Black runs of each row as (row, first column, length). Rows do not overlap. Viewers that smooth edges show
    hairlines between shapes that touch, but not between runs of one path."""
    for row, line in enumerate(modules):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        for first, last in edges.reshape(-1, 2):
            yield row, int(first), int(last - first)


__all__ = ["Board", "Tag", "draw_board", "save_board", "tag_modules"]
