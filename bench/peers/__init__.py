"""The same work done by other tools: ./dev bench peers. None of them is required; a missing one is skipped, with the
reason.

OpenCV comes with fastibl. The others: `pip install py360convert`, `apt install libfilament-tools` (cmgen), and node
with npm, which fetches three.js into the user's cache folder. No package manager has cmft: its rows show the figures
that were measured when fastibl was begun, in yardsticks.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from .. import inputs
from ..measure import Row, one_core
from . import cmft, cmgen, conversion, three


@one_core()
def rows() -> list[Row]:
    out: list[Row] = []
    for name, measure in PEERS.items():
        if not inputs.MAPS:
            print(f"{name}: skipped, {inputs.NO_MAPS}", file=sys.stderr)
            continue
        try:
            out += measure()
        except (ImportError, FileNotFoundError, RuntimeError) as reason:
            print(f"{name}: skipped, {reason}", file=sys.stderr)
    return out


PEERS: dict[str, Callable[[], list[Row]]] = {
    "OpenCV remap": conversion.opencv,
    "py360convert": conversion.py360convert,
    "fastibl's conversion": conversion.ours,
    "cmgen, spherical harmonics": cmgen.harmonics,
    "cmgen, GGX": cmgen.ggx,
    "three.js": three.light_probe,
    "cmft": cmft.rows,
}
