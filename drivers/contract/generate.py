"""Makes the C codec and the reference page from the wire contract, axistwin.dbc.

    generate.py --code build/contract    axt_contract.h and axt_contract.c
    generate.py --page docs/wire.md      the reference page
    generate.py --check docs/wire.md     fails when that page is not what the contract says

The contract is the only place where a frame is described; everything else is made of it here.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cantools
from cantools.database.can import Database, Message, Signal

CONTRACT = Path(__file__).with_name("axistwin.dbc")
PREFIX = "axt_contract"

INTRODUCTION = """\
# The wire

This page is made of `drivers/contract/axistwin.dbc` by `make docs/wire.md`; change the contract,
not the page. Any CAN tool that reads DBC files can decode the bus with that file: load it and set
the node id, or use node id 0's identifiers plus the node id as below.

Contract version {version}. Report page 0 says which version a node speaks; a host that finds
another one must not go on.

* Classical CAN, 11-bit identifiers: the base below plus the node id, {lowest} to {highest}. The
  bases are CANopen's, so a node can share a bus with CANopen devices.
* Little-endian. Bit 0 is the least significant bit of byte 0.
* Positions are counts, torque is per mille of the rated torque (report page 3): CiA 402's units.
* On SLCAN carriers the same frames travel as LAWICEL lines: `t` + identifier + length + data, in
  hexadecimal, ended by a carriage return.
"""


def c_name(name: str) -> str:
    """The way cantools spells a CamelCase name in a C macro."""
    spelled = ""
    for i, letter in enumerate(name):
        if i > 0 and letter.isupper() and not name[i - 1].isupper():
            spelled += "_"
        spelled += letter.upper()
    return spelled


def contract_version(database: Database) -> int:
    """The contract's version number, an attribute of the DBC file."""
    if database.dbc is None:
        raise SystemExit(f"generate.py: {CONTRACT} has no attributes")
    return int(database.dbc.attributes["ContractVersion"].value)


def constants(database: Database) -> Iterator[str]:
    """What cantools leaves out: the contract's version, and the scale of each scaled signal."""
    yield f"#define {PREFIX.upper()}_VERSION ({contract_version(database)}u)"
    for message in database.messages:
        for signal in message.signals:
            if signal.scale != 1:
                macro = f"{PREFIX}_{message.name}_".upper() + c_name(signal.name)
                yield f"/* {signal.unit} a count */"
                yield f"#define {macro}_SCALE ({float(signal.scale)}f)"


def write_code(database: Database, folder: Path) -> None:
    """Writes axt_contract.h and axt_contract.c into `folder`.

    Signals are raw numbers in C, never scaled ones: a float cannot hold a 32-bit count, and a
    conversion that is out of range is undefined. The node scales, and saturates, for itself.
    """
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "cantools", "generate_c_source"]
    options = ["--no-floating-point-numbers", "--database-name", PREFIX]
    subprocess.run(
        [*command, *options, "--output-directory", str(folder), str(CONTRACT)],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    header = folder / f"{PREFIX}.h"
    text = header.read_text(encoding="utf-8")
    guard = f"#define {PREFIX.upper()}_H\n"
    added = "\n".join(constants(database))
    header.write_text(text.replace(guard, f"{guard}\n{added}\n", 1), encoding="utf-8")


def value_type(signal: Signal) -> str:
    """int16, uint32, float32 and the like."""
    if signal.is_float:
        return f"float{signal.length}"
    return f"{'' if signal.is_signed else 'u'}int{signal.length}"


def unit(signal: Signal) -> str:
    """The unit for a table; an empty cell for a pure number."""
    return {"permille": "‰ of rated torque"}.get(signal.unit or "", signal.unit or "")


def bits(signal: Signal) -> str:
    """Which bits of the frame, and which bytes when they are whole."""
    first, last = signal.start, signal.start + signal.length - 1
    if first % 8 == 0 and last % 8 == 7:
        byte, end = first // 8, last // 8
        return f"byte {byte}" if byte == end else f"bytes {byte}-{end}"
    return f"bit {first}" if first == last else f"bits {first}-{last}"


def table(head: list[str], rows: list[list[str]]) -> Iterator[str]:
    """A Markdown table."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(row) + " |"


def identifiers(database: Database) -> Iterator[str]:
    """All frames at a glance."""
    rows = []
    for message in sorted(database.messages, key=lambda m: m.frame_id):
        sender = "node" if message.senders == ["Node"] else "host"
        cycle = f", every {message.cycle_time} ms" if message.cycle_time else ""
        rows.append(
            [
                f"[{message.name}](#{message.name.lower()})",
                f"0x{message.frame_id:03X} + node id",
                str(message.length),
                sender + cycle,
                message.comment or "",
            ]
        )
    yield "## Frames\n"
    yield from table(["frame", "identifier", "bytes", "sent by", "what"], rows)
    yield ""


def selector(message: Message) -> Signal | None:
    """The multiplexer signal that says what the rest of the frame means."""
    return next((s for s in message.signals if s.is_multiplexer), None)


def frame(message: Message) -> Iterator[str]:
    """One frame: its signals and, where it is multiplexed, what each selector value carries."""
    yield f"## {message.name}\n"
    yield f"{message.comment}\n"
    plain = [s for s in message.signals if not s.multiplexer_ids]
    rows = [
        [s.name, bits(s), value_type(s), f"{s.scale:g}", unit(s), s.comment or ""] for s in plain
    ]
    yield from table(["signal", "place", "type", "LSB", "unit", "meaning"], rows)
    yield ""
    for signal in plain:
        if signal.choices and not signal.is_multiplexer:
            names = ", ".join(f"{value} {name}" for value, name in signal.choices.items())
            yield f"{signal.name}: {names}.\n"
    chosen = selector(message)
    if chosen is None:
        return
    rows = []
    for signal in message.signals:
        for value in signal.multiplexer_ids or []:
            shown = [str(value), signal.name, bits(signal), value_type(signal)]
            rows.append([*shown, f"{signal.scale:g}", unit(signal), signal.comment or ""])
    rows.sort(key=lambda row: int(row[0]))
    head = [chosen.name, "signal", "place", "type", "LSB", "unit", "meaning"]
    yield from table(head, rows)
    yield ""


def example(database: Database) -> Iterator[str]:
    """One Motor frame, encoded here and annotated byte by byte."""
    node = 1
    message = database.get_message_by_name("Motor")
    values = {"Counter": 4660, "Position": -123456, "Torque": 312.5}
    data = message.encode(values)
    payload = data.hex(" ").upper()
    yield f"## A {message.name} frame, byte by byte\n"
    yield (
        f"Node {node} sends identifier 0x{message.frame_id + node:03X} with `{payload}`; as an "
        f"SLCAN line `t{message.frame_id + node:03X}{len(data)}{data.hex().upper()}`.\n"
    )
    rows = []
    for signal in message.signals:
        start, size = signal.start // 8, signal.length // 8
        part = data[start : start + size]
        raw = int.from_bytes(part, "little", signed=signal.is_signed)
        reading = f"{raw}"
        if signal.scale != 1:
            reading = f"{raw} x {signal.scale:g} = {values[signal.name]:g}"
        number = int.from_bytes(part, "little")
        rows.append(
            [
                bits(signal),
                f"`{part.hex(' ').upper()}`",
                f"0x{number:0{2 * size}X}",
                f"{signal.name} {reading} {signal.unit or ''}".strip(),
            ]
        )
    yield from table(["place", "bytes", "little-endian number", "meaning"], rows)


def page(database: Database) -> str:
    """The whole reference page."""
    lines = [INTRODUCTION.format(version=contract_version(database), lowest=1, highest=126)]
    lines.extend(identifiers(database))
    for message in database.messages:
        lines.extend(frame(message))
    lines.extend(example(database))
    return "\n".join(lines) + "\n"


def main() -> int:
    """Command line; 0 when done, 1 when --check finds a stale page."""
    parser = argparse.ArgumentParser(description="make code and reference page of the contract")
    parser.add_argument("--code", type=Path, metavar="FOLDER", help="write the C codec here")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the reference page here")
    parser.add_argument("--check", type=Path, metavar="FILE", help="fail when this page is stale")
    arguments = parser.parse_args()
    database = cantools.database.load_file(CONTRACT)
    if not isinstance(database, Database):
        raise SystemExit(f"generate.py: {CONTRACT} is not a CAN database")

    if arguments.code is not None:
        write_code(database, arguments.code)
    if arguments.page is not None:
        arguments.page.parent.mkdir(parents=True, exist_ok=True)
        arguments.page.write_text(page(database), encoding="utf-8")
    if arguments.check is not None:
        found = arguments.check
        if not found.exists() or found.read_text(encoding="utf-8") != page(database):
            print(f"{found} is not what {CONTRACT.name} says; run: make {found}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
