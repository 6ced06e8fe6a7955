"""The command `observer-fi`: arguments, one call, output, an exit code.

Start-up counts (a whole diagnosis has two seconds), so nothing heavy is imported here: each command imports its own.
"""

import argparse
import gc
import os
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
    writable_output,
)
from observer_fi.cli.progress import tell_when_compiling
from observer_fi.errors import InvalidLogError, LostClusterError, UsageError

# New objects between two searches for cycles: those of a thousand logs are no garbage, and looking through them costs a tenth.
OBJECTS = 50_000
# How hard LLVM works on kernels, unless the environment says so: they are written as vectors and run as fast at 1 as at 3, to the
# same digits, and the first run takes a fifth less.
OPTIMISATION = "1"
# Of a product of matrices, unless the environment says so: ours are small, and moves and logs run side by side. More threads
# only wait for each other.
BLAS_THREADS = "1"


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
        os.environ.setdefault("NUMBA_OPT", OPTIMISATION)
        os.environ.setdefault("OPENBLAS_NUM_THREADS", BLAS_THREADS)
        tell_when_compiling(args)
        gc.set_threshold(OBJECTS)
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
        sub = commands.add_parser(
            name,
            help=command.help,
            description=f"{command.help[0].upper()}{command.help[1:]}.",
            epilog=command.epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name == wanted:
            command.arguments(sub)
        sub.set_defaults(run=command.run)
    return parser


# A command is a row here: its help, its arguments, its function, examples. The functions import what they need inside.
COMMANDS: dict[str, Command] = {
    "diagnose": Command(
        "detect and isolate a fault in each log",
        cli_verdicts.diagnose_arguments,
        cli_verdicts.run_diagnose,
        (
            ("diagnose monday.csv", "a verdict, and a page under reports/monday/"),
            (
                "diagnose logs/*.csv --rig reports/mine/rig.toml --out results",
                "many logs of your own machine",
            ),
            (
                "diagnose move.csv --json --fail-on-fault",
                "for a program: report.json, and exit code 3 on a fault",
            ),
        ),
    ),
    "inspect": Command(
        "what a file holds, and a column map for it",
        cli_inspection.inspect_arguments,
        cli_inspection.run_inspect,
        (
            ("inspect run.csv", "columns, units, clock, moves, and what is missing for which command"),
            ("inspect run.tdms --write", "keep the proposed map as reports/run/columns.toml"),
            ("inspect run.csv --columns map.toml", "what the file holds, read with a map"),
        ),
    ),
    "compare": Command(
        "observer bank against open-loop mixture on many faults",
        cli_synthetic.compare_arguments,
        cli_synthetic.run_compare,
        (
            ("compare", "sixty logs, a table and a page"),
            ("compare --cases 300 --seed 7 --figures pdf", "more of them, and a figure for a paper"),
        ),
    ),
    "identify": Command(
        "learn a rig from its logs, with intervals",
        cli_learning.identify_arguments,
        cli_learning.run_identify,
        (
            ("identify healthy.csv --name mine", "a rig file: reports/mine/rig.toml"),
            ("identify slow.csv fast.csv --rig mine.toml --columns map.toml", "from what a data sheet gave"),
        ),
    ),
    "improve": Command(
        "show what the simulation gets wrong, name the cause, extend the model",
        cli_learning.improve_arguments,
        cli_learning.run_improve,
        (
            ("improve campaign.csv --name mine", "causes with sizes, and reports/mine/extended_rig.toml"),
            (
                "improve campaign.csv --rig mine.toml --keep-unexplained",
                "what has no name as a curve of the rig",
            ),
        ),
    ),
    "plan": Command(
        "the next log worth recording: the moves that best tell rivals apart",
        cli_planning.plan_arguments,
        cli_planning.run_plan,
        (
            ("plan --between backlash,position_lag", "two causes that look alike"),
            ("plan --from reports/mine/improve.json --seconds 20", "what improve left open"),
            ("plan --for A,B --pitches=-10,0,10", "constants that the logs do not show"),
        ),
    ),
    "simulate": Command(
        "a synthetic log with an injected fault, and its truth beside it",
        cli_synthetic.simulate_arguments,
        cli_synthetic.run_simulate,
        (
            (
                "simulate --fault overload --at 1.6 --name monday --out .",
                "an obstacle 1.6 s after the log begins",
            ),
            (
                "simulate --moves 0.3:410:1,1.8:-410:1 --spread --seed 3",
                "there and back, by a rig of its own",
            ),
            ("simulate --effect viscous_positive=1e-6", "a motor that is not as its rig file says"),
        ),
    ),
    "watch": Command(
        "follow a live stream of samples",
        cli_verdicts.watch_arguments,
        cli_verdicts.run_watch,
        (
            (
                "watch --follow /var/log/rig.csv",
                "a file that grows: a JSON line for each change of the verdict",
            ),
            ("watch --text < samples.csv", "standard input, and words instead of JSON"),
            (
                "watch --heartbeat 10 --fail-on-fault < samples.csv",
                "a sign of life, and exit code 3 on a fault",
            ),
        ),
    ),
    "fleet": Command(
        "many logs, on local processes or a Dask cluster",
        cli_verdicts.fleet_arguments,
        cli_verdicts.run_fleet,
        (
            ("fleet logs/", "every log below a folder, and a summary that puts the worst first"),
            (
                "fleet logs/ --pattern '*.tdms' --columns map.toml --workers 4",
                "some of them, on four processes",
            ),
            ("fleet logs/ --scheduler tcp://10.0.0.5:8786", "on a running cluster"),
        ),
    ),
    "rig": Command(
        "new: a rig file from data sheets, wide where nothing is known",
        cli_rigs.rig_arguments,
        cli_rigs.run_rig,
        (
            (
                "rig new --to mine.toml --drive voltage --resistance '2.3 ohm' --speed-constant '184 rpm/V' \\\n"
                "      --rotor-inertia '520 gcm2' --lead '4 mm' --mass '6 kg' --travel '500 mm' --supply '24 V'",
                "from the units that a data sheet prints",
            ),
            (
                "rig new --drive current --resistance 8.1 --torque-constant '17.5 mNm/A' \\\n"
                "      --rotor-inertia '2.6 gcm2' --lead '1 mm'",
                "to standard output",
            ),
        ),
    ),
    "trend": Command(
        "what changed over an actuator's logs: since when, by how much, and is it real",
        cli_trends.trend_arguments,
        cli_trends.run_trend,
        (
            ("trend logs/", "the first logs are the healthy ones"),
            ("trend logs/ --baseline-logs healthy/ --false-alarm-rate 0.01", "these are"),
            ("trend logs/ --limit friction=6e-4", "when friction will reach a value"),
        ),
    ),
}
