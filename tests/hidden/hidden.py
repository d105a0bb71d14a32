"""Records with hidden effects, and what is hidden in each.

    hidden.py write FOLDER FIRST COUNT [--kind KIND] [--effect EFFECT] [--least THRESHOLDS]

writes FOLDER/SEED.csv, a record, and FOLDER/SEED.json, the truth, for COUNT seeds from FIRST on.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cases import KINDS, SIZES, Case, draw
from catalogue import DRAWERS


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
    parser = argparse.ArgumentParser(description="records with hidden effects")
    verbs = parser.add_subparsers(required=True)
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
