"""The command `observer-fi`: arguments, one call, output, an exit code.

Start-up counts (a whole diagnosis has two seconds), so nothing heavy is imported here: each command imports its own.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import NoReturn

from observer_fi import __version__
from observer_fi.cli import inspection as cli_inspection
from observer_fi.cli import learning as cli_learning
from observer_fi.cli import planning as cli_planning
from observer_fi.cli import rigs as cli_rigs
from observer_fi.cli import synthetic as cli_synthetic
from observer_fi.cli import trends as cli_trends
from observer_fi.cli import verdicts as cli_verdicts
from observer_fi.cli.options import (
    BUG,
    OK,
    USAGE,
    Command,
    complain,
    give_up_output,
    tell_when_compiling,
    writable_output,
)
from observer_fi.errors import InvalidLogError, LostClusterError, UsageError


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
        writable_output()
        tell_when_compiling(args)
        code = int(args.run(args))
        sys.stdout.flush()
        return code
    except (InvalidLogError, UsageError) as error:
        complain(str(error))
        return USAGE
    except LostClusterError as error:
        complain(f"{error}: run the same command again to go on")
        return BUG
    except BrokenPipeError:  # the reader of our output has gone: nothing to tell it
        give_up_output()
        return OK
    except OSError as error:
        if error.filename is not None:  # of files and folders commands tell themselves
            raise
        give_up_output()
        complain(f"cannot read or write ({error}); look for a full disk or a closed output")
        return USAGE
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


# A command is a row here: its help, its arguments, its function. Both import what they need inside.
COMMANDS: dict[str, Command] = {
    "diagnose": Command(
        "detect and isolate a fault in each log", cli_verdicts.diagnose_arguments, cli_verdicts.run_diagnose
    ),
    "inspect": Command(
        "what a file holds, and a column map for it",
        cli_inspection.inspect_arguments,
        cli_inspection.run_inspect,
    ),
    "compare": Command(
        "observer bank against open-loop mixture on many faults",
        cli_synthetic.compare_arguments,
        cli_synthetic.run_compare,
    ),
    "identify": Command(
        "learn a rig from its logs, with intervals",
        cli_learning.identify_arguments,
        cli_learning.run_identify,
    ),
    "improve": Command(
        "show what the simulation gets wrong, name the cause, extend the model",
        cli_learning.improve_arguments,
        cli_learning.run_improve,
    ),
    "plan": Command(
        "the next log worth recording: the moves that best tell rivals apart",
        cli_planning.plan_arguments,
        cli_planning.run_plan,
    ),
    "simulate": Command(
        "a synthetic log with an injected fault, and its truth beside it",
        cli_synthetic.simulate_arguments,
        cli_synthetic.run_simulate,
    ),
    "watch": Command("follow a live stream of samples", cli_verdicts.watch_arguments, cli_verdicts.run_watch),
    "fleet": Command(
        "many logs, on local processes or a Dask cluster",
        cli_verdicts.fleet_arguments,
        cli_verdicts.run_fleet,
    ),
    "rig": Command(
        "new: a rig file from data sheets, wide where nothing is known",
        cli_rigs.rig_arguments,
        cli_rigs.run_rig,
    ),
    "trend": Command(
        "what changed over an actuator's logs: since when, by how much, and is it real",
        cli_trends.trend_arguments,
        cli_trends.run_trend,
    ),
}
