"""Recordings keep what was written to the bit, and say what is missing."""

import resource
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_pictures import held
from standin import Page

import fastibl
from fastibl import Board, Camera, CubeMap, Frame, Pose, Recording, Response, Rig
from fastibl.__main__ import main
from fastibl.recorder import Recorder
from fastibl.recording import (
    RecordingWarning,
    RecordingWriter,
    Truth,
    read_board,
    read_rig,
    write_attitudes,
    write_board,
    write_rig,
)
from hostile import ENDLESS, NESTED

RNG = np.random.default_rng(5)
TURN = Pose.from_rotation_vector([0.1, 3.0, 0.02], [0.01, -0.02, 0.003])


def cameras():
    curve = np.linspace(0, 1, 33) ** 2.1
    back = Camera(48, 32, 41.123456789, 40.9, 23.7, 16.4, (0.1, -0.2, 0.001, 0.002, 0.03), gain=1.25)
    front = Camera(40, 30, 30, 30.5, 20.25, 15, response=Response.from_curve(curve), vignetting=(-0.3, 0.07))
    return back, front


def frames(count=5):
    def picture(height, width):
        return RNG.integers(0, 256, (height, width, 3), dtype=np.uint8)

    return [
        Frame(k / 7, picture(32, 48), picture(30, 40), back_exposure=0.3, front_exposure=0.7 / 16 ** (k % 3))
        for k in range(count)
    ]


def write(path, given, video=False, rig=None, board=None, truth=None):
    with RecordingWriter(path, rig or Rig(*cameras(), TURN), board, video=video) as writer:
        for frame in given:
            writer.add(frame)
        if truth is not None:
            writer.write_truth(truth)
    return path


def test_frame():
    frame = Frame(0.5)
    assert (frame.back, frame.front, frame.back_exposure, frame.front_exposure) == (None, None, 1.0, 1.0)
    assert frame.back_from_marker is None
    assert frame == Frame(0.5) and frame != Frame(0.5, back=np.zeros((2, 2, 3), np.uint8))
    assert frame != 3 and "no picture" in repr(frame)


@pytest.mark.parametrize("video", [False, True])
def test_round_trip_keeps_every_bit(tmp_path, video):
    given, rig = frames(), Rig(*cameras(), TURN)
    recording = Recording.open(write(tmp_path / "r", given, video, rig))
    assert len(recording) == 5 and recording.path == tmp_path / "r"
    assert list(recording) == given
    assert list(recording) == given  # again
    assert recording[3] == given[3] and recording[1] == given[1]
    assert recording.times == [f.time for f in given]
    assert recording.duration == pytest.approx(4 / 7)
    assert recording.board is None and recording.truth is None
    assert (tmp_path / "r" / "back.mkv").is_file() == video
    assert recording.rig.back == rig.back and recording.rig.front == rig.front
    assert "5 frames" in repr(recording)


def test_frames_with_matrices_are_compared():
    pose = Pose(np.eye(4))
    a, b = Frame(0.0, back_from_marker=np.eye(4)), Frame(0.0, back_from_marker=pose)
    assert a == b == Frame(0.0, back_from_marker=np.eye(4)) and a != Frame(0.0)
    assert Frame(0.0, back_last_row=TURN) != Frame(0.0, back_last_row=pose)
    assert Frame(0.0, back_last_row=TURN.matrix) == Frame(0.0, back_last_row=TURN)


def test_attitudes_are_kept(tmp_path):
    given = frames(4)
    given[1].attitude, given[3].attitude = TURN.rotation, np.eye(3)
    path = write(tmp_path / "r", given)
    read = list(Recording.open(path))
    assert read == given and read[2].attitude is None
    given[1].attitude = np.eye(3)
    assert read != given
    for frame in given[2:]:  # of one time: each its own
        frame.time = given[1].time
    given[2].attitude = TURN.rotation
    assert list(Recording.open(write(path, given))) == given
    write(path, frames(2))  # an older one's go with it
    assert not (path / "attitudes.csv").exists()


def test_attitudes_of_frames_of_one_time_stay_theirs(tmp_path):
    given = frames(6)
    for frame, time in zip(given, (0.0, 0.0, 0.0, 0.1, 0.2, 0.2), strict=True):
        frame.time = time
    given[1].attitude, given[4].attitude = TURN.rotation, np.eye(3)
    path = write(tmp_path / "r", given)
    assert list(Recording.open(path)) == given
    assert write_attitudes(path, [None, None, np.eye(3), None, None, TURN.rotation]) == 2
    told = [f.attitude is not None for f in Recording.open(path)]
    assert told == [False, False, True, False, False, True]


def test_cameras_of_one_time_have_one_attitude(tmp_path):
    both = frames(1)[0]
    given = [Frame(0.0, both.back), Frame(0.0, front=both.front, attitude=TURN.rotation), Frame(0.0, both.back)]
    read = list(Recording.open(write(tmp_path / "r", given)))
    assert [f.attitude is not None for f in read] == [True, False] and read[0].front is not None


@pytest.mark.parametrize("size", [(49, 32), (48, 31)])
def test_videos_of_odd_sizes_are_refused(tmp_path, size):
    """OpenCV would leave the last row or column out. What is there stays."""
    path = write(tmp_path / "r", frames(2))
    rig = Rig(Camera(*size, 40, 40, 24, 16))
    with pytest.raises(ValueError, match=f"even width and height, but the back camera's .* {size[0]} x {size[1]}"):
        RecordingWriter(path, rig, video=True)
    assert len(Recording.open(path)) == 2
    picture = RNG.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    assert list(Recording.open(write(tmp_path / "s", [Frame(0.0, picture)], rig=rig))) == [Frame(0.0, picture)]


COLUMNS = "time,m00,m01,m02,m10,m11,m12,m20,m21,m22\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,x,y\n", "columns"),
        (COLUMNS + "0,1,2\n", "line 2: expected ten"),
        (COLUMNS + "0,1,0,0,0,1,0,0,0,1\n1,1,0,0,0,1,0,0,0,nan\n", "line 3: the attitude must be a rotation"),
        (COLUMNS + "0,1,0,0,0,1,0,0,0,one\n", "line 2: expected ten"),
        (COLUMNS + "0,1,0,0,0,1,0,0,0,-1\n", "line 2: the attitude must be a rotation"),  # a mirror
        (COLUMNS + "\n", "line 2: expected ten"),
    ],
)
def test_bad_attitudes(tmp_path, text, message):
    path = write(tmp_path / "r", frames(1))
    (path / "attitudes.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        Recording.open(path)


def test_an_attitude_that_a_crash_cut_off_is_left_out(tmp_path):
    path = write(tmp_path / "r", frames(2))
    (path / "attitudes.csv").write_text(COLUMNS + "0.0,1,0,0,0,1,0,0,0,1\n0.1428571,0,1")
    with pytest.warns(RecordingWarning, match="cut off"):
        recording = Recording.open(path)
    assert np.array_equal(recording[0].attitude, np.eye(3)) and recording[1].attitude is None


def test_nothing_is_written_or_read_through_links_that_lead_out(tmp_path):
    path = write(tmp_path / "r", frames(1))
    secret = tmp_path / "secret"
    secret.write_text("mine\n")
    (path / "attitudes.csv.part").symlink_to(secret)
    write_attitudes(path, [np.eye(3)])
    assert secret.read_text() == "mine\n" and not (path / "attitudes.csv").is_symlink()
    for name in ("attitudes.csv", "frames.csv", "board.yaml", "rig.yaml"):
        (path / name).unlink(missing_ok=True)
        (path / name).symlink_to(secret)
        with pytest.raises(OSError, match="leads out of the recording"):
            Recording.open(path)
        if name.endswith(".csv"):
            with pytest.raises(OSError, match="leads out of the recording"):
                write_attitudes(path, [np.eye(3)])
    assert secret.read_text() == "mine\n"


@pytest.mark.parametrize("attitude", [(1, 2), 0.5, np.full((3, 3), np.inf), "left", 2 * np.eye(3)])
def test_writer_refuses_what_is_no_attitude(tmp_path, attitude):
    frame = frames(1)[0]
    frame.attitude = attitude
    with pytest.raises(ValueError, match="must be a rotation"):
        write(tmp_path / "r", [frame])


def test_rig_round_trip(tmp_path):
    rig = Rig(*cameras(), TURN)
    write_rig(tmp_path / "rig.yaml", rig)
    read = read_rig(tmp_path / "rig.yaml")
    assert read.back == rig.back and read.front == rig.front
    np.testing.assert_array_equal(read.front_from_back.matrix, TURN.matrix)
    import cv2

    storage = cv2.FileStorage(str(tmp_path / "rig.yaml"), cv2.FILE_STORAGE_READ)
    matrix = storage.getNode("back").getNode("camera_matrix").mat()
    assert matrix[0, 2] == pytest.approx(23.7 - 0.5)  # OpenCV's convention
    write_rig(tmp_path / "one.yaml", Rig(rig.back))
    assert read_rig(tmp_path / "one.yaml") == Rig(rig.back)


def test_a_calibration_that_cannot_be_written_leaves_the_one_before(tmp_path, monkeypatch):
    path = tmp_path / "rig.yaml"
    write_rig(path, Rig(*cameras(), TURN))
    before = path.read_bytes()

    def full(self, data):
        with self.open("wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space"):
        write_rig(path, Rig(cameras()[0]))
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["rig.yaml"]


def test_links_and_devices_stay_what_they_are(tmp_path):
    (tmp_path / "there").mkdir()
    link = tmp_path / "rig.yaml"
    link.symlink_to(tmp_path / "there" / "real.yaml")
    write_rig(link, Rig(cameras()[0]))
    assert link.is_symlink() and read_rig(tmp_path / "there" / "real.yaml") == Rig(cameras()[0])
    write_rig("/dev/null", Rig(cameras()[0]))
    assert not Path("/dev/null").is_file()


def test_a_file_keeps_its_mode_and_may_have_any_name(tmp_path):
    for name in ("rig.yaml", "n" * 250 + ".yaml"):
        path = tmp_path / name
        write_rig(path, Rig(cameras()[0]))
        path.chmod(0o600)
        write_rig(path, Rig(cameras()[0]))
        assert path.stat().st_mode & 0o777 == 0o600
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_nested_calibrations_are_refused(tmp_path, text):
    for name, read in (("rig.yaml", read_rig), ("board.yaml", read_board)):
        (tmp_path / name).write_text(text)
        with pytest.raises(ValueError, match=f"{name} nests more than 32 levels"):
            read(tmp_path / name)


def test_binary_calibrations_are_refused(tmp_path):
    (tmp_path / "rig.yaml").write_text(ENDLESS)
    with pytest.raises(ValueError, match="holds binary data; expected numbers as text"):
        read_rig(tmp_path / "rig.yaml")


def test_calibrations_as_json_and_xml(tmp_path):
    """OpenCV's other two kinds, as its writer has them."""
    rig = Rig(*cameras(), TURN)
    write_rig(tmp_path / "rig.yaml", rig)
    read = cv2.FileStorage(str(tmp_path / "rig.yaml"), cv2.FILE_STORAGE_READ)

    def copy(node, to):
        for key in node.keys():
            item = node.getNode(key)
            if item.isMap() and not item.getNode("dt").empty():
                to.write(key, item.mat())
            elif item.isMap():
                to.startWriteStruct(key, cv2.FileNode_MAP)
                copy(item, to)
                to.endWriteStruct()
            else:
                to.write(key, item.string() if item.isString() else item.real())

    for name in ("rig.json", "rig.xml"):
        to = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        copy(read.root(), to)
        to.release()
        assert read_rig(tmp_path / name) == rig


def test_board_round_trip(tmp_path):
    board = Board.default()
    write_board(tmp_path / "board.yaml", board)
    read = read_board(tmp_path / "board.yaml")
    assert (read.width, read.height, read.border_bits) == (board.width, board.height, board.border_bits)
    assert [t.id for t in read.tags] == [t.id for t in board.tags]
    np.testing.assert_array_equal(read.tags[7].corners, board.tags[7].corners)
    write_board(tmp_path / "page.yaml", Page())
    assert read_board(tmp_path / "page.yaml") is None


def test_truth_round_trip(tmp_path):
    maps = [(0.0, CubeMap(RNG.random((6, 4, 4, 3)))), (0.3, CubeMap(RNG.random((6, 4, 4, 3))))]
    poses = [(k / 7, Pose.from_rotation_vector(RNG.normal(size=3), RNG.normal(size=3))) for k in range(5)]
    truth = Truth(maps, poses, lamp_time=0.3, hand=(0.4, 0.5), position=(0.0, 0.0, 0.05))
    read = Recording.open(write(tmp_path / "r", frames(), truth=truth)).truth
    assert read.environment(0.0) == maps[0][1] and read.environment(0.29) == maps[0][1]
    assert read.environment(0.3) == maps[1][1]
    np.testing.assert_array_equal(read.pose(3 / 7).matrix, poses[3][1].matrix)
    assert (read.lamp_time, read.hand, read.position) == (0.3, (0.4, 0.5), (0.0, 0.0, 0.05))
    with pytest.raises(LookupError, match="no true pose"):
        read.pose(0.05)
    with pytest.raises(LookupError, match="no true environment"):
        Truth().environment(0)


def test_cameras_need_not_be_in_step(tmp_path):
    given = frames(3)
    given[1].front = None
    given[2].back = None
    recording = Recording.open(write(tmp_path / "r", given))
    assert [(f.back is None, f.front is None) for f in recording] == [
        (False, False),
        (False, True),
        (True, False),
    ]


def test_an_older_recording_is_replaced_but_nothing_else(tmp_path):
    write(tmp_path / "r", frames(5), video=True)
    write(tmp_path / "r", frames(2))
    assert len(list(Recording.open(tmp_path / "r"))) == 2
    assert not (tmp_path / "r" / "back.mkv").exists()
    (tmp_path / "r" / "notes.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="notes.txt"):
        write(tmp_path / "r", frames(1))
    assert len(list(Recording.open(tmp_path / "r"))) == 2
    with pytest.raises(FileExistsError, match="is a file"):
        RecordingWriter(tmp_path / "r" / "notes.txt", Rig(cameras()[0]))


def test_pictures_of_16_bits_stay(tmp_path):
    deep = RNG.integers(0, 65536, (32, 48, 3), dtype=np.uint16)
    given = [Frame(0.0, deep), Frame(0.1, (deep >> 8).astype(np.uint8))]
    write(tmp_path / "r", given, rig=Rig(cameras()[0]))
    read = [f.back for f in Recording.open(tmp_path / "r")]
    assert [p.dtype for p in read] == [np.uint16, np.uint8]
    assert all(np.array_equal(p, f.back) for p, f in zip(read, given, strict=True))
    with (
        RecordingWriter(tmp_path / "v", Rig(cameras()[0]), video=True) as writer,
        pytest.raises(ValueError, match=r"\(h, w, 3\) uint8, got \(32, 48, 3\) uint16"),
    ):
        writer.add(given[0])


def test_writer_refuses_what_is_no_picture(tmp_path):
    with RecordingWriter(tmp_path / "r", Rig(cameras()[0])) as writer:
        with pytest.raises(ValueError, match="uint8"):
            writer.add(Frame(0.0, back=np.zeros((4, 4, 3))))
        with pytest.raises(ValueError, match="uint8"):
            writer.add(Frame(0.0, back=np.zeros((4, 4), np.uint8)))
        with pytest.raises(ValueError, match="48 x 32 pixels, as its camera in the rig, got 18 x 16"):
            writer.add(Frame(0.1, back=np.zeros((16, 18, 3), np.uint8)))
        with pytest.raises(ValueError, match="no front camera"):
            writer.add(frames(1)[0])
    with RecordingWriter(tmp_path / "both", Rig(*cameras(), TURN)) as writer:
        broken = frames(1)[0]
        broken.front = broken.front / 255.0
        with pytest.raises(ValueError, match="the front picture must be"):
            writer.add(broken)
    assert len(Recording.open(tmp_path / "both")) == 0  # nor the back picture


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(
    "name", ["back/IMG_1.jpg", "front/00001.jpg", "truth/notes.txt", "back/more/00000.png", "front"]
)
@pytest.mark.parametrize("rig", [False, True])
def test_pictures_that_no_recording_wrote_are_never_deleted(name, rig, tmp_path):
    """Folders of pictures, back/ and front/, look like a recording: FolderSource reads them."""
    mine = tmp_path / "shots" / name
    mine.parent.mkdir(parents=True)
    mine.write_bytes(b"mine")
    if rig:
        write_rig(tmp_path / "shots" / "rig.yaml", Rig(*cameras(), TURN))
    before = contents(tmp_path)
    with pytest.raises(FileExistsError, match="choose another folder"):
        RecordingWriter(tmp_path / "shots", Rig(*cameras(), TURN))
    assert contents(tmp_path) == before


def test_numbered_pictures_without_a_rig_are_not_deleted(tmp_path):
    (tmp_path / "back").mkdir()
    (tmp_path / "back" / "00000.png").write_bytes(b"mine")
    with pytest.raises(FileExistsError, match="no rig.yaml"):
        RecordingWriter(tmp_path, Rig(*cameras(), TURN))
    assert (tmp_path / "back" / "00000.png").read_bytes() == b"mine"


def test_folders_and_links_of_a_recordings_names_are_not_deleted(tmp_path):
    path = write(tmp_path / "r", frames(2))
    (path / "frames.csv").unlink()
    (path / "frames.csv").mkdir()
    elsewhere = tmp_path / "elsewhere"
    (path / "back").rename(elsewhere)
    before = contents(tmp_path)
    for name in ("frames.csv", "back"):
        with pytest.raises(FileExistsError, match=f"holds {name}, which"):
            RecordingWriter(path, Rig(*cameras(), TURN))
        assert contents(tmp_path) == before
        if name == "frames.csv":
            (path / "frames.csv").rmdir()
            (path / "back").symlink_to(elsewhere)
            before = contents(tmp_path)


def test_an_older_recording_stays_where_a_new_one_cannot_begin(tmp_path):
    path = write(tmp_path / "r", frames(2))
    before = contents(path)
    with pytest.raises(TypeError, match="rig must be Rig, got Camera"):
        RecordingWriter(path, cameras()[0])
    with pytest.raises(TypeError, match="board must be Board, got int"):
        RecordingWriter(path, Rig(*cameras(), TURN), board=3)
    with pytest.raises(OSError, match="are free where"):
        Recorder(path, Rig(*cameras(), TURN), least_free=10**18)
    assert contents(path) == before


def read_until_it_breaks(path, message):
    recording, read = Recording.open(path), []
    with pytest.warns(RecordingWarning, match=message):
        for frame in recording:
            read.append(frame)
    return read


def test_pictures_are_the_sensors_however_the_telephone_was_held(tmp_path):
    path = write(tmp_path / "r", frames(1))
    jpeg = cv2.imencode(".jpg", cv2.imread(str(path / "back" / "00000.png")))[1].tobytes()
    expected = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    (path / "back" / "00000.jpg").write_bytes(held(jpeg, 6))
    listed = path / "frames.csv"
    listed.write_text(listed.read_text().replace("back/00000.png", "back/00000.jpg"))
    assert np.array_equal(Recording.open(path)[0].back, expected)


def test_a_missing_or_cut_picture_ends_the_recording(tmp_path):
    given = frames()
    path = write(tmp_path / "r", given)
    picture = path / "front" / "00003.png"
    whole = picture.read_bytes()
    picture.write_bytes(whole[: len(whole) // 2])
    assert read_until_it_breaks(path, r"front.00003\.png cannot be read.*3 of 5 frames") == given[:3]
    picture.write_bytes(b"")
    assert read_until_it_breaks(path, r"00003\.png cannot be read") == given[:3]
    picture.unlink()
    assert read_until_it_breaks(path, r"front.00003\.png is missing.*3 of 5 frames") == given[:3]
    with pytest.raises(FileNotFoundError, match="00003.png"):
        Recording.open(path)[3]


def test_a_cut_video_ends_the_recording(tmp_path):
    given = frames(20)
    path = write(tmp_path / "r", given, video=True)
    video = path / "front.mkv"
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) * 2 // 3])
    read = read_until_it_breaks(path, r"front\.mkv ends after \d+ frames")
    assert 5 < len(read) < 19 and read == given[: len(read)]
    video.write_bytes(b"no video")
    assert read_until_it_breaks(path, r"front\.mkv cannot be read") == []
    video.unlink()
    assert read_until_it_breaks(path, r"front\.mkv is missing") == []


def test_missing_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="no recording at"):
        Recording.open(tmp_path / "nowhere")
    path = write(tmp_path / "r", frames(1))
    for name in ("rig.yaml", "frames.csv"):
        broken = tmp_path / f"without-{name}"
        shutil.copytree(path, broken)
        (broken / name).unlink()
        with pytest.raises(FileNotFoundError, match=name):
            Recording.open(broken)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,camera,file\n", "no column exposure"),
        ("", "no column"),
        ("time,camera,file,exposure\nsoon,back,a.png,1\n", "line 2: time and exposure"),
        ("time,camera,file,exposure\n0,back,a.png\n", "line 2: time and exposure"),
        ("time,camera,file,exposure\n0,back,a.png,0\n", "positive"),
        ("time,camera,file,exposure\nnan,back,a.png,1\n", "finite"),
        ("time,camera,file,exposure\n0,side,a.png,1\n", "back or front"),
        ("time,camera,file,exposure\n0,back,a.mkv#x,1\n", "video#number"),
        ("time,camera,file,exposure\n0,back,,1\n", "video#number"),
        ("time,camera,exposure,file\n0,back,1\n", "video#number"),
        ("time,camera,file,exposure\n0,back,a.mkv#" + 5000 * "7" + ",1\n", "video#number"),
    ],
)
def test_bad_frame_lists(tmp_path, text, message):
    path = write(tmp_path / "r", frames(1))
    (path / "frames.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        Recording.open(path)


@pytest.mark.parametrize(
    ("find", "replace", "message"),
    [
        ("camera_matrix", "matrix", "no camera_matrix of the back camera"),
        ("width", "wide", "no number width"),
        ("back:", "rear:", "no back camera"),
        ("front_from_back", "pose", "no front_from_back"),
        ("response: srgb", "response: film", "srgb"),
    ],
)
def test_bad_rigs(tmp_path, find, replace, message):
    path = write(tmp_path / "r", frames(1))
    text = (path / "rig.yaml").read_text()
    assert find in text
    (path / "rig.yaml").write_text(text.replace(find, replace, 1))
    with pytest.raises(ValueError, match=message):
        Recording.open(path)


def test_a_rig_that_is_no_yaml(tmp_path):
    path = write(tmp_path / "r", frames(1))
    for text in ("", "no yaml", "%YAML:1.0\n---\nback: [1, 2"):
        (path / "rig.yaml").write_text(text)
        with pytest.raises((ValueError, OSError), match="rig.yaml"):
            Recording.open(path)


def test_front_pictures_without_a_front_camera(tmp_path):
    path = write(tmp_path / "r", frames(1))
    write_rig(path / "rig.yaml", Rig(cameras()[0]))
    with pytest.raises(ValueError, match="no front camera"):
        Recording.open(path)


def test_broken_truth(tmp_path):
    truth = Truth([(0.0, CubeMap(RNG.random((6, 4, 4, 3))))], [(0.0, TURN)])
    path = write(tmp_path / "r", frames(1), truth=truth)
    (path / "truth" / "map-0.npy").unlink()
    with pytest.raises(FileNotFoundError, match="map-0.npy"):
        Recording.open(path)
    (path / "truth" / "maps.csv").write_text("time,file\n")
    (path / "truth" / "poses.csv").write_text("time,m\n0,1,2\n")
    with pytest.raises(ValueError, match="truth"):
        Recording.open(path)


def test_truth_in_any_order(tmp_path):
    truth = Truth([(0.0, CubeMap(RNG.random((6, 4, 4, 3))))], [(0.0, TURN), (5.0, TURN @ TURN)], lamp_time=0.3)
    path = write(tmp_path / "r", frames(1), truth=truth)
    listed = (path / "truth" / "poses.csv").read_text().splitlines()
    (path / "truth" / "poses.csv").write_text("\n".join((listed[0], listed[2], "", listed[1])))
    read = Recording.open(path).truth
    np.testing.assert_array_equal(read.pose(5.0).matrix, (TURN @ TURN).matrix)
    np.testing.assert_array_equal(read.pose(0.0).matrix, TURN.matrix)
    for events in (
        '{"lamp": "x"}',
        '{"position": [1]}',
        '{"position": [0, 0, "nan"]}',
        '{"clock_offset": "nan"}',
        '{"hand": [1]}',
    ):
        (path / "truth" / "events.json").write_text(events)
        with pytest.raises(ValueError, match="truth cannot be read"):
            Recording.open(path)


def test_a_video_that_did_not_fit_is_told(tmp_path):
    """As on a full disk: OpenCV says nothing."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    writer = RecordingWriter(tmp_path / "r", Rig(cameras()[0]), video=True)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))
    try:
        for frame in frames(60):
            writer.add(Frame(frame.time, frame.back))
        with pytest.raises(OSError, match=r"back\.mkv holds \d+ of 60 pictures"):
            writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    writer.close()  # was told


def test_threads_that_iterate_one_video(tmp_path):
    """FFmpeg ends the process where two threads read at once."""
    given = frames(40)
    recording = Recording.open(write(tmp_path / "r", given, video=True))
    with ThreadPoolExecutor(3) as threads:
        for read in threads.map(list, [recording] * 3):
            assert len(read) == 40 and all(np.array_equal(a.back, b.back) for a, b in zip(read, given, strict=True))


def test_frames_without_a_back_picture(tmp_path):
    given = frames(3)
    given[1].back = None
    for recording in (Recording(Rig(*cameras(), TURN), given), Recording.open(write(tmp_path / "r", given))):
        assert recording.pictured("back") == [0, 2] and recording.pictured("front") == [0, 1, 2]
        assert recording.back_times == [given[0].time, given[2].time]


def test_a_response_that_files_do_not_hold_is_refused_before_anything_is_written(tmp_path):
    camera = cameras()[0].replace(response=Response.from_curve(np.linspace(0, 1, 65536) ** 2))
    with pytest.raises(ValueError, match="65536 values.*up to 16384"):
        RecordingWriter(tmp_path / "r", Rig(camera))
    assert not (tmp_path / "r").exists()
    camera = cameras()[0].replace(response=Response.from_curve(np.linspace(0, 1, 16384) ** 2))
    write_rig(tmp_path / "rig.yaml", Rig(camera))
    assert read_rig(tmp_path / "rig.yaml") == Rig(camera)


def test_ids_are_whole(tmp_path):
    write_board(tmp_path / "board.yaml", Board.default())
    text = (tmp_path / "board.yaml").read_text()
    ids = text.index("ids:")
    (tmp_path / "board.yaml").write_text(
        text[:ids] + text[ids:].replace("dt: i", "dt: d", 1).replace("[ 0,", "[ 0.5,", 1)
    )
    with pytest.raises(ValueError, match="ids must be whole numbers"):
        read_board(tmp_path / "board.yaml")


def test_command(tmp_path, capsys):
    out = str(tmp_path / "r")
    assert main(["simulate", out, "--seconds", "0.2", "--fps", "10", "--size", "64x48"]) == 0
    assert "2 frames" in capsys.readouterr().out
    recording = fastibl.Recording.open(out)
    assert [f.front.shape for f in recording] == [(48, 64, 3)] * 2
    assert main(["simulate", out, "--environment", str(tmp_path / "x.hdr")]) == 2
    assert "x.hdr" in capsys.readouterr().err
    for arguments in (
        ["simulate"],
        ["simulate", out, "--size", "64"],
        ["simulate", out, "--seconds", "-1"],
        ["simulate", out, "--fps", "fast"],
        ["nothing"],
        [],
    ):
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        assert stop.value.code == 2
        assert "error" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main(["simulate", "--help"])
    assert stop.value.code == 0
    assert "example:" in capsys.readouterr().out


def test_opencv_is_imported_only_where_it_is_used():
    code = "import sys, fastibl; fastibl.Frame(0.0), fastibl.Recording; assert 'cv2' not in sys.modules"
    root = Path(fastibl.__file__).parents[1]
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)


def test_pictures_of_one_time_are_all_kept(tmp_path):
    given = frames(4)
    for frame, time in zip(given, (0.0, 0.1, 0.1, 0.2), strict=True):
        frame.time = time
    given[1].front = None
    write(tmp_path, given)
    recording = Recording.open(tmp_path)
    assert recording.times == [0.0, 0.1, 0.1, 0.2]
    for frame, found in zip(given, recording, strict=True):
        assert np.array_equal(frame.back, found.back)


@pytest.mark.parametrize(
    "change",
    [{"time": np.nan}, {"time": np.inf}, {"back_exposure": 0.0}, {"front_exposure": -1.0}, {"back_exposure": np.nan}],
)
def test_writer_refuses_what_could_not_be_read(tmp_path, change):
    frame = frames(1)[0]
    for name, value in change.items():
        setattr(frame, name, value)
    with RecordingWriter(tmp_path, Rig(*cameras(), TURN)) as writer:
        writer.add(frames(1)[0])
        with pytest.raises(ValueError, match=r"must be (finite|positive)"):
            writer.add(frame)
    assert len(Recording.open(tmp_path)) == 1


def test_poses_that_are_not_kept_are_told_of(tmp_path):
    with RecordingWriter(tmp_path, Rig(*cameras(), TURN)) as writer:
        with pytest.warns(RecordingWarning, match="keeps no given poses"):
            writer.add(Frame(0.0, frames(1)[0].back, back_from_marker=TURN))


def test_lists_that_a_spreadsheet_saved(tmp_path):
    """With a mark in front, Windows' ends of lines, and spaces after commas."""
    given = frames(2)
    write(tmp_path, given)
    text = (tmp_path / "frames.csv").read_text()
    (tmp_path / "frames.csv").write_bytes(("\ufeff" + text.replace(",", ", ").replace("\n", "\r\n")).encode())
    recording = Recording.open(tmp_path)
    assert [f.back_exposure for f in recording] == [f.back_exposure for f in given]
