"""The commands of `fastibl`, one module each.

A module has `add(commands)`, which adds its parser to argparse's sub-commands (see `parser`), and
`run(arguments)`. What it raises as OSError, ValueError, TypeError or LookupError is shown as an error, with
exit code 2.
"""

from __future__ import annotations

from . import board, calibrate, demo, export, extremes, live, record, render, report, simulate

ALL = (demo, render, simulate, live, record, export, board, calibrate, report, extremes)
