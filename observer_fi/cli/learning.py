"""Commands that learn from logs: identify, improve."""

import argparse
from typing import TYPE_CHECKING

from observer_fi.cli.options import (
    OK,
    add_common,
    add_figures,
    add_logs,
    add_rig,
    complain,
    emit_json,
    still_figures,
    taken,
)
from observer_fi.cli.progress import Stages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from observer_fi.physics import Rig
    from observer_fi.records import Filter, Log
    from observer_fi.report import Made


# What each stage usually takes of the whole, measured on campaigns of 20 to 25 s.
IDENTIFY_SHARES = {"learning the rig": 0.4, "what the fit leaves": 0.6}
IMPROVE_SHARES = {
    "refit of the rig": 0.05, "scores, 0": 0.2, "scores, 1": 0.06, "which equation": 0.1, "what stays": 0.02,
    "what diagnose says": 0.3, "what diagnose gains": 0.27,
}  # fmt: skip


def identify_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `identify`."""
    add_logs(parser)
    add_rig(parser, settings=False)
    add_common(parser)
    add_figures(parser)


def improve_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `improve`."""
    identify_arguments(parser)
    parser.add_argument(
        "--keep-unexplained",
        action="store_true",
        help="what no cause explains becomes an empirical curve of the extended rig, if it helps on held-out moves",
    )


def _learning_logs(args: argparse.Namespace, rig: "Rig") -> "list[Log]":
    """All logs of one rig; unlike in diagnose, one that cannot be read ends the command: the result would not be of them all."""
    from observer_fi.logs import load_columns, read_log, thinned, with_command

    columns = load_columns(args.columns) if args.columns else None
    logs = [thinned(read_log(path, columns), rig) for path in dict.fromkeys(args.logs)]
    return [with_command(log, rig) for log in logs] if rig.driven.motor else logs


def run_identify(args: argparse.Namespace) -> int:
    """A rig learned from its logs."""
    from observer_fi.learn import (
        identified_rig,
        identify,
        residuals_by_phase,
        too_many_moves,
        with_equation_errors,
    )
    from observer_fi.logs import filtered_logger, with_command, with_logger
    from observer_fi.physics import load_rig
    from observer_fi.report import folder_name, identify_files, identify_json, write_result

    rig, name = load_rig(args.rig), folder_name(args.name, args.logs[0])
    logs = _learning_logs(args, rig)
    note = _told(too_many_moves(logs, rig) if rig.driven.servo else "")
    with Stages(args, IDENTIFY_SHARES) as tell:
        tell("learning the rig")
        fit = identify(logs, rig)
        tell("what the fit leaves")
        by_phase = residuals_by_phase(logs, fit, rig)
        found = identified_rig(fit, rig)
        logs = [with_command(log, found) for log in logs] if found.driven.motor else logs
        logged = filtered_logger(with_logger(found, logs), fit.filters, logs[0].rate_hz)
        learned = with_equation_errors(logged, logs, fit.filters)
    _tell_readings(fit.filters, fit.warnings)
    files = identify_files(fit, rig, learned, by_phase, name, list(args.logs), note)
    still = still_figures(args, fit)
    folder = write_result(args.out, name, _made("identify", logs), {**files, **still})
    taken(args.logs[0], name, folder)
    if args.json:
        emit_json(identify_json(fit))
    elif not args.quiet:
        unlearned = f", {len(fit.not_identifiable)} cannot be told" if fit.not_identifiable else ""
        print(
            f"{folder.name}: {len(fit.parameters)} parameters learned{unlearned}  {folder / 'identify.html'}"
        )
    return OK


def run_improve(args: argparse.Namespace) -> int:
    """What the simulation gets wrong, and the extended rig."""
    from observer_fi.improve import MOST_ROWS, diagnosis_gain, improve
    from observer_fi.learn import too_many_moves
    from observer_fi.physics import load_rig
    from observer_fi.plan import with_moves
    from observer_fi.report import (
        folder_name,
        improve_files,
        improve_headline,
        improve_json,
        write_result,
    )

    rig, name = load_rig(args.rig), folder_name(args.name, args.logs[0])
    logs = _learning_logs(args, rig)
    note = _told(too_many_moves(logs, rig, MOST_ROWS))
    with Stages(args, IMPROVE_SHARES) as tell:
        record = improve(logs, rig, progress=tell, keep_unexplained=args.keep_unexplained)
        if any(f.indistinguishable_from for f in record.findings):
            tell("which move tells rivals apart")
            record = with_moves(record, logs)
        tell("what diagnose gains on simulated faults")
        gain = diagnosis_gain(record.rig, record.extended_rig)
    _tell_readings(record.filters, record.warnings)
    files = improve_files(record, gain, name, list(args.logs), note)
    still = still_figures(args, record)
    folder = write_result(args.out, name, _made("improve", logs), {**files, **still})
    taken(args.logs[0], name, folder)
    if args.json:
        emit_json(improve_json(record, gain))
    elif not args.quiet:
        print(f"{folder.name}: {improve_headline(record)}  {folder / 'improve.html'}")
    return OK


def _told(note: str) -> str:
    """A note on the whole command, which its page has, too."""
    if note:
        complain(note)
    return note


def _tell_readings(filters: "Sequence[Filter]", warnings: "Sequence[str]") -> None:
    """What the logger has before its readings, and what else was found in them, on the terminal."""
    from observer_fi.logs import told_filter

    for text in (*map(told_filter, filters), *warnings):
        complain(text)


def _made(command: str, logs: "list[Log]") -> "Made":
    from observer_fi.report import Made

    return Made(command, {log.path: log.sha256 for log in logs})
