"""The same work on many recordings or maps: in several processes, on several machines, resumed where it broke off.

A function makes one result from one item, as a file or a folder at a path that it is given:

    def light(recording, path):  # at the top of a module, so that other processes find it
        fastibl.export_light(fastibl.read_environment(recording), path)

    if __name__ == "__main__":
        summary = fastibl.batch.run(light, sorted(Path("maps").glob("*.hdr")), "lights")
        print(summary)

- A result appears in the folder `out` whole or not at all: it is written elsewhere, and renamed when the function has
  returned. Items whose result is there are done: a run that is started again after an error, a power cut or kill -9
  does only the rest. To do an item again, delete its result.
- An item that raises does not stop the others. The summary says which failed and why, and how long everything took; it
  is also written to out/summary.json.
- By default, processes of this machine do the work. For other machines, use any executor with `submit`: with Dask (`pip
  install distributed`), `executor=dask.distributed.Client("scheduler:8786")`, with `out` a folder that all of them
  share.

Only one run at a time may work on one `out`: another one is refused.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import time
import traceback
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import parent_process
from operator import index
from pathlib import Path
from typing import IO, Any, SupportsIndex

from ._fastibl import set_threads
from ._fastibl import threads as threads_now
from .expected import expect

_UNFINISHED = ".unfinished"  # folder in `out` for results that are being written
_SUMMARY = "summary.json"
_LOCK = ".running"  # held by the run that works on `out`


@dataclass(frozen=True)
class Item:
    """The outcome of one item.

    name: name of its result in `out`. state: "done"; "kept", if an earlier run had done it; "failed". seconds: time
    taken by the function, 0 if kept. error: the last line of what it raised, "" if nothing; trace: all of it.
    """

    name: str
    state: str
    seconds: float = 0.0
    error: str = ""
    trace: str = ""


@dataclass(frozen=True)
class Summary:
    """The outcome of a run's items, in their order; seconds: time of the whole run. print() shows the summary."""

    items: tuple[Item, ...]
    seconds: float

    def of(self, state: str) -> list[Item]:
        """Items in this state: "done", "kept" or "failed"."""
        return [item for item in self.items if item.state == state]

    @property
    def failed(self) -> list[Item]:
        """Items whose function raised; their `error` says what."""
        return self.of("failed")

    def __str__(self) -> str:
        done = self.of("done")
        lines = [
            f"{len(done)} done, {len(self.of('kept'))} kept, {len(self.failed)} failed in {self.seconds:.1f} s"
            + (f"; {sum(i.seconds for i in done) / len(done):.2f} s an item" if done else "")
        ]
        lines += [f"  {item.name}: {item.error} (after {item.seconds:.1f} s)" for item in self.failed]
        return "\n".join(lines)


def run(
    function: Callable[[Any, Path], object],
    items: Iterable[Any],
    out: str | os.PathLike[str],
    *,
    suffix: str = "",
    name: Callable[[Any], str] | None = None,
    workers: int | None = None,
    executor: Any = None,
    threads: int | None = None,
    progress: bool = True,
) -> Summary:
    """Calls function(item, path) for every item without a result in the folder `out`.

    function: writes a file or a folder at `path`, whose ending is that of the result; the function and the items go to
    other processes by pickle.
    name: function from an item to the name of its result; by default the item's file name without its ending, or
    str(item), and `suffix`.
    workers: number of processes (default: one per core), where no executor is given.
    executor: anything with submit(function, *arguments) whose futures have add_done_callback and result.
    threads: number of fastibl's threads in each call; by default the cores are shared among the workers, and other
    executors' threads are left alone.
    progress: whether to show a bar.

    Raises ValueError for two items with the same name, a name that is not a file name, or fewer than one worker or
    thread; TypeError for one path instead of items, and for what is not an executor; RuntimeError where another run is
    working on `out`. What items raise is in the summary.
    """
    for number, what in ((workers, "workers"), (threads, "threads")):
        expect(number, (SupportsIndex, type(None)), what)
        if number is not None and index(number) < 1:
            raise ValueError(f"{what} must be at least 1, got {number}")
    if isinstance(items, (str, bytes, os.PathLike)):
        raise TypeError(f"items must be a list or another iterable, got {items!r}: [{items!r}] is a list of it")
    out, items = Path(out), list(items)
    names = _names(items, name or _name_of, suffix)
    if executor is not None and not hasattr(executor, "submit"):
        raise TypeError(f"an executor needs submit(function, *arguments), got {type(executor).__name__}")
    out.mkdir(parents=True, exist_ok=True)
    with _alone(out):
        return _run(function, dict(zip(names, items, strict=True)), out, executor, workers, threads, progress)


def _run(
    function: Callable[[Any, Path], object],
    items: dict[str, Any],
    out: Path,
    executor: Any,
    workers: int | None,
    threads: int | None,
    progress: bool,
) -> Summary:
    """The same for items by the names of their results."""
    shutil.rmtree(out / _UNFINISHED, ignore_errors=True)  # left by a run that was killed
    begin = time.perf_counter()
    results = {n: Item(n, "kept") for n in items if (out / n).exists()}
    todo = {n: item for n, item in items.items() if n not in results}
    before = threads_now()
    try:
        with _bar(len(items), len(results), progress) as bar:
            for item in _every(executor, workers, function, todo, out.absolute(), threads):
                results[item.name] = item
                bar.update()
                if item.error:
                    bar.write(f"{item.name}: {item.error}")
    finally:
        set_threads(before)  # items that ran in this process changed the number of threads
    summary = Summary(tuple(results[n] for n in items), time.perf_counter() - begin)
    shutil.rmtree(out / _UNFINISHED, ignore_errors=True)
    _write_summary(out, summary)
    return summary


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Raises RuntimeError where another run works on `out`. Nothing is checked where files cannot be locked."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    while True:
        with open(out / _LOCK, "a") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise RuntimeError(f"another run is working on {out}; only one at a time may") from None
            except OSError:  # a shared folder without locks
                pass
            if not _is_open(out / _LOCK, file):  # a run that ended has just removed it
                continue
            try:
                yield
            finally:
                (out / _LOCK).unlink(missing_ok=True)
            return


def _is_open(path: Path, file: IO[str]) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def _name_of(item: Any) -> str:
    return Path(item).stem if isinstance(item, (str, os.PathLike)) else str(item)


def _names(items: list[Any], name: Callable[[Any], str], suffix: str) -> list[str]:
    names: dict[str, Any] = {}
    for item in items:
        n = name(item) + suffix
        if n in ("", ".", "..", _UNFINISHED, _SUMMARY, _LOCK) or Path(n).name != n:
            raise ValueError(f"{n!r}, the name of the result of {item!r}, is no name of a file")
        if n in names:
            raise ValueError(f"{names[n]!r} and {item!r} would both give {n}; tell them apart with name=")
        names[n] = item
    return list(names)


@contextmanager
def _executor(given: Any, workers: int | None, count: int) -> Iterator[tuple[Any, int | None]]:
    """Gives the executor that runs the items, and how many threads of fastibl each item may use."""
    if given is not None:
        yield given, None
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = max(1, min(workers or cores, count))
    # New processes are spawned: a fork would copy locks that threads of this process hold.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_end_with_parent) as pool:
        yield pool, max(1, cores // workers)


def _end_with_parent() -> None:
    """Ends this worker when the run is killed. A killed run does not tell its workers, and they would wait for work for
    ever."""
    import multiprocessing
    import threading

    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _bar(total: int, initial: int, shown: bool) -> Iterator[Any]:
    from tqdm import tqdm

    with tqdm(total=total, initial=initial, unit="item", disable=not shown) as bar:
        yield bar


def _every(
    executor: Any, workers: int | None, function: Callable[[Any, Path], object], todo: dict[str, Any], out: Path,
    threads: int | None,
) -> Iterator[Item]:  # fmt: skip
    """Gives all items. A process that is killed takes its whole pool with it: the items that it may have been working
    on then run alone, one after the other, to find the one that caused it; all other items go to a new pool."""
    left, hopeful = dict(todo), executor is None
    while left:
        lost: list[str] = []
        before = len(left)
        with _executor(executor, workers, before) as (runner, share):
            for item in _finished(runner, function, dict(left), out, threads or share, lost if hopeful else None):
                del left[item.name]
                yield item
        hopeful = bool(lost) or len(left) < before  # otherwise not even one process starts
        for name in lost:
            with _executor(None, 1, 1) as (runner, _):
                yield from _finished(runner, function, {name: left.pop(name)}, out, threads or share, None)


def _finished(
    runner: Any, function: Callable[[Any, Path], object], todo: dict[str, Any], out: Path, threads: int | None,
    lost: list[str] | None,
) -> Iterator[Item]:  # fmt: skip
    """Gives items as they come back, from futures of any kind. lost: gets the names of items that may have ended their
    process. Neither these nor the other items that were lost with it are given. None: all of them are given as
    failed."""
    from concurrent.futures.process import BrokenProcessPool

    back: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()
    futures, begun = [], {}
    try:
        for n, item in todo.items():
            # Each attempt has its own folder name: an executor that caches calls must not answer with an earlier
            # failure.
            part = out / _UNFINISHED / uuid.uuid4().hex[:12] / n
            begun[n] = _mark(part)
            try:
                future = runner.submit(_attempt, function, item, part, out / n, threads)
            except Exception as broke:  # the pool is broken; the futures submitted before report it
                if lost is None:
                    yield Item(n, "failed", 0.0, _last_line(broke))
                continue
            futures.append(future)
            future.add_done_callback(lambda done, n=n: back.put((n, done)))
        for _ in range(len(futures)):
            n, future = back.get()
            try:
                seconds, error, trace = future.result()
            except BrokenProcessPool as broke:
                if lost is not None:
                    if begun[n].exists():
                        lost.append(n)
                    continue
                seconds, error, trace = 0.0, _last_line(broke), ""
            except Exception as broke:  # its process was killed, or the item cannot be sent there
                seconds, error, trace = 0.0, _last_line(broke), ""
            yield Item(n, "failed" if error else "done", seconds, error, trace)
    except BaseException:
        for future in futures:
            future.cancel()
        raise


def _attempt(
    function: Callable[[Any, Path], object], item: Any, part: Path, final: Path, threads: int | None
) -> tuple[float, str, str]:
    """Runs where the executor runs it. Returns the seconds it took, and what was raised."""
    begin = time.perf_counter()
    error = trace = ""
    # A Ctrl-C that the user pressed reaches the parent process, too.
    failures = (Exception, SystemExit, *((KeyboardInterrupt,) if parent_process() is not None else ()))
    try:
        part.parent.mkdir(parents=True, exist_ok=True)
        _mark(part).touch()
        if threads is not None:
            set_threads(threads)
        function(item, part)
        if not part.exists():
            raise FileNotFoundError("the function returned without writing a file or folder at its path")
        beside = sorted(path.name for path in part.parent.iterdir() if path != part)
        if beside:
            raise FileExistsError(
                f"the function wrote {', '.join(beside)} beside {part.name}: what belongs together is written into a "
                "folder of that name, with suffix=''"
            )
        _sync(part)
        os.replace(part, final)
    except failures as raised:  # the summary reports it
        error, trace = _last_line(raised), traceback.format_exc()
    _remove(part.parent)
    _mark(part).unlink(missing_ok=True)
    return time.perf_counter() - begin, error, trace


def _mark(part: Path) -> Path:
    """The path of a file that exists while an item is worked on."""
    return part.parent.with_name(f"{part.parent.name}.begun")


def _last_line(error: BaseException) -> str:
    """Of what is said without a traceback and without notes; never empty, because it names the exception."""
    said = traceback.TracebackException.from_exception(error)
    if hasattr(said, "__notes__"):
        said.__notes__ = None
    return list(said.format_exception_only())[-1].strip()


def _sync(part: Path) -> None:
    """Writes the content to disk before the result gets its name, so that a machine that stops leaves no empty
    result."""
    for path in [part, *part.rglob("*")] if part.is_dir() else [part]:
        if path.is_file():
            with open(path, "rb") as file:
                os.fsync(file.fileno())


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _write_summary(out: Path, summary: Summary) -> None:
    part = out / f".{_SUMMARY}"
    part.write_text(json.dumps(asdict(summary), indent=1) + "\n", encoding="utf-8")
    os.replace(part, out / _SUMMARY)
