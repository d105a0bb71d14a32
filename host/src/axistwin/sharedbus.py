"""One bus for several nodes: each has a port of its own, and every port sees every message.

A serial line can be opened only once, and a socket for each node would have the kernel copy every
frame for each.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import can


class SharedBus:
    """A bus that is open, by ``open_bus`` and until ``close``, as long as one of its ports is.

    ``sinks`` are called with every message that is received, once. A bus that has failed is closed
    for all ports: the first one that is opened anew opens it again. ``count_dropped`` tells how
    many frames found no room on their way to this program since a bus was opened. ``bus`` is the
    open one.
    """

    def __init__(
        self,
        open_bus: Callable[[], can.BusABC],
        close: Callable[[can.BusABC], object],
        count_dropped: Callable[[can.BusABC], int] = lambda _: 0,
    ) -> None:
        self._open_bus = open_bus
        self._close_bus = close
        self._count_dropped = count_dropped
        self._dropped_before = 0
        self.bus: can.BusABC | None = None
        self._ports: list[Port] = []
        self.sinks: list[Callable[[can.Message], object]] = []

    @property
    def dropped(self) -> int:
        """Frames that found no room on their way to this program."""
        now = 0 if self.bus is None else self._count_dropped(self.bus)
        return self._dropped_before + now

    def open_port(self) -> Port:
        """A new port. Raises what opening the bus raises."""
        if self.bus is None:
            self.bus = self._open_bus()
        port = Port(self)
        self._ports.append(port)
        return port

    def receive(self, port: Port, timeout: float | None) -> can.Message | None:
        """The next message for a port; what comes is kept for the others, too."""
        if port.waiting:
            return port.waiting.popleft()
        message = self._working(port).recv(timeout)
        if message is not None:
            for sink in self.sinks:
                sink(message)
            for other in self._ports:
                if other is not port:
                    other.waiting.append(message)
        return message

    def send(self, port: Port, message: can.Message, timeout: float | None) -> None:
        """Sends for a port."""
        self._working(port).send(message, timeout)

    def leave(self, port: Port) -> None:
        """Closes a port, and with the last one the bus."""
        if port in self._ports:
            self._ports.remove(port)
        if not self._ports:
            self._close()

    def fail(self) -> None:
        """Closes the bus and with it all ports: they notice when they are used next."""
        self._ports.clear()
        self._close()

    def _close(self) -> None:
        if self.bus is not None:
            self._dropped_before = self.dropped
            bus, self.bus = self.bus, None
            self._close_bus(bus)

    def _working(self, port: Port) -> can.BusABC:
        if self.bus is None or port not in self._ports:
            raise can.CanOperationError("the bus has failed")
        return self.bus


class Port(can.BusABC):
    """A bus as one node sees it."""

    def __init__(self, shared: SharedBus) -> None:
        super().__init__(channel="")
        self.waiting: deque[can.Message] = deque()
        self._shared = shared

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next message, see can.BusABC.recv()."""
        try:
            return self._shared.receive(self, timeout)
        except (can.CanError, OSError):
            self._shared.fail()
            raise

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a message, see can.BusABC.send()."""
        self._shared.send(self, msg, timeout)

    def shutdown(self) -> None:
        """Closes this port."""
        super().shutdown()
        self._shared.leave(self)
