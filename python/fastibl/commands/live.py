"""fastibl live: put an object before live cameras, and show it as a page."""

from __future__ import annotations

import argparse
import os
import signal
import stat
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory, mkstemp
from typing import TYPE_CHECKING, Any

from ..plain_text import tell
from ._arguments import add_cameras, add_object, parser, picture_size, positive

if TYPE_CHECKING:
    from ..live import Played
    from ..session import Session
    from ._kept_map import KeptMap
    from ._live_source import Opened

_ENDING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
_DEGREES = 65.0  # as guessed_rig.DEGREES, whose import would load NumPy


def add(commands: argparse._SubParsersAction) -> None:
    p = parser(
        commands,
        "live",
        run,
        "light an object by what live cameras see, as a page on this machine; waits for a camera that is unplugged",
        "fastibl live --simulate\n"
        "  fastibl live --back 0 --front 1 --object chair.glb\n"
        "  fastibl live --back 0 --environment room.hdr\n"
        "  fastibl live --rig rig.yaml --back 0 --front http://192.168.0.7:8080/video --out live.webm",
    )
    source = p.add_argument_group("pictures")
    add_cameras(source, patience=None)
    source.add_argument("--simulate", action="store_true", help="a virtual camera in a simulated room")
    source.add_argument("--recording", type=Path, metavar="REC", help="a recording, in its own time")
    source.add_argument("--rig", type=Path, metavar="YAML", help="calibration (default: none; angles are then guessed)")
    source.add_argument(
        "--fov",
        type=positive,
        metavar="DEG",
        help="angle across the back picture's longer side, without --rig "
        f"(default: {_DEGREES:g} until the board shows it)",
    )
    source.add_argument(
        "--front-fov",
        type=positive,
        default=_DEGREES,
        metavar="DEG",
        help="the same of the front picture (default: %(default)g)",
    )
    source.add_argument("--size", type=picture_size, default=(640, 480), metavar="WxH", help="without --rig")
    _add_light(p.add_argument_group("light"))
    add_object(p, several=True)
    p.add_argument(
        "--error", type=float, default=2.0, metavar="%", help="budget of the picture's error, 0 for none (default: 2)"
    )
    p.add_argument(
        "--milliseconds", type=float, default=0.0, metavar="MS", help="budget of a frame's time, 0 for none (default)"
    )
    out = p.add_argument_group("what comes out")
    out.add_argument("--port", type=int, default=0, help="of the page (default: a free one)")
    out.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="file with the secret of the page's address, 16 random characters or more, so that the address stays "
        "(default: a new one each time); not given as an argument, because other users can read those",
    )
    out.add_argument("--open", action="store_true", help="open the page in a browser")
    out.add_argument(
        "--folder", type=Path, default=Path(), help="of the page's recordings and pictures (default: this one)"
    )
    out.add_argument("--no-page", action="store_true", help="only write the video")
    out.add_argument(
        "--out", type=Path, metavar="WEBM", help="video to write (default: none; live.webm with --no-page)"
    )
    out.add_argument("--fps", type=positive, default=30.0, help="of the video (default: 30)")


def _add_light(p: argparse._ArgumentGroup) -> None:
    p.add_argument(
        "--environment",
        type=Path,
        metavar="HDR",
        help="light of the place as a map, instead of capturing it; with --simulate the place",
    )
    p.add_argument(
        "--keep",
        type=Path,
        metavar="KTX2",
        help="file that keeps the captured light for the next start: read where it is there, and written every 5 "
        "minutes and at the end",
    )
    p.add_argument("--exposures", choices=("adaptive", "bracket", "constant"), default="adaptive", help="of the front")
    p.add_argument(
        "--flicker",
        type=float,
        default=0.0,
        metavar="HZ",
        help="of the lamps, 100 or 120: adaptive exposures last whole periods where they can (default: 0)",
    )
    p.add_argument(
        "--most-boost",
        type=positive,
        metavar="FACTOR",
        help="most that light that clips in the shortest exposure is made brighter by the board's white (default: "
        "10000 with several exposures, 1 with one)",
    )


def run(arguments: argparse.Namespace) -> int:
    with _Ending() as ending:
        return _run(arguments, ending)


def _run(arguments: argparse.Namespace, ending: _Ending) -> int:
    from ..live_page import Choices, LiveLoop, PageServer, Settings
    from ..sources import close
    from ._live_source import open_source

    if not 0 <= arguments.port < 1 << 16:
        raise ValueError(f"--port must be from 0 to 65535, got {arguments.port}")
    for name in ("port", "open", "token_file"):
        if arguments.no_page and getattr(arguments, name):
            raise ValueError(f"--{name.replace('_', '-')} is of the page, and with --no-page there is none")
    token = _token_of(arguments.token_file)
    choices = Choices(arguments.object or (), arguments.up, arguments.height)
    settings = Settings(
        choices.objects[0],
        methods=arguments.methods,
        backend="cpu" if arguments.backend == "auto" else arguments.backend,
        error=arguments.error / 100,
        milliseconds=arguments.milliseconds,
    )
    log = _Log()
    opened = open_source(arguments, log)
    for notice in opened.notices:
        tell(notice.replace("`", ""))
    with ExitStack() as stack:
        stack.callback(close, opened.source)
        given = _given_light(arguments)
        kept = None if arguments.keep is None else stack.enter_context(_kept(arguments.keep, given, log))
        watch = _Watch(arguments, opened, stack, given, log)
        arguments.folder.mkdir(parents=True, exist_ok=True)
        loop = LiveLoop(
            opened.source,
            choices,
            settings,
            _session_options(arguments, given, kept),
            folder=arguments.folder.resolve(),
            about=opened.about,
            after_frame=watch.take,
            log=tell,
            watched=not arguments.no_page,
            lens=opened.lens,
        )
        log.to, watch.loop, watch.kept, ending.loop = loop.say, loop, kept, loop
        if not arguments.no_page:
            server = PageServer(loop, arguments.port, notices=tuple(opened.notices), token=token)
            stack.enter_context(server)
            print(f"\n  {server.url}\n\nThe page is for this machine alone. Ctrl-C ends.", flush=True)
            if arguments.open:
                _open(server.url, stack)
        loop.run(until_end=arguments.no_page)
    return watch.conclude(ending.by)


class _Log:
    """Takes the cameras' messages, at first for the terminal alone, later for the page, too."""

    def __init__(self) -> None:
        self.to: Callable[[str], None] = tell

    def __call__(self, line: str) -> None:
        self.to(line)


def _token_of(path: Path | None) -> str | None:
    """The token in a file. Raises ValueError for one that could be guessed."""
    from ..live_page.server import check_token

    if path is None:
        return None
    if os.name == "posix" and path.stat().st_mode & stat.S_IROTH:
        tell(f"every user of this machine can read the token in {path}: chmod o-r {path}")
    try:
        return check_token(path.read_text("utf-8").strip())
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _given_light(arguments: argparse.Namespace) -> Any:
    """The file's CubeMap, or None where the light is captured."""
    from ..environment_files import read_environment

    given = arguments.environment is not None and not arguments.simulate
    return read_environment(arguments.environment) if given else None


def _kept(path: Path, given: Any, log: _Log) -> KeptMap:
    from ._kept_map import KeptMap

    if given is not None:
        raise ValueError("--keep is of captured light; with --environment it is given: leave one away")
    return KeptMap(path, log)


def _session_options(arguments: argparse.Namespace, given: Any, kept: KeptMap | None) -> dict[str, Any]:
    return {
        "distance": arguments.distance,
        "most_boost": arguments.most_boost,
        "environment": given,
        "prior": None if kept is None else kept.prior,
    }


def _open(url: str, stack: ExitStack) -> None:
    """Opens a browser by a file that leads to the page and exists until the stack ends. Every user of the machine can
    read a browser's arguments, but only the user whose page it is can read this file."""
    import webbrowser

    folder = stack.enter_context(TemporaryDirectory(prefix="fastibl-", ignore_cleanup_errors=True))
    descriptor, name = mkstemp(".html", "live-", folder)  # of mode 0600
    with open(descriptor, "w", encoding="utf-8") as file:
        file.write(
            f'<!doctype html><meta http-equiv="refresh" content="0;url={url}"><a href="{url}">fastibl live</a>\n'
        )
    webbrowser.open(Path(name).as_uri())


class _Ending:
    """Makes Ctrl-C, SIGTERM and SIGHUP end the loop after the current frame, so that what is written stays whole, and
    the program where there is no loop yet. A second Ctrl-C does not wait. A context manager.

    by: the signal that came, if one did.
    """

    def __init__(self) -> None:
        self.by: int | None = None
        self.loop: Any = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> _Ending:
        if threading.current_thread() is threading.main_thread():
            for number in _ENDING:
                if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:  # as by nohup
                    self._before[number] = signal.signal(number, self._end)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _end(self, number: int, _: Any) -> None:
        self.by = number
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if self.loop is not None:
            # Not in this thread: the loop, which is interrupted for this handler, may hold the locks of its cameras.
            threading.Thread(target=self.loop.stop, daemon=True).start()
        elif number == signal.SIGINT:
            raise KeyboardInterrupt
        else:
            raise SystemExit(0)


class _Watch:
    """What is done with each frame besides the page: the video, the front camera's exposures, the terminal's line."""

    def __init__(self, arguments: argparse.Namespace, opened: Opened, stack: ExitStack, given: Any, log: _Log):
        from tqdm import tqdm

        from ._live_film import LiveFilm

        self._opened, self._seconds = opened, arguments.seconds
        self._recording = arguments.recording
        self.out = arguments.out or (Path("live.webm") if arguments.no_page else None)
        self._alone = arguments.no_page  # whether the video is all that there is
        self._video = None if self.out is None else stack.enter_context(LiveFilm(self.out, arguments.fps, log))
        if self._video is not None and self._video.error is not None and self._alone:
            raise self._video.error
        self._bar = stack.enter_context(tqdm(desc="live", unit="frame", disable=None))
        self.loop: Any = None
        self.kept: KeptMap | None = None
        self._given = given  # a map of the light, if given
        self._lit: Session | None = None  # the session in which it has the brightness of this place
        self._frames = self._posed = self._refused = 0
        self._error = float("nan")
        self._end: threading.Timer | None = None

    def take(self, session: Session, played: Played) -> None:
        self._refused += bool(played.refused)
        result, source = played.result, self._opened.source
        if self._given is not None and session is not self._lit:
            self._light(session, played)
        if result is not None and self.kept is not None:
            self.kept.note(result)
        if result is not None and played.frame.back is not None:
            if self._video is not None:
                self._video.add(result.image, played.frame.time)
                if self._video.error is not None and self._alone:
                    self.loop.stop()
            pose, self._error = result.back_from_marker, result.predicted_error
            self._frames, self._posed = self._frames + 1, self._posed + (pose is not None)
            if self._opened.adaptive and pose is not None:
                self._opened.adaptive.schedule.update(session.capture, source.rig.front_from_back @ pose)
            self._bar.update()
            self._bar.set_postfix(error=f"{100 * self._error:.0f} %", dropped=self._dropped, refresh=False)
        if self._seconds is not None and self._end is None:  # a timer, because a recording may end earlier
            self._end = threading.Timer(self._seconds, self.loop.stop)
            self._end.daemon = True
            self._end.start()

    def _light(self, session: Session, played: Played) -> None:
        """Scales a given map to the brightness that the board's white has in the camera's picture."""
        from ..board_meter import brightness_of, scaled

        frame, source = played.frame, self._opened.source
        pose = None if played.result is None or frame.back is None else played.result.back_from_marker
        if pose is None or source.board is None:
            return
        factor = brightness_of(self._given, source.rig, source.board, frame, pose)
        if factor is None:
            return
        self._lit = session
        session.set_environment(scaled(self._given, factor))
        self.loop.say(f"the map's light is taken {factor:.3g} times, as the board's white shows it")

    @property
    def _dropped(self) -> int:
        return int(getattr(self._opened.source, "dropped", 0))

    def conclude(self, ended_by: int | None) -> int:
        source = self._opened.source
        gave_up = getattr(source, "gave_up", False)
        if not self._frames and not gave_up:
            if ended_by == signal.SIGINT:
                raise KeyboardInterrupt
            if ended_by is not None:
                tell("ended before the first picture")
                return 0
            if self._recording is not None:
                raise ValueError(f"{self._recording} holds no back pictures")
            raise ValueError("the back camera gave no picture")
        if self._frames:
            self._print_summary()
        if self._video is not None and self._video.error is not None and self._alone:
            raise self._video.error
        if gave_up:  # an error, for a service manager to start it again
            raise OSError(f"no picture came for {source.patience:g} s")
        return 0

    def _print_summary(self) -> None:
        print(
            ("" if self._video is None or self._video.error else f"{self.out}: ")
            + f"{self._frames} frames, board seen in {self._posed}, {self._refused} with pictures left out, "
            f"{self._dropped} pictures not asked for in time; "
            f"predicted error of the irradiance {100 * self._error:.1f} %"
        )
