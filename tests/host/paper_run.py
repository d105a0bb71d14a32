"""One run of all studies of the paper, shared by the tests that look at what it leaves behind."""

from __future__ import annotations

import functools
import json
import tempfile
from pathlib import Path
from typing import Any, TypeAlias

from axistwin.paper import runner

Rows: TypeAlias = list[dict[str, Any]]

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"

_FOLDER = tempfile.TemporaryDirectory(prefix="axistwin-paper-")


@functools.cache
def results() -> Path:
    """The folder with the results of one whole run."""
    folder = Path(_FOLDER.name)
    runner.run(folder)
    return folder


@functools.cache
def tables() -> dict[str, Rows]:
    """tables.json: the paper's numbers beside ours."""
    found: dict[str, Rows] = json.loads((results() / "tables.json").read_text(encoding="utf-8"))
    return found


@functools.cache
def studies() -> dict[str, Rows]:
    """studies.json: our own tables."""
    found: dict[str, Rows] = json.loads((results() / "studies.json").read_text(encoding="utf-8"))
    return found


def value(study: str, row: str, column: str) -> float:
    """One number of studies.json."""
    (found,) = (v for v in studies()[study] if v["row"] == row and v["column"] == column)
    return float(found["value"])
