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
from collections.abc import Iterable, Iterator, Sequence
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

* 11-bit identifiers: the base below plus the node id, {lowest} to {highest}; a host counts as node
  {host}. The bases are CANopen's, so a node can share a bus with CANopen devices.
* Classical CAN, but for the frame that is marked FD: it is sent only where the bus offers CAN FD
  and a host asks for it, with the faster bit rate in its data phase.
* Little-endian. Bit 0 is the least significant bit of byte 0.
* Positions are counts, torque is per mille of the rated torque (report page 3): CiA 402's units.
* On SLCAN carriers the same frames travel as LAWICEL lines: `t` + identifier + length + data, in
  hexadecimal, ended by a carriage return.
"""

DRIVE = """\

A control word that is not in the table for the present state leaves it as it is and is refused; one
that asks for the state the drive is in, and `DisableVoltage` in any state, is fine.

* Torque acts in operation enabled and nowhere else. Whatever ends that state sets the set-point to
  0 and ends the excitation: a quick stop, too, is a torque of 0 at the next sample, not a ramp.
* Operation is enabled only while the heartbeat of a host is heard. When it fails, torque is 0 and
  the drive in fault as soon as the time in report page `HostHeartbeat` has passed.
* The torque limit cuts torque off (bit 11 of the status word). Above the speed limit, and on
  leaving the travel range, the drive goes into fault; it can be enabled outside the range, but only
  torque back inside is then applied.
"""

#: CiA 402's transitions: number, state, what leads on, next state.
TRANSITIONS = (
    ("0, 1", "not ready to switch on", "by itself, at the first sample", "switch on disabled"),
    ("2", "switch on disabled", "`Shutdown`", "ready to switch on"),
    ("3", "ready to switch on", "`SwitchOn`", "switched on"),
    ("3, 4", "ready to switch on", "`EnableOperation`", "operation enabled"),
    ("4", "switched on", "`EnableOperation`", "operation enabled"),
    ("5", "operation enabled", "`SwitchOn`", "switched on"),
    ("6", "switched on", "`Shutdown`", "ready to switch on"),
    ("7", "ready to switch on", "`DisableVoltage`, `QuickStop`", "switch on disabled"),
    ("8", "operation enabled", "`Shutdown`", "ready to switch on"),
    ("9", "operation enabled", "`DisableVoltage`", "switch on disabled"),
    ("10", "switched on", "`DisableVoltage`, `QuickStop`", "switch on disabled"),
    ("11", "operation enabled", "`QuickStop`", "quick stop active"),
    ("12", "quick stop active", "`DisableVoltage`", "switch on disabled"),
    ("13", "operation enabled", "a limit, or no heartbeat of the host", "fault reaction active"),
    ("14", "fault reaction active", "by itself, at the next sample", "fault"),
    ("15", "fault", "`FaultReset`: bit 7 from 0 to 1", "switch on disabled"),
    ("16", "quick stop active", "`EnableOperation`", "operation enabled"),
)


def c_name(name: str) -> str:
    """The way cantools spells a CamelCase name in a C macro."""
    spelled = ""
    for i, letter in enumerate(name):
        if i > 0 and letter.isupper() and not name[i - 1].isupper():
            spelled += "_"
        spelled += letter.upper()
    return spelled


def attribute(database: Database, name: str) -> int:
    """A number that belongs to the contract as a whole, such as its version."""
    if database.dbc is None:
        raise SystemExit(f"generate.py: {CONTRACT} has no attributes")
    return int(database.dbc.attributes[name].value)


def value_tables(database: Database) -> dict[str, dict[int, str]]:
    """Names of values that are no single signal's, by the name of their table."""
    tables = database.dbc.value_tables if database.dbc is not None else {}
    return {
        name: {int(value): str(text) for value, text in sorted(values.items())}
        for name, values in tables.items()
    }


def constants(database: Database) -> Iterator[str]:
    """What cantools leaves out: version, host id, value tables, the scale of scaled signals."""
    yield f"#define {PREFIX.upper()}_VERSION ({attribute(database, 'ContractVersion')}u)"
    yield f"#define {PREFIX.upper()}_HOST_ID ({attribute(database, 'HostId')}u)"
    for name, values in value_tables(database).items():
        for value, text in values.items():
            macro = f"{PREFIX}_".upper() + f"{c_name(name)}_{c_name(text)}"
            yield f"#define {macro} ({value}u)"
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


def meaning(signal: Signal) -> str:
    """What a signal is, with the names of its values; a selector's have a table of their own."""
    if not signal.choices or signal.is_multiplexer:
        return signal.comment or ""
    form = "0x{:04X} {}" if signal.length == 16 else "{} {}"
    named = ", ".join(form.format(*choice) for choice in signal.choices.items())
    return f"{signal.comment or ''}: {named}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """A Markdown table."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(row) + " |"


def identifiers(database: Database) -> Iterator[str]:
    """All frames at a glance."""
    rows = []
    for message in sorted(database.messages, key=lambda m: m.frame_id):
        sender = " and ".join(name.lower() for name in message.senders)
        cycle = f", every {message.cycle_time} ms" if message.cycle_time else ""
        rows.append(
            [
                f"[{message.name}](#{message.name.lower()})",
                f"0x{message.frame_id:03X} + node id",
                f"{message.length}{' (FD)' if message.is_fd else ''}",
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
    rows = [[s.name, bits(s), value_type(s), f"{s.scale:g}", unit(s), meaning(s)] for s in plain]
    yield from table(["signal", "place", "type", "LSB", "unit", "meaning"], rows)
    yield ""
    chosen = selector(message)
    if chosen is None:
        return
    rows = []
    for signal in message.signals:
        for value in signal.multiplexer_ids or []:
            shown = [str(value), signal.name, bits(signal), value_type(signal)]
            rows.append([*shown, f"{signal.scale:g}", unit(signal), meaning(signal)])
    rows.sort(key=lambda row: int(row[0]))
    head = [chosen.name, "signal", "place", "type", "LSB", "unit", "meaning"]
    yield from table(head, rows)
    yield ""


def names(database: Database) -> Iterator[str]:
    """The value tables: what numbers mean that appear in more than one place."""
    yield "## Names of values\n"
    where = {
        "Result": "how a command or a control word ended",
        "DriveState": "`StatusWord & 0x6F`",
        "DriftState": "Flags of report page Drift",
        "TraceState": "Flags of report page TraceCaptured",
    }
    for name, values in value_tables(database).items():
        listed = ", ".join(f"{value} {text}" for value, text in values.items())
        yield f"{name} ({where[name]}): {listed}.\n"


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
    host = attribute(database, "HostId")
    version = attribute(database, "ContractVersion")
    lines = [INTRODUCTION.format(version=version, lowest=1, highest=host - 1, host=host)]
    lines.extend(identifiers(database))
    lines.append("## The drive's state\n")
    lines.extend(table(["transition", "state", "what leads on", "next state"], TRANSITIONS))
    lines.append(DRIVE)
    for message in database.messages:
        lines.extend(frame(message))
    lines.extend(names(database))
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
