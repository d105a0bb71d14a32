"""`axistwin demo`: an axis emulated in one process, identified over a CAN bus from others."""

from __future__ import annotations

import argparse
import contextlib
import re
import shlex
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from axistwin import bus, core, excitation, plots
from axistwin.commands.emulate import find_emulator
from axistwin.errors import BusError, FileError
from axistwin.identify import axis_truth, identify, table
from axistwin.readers import read_record
from axistwin.terminal import Terminal

# The paper's second setting (Table 2): N = 2048 samples a period, wn on its line k = 146.
_LENGTH, _LINE = 2048, 146

_SAMPLES = 5 * _LENGTH

# What the node's estimator is given to learn from [s].
_LEARNING = 3.0

_START_MAX = 10.0
_READY = re.compile(r"axistwin-emulator: node \d+ on (\w+) (\S+),")
_VCAN = "vcan0"

# Quantity, its unit, and the report page that carries the node's estimate of it.
_QUANTITIES = (
    ("I1", "kg m2", "EstimateI1"),
    ("I2", "kg m2", "EstimateI2"),
    ("B", "N m s/rad", "EstimateB"),
    ("K", "N m/rad", "EstimateK"),
    ("wn", "rad/s", "EstimateWn"),
    ("wd", "rad/s", "EstimateWd"),
    ("zeta", "1", "EstimateZeta"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        "--output",
        default="axistwin-demo",
        metavar="DIR",
        help="folder for the record and the figures (default: axistwin-demo)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Emulates, traces, identifies, and prints what came of it. Returns the exit status."""
    terminal = Terminal()
    folder = Path(arguments.output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make the folder {folder}: {error.strerror}") from error
    record = folder / "trace.csv"
    axis = core.paper_axis()
    period = core.time_step(_LENGTH, _LINE, core.modal(axis).wn)
    with _interface(terminal) as line, _emulator(line, period, terminal) as channel:
        node = _node_estimate(channel, terminal)
        _run("trace", *channel, "--excite", "-n", str(_SAMPLES), "-f", str(record))
    terminal.note(f"$ axistwin identify {shlex.quote(str(record))}")
    result = identify(read_record(record))
    truth = axis_truth(axis)
    host = {name: item.value for name, item in result.estimate.quantities.items()}
    print(_comparison(truth, node, host))
    print(f"\nOn the host: {table(result, truth)}\n")
    print(f"Record: {record}")
    for figure in plots.save_all(result, folder, truth):
        print(f"Figure: {figure}")
    return 0


@contextlib.contextmanager
def _interface(terminal: Terminal) -> Iterator[str]:
    """The emulator's bus: a virtual CAN interface where the kernel has one, else a pseudo-terminal.

    An interface that had to be made is removed afterwards.
    """
    if _has_interface():
        terminal.note(f"using the virtual CAN interface {_VCAN}")
        yield _VCAN
        return
    with contextlib.suppress(OSError):
        subprocess.run(["modprobe", "--quiet", "vcan"], check=False, capture_output=True)
    made = _ip("link", "add", "dev", _VCAN, "type", "vcan") is not None
    if not made or _ip("link", "set", _VCAN, "up") is None:
        terminal.note("no virtual CAN interface here: using SLCAN on a pseudo-terminal")
        yield "pty"
        return
    terminal.note(f"made the virtual CAN interface {_VCAN}")
    try:
        yield _VCAN
    finally:
        _ip("link", "delete", _VCAN)


def _has_interface() -> bool:
    # Not by /sys/class/net: that shows the network namespace in which it was mounted.
    return _VCAN in [name for _, name in socket.if_nameindex()] and bool(
        _ip("-oneline", "link", "show", "up", "dev", _VCAN)
    )


def _ip(*arguments: str) -> str | None:
    """What `ip` says; None when it fails."""
    try:
        ran = subprocess.run(["ip", *arguments], capture_output=True, check=False, text=True)
    except OSError:
        return None
    return ran.stdout if ran.returncode == 0 else None


@contextlib.contextmanager
def _emulator(line: str, period: float, terminal: Terminal) -> Iterator[tuple[str, ...]]:
    """A running emulator; yields the bus arguments to reach it with."""
    command = [find_emulator(), "--bus", line, "--period", repr(period)]
    command += ["--excitation", f"{_LENGTH},{2 * _LINE}"]
    terminal.note(f"$ {shlex.join(command)}")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        ready = _READY.match(process.stdout.readline())
        if ready is None:
            process.wait(_START_MAX)
            raise BusError("the emulator does not start; what it said stands above")
        interface = "socketcan" if ready[1] == "socketcan" else "slcan"
        yield "-i", interface, "-c", ready[2]
    finally:
        process.terminate()
        try:
            process.wait(_START_MAX)
        except subprocess.TimeoutExpired:
            process.kill()


def _node_estimate(channel: tuple[str, ...], terminal: Terminal) -> dict[str, float]:
    """What the node itself has identified after a while, by name."""
    parser = argparse.ArgumentParser()
    bus.add_arguments(parser)
    excitation.add_arguments(parser)
    arguments = parser.parse_args([*channel, "--excite"])
    with bus.node_of(arguments) as node:
        node.connect(arguments.wait, terminal.note)
        with excitation.excited(node, arguments):
            terminal.note(f"the drive is enabled, the node learns for {_LEARNING:g} s")
            end = time.monotonic() + _LEARNING
            while (left := end - time.monotonic()) > 0.0:
                node.poll(min(left, 0.1))
        missing = [page for *_, page in _QUANTITIES if page not in node.pages]
        if missing:
            raise BusError(f"node {node.id} has not sent its estimate")
        return {name: node.pages[page] for name, _, page in _QUANTITIES}


def _run(verb: str, *arguments: str) -> None:
    """Runs a verb of this command line in a process of its own, shown as it would be typed."""
    print(f"$ {shlex.join(['axistwin', verb, *arguments])}", file=sys.stderr, flush=True)
    status = subprocess.run(
        [sys.executable, "-m", "axistwin", verb, *arguments], check=False, stdout=subprocess.DEVNULL
    ).returncode
    if status != 0:
        raise BusError(f"axistwin {verb} failed; what it said stands above")


def _comparison(truth: dict[str, float], node: dict[str, float], host: dict[str, float]) -> str:
    """Real, estimated, error: for the estimator on the node and for the host."""
    lines = [
        "",
        f"{'':29}{'On the node (C, float32, online)':^30}  {'On the host (from the trace)':^28}",
        f"{'':16}{'Real':>13}" + 2 * f"{'Estimated':>16}{'Error (%)':>14}",
    ]
    for name, unit, _ in _QUANTITIES:
        line = f"{f'{name} ({unit})':16}{truth[name]:13.6g}"
        for found in (node[name], host[name]):
            line += f"{found:16.6g}{100.0 * (found / truth[name] - 1.0):14.2e}"
        lines.append(line)
    return "\n".join(lines)
