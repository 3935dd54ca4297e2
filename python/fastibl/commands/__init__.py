"""The commands of `fastibl`, one module each.

A module has `add(commands)`, which adds its parser to argparse's sub-commands (see `parser`), and `run(arguments)`. An
OSError, ValueError, TypeError or LookupError that it raises is shown as an error, with exit code 2.
"""

from __future__ import annotations

from . import board, calibrate, demo, export, extremes, live, record, render, report, simulate

ALL = (demo, render, simulate, live, record, export, board, calibrate, report, extremes)
