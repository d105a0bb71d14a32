"""The firmware on emulated boards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from board import IMAGE

from .rig import Rig

Start = Callable[..., Rig]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts a board; it ends with the test."""
    with ExitStack() as stack:

        def begin(image: str = IMAGE, icount: str | None = None) -> Rig:
            rig = Rig(tmp_path, image, icount)
            stack.callback(rig.close)
            rig.reset()
            return rig

        yield begin
