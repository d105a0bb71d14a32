"""The command line itself: its verbs, its messages, its exit status."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import axistwin
from axistwin.cli import main

REPOSITORY = Path(__file__).resolve().parent.parent.parent
EMULATOR = REPOSITORY / "build" / "axistwin-emulator"


def command(
    *arguments: str, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "axistwin", *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env={**os.environ, **environment},
    )


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"axistwin {axistwin.__version__}\n"


@pytest.mark.parametrize(
    "verb", ["log", "trace", "excite", "simulate", "compare", "identify", "diagnose", "demo"]
)
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    assert f"    {verb} " in capsys.readouterr().out
    with pytest.raises(SystemExit) as caught:
        main([verb, "--help"])
    assert caught.value.code == 0
    assert f"usage: axistwin {verb}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "the following arguments are required: VERB"),
        (["fly"], "invalid choice: 'fly'"),
        (["log", "--no-such-option"], "unrecognized arguments: --no-such-option"),
        (["log", "-i", "no-such-interface"], "invalid choice: 'no-such-interface'"),
        (["log", "--duration", "-1"], "--duration has to be a positive time"),
        (["log", "--node", "0"], "node 0: ids are 1 to 126"),
        (["log", "--node", "127"], "node 127: ids are 1 to 126"),
        (["log", "--wait", "-1"], "--wait has to be 0 or more seconds"),
        (["log", "--heartbeat-timeout", "0"], "--heartbeat-timeout has to be a positive time"),
        (["log", "--dbc", "nothing.dbc"], "cannot read nothing.dbc"),
        (["trace", "-f", "trace.odt"], "cannot write trace.odt: its ending is neither"),
        (["trace", "-n", "0"], "-n has to be 1 or more samples"),
        (["trace", "--settle", "nan"], "--settle has to be 0 or more seconds"),
        (["excite", "perhaps"], "invalid choice: 'perhaps'"),
        (["identify"], "the following arguments are required: RECORD"),
    ],
)
def test_a_wrong_command_line_gets_a_clear_message(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status: object
    try:
        status = main(arguments)
    except SystemExit as end:
        status = end.code
    assert status == 2
    said = capsys.readouterr()
    assert complaint in said.err
    assert said.out == ""


def test_emulate_becomes_the_emulator() -> None:
    done = command(
        "emulate",
        "--bus",
        "tcp:0",
        "--duration",
        "0.1",
        "--simulated",
        AXISTWIN_EMULATOR=str(EMULATOR),
    )
    assert done.returncode == 0
    assert done.stdout.startswith("axistwin-emulator: node 1 on tcp ")
    done = command("emulate", "--help", AXISTWIN_EMULATOR=str(EMULATOR))
    assert done.stdout.startswith("usage: axistwin-emulator")
    done = command("emulate", "--node", "1000", AXISTWIN_EMULATOR=str(EMULATOR))
    assert done.returncode == 2
    assert "axistwin-emulator: --node" in done.stderr


def test_the_emulator_is_found_in_the_build_folder_and_in_the_path(tmp_path: Path) -> None:
    done = command("emulate", "--version", cwd=REPOSITORY, AXISTWIN_EMULATOR="")
    assert done.returncode == 0
    done = command(
        "emulate", "--version", cwd=tmp_path, AXISTWIN_EMULATOR="", PATH=str(EMULATOR.parent)
    )
    assert done.returncode == 0
    done = command("emulate", cwd=tmp_path, AXISTWIN_EMULATOR="", PATH="")
    assert done.returncode == 2
    assert done.stderr.startswith("axistwin: no axistwin-emulator to be run")
    done = command("emulate", cwd=REPOSITORY, AXISTWIN_EMULATOR="/nowhere")
    assert done.returncode == 2
    assert "$AXISTWIN_EMULATOR is /nowhere" in done.stderr


def test_a_reader_that_has_had_enough_is_no_error() -> None:
    line = f"'{sys.executable}' -m axistwin identify --help | head -n 1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("\n0\n")
    assert done.stderr == ""
