"""Writing files so that nothing half written is ever found under a result's name."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from axistwin.errors import FileError


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Gives a temporary path with the same ending; it takes the name ``path`` when all went well.

    Raises FileError when the file cannot be written; what stood under ``path`` is then still there.
    """
    target = Path(path)
    try:
        with tempfile.TemporaryDirectory(prefix=".axistwin-", dir=target.parent) as folder:
            partial = Path(folder) / target.name
            yield partial
            partial.replace(target)
    except OSError as error:
        raise FileError(f"cannot write {target}: {error.strerror or error}") from error


def write_json(path: str, value: Any) -> None:
    """Writes a result as JSON; ``-`` is the standard output. Raises FileError."""
    text = json.dumps(value, indent=2, allow_nan=False) + "\n"
    if path == "-":
        sys.stdout.write(text)
        return
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8")
