"""Runs the project's suites, each a make target, and counts honestly.

    suites.py [--show TARGET] TARGET...

Every target runs, whatever became of the others; its output goes to build/results/TARGET.log and
is printed when it fails (with --show: always, while it runs). What is counted is what was seen to
run: the JUnit report of a pytest suite, the closing lines of unit test programs, otherwise one
check a target. A target that fails without a failure of its own counted (a crash, a compiler
error, a test runner that did not start) counts as one failure. The end names what failed and what
was skipped, so that the last lines alone say it; the very last one is the sum. The exit status is 1
unless all ran and nothing failed.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

RESULTS = Path("build/results")
MAKE = ["make", "--silent", "--no-print-directory", f"--jobs={os.cpu_count()}"]
UNIT_CLOSING_LINE = re.compile(r"^\w+: (\d+) passed, (\d+) failed$", re.MULTILINE)


@dataclass
class Count:
    """Tests by outcome, and a line for each that did not pass."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0
    remarks: list[str] = field(default_factory=list)

    def add(self, other: Count) -> None:
        """Adds another count to this one."""
        self.passed += other.passed
        self.failed += other.failed
        self.skipped += other.skipped
        self.remarks += other.remarks

    def __str__(self) -> str:
        return f"{self.passed} passed, {self.failed} failed, {self.skipped} skipped"


def brief(outcome: ElementTree.Element) -> str:
    """The first line of the message of a failure or a skip."""
    return (outcome.get("message") or "no reason given").splitlines()[0]


def count_junit(report: Path) -> Count:
    """What pytest's own report says."""
    count = Count()
    for case in ElementTree.parse(report).iter("testcase"):
        name = f"{case.get('classname', '')}.{case.get('name', '')}"
        failure, error, skip = (case.find(kind) for kind in ("failure", "error", "skipped"))
        fault = failure if failure is not None else error
        if fault is not None:
            count.failed += 1
            count.remarks.append(f"FAILED {name}: {brief(fault)}")
        elif skip is not None:
            count.skipped += 1
            count.remarks.append(f"SKIPPED {name}: {brief(skip)}")
        else:
            count.passed += 1
    return count


def count_target(target: str, output: str, status: int) -> Count:
    """The outcome of one target, from its report, its output and its exit status."""
    report = RESULTS / f"{target}.xml"
    if report.exists():
        count = count_junit(report)
    else:
        closing = UNIT_CLOSING_LINE.findall(output)
        count = Count(sum(int(p) for p, _ in closing), sum(int(f) for _, f in closing))
        if not closing and status == 0:
            count.passed = 1
    if status != 0 and count.failed == 0:
        count.failed = 1
    if count.failed > sum(remark.startswith("FAILED") for remark in count.remarks):
        count.remarks.append(f"FAILED {target}: see {RESULTS / target}.log")
    return count


def run_target(target: str, show: bool) -> Count:
    """Makes one target and prints its line."""
    report, log = RESULTS / f"{target}.xml", RESULTS / f"{target}.log"
    report.unlink(missing_ok=True)
    start = time.monotonic()
    lines: list[str] = []
    with (
        log.open("w", encoding="utf-8") as copy,
        subprocess.Popen(
            [*MAKE, target],
            env={name: value for name, value in os.environ.items() if name != "MAKEFLAGS"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        ) as process,
    ):
        assert process.stdout is not None
        for line in process.stdout:
            copy.write(line)
            lines.append(line)
            if show:
                print(f"    | {line}", end="", flush=True)
    count = count_target(target, "".join(lines), process.returncode)
    if count.failed > 0 and not show:
        print("".join(f"    | {line}" for line in lines), end="")
    print(f"{target:<24} {count}   {time.monotonic() - start:.1f} s", flush=True)
    return count


def main() -> int:
    """Command line: exit status 0 when all targets ran and nothing failed, otherwise 1."""
    parser = argparse.ArgumentParser(description="run make targets that test, and count")
    parser.add_argument("targets", nargs="+", metavar="TARGET")
    parser.add_argument("--show", action="append", default=[], metavar="TARGET")
    arguments = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    total = Count()
    for target in arguments.targets:
        total.add(run_target(target, target in arguments.show))
    for remark in total.remarks:
        print(remark)
    print(total)
    return 1 if total.failed > 0 else 0


if __name__ == "__main__":
    sys.exit(main())
