"""Commands on logs that are made here: simulate, compare."""

import argparse
from typing import TYPE_CHECKING

from observer_fi.cli.options import (
    OK,
    add_common,
    add_engine,
    add_figures,
    add_rig,
    emit_json,
    still_figures,
)
from observer_fi.cli.progress import progress
from observer_fi.errors import UsageError

if TYPE_CHECKING:
    from observer_fi.physics import Scenario


def simulate_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `simulate`."""
    from observer_fi.physics import FAULT_KINDS
    from observer_fi.records import CHANNELS

    parser.add_argument(
        "--moves",
        default="0.3:410:2.5",
        metavar="START:SPEED:SECONDS,...",
        help="commanded moves, s and rad/s, signed; moves that touch go over without a stop (0.3:410:2.5)",
    )
    parser.add_argument("--seconds", type=float, help="length of the log [s] (0.4 more than the moves)")
    parser.add_argument("--rate", type=float, default=1600.0, help="samples a second (1600)")
    parser.add_argument("--pitch", type=float, default=0.0, help="pitch [deg] (0)")
    parser.add_argument(
        "--fault",
        choices=FAULT_KINDS,
        default="none",
        metavar="KIND",
        help=f"what goes wrong: {', '.join(FAULT_KINDS)}",
    )
    parser.add_argument("--at", type=float, default=0.0, metavar="T", help="when it goes wrong [s]")
    parser.add_argument("--channel", choices=CHANNELS, help="which sensor, for a sensor fault")
    parser.add_argument("--size", type=float, help="size of the fault, SI units (a plain one)")
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of the equations at another value, all the time; may be repeated",
    )
    parser.add_argument(
        "--spread", action="store_true", help="draw the rig from the spread of its parameters"
    )
    parser.add_argument("--noise", type=float, default=1.0, help="sensor noise, times that of the rig (1)")
    parser.add_argument("--seed", type=int, default=0, help="repeats the log (0)")
    parser.add_argument("--name", default="synthetic", help="name of the log (synthetic)")
    parser.add_argument("--gzip", action="store_true", help="write .csv.gz")
    add_rig(parser, settings=False)
    add_common(parser)


def run_simulate(args: argparse.Namespace) -> int:
    """A synthetic log, its truth beside it."""
    from observer_fi.physics import csv_bytes, load_rig, synthesise
    from observer_fi.report import Made, checked_name, json_text, write_beside

    rig, scenario = load_rig(args.rig), _scenario(args)
    checked_name(args.name)
    log, truth = synthesise(scenario, rig, args.name)
    path = args.out / f"{args.name}.csv{'.gz' if args.gzip else ''}"
    files: dict[str, str | bytes] = {
        f"{args.name}.truth.json": json_text(truth.as_dict()),
        path.name: csv_bytes(log, args.gzip),
    }
    write_beside(args.out, Made(f"simulate {args.name}", {}), files)
    if args.json:
        emit_json({"log": str(path), **truth.as_dict()})
    elif not args.quiet:
        print(f"{path}: {truth.label}, truth in {args.out / args.name}.truth.json")
    return OK


def _scenario(args: argparse.Namespace) -> "Scenario":
    from observer_fi.physics import Fault, Move, Scenario

    moves = tuple(Move(*numbers(part, ":", 3, "--moves")) for part in args.moves.split(",") if part)
    ends = [move.start_s + move.seconds for move in moves]
    effects = dict(assignment(text) for text in args.effect)
    return Scenario(
        moves, args.seconds or max(ends, default=0.6) + 0.4, args.rate, args.pitch,
        Fault(args.fault, args.at, args.channel, args.size), effects, args.spread, args.noise, args.seed,
    )  # fmt: skip


def numbers(text: str, separator: str, count: int, option: str) -> list[float]:
    """Exactly `count` numbers of an option. Raises UsageError."""
    try:
        found = [float(part) for part in text.split(separator)]
    except ValueError:
        found = []
    if len(found) != count:
        raise UsageError(f"{option}: {text!r} is not {count} numbers with {separator!r} between them")
    return found


def assignment(text: str) -> tuple[str, float]:
    """NAME=VALUE of --effect. Raises UsageError."""
    name, _, value = text.partition("=")
    return name.strip(), numbers(value, "=", 1, "--effect")[0]


def compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `compare`."""
    parser.add_argument("--cases", type=int, default=60, help="how many logs (60)")
    parser.add_argument("--seed", type=int, default=0, help="repeats the logs (0)")
    add_rig(parser)
    add_engine(parser)
    add_common(parser)
    add_figures(parser)


def run_compare(args: argparse.Namespace) -> int:
    """The bank against the open-loop mixture on drawn faults."""
    from observer_fi.physics import load_rig
    from observer_fi.report import Made, json_text, page, table, write_result
    from observer_fi.settings import load_settings
    from observer_fi.verdict import comparison

    rig, settings = load_rig(args.rig), load_settings(args.settings)
    if args.cases < 1:
        raise UsageError(f"--cases: at least one log, got {args.cases}")
    pairs = comparison.compare(args.cases, args.seed, rig, settings, args.engine, args.filter)
    result = comparison.as_dict(list(progress(pairs, args, args.cases, "log")), args.seed, rig)
    files = {"compare.json": json_text(result), "compare.html": page(result)}
    still = still_figures(args, result)
    folder = write_result(args.out, "compare", Made("compare", {}), {**files, **still})
    if args.json:
        emit_json(result)
    elif not args.quiet:
        print(f"{table(result)}\n{folder / 'compare.html'}")
    return OK
