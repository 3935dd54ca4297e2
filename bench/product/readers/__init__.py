"""Readers of exported light that share nothing with fastibl, in Node and in a browser without a screen."""

from __future__ import annotations

import base64
import functools
import html
import http.server
import json
import re
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).parent
_CHROMIUM = (
    "--headless --no-sandbox --disable-gpu --use-angle=swiftshader --enable-unsafe-swiftshader --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync --virtual-time-budget=120000 --dump-dom"
).split()
SIZE = 128  # of a view, as views.js has it


def missing() -> str | None:
    """What of Node, npm and Chromium is not there, or None."""
    absent = [name for name in ("node", "npm", "chromium") if shutil.which(name) is None]
    return f"needs {', '.join(absent)}" if absent else None


def install() -> Path:
    """Folder with the readers of package.json; build/readers of the source tree, kept from run to run."""
    folder = HERE.parents[2] / "build" / "readers"
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(HERE / "package.json", folder)
    done = subprocess.run(["npm", "install", "--no-audit", "--no-fund"], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"npm could not install the readers: {done.stderr[-500:]}")
    return folder


def in_node(readers: Path, folder: Path, normals: NDArray) -> dict[str, Any]:
    """What read.mjs finds in a folder of exported light."""
    shutil.copy(HERE / "read.mjs", readers)
    given = json.dumps({"folder": str(folder), "normals": normals.tolist()})
    done = subprocess.run(["node", "read.mjs"], cwd=readers, input=given, capture_output=True, text=True, timeout=120)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout)


def in_browser(readers: Path, page: str, files: list[Path]) -> dict[str, dict[str, Any]]:
    """What a page finds in each of the files, by name: "views" (6, n, n, 3), and what else it says."""
    with tempfile.TemporaryDirectory() as site, tempfile.TemporaryDirectory() as profile:
        root = Path(site)
        (root / "node_modules").symlink_to(readers / "node_modules")
        for source in (HERE / page, HERE / "views.js", *files):
            shutil.copy(source, root)
        (root / "jobs.json").write_text(json.dumps([file.name for file in files]))
        with _serving(root) as address:
            command = ["chromium", *_CHROMIUM, f"--user-data-dir={profile}", f"{address}/{page}"]
            done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    found = re.search(r"RESULT(\{.*\})END", html.unescape(done.stdout), re.DOTALL)
    if not found:
        raise RuntimeError(f"{page} gave no result: {done.stderr[-2000:]}")
    results = json.loads(found[1])
    for name, result in results.items():
        if "error" in result:
            raise RuntimeError(f"{name} in {page}: {result['error']}")
        floats = [np.frombuffer(base64.b64decode(view), "<f4") for view in result["views"]]
        result["views"] = np.reshape(floats, (6, SIZE, SIZE, 3))
    return results


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


class _serving:
    def __init__(self, root: Path):
        handler = functools.partial(_Quiet, directory=str(root))
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)

    def __enter__(self) -> str:
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{self.server.server_port}"

    def __exit__(self, *_: Any) -> None:
        self.server.shutdown()
        self.server.server_close()


def view_samples(views: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Directions (n, 3) in glTF's axes, solid angles (n,) and radiances (n, 3) of the six views."""
    across = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    right, down = np.meshgrid(across, across)
    angles = (2 / SIZE) ** 2 / (1 + right**2 + down**2) ** 1.5
    frames = [((0, 0, 1), (0, 1, 0)), ((-1, 0, 0), (0, 1, 0)), ((0, 0, -1), (0, 1, 0)), ((1, 0, 0), (0, 1, 0)),
              ((0, 1, 0), (0, 0, -1)), ((0, -1, 0), (0, 0, 1))]  # fmt: skip
    directions = np.stack([
        np.asarray(forward) + right[..., None] * np.cross(forward, up) - down[..., None] * np.asarray(up)
        for forward, up in frames
    ])  # fmt: skip
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return directions.reshape(-1, 3), np.tile(angles.reshape(-1), 6), views.reshape(-1, 3).astype(np.float64)
