"""From frames to records: whatever is lost, doubled, late or damaged on the way is said."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import can
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin import frames
from axistwin.contract import load_contract
from axistwin.errors import InputError
from axistwin.readers import buslog, read_record
from axistwin.record import Record

Measured = Callable[[str], Path]
Messages = list[can.Message]

CONTRACT = load_contract()
PERIOD, DECIMATION, RATED = 5e-5, 20, 0.64
RESOLUTION = 1 << 20
ENDINGS = (".log", ".asc", ".blf", ".mf4", ".trc", ".db", ".log.gz")
PAGES = {
    "Contract": CONTRACT.version,
    "Firmware": 0x0102_03,
    "ControlPeriod": PERIOD,
    "RatedTorque": 640,
    "MotorResolution": RESOLUTION,
    "TableResolution": RESOLUTION,
    "StreamDecimation": DECIMATION,
    "TraceCapacity": 32768,
}


def message(name: str, values: Mapping[str, float], time: float, node: int = 1) -> can.Message:
    """A frame, encoded by cantools and not by what is tested here."""
    definition = CONTRACT.messages[name]
    return can.Message(
        timestamp=time,
        arbitration_id=definition.frame_id + node,
        data=definition.encode(values),
        is_extended_id=False,
        channel="vcan0",
    )


def report(
    page: str, value: float, time: float = 0.0, flags: int = 0, sequence: int = 0, node: int = 1
) -> can.Message:
    """A report page."""
    number = CONTRACT.choice("Report", page)
    values = {"Page": number, "Flags": flags, "Sequence": sequence, page: value}
    return message("Report", values, time, node)


def identity(time: float = 0.0, node: int = 1, **changed: float) -> Messages:
    """What a node says of itself."""
    return [report(page, value, time, node=node) for page, value in {**PAGES, **changed}.items()]


class Axis:
    """What an axis did: raw torque and positions that wrap around at 32 bits."""

    def __init__(self, n: int, seed: int = 0, start: int = 2**31 - 1000) -> None:
        random = np.random.default_rng(seed)
        self.torque = random.integers(-3000, 3000, n)
        self.counts = start + np.cumsum(random.integers(-50, 300, (n, 2)), axis=0)

    @property
    def wrapped(self) -> npt.NDArray[np.int32]:
        """The positions as 32-bit registers show them."""
        return self.counts.astype(np.int32)

    def check(self, record: Record, first: int = 0) -> None:
        """Compares the samples of a record that are not missing with what the axis did."""
        there = np.setdiff1d(np.arange(len(record)), record.missing)
        torque = record.torque[there] / (RATED * 1e-4)
        assert torque == pytest.approx(self.torque[first + there], abs=1e-6)
        assert record.theta2 is not None
        for angle, counts in zip((record.theta1, record.theta2), self.counts.T, strict=True):
            found = angle[there] * RESOLUTION / (2.0 * np.pi)
            moved = counts[first + there] - counts[first + there[0]]
            assert found - found[0] == pytest.approx(moved, abs=1e-4)


def stream(axis: Axis, counter: int = 0, begin: float = 0.0, node: int = 1) -> Messages:
    """The live stream of what the axis did, the first sample with this counter."""
    sent = []
    for i, (torque, (motor, table)) in enumerate(zip(axis.torque, axis.wrapped, strict=True)):
        time = begin + 1e-3 * i
        count = (counter + i) % 65536
        head = {"Counter": count, "Position": int(motor), "Torque": torque * 0.1}
        sent.append(message("Motor", head, time, node))
        tail = {"Counter": count, "Position": int(table), "StatusWord": 0x0237}
        sent.append(message("Table", tail, time + 1e-4, node))
    return sent


def trace(axis: Axis, begin: float = 0.0) -> Messages:
    """An uploaded trace with all that belongs to it."""
    sent = []
    for i, (torque, (motor, table)) in enumerate(zip(axis.torque, axis.wrapped, strict=True)):
        time = begin + 3e-4 * i
        head = {"Channel": 0, "Index": i, "MotorPosition": int(motor), "Torque": torque * 0.1}
        sent.append(message("Trace", head, time))
        tail = {"Channel": 1, "Index": i, "TablePosition": int(table), "StatusWord": 0x0237}
        sent.append(message("Trace", tail, time + 1e-4))
    checksum = zlib.crc32(b"".join(bytes(m.data) for m in sent))
    end = sent[-1].timestamp + 1e-4
    sent.append(report("TraceCaptured", len(axis.torque), end, flags=2))
    sent.append(report("TraceChecksum", checksum, end))
    return sent


def decode(messages: Messages, **settings: object) -> Record:
    part = settings.pop("part", None)
    options = frames.Settings(**settings)  # type: ignore[arg-type]
    collected = frames.Frames.of(messages)
    return frames.decode(collected, CONTRACT, "made here", options, part)  # type: ignore[arg-type]


@given(st.integers(0, 65535), st.sets(st.integers(0, 399), max_size=40), st.integers(0, 2**32 - 1))
def test_the_record_lists_exactly_the_samples_that_were_lost(
    counter: int, lost_frames: set[int], seed: int
) -> None:
    axis = Axis(200, seed)
    sent = stream(axis, counter)
    kept = [m for i, m in enumerate(sent) if i not in lost_frames]
    record = decode(identity() + kept)
    lost = sorted({i // 2 for i in lost_frames})
    first = next(i for i in range(200) if i not in lost)
    last = next(i for i in range(199, -1, -1) if i not in lost)
    assert record.missing.tolist() == [i - first for i in lost if first < i < last]
    assert len(record) == last - first + 1
    assert record.time_step == pytest.approx(PERIOD * DECIMATION)
    axis.check(record, first)


@given(st.data())
def test_frames_that_come_late_or_twice_change_nothing(data: st.DataObject) -> None:
    axis = Axis(100)
    sent = stream(axis, counter=65500)
    order = np.arange(len(sent)) + np.array(
        data.draw(st.lists(st.integers(-8, 8), min_size=len(sent), max_size=len(sent)))
    )
    twice = data.draw(st.sets(st.integers(0, len(sent) - 1), max_size=10))
    mixed = [sent[i] for i in np.argsort(order, kind="stable")]
    for i in sorted(twice):
        mixed.insert(i, mixed[i])
    record = decode(identity() + mixed)
    assert len(record) == 100
    assert len(record.missing) == 0
    axis.check(record)
    assert any("twice" in warning for warning in record.warnings) == bool(twice)


def test_a_node_that_starts_afresh_parts_the_record() -> None:
    before, after = Axis(300, 1), Axis(500, 2)
    boot = message("Heartbeat", {"State": 0}, 0.6)
    for marks in ([], [boot]):
        sent = stream(before, counter=40_000) + marks + stream(after, counter=3, begin=0.6)
        record = decode(identity() + sent)
        assert len(record) == 500
        after.check(record)
        assert any("starts afresh 1 times" in warning for warning in record.warnings)
    # where the new counter happens to go on from the old one, the boot-up still parts them
    sent = [*stream(before, counter=0), boot, *stream(after, counter=310, begin=0.6)]
    assert len(decode(identity() + sent)) == 500


def test_a_pause_in_which_the_counter_may_have_gone_round_parts_the_record() -> None:
    axis, later = Axis(300, 1), Axis(200, 2)
    pause = 65536e-3
    sent = stream(axis, counter=0) + stream(later, counter=310, begin=0.31 + pause)
    record = decode(identity() + sent)
    assert len(record) == 300
    axis.check(record)


def test_a_change_of_the_stream_rate_parts_the_record() -> None:
    slow, fast = Axis(100, 1), Axis(400, 2)
    sent = (
        identity()
        + stream(slow, counter=100)
        + [report("StreamDecimation", 10, 0.1)]
        + stream(fast, counter=200, begin=0.1)
    )
    record = decode(sent)
    assert len(record) == 400
    assert record.time_step == pytest.approx(PERIOD * 10)
    fast.check(record)
    # samples at the new rate come between the answer to the command and the report of the rate
    sent.insert(-790, sent.pop(sent.index(sent[-801])))
    code = CONTRACT.choice("Command", "StreamStart")
    sent.insert(-801, report("Answer", 10, 0.1, flags=code))
    record = decode(sent)
    assert len(record) == 400
    assert record.meta["frames"]["contradictory"] == 0
    fast.check(record)


def test_frames_of_the_wrong_length_are_counted_and_left_out() -> None:
    axis = Axis(50)
    sent = stream(axis)
    for i in (10, 30, 40):
        sent[i].data = sent[i].data[:6]
        sent[i].dlc = 6
    record = decode(identity() + sent)
    assert record.missing.tolist() == [5, 15, 20]
    assert any("3 Motor frames do not have 8 bytes" in warning for warning in record.warnings)


def test_error_frames_and_late_control_periods_are_said() -> None:
    sent = [*identity(), report("Overruns", 5), *stream(Axis(50)), report("Overruns", 12, 1.0)]
    sent.append(can.Message(is_error_frame=True, timestamp=1.0))
    warnings = decode(sent).warnings
    assert "1 bus error frames" in warnings
    assert "the node's control loop was late 7 times" in warnings


def test_what_the_log_does_not_say_has_to_be_given() -> None:
    axis = Axis(60)
    sent = stream(axis)
    given: dict[str, object] = {}
    for option, name, value in (
        ("--counts", "counts_per_turn", (RESOLUTION, RESOLUTION)),
        ("--time-step", "time_step", 1e-3),
        ("--rated-torque", "rated_torque", RATED),
    ):
        with pytest.raises(InputError, match="give --"):
            decode(sent, **given)
        given[name] = value
        assert option
    record = decode(sent, **given)
    assert record.time_step == 1e-3
    axis.check(record)


def test_a_node_has_to_be_chosen_where_there_are_several() -> None:
    one, two = Axis(50, 1), Axis(50, 2)
    sent = identity() + identity(node=2) + stream(one) + stream(two, node=2)
    with pytest.raises(InputError, match="holds nodes 1, 2; say which one with --node"):
        decode(sent)
    two.check(decode(sent, node=2))
    with pytest.raises(InputError, match="no samples of node 3, but of 1, 2"):
        decode(sent, node=3)


def test_frames_of_other_devices_make_no_node() -> None:
    foreign = [can.Message(arbitration_id=0x123, data=b"12345678", is_extended_id=False)]
    with pytest.raises(InputError, match="none of its 1 CAN frames is a node's sample"):
        decode(foreign)
    # a CANopen device whose identifiers happen to be those of a node
    alien = [m for m in stream(Axis(10), node=5) if m.arbitration_id == 0x185]
    assert len(decode(identity() + stream(Axis(20)) + alien)) == 20


def test_another_version_of_the_contract_is_not_decoded() -> None:
    with pytest.raises(InputError, match=r"version 9, axistwin\.dbc is version 3"):
        decode(identity(Contract=9) + stream(Axis(10)))


@given(st.sets(st.integers(0, 199), max_size=20), st.integers(0, 2**32 - 1))
def test_a_trace_lists_exactly_the_samples_that_were_lost(lost: set[int], seed: int) -> None:
    axis = Axis(100, seed)
    sent = [m for i, m in enumerate(trace(axis)) if i not in lost]
    record = decode(identity() + sent)
    gone = sorted({i // 2 for i in lost})
    first = next(i for i in range(100) if i not in gone)
    last = next(i for i in range(99, -1, -1) if i not in gone)
    assert record.missing.tolist() == [i - first for i in gone if first < i < last]
    assert record.time_step == pytest.approx(PERIOD)
    axis.check(record, first)
    assert not any("checksum" in warning for warning in record.warnings)


def test_a_trace_that_was_altered_does_not_match_its_checksum() -> None:
    sent = trace(Axis(100))
    sent[40].data[3] ^= 1
    assert "the trace does not match its checksum" in decode(identity() + sent).warnings


def test_trace_or_stream_can_be_chosen_where_both_are_there() -> None:
    live, fast = Axis(50, 1), Axis(30, 2)
    sent = identity() + stream(live) + trace(fast, begin=0.1)
    assert decode(sent).meta["part"] == "trace"
    fast.check(decode(sent))
    live.check(decode(sent, part="stream"))
    with pytest.raises(InputError, match="holds no trace of node 1"):
        decode(identity() + stream(live), part="trace")


def test_the_latest_complete_estimate_is_found() -> None:
    names = ("I1", "I2", "B", "K", "Wn", "Wd", "Zeta")

    def snapshot(sequence: int, factor: float, valid: int) -> Iterator[can.Message]:
        for kind, size in (("Estimate", 1.0), ("Error", 0.01)):
            for i, name in enumerate(names, 1):
                value = factor * size * i
                yield report(kind + name, value, flags=valid, sequence=sequence)

    cut = list(snapshot(7, 3.0, 1))[:-1]
    sent = [*snapshot(5, 1.0, 0), *snapshot(6, 2.0, 1), *cut]
    found = decode(identity() + stream(Axis(20)) + sent).meta["node_estimate"]
    assert found["axis"] == pytest.approx({"I1": 2.0, "I2": 4.0, "B": 6.0, "K": 8.0})
    assert found["modal_error"] == pytest.approx({"wn": 0.1, "wd": 0.12, "zeta": 0.14})
    assert found["valid"] == (True, True, True, True)
    assert "node_estimate" not in decode(identity() + stream(Axis(20)) + cut).meta


@given(st.binary(min_size=64, max_size=64))
def test_every_signal_is_decoded_as_cantools_does(payload: bytes) -> None:
    for name, definition in CONTRACT.messages.items():
        selector = next((s for s in definition.signals if s.is_multiplexer), None)
        for choice in {i for s in definition.signals for i in s.multiplexer_ids or ()} or {0}:
            data = bytearray(payload[: definition.length])
            if selector is not None:
                data[0] = data[0] & ~(2**selector.length - 1) & 0xFF | choice
            expected = definition.decode(bytes(data), decode_choices=False, scaling=False)
            row = np.frombuffer(bytes(data), np.uint8)[None, :]
            assert isinstance(expected, dict)
            for signal, value in expected.items():
                np.testing.assert_equal(float(CONTRACT.raw(name, signal, row)[0]), value)


@pytest.mark.parametrize(
    "ending", [".log", ".asc", ".blf", ".mf4", ".trc", ".csv", ".db", ".log.gz"]
)
def test_what_python_can_writes_is_read(ending: str, tmp_path: Path) -> None:
    axis = Axis(200)
    begin = 1_700_000_000.0
    sent = identity(begin) + stream(axis, counter=65_500, begin=begin + 0.01)
    file = tmp_path / f"live{ending}"
    with can.Logger(file) as writer:
        for item in sent:
            writer(item)
    record = read_record(file)
    assert len(record) == 200
    assert len(record.missing) == 0
    assert record.source == str(file)
    axis.check(record)


# Readers that cannot read a file leave it open.
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@given(st.binary(max_size=400))
@pytest.mark.parametrize("ending", ENDINGS)
def test_garbage_in_a_bus_log_gets_one_clear_line(
    tmp_path_factory: pytest.TempPathFactory, ending: str, garbage: bytes
) -> None:
    file = tmp_path_factory.mktemp("garbage") / f"live{ending}"
    file.write_bytes(b"x" + garbage)
    with pytest.raises(InputError) as caught:
        read_record(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "count", "errors"),
    [
        ("pythoncan_issue_1256.asc", 1457, 0),
        ("pythoncan_test_CanMessage.asc", 2, 0),
        ("pythoncan_test_CanMessage.blf", 2, 0),
        ("pythoncan_test_CanMessage.trc", 2, 0),
        ("pythoncan_logfile_errorframes.asc", 1, 3),
        ("pythoncan_test_CanFdMessage.asc", 2, 0),
        ("pythoncan_test_CanFdMessage.blf", 2, 0),
    ],
)
def test_logs_of_other_tools_are_read(
    measured: Measured, name: str, count: int, errors: int
) -> None:
    file = measured(f"CAN_interop/{name}")
    found, damage = buslog.read_frames(file)
    assert (len(found), found.errors, damage) == (count, errors, ())
    with pytest.raises(InputError, match="is a node's sample"):
        read_record(file)


def test_a_log_without_data_frames_is_said_to_have_none(measured: Measured) -> None:
    with pytest.raises(InputError, match="it holds no data frames"):
        read_record(measured("CAN_interop/asammdf_test_metadata.mf4"))


@pytest.mark.parametrize("version", ["0.5.6", "0.6.10"])
def test_the_dbc_of_another_drive_is_no_contract(measured: Measured, version: str) -> None:
    with pytest.raises(InputError, match="no AxisTwin contract: it has no proper message Motor"):
        load_contract(measured(f"CAN_interop/odrive-cansimple-{version}.dbc"))


def test_a_file_that_is_no_dbc_is_said_to_be_none(tmp_path: Path) -> None:
    file = tmp_path / "x.dbc"
    file.write_bytes(b"\x00garbage\xff")
    with pytest.raises(InputError, match=r"x\.dbc is not a DBC file"):
        load_contract(file)
    with pytest.raises(InputError, match="No such file"):
        load_contract(tmp_path / "nothing.dbc")
