"""The command on rig files: rig new."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from observer_fi.cli.options import OK, complain
from observer_fi.errors import UsageError

if TYPE_CHECKING:
    from observer_fi.physics import DataSheet


class Printed(NamedTuple):
    """A value of a data sheet: its name in `DataSheet`, its kind in `KINDS`, how options call it, and one line of help."""

    name: str
    kind: str
    options: tuple[str, ...]
    help: str


PRINTED = (
    Printed("resistance", "resistance", ("--resistance", "--terminal-resistance"), "of the winding, at the terminals"),
    Printed("inductance", "inductance", ("--inductance",), "of the winding, which is taken out of the voltage"),
    Printed("torque_constant", "torque_constant", ("--torque-constant",), "of the motor"),
    Printed("speed_constant", "speed_constant", ("--speed-constant",), "of the motor, in place of the torque constant"),
    Printed("back_emf", "back_emf", ("--back-emf",), "of the motor, in place of the torque constant"),
    Printed("rotor_inertia", "inertia", ("--rotor-inertia", "--inertia"), "of the rotor"),
    Printed("gear", "gear", ("--gear", "--gear-ratio"), "motor turns a turn of the screw (1)"),
    Printed("efficiency", "efficiency", ("--efficiency", "--gear-efficiency"), "of gear and screw (1)"),
    Printed("lead", "lead", ("--lead", "--screw-lead"), "travel a turn of the screw"),
    Printed("mass", "mass", ("--mass", "--moved-mass"), "that moves, with the carriage"),
    Printed("travel", "travel", ("--travel",), "from end to end"),
    Printed("supply", "voltage", ("--supply", "--nominal-voltage"), "voltage of the supply"),
    Printed("nominal_current", "current", ("--nominal-current",), "of the motor, continuous"),
    Printed("stall_current", "current", ("--stall-current",), "of the motor at the supply"),
    Printed("no_load_current", "current", ("--no-load-current",), "of the motor alone"),
    Printed("no_load_speed", "speed", ("--no-load-speed",), "of the motor alone at the supply"),
    Printed("friction_force", "force", ("--friction-force", "--friction"), "that the mass needs to keep moving, if known"),
    Printed("acceleration", "acceleration", ("--acceleration",), "commanded, of the motor, if known"),
)  # fmt: skip


def rig_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `rig`."""
    from observer_fi.physics import DRIVES, KINDS

    parser.add_argument("action", choices=("new",), metavar="new", help="write a rig file from data sheets")
    parser.add_argument("--to", type=Path, metavar="FILE", help="the rig file (standard output)")
    parser.add_argument("--name", help="name of the rig (that of the file)")
    parser.add_argument(
        "--drive", default="pi_servo", metavar="DRIVE", help=f"{', '.join(DRIVES)} (pi_servo)"
    )
    parser.add_argument(
        "--orientation",
        choices=("horizontal", "vertical"),
        default="horizontal",
        help="of the screw (horizontal)",
    )
    for one in PRINTED:
        shown = KINDS[one.kind].example.replace("%", "%%")
        parser.add_argument(*one.options, dest=one.name, metavar="VALUE", help=f'{one.help}, as "{shown}"')
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors and the rig")


def run_rig(args: argparse.Namespace) -> int:
    """A rig file from data sheets."""
    from observer_fi.physics import rig_of_sheet, rig_toml
    from observer_fi.report import write_file

    made = rig_of_sheet(_sheet(args))
    text = rig_toml(made.rig)
    if args.to is not None:
        if args.to.exists():
            raise UsageError(f"{args.to}: is there already; choose another name or move it away")
        write_file(args.to, text)
    for warning in made.warnings:
        complain(f"warning: {warning}")
    if args.to is None:
        print(text, end="")
    elif not args.quiet:
        guessed = [name for name, q in made.rig.quantities.items() if q.method == "guess"]
        print(
            f"{args.to}: drive {made.rig.drive}, {len(made.rig.quantities)} values, guessed: {', '.join(guessed) or 'none'}"
        )
        print(f"next: observer-fi identify HEALTHY_LOG --rig {args.to}")
    return OK


def _sheet(args: argparse.Namespace) -> "DataSheet":
    """What the options say. Raises UsageError naming the option."""
    from observer_fi.physics import DataSheet, value_of

    values: dict[str, float] = {}
    notes: list[str] = []
    for one in PRINTED:
        text = getattr(args, one.name)
        if text is None:
            continue
        value, note = value_of(text, one.kind, one.options[0])
        values[one.name] = value
        notes += [note] if note else []
    name = args.name or (args.to.stem if args.to is not None else "rig")
    return DataSheet(name=name, drive=args.drive, orientation=args.orientation, notes=tuple(notes), **values)
