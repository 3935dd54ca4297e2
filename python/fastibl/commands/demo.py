"""fastibl demo: simulate, render, compare with the truth, write videos and a report."""

from __future__ import annotations

import argparse
from pathlib import Path

from ._arguments import parser


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(
        commands,
        "demo",
        run,
        "simulate the built-in room, run everything on it, write videos and a report",
        "fastibl demo --out demo",
    )
    made.add_argument("--out", type=Path, default=Path("demo"), help="folder to write (default: %(default)s)")
    made.add_argument("--seconds", type=float, default=12.0, help="length of the recording (default: %(default)s)")
    made.add_argument("--fps", type=float, default=15.0, help="pictures a second (default: %(default)s)")
    made.add_argument("--seed", type=int, default=0, help="another seed is another walk (default: %(default)s)")


def run(arguments: argparse.Namespace) -> int:
    from ..demo import POSITION, run_demo
    from ..simulator import simulate

    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise ValueError("the report needs matplotlib: pip install matplotlib") from error
    from ..demo_report import write_report

    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    print(f"simulating {arguments.seconds:g} s of the built-in room")
    recording = simulate(
        seed=arguments.seed,
        seconds=arguments.seconds,
        fps=arguments.fps,
        out=out / "recording",
        position=POSITION,
        progress=True,
    )
    print(f"tracking, capturing, lighting: the default methods, then the paper's; see {out / 'picture.jpg'} meanwhile")
    result = run_demo(recording, out)
    path = write_report(result, out)
    default = result.runs["default"]
    print(
        f"captured light within {100 * default.map_error:.1f} % (median), irradiance within "
        f"{100 * default.irradiance_error[-1]:.1f} % (predicted {100 * default.predicted_error[-1]:.1f} %), "
        f"{default.milliseconds('total'):.0f} ms a frame"
    )
    print(f"wrote {out / 'composite.webm'}, {out / 'four-panel.webm'}, {path}")
    return 0
