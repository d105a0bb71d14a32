"""Both Modbus servers against peers that we did not write, and against all that a line can do."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Container, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from axistwin.cli import main
from axistwin.errors import NotEnoughDataError
from axistwin.history import HistoryLog
from axistwin.readers import read_record
from axistwin.registers import Value, load_table

from .modbus_rig import (
    PORTABLE,
    REPOSITORY,
    SANITIZED,
    Line,
    Raw,
    Server,
    Station,
    adu,
    crc16,
    firmware_on_a_line,
    line,
    on_a_line,
    over_tcp,
    read_pdu,
    server,
    write_pdu,
)

TABLE = load_table()
WRITE_KEY = TABLE.registers["WriteKey"].address
ARGUMENT = TABLE.registers["Argument"].address
HISTORY_DECIMATION = 256  # the command
KEYS = (0x4158, 0x5457)
SIGNATURE = b"AXTW"

Cli = Callable[..., tuple[int, str, str]]


@pytest.fixture
def emulator() -> Iterator[Server]:
    """An emulated axis that moves, served over TCP."""
    with server(SANITIZED, "--modbus", "tcp:0", "--excite") as started:
        yield started


@pytest.fixture
def serial() -> Iterator[Line]:
    """A serial line."""
    with line() as opened:
        yield opened


@pytest.fixture(params=["libmodbus", "portable", "firmware"])
def on_line(request: pytest.FixtureRequest, serial: Line) -> Iterator[tuple[Line, int]]:
    """Each of our RTU servers on a line, and its unit id."""
    if request.param == "firmware":
        with firmware_on_a_line() as station:
            assert station.line is not None
            station.start()
            yield station.line, 1
    elif request.param == "portable":
        with server(PORTABLE, serial.server):
            yield serial, 5
    else:
        modbus = f"rtu:{serial.server},115200,N"
        with server(SANITIZED, "--modbus", modbus, "--node", "5"):
            yield serial, 5


STATIONS = {"tcp": over_tcp, "rtu": on_a_line, "rtu-firmware": firmware_on_a_line}


@pytest.fixture(params=STATIONS)
def station(request: pytest.FixtureRequest) -> Iterator[Station]:
    """Each way to be served registers: over TCP, on a line from Linux, and from firmware."""
    with STATIONS[request.param]() as opened:
        opened.start()
        yield opened


@pytest.fixture
def cli(capfd: pytest.CaptureFixture[str]) -> Cli:
    """Runs `axistwin modbus ...`: status, output, messages."""

    def run(*arguments: str) -> tuple[int, str, str]:
        capfd.readouterr()
        try:
            status = main(("modbus", *arguments))
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 1
        captured = capfd.readouterr()
        assert "Traceback" not in captured.err
        return status, captured.out, captured.err

    return run


def tcp(started: Server) -> tuple[str, str]:
    return "-c", f"tcp:127.0.0.1:{started.port}"


def rtu(opened: Line, unit: int) -> tuple[str, ...]:
    channel = f"rtu:{opened.client}"
    return "-c", channel, "-b", "115200", "--parity", "N", "--node", str(unit)


def is_well(started: Server) -> bool:
    """Does it answer a new client?"""
    with Raw(started.port) as client:
        return client.ask(read_pdu(0, 2)) == b"\x03\x04" + SIGNATURE


def unlock(client: Raw) -> None:
    for key in KEYS:
        assert client.ask(write_pdu(WRITE_KEY, key)) == write_pdu(WRITE_KEY, key)


def keeps_history(started: Server, decimation: int) -> bool:
    """Does it, sooner or later, keep samples so many control periods apart?"""
    deadline = time.monotonic() + 20
    while (found := history_decimation(started)) != decimation and time.monotonic() < deadline:
        time.sleep(0.01)
    return found == decimation


def history_decimation(started: Server) -> int:
    with Raw(started.port) as client:
        answer = client.ask(read_pdu(TABLE.registers["HistoryDecimation"].address, 2))
        return int.from_bytes(answer[2:], "big")


# ---- Peers ---------------------------------------------------------------------------------------


def poll(*arguments: str) -> str:
    """Runs mbpoll, which says everything on its standard output, or error when it has failed."""
    command = ["mbpoll", "-0", "-1", "-q", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.stdout + done.stderr


def test_mbpoll_reads_and_writes_over_tcp(emulator: Server) -> None:
    where = ("-m", "tcp", "-p", str(emulator.port))
    known = TABLE.registers["TestFloat"].address
    floats = poll(*where, "-t", "4:float", "-B", "-r", str(known), "127.0.0.1")
    assert f"[{known}]: \t3.14159" in floats
    for kind in ("3", "4"):  # input, holding
        words = poll(*where, "-t", kind, "-r", "0", "-c", "3", "127.0.0.1")
        assert re.findall(r"\[(\d)\]: \t(\d+)", words) == [
            ("0", "16728"),
            ("1", "21591"),
            ("2", "2"),
        ]
    written = poll(*where, "-t", "4", "-r", str(WRITE_KEY), "127.0.0.1", str(KEYS[0]))
    assert "Written 1 references." in written
    refused = poll(*where, "-t", "4", "-r", str(ARGUMENT), "127.0.0.1", "1", "2", "3")
    assert "Illegal data address" in refused


def test_mbpoll_reads_and_writes_on_a_serial_line(on_line: tuple[Line, int]) -> None:
    opened, unit = on_line
    where = ("-m", "rtu", "-b", "115200", "-P", "none", "-s", "2", "-a", str(unit))
    known = TABLE.registers["TestFloat"].address
    floats = poll(*where, "-t", "4:float", "-B", "-r", str(known), opened.client)
    assert f"[{known}]: \t3.14159" in floats
    written = poll(*where, "-t", "4", "-r", str(WRITE_KEY), opened.client, str(KEYS[0]))
    assert "Written 1 references." in written
    longest = TABLE.blocks["History"]
    block = poll(
        *where, "-t", "4", "-r", str(longest.address), "-c", str(longest.size), opened.client
    )
    assert len(re.findall(r"^\[", block, re.MULTILINE)) == longest.size


def use_as_pymodbus_does(client: ModbusTcpClient | ModbusSerialClient, unit: int) -> None:
    """Functions 3, 4, 6, 16 and 23, and values in the word order that is pymodbus' own default."""
    assert client.connect()
    known = TABLE.registers["TestFloat"]
    for read in (client.read_holding_registers, client.read_input_registers):
        words = read(known.address, count=2, device_id=unit).registers
        decoded = client.convert_from_registers(words, client.DATATYPE.FLOAT32)
        assert decoded == pytest.approx(np.pi, rel=1e-7)
    for key in KEYS:
        assert not client.write_register(WRITE_KEY, key, device_id=unit).isError()
    command = [0, 10, HISTORY_DECIMATION]
    assert not client.write_registers(ARGUMENT, command, device_id=unit).isError()
    both = client.readwrite_registers(
        read_address=WRITE_KEY,
        read_count=8,
        write_address=ARGUMENT,
        address=0,
        values=[0, 25, HISTORY_DECIMATION],
        device_id=unit,
    )
    assert both.registers == [KEYS[1], 0, 25, HISTORY_DECIMATION, 0, 0, 0, 1]
    assert client.read_coils(0, count=1, device_id=unit).exception_code == 1
    assert client.read_holding_registers(9999, count=1, device_id=unit).exception_code == 2
    refused = client.write_registers(ARGUMENT, [0, 0, HISTORY_DECIMATION], device_id=unit)
    assert refused.exception_code == 3


def test_pymodbus_uses_every_function_over_tcp(emulator: Server) -> None:
    with ModbusTcpClient("127.0.0.1", port=emulator.port, timeout=10) as client:
        use_as_pymodbus_does(client, 1)


def test_pymodbus_uses_every_function_on_a_serial_line(on_line: tuple[Line, int]) -> None:
    opened, unit = on_line
    with ModbusSerialClient(opened.client, baudrate=115200, timeout=10) as client:
        use_as_pymodbus_does(client, unit)


# ---- What the answers say ------------------------------------------------------------------------


def test_values_of_one_answer_are_of_one_moment(station: Station) -> None:
    """Each sample is seen in many answers: it is the same in all, and the state is one of them."""
    seen: dict[int, tuple[int, ...]] = {}
    state, history = TABLE.blocks["State"], TABLE.blocks["History"]
    with station.master() as client:
        for _ in range(10**5):
            if len(seen) > 500:
                break
            words = struct.unpack(
                f">{state.size}H", client.ask(read_pdu(state.address, state.size))[2:]
            )
            now = state.decode(words)
            assert now["Sequence"] == now["SequenceEnd"]
            words = struct.unpack(
                f">{history.size}H", client.ask(read_pdu(history.address, history.size))[2:]
            )
            past = history.decode(words)
            first, step = past["HistoryCounter"], past["HistoryDecimation"]
            assert isinstance(first, int)
            assert isinstance(step, int)
            columns = [past[f"History{n}"] for n in ("MotorPosition", "TablePosition", "Torque")]
            for i, sample in enumerate(zip(*columns, strict=True)):
                if i < int(str(past["HistoryCount"])):
                    assert seen.setdefault(first + i * step, sample) == sample
            at = now["SampleCounter"]
            assert isinstance(at, int)
            if at in seen:
                assert seen[at] == (now["MotorPosition"], now["TablePosition"], now["Torque"])
    counters = np.array(sorted(seen))
    assert len(counters) > 500
    assert np.all(np.diff(counters) % step == 0)


def test_the_record_is_the_one_that_can_carries(tmp_path: Path, cli: Cli) -> None:
    """Both logged at the same time, over SLCAN and over TCP: every sample that both have is one."""
    link = tmp_path / "slcan"
    command = [str(REPOSITORY / "build" / "axistwin-emulator"), "--bus", f"pty:{link}"]
    command += ["--modbus", "tcp:0", "--excite", "--rate", "5000", "--stream-rate", "250"]
    with server(*command) as started:
        over_can = tmp_path / "can.log"
        can_log = [sys.executable, "-m", "axistwin", "log", "-i", "slcan", "-c", str(link)]
        can_log += ["-f", str(over_can), "--heartbeat-timeout", "5"]
        with subprocess.Popen(can_log, stdout=subprocess.DEVNULL) as beside:
            while not over_can.exists() or over_can.stat().st_size < 10000:
                assert beside.poll() is None
                time.sleep(0.05)
            status, _, messages = cli(
                "log", *tcp(started), "--duration", "1", "-f", str(tmp_path / "modbus.csv")
            )
            beside.send_signal(signal.SIGINT)
        assert (status, beside.returncode) == (0, 0), messages
    modbus, can = read_record(tmp_path / "modbus.csv"), read_record(over_can)
    assert modbus.time_step == pytest.approx(can.time_step, rel=1e-3)
    assert modbus.counts_per_turn == can.counts_per_turn
    assert modbus.meta["node"] == can.meta["node"] == 1
    assert modbus.meta["node_estimate"].keys() == can.meta["node_estimate"].keys()
    keys = {sample: i for i, sample in enumerate(zip(can.theta1, can.torque, strict=True))}
    there = np.setdiff1d(np.arange(len(modbus)), modbus.missing)
    places = np.array([keys.get((modbus.theta1[i], modbus.torque[i]), -1) for i in there])
    found = places >= 0
    assert np.count_nonzero(found) > 100
    # what both have is at the same distance in both, and the table encoder agrees, too
    assert len(np.unique(places[found] - there[found])) == 1
    assert modbus.theta2 is not None
    assert can.theta2 is not None
    assert np.array_equal(modbus.theta2[there[found]], can.theta2[places[found]])


def test_a_log_says_which_samples_the_line_was_too_slow_for(
    emulator: Server, cli: Cli, tmp_path: Path
) -> None:
    """Asked for more than fits: what is missing is known by the counter, and listed."""
    file, summary = tmp_path / "fast.csv", tmp_path / "fast.json"
    # One answer is held back for longer than the node keeps samples.
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=slow_gateway, args=(listener, emulator.port), daemon=True).start()
        channel = f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        arguments = ("-c", channel, "--rate", "4000", "--duration", "3", "--timeout", "20")
        status, _, messages = cli("log", *arguments, "-f", str(file), "--json", str(summary))
    told = json.loads(summary.read_text())
    assert status == 0, messages
    record = read_record(file)
    assert told["lost"] == len(record.missing) > 0
    assert told["samples"] + told["lost"] == len(record)
    assert f"{len(record.missing)} of {len(record)} samples are missing" in messages


def test_a_log_of_too_few_samples_is_left_as_it_is(
    emulator: Server, cli: Cli, tmp_path: Path
) -> None:
    file = tmp_path / "few.csv"
    with socket.create_server(("127.0.0.1", 0)) as listener:
        arguments = (listener, emulator.port, range(20, 10**6, 20))
        threading.Thread(target=slow_gateway, args=arguments, daemon=True).start()
        channel = f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        where = ("-c", channel, "--timeout", "20")
        status, _, messages = cli(
            "log", *where, "--rate", "20000", "--duration", "6", "-f", str(file)
        )
    assert status == 4, messages
    assert "the line is too slow for this rate: give a lower one with --rate" in messages
    assert f"what was logged is in {file}.jsonl" in messages
    assert list(tmp_path.iterdir()) == [tmp_path / "few.csv.jsonl"]


def slow_gateway(listener: socket.socket, port: int, late: Container[int] = (60,)) -> None:
    """Passes requests on; these answers come 1.5 s late: the node keeps 4096 samples."""
    client, _ = listener.accept()
    with client, Raw(port) as onward:
        for count in range(10**6):
            lump = client.recv(300)
            if not lump:
                return
            onward.send(lump)
            answer = onward.receive()
            if count in late:
                time.sleep(1.5)
            with contextlib.suppress(OSError):
                client.sendall(lump[:4] + struct.pack(">H", len(answer)) + answer)


def test_a_node_that_goes_away_leaves_a_record_and_a_word(
    station: Station, cli: Cli, tmp_path: Path
) -> None:
    file = tmp_path / "lost.csv"
    threading.Timer(1.5, station.kill).start()
    status, _, messages = cli(
        "log", *station.where, "--duration", "30", "--wait", "0.5", "-f", str(file)
    )
    assert status == 3
    assert "has not come back" in messages
    assert len(read_record(file)) > 100


def test_a_node_that_starts_afresh_is_noticed(station: Station, cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "afresh.csv"

    def restart() -> None:
        station.kill()
        time.sleep(2.5)  # longer than an answer may take
        station.start()

    disturbance = threading.Timer(1.0, restart)
    disturbance.start()
    times = ("--rate", "200", "--duration", "6", "--timeout", "2", "--wait", "20")
    status, _, messages = cli("log", *station.where, *times, "-f", str(file))
    disturbance.join()
    assert status == 3, messages
    assert "is back: gap from" in messages
    assert "the history starts afresh 1 times" in messages
    record = read_record(file)
    assert len(record) > 100
    assert len(record.missing) == 0


IDENTITY: dict[str, Value] = {
    "NodeId": 1,
    "ControlPeriod": 1e-3,
    "RatedTorque": 1000,
    "MotorResolution": 1000,
    "TableResolution": 0,
}


def history_of(first: int, count: int, decimation: int) -> dict[str, Value]:
    """What a node shows whose motor is at 2^26 counts times the control period, counted on."""
    n = first + decimation * np.arange(19)
    position = (n << 26).astype(np.int32)
    return {
        "HistoryCount": count,
        "HistoryDecimation": decimation,
        "HistoryCounter": first % 2**32,
        "HistoryMotorPosition": tuple(position.tolist()),
        "HistoryTablePosition": (0,) * 19,
        "HistoryTorque": tuple((n % 7).tolist()),
        "HistoryStatusWord": (0,) * 19,
    }


@given(
    st.integers(1, 3),
    st.integers(2**32 - 3000, 2**32 - 1),
    st.lists(st.tuples(st.integers(1, 19), st.integers(0, 5)), min_size=20, max_size=40),
)
def test_counters_and_positions_may_wrap_around(
    decimation: int, start: int, lumps: list[tuple[int, int]]
) -> None:
    """Whatever is missing between the lumps that come: the record is the motion, counted on."""
    log, n = HistoryLog(IDENTITY), start
    assert log.next == 0
    for count, missing in lumps:
        log.take(n * 1e-3, history_of(n, count, decimation))
        n += decimation * count
        assert log.next == n % 2**32
        n += decimation * missing
    n -= decimation * lumps[-1][1]
    total = (n - start) // decimation
    assert log.samples == sum(count for count, _ in lumps)
    assert log.samples + log.lost == total
    if 2 * log.samples < total:
        with pytest.raises(NotEnoughDataError):
            log.record("here", {})
        return
    record = log.record("here", {})
    assert len(record) == total
    assert len(record.missing) == log.lost
    counts = (decimation * np.arange(total)) * 2**26
    turns = (record.theta1 - record.theta1[0]) / (2.0 * np.pi)
    assert np.allclose(turns, counts / 1000.0, rtol=1e-9)
    there = np.setdiff1d(np.arange(total), record.missing)
    assert np.allclose(record.torque[there], ((start + decimation * there) % 7) * 1e-4)


def test_a_node_that_is_behind_has_started_afresh() -> None:
    log = HistoryLog(IDENTITY)
    log.take(100.0, history_of(5000, 19, 1))
    log.watch(110.0, history_of(15010, 19, 1))  # ten seconds on: 10000 periods of 1 ms
    assert log.next == 5019
    log.watch(110.0, history_of(14900, 19, 1))  # late by less than an answer may be
    assert log.next == 5019
    log.watch(110.0, history_of(9990, 19, 1))  # as many as there was time, but from 0
    assert log.next == 0


def test_a_log_excites_the_axis_and_leaves_it_as_it_was(
    station: Station, cli: Cli, tmp_path: Path
) -> None:
    file = tmp_path / "excited.csv"
    where = station.where
    arguments = ("--excite", "--duration", "1.5", "--timeout", "5", "-f", str(file))
    status, _, messages = cli("log", *where, *arguments)
    assert status == 0, messages
    _, output, _ = cli("read", *where, "StatusWord", "Torque", "Faults", "--json", "-")
    left = json.loads(output)
    assert np.std(read_record(file).torque) > 0.1
    assert (left["StatusWord"] & 0x6F, left["Torque"], left["Faults"]) == (0x40, 0, 0)


def test_registers_are_read_and_commands_given(station: Station, cli: Cli) -> None:
    where = station.where
    status, output, _ = cli("read", *where, "NodeId", "TestFloat", "--json", "-")
    assert (status, json.loads(output)) == (0, {"NodeId": 1, "TestFloat": pytest.approx(np.pi)})
    assert cli("write", *where, "HistoryDecimation", "40")[0] == 0
    deadline = time.monotonic() + 20
    read = ("read", *where, "HistoryDecimation", "--json", "-")
    while json.loads(cli(*read)[1]) != {"HistoryDecimation": 40}:
        assert time.monotonic() < deadline
    status, output, _ = cli("read", *where)
    assert status == 0
    assert [line.split()[0] for line in output.splitlines()] == list(TABLE.registers)


def test_the_drift_watch_is_started(emulator: Server, cli: Cli) -> None:
    deadline = time.monotonic() + 20
    while (ended := cli("write", *tcp(emulator), "DriftWatch", "1"))[0] != 0:
        assert "refuses DriftWatch: not now" in ended[2]  # before there is an estimate
        assert time.monotonic() < deadline
    _, output, _ = cli("read", *tcp(emulator), "Drift", "DriftAlarms", "--json", "-")
    assert json.loads(output) == {"Drift": 1, "DriftAlarms": 0}  # learning


def test_what_cannot_be_is_said_in_one_line(emulator: Server, cli: Cli) -> None:
    here = tcp(emulator)
    for arguments, status, words in (
        (("read", *here, "Position"), 2, "there is no register Position"),
        (("read", *here, "--node", "7", "--wait", "0"), 3, "there is no node of this id here"),
        (("read", *here, "--node", "200"), 2, "ids are 1 to 126"),
        (("read", "-c", "tcp:127.0.0.1:1", "--wait", "0"), 3, "cannot open tcp:127.0.0.1:1"),
        (("read", "-c", "rtu:/dev/nowhere", "--wait", "0"), 3, "cannot open rtu:/dev/nowhere"),
        (("read", "-c", "udp:1"), 2, "has to be tcp:HOST[:PORT] or rtu:DEVICE"),
        (("read", "-c", "tcp:here:http"), 2, "http is not a port"),
        (("write", *here, "Nonsense"), 2, "Command has no signal Nonsense"),
        (("write", *here, "HistoryDecimation", "0"), 2, "0 is out of range"),
        (("write", *here, "TraceUpload"), 3, "node 1 refuses TraceUpload: not now"),
        (("log", *here, "--rate", "1e6"), 2, "--rate has to be positive and at most 20000 Hz"),
        (("log", *here, "--duration", "0"), 2, "--duration has to be a positive time"),
    ):
        found, _, messages = cli(*arguments)
        assert found == status, messages
        assert words in messages
        assert messages.count("\n") == 1


def test_another_device_is_not_taken_for_a_node(cli: Cli) -> None:
    """pymodbus' own server, all registers 17."""
    program = (
        "from pymodbus.server import StartTcpServer\n"
        "from pymodbus.datastore import *\n"
        "block = ModbusSequentialDataBlock(1, [17] * 300)\n"
        "device = ModbusDeviceContext(hr=block)\n"
        "StartTcpServer(ModbusServerContext(devices=device, single=True),"
        " address=('127.0.0.1', int(__import__('sys').argv[1])))\n"
    )
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with subprocess.Popen([sys.executable, "-W", "ignore", "-c", program, str(port)]) as foreign:
        try:
            status, _, messages = cli("read", "-c", f"tcp:127.0.0.1:{port}", "--wait", "20")
        finally:
            foreign.terminate()
    assert status == 3
    assert "is not an AxisTwin node" in messages


# ---- Faults --------------------------------------------------------------------------------------


def test_a_slow_client_holds_up_nobody(emulator: Server) -> None:
    request = adu(read_pdu(0, 2))
    with contextlib.ExitStack() as stack:
        halves = [stack.enter_context(Raw(emulator.port)) for _ in range(10)]
        for i, half in enumerate(halves):
            half.send(request[: 1 + i])
        with Raw(emulator.port) as other:
            for _ in range(100):
                assert other.ask(read_pdu(0, 2))[2:] == SIGNATURE
        for i, half in enumerate(halves[:5]):  # the rest comes late, but comes
            half.send(request[1 + i :])
            assert half.receive()[3:] == SIGNATURE
        for half in halves[5:]:  # the rest does not come
            assert half.receive() == b""


def test_a_client_that_does_not_read_is_dropped_and_holds_up_nobody(emulator: Server) -> None:
    history = TABLE.blocks["History"]
    requests = 100 * adu(read_pdu(history.address, history.size))
    with Raw(emulator.port, timeout=60.0) as deaf:
        # 24 MB, and 20 times as many answers: more than any buffers hold
        with pytest.raises(OSError, match=r"reset|Broken pipe"):
            deaf.send(20000 * requests)
        assert is_well(emulator)


def test_more_clients_than_there_is_room_for_replace_the_most_silent(emulator: Server) -> None:
    with contextlib.ExitStack() as stack:
        clients = []
        for _ in range(32):
            clients.append(stack.enter_context(Raw(emulator.port)))
            assert clients[-1].ask(read_pdu(0, 2))[2:] == SIGNATURE
            time.sleep(0.003)
        assert clients[0].ask(read_pdu(0, 2))[2:] == SIGNATURE
        last = stack.enter_context(Raw(emulator.port))
        assert last.ask(read_pdu(0, 2))[2:] == SIGNATURE
        assert clients[1].receive() == b""
        for client in [clients[0], *clients[2:]]:
            assert client.ask(read_pdu(0, 2))[2:] == SIGNATURE


def test_sixteen_clients_each_get_their_own_answers(emulator: Server) -> None:
    wrong: list[bytes] = []

    def read(number: int) -> None:
        with Raw(emulator.port) as client:
            for i in range(200):
                transaction = (number << 8) + i
                client.send(adu(read_pdu(0, 1 + number), 1, transaction))
                header = client.socket.recv(6)
                rest = client.socket.recv(3 + 2 * (1 + number))
                if header[:2] != struct.pack(">H", transaction) or rest[3:5] != SIGNATURE[:2]:
                    wrong.append(header + rest)

    threads = [threading.Thread(target=read, args=(number,)) for number in range(14)]
    threads += [threading.Thread(target=read, args=(number,)) for number in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_requests_in_one_segment_are_answered_in_order(emulator: Server) -> None:
    with Raw(emulator.port) as client:
        client.send(b"".join(adu(read_pdu(i % 16, 1), 1, i) for i in range(500)))
        for i in range(500):
            header = client._exactly(6)
            assert header[:2] == struct.pack(">H", i)
            assert len(client._exactly(5)) == 5


def test_what_is_not_modbus_is_cut_off_and_impossible_counts_are_answered_at_once(
    emulator: Server,
) -> None:
    for nonsense in (
        b"GET / HTTP/1.1\r\n\r\n",
        b"\0\0\0\0\0\1\1",
        b"\0\0\0\0\1\0\1\3",
        b"\xff" * 300,
    ):
        with Raw(emulator.port) as client:
            client.send(nonsense)
            assert client.receive() == b""
    with Raw(emulator.port) as client:
        client.send(adu(b"\x83\2"))  # an answer: libmodbus would take it for a request
        assert client.receive() == b""
    with Raw(emulator.port) as client:
        for count in (0, 126, 2000, 0xFFFF):  # libmodbus would sleep half a second over each
            for _ in range(25):
                assert client.ask(read_pdu(0, count)) == b"\x83\x03"
        for pdu in (b"\x10\1\1\0\1\xff" + b"\0" * 240, b"\x17" + b"\xff" * 252, b"\x06\1"):
            assert client.ask(pdu)[:1] == bytes([pdu[0] | 0x80])
        for unit, expected in ((0, SIGNATURE), (255, SIGNATURE), (2, None), (100, None)):
            answer = client.ask(read_pdu(0, 2), unit)
            assert answer == (b"\x83\x0b" if expected is None else b"\x03\x04" + expected)


def test_nobody_commands_without_the_keys_nor_with_another_clients(emulator: Server) -> None:
    command = struct.pack(">BHHBIH", 16, ARGUMENT, 3, 6, 77, HISTORY_DECIMATION)
    with Raw(emulator.port) as owner, Raw(emulator.port) as other:
        assert other.ask(command) == b"\x90\x02"
        unlock(owner)
        assert other.ask(command) == b"\x90\x02"
        other.ask(write_pdu(WRITE_KEY, KEYS[1]))
        assert other.ask(command) == b"\x90\x02"
        assert history_decimation(emulator) == 20
        assert owner.ask(command) == command[:5]
        assert owner.ask(write_pdu(WRITE_KEY, 0)) == write_pdu(WRITE_KEY, 0)
        assert owner.ask(command) == b"\x90\x02"
    assert keeps_history(emulator, 77)


def test_a_drive_whose_host_falls_silent_stops_whoever_else_reads(emulator: Server) -> None:
    """Enabled over Modbus; then its client says nothing more, while another goes on reading."""
    word, torque = (TABLE.registers[name].address for name in ("ControlWord", "Torque"))
    status = TABLE.registers["StatusWord"].address

    def state(client: Raw) -> int:
        return int.from_bytes(client.ask(read_pdu(status, 1))[2:], "big") & 0x6F

    def becomes(client: Raw, wanted: int) -> bool:
        deadline = time.monotonic() + 20
        while state(client) != wanted and time.monotonic() < deadline:
            time.sleep(0.01)
        return state(client) == wanted

    with Raw(emulator.port) as host, Raw(emulator.port) as other:
        unlock(host)
        for control, setpoint, wanted in ((0, 0, 0x40), (6, 0, 0x21), (7, 0, 0x23), (15, 99, 0x27)):
            host.ask(struct.pack(">BHHBHh", 16, word, 2, 4, control, setpoint))
            assert becomes(host, wanted)
        assert becomes(other, 0x08)
        assert other.ask(read_pdu(torque, 1)) == b"\x03\x02\0\0"


def test_a_damaged_line_gives_no_wrong_values(on_line: tuple[Line, int]) -> None:
    """Either way bytes are changed, dropped and doubled: a client sees silence, never nonsense."""
    opened, unit = on_line
    random = np.random.default_rng(1)

    def damage(lump: bytes) -> bytes:
        kind, at = random.integers(8), int(random.integers(len(lump)))
        if kind == 0:
            return lump[:at] + bytes([lump[at] ^ 1 << int(random.integers(8))]) + lump[at + 1 :]
        if kind == 1:
            return lump[:at] + lump[at + 1 :]
        if kind == 2:
            return lump[:at] + lump[at : at + 1] + lump[at:]
        return lump

    opened.to_server = opened.to_client = damage
    opened.pause = 0.01  # a message is one lump, also where a board sends it byte by byte
    answers, silences = 0, 0
    with ModbusSerialClient(opened.client, baudrate=115200, timeout=0.15, retries=0) as client:
        for _ in range(20):
            assert client.connect()  # a client that got no answer has closed its port
            try:
                answer = client.read_holding_registers(0, count=6, device_id=unit)
            except Exception:
                silences += 1
                time.sleep(0.15)  # silence: 50 ms, on a board that may be slow
                continue
            if not answer.isError():
                assert answer.registers == [0x4158, 0x5457, 2, 0x4049, 0x0FDB, unit]
                answers += 1
    assert answers > 3
    assert silences > 3


def test_a_device_that_goes_and_comes_back_is_opened_again(tmp_path: Path, cli: Cli) -> None:
    link = tmp_path / "serial"
    with line() as first:
        link.symlink_to(first.server)
        started = server(SANITIZED, "--modbus", f"rtu:{link},115200,N", "--node", "5")
        stack = contextlib.ExitStack()
        running = stack.enter_context(started)
        assert cli("read", *rtu(first, 5), "NodeId")[0] == 0
    with stack, line() as second:
        link.unlink()
        link.symlink_to(second.server)
        status, output, messages = cli("read", *rtu(second, 5), "NodeId", "--wait", "20")
        assert status == 0, messages
        assert output.split() == ["NodeId", "5"]
        assert running.is_alive()


def test_an_address_that_cannot_be_used_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for where, words in (
            (f"tcp:{port}", "somebody else uses it"),
            ("tcp:no.such.host.invalid:1", "no such address"),
            ("rtu:/dev/nowhere", "no such address or device"),
            (f"rtu:{os.devnull},1234", "bit rate that it does not have"),
            ("udp:1", "no such address"),
        ):
            command = [str(SANITIZED), "--modbus", where]
            done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
            assert done.returncode == 3
            assert f"--modbus {where}" in done.stderr
            assert words in done.stderr


# ---- Anything at all -----------------------------------------------------------------------------

FUNCTIONS = st.sampled_from([1, 2, 3, 4, 5, 6, 15, 16, 20, 22, 23, 43]) | st.integers(0, 255)
WORD = st.sampled_from([0, 1, 2, 121, 123, 125, 126, 128, 255, 256, 259, 262, 0x7FFF, 0xFFFF])
WORDS = st.lists(WORD | st.integers(0, 0xFFFF), max_size=130)
PDUS = st.builds(
    lambda function, words, tail: (
        (bytes([function]) + struct.pack(f">{len(words)}H", *words))[:253] + tail
    ),
    FUNCTIONS,
    WORDS,
    st.binary(max_size=8),
)
LUMPS = st.one_of(
    st.builds(lambda pdu, unit: adu(pdu[:253], unit), PDUS, st.sampled_from([0, 1, 2, 255])),
    st.builds(lambda pdu, cut: adu(pdu[:253])[:cut], PDUS, st.integers(0, 260)),
    st.binary(max_size=300),
)
FUZZ = settings(
    max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)


@pytest.fixture(scope="module")
def under_fire() -> Iterator[tuple[Server, Line]]:
    """One emulator for many examples, over TCP and on a serial line."""
    with line() as opened:
        modbus = ("--modbus", "tcp:0", "--modbus", f"rtu:{opened.server},115200,N")
        with server(SANITIZED, *modbus) as started:
            yield started, opened


@FUZZ
@given(st.lists(LUMPS, max_size=5))
def test_nothing_that_comes_over_tcp_harms_or_changes_anything(
    under_fire: tuple[Server, Line], lumps: list[bytes]
) -> None:
    started, _ = under_fire
    with Raw(started.port) as client, contextlib.suppress(OSError):
        for lump in lumps:
            client.send(lump)
        client.socket.shutdown(socket.SHUT_WR)
        while client.receive():
            pass
    assert is_well(started)
    assert history_decimation(started) == 20


@FUZZ
@given(
    st.lists(
        st.builds(
            lambda pdu, unit: bytes([unit]) + pdu[:250], PDUS, st.sampled_from([0, 1, 2])
        ).map(lambda message: message + crc16(message))
        | st.binary(max_size=300),
        max_size=4,
    )
)
def test_nothing_that_comes_on_the_line_harms_or_changes_anything(
    under_fire: tuple[Server, Line], lumps: list[bytes]
) -> None:
    started, opened = under_fire
    for lump in lumps:
        opened.send(lump)
    assert is_well(started)
    assert history_decimation(started) == 20


def test_after_all_that_the_line_is_understood_again(under_fire: tuple[Server, Line]) -> None:
    _, opened = under_fire
    time.sleep(0.2)
    with ModbusSerialClient(opened.client, baudrate=115200, timeout=10) as client:
        assert client.connect()
        assert client.read_holding_registers(0, count=2, device_id=1).registers == [0x4158, 0x5457]
