"""The pictures of docs/live.md: the page with the simulated room, as a browser shows it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fastibl
from fastibl.__main__ import build_parser
from fastibl.commands._live_source import guess_notice
from fastibl.live_page import Choices, LiveLoop, Settings
from fastibl.sources import BackAndForth, Paced

from . import live_browser
from .measure import ROOT

_IMAGES = ROOT / "docs" / "images"
_QUALITY = 80
_FPS = 30


def main() -> Iterator[Path]:
    """Writes the pictures one by one. Raises RuntimeError where there is no browser."""
    if live_browser.missing():
        raise RuntimeError(live_browser.missing())
    made = fastibl.simulate(seconds=5, fps=_FPS, hand=False, live=True, truth_size=16, seed=2)
    film = list(made)
    with tempfile.TemporaryDirectory() as name, live_browser.browser() as browser:
        folder = Path(name)
        with live_browser.served(_loop(fastibl.Recording(made.rig, film, made.board), folder)) as server:
            page = live_browser.open_page(browser, server.url)
            page.select_option("#material", "porcelain")
            live_browser.wait(page, f"last.picture > {len(film) // 2} && last.light.lights.length > 2")
            yield _shoot(page, "live")
            page.keyboard.press("f")
            page.keyboard.press("a")
            page.select_option("#material", "gold")
            page.select_option("#methods", "paper")
            live_browser.wait(page, "last.settings.methods === 'paper' && shown === last.picture")
            page.wait_for_timeout(1500)
            yield _shoot(page, "live-paper", whole=True)
            page.select_option("#methods", "auto")
            live_browser.wait(page, "last.settings.methods === 'auto'")
            dark = live_browser.open_page(browser, server.url, color_scheme="dark")
            dark.keyboard.press("r")
            live_browser.wait(dark, "last.recording")
            dark.keyboard.press("f")
            live_browser.wait(dark, "last.recording.written > 12 && last.state === 'running'")
            yield _shoot(dark, "live-dark")
            dark.keyboard.press("r")
            live_browser.wait(dark, "!last.recording")
            dark.close()
            small = live_browser.open_page(browser, server.url, (400, 860))
            small.wait_for_timeout(1500)
            yield _shoot(small, "live-small")
        loop = _loop(_without_board(made.rig), folder)
        with live_browser.served(loop, (_guess(),)) as server:
            page = live_browser.open_page(browser, server.url)
            page.wait_for_timeout(1500)
            yield _shoot(page, "live-no-board")


def _loop(film: fastibl.Recording, folder: Path) -> LiveLoop:
    source = Paced(BackAndForth(film, 1 / _FPS), catch_up=0.1)
    return LiveLoop(source, Choices(), Settings("figurine"), {"distance": 3.0}, folder=folder, about="a simulated room")


def _without_board(rig: fastibl.Rig) -> fastibl.Recording:
    """The same room, with nothing on the table."""
    made = fastibl.simulate(seconds=0.8, fps=_FPS, hand=False, truth_size=16, board=False, lamp=False, seed=2)
    return fastibl.Recording(rig, list(made), fastibl.Board.default())


def _guess() -> str:
    """What the command says about cameras without calibration."""
    arguments = build_parser().parse_args(["live", "--back", "0"])
    return guess_notice(arguments)


def _shoot(page: Any, name: str, whole: bool = False) -> Path:
    path = _IMAGES / f"{name}.jpg"
    page.evaluate("document.activeElement.blur()")
    page.screenshot(path=path, type="jpeg", quality=_QUALITY, full_page=whole)
    return path
