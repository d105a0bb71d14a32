"""The register table: what the Modbus registers of an AxisTwin node mean."""

from __future__ import annotations

import csv
import functools
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

#: A register, or the numbers of an array.
Value = int | float | tuple[int | float, ...]

# The more significant register first, each of them big-endian.
_FORMATS = {"uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "float32": "f"}


@dataclass(frozen=True)
class Register:
    """One row of the table: ``length`` numbers of one type (``kind``) from ``address`` on.

    Registers of a ``block`` follow each other and are read with one request.
    """

    block: str
    address: int
    name: str
    kind: str
    length: int
    unit: str
    constant: str
    meaning: str

    @property
    def size(self) -> int:
        """16-bit registers that it takes."""
        return struct.calcsize(f">{self.length}{_FORMATS[self.kind]}") // 2

    def decode(self, words: Sequence[int]) -> Value:
        """Its value from ``size`` registers."""
        packed = struct.pack(f">{len(words)}H", *words)
        numbers = struct.unpack(f">{self.length}{_FORMATS[self.kind]}", packed)
        return numbers[0] if self.length == 1 else numbers


@dataclass(frozen=True)
class Block:
    """Registers that are read together, and so are of one moment."""

    registers: tuple[Register, ...]

    @property
    def address(self) -> int:
        """Of the first one."""
        return self.registers[0].address

    @property
    def size(self) -> int:
        """16-bit registers in all."""
        return sum(register.size for register in self.registers)

    def decode(self, words: Sequence[int]) -> dict[str, Value]:
        """All values by name, from ``size`` registers."""
        values = {}
        for register in self.registers:
            begin = register.address - self.address
            values[register.name] = register.decode(words[begin : begin + register.size])
        return values


class Table:
    """All registers. ``blocks`` by name, ``registers`` by name."""

    def __init__(self, rows: Iterable[Mapping[str, str]]) -> None:
        self.registers: dict[str, Register] = {}
        grouped: dict[str, list[Register]] = {}
        for row in rows:
            register = Register(
                row["block"],
                int(row["address"]),
                row["name"],
                row["type"],
                int(row["length"]),
                row["unit"],
                row["constant"],
                row["meaning"],
            )
            self.registers[register.name] = register
            grouped.setdefault(register.block, []).append(register)
        self.blocks = {name: Block(tuple(members)) for name, members in grouped.items()}

    def constant(self, name: str) -> int:
        """What this register holds in every node."""
        return int(self.registers[name].constant, 0)


@functools.cache
def load_table() -> Table:
    """The table that this program was built with."""
    text = (files("axistwin") / "registers.csv").read_text(encoding="utf-8")
    return Table(csv.DictReader(text.splitlines()))
