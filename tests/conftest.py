"""What the host and the hardware-in-the-loop tests share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

# How long an example takes depends on what else the machine does: never a reason to fail. And a run
# tries what the last one tried, so that a failure can be repeated.
settings.register_profile("axistwin", deadline=None, derandomize=True)
settings.load_profile("axistwin")

# Where the measured records can be had, by the folder that they are kept in.
SOURCES = {
    "CAN_interop": "github.com/hardbyte/python-can (test/data), PyPI odrive-can, "
    "github.com/danielhrisca/asammdf (test)",
    "EMPS": "nonlinearbenchmark.org, EMPS (A. Janot, M. Gautier, M. Brunot, 2019)",
    "Kinova_Gen3_joints": "github.com/SedkiLmm/dynamic-identification (data/kinova)",
    "LAAS_cogging": "github.com/heitor-andrade/laas_anti_cogging (codes)",
    "ODrive_voltage_tests": "github.com/labmrd/odrive-with-motor-characterization",
    "UR5_joints": "github.com/SedkiLmm/dynamic-identification (data/ur5)",
}

Measured = Callable[[str], Path]


@pytest.fixture(scope="session")
def measured() -> Measured:
    """Finds a measured record, `measured("EMPS/DATA_EMPS.mat")`, in the folder AXISTWIN_DATA.

    A test whose record is not there is skipped, which the count at the end shows, and says where
    the record can be had.
    """
    repository = Path(__file__).resolve().parent.parent
    folder = Path(os.environ.get("AXISTWIN_DATA") or repository.parent / "shared" / "data")

    def find(name: str) -> Path:
        path = folder / name
        if not path.exists():
            source = SOURCES[name.split("/")[0]]
            pytest.skip(f"{path} is not there; set AXISTWIN_DATA; public source: {source}")
        return path

    return find
