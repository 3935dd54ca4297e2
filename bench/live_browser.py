"""The live page in a browser without a window: uses every control as a person does. Needs Chromium and Playwright."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from fastibl.live_page import LiveLoop, PageServer

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)
_PATIENCE = 60.0  # seconds: machines may be busy


def missing() -> str:
    """Why there is no browser to drive; empty where there is one."""
    try:
        import playwright  # noqa: F401
    except ImportError:
        return "Playwright is not installed: pip install playwright"
    return "" if any(map(shutil.which, _NAMES)) else f"no browser: none of {', '.join(_NAMES)}"


@contextmanager
def browser() -> Iterator[Any]:
    """Playwright's Browser with the installed Chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        path = next(path for path in map(shutil.which, _NAMES) if path)
        opened = playwright.chromium.launch(executable_path=path, args=list(_ARGUMENTS))
        try:
            yield opened
        finally:
            opened.close()


@contextmanager
def served(loop: LiveLoop, notices: tuple[str, ...] = ()) -> Iterator[PageServer]:
    """A loop that runs in a thread, and its page."""
    with PageServer(loop, notices=notices) as server:
        thread = threading.Thread(target=loop.run, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            loop.stop()
            thread.join(30)


def open_page(opened: Any, url: str, size: tuple[int, int] = (1280, 800), **options: Any) -> Any:
    """The page, once it shows a picture. page.errors collects what its console complains about, page.outside its
    requests to other places."""
    page = opened.new_page(viewport={"width": size[0], "height": size[1]}, **options)
    page.errors, page.outside = [], []
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.on("console", lambda m: page.errors.append(m.text) if m.type == "error" else None)
    page.on("request", lambda r: None if r.url.startswith((url, "data:")) else page.outside.append(r.url))
    page.set_default_timeout(1000 * _PATIENCE)
    page.goto(url)
    wait(page, "last && last.picture > 0 && shown > 0")
    return page


def wait(page: Any, comes: str) -> None:
    """Waits until an expression holds in the page, whose policy forbids evaluation from within. Raises AssertionError
    that says what the page's state is instead."""
    end = time.monotonic() + _PATIENCE
    while not page.evaluate(f"Boolean({comes})"):
        if time.monotonic() > end:
            now = page.evaluate("[last?.state, last?.settings, last?.messages]")
            raise AssertionError(f"waited for {comes}; the page is at {now}")
        page.wait_for_timeout(30)


def exercise(page: Any) -> list[str]:
    """Uses every control once and waits for its effect; returns the controls' names. Raises AssertionError where one
    has no effect."""
    done = []

    def control(name: str, act: Callable[[], Any], comes: str) -> None:
        act()
        wait(page, comes)
        done.append(name)

    def select(which: str, value: str, comes: str) -> None:
        control(f"{which} {value}", lambda: page.select_option(f"#{which}", value), comes)

    pixels = "$('picture').toDataURL()"
    control("notice", lambda: page.click("#notices button"), "!document.querySelector('#notices p')")
    control("freeze, by hand", lambda: page.click("#freeze"), "last.state === 'frozen' && !$('frozen').hidden")
    control("freeze, again", lambda: page.keyboard.press("f"), "last.state === 'running'")
    page.evaluate("document.activeElement.blur()")
    control("freeze, by space", lambda: page.keyboard.press("Space"), "last.state === 'frozen'")
    wait(page, "shown === last.picture")
    number = page.evaluate("last.picture")
    control("step", lambda: page.keyboard.press("s"), f"last.picture === {number + 1} && shown === last.picture")
    _looks(page, done, pixels)
    _object(page, control, select, pixels)
    _budget(control, select, page)
    control("start anew", lambda: page.click("#restart"), "last.state === 'running'")
    control("record", lambda: page.keyboard.press("r"), "last.recording?.written > 2 && !$('recording').hidden")
    control("record, ended", lambda: page.keyboard.press("r"), "last.messages.some((m) => /^recorded/.test(m.text))")
    control("picture", lambda: page.keyboard.press("p"), "last.messages.some((m) => /^saved/.test(m.text))")
    control("help", lambda: page.keyboard.press("?"), "$('keys').open")
    control("help, closed", lambda: page.keyboard.press("Escape"), "!$('keys').open")
    return done


def _looks(page: Any, done: list[str], pixels: str) -> None:
    """Views and axes, while frozen: the large picture must change."""
    page.evaluate(f"window.before = {pixels}")
    for key, name in (("2", "camera"), ("3", "front camera"), ("1", "composite")):
        page.keyboard.press(key)
        other = "===" if name == "composite" else "!=="
        wait(page, f"{pixels} {other} before")
        done.append(f"view {name}")
    drawn = (
        "$('overlay').getContext('2d').getImageData(0, 0, $('overlay').width, $('overlay').height).data.some((x) => x)"
    )
    assert not page.evaluate(drawn)
    page.keyboard.press("a")
    wait(page, drawn)
    page.keyboard.press("a")
    wait(page, f"!{drawn}")
    done.append("axes")


def _object(page: Any, control: Callable, select: Callable, pixels: str) -> None:
    def other(act: Callable[[], Any], comes: str) -> tuple[Callable[[], Any], str]:
        """Also expects the picture to change."""

        def run() -> None:
            page.evaluate(f"window.before = {pixels}")
            act()

        return run, f"{comes} && {pixels} !== before"

    for which, value in (("material", "gold"), ("object", "ring")):
        act, comes = other(
            partial(page.select_option, f"#{which}", value),
            f"last.settings.{which} === '{value}'",
        )
        control(f"{which} {value}", act, comes + " && !last.preparing")
    slide = "$('turn').value = 60; $('turn').dispatchEvent(new Event('input'))"
    control("turn", *other(lambda: page.evaluate(slide), "last.settings.turn === 60"))
    control("shadow off", *other(lambda: page.click("#shadow"), "!last.settings.shadow"))
    control("shadow on", *other(lambda: page.click("#shadow"), "last.settings.shadow"))


def _budget(control: Callable, select: Callable, page: Any) -> None:
    def enter(which: str, value: str) -> None:
        page.fill(f"#{which}", value)
        page.press(f"#{which}", "Enter")

    control("error", lambda: enter("error-budget", "30"), "last.settings.error === 0.3 && last.plan.meets_error")
    control("time", lambda: enter("time-budget", "12"), "last.settings.milliseconds === 12")
    control("no time", lambda: enter("time-budget", ""), "last.settings.milliseconds === 0")
    select("methods", "paper", "last.settings.methods === 'paper'")
    passes = "Object.fromEntries(last.plan.passes.map((p) => [p.step, p.method]))"
    select("method-shadow", "cap-sum", f"{passes}.shadow === 'cap-sum' && {passes}.diffuse.startsWith('six-face')")
    select("methods", "auto", "last.settings.methods === 'auto'")
    select("method-diffuse", "sh9", f"last.settings.methods.diffuse === 'sh9' && {passes}.diffuse.startsWith('sh9')")
    if page.evaluate("!$('backend').hidden"):
        select("backend", "gl", "last.settings.backend === 'gl' || last.messages.some((m) => /^backend/.test(m.text))")
        select("backend", "cpu", "last.settings.backend === 'cpu'")


def pictures_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("picture-*.png"))
