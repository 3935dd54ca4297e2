"""The native program: what Python's Session makes of a recording, it makes too; bad input; the window."""

import dataclasses
import os
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

import fastibl
from fastibl.recording import RecordingWriter
from hostile import ENDLESS, NESTED

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = Path(os.environ.get("FASTIBL_DEMO_PROGRAM", ROOT / "build/cpp/cpp/demo/fastibl-demo"))
SIZE = (320, 240)

if not PROGRAM.is_file():
    pytest.skip(f"fastibl-demo is not built: no {PROGRAM}", allow_module_level=True)


class PrintedBoard:
    """A board that can be laid on the simulator's table."""

    def __init__(self, board):
        self._board = board

    def __getattr__(self, name):
        return getattr(self._board, name)

    def image(self, dpi):
        scale = dpi / 0.0254
        page = np.full((round(self.height * scale), round(self.width * scale)), 255, np.uint8)
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        for tag in self.tags:
            corners = np.asarray(tag.corners)
            x, y = ((corners[0] + [self.width / 2, -self.height / 2]) * [scale, -scale]).round().astype(int)
            n = round((corners[1, 0] - corners[0, 0]) * scale)
            page[y : y + n, x : x + n] = cv2.aruco.generateImageMarker(family, tag.id, n, borderBits=self.border_bits)
        return page


def store(recording, path, video=False):
    with RecordingWriter(path, recording.rig, recording.board, video=video) as writer:
        for frame in recording:
            writer.add(frame)
        writer.write_truth(recording.truth)
    return path


@pytest.fixture(scope="module")
def recording():
    """In memory; the camera looks at the default board from all around."""
    board = PrintedBoard(fastibl.Board.default())
    return fastibl.simulate(seconds=0.5, fps=10, size=SIZE, truth_size=16, hand=False, board=board)


@pytest.fixture(scope="module")
def folder(recording, tmp_path_factory):
    return store(recording, tmp_path_factory.mktemp("recordings") / "pictures")


@pytest.fixture(scope="module")
def obj(tmp_path_factory):
    """A bipyramid, y up, with a polygon and texture indices."""
    path = tmp_path_factory.mktemp("objects") / "object.obj"
    path.write_text(
        "# lowest point first\nv 0 -1 0\nv 1 0 0\nv 0 0 1\nv -1 0 0\nv 0 0 -1\nv 0 2 0\nvt 0 0\no thing\n"
        "f 6/1 3/1 2/1\nf 6 4 3\nf -1 -2 -3\nf 6//1 2//1 5//1\nf 1 2 3\nf 1 3 4\n"
        "f 1 4 5\nf 1 5 2\nf 2 3 4 5\n"
    )
    return path


def python_mesh():
    vertices = [(0, 0, -1), (1, 0, 0), (0, -1, 0), (-1, 0, 0), (0, 1, 0), (0, 0, 2)]
    faces = "632 643 654 625 123 134 145 152 234 245"
    triangles = [[int(corner) - 1 for corner in face] for face in faces.split()]
    return fastibl.stand(fastibl.Mesh(np.array(vertices, np.float64), np.array(triangles)), 0.09)


def run(*arguments, code=0, env=None):
    command = [str(part) for part in (PROGRAM, *arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=env)
    assert done.returncode == code, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout if code == 0 else done.stderr


def pictures(path):
    return [cv2.imread(str(p), cv2.IMREAD_UNCHANGED)[..., ::-1] for p in sorted(path.glob("*.png"))]


MATERIAL = ("--diffuse", "0.5,0.4,0.3", "--glossy", "0.2,0.3,0.4", "--exponent", 40)


@pytest.mark.parametrize("methods, supersampling", [("auto", 1), ("paper", 1), ("auto", 2)])
def test_same_bytes_as_python(recording, folder, obj, methods, supersampling, tmp_path):
    material = fastibl.Material(diffuse=(0.5, 0.4, 0.3), glossy=(0.2, 0.3, 0.4), exponent=40)
    session = fastibl.Session(
        fastibl.Scene(python_mesh(), material),
        recording.rig,
        fastibl.Board.default(),
        methods=methods,
        backend="cpu",
        supersampling=supersampling,
    )
    expected = []
    for frame in recording:
        frame.back_from_marker = recording.truth.pose(frame.time)
        expected.append(session.process(frame).image)
        frame.back_from_marker = None

    arguments = ("--recording", folder, "--object", obj, "--height", 0.09, *MATERIAL, "--methods", methods)
    arguments += ("--supersampling", supersampling)
    for threads in (1, 2):
        out = tmp_path / f"out-{threads}"
        run(*arguments, "--poses", "truth", "--headless", "--out", out, "--threads", threads)
        got = pictures(out)
        assert len(got) == len(expected)
        for a, b in zip(got, expected, strict=True):
            np.testing.assert_array_equal(a, b)
    changed = [np.any(a != frame.back, axis=-1).mean() for a, frame in zip(expected, recording, strict=True)]
    assert min(changed) > 0.02  # an object is there


def test_tracks_the_board(recording, folder, tmp_path):
    """Poses of its own detector: the same picture up to a small shift of the edges. Without its shadow, whose
    directions are chosen by maps that differ by some pixels."""
    matte = "--recording", folder, "--glossy", "0,0,0", "--shadow-strength", 0, "--headless", "--out"
    run(*matte, tmp_path / "track")
    run(*matte, tmp_path / "truth", "--poses", "truth")
    tracked, true = pictures(tmp_path / "track"), pictures(tmp_path / "truth")
    for a, b, frame in zip(tracked, true, recording, strict=True):
        difference = np.abs(a.astype(int) - b).mean()
        drawn = np.abs(b.astype(int) - frame.back).mean()
        assert difference < 0.2 * drawn


def test_attitudes_are_read_and_recorded(recording, tmp_path):
    """Of the frames that have one; a bad one is named."""
    turns = [
        fastibl.Pose.from_rotation_vector([0.1 * k, 0.2, 0.3], np.zeros(3)).rotation for k in range(len(recording))
    ]
    frames = [dataclasses.replace(frame, attitude=None if k == 2 else turns[k]) for k, frame in enumerate(recording)]
    told = store(fastibl.Recording(recording.rig, frames, recording.board, recording.truth), tmp_path / "told")
    run("--recording", told, "--headless", "--record", tmp_path / "again")
    again = fastibl.Recording.open(tmp_path / "again")
    for k, frame in enumerate(again):
        assert frame.attitude is None if k == 2 else np.array_equal(frame.attitude, turns[k])
    assert len(again) == len(frames)
    for edit, message in (
        (lambda text: text.replace(",0.", ",9.", 1), "attitudes.csv: the attitude at 0 s must be a rotation"),
        (lambda text: text.replace("\n0.0,", "\n0.0,x", 1), "expected a finite number"),
        (lambda text: text.replace("\n0.0,", "\n0.0,1,", 1), "expected a time and 9 numbers, got 11 values"),
        (lambda text: text.replace("m00,m01", "m01,m00"), "must have the columns time,m00,m01"),
    ):
        copy = edited(told, tmp_path / str(len(message)), "attitudes.csv", edit)
        assert message in run("--recording", copy, "--headless", code=2)


def test_attitudes_of_one_time_are_each_their_own(recording, tmp_path):
    turns = [fastibl.Pose.from_rotation_vector([0.1 * k, 0.2, 0.3], np.zeros(3)).rotation for k in range(3)]
    turns[:1] = [None]  # not the next one's
    frames = [
        dataclasses.replace(frame, attitude=turn, time=0.0, front=None)
        for frame, turn in zip(recording, turns, strict=False)
    ]
    told = store(fastibl.Recording(recording.rig, frames, recording.board, recording.truth), tmp_path / "told")
    run("--recording", told, "--headless", "--record", tmp_path / "again")
    again = list(fastibl.Recording.open(tmp_path / "again"))
    assert [frame.time for frame in again] == [0.0] * 3
    for frame, before, turn in zip(again, frames, turns, strict=True):
        assert (frame.attitude is None) == (turn is None) and np.array_equal(frame.back, before.back)
        assert turn is None or np.array_equal(frame.attitude, turn)


def test_all_of_a_rig_goes_through(recording, tmp_path):
    """Every parameter of a camera, other than it is by itself, is read and recorded."""
    back = fastibl.Camera(
        320, 240, 301.5, 299.25, 158.5, 121.75, distortion=[0.01, -0.02, 0.001, 0.002, 0.003], gain=1.5, readout=0.01
    ).replace(vignetting=[-0.1, 0.02, 0.0], response=fastibl.Response.from_curve(np.linspace(0, 1, 64) ** 2))
    front = fastibl.Camera(
        320, 240, 95.5, 96.5, 160.5, 119.5, model="fisheye", distortion=[0.01, 0.002, 0.0, 0.001], field_of_view=183.0
    )
    rig = fastibl.Rig(back, front, fastibl.Pose.from_rotation_vector([0, 3.1, 0.1], [0.01, 0.02, -0.03]))
    frames = [dataclasses.replace(recording[0], front=np.zeros((240, 320, 3), np.uint8))]
    assert frames[0].back.shape == (240, 320, 3)
    told = store(fastibl.Recording(rig, frames, recording.board, recording.truth), tmp_path / "told")
    run("--recording", told, "--headless", "--record", tmp_path / "again")
    again = fastibl.Recording.open(tmp_path / "again").rig
    assert again.back == back and again.front == front
    np.testing.assert_allclose(again.front_from_back.matrix, rig.front_from_back.matrix, atol=1e-12)


def test_a_list_that_a_spreadsheet_saved(folder, tmp_path):
    marked = edited(folder, tmp_path / "marked", "frames.csv", lambda text: "\ufeff" + text.replace(",", ", "))
    for name, path in (("a", folder), ("b", marked)):
        run("--recording", path, "--headless", "--out", tmp_path / name, "--frames", 2)
    for a, b in zip(pictures(tmp_path / "a"), pictures(tmp_path / "b"), strict=True):
        np.testing.assert_array_equal(a, b)


def test_video_recording_gives_the_same(recording, folder, tmp_path):
    video = store(recording, tmp_path / "video", video=True)
    run("--recording", folder, "--headless", "--out", tmp_path / "a", "--frames", 3)
    run("--recording", video, "--headless", "--out", tmp_path / "b", "--frames", 3)
    for a, b in zip(pictures(tmp_path / "a"), pictures(tmp_path / "b"), strict=True):
        np.testing.assert_array_equal(a, b)


def test_without_a_board_pictures_pass_through(tmp_path):
    plain = fastibl.simulate(seconds=0.3, fps=10, size=SIZE, truth_size=16, board=False)
    text = run("--recording", store(plain, tmp_path / "in"), "--headless", "--out", tmp_path / "out")
    assert "not seen in 3 of 3 frames" in text
    for a, frame in zip(pictures(tmp_path / "out"), plain, strict=True):
        np.testing.assert_array_equal(a, frame.back)


def test_outputs_and_timings(folder, tmp_path):
    text = run("--recording", folder, "--headless", "--out", tmp_path / "last.png", "--frames", 2)
    for word in ("track", "capture", "shade", "composite", "total", "median ms", "frames/s"):
        assert word in text
    assert cv2.imread(str(tmp_path / "last.png")).shape == (SIZE[1], SIZE[0], 3)

    run("--recording", folder, "--headless", "--out", tmp_path / "out.webm")
    video = cv2.VideoCapture(str(tmp_path / "out.webm"))
    count = 0
    while video.read()[0]:
        count += 1
    assert count == 5 and video.get(cv2.CAP_PROP_FPS) == pytest.approx(10)


def test_broken_recording_keeps_what_was_read(folder, tmp_path):
    broken = shutil.copytree(folder, tmp_path / "broken")
    picture = broken / "back" / "00002.png"
    picture.write_bytes(picture.read_bytes()[:100])
    done = subprocess.run(
        [PROGRAM, "--recording", broken, "--headless", "--out", tmp_path / "out"],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0 and "00002.png" in done.stderr and "2 of 5 frames" in done.stderr
    assert len(pictures(tmp_path / "out")) == 2


def edited(folder, tmp_path, name, edit):
    copy = shutil.copytree(folder, tmp_path / "edited")
    file = copy / name
    text = edit(file.read_text())
    file.unlink()
    if text is not None:
        file.write_text(text)
    return copy


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda text: text.replace("rows: 3", "sizes: [" + "1094795585, " * 40 + "1]", 1), "rows and cols"),
        (lambda text: text.replace("rows: 3", "rows: 2000000000", 1), "must be a matrix of 2000000000"),
        (lambda text: text.replace("rows: 3", "rows: -3", 1), "must be a matrix of -3"),
        (lambda text: text.replace("cols: 3", "cols: 4", 1), "must be a matrix of 3 × 4 values"),
        (lambda text: text.replace("width: 320", "width: 320.5", 1), "must be a whole number, got 320.5"),
        (lambda text: text.replace("width: 320", "width: wide", 1), "no number width"),
        (lambda text: text + "x: 1\n" * 2**20, "at most 4194304"),
        *((lambda _, nested=nested: nested, "nests more than 32 levels") for nested in NESTED.values()),
        (lambda _: ENDLESS, "holds binary data"),
    ],
)
def test_hostile_calibrations(folder, tmp_path, change, message):
    """OpenCV's own reader of matrices writes beyond its memory."""
    text = run("--recording", edited(folder, tmp_path, "rig.yaml", change), "--headless", code=2)
    assert message in text and "rig.yaml" in text


def test_pictures_that_are_cut_or_elsewhere(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    whole = cv2.imencode(".jpg", cv2.imread(str(copy / "back" / "00000.png")))[1].tobytes()
    table = copy / "frames.csv"
    for name, content, words in (
        ("cut.jpg", whole[:-200], "may be cut off"),
        ("out.png", tmp_path / "secret.png", "leads out of the recording's folder"),
        ("list.mkv#0", b"#EXTM3U\n#EXTINF:1,\n" + str(tmp_path / "secret.ts").encode(), "no Matroska, AVI or MP4 file"),
    ):
        path = copy / name.partition("#")[0]
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            shutil.copy(folder / "back" / "00000.png", content)
            path.symlink_to(content)
        table.write_text(f"time,camera,file,exposure\n0.0,back,back/00000.png,1.0\n0.1,back,{name},1.0\n")
        done = subprocess.run(
            [str(PROGRAM), "--recording", str(copy), "--headless"], capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0 and words in done.stderr and "1 of 2 frames were read" in done.stderr


def test_nothing_is_lost_on_the_way(folder, tmp_path):
    """Every frame is recorded and written, whatever else is asked for at it; what never came is told."""
    out, recorded = tmp_path / "out", tmp_path / "recorded"
    arguments = [str(part) for part in (
        PROGRAM, "--recording", folder, "--headless", "--record", recorded, "--out", out,
        "--screenshot", tmp_path / "a.png", "--at", 3,
        "--do", "2:object=ball", "--do", "2:height=0.06", "--do", "40:height=0.2",
    )]  # fmt: skip
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1, done.stderr  # a script that asked for more frames than there were
    assert len(pictures(out)) == 5 and (tmp_path / "a.png").is_file()
    assert "recorded 5 frames" in done.stdout and "no room" not in done.stdout
    assert "ball, 6 cm high" in done.stdout
    assert "frame 40 of height=0.2 never came: there were 5 frames" in done.stderr
    assert 'height: expected a number, got "abc"' in run(
        "--recording", folder, "--headless", "--do", "2:height=abc", code=2
    )
    assert "only the simulated room has one" in run("--recording", folder, "--headless", "--do", "2:lamp=on", code=2)


def test_the_front_cameras_own_times_do_not_make_videos_faster(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    rows = [line.split(",") for line in (copy / "frames.csv").read_text().splitlines()[1:]]
    moved = [[str(float(t) + 0.03 * (camera == "front")), camera, *rest] for t, camera, *rest in rows]
    (copy / "frames.csv").write_text("\n".join(["time,camera,file,exposure", *(",".join(r) for r in moved)]) + "\n")
    run("--recording", copy, "--headless", "--out", tmp_path / "a.webm")
    assert cv2.VideoCapture(str(tmp_path / "a.webm")).get(cv2.CAP_PROP_FPS) == pytest.approx(10, abs=0.1)


def test_hard_edges_stay_hard(folder, tmp_path):
    """A file's own normals, in the program as in Python."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = ["v {} {} {}".format(*p) for p in corners]
    lines += ["vn {} {} {}".format(*n) for n in ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1))]
    lines += ["f " + " ".join(f"{v + 1}//{k + 1}" for v in side) for k, side in enumerate(sides)]
    (tmp_path / "cube.OBJ").write_text("\n".join(lines))
    run("--recording", folder, "--object", tmp_path / "cube.OBJ", "--up", "z", "--headless", "--poses", "truth",
        "--height", 0.09, "--frames", 1, *MATERIAL, "--out", tmp_path / "a.png")  # fmt: skip
    recording = fastibl.Recording.open(folder)
    mesh = fastibl.stand(fastibl.read_mesh(tmp_path / "cube.OBJ", up="z"), 0.09)
    assert len(mesh.vertices) == 24
    material = fastibl.Material(diffuse=(0.5, 0.4, 0.3), glossy=(0.2, 0.3, 0.4), exponent=40)
    session = fastibl.Session(fastibl.Scene(mesh, material), recording.rig, recording.board, backend="cpu")
    frame = recording[0]
    frame.back_from_marker = recording.truth.pose(frame.time)
    np.testing.assert_array_equal(session.process(frame).image, cv2.imread(str(tmp_path / "a.png"))[..., ::-1])


@pytest.mark.parametrize(
    "name, edit, message",
    [
        ("rig.yaml", lambda text: None, "rig.yaml is missing"),
        ("rig.yaml", lambda text: "%YAML:1.0\n---\nfront: [", "rig.yaml is not a file"),
        ("rig.yaml", lambda text: text.replace("camera_matrix", "matrix"), "no 3 × 3 camera_matrix"),
        ("rig.yaml", lambda text: text.replace("front_from_back", "x"), "no 4 × 4 front_from_back"),
        ("rig.yaml", lambda text: text.replace("srgb", "film"), 'must be "srgb" or a curve, got "film"'),
        ("board.yaml", lambda text: text.replace("border_bits", "x"), "no number border_bits"),
        ("frames.csv", lambda text: None, "no frames.csv"),
        ("frames.csv", lambda text: text.replace("exposure", "x"), "no column exposure"),
        ("frames.csv", lambda text: text.replace(",back,", ",left,"), 'back or front, got "left"'),
        ("frames.csv", lambda text: text.replace("0.1,", "soon,"), 'finite number, got "soon"'),
        (
            "frames.csv",
            lambda text: text.replace(".png", "#x"),
            'picture or video#number, got "back/00000#x"',
        ),
        ("frames.csv", lambda text: text.split("\n")[0] + "\n", "lists no pictures"),
    ],
)
def test_bad_recordings(folder, tmp_path, name, edit, message):
    text = run("--recording", edited(folder, tmp_path, name, edit), "--headless", code=2)
    assert message in text


@pytest.mark.parametrize(
    "arguments, message",
    [
        ((), "expected one of --simulate, --recording DIR and --back CAMERA, got none"),
        (("--recording", "nowhere"), "no recording at nowhere"),
        (("--back", 0), "expected --rig"),
        (("--recording", "x", "--back", 0), "got several"),
        (("--recording", "x", "--height", -1), 'expected a number above 0, got "-1"'),
        (("--recording", "x", "--exponent", "nan"), 'expected 0 or more, got "nan"'),
        (("--recording", "x", "--diffuse", "1,2"), "--diffuse"),
        (("--recording", "x", "--glossy", "1,2,-3"), "at least 0, got 1, 2, -3"),
        (("--recording", "x", "--supersampling", 9), "9 not in range"),
        (("--recording", "x", "--methods", "magic"), "magic not in {auto,paper}"),
        (("--recording", "x", "--nonsense"), "--nonsense"),
        (("--recording", "FOLDER", "--out", "no-such-folder/a.webm"), "no folder no-such-folder"),
        (("--recording", "FOLDER", "--out", "a.mp4"), "expected a .webm, a .png or a folder"),
        (("--recording", "FOLDER", "--object", "nowhere.obj"), "no mesh at nowhere.obj"),
    ],
)
def test_bad_arguments(folder, arguments, message):
    arguments = [folder if argument == "FOLDER" else argument for argument in arguments]
    assert message in run(*arguments, "--headless", code=2)


@pytest.mark.parametrize(
    "text, message",
    [
        ("v 0 0\n", "line 1: expected three numbers"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", 'line 4: expected a vertex from 1 to 3, got "4"'),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", 'got "x"'),
        ("v 0 0 0\nv 1 0 0\nf 1 2\n", "at least 3 corners, got 2"),
        ("v 0 0 0\n", "holds no triangles"),
        ("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n", "without extent along z"),
    ],
)
def test_bad_objects(folder, tmp_path, text, message):
    (tmp_path / "bad.obj").write_text(text)
    assert message in run("--recording", folder, "--object", tmp_path / "bad.obj", "--headless", code=2)


def test_help_and_version():
    assert "Examples:" in run("--help")
    assert fastibl.__version__ in run("--version")


def test_no_display(folder):
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    assert "use --headless" in run("--recording", folder, code=2, env=env)


@pytest.mark.skipif(not shutil.which("xvfb-run"), reason="needs xvfb-run")
def test_window(folder, tmp_path):
    shot = tmp_path / "shot.png"
    command = [
        "xvfb-run",
        "-a",
        PROGRAM,
        "--recording",
        folder,
        "--screenshot",
        shot,
        "--frames",
        "3",
        "--no-interface",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if "built without a window" in done.stderr:
        pytest.skip("fastibl-demo is built without a window")
    assert done.returncode == 0, done.stderr
    assert "space" in done.stdout  # the keys
    window = cv2.imread(str(shot))
    run("--recording", folder, "--headless", "--out", tmp_path / "last.png", "--frames", 3)
    picture = cv2.imread(str(tmp_path / "last.png"))
    assert window.shape == picture.shape and window.mean() > 20
    assert np.abs(window.astype(int) - picture).max() <= 1
