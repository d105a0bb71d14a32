"""A hidden effect over a real CAN interface: recorded, named, flashed back, and measured again."""

from __future__ import annotations

from pathlib import Path

import pytest
from host import hidden_effect

from axistwin import model
from axistwin.model import Model

from .carriers import INTERFACE, OPTIONS, EmulatorCarrier
from .conftest import Host


@pytest.mark.needs(INTERFACE, OPTIONS)
def test_a_hidden_effect_is_named_and_flashed_back(
    carrier: EmulatorCarrier, host: Host, tmp_path: Path
) -> None:
    carrier.start(*hidden_effect.DRIVE)

    def trace(axis: Model, file: Path) -> None:
        """The drive that runs gets the axis over the bus."""
        model.write(axis, tmp_path / "flashed.toml")
        host("model", "send", str(tmp_path / "flashed.toml"), *carrier.host).expect(0)
        samples = ("-n", str(hidden_effect.SAMPLES))
        host("trace", *carrier.host, "--excite", *samples, "-f", str(file)).expect(0)

    hidden_effect.check(hidden_effect.draw(), trace, tmp_path)
