"""Which lines, branches and conditions of lib/ its unit tests reach.

    coverage.py OUTPUT.json PROGRAM...

The programs are unit tests built by clang with -fprofile-instr-generate -fcoverage-mapping
-fcoverage-mcdc. Runs them, merges what they counted, prints a table by file and what was missed,
and writes OUTPUT.json. Fails when a line or one way of a branch is missed that is not justified
below, or when one that is justified is missed no more.

A branch is a condition, and counts as two ways. MC/DC (modified condition/decision coverage: each
condition of a decision was seen to change its outcome by itself) is reported, and what is missing
is listed, but only lines and branches decide.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path

BUILD = Path("build/coverage")
LIB = Path("lib").resolve()
PROFDATA, COV = "llvm-profdata-19", "llvm-cov-19"

# What no test can reach, by file and text of the line, and why.
CHECKED = "the same was checked before; it is asked again rather than taken for granted"
ROUNDING = "a sum of squares that rounding alone could make zero or less"
RANGES = "the ranges of the settings keep it away from that end"
JUSTIFIED = {
    ("lib/axt_excitation.c", "if (!(sum.hi > AXT_R(0)) || !axt_finite(sum.hi)) {"): "an infinite "
    "sum is not a number any more after the two-sum, and then not above 0 either",
    (
        "lib/axt_ident.c",
        "found.t = (found.error > AXT_R(0)) ? found.value / found.error : AXT_R(0);",
    ): ROUNDING,
    (
        "lib/axt_ident.c",
        "return (axt_finite(error) && error * AXT_R(RELATIVE_ERROR) < value) ? flag : 0;",
    ): "an error that is not finite does not come of scaled samples; it would not be relied on",
    ("lib/axt_ident.c", "axt_axis_modal(&found.axis, &found.modal) != AXT_OK) {"): CHECKED,
    (
        "lib/axt_integrator.c",
        "while (largest * factor > AXT_R(0.5) && halvings < HALVINGS_MAX) {",
    ): RANGES,
    ("lib/axt_integrator.c", "switch (integrator->method) {"): "no other method passes the init",
    ("lib/axt_iv.c", "if (!(axt_abs(total) >= LEAST_TOTAL) || !axt_finite(total)) {"): RANGES,
    (
        "lib/axt_machine.c",
        "return axt_finite(speeds->change[0]) && axt_finite(speeds->change[1]);",
    ): RANGES,
    ("lib/axt_math.h", "while (power > x && power > AXT_R(1e-30)) {"): RANGES,
    ("lib/axt_math.h", "while (power <= AXT_R(0.5) * x && power < AXT_R(1e30)) {"): RANGES,
    ("lib/axt_monitor.c", "return (b > OVERSHOOT) ? b - OVERSHOOT : AXT_R(0);"): RANGES,
    ("lib/axt_regressor.c", "if (status != AXT_OK) {"): CHECKED,
    ("lib/axt_regressor.c", "return status;"): CHECKED,
}


@dataclass
class Ratio:
    """So many of so many."""

    covered: int = 0
    total: int = 0

    def add(self, covered: int, total: int) -> None:
        """Counts more."""
        self.covered += covered
        self.total += total

    def __str__(self) -> str:
        return f"{self.covered}/{self.total}"


@dataclass
class Missed:
    """A place that was not reached, or not both ways."""

    file: str
    line: int
    what: str
    text: str
    reason: str = ""


@dataclass
class Coverage:
    """Of a file."""

    lines: Ratio = field(default_factory=Ratio)
    branches: Ratio = field(default_factory=Ratio)
    mcdc: Ratio = field(default_factory=Ratio)
    missed: list[Missed] = field(default_factory=list)


class CoverageError(Exception):
    """A program did not run to its end; the message says which and what it said."""


def run(command: list[str], environment: dict[str, str] | None = None) -> str:
    """The standard output of a command that has to succeed."""
    result = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if result.returncode != 0:
        raise CoverageError(f"{' '.join(command)}\n{(result.stdout + result.stderr)[-2000:]}")
    return result.stdout


def export(programs: list[str]) -> list[str]:
    """Runs the programs; the options of llvm-cov that name them and what they counted."""
    BUILD.mkdir(parents=True, exist_ok=True)
    profiles = []
    for program in programs:
        profile = BUILD / f"{Path(program).name}.profraw"
        run([program], {**os.environ, "LLVM_PROFILE_FILE": str(profile)})
        profiles.append(str(profile))
    merged = str(BUILD / "all.profdata")
    run([PROFDATA, "merge", "-sparse", "-o", merged, *profiles])
    objects = [option for program in programs[1:] for option in ("-object", program)]
    return [programs[0], *objects, f"-instr-profile={merged}"]


def name_of(path: str) -> str | None:
    """lib/NAME for a file of the library."""
    return f"lib/{Path(path).name}" if Path(path).resolve().parent == LIB else None


def count_lines(report: str, coverage: dict[str, Coverage]) -> None:
    """Lines, from LCOV's format."""
    name: str | None = None
    for entry in report.splitlines():
        if entry.startswith("SF:"):
            name = name_of(entry[3:])
            if name is not None:
                coverage[name] = Coverage()
        found = re.match(r"DA:(\d+),(\d+)", entry)
        if name is not None and found is not None:
            count = int(found[2])
            coverage[name].lines.add(1 if count > 0 else 0, 1)
            if count == 0:
                coverage[name].missed.append(Missed(name, int(found[1]), "line", ""))


def count_branches(name: str, branches: list[list[int]], coverage: Coverage) -> None:
    """Both ways of each condition, over all functions that a header's was made part of."""
    ways: dict[tuple[int, int], list[int]] = {}
    for line, column, _, _, true, false, *_ in branches:
        way = ways.setdefault((line, column), [0, 0])
        way[0] += true
        way[1] += false
    for (line, column), (true, false) in sorted(ways.items()):
        coverage.branches.add((true > 0) + (false > 0), 2)
        for count, outcome in ((true, "true"), (false, "false")):
            if count == 0:
                what = f"branch at column {column} never {outcome}"
                coverage.missed.append(Missed(name, line, what, ""))


def count_mcdc(name: str, records: list[list[object]], coverage: Coverage) -> None:
    """Conditions that were seen to decide by themselves, likewise."""
    decisions: dict[tuple[int, int], list[bool]] = {}
    for record in records:
        line, column, conditions = record[0], record[1], record[-1]
        assert isinstance(line, int)
        assert isinstance(column, int)
        assert isinstance(conditions, list)
        seen = decisions.setdefault((line, column), [False] * len(conditions))
        decisions[line, column] = [a or b for a, b in zip(seen, conditions, strict=True)]
    for (line, _), conditions in sorted(decisions.items()):
        coverage.mcdc.add(sum(conditions), len(conditions))
        for number, decides in enumerate(conditions):
            if not decides:
                what = f"MC/DC: condition {number + 1} of {len(conditions)}"
                coverage.missed.append(Missed(name, line, what, ""))


def measure(programs: list[str]) -> dict[str, Coverage]:
    """Coverage by file of lib/."""
    options = export(programs)
    coverage: dict[str, Coverage] = {}
    count_lines(run([COV, "export", "-format=lcov", *options]), coverage)
    for file in json.loads(run([COV, "export", *options]))["data"][0]["files"]:
        name = name_of(file["filename"])
        if name is not None:
            count_branches(name, file["branches"], coverage[name])
            count_mcdc(name, file["mcdc_records"], coverage[name])
    for name, one in coverage.items():
        source = Path(name).read_text(encoding="utf-8").splitlines()
        for missed in one.missed:
            missed.text = source[missed.line - 1].strip()
            if missed.text == "}":  # goes with the line that it ends
                missed.text = source[missed.line - 2].strip()
            missed.reason = JUSTIFIED.get((name, missed.text), "")
    return dict(sorted(coverage.items()))


def total(coverage: dict[str, Coverage]) -> Coverage:
    """The sum of all files."""
    everything = Coverage()
    for one in coverage.values():
        everything.lines.add(one.lines.covered, one.lines.total)
        everything.branches.add(one.branches.covered, one.branches.total)
        everything.mcdc.add(one.mcdc.covered, one.mcdc.total)
        everything.missed += one.missed
    return everything


def print_row(name: str, coverage: Coverage) -> None:
    """One row of the table."""
    ratios = (coverage.lines, coverage.branches, coverage.mcdc)
    print(f"{name:<26}" + "".join(f"{ratio!s:>12}" for ratio in ratios))


def print_missed(missed: list[Missed]) -> None:
    """Each place that was missed, and why when that is known."""
    for one in missed:
        reason = f"  justified: {one.reason}" if one.reason else ""
        print(f"{one.file}:{one.line}: {one.what}: {one.text}{reason}")


def main() -> int:
    """Measures, prints and writes; 1 when something is missed without a reason."""
    output, programs = Path(sys.argv[1]), sys.argv[2:]
    try:
        coverage = measure(programs)
    except CoverageError as error:
        print(error, file=sys.stderr)
        return 1
    everything = total(coverage)
    print(f"{'file':<26}{'lines':>12}{'branches':>12}{'MC/DC':>12}")
    for name, one in coverage.items():
        print_row(name, one)
    print_row("all", everything)
    print_missed(everything.missed)
    report = {"all": asdict(everything), "files": {k: asdict(v) for k, v in coverage.items()}}
    output.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")

    decisive = [one for one in everything.missed if not one.what.startswith("MC/DC")]
    unjustified = [one for one in decisive if not one.reason]
    needless = set(JUSTIFIED) - {(one.file, one.text) for one in everything.missed}
    for file, text in sorted(needless):
        print(f"{file}: justified but not missed: {text}")
    if unjustified:
        print(f"coverage: {len(unjustified)} missed without a reason")
    return 1 if unjustified or needless else 0


if __name__ == "__main__":
    sys.exit(main())
