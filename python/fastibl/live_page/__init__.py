"""A page on this machine that shows a running session and changes it.

What is shown goes one way, from the loop through snapshots to the server; what is changed goes the other, through the
loop's queue. The session belongs to the loop's thread alone.
"""

from .choices import Choices
from .loop import LiveLoop, Settings
from .server import PageServer

__all__ = ["Choices", "LiveLoop", "PageServer", "Settings"]
