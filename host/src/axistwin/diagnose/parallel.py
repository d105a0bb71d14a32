"""Independent work on all cores, which numpy and the core of the simulation share among threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")
Result = TypeVar("Result")


def each(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """What a function makes of each item, in their order. Raises what the first of them raises."""

    def run(item: Item) -> Result:
        with quiet():  # numpy knows of it in its own thread only
            return function(item)

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(threads.map(run, items))


def quiet() -> np.errstate:
    """No warnings of numbers too large: a simulation that runs away is looked for where it ends."""
    return np.errstate(over="ignore", invalid="ignore")
