"""What can be the verdict on a move: one row a fault. What differs between faults is a column of this table.

A row is the change of the plant, the constants that only this fault has, and every word that a page, the terminal or an
explanation says of it. A fault is also the hypotheses of a bank: one, or for a sensor fault one a channel, whose mode is
called "sensor:voltage" and so on.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import NamedTuple

from observer_fi.physics.equations import PARAMETERS
from observer_fi.physics.rigs import Model, override
from observer_fi.records import CHANNELS


class OwnState(NamedTuple):
    """A state that a fault adds: what it is when the fault sets in, and how fast it may change.

    name: a parameter of the equations, as a factor of its value, or d (indentation of a stop [m]), torque [N m], rate [m/s].
    mean and std when the fault is entered; std None: the rig's own spread, and no state where a rig has none. growth:
    of the standard deviation per square root of a second. of_friction: torque as a share of the rig's friction.

    tells: what the constant is called where it says how severe a fault is, and words: the same in a sentence, of its value.
    absolute: in its own unit and not as a share of what the rig file gives. low, high: what is believable of it.
    means: of several Gaussians in place of the one around `mean`, for a constant that a filter cannot find from afar.
    """

    name: str
    mean: float
    std: float | None
    growth: float
    tells: str = ""
    words: str = ""
    absolute: bool = False
    of_friction: bool = False
    low: float = -math.inf
    high: float = math.inf
    means: tuple[float, ...] = ()


class Injection(NamedTuple):
    """A kind of fault that a synthetic log can have.

    parameters: what changes of the plant; where there are two, the first in a move forwards and the second backwards.
    size: what it becomes; None: the position of the mass at that moment. sizes: of a sensor's failure, V, A, m.
    """

    parameters: tuple[str, ...] = ()
    size: float | None = None
    sizes: tuple[float, ...] = ()


@dataclass(frozen=True)
class FaultRow:
    """One verdict.

    label: in report.json. plant: what it changes of the parameters. shares: constants of the healthy plant that it still
    shows. states: those it adds in a bank, none of it where `live` is False. sizes: the same where a whole move is at hand,
    wide enough for a fault of any severity. heals: it can be over within a move. rare: seldom, next to the others, and where
    most moves of a log show it the model is to blame. open_loop: the paper's mixture knows it. by_channel: one hypothesis a
    channel, which that hypothesis does not believe. made_by: kinds of synthetic fault of which it is the right verdict.
    rank: order of faults in a fleet, the least is the most severe.

    title: on a page. words: beside a curve and in a sentence. happened, action: sentences for a technician. alike:
    sentences on what looks the same, by channel or None. caveat: a sentence that depends on the plant, or "". colours:
    one, or one a channel. Words may say {channel} where there is one.
    """

    label: str
    plant: Mapping[str, float]
    shares: tuple[str, ...]
    states: tuple[OwnState, ...]
    sizes: tuple[OwnState, ...]
    live: bool
    heals: bool
    rare: bool
    open_loop: bool
    by_channel: bool
    made_by: Mapping[str, Injection]
    rank: int
    title: str
    words: str
    happened: str
    action: str
    alike: Mapping[str | None, str]
    caveat: Callable[[Model], str]
    colours: tuple[str, ...]

    def __post_init__(self) -> None:
        """Raises ValueError for a word that is missing, a parameter that does not exist, a colour that is none."""
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, str) and (not value.strip() or ("{" in value and not self.by_channel)):
                raise ValueError(f"fault {self.label!r}: {f.name} says nothing, or of a channel: {value!r}")
        for name in (*self.plant, *self.shares, *(p for i in self.made_by.values() for p in i.parameters)):
            if name not in PARAMETERS:
                raise ValueError(f"fault {self.label!r}: there is no parameter {name!r}")
        if len(self.colours) != (len(CHANNELS) if self.by_channel else 1):
            raise ValueError(f"fault {self.label!r}: one colour each of its hypotheses, not {self.colours}")
        if not all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in self.colours):
            raise ValueError(f"fault {self.label!r}: {self.colours} are no colours like #0072b2")

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of its hypotheses."""
        return tuple(f"{SENSOR}{channel}" for channel in CHANNELS) if self.by_channel else (self.label,)

    def says(self, words: str, channel: str | None) -> str:
        """A column of words with its channel filled in."""
        return words.format(channel=channel or "unnamed")


NOMINAL, UNKNOWN, SENSOR = "nominal", "unknown", "sensor:"
NOT_TESTED = "not_tested"  # no verdict, where a log holds nothing that could tell


def table(*rows: FaultRow) -> Mapping[str, FaultRow]:
    """Rows by label. Raises ValueError where two share a label, a rank, a mode or a kind of synthetic fault."""
    for what in (
        [row.label for row in rows],
        [row.rank for row in rows],
        [mode for row in rows for mode in row.modes],
        [kind for row in rows for kind in row.made_by],
    ):
        if len(set(what)) < len(what):
            raise ValueError(f"two faults have the same of {what}")
    found = {row.label: row for row in rows}
    if not {NOMINAL, UNKNOWN} <= set(found) or rows[0].label != NOMINAL:
        raise ValueError(f"a table of faults begins with {NOMINAL!r} and has {UNKNOWN!r}, not {list(found)}")
    return MappingProxyType(found)


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


_FRICTION_AND_GRAVITY = ("A", "B")
_LOST = "the mass loses {:.0%} of its travel"

# Colours are Okabe and Ito's, which people of every colour vision tell apart.
FAULTS = table(
    FaultRow(
        label=NOMINAL,
        plant={},
        shares=_FRICTION_AND_GRAVITY,
        states=(),
        sizes=(),
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
            OwnState("C", 1.0, 6.0, 0.0, "stiffness", "the obstacle is {:.2g} N m/m^2 stiff", low=0.05),
            OwnState("E", 0.5, 0.3, 0.0, "share_lost", _LOST, absolute=True, low=0.03, high=1.0),
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
        states=(OwnState("A_decoupled", 1.0, None, 0.0),),
        sizes=(
            OwnState(
                "A_decoupled",
                0.9,
                0.4,
                0.0,
                "drag",
                "what is left of the friction is {:.3g} N m",
                low=0.05,
                high=1.35,  # more than that the whole rig has: then the position stands still, and not the mass
            ),
            OwnState(
                "J_decoupled",
                0.9,
                0.2,
                0.0,
                "inertia",
                "what is left of the inertia is {:.3g} kg m^2",
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
        plant={},
        shares=_FRICTION_AND_GRAVITY,
        states=(),
        sizes=(
            OwnState("torque", 0.0, 1.0, 0.05, "friction_rise", "friction is up by {:.0%}", of_friction=True),
        ),
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
        words="none of these",
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
        words="{channel} sensor",
        happened="The {channel} sensor stopped telling the truth, while the other channels agree with the model.",
        action="Check the {channel} sensor, its wiring and its input channel before trusting further moves.",
        alike={
            "voltage": "A changed winding resistance looks the same as a voltage sensor fault in these channels: "
            "measure the resistance at rest to tell them apart.",
            "position": "A nut that slips or a lost coupling can look like a dead position sensor while the speed is "
            "steady: a reversal, or the encoder, tells them apart.",
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
