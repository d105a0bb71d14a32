"""Bytes of the estimator on each target: code, state, and stack of an update."""

from __future__ import annotations

from size import measure as measure_size
from toolchain import core_flags

ESTIMATOR = ("axt_rls", "axt_ident", "axt_filter", "axt_regressor", "axt_rows")
UPDATES = ("axt_ident_counts", "axt_ident_motion")
SPEED = "-O2"  # what the instructions are counted with
SIZE = "-Os"


def measure(target: str, stack_seen: dict[str, int]) -> dict[str, int]:
    """Figures of one target.

    `stack` is the deepest path of calls by the compiler's call graph, or what the running program
    was seen to use (`stack_seen`, bytes by function; empty on the host) where that is more: the
    call graph does not know the compiler's own soft-float routines.
    """
    fast = measure_size(target, SPEED, core_flags())
    small = measure_size(target, SIZE, core_flags())
    return {
        "text": sum(fast.text[name] for name in ESTIMATOR),
        "text_os": sum(small.text[name] for name in ESTIMATOR),
        "state": fast.state["axt_ident"],
        "state_rls": fast.state["axt_rls"],
        "stack": max([fast.stack[name] for name in UPDATES] + [*stack_seen.values()]),
    }
