"""SLCAN read in chunks: whatever the pieces in which it comes, the frames are the same."""

from __future__ import annotations

import os
import pty
import tty

import can
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from axistwin import slcan


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_frames_do_not_depend_on_the_pieces_that_they_come_in(data: st.DataObject) -> None:
    frames = data.draw(
        st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), min_size=1, max_size=20)
    )
    line = b"".join(
        f"t{identifier:03X}{len(payload)}{payload.hex().upper()}\r".encode()
        + data.draw(st.sampled_from([b"", b"\r", b"\a", b"z\r"]))
        for identifier, payload in frames
    )
    slcan.register()
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        with can.Bus(os.ttyname(slave), "slcan", sleep_after_open=0.0) as bus:
            assert isinstance(bus, slcan.SlcanBus)
            found = []
            begin = 0
            while begin < len(line):
                end = begin + data.draw(st.integers(1, 40))
                os.write(master, line[begin:end])
                begin = end
                while (message := bus.recv(0.002)) is not None:
                    found.append((message.arbitration_id, bytes(message.data)))
            while (message := bus.recv(0.05)) is not None:
                found.append((message.arbitration_id, bytes(message.data)))
            assert found == frames
    finally:
        os.close(master)
        os.close(slave)
