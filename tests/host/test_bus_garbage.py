"""Whatever is on the bus: the client of a node, its log and its loss counter take it calmly."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import can
import pytest
from can.interfaces.virtual import VirtualBus
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin import bus
from axistwin.commands.monitor import _Listener
from axistwin.commands.trace import _Collected
from axistwin.contract import load_contract
from axistwin.frames import Frames
from axistwin.monitor import BusLoad, StreamMonitor

CONTRACT = load_contract()
NODE = 1
CHANNEL = "garbage"

# What a node says, and what a host may hear of it.
MINE = {
    CONTRACT.identifier(name, NODE): CONTRACT.length(name)
    for name in ("Emergency", "Motor", "Table", "Samples", "Report", "Trace", "Heartbeat")
}


def messages(identifiers: st.SearchStrategy[int]) -> st.SearchStrategy[can.Message]:
    """Frames of any kind with these identifiers."""
    return st.builds(
        lambda identifier, data, flags: can.Message(
            arbitration_id=identifier,
            data=data,
            is_extended_id=flags[0],
            is_error_frame=flags[1],
            is_fd=len(data) > 8,
        ),
        identifiers,
        st.binary(max_size=8) | st.binary(min_size=64, max_size=64),
        st.tuples(st.booleans(), st.booleans()),
    )


@pytest.fixture(scope="module")
def line() -> Iterator[tuple[bus.Node, can.BusABC]]:
    """A node's client that listens, and the other end."""
    with VirtualBus(CHANNEL) as other:
        node = bus.Node(lambda: VirtualBus(CHANNEL), CONTRACT, NODE)
        node._bus = VirtualBus(CHANNEL)
        with node:
            yield node, other


def state(node: bus.Node) -> dict[str, Any]:
    """All that a client knows of its node."""
    names = ("info", "streaming", "pages", "page_flags", "excited", "state", "fault")
    return {name: repr(getattr(node, name)) for name in names}


def hear(line: tuple[bus.Node, can.BusABC], sent: list[can.Message]) -> None:
    node, other = line
    for message in sent:
        other.send(message)
    heard = node.frames + node.errors + len(sent)
    while node.frames + node.errors < heard:
        node.poll(1.0)


@given(st.lists(messages(st.integers(0, 0x7FF) | st.sampled_from(list(MINE))), max_size=30))
@settings(deadline=None)
def test_any_frames_are_taken(line: tuple[bus.Node, can.BusABC], sent: list[can.Message]) -> None:
    node, _ = line
    monitor, load, trace = StreamMonitor(CONTRACT, NODE), BusLoad(10**6), _Collected(CONTRACT, NODE)
    listener = _Listener(CONTRACT, None)
    node.sinks[:] = [monitor, load, trace.take, listener]
    hear(line, sent)
    assert monitor.samples <= 6 * len(sent)
    assert monitor.lost >= 0
    assert load.mean() >= 0.0
    assert len(trace.messages) <= len(sent)
    assert len(Frames.of(trace.messages)) == len(trace.messages)
    assert trace.latest(("TraceCaptured",)).keys() <= {"TraceCaptured"}
    assert all(known.stream.samples >= 0 for known in listener.nodes.values())


@given(
    st.lists(
        messages(st.integers(0, 0x7FF).filter(lambda i: i not in MINE)).filter(
            lambda message: message.arbitration_id not in MINE
        )
        | messages(st.sampled_from(list(MINE))).filter(
            lambda message: (
                message.is_extended_id
                or message.is_error_frame
                or len(message.data) != MINE[message.arbitration_id]
            )
        ),
        max_size=30,
    )
)
@settings(deadline=None)
def test_frames_that_are_not_the_nodes_change_nothing_that_is_known_of_it(
    line: tuple[bus.Node, can.BusABC], sent: list[can.Message]
) -> None:
    node, _ = line
    node.sinks.clear()
    before = state(node)
    hear(line, sent)
    assert state(node) == before
