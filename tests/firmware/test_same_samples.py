"""The image and the Linux build of the same node, sample by sample."""

from __future__ import annotations

import re
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .conftest import Start
from .rig import CONTRACT, ENABLE, HEARTBEAT, NODE, OPEN, command

# With axt_fma() fused as on a Cortex-M4F: fmaf() is exact on every machine.
FUSED = Path(__file__).resolve().parents[2] / "build" / "fused" / "axistwin-emulator"

STEPS = 1_000_000
# Each sample depends on all before it. The firmware streams one of eleven, and so each of the
# excitation's 2048 values in turn: the way through the emulated UART takes minutes for more.
EVERY = 11
FRAME_SAMPLES = 6
FRAME = re.compile(rb"b%03XF([0-9A-F]{128})\r" % CONTRACT.identifier("Samples", NODE))
LINE = 134  # characters
BEAT = 300 * LINE  # between heartbeats of the host


def stream(
    write: Callable[[bytes], None], read: Callable[[], bytes], every: int
) -> npt.NDArray[np.int64]:
    """Torque, motor and table position from the first sample of the excitation on, none missing.

    Begins at rest and goes on for STEPS control periods of excitation or more.
    """
    write(OPEN + command("StreamStartFd", every) + ENABLE + command("ExcitationOn"))
    received = bytearray()
    beats = 0
    # until the excitation is filled in, a drive's background comes round 271 times
    while len(received) < (STEPS + 200_000) // (every * FRAME_SAMPLES) * LINE:
        received += read()
        if len(received) > beats * BEAT:
            write(HEARTBEAT)
            beats += 1
    packed = bytes.fromhex(b"".join(FRAME.findall(bytes(received))).decode())
    payloads = np.frombuffer(packed, np.uint8).reshape(-1, CONTRACT.length("Samples"))

    def signal(name: str) -> npt.NDArray[Any]:
        columns = [CONTRACT.raw("Samples", f"{name}{i}", payloads) for i in range(FRAME_SAMPLES)]
        return np.stack(columns, axis=1).ravel()

    counters = np.diff(CONTRACT.raw("Samples", "Counter", payloads)) % 65536
    assert set(counters) == {FRAME_SAMPLES}
    found = np.stack([signal(name) for name in ("Torque", "MotorPosition", "TablePosition")])
    begin = int(np.argmax(found[0] != 0))
    assert begin > 0
    assert not found[:, :begin].any()
    return found[:, begin:]


def emulated() -> npt.NDArray[np.int64]:
    """Every sample of the Linux build, as fast as it goes."""
    options = ("--rate", "10000", "--simulated", "--watchdog", "65535")
    with subprocess.Popen(
        [FUSED, "--bus", "tcp:0", *options], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        found = re.search(r"tcp 127\.0\.0\.1:(\d+)", process.stdout.readline())
        assert found
        with socket.create_connection(("127.0.0.1", int(found[1]))) as line:
            samples = stream(line.sendall, lambda: line.recv(1 << 20), 1)
        process.kill()
    return samples


def test_a_million_steps_are_the_same_bit_for_bit(start: Start) -> None:
    """The excitation, and what the axis and its encoders make of it: Cortex-M4F and Linux."""
    rig = start(icount="shift=4")
    firmware = stream(rig.can.write, rig.can.read, EVERY)[:, : STEPS // EVERY]
    linux = emulated()[:, :STEPS]
    # the firmware streams one of eleven of the excitation's first samples, which all differ
    first = linux[0, :EVERY].tolist().index(firmware[0, 0])
    linux = linux[:, first::EVERY]
    together = min(linux.shape[1], firmware.shape[1])
    assert together >= STEPS // EVERY - 1
    np.testing.assert_array_equal(firmware[:, :together], linux[:, :together])
    assert np.ptp(linux[1]) > 1000  # the motor has moved
