"""Commands that learn from logs: identify, improve."""

import argparse
from typing import TYPE_CHECKING, Any

from observer_fi.cli.options import OK, add_common, add_logs, add_rig, emit_json, step, taken
from observer_fi.errors import UsageError

if TYPE_CHECKING:
    from observer_fi.physics import Rig
    from observer_fi.records import Log
    from observer_fi.report import Made

Improved = tuple[dict[str, Any], dict[str, str], str]  # JSON, files, headline


def identify_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `identify`."""
    add_logs(parser)
    add_rig(parser, settings=False)
    add_common(parser)


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
    from observer_fi.logs import load_columns, read_log, with_command

    columns = load_columns(args.columns) if args.columns else None
    logs = [read_log(path, columns) for path in dict.fromkeys(args.logs)]
    return logs if rig.drive == "force" else [with_command(log, rig.model) for log in logs]


def run_identify(args: argparse.Namespace) -> int:
    """A rig learned from its logs."""
    from observer_fi.learn import identified_rig, identify, residuals_by_phase
    from observer_fi.physics import load_rig
    from observer_fi.report import folder_name, identify_files, identify_json, write_result

    rig, name = load_rig(args.rig), folder_name(args.name, args.logs[0])
    logs = _learning_logs(args, rig)
    fit = identify(logs, rig)
    by_phase = residuals_by_phase(logs, fit, rig.model)
    files = identify_files(fit, rig, identified_rig(fit, rig), by_phase, name, list(args.logs))
    folder = write_result(args.out, name, _made("identify", logs), files)
    taken(args.logs[0], name, folder)
    if args.json:
        emit_json(identify_json(fit))
    elif not args.quiet:
        told = f", {len(fit.not_identifiable)} cannot be told" if fit.not_identifiable else ""
        print(f"{folder.name}: {len(fit.parameters)} parameters learned{told}  {folder / 'identify.html'}")
    return OK


def run_improve(args: argparse.Namespace) -> int:
    """What the simulation gets wrong, and the extended rig."""
    from observer_fi.physics import load_rig
    from observer_fi.report import folder_name, write_result

    rig, name = load_rig(args.rig), folder_name(args.name, args.logs[0])
    logs = _learning_logs(args, rig)
    improved = _improve_force if rig.drive == "force" else _improve_servo
    result, files, headline = improved(logs, rig, name, args)
    folder = write_result(args.out, name, _made("improve", logs), files)
    taken(args.logs[0], name, folder)
    if args.json:
        emit_json(result)
    elif not args.quiet:
        print(f"{folder.name}: {headline}  {folder / 'improve.html'}")
    return OK


def _made(command: str, logs: "list[Log]") -> "Made":
    from observer_fi.report import Made

    return Made(command, {log.path: log.sha256 for log in logs})


def _improve_servo(logs: "list[Log]", rig: "Rig", name: str, args: argparse.Namespace) -> Improved:
    """A rig with a servo: simulated moves against measured ones."""
    from observer_fi.improve import improve, worth
    from observer_fi.learn import with_servo
    from observer_fi.logs import excitation, log_segments
    from observer_fi.report import improve_files, improve_headline, improve_json
    from observer_fi.settings import Settings

    tell = step(args)
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
    from observer_fi.improve import inverse_json, name_causes
    from observer_fi.learn import prepare_motion
    from observer_fi.report import inverse_files, inverse_headline

    ladder = name_causes(rig, [prepare_motion(log) for log in logs], progress=step(args))
    return inverse_json(ladder), inverse_files(ladder, name, list(args.logs)), inverse_headline(ladder)
