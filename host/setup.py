"""Adds to pyproject.toml what it cannot say: the compiled core and the copied wire contract."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

HERE = Path(__file__).resolve().parent
CONTRACT = HERE.parent / "drivers" / "contract"
CONTRACT_FILES = ("axistwin.dbc", "registers.csv")


class BuildCore(build_ext):
    """Compiles the core, whose sources lie outside of this folder."""

    def get_source_files(self) -> list[str]:
        """None for the manifest, which takes only what lies in this folder."""
        return []


class BuildWithContract(build_py):
    """Puts the wire contract, whose one source is drivers/contract, into the package."""

    def run(self) -> None:
        """Copies after everything else has been built."""
        super().run()
        root = HERE / "src" if self.editable_mode else Path(self.build_lib)
        for name in CONTRACT_FILES:
            if not (CONTRACT / name).exists():
                sys.exit(
                    f"axistwin: the wire contract {CONTRACT / name} is missing; "
                    "install from a checkout of the whole repository: pip install ./host"
                )
            shutil.copyfile(CONTRACT / name, root / "axistwin" / name)


setup(
    cffi_modules=["build_core.py:core32", "build_core.py:core64"],
    cmdclass={"build_ext": BuildCore, "build_py": BuildWithContract},
)
