"""Work that takes long tells its progress, and ends when it is asked to."""

import contextlib
import io
import signal
import sys
import time

import numpy as np
import pytest

import fastibl
from fastibl import progress

OPTIONS = {"refine": False, "visibility_rays": 8}


def bumpy(n):
    """An open surface of 2 n^2 triangles."""
    x, y = (v.ravel() for v in np.meshgrid(*[np.linspace(0, 1, n + 1)] * 2))
    i = np.arange(n * (n + 1)).reshape(n, n + 1)[:, :n].ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + n + 1], 1), np.stack([i + 1, i + n + 2, i + n + 1], 1)])
    return fastibl.Mesh(np.stack([x, y, 0.1 + 0.05 * np.sin(20 * x) * np.sin(15 * y)], axis=1), triangles)


MESH = bumpy(40)  # 1681 vertices: several pieces of each long loop


def parts(**options):
    seen = []
    fastibl.Scene(MESH, progress=lambda done: not seen.append(done), **options)
    return seen


def test_a_function_that_returns_nothing_ends_nothing():
    seen = []
    fastibl.Scene(MESH, progress=seen.append, **OPTIONS)
    fastibl.MeshShadow(bumpy(4), resolution=16, progress=seen.append)
    assert seen.count(1) == 2


@pytest.mark.parametrize("options", [OPTIONS, {"visibility_rays": 8}, {"visibility_rays": 0, "spheres": 0}])
def test_a_scene_tells_the_part_done(options):
    seen = parts(**options)
    assert seen[0] == 0 and seen[-1] == 1 and seen == sorted(seen)


def test_long_loops_tell_their_progress():
    """Of P_V, of the refinement, of directions, of samples: no long step is without a word."""
    seen = np.array(parts(**OPTIONS))
    for begin, end in ((0.0, 0.1), (0.2, 0.95), (0.95, 1.0)):
        assert ((seen > begin) & (seen < end)).sum() >= 1
    seen = np.array(parts(visibility_rays=8))
    assert ((seen > 0.12) & (seen < 0.2)).sum() >= 5


def test_progress_changes_nothing():
    told, plain = (fastibl.Scene(MESH, progress=p, **OPTIONS) for p in (lambda done: True, None))
    np.testing.assert_array_equal(told.visibility, plain.visibility)
    np.testing.assert_array_equal(told.refined_mesh.vertices, plain.refined_mesh.vertices)


@pytest.mark.parametrize("until", [0.0, 0.05, 0.5, 0.97, 1.0])
def test_a_scene_can_be_ended(until):
    with pytest.raises(KeyboardInterrupt, match="ended"):
        fastibl.Scene(MESH, progress=lambda done: done < until, **OPTIONS)


def test_what_progress_raises_ends_the_work():
    with pytest.raises(ZeroDivisionError):
        fastibl.Scene(MESH, progress=lambda done: 1 / (done < 0.5), **OPTIONS)


def test_signals_end_the_work():
    """As Ctrl-C sends them."""
    seen = []

    def tell(done):
        seen.append(done)
        if len(seen) == 3:
            signal.raise_signal(signal.SIGINT)
        return True

    with pytest.raises(KeyboardInterrupt):
        fastibl.Scene(MESH, progress=tell, **OPTIONS)
    assert len(seen) == 3


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timer sends a signal")
@pytest.mark.parametrize(
    "work",
    [
        lambda mesh: fastibl.ambient_occlusion(mesh, rays=1000),
        fastibl.SelfShadow,
        lambda mesh: fastibl.PlaneExchange(mesh, cells=64),
    ],
    ids=["occlusion", "self-shadow", "exchange"],
)
def test_signals_end_work_that_tells_no_progress(work):
    """Two calls side by side: one to its end, and one that a signal ends after a tenth of that time."""

    def seconds(ended_after=0.0):
        begin = time.perf_counter()
        signal.setitimer(signal.ITIMER_REAL, ended_after)
        with contextlib.suppress(KeyboardInterrupt):
            work(mesh)
        return time.perf_counter() - begin

    mesh, before = bumpy(120), signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        whole = seconds()
        assert seconds(0.1 * whole) < 0.5 * whole
    finally:
        signal.signal(signal.SIGALRM, before)


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("make, what", [
    (lambda shown: fastibl.Scene(MESH, progress=shown, **OPTIONS), "make scene"),
    (lambda shown: fastibl.MeshShadow(MESH, 32, rings=4, cache=False, progress=shown), "bake shadow"),
])  # fmt: skip
def test_a_bar_on_a_terminal(make, what, monkeypatch):
    monkeypatch.setattr(progress, "_PATIENCE", 0)
    monkeypatch.setattr(sys, "stderr", Terminal())
    make(True)
    assert what in sys.stderr.getvalue() and "%" in sys.stderr.getvalue()
    monkeypatch.setattr(sys, "stderr", Terminal())
    make(False)
    assert sys.stderr.getvalue() == ""
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    make(True)
    assert sys.stderr.getvalue() == ""
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(progress, "_PATIENCE", np.inf)
    make(True)
    assert sys.stderr.getvalue() == ""
