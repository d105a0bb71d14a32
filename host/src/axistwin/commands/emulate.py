"""`axistwin emulate`: starts the emulated axis with its drive, ideal or that of a model file."""

from __future__ import annotations

import argparse
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from axistwin.errors import InputError

_PROGRAM = "axistwin-emulator"

# The option that the emulator itself does not have: it reads no files.
_EFFECTS = "--effects"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command: all of them are the emulator's own."""
    parser.add_argument(
        "arguments", nargs="*", metavar="...", help=f"arguments of {_PROGRAM}; --help lists them"
    )


def find_emulator() -> str:
    """The emulator's path: $AXISTWIN_EMULATOR, build/ of the current folder, or PATH.

    Raises InputError when there is none.
    """
    named = os.environ.get("AXISTWIN_EMULATOR")
    built = Path("build") / _PROGRAM
    found = named or (str(built) if built.exists() else shutil.which(_PROGRAM))
    if found is None or shutil.which(found) is None:
        where = f"$AXISTWIN_EMULATOR is {named}" if named else "not in ./build, not in PATH"
        raise InputError(f"no {_PROGRAM} to be run ({where}); build it with: make build/{_PROGRAM}")
    return found


def run(arguments: argparse.Namespace) -> int:
    """Becomes the emulator: signals and exit status are its own."""
    options = with_model(arguments.arguments)
    program = find_emulator()
    os.execv(program, [program, *options])


def with_model(arguments: Sequence[str]) -> list[str]:
    """The arguments with the options of a model in the place of ``--effects FILE``.

    Raises InputError when there is no such model, or no emulated axis can be like it.
    """
    options: list[str] = []
    rest = iter(arguments)
    for argument in rest:
        name, equals, path = argument.partition("=")
        if name != _EFFECTS:
            options.append(argument)
            continue
        path = path if equals else next(rest, "")
        if not path:
            raise InputError(f"{_EFFECTS} wants a model file")
        from axistwin import model  # takes a second, and most emulators are ideal

        options += model.read(path).emulator_options()
    return options
