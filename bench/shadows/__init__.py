"""Goals of shadow: table "shadow". One file per subject; each adds its rows when it is imported."""

from . import pictures, place, plane, proxies, rigid, self_shadow, steady  # noqa: F401
