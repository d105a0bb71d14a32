"""A hidden effect over SLCAN: the drive is a process of its own, the host knows only its frames."""

from __future__ import annotations

from pathlib import Path

from axistwin.model import Model

from . import hidden_effect
from .drive_process import axistwin, run, running_drive


def test_a_hidden_effect_is_named_and_flashed_back(tmp_path: Path) -> None:
    def trace(axis: Model, file: Path) -> None:
        line = tmp_path / "line"
        options = (*hidden_effect.DRIVE, "--excite", "--simulated", *axis.emulator_options())
        with running_drive(line, *options):
            samples = ("-n", str(hidden_effect.SAMPLES))
            ran = run(axistwin("trace", line, file, *samples))
            assert ran.returncode == 0, ran.stderr

    hidden_effect.check(hidden_effect.draw(), trace, tmp_path)
