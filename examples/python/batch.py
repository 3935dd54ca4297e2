"""The light that many recordings captured, as files, in several processes; run it again and it does the rest.

python batch.py recordings/* --out lights
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import fastibl
from fastibl import batch


def captured_light(recording: Path, path: Path) -> None:
    """The map at the recording's end, what is known of it, and its nine spherical harmonics, as .npz."""
    film = fastibl.Recording.open(recording)
    capture = fastibl.Capture(size=64)
    tracker = fastibl.Tracker(film.board, film.rig.back)
    for frame in film:
        tracked = tracker.track(frame.back) if frame.back is not None else None
        if tracked is None:
            continue
        pose = tracked.camera_from_marker
        capture.add(frame.back, film.rig.back, pose, exposure=frame.back_exposure, time=frame.time)
        if frame.front is not None and film.rig.front is not None:
            front = film.rig.front_from_back @ pose
            capture.add(frame.front, film.rig.front, front, exposure=frame.front_exposure, time=frame.time)
    seen = capture.environment()
    light = fastibl.Lighting(seen)
    np.savez_compressed(
        path, faces=seen.radiance.faces, confidence=seen.confidence, error=seen.predicted_error, sh9=light.sh9
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("lights"), help="folder of the results (default: %(default)s)")
    parser.add_argument("--workers", type=int, help="processes (default: one a core)")
    given = parser.parse_args(arguments)
    summary = batch.run(captured_light, given.recordings, given.out, suffix=".npz", workers=given.workers)
    print(summary)
    return 1 if summary.failed else 0


if __name__ == "__main__":  # the other processes import this file
    sys.exit(main())
