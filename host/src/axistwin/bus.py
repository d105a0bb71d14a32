"""A node on a CAN bus: finding it, commanding it, noticing when it goes away.

Everything happens in poll(), in the caller's thread: a second thread for receiving would have to
wait for the first whenever that is busy, and would lose more than it saves. The kernel keeps what
comes in between.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import can
import can.cli
import can.util
from can.interfaces.socketcan import SocketcanBus

from axistwin import slcan
from axistwin.contract import NODES, Contract, load_contract
from axistwin.errors import (
    AxisTwinError,
    BusError,
    CommandRefusedError,
    ContractError,
    DriveFaultError,
    InputError,
    NoAnswerError,
    NodeLostError,
)
from axistwin.frames import IDENTITY, short
from axistwin.sharedbus import SharedBus
from axistwin.waiting import Tell, until_answered

if TYPE_CHECKING:  # takes a second, and most commands need none
    from axistwin.model import Model

#: A node that has sent no heartbeat for this long is gone, unless told otherwise: it sends one
#: every 100 ms.
HEARTBEAT_TIMEOUT = 0.5

#: What an answer may take at least, a busy bus included.
ANSWER_TIMEOUT = 1.0

# Room in the kernel for what is received while this program is busy: 20 s of a full bus. It is
# taken only as it is needed.
_RECEIVE_BUFFER = 64 << 20
_SO_RCVBUFFORCE = 33  # Linux, not known to the socket module; wants the right to administer the net

# What Linux says of a socket's memory: nine numbers, the last is of frames that were dropped.
_SO_MEMINFO = 55
_MEMORY = struct.Struct("=9I")

# So many frames are dealt with before the caller has its turn.
_BATCH = 256

_DEFAULT_CHANNEL = "vcan0"
_ASK_AGAIN = 0.25
#: Bits of the CiA 402 status word that are the state of the drive.
DRIVE_STATE = 0x6F

_EXCITED = 0x0100  # bit 8: the excitation plays

# How often this host's heartbeat is sent while it has a drive under its control [s].
_BEAT = 0.1

# What leads towards operation enabled, by the state of the drive: a control word, the next state.
_TOWARDS_ENABLED = {
    "QuickStopActive": ("DisableVoltage", "SwitchOnDisabled"),
    "SwitchOnDisabled": ("Shutdown", "ReadyToSwitchOn"),
    "ReadyToSwitchOn": ("SwitchOn", "SwitchedOn"),
    "SwitchedOn": ("EnableOperation", "OperationEnabled"),
    "OperationEnabled": ("EnableOperation", "OperationEnabled"),
}
_FAULT_STATES = ("FaultReactionActive", "Fault")
_KNOWN_ERRORS = {
    errno.EAFNOSUPPORT: "this kernel has no SocketCAN",
    errno.ENODEV: "there is no such CAN interface",
    errno.ENOENT: "there is no such device",
    errno.ENETDOWN: "the interface is down",
}
_LOGGING = ("critical", "info", "debug")
_STREAMING_AFTER = {"StreamStart": True, "StreamStartFd": True, "StreamStop": False}
#: Why a command was refused, by the contract's name of the result.
REFUSALS = {
    "UnknownCommand": "it does not know this command",
    "OutOfRange": "the argument is out of range",
    "NotNow": "not now",
    "NoRoom": "it has no room for that",
    "NotEnabled": "operation is not enabled",
    "NotWhileEnabled": "not while operation is enabled",
    "NoTransition": "its state does not lead there",
    "NoHostHeartbeat": "it does not hear a host's heartbeat",
    "NoFd": "its bus does not carry CAN FD frames",
}
_FAULTS = {
    "HostHeartbeatLost": "it has not heard this host for too long",
    "SpeedLimitExceeded": "the axis is faster than its speed limit",
    "TravelLimitExceeded": "the axis has left its travel range",
    "WatchdogReset": "its firmware hung, and its watchdog has started it anew",
    "InternalSoftware": "its firmware went wrong, and has started anew",
}

Sink = Callable[[can.Message], object]


@dataclass(frozen=True)
class NodeInfo:
    """What a node says about itself.

    ``control_period`` [s] is the time between samples of the trace, the live stream has one sample
    in ``stream_decimation`` of them. ``rated_torque`` [N m]; ``counts_per_turn`` of the encoders at
    motor and table (None: no such encoder); ``trace_capacity`` in samples.
    """

    contract: int
    firmware: str
    control_period: float
    rated_torque: float
    counts_per_turn: tuple[int, int | None]
    stream_decimation: int
    trace_capacity: int

    @staticmethod
    def of(pages: dict[str, float]) -> NodeInfo:
        """From the values of the report pages IDENTITY."""
        firmware = int(pages["Firmware"])
        return NodeInfo(
            contract=int(pages["Contract"]),
            firmware=f"{firmware >> 16 & 255}.{firmware >> 8 & 255}.{firmware & 255}",
            control_period=short(pages["ControlPeriod"]),
            rated_torque=pages["RatedTorque"] * 1e-3,
            counts_per_turn=(int(pages["MotorResolution"]), int(pages["TableResolution"]) or None),
            stream_decimation=int(pages["StreamDecimation"]),
            trace_capacity=int(pages["TraceCapacity"]),
        )

    def __str__(self) -> str:
        return (
            f"firmware {self.firmware}, {1.0 / self.control_period:.6g} Hz, "
            f"stream {1.0 / self.control_period / self.stream_decimation:.6g} Hz"
        )


def add_arguments(parser: argparse.ArgumentParser, several: bool = False) -> None:
    """Adds the options of python-can's own tools, and which node to talk to, to a parser.

    With ``several`` nodes, --node may be given more than once: nodes_of() then makes them all.
    """
    can.cli.add_bus_arguments(parser, group_title="bus")
    group = parser.add_argument_group("node")
    if several:
        text = "node id; give it again for each further node (default: 1)"
        group.add_argument("--node", type=int, action="append", metavar="ID", help=text)
    else:
        group.add_argument("--node", type=int, default=1, metavar="ID", help="node id (default: 1)")
    group.add_argument(
        "--wait",
        type=float,
        default=5.0,
        metavar="S",
        help="wait this long for a node that is not there, or has gone (default: 5)",
    )
    group.add_argument(
        "--heartbeat-timeout",
        type=float,
        default=HEARTBEAT_TIMEOUT,
        metavar="S",
        help=f"a node that has been silent this long is gone (default: {HEARTBEAT_TIMEOUT:g})",
    )
    group.add_argument(
        "-v",
        dest="verbosity",
        action="count",
        default=0,
        help="show python-can's messages (-vv: all)",
    )
    group.add_argument("--dbc", metavar="FILE", help="wire contract (default: the built-in one)")


class Node:
    """A connection to one node. Use it as a context manager, or close() it.

    ``sinks`` are called with every message that is received. ``errors`` counts bus error frames,
    ``frames`` everything else. ``pages`` and ``page_flags`` are the latest report pages by name.

    A drive that was enabled stops its torque when it does not hear from its host: poll() sends this
    host's heartbeat, so call it, or what calls it, at least every 200 ms.
    """

    def __init__(
        self,
        open_bus: Callable[[], can.BusABC],
        contract: Contract,
        node_id: int,
        heartbeat_timeout: float = HEARTBEAT_TIMEOUT,
    ) -> None:
        if node_id not in NODES:
            raise InputError(f"node {node_id}: ids are {NODES.start} to {NODES.stop - 1}")
        self.contract = contract
        self.id = node_id
        self.sinks: list[Sink] = []
        self.errors = 0
        self.frames = 0
        self.info: NodeInfo | None = None
        self.streaming = False
        self.pages: dict[str, float] = {}
        self.page_flags: dict[str, int] = {}
        self._open_bus = open_bus
        self._heartbeat_timeout = heartbeat_timeout
        self.answer_timeout = max(ANSWER_TIMEOUT, 2.0 * heartbeat_timeout)
        self._bus: can.BusABC | None = None
        self._drained = True
        self._heard: set[int] = set()
        self._last_heartbeat = 0.0
        self._gone: str | None = None
        self._status: int | None = None
        self._answers: list[bytes] = []
        self._refusals: list[bytes] = []
        self._beating = False
        self._last_beat = 0.0
        self._page_names = {
            multiplexer: signal.name
            for signal in contract.messages["Report"].signals
            for multiplexer in signal.multiplexer_ids or ()
        }
        self._state = contract.reader("Heartbeat", "State")
        self._page = contract.reader("Report", "Page")
        self._flags = contract.reader("Report", "Flags")
        self._sequence = contract.reader("Report", "Sequence")
        self._answer = contract.reader("Report", "Answer")
        self._error_code = contract.reader("Emergency", "ErrorCode")
        self._status_page = contract.reader("Report", "Status")
        self._status_word = contract.reader("Table", "StatusWord")
        self._status_word_fd = contract.reader("Samples", "StatusWord")
        self._heartbeats = range(
            contract.identifier("Heartbeat", NODES.start),
            contract.identifier("Heartbeat", NODES.stop),
        )
        self._handlers = {
            contract.identifier(message, node_id): (contract.length(message), handler)
            for message, handler in (
                ("Heartbeat", self._on_heartbeat),
                ("Emergency", self._on_emergency),
                ("Report", self._on_report),
                ("Table", self._on_table),
                ("Samples", self._on_samples),
            )
        }

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the bus. What the node does is left as it is; only a drive enabled here is not."""
        if self._beating:
            with contextlib.suppress(AxisTwinError):  # it stops its torque by itself soon
                self.disable()
        self._beating = False
        if self._bus is not None:
            _close(self._bus)
            self._bus = None

    def connect(self, wait: float, tell: Tell) -> NodeInfo:
        """Opens the bus and finds the node, both within ``wait`` seconds; ``tell`` says what for.

        Raises BusError when the bus cannot be opened, NoAnswerError when the node does not answer,
        ContractError when it speaks another version of the contract.
        """
        self._beating = False  # whoever answers is not under this host's control
        self._status = None
        self.close()
        self.info = None

        def attempt(deadline: float) -> NodeInfo:
            if self._bus is None:
                self._bus = self._open_bus()
            self.info = self._identify(deadline, tell)
            self._gone = None  # what was heard before does not count
            return self.info

        return until_answered(attempt, self.close, wait, tell)

    def poll(self, timeout: float) -> None:
        """Deals with everything that has been received, waiting up to ``timeout`` [s] for it.

        Raises NodeLostError when the bus has failed, or a connected node is silent or has started
        afresh.
        """
        self._beat()
        taken = 0
        message = self._receive(min(timeout, _BEAT) if self._beating else timeout)
        while message is not None:
            self._take(message)
            taken += 1
            message = self._receive(0.0) if taken < _BATCH else None
        self._drained = taken < _BATCH
        if self.info is None:
            return
        silent = time.monotonic() - self._last_heartbeat
        if self._gone is None and self._drained and silent > self._heartbeat_timeout:
            self._gone = f"node {self.id} is lost: no heartbeat for {silent * 1e3:.0f} ms"
        if self._gone is not None:
            raise NodeLostError(self._gone)

    @property
    def excited(self) -> bool | None:
        """Does the excitation play? None: not known."""
        return None if self._status is None else bool(self._status & _EXCITED)

    @property
    def state(self) -> str | None:
        """The state of the drive by its name in the contract. None: not known."""
        if self._status is None:
            return None
        return self.contract.names["DriveState"].get(self._status & DRIVE_STATE)

    @property
    def fault(self) -> str | None:
        """Why the drive is in fault; None when it is not."""
        if self.state not in _FAULT_STATES:
            return None
        code = int(self.pages.get("Error", 0))
        name = self.contract.name_of("Emergency", "ErrorCode", code)
        return _FAULTS.get(name, f"error 0x{code:04X}")

    def check_drive(self) -> None:
        """Raises DriveFaultError when the drive is in fault."""
        if self.fault is not None:
            raise DriveFaultError(f"node {self.id} is in fault, its torque off: {self.fault}")

    def enable(self) -> None:
        """Has the drive enable operation, step by step, and keeps it so by this host's heartbeat.

        A fault from before is reset. Raises CommandRefusedError or NoAnswerError when the drive
        does not follow, DriveFaultError when it goes into fault meanwhile.
        """
        self._beating = True
        self.await_status(lambda: self.state in (*_TOWARDS_ENABLED, "Fault"), "say its state")
        if self.state == "Fault":
            self.reset_fault()
        state = None
        while state != "OperationEnabled":
            self.check_drive()
            word, state = _TOWARDS_ENABLED[self.state or ""]
            self._control(word, state)

    def disable(self) -> None:
        """Ends operation: torque 0, and no heartbeat any more."""
        self._control("DisableVoltage", "SwitchOnDisabled", "Fault")
        self._beating = False

    def quick_stop(self) -> None:
        """Stops the torque at once; enable() goes on from there."""
        self._control("QuickStop", "QuickStopActive", "SwitchOnDisabled")

    def reset_fault(self) -> None:
        """Leads from fault to switch on disabled: the step of a bit from 0 to 1."""
        self._send(self.contract.control(self.id, "DisableVoltage"))
        self._control("FaultReset", "SwitchOnDisabled")

    def set_torque(self, torque: float) -> None:
        """The torque set-point [N m], within the drive's limits, while operation is enabled."""
        assert self.info is not None
        per_mille = 1e3 * torque / self.info.rated_torque
        self._send(self.contract.control(self.id, "EnableOperation", per_mille))

    def await_status(
        self,
        condition: Callable[[], bool],
        what: str,
        timeout: float = 0.0,
        again: can.Message | None = None,
    ) -> None:
        """Polls until the condition holds; what may have got lost is asked for and sent again.

        Raises NoAnswerError when the node does not do ``what`` within ``answer_timeout``, or
        ``timeout`` [s] where that is longer.
        """
        deadline = time.monotonic() + max(timeout, self.answer_timeout)
        while not self.wait_until(condition, _ASK_AGAIN):
            if time.monotonic() > deadline:
                raise NoAnswerError(f"node {self.id} does not {what}")
            if again is not None:
                self._send(again)
            self.command("Identify")

    def _control(self, word: str, *states: str) -> None:
        """Sends a control word and waits until the drive is in one of the states."""
        self._refusals.clear()
        message = self.contract.control(self.id, word)
        wanted = (*states, *(_FAULT_STATES if word != "FaultReset" else ()))
        self._send(message)
        self.await_status(
            lambda: bool(self._refusals) or self.state in wanted,
            f"follow the control word {word}",
            again=message,
        )
        if self._refusals:
            self._check_result(self._sequence(self._refusals[0]), f"the control word {word}", 0)
        if self.state not in states:
            self.check_drive()

    def _beat(self) -> None:
        """Sends this host's heartbeat when it is due."""
        now = time.monotonic()
        if self._beating and self._bus is not None and now - self._last_beat >= _BEAT:
            self._last_beat = now
            self._send(self.contract.host_heartbeat())

    def command(self, name: str, argument: float = 0) -> None:
        """Sends a command and waits until it is answered.

        Raises CommandRefusedError when the node will not, NoAnswerError when it does not answer.
        """
        message = self.contract.command(self.id, name, argument)
        argument_of = self.contract.reader("Command", name)
        wanted = self.contract.choice("Command", name), argument_of(bytes(message.data))

        def answers() -> list[bytes]:
            return [a for a in self._answers if (self._flags(a), self._answer(a)) == wanted]

        self._answers.clear()
        self._send(message)
        if not self.wait_until(lambda: bool(answers()), self.answer_timeout):
            raise NoAnswerError(f"node {self.id} does not answer the command {name}")
        self._check_result(self._sequence(answers()[0]), name, argument)
        self.streaming = _STREAMING_AFTER.get(name, self.streaming)

    def restart_axis(self, model: Model) -> None:
        """Has an emulated axis begin anew as that of a model, at rest at angle 0.

        Its numbers travel as float32. Raises InputError for a model that no emulated axis can be,
        CommandRefusedError where the axis is a real one, the drive enabled, or a number out of
        range; the axis then goes on as it was.
        """
        for name, argument in model.commands():
            self.command(name, argument)

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Polls until the condition holds; False when it does not within ``timeout`` [s].

        While frames are waiting to be dealt with, what is wanted may be among them: it then takes
        ten times as long to give up. Raises NodeLostError as poll() does.
        """
        begin = time.monotonic()
        while not condition():
            waited = time.monotonic() - begin
            if waited > (timeout if self._drained else 10.0 * timeout):
                return False
            self.poll(0.05)
        return True

    def _check_result(self, result: int, name: str, argument: float) -> None:
        if result != 0:
            what = f"{name} {argument:.10g}" if argument else name
            name = self.contract.names["Result"].get(result, "")
            reason = REFUSALS.get(name, f"result {result}")
            raise CommandRefusedError(f"node {self.id} refuses {what}: {reason}")

    def _receive(self, timeout: float) -> can.Message | None:
        if self._bus is None:
            raise NodeLostError("the bus is closed")
        try:
            return self._bus.recv(timeout)
        except (can.CanError, OSError) as error:
            raise NodeLostError(f"the bus has failed: {_reason(error)}") from error
        except (ValueError, IndexError):  # a line of SLCAN that has been garbled
            self.errors += 1
            return None

    def _send(self, message: can.Message) -> None:
        if self._bus is None:
            raise NodeLostError("the bus is closed")
        try:
            self._bus.send(message, timeout=self.answer_timeout)
        except (can.CanError, OSError, ValueError) as error:
            raise NodeLostError(f"cannot send on the bus: {_reason(error)}") from error

    def _identify(self, deadline: float, tell: Tell) -> NodeInfo:
        """Asks the node who it is until everything is known and a heartbeat was heard."""
        self.pages = {}
        begin = time.monotonic()
        told = False
        while True:
            self._send(self.contract.command(self.id, "Identify"))
            again = time.monotonic() + _ASK_AGAIN
            while time.monotonic() < again:
                self.poll(0.02)
                if "Contract" in self.pages:
                    self._check_contract()
                known = all(page in self.pages for page in IDENTITY)
                if known and self._last_heartbeat >= begin:
                    return NodeInfo.of(self.pages)
            if time.monotonic() >= deadline:
                raise NoAnswerError(f"no answer from node {self.id}; {self._who()}")
            if not told and time.monotonic() - begin > 0.4:
                left = deadline - time.monotonic()
                tell(f"waiting up to {left:.1f} s for node {self.id}; {self._who()}")
                told = True

    def _who(self) -> str:
        others = sorted(self._heard - {self.id})
        if others:
            numbers = ", ".join(map(str, others))
            return f"heard heartbeats of node{'s' if len(others) > 1 else ''} {numbers}"
        if self.frames > 0:
            return f"heard {self.frames} frames but no heartbeat of a node"
        return "heard nothing on the bus (is the node running, on this channel and bit rate?)"

    def _check_contract(self) -> None:
        version = int(self.pages["Contract"])
        if version != self.contract.version:
            raise ContractError(
                f"node {self.id} speaks contract version {version}, {self.contract.source} is "
                f"version {self.contract.version}; give the matching file with --dbc"
            )

    def _take(self, received: can.Message) -> None:
        if received.is_error_frame:
            self.errors += 1
        else:
            self.frames += 1
        if not (received.is_error_frame or received.is_extended_id or received.is_remote_frame):
            identifier = received.arbitration_id
            if identifier in self._heartbeats:
                self._heard.add(identifier - self._heartbeats.start + NODES.start)
            length, handler = self._handlers.get(identifier, (None, None))
            if handler is not None and len(received.data) == length:
                handler(bytes(received.data))
        for sink in self.sinks:
            sink(received)

    def _on_heartbeat(self, payload: bytes) -> None:
        state = self._state(payload)
        self._last_heartbeat = time.monotonic()
        self.streaming = state == self.contract.state("Operational")
        if state == self.contract.state("BootUp"):
            self._gone = f"node {self.id} has started afresh"
        elif state == self.contract.state("Stopped"):
            self._gone = f"node {self.id} has ended"

    def _on_report(self, payload: bytes) -> None:
        name = self._page_names.get(self._page(payload))
        if name == "Answer":
            self._answers.append(payload)
        elif name == "ControlRefused":
            self._refusals.append(payload)
        elif name is not None:
            self.pages[name] = self.contract.value("Report", name, payload)
            self.page_flags[name] = self._flags(payload)
            if name == "Status":
                self._status = self._status_page(payload)

    def _on_emergency(self, payload: bytes) -> None:
        code = self._error_code(payload)
        if self.contract.name_of("Emergency", "ErrorCode", code) in _FAULTS:
            self.pages["Error"] = code

    def _on_table(self, payload: bytes) -> None:
        self._status = self._status_word(payload)

    def _on_samples(self, payload: bytes) -> None:
        self._status = self._status_word_fd(payload)


def node_of(arguments: argparse.Namespace) -> Node:
    """The node that the arguments of add_arguments() name, not yet connected.

    Raises InputError when the wire contract cannot be read or the node id is impossible.
    """
    open_bus = _opener(arguments)
    contract = load_contract(arguments.dbc)
    return Node(open_bus, contract, arguments.node, arguments.heartbeat_timeout)


@contextlib.contextmanager
def nodes_of(arguments: argparse.Namespace) -> Iterator[tuple[SharedBus, list[Node]]]:
    """All nodes that the arguments of add_arguments() name, and the bus that they share.

    Raises InputError as node_of() does, and when a node is named twice.
    """
    ids = arguments.node or [1]
    if len(set(ids)) < len(ids):
        raise InputError("--node: each node once")
    shared = SharedBus(_opener(arguments), _close, _dropped)
    contract = load_contract(arguments.dbc)
    nodes = [Node(shared.open_port, contract, i, arguments.heartbeat_timeout) for i in ids]
    with contextlib.ExitStack() as stack:
        yield shared, [stack.enter_context(node) for node in nodes]


@contextlib.contextmanager
def listening(arguments: argparse.Namespace) -> Iterator[Callable[[float], can.Message | None]]:
    """The bus that the arguments name, to listen to: the next message within so many seconds.

    Opening it raises as Node.connect() does; what is yielded raises BusError when the bus fails.
    """
    opened = _opener(arguments)()

    def receive(timeout: float) -> can.Message | None:
        try:
            return opened.recv(timeout)
        except (can.CanError, OSError) as error:
            raise BusError(f"the bus has failed: {_reason(error)}") from error
        except (ValueError, IndexError):  # a line of SLCAN that has been garbled
            return None

    try:
        yield receive
    finally:
        _close(opened)


def _opener(arguments: argparse.Namespace) -> Callable[[], can.BusABC]:
    """What opens the bus that the arguments name. Raises InputError when they make no sense."""
    if not arguments.wait >= 0.0:
        raise InputError(f"--wait has to be 0 or more seconds, not {arguments.wait}")
    if not arguments.heartbeat_timeout > 0.0:
        raise InputError(
            f"--heartbeat-timeout has to be a positive time, not {arguments.heartbeat_timeout}"
        )
    slcan.register()
    defaults = _defaults(arguments)
    logging.basicConfig(format="%(name)s: %(message)s")
    can.set_logging_level(_LOGGING[min(arguments.verbosity, len(_LOGGING) - 1)])

    def open_bus() -> can.BusABC:
        merged = argparse.Namespace(**{**defaults, **vars(arguments)})
        name = f"{merged.interface} {merged.channel}"
        try:
            opened = can.cli.create_bus_from_namespace(merged)
        except argparse.ArgumentError as error:
            kind: type[AxisTwinError] = BusError
            if isinstance(error.__cause__, (ValueError, TypeError)):
                kind = InputError
            raise kind(f"cannot open {name}: {_reason(error)}") from error
        _enlarge_receive_buffer(opened)
        return opened

    return open_bus


def _close(bus: can.BusABC) -> None:
    # A carrier that has gone cannot be closed properly, and says so in many ways.
    with contextlib.suppress(Exception):
        bus.shutdown()
    if isinstance(bus, slcan.SlcanBus):  # stays open where it could not say goodbye
        bus.serialPortOrig.close()


def _defaults(arguments: argparse.Namespace) -> dict[str, Any]:
    """Bus arguments that were not given: from python-can's configuration, else the usual ones."""
    configured = {**can.util.load_file_config(), **can.util.load_environment_config(), **can.rc}
    channel = str(getattr(arguments, "channel", configured.get("channel") or _DEFAULT_CHANNEL))
    terminal = channel.startswith(("/", "socket://", "COM"))
    interface = configured.get("interface") or ("slcan" if terminal else "socketcan")
    defaults: dict[str, Any] = {"channel": channel, "interface": interface}
    if getattr(arguments, "interface", interface) == "slcan" and _is_software(channel):
        defaults["bus_kwargs"] = {"sleep_after_open": 0.0}  # nothing there that has to boot
    return defaults


def _enlarge_receive_buffer(bus: can.BusABC) -> None:
    """As far as this process may; other carriers than SocketCAN have no such buffer."""
    if not isinstance(bus, SocketcanBus):
        return
    for option in (socket.SO_RCVBUF, _SO_RCVBUFFORCE):
        with contextlib.suppress(OSError):
            bus.socket.setsockopt(socket.SOL_SOCKET, option, _RECEIVE_BUFFER)


def _dropped(bus: can.BusABC) -> int:
    """Frames that the kernel had no room for; other carriers than SocketCAN do not say."""
    if not isinstance(bus, SocketcanBus):
        return 0
    try:
        return int(
            _MEMORY.unpack(bus.socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMORY.size))[-1]
        )
    except OSError:  # the interface has gone
        return 0


def _reason(error: BaseException) -> str:
    """Why a bus has failed: the system's own word for it, under all that was said on top of it."""
    reason = str(error)
    below: BaseException | None = error
    while below is not None:
        if isinstance(below, OSError) and below.errno is not None:
            reason = _KNOWN_ERRORS.get(below.errno, os.strerror(below.errno))
        else:
            reason = str(below) or reason
        below = below.__cause__ or below.__context__
    # pyserial's word for a device that was unplugged, or a program at the other end that has ended
    return "the device has gone" if "returned no data" in reason else reason


def _is_software(channel: str) -> bool:
    """Is the other end of this SLCAN line a program?"""
    return channel.startswith("socket://") or os.path.realpath(channel).startswith("/dev/pts/")
