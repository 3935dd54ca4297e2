"""Goals of capture and tracking: table "capture". One file a subject; each adds its rows when it is imported."""

from . import (  # noqa: F401
    change,
    cost,
    lights,
    merge,
    near,
    predicted,
    rolling,
    sweep,
    tracking,
    turning,
    wide,
)
