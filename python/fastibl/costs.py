"""The time that each pass takes on this machine: measured once, kept on disk."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path

from ._fastibl import __version__, _default_costs, _measure_costs
from .machine import cpu
from .mesh_shadow import cache_folder
from .whole_file import write_whole

_APART = 1000.0  # how many times a machine may be faster or slower than that of the built-in table


def default_costs() -> dict[str, float]:
    """The built-in table: nanoseconds by name. Choices by error alone use it, and so are the same on every machine."""
    return _default_costs()


def costs_path() -> Path | None:
    """Path of this machine's table, in the cache folder of baked shadows; None where FASTIBL_CACHE is 0."""
    folder = cache_folder()
    machine = hashlib.sha256(cpu().encode()).hexdigest()[:12]
    return None if folder is None else folder / f"costs-{__version__}-{machine}.json"


def machine_costs(measure: bool = True) -> dict[str, float]:
    """This machine's table: nanoseconds of one core by name, for Session(costs=...) and make_plan(costs=...).

    It is read from costs_path(), or measured (some seconds) and written there. If the file is broken or has other
    names, the table is measured again; a file that cannot be written is no error. measure=False gives the built-in
    table instead of measuring.
    """
    path = costs_path()
    kept = None if path is None else _read(path)
    if kept is not None:
        return kept
    if not measure:
        return default_costs()
    costs = _measure_costs()
    if path is None:
        return costs
    text = json.dumps({"cpu": cpu(), "nanoseconds": costs}, indent=1)
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    return costs


def _read(path: Path) -> dict[str, float] | None:
    """The table of costs in a file; None where there is no file, or its costs are not those of any possible machine."""
    try:
        given = json.loads(path.read_text(encoding="utf-8"))["nanoseconds"]
        costs = {str(name): float("nan" if isinstance(v, bool) else v) for name, v in given.items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        return None
    usual = default_costs()
    good = set(costs) == set(usual) and all(1 / _APART <= v / usual[name] <= _APART for name, v in costs.items())
    return costs if good else None
