"""What a row of the table of faults is: the change of the plant, constants, words. Raises where a row says nonsense."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import NamedTuple

from observer_fi.numerics import size_words
from observer_fi.physics.equations import PARAMETERS
from observer_fi.physics.rigs import Model
from observer_fi.records import CHANNELS

NOMINAL, UNKNOWN, SENSOR = "nominal", "unknown", "sensor:"
NOT_TESTED = "not_tested"  # no verdict, where a log holds nothing that could tell


class OwnState(NamedTuple):
    """A state that a fault adds: what it is when the fault sets in, and how fast it may change.

    name: a parameter of the equations, as a factor of its value, or d (indentation of a stop [m]), torque [N m], rate [m/s].
    mean and std when the fault is entered; std None: the rig's own spread, and no state where a rig has none. growth:
    of the standard deviation per square root of a second. of_friction: torque as a share of the rig's friction.

    tells: what the constant is called where it says how severe a fault is, and words: the same in a sentence, of its value.
    absolute: in its own unit and not as a share of what the rig file gives. low, high: what is believable of it.
    means: of several Gaussians in place of the one around `mean`, for a constant that a filter cannot find from afar. growths: of
    several in place of `growth`, for a state that may stand or run away. creeps: mean, std and growth of one more Gaussian, of a
    fault that begins at nothing and grows slowly. factor: of a constant that differs by decades, a standard deviation of its
    logarithm, where evidence is weighed; a filter begins with the Gaussian of mean and std. told_as: of a factor, how it is told;
    None: in the unit of its parameter, times the value in the rig file.
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
    growths: tuple[float, ...] = ()
    creeps: tuple[float, float, float] | None = None
    factor: float = 0.0
    told_as: "Told | None" = None

    def says(self, value: float, unit: str) -> str:
        """How large the fault is, in a sentence."""
        return self.words.format(size_words(value, unit))


class Told(NamedTuple):
    """A factor as it is told: in `unit`, and in a sentence in its own unit, each for a factor of 1 of a plant."""

    unit: str
    value: Callable[[Model], float]
    unit_in_words: str
    in_words: Callable[[Model], float]


class Law(NamedTuple):
    """Another law of the same fault, tried on a whole move where that fault or one that follows anything is the best so far.

    plant: what it changes beside the row's own change, of the healthy plant; sizes: its constants, as those of the row.
    """

    plant: Callable[[Model], Mapping[str, float]]
    sizes: tuple[OwnState, ...]


def _itself(plant: Model, value: float) -> float:
    return value


class Least(NamedTuple):
    """How the smallest severity is found and told that a healthy move would have shown.

    constant: of `sizes`, what the fault is tried with; tried: its values there, increasing; held: values of the other constants.
    lasts: the fault has no size, and how long it must last [s] is told. name, words: what is told is called, and in a sentence
    of its value with its unit. told: the value that is told, from the plant and the value found.
    """

    constant: str
    tried: tuple[float, ...]
    name: str
    words: str
    held: Mapping[str, float] = MappingProxyType({})
    lasts: bool = False
    told: Callable[[Model, float], float] = _itself

    def says(self, value: float, unit: str) -> str:
        """What would have shown, in a sentence: two digits of it, as it is found on a coarse grid."""
        return self.words.format(size_words(float(f"{value:.2g}"), unit))


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
    wide enough for a fault of any severity. laws: other laws that it may follow. least: how a healthy move tells
    what of it would have shown, or None. heals: it can be over within a move. rare: seldom, next to the others, and where
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
    laws: tuple[Law, ...]
    least: Least | None
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
