"""Plant to parameters over a real CAN interface."""

from __future__ import annotations

from pathlib import Path

import pytest

from axistwin import core
from axistwin.identify import identify
from axistwin.readers import read_record

from .carriers import Carrier
from .conftest import Host


def test_the_axis_is_identified_from_a_trace(carrier: Carrier, host: Host, tmp_path: Path) -> None:
    """Positions of 2^20 counts a turn and torque of 0.2 N m rms, nothing else."""
    carrier.start()
    trace = tmp_path / "trace.csv"
    excitation = ("--excite", "--length", "2048", "--lines", "272", "--rms", "0.2")
    host("trace", *carrier.host, *excitation, "-n", "2048", "-f", str(trace)).expect(0)
    found = identify(read_record(trace)).estimate.quantities
    axis = core.paper_axis()
    for name, tolerance in (("I1", 2e-3), ("I2", 2e-3), ("B", 2e-2), ("K", 2e-3)):
        assert found[name].value == pytest.approx(getattr(axis, name), rel=tolerance)
