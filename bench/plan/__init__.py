"""Goals of the plan, the report and the extremes: table "plan". One file a subject; each adds rows when imported."""

from . import (
    extremes,  # noqa: F401
    frame,  # noqa: F401
    report,  # noqa: F401
)
