"""Plant to parameters over a real CAN interface."""

from __future__ import annotations

from pathlib import Path

import pytest

from axistwin import core
from axistwin.identify import identify
from axistwin.readers import read_record

from .conftest import Carrier, Host, StartEmulator


def test_the_axis_is_identified_from_a_trace(
    vcan: Carrier, start_emulator: StartEmulator, host: Host, tmp_path: Path
) -> None:
    """Positions of 2^20 counts a turn and torque of 0.2 N m rms, nothing else."""
    start_emulator(vcan, "--period", "1.0761e-4", "--excitation", "2048,292,0.2")
    trace = tmp_path / "trace.csv"
    host("trace", *vcan.host, "--excite", "-n", "2048", "-f", str(trace)).expect(0)
    found = identify(read_record(trace)).estimate.quantities
    axis = core.paper_axis()
    for name, tolerance in (("I1", 2e-3), ("I2", 2e-3), ("B", 2e-2), ("K", 2e-3)):
        assert found[name].value == pytest.approx(getattr(axis, name), rel=tolerance)
