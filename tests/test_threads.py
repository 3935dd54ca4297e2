"""Python's threads: calls on one object come one after the other, and what was handed out stays."""

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import fastibl
from fastibl.tracking import detect

POSE = fastibl.Pose.look_at((0, -0.3, 0.2), (0, 0, 0.05))
CAMERA = fastibl.Camera(160, 120, 150, 150, 80, 60)


def session(**options):
    light = fastibl.CubeMap(np.random.default_rng(0).random((6, 16, 16, 3)).astype(np.float32))
    scene = fastibl.Scene(fastibl.shapes.figurine(detail=0.9), spheres=10)
    return fastibl.Session(scene, fastibl.Rig(CAMERA), None, light, **options)


def meanwhile(work, other, calls):
    """Calls `work` at least so often while another thread calls `other`, again and again; how often that was. On a busy
    machine the other thread may begin late: it is waited for."""
    done, count = threading.Event(), 0

    def again():
        nonlocal count
        while not done.is_set():
            other(count)
            count += 1

    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(again)
        try:
            for k in range(20 * calls):
                work(k)
                if k >= calls and count > 10:
                    break
        finally:
            done.set()
        running.result()
    return count


STEERED = """
import sys
sys.path.insert(0, sys.argv[1])
import fastibl, test_threads
session = test_threads.session(error=0.02)
materials = [fastibl.Material((0.5, 0.5, 0.5)), fastibl.Material.pbr((0.9, 0.9, 0.9), 1.0, 0.3)]
def steer(k):
    session.set_material(materials[k % 2])
    session.move(fastibl.Pose.from_rotation_vector((0, 0, 0.1 * (k % 9)), (0, 0, 0)))
    session.object.rgba, session.shadow_map.image, session.plan.passes, session.scene
def process(k):
    session.process(fastibl.Frame(time=0.1 * k, back_from_marker=test_threads.POSE))
print(test_threads.meanwhile(process, steer, 80))
"""


def test_a_session_is_steered_from_another_thread():
    """In a process of its own: what would go wrong is a crash."""
    command = [sys.executable, "-c", STEERED, str(Path(__file__).parent)]
    ran = subprocess.run(command, capture_output=True, text=True)
    print(ran.stdout, ran.stderr[-500:])
    assert ran.returncode == 0 and int(ran.stdout) > 10


def test_a_capture_is_asked_from_another_thread():
    capture = fastibl.Capture(size=32)
    shown = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
    asked = meanwhile(
        lambda k: capture.add(
            shown, CAMERA, fastibl.Pose.look_at((0, 0, 0.1), (np.cos(k), np.sin(k), 0.5)), 1.0, 0.1 * k
        ),
        lambda k: (capture.environment().radiance.faces.sum(), capture.last_seen.max()),
        200,
    )
    assert asked > 10 and np.isfinite(capture.environment().radiance.faces).all()


def test_a_detector_may_call_its_session():
    """The one that is asked for tags while a frame is processed."""
    seen = []

    def detector(*given):
        seen.append(session.plan)
        session.set_material(fastibl.Material((0.1, 0.1, 0.1)))
        return detect(*given)

    film = fastibl.simulate(seconds=0.2, fps=10, size=(160, 120), truth_size=16)
    scene = fastibl.Scene(fastibl.shapes.figurine(detail=0.9), spheres=10)
    session = fastibl.Session(scene, film.rig, film.board, detector=detector, size=32)
    for frame in film:
        session.process(frame)
    assert seen


def test_a_plan_that_was_handed_out_stays():
    running = session(error=0.02)
    running.process(fastibl.Frame(time=0.0, back_from_marker=POSE))
    plan = running.plan
    passes, before, methods = plan.passes, str(plan), str(plan.methods)
    named = [(p.name, p.included, p.reason) for p in passes]
    for k in range(1, 6):
        running.set_methods("paper" if k % 2 else "auto")
        running.process(fastibl.Frame(time=0.1 * k, back_from_marker=POSE))
    assert [(p.name, p.included, p.reason) for p in passes] == named
    assert str(plan) == before and str(plan.methods) == methods


LEFT_AT_WORK = """
import sys, threading
sys.path.insert(0, sys.argv[1])
import numpy as np
import fastibl, test_threads
session = test_threads.session()
cube = fastibl.CubeMap(np.ones((6, 64, 64, 3), np.float32))
mesh = fastibl.shapes.figurine(detail=0.9)
at_work = threading.Event()
def frames():
    for k in range(10**9):
        session.process(fastibl.Frame(time=0.01 * k, back_from_marker=test_threads.POSE))
        at_work.set()
def light():
    while True:
        fastibl.Lighting(cube).prefiltered(size=32)
        at_work.set()
def baked():
    def told(done):
        at_work.set()
        return True
    while True:
        fastibl.MeshShadow(mesh, cache=False, progress=told)
threading.Thread(target=locals()[sys.argv[2]], daemon=True).start()
at_work.wait()
"""


@pytest.mark.parametrize("work", ["frames", "light", "baked"])
def test_a_program_may_end_while_a_thread_is_at_work(work):
    """As that of a page that is still preparing an object: the process ends as the main thread says."""
    command = [sys.executable, "-c", LEFT_AT_WORK, str(Path(__file__).parent), work]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stderr[-500:]
