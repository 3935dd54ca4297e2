"""fastibl report: error against time of every method, on this machine."""

from __future__ import annotations

import argparse
import shlex
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..plain_text import plain_text
from ._arguments import MESH_FILES, parser

if TYPE_CHECKING:
    from ..measuring import Row
    from ..report.compare import Comparison

_HEIGHT = 0.12


def add(commands: argparse._SubParsersAction) -> None:
    made = parser(
        commands,
        "report",
        run,
        "measure every method on this machine, error against time, and write a page, rows and plots",
        "fastibl report --quick\n  fastibl report --environment room.hdr --mesh spot.obj --out my-report\n"
        "  fastibl report --quick --against old/report.json",
    )
    made.add_argument(
        "--environment", type=Path, action="append", nargs="+", metavar="HDR",
        help="equirectangular maps to measure on, .hdr or .exr (default: the built-in room)",
    )  # fmt: skip
    made.add_argument("--mesh", type=Path, help=f"object ({MESH_FILES}); by default the built-in figurine")
    made.add_argument("--up", choices=("y", "z"), default="y", help="the mesh's upward axis (default: %(default)s)")
    made.add_argument("--recording", type=Path, help="folder of a recording (default: a simulated one)")
    made.add_argument("--out", type=Path, default=Path("report"), help="folder to write (default: %(default)s)")
    made.add_argument("--quick", action="store_true", help="one to two minutes instead of 4 to 20")
    made.add_argument(
        "--against", type=Path, metavar="JSON",
        help="report.json of before: says what became better or worse; exit code 1 if something is clearly worse",
    )  # fmt: skip
    made.add_argument(
        "--measured", type=Path, metavar="JSON", help="with --against: compare this report.json, measure nothing"
    )


def run(arguments: argparse.Namespace) -> int:
    if arguments.measured is not None and arguments.against is None:
        raise ValueError("--measured needs --against")
    for name in ("environment", "mesh", "recording", "quick") if arguments.measured is not None else ():
        if getattr(arguments, name):
            raise ValueError(f"--{name} says what to measure, and with --measured nothing is")
    old = None if arguments.against is None else _Written.read(arguments.against)
    if old is not None and arguments.measured is not None:
        new = _Written.read(arguments.measured)
        return int(_compared(old, new.rows, new.head).regressed)
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise ValueError("the report needs matplotlib: pip install matplotlib") from error
    return _measured(arguments, old)


@dataclass(frozen=True)
class _Written:
    """A report that was written to a file."""

    path: Path
    rows: list[Row]
    head: dict[str, Any]

    @staticmethod
    def read(path: Path) -> _Written:
        from ..measuring import read_head, read_rows

        return _Written(path, read_rows(path), read_head(path))


def _compared(old: _Written, rows: list[Row], head: Mapping[str, Any]) -> Comparison:
    """Compares the two reports. Raises ValueError where they are not comparable."""
    from ..report.compare import as_text, compare, of_other_inputs

    if others := of_other_inputs(old.head, head):
        raise ValueError(f"{old.path} is a report of something else: {others} is another; their rows do not compare")
    found = compare(old.rows, rows, str(old.path))
    print(plain_text(as_text(found)))
    return found


def _measured(arguments: argparse.Namespace, old: _Written | None) -> int:
    from tqdm import tqdm

    from .. import report

    effort = report.QUICK if arguments.quick else report.FULL
    places, mesh, recording = _given(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)  # fails before any work is done
    with tempfile.TemporaryFile(dir=arguments.out):
        pass
    parts = ["inputs", *(name for name, _ in (*report.STEPS, *report.MORE)), "page"]
    with tqdm(total=len(parts), unit="part", disable=None) as bar:
        bar.set_description(parts[0])
        inputs = report.gathered(places, mesh, recording, effort)

        def progress(name: str) -> None:
            bar.update(1), bar.set_description(name)

        made = report.make_report(inputs, _command(arguments), progress)
        progress(parts[-1])
        against, refused = None, None
        try:
            against = None if old is None else _compared(old, made.rows, made.head)
        except ValueError as error:  # what was measured is written nevertheless
            refused = error
        path = report.write_report(made, arguments.out, against)
        bar.update(1)
    for section in made.sections:
        if section.name in ("overview", "frame"):
            print("\n".join(section.seen))
    print(f"wrote {path}, {arguments.out / 'report.json'} ({len(made.rows)} rows), {arguments.out / 'plots'}")
    if refused is not None:
        raise refused
    return int(against is not None and against.regressed)


def _given(arguments: argparse.Namespace):
    """The places, mesh and recording that were asked for; None where the built-in ones are used."""
    from ..environment_files import read_environment
    from ..files import read_mesh, stand
    from ..recording import Recording

    paths = [path for some in arguments.environment or () for path in some]
    named: dict[str, Path] = {}
    for path in paths:
        name = path.stem.removesuffix("_1k")
        if name in named:
            raise ValueError(f"{named[name]} and {path} would both be called {name}: rename one")
        named[name] = path
    places = {name: read_environment(path, size=128) for name, path in named.items()} or None
    mesh = None
    if arguments.mesh is not None:
        mesh = arguments.mesh.stem, stand(read_mesh(arguments.mesh, arguments.up), _HEIGHT)
    recording = None
    if arguments.recording is not None:
        recording = f"the recording {arguments.recording.name}", Recording.open(arguments.recording)
    return places, mesh, recording


def _command(arguments: argparse.Namespace) -> str:
    words = ["fastibl", "report"]
    for path in (path for some in arguments.environment or () for path in some):
        words += ["--environment", path.name]
    if arguments.mesh is not None:
        words += ["--mesh", arguments.mesh.name]
    if arguments.recording is not None:
        words += ["--recording", arguments.recording.name]
    return shlex.join(words + ["--quick"] * arguments.quick)
