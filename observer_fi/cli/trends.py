"""The command on an actuator's life: trend."""

import argparse
import os
from typing import TYPE_CHECKING

from observer_fi.cli.options import (
    OK,
    USAGE,
    add_common,
    add_figures,
    add_rig,
    at_least,
    complain,
    emit_json,
    finite,
    still_figures,
    taken,
)
from observer_fi.cli.progress import progress
from observer_fi.errors import UsageError

if TYPE_CHECKING:
    from observer_fi.physics import Rig
    from observer_fi.trend import Digest


def trend_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `trend`."""
    parser.add_argument("logs", nargs="+", metavar="LOG|DIR", help="logs of one actuator, or folders of them")
    parser.add_argument("--columns", metavar="MAP.toml", help="names and units of the logs' columns")
    parser.add_argument("--name", help="name of the output folder (that of the first log or folder)")
    add_rig(parser, settings=False)
    parser.add_argument(
        "--baseline", metavar="RIG.toml", help="the constants of this rig file are the healthy state"
    )
    parser.add_argument(
        "--baseline-logs", nargs="+", metavar="LOG|DIR", help="these logs are healthy (the first of LOG)"
    )
    parser.add_argument(
        "--false-alarm-rate", type=_rate, default=1e-3, metavar="P", help="false alarms per log (0.001)"
    )
    parser.add_argument(
        "--limit", action="append", type=_limit, default=[], metavar="NAME=VALUE",
        help="when a quantity will reach this value: friction, play, delay, or a name from trend.json",
    )  # fmt: skip
    parser.add_argument(
        "--workers", type=at_least(1), default=os.cpu_count() or 2, help="local processes (one a core)"
    )
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="a running Dask cluster instead")
    add_common(parser)
    add_figures(parser)


def run_trend(args: argparse.Namespace) -> int:
    """What changed over the logs, since when, by how much."""
    from observer_fi.physics import load_rig
    from observer_fi.report import (
        Made,
        folder_name,
        ours,
        reports_below,
        trend_files,
        trend_headline,
        trend_json,
        write_result,
    )
    from observer_fi.serve import digests, fleet
    from observer_fi.trend import trend

    if args.baseline and args.baseline_logs:
        raise UsageError("--baseline and --baseline-logs: give one of them")
    name = folder_name(args.name, args.logs[0].rstrip("/"))
    paths = digests.logs_in(args.logs)
    healthy = [p for p in digests.logs_in(args.baseline_logs or []) if p not in paths]
    inside = [p for p in digests.logs_in(args.baseline_logs or []) if p in paths]
    baseline_rig = load_rig(args.baseline) if args.baseline else None
    bad: list[str] = []
    rig = _rig(args, paths)
    found = {d.path: d for d in _digests(args, [*paths, *healthy], rig, bad)}
    logs = [found[p] for p in paths if p in found]
    if not logs:
        return USAGE  # each log has been told with its reason
    chosen = [found[p] for p in (*healthy, *inside) if p in found]
    if args.baseline_logs and not chosen:
        raise UsageError("--baseline-logs: none of them could be read")
    result = trend(logs, rig, args.false_alarm_rate, chosen, baseline_rig, dict(args.limit))
    made = Made("trend", {d.path: d.sha256 for d in logs}, grows=True)
    reports = reports_below(args.out, [d.path for d in logs])
    summary = f"../{fleet.INDEX}" if fleet.INDEX in ours(args.out) else ""
    files: dict[str, str | bytes] = {**trend_files(result, name, bad, reports, summary)}
    files |= still_figures(args, result)
    folder = write_result(args.out, name, made, files)
    taken(args.logs[0], name, folder)
    if args.json:
        emit_json(trend_json(result, bad))
    elif not args.quiet:
        print(f"{folder.name}: {trend_headline(result)}  {folder / 'trend.html'}")
    return USAGE if bad else OK


def _rig(args: argparse.Namespace, paths: list[str]) -> "Rig":
    """The rig that was named; else the default one where logs have a voltage, and one without constants where they have none."""
    from observer_fi.logs import load_columns, open_log
    from observer_fi.physics import load_rig
    from observer_fi.trend import rig_without_constants

    if args.rig or args.baseline:
        return load_rig(args.rig or args.baseline)
    columns = load_columns(args.columns) if args.columns else None
    for path in paths:
        try:
            known = open_log(path, columns).columns
        except ValueError:  # a log that cannot be read is told when its turn comes
            continue
        return load_rig(None) if "voltage_v" in known else rig_without_constants()
    return load_rig(None)


def _digests(args: argparse.Namespace, paths: list[str], rig: "Rig", bad: list[str]) -> "list[Digest]":
    from observer_fi.logs import PLAIN, load_columns
    from observer_fi.serve import digests

    job = digests.DigestJob(
        args.out / digests.KEPT, rig, load_columns(args.columns) if args.columns else PLAIN
    )

    def say(line: str) -> None:
        bad.append(line)
        complain(line)

    under_way = digests.digests(paths, job, args.workers, args.scheduler, say)
    return list(progress(under_way, args, len(paths), "log"))


def _rate(text: str) -> float:
    value = finite(text)
    if not 1e-9 <= value <= 0.5:
        raise argparse.ArgumentTypeError(f"a share of logs from 1e-9 to 0.5 is needed, not {text[:40]!r}")
    return value


def _limit(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"NAME=VALUE is needed, as in friction=6e-4, not {text[:40]!r}")
    return name, finite(value)
