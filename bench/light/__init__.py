"""Goals of light: table "light". One file per subject; each adds its rows when it is imported."""

from . import diffuse, ggx, glossy, prefilter, speed, stability  # noqa: F401
