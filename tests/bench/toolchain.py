"""The bench's targets and how a program is compiled for one of them."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

from size import TARGETS as SIZE_TARGETS

BENCH = Path("tests/bench")
BUILD = Path("build/bench")
HOST = "x86_64"

# The host is a target like the others.
SIZE_TARGETS.setdefault(HOST, ("", []))


@dataclass(frozen=True)
class Board:
    """A board that QEMU emulates."""

    machine: str
    processor: str  # of the board, where it is not the very target


# No board of QEMU's has a Cortex-M0+; the Cortex-M0 has the same instruction set (Armv6-M).
BOARDS = {
    "cortex-m4f": Board("mps2-an386", "Cortex-M4"),
    "cortex-m7": Board("mps2-an500", "Cortex-M7"),
    # QEMU has no larger M0 than one of 16 kB; a Cortex-M3 runs the same instructions.
    "cortex-m0plus": Board("mps2-an385", "Cortex-M3 running ARMv6-M code"),
}
TARGETS = [*BOARDS, HOST]


class BenchError(Exception):
    """Something could not be measured; the message says what and why."""


def run(command: list[str], timeout: float = 600.0) -> str:
    """The standard output of a command that has to succeed within `timeout` seconds."""
    try:
        result = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=timeout
        )
    except FileNotFoundError as error:
        raise BenchError(f"{command[0]} is not installed") from error
    except subprocess.TimeoutExpired as error:
        raise BenchError(f"{' '.join(command)}: no end after {timeout:g} s") from error
    if result.returncode != 0:
        raise BenchError(f"{' '.join(command)}\n{result.stdout[-2000:]}{result.stderr[-2000:]}")
    return result.stdout


def core_flags() -> list[str]:
    """The flags that the Makefile compiles lib/ with."""
    return os.environ["CORE_FLAGS"].split()


def build(target: str, name: str, sources: list[Path], flags: list[str]) -> Path:
    """Compiles lib/*.c with these sources into a program build/bench/<target>/<name>."""
    tool, machine = SIZE_TARGETS[target]
    folder = BUILD / target
    folder.mkdir(parents=True, exist_ok=True)
    objects = []
    # -MMD and -MP are for the Makefile's objects, and only the core is freestanding.
    core = [flag for flag in core_flags() if not flag.startswith("-MM") and flag != "-MP"]
    hosted = [flag for flag in core if flag != "-ffreestanding"]
    for source in [*sorted(Path("lib").glob("*.c")), *sources]:
        options = core if source.parent.name == "lib" else [*hosted, f"-I{BENCH}", "-D_GNU_SOURCE"]
        target_file = folder / f"{source.stem}.o"
        compile_ = [f"{tool}gcc", *options, *machine, *flags, "-c", str(source)]
        run([*compile_, "-o", str(target_file)])
        objects.append(str(target_file))
    program = folder / name
    run([f"{tool}gcc", *machine, *flags, *objects, "-lm", "-o", str(program)])
    return program
