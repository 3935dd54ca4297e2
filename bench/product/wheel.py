"""The wheel: its size, its content, and the demo where nothing else is installed."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

from ..goals import Goal, row, skipped

ROOT = Path(__file__).resolve().parents[2]

# Does what the demo does, then lists the graphics libraries that its process has loaded.
_DEMO = """
import sys
from pathlib import Path
from fastibl.__main__ import main
status = main(["demo", "--out", sys.argv[1]])
loaded = {line.split()[-1] for line in Path("/proc/self/maps").read_text().splitlines() if "/" in line}
print("status", status, "graphics", sorted(l for l in loaded if any(w in l for w in ("libGL", "libEGL", "epoxy"))))
"""


@row("product", "wheel")
def wheels() -> Iterator[Goal]:
    found = sorted((ROOT / "wheels").glob("*.whl"))
    if not found:
        yield skipped("wheels", "./dev wheel makes them")
        return
    for wheel in found:
        size = wheel.stat().st_size / 1e6
        with zipfile.ZipFile(wheel) as archive:
            shared = [name for name in archive.namelist() if ".so" in name]
        own = [name for name in shared if name.startswith("fastibl/_fastibl.")]
        yield Goal(
            wheel.name,
            f"{size:.2f} MB; {', '.join(shared)}",
            "≤ 5 MB, the extension alone",
            size <= 5 and shared == own and len(own) == 1 and "manylinux" in wheel.name,
        )
    tag = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    mine = next((wheel for wheel in found if f"-{tag}-" in wheel.name), None)
    if mine is None:
        yield skipped("fastibl demo from the wheel", f"no wheel for this Python ({tag})")
        return
    with tempfile.TemporaryDirectory() as folder:
        venv = Path(folder) / "venv"
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
        python = venv / "bin" / "python"
        subprocess.run([python, "-m", "pip", "install", "-q", f"{mine}[board,report]"], check=True)
        done = subprocess.run([python, "-c", _DEMO, f"{folder}/demo"], cwd=folder, capture_output=True, text=True)
        report = Path(folder, "demo", "report.html")
        yield Goal(
            "fastibl demo from the wheel in a fresh environment, on the CPU back end",
            f"{done.stdout.strip().splitlines()[-1] if done.stdout.strip() else done.stderr[-200:]}",
            "a report, and no library of graphics loaded",
            "status 0 graphics []" in done.stdout and report.is_file(),
        )
