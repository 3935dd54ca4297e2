"""Batches: each item once, whole or not at all, whoever runs it."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import fastibl
from fastibl import batch

ROOT = Path(__file__).resolve().parents[1]


def light_of(seed, path):
    """Irradiance in a random map; a file of bytes that depend on the seed alone."""
    faces = np.random.default_rng(seed).random((6, 8, 8, 3))
    normals = np.random.default_rng(0).normal(size=(50, 3))
    path.write_bytes(fastibl.Lighting(fastibl.CubeMap(faces)).irradiance(normals).tobytes())


def log_and_write(item, path):
    with open(path.parents[2] / "calls.log", "a") as log:
        log.write(f"{item}\n")
    path.write_text(str(item))


def sometimes(item, path):
    path.write_text("half of it")
    if item % 3 == 1:
        raise ValueError(f"{item} is bad")
    path.write_text(f"all of {item}")


def with_notes(item, path):
    error = RuntimeError("the disk broke")
    error.__notes__ = ["", "see the manual"][item:]
    raise error


def folder_of(item, path):
    path.mkdir()
    (path / "a.txt").write_text(str(item))


def slow(item, path):
    path.write_text("half of it")
    time.sleep(0.15)
    light_of(item, path)


def dies(item, path):
    path.write_text("half of it")
    if item == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    path.write_text("whole")


def always_dies(item, path):
    os.kill(os.getpid(), signal.SIGKILL)


def threads_used(item, path):
    path.write_text(str(fastibl.threads()))


def nothing(item, path):
    pass


def results(out):
    files = (p for p in Path(out).iterdir() if p.is_file() and p.name not in ("summary.json", ".running"))
    return {p.name: p.read_bytes() for p in files}


def with_threads(function, items, out, **others):
    with ThreadPoolExecutor(2) as executor:
        return batch.run(function, items, out, executor=executor, progress=False, **others)


def test_processes_do_every_item_once_and_keep_what_is_done(tmp_path):
    first = batch.run(log_and_write, range(5), tmp_path, workers=2, progress=False)
    assert [i.name for i in first.of("done")] == list("01234") and not first.failed
    (tmp_path / "3").unlink()
    again = batch.run(log_and_write, range(6), tmp_path, workers=2, progress=False)
    assert [i.state for i in again.items] == ["kept"] * 3 + ["done", "kept", "done"]
    calls = (tmp_path / "calls.log").read_text().split()
    assert sorted(calls) == sorted("0123435")
    assert not (tmp_path / ".unfinished").exists()


def test_an_item_that_fails_leaves_nothing_and_stops_nobody(tmp_path):
    summary = with_threads(sometimes, range(6), tmp_path, suffix=".txt")
    assert [i.name for i in summary.failed] == ["1.txt", "4.txt"]
    assert summary.failed[0].error == "ValueError: 1 is bad" and "in sometimes" in summary.failed[0].trace
    assert set(results(tmp_path)) == {"0.txt", "2.txt", "3.txt", "5.txt"}
    assert all(text.startswith(b"all of") for text in results(tmp_path).values())
    assert "4 done, 0 kept, 2 failed" in str(summary) and "1.txt: ValueError: 1 is bad" in str(summary)
    stored = json.loads((tmp_path / "summary.json").read_text())
    assert [i["state"] for i in stored["items"]] == [i.state for i in summary.items] and stored["seconds"] > 0
    assert all(i.seconds > 0 for i in summary.of("done"))


def test_notes_do_not_hide_what_was_raised(tmp_path):
    summary = with_threads(with_notes, range(3), tmp_path)
    assert [i.state for i in summary.items] == ["failed"] * 3
    assert {i.error for i in summary.items} == {"RuntimeError: the disk broke"}


def test_a_result_may_be_a_folder_and_must_be_there(tmp_path):
    with_threads(folder_of, ["rooms/a.hdr", Path("rooms/b.hdr")], tmp_path)
    assert (tmp_path / "a" / "a.txt").read_text() == "rooms/a.hdr" and (tmp_path / "b").is_dir()
    assert "without writing" in with_threads(nothing, ["c"], tmp_path).failed[0].error


def leaves(item, path):
    """As a command line's main() does."""
    if item == "b":
        sys.exit("bad item")
    Path(path).write_text(item)


def test_an_item_that_calls_exit_fails_alone(tmp_path):
    summary = with_threads(leaves, ["a", "b", "c"], tmp_path)
    assert [i.state for i in summary.items] == ["done", "failed", "done"] and "bad item" in summary.failed[0].error


def test_names_are_checked_before_anything_runs(tmp_path):
    with pytest.raises(ValueError, match="would both give x.npz"):
        with_threads(nothing, ["a/x.hdr", "b/x.hdr"], tmp_path / "out", suffix=".npz")
    for bad in ("..", "a/b", "", "summary.json"):
        with pytest.raises(ValueError, match="no name of a file"):
            with_threads(nothing, [1], tmp_path / "out", name=lambda item, bad=bad: bad)
    with pytest.raises(TypeError, match="an executor needs submit"):
        batch.run(nothing, [1], tmp_path / "out", executor=3)
    for one in ("maps", Path("maps")):
        with pytest.raises(TypeError, match="is a list of it"):
            batch.run(nothing, one, tmp_path / "out")
    for name in ("workers", "threads"):
        for bad in (0, -1):
            with pytest.raises(ValueError, match=f"{name} must be at least 1, got {bad}"):
                batch.run(nothing, [1], tmp_path / "out", **{name: bad})
        with pytest.raises(TypeError, match=f"{name} must be a whole number or None, got float"):
            batch.run(nothing, [1], tmp_path / "out", **{name: 1.5})
    assert not (tmp_path / "out").exists()
    both = with_threads(folder_of, ["a/x.hdr", "b/x.hdr"], tmp_path, name=lambda p: p.replace("/", "-"))
    assert [i.name for i in both.items] == ["a-x.hdr", "b-x.hdr"]


def test_a_worker_that_is_killed_is_told_of(tmp_path):
    """And stops nobody else, with one worker or more."""
    for workers in (1, 2):
        out = tmp_path / str(workers)
        summary = batch.run(dies, range(12), out, workers=workers, progress=False)
        lost = summary.failed
        assert [i.name for i in lost] == ["2"] and "terminated abruptly" in lost[0].error
        assert [i.name for i in summary.items] == [str(i) for i in range(12)] and len(summary.of("done")) == 11
        assert all(text == b"whole" for text in results(out).values()) and len(results(out)) == 11
        assert not (out / ".unfinished").exists()
    both = batch.run(always_dies, range(3), tmp_path / "all", workers=2, progress=False)
    assert len(both.failed) == 3


def test_workers_share_the_cores(tmp_path):
    batch.run(threads_used, range(2), tmp_path / "a", workers=2, progress=False)
    cores = len(os.sched_getaffinity(0))
    assert {int(t) for t in results(tmp_path / "a").values()} == {max(1, cores // 2)}


_RUN = """
import sys
from pathlib import Path
sys.path[:0] = [{tests!r}, {package!r}]
import test_batch
from fastibl import batch
if __name__ == "__main__":
    batch.run(test_batch.slow, range(10), Path({out!r}), workers=2, progress=False)
"""


def started(tmp_path, out):
    script = tmp_path / "run.py"
    package = str(Path(fastibl.__file__).parents[1])
    script.write_text(_RUN.format(tests=str(Path(__file__).parent), package=package, out=str(out)))
    return subprocess.Popen([sys.executable, str(script)])


def children(pid):
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True).stdout
    return [int(p) for p in listed.split()]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="kills a process and looks at its children")
def test_a_run_that_was_killed_is_resumed(tmp_path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    with_threads(slow, range(10), whole)
    process = started(tmp_path, broken)
    begin = time.monotonic()
    while not (broken.is_dir() and len(results(broken)) >= 2) and time.monotonic() < begin + 60:
        time.sleep(0.02)
    workers = children(process.pid)
    process.kill()
    process.wait()
    before = results(broken)
    assert 2 <= len(before) < 10
    begin = time.monotonic()
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < begin + 10:
        time.sleep(0.05)
    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)  # none waits for ever
    summary = with_threads(slow, range(10), broken)
    assert len(summary.of("kept")) >= 2 and not summary.failed
    assert results(broken) == results(whole)
    assert not (broken / ".unfinished").exists()


def script(folder, *command, status=0):
    path = os.pathsep.join([str(Path(fastibl.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run([sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done.stdout


@pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="needs the source tree")
def test_the_example_of_the_documentation(tmp_path):
    code = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "batch.md").read_text(), re.S)[1]
    (tmp_path / "run.py").write_text(code)
    (tmp_path / "maps").mkdir()
    for name in ("a", "b"):
        fastibl.write_environment(tmp_path / "maps" / f"{name}.hdr", fastibl.CubeMap(np.ones((6, 8, 8, 3))))
    assert script(tmp_path, "run.py").startswith("2 done, 0 kept, 0 failed")
    assert (tmp_path / "lights" / "b" / "light.json").is_file()
    assert script(tmp_path, "run.py").startswith("0 done, 2 kept, 0 failed")


@pytest.mark.skipif(not (ROOT / "examples").is_dir(), reason="needs the source tree")
def test_the_example_with_recordings(tmp_path):
    for seed in range(2):
        fastibl.simulate(seed=seed, seconds=0.3, fps=10, size=(320, 240), out=tmp_path / f"film-{seed}")
    code = str(ROOT / "examples" / "python" / "batch.py")
    said = script(tmp_path, code, "film-0", "film-1", "none", "--workers", "2", status=1)
    assert "2 done, 0 kept, 1 failed" in said and "no recording at none" in said
    with np.load(tmp_path / "lights" / "film-0.npz") as light:
        assert light["faces"].shape == (6, 64, 64, 3) and light["sh9"].shape == (9, 3)
        assert 0 < light["error"] < 1 and light["sh9"][0].min() > 0


def test_dask(tmp_path):
    distributed = pytest.importorskip("distributed", reason="pip install distributed")
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        summary = batch.run(sometimes, range(4), tmp_path / "a", executor=client, progress=False)
        again = batch.run(sometimes, range(4), tmp_path / "a", executor=client, progress=False)
        other = batch.run(light_of, range(2), tmp_path / "b", executor=client.get_executor(), progress=False)
    assert [i.state for i in summary.items] == ["done", "failed", "done", "done"]
    assert [i.state for i in again.items] == ["kept", "failed", "kept", "kept"]
    assert not other.failed and len(results(tmp_path / "b")) == 2


def two_files(item, path):
    path.write_text("one")
    path.with_suffix(".json").write_text("two")


def interrupted(item, path):
    if item == 1:
        raise KeyboardInterrupt
    path.write_text("here")


def test_a_second_file_is_not_lost_without_a_word(tmp_path):
    summary = batch.run(two_files, [0], tmp_path, suffix=".txt", workers=1, progress=False)
    (item,) = summary.items
    assert item.state == "failed" and "0.json beside 0.txt" in item.error and not (tmp_path / "0.txt").exists()


def test_items_are_written_under_their_own_names(tmp_path):
    def dome(item, path):
        path.mkdir()
        fastibl.write_usd(path / "stage.usda", fastibl.CubeMap(np.ones((6, 8, 8, 3), np.float32)))

    summary = batch.run(dome, [0], tmp_path, executor=ThreadPoolExecutor(1), progress=False)
    assert summary.items[0].state == "done"
    assert "stage_dome.hdr" in (tmp_path / "0" / "stage.usda").read_text()
    assert (tmp_path / "0" / "stage_dome.hdr").exists()


def test_an_item_that_is_interrupted_fails_alone(tmp_path):
    summary = batch.run(interrupted, range(4), tmp_path, workers=2, progress=False)
    assert [item.state for item in summary.items] == ["done", "failed", "done", "done"]
    assert "KeyboardInterrupt" in summary.items[1].error


def test_a_second_run_beside_the_first_is_refused(tmp_path):
    """It threw away what the first was writing."""
    pytest.importorskip("fcntl")
    run = lambda function: batch.run(function, [1], tmp_path / "out", executor=ThreadPoolExecutor(1), progress=False)  # noqa: E731
    told = []

    def meanwhile(item, path):
        try:
            run(light_of)
        except RuntimeError as error:
            told.append(str(error))
        path.write_text("whole")

    assert run(meanwhile).items[0].state == "done"
    assert len(told) == 1 and "another run is working on" in told[0] and "out" in told[0]
    assert (tmp_path / "out" / "1").read_text() == "whole"
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["1", "summary.json"]
    assert run(meanwhile).items[0].state == "kept"


def test_threads_are_what_they_were(tmp_path):
    before = fastibl.threads()
    fastibl.set_threads(2)
    try:
        batch.run(interrupted, [0], tmp_path, executor=ThreadPoolExecutor(1), threads=1, progress=False)
        assert fastibl.threads() == 2
    finally:
        fastibl.set_threads(before)
