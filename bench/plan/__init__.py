"""Goals of the plan, the report and the extremes: table "plan"; and of own shadows in its pictures, table "shadow".
One file per subject; each adds its rows when it is imported."""

from . import (  # noqa: F401
    cheapness,
    discovered,
    extremes,
    frame,
    lamps,
    left_out,
    near_lamps,
    promise,
    report,
    time_budget,
    times,
)
