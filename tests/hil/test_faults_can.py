"""Faults of the bus, of the host and of the node: each is survived, and none is silent.

What is missing is known from the node's own sample counter and compared with what the injector says
it has done.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from axistwin.errors import InputError
from axistwin.readers import read_record

from .carriers import INTERFACE, OPTIONS, OWN, SECOND, VCAN, Carrier, EmulatorCarrier
from .conftest import Host, during, pages

MOTOR, TABLE, SAMPLES = 0x181, 0x281, 0x401
LENGTHS = {MOTOR: 8, TABLE: 8, SAMPLES: 64}
PACKED = 6  # samples in a Samples frame
SLOW_STREAM = ("--stream-rate", "100")
BACK_OFF = 0.1  # after a bus-off [s]
PROTOCOL_ERROR, CONTROLLER, BUS_OFF = 0x008, 0x004, 0x040  # classes of error frames
PASSIVE = 0x20
FAR = "vcan1"  # where the node is when something is between it and the host


def ip(*arguments: str) -> None:
    """Changes the network of this namespace."""
    subprocess.run(["ip", *arguments], check=True)


class Injector:
    """A running injector.py between the node's side, vcan1, and the host's, vcan0."""

    def __init__(self, fault: str, every: int, *identifiers: int) -> None:
        program = Path(__file__).with_name("injector.py")
        command = [sys.executable, "-S", "-E", str(program), FAR, VCAN, fault, str(every)]
        command += [f"{identifier:X}" for identifier in identifiers]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert self._process.stdout.readline().startswith("injector: ")

    def kill(self) -> None:
        """Ends it whatever it does."""
        self._process.kill()
        self._process.wait()

    def stop(self) -> list[tuple[int, int]]:
        """Ends it; identifier and sample counter of each frame that was harmed."""
        self._process.terminate()
        output, _ = self._process.communicate(timeout=60)
        frames = [line.split("#") for line in output.splitlines()]
        return [
            (int(identifier, 16), int.from_bytes(bytes.fromhex(data)[:2], "little"))
            for identifier, data in frames
        ]


@pytest.fixture
def far() -> Iterator[Carrier]:
    """A second interface for the node, away from the host's."""
    ip("link", "add", "dev", FAR, "type", "vcan")
    ip("link", "set", FAR, "up")
    with EmulatorCarrier(FAR, "socketcan", FAR) as opened:
        yield opened
    ip("link", "del", FAR)


StartInjector = Callable[..., Injector]


@pytest.fixture
def injector() -> Iterator[StartInjector]:
    """Starts injectors that end with the test."""
    started: list[Injector] = []

    def start(fault: str, every: int, *identifiers: int) -> Injector:
        started.append(Injector(fault, every, *identifiers))
        return started[-1]

    yield start
    for one in started:
        one.kill()


def frames_of(log: Path, identifier: int) -> list[can.Message]:
    """The frames with this identifier in a log."""
    with can.LogReader(log) as reader:
        return [message for message in reader if message.arbitration_id == identifier]


def counters_of(log: Path, identifier: int) -> list[int]:
    """The sample counters of the whole frames with this identifier in a log."""
    length = LENGTHS[identifier]
    whole = [m.data for m in frames_of(log, identifier) if len(m.data) == length]
    return [int.from_bytes(data[:2], "little") for data in whole]


def missing_from(log: Path) -> list[int]:
    """Samples, counted from the first, that a log lacks wholly or in part."""
    motor, table = (counters_of(log, identifier) for identifier in (MOTOR, TABLE))
    first, last = min(motor[0], table[0]), max(motor[-1], table[-1])
    return [n - first for n in range(first, last + 1) if n not in motor or n not in table]


# In what the reader says of a log, what each fault is called.
FOUND_AS = {
    "drop": "missing",
    "duplicate": "twice",
    "swap": "out_of_order",
    "delay": "out_of_order",
    "cut": "wrong_length",
}
# What makes the host ask for a stream, the frames that carry it, and samples in one of them.
STREAMS: dict[str, tuple[tuple[str, ...], tuple[int, ...], int]] = {
    "classical": (SLOW_STREAM, (MOTOR, TABLE), 1),
    "fd": (("--fd", "--stream-rate", "600"), (SAMPLES,), PACKED),
}
EVERY = 23


@pytest.mark.needs(OWN)
@pytest.mark.parametrize("fault", FOUND_AS)
@pytest.mark.parametrize("stream", STREAMS)
def test_the_record_says_which_samples_are_missing(
    carrier: Carrier,
    far: Carrier,
    injector: StartInjector,
    host: Host,
    tmp_path: Path,
    stream: str,
    fault: str,
) -> None:
    options, identifiers, packed = STREAMS[stream]
    far.start()
    faulty = injector(fault, EVERY, *identifiers)
    log, summary = tmp_path / "faulty.log", tmp_path / "faulty.json"
    arguments = ("--duration", "2", "-f", str(log), "--json", str(summary))
    host("log", *carrier.host, *options, *arguments).expect(0)
    harmed = faulty.stop()
    assert {identifier for identifier, _ in harmed} == set(identifiers)

    record = read_record(log)
    arrived = {i: counters_of(log, i) for i in identifiers}
    first = min(counters[0] for counters in arrived.values())
    lost = sorted({c - first + k for i, c in harmed if c not in arrived[i] for k in range(packed)})
    assert len(record) > 100
    assert record.missing.tolist() == [place for place in lost if place < len(record)]
    assert json.loads(summary.read_text())["lost"] == len(record.missing)
    assert record.meta["frames"][FOUND_AS[fault]] >= 4, record.meta["frames"]
    assert len(record.missing) <= packed or fault in ("drop", "cut")


@pytest.mark.needs(OWN)
def test_a_sample_with_a_wrong_counter_is_missing_and_takes_no_place_of_another(
    carrier: Carrier,
    far: Carrier,
    injector: StartInjector,
    host: Host,
    tmp_path: Path,
) -> None:
    far.start()
    faulty = injector("count", EVERY, MOTOR)
    log = tmp_path / "miscounted.log"
    host("log", *carrier.host, *SLOW_STREAM, "--excite", "--duration", "2", "-f", str(log)).expect(
        0
    )
    harmed = [counter for _, counter in faulty.stop()]
    first = counters_of(log, MOTOR)[0]
    record = read_record(log)
    assert len(record.missing) >= 4
    assert set(record.missing.tolist()) == {c - first for c in harmed if c - first < len(record)}


@pytest.mark.needs(OWN)
def test_error_frames_and_bus_off_cost_no_sample(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    log = tmp_path / "errors.log"
    with can.Bus(VCAN, "socketcan") as controller:

        def report() -> None:
            for error, detail in ((PROTOCOL_ERROR, 0), (CONTROLLER, PASSIVE), (BUS_OFF, 0)):
                data = bytes([0, detail, 0, 0, 0, 0, 0, 0])
                controller.send(can.Message(arbitration_id=error, data=data, is_error_frame=True))

        later = threading.Timer(1.0, report)
        later.start()
        outcome = host("log", *carrier.host, *SLOW_STREAM, "--duration", "3", "-f", str(log))
        later.join()
    outcome.expect(0, "3 bus errors")
    record = read_record(log)
    assert len(record) > 150
    assert len(record.missing) == 0
    assert record.meta["frames"]["error_frames"] == 3
    arrivals = [message.timestamp for message in frames_of(log, MOTOR)]
    assert max(b - a for a, b in itertools.pairwise(arrivals)) > BACK_OFF
    counted = pages(carrier)
    assert [counted[name] for name in ("BusErrors", "BusOffs", "BusOutages")] == [3, 1, 0]


@pytest.mark.needs(OWN)
def test_an_interface_that_goes_down_or_away_is_taken_up_again(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()

    def interrupt() -> None:
        ip("link", "set", VCAN, "down")
        time.sleep(0.4)
        ip("link", "set", VCAN, "up")
        time.sleep(1.0)
        ip("link", "del", VCAN)
        time.sleep(0.4)
        ip("link", "add", "dev", VCAN, "type", "vcan")
        ip("link", "set", VCAN, "up")

    disturbance = threading.Timer(1.0, interrupt)
    disturbance.start()
    log = tmp_path / "outage.log"
    outcome = host(
        "log", *carrier.host, *SLOW_STREAM, "--duration", "5", "-f", str(log), "--wait", "30"
    )
    disturbance.join()
    outcome.expect(3, "the interface is down", "gap from")
    assert outcome.messages.count("node 1 is back") == 2
    record = read_record(log)
    assert len(record) > 200
    assert record.missing.tolist() == missing_from(log) != []
    counted = pages(carrier)
    assert counted["LostSamples"] == 0  # the node has kept what it could not send
    assert counted["BusOutages"] == 2


@pytest.mark.needs(SECOND)
def test_two_nodes_with_one_id_are_told(
    carrier: EmulatorCarrier, host: Host, tmp_path: Path
) -> None:
    for _ in range(2):
        carrier.start("--stream", *SLOW_STREAM)
        time.sleep(1.0)
    log = tmp_path / "twins.log"
    host("log", *carrier.host, "--duration", "2", "-f", str(log))
    with pytest.raises(InputError, match="two nodes with id 1 send at the same time"):
        read_record(log)


@pytest.mark.needs(INTERFACE)
def test_a_full_bus_costs_no_sample(carrier: Carrier, host: Host, tmp_path: Path) -> None:
    """A second of bus time at 1 Mbit/s, sent by another node in one go."""
    carrier.start()
    log = tmp_path / "full.log"
    form = ("-I", "7A5", "-L", "8", "-D", "i")
    command = ("cangen", carrier.channel, "-g", "0", "-p", "1", "-n", "7400", *form)

    def fill() -> None:
        subprocess.run(command, check=True)
        time.sleep(1.0)

    with during(log, fill):
        host("log", *carrier.host, *SLOW_STREAM, "-f", str(log)).expect(0)
    others = [int.from_bytes(message.data, "little") for message in frames_of(log, 0x7A5)]
    assert others == list(range(7400))
    record = read_record(log)
    assert len(record) > 100
    assert len(record.missing) == 0
    assert pages(carrier)["LostSamples"] == 0


def test_a_host_that_dies_leaves_its_log_and_the_node_to_the_next(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    log = tmp_path / "first.log"
    command = [sys.executable, "-m", "axistwin", "log", *carrier.host, *SLOW_STREAM, "-f", str(log)]
    first = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while not log.exists() or len(log.read_bytes()) < 20000:
        assert first.poll() is None
        time.sleep(0.2)
    first.kill()
    first.wait()
    assert len(read_record(log)) > 100
    log = tmp_path / "second.log"
    host("log", *carrier.host, *SLOW_STREAM, "--duration", "1", "-f", str(log)).expect(0)
    assert len(read_record(log).missing) == 0


@pytest.mark.needs(OPTIONS)
def test_a_clock_that_is_200_ppm_fast_is_put_right(
    carrier: EmulatorCarrier, host: Host, tmp_path: Path
) -> None:
    carrier.start("--clock-error", "200")
    log = tmp_path / "fast.log"
    host("log", *carrier.host, *SLOW_STREAM, "--duration", "4", "-f", str(log)).expect(0)
    record = read_record(log)
    clock = record.meta["frames"]["clock"]
    # A computer that becomes busy half way is some 10 us later with everything from then on.
    stamps = 20.0
    assert abs(clock["drift_ppm"] + 200.0) < max(stamps, 5.0 * clock["error_ppm"])
    assert 5.0 * clock["error_ppm"] < 100.0
    assert record.time_step == pytest.approx(0.01 / (1.0 + 200e-6), rel=1e-4)
