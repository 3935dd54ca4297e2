"""What it costs to start: the import, and the memory of a session."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from ..goals import Goal, row

# Each runs in a fresh process: what is imported or allocated once would not show a second time.
_IMPORT = """
import resource, time
begin = time.perf_counter()
import fastibl
print(time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""

_RECORD = """
import sys
import fastibl
fastibl.simulate(seconds=1, size=(640, 480), out=sys.argv[1])
"""

# Reads the frames one after the other, so that the memory that remains is the session's own.
_SESSION = """
import resource, sys
import fastibl
recording = fastibl.Recording.open(sys.argv[1])
mesh = fastibl.stand(fastibl.shapes.figurine(), height=0.2)
before = int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize()
session = fastibl.Session(fastibl.Scene(mesh, fastibl.Material()), recording.rig, recording.board)
for frame in recording:
    session.process(frame)
print(int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() - before,
      1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def _run(code: str, *arguments: str) -> list[float]:
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


@row("product", "import and memory")
def import_and_memory() -> Iterator[Goal]:
    _run(_IMPORT)  # fills the page cache
    seconds, kilobytes = zip(*(_run(_IMPORT) for _ in range(5)), strict=True)
    time = statistics.median(seconds)
    yield Goal(
        "import fastibl: median of 5 processes",
        f"{time:.2f} s (least {min(seconds):.2f}), {max(kilobytes) / 1024:.0f} MB",
        "≤ 0.3 s",
        time <= 0.3,
    )
    with tempfile.TemporaryDirectory() as folder:
        _run(_RECORD, folder + "/recording")
        taken, peak = (value / 1e6 for value in _run(_SESSION, folder + "/recording"))
    yield Goal(
        "memory that a 640x480 session with two cameras takes",
        f"{taken:.0f} MB; the whole process at most {peak:.0f} MB",
        "≤ 150 MB",
        taken <= 150,
    )
