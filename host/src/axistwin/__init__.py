"""AxisTwin: a digital twin of a servo axis. The command line is `axistwin --help`."""

from importlib.metadata import version

__version__ = version("axistwin")
