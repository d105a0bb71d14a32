"""What the paper prints: Tables 1 to 6, digit for digit, with a decimal point for its comma.

A table is a sequence of rows, each a name and its numbers under ``COLUMNS``; the two settings
follow each other (settings.SETTINGS).
"""

from __future__ import annotations

from typing import TypeAlias

Row: TypeAlias = tuple[str, tuple[str, str, str, str]]

#: Estimate and error in per cent in each of the two settings.
COLUMNS = ("Estimated", "Error (%)")

#: Table 1, in SI units.
PARAMETERS = {"I1": "2.7e-05", "I2": "8.3e-06", "B": "2.1e-03", "K": "1.1e+02"}

#: The columns called Real of Tables 4 and 6; those of Tables 3 and 5 are Table 1.
MODAL = {
    "wn1": "4.1626e+3",
    "wn2": "4.1626e+3",
    "wd1": "4.1593e+3",
    "wd2": "4.1593e+3",
    "zeta1": "3.97e-2",
    "zeta2": "3.97e-2",
}

#: Table 2: N and k, and what follows from them.
TIME_STEPS = (
    {"wn": "4.1626e+03", "w0": "416.2582", "Dt": "2.9481e-05"},
    {"wn": "4.1626e+03", "w0": "28.5108", "Dt": "1.0761e-04"},
)

TABLE_3: tuple[Row, ...] = (
    ("I1", ("2.7133e-5", "4.9e-1", "2.702e-5", "7.6e-2")),
    ("I2", ("8.2999e-6", "7.05e-6", "8.29999e-6", "1.06e-7")),
    ("B", ("1.4e-03", "3.509e+1", "7.4e-3", "2.52e+2")),
    ("K", ("1.0905e+2", "8.5e-1", "1.03e+2", "6.36e0")),
)

TABLE_4: tuple[Row, ...] = (
    ("wn1", ("4.1423e+3", "4.8e-1", "4.0276e+3", "3.24e0")),
    ("wn2", ("4.1423e+3", "4.8e-1", "4.0276e+3", "3.24e0")),
    ("wd1", ("4.1410e+3", "4.4e-1", "3.9852e+3", "4.18e0")),
    ("wd2", ("4.1410e+3", "4.4e-1", "3.9852e+3", "4.18e0")),
    ("zeta1", ("2.59e-2", "3.48e+1", "1.447e-1", "2.64e+2")),
    ("zeta2", ("2.59e-2", "3.48e+1", "1.447e-1", "2.64e+2")),
)

TABLE_5: tuple[Row, ...] = (
    ("I1", ("2.699e-5", "3.67e-2", "2.69998e-5", "6.81e-4")),
    ("I2", ("8.299e-6", "2.75e-4", "8.29999e-6", "3.6e-7")),
    ("B", ("2.08e-3", "6.64e-1", "2.0998e-3", "5.0e-3")),
    ("K", ("1.0994e+2", "4.89e-2", "1.0999e+2", "5.8e-4")),
)

TABLE_6: tuple[Row, ...] = (
    ("wn1", ("4.1617e+3", "2e-2", "4.16257e+3", "2.11e-4")),
    ("wn2", ("4.1617e+3", "2e-2", "4.16257e+3", "2.11e-4")),
    ("wd1", ("4.1585e+3", "1.9e-2", "4.15928e+3", "2.04e-4")),
    ("wd2", ("4.1585e+3", "1.9e-2", "4.15928e+3", "2.04e-4")),
    ("zeta1", ("3.95e-2", "6.36e-1", "3.973e-2", "4.6e-3")),
    ("zeta2", ("3.95e-2", "6.36e-1", "3.973e-2", "4.6e-3")),
)
