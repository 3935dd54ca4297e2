"""Goals of capture: table "capture". One file a subject; each adds its rows when it is imported."""

from . import tracking  # noqa: F401
