"""Records as MAT files (MATLAB 5 to 7.2): a variable is a column, or a number to scale with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from axistwin.errors import InputError
from axistwin.readers.columns import ColumnOptions, make_record, wanted
from axistwin.record import Record
from axistwin.sampling import Array


def read(path: Path, options: ColumnOptions) -> Record:
    """The record in a MAT file. Fields of a structure are named ``structure.field``.

    Raises InputError.
    """
    try:
        contents = scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise InputError(f"{path} is a MATLAB 7.3 file; save it with: save(..., '-v7')") from None
    except Exception as error:  # scipy passes on whatever damaged data make it stumble over
        raise InputError(f"{path} is not a readable MAT file ({error})") from error
    variables = _flat({k: v for k, v in contents.items() if not k.startswith("__")})
    vectors = {name: value for name, value in variables.items() if value.size > 1}
    places = wanted(options, list(vectors), str(path))
    channels = {channel: vectors[name] for channel, name in places.items()}

    def number(text: str) -> float:
        if text in variables and variables[text].size == 1:
            return float(variables[text][0])
        return float(text)

    return make_record(channels, options, str(path), number)


def _flat(variables: dict[str, Any], prefix: str = "") -> dict[str, Array]:
    """Numeric variables as vectors, those of structures under ``structure.field``."""
    found = {}
    for name, value in variables.items():
        if isinstance(value, dict):
            found.update(_flat(value, f"{prefix}{name}."))
            continue
        array = np.asarray(value)
        if array.dtype.kind in "iufb" and array.size == max(array.shape, default=1):
            found[prefix + name] = array.ravel().astype(np.float64)
    return found
