"""Runs the fuzz targets for a while each and counts.

    fuzz.py OUTPUT.json SECONDS TARGET...

A target is a program that libFuzzer drives (address and undefined-behaviour sanitizers on), named
after its source fuzz_NAME.c. It starts from the corpus in tests/fuzz/corpus/NAME and keeps what it
finds in build/fuzz/corpus/NAME for the next run. Prints a table and writes OUTPUT.json. Fails when
a target found something; its input is then kept beside the target and printed, with the command
that tries it again.

An execution is one call of the target's entry; the first comment of each source says how much it
does with one.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

KEPT = Path("tests/fuzz/corpus")
FOUND = Path("build/fuzz/corpus")
LONGEST = 256  # bytes of one input
TIMEOUT = 20  # seconds for one input
GRACE = 120  # seconds to read the corpus on a busy machine


@dataclass(frozen=True)
class Result:
    """What a target came to."""

    executions: int
    seconds: float
    corpus: int  # inputs
    crashes: list[str]  # files


def crashes_of(target: Path) -> set[Path]:
    """What earlier and present runs have found."""
    kinds = ("crash", "timeout", "oom", "leak")
    return {path for kind in kinds for path in target.parent.glob(f"{target.name}-{kind}-*")}


def fuzz(target: Path, seconds: int) -> Result:
    """Runs one target; its log is written beside it."""
    kept, found = KEPT / target.name, FOUND / target.name
    found.mkdir(parents=True, exist_ok=True)
    before = crashes_of(target)
    log = target.with_suffix(".log")
    command = [
        str(target),
        f"-max_total_time={seconds}",
        f"-max_len={LONGEST}",
        f"-timeout={TIMEOUT}",
        f"-artifact_prefix={target}-",
        "-print_final_stats=1",
        str(found),
        *([str(kept)] if kept.is_dir() else []),
    ]
    begun = time.monotonic()
    with log.open("w", encoding="utf-8") as output:
        result = subprocess.run(
            command, stdout=output, stderr=subprocess.STDOUT, timeout=seconds + GRACE, check=False
        )
    text = log.read_text(encoding="utf-8", errors="replace")
    executions = re.search(r"^stat::number_of_executed_units: (\d+)", text, re.MULTILINE)
    crashes = sorted(str(path) for path in crashes_of(target) - before)
    if result.returncode != 0 and not crashes:
        crashes = [f"{target} (see {log})"]
    return Result(
        executions=int(executions[1]) if executions else 0,
        seconds=round(time.monotonic() - begun, 1),
        corpus=sum(1 for _ in found.iterdir()),
        crashes=crashes,
    )


def main() -> int:
    """Fuzzes, prints and writes; 1 when something was found."""
    output, seconds = Path(sys.argv[1]), int(sys.argv[2])
    targets = [Path(name) for name in sys.argv[3:]]
    results: dict[str, Result] = {}
    print(f"{'target':<14}{'executions':>14}{'seconds':>10}{'corpus':>9}{'crashes':>9}")
    for target in targets:
        result = fuzz(target, seconds)
        results[target.name] = result
        print(
            f"{target.name:<14}{result.executions:>14,}{result.seconds:>10.1f}"
            f"{result.corpus:>9}{len(result.crashes):>9}",
            flush=True,
        )
    total = sum(result.executions for result in results.values())
    print(f"{'all':<14}{total:>14,}")
    report = {"executions": total, "targets": {k: asdict(v) for k, v in results.items()}}
    output.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    found = [path for result in results.values() for path in result.crashes]
    for path in found:
        name = Path(path).name.split("-")[0]
        print(f"fuzz: {name} failed; again with: build/fuzz/{name} {path}")
    silent = [name for name, result in results.items() if result.executions == 0]
    if silent:
        print(f"fuzz: nothing was executed: {', '.join(silent)}")
    return 1 if found or silent else 0


if __name__ == "__main__":
    sys.exit(main())
