"""What can be the verdict on a move: one row a fault. What differs between faults is a column of this table.

A row is the change of the plant, the constants that only this fault has, and every word that a page, the terminal or an
explanation says of it. A fault is also the hypotheses of a bank: one, or for a sensor fault one a channel, whose mode is
called "sensor:voltage" and so on.
"""

import math
from types import MappingProxyType

from observer_fi.physics.equations import CONTACT_DEPTH
from observer_fi.physics.fault_row import (
    NOMINAL,
    NOT_TESTED,
    SENSOR,
    UNKNOWN,
    FaultRow,
    Injection,
    Law,
    Least,
    OwnState,
    Told,
    table,
)
from observer_fi.physics.rigs import Model, override


def _nothing(plant: Model) -> str:
    return ""


def _same_current(plant: Model) -> str:
    """Where decoupled and nominal draw the same current (design section 2): theta = (A' - A) / B."""
    if not plant["B"]:
        return ""
    angle = (plant["A_decoupled"] - plant["A"]) / plant["B"]
    return (
        f"Near {angle:.1f} deg of pitch (forward moves) a lost coupling draws the nominal current, "
        "and only a start or a reversal tells."
    )


def _stiffness(plant: Model, share: float) -> float:
    """Stiffness of an obstacle [N m/m^2] into which the mass moves more slowly, equation 10, from that as a share of the plant's
    which pushes back as much on a mass that keeps its speed."""
    return share * plant["C"] / (1.0 - plant["E"]) ** 2


_FRICTION_AND_GRAVITY = ("A", "B")
_LOST = "the mass loses {} of its travel"


def _spring(plant: Model) -> dict[str, float]:
    """A spring whose torque grows with its indentation itself, as large as that of the plant's stop where that is friction's."""
    depth = math.sqrt(plant["A"] / plant["C"]) if plant["A"] and plant["C"] else CONTACT_DEPTH
    return {"contact_exponent": 1.0, "C": plant["C"] * depth / CONTACT_DEPTH}


def _torque_per_metre(plant: Model) -> float:
    return plant["C"] * CONTACT_DEPTH


def _newton_per_millimetre(plant: Model) -> float:
    """Of a spring that the mass meets, from its torque on the motor: a torque T stands for a force T / D."""
    return 1e-3 * _torque_per_metre(plant) / plant["D"]


_SHARE_LOST = OwnState("E", 0.5, 0.3, 0.0, "share_lost", _LOST, absolute=True, low=0.0, high=1.0)
_DEPTH = OwnState("d", 0.0, 2e-6, 0.0)
_LINEAR = OwnState(
    "C",
    1.0,
    6.0,
    0.0,
    "stiffness",
    "the obstacle is a spring of {}",
    low=0.05,
    factor=5.0,
    told_as=Told("N m/m", _torque_per_metre, "N/mm", _newton_per_millimetre),
)
_LOAD = OwnState("torque", 0.0, 0.5, 0.3, of_friction=True)
# Beside the paper's square law: a spring; and one with a load in front of it, of a law between and beyond the two, or a wall.
_SPRINGS = (
    Law(_spring, (_DEPTH, _LINEAR, _SHARE_LOST)),
    Law(_spring, (_DEPTH, _LINEAR._replace(std=1000.0, factor=0.0), _SHARE_LOST, _LOAD)),
)

# Colours are Okabe and Ito's, which people of every colour vision tell apart.
FAULTS = table(
    FaultRow(
        label=NOMINAL,
        plant={},
        shares=_FRICTION_AND_GRAVITY,
        states=(),
        sizes=(),
        laws=(),
        least=None,
        live=True,
        heals=False,
        rare=False,
        open_loop=True,
        by_channel=False,
        made_by={"none": Injection()},
        rank=50,
        title="No fault",
        words="no fault",
        happened="The actuator behaved as its model says.",
        action="No action is needed.",
        alike={},
        caveat=_nothing,
        colours=("#0072b2",),
    ),
    FaultRow(
        label="overload",
        plant={"contact": 1.0},  # equations 10 and 11: the mass presses against a stop
        shares=_FRICTION_AND_GRAVITY,
        states=(OwnState("d", 0.0, 2e-6, 0.0), OwnState("C", 1.0, None, 0.0), OwnState("E", 1.0, None, 0.0)),
        sizes=(  # from obstacle to obstacle they differ by decades
            OwnState("d", 0.0, 2e-6, 0.0),
            OwnState("C", 1.0, 6.0, 0.0, "stiffness", "the obstacle is {} stiff", low=0.002, factor=5.0),
            _SHARE_LOST._replace(low=0.03),
        ),
        laws=_SPRINGS,
        least=Least(
            "C",
            (0.01, 0.3, 10.0, 300.0),
            "stiffness",
            "an obstacle of {} or stiffer",
            held={"E": 0.0},
            told=_stiffness,
        ),
        live=True,
        heals=True,  # the mass can leave an obstacle
        rare=False,
        open_loop=True,
        by_channel=False,
        made_by={"overload": Injection(("x_stop_high", "x_stop_low"))},
        rank=20,
        title="Overload",
        words="overload",
        happened="The mass pressed against an obstacle or a travel limit: current rose while the mass moved at "
        "about half its speed.",
        action="Stop the move, look for an obstacle and compare the position with the travel limits before moving again.",
        alike={},
        caveat=_nothing,
        colours=("#d55e00",),
    ),
    FaultRow(
        label="coupling_loss",
        plant={"coupling": 0.0},  # equations 12 and 13: the motor turns without the mass
        shares=(),
        states=(OwnState("A_decoupled", 1.0, None, 0.0), OwnState("J_decoupled", 1.0, None, 0.0)),
        sizes=(
            OwnState(
                "A_decoupled",
                0.9,
                0.4,
                0.0,
                "drag",
                "what is left of the friction is {}",
                low=0.05,
                high=1.35,  # more than that the whole rig has: then the position stands still, and not the mass
            ),
            OwnState(
                "J_decoupled",
                0.9,
                0.2,
                0.0,
                "inertia",
                "what is left of the inertia is {}",
                low=0.05,
                high=1.8,
                means=(
                    0.35,
                    0.6,
                    0.9,
                    1.25,
                ),  # it divides: the first samples of a free motor are far from linear in it
            ),
        ),
        laws=(),
        least=Least(
            "A_decoupled",
            (0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.2, 1.35),
            "duration",
            "a coupling lost for {} or longer",
            held={"J_decoupled": 0.9},
            lasts=True,
        ),
        live=True,
        heals=False,
        rare=False,
        open_loop=True,
        by_channel=False,
        made_by={"coupling_loss": Injection(("coupling",), 0.0)},
        rank=10,
        title="Coupling loss",
        words="coupling loss",
        happened="The motor turned without moving the mass: the coupling between lead screw and nut has let go.",
        action="Do not command further moves; check the setscrew between lead screw and nut.",
        alike={},
        caveat=_same_current,
        colours=("#009e73",),
    ),
    FaultRow(
        label="slip",
        plant={"contact": 1.0, "C": 0.0},  # the mass moves as in contact, and meets nothing
        shares=_FRICTION_AND_GRAVITY,
        states=(),
        sizes=(OwnState("E", 0.5, 0.4, 0.03, "share_lost", _LOST, absolute=True, low=0.01, high=0.98),),
        laws=(),
        least=Least("E", (0.001, 0.01, 0.1, 0.9), "share_lost", "a slip of {} or more"),
        live=False,
        heals=False,
        rare=False,
        open_loop=False,
        by_channel=False,
        made_by={"slip": Injection(("slip",), 0.5)},
        rank=12,
        title="Slip",
        words="slip",
        happened="The mass followed the motor only in part, without meeting more resistance: the nut or the coupling slipped.",
        action="Stop the move; check the nut, the setscrew and the coupling for wear and for oil where none belongs.",
        alike={None: "A soft obstacle looks the same until the current rises."},
        caveat=_nothing,
        colours=("#cc79a7",),
    ),
    FaultRow(
        label="jam",
        plant={"rubbing": 1.0},  # whichever way the motor turns
        shares=_FRICTION_AND_GRAVITY,
        states=(),
        sizes=(
            OwnState(
                "torque",
                0.0,
                1.0,
                0.05,
                "friction_rise",
                "friction is up by {}",
                of_friction=True,
                low=0.0,
                # one that stands, and one that doubles within a second, which is followed by the second
                growths=(0.0, 0.05, 0.5),
                creeps=(0.0, 0.05, 0.02),
            ),
        ),
        laws=(),
        least=Least("torque", (0.003, 0.03, 0.3, 3.0), "friction_rise", "friction risen by {} or more"),
        live=False,
        heals=False,
        rare=False,
        open_loop=False,
        by_channel=False,
        made_by={"friction": Injection(("torque_offset",), 4e-4)},
        rank=15,
        title="Jam",
        words="jam",
        happened="Friction rose while the mass kept following the motor: the mechanics turn harder than they did.",
        action="Look for dirt, dry grease or a bent screw before moving on, and measure the friction again.",
        alike={None: "A load along the axis that nobody logged looks the same in moves of one direction."},
        caveat=_nothing,
        colours=("#56b4e9",),
    ),
    FaultRow(
        label=UNKNOWN,
        plant={},
        shares=(),
        states=(
            OwnState("torque", 0.0, 5e-4, 2e-4),
            OwnState("rate", 0.0, 1e-3, 5e-4),
        ),  # a load and a slip at will
        sizes=(OwnState("torque", 0.0, 5e-4, 2e-4), OwnState("rate", 0.0, 1e-3, 5e-4)),
        laws=(),
        least=None,
        live=True,
        heals=False,
        rare=True,
        open_loop=False,
        by_channel=False,
        made_by={
            "winding": Injection(("Rm",), 26.0),
            "supply": Injection(("Vmax",), 8.5),
        },
        rank=40,
        title="Unknown fault",
        words="unknown fault",
        happened="Something went wrong that is none of the known faults.",
        action="Inspect the drive by hand, and compare friction, supply and winding resistance with an earlier healthy move.",
        alike={None: "A wrong pitch reading looks the same as a changed load."},
        caveat=_nothing,
        colours=("#6b7280",),
    ),
    FaultRow(
        label="sensor_fault",
        plant={},
        shares=_FRICTION_AND_GRAVITY,
        states=(),
        sizes=(),
        laws=(),
        least=None,
        live=True,
        heals=False,
        rare=True,
        open_loop=False,
        by_channel=True,
        made_by={  # sizes make a fault plain without being absurd
            "sensor_frozen": Injection(),
            "sensor_offset": Injection(sizes=(0.5, 5e-3, 3e-4)),
            "sensor_drift": Injection(sizes=(0.5, 5e-3, 3e-4)),
            "sensor_gain": Injection(sizes=(0.1, 0.25, 0.25)),
            "sensor_noise": Injection(sizes=(0.2, 6e-3, 2e-4)),
            "sensor_dropout": Injection(),
        },
        rank=30,
        title="Sensor fault",
        words="{channel} sensor fault",
        happened="The {channel} sensor stopped telling the truth, while the other channels agree with the model.",
        action="Check the {channel} sensor, its wiring and its input channel before trusting further moves.",
        alike={
            "voltage": "A changed winding or torque constant looks the same as a voltage sensor fault while the motor stays at "
            "one speed: a start, a stop or the resistance measured at rest tells them apart.",
            "position": "A nut that slips or a lost coupling can look like a dead position sensor while the speed is "
            "steady: a reversal, or the encoder, tells them apart. Where `encoder_rad` is logged it says which of position and "
            "voltage with current is right about how far the motor turned: what goes with the mass refutes a slip, a lost "
            "coupling, and an obstacle or a jam that a tenth of the way contradicts.",
        },
        caveat=_nothing,
        colours=("#b5548c", "#8c6bb1", "#a6761d"),
    ),
)
LABELS = tuple(FAULTS)
OPEN_LOOP = tuple(label for label, row in FAULTS.items() if row.open_loop)
FAULT_KINDS = MappingProxyType({kind: row for row in FAULTS.values() for kind in row.made_by})
_BY_MODE = {mode: row for row in FAULTS.values() for mode in row.modes}


def label_of(mode: str) -> str:
    """Label of the verdict for a hypothesis: "sensor:current" is a sensor_fault."""
    return _BY_MODE[mode].label if mode in _BY_MODE else mode


def channel_of(mode: str) -> str | None:
    """Channel of a sensor hypothesis, None for the others."""
    return mode.removeprefix(SENSOR) if mode.startswith(SENSOR) else None


def mode_of(label: str, channel: str | None) -> str:
    """The hypothesis of a verdict with its channel."""
    return label if channel is None else f"{SENSOR}{channel}"


def words_of(mode: str) -> str:
    """What a hypothesis is called beside a curve and in a sentence."""
    row = _BY_MODE[mode]
    return row.says(row.words, channel_of(mode))


def colour_of(label: str, channel: str | None = None) -> str:
    """Colour of a hypothesis, or of a verdict with its channel."""
    if label == NOT_TESTED:
        return FAULTS[UNKNOWN].colours[0]
    mode = mode_of(label, channel)
    row = _BY_MODE.get(mode) or FAULTS[mode]
    return row.colours[row.modes.index(mode) if mode in row.modes else 0]


def faulty(plant: Model, label: str) -> Model:
    """The plant under a fault, as a bank takes it."""
    return override(plant, label, **FAULTS[label].plant)


def broken(plant: Model, kind: str, x: float, forwards: bool, size: float | None = None) -> Model:
    """The plant from the moment on in which a kind of synthetic fault sets in, the mass at x [m]; size: None is the usual."""
    made = FAULT_KINDS[kind].made_by[kind]
    usual = x if made.size is None else made.size
    chosen = made.parameters[:1] if forwards else made.parameters[-1:]
    return override(plant, kind, **dict.fromkeys(chosen, usual if size is None else size))
