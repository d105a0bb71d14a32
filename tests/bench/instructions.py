"""Instructions of every call of the control interrupt, call by call, exact and repeatable."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from toolchain import BENCH, BOARDS, HOST, BenchError, build, run

# 1 instruction = 2^8 ns of virtual time: several ticks of the boards' timers (target/counter.c).
ICOUNT_SHIFT = 8
QEMU = ["-nographic", "-monitor", "none", "-serial", "none"]
SEMIHOSTING = ["-semihosting-config", "enable=on,target=native,chardev=output", "-chardev"]
LINK = ["--specs=picolibc.specs", "-nostartfiles", "-T", str(BENCH / "target/target.ld")]

EMPTY = "nothing"  # counted, to be subtracted
MEAN_OVER = "running"


@dataclass
class Counts:
    """Instructions of one kind of call."""

    running: list[int] = field(default_factory=list)
    largest: int = 0

    def add(self, section: str, count: int) -> None:
        """Takes one call into account."""
        self.largest = max(self.largest, count)
        if section == MEAN_OVER:
            self.running.append(count)

    def figures(self) -> dict[str, float]:
        """Mean over normal running, maximum over everything, and by how much that is more."""
        mean = sum(self.running) / len(self.running)
        return {"mean": round(mean, 2), "max": self.largest, "spread": self.largest / mean - 1}


@dataclass
class Measurement:
    """What one target's program reported."""

    instructions: dict[str, dict[str, float]]
    stack: dict[str, int]  # bytes seen in use, by function


def sources(counter: Path) -> list[Path]:
    """The program that counts, with the target's way of counting."""
    return [BENCH / "drive.c", BENCH / "instructions.c", counter]


def lines_of_board(target: str) -> Iterator[str]:
    """What the program writes on an emulated board."""
    board = BENCH / "target"
    extra = [board / "startup.c", board / "semihosting.c"]
    program = build(target, "instructions.elf", [*sources(board / "counter.c"), *extra], LINK)
    machine = ["qemu-system-arm", "-M", BOARDS[target].machine, "-icount", f"shift={ICOUNT_SHIFT}"]
    output = program.with_suffix(".txt")
    console = [*SEMIHOSTING, f"file,id=output,path={output}"]
    try:
        run([*machine, *QEMU, *console, "-kernel", str(program)], 300)
    except BenchError as error:
        last = output.read_text(encoding="utf-8").splitlines()[-1:] if output.exists() else []
        raise BenchError(f"{error}{''.join(last)}") from error
    yield from output.read_text(encoding="utf-8").splitlines()


def lines_of_callgrind() -> Iterator[str]:
    """The same lines from callgrind, which writes one part of its output for each count."""
    program = build(HOST, "instructions", sources(BENCH / "counter_callgrind.c"), [])
    output = program.with_suffix(".callgrind")
    options = ["--collect-atstart=no", "--combine-dumps=yes", f"--callgrind-out-file={output}"]
    run(["valgrind", "--quiet", "--tool=callgrind", *options, str(program)])
    name = None
    with output.open(encoding="utf-8") as parts:
        for line in parts:
            if found := re.match(r"desc: Trigger: Client Request: (.*)", line):
                name = found[1]
            elif name is not None and line.startswith("summary:"):
                yield name if name.startswith("section ") else f"{name} {line.split()[1]}"
                name = None
    output.unlink()


def measure(target: str) -> Measurement:
    """Counts on one target.

    Raises BenchError when the program does not run there, or counts nothing.
    """
    counts: dict[str, Counts] = {}
    stack: dict[str, int] = {}
    section = ""
    for line in lines_of_callgrind() if target == HOST else lines_of_board(target):
        name, value = line.rsplit(" ", 1)
        if name == "section":
            section = value
        elif name.startswith("stack "):
            stack[name.removeprefix("stack ")] = int(value)
        else:
            counts.setdefault(name, Counts()).add(section, int(value))
    if EMPTY not in counts:
        raise BenchError(f"{target}: nothing was counted")
    empty = counts.pop(EMPTY)
    if set(empty.running) != {empty.largest}:
        raise BenchError(f"{target}: counting itself does not always take the same instructions")
    for one in counts.values():
        one.running = [count - empty.largest for count in one.running]
        one.largest -= empty.largest
    return Measurement({name: one.figures() for name, one in counts.items()}, stack)
