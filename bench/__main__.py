"""Benchmarks: rows of error against time, written to bench/results/ and drawn to docs/plots/.

./dev bench                   all
./dev bench lighting real     some of them
./dev bench shadow-pictures   docs/shadow.md and its pictures, which `all` leaves as they are
./dev bench plan-pictures     the picture of docs/plan.md, likewise
./dev bench capture-pictures  the picture of docs/capture.md, likewise
./dev bench live-pictures     those of docs/live.md, likewise
./dev bench program-pictures  those of docs/program.md, likewise
./dev bench report-pictures   the plots and the picture of reports in the documents, likewise
./dev bench demo-picture      that of the README, likewise
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time

from fastibl import set_threads

from .measure import ROOT, cpu, table, write_rows, yardstick_seconds
from .plot import plot

PICTURES = {
    "shadow-pictures": "bench.shadows.pictures",
    "plan-pictures": "bench.plan.pictures",
    "capture-pictures": "bench.capture.pictures",
    "live-pictures": "bench.live_pictures",
    "program-pictures": "bench.program_pictures",
    "report-pictures": "bench.report_pictures",
    "demo-picture": "bench.demo_picture",
}
NAMES = ("lighting", "shadow", "tracking", "frame", "pixels", "real", "peers")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="./dev bench", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)} (default: all), {', '.join(PICTURES)}"
    )
    given = parser.parse_args(arguments)
    for name in given.names:
        if name not in (*NAMES, *PICTURES):
            parser.error(f"no benchmark {name!r}; there are: {', '.join((*NAMES, *PICTURES))}")
    print(f"{cpu()}; yardstick {1e3 * yardstick_seconds():.2f} ms")
    for name in given.names or NAMES:
        if name in PICTURES:
            for drawn in importlib.import_module(PICTURES[name]).main():
                print(f"written: {drawn.relative_to(ROOT)}")
            continue
        set_threads(1)  # rows that use more say so
        begin = time.perf_counter()
        rows = importlib.import_module(f"bench.{name}").rows()
        path = write_rows(name, rows)
        print(f"\n{name}: {len(rows)} rows in {path.relative_to(ROOT)}, {time.perf_counter() - begin:.0f} s")
        print(table(rows), flush=True)
        for drawn in plot(name, rows):
            print(f"drawn: {drawn.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
