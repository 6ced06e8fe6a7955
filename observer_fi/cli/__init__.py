"""The command line: arguments to one call to an exit code."""

from observer_fi.cli.commands import main

__all__ = [
    "main",
]
