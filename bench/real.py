"""The main job on real input: seven measured places, two meshes that were scanned or modelled, and photographs of
tags."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import fastibl
from fastibl._fastibl import _grey, _refine_corners
from fastibl.comparison import irradiance_error
from fastibl.recording import truth_of
from fastibl.tracking import detect
from fastibl.truth import TrueRenderer, picture_error

from . import inputs, photographs
from .measure import Row, measure, row, timing

MESHES = ("spot", "stanford-bunny")
_SECONDS, _FPS = 6, 8
SHEET = os.environ.get("FASTIBL_SHEET")  # where to write a picture of all composites beside the true ones


def rows() -> list[Row]:
    return places() + tracked_photographs()


def places() -> list[Row]:
    """Each map lights each mesh from infinity, seen by the simulated cameras; the last frame is compared with the
    truth."""
    names = [name for name in MESHES if inputs.mesh_path(name).is_file()]
    out, pictures = [], []
    renderers = {name: TrueRenderer(inputs.scene(name)) for name in names} if inputs.MAPS else {}
    for place, path in inputs.MAPS.items():
        recording = fastibl.simulate(path, seconds=_SECONDS, fps=_FPS, seed=0, position=inputs.OBJECT)
        frame, camera = recording[len(recording) - 1], recording.rig.back
        true_map = truth_of(recording).environment(frame.time)
        for name in names:
            print(f"{place}, {name}", file=sys.stderr, flush=True)
            true = renderers[name].render(
                frame.back, frame.back_exposure, camera, truth_of(recording).pose(frame.time), true_map
            )
            for methods in ("auto", "paper"):
                done = inputs.process(recording, inputs.scene(name), methods=methods)
                if methods == "auto":
                    pictures.append((f"{place}, {name}", done.last.image, true.image))
                environment, case = done.last.environment, f"{place}, {name}"
                totals = [t["total"] for t in done.timings[len(done.timings) // 4 :]]
                error = picture_error(done.last.image, true, frame.back, camera.response)
                for metric, value in (
                    ("error of the picture against the true one", error),
                    ("median error of the captured irradiance", irradiance_error(environment, true_map)),
                    ("predicted error of the captured irradiance", environment.predicted_error),
                    ("share of the sphere never seen", 1 - environment.coverage),
                    ("share of the seen sphere only a lower bound", environment.clipped),
                ):
                    whole = timing(totals, totals) if metric.startswith("error of the picture") else None
                    out.append(row(methods, case, metric, value, whole, threads=fastibl.threads()))
    if SHEET and pictures:
        write_sheet(Path(SHEET), pictures)
    return out


def write_sheet(path: Path, pictures: list[tuple[str, NDArray, NDArray]]) -> None:
    """Writes one picture of all composites, with the true one to the right of each."""
    cells = []
    for title, ours, true in pictures:
        pair = cv2.resize(np.hstack([ours, true])[..., ::-1], (640, 240), interpolation=cv2.INTER_AREA)
        cv2.putText(pair, title, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
        cells.append(pair)
    if len(cells) % 2:
        cells.append(np.zeros_like(cells[0]))
    cv2.imwrite(str(path), np.vstack([np.hstack(cells[k : k + 2]) for k in range(0, len(cells), 2)]))


def tracked_photographs() -> list[Row]:
    """The tracker on photographs that other people took."""
    return tagged_photographs() + grid_photographs()


def tagged_photographs() -> list[Row]:
    """Photographs full of tags that all have id 0, with the corners that AprilTag's own detector listed (not all of
    them)."""
    out = []
    for path in photographs.TAGS:
        image = photographs.read(path)
        listed = [
            np.array(line.replace("(", "").replace(")", "").replace(",", " ").split()[1:], float).reshape(4, 2)
            for line in path.with_suffix(".txt").read_text().splitlines()
            if line.strip()
        ]
        height, width = image.shape[:2]
        camera = fastibl.Camera(width, height, 800.0, 800.0, width / 2, height / 2)
        board, grey = fastibl.Board.grid(1, 1, 0.1, 0.02), _grey(image, camera)
        found = detect(grey, board, camera)[0]
        corners = np.array([tag.corners for tag in _refine_corners(grey, found, 1, camera)]).reshape(-1, 4, 2)
        distances = np.array(
            [np.linalg.norm(corners.mean(axis=1) - quad.mean(axis=0), axis=1).min(initial=np.inf) for quad in listed]
        )
        hit = distances < 2
        time = measure(lambda g, b=board, c=camera: detect(g, b, c), [grey], repetitions=9).of_cpu
        case = f"photograph {path.stem.split('_')[0]}"
        out += [
            row("board", case, "number of tags found", float(len(found)), time),
            row("board", case, f"number of {len(listed)} listed tags missed", float((~hit).sum())),
            row("board", case, "median distance of centres in pixels", float(np.median(distances[hit]))),
        ]
    return out


def grid_photographs() -> list[Row]:
    """A telephone's photographs of a Kalibr grid; the lens is calibrated with the same tags."""
    if not photographs.GRID:
        return []
    board, camera, images = photographs.grid(terms=4)
    out = []
    for path, image in zip(photographs.GRID, images, strict=True):
        for method in fastibl.methods("tracking"):
            tracker = fastibl.Tracker(board, camera, method=method.name)
            tracked = tracker.track(image)
            time = measure(tracker.track, [image], repetitions=5).of_cpu
            case = f"photograph of a grid {path.stem}"
            residual = None if tracked is None else tracked.residual_px
            used = 0 if tracked is None else len(tracked.tags)
            out += [
                row(method.name, case, "residual in pixels", residual, time, threads=fastibl.threads()),
                row(method.name, case, "number of tags used", float(used)),
            ]
    return out
