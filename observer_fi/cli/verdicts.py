"""Commands on logs and streams that ask for a verdict: diagnose, watch, fleet."""

import argparse
import os
from pathlib import Path
from typing import Any

from observer_fi.cli.options import (
    FAULT,
    OK,
    USAGE,
    add_common,
    add_engine,
    add_logs,
    add_rig,
    complain,
    emit_json,
    folder_names,
    progress,
)
from observer_fi.errors import InvalidLogError, UsageError


def diagnose_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `diagnose`."""
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


def run_diagnose(args: argparse.Namespace) -> int:
    """A verdict and a report for each log; a bad one never stops the others."""
    from observer_fi.logs import load_columns
    from observer_fi.physics import load_rig
    from observer_fi.report import diagnosis as report
    from observer_fi.settings import load_settings
    from observer_fi.verdict import diagnose

    rig, settings = load_rig(args.rig), load_settings(args.settings)
    columns = load_columns(args.columns) if args.columns else None
    names, notes = folder_names(args.logs, args.name)
    for note in notes:
        complain(note)
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
            complain(str(error))
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
            complain(f"{bad} of {len(names)} logs could not be read; the others are done")
        return USAGE
    return FAULT if faults and args.fail_on_fault else OK


def watch_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `watch`."""
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


def run_watch(args: argparse.Namespace) -> int:
    """The bank on a live stream."""
    from observer_fi.serve import watch

    return watch.run(args, complain)


def fleet_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `fleet`."""
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


def run_fleet(args: argparse.Namespace) -> int:
    """Many logs, and a summary of them."""
    from observer_fi.logs import load_columns
    from observer_fi.physics import load_rig
    from observer_fi.serve import fleet
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
        complain(problem)
    if args.json:
        emit_json({"schema": "observer-fi/fleet/1", "read": len(todo), "logs": fleet.worst_first(rows)})
    elif not args.quiet:
        print(f"{fleet.headline(rows, len(todo))}\n{args.out / fleet.INDEX}")
    if any(row["status"] != "done" for row in rows):
        return USAGE
    faulty = any(row["label"] != "nominal" for row in rows)
    return FAULT if faulty and args.fail_on_fault else OK
