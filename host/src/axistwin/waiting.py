"""Waiting for a node that does not answer yet."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from axistwin.errors import BusError, ContractError

Answer = TypeVar("Answer")

#: Says one line to the user.
Tell = Callable[[str], None]

# Tries are this far apart at the most [s].
_PAUSE = 0.1


def until_answered(
    attempt: Callable[[float], Answer], close: Callable[[], None], wait: float, tell: Tell
) -> Answer:
    """The answer of the first attempt that has one, within ``wait`` [s].

    ``attempt`` is given the time by ``time.monotonic()`` at which it has to be over; after each
    that fails ``close`` takes back what it opened. ``tell`` says once what is waited for. Raises
    the BusError of the last attempt; ContractError at once, as waiting changes no contract.
    """
    deadline = time.monotonic() + wait
    told = False
    while True:
        try:
            return attempt(deadline)
        except ContractError:
            raise
        except BusError as error:
            close()
            if time.monotonic() >= deadline:
                raise
            if not told:
                tell(f"{error}; waiting up to {wait:g} s for it")
                told = True
            time.sleep(min(_PAUSE, max(0.0, deadline - time.monotonic())))
