"""The command line: arguments to one call to an exit code."""

from observer_fi.cli.main import main

__all__ = ["main"]
