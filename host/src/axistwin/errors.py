"""What can go wrong, each with the exit status of the command line.

Every message is one line for the person who typed the command: what is wrong, where, what to do.
"""

from __future__ import annotations


class AxisTwinError(Exception):
    """Anything that this package raises on purpose."""

    #: Exit status of the command line.
    exit_code = 2


class InputError(AxisTwinError):
    """An argument, a file or a value in it does not make sense."""


class FileError(AxisTwinError):
    """A file cannot be written."""

    exit_code = 3


class BusError(AxisTwinError):
    """The bus or the node does not do what was asked of it."""

    exit_code = 3


class NoAnswerError(BusError):
    """A node does not answer."""


class NodeLostError(BusError):
    """A node that was there has gone silent, or the way to it is gone."""


class CommandRefusedError(BusError):
    """A node answered that it will not carry out a command."""


class DriveFaultError(BusError):
    """A drive has gone into fault: its torque is off."""


class ContractError(BusError):
    """Node and host do not speak the same version of the wire contract."""


class NotEnoughDataError(AxisTwinError):
    """The data cannot answer what was asked."""

    exit_code = 4
