"""fastibl simulate: a recording with known light."""

from __future__ import annotations

import argparse

from ._arguments import parser, picture_size, positive

_TIME = (
    ("readout", "S", "rolling shutter: seconds from the first row of a picture to the last"),
    ("shutter", "S", "motion blur: exposure time in seconds"),
    ("flicker", "HZ", "of the lamps: 100 or 120"),
    ("glare", "SHARE", "of the light, that spreads over the whole picture: 0.01 or more"),
    ("clock-offset", "S", "seconds by which pictures are taken after their time stamps"),
)


def add(commands: argparse._SubParsersAction) -> None:
    p = parser(
        commands,
        "simulate",
        run,
        "make a recording of a back and a front camera in a place whose light is known",
        "fastibl simulate my-recording --environment venice_sunset_1k.hdr --seconds 8 --fps 15",
    )
    p.add_argument("out", metavar="OUT", help="folder to write; a recording that is there is replaced")
    p.add_argument("--environment", metavar="MAP", help=".hdr, .exr, .ktx2 or .dds (default: a built-in room)")
    p.add_argument("--seconds", type=positive, default=8.0, help="length (default: 8)")
    p.add_argument("--fps", type=positive, default=15.0, help="frames a second (default: 15)")
    p.add_argument("--seed", type=int, default=0, help="of the camera's path and the noise (default: 0)")
    p.add_argument(
        "--size",
        type=picture_size,
        default=(640, 480),
        metavar="WxH",
        help="of the pictures (default: 640x480)",
    )
    for name, unit, what in _TIME:
        p.add_argument(f"--{name}", type=float, default=0.0, metavar=unit, help=f"{what} (default: 0)")
    p.add_argument("--video", action="store_true", help="lossless FFV1 videos instead of PNG pictures")


def run(arguments: argparse.Namespace) -> int:
    from ..simulator import simulate

    recording = simulate(
        arguments.environment,
        seed=arguments.seed,
        seconds=arguments.seconds,
        fps=arguments.fps,
        out=arguments.out,
        size=arguments.size,
        readout=arguments.readout,
        shutter=arguments.shutter,
        flicker=arguments.flicker,
        glare=arguments.glare,
        clock_offset=arguments.clock_offset,
        video=arguments.video,
        progress=True,
    )
    print(f"{recording.path}: {len(recording)} frames")
    return 0
