"""Goals of capture and tracking: table "capture". One file a subject; each adds its rows when it is imported."""

from . import change, cost, lights, merge, predicted, rolling, sweep, tracking, turning  # noqa: F401
