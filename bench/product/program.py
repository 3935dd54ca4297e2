"""The native program in a window: every control, frames a second, and the program's own share of the processor."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

from fastibl.expected import present

from ..goals import Goal, row, skipped
from ..window import PROGRAM, ROOT, Screen, Window, missing_tools

_FRAMES = 90
_RATE = re.compile(r"([\d.]+) frames/s in all, ([\d.]+) ms of processor time each")
_KEYS = {"space": "space", ",": "comma", ".": "period", "tab": "Tab"}  # the names that X has for them
_SILENT = {"turn-left", "turn-right", "step", "quit"}  # commands that show what they do without printing anything


def _commands() -> list[tuple[str, str]]:
    """(key, name) of each command, as --help lists them."""
    text = subprocess.run([PROGRAM, "--help"], capture_output=True, text=True, check=True).stdout
    lines = text.partition("Keys, and commands")[2].splitlines()[1:]
    return [(line[2:9].strip(), line[9:26].strip()) for line in lines if line.strip()]


def _answered(screen: Screen, folder: Path) -> tuple[int, list[str]]:
    """The number of commands, and those whose key the window did not answer."""
    commands = _commands()
    silent = []
    with Window(screen, "--simulate", "--size", "320x240", "--object", "ball", folder=folder) as window:
        window.wait_for("Esc, too")
        for key, name in sorted(commands, key=lambda command: command[1] == "quit"):
            said = len(window.output)
            window.press(_KEYS.get(key, key))
            if name in _SILENT:
                continue
            words = {"object": " cm high", "height": " cm high", "restart": "beginning", "screenshot": "wrote"}
            try:
                window.wait_for(words.get(name, f"{name}: " if name != "record" else "recording to"), since=said)
            except AssertionError:
                silent.append(name)
        if window.wait() != 0:
            silent.append("quit")
    return len(commands), silent


def _measured(command: list[object], env: dict[str, str] | None = None) -> tuple[float, float]:
    """Frames a second of wall time, and processor milliseconds per frame."""
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=True, env=env)
    rate, used = present(_RATE.search(done.stdout)).groups()
    return float(rate), float(used)


@row("product", "native program")
def native_program() -> Iterator[Goal]:
    what = "native program's window"
    if not PROGRAM.is_file():
        yield skipped(what, f"not built: no {PROGRAM}")
        return
    if missing_tools():
        yield skipped(what, f"needs {' and '.join(missing_tools())}")
        return
    with tempfile.TemporaryDirectory() as name, Screen() as screen:
        folder = Path(name)
        count, silent = _answered(screen, folder)
        yield Goal(
            "commands that a window under Xvfb answers by their keys",
            f"{count - len(silent)} of {count}" + (f"; not {', '.join(silent)}" if silent else ""),
            "all",
            not silent,
        )
        yield from _speed(screen, folder)
    pictures = sorted((ROOT / "docs" / "images").glob("program*.jpg"))
    largest = max((picture.stat().st_size for picture in pictures), default=0)
    yield Goal(
        "screenshots in the docs", f"{len(pictures)}, at most {largest / 1000:.0f} kB", "≥ 2, ≤ 200 kB",
        len(pictures) >= 2 and largest <= 200_000,
    )  # fmt: skip


def _speed(screen: Screen, folder: Path) -> Iterator[Goal]:
    frames = ("--frames", _FRAMES)
    subprocess.run(
        [str(part) for part in (PROGRAM, "--simulate", "--headless", *frames, "--record", folder / "rec")],
        check=True,
        capture_output=True,
    )
    played = ("--recording", folder / "rec")
    env = screen.environment
    rounds = 2  # the least counts: other work on this machine can only add
    plain = min(_measured([PROGRAM, *played, "--headless"])[1] for _ in range(rounds))
    bare = min(_measured([PROGRAM, *played, *frames, "--no-pace", "--no-interface"], env)[1] for _ in range(rounds))
    shown = ("--overlay", "pose,map,lights")
    full = min(_measured([PROGRAM, *played, *frames, "--no-pace", *shown], env)[1] for _ in range(rounds))
    runs = [_measured([PROGRAM, "--simulate", *frames, "--no-pace", *shown], env) for _ in range(rounds)]
    rate = max(rate for rate, _ in runs)
    used = min(used for _, used in runs)
    yield Goal(
        "window at 640x480 with the default plan, panel, pose, map and lights: simulated room",
        f"{rate:.0f} frames/s, {used:.1f} ms of processor time a frame with the simulation",
        "≥ 30 frames/s",
        rate >= 30,
        (
            f"recording: {plain:.1f} ms without a window (decoding two PNGs included), {bare:.1f} with a window, "
            f"{full:.1f} with panel and overlays: the program's own share is {full - plain:.1f} ms",
        ),
    )
