"""The command that says what to record next: plan."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from observer_fi.cli.options import OK, add_common, add_figures, add_rig, emit_json, finite, still_figures
from observer_fi.cli.progress import Stages
from observer_fi.cli.synthetic import numbers
from observer_fi.errors import UsageError

if TYPE_CHECKING:
    from observer_fi.physics import Rig
    from observer_fi.plan import Limits, Plan


# What each stage usually takes of the whole.
SHARES = {
    "sizes of the rivals": 0.1, "what each kind": 0.1, "the best profile": 0.1, "does it decide": 0.7,
}  # fmt: skip


def plan_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `plan`."""
    asked = parser.add_mutually_exclusive_group(required=True)
    asked.add_argument(
        "--between",
        metavar="CAUSE[:PARAMETER=VALUE;...],...",
        help="causes to tell apart, or one to show; without a size: what a usual campaign would just name",
    )
    asked.add_argument(
        "--from",
        dest="improved",
        type=Path,
        metavar="improve.json",
        help="a finding of improve and its rivals",
    )
    asked.add_argument(
        "--faults",
        metavar="FAULT,...",
        help="faults to tell apart, as coupling_loss,sensor_fault:position (a frozen sensor)",
    )
    asked.add_argument(
        "--for", dest="constants", metavar="CONSTANT,...", help="constants of the rig to learn, as A,B"
    )
    parser.add_argument("--seconds", type=finite, default=10.0, help="how long the log may be [s] (10)")
    parser.add_argument(
        "--pitches", default="0", metavar="DEG,...", help="levels of pitch that can be set [deg] (0)"
    )
    parser.add_argument("--speed", type=finite, help="highest speed [rad/s] (0.6 of what the supply holds)")
    parser.add_argument(
        "--travel",
        metavar="LOW:HIGH",
        help="how far the mass may go from where the log begins [mm] (the stops of the rig file)",
    )
    parser.add_argument("--rate", type=finite, default=1600.0, help="samples a second of the logger (1600)")
    parser.add_argument("--name", default="plan", help="name of the output folder (plan)")
    add_rig(parser, settings=False)
    add_figures(parser)
    add_common(parser)


def run_plan(args: argparse.Namespace) -> int:
    """The moves to record next, as a CSV that a controller can play."""
    from observer_fi.physics import load_rig
    from observer_fi.plan import in_lines, limits_of, to_json
    from observer_fi.report import Made, checked_name, plan_files, write_result

    rig = load_rig(args.rig)
    checked_name(args.name)
    pitches = tuple(_number(p, "--pitches") for p in args.pitches.split(","))
    travel = None
    if args.travel is not None:
        low, high = numbers(args.travel, ":", 2, "--travel")
        travel = 1e-3 * low, 1e-3 * high
    limits = limits_of(rig, args.seconds, pitches, args.speed, travel, args.rate)
    with Stages(args, SHARES) as tell:
        plan = _planned(args, rig, limits, tell)
    result = to_json(plan)
    made = Made("plan", {})
    folder = write_result(args.out, args.name, made, {**plan_files(plan), **still_figures(args, plan)})
    if args.json:
        emit_json(result)
    elif not args.quiet:
        print("\n".join([*in_lines(plan), str(folder / "moves.csv"), str(folder / "plan.html")]))
    return OK


def _number(text: str, option: str) -> float:
    return numbers(text, ":", 1, option)[0]


def _planned(args: argparse.Namespace, rig: "Rig", limits: "Limits", tell: Stages) -> "Plan":
    from observer_fi.plan import asked_by, parse, plan_causes, plan_constants, plan_faults

    if args.faults is not None:
        return plan_faults(args.faults, rig, limits, tell)
    if args.constants is not None:
        names = tuple(filter(None, (n.strip() for n in args.constants.split(","))))
        if not names:
            raise UsageError("--for: name at least one constant, as A")
        return plan_constants(names, rig, limits, tell)
    return plan_causes(asked_by(args.improved) if args.improved else parse(args.between), rig, limits, tell)
