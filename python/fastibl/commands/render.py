"""fastibl render: put an object into a recording."""

from __future__ import annotations

import argparse
from pathlib import Path

from ._arguments import add_object, add_response, object_of, parser


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(
        commands,
        "render",
        run,
        "put an object into a recording and write the video",
        "fastibl render my-recording --object spot.obj --height 0.12 --out out.webm",
    )
    made.add_argument("recording", type=Path, help="folder of a recording")
    add_object(made)
    made.add_argument(
        "--environment", type=Path, help="light by this map (.hdr, .exr, .ktx2, .dds, .png, .jpg) instead of capturing"
    )
    add_response(made)
    made.add_argument("--diffuse", type=float, default=0.7, help="k_L (default: %(default)s)")
    made.add_argument("--glossy", type=float, default=0.1, help="k_G (default: %(default)s)")
    made.add_argument("--exponent", type=float, default=64.0, help="of the glossy lobe (default: %(default)s)")
    made.add_argument("--out", type=Path, default=Path("out.webm"), help="video to write (default: %(default)s)")
    made.add_argument(
        "--layers",
        type=Path,
        metavar="FOLDER",
        help="also write what each picture is made from: object, shadow ratio and plate, as linear .exr",
    )


def run(arguments: argparse.Namespace) -> int:
    import numpy as np
    from tqdm import tqdm

    from .._fastibl import Material, Scene
    from ..environment_files import read_environment
    from ..layer_files import write_layers
    from ..recording import Recording
    from ..session import Session
    from ..video import VideoWriter

    recording = Recording.open(arguments.recording)
    material = Material([arguments.diffuse] * 3, [arguments.glossy] * 3, arguments.exponent)
    scene = Scene(object_of(arguments), material)
    environment = None
    if arguments.environment is not None:
        environment = read_environment(arguments.environment, response=arguments.response)
    session = Session(
        scene,
        recording.rig,
        recording.board,
        environment,
        methods=arguments.methods,
        backend=arguments.backend,
        distance=arguments.distance,
    )
    times = recording.back_times
    fps = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 15.0
    seconds: list[float] = []
    seen, result = 0, None
    if arguments.layers is not None:
        arguments.layers.mkdir(parents=True, exist_ok=True)
    with VideoWriter(arguments.out, fps) as video:
        for frame in tqdm(recording, total=len(recording), unit="frame"):
            if frame.back is None:
                session.process(frame)
                continue
            result = session.process(frame)
            video.add(result.image)
            if arguments.layers is not None:
                path = arguments.layers / f"{len(seconds):05d}.exr"
                write_layers(path, session.layers, frame.back, recording.rig.back.response)
            seconds.append(result.timings["total"])
            seen += result.back_from_marker is not None
    if result is None:
        raise ValueError(f"{arguments.recording} holds no back pictures")
    print(result.plan)
    print(
        f"board seen in {seen} of {len(seconds)} frames; {1000 * np.median(seconds):.1f} ms a frame (median); "
        f"predicted error of the irradiance {100 * result.predicted_error:.1f} %"
    )
    layers = "" if arguments.layers is None else f", and {len(seconds)} .exr in {arguments.layers}"
    print(f"wrote {arguments.out}{layers}")
    return 0
