"""What cameras that look somewhere see; shared with `fastibl extremes`."""

from fastibl.extremes.views import *  # noqa: F403
