"""Goals of the plan, the report and the extremes: table "plan". One file per subject; each adds its rows when it is
imported."""

from . import (  # noqa: F401
    cheapness,
    discovered,
    extremes,
    frame,
    left_out,
    promise,
    report,
    time_budget,
    times,
)
