"""What the commands share: exit codes, options, and how they speak."""

import argparse
import contextlib
import io
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from observer_fi.errors import UsageError

OK, BUG, USAGE, FAULT = 0, 1, 2, 3


class Command(NamedTuple):
    """A subcommand: one line of help, its arguments, what it does, and two or three examples, each with what it is for."""

    help: str
    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]
    examples: tuple[tuple[str, str], ...]

    @property
    def epilog(self) -> str:
        """The examples, as they are typed."""
        lines = (f"  # {what}\n  observer-fi {words}" for words, what in self.examples)
        return "\n".join(["examples:", *lines])


def add_common(parser: argparse.ArgumentParser) -> None:
    """Where the output goes, and in which form."""
    parser.add_argument(
        "--out", type=Path, default=Path("reports"), metavar="DIR", help="output folder (reports)"
    )
    parser.add_argument("--json", action="store_true", help="the result as JSON on standard output")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def add_figures(parser: argparse.ArgumentParser) -> None:
    """Whether still figures are wanted, and in which form."""
    parser.add_argument(
        "--figures", choices=("png", "svg", "pdf"), help="still figures beside the page, drawn by matplotlib"
    )


def still_figures(args: argparse.Namespace, record: Any) -> dict[str, bytes]:
    """The figures of this command's result as files, if they were asked for: matplotlib is imported only then."""
    if args.figures is None:
        return {}
    from observer_fi.report import stills_of

    return stills_of(args.command, record, args.figures)


def add_rig(parser: argparse.ArgumentParser, settings: bool = True) -> None:
    """Which machine, and everything tunable."""
    parser.add_argument(
        "--rig", metavar="RIG.toml", help="the machine: a file or a packaged name (mass_shifter)"
    )
    if settings:
        parser.add_argument("--settings", metavar="FILE.toml", help="settings that differ from the defaults")


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Which implementation of the bank."""
    parser.add_argument(
        "--engine", choices=("compiled", "filterpy"), default="compiled", help="implementation (compiled)"
    )
    parser.add_argument("--filter", choices=("ekf", "ukf"), default="ekf", help="kind of filter (ekf)")


def add_logs(parser: argparse.ArgumentParser) -> None:
    """Which logs, and how their columns are called."""
    parser.add_argument("logs", nargs="+", metavar="LOG", help="CSV, CSV.gz, Parquet, TDMS, LVM, MAT or MDF")
    parser.add_argument("--columns", metavar="MAP.toml", help="names and units of the log's columns")
    parser.add_argument("--name", help="name of the output folder (the log's name)")


def finite(text: str) -> float:
    """The type of an option: a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"a finite number is needed, not {text[:40]!r}")
    return value


def seconds(text: str) -> float:
    """The type of an option: a time of zero seconds or more, at most a year."""
    value = finite(text)
    if not 0.0 <= value <= 3.2e7:
        raise argparse.ArgumentTypeError(f"seconds from 0 to a year are needed, not {text[:40]!r}")
    return value


def at_least(least: int, most: int = 10**9) -> Callable[[str], int]:
    """The type of an option: a whole number from `least` to `most`."""

    def whole(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f"a whole number from {least} to {most} is needed, not {text[:40]!r}"
            )
        return value

    return whole


def emit_json(value: Any) -> None:
    """A result on standard output."""
    from observer_fi.report import json_text

    sys.stdout.write(json_text(value))


def taken(log: object, wanted: str, folder: Path) -> None:
    """Says where a result is whose name another log has."""
    if folder.name != wanted:
        complain(f"{log}: the name {wanted} is taken, its report is under {folder.name}")


def writable_output() -> None:
    """Standard output that takes any file name, and is there. Raises UsageError."""
    if sys.stdout is None:
        raise UsageError("standard output is closed; send it to a file or to /dev/null")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def give_up_output() -> None:
    """Nobody takes what is still to be written: the interpreter's last flush must not fail or wait for it."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def complain(message: str) -> None:
    """One line on standard error, without what would steer a terminal."""
    if sys.stderr is None:
        return
    message = "".join(c if c.isprintable() or c.isspace() else ascii(c)[1:-1] for c in message)
    with contextlib.suppress(OSError):  # nobody to tell
        _between_bars(f"observer-fi: {' '.join(message.split())}", sys.stderr)


def say(line: str) -> None:
    """One line on standard output."""
    _between_bars(line, sys.stdout)


def _between_bars(line: str, out: TextIO) -> None:
    """A line that no progress bar is written over: bars give way to it, where there are any."""
    tqdm = sys.modules.get("tqdm")
    if tqdm is None:
        print(line, file=out)
    else:
        tqdm.tqdm.write(line, file=out)
