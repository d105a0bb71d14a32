"""One bus for several nodes, on python-can's own virtual bus."""

from __future__ import annotations

from collections.abc import Iterator

import can
import pytest
from can.interfaces.virtual import VirtualBus

from axistwin.errors import InputError
from axistwin.sharedbus import SharedBus

CHANNEL = "shared"


class Line(VirtualBus):
    """A virtual bus that can be cut, and counts how often it was opened."""

    opened = 0
    cut = False

    def __init__(self) -> None:
        super().__init__(CHANNEL)
        Line.opened += 1

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if Line.cut:
            raise can.CanOperationError("cut")
        return super()._recv_internal(timeout)


@pytest.fixture
def shared() -> Iterator[SharedBus]:
    Line.opened = 0
    lines: list[Line] = []

    def opened() -> Line:
        lines.append(Line())
        return lines[-1]

    bus = SharedBus(opened, lambda line: line.shutdown(), lambda _: 3)
    yield bus
    bus.fail()
    assert Line.opened == len(lines)


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    with VirtualBus(CHANNEL) as bus:
        yield bus


def numbers(port: can.BusABC) -> list[int]:
    """Identifiers of all that a port has."""
    found = []
    while (message := port.recv(0.05)) is not None:
        found.append(message.arbitration_id)
    return found


def test_every_port_sees_every_message_and_every_sink_once(
    shared: SharedBus, other: can.BusABC
) -> None:
    one, two = shared.open_port(), shared.open_port()
    heard: list[int] = []
    shared.sinks.append(lambda message: heard.append(message.arbitration_id))
    for i in range(20):
        other.send(can.Message(arbitration_id=i))
        if i % 3 == 0:
            one.recv(0.05)
    assert numbers(two) == list(range(20))
    assert numbers(one) == list(range(7, 20))
    assert heard == list(range(20))
    assert Line.opened == 1


def test_what_a_port_sends_is_on_the_bus(shared: SharedBus, other: can.BusABC) -> None:
    shared.open_port().send(can.Message(arbitration_id=5))
    assert numbers(other) == [5]


def test_the_bus_is_closed_with_its_last_port(shared: SharedBus, other: can.BusABC) -> None:
    one, two = shared.open_port(), shared.open_port()
    one.shutdown()
    other.send(can.Message(arbitration_id=1))
    assert numbers(two) == [1]
    two.shutdown()
    other.send(can.Message(arbitration_id=2))
    three = shared.open_port()
    assert numbers(three) == []
    assert Line.opened == 2


def test_a_bus_that_fails_is_opened_anew_once_for_all(shared: SharedBus, other: can.BusABC) -> None:
    one, two = shared.open_port(), shared.open_port()
    Line.cut = True
    with pytest.raises(can.CanOperationError, match="cut"):
        one.recv(0.05)
    Line.cut = False
    for port in (one, two):
        with pytest.raises(can.CanOperationError, match="the bus has failed"):
            port.send(can.Message(arbitration_id=1))
        port.shutdown()
    one, two = shared.open_port(), shared.open_port()
    other.send(can.Message(arbitration_id=2))
    assert numbers(one) == numbers(two) == [2]
    assert Line.opened == 2


def test_what_was_dropped_is_counted_over_all_times_the_bus_was_open(shared: SharedBus) -> None:
    assert shared.dropped == 0
    shared.open_port().shutdown()
    assert shared.dropped == 3
    shared.open_port()
    assert shared.dropped == 6


def test_a_bus_that_cannot_be_opened_leaves_no_port() -> None:
    def fails() -> can.BusABC:
        raise InputError("no such bus")

    shared = SharedBus(fails, lambda bus: bus.shutdown())
    with pytest.raises(InputError):
        shared.open_port()
    assert shared.dropped == 0
