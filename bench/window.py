"""The native program as tests and goals drive it: where it is, and its window on a screen of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = Path(os.environ.get("FASTIBL_DEMO_PROGRAM", ROOT / "build/cpp/cpp/demo/fastibl-demo"))

# An environment in which Mesa finds no driver.
NO_DRIVER = {
    "LIBGL_DRIVERS_PATH": "/nowhere",
    "MESA_LOADER_DRIVER_OVERRIDE": "none",
    "__EGL_VENDOR_LIBRARY_DIRS": "/nowhere",
}


def missing_tools() -> list[str]:
    """Tools that a window needs but that are not installed."""
    return [tool for tool in ("Xvfb", "xdotool") if not shutil.which(tool)]


class Screen:
    """An X server that needs no real screen; a context manager. .display is its name."""

    def __enter__(self) -> Screen:
        read, write = os.pipe()
        self._server = subprocess.Popen(
            ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x800x24", "-nolisten", "tcp"],
            pass_fds=(write,),
            stderr=subprocess.DEVNULL,
        )
        os.close(write)
        with os.fdopen(read) as pipe:
            self.display = ":" + pipe.readline().strip()  # the server writes its name when it is ready
        return self

    @property
    def environment(self) -> dict[str, str]:
        """The environment for a program whose window is to appear here."""
        environment = {**os.environ, "DISPLAY": self.display}
        environment.pop("WAYLAND_DISPLAY", None)
        return environment

    def __exit__(self, *_: object) -> None:
        self._server.terminate()
        self._server.wait()


class Window:
    """The program in a window that is driven by keys and clicks; a context manager."""

    def __init__(self, screen: Screen, *arguments: object, folder: Path):
        self._env = screen.environment
        self._log = tempfile.TemporaryFile("w+")
        command = [str(part) for part in (PROGRAM, *arguments)]
        self._process = subprocess.Popen(command, cwd=folder, env=self._env, stdout=self._log, stderr=self._log)
        self._id = self._tool("search", "--sync", "--onlyvisible", "--pid", str(self._process.pid)).split()[-1]

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()

    def _tool(self, *arguments: str) -> str:
        done = subprocess.run(["xdotool", *arguments], env=self._env, capture_output=True, text=True, timeout=120)
        return done.stdout

    @property
    def output(self) -> str:
        self._log.seek(0)
        return self._log.read()

    @property
    def title(self) -> str:
        return self._tool("getwindowname", self._id).strip()

    def press(self, *keys: str) -> None:
        """Presses keys, by the names that X has for them: "space", "Tab", "comma", "m"."""
        for key in keys:
            self._tool("key", "--window", self._id, key)
            time.sleep(0.05)

    def hold(self, key: str, seconds: float) -> None:
        """Holds a key, which repeats as on a keyboard."""
        self._tool("windowfocus", self._id)
        self._tool("keydown", key)
        time.sleep(seconds)
        self._tool("keyup", key)

    def type(self, text: str) -> None:
        self._tool("type", "--window", self._id, "--delay", "30", text)

    def click(self, x: int, y: int) -> None:
        """Clicks at pixels from the window's upper left corner. A frame passes before the button is released."""
        self._tool("mousemove", "--window", self._id, str(x), str(y))
        time.sleep(0.3)
        self._tool("mousedown", "1")
        time.sleep(0.3)
        self._tool("mouseup", "1")
        time.sleep(0.3)

    def wait_for(self, text: str, seconds: float = 60, count: int = 1, since: int = 0) -> None:
        """Waits until the program has said the text `count` times after the first `since` letters."""
        end = time.monotonic() + seconds
        while self.output[since:].count(text) < count:
            assert self._process.poll() is None, f"the program ended:\n{self.output}"
            assert time.monotonic() < end, f"{text!r} was not said within {seconds} s:\n{self.output}"
            time.sleep(0.05)

    def wait(self, seconds: float = 60) -> int:
        """Waits for the program to end; returns its exit code."""
        return self._process.wait(seconds)
