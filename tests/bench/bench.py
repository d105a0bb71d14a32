"""The bench: what the core costs and what it survives, beside what was asked of it.

    bench.py [PART ...]

Without PART everything is measured and build/bench.json written (a few minutes, or half an hour
where vcan needs an emulated machine). A PART measures only that and takes the place of what
build/bench.json had of it: `instructions`, `bytes`, `survival`, `host`, `simulation`, `diagnosis`,
`bus`, or one of their members, such as `instructions.cortex-m4f` or `bus.modbus`.
`bus.ten_minutes`, a full bus for that long, is measured only when it is named.

Instructions are counted one call at a time: `mean` is over normal running, `max` over everything
that can happen, standing still and samples that are not numbers included. The exit status is 1 when
something could not be measured; what was measured and misses its target is marked in the tables.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bus
import diagnosis
import footprint
import instructions
import modbus
import simulation
import speed
import survival
from toolchain import BOARDS, HOST, TARGETS, BenchError, run

OUTPUT = Path("build/bench.json")
PARTS = ("instructions", "bytes", "survival", "host", "simulation", "diagnosis", "bus")

Figures = dict[str, Any]


@dataclass(frozen=True)
class Limit:
    """What is asked of a figure: at most this."""

    path: tuple[str, ...]
    most: float


M4F = ("instructions", "cortex-m4f")
SPREAD = 0.2
LIMITS = [
    Limit((*M4F, "rls_5x4", "max"), 300),
    Limit((*M4F, "rls_3x2", "max"), 130),
    Limit((*M4F, "plant_ideal", "max"), 60),
    Limit((*M4F, "control_tick", "max"), 600),
    *(
        Limit((*M4F, what, "spread"), SPREAD)
        for what in ("rls_5x4", "rls_3x2", "plant_ideal", "control_tick")
    ),
    Limit(("bytes", "cortex-m4f", "text"), 2048),
    Limit(("bytes", "cortex-m4f", "state"), 256),
    Limit(("bytes", "cortex-m4f", "stack"), 256),
    Limit(("survival", "collinear_raw", "error"), 5e-3),
    Limit(("survival", "collinear_made_up", "error"), 5e-3),
    Limit(("survival", "collinear_axis_3x2", "error"), 1e-5),
    Limit(("survival", "collinear_axis_5x4", "error"), 1e-5),
    Limit(("diagnosis", "axistwin", "seconds_for_60_s"), 20),
    *(
        Limit(("bus", stream, what), 0)
        for stream in ("full_bus", "ten_minutes", "fd")
        for what in ("lost", "lost_by_node")
    ),
]

# Public C implementations of recursive least squares, float32, Cortex-M4F at -O2, measured by us:
# outputs, instructions a step, parameters after 1e6 steps of standstill with lambda 0.995, error
# with regressors collinear to 1e-4.
PUBLIC = (
    ("CControl recursive", 1, 2104, "NaN", "NaN"),
    ("PX4 ArxRls", 1, 2993, "NaN", "NaN"),
    ("RLSFilter (Eigen)", 1, 1464, "NaN", "2.7e7"),
    ("numerical-toolbox RecursiveLeastSquares", 1, 924, "NaN", "4e5"),
    ("indiflight rlsParallelNewSample", 4, 1406, "finite, 0.63 transient", "NaN"),
    ("libinertial kalman_udu_scalar (UD)", 1, 675, "NaN", "5e-3"),
    ("rombrew/lse (Givens)", 4, 1408, "forgets everything", "9e-3"),
)
PUBLIC_COLUMNS = ("name", "outputs", "instructions", "standstill", "collinear")


class Selection:
    """Which parts the command line asks for; all when it names none."""

    def __init__(self, parts: list[str]) -> None:
        for part in parts:
            if part.split(".")[0] not in PARTS:
                raise BenchError(f"no part {part}; there are {', '.join(PARTS)}")
        self.parts = parts
        self.taken: set[str] = set()

    def wants(self, *path: str) -> bool:
        """Whether this member, or one inside it, is to be measured."""
        name = ".".join(path)
        for part in self.parts:
            if f"{name}.".startswith(f"{part}."):
                self.taken.add(part)
                return True
        return not self.parts

    def wants_inside(self, name: str) -> bool:
        """Whether any member of this part is to be measured."""
        return not self.parts or any(part.split(".")[0] == name for part in self.parts)

    def check_all_taken(self) -> None:
        """Raises BenchError when the command line named something that does not exist."""
        if unknown := sorted(set(self.parts) - self.taken):
            raise BenchError(f"nothing is called {', '.join(unknown)}")


def measure_targets(selection: Selection) -> Iterator[tuple[str, str, Figures]]:
    """Instructions and bytes: part, target, figures."""
    for target in TARGETS:
        count, weigh = (selection.wants(part, target) for part in ("instructions", "bytes"))
        if not count and not weigh:
            continue
        measured = instructions.measure(target)
        if count:
            yield "instructions", target, measured.instructions
        if weigh:
            on_update = {name: measured.stack.get(name, 0) for name in footprint.UPDATES}
            yield "bytes", target, footprint.measure(target, on_update)


def measure(selection: Selection) -> Figures:
    """Everything that was asked for, as bench.json holds it."""
    figures: Figures = {}
    for part, target, values in measure_targets(selection):
        figures.setdefault(part, {})[target] = values
    if selection.wants_inside("host"):
        core = speed.library()
        wanted = [what for what in speed.PEERS if selection.wants("host", what)]
        figures["host"] = {what: speed.compare(core, what) for what in wanted}
        figures["nanoseconds"] = {HOST: speed.step_times(core)}
    for part, members, one in (
        ("simulation", simulation.WAYS, simulation.measure),
        ("diagnosis", diagnosis.FINDERS, diagnosis.measure),
    ):
        chosen = [member for member in members if selection.wants(part, member)]
        if chosen:
            figures[part] = {member: one(member) for member in chosen}
    if selection.wants_inside("survival"):
        program = survival.program()
        wanted = [case for case in survival.cases(program) if selection.wants("survival", case)]
        figures["survival"] = survival.measure(program, wanted)
    if selection.wants_inside("bus"):
        wanted = [member for member in bus.MEMBERS if selection.wants("bus", member)]
        named = [member for member in wanted if f"bus.{member}" in selection.parts]
        figures["bus"] = bus.measure([m for m in wanted if m not in bus.ON_DEMAND or m in named])
    if selection.wants("bus", "modbus"):
        figures.setdefault("bus", {})["modbus"] = modbus.measure()
    selection.check_all_taken()
    return figures


def survival_limits(figures: Figures) -> list[Limit]:
    """What is asked of every case, and of standing still.

    Unmoved: by no more than the error there was before. Converged again: to within twice that.
    Float32 itself is off by 1e-6.
    """
    limits = []
    for case, values in figures.get("survival", {}).items():
        if "error_before" in values and values["error_before"] is not None:
            before = max(values["error_before"], 1e-6)
            limits.append(Limit(("survival", case, "moved"), before))
            limits.append(Limit(("survival", case, "error"), 2 * before))
            limits.append(Limit(("survival", case, "variance_to_prior"), 1.0 + 1e-6))
    return limits


def lookup(figures: Figures, path: tuple[str, ...]) -> Any:
    """The figure at a path; KeyError when it was not measured."""
    value: Any = figures
    for name in path:
        value = value[name]
    return value


class Judgement:
    """Figures against limits."""

    def __init__(self, figures: Figures) -> None:
        self.limits = {limit.path: limit.most for limit in [*LIMITS, *survival_limits(figures)]}
        self.judged: dict[str, dict[str, Any]] = {}
        for path, most in self.limits.items():
            try:
                value = lookup(figures, path)
            except KeyError:
                continue
            met = value is not None and value <= most
            self.judged[".".join(path)] = {"value": value, "most": most, "met": met}
        for case, values in figures.get("survival", {}).items():
            path_of_case = f"survival.{case}.finite"
            self.judged[path_of_case] = {
                "value": values["finite"],
                "most": None,
                "met": values["finite"],
            }

    def missed(self) -> list[str]:
        """Paths of the figures that miss."""
        return [path for path, one in self.judged.items() if not one["met"]]

    def mark(self, *path: str) -> str:
        """The limit of a figure and whether it is met; empty without one."""
        one = self.judged.get(".".join(path))
        if one is None or one["most"] is None:
            return ""
        return f"<= {one['most']:.4g}{'' if one['met'] else '  MISSED'}"


def print_instructions(figures: Figures, judgement: Judgement) -> None:
    """One table a target."""
    for target, values in figures.items():
        where = (
            f"QEMU {BOARDS[target].machine}, {BOARDS[target].processor}"
            if target in BOARDS
            else "callgrind"
        )
        print(f"\ninstructions, {target} ({where})")
        print(f"  {'':<20}{'mean':>10}{'max':>8}{'spread':>8}  asked of max")
        for what, one in sorted(values.items()):
            path = ("instructions", target, what)
            spread = judgement.mark(*path, "spread")
            print(
                f"  {what:<20}{one['mean']:>10.1f}{one['max']:>8}{100 * one['spread']:>7.1f}%"
                f"  {judgement.mark(*path, 'max')}"
                f"{'  SPREAD MISSED' if 'MISSED' in spread else ''}"
            )


def print_bytes(figures: Figures, judgement: Judgement) -> None:
    """One column a target."""
    print(f"\n{'bytes of the estimator':<24}" + "".join(f"{target:>16}" for target in figures))
    for what in next(iter(figures.values())):
        row = "".join(f"{values[what]:>16}" for values in figures.values())
        print(f"  {what:<22}{row}  {judgement.mark('bytes', 'cortex-m4f', what)}")


def print_survival(figures: Figures, judgement: Judgement) -> None:
    """One line a figure of a case."""
    print("\nsurvival, float32")
    for case, values in figures.items():
        finite = "finite" if values["finite"] else "NOT FINITE  MISSED"
        print(f"  {case:<24}{values['steps']:>14,.0f} steps, {finite}")
        for name, value in values.items():
            if name not in ("steps", "finite"):
                shown = "none" if value is None else f"{value:.2g}"
                print(f"    {name:<22}{shown:>14}  {judgement.mark('survival', case, name)}")


def print_host(figures: Figures) -> None:
    """One line a peer."""
    print(f"\n{'time a step, this machine':<58}{'ours':>10}{'theirs':>12}{'ratio':>8}")
    for what, one in figures.items():
        print(
            f"  {what:<18}{one['peer_name']:<38}{one['ours']:>7.1f} ns{one['peer']:>9.0f} ns"
            f"{one['ratio']:>8.1f}"
        )


def print_simulation(figures: Figures) -> None:
    """One line a way."""
    print(f"\n{'5 s of a worn axis':<32}{'seconds':>10}{'error of twist':>16}{'of theta1':>12}")
    for way, one in figures.items():
        print(
            f"  {way:<30}{one['seconds']:>10.4f}{one['twist_error']:>16.2g}"
            f"{one['theta1_error']:>8.1g} rad"
        )


def print_diagnosis(figures: Figures, judgement: Judgement) -> None:
    """One line a finder."""
    print("\ndry friction at the table, 30 s to learn from, the rest unseen")
    print(
        f"  {'':<18}{'seconds':>8}{'named':>7}{'its error':>11}{'terms too many':>16}{'unseen':>9}"
    )
    for finder, one in figures.items():
        error = f"{100.0 * one['torque_error']:.1f} %" if "torque_error" in one else "-"
        extra = "-" if one["terms_too_many"] is None else str(one["terms_too_many"])
        print(
            f"  {finder:<18}{one['seconds']:>8.1f}{'yes' if one['named'] else 'no':>7}{error:>11}"
            f"{extra:>16}{one['unseen_error']:>9.2g}"
        )
    if "axistwin" in figures:
        whole = figures["axistwin"]["seconds_for_60_s"]
        limit = judgement.mark("diagnosis", "axistwin", "seconds_for_60_s")
        print(f"  all 60 s, 1 kHz, two encoders, whole catalogue: {whole:.1f} s  {limit}")


def print_bus(figures: Figures, judgement: Judgement) -> None:
    """One line a figure; histograms are for the file."""
    print("\nbus (vcan; seconds are those of the machine that has it)")
    for member, values in figures.items():
        for name, value in values.items():
            if isinstance(value, dict):
                shown = ", ".join(f"{k} {v:.6g}" for k, v in value.items() if k != "histogram")
            else:
                shown = f"{value:.6g}  {judgement.mark('bus', member, name)}"
            print(f"  {member:<12}{name:<24}{shown}")


def print_public() -> None:
    """The implementations to compare with."""
    print("\npublic C implementations of RLS, float32, Cortex-M4F at -O2")
    print(f"  {'':<42}{'outputs':>7}{'instr':>7}  {'standstill 1e6':<24}collinear 1e-4")
    for name, outputs, count, standstill, collinear in PUBLIC:
        print(f"  {name:<42}{outputs:>7}{count:>7}  {standstill:<24}{collinear}")


def print_all(figures: Figures, judgement: Judgement) -> None:
    """Everything that was measured, as a person reads it."""
    if "instructions" in figures:
        print_instructions(figures["instructions"], judgement)
        print_public()
    if "bytes" in figures:
        print_bytes(figures["bytes"], judgement)
    if "nanoseconds" in figures:
        print("\nnanoseconds a step, this machine, the core's own loops")
        for what, value in figures["nanoseconds"][HOST].items():
            print(f"  {what:<20}{value:>8.1f}")
    if figures.get("host"):
        print_host(figures["host"])
    if "simulation" in figures:
        print_simulation(figures["simulation"])
    if "diagnosis" in figures:
        print_diagnosis(figures["diagnosis"], judgement)
    if "survival" in figures:
        print_survival(figures["survival"], judgement)
    if "bus" in figures:
        print_bus(figures["bus"], judgement)
    missed = judgement.missed()
    print(f"\n{len(judgement.judged) - len(missed)} of {len(judgement.judged)} targets met")
    for path in missed:
        print(f"  missed: {path}")


def merge(known: Figures, measured: Figures) -> Figures:
    """What was known, with what has been measured in place of the same members."""
    parts = {part: {**known.get(part, {}), **members} for part, members in measured.items()}
    return {**known, **parts}


def tools() -> dict[str, str]:
    """Versions of what the figures depend on."""
    commands = ("arm-none-eabi-gcc", "gcc", "qemu-system-arm", "valgrind")
    return {command: run([command, "--version"]).splitlines()[0] for command in commands}


def main() -> int:
    """Command line; 0 when everything asked for was measured, 1 otherwise, 2 usage."""
    arguments = sys.argv[1:]
    if any(argument.startswith("-") for argument in arguments):
        print(__doc__)
        return 0 if arguments in (["-h"], ["--help"]) else 2
    try:
        figures = measure(Selection(arguments))
        judgement = Judgement(figures)
        print_all(figures, judgement)
        known = json.loads(OUTPUT.read_text()) if arguments and OUTPUT.exists() else {}
        merged = merge(known, figures)
        everything = {
            **merged,
            "targets": Judgement(merged).judged,
            "public": [dict(zip(PUBLIC_COLUMNS, row, strict=True)) for row in PUBLIC],
            "tools": tools(),
        }
        OUTPUT.write_text(json.dumps(everything, indent=1) + "\n", encoding="utf-8")
        print(f"written: {OUTPUT}")
    except BenchError as error:
        print(f"bench: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
