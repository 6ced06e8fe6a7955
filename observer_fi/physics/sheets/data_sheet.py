"""A rig from data sheets: what is printed, what follows from it, and a guess for what no sheet says, each marked as such.

Letters as in `equations.py`, all of the motor side: D = lead / (2 pi gear), masses count with D^2, forces with D.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from observer_fi.errors import UsageError
from observer_fi.numerics import digits
from observer_fi.physics.drives import DRIVES
from observer_fi.physics.equations import PARAMETERS
from observer_fi.physics.rigs import Quantity, Rig, unknown_name
from observer_fi.physics.sheets.derived import DERIVED, GUESS, SHEET, derived

PRINTED = 0.05  # what a data sheet's values are good for, from motor to motor
GEARED = 0.01  # a gear of 14:1 may be one of 13.8
ROUNDED = 1e-3
AGREE, CONTRADICT = 0.025, 0.1  # between constants that are one number: told, refused
TIMES = (1e-4, 3.0)  # s, mechanical time constants beyond which a unit must be wrong
ODD_TIMES = (5e-4, 0.3)  # beyond which it may be
FAST, SLOW = 5.0, 3600.0  # m/s, and s for the travel, beyond which a unit may be wrong
TURNING_PARTS = 0.15  # inertia of gear, coupling and screw, as a share of the rotor's
USUAL_TIME_S = 0.01  # mechanical time constant of a motor of which nobody knows
USUAL_MASS = 0.3  # inertia of a mass that nobody knows, as a share of the rotor's
# Friction that nobody knows, as a share of the torque at nominal current, or at stall.
OF_NOMINAL, OF_STALL = 0.2, 0.04
STEADY = 1e3  # rad/s^2: friction of a rig of which only the inertia is known
OWN_FRICTION = 0.02  # of a motor, as a share of its torque at stall
# The loop of a servo that nobody knows: its ringing decays within, and rings at. A position loop is ten times slower.
DECAY_S, RINGING, FOLLOWS = 0.06, 100.0, 10.0
SOURCE_OHM = 0.03  # resistance of the supply, as a share of the winding's
RAMP_S = 0.02  # in which a servo is told to reach full speed
# A card of 18 bits for twice the supply, the current at stall, the travel: what a log shows beyond that is taken from it.
CARD = 2.0 / 2**18 / math.sqrt(12.0)
G = 9.80665


@dataclass(frozen=True)
class DataSheet:
    """What data sheets print, SI units; None where they are silent.

    acceleration: commanded, rad/s^2 of the motor. travel: from end to end. friction_force: at the mass. speed_constant:
    rad/s a volt. orientation: "horizontal" or "vertical". notes: what must be told of its values.
    """

    name: str
    drive: str
    lead: float | None = None
    resistance: float | None = None
    inductance: float | None = None
    torque_constant: float | None = None
    speed_constant: float | None = None
    back_emf: float | None = None
    rotor_inertia: float | None = None
    gear: float = 1.0
    efficiency: float = 1.0
    mass: float | None = None
    travel: float | None = None
    supply: float | None = None
    nominal_current: float | None = None
    stall_current: float | None = None
    no_load_current: float | None = None
    no_load_speed: float | None = None
    friction_force: float | None = None
    acceleration: float | None = None
    orientation: str = "horizontal"
    notes: tuple[str, ...] = field(default=())


class FromSheet(NamedTuple):
    """A rig, and what must be told of it."""

    rig: Rig
    warnings: tuple[str, ...]


def rig_of_sheet(sheet: DataSheet) -> FromSheet:
    """The rig of a data sheet: printed values, derived ones and wide guesses, each with its source.

    Raises UsageError for what the drive needs and the sheet has not, and for values that contradict each other.
    """
    if sheet.drive not in DRIVES:
        raise unknown_name(sheet.drive, tuple(DRIVES), "drive")
    made = _Maker(sheet)
    quantities = made.quantities()
    warnings = (*sheet.notes, *made.warnings)
    facts = [f"{sheet.orientation} screw of {1e3 * made.need('lead'):g} mm a turn"]
    facts += [f"gear {sheet.gear:g}:1"] if sheet.gear != 1.0 else []
    facts += [f"travel {1e3 * sheet.travel:g} mm"] if sheet.travel else []
    described = "; ".join([", ".join(facts), *(f"warning: {w}" for w in warnings)])
    source = "data sheets; what they do not say is guessed: run identify on healthy moves"
    L = Quantity(sheet.inductance, "H", SHEET) if sheet.inductance and DRIVES[sheet.drive].motor else None
    rig = Rig(sheet.name, described, sheet.drive, quantities, made.noise(), source, inductance=L)
    return FromSheet(rig, warnings)


class _Maker:
    """One rig in the making: values by letter, and what is odd about them."""

    def __init__(self, sheet: DataSheet) -> None:
        self.sheet = sheet
        self.found: dict[str, Quantity] = {}
        self.warnings: list[str] = []

    def need(self, name: str) -> float:
        """A value of the sheet. Raises UsageError where it is missing."""
        value = getattr(self.sheet, name)
        if value is None:
            raise UsageError(f"drive {self.sheet.drive!r} needs --{name.replace('_', '-')} of the data sheet")
        return float(value)

    def quantities(self) -> dict[str, Quantity]:
        self._put(
            "D", self.need("lead") / (2.0 * math.pi * self.sheet.gear), DERIVED, self._lead(), self._exact()
        )
        if DRIVES[self.sheet.drive].motor:
            self._motor()
        self._inertia()
        self._friction()
        if DRIVES[self.sheet.drive].motor:
            self._gravity()
            if DRIVES[self.sheet.drive].servo:
                self._servo()
            self._rest()
            self._check()
        return {name: self.found[name] for name in PARAMETERS if name in self.found}

    def noise(self) -> dict[str, float]:
        """Standard deviations that no logger goes below, V, A, m."""
        sheet, volts = self.sheet, self.sheet.supply or 24.0
        amperes = self._stall_current() or 10.0 * (sheet.nominal_current or 0.1)
        metres = sheet.travel or 10.0 * (sheet.lead or 1e-3)
        return {"voltage": CARD * volts, "current": CARD * amperes, "position": CARD * metres}

    def _put(self, name: str, value: float, method: str, source: str, spread: float) -> None:
        self.found[name] = Quantity(value, PARAMETERS[name][0], method, source, round(spread, 4))

    def _value(self, name: str) -> float:
        return self.found[name].value

    def _lead(self) -> str:
        gear = f", gear {self.sheet.gear:g}:1" if self.sheet.gear != 1.0 else ""
        return f"{1e3 * self.need('lead'):g} mm a turn{gear}"

    def _exact(self) -> float:
        return ROUNDED if self.sheet.gear == 1.0 else GEARED

    # --- the motor ------------------------------------------------------------------------------

    def _motor(self) -> None:
        sheet = self.sheet
        if (
            "Rm" in DRIVES[sheet.drive].requires
            and sheet.resistance is None
            and sheet.stall_current
            and sheet.supply
        ):
            self._put(
                "Rm", sheet.supply / sheet.stall_current, DERIVED, "supply over stall current", 2.0 * PRINTED
            )
        elif "Rm" in DRIVES[sheet.drive].requires or sheet.resistance is not None:
            self._put("Rm", self.need("resistance"), SHEET, "terminal resistance", PRINTED)
        sources = dict(self._torque_constants())
        if not sources:
            raise UsageError(
                f"drive {sheet.drive!r} needs --torque-constant, --speed-constant or --back-emf of the motor's data sheet"
            )
        name, Km = next(iter(sources.items()))
        for other, value in sources.items():
            self._agree(name, Km, other, value)
        self._put("Km", Km, SHEET, name, PRINTED)

    def _torque_constants(self) -> Iterator[tuple[str, float]]:
        """Km [N m/A] by where it is printed: a torque constant in N m/A is a back EMF in V s/rad."""
        sheet = self.sheet
        if sheet.torque_constant is not None:
            yield "torque constant", sheet.torque_constant
        if sheet.speed_constant is not None:
            yield "speed constant", 1.0 / sheet.speed_constant
        if sheet.back_emf is not None:
            yield "back EMF", sheet.back_emf
        if sheet.no_load_speed is not None and sheet.supply is not None:
            drop = (sheet.no_load_current or 0.0) * (sheet.resistance or 0.0)
            yield "no-load speed", max(sheet.supply - drop, 0.0) / sheet.no_load_speed

    def _agree(self, name: str, Km: float, other: str, value: float) -> None:
        off = abs(value / Km - 1.0)
        said = f"{name} and {other} give torque constants of {digits(1e3 * Km, 4)} and {digits(1e3 * value, 4)} mNm/A"
        if off > CONTRADICT and "no-load speed" not in (name, other):
            raise UsageError(
                f"{said}: they are one number in SI units; check the units, and whether one is of a phase or an amplitude"
            )
        if off > AGREE and (off > CONTRADICT or "no-load speed" not in (name, other)):
            self.warnings.append(f"{said}, {off:.0%} apart; the first is taken")

    def _stall_current(self) -> float | None:
        sheet = self.sheet
        if sheet.supply and sheet.resistance:
            return sheet.supply / sheet.resistance
        return sheet.stall_current

    # --- the mechanics --------------------------------------------------------------------------

    def _inertia(self) -> None:
        sheet, D = self.sheet, self._value("D")
        if not DRIVES[sheet.drive].motor:
            self._put("J", self.need("mass") * D**2, DERIVED, "mass times D^2", 0.2)
            return
        method, said = DERIVED, "rotor"
        if sheet.rotor_inertia is not None:
            rotor, doubt = sheet.rotor_inertia, PRINTED
        elif "Rm" in self.found:
            rotor = USUAL_TIME_S * self._value("Km") ** 2 / self._value("Rm")
            method, said, doubt = (
                GUESS,
                f"rotor of a mechanical time constant of {1e3 * USUAL_TIME_S:g} ms",
                1.0,
            )
        else:
            rotor = self.need("rotor_inertia")
        parts = TURNING_PARTS * rotor
        moved = sheet.mass * D**2 if sheet.mass is not None else USUAL_MASS * rotor
        unknown_mass = 0.0 if sheet.mass is not None else moved
        J = rotor + parts + moved
        said += f", {TURNING_PARTS:.0%} for gear and screw (guess), "
        said += "mass times D^2" if sheet.mass is not None else f"{USUAL_MASS:.0%} for the mass (guess)"
        self._put("J", J, method, said, math.hypot(doubt * rotor, parts, unknown_mass, 0.1 * J) / J)
        loose = f"rotor and {TURNING_PARTS:.0%} for gear and screw, without the mass"
        self._put("J_decoupled", rotor + parts, DERIVED, loose, max(doubt, 0.3))

    def _friction(self) -> None:
        sheet, D = self.sheet, self._value("D")
        own = self._own_friction()
        if own is not None and "Km" in self.found:
            self._put("A_decoupled", own[0], own[1], own[2], 0.3 if own[1] == DERIVED else 0.7)
        if sheet.friction_force is not None:
            A = sheet.friction_force * D / sheet.efficiency
            said = "friction force times D over the efficiency"
            A, said = (A + own[0], f"{said}, and the motor's own") if own is not None else (A, said)
            self._put("A", A, DERIVED, said, 0.5)
            return
        A, said = self._usual_friction()
        self._put("A", A, GUESS, said, 1.0)
        self.found.pop("A_decoupled", None)

    def _own_friction(self) -> tuple[float, str, str] | None:
        """Friction of the motor alone [N m], how it was found, and from what."""
        if "Km" not in self.found:
            return None
        if self.sheet.no_load_current is not None:
            return self._value("Km") * self.sheet.no_load_current, DERIVED, "no-load current"
        stall = self._stall_current()
        if stall is None:
            return None
        return OWN_FRICTION * self._value("Km") * stall, GUESS, f"{OWN_FRICTION:.0%} of the torque at stall"

    def _usual_friction(self) -> tuple[float, str]:
        sheet, stall = self.sheet, self._stall_current()
        if "Km" in self.found and sheet.nominal_current is not None:
            return OF_NOMINAL * self._value(
                "Km"
            ) * sheet.nominal_current, f"{OF_NOMINAL:.0%} of the nominal torque"
        if "Km" in self.found and stall is not None:
            return OF_STALL * self._value("Km") * stall, f"{OF_STALL:.0%} of the torque at stall"
        return STEADY * self._value("J"), f"the torque of {STEADY:g} rad/s^2"

    def _gravity(self) -> None:
        sheet, D = self.sheet, self._value("D")
        if sheet.mass is None:
            return
        weight = sheet.mass * G * D
        if sheet.orientation == "vertical":
            self._put(
                "torque_offset",
                weight,
                DERIVED,
                "weight times D, with +x upwards: identify finds the sign",
                0.5,
            )
        self._put("B", weight * math.pi / 180.0, DERIVED, "weight times D by degree of pitch", 0.2)

    def _rest(self) -> None:
        """What faults need and no sheet prints."""
        given = {name: q.value for name, q in self.found.items()}
        if self.sheet.travel is not None:
            given |= {"x_stop_low": 0.0, "x_stop_high": self.sheet.travel}
        for name, one in derived(given).items():
            self._put(name, one.value, one.method, one.source, one.spread)

    # --- the servo ------------------------------------------------------------------------------

    def _servo(self) -> None:
        J, Km, top = self._value("J"), self._value("Km"), self.need("supply") / self._value("Km")
        self._put("Vmax", self.need("supply"), SHEET, "supply", PRINTED)
        self._put("Rs", SOURCE_OHM * self._value("Rm"), GUESS, f"{SOURCE_OHM:.0%} of the winding", 1.0)
        self._put(
            "Kp", 2.0 * J / (Km * DECAY_S), GUESS, f"ringing that decays within {1e3 * DECAY_S:g} ms", 1.0
        )
        self._put("Ki", J * RINGING**2 / Km, GUESS, f"a loop that rings at {RINGING:g} rad/s", 1.0)
        if "Kx" in DRIVES[self.sheet.drive].requires:
            self._put("Kx", FOLLOWS, GUESS, "a loop that follows within a tenth of a second", 1.0)
        elif self.sheet.acceleration is not None:
            self._put("accel_cmd", self.sheet.acceleration, SHEET, "commanded acceleration", PRINTED)
        else:
            said = f"full speed within {1e3 * RAMP_S:g} ms"
            self._put("accel_cmd", top / RAMP_S, GUESS, said, 1.0)

    # --- whether all that can be ----------------------------------------------------------------

    def _check(self) -> None:
        sheet, stall = self.sheet, self._stall_current()
        if stall is not None and sheet.nominal_current is not None and sheet.nominal_current >= stall:
            raise UsageError(
                f"a nominal current of {sheet.nominal_current:g} A is not below that at stall, {digits(stall, 4)} A; check units"
            )
        self._check_stall()
        self._check_time()
        self._check_speed()
        self._check_weight(stall)

    def _check_stall(self) -> None:
        sheet = self.sheet
        if sheet.stall_current is None or not (sheet.supply and sheet.resistance):
            return
        ratio = sheet.stall_current * sheet.resistance / sheet.supply
        said = f"the stall current is {digits(ratio)} times the supply over the resistance"
        if not 1.0 / 3.0 < ratio < 3.0:
            raise UsageError(f"{said}; check units")
        if abs(ratio - 1.0) > 0.15:
            self.warnings.append(f"{said}: is it of another voltage?")

    def _check_time(self) -> None:
        if self.sheet.rotor_inertia is None or "Rm" not in self.found:
            return
        tau = self.sheet.rotor_inertia * self._value("Rm") / self._value("Km") ** 2
        said = f"rotor inertia, resistance and torque constant give a mechanical time constant of {digits(1e3 * tau)} ms"
        if not TIMES[0] <= tau <= TIMES[1]:
            raise UsageError(f"{said}, which no motor has; check their units")
        if not ODD_TIMES[0] <= tau <= ODD_TIMES[1]:
            self.warnings.append(f"{said}, which is unusual: check their units")

    def _check_speed(self) -> None:
        sheet = self.sheet
        if sheet.supply is None:
            return
        speed = sheet.supply / self._value("Km") * self._value("D")
        said = f"the supply would drive the mass at {digits(1e3 * speed)} mm/s"
        if speed > FAST or (sheet.travel and sheet.travel / speed > SLOW):
            self.warnings.append(f"{said}: check units, gear and lead")

    def _check_weight(self, stall: float | None) -> None:
        sheet = self.sheet
        if sheet.orientation != "vertical" or sheet.mass is None or stall is None:
            return
        share = sheet.mass * G * self._value("D") / (self._value("Km") * stall)
        if share > 1.0:
            raise UsageError(
                f"the motor cannot lift the mass: its weight is {digits(share)} times the torque at stall; check units"
            )
        if share > 0.5:
            self.warnings.append(f"the weight takes {share:.0%} of the torque at stall: check units")
