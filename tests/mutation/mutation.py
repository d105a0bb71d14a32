"""Do the unit tests notice when one operator of lib/ is another?

    mutation.py OUTPUT.json COUNT SEED TEST.c...

Changes one operator of one lib/*.c at a time, COUNT times at random (the same ones for the same
SEED), compiles that file (float, -O1) and runs the unit tests that link it, the one that is named
after it first, until one fails. A mutant is caught when a test fails, crashes or does not end, or
when it does not compile. Prints the survivors, writes all mutants to OUTPUT.json, and fails when
fewer than 90 % are caught.

A survivor is a hole in the tests or no change at all (an equivalent mutant). Those that were looked
at and found equivalent are in EQUIVALENT with the reason, and are printed apart; against the 90 %
they count as survivors all the same. A reason whose line is gone, or whose mutant a test catches,
is an error.
"""

from __future__ import annotations

import json
import os
import random
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

LIB = Path("lib")
BUILD = Path("build/mutation")
OPTIONS = ["-DAXT_REAL=float", "-O1", "-w"]
# An index beyond its array is seen, as it is in the sanitized variants.
SANITIZE = ["-fsanitize=bounds,signed-integer-overflow,shift", "-fno-sanitize-recover=all"]
CORE_FLAGS = [*os.environ["CORE_FLAGS"].split(), *OPTIONS, *SANITIZE]
TEST_FLAGS = [*os.environ["TEST_FLAGS"].split(), *OPTIONS]
DRIVERS = os.environ["DRIVERS"]  # archive; some tests of lib/ take the node's axis, too
CAUGHT_MIN = 0.9

# Binary operators stand between spaces (clang-format); pointers and signs do not.
SWAPS = {
    "+": "-", "-": "+", "*": "/", "/": "*", "+=": "-=", "-=": "+=", "*=": "/=",
    "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==",
    "&&": "||", "||": "&&", "&": "|", "|": "&", "<<": ">>", ">>": "<<", "++": "--", "--": "++",
}  # fmt: skip
BINARY = re.compile(r"(?<= )(\+=|-=|\*=|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/<>&|])(?=[ \n])")
OTHER = re.compile(r"(?<=\w)(\+\+|--)|(?<=[ (])(!)(?=[\w(])")
NOT_CODE = re.compile(r'/\*.*?\*/|//[^\n]*|"[^"\n]*"|^#include[^\n]*', re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Mutant:
    """A change: `operator` at `place` of the file's text becomes `instead`."""

    file: str
    line: int
    place: int
    operator: str
    instead: str
    text: str


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant."""

    mutant: Mutant
    caught_by: str | None


@dataclass(frozen=True)
class UnitTest:
    """A compiled unit test, the files of lib/ that it links, and how long it runs."""

    name: str
    program: Path
    links: frozenset[str]
    seconds: float


@dataclass(frozen=True)
class Equivalent:
    """A change that nobody can see: its line, its operators, and why."""

    file: str
    text: str
    operator: str
    instead: str
    reason: str

    def is_of(self, mutant: Mutant) -> bool:
        """Whether this is the change that the mutant makes."""
        return (self.file, self.text, self.operator, self.instead) == (
            mutant.file, mutant.text, mutant.operator, mutant.instead,
        )  # fmt: skip


ROUNDED_ZERO = "differs for 0 alone, and -0.5 and 0.5 are both truncated to 0"
LARGER = "the larger of two: where they are equal it is the same"

EQUIVALENT = [
    Equivalent(
        "lib/axt_friction.c",
        "const axt_real way = (start < AXT_R(0)) ? AXT_R(-1) : AXT_R(1);",
        "<",
        "<=",
        "from rest both ways are the same",
    ),
    Equivalent(
        "lib/axt_machine.c",
        "return (axt_real)(int32_t)(x + ((x < AXT_R(0)) ? AXT_R(-0.5) : AXT_R(0.5)));",
        "<",
        "<=",
        ROUNDED_ZERO,
    ),
    Equivalent(
        "lib/axt_encoder.c",
        "const int32_t near = (int32_t)(rest + ((rest < AXT_R(0)) ? AXT_R(-0.5) : AXT_R(0.5)));",
        "<",
        "<=",
        ROUNDED_ZERO,
    ),
    Equivalent(
        "lib/axt_machine.c",
        "return (x > AXT_R(0)) ? x : AXT_R(0);",
        ">",
        ">=",
        "differs for -0 alone, and a sum of 1 and a number, which x is, is never -0",
    ),
    Equivalent(
        "lib/axt_monitor.c",
        "normal->deviation = AXT_R(1) / ((deviation > least) ? deviation : least);",
        ">",
        ">=",
        LARGER,
    ),
    Equivalent(
        "lib/axt_monitor.c",
        "*chart = (next > AXT_R(0)) ? next : AXT_R(0);",
        ">",
        ">=",
        LARGER,
    ),
]


class MutationError(Exception):
    """The unchanged code does not build or pass; the message says where."""


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """A command whose outcome the caller looks at."""
    return subprocess.run(command, capture_output=True, text=True, check=False)


def build(command: list[str]) -> str:
    """A command that has to succeed."""
    result = run(command)
    if result.returncode != 0:
        raise MutationError(f"{' '.join(command)}\n{result.stderr[-2000:]}")
    return result.stdout


def mutants_of(path: Path) -> list[Mutant]:
    """Every change that one operator of this file can take."""
    text = path.read_text(encoding="utf-8")
    code = NOT_CODE.sub(lambda found: re.sub(r"[^\n]", "_", found[0]), text)
    mutants = []
    for found in [*BINARY.finditer(code), *OTHER.finditer(code)]:
        operator = found[0]
        line = code.count("\n", 0, found.start()) + 1
        source = text.splitlines()[line - 1].strip()
        instead = SWAPS.get(operator, "")
        mutants.append(Mutant(str(path), line, found.start(), operator, instead, source))
    return mutants


def compile_object(source: Path, target: Path, flags: list[str]) -> list[str]:
    """The command that compiles a file of lib/ or a test of it."""
    return ["gcc", *flags, "-c", str(source), "-o", str(target)]


def link(test: Path, objects: list[Path], program: Path) -> list[str]:
    """The command that links a test against objects and the archive of all others."""
    rest = [str(test), *map(str, objects), DRIVERS, str(BUILD / "lib.a"), "-lm"]
    return ["gcc", *SANITIZE, *rest, "-o", str(program)]


def prepare(tests: list[Path]) -> list[UnitTest]:
    """Builds all unchanged, runs it, and finds out which test links what."""
    BUILD.mkdir(parents=True, exist_ok=True)
    objects = []
    for source in sorted(LIB.glob("*.c")):
        objects.append(BUILD / f"{source.stem}.o")
        build(compile_object(source, objects[-1], CORE_FLAGS))
    (BUILD / "lib.a").unlink(missing_ok=True)
    build(["ar", "rcs", str(BUILD / "lib.a"), *map(str, objects)])
    ready = []
    for source in tests:
        test = BUILD / f"{source.stem}.o"
        build(compile_object(source, test, TEST_FLAGS))
        program = BUILD / source.stem
        linked = program.with_suffix(".map")
        build([*link(test, [], program), f"-Wl,-Map={linked}"])
        found = re.findall(r"lib\.a\((axt_\w+)\.o\)", linked.read_text(encoding="utf-8"))
        begun = time.monotonic()
        build([str(program)])
        ready.append(UnitTest(source.stem, test, frozenset(found), time.monotonic() - begun))
    return ready


def fails(program: Path, limit: float) -> bool:
    """Whether a test program fails, crashes or does not end."""
    try:
        result = subprocess.run([str(program)], capture_output=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return True
    return result.returncode != 0


def judge(number: int, mutant: Mutant, tests: list[UnitTest]) -> Verdict:
    """Builds one mutant and runs the tests concerned until one fails."""
    folder = BUILD / str(number)
    folder.mkdir(exist_ok=True)
    original = Path(mutant.file)
    text = original.read_text(encoding="utf-8")
    changed = folder / original.name
    end = mutant.place + len(mutant.operator)
    changed.write_text(text[: mutant.place] + mutant.instead + text[end:], encoding="utf-8")
    target = changed.with_suffix(".o")
    if run(compile_object(changed, target, CORE_FLAGS)).returncode != 0:
        return Verdict(mutant, "compiler")
    concerned = [test for test in tests if original.stem in test.links]
    own = f"test_{original.stem.removeprefix('axt_')}"
    for test in sorted(concerned, key=lambda test: (test.name != own, test.seconds)):
        program = folder / test.name
        build(link(test.program, [target], program))
        failed = fails(program, 10 + 10 * test.seconds)
        program.unlink()
        if failed:
            return Verdict(mutant, test.name)
    return Verdict(mutant, None)


def place_of(mutant: Mutant) -> str:
    """A mutant in one line."""
    return f"{mutant.file}:{mutant.line}: {mutant.operator!r} -> {mutant.instead!r}: {mutant.text}"


def wrong_reasons(possible: list[Mutant], verdicts: list[Verdict]) -> list[str]:
    """What is wrong with EQUIVALENT: a change that is not there once, or that a test has seen."""
    wrong = []
    for one in EQUIVALENT:
        matches = sum(map(one.is_of, possible))
        if matches != 1:
            wrong.append(f"EQUIVALENT: {matches} such changes, expected 1: {one.file}: {one.text}")
    for verdict in verdicts:
        if verdict.caught_by is not None and any(one.is_of(verdict.mutant) for one in EQUIVALENT):
            wrong.append(f"EQUIVALENT: {verdict.caught_by} catches {place_of(verdict.mutant)}")
    return wrong


def main() -> int:
    """Makes and judges the mutants; 1 when too many survive or a reason is wrong."""
    output, count, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    try:
        tests = prepare([Path(name) for name in sys.argv[4:]])
    except MutationError as error:
        print(error, file=sys.stderr)
        return 1
    possible = [mutant for path in sorted(LIB.glob("*.c")) for mutant in mutants_of(path)]
    chosen = random.Random(seed).sample(possible, count)
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        verdicts = list(pool.map(lambda job: judge(job[0], job[1], tests), enumerate(chosen)))
    wrong = wrong_reasons(possible, verdicts)
    survivors = sorted(
        (verdict.mutant for verdict in verdicts if verdict.caught_by is None),
        key=lambda one: (one.file, one.line),
    )
    reasons = {one: known.reason for one in survivors for known in EQUIVALENT if known.is_of(one)}
    for one in survivors:
        if one not in reasons:
            print(place_of(one))
    for one, reason in reasons.items():
        print(f"equivalent: {place_of(one)}: {reason}")
    caught = count - len(survivors)
    print(
        f"{caught} of {count} mutants caught, {len(survivors) - len(reasons)} missed, "
        f"{len(reasons)} equivalent, seed {seed}, {len(possible)} possible"
    )
    for line in wrong:
        print(line, file=sys.stderr)
    report = {
        "seed": seed,
        "possible": len(possible),
        "mutants": count,
        "caught": caught,
        "survivors": [asdict(one) for one in survivors if one not in reasons],
        "equivalent": [asdict(one) | {"reason": reason} for one, reason in reasons.items()],
        "verdicts": [
            {"file": v.mutant.file, "line": v.mutant.line, "operator": v.mutant.operator,
             "instead": v.mutant.instead, "caught_by": v.caught_by}
            for v in verdicts
        ],
    }  # fmt: skip
    output.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0 if caught >= CAUGHT_MIN * count and not wrong else 1


if __name__ == "__main__":
    sys.exit(main())
