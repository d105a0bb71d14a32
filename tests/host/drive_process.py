"""An emulated drive on a pseudo-terminal, and the command line against it."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from axistwin.cli import main

REPOSITORY = Path(__file__).resolve().parent.parent.parent
EMULATOR = os.environ.get("AXISTWIN_EMULATOR") or str(REPOSITORY / "build" / "axistwin-emulator")

# A process may have to wait for its turn on a busy machine longer than a drive would.
PATIENCE = ("--heartbeat-timeout", "3")


@contextmanager
def running_drive(line: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A drive that can be reached by this line; at the end it has to be there still."""
    command = [EMULATOR, "--bus", f"pty:{line}", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "node 1 on" in process.stdout.readline()
        yield process
        assert process.poll() is None
        process.terminate()
        process.communicate(timeout=30)


def axistwin(verb: str, line: Path, file: Path, *arguments: str) -> list[str]:
    """The command line of a verb that writes a file, for a process of its own."""
    bus = ("-i", "slcan", "-c", str(line), *PATIENCE)
    return [sys.executable, "-m", "axistwin", verb, *bus, "-f", str(file), *arguments]


@dataclass(frozen=True)
class Outcome:
    """What a command said on standard error, and its exit status."""

    returncode: int
    stderr: str


def run(command: list[str]) -> Outcome:
    """Runs a command line of axistwin() to its end, in this process: that is quicker."""
    said = io.StringIO()
    with redirect_stderr(said), redirect_stdout(io.StringIO()):
        try:
            status = main(command[3:])
        except SystemExit as end:  # argparse's
            status = end.code if isinstance(end.code, int) else 1
    assert "Traceback" not in said.getvalue()
    return Outcome(status, said.getvalue())
