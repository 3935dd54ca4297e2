"""Goals of shadow: table "shadow". One file a subject; each adds its rows when it is imported."""

from . import plane, steady  # noqa: F401
