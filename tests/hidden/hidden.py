"""Effects hidden in records, and whether axistwin finds them.

    hidden.py run [--count N] [--seed SEED] [--output FILE.json] [--figure FILE.png]

diagnoses N records that have never been seen before, in two processes, and writes the score and
every case. The seeds are SEED, SEED + 1, ...; without one a new SEED is drawn, and printed. A run
that was interrupted goes on where it was when it is given its SEED and axistwin is as it was.

    hidden.py write FOLDER FIRST COUNT [--kind KIND] [--effect EFFECT] [--least THRESHOLDS]

writes FOLDER/SEED.csv, a record, and FOLDER/SEED.json, the truth, for COUNT seeds from FIRST on.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import secrets
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cases import KINDS, SIZES, Case, draw
from catalogue import DRAWERS
from confusion import draw_confusion
from score import Score, judge, score

import axistwin
from axistwin.diagnose import diagnose
from axistwin.readers import read_record

#: The targets are for effects of this size or more [thresholds].
LEAST = 3.0

_WORKERS = 2


def truth_of(case: Case) -> dict[str, Any]:
    """What is hidden in a case, and what it is made of, for JSON."""
    setting = case.setting
    axis = {name: getattr(setting.truth, name) for name in ("I1", "I2", "B", "K")}
    return {
        "seed": case.seed,
        "kind": case.kind,
        "hidden": [
            {**asdict(effect), "thresholds": size}
            for effect, size in zip(case.hidden, case.sizes, strict=True)
        ],
        "axis": axis,
        "time_step": setting.time_step,
        "samples": len(setting.feed),
        "excitation": setting.excitation,
        "noise": setting.noise,
    }


def examine(case: Case) -> dict[str, Any]:
    """The truth of a case and the answer to its record, which is all that the diagnosis is given.

    Whatever it raises is no answer, and is kept as the error.
    """
    truth = truth_of(case)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        case.write(path)
        start = time.monotonic()
        try:
            answer = diagnose(read_record(path)).to_json()
        except Exception as error:  # a crash is a wrong answer, not the end of the run
            return {"truth": truth, "error": f"{type(error).__name__}: {error}"}
    return {"truth": truth, "answer": answer, "seconds": time.monotonic() - start}


def examine_seed(seed: int) -> dict[str, Any]:
    """examine() of the case of a seed."""
    return examine(draw(seed))


def _fingerprint() -> str:
    """Of the installed axistwin: results of another one are not mixed in."""
    folder = Path(axistwin.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.suffix in (".py", ".so")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _results(seeds: Sequence[int], kept: Path) -> Iterator[dict[str, Any]]:
    """The result of every seed; new ones are added to the file `kept`."""
    missing = set(seeds)
    if kept.exists():
        for line in kept.read_text(encoding="ascii").splitlines():
            result = json.loads(line)
            if result["truth"]["seed"] in missing:
                missing.remove(result["truth"]["seed"])
                yield result
    kept.parent.mkdir(parents=True, exist_ok=True)
    with kept.open("a", encoding="ascii") as file, ProcessPoolExecutor(_WORKERS) as pool:
        for future in as_completed([pool.submit(examine_seed, seed) for seed in sorted(missing)]):
            result = future.result()
            file.write(json.dumps(result) + "\n")
            file.flush()
            yield result


def run(seed: int, count: int, folder: Path) -> list[dict[str, Any]]:
    """Diagnoses the cases of `count` seeds, with progress on standard error, in order of seeds."""
    results = []
    kept = folder / f"{seed}-{_fingerprint()}.jsonl"
    wrong = 0
    for result in _results(range(seed, seed + count), kept):
        results.append(result)
        wrong += "answer" not in result or not judge(result["truth"], result["answer"]).right
        if len(results) % 10 == 0 or len(results) == count:
            print(f"{len(results)} of {count} records, {wrong} answers wrong", file=sys.stderr)
    return sorted(results, key=lambda result: int(result["truth"]["seed"]))


def _case(result: Mapping[str, Any]) -> dict[str, Any]:
    """A result as it is published: with the verdict, without what can be had from the seed."""
    if "answer" not in result:
        return {**result, "right": False}
    answer = result["answer"]
    verdict = judge(result["truth"], answer)
    said = {key: answer[key] for key in ("findings", "unexplained", "error")}
    return {**result, "answer": said, **asdict(verdict)}


def _print(total: Score) -> None:
    for name, target in (
        ("single_right", ">= 97 %"),
        ("pair_right", ">= 90 %"),
        ("clean_right", ">= 99 %"),
        ("unknown_right", ">= 90 %"),
        ("coverage95", "90 .. 98 %"),
        ("floor_reached", "100 %"),
    ):
        share = getattr(total, name)
        of = total.counts.get(name.removesuffix("_right"))
        text = "none" if share is None else f"{100 * share:.1f} %"
        print(f"{name:<14} {text:>8}   target {target}" + (f"   of {of}" if of is not None else ""))


def _run(arguments: argparse.Namespace) -> None:
    seed = secrets.randbelow(2**40) if arguments.seed is None else arguments.seed
    print(f"SEED={seed}", flush=True)
    output: Path = arguments.output
    results = run(seed, arguments.count, output.parent / "hidden")
    total = score(results, LEAST)
    _print(total)
    document = {
        **asdict(total),
        "seed": seed,
        "all_sizes": asdict(score(results, 0.0)),
        "cases": [_case(result) for result in results],
    }
    output.write_text(json.dumps(document, indent=1) + "\n", encoding="ascii")
    draw_confusion([r for r in results if _is_large(r["truth"])], arguments.figure)
    print(f"{output}, {arguments.figure}")


def _is_large(truth: Mapping[str, Any]) -> bool:
    return all(effect["thresholds"] >= LEAST for effect in truth["hidden"])


def _write(arguments: argparse.Namespace) -> None:
    folder: Path = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(arguments.first, arguments.first + arguments.count):
        case = draw(seed, kind=arguments.kind, effect=arguments.effect, least=arguments.least)
        case.write(folder / f"{seed}.csv")
        truth = json.dumps(truth_of(case), indent=1)
        (folder / f"{seed}.json").write_text(truth + "\n", encoding="ascii")
        print(f"{seed}: {case.kind}", *(f"{e.effect} at {e.location}" for e in case.hidden))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="effects hidden in records, to be found")
    verbs = parser.add_subparsers(required=True)
    runs = verbs.add_parser("run", help="diagnose records and score the answers")
    runs.add_argument("--count", type=int, default=500)
    runs.add_argument("--seed", type=int)
    runs.add_argument("--output", type=Path, default=Path("build/hidden.json"))
    runs.add_argument("--figure", type=Path, default=Path("build/hidden-confusion.png"))
    runs.set_defaults(run=_run)
    write = verbs.add_parser("write", help="write records and their truths")
    write.add_argument("folder", type=Path)
    write.add_argument("first", type=int)
    write.add_argument("count", type=int)
    write.add_argument("--kind", choices=list(KINDS))
    write.add_argument("--effect", choices=[*DRAWERS, "quantisation", "sample_loss"])
    write.add_argument("--least", type=float, default=SIZES[0], help="least size in thresholds")
    write.set_defaults(run=_write)
    arguments = parser.parse_args()
    arguments.run(arguments)
    return 0


if __name__ == "__main__":
    sys.exit(main())
