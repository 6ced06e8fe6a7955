"""The command `observer-fi`: arguments, one call, output, an exit code.

Start-up counts (a whole diagnosis has two seconds), so this file imports nothing heavy: each command imports
its own.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeVar

from observer_fi import __version__
from observer_fi.errors import InvalidLogError, UsageError

if TYPE_CHECKING:
    from observer_fi.models import Rig
    from observer_fi.records import Log
    from observer_fi.scenario import Scenario

OK, BUG, USAGE, FAULT = 0, 1, 2, 3
Improved = tuple[dict[str, Any], dict[str, str], str]  # JSON, files, headline
T = TypeVar("T")


class Command(NamedTuple):
    """A subcommand: one line of help, its arguments, and what it does."""

    help: str
    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and where help is; exit with 2."""
        print(f"{self.prog}: {message}; see {self.prog} --help", file=sys.stderr)
        raise SystemExit(USAGE)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    words = sys.argv[1:] if argv is None else list(argv)
    args = _parser(next((word for word in words if not word.startswith("-")), "")).parse_args(words)
    try:
        return int(args.run(args))
    except (InvalidLogError, UsageError) as error:
        _complain(str(error))
        return USAGE
    except BrokenPipeError:  # the reader of our output has gone: nothing to tell it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except KeyboardInterrupt:
        return 130  # as a shell reports SIGINT


def _parser(wanted: str) -> argparse.ArgumentParser:
    """The parser of all commands, with the arguments of the one that is wanted: the others may be slow to import."""
    parser = _Parser(
        prog="observer-fi",
        description="Fault isolation of a DC-motor linear actuator: a DAQ log in, a verdict out.",
    )
    parser.add_argument("--version", action="version", version=f"observer-fi {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        sub = commands.add_parser(name, help=command.help, description=f"{command.help.capitalize()}.")
        if name == wanted:
            command.arguments(sub)
        sub.set_defaults(run=command.run)
    return parser


# --- options that commands share ---


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
    from observer_fi.ingest import log_name

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


def _complain(message: str) -> None:
    print(f"observer-fi: {' '.join(message.split())}", file=sys.stderr)


# --- diagnose ---


def _diagnose_arguments(parser: argparse.ArgumentParser) -> None:
    add_logs(parser)
    add_rig(parser)
    add_engine(parser)
    add_common(parser)
    parser.add_argument(
        "--detected-at", type=float, metavar="T", help="detection time from outside, on the log's clock [s]"
    )
    parser.add_argument(
        "--fail-on-fault", action="store_true", help="exit with 3 if a verdict is not nominal"
    )


def _diagnose(args: argparse.Namespace) -> int:
    from observer_fi import report
    from observer_fi.diagnose import diagnose
    from observer_fi.ingest import load_columns
    from observer_fi.models import load_rig
    from observer_fi.settings import load_settings

    rig, settings = load_rig(args.rig), load_settings(args.settings)
    columns = load_columns(args.columns) if args.columns else None
    names, notes = folder_names(args.logs, args.name)
    for note in notes:
        _complain(note)
    shown: list[dict[str, Any]] = []
    bad = faults = 0
    for path, name in progress(names.items(), args, len(names), "log"):
        try:
            outcome = diagnose(
                path,
                rig,
                settings,
                engine=args.engine,
                filter_kind=args.filter,
                columns=columns,
                detected_at=args.detected_at,
            )
            if outcome.error is not None:
                raise InvalidLogError(outcome.error)
        except InvalidLogError as error:
            bad += 1
            _complain(str(error))
            shown.append({"log": {"path": path}, "error": str(error)})
            continue
        result = report.report_dict(outcome)
        report.write(outcome, rig, args.out / name)
        faults += result["verdict"]["label"] != "nominal"
        shown.append(result)
        if not args.quiet and not args.json:
            print(f"{name}: {report.headline(outcome)}  {args.out / name / 'report.html'}")
    if args.json and (len(names) > 1 or not bad):
        emit_json(shown if len(names) > 1 else shown[0])
    if bad:
        if len(names) > 1:
            _complain(f"{bad} of {len(names)} logs could not be read; the others are done")
        return USAGE
    return FAULT if faults and args.fail_on_fault else OK


# --- simulate ---


def _simulate_arguments(parser: argparse.ArgumentParser) -> None:
    from observer_fi.records import CHANNELS
    from observer_fi.scenario import FAULTS

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
        choices=FAULTS,
        default="none",
        metavar="KIND",
        help=f"what goes wrong: {', '.join(FAULTS)}",
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


def _simulate(args: argparse.Namespace) -> int:
    from observer_fi.models import load_rig
    from observer_fi.output import write_file
    from observer_fi.report import json_text
    from observer_fi.scenario import csv_bytes, synthesise

    rig, scenario = load_rig(args.rig), _scenario(args)
    log, truth = synthesise(scenario, rig, args.name)
    path = args.out / f"{args.name}.csv{'.gz' if args.gzip else ''}"
    write_file(args.out / f"{args.name}.truth.json", json_text(truth.as_dict()))
    write_file(path, csv_bytes(log, args.gzip))
    if args.json:
        emit_json({"log": str(path), **truth.as_dict()})
    elif not args.quiet:
        print(f"{path}: {truth.label}, truth in {args.out / args.name}.truth.json")
    return OK


def _scenario(args: argparse.Namespace) -> "Scenario":
    from observer_fi.scenario import Fault, Move, Scenario

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


# --- compare ---


def _compare_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--cases", type=int, default=60, help="how many logs (60)")
    parser.add_argument("--seed", type=int, default=0, help="repeats the logs (0)")
    add_rig(parser)
    add_engine(parser)
    add_common(parser)


def _compare(args: argparse.Namespace) -> int:
    from observer_fi import comparison
    from observer_fi.comparison_report import page, table
    from observer_fi.models import load_rig
    from observer_fi.output import write_folder
    from observer_fi.report import json_text
    from observer_fi.settings import load_settings

    rig, settings = load_rig(args.rig), load_settings(args.settings)
    if args.cases < 1:
        raise UsageError(f"--cases: at least one log, got {args.cases}")
    pairs = comparison.compare(args.cases, args.seed, rig, settings, args.engine, args.filter)
    result = comparison.as_dict(list(progress(pairs, args, args.cases, "log")), args.seed, rig)
    write_folder(args.out / "compare", {"compare.json": json_text(result), "compare.html": page(result)})
    if args.json:
        emit_json(result)
    elif not args.quiet:
        print(f"{table(result)}\n{args.out / 'compare' / 'compare.html'}")
    return OK


# --- watch ---


def _watch_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--follow", type=Path, metavar="FILE", help="a growing file (standard input)")
    parser.add_argument("--columns", metavar="MAP.toml", help="names and units of the columns")
    parser.add_argument(
        "--every", type=int, default=0, metavar="N", help="the posterior of every Nth sample too"
    )
    parser.add_argument(
        "--heartbeat", type=float, default=0.0, metavar="S", help="a line every S seconds, changed or not"
    )
    add_rig(parser)
    add_engine(parser)
    parser.add_argument("--json", action="store_true", help="JSON lines, which is what it always writes")
    parser.add_argument("--quiet", action="store_true", help="no notes about restarts")
    parser.add_argument("--fail-on-fault", action="store_true", help="exit with 3 if a move had a fault")


def _watch(args: argparse.Namespace) -> int:
    from observer_fi import watch

    return watch.run(args, _complain)


# --- fleet ---


def _fleet_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of logs, searched to its depth")
    parser.add_argument("--pattern", default="*", metavar="GLOB", help="which file names (*)")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 2, help="local processes (one a core)"
    )
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="a running Dask cluster instead")
    parser.add_argument("--columns", metavar="MAP.toml", help="names and units of the logs' columns")
    add_rig(parser)
    add_engine(parser)
    add_common(parser)
    parser.add_argument("--fail-on-fault", action="store_true", help="exit with 3 if a log has a fault")


def _fleet(args: argparse.Namespace) -> int:
    from observer_fi import fleet
    from observer_fi.ingest import load_columns
    from observer_fi.models import load_rig
    from observer_fi.settings import load_settings

    if args.workers < 1:
        raise UsageError(f"--workers: at least one, got {args.workers}")
    columns = {"columns": load_columns(args.columns)} if args.columns else {}
    rig, settings = load_rig(args.rig), load_settings(args.settings)
    job = fleet.Job(args.folder, args.out, rig, settings, args.engine, args.filter, **columns)
    rows, todo = fleet.split(job, fleet.find_logs(job, args.pattern))
    fresh = progress(fleet.run(job, todo, args.workers, args.scheduler), args, len(todo), "log")
    rows += list(fresh)
    fleet.write_summary(job, rows)
    for problem in fleet.problems(rows):
        _complain(problem)
    if args.json:
        emit_json({"schema": "observer-fi/fleet/1", "read": len(todo), "logs": fleet.worst_first(rows)})
    elif not args.quiet:
        print(f"{fleet.headline(rows, len(todo))}\n{args.out / fleet.INDEX}")
    if any(row["status"] != "done" for row in rows):
        return USAGE
    faulty = any(row["label"] != "nominal" for row in rows)
    return FAULT if faulty and args.fail_on_fault else OK


# --- identify and improve ---


def _learning_arguments(parser: argparse.ArgumentParser) -> None:
    add_logs(parser)
    add_rig(parser, settings=False)
    add_common(parser)


def _improve_arguments(parser: argparse.ArgumentParser) -> None:
    _learning_arguments(parser)
    parser.add_argument(
        "--keep-unexplained",
        action="store_true",
        help="what no cause explains becomes an empirical curve of the extended rig, if it helps on held-out moves",
    )


def _learning_logs(args: argparse.Namespace, rig: "Rig") -> "list[Log]":
    """All logs of one rig; unlike in diagnose, one that cannot be read ends the command: the result would not be of them all."""
    from observer_fi.command_recovery import with_command
    from observer_fi.ingest import load_columns, read_log

    columns = load_columns(args.columns) if args.columns else None
    logs = [read_log(path, columns) for path in dict.fromkeys(args.logs)]
    return logs if rig.drive == "force" else [with_command(log, rig.model) for log in logs]


def _identify(args: argparse.Namespace) -> int:
    from observer_fi.identify import identified_rig, identify, residuals_by_phase
    from observer_fi.ingest import log_name
    from observer_fi.learning_report import identify_files, identify_json
    from observer_fi.models import load_rig
    from observer_fi.output import write_folder

    rig, name = load_rig(args.rig), args.name or log_name(args.logs[0])
    logs = _learning_logs(args, rig)
    fit = identify(logs, rig)
    by_phase = residuals_by_phase(logs, fit, rig.model)
    files = identify_files(fit, rig, identified_rig(fit, rig), by_phase, name, list(args.logs))
    write_folder(args.out / name, files)
    if args.json:
        emit_json(identify_json(fit))
    elif not args.quiet:
        told = f", {len(fit.not_identifiable)} cannot be told" if fit.not_identifiable else ""
        print(f"{name}: {len(fit.parameters)} parameters learned{told}  {args.out / name / 'report.html'}")
    return OK


def _improve(args: argparse.Namespace) -> int:
    from observer_fi.ingest import log_name
    from observer_fi.models import load_rig
    from observer_fi.output import write_folder

    rig, name = load_rig(args.rig), args.name or log_name(args.logs[0])
    logs = _learning_logs(args, rig)
    improved = _improve_force if rig.drive == "force" else _improve_servo
    result, files, headline = improved(logs, rig, name, args)
    write_folder(args.out / name, files)
    if args.json:
        emit_json(result)
    elif not args.quiet:
        print(f"{name}: {headline}  {args.out / name / 'report.html'}")
    return OK


def _improve_servo(logs: "list[Log]", rig: "Rig", name: str, args: argparse.Namespace) -> Improved:
    """A rig with a servo: simulated moves against measured ones."""
    from observer_fi.diagnosis_gain import worth
    from observer_fi.improve import improve
    from observer_fi.learning_report import improve_files, improve_headline, improve_json
    from observer_fi.segment import excitation, log_segments
    from observer_fi.servo import with_servo
    from observer_fi.settings import Settings

    tell = _step(args)
    rig = with_servo(logs, rig)
    record = improve(logs, rig, progress=tell, keep_unexplained=args.keep_unexplained)
    tell("what diagnose gains")
    best = record.extended_rig
    gain = worth(logs, best, rig, Settings()), worth(logs, best, best, Settings())
    shown = [excitation(log, log_segments(log), rig.model) for log in logs]
    files = improve_files(record, gain, shown, name, list(args.logs))
    return improve_json(record, gain), files, improve_headline(record)


def _improve_force(logs: "list[Log]", rig: "Rig", name: str, args: argparse.Namespace) -> Improved:
    """A rig that logs the drive force: the force that its motion asks for against the commanded one."""
    if args.keep_unexplained:
        raise UsageError(
            '--keep-unexplained needs a rig whose moves are simulated, not one with drive = "force"'
        )
    from observer_fi.inverse_improve import to_json
    from observer_fi.inverse_motion import prepare
    from observer_fi.inverse_naming import name_causes
    from observer_fi.inverse_report import improve_files, improve_headline

    ladder = name_causes(rig, [prepare(log) for log in logs], progress=_step(args))
    return to_json(ladder), improve_files(ladder, name, list(args.logs)), improve_headline(ladder)


def _step(args: argparse.Namespace) -> Callable[[str], None]:
    """Tells on a terminal what a long command is doing."""

    def tell(text: str) -> None:
        if sys.stderr.isatty() and not args.quiet and not args.json:
            print(f"  {text}", file=sys.stderr, flush=True)

    return tell


# A command is a row here: its help, its arguments, its function. Both import what they need inside.
COMMANDS: dict[str, Command] = {
    "diagnose": Command("detect and isolate a fault in each log", _diagnose_arguments, _diagnose),
    "compare": Command(
        "observer bank against open-loop mixture on many faults", _compare_arguments, _compare
    ),
    "identify": Command("learn a rig from its logs, with intervals", _learning_arguments, _identify),
    "improve": Command(
        "show what the simulation gets wrong, name the cause, extend the model", _improve_arguments, _improve
    ),
    "simulate": Command(
        "a synthetic log with an injected fault, and its truth beside it", _simulate_arguments, _simulate
    ),
    "watch": Command("follow a live stream of samples", _watch_arguments, _watch),
    "fleet": Command("many logs, on local processes or a Dask cluster", _fleet_arguments, _fleet),
}
