"""Bytes of the estimator on each target: code, state, and stack of an update.

The estimator is recursive least squares with its guards, counters and both unrolled shapes, as the
public implementations are: what a program links that starts, updates and resets it. `text_rls`,
`text_ident` and `state_ident` are all of axt_rls, and all that identification takes besides.
"""

from __future__ import annotations

from size import BUILD, function_sizes
from size import TARGETS as SIZE_TARGETS
from size import measure as measure_size
from toolchain import core_flags

RLS = "axt_rls"
# Linked where they are called, and not in the interrupt: questions about the estimate.
QUESTIONS = ("axt_rls_covariance", "axt_rls_information", "axt_rls_invariants")
IDENT = (RLS, "axt_ident", "axt_filter", "axt_regressor", "axt_rows", "axt_scatter")
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
    tool, _ = SIZE_TARGETS[target]
    functions = function_sizes(tool, BUILD / f"{target}{SPEED}" / f"{RLS}.o")
    return {
        "text": sum(size for name, size in functions.items() if name not in QUESTIONS),
        "text_rls": fast.text[RLS],
        "text_ident": sum(fast.text[name] for name in IDENT),
        "text_ident_os": sum(small.text[name] for name in IDENT),
        "state": fast.state[RLS],
        "state_ident": fast.state["axt_ident"],
        "stack": max([fast.stack[name] for name in UPDATES] + [*stack_seen.values()]),
    }
