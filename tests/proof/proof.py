"""Proves by abstract interpretation (Frama-C/Eva) what the drivers beside this file assert.

    proof.py OUTPUT.json

Each driver calls code under proof with any values within its stated preconditions; Eva then covers
every path. An alarm is what it could not prove: undefined behaviour in the code, a number that is
not finite where the driver says so, or an assertion of the driver. Lemmas on rounding, which no
analysis by intervals sees, are proven by Gappa. Prints a table and writes OUTPUT.json. Fails when
an alarm is left that is not justified below, when a justified one is no longer raised, or when an
assertion is never reached.
"""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

HERE = Path("tests/proof")
BUILD = Path("build/proof")
CONTRACT = Path("build/contract/axt_contract.h")

INTERVALS = "-eva-domains equality -eva-slevel 300 -eva-auto-loop-unroll 200"


class ProofError(Exception):
    """A tool did not run to its end; the message says which and what it said."""


@dataclass(frozen=True)
class Proof:
    """A driver, the sources it proves something about, and the alarms that are justified."""

    what: str
    driver: str
    sources: tuple[str, ...]
    includes: str  # for the preprocessor
    options: str  # of the analysis
    justified: dict[str, str] = field(default_factory=dict)  # reason by name of the assertion


@dataclass(frozen=True)
class Result:
    """What a proof came to."""

    what: str
    functions: list[str]
    preconditions: str
    alarms: list[str]
    justified: dict[str, str]
    seconds: float


PROOFS = (
    Proof(
        what="plant step",
        driver="plant.c",
        sources=("lib/axt_plant.c",),
        includes="-Ilib -include tests/proof/inlined.h",
        options=f"{INTERVALS} -warn-special-float none",
        justified={
            "impulse_low": "a lemma on rounding: low_words.gappa",
            "travel_low": "a lemma on rounding: low_words.gappa",
            "not_finite": "the sum that is compared is infinite or not a number, and such a number "
            "is not less or equal (IEEE 754); the analyser keeps both outcomes of a comparison "
            "with not-a-number. tests/unit/test_plant.c tries all three values",
        },
    ),
    Proof(
        what="RLS update",
        driver="rls.c",
        sources=("lib/axt_rls.c",),
        includes="-Ilib -include tests/proof/inlined.h",
        options=f"{INTERVALS} -warn-special-float non-finite",
        justified={
            "square": "share = (D f) f with D > 0, and rounding keeps signs; an interval does not "
            "see that both factors have the sign of f",
            "left": "alpha = before + share with before >= 1 and share >= 0; rounding is "
            "monotonic, so alpha >= before and the quotient is not above 1",
            "largest": "D (1 + (1 - lambda) (1 - x)) with x = D / limit does not pass the limit, "
            "as (1 - x) (1 - (1 - lambda) x) >= 0; and where growth is within a rounding of 0, D "
            "no longer changes",
            "positive": "left > 0, and growth is not negative below the limit",
        },
    ),
    Proof(
        what="contract codec",
        driver="contract.c",
        sources=("build/contract/axt_contract.c",),
        includes="-Ibuild/contract -Ibuild/proof",
        options="-eva-slevel 500",
    ),
    Proof(
        what="SLCAN codec",
        driver="slcan.c",
        sources=("drivers/can/axt_slcan.c", "drivers/can/axt_can.c"),
        includes="-Idrivers/can",
        options="-eva-slevel 5000 -eva-split-return auto -eva-split-limit 300 "
        "-eva-auto-loop-unroll 200",
    ),
)


def run(command: list[str]) -> str:
    """The standard output of a command that has to succeed."""
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise ProofError(f"{' '.join(command)}\n{(result.stdout + result.stderr)[-2000:]}")
    return result.stdout


def write_messages() -> None:
    """The messages of the generated codec as a macro, so that none is left out."""
    text = CONTRACT.read_text(encoding="utf-8")
    names = re.findall(r"^int axt_contract_(\w+)_unpack\($", text, re.MULTILINE)
    calls = " ".join(f"X({name}, {name.upper()})" for name in names)
    (BUILD / "messages.h").write_text(f"#define AXT_PROOF_MESSAGES(X) {calls}\n", encoding="utf-8")


def preconditions(driver: Path) -> str:
    """The paragraph of the driver's first comment that begins with "Precondition"."""
    comment = driver.read_text(encoding="utf-8").split("*/")[0]
    text = re.sub(r"^ \*? ?", "", comment, flags=re.MULTILINE)
    found = re.search(r"^Preconditions?: (.*?)(?:\n\s*\n|\Z)", text, re.MULTILINE | re.DOTALL)
    if found is None:
        raise ProofError(f"{driver} does not state its preconditions")
    return " ".join(found[1].split())


def named(row: dict[str, str]) -> str:
    """The name that the source gives an assertion (the report leaves it out), or what it says."""
    path = Path(row["directory"]) / row["file"]
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    name = re.search(r"@ assert (\w+):", lines[int(row["line"]) - 1]) if lines else None
    return name[1] if name else row["property"]


def unproven(report: Path) -> tuple[dict[str, str], list[str]]:
    """Where, by name, something is left without proof, and where an assertion is never reached."""
    alarms = {}
    dead = []
    with report.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines, delimiter="\t", quoting=csv.QUOTE_NONE):
            where = f"{row['file']}:{row['line']}: {row['property']}"
            if row["status"] not in ("Valid", "Considered valid", "Dead"):
                alarms[named(row)] = where
            elif row["status"] == "Dead" and row["property kind"] == "user assertion":
                dead.append(where)
    return alarms, dead


def prove(proof: Proof) -> tuple[Result, list[str]]:
    """Runs one driver. Returns the result and what is wrong with it."""
    start = time.monotonic()
    driver = HERE / proof.driver
    report = BUILD / f"{driver.stem}.csv"
    report.unlink(missing_ok=True)
    command = ["frama-c", "-machdep", "gcc_x86_64", f"-cpp-extra-args=-I{HERE} {proof.includes}"]
    command += ["-eva", "-eva-no-show-progress", *proof.options.split()]
    command += [str(driver), *proof.sources, "-then", "-report-csv", str(report)]
    output = run(command)
    seconds = time.monotonic() - start
    alarms, dead = unproven(report)
    source = "".join(Path(path).read_text(encoding="utf-8") for path in proof.sources)
    seen = re.findall(r"Values at end of function (\w+):", output)
    functions = sorted(name for name in seen if re.search(rf"\b{name}\(", source))
    wrong = [f"alarm: {where}" for name, where in alarms.items() if name not in proof.justified]
    wrong += [f"no longer raised: {name}" for name in proof.justified if name not in alarms]
    wrong += [f"never reached: {text}" for text in dead]
    return (
        Result(
            what=proof.what,
            functions=functions,
            preconditions=preconditions(driver),
            alarms=list(alarms.values()),
            justified=proof.justified,
            seconds=round(seconds, 1),
        ),
        wrong,
    )


def prove_lemmas() -> list[Result]:
    """Runs Gappa on every lemma; it fails where one cannot be proven."""
    results = []
    for path in sorted(HERE.glob("*.gappa")):
        start = time.monotonic()
        run(["gappa", str(path)])
        title = path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")
        seconds = round(time.monotonic() - start, 1)
        results.append(Result(f"lemma {path.stem}", [], title, [], {}, seconds))
    return results


def print_table(results: list[Result]) -> None:
    """What was proven, as a person reads it."""
    print(f"{'proven':<18}{'functions':>10}{'alarms':>8}{'justified':>11}{'seconds':>9}")
    for one in results:
        count = len(one.functions) or "-"
        print(
            f"{one.what:<18}{count:>10}{len(one.alarms):>8}{len(one.justified):>11}"
            f"{one.seconds:>9.1f}"
        )
    for one in results:
        print(f"\n{one.what}: {one.preconditions}")
        for name, reason in one.justified.items():
            print(f"  justified, {name}: {reason}")


def main() -> int:
    """Command line; 0 when everything is proven or justified, 1 otherwise."""
    output = Path(sys.argv[1])
    BUILD.mkdir(parents=True, exist_ok=True)
    write_messages()
    results = []
    wrong = []
    try:
        for proof in PROOFS:
            result, faults = prove(proof)
            results.append(result)
            wrong += [f"{proof.what}: {fault}" for fault in faults]
        results += prove_lemmas()
    except ProofError as error:
        print(f"proof: {error}", file=sys.stderr)
        return 1
    print_table(results)
    output.write_text(json.dumps([asdict(one) for one in results], indent=1) + "\n", "utf-8")
    for fault in wrong:
        print(f"proof: {fault}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
