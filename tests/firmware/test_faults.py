"""What can go wrong on a drive's own side: its lines, its program, its power."""

from __future__ import annotations

import random
import struct
import threading

import pytest

from .conftest import Start
from .rig import CONTRACT, ENABLE, FAULT_RESET, OPEN, Line, Rig, command

# Instructions (Thumb) that a debugger puts where the program will come by.
HANG = bytes.fromhex("fee7")  # b .
UNDEFINED = bytes.fromhex("00de")  # udf #0
DESCEND = bytes.fromhex("ffb4fde7")  # push {r0-r7}; b to it

BOOT_UP = CONTRACT.value_of("Heartbeat", "State", "BootUp")


def error_code(name: str) -> int:
    return CONTRACT.value_of("Emergency", "ErrorCode", name)


def enable(line: Line) -> None:
    """Opens the channel and has operation enabled."""
    line.write(OPEN + ENABLE + command("ExcitationOn"))
    answer = line.wait_for("Report", "Answer")
    assert CONTRACT.names["Result"][struct.unpack_from("<H", answer, 2)[0]] == "Done"


def break_at(rig: Rig, function: str, instructions: bytes) -> int:
    """Has the program do this at the start of a function; where that is."""
    address = rig.address(function)
    debugger = rig.debug()
    debugger.write(address, instructions)
    debugger.release()
    return address


def wait_for_boot_up(line: Line) -> None:
    while line.wait_for("Heartbeat")[0] != BOOT_UP:
        pass


def expect_emergency(line: Line, name: str) -> int:
    """The cause of the next emergency, which is this one."""
    code, _, cause = struct.unpack_from("<HBi", line.wait_for("Emergency"))
    assert code == error_code(name)
    return int(cause)


def expect_fault_until_reset(rig: Rig, name: str) -> None:
    """In fault, torque off, until a host has seen and reset it."""
    assert rig.registers("ErrorCode", 1) == (error_code(name),)
    rig.can.write(FAULT_RESET)
    while rig.can.wait_for_page("Error") != 0:
        pass
    assert rig.registers("ErrorCode", 1) == (0,)


@pytest.mark.parametrize("image", ["cortex-m3", "cortex-m4f", "cortex-m7", "cortex-m33"])
def test_a_background_that_hangs_is_ended_by_the_watchdog(start: Start, image: str) -> None:
    rig = start(image)
    enable(rig.can)
    address = break_at(rig, "axt_node_background", HANG)
    wait_for_boot_up(rig.can)
    assert expect_emergency(rig.can, "WatchdogReset") == address
    expect_fault_until_reset(rig, "WatchdogReset")
    assert rig.registers("Restarts", 1) == (1,)


@pytest.mark.parametrize("function", ["axt_node_background", "axt_node_tick"])
def test_a_hard_fault_is_recorded_and_told_after_the_restart(start: Start, function: str) -> None:
    """In the background, and in the control interrupt."""
    rig = start()
    enable(rig.can)
    address = break_at(rig, function, UNDEFINED)
    wait_for_boot_up(rig.can)
    assert expect_emergency(rig.can, "InternalSoftware") == address
    expect_fault_until_reset(rig, "InternalSoftware")


@pytest.mark.parametrize("image", ["cortex-m4f", "cortex-m33"])
def test_a_stack_that_grows_too_deep_is_a_fault(start: Start, image: str) -> None:
    rig = start(image)
    rig.can.write(OPEN)
    rig.can.wait_for("Heartbeat")
    break_at(rig, "axt_node_background", DESCEND)
    expect_emergency(rig.can, "InternalSoftware")
    expect_fault_until_reset(rig, "InternalSoftware")


def test_a_control_interrupt_that_never_ends_is_ended_by_the_watchdog(start: Start) -> None:
    rig = start()
    rig.can.write(OPEN)
    rig.can.wait_for("Heartbeat")
    assert break_at(rig, "axt_node_tick", HANG) == expect_emergency(rig.can, "WatchdogReset")


def test_a_reset_in_mid_stream_is_seen_and_the_stream_can_be_started_again(start: Start) -> None:
    """The channel stays open, as that of an adapter does when a drive on its bus starts anew."""
    rig = start()
    enable(rig.can)
    rig.can.write(command("StreamStart"))
    for _ in range(100):
        rig.can.wait_for("Motor")
    rig.reset()
    wait_for_boot_up(rig.can)
    rig.can.write(command("StreamStart"))
    counters = [struct.unpack_from("<H", rig.can.wait_for("Motor"))[0] for _ in range(100)]
    assert counters == list(range(counters[0], counters[0] + 100))
    assert counters[0] < 1000  # of a clock that began with the reset
    assert rig.registers("ErrorCode", 1) == (0,)  # nothing was wrong
    assert rig.registers("Restarts", 1) == (1,)


def test_garbage_on_both_lines_costs_no_control_period(start: Start) -> None:
    """As fast as the UARTs take it, which at this count of instructions is about 1 MB a second of
    the board's time on each, while the drive streams."""
    rig = start(icount="shift=0")
    enable(rig.can)
    rig.can.write(command("StreamStart"))
    garbage = random.Random(1).randbytes(1 << 18)
    lines = (rig.can, rig.modbus)
    floods = [threading.Thread(target=line.write, args=(garbage,)) for line in lines]
    for flood in floods:
        flood.start()
    while any(flood.is_alive() for flood in floods):
        rig.can.read()
    rig.can.write(b"\r" + OPEN + command("Identify"))
    assert rig.can.wait_for_page("BusErrors") > 0
    assert rig.can.wait_for_page("Overruns") == 0
    assert rig.registers("LostSamples", 2) == (0, 0)
    assert rig.registers("Restarts", 1) == (0,)


def test_what_finds_no_room_is_counted_and_what_comes_after_it_is_understood(start: Start) -> None:
    """A host that writes and does not read: its answers fill the way back, then its lines the way
    in, and then the UART overruns. Samples that are streamed meanwhile are lost, and counted."""
    rig = start()
    rig.can.write(OPEN + command("StreamStart"))
    rig.can.wait_for("Motor")
    rig.can.write(b"V\r" * 20_000)
    while rig.registers("LostSamples", 2) == (0, 0):
        pass
    while rig.can.wait_for_page("LostFrames") == 0:
        pass
    rig.can.write(b"\r" + command("Identify"))
    assert rig.can.wait_for_page("Overruns") == 0
    counters = [struct.unpack_from("<H", rig.can.wait_for("Motor"))[0] for _ in range(10)]
    assert [(counter - counters[0]) % 65536 for counter in counters] == list(range(10))
    assert rig.registers("Restarts", 1) == (0,)


def test_the_stack_and_the_load_are_told(start: Start) -> None:
    rig = start()
    enable(rig.can)
    rig.can.write(command("StreamStart"))
    for _ in range(1000):
        rig.can.wait_for("Motor")
    size, used, load, _ = rig.registers("StackSize", 4)
    assert 0 < used < size
    assert 0 < load < 1000
    # the painted word below the deepest one is the highest that still has its paint
    bottom = rig.address("stack_bottom")
    debugger = rig.debug()
    words = [debugger.read(bottom + 4 * i) for i in range(size // 4)]
    debugger.release()
    assert next(i for i, word in enumerate(words) if word != words[0]) == (size - used) // 4
