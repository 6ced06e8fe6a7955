"""Observer-based fault isolation: a DAQ log of a linear actuator in, a verdict out."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("observer-fi")
except PackageNotFoundError:  # run from a checkout that was never installed
    __version__ = "0+unknown"
