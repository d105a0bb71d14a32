"""Makes the C tables and the reference page from the register table, registers.csv.

    generate_registers.py --code build/contract         axt_register_table.h and .c
    generate_registers.py --page docs/registers.md      the reference page
    generate_registers.py --check docs/registers.md     fails when that page is another

The table is the only place where a Modbus register is described; everything else is made of it.
"""

from __future__ import annotations

import argparse
import csv
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cantools
from cantools.database.can import Database
from generate import CONTRACT, c_name, table

TABLE = Path(__file__).with_name("registers.csv")
OUTPUT = "axt_register_table"

#: How a value of each type is packed, the most significant register first.
FORMATS = {"uint16": ">H", "int16": ">h", "uint32": ">I", "int32": ">i", "float32": ">f"}

#: What one request may read (Modbus application protocol 1.1b3, 6.3).
READ_MAX = 125

INTRODUCTION = """\
# The registers

This page is made of `drivers/contract/registers.csv` by `make docs/registers.md`; change the table,
not the page.

Table version {version}. Register {version_address} says which version a node speaks; a host that
finds another one must not go on.

* Addresses are those of the protocol, from 0 (a tool that counts from 1 adds one).
* Functions 3 and 4 read the same registers. 6, 16 and 23 write, where access says `rw`. There are
  no coils. A request that touches a register which is not listed gets exception 2.
* Values of 32 bits take two registers, **the more significant one first**, each big-endian as
  Modbus has it. Signature (bytes `41 58 54 57`) and TestFloat show whether a host reads them so.
* **Values of one answer are of one moment.** Every block fits into one request; whoever reads State
  in pieces compares Sequence and SequenceEnd.
* The unit id is the node id. Over TCP 0 and 255 are taken, too; any other gets exception 11. On a
  serial line a broadcast (unit 0) is carried out and not answered.

Registers of block Client are each client's own; those above are the same for all.

## Commands

The commands are those of the [CAN contract](wire.md#command), with the same codes and arguments,
and `256`: keep a sample for the history every so many control periods (argument, 1 or more).

A node takes no command before the host has asked for it: write 0x4158 to WriteKey and, with the
next request, 0x5457. That holds for this client, a connection or all of a serial line, until it is
gone, anything else is written to WriteKey, or 10 s have passed without a write. Then write Argument
and Code, in this order or with one request, or ControlWord and TargetTorque. The answer comes when
the command is done. Of commands that were refused, Result says why:

{results}.

A drive that is enabled wants to hear its host: every request of a client that may give commands
counts as its heartbeat. When none has come for HostTimeout the torque is stopped, as on CAN.

| exception | meaning |
|---|---|
| 2 | these registers cannot be written, or not before WriteKey |
| 3 | a count, a command or its argument is impossible; Result says which |
| 4 | the command is refused; Result says why |
| 6 | the node is busy: try again |

## The history

A node keeps its newest samples, one every HistoryDecimation control periods, and block History
shows {history} of them: the newest, or those from HistoryFrom on. Whoever writes the control period
after the last sample to HistoryFrom and reads the block with the same request (function 23) gets
one sample after the other and misses none as long as the node keeps them; HistoryCounter says where
that was not so.
"""


@dataclass(frozen=True)
class Register:
    """One row of the table: ``length`` values of a type from an address on."""

    block: str
    address: int
    name: str
    kind: str
    length: int
    access: str
    unit: str
    constant: str
    meaning: str

    @property
    def size(self) -> int:
        """Registers that it takes."""
        return struct.calcsize(FORMATS[self.kind]) // 2 * self.length

    def words(self) -> tuple[int, ...]:
        """The registers of its constant."""
        value = float(self.constant) if self.kind == "float32" else int(self.constant, 0)
        packed = struct.pack(FORMATS[self.kind], value)
        return struct.unpack(f">{len(packed) // 2}H", packed)


def load() -> list[Register]:
    """The table, checked; SystemExit when a row cannot be."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        registers = [
            Register(
                row["block"],
                int(row["address"]),
                row["name"],
                row["type"],
                int(row["length"]),
                row["access"],
                row["unit"],
                row["constant"],
                row["meaning"],
            )
            for row in csv.DictReader(file)
        ]
    if len({register.name for register in registers}) < len(registers):
        raise SystemExit(f"{TABLE.name}: a name stands twice")
    end = 0
    for before, register in zip([None, *registers], registers, strict=False):
        follows = before is None or before.block == register.block
        if register.address < end or (follows and register.address != end):
            raise SystemExit(f"{TABLE.name}: {register.name} does not follow at address {end}")
        end = register.address + register.size
    for name, rows in blocks(registers).items():
        if span(rows)[1] > READ_MAX:
            raise SystemExit(f"{TABLE.name}: {name} does not fit into one read")
    return registers


def blocks(registers: list[Register]) -> dict[str, list[Register]]:
    """Rows by block."""
    found: dict[str, list[Register]] = {}
    for register in registers:
        found.setdefault(register.block, []).append(register)
    return found


def span(rows: list[Register]) -> tuple[int, int]:
    """First address and number of registers of rows that follow one another."""
    return rows[0].address, rows[-1].address + rows[-1].size - rows[0].address


def writable(registers: list[Register]) -> tuple[int, int]:
    """The one span that can be written."""
    rows = [register for register in registers if register.access == "rw"]
    if sum(row.size for row in rows) != span(rows)[1]:
        raise SystemExit(f"{TABLE.name}: what can be written does not stand together")
    return span(rows)


def macro(register: Register) -> str:
    """The C name of its address."""
    return f"AXT_REGISTER_{c_name(register.name)}"


def header(registers: list[Register]) -> Iterator[str]:
    """axt_register_table.h."""
    yield "/* Made from drivers/contract/registers.csv. */"
    yield "#ifndef AXT_REGISTER_TABLE_H\n#define AXT_REGISTER_TABLE_H\n\n#include <stdint.h>\n"
    yield "/* Addresses. */\nenum {"
    yield from (f"    {macro(r)} = {r.address}, /* {r.kind} */" for r in registers)
    yield "};\n\n/* Values of an array. */\nenum {"
    yield from (f"    {macro(r)}_LENGTH = {r.length}," for r in registers if r.length > 1)
    first, count = writable(registers)
    yield "};\n\nenum {"
    yield f"    AXT_REGISTER_END = {sum(span(registers))}, /* no address from here on */"
    yield f"    AXT_REGISTER_BLOCKS = {len(blocks(registers))},"
    yield f"    AXT_REGISTER_WRITABLE_FIRST = {first},"
    yield f"    AXT_REGISTER_WRITABLE_COUNT = {count}"
    yield "};\n"
    yield "typedef struct {\n    uint16_t first;\n    uint16_t count;\n} axt_register_block;\n"
    yield "/* What can be read. */"
    yield "extern const axt_register_block axt_register_blocks[AXT_REGISTER_BLOCKS];\n"
    yield "/* Registers with their constants, 0 elsewhere. */"
    yield "extern const uint16_t axt_register_constants[AXT_REGISTER_END];\n\n#endif"


def source(registers: list[Register]) -> Iterator[str]:
    """axt_register_table.c."""
    yield '#include "axt_register_table.h"\n'
    yield "const axt_register_block axt_register_blocks[AXT_REGISTER_BLOCKS] = {"
    for rows in blocks(registers).values():
        yield "    {{{}, {}}},".format(*span(rows))
    yield "};\n\nconst uint16_t axt_register_constants[AXT_REGISTER_END] = {"
    for register in registers:
        if register.constant:
            for i, word in enumerate(register.words()):
                yield f"    [{macro(register)} + {i}] = 0x{word:04X},"
    yield "};"


def rows_of(rows: list[Register]) -> Iterator[str]:
    """The table of one block."""
    cells = []
    for row in rows:
        last = row.address + row.size - 1
        place = f"{row.address}" if row.size == 1 else f"{row.address}-{last}"
        kind = row.kind if row.length == 1 else f"{row.kind} x {row.length}"
        meaning = f"{row.meaning} (always {row.constant})" if row.constant else row.meaning
        unit = row.unit.replace("permille", "‰ of rated")
        cells.append([place, row.name, kind, row.access, unit, meaning])
    yield from table(["address", "register", "type", "access", "unit", "meaning"], cells)


def crc16(message: bytes) -> int:
    """CRC-16 of Modbus over serial line (specification 1.02, 6.2.2)."""
    crc = 0xFFFF
    for byte in message:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def example(registers: list[Register]) -> Iterator[str]:
    """One request and its answer, byte by byte."""
    wanted = next(register for register in registers if register.name == "MotorPosition")
    request = struct.pack(">BBHH", 1, 3, wanted.address, wanted.size)
    value = -123456
    answer = struct.pack(">BBBi", 1, 3, 2 * wanted.size, value)

    def cells(parts: list[tuple[bytes, str]]) -> Iterator[str]:
        rows = [[f"`{part.hex(' ').upper()}`", meaning] for part, meaning in parts]
        yield from table(["bytes", "meaning"], rows)

    def checked(message: bytes) -> tuple[bytes, str]:
        return struct.pack("<H", crc16(message)), "CRC-16, the low byte first"

    yield f"## Reading {wanted.name}, byte by byte\n"
    yield "The request on a serial line:\n"
    unit, function = (b"\x01", "unit id"), (b"\x03", "function 3: read registers")
    address = (request[2:4], f"address {wanted.address}")
    yield from cells([unit, function, address, (request[4:], "2 registers"), checked(request)])
    yield "\nThe answer:\n"
    position = (answer[3:], f"{wanted.name} {value} {wanted.unit}")
    yield from cells([unit, function, (answer[2:3], "4 bytes follow"), position, checked(answer)])
    header_of = struct.pack(">HHH", 0x1234, 0, len(request))
    yield (
        f"\nOver TCP the same request is `{(header_of + request).hex(' ').upper()}`: transaction "
        "0x1234, protocol 0, 6 bytes follow, and no CRC."
    )


def results() -> str:
    """How a command may end, as the CAN contract names it."""
    database = cantools.database.load_file(CONTRACT)
    assert isinstance(database, Database)
    assert database.dbc is not None
    choices = database.dbc.value_tables["Result"]
    return ", ".join(f"{value} {name}" for value, name in choices.items())


def page(registers: list[Register]) -> str:
    """The whole reference page."""
    by_name = {register.name: register for register in registers}
    version = by_name["Version"]
    lines = [
        INTRODUCTION.format(
            version=version.constant,
            version_address=version.address,
            history=by_name["HistoryTorque"].length,
            results=results(),
        )
    ]
    for name, rows in blocks(registers).items():
        lines.append(f"## {name}\n")
        lines.extend(rows_of(rows))
        lines.append("")
    lines.extend(example(registers))
    return "\n".join(lines) + "\n"


def main() -> int:
    """Command line; 0 when done, 1 when --check finds a stale page."""
    parser = argparse.ArgumentParser(description="make code and reference page of the registers")
    parser.add_argument("--code", type=Path, metavar="FOLDER", help="write the C tables here")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the reference page here")
    parser.add_argument("--check", type=Path, metavar="FILE", help="fail when this page is stale")
    arguments = parser.parse_args()
    registers = load()
    if arguments.code is not None:
        arguments.code.mkdir(parents=True, exist_ok=True)
        for ending, lines in ((".h", header(registers)), (".c", source(registers))):
            path = arguments.code / f"{OUTPUT}{ending}"
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if arguments.page is not None:
        arguments.page.write_text(page(registers), encoding="utf-8")
    if arguments.check is not None:
        found = arguments.check
        if not found.exists() or found.read_text(encoding="utf-8") != page(registers):
            print(f"{found} is not what {TABLE.name} says; run: make {found}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
