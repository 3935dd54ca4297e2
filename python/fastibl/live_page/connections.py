"""Keeps the number of connections bounded. Those that have not shown the token yet give way to new ones, and no
connection may take for ever to send a request."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass
class _Place:
    """since: the time since when its request is awaited; None while one is answered."""

    since: float | None
    admitted: bool = False


class Connections:
    """most: connections at a time. patience: seconds within which a whole request must come, counted from the previous
    answer."""

    def __init__(self, most: int, patience: float, clock: Callable[[], float] = time.monotonic):
        self._most, self._patience, self._clock = most, patience, clock
        self._lock = threading.Lock()
        self._places: dict[socket.socket, _Place] = {}  # the oldest first

    def take(self, connection: socket.socket) -> bool:
        """Whether there is a place for the connection. If all are taken, it gets that of the oldest one that was not
        admitted."""
        with self._lock:
            if len(self._places) >= self._most:
                stranger = next((one for one, place in self._places.items() if not place.admitted), None)
                if stranger is None:
                    return False
                self._end(stranger)
            self._places[connection] = _Place(self._clock())
            return True

    def admit(self, connection: socket.socket) -> None:
        """Lets the connection keep its place: its whole request has come, with the token."""
        with self._lock:
            if place := self._places.get(connection):  # it may have been ended in the meantime
                place.since, place.admitted = None, True

    def wait(self, connection: socket.socket) -> None:
        """Begins to wait for the connection's next request."""
        with self._lock:
            if place := self._places.get(connection):
                place.since = self._clock()

    def leave(self, connection: socket.socket) -> None:
        with self._lock:
            self._places.pop(connection, None)

    def end_late(self) -> None:
        """Ends the connections whose request has not come in time."""
        with self._lock:
            late = self._clock() - self._patience
            for one in [one for one, place in self._places.items() if place.since is not None and place.since < late]:
                self._end(one)

    def __len__(self) -> int:
        with self._lock:
            return len(self._places)

    def _end(self, connection: socket.socket) -> None:
        """Shuts the connection down; its thread, which is reading from it, notices and closes it."""
        del self._places[connection]
        with contextlib.suppress(OSError):  # the client may be gone already
            connection.shutdown(socket.SHUT_RDWR)
