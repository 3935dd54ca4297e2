"""A page on this machine that shows a running session and changes it.

What is shown goes from the loop through snapshots to the server; changes go the other way, through the loop's queue.
Only the loop's thread touches the session.
"""

from .choices import Choices
from .loop import LiveLoop, Settings
from .server import PageServer

__all__ = ["Choices", "LiveLoop", "PageServer", "Settings"]
