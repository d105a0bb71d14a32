"""Builds axistwin._core32 and axistwin._core64: the C core in single and in double precision.

What Python sees is declared by the core's own headers, preprocessed: there is no second list.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from cffi import FFI

HERE = Path(__file__).resolve().parent
NATIVE = HERE / "native"
CORE = HERE.parent / "lib"

# Simulations between the samples of a record take short steps, of which a delay lasts many.
DELAY_STEPS = 1024
STANDARD_HEADERS = ("stdbool.h", "stddef.h", "stdint.h")


def declarations(real: str) -> str:
    """The declarations that the headers in native/ make visible, for the number type `real`.

    The standard headers are replaced by empty ones: cffi knows what they define.
    """
    compiler = os.environ.get("CC", "cc").split()
    with tempfile.TemporaryDirectory() as empty:
        for header in STANDARD_HEADERS:
            (Path(empty) / header).touch()
        options = [
            "-E",
            "-P",
            "-nostdinc",
            f"-I{empty}",
            f"-I{CORE}",
            f"-I{NATIVE}",
            f"-DAXT_REAL={real}",
            f"-DAXT_DELAY_STEPS={DELAY_STEPS}",
        ]
        return subprocess.run(
            [*compiler, *options, "-xc", "-"],
            input=includes(),
            check=True,
            capture_output=True,
            text=True,
        ).stdout


def includes() -> str:
    """Includes every header of native/."""
    return "".join(f'#include "{path.name}"\n' for path in sorted(NATIVE.glob("*.h")))


def core(name: str, real: str) -> FFI:
    """The extension module `name` with the number type `real`."""
    if not (CORE / "axt.h").exists():
        sys.exit(
            f"axistwin: the sources of its C core are not in {CORE}; "
            "install it from a checkout of the whole repository: pip install ./host"
        )
    ffi = FFI()
    ffi.cdef(declarations(real))
    ffi.set_source(
        name,
        includes(),
        sources=[str(path) for path in (*sorted(CORE.glob("*.c")), *sorted(NATIVE.glob("*.c")))],
        include_dirs=[str(CORE), str(NATIVE)],
        define_macros=[("AXT_REAL", real), ("AXT_DELAY_STEPS", str(DELAY_STEPS))],
        extra_compile_args=[
            "-std=c11",
            "-O2",
            # So that the same samples give the same bits here as on the node.
            "-ffp-contract=off",
            # Pairs of numbers just stored one by one are slow to load as a vector.
            "-fno-tree-slp-vectorize",
            "-fvisibility=hidden",
        ],
        libraries=["m"],
    )
    return ffi


def core32() -> FFI:
    """Single precision, as on a drive."""
    return core("axistwin._core32", "float")


def core64() -> FFI:
    """Double precision."""
    return core("axistwin._core64", "double")
