"""The wire contract: what the frames of an AxisTwin node mean, read from its DBC file."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, cast

import can
import cantools
import numpy as np
import numpy.typing as npt
from cantools.database.can import Database, Message, Signal

from axistwin.errors import InputError

#: Node ids that the contract's identifiers leave room for.
NODES = range(1, 127)

#: Full length of a classical and of an FD frame's payload, to which shorter ones are filled up with
#: zeros.
PAYLOAD, PAYLOAD_FD = 8, 64

Payloads = npt.NDArray[np.uint8]

_VERSION = "ContractVersion"
_HOST = "HostId"

# What this program relies on, with the signal that selects what the rest of the frame means.
_MESSAGES = {
    "Motor": None,
    "Table": None,
    "Samples": None,
    "Report": "Page",
    "Trace": "Channel",
    "Emergency": None,
    "Heartbeat": None,
    "Command": "Code",
    "Control": None,
}


@dataclass(frozen=True)
class Contract:
    """A wire contract. ``version`` has to be the node's own; ``source`` names the DBC file.

    ``host`` is the node id that a host goes by. ``names`` are the value tables: names of numbers
    that appear in more than one place.
    """

    version: int
    host: int
    source: str
    messages: dict[str, Message]
    names: dict[str, dict[int, str]]

    def identifier(self, message: str, node: int) -> int:
        """Identifier of a message from or to a node."""
        return self.messages[message].frame_id + node

    def length(self, message: str) -> int:
        """Number of payload bytes of a message."""
        return self.messages[message].length

    def samples(self, message: str) -> int:
        """How many samples a message of the stream carries."""
        names = [signal.name for signal in self.messages[message].signals]
        return max(1, sum(name.startswith("MotorPosition") for name in names))

    def signal(self, message: str, name: str) -> Signal:
        """A signal by name; InputError when this contract has none of that name."""
        try:
            return self.messages[message].get_signal_by_name(name)
        except KeyError:
            raise InputError(f"{self.source}: {message} has no signal {name}") from None

    def choice(self, message: str, name: str) -> int:
        """The selector of a multiplexed signal: the page of a report, the code of a command."""
        multiplexers = self.signal(message, name).multiplexer_ids
        if not multiplexers:
            raise InputError(f"{self.source}: {message} {name} is not multiplexed")
        return multiplexers[0]

    def state(self, name: str) -> int:
        """A heartbeat state by name."""
        return self.value_of("Heartbeat", "State", name)

    def value_of(self, message: str, signal: str, name: str) -> int:
        """The value of a signal that has this name."""
        for value, text in (self.signal(message, signal).choices or {}).items():
            if str(text) == name:
                return int(value)
        raise InputError(f"{self.source}: {message} {signal} has no value {name}")

    def name_of(self, message: str, signal: str, value: int) -> str:
        """The name of a value of a signal; the number itself where it has none."""
        choices = self.signal(message, signal).choices
        return str(choices[value]) if choices is not None and value in choices else str(value)

    def raw(self, message: str, name: str, payloads: Payloads) -> npt.NDArray[Any]:
        """A signal of payloads (n, length) as it is on the wire: (n,) int64 or float32.

        Signals of up to 57 bits, wherever they lie in frames of any length.
        """
        signal = self.signal(message, name)
        if signal.byte_order != "little_endian":
            raise InputError(f"{self.source}: {message} {name} is not little-endian")
        first, end = signal.start // 8, (signal.start + signal.length + 7) // 8
        window = np.zeros((len(payloads), 8), np.uint8)
        window[:, : end - first] = payloads[:, first:end]
        words: npt.NDArray[np.uint64] = window.view("<u8")[:, 0]
        bits = (words >> np.uint64(signal.start % 8)) & np.uint64(2**signal.length - 1)
        if signal.is_float:
            real: npt.NDArray[np.float32] = bits.astype(np.uint32).view(np.float32)
            return real
        number: npt.NDArray[np.int64] = bits.astype(np.int64)
        if signal.is_signed:
            number -= (number >> (signal.length - 1)) << signal.length
        return number

    def scale(self, message: str, name: str) -> float:
        """What 1 of a raw number means, in the unit that the contract gives."""
        return float(self.signal(message, name).scale)

    def value(self, message: str, name: str, payload: bytes) -> float:
        """A signal of one payload, scaled."""
        row = np.frombuffer(payload.ljust(self.length(message), b"\0"), np.uint8)[None, :]
        return float(self.raw(message, name, row)[0]) * self.scale(message, name)

    def reader(self, message: str, name: str) -> Callable[[bytes], int]:
        """A quick way to read the bits of a signal from one payload after the other, unsigned."""
        signal = self.signal(message, name)
        shift, mask = signal.start, 2**signal.length - 1
        return lambda payload: (int.from_bytes(payload, "little") >> shift) & mask

    def command(self, node: int, name: str, argument: float = 0) -> can.Message:
        """A command frame. Raises InputError when the argument does not fit into it."""
        signal = self.signal("Command", name)
        number = float(argument) if signal.is_float else int(argument)
        message = self.messages["Command"]
        try:
            data = message.encode({"Code": self.choice("Command", name), name: number})
        except Exception as error:  # cantools and bitstruct have an exception each
            raise InputError(f"command {name}: {argument} is out of range") from error
        return self._frame("Command", node, data)

    def control(self, node: int, word: str, torque: float = 0.0) -> can.Message:
        """A Control frame: a control word by name, and a set-point [per mille of rated torque].

        Raises InputError when the set-point does not fit into it.
        """
        try:
            data = self.messages["Control"].encode({"ControlWord": word, "TargetTorque": torque})
        except Exception as error:  # as above
            raise InputError(f"a torque of {torque:g} per mille is out of range") from error
        return self._frame("Control", node, data)

    def host_heartbeat(self) -> can.Message:
        """The heartbeat of a host."""
        data = self.messages["Heartbeat"].encode({"State": "Operational"})
        return self._frame("Heartbeat", self.host, data)

    def _frame(self, message: str, node: int, data: bytes) -> can.Message:
        identifier = self.identifier(message, node)
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def load_contract(path: str | Path | None = None) -> Contract:
    """The contract of a DBC file; the one that this program was built with when no path is given.

    Raises InputError when the file is not a contract of an AxisTwin node.
    """
    return _load(None if path is None else str(path))


@functools.cache
def _load(path: str | None) -> Contract:
    if path is None:
        with as_file(files("axistwin") / "axistwin.dbc") as built_in:
            return _parse(built_in, built_in.name)
    return _parse(Path(path), path)


def _parse(path: Path, source: str) -> Contract:
    try:
        database = cantools.database.load_file(path, database_format="dbc")
    except OSError as error:
        raise InputError(f"cannot read {source}: {error.strerror}") from error
    except Exception as error:  # cantools passes on whatever its parsers raise
        raise InputError(f"{source} is not a DBC file") from error
    database = cast(Database, database)
    messages = {message.name: message for message in database.messages}
    for name, selector in _MESSAGES.items():
        signals = [signal.name for signal in messages[name].signals] if name in messages else []
        if name not in messages or (selector is not None and selector not in signals):
            raise InputError(f"{source} is no AxisTwin contract: it has no proper message {name}")
    attributes = database.dbc.attributes if database.dbc is not None else {}
    for name in (_VERSION, _HOST):
        if name not in attributes:
            raise InputError(f"{source} is no AxisTwin contract: it has no attribute {name}")
    tables = database.dbc.value_tables if database.dbc is not None else {}
    return Contract(
        int(attributes[_VERSION].value),
        int(attributes[_HOST].value),
        source,
        {name: messages[name] for name in _MESSAGES},
        {name: {int(i): str(text) for i, text in table.items()} for name, table in tables.items()},
    )
