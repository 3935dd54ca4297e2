"""The live page's server without a browser: who is let in, what is answered, what the controls do, what has bounds."""

import contextlib
import http.client
import json
import re
import socket
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

import fastibl
from fastibl.calibration.guess import LensSearch
from fastibl.guessed_rig import guessed_camera
from fastibl.live_page import Choices, LiveLoop, PageServer, Settings, pictures, server
from fastibl.live_page.connections import Connections
from fastibl.live_page.threads import Threads
from fastibl.live_page.viewers import Viewers
from fastibl.recording import RecordingWarning
from views import camera_of, looking

CAMERA = camera_of(96, 72, 50.0)
EYE = (0.0, -0.25, 0.2)
POSE = looking(np.array([0, 0, 0.03]) - EYE, EYE)
WHITE = fastibl.CubeMap(np.ones((6, 8, 8, 3)))
VIEWER = "abcdefgh"


def smooth(rng, width, height):
    """Noise that JPEG keeps."""
    return cv2.resize(rng.integers(0, 256, (4, 5, 3), np.uint8), (width, height), interpolation=cv2.INTER_CUBIC)


class Source:
    """Pictures of smooth noise with their poses; as many as asked for, as fast as they are taken but for `pause`."""

    def __init__(self, count=None, pause=0.004, camera=CAMERA):
        self.rig, self.board, self.count, self.pause = fastibl.Rig(camera), None, count, pause
        self.given, self.closed = 0, False
        rng = np.random.default_rng(0)
        self._back = [smooth(rng, camera.width, camera.height) for _ in range(2)]

    def close(self):
        self.closed = True

    def __iter__(self):
        k = 0
        while not self.closed and (self.count is None or k < self.count):
            time.sleep(self.pause)
            self.given += 1
            yield fastibl.Frame(k / 100, self._back[k % 2], back_from_marker=POSE)
            k += 1


class Client:
    def __init__(self, page, viewer=VIEWER):
        self.page, self.viewer = page, viewer
        self.connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)

    def ask(self, path, method="GET", body=None, token=None, **headers):
        query = f"{'&' if '?' in path else '?'}viewer={self.viewer}"
        headers = {name.replace("_", "-"): value for name, value in headers.items()}
        token = self.page.token if token is None else token
        self.connection.request(method, f"/{token}/{path}{query}", body, headers)
        answer = self.connection.getresponse()
        return answer, answer.read()

    def state(self):
        answer, body = self.ask("state")
        assert answer.status == 200, body
        return json.loads(body)

    def change(self, **changes):
        return self.ask("control", "POST", json.dumps(changes), Content_Type="application/json")

    def until(self, condition, seconds=20.0):
        """The first state for which it holds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            state = self.state()
            if condition(state):
                return state
            time.sleep(0.01)
        raise AssertionError(f"after {seconds} s: {state}")

    def picture(self, view="composite", after=0, wait=1):
        answer, body = self.ask(f"picture/{view}?after={after}" + ("&wait=1" if wait else ""))
        if answer.status == 204:
            return None, 0
        assert answer.status == 200 and answer.headers["Content-Type"] == "image/jpeg", body
        return cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR), int(answer.headers["X-Picture"])


@pytest.fixture(scope="module")
def loaded():
    """Objects made ready once for all tests."""
    return {}


@pytest.fixture
def run(tmp_path, monkeypatch, loaded):
    """Runs a loop in a thread, and its page."""
    real = LiveLoop._load
    monkeypatch.setattr(
        LiveLoop, "_load", lambda loop, name: loaded.get(name) or loaded.setdefault(name, real(loop, name))
    )
    with contextlib.ExitStack() as stack:

        def begin(source=None, options=None, lens=None, **others):
            source = Source() if source is None else source
            loop = LiveLoop(
                source,
                Choices(height=0.05),
                Settings("cube"),
                {"environment": WHITE} if options is None else options,
                folder=tmp_path,
                about="noise",
                lens=lens,
            )
            page = stack.enter_context(PageServer(loop, **others))
            thread = threading.Thread(target=loop.run, daemon=True)
            thread.start()

            def end():
                loop.stop()
                thread.join(10)
                assert not thread.is_alive(), "the loop does not end"

            stack.callback(end)
            client = Client(page)
            client.until(lambda s: s["picture"] > 0)
            return client, page, loop

        yield begin


def test_nobody_is_let_in_without_the_token_or_by_another_name(run):
    client, page, _ = run(notices=("`x` is so",))
    host = f"127.0.0.1:{page.port}"
    for token in ("", "wrong", page.token[:-1], page.token + "x", "%C3%A9"):
        for path in ("", "state", "picture/composite", "choices"):
            connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
            connection.putrequest("GET", f"/{token}/{path}")
            connection.endheaders()
            answer = connection.getresponse()
            assert answer.status == 403 and b"address" in answer.read()
    for headers in (
        {"Host": "evil.example"},
        {"Host": f"evil.example:{page.port}"},
        {"Host": "127.0.0.1:1"},
        {"Host": ""},
        {"Host": host, "Origin": "http://evil.example"},
        {"Host": host, "Origin": "null"},
        {"Host": host, "Sec-Fetch-Site": "cross-site"},
        {"Host": host, "Sec-Fetch-Site": "same-site"},
    ):
        assert client.ask("state", **headers)[0].status == 403, headers
        answer, _ = client.ask("control", "POST", '{"freeze": true}', Content_Type="application/json", **headers)
        assert answer.status == 403
    for headers in ({"Host": host}, {"Host": f"localhost:{page.port}"}, {"Origin": f"http://{host}"}):
        assert client.ask("state", **headers)[0].status == 200, headers
    assert client.state()["settings"]["freeze"] is False
    assert page._server.server_address[0] == "127.0.0.1"


def test_a_given_token(run):
    token = "kiosk-0_" + "AbCdEf" * 2
    client, page, _ = run(token=token)
    assert page.url.endswith(f"/{token}/") and client.ask("", token=token)[0].status == 200
    assert client.ask("", token=token[:-1])[0].status == 403
    for wrong, why in (
        ("", "16 random characters"),
        ("AbCdEfGh1234567", "16 random characters or more, got 15"),
        ("a" * 20, "random"),
        ("AbCdEfGh/1234567890", "letters"),
        ("AbCdEfGh12345678\n", "letters"),
        ("ÄbCdEfGh1234567890", "letters"),
    ):
        with pytest.raises(ValueError, match=why) as refused:
            PageServer(page.loop, token=wrong)
        assert not wrong or wrong not in str(refused.value)


def test_the_address_is_opened_as_people_do(run):
    """Without its last slash, and by a link in another page; nothing else is let in so."""
    client, page, _ = run()
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    connection.request("GET", f"/{page.token}")
    answer = connection.getresponse()
    assert answer.status == 308 and answer.headers["Location"] == f"/{page.token}/"
    followed = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    assert client.ask("", **followed)[0].status == 200
    assert client.ask("", **followed | {"Sec-Fetch-Dest": "iframe"})[0].status == 403
    assert client.ask("state", **followed)[0].status == 403


def test_the_page_loads_nothing_from_outside(run):
    client, page, _ = run(notices=("`x` is so",))
    answer, body = client.ask("")
    policy = answer.headers["Content-Security-Policy"]
    assert answer.status == 200 and policy == page.policy and "default-src 'none'" in policy
    assert "unsafe" not in policy and policy.count("sha256-") == 2
    text = body.decode()
    assert not re.search(r"""(https?:)?//\w|src=|@import|url\(|\sstyle=|\son\w+=""", text.replace("// ", ""))
    assert answer.headers["Referrer-Policy"] == "no-referrer" and answer.headers["Cache-Control"] == "no-store"
    choices = json.loads(client.ask("choices")[1])
    assert choices["notices"] == ["`x` is so"] and "cube" in choices["objects"] and "gold" in choices["materials"]
    assert "sh9" in choices["methods"]["diffuse"]


def test_pictures_are_the_sessions(run):
    client, _, loop = run()
    assert client.change(freeze=True)[0].status == 200
    client.until(lambda s: s["state"] == "frozen")
    picture, number = client.picture()
    snapshot = loop.latest.get()
    assert number == snapshot.picture
    expected = cv2.imdecode(np.frombuffer(pictures.jpeg(snapshot.result.image), np.uint8), cv2.IMREAD_COLOR)
    assert np.array_equal(picture, expected) and picture.shape == (72, 96, 3)
    back, _ = client.picture("back")
    assert np.abs(back[..., ::-1].astype(int) - snapshot.frame.back).mean() < 6 < np.ptp(back)
    assert client.picture("front", wait=0) == (None, 0)
    assert client.picture("map")[0].shape == (160, 320, 3)
    shadow, _ = client.picture("shadow")
    assert shadow.shape == (192, 192, 3) and shadow.min() < 100 and shadow.max() > 250
    assert client.picture(after=number, wait=0) == (None, 0), "the same picture was sent twice"
    begin = time.monotonic()
    server_wait = client.picture(after=number)
    assert server_wait == (None, 0) and time.monotonic() - begin >= 1.5, "a client that waits must not ask in a loop"
    answer, _ = client.ask("picture/composite?after=0&overlay=1")
    overlay = json.loads(answer.headers["X-Overlay"])
    np.testing.assert_allclose(overlay["axes"][0], CAMERA.project(POSE.translation[None])[0], atol=1e-6)
    assert len(overlay["shadow"]) == 4


def test_a_picture_is_encoded_once_and_only_when_asked_for(run, monkeypatch):
    made = []
    real = pictures.jpeg
    monkeypatch.setattr(pictures, "jpeg", lambda picture: made.append(1) or real(picture))
    client, page, loop = run()
    while loop.latest.get().picture < 30:
        time.sleep(0.01)
    assert not made
    client.change(freeze=True)
    client.until(lambda s: s["state"] == "frozen")
    for viewer in ("viewer01", "viewer02", "viewer03"):
        assert Client(page, viewer).picture()[1] == loop.latest.get().picture
    assert len(made) == 1


def test_numbers_are_the_sessions(run):
    client, _, loop = run()
    client.change(freeze=True)
    client.until(lambda s: s["state"] == "frozen")
    state, snapshot = client.state(), loop.latest.get()
    plan = snapshot.newest.plan
    assert [p["name"] for p in state["plan"]["passes"]] == [p.name for p in plan.passes]
    assert [p["method"] for p in state["plan"]["passes"]] == [p.method for p in plan.passes]
    assert state["plan"]["text"] == str(plan) and state["plan"]["expected_error"] == plan.expected_error
    total = np.median([1e3 * t["total"] for t in snapshot.timings])
    assert state["milliseconds"]["total"] == pytest.approx(total)
    environment = snapshot.newest.environment
    assert state["light"]["coverage"] == environment.coverage == 1
    assert state["light"]["error"] == snapshot.newest.predicted_error
    low, high = state["light"]["interval"]
    assert low <= state["light"]["captured"] <= high
    assert state["light"]["guidance"] == "all of the sky was seen"
    assert state["board"]["seen"] and state["board"]["metres"] == pytest.approx(np.linalg.norm(POSE.translation))
    assert state["front"] is False
    assert state["source"] == "noise" and state["size"] == [96, 72] and state["viewers"] == 1


def test_every_control_is_applied(run, tmp_path):
    client, _, loop = run()
    client.change(freeze=True)
    client.until(lambda s: s["state"] == "frozen")

    def changed(condition, **changes):
        """The picture before and after a change, while frozen."""
        before, number = client.picture()
        assert client.change(**changes)[0].status == 200
        state = client.until(lambda s: condition(s) and s["picture"] != number)
        return before, client.picture()[0], state

    before, after, _ = changed(lambda s: s["settings"]["material"] == "red plastic", material="red plastic")
    assert not np.array_equal(before, after)
    before, after, _ = changed(lambda s: s["settings"]["turn"] == 45, turn=45)
    assert not np.array_equal(before, after)
    before, after, state = changed(lambda s: not s["settings"]["shadow"], shadow=False)
    assert not np.array_equal(before, after)
    assert not next(p for p in state["plan"]["passes"] if p["name"] == "shadow")["included"]
    changed(lambda s: s["settings"]["shadow"], shadow=True)

    def method(state, step):
        return next(p for p in state["plan"]["passes"] if p["step"] == step)["method"]

    _, _, state = changed(
        lambda s: s["settings"]["methods"] == {"diffuse": "six-face"}, methods={"diffuse": "six-face"}
    )
    assert method(state, "diffuse").startswith("six-face")
    _, _, state = changed(lambda s: "shadow" in s["settings"]["methods"], methods={"shadow": "cap-product"})
    assert method(state, "shadow") == "cap-product" and method(state, "diffuse").startswith("six-face")
    _, _, state = changed(lambda s: s["settings"]["methods"] == "paper", methods="paper")
    assert method(state, "diffuse") == "six-face" and method(state, "shadow") == "cap-product"
    changed(lambda s: s["settings"]["methods"] == "auto", methods="auto")
    _, _, state = changed(lambda s: s["settings"]["error"] == 0.3, error=0.3, milliseconds=50)
    assert loop.latest.get().newest.plan.error_budget == 0.3
    assert loop.latest.get().newest.plan.milliseconds_budget == 50
    before, after, state = changed(lambda s: s["settings"]["object"] == "ball" and not s["preparing"], object="ball")
    assert not np.array_equal(before, after) and state["settings"]["material"] == "red plastic"
    assert np.allclose(loop._session.scene.marker_from_object.rotation[0, :2], [np.sqrt(0.5), -np.sqrt(0.5)])
    if "gl" in loop.choices.backends:
        assert client.change(backend="gl")[0].status == 200  # or a message, where there is no driver
        client.until(lambda s: s["settings"]["backend"] == "gl" or any("backend" in m["text"] for m in s["messages"]))

    answer, body = client.ask("save", "POST", "")
    saved = json.loads(body)["saved"]
    assert answer.status == 200 and saved.startswith(str(tmp_path))
    assert np.array_equal(cv2.imread(saved)[..., ::-1], loop.latest.get().result.image)
    other = json.loads(client.ask("save", "POST", "")[1])["saved"]
    assert other != saved, "a picture was written over another"


def test_changes_that_find_no_room_are_refused_whole(tmp_path):
    loop = LiveLoop(Source(), Choices(height=0.05), Settings("cube"), {"environment": WHITE}, folder=tmp_path, about="")
    while loop._queue.qsize() < loop._queue.maxsize - 1:
        assert loop.change({"turn": 1.0})
    assert loop.change({"step": True, "shadow": False}) and not loop.change({"step": True, "shadow": True})
    loop._apply_waiting()
    assert loop._steps == 1 and loop._queue.empty()


def test_viewers_who_save_at_once_have_a_picture_each(run, monkeypatch):
    client, page, loop = run()
    from fastibl.live_page import server

    taken, real = threading.Barrier(2), server.free_path

    def free(*given):
        path = real(*given)
        with contextlib.suppress(threading.BrokenBarrierError):
            taken.wait(2)  # both have asked
        return path

    monkeypatch.setattr(server, "free_path", free)
    with ThreadPoolExecutor(2) as pool:
        answers = [pool.submit(Client(page).ask, "save", "POST", "") for _ in range(2)]
        saved = {json.loads(answer.result()[1])["saved"] for answer in answers}
    assert len(saved) == 2 and all(cv2.imread(path) is not None for path in saved)


def test_objects_are_made_ready_one_at_a_time(run, monkeypatch):
    client, _, loop = run()
    load, begun, go_on = loop._load, [], threading.Event()

    def slow(name):
        begun.append(name)
        assert go_on.wait(20)
        return load(name)

    monkeypatch.setattr(loop, "_load", slow)
    for name in ("ball", "cube", "ring", "ball", "cube"):
        client.change(object=name)
    state = client.until(lambda s: s["preparing"] == "ball")
    number = state["picture"]
    client.until(lambda s: s["picture"] > number + 3)  # the session runs on
    go_on.set()
    client.until(lambda s: not s["preparing"] and begun == ["ball", "cube"])
    assert client.state()["settings"]["object"] == "cube"


def test_freeze_step_and_start_anew(run):
    source = Source()
    client, _, loop = run(source)
    client.change(freeze=True)
    frozen = client.until(lambda s: s["state"] == "frozen")
    given = source.given
    time.sleep(0.1)
    assert client.state()["picture"] == frozen["picture"] and source.given == given, "it goes on while frozen"
    for k in range(1, 4):
        client.change(step=True)
        client.until(lambda s, k=k: s["picture"] == frozen["picture"] + k)
    assert source.given == given + 3
    client.change(freeze=False)
    client.until(lambda s: s["picture"] > frozen["picture"] + 10)
    session = loop._session
    client.change(restart=True)
    client.until(lambda s: loop._session is not session and s["state"] == "running")
    assert loop.latest.get().frame.time < 1, "the source did not begin anew"


def test_record(run, tmp_path):
    client, _, loop = run()
    client.change(record=True)
    state = client.until(lambda s: s["recording"] and s["recording"]["written"] > 5)
    client.change(record=False)
    client.until(lambda s: not s["recording"] and any("recorded" in m["text"] for m in s["messages"]))
    recording = fastibl.Recording.open(state["recording"]["path"])
    assert len(recording) > 5 and recording.rig == loop.source.rig
    assert recording.path.parent == tmp_path


def test_starting_anew_ends_a_recording_unless_time_goes_on(run):
    for live in (False, True):
        source = Source()
        source.live = live
        client, _, loop = run(source)
        client.change(record=True)
        client.until(lambda s: s["recording"] and s["recording"]["written"] > 5)
        session = loop._session
        client.change(restart=True)
        client.until(lambda _, loop=loop, session=session: loop._session is not session)
        last = loop.latest.get().picture  # of the session before, perhaps; the one after it is not
        state = client.until(lambda s, last=last: s["picture"] > last + 1 and s["state"] == "running")
        assert bool(state["recording"]) == live
        client.change(record=False)
        client.until(lambda s: any("recorded" in m["text"] for m in s["messages"]))


def test_a_step_shows_a_back_picture(run):
    class Between(Source):
        """A front picture alone after each back picture."""

        def __iter__(self):
            for frame in super().__iter__():
                yield frame
                yield fastibl.Frame(frame.time + 0.004, front=frame.back)

    source = Between()
    source.rig = fastibl.Rig(CAMERA, CAMERA, fastibl.Pose(np.diag([1.0, -1, -1, 1])))
    client, _, _ = run(source)
    client.change(freeze=True)
    frozen = client.until(lambda s: s["state"] == "frozen")
    for k in range(1, 5):
        client.change(step=True)
        client.until(lambda s, k=k: s["picture"] == frozen["picture"] + k)


def test_changes_of_a_frozen_picture_leave_the_map(run):
    """Half of the picture says one thing and half another: captured again and again it would be believed more."""
    source = Source()
    client, _, loop = run(source, options={"environment": None})
    client.change(freeze=True)
    client.until(lambda s: s["state"] == "frozen")
    before = loop.latest.get().result.environment
    for k in range(20):
        client.change(turn=10 * k)
        client.until(lambda s, k=k: s["settings"]["turn"] == 10 * k)
    after = loop.latest.get().result.environment
    np.testing.assert_array_equal(after.radiance.faces, before.radiance.faces)
    light = client.state()["light"]  # still captured, and as well known
    assert not light["given"] and light["interval"] == list(before.predicted_interval)
    np.testing.assert_array_equal(after.confidence, before.confidence)
    client.change(freeze=False)
    # Captured again, from pictures that differ.
    client.until(lambda s: (loop.latest.get().result.environment.radiance.faces != before.radiance.faces).any())
    assert loop.latest.get().result.environment.coverage > 0


def test_the_page_knows_the_papers_methods(run):
    client, _, loop = run()
    _, body = client.ask("choices")
    paper = json.loads(body)["paper"]
    for step, name in paper.items():
        assert name == fastibl.lighting.method_name(step, "paper")
    client.change(methods={**paper, "shadow": "directions"})
    plan = client.until(lambda s: any("directions" in p["method"] for p in s["plan"]["passes"]))["plan"]["passes"]
    passes = {p["name"]: p for p in plan}
    assert not passes["bounce"]["included"]
    assert "transfer" not in passes["self_shadow"]["method"] or not passes["self_shadow"]["included"]


def test_who_looks_on_sees_no_slow_motion(run, monkeypatch):
    """Frames that take long for their error get a budget of time, once, where none was asked for."""
    monkeypatch.setattr("fastibl.live_page.loop._SLOW", 0.0)
    client, _, loop = run()
    state = client.until(lambda s: s["settings"]["milliseconds"] == 50)
    assert any("methods are now chosen for 50 ms" in m["text"] for m in state["messages"])
    client.change(milliseconds=0)
    picture = client.until(lambda s: s["settings"]["milliseconds"] == 0)["picture"]
    assert client.until(lambda s: s["picture"] > picture + 15)["settings"]["milliseconds"] == 0


def test_warnings_of_a_recording_are_said(run):
    class Cut(Source):
        def __iter__(self):
            yield from list(super().__iter__())[:2]
            warnings.warn("frame 2 of 9 is cut off", RecordingWarning, stacklevel=1)

    client, _, _ = run(Cut(count=2))
    state = client.until(lambda s: s["state"] == "ended")
    assert any("frame 2 of 9 is cut off" in m["text"] for m in state["messages"])


def test_what_cannot_be_done_is_said(run, tmp_path):
    client, _, loop = run()
    loop.folder = tmp_path / "nowhere" / "at all"
    answer, body = client.ask("save", "POST", "")
    assert answer.status == 409 and b"nowhere" in body
    (tmp_path / "nowhere").write_text("a file")
    client.change(record=True)
    client.until(lambda s: any("record" in m["text"] for m in s["messages"]))
    loop.choices._files["broken.obj"] = tmp_path / "broken.obj"
    loop.choices.objects.append("broken.obj")
    client.change(object="broken.obj")
    state = client.until(lambda s: any("broken.obj" in m["text"] for m in s["messages"]) and not s["preparing"])
    assert state["settings"]["object"] == "cube" and state["state"] == "running"


@pytest.mark.parametrize(
    "changes",
    [
        {},
        [],
        "freeze",
        {"freeze": 1},
        {"freeze": "yes"},
        {"step": False},
        {"object": "../../etc/passwd"},
        {"object": ["cube"]},
        {"material": "unobtainium"},
        {"error": -1},
        {"error": float("nan")},
        {"error": True},
        {"milliseconds": 1e9},
        {"turn": "north"},
        {"turn": 10**400},
        {"methods": "best"},
        {"methods": {"diffuse": "mip"}},
        {"methods": {"cooking": "auto"}},
        {"methods": {"diffuse": {}}},
        {"backend": "vulkan"},
        {"__class__": 1},
        {"_ready": None},
        {"quit": True},
    ],
)
def test_changes_that_are_none(changes):
    with pytest.raises(ValueError, match=".") as caught:
        Choices().read(changes)
    assert len(str(caught.value)) < 400


def test_bad_requests(run):
    client, page, _ = run()
    kind = {"Content_Type": "application/json"}
    assert client.ask("control", "POST", "{", **kind)[0].status == 400
    assert client.ask("control", "POST", "[" * 4000, **kind)[0].status == 400
    assert client.ask("control", "POST", b"\xff\xfe", **kind)[0].status == 400
    answer, body = client.ask("control", "POST", '{"quit": true}', **kind)
    assert answer.status == 400 and b"quit" in body
    assert client.ask("control", "POST", '{"freeze": true}', Content_Type="text/plain")[0].status == 415
    assert client.ask("nothing")[0].status == 404 and client.ask("control")[0].status == 404
    for path in ("picture/none", "picture/composite?after=x", "picture/composite?after=" + "9" * 30, "picture/"):
        assert client.ask(path)[0].status == 404, path
    assert client.ask("state", "DELETE")[0].status == 501
    client = Client(page)
    assert client.ask("control", "POST", b"x" * 5000, **kind)[0].status == 413
    client = Client(page)
    client.connection.putrequest("POST", f"/{page.token}/control?viewer={VIEWER}")
    client.connection.endheaders()
    assert client.connection.getresponse().status == 411
    assert Client(page, "").ask("state")[0].status == 400 and Client(page, "a" * 99).ask("state")[0].status == 400
    for garbage in (
        b"\0" * 100 + b"\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET http://[::1/ HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % page.port,
        b"GET " + b"/" * 70000 + b" HTTP/1.1\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", page.port), 10) as raw:
            raw.sendall(garbage)
            with contextlib.suppress(ConnectionError):
                assert b" 200 " not in raw.recv(1000)
    assert Client(page).state()["state"] == "running"
    for k in range(20):
        client = Client(page)
        assert client.ask(f"unknown{k}")[0].status == 404
    # Kinds of requests and views of pictures: a request is counted after its answer.
    assert not [what for what in page.served if "unknown" in what], "what is asked for grows without end"


def test_viewers_are_bounded_and_forgotten(run):
    client, page, _ = run()
    others = [Client(page, f"viewer{k:02d}") for k in range(4)]
    assert [other.ask("state")[0].status for other in others] == [200, 200, 200, 503]
    answer, body = others[3].ask("picture/composite")
    assert answer.status == 503 and b"4 pages are open already" in body
    assert others[0].ask("leave", "POST", "")[0].status == 204
    assert others[3].ask("state")[0].status == 200 and others[0].ask("state")[0].status == 503
    now = [0.0]
    viewers = Viewers(2, silence=5, clock=lambda: now[0])
    assert viewers.admit("a" * 8) and viewers.admit("b" * 8) and not viewers.admit("c" * 8)
    now[0] = 4
    assert viewers.admit("a" * 8)
    now[0] = 6
    assert viewers.admit("c" * 8) and len(viewers) == 2 and not viewers.admit("b" * 8)


def test_connections_are_bounded_and_cleaned_up(run):
    client, page, _ = run()
    opened = [Client(page) for _ in range(server._CONNECTIONS)]
    try:
        for one in opened[:-1]:
            one.state()
        answer, _ = opened[-1].ask("state")
        assert answer.status == 503 and page.connections == server._CONNECTIONS
        assert client.state()["state"] == "running", "a client that was there is served on"
    finally:
        for one in opened:
            one.connection.close()
    end = time.monotonic() + 10
    while page.connections > 1 and time.monotonic() < end:
        time.sleep(0.01)
    assert page.connections == 1


def connected(page):
    return socket.create_connection(("127.0.0.1", page.port), 10)


def until_closed(connection, seconds=5.0):
    """What comes until the server closes the connection. Raises TimeoutError where it does not."""
    connection.settimeout(seconds)
    received = b""
    with contextlib.suppress(ConnectionError):
        while more := connection.recv(65536):
            received += more
    return received


def of_connections():
    return [thread for thread in threading.enumerate() if thread.name == "fastibl page's connection"]


def test_threads_serve_one_connection_after_the_other(run):
    """OpenCV keeps memory for each thread that ever was, and clients may connect anew for each request."""
    client, page, _ = run()
    before = set(of_connections())
    for _ in range(40):
        one = Client(page)
        one.state()
        one.connection.close()
    assert len(set(of_connections()) - before) <= 4
    page.close()
    client.connection.close()
    end = time.monotonic() + 10
    while of_connections() and time.monotonic() < end:
        time.sleep(0.01)
    assert not of_connections()


def test_threads_run_jobs_at_once():
    threads, all_there = Threads("a test's"), threading.Barrier(4, timeout=10)
    for _ in range(2):
        for _ in range(3):
            threads.run(all_there.wait)
        all_there.wait()
    assert threading.active_count() >= 4
    threads.close()
    threads.run(lambda: pytest.fail("it is closed"))


def test_who_was_not_admitted_makes_room(run):
    """Whoever holds places without the token: with silence, with parts of a request."""
    client, page, _ = run()
    strangers = [connected(page) for _ in range(2 * server._CONNECTIONS)]
    try:
        assert until_closed(strangers[0]) == b"" and page.connections == server._CONNECTIONS
        for one in strangers[-server._CONNECTIONS + 1 :]:
            one.sendall(b"GET / HTTP/1.1\r\nX: ")
        others = [Client(page) for _ in range(8)]
        assert all(other.state()["state"] == "running" for other in others)
        sockets = [one.connection.sock for one in [client, *others]]
        assert client.state()["state"] == "running"
        strangers += [connected(page) for _ in range(2 * server._CONNECTIONS)]
        assert all(other.state()["state"] == "running" for other in others)
        assert sockets == [one.connection.sock for one in [client, *others]], "strangers took an admitted one's place"
    finally:
        for one in strangers:
            one.close()


def test_who_is_refused_keeps_no_connection(run):
    _, page, _ = run()
    host = f"Host: 127.0.0.1:{page.port}\r\n"
    inner = f"GET /{page.token}/choices HTTP/1.1\r\n{host}\r\n"
    for status, request in (
        (403, "GET / HTTP/1.1\r\nHost: evil.example\r\nSec-Fetch-Site: cross-site\r\n\r\n"),
        (403, f"GET /wrong/ HTTP/1.1\r\n{host}\r\n"),
        (404, f"GET /{page.token}/nothing HTTP/1.1\r\n{host}\r\n"),
        (400, f"GET /{page.token}/ HTTP/1.1\r\n{host}Content-Length: {len(inner)}\r\n\r\n{inner}"),
        (400, f"GET /{page.token}/ HTTP/1.1\r\n{host}Transfer-Encoding: chunked\r\n\r\n{inner}"),
    ):
        with connected(page) as connection:
            connection.sendall(request.encode())
            answer = until_closed(connection)
        assert answer.startswith(b"HTTP/1.1 %d " % status) and answer.count(b"HTTP/1.1 ") == 1, answer


def test_a_request_without_a_version_is_refused(run, capfd):
    _, page, _ = run()
    for request in (b"GET /\r\n", b"GET /%s/\r\n" % page.token.encode(), b"GET / HTTP/0.9\r\n\r\n"):
        with connected(page) as connection:
            connection.sendall(request)
            assert until_closed(connection).startswith(b"HTTP/1.1 505 "), request
    assert capfd.readouterr().err == ""


def test_a_whole_request_has_a_deadline():
    now = [0.0]
    connections = Connections(3, 10.0, clock=lambda: now[0])
    pairs = [socket.socketpair() for _ in range(3)]
    try:
        for connection, _ in pairs:
            assert connections.take(connection)
        idle, asking, waiting = (connection for connection, _ in pairs)
        for connection in (asking, waiting):
            connections.admit(connection)
        now[0] = 8
        connections.wait(waiting)
        pairs[0][1].sendall(b"a byte")  # does not prolong it
        now[0] = 12
        connections.end_late()
        assert idle.recv(10) == b"a byte" and idle.recv(10) == b"" and len(connections) == 2
        connections.admit(idle)  # too late
        now[0] = 19
        connections.end_late()
        assert waiting.recv(10) == b"" and len(connections) == 1, "only what is answered may last"
        connections.leave(asking)
        assert len(connections) == 0
    finally:
        for both in pairs:
            for connection in both:
                connection.close()


def test_a_byte_now_and_then_holds_no_connection(run, monkeypatch):
    monkeypatch.setattr(server, "_TIMEOUT", 1.0)
    _, page, _ = run()
    with connected(page) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nX: ")
        connection.settimeout(0.2)
        end = time.monotonic() + 8
        with contextlib.suppress(ConnectionError):
            while time.monotonic() < end:
                connection.sendall(b"a")
                with contextlib.suppress(TimeoutError):
                    if not connection.recv(10):
                        break
    assert time.monotonic() < end, "each byte prolongs it"


def test_a_slow_client_slows_nobody(run):
    """One that asks and never takes what it gets: only its own thread waits."""
    big = camera_of(640, 480, 500.0)
    client, page, loop = run(Source(camera=big, pause=0.001))
    slow = socket.socket()
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    slow.connect(("127.0.0.1", page.port))
    line = (
        f"GET /{page.token}/picture/composite?after=0&viewer=slowslow HTTP/1.1\r\nHost: 127.0.0.1:{page.port}\r\n\r\n"
    )
    slow.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        for _ in range(2000):
            slow.send(line.encode())
    served, end = -1, time.monotonic() + 20
    while served != page.served.get("picture/composite", 0):  # until all buffers on the way are full
        assert time.monotonic() < end, "it is not slow"
        served = page.served.get("picture/composite", 0)
        time.sleep(0.3)
    assert 0 < served < 2000
    before, begin = loop.latest.get().picture, time.monotonic()
    numbers = [client.picture()[1]]
    while time.monotonic() - begin < 1:
        numbers.append(client.picture(after=numbers[-1])[1])
    assert loop.latest.get().picture - before >= 5 and len(numbers) >= 4, "the session waits for it"
    assert sorted(set(numbers)) == numbers
    slow.close()
    end = time.monotonic() + 10
    while page.connections > 1 and time.monotonic() < end:
        time.sleep(0.01)
    assert page.connections == 1, "a client that left keeps its thread"


def test_a_port_in_use_is_said(run):
    _, page, loop = run()
    with pytest.raises(OSError, match=f"port {page.port} is in use"):
        PageServer(loop, page.port)


def test_a_source_that_ends(run):
    client, _, loop = run(Source(count=5))
    state = client.until(lambda s: s["state"] == "ended")
    assert state["picture"] == 5 and client.picture()[0] is not None
    client.change(material="gold")
    client.until(lambda s: s["picture"] == 6 and s["settings"]["material"] == "gold")
    client.change(restart=True)
    assert client.until(lambda s: s["state"] == "ended" and s["picture"] == 11)["settings"]["material"] == "gold"


def test_a_source_that_fails_is_said(run):
    class Failing(Source):
        def __iter__(self):
            yield from list(super().__iter__())[:2]
            raise OSError("the disk is gone")

    client, _, _ = run(Failing(count=2))
    state = client.until(lambda s: s["state"] == "ended")
    assert "the disk is gone" in state["reason"] and any("the disk is gone" in m["text"] for m in state["messages"])


def filmed(degrees):
    """A source of pictures from a tilt of 45 degrees, whose camera is so many degrees wide but is taken for 65."""
    camera = guessed_camera((640, 480), degrees)
    pose = fastibl.Pose.look_at(eye=(0.05, -0.35, 0.37), target=(0.0, 0.02, 0.0))
    film = fastibl.simulate(
        seconds=0.2, fps=10, size=(640, 480), rig=fastibl.Rig(camera), path=lambda _: pose, hand=False, lamp=False
    )
    pictures = [frame.back for frame in film]

    class Filmed(Source):
        def __iter__(self):
            k = 0
            while not self.closed:
                time.sleep(self.pause)
                yield fastibl.Frame(0.3 * k, pictures[k % 2], back_exposure=None)
                k += 1

    source = Filmed()
    source.rig, source.board = fastibl.Rig(guessed_camera((640, 480))), fastibl.Board.default()
    return source, camera


@pytest.mark.parametrize("degrees", [50, 65])
def test_a_lens_that_was_guessed_is_found(run, degrees):
    """The session begins anew with it, once; where the guess was right, it goes on."""
    source, camera = filmed(degrees)
    client, page, loop = run(source, {}, lens=LensSearch(source.rig.back, source.board))
    first = loop._session
    state = client.until(lambda s: any("lens is" in m["text"] for m in s["messages"]))
    assert f"lens is {degrees}° wide" in state["messages"][-1]["text"]
    client.until(lambda s: s["picture"] > state["picture"] + 3)
    assert page.loop.latest.get().rig.back.fx == pytest.approx(camera.fx, rel=0.02)
    assert (loop._session is first) == (degrees == 65)
    said = [m["text"] for m in client.state()["messages"] if "lens is" in m["text"]]
    assert len(said) == 1 and ("as was taken" in said[0]) == (degrees == 65)


def test_says_why_the_board_is_not_seen(run):
    class Dark(Source):
        def __init__(self):
            super().__init__()
            self.board = fastibl.Board.default()

        def __iter__(self):
            for frame in super().__iter__():
                yield fastibl.Frame(frame.time, np.zeros_like(frame.back))

    client, _, _ = run(Dark(), {})
    assert "too dark" in client.until(lambda s: s["board"].get("advice"))["board"]["advice"]


def test_without_a_board_the_picture_is_the_cameras(run):
    class Blind(Source):
        def __iter__(self):
            for frame in super().__iter__():
                yield fastibl.Frame(frame.time, frame.back)

    client, _, loop = run(Blind(), {})
    client.change(freeze=True)
    state = client.until(lambda s: s["state"] == "frozen")
    assert not state["board"]["seen"] and state["light"] is None
    assert client.picture("map", wait=0) == (None, 0)
    assert np.array_equal(loop.latest.get().result.image, loop.latest.get().frame.back)


class TwoCameras(Source):
    """Pictures of a back and a front camera in turn; from `alone` on the front camera's alone."""

    def __init__(self, alone=None):
        super().__init__(pause=0.01)
        self.rig, self.alone = fastibl.Rig(CAMERA, CAMERA, fastibl.Pose(np.diag([1.0, -1, -1, 1]))), alone

    def __iter__(self):
        for k, frame in enumerate(super().__iter__()):
            if self.alone is None or k < self.alone:
                yield frame
            yield fastibl.Frame(frame.time + 0.004, front=np.roll(255 - frame.back, k, axis=1))


def test_changes_of_a_picture_before_a_front_cameras(run):
    """A frozen one, or the last of a back camera that is away: front pictures may have come since."""
    client, *_ = run(TwoCameras(), {"environment": None})
    client.until(lambda s: s["picture"] > 3)
    for k in range(4):
        client.change(freeze=True)
        before = client.until(lambda s: s["state"] == "frozen")
        client.change(turn=10.0 * (k + 1))
        client.until(
            lambda s, k=k, n=before["picture"]: s["picture"] == n + 1 and s["settings"]["turn"] == 10 * (k + 1)
        )
        client.change(freeze=False)
        client.until(lambda s, n=before["picture"]: s["picture"] > n + 2)
    assert not any("backwards" in m["text"] for m in client.state()["messages"])


def test_a_front_camera_that_goes_on_alone(run):
    client, *_ = run(TwoCameras(alone=5), {"environment": None})
    time.sleep(0.5)
    shown = client.until(lambda s: s["picture"] >= 5)["picture"]
    first, number = client.picture("front")
    later, after = client.picture("front", number)
    assert after > number and not np.array_equal(first, later)
    client.change(turn=45.0)
    client.until(lambda s: s["picture"] == shown + 1 and s["settings"]["turn"] == 45)
    for view, drawn in (("back", True), ("composite", True), ("front", False), ("map", False)):
        answer, _ = client.ask(f"picture/{view}?after=0&overlay=1")
        assert answer.status == 200 and bool(answer.headers.get("X-Overlay")) == drawn
