"""The live page: what it costs besides the session, what a browser gets of it, and whether every control works."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from statistics import median
from typing import Any

import fastibl
from fastibl.live_page import Choices, LiveLoop, PageServer, Settings
from fastibl.measuring import all_cores
from fastibl.sources import BackAndForth, Paced

from .. import live_browser
from ..goals import Goal, row, skipped
from ..measure import yardstick_seconds

_FPS = 30
_SECONDS = 6.0
_WARM = 60  # frames until there is a map and the plan is settled


class _Metered:
    """Processor time of the loop's thread within process() and of the whole process, frame by frame."""

    def __init__(self, session: Any):
        self._session, self.frames, self.session, self.thread = session, 0, 0.0, 0.0
        self.inside: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def process(self, frame: Any) -> Any:
        begin, whole = time.thread_time(), time.process_time()
        result = self._session.process(frame)
        self.session += time.thread_time() - begin
        self.inside.append(time.process_time() - whole)
        self.thread, self.frames = time.thread_time(), self.frames + 1
        return result


def _film() -> fastibl.Recording:
    """640 x 480, made before anything is measured."""
    made = fastibl.simulate(seconds=2, fps=_FPS, hand=False, live=True, truth_size=16)
    return fastibl.Recording(made.rig, list(made), made.board)


def _forth(film: fastibl.Recording) -> BackAndForth:
    return BackAndForth(film, 1 / _FPS)


class _Reader(threading.Thread):
    """Takes pictures and numbers as the page does, for use where there is no browser."""

    def __init__(self, server: PageServer):
        super().__init__(daemon=True)
        self.server, self.pictures, self.ending = server, 0, threading.Event()

    def run(self) -> None:
        import http.client

        connection = http.client.HTTPConnection("127.0.0.1", self.server.port)
        number, path, due = 0, f"/{self.server.token}/", 0.0
        while not self.ending.is_set():
            asked = [f"picture/composite?after={number}&wait=1"]
            if time.monotonic() >= due:
                due = time.monotonic() + 0.45
                asked += ["state?", "state?", "picture/map?after=0", "picture/shadow?after=0"]
            for what in asked:
                connection.request("GET", f"{path}{what}&viewer=measures1")
                answer = connection.getresponse()
                answer.read()
                if what.startswith("picture/composite") and answer.status == 200:
                    number, self.pictures = int(answer.headers["X-Picture"]), self.pictures + 1


def _run(film: Any, folder: Path, browser: Any) -> dict[str, float]:
    """Processor seconds and number of pictures of a run that is shown."""
    loop = LiveLoop(film, Choices(), Settings("figurine"), {"distance": 3.0}, folder=folder, about="simulated")
    meter: Any = _Metered(loop._session)
    loop._session = meter
    with live_browser.served(loop) as server:
        reader = page = None
        if browser is not None:
            page = live_browser.open_page(browser, server.url)
        else:
            reader = _Reader(server)
            reader.start()
        while meter.frames < _WARM:
            time.sleep(0.05)
        shown = _shown(page, reader)
        frames, session, thread = meter.frames, meter.session, meter.thread
        before, begin = (dict(server.seconds), dict(server.served)), time.monotonic()
        time.sleep(_SECONDS)
        seconds = time.monotonic() - begin
        shown = _shown(page, reader) - shown
        done = {
            "frames": meter.frames - frames,
            "shown": shown,
            "seconds": seconds,
            "session": median(meter.inside[frames:]),
            "loop": (meter.thread - thread) - (meter.session - session),
        }
        what = "picture/composite"
        spent = {name: server.seconds[name] - before[0].get(name, 0) for name in server.seconds}
        done["picture"] = spent.pop(what) / max(server.served[what] - before[1].get(what, 0), 1)
        done["steady"] = sum(spent.values()) / seconds  # in each second: numbers, map, shadow
        if reader is not None:
            reader.ending.set()
    return done


def _shown(page: Any, reader: _Reader | None) -> int:
    """Pictures that the client has taken so far."""
    return reader.pictures if reader is not None else page.evaluate("taken")


@row("product", "live page")
@all_cores()
def live_page() -> Iterator[Goal]:
    why = live_browser.missing()
    with tempfile.TemporaryDirectory() as name, nullcontext() if why else live_browser.browser() as browser:
        folder = Path(name)
        film = _film()
        who = "the page in Chromium" if browser is not None else f"a client of ours ({why})"
        yield from _costs(
            _run(Paced(_forth(film), catch_up=0.1), folder, browser), _run(_forth(film), folder, browser), who
        )
        if browser is None:
            yield skipped("every control of the page, used by a browser", why)
            return
        loop = LiveLoop(
            Paced(_forth(film), catch_up=0.1),
            Choices(),
            Settings("figurine"),
            {"distance": 3.0},
            folder=folder,
            about="simulated",
        )
        with live_browser.served(loop, ("a notice",)) as server:
            page = live_browser.open_page(browser, server.url)
            try:
                done, failed = live_browser.exercise(page), ""
            except AssertionError as error:
                done, failed = [], str(error)
            wrong = page.errors + page.outside
    yield Goal(
        "every control of the page, used by a browser",
        failed or f"{len(done)} work; {len(wrong)} errors or requests to other places",
        "all, 0",
        bool(done) and not wrong,
        (", ".join(done),),
    )


def _costs(paced: dict[str, float], free: dict[str, float], who: str) -> Iterator[Goal]:
    rate = paced["shown"] / paced["seconds"]
    loop = paced["loop"] / max(paced["frames"], 1)
    own = 1e3 * (paced["picture"] + paced["steady"] / _FPS + loop)
    work = 1e3 * free["session"] + own
    yield Goal(
        f"pictures that {who} shows, of a source of {_FPS} a second, 640x480, default plan",
        f"{rate:.1f} a second ({paced['frames'] / paced['seconds']:.1f} processed); as fast as it can: "
        f"{free['shown'] / free['seconds']:.1f} ({free['frames'] / free['seconds']:.1f})",
        "30 a second, less 2",
        rate >= _FPS - 2,
        (f"on this machine as busy as it is: the yardstick takes {1e3 * yardstick_seconds():.1f} ms",),
    )
    yield Goal(
        "processor time of a picture: session (all its threads, median) and page",
        f"{1e3 * paced['session']:.1f} + {own:.2f} ms paced; {1e3 * free['session']:.1f} as fast as it can",
        "33 ms together",
        work <= 1e3 / _FPS,
    )
    yield Goal(
        f"the page's own: a picture's request and JPEG; map, shadow and numbers at {_FPS} pictures a second; the loop",
        f"{1e3 * paced['picture']:.2f} + {1e3 * paced['steady'] / _FPS:.2f} + {1e3 * loop:.2f} ms",
        "3 ms together",
        own <= 3,
    )
