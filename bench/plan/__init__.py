"""Goals of plan, report and extremes: table "plan". One file a subject; each adds its rows when it is imported."""

from . import (
    report,  # noqa: F401
)
