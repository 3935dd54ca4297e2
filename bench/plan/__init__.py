"""Goals of the plan: table "plan". One file a subject; each adds its rows when it is imported."""

from . import cheapness, left_out, promise, time_budget, times  # noqa: F401
