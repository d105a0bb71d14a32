"""What the core costs on each target: text, data, stack and state.

    size.py OUTPUT.json

Compiles every lib/*.c for the targets below at -Os and -O2, freestanding and with warnings as
errors, prints a table and writes OUTPUT.json. Fails when something does not compile, when the
objects want a symbol that is neither one of the mathematical functions that lib/axt_math.h declares
nor one of the compiler's own helpers, when a function's stack has no fixed size, or when functions
call each other in a circle.

Stack is the deepest path of calls from any public function, from the compiler's own call graph,
without what the mathematical functions and helpers use. State is the size of the public structs.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

LIB = Path("lib")
BUILD = Path("build/size")

ARM = "arm-none-eabi-"
RISCV = "riscv64-unknown-elf-"
FLOAT_ABI = "-mfloat-abi=hard"
# One instruction at a time: to load early gains nothing there, and costs registers.
IN_ORDER = "-fno-schedule-insns"
TARGETS = {
    "cortex-m0plus": (ARM, ["-mcpu=cortex-m0plus", "-mthumb", IN_ORDER]),
    "cortex-m4f": (ARM, ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", FLOAT_ABI, IN_ORDER]),
    "cortex-m7": (ARM, ["-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-sp-d16", FLOAT_ABI]),
    "cortex-r5f": (ARM, ["-mcpu=cortex-r5", "-mthumb", "-mfpu=vfpv3-d16", FLOAT_ABI]),
    "rv32imac": (RISCV, ["-march=rv32imac", "-mabi=ilp32"]),
}
OPTIMISATIONS = ["-Os", "-O2"]

# What GCC may call by itself: memory functions (its manual requires them of every freestanding
# environment) and its run-time library for integers and single-precision numbers that the processor
# has no instructions for. Its helpers for double are not here: the float core must not need them.
COMPILER_HELPERS = re.compile(
    r"mem(cpy|move|set|cmp)"
    r"|__gnu_thumb1_case_\w+"
    r"|__aeabi_(f\w+|[iu]i?2f|u?l2f|u?idiv(mod)?|u?ldivmod|lmul|l(ls|ls|as)[lr]|u?lcmp|mem\w+)"
    r"|__(add|sub|mul|div|neg|eq|ne|lt|le|gt|ge|unord)sf[23]"
    r"|__fix(uns)?sf[sd]i|__float(un)?[sd]isf"
    r"|__(u?div|u?mod|mul|ashl|ashr|lshr|cmp|ucmp)[sd]i[23]|__c[lt]z[sd]i2"
)


class SizeError(Exception):
    """The core does not meet a condition on one target; the message says which."""


@dataclass(frozen=True)
class Function:
    """A node of the call graph: its own stack in bytes, and what it calls."""

    stack: int
    calls: tuple[str, ...]


@dataclass(frozen=True)
class Figures:
    """One target at one optimisation, in bytes."""

    text: dict[str, int]  # by object; code and constants
    data: dict[str, int]
    bss: dict[str, int]
    stack: dict[str, int]  # by public function
    state: dict[str, int]  # by public struct


def run(command: list[str]) -> str:
    """The standard output of a command that has to succeed."""
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise SizeError(f"{' '.join(command)}\n{result.stdout}{result.stderr}")
    return result.stdout


def declared_math_functions() -> set[str]:
    """The C library's functions that lib/axt_math.h declares for single precision."""
    text = (LIB / "axt_math.h").read_text(encoding="utf-8")
    return set(re.findall(r"^float (\w+)\(.*\);", text, re.MULTILINE))


def public_structs() -> list[str]:
    """The struct types of the public headers; a private header says that it is."""
    names = []
    for header in sorted(LIB.glob("*.h")):
        text = header.read_text(encoding="utf-8")
        if "Private to lib/" not in text:
            names += re.findall(r"^typedef struct \{.*?^\} (\w+);", text, re.MULTILINE | re.DOTALL)
    return names


def call_graph(files: list[Path]) -> dict[str, Function]:
    """Functions by name, from what -fcallgraph-info=su wrote."""
    stack: dict[str, int] = {}
    calls: dict[str, list[str]] = {}
    for file in files:
        text = file.read_text(encoding="utf-8")
        for name, size, kind in re.findall(
            r'node: \{ title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \(([\w,]+)\)', text
        ):
            if kind != "static":
                raise SizeError(f"{name} uses stack of no fixed size ({kind})")
            stack[name] = int(size)
        edges = re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text)
        for caller, callee in edges:
            calls.setdefault(caller, []).append(callee)
    return {name: Function(stack[name], tuple(calls.get(name, ()))) for name in stack}


def deepest(name: str, graph: dict[str, Function], path: tuple[str, ...] = ()) -> int:
    """Bytes of stack of a function and of what it calls; functions outside the core count 0."""
    if name == "__indirect_call":
        raise SizeError(f"{path[-1]} calls through a pointer: its stack cannot be bounded")
    if name in path:
        raise SizeError(f"{' -> '.join([*path, name])} is recursive")
    if name not in graph:
        return 0
    function = graph[name]
    below = (deepest(callee, graph, (*path, name)) for callee in function.calls)
    return function.stack + max(below, default=0)


def sections(tool: str, file: Path) -> tuple[int, int, int]:
    """Bytes of text (with constants), data and bss of an object file."""
    text, data, bss = run([f"{tool}size", str(file)]).splitlines()[1].split()[:3]
    return int(text), int(data), int(bss)


def function_sizes(tool: str, file: Path) -> dict[str, int]:
    """Bytes of each function of an object file, static ones too."""
    sizes = {}
    for line in run([f"{tool}nm", "--print-size", str(file)]).splitlines():
        fields = line.split()
        if len(fields) == 4 and fields[2] in "Tt":
            sizes[fields[3]] = int(fields[1], 16)
    return sizes


def check_undefined(tool: str, objects: list[Path], allowed: set[str]) -> None:
    """Fails when the objects together want something that the core does not document."""
    defined: set[str] = set()
    wanted: set[str] = set()
    for line in run([f"{tool}nm", "--format=posix", *map(str, objects)]).splitlines():
        fields = line.split()
        if len(fields) >= 2:
            (wanted if fields[1] in "Uwv" else defined).add(fields[0])
    unknown = wanted - defined - allowed
    surplus = {name for name in unknown if not COMPILER_HELPERS.fullmatch(name)}
    if surplus:
        raise SizeError(f"undefined symbols that lib/axt_math.h does not list: {sorted(surplus)}")


def compile_core(tool: str, flags: list[str], folder: Path) -> list[Path]:
    """Compiles lib/*.c into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    objects = []
    for source in sorted(LIB.glob("*.c")):
        target = folder / f"{source.stem}.o"
        run([f"{tool}gcc", *flags, "-fcallgraph-info=su", "-c", str(source), "-o", str(target)])
        objects.append(target)
    return objects


def state_sizes(tool: str, flags: list[str], folder: Path) -> dict[str, int]:
    """Bytes of each public struct: compiled into arrays of that size, read from the object."""
    structs = public_structs()
    source = folder / "state.c"
    arrays = [f"extern char state_{name}[]; char state_{name}[sizeof({name})];" for name in structs]
    source.write_text('#include "axt.h"\n' + "\n".join(arrays) + "\n", encoding="utf-8")
    target = source.with_suffix(".o")
    run([f"{tool}gcc", *flags, "-c", str(source), "-o", str(target)])
    sizes = {}
    for line in run([f"{tool}nm", "--print-size", str(target)]).splitlines():
        _, size, _, name = line.split()
        sizes[name.removeprefix("state_")] = int(size, 16)
    return {name: sizes[name] for name in structs}


def measure(target: str, optimisation: str, flags: list[str]) -> Figures:
    """All figures of one target at one optimisation."""
    tool, machine = TARGETS[target]
    folder = BUILD / f"{target}{optimisation}"
    options = [*flags, *machine, optimisation]
    objects = compile_core(tool, options, folder)
    check_undefined(tool, objects, declared_math_functions())
    graph = call_graph([path.with_suffix(".ci") for path in objects])
    parts = {path.stem: sections(tool, path) for path in objects}
    return Figures(
        text={name: part[0] for name, part in parts.items()},
        data={name: part[1] for name, part in parts.items()},
        bss={name: part[2] for name, part in parts.items()},
        # GCC writes a static function as file:name.
        stack={name: deepest(name, graph) for name in sorted(graph) if ":" not in name},
        state=state_sizes(tool, options, folder),
    )


def print_row(title: str, values: list[int]) -> None:
    """One row: a title and a number for each target."""
    print(f"  {title:<22}" + "".join(f"{value:>15}" for value in values))


def print_tables(optimisation: str, figures: list[Figures]) -> None:
    """The figures of all targets at one optimisation, as a person reads them."""
    print(f"{optimisation + ', bytes':<24}" + "".join(f"{target:>15}" for target in TARGETS))
    print("text")
    for name in figures[0].text:
        print_row(name, [one.text[name] for one in figures])
    print("total")
    print_row("text", [sum(one.text.values()) for one in figures])
    print_row("data", [sum(one.data.values()) for one in figures])
    print_row("bss", [sum(one.bss.values()) for one in figures])
    print_row("stack, deepest path", [max(one.stack.values()) for one in figures])
    print()


def print_state(figures: list[Figures]) -> None:
    """What a caller has to keep, by struct; the same at every optimisation."""
    print("state, bytes")
    for name in figures[0].state:
        print_row(name, [one.state[name] for one in figures])


def as_json(one: Figures) -> dict[str, object]:
    """The figures with their totals."""
    total = {part: sum(getattr(one, part).values()) for part in ("text", "data", "bss")}
    return {"total": {**total, "stack": max(one.stack.values())}, **asdict(one)}


def main() -> int:
    """Command line; 0 when every target meets every condition, 1 otherwise."""
    output = Path(sys.argv[1])
    flags = os.environ["CORE_FLAGS"].split()
    figures: dict[str, dict[str, Figures]] = {}
    for target in TARGETS:
        try:
            figures[target] = {o: measure(target, o, flags) for o in OPTIMISATIONS}
        except SizeError as error:
            print(f"size: {target}: {error}", file=sys.stderr)
            return 1
    for optimisation in OPTIMISATIONS:
        print_tables(optimisation, [figures[target][optimisation] for target in TARGETS])
    print_state([figures[target][OPTIMISATIONS[0]] for target in TARGETS])
    everything = {t: {o: as_json(one) for o, one in by.items()} for t, by in figures.items()}
    output.write_text(json.dumps(everything, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
