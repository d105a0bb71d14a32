"""What the estimator survives: the cases of survival.c, two at a time."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from toolchain import BENCH, HOST, build, run

TIME_LIMIT = 1800.0  # [s] of one case


def program() -> Path:
    """Compiles the cases for the host."""
    return build(HOST, "survival", [BENCH / "drive.c", BENCH / "survival.c"], [])


def cases(survival: Path) -> list[str]:
    """Names of all cases."""
    return run([str(survival)]).split()


def figure(text: str) -> float | None:
    """A number as JSON can hold it; None for infinite and not-a-number."""
    number = float(text)
    return number if abs(number) < float("inf") else None


def run_case(survival: Path, case: str) -> dict[str, float | bool | None]:
    """Steps, error, finite and the case's own figures."""
    lines = run([str(survival), case], TIME_LIMIT).splitlines()
    measured: dict[str, float | bool | None] = {}
    for name, text in (line.split() for line in lines):
        measured[name] = figure(text)
    return {**measured, "steps": int(measured["steps"] or 0), "finite": measured["finite"] == 1}


def measure(survival: Path, names: list[str]) -> dict[str, dict[str, float | bool | None]]:
    """Runs these cases. The long ones are last in survival.c and start first."""
    with ThreadPoolExecutor(max_workers=2) as pool:
        results = {name: pool.submit(run_case, survival, name) for name in reversed(names)}
    return {name: results[name].result() for name in names}
