"""What the commands share: exit codes, options, progress, and how they speak."""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

OK, BUG, USAGE, FAULT = 0, 1, 2, 3
T = TypeVar("T")


class Command(NamedTuple):
    """A subcommand: one line of help, its arguments, and what it does."""

    help: str
    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def add_common(parser: argparse.ArgumentParser) -> None:
    """Where the output goes, and in which form."""
    parser.add_argument(
        "--out", type=Path, default=Path("reports"), metavar="DIR", help="output folder (reports)"
    )
    parser.add_argument("--json", action="store_true", help="the result as JSON on standard output")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


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
    parser.add_argument("logs", nargs="+", metavar="LOG", help="CSV, CSV.gz, Parquet, TDMS or LVM")
    parser.add_argument("--columns", metavar="MAP.toml", help="names and units of the log's columns")
    parser.add_argument("--name", help="name of the output folder (the log's name)")


def progress(items: Iterable[T], args: argparse.Namespace, total: int, unit: str) -> Iterable[T]:
    """`items` with a progress bar on standard error, on a terminal only."""
    if args.quiet or total < 2 or not sys.stderr.isatty():
        return items
    from tqdm import tqdm

    return tqdm(items, total=total, unit=unit, leave=False)


def emit_json(value: Any) -> None:
    """A result on standard output."""
    from observer_fi.report import json_text

    sys.stdout.write(json_text(value))


def folder_names(logs: Sequence[str], name: str | None = None) -> tuple[dict[str, str], list[str]]:
    """Output folder of every log, {path: name}, and what to tell about names that had to change.

    Two logs of one stem would overwrite each other's report: the later ones get their parent folder's name
    in front, or a number.
    """
    from observer_fi.logs import log_name

    taken: set[str] = set()
    names: dict[str, str] = {}
    notes = []
    for path in dict.fromkeys(logs):
        stem = name or log_name(path) or "log"
        wanted, number = stem, 2
        if wanted in taken:
            wanted = f"{Path(path).resolve().parent.name}_{stem}"
        while wanted in taken:
            wanted = f"{stem}_{number}"
            number += 1
        if wanted != stem:
            notes.append(f"{path}: the name {stem} is taken, its report is under {wanted}")
        taken.add(wanted)
        names[path] = wanted
    return names, notes


def complain(message: str) -> None:
    """One line on standard error."""
    print(f"observer-fi: {' '.join(message.split())}", file=sys.stderr)


def step(args: argparse.Namespace) -> Callable[[str], None]:
    """Tells on a terminal what a long command is doing."""

    def tell(text: str) -> None:
        if sys.stderr.isatty() and not args.quiet and not args.json:
            print(f"  {text}", file=sys.stderr, flush=True)

    return tell


def tell_when_compiling(args: argparse.Namespace) -> None:
    """Say on a terminal why the first run takes longer, before it does."""
    tell = step(args)
    if sys.stderr.isatty():
        from observer_fi.numerics import when_compiling

        when_compiling(lambda: tell("compiling the filters, once for this version: about half a minute"))
