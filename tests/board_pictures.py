"""Pictures of a board from known poses, shared with `fastibl extremes`, and those that are stored in tests/data."""

from pathlib import Path

import numpy as np

import fastibl
from fastibl.extremes.board_pictures import *  # noqa: F403
from fastibl.extremes.board_pictures import look_at, project_tag, render


def held(jpeg, orientation):
    """A JPEG file's bytes with EXIF that says how the telephone was held (1 and 3: lying, 6: upright)."""
    entry = b"\x01\x12\x00\x03" + (1).to_bytes(4, "big") + orientation.to_bytes(2, "big") + bytes(2)
    exif = b"Exif\0\0MM\0*" + (8).to_bytes(4, "big") + b"\0\1" + entry + bytes(4)
    return jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]


def vectors():
    """Name, board, camera, pose of the stored pictures in tests/data."""
    camera = fastibl.Camera(320, 240, 400.0, 402.0, 161.0, 118.5)
    yield "grid", fastibl.Board.grid(3, 4, 0.03, 0.01), camera, look_at(35, 0.24, 30, 12, (0.005, -0.004))
    camera = fastibl.Camera(160, 120, 200.0, 200.0, 80.0, 60.0)
    yield "kalibr", fastibl.Board.kalibr(2, 2, 0.05, 0.3), camera, look_at(25, 0.26, 200, -5)


def write_vectors(folder):
    """Pictures as PGM and text, which C++ reads without a library. Run again only when the format changes."""
    from fastibl.tracking import detect

    for name, board, camera, pose in vectors():
        grey = render(board, camera, pose, seed=7)[..., 1]
        header = f"P5\n{camera.width} {camera.height}\n255\n".encode()
        (folder / f"{name}.pgm").write_bytes(header + grey.tobytes())
        lines = [f"camera {camera.fx} {camera.fy} {camera.cx} {camera.cy}"]
        lines.append("pose " + " ".join(f"{v:.17g}" for v in pose[:3].ravel()))
        for id, corners in sorted(detect(np.ascontiguousarray(grey), board, camera)[0], key=lambda t: t[0]):
            lines.append(f"detected {id} " + " ".join(f"{v:.4f}" for v in corners.ravel()))
        for tag in board.tags:
            lines.append(f"expected {tag.id} " + " ".join(f"{v:.4f}" for v in project_tag(tag, camera, pose).ravel()))
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    write_vectors(Path(__file__).parent / "data")
