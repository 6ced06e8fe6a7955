"""Commands on logs and streams that ask for a verdict: diagnose, watch, fleet."""

import argparse
import os
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from observer_fi.cli.options import (
    BUG,
    FAULT,
    OK,
    USAGE,
    add_common,
    add_engine,
    add_figures,
    add_logs,
    add_rig,
    at_least,
    complain,
    emit_json,
    finite,
    say,
    seconds,
    still_figures,
    taken,
)
from observer_fi.cli.progress import progress, share_of
from observer_fi.errors import InvalidLogError, LostClusterError, UsageError


def diagnose_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `diagnose`."""
    add_logs(parser)
    add_rig(parser)
    add_engine(parser)
    add_common(parser)
    add_figures(parser)
    parser.add_argument(
        "--detected-at", type=finite, metavar="T", help="detection time from outside, on the log's clock [s]"
    )
    parser.add_argument(
        "--fail-on-fault", action="store_true", help="exit with 3 if a verdict is not nominal"
    )


def run_diagnose(args: argparse.Namespace) -> int:
    """A verdict and a report for each log; a bad one never stops the others."""
    from observer_fi.logs import load_columns
    from observer_fi.physics import load_rig
    from observer_fi.report import diagnosis as report
    from observer_fi.report import folder_name
    from observer_fi.settings import load_settings
    from observer_fi.verdict import diagnose

    rig, settings = load_rig(args.rig), load_settings(args.settings)
    columns = load_columns(args.columns) if args.columns else None
    names = {path: folder_name(args.name, path) for path in dict.fromkeys(args.logs)}

    def one(path: str) -> dict[str, Any]:
        with share_of(args, names[path], alone=len(names) == 1) as told:
            outcome = diagnose(
                path, rig, settings, engine=args.engine, filter_kind=args.filter, columns=columns,
                detected_at=args.detected_at, progress=told,
            )  # fmt: skip
        if outcome.error is not None:
            raise InvalidLogError(outcome.error)
        still = still_figures(args, outcome)
        folder = report.write(outcome, rig, args.out / names[path], still)
        taken(path, names[path], folder)
        if not args.quiet and not args.json:
            for warning in outcome.warnings:
                say(f"{folder.name}: warning: {warning}")
            say(f"{folder.name}: {report.headline(outcome)}  {folder / 'report.html'}")
        return report.report_dict(outcome)

    shown = [_one_of(names, one, path) for path in progress(names, args, len(names), "log")]
    errors = [result for result in shown if "error" in result]
    if args.json and (len(names) > 1 or not errors):
        emit_json(shown if len(names) > 1 else shown[0])
    if errors:
        if len(names) > 1:
            complain(f"{len(errors)} of {len(names)} logs could not be read; the others are done")
        return BUG if any(result.get("bug") for result in errors) else USAGE
    faulty = any(result["verdict"]["label"] != "nominal" for result in shown)
    return FAULT if faulty and args.fail_on_fault else OK


def _one_of(logs: Collection[str], judge: Callable[[str], dict[str, Any]], path: str) -> dict[str, Any]:
    """The result of one log, or what is wrong with it. What we did not foresee stops no other log, if there are others."""
    try:
        return judge(path)
    except InvalidLogError as error:
        complain(str(error))
        return {"log": {"path": path}, "error": str(error)}
    except (UsageError, BrokenPipeError):
        raise
    except Exception as error:
        if len(logs) == 1:
            raise
        said = f"{path}: a bug of observer-fi, please report it ({type(error).__name__}: {error})"
        complain(said)
        return {"log": {"path": path}, "error": said, "bug": True}


def watch_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `watch`."""
    parser.add_argument("--follow", type=Path, metavar="FILE", help="a growing file (standard input)")
    parser.add_argument("--columns", metavar="MAP.toml", help="names and units of the columns")
    parser.add_argument(
        "--every", type=at_least(0), default=0, metavar="N", help="the posterior of every Nth sample too"
    )
    parser.add_argument(
        "--heartbeat", type=seconds, default=0.0, metavar="S", help="a line every S seconds, changed or not"
    )
    add_rig(parser)
    add_engine(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="JSON lines, which it writes without --text")
    form.add_argument("--text", action="store_true", help="the same in words, a line a change")
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
        "--workers", type=at_least(1), default=os.cpu_count() or 2, help="local processes (one a core)"
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

    columns = {"columns": load_columns(args.columns)} if args.columns else {}
    rig, settings = load_rig(args.rig), load_settings(args.settings)
    job = fleet.Job(args.folder, args.out, rig, settings, args.engine, args.filter, **columns)
    fleet.check_summary(job)
    names = fleet.find_logs(job, args.pattern, complain)
    rows, todo = fleet.split(job, names)
    lost = ""
    try:
        for row in progress(fleet.run(job, todo, args.workers, args.scheduler), args, len(todo), "log"):
            rows.append(row)
    except LostClusterError as error:
        lost = str(error)
    for problem in fleet.problems(rows):
        complain(problem)
    if lost:
        left = fleet.not_done(names, rows, lost)
        rows += left
        complain(
            f"{lost}: {len(left)} of {len(names)} logs are not done; run the same command again to go on"
        )
    fleet.write_summary(job, rows + fleet.other_rows(job, names, args.pattern))
    if args.json:
        emit_json({"schema": "observer-fi/fleet/1", "read": len(todo), "logs": fleet.worst_first(rows)})
    elif not args.quiet:
        print(f"{fleet.headline(rows, len(todo))}\n{args.out / fleet.INDEX}")
    if lost:
        return BUG
    if any(row["status"] != "done" for row in rows):
        return USAGE
    faulty = any(row["label"] != "nominal" for row in rows)
    return FAULT if faulty and args.fail_on_fault else OK
