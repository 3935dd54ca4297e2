"""fastibl calibrate: what a rig has to know of itself, measured."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._arguments import board_of, parser
from ._arguments import response as response_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .._fastibl import Board, Camera, Pose, Rig


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(
        commands,
        "calibrate",
        None,
        "measure lenses, responses, the board and the rig",
        "fastibl calibrate camera *.png",
    )
    subjects = made.add_subparsers(metavar="SUBJECT", required=True)

    camera = parser(
        subjects,
        "camera",
        run_camera,
        "focal lengths, centre and distortion, from pictures of the board",
        "fastibl calibrate camera shots/*.png --rig rig.yaml\n  fastibl calibrate camera film.mp4",
    )
    _pictures(camera)
    camera.add_argument(
        "--fisheye", action="store_true", help="a fisheye (Kannala and Brandt) instead of a perspective lens"
    )
    camera.add_argument(
        "--field-of-view", type=float, metavar="DEGREES",
        help="across a fisheye's circle, outside which its pictures show nothing (default: all of the picture)",
    )  # fmt: skip
    camera.add_argument(
        "--terms", type=int, choices=(4, 5, 8), default=5, help="of the distortion (default: %(default)s)"
    )
    camera.add_argument(
        "--response", type=response_of, metavar="CURVE",
        help='from light to code: "srgb" or an exponent, 1 for linear pictures (default: that of rig.yaml, or srgb)',
    )  # fmt: skip
    _board(camera)

    response = parser(
        subjects,
        "response",
        run_response,
        "the curve from light to code, from exposures of one still place",
        "fastibl calibrate response 1.png 2.png 3.png --exposures 1 4 16 --rig rig.yaml",
    )
    _pictures(response)
    response.add_argument("--exposures", type=float, nargs="+", required=True, help="of each picture, in any unit")
    response.add_argument("--dark", type=Path, metavar="PICTURE", help="with the lens covered, for the black level")

    board = parser(
        subjects,
        "board",
        run_board,
        "where the printed tags are, from pictures of the whole board",
        "fastibl calibrate board shots/*.png --rig rig.yaml --measured 12 15 0.2395 --out board.yaml",
    )
    _pictures(board)
    _board(board)
    board.add_argument(
        "--measured", nargs=3, metavar=("TAG", "TAG", "METRES"),
        help="distance of two tags' centres by a ruler, the farther apart the better",
    )  # fmt: skip
    board.add_argument("--out", type=Path, default=Path("board.yaml"), help="default: %(default)s")

    rig = parser(
        subjects,
        "rig",
        run_rig,
        "front_from_back, from a recording in which each camera sees a board of its own",
        "fastibl calibrate rig my-recording --front-board second.yaml --rig rig.yaml",
    )
    rig.add_argument("recording", type=Path)
    _board(rig)
    rig.add_argument("--front-board", type=Path, required=True, help="board.yaml of the board before the front camera")
    rig.add_argument(
        "--rig", type=Path, default=Path("rig.yaml"), help="with both cameras, to be completed (%(default)s)"
    )

    timing = parser(
        subjects,
        "timing",
        run_timing,
        "the readout of a rolling shutter, from a recording in which the camera turns briskly before the board",
        "fastibl calibrate timing my-recording --rig rig.yaml",
    )
    timing.add_argument("recording", type=Path)
    timing.add_argument("--camera", choices=("back", "front"), default="back", help="which one (default: %(default)s)")
    timing.add_argument("--rig", type=Path, default=Path("rig.yaml"), help="with the camera's lens (%(default)s)")
    timing.add_argument(
        "--against-back",
        action="store_true",
        help="with --camera front: also by how much the front camera's clock is ahead, where both see the board",
    )
    timing.add_argument(
        "--gyro",
        type=Path,
        metavar="LOG",
        help="a gyroscope's log (time and three rates, as telephones write it): also its clock and its axes",
    )
    timing.add_argument(
        "--attitudes",
        action="store_true",
        help="with --gyro: writes into the recording how the camera turned by it, for where the board is out of view",
    )
    _board(timing)


def _pictures(to: argparse.ArgumentParser) -> None:
    to.add_argument("pictures", type=Path, nargs="+", help="picture files, or one film or recording's folder")
    to.add_argument("--camera", choices=("back", "front"), default="back", help="which one (default: %(default)s)")
    to.add_argument("--rig", type=Path, default=Path("rig.yaml"), help="to read and to write (default: %(default)s)")
    to.add_argument(
        "--most", type=int, default=60, help="pictures of a film or recording, evenly chosen (default: %(default)s)"
    )


def _board(to: argparse.ArgumentParser) -> None:
    to.add_argument("--board", type=Path, help="board.yaml (default: the default board)")


def _read_pictures(arguments: argparse.Namespace, any_depth: bool = True) -> list[NDArray[Any]]:
    return _read_shots(arguments, any_depth)[0]


def _read_shots(
    arguments: argparse.Namespace, any_depth: bool = True, in_a_row: int = 1
) -> tuple[list[NDArray[Any]], list[float] | None]:
    """The pictures, and their times if they are from a recording or a film. Of these, groups of `in_a_row` successive
    pictures are taken."""
    from ..camera_files import HDR_ADVICE, hdr_curve, is_film_name, read_pixels

    paths: list[Path] = arguments.pictures
    if arguments.most < 1:
        raise ValueError(f"--most must be at least 1, got {arguments.most}")
    films = [path for path in paths if is_film_name(path)]
    if len(paths) > 1 and films:
        raise ValueError(f"{films[0]} is a film: expected pictures, or one film or recording alone")
    if films:
        if curve := hdr_curve(films[0]):
            raise ValueError(f"{films[0]} is HDR ({curve}): {HDR_ADVICE}")
        shots = list(_of_film(films[0], arguments.most, in_a_row))
    elif len(paths) == 1 and paths[0].is_dir():
        shots = list(_of_recording(paths[0], arguments.camera, arguments.most, in_a_row))
    else:
        return [read_pixels(path, any_depth) for path in paths], None
    return [picture for _, picture in shots], [time for time, _ in shots]


def _chosen(count: int, most: int, in_a_row: int) -> list[int]:
    """Numbers of at most `most` of `count` pictures, in evenly spaced groups of `in_a_row` successive ones."""
    import numpy as np

    if count <= most:
        return list(range(count))
    in_a_row = min(in_a_row, most)
    firsts = np.linspace(0, count - in_a_row, most // in_a_row).astype(int)
    return sorted({int(first) + k for first in firsts for k in range(in_a_row)})


def _of_recording(path: Path, camera: str, most: int, in_a_row: int) -> Iterator[tuple[float, NDArray[Any]]]:
    from ..recording import Recording

    recording = Recording.open(path)
    with_picture = recording.pictured(camera)
    for k in _chosen(len(with_picture), most, in_a_row):
        frame = recording[with_picture[k]]
        yield frame.time, getattr(frame, camera)


def _of_film(path: Path, most: int, in_a_row: int) -> Iterator[tuple[float, NDArray[Any]]]:
    import numpy as np

    from ..camera_files import FilmTimes, open_film

    film = open_film(path)
    count = 0
    while film.grab():
        count += 1
    film.release()
    if count == 0:
        raise ValueError(f"the video {path} holds no picture")
    chosen, film = set(_chosen(count, most, in_a_row)), open_film(path)
    times = FilmTimes(film)
    for k in range(count):
        if not film.grab():
            break
        time = times.next()
        _, picture = film.retrieve() if k in chosen else (False, None)
        if picture is not None:
            yield time, np.ascontiguousarray(picture[..., ::-1])
    film.release()


def _known_camera(arguments: argparse.Namespace) -> Camera:
    from ..calibration_files import read_rig

    camera = getattr(read_rig(arguments.rig), arguments.camera)
    if camera is None:
        raise ValueError(f"{arguments.rig} has no {arguments.camera} camera: calibrate it first")
    return camera


def _keep(arguments: argparse.Namespace, camera: Camera) -> None:
    """Puts a camera into rig.yaml and keeps what else is there."""
    from .._fastibl import Pose, Rig
    from ..calibration_files import read_rig, write_rig

    known: Rig | None = read_rig(arguments.rig) if arguments.rig.is_file() else None
    if arguments.camera == "back":
        rig = Rig(camera) if known is None or known.front is None else Rig(camera, known.front, known.front_from_back)
    elif known is None:
        raise ValueError(f"{arguments.rig} has no back camera yet: calibrate it first")
    else:
        # It is taken to look the opposite way, until `calibrate rig` has measured the pose.
        away = Pose.from_rotation_vector([0.0, 3.141592653589793, 0.0], [0.0, 0.0, 0.0])
        rig = Rig(known.back, camera, known.front_from_back if known.front is not None else away)
    write_rig(arguments.rig, rig)
    print(f"wrote {arguments.rig}")


def run_camera(arguments: argparse.Namespace) -> int:
    from ..calibration import calibrate_camera
    from ..calibration_files import read_rig

    if arguments.fisheye and arguments.camera == "back":
        raise ValueError("boards are tracked in perspective pictures: --fisheye goes with --camera front")
    if arguments.field_of_view is not None and not arguments.fisheye:
        raise ValueError("--field-of-view goes with --fisheye")
    known = getattr(read_rig(arguments.rig), arguments.camera) if arguments.rig.is_file() else None
    if arguments.camera == "front" and not arguments.rig.is_file():
        raise ValueError(f"{arguments.rig} has no back camera yet: calibrate it first")
    pictures, times = _read_shots(arguments, in_a_row=3)  # so that the camera's motion is known
    found = calibrate_camera(
        pictures,
        board_of(arguments.board),
        model="fisheye" if arguments.fisheye else "perspective",
        terms=arguments.terms,
        response=arguments.response or (None if known is None else known.response),
        times=times,
    )
    print(found)
    camera = found.camera
    if known is not None:  # keeps what pictures of a board do not tell
        camera = camera.replace(gain=known.gain, readout=camera.readout or known.readout, vignetting=known.vignetting)
        if known.model == camera.model:
            camera = camera.replace(field_of_view=known.field_of_view)
    if arguments.field_of_view is not None:
        camera = camera.replace(field_of_view=arguments.field_of_view)
    _keep(arguments, camera)
    return 0


def run_response(arguments: argparse.Namespace) -> int:
    from ..calibration import calibrate_response
    from ..camera_files import read_pixels

    camera = _known_camera(arguments)
    dark = None if arguments.dark is None else read_pixels(arguments.dark)
    found = calibrate_response(_read_pictures(arguments, any_depth=False), arguments.exposures, dark)
    print(found)
    _keep(arguments, camera.replace(response=found.response))
    return 0


def run_board(arguments: argparse.Namespace) -> int:
    from ..calibration import calibrate_board
    from ..calibration_files import write_board

    measured = None
    if arguments.measured:
        first, second, metres = arguments.measured
        try:
            measured = int(first), int(second), float(metres)
        except ValueError:
            raise ValueError(
                "--measured takes the numbers of two tags and the metres between their centres, got "
                + " ".join(arguments.measured)
            ) from None
    found = calibrate_board(
        _read_pictures(arguments), board_of(arguments.board), _known_camera(arguments), measured=measured
    )
    print(found)
    write_board(arguments.out, found.board)
    print(f"wrote {arguments.out}")
    return 0


def _finder(board: Board, camera: Camera) -> Callable[[NDArray[Any], float], Pose | None]:
    """A function from a picture and its time to camera_from_marker: tracks in perspective pictures, and finds the board
    anew in each other picture."""
    from ..calibration.board_pose import board_pose
    from ..tracking import Tracker

    if camera.model != "perspective":
        return lambda picture, time: board_pose(picture, board, camera)
    tracker = Tracker(board, camera)

    def track(picture: NDArray[Any], time: float) -> Pose | None:
        tracked = tracker.track(picture, time)
        return None if tracked is None else tracked.camera_from_marker

    return track


def run_rig(arguments: argparse.Namespace) -> int:
    from .._fastibl import Rig
    from ..calibration import calibrate_rig
    from ..recording import Recording, read_rig, write_rig

    rig = read_rig(arguments.rig)
    if rig.front is None:
        raise ValueError(f"{arguments.rig} has no front camera: calibrate it first")
    find_back = _finder(board_of(arguments.board), rig.back)
    find_front = _finder(board_of(arguments.front_board), rig.front)
    poses: tuple[list[Pose | None], list[Pose | None]] = [], []
    for frame in Recording.open(arguments.recording):
        for list_, find, picture in zip(poses, (find_back, find_front), (frame.back, frame.front), strict=True):
            list_.append(None if picture is None else find(picture, frame.time))
    found = calibrate_rig(*poses)
    print(found)
    write_rig(arguments.rig, Rig(rig.back, rig.front, found.front_from_back))
    print(f"wrote {arguments.rig}")
    return 0


def run_timing(arguments: argparse.Namespace) -> int:
    from ..calibration import calibrate_timing
    from ..gyroscope import read_gyroscope
    from ..recording import Recording, read_rig, write_attitudes

    if arguments.against_back and (arguments.camera != "front" or arguments.gyro):
        raise ValueError("--against-back needs --camera front, and no --gyro")
    if arguments.attitudes and (arguments.camera != "back" or not arguments.gyro):
        raise ValueError("--attitudes are the back camera's, by --gyro LOG")
    board, recording = board_of(arguments.board), Recording.open(arguments.recording)

    def film(name: str) -> Iterator[tuple[float, NDArray[Any]]]:
        return ((f.time, getattr(f, name)) for f in recording if getattr(f, name) is not None)

    camera = _known_camera(arguments)
    gyro = read_gyroscope(arguments.gyro) if arguments.gyro else None
    poses = None
    if arguments.against_back:
        back = calibrate_timing(film("back"), read_rig(arguments.rig).back, board)
        poses = back.times, back.poses
    found = calibrate_timing(
        film(arguments.camera),
        camera,
        board,
        poses=poses,
        gyro=gyro,
        longest_offset=None if gyro else 0.25,  # a log's clock may begin anywhere
    )
    print(found)
    if arguments.attitudes and found.gyroscope is not None:
        count = write_attitudes(arguments.recording, found.gyroscope.attitudes(recording.times))
        print(f"wrote {arguments.recording}: attitudes of {count} of {len(recording)} frames")
    # A readout that cannot be told from 0 counts as a global shutter's.
    readout = found.readout if found.readout > 3 * found.readout_deviation else 0.0
    _keep(arguments, camera.replace(readout=readout))
    return 0
