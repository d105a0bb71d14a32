"""A node's registers over Modbus, TCP or a serial line: reading, commands, and its history.

Everything of one block is read with one request, so its values are of one moment.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any, cast

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.client.base import ModbusBaseSyncClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from axistwin.bus import REFUSALS
from axistwin.contract import NODES, load_contract
from axistwin.core import Axis, Estimate, Modal
from axistwin.errors import (
    BusError,
    CommandRefusedError,
    ContractError,
    InputError,
    NoAnswerError,
)
from axistwin.registers import Value, load_table
from axistwin.waiting import Tell, until_answered

#: Port of Modbus over TCP where none is given.
PORT = 502

#: The command of the registers that the CAN contract does not have.
HISTORY_DECIMATION = "HistoryDecimation"
_HISTORY_CODE = 256

_KEYS = (0x4158, 0x5457)
_BUSY = 6
_BUSY_TRIES = 10
_BUSY_PAUSE = 0.01
_ANSWER_MAX = 2.0

# Bit 8 of the status word: the excitation plays, once it has been filled in line by line [s].
_EXCITED = 0x0100
_FILLING_MAX = 30.0
_EXCEPTIONS = {
    1: "it does not serve this function",
    2: "it has no such register, or does not let this be written",
    3: "the value is out of range",
    4: "it refuses",
    _BUSY: "not now",
    11: "there is no node of this id here",
}
_ARGUMENT_END = 1 << 32


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds which node to talk to, and how, to a parser."""
    group = parser.add_argument_group("bus")
    group.add_argument(
        "-c",
        "--channel",
        default="tcp:127.0.0.1",
        metavar="WHERE",
        help=f"tcp:HOST[:PORT] or rtu:DEVICE (default: tcp:127.0.0.1:{PORT})",
    )
    group.add_argument(
        "-b",
        "--bitrate",
        type=int,
        default=19200,
        metavar="BITS",
        help="of a serial line (default: 19200)",
    )
    group.add_argument(
        "--parity", choices="NEO", default="E", help="of a serial line (default: E, even)"
    )
    group.add_argument(
        "--node", type=int, default=1, metavar="ID", help="node id, the Modbus unit (default: 1)"
    )
    group.add_argument(
        "--timeout",
        type=float,
        default=1.0,
        metavar="S",
        help="an answer may take so long (default: 1)",
    )
    group.add_argument(
        "--wait",
        type=float,
        default=5.0,
        metavar="S",
        help="wait this long for a node that is not there, or has gone (default: 5)",
    )


def client_of(arguments: argparse.Namespace) -> Client:
    """The client that the arguments of add_arguments() ask for. Raises InputError."""
    if arguments.node not in NODES:
        raise InputError(f"node {arguments.node}: ids are {NODES.start} to {NODES.stop - 1}")
    if not arguments.timeout > 0.0 or not arguments.wait >= 0.0:
        raise InputError("--timeout has to be positive, --wait 0 or more seconds")
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # what goes wrong is raised as well
    line = _line(arguments.channel, arguments.bitrate, arguments.parity, arguments.timeout)
    return Client(line, arguments.channel, arguments.node)


def _line(channel: str, bitrate: int, parity: str, timeout: float) -> ModbusBaseSyncClient:
    kind, _, where = channel.partition(":")
    if kind == "tcp" and where:
        host, separator, port = where.rpartition(":")
        if not separator or where.endswith("]"):
            host, port = where, str(PORT)
        if not port.isdecimal() or int(port) > 65535:
            raise InputError(f"--channel {channel}: {port} is not a port")
        return ModbusTcpClient(host.strip("[]"), port=int(port), timeout=timeout, retries=0)
    if kind == "rtu" and where:
        if bitrate < 1:
            raise InputError(f"--bitrate has to be positive, not {bitrate}")
        return ModbusSerialClient(
            where,
            baudrate=bitrate,
            parity=parity,
            stopbits=2 if parity == "N" else 1,
            timeout=timeout,
            retries=0,
        )
    raise InputError(f"--channel {channel}: has to be tcp:HOST[:PORT] or rtu:DEVICE")


class Client:
    """A connection to the registers of one node. Use it as a context manager, or close() it."""

    def __init__(self, line: ModbusBaseSyncClient, name: str, node_id: int) -> None:
        self.id = node_id
        self._line = line
        self._name = name
        self._table = load_table()
        self._enabled = False

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connection; a node then takes no more commands over it."""
        self._line.close()  # type: ignore[no-untyped-call]
        self._enabled = False

    def connect(self, wait: float, tell: Tell) -> dict[str, Value]:
        """Connects and finds the node, both within ``wait`` [s]: its Identity.

        Raises BusError when there is no way to it, NoAnswerError when it does not answer,
        ContractError when it is no AxisTwin node or has another version of the table.
        """
        return until_answered(lambda _: self._identify(), self.close, wait, tell)

    def read(self, block: str) -> dict[str, Value]:
        """All registers of a block, of one moment. Raises BusError as the errors say."""
        wanted = self._table.blocks[block]
        answer = self._ask(
            lambda: self._line.read_holding_registers(
                wanted.address, count=wanted.size, device_id=self.id
            ),
            f"reading {block}",
        )
        return wanted.decode(answer.registers)

    def read_history(self, start: int) -> dict[str, Value]:
        """Block History from control period ``start`` on (modulo 2^32), 0: the newest samples."""
        wanted = self._table.blocks["History"]
        answer = self._ask(
            lambda: self._line.readwrite_registers(
                read_address=wanted.address,
                read_count=wanted.size,
                write_address=self._table.registers["HistoryFrom"].address,
                values=[start >> 16, start & 0xFFFF],
                device_id=self.id,
            ),
            "reading History",
        )
        return wanted.decode(answer.registers)

    def command(self, name: str, argument: float = 0) -> None:
        """Has the node carry out a command: of the CAN contract, or HISTORY_DECIMATION.

        Raises InputError when there is no such command or its argument cannot be,
        CommandRefusedError when the node will not, NoAnswerError when it does not answer.
        """
        code, bits = self._encode(name, argument)
        if not self._enabled:
            self._unlock()
        address = self._table.registers["Argument"].address
        words = [bits >> 16, bits & 0xFFFF, code]
        for _ in range(_BUSY_TRIES):
            answer = self._exchange(
                lambda: self._line.write_registers(address, words, device_id=self.id)
            )
            if not answer.isError() or answer.exception_code != _BUSY:
                break
            time.sleep(_BUSY_PAUSE)
        if answer.isError():
            raise CommandRefusedError(f"node {self.id} refuses {name}: {self._refusal(answer)}")

    def control(self, word: str, state: str) -> None:
        """Gives a CiA 402 control word by its name in the contract, set-point 0.

        Waits until the drive is in ``state``, likewise named; raises CommandRefusedError when it
        does not get there. An enabled drive wants a request at least every HostTimeout.
        """
        contract = load_contract()
        words: dict[int, Any] = dict(contract.signal("Control", "ControlWord").choices or {})
        number = next(value for value, name in words.items() if str(name) == word)
        if not self._enabled:
            self._unlock()
        address = self._table.registers["ControlWord"].address
        self._ask(
            lambda: self._line.write_registers(address, [number, 0], device_id=self.id),
            f"writing ControlWord {word}",
        )
        if not self._becomes(lambda status: contract.names["DriveState"].get(status & 0x6F), state):
            raise CommandRefusedError(f"node {self.id} does not follow {word}: {self._fault()}")

    @contextlib.contextmanager
    def excited(self) -> Iterator[None]:
        """The drive is enabled and the excitation plays inside; afterwards neither.

        Raises CommandRefusedError as command() and control().
        """
        try:
            self.control("Shutdown", "ReadyToSwitchOn")
            self.control("SwitchOn", "SwitchedOn")
            self.control("EnableOperation", "OperationEnabled")
            self.command("ExcitationOn")
            if not self._becomes(lambda status: status & _EXCITED, _EXCITED):
                raise CommandRefusedError(f"node {self.id} does not apply the excitation")
            yield
        finally:
            with contextlib.suppress(BusError):  # what ended this has been said already
                self.command("ExcitationOff")
                self.control("DisableVoltage", "SwitchOnDisabled")

    def keep_history(self, decimation: int) -> None:
        """Keeps a sample every so many control periods from now on, and waits until it does.

        Raises as command().
        """
        if self.read_history(0)["HistoryDecimation"] == decimation:
            return
        self.command(HISTORY_DECIMATION, decimation)
        period = cast(float, self.read("Identity")["ControlPeriod"])
        deadline = time.monotonic() + _ANSWER_MAX + 2.0 * decimation * period
        while self.read_history(0)["HistoryDecimation"] != decimation:
            if time.monotonic() > deadline:
                raise NoAnswerError(f"node {self.id} does not keep its history at another rate")

    def estimate(self) -> Estimate:
        """What the node has found out about its axis so far."""
        state = cast(dict[str, float], self.read("State"))

        def columns(kind: str, names: tuple[str, ...]) -> list[float]:
            return [state[f"{kind}{name}"] for name in names]

        axis, modal = ("I1", "I2", "B", "K"), ("Wn", "Wd", "Zeta")
        I1, I2, B, K = (bool(int(state["EstimateValid"]) >> i & 1) for i in range(4))
        return Estimate(
            Axis(*columns("Estimate", axis)),
            Modal(*columns("Estimate", modal)),
            Axis(*columns("Error", axis)),
            Modal(*columns("Error", modal)),
            (I1, I2, B, K),
        )

    def _becomes(self, reading: Callable[[int], object], wanted: object) -> bool:
        """Does what is read from the status word become this before long?"""
        deadline = time.monotonic() + _FILLING_MAX
        while (found := reading(int(cast(int, self.read("State")["StatusWord"])))) != wanted:
            if time.monotonic() > deadline:
                return False
        return found == wanted

    def _fault(self) -> str:
        state = self.read("State")
        return f"status word 0x{state['StatusWord']:04X}, error 0x{state['ErrorCode']:04X}"

    def _identify(self) -> dict[str, Value]:
        if not self._line.connect():
            raise BusError(f"cannot open {self._name}")
        identity = self.read("Identity")
        if identity["Signature"] != self._table.constant("Signature"):
            raise ContractError(f"{self._name} unit {self.id} is not an AxisTwin node")
        if identity["Version"] != self._table.constant("Version"):
            raise ContractError(
                f"node {self.id} has version {identity['Version']} of the register table, this "
                f"program version {self._table.constant('Version')}"
            )
        return identity

    def _unlock(self) -> None:
        address = self._table.registers["WriteKey"].address
        for key in _KEYS:
            write = functools.partial(self._line.write_register, address, key, device_id=self.id)
            self._ask(write, "writing WriteKey")
        self._enabled = bool(self.read("Client")["WriteEnabled"])

    def _encode(self, name: str, argument: float) -> tuple[int, int]:
        """Code and the bits of the argument."""
        if name == HISTORY_DECIMATION:
            if argument != int(argument) or not 1 <= argument < _ARGUMENT_END:
                raise InputError(f"command {name}: {argument:g} is out of range")
            return _HISTORY_CODE, int(argument)
        data = bytes(load_contract().command(self.id, name, argument).data)
        return data[0], int.from_bytes(data[4:8], "little")

    def _ask(self, request: Callable[[], ModbusPDU], what: str) -> ModbusPDU:
        answer = self._exchange(request)
        if answer.isError():
            reason = _EXCEPTIONS.get(answer.exception_code, f"exception {answer.exception_code}")
            raise BusError(f"{what} of node {self.id}: {reason}")
        return answer

    def _exchange(self, request: Callable[[], ModbusPDU]) -> ModbusPDU:
        try:
            return request()
        except (ModbusException, OSError) as error:
            self.close()  # an answer that is late must not be taken for the next one's
            raise NoAnswerError(f"node {self.id} does not answer on {self._name}") from error

    def _refusal(self, answer: ModbusPDU) -> str:
        result = self.read("Client")["Result"]
        named = load_contract().names["Result"].get(cast(int, result), "")
        return REFUSALS.get(named) or _EXCEPTIONS.get(answer.exception_code, f"result {result}")


def node_estimate(client: Client) -> dict[str, Any]:
    """The estimate as a record's ``meta`` has it."""
    return {"node_estimate": asdict(client.estimate())}
