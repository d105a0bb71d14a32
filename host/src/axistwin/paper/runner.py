"""Runs the studies of the paper: `make paper`."""

from __future__ import annotations

import argparse
import importlib
import multiprocessing
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from axistwin.errors import AxisTwinError
from axistwin.paper import docs
from axistwin.paper.report import Report
from axistwin.paper.style import use_style

#: Modules of this package with a function run(report), those that take longest first.
STUDIES = (
    "noise",
    "excitations",
    "torque",
    "figures",
    "tables",
    "integrators",
    "estimators",
    "errata",
)


def run_study(name: str, folder: Path) -> Report:
    """Runs one study; its figures are written to ``folder``, its tables come back."""
    use_style()
    report = Report(folder)
    start = time.monotonic()
    report.progress(f"{name} ...")
    importlib.import_module(f"axistwin.paper.{name}").run(report)
    report.progress(f"{name} took {time.monotonic() - start:.1f} s")
    return report


def run(folder: Path, studies: Sequence[str] = STUDIES, workers: int = 2) -> Report:
    """Runs studies side by side in processes and writes all they find to ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    # the fits are small: threads beside processes cost ten times what they gain
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    report = Report(folder)
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        for found in pool.map(run_study, studies, [folder] * len(studies)):
            report.add(found)
    report.write()
    return report


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `python -m axistwin.paper`."""
    parser = argparse.ArgumentParser(prog="python -m axistwin.paper", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/paper"), metavar="DIR")
    parser.add_argument("--docs", type=Path, metavar="DIR", help="bring this folder up to date")
    parser.add_argument("--only", nargs="+", choices=STUDIES, default=STUDIES, metavar="STUDY")
    options = parser.parse_args(arguments)
    try:
        run(options.output, options.only)
        if options.docs:
            docs.update(options.docs, options.output)
    except AxisTwinError as error:
        print(f"axistwin.paper: {error}", file=sys.stderr)
        return error.exit_code
    return 0
