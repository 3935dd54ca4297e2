"""Goals of the plan, the report and the extremes: table "plan". One file per subject; each adds its rows when it is
imported."""

from . import (
    cheapness,  # noqa: F401
    extremes,  # noqa: F401
    frame,  # noqa: F401
    left_out,  # noqa: F401
    promise,  # noqa: F401
    report,  # noqa: F401
    time_budget,  # noqa: F401
    times,  # noqa: F401
)
