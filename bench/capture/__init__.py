"""Goals of capture and tracking: table "capture". One file per subject; each adds its rows when it is imported."""

from . import (  # noqa: F401
    boost,
    change,
    cost,
    exposures,
    faults,
    flicker,
    lens,
    lights,
    merge,
    near,
    predicted,
    rolling,
    rolling_tracking,
    sweep,
    tracking,
    turning,
    unmetered,
    wide,
)
