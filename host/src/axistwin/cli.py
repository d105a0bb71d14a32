"""The command line: `axistwin VERB ...`. Exit status: 0 fine, 1 a finding or a check that failed,
2 usage (arguments, input files), 3 bus or file trouble, 4 not enough data to answer."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import Any

from axistwin import __version__
from axistwin.errors import AxisTwinError

# Verb, the module that has its add_arguments(parser) and run(arguments), what it does. Only the
# module of the verb that is used is imported: help and errors come quickly.
_VERBS = {
    "emulate": ("axistwin.commands.emulate", "run an emulated axis with its drive on a CAN bus"),
    "monitor": ("axistwin.commands.monitor", "show what the nodes on a bus do, listening only"),
    "log": ("axistwin.commands.log", "record the live stream of a node as a bus log"),
    "trace": ("axistwin.commands.trace", "capture and fetch samples at the full control rate"),
    "modbus": ("axistwin.commands.modbus", "read, command and log a node over Modbus TCP or RTU"),
    "excite": ("axistwin.commands.excite", "switch the excitation of a node on or off"),
    "demo": ("axistwin.commands.demo", "identify an emulated axis over CAN, from start to figures"),
    "simulate": ("axistwin.commands.simulate", "what a model does under the torque of a record"),
    "model": ("axistwin.commands.model", "give a model to an emulated axis or to a firmware"),
    "compare": ("axistwin.commands.compare", "how far a model is from a record, nothing fitted"),
    "identify": ("axistwin.commands.identify", "the parameters of the axis from a record"),
    "diagnose": ("axistwin.commands.diagnose", "what a simulation of a record gets wrong, and why"),
}

# A parser that takes nothing for an option: everything, --help too, is for the emulator itself.
_PASSED_ON = {"prefix_chars": "\0", "add_help": False}

_INTERRUPTED = 128 + signal.SIGINT


def make_parser(verb: str | None) -> argparse.ArgumentParser:
    """The parser of the whole command line, with the arguments of one verb."""
    parser = argparse.ArgumentParser(
        prog="axistwin",
        description="A digital twin of a servo axis: log it, identify it, find what is wrong.",
        epilog="exit status: 0 fine, 1 finding or failed check, 2 usage, 3 bus or file, "
        "4 not enough data",
    )
    parser.add_argument("--version", action="version", version=f"axistwin {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for name, (module, text) in _VERBS.items():
        options: dict[str, Any] = _PASSED_ON if name == "emulate" else {}
        subparser = verbs.add_parser(
            name, help=text, description=f"{text[0].upper()}{text[1:]}.", **options
        )
        if name == verb:
            importlib.import_module(module).add_arguments(subparser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line and returns its exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    verb = next((argument for argument in arguments if argument in _VERBS), None)
    signal.signal(signal.SIGTERM, _interrupt)
    # Our matrices are small: on a busy machine, threads cost ten times what they gain.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        parsed = make_parser(verb).parse_args(arguments)
        module: Any = importlib.import_module(_VERBS[parsed.verb][0])
        status: int = module.run(parsed)
        sys.stdout.flush()
        return status
    except AxisTwinError as error:
        print(f"axistwin: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("axistwin: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has had enough: nothing to say, and nothing to flush at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
