"""Size and speed of the firmware by image.

    measure.py OUTPUT.json             measure, print a table
    measure.py OUTPUT.json --page README.md    ... and put it into that page
    measure.py OUTPUT.json --check README.md   ... and fail when the page says something else

Instructions are those of the longest control interrupt of a run in which everything happens that
can: excitation, estimator and its copies, drift alarm, stream, trace, history. The board's timer
counts them, for QEMU lets every instruction take the same time. Stack is what was found used of the
painted stack at the end of that run.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from board import IMAGES, MACHINES

from firmware.rig import ENABLE, HEARTBEAT, OPEN, Rig, command

CONTROL_RATE = 10_000  # [Hz]
CYCLES = 168_000_000  # a second, of a usual Cortex-M4F; an instruction each is an estimate
#: How many bits the time of an instruction [ns] is shifted by: free running, with time for all.
SHIFTS = dict.fromkeys(MACHINES, 4) | {"cortex-m3": 1}
BEGIN, END = "<!-- made by `make README.md` -->\n", "<!-- end -->\n"
#: So much may a page be off [share]: a line of code more or less is no news, and when interrupts
#: come is another time in each run.
SPREAD = {"text": 0.03, "data": 0.03, "bss": 0.03, "stack": 0.1, "instructions": 0.05}


@dataclass(frozen=True)
class Figures:
    """Of one image: bytes, and instructions of the longest control interrupt."""

    text: int
    data: int
    bss: int
    stack: int
    instructions: int

    def share(self) -> float:
        """Load of a processor that executes CYCLES instructions a second."""
        return self.instructions * CONTROL_RATE / CYCLES


def run_everything(rig: Rig) -> None:
    """Has the node do all it can in the control interrupt, for a while."""
    line = rig.can
    line.write(OPEN + command("ExcitationLength", 512) + command("ExcitationLines", 64))
    line.write(ENABLE + command("StreamStart") + command("ExcitationOn"))
    while line.wait_for_page("EstimateK") <= 0:
        line.write(HEARTBEAT)
    line.write(
        command("DriftWatch", 1) + command("TraceTrigger", 5) + command("TracePretrigger", 9)
    )
    line.write(command("TraceArm", 1000))
    for _ in range(60):
        line.wait_for("Heartbeat")
        line.write(HEARTBEAT)
    rig.registers("Sequence", 95)


def measure(image: str) -> Figures:
    """All figures of one image."""
    program = IMAGES / f"{image}.elf"
    sizes = subprocess.run(
        ["arm-none-eabi-size", str(program)], capture_output=True, text=True, check=True
    )
    text, data, bss = map(int, sizes.stdout.splitlines()[1].split()[:3])
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Path(folder), image, f"shift={SHIFTS[image]}")
        try:
            rig.reset()
            run_everything(rig)
            size, used = rig.registers("StackSize", 2)
            debugger = rig.debug()
            ticks = debugger.read(rig.address("longest"))
            period = debugger.read(rig.address("ticks_per_period"))
            late = debugger.read(rig.address("late"))
            debugger.release()
        finally:
            rig.close()
    if late > 0:
        raise SystemExit(f"measure.py: {image}: {late} control interrupts took too long")
    nanoseconds = ticks / period / CONTROL_RATE * 1e9
    # the painted part is beside the variables, which count it in
    return Figures(text, data, bss - size, used, round(nanoseconds / 2 ** SHIFTS[image]))


def table(figures: dict[str, Figures]) -> str:
    """For people."""
    head = "| image | text | data | bss | stack | instructions |\n|---|---|---|---|---|---|\n"
    rows = "".join(
        f"| {image} | {f.text} | {f.data} | {f.bss} | {f.stack} | {f.instructions} |\n"
        for image, f in figures.items()
    )
    share = figures["cortex-m4f"].share()
    soft = figures["cortex-m3"].instructions * CONTROL_RATE / 1e6
    return (
        f"{head}{rows}\nBytes; instructions of the longest control interrupt of a run. On a "
        f"Cortex-M4F of {CYCLES // 10**6} MHz these are\n{share:.1%} of the time at "
        f"{CONTROL_RATE // 1000} kHz, if an instruction takes one cycle, which is an estimate. A "
        f"Cortex-M3\nhas no floating point, and would have to execute {soft:.0f} million "
        "instructions a second.\n"
    )


def put_into(page: str, made: str) -> str:
    """The page with the table in its place."""
    before, rest = page.split(BEGIN)
    return before + BEGIN + made + END + rest.split(END, 1)[1]


def differences(page: str, figures: dict[str, Figures]) -> list[str]:
    """What the table of a page says otherwise than the figures, beyond what they may spread."""
    names = [field.name for field in fields(Figures)]
    found = []
    for image, one in figures.items():
        row = re.search(rf"^\| {image} \|(( \d+ \|)+)$", page, re.MULTILINE)
        written = row[1].split("|")[:-1] if row else []
        if len(written) != len(names):
            return [f"{image}: no such row"]
        for name, text in zip(names, written, strict=True):
            measured = getattr(one, name)
            if abs(int(text) - measured) > SPREAD[name] * measured:
                found.append(f"{image}: {name} is {measured}, not {int(text)}")
    return found


def main() -> int:
    """Command line; 1 when --check finds a stale page."""
    parser = argparse.ArgumentParser(description="measure the firmware")
    parser.add_argument("output", type=Path)
    parser.add_argument("--page", type=Path, metavar="FILE")
    parser.add_argument("--check", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    figures = {image: measure(image) for image in MACHINES}
    print(table(figures))
    found = {image: {**asdict(one), "load": one.share()} for image, one in figures.items()}
    arguments.output.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        arguments.page.write_text(put_into(page, table(figures)), encoding="utf-8")
    if arguments.check:
        stale = differences(arguments.check.read_text(encoding="utf-8"), figures)
        print(*stale, sep="\n", file=sys.stderr)
        return 1 if stale else 0
    return 0


if __name__ == "__main__":
    sys.exit(main())
