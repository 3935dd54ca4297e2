"""The loop of a live session. Only the loop touches the session: it takes changes from a queue and gives snapshots."""

from __future__ import annotations

import queue
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._fastibl import FrameResult, Material, Pose, Scene
from ..calibration.guess import LensSearch
from ..guessed_rig import degrees_across, with_back
from ..live import Played, play
from ..recorder import Recorder
from ..recording import Frame, RecordingWarning
from ..session import Session, bake_shadow
from .choices import OWN, Choices
from .snapshot import Latest, Snapshot

_WINDOW = 1.0  # seconds over which the frame rate is counted
_TIMINGS = 30  # frames whose timings are shown
_MESSAGES = 20  # messages that are kept
_WAITING = 64  # changes that may wait in the queue
_SLOW = 0.15  # seconds from which on a frame counts as slow
_SLOW_FRAMES = 5  # slow frames in a row before time is limited
_QUICK_ENOUGH = 50.0  # milliseconds a frame may then take
_PAUSE = 0.1  # seconds without a picture after which changes are looked for
_LATE = 1.5  # seconds without a back picture after which the page says that it waits
_SAME_LENS = 0.01  # relative difference of focal lengths for which nothing begins anew
_WAITING_FOR = "no new picture comes; it goes on by itself when one does"


@dataclass(frozen=True)
class Settings:
    """The state of the controls. error: that of the picture; milliseconds: those of a frame; 0 for none. turn:
    degrees."""

    object: str
    material: str = OWN
    methods: Mapping[str, str] | str = "auto"
    backend: str = "cpu"
    error: float = 0.02
    milliseconds: float = 0.0
    shadow: bool = True
    turn: float = 0.0
    freeze: bool = False


@dataclass(frozen=True)
class _Object:
    """An object that is ready to show. Making its scene takes seconds, so it is made in another thread than the
    loop's."""

    name: str
    own: Material
    scene: Scene


def _turned(degrees: float) -> Pose:
    return Pose.from_rotation_vector([0.0, 0.0, np.radians(degrees)], [0.0, 0.0, 0.0])


class LiveLoop:
    """Runs a source through a session and shows it as snapshots in `latest`.

    source: gives Frames; iterated again, it begins again. Where it has wait(seconds), as CameraSource does, changes are
    applied while no pictures come. choices: what may be changed. settings: those to begin with.
    options: more options of Session (environment, distance, ...). folder: where recordings go. about: the source in
    words, or a function that gives them. after_frame: called in the loop's thread, with the session and what it made of
    each frame. log: called with each message. watched: whether a person looks on; if so, frames that take long to keep
    to their error get a time budget. lens: finds that of a back camera that was guessed; light is then captured anew.
    """

    def __init__(
        self,
        source: Any,
        choices: Choices,
        settings: Settings,
        options: Mapping[str, Any] | None = None,
        *,
        folder: Path = Path(),
        about: str | Callable[[], str] = "",
        after_frame: Callable[[Session, Played], None] | None = None,
        log: Callable[[str], None] = lambda line: None,
        watched: bool = True,
        lens: LensSearch | None = None,
    ):
        self.source, self.choices, self.folder = source, choices, folder
        self._options, self._after_frame, self._log = dict(options or {}), after_frame, log
        self._settings, self._watched, self._lens = settings, watched, lens
        self._about = about if callable(about) else lambda: about
        self._queue: queue.Queue[Mapping[str, Any]] = queue.Queue(_WAITING)
        self._stopping = threading.Event()
        self._restarting = False
        self._steps = 0
        self._wanted = ""  # object that was asked for but is not ready yet
        self._recorder: Recorder | None = None
        self._closing: threading.Thread | None = None
        self._again: Played | None = None  # the last frame with a back picture, to show changes while no new one comes
        self._time = 0.0  # of the last frame that the session processed
        self._times: deque[float] = deque()
        self._timings: deque[Mapping[str, float]] = deque(maxlen=_TIMINGS)
        self._messages: deque[tuple[int, str]] = deque(maxlen=_MESSAGES)
        self._said = 0
        self._saying = threading.Lock()
        self._object = self._load(settings.object)
        self._session = self._make_session()
        self.frames = 0  # frames that were processed
        self._slow, self._hurried = 0, False  # slow frames in a row; whether time was limited because of them
        self.latest = Latest(Snapshot(source.rig, source.board, settings=settings, source=self._about()))

    # For other threads.

    def change(self, changes: Mapping[str, Any]) -> bool:
        """Asks for changes that Choices.read has checked. Returns False, and changes nothing, where too many wait
        already."""
        try:
            self._queue.put_nowait(changes)
        except queue.Full:
            return False
        return True

    def say(self, text: str) -> None:
        """Shows a message."""
        with self._saying:
            self._said += 1
            self._messages.append((self._said, text))
        self._log(text)

    def stop(self) -> None:
        """Ends run() after the current frame."""
        self._stopping.set()
        if hasattr(self.source, "close"):
            self.source.close()

    # The loop's own thread.

    def run(self, until_end: bool = False) -> None:
        """Runs until stop(), or until cameras gave no picture for their source's patience. When another source has
        ended, it waits for changes, or returns if `until_end`."""
        with warnings.catch_warnings():
            warnings.simplefilter("always", RecordingWarning)
            shown = warnings.showwarning
            warnings.showwarning = lambda message, category, *rest: (
                self.say(str(message)) if issubclass(category, RecordingWarning) else shown(message, category, *rest)
            )
            self._run(until_end)

    def _run(self, until_end: bool) -> None:
        try:
            while not self._stopping.is_set():
                self._restarting = False
                reason = self._play()
                if self._stopping.is_set() or (until_end and not self._restarting):
                    return
                if not self._restarting:
                    self._show(state="ended", reason=reason)
                    if getattr(self.source, "gave_up", False):
                        return
                    self._wait_for(lambda: self._restarting)
                if self._restarting:
                    self._session, self._again = self._make_session(), None
                    self._timings.clear()
        finally:
            self._end_recording()
            if self._closing is not None:
                self._closing.join()
            self.latest.close()

    def _play(self) -> str:
        """Processes the source's frames from its beginning; returns why they ended."""
        frames = play(self._session, self.source)
        self._show(state="frozen" if self._settings.freeze else "waiting", reason="", fps=0.0)
        wait = getattr(self.source, "wait", lambda seconds: True)
        while True:
            changed = self._apply_waiting()
            if self._settings.freeze and not self._steps:
                self._show(state="frozen", fps=0.0)
                self._times.clear()
                self._wait_for(lambda: not self._settings.freeze or self._steps or self._restarting)
            if self._stopping.is_set() or self._restarting:
                frames.close()
                return ""
            if not wait(_PAUSE):
                self._show_waiting(changed)
                continue
            try:
                played = next(frames, None)
            except (OSError, ValueError, TypeError, LookupError) as error:
                self.say(f"the source failed: {error}")
                return str(error)
            if played is None:
                given_up = getattr(self.source, "gave_up", False)
                return f"no picture came for {self.source.patience:g} s" if given_up else "no more pictures come"
            if played.frame.back is not None:  # a front picture alone has nothing to show
                self._steps = max(0, self._steps - 1)
            self._take(played)
            if changed and played.frame.back is None and self._again is not None:
                self._process_again(self._again)  # the back camera may be away

    def _show_waiting(self, changed: bool) -> None:
        """Shows that pictures are waited for, and the last one with what was changed since."""
        now, again = self.latest.get(), self._again
        if changed and again is not None:
            self._process_again(again)
        if now.state != "frozen" and not now.reason and self._late():
            self._times.clear()
            self._show(state="waiting", reason=_WAITING_FOR, fps=0.0)
        elif changed or now.messages != tuple(self._messages):
            self._show()

    def _late(self) -> bool:
        return time.monotonic() - self.latest.get().made > _LATE

    def _take(self, played: Played) -> None:
        result = played.result
        if self._recorder is not None:
            self._record(self._recorder, played)
        changes: dict[str, Any] = {"left_out": "; ".join(f"{k}: {why}" for k, why in played.refused.items())}
        if result is not None:
            self.frames += 1
            self._time = played.frame.time
            now = time.monotonic()
            self._times.append(now)
            while now - self._times[0] > _WINDOW:
                self._times.popleft()
            self._timings.append(result.timings)
            self._watch_time(result.timings["total"])
            changes |= self._pictures(played) | {"timings": tuple(self._timings), "fps": self._fps(now)}
            if played.frame.back is not None:
                changes["made"] = now
                self._search_lens(played.frame, result)
        late = "made" not in changes and self._late()  # the front camera goes on alone
        state = "frozen" if self._settings.freeze else "waiting" if late else "running"
        self._show(state=state, reason=_WAITING_FOR if state == "waiting" else "", **changes)
        if self._after_frame is not None:
            self._after_frame(self._session, played)

    def _search_lens(self, frame: Frame, result: FrameResult) -> None:
        """Begins anew with the lens that the board shows, but not amid a recording, which has one lens."""
        pose = result.back_from_marker
        if self._lens is None or pose is None or self._recorder is not None or frame.back is None:
            return
        found = self._lens.add(frame.back, pose, frame.time)
        if found is None:
            return
        (camera, deviation), usual = found, self._lens.usual
        self._lens = None
        angle = f"{degrees_across(camera):.0f}° wide (within {100 * deviation:.1f} %)"
        shows = f"the board shows that the back camera's lens is {angle}"
        if abs(camera.fx / usual.fx - 1) < _SAME_LENS:
            self.say(f"{shows}, as was taken")
            return
        self.say(f"{shows}, where {degrees_across(usual):.0f}° was taken: light is captured anew with it")
        self.source.rig = with_back(self.source.rig, camera)
        self._restarting = True

    def _watch_time(self, seconds: float) -> None:
        """Limits the time of frames for a person who looks on and set no time: a mirror within 2 % may take most of a
        second."""
        if self._settings.milliseconds or not self._settings.error or not self._watched:
            return
        self._slow = self._slow + 1 if seconds > _SLOW else 0
        if self._slow < _SLOW_FRAMES or self._hurried:
            return
        self._hurried = True  # only once: a person who then switches the limit off keeps it off
        self._set_milliseconds(_QUICK_ENOUGH)
        self.say(
            f"{1000 * seconds:.0f} ms a frame for {100 * self._settings.error:g} %: methods are now chosen for "
            f"{_QUICK_ENOUGH:g} ms"
        )

    def _fps(self, now: float) -> float:
        span = now - self._times[0]
        return (len(self._times) - 1) / span if span > 0 else 0.0

    def _pictures(self, played: Played) -> dict[str, Any]:
        changes: dict[str, Any] = {"given": self._options.get("environment") is not None}
        changes["taken"] = self.latest.get().taken + 1
        # A front picture after a change is of no map yet.
        if self.latest.get().newest is None or (played.result is not None and played.result.environment is not None):
            changes["newest"] = played.result
        if played.frame.front is not None:
            changes["front"] = played.frame.front
        if played.frame.back is not None:
            self._again = played
            number = self.latest.get().picture + 1
            changes |= {"frame": played.frame, "result": played.result, "picture": number}
        return changes

    def _show(self, **changes: Any) -> None:
        recorder = self._recorder
        recording = None if recorder is None else (str(recorder.path), recorder.written, recorder.dropped)
        with self._saying:
            messages = tuple(self._messages)
        self.latest.publish(
            messages=messages,
            recording=recording,
            settings=self._settings,
            rig=self.source.rig,
            source=self._about(),
            dropped=int(getattr(self.source, "dropped", 0)),
            **changes,
        )

    def _wait_for(self, condition: Callable[[], object]) -> None:
        """Applies changes as they come, and processes the last frame again if they change its picture."""
        while not condition() and not self._stopping.is_set():
            try:
                first = self._queue.get(timeout=0.1)
            except queue.Empty:
                if self.latest.get().messages != tuple(self._messages):
                    self._show()
                continue
            changed = self._apply(first)
            changed |= self._apply_waiting()
            if changed and self._again is not None and not condition():
                self._process_again(self._again)
            else:
                self._show()

    def _process_again(self, played: Played) -> None:
        """Processes the last picture once more, in the light captured by now: a picture counts only once."""
        frame = replace(played.frame, front=None, time=self._time)  # front pictures may have come since
        newest = self.latest.get().newest
        captured = None if newest is None or self._options.get("environment") else newest.environment
        try:
            if captured is not None:
                self._session.set_environment(captured)
            result = self._session.process(frame)
        except (ValueError, TypeError) as error:
            self.say(str(error))
            return
        finally:
            if captured is not None:
                self._session.set_environment(None)
        self._timings.append(result.timings)
        self._show(**self._pictures(Played(played.frame, result, {})), timings=tuple(self._timings))

    # Changes.

    def _apply_waiting(self) -> bool:
        changed = False
        while True:
            try:
                change = self._queue.get_nowait()
            except queue.Empty:
                return changed
            changed |= self._apply(change)

    def _apply(self, changes: Mapping[str, Any]) -> bool:
        """Applies changes; returns whether they change the picture."""
        changed = False
        for name, value in changes.items():
            try:
                changed |= bool(getattr(self, f"_set_{name}")(value))
            except (OSError, ValueError, TypeError, RuntimeError) as error:
                self.say(f"{name.strip('_')}: {error}")
        return changed

    def _note(self, **settings: Any) -> None:
        self._settings = replace(self._settings, **settings)

    def _set_freeze(self, value: bool) -> None:
        self._note(freeze=value)
        self._steps = 0

    def _set_step(self, value: bool) -> None:
        self._note(freeze=True)
        self._steps += 1

    def _set_restart(self, value: bool) -> None:
        if not getattr(self.source, "live", False):
            self._end_recording()  # the source's times begin again
        self._restarting = True
        self._options.pop("prior", None)  # light of earlier is forgotten, too
        self._note(freeze=False)

    def _set_shadow(self, value: bool) -> bool:
        self._session.set_cast_shadow(value)
        self._note(shadow=value)
        return True

    def _set_turn(self, value: float) -> bool:
        self._session.move(_turned(value))
        self._note(turn=value)
        return True

    def _set_material(self, value: str) -> bool:
        self._session.set_material(self._material(value))
        self._note(material=value)
        return True

    def _set_methods(self, value: Mapping[str, str] | str) -> bool:
        now = self._settings.methods
        if isinstance(value, Mapping) and isinstance(now, Mapping):
            value = {**now, **value}
        self._session.set_methods(value)
        self._note(methods=value)
        return True

    def _set_error(self, value: float) -> bool:
        self._session.set_budgets(value, self._settings.milliseconds)
        self._note(error=value)
        return True

    def _set_milliseconds(self, value: float) -> bool:
        self._session.set_budgets(self._settings.error, value)
        self._note(milliseconds=value)
        return True

    def _set_backend(self, value: str) -> bool:
        self._session.set_backend(value)
        self._note(backend=value)
        return True

    def _set_object(self, value: str) -> None:
        """Prepares the object in a thread, and takes it through the queue. One is prepared at a time; next comes the
        last one asked for."""
        idle, self._wanted = not self._wanted, value
        if idle:
            self._prepare(value)

    def _prepare(self, name: str) -> None:
        self._show(preparing=name)

        def prepare() -> None:
            try:
                made = self._load(name)
            except Exception as error:  # noqa: BLE001 - files and their readers raise what they like
                self._queue.put({"_failed": (name, error)})
            else:
                self._queue.put({"_ready": made})

        threading.Thread(target=prepare, name="fastibl object", daemon=True).start()

    def _set__failed(self, value: tuple[str, Exception]) -> None:
        name, error = value
        self.say(f"{name}: {error}")
        self._prepared(name)

    def _set__ready(self, made: _Object) -> bool:
        if not self._prepared(made.name):
            return False
        self._session.set_scene(made.scene)
        self._object = made
        self._dress(self._session)
        self._note(object=made.name)
        return True

    def _prepared(self, name: str) -> bool:
        """Whether this is still the object that was asked for last; if not, preparing that one begins."""
        wanted, self._wanted = self._wanted, ""
        if wanted == name:
            self._show(preparing="")
            return True
        self._set_object(wanted)
        return False

    def _material(self, name: str) -> Material:
        return self._object.own if name == OWN else self.choices.materials[name]

    # What sessions are made of.

    def _load(self, name: str) -> _Object:
        """Makes an object ready; takes seconds for one that no session had yet."""
        mesh, own = self.choices.mesh(name)
        scene = Scene(mesh, own)
        bake_shadow(scene)
        return _Object(name, own, scene)

    def _make_session(self) -> Session:
        s = self._settings
        session = Session(
            self._object.scene,
            self.source.rig,
            self.source.board,
            error=s.error,
            milliseconds=s.milliseconds,
            methods=s.methods,
            backend=s.backend,
            cast_shadow=s.shadow,
            **self._options,
        )
        self._dress(session)
        return session

    def _dress(self, session: Session) -> None:
        """Gives the session's object what the controls say of it."""
        if self._settings.material != OWN:
            session.set_material(self._material(self._settings.material))
        if self._settings.turn:
            session.move(_turned(self._settings.turn))

    # Recordings.

    def _set_record(self, value: bool) -> None:
        if not value:
            return self._end_recording()
        if self._recorder is None:
            path = free_path(self.folder, time.strftime("recording-%Y%m%d-%H%M%S"))
            self._recorder = Recorder(path, self.source.rig, self.source.board)
            self.say(f"recording to {path}")
        return None

    def _record(self, recorder: Recorder, played: Played) -> None:
        try:
            recorder.add(played.frame)
        except Exception as error:  # noqa: BLE001 - whatever ended it
            self.say(f"the recording ended: {error}")
            self._end_recording()

    def _end_recording(self) -> None:
        """Ends the recording; what still waits is written in a thread, while the loop goes on."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return

        def close() -> None:
            try:
                recorder.close()
            except Exception as error:  # noqa: BLE001 - a disk that is full, or gone
                self.say(f"the recording ended: {error}")
            lost = f", {recorder.dropped} dropped" if recorder.dropped else ""
            self.say(f"recorded {recorder.written} frames{lost}: {recorder.path}")

        self._closing = threading.Thread(target=close, name="fastibl recording")
        self._closing.start()


def free_path(folder: Path, name: str, names: Sequence[str] = ("",)) -> Path:
    """folder/name, with a number if that is taken. names: endings, all of which must be free."""
    for number in range(1, 10_000):
        stem = name if number == 1 else f"{name}-{number}"
        if not any((folder / f"{stem}{ending}").exists() for ending in names):
            return folder / f"{stem}{names[0]}"
    raise OSError(f"no free name for {name} in {folder}")
