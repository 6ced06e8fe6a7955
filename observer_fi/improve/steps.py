"""The records that pass between the ladder of causes and a problem: candidate, trial, step, ladder, and what it leaves."""

from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from observer_fi.physics import Cause, Variant, is_possible
from observer_fi.records import Array

F = TypeVar("F")  # what a fit of the problem is


@dataclass(frozen=True)
class Candidate:
    """One variant of a cause with its score beside a fit, before anything is refitted.

    gain: nats that the linearised terms gain; net: less what its parameters and the choice cost. size: its linear estimate by
    name. detectable: smallest size that would stand out in these logs by name, infinite where they cannot show it.
    """

    cause: Cause
    variant: Variant
    gain: float
    net: float
    size: dict[str, float]
    detectable: dict[str, float]


@dataclass(frozen=True)
class Trial(Generic[F]):
    """One candidate, or two of which each hides the other, fitted with everything else.

    gain: nats that the fit gains. nets: of each candidate, less what its parameters and the choice cost, of a pair with the
    other in place.
    """

    candidates: tuple[Candidate, ...]
    fitted: F
    gain: float
    nets: tuple[float, ...]

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of the causes."""
        return tuple(c.cause.name for c in self.candidates)


class HeldOut(NamedTuple):
    """What samples gain that a fit never saw: nats a sample, and rmse after over before by channel."""

    drop: float
    ratio: dict[str, float]


@dataclass(frozen=True)
class Step(Generic[F]):
    """One accepted trial. rivals: by cause, the names of those that these logs cannot tell from it."""

    trial: Trial[F]
    held_out: HeldOut
    rivals: dict[str, tuple[str, ...]]


@dataclass(frozen=True)
class Ladder(Generic[F]):
    """What the ladder found: the refitted rig, the fit with every accepted cause, and the steps in order.

    path: the fit after each step as it was accepted. refused: what was tried last, with its net nats. screened: the scores
    of the last round, best first.
    """

    baseline: F
    extended: F
    steps: tuple[Step[F], ...]
    path: tuple[F, ...]
    refused: tuple[tuple[str, float], ...]
    screened: tuple[Candidate, ...]


@dataclass(frozen=True)
class Measure:
    """How well a model explains what it was not fitted to. rmse: A, m, rad/s, N. whiteness_p: per channel.

    noise_floor_nll: what a model that is right would leave, of the noise alone.
    """

    nll_per_sample: float
    rmse: dict[str, float]
    whiteness_p: dict[str, float]
    noise_floor_nll: float


@dataclass(frozen=True)
class Smooth:
    """A smooth term that the residual asks for: equation, regressor, whether it follows the direction of motion.

    gain, held_out: nats in all, and predicted for moves from the others. share: held_out over the residual's excess.
    at, curve, band: the fitted curve over the regressor and its standard error, in the unit of the equation (N m,
    ohm, 1, m, A, V) and over what the regressor is, or in `unit`, of what `what` and `over` say in words; empty where nothing
    that is known goes with it. coefficients: how many numbers it took. order, frequency_hz: of a line, per turn of the motor or
    in time.
    """

    equation: str
    regressor: str
    directed: bool
    gain: float
    held_out: float
    share: float
    at: Array
    curve: Array
    band: Array
    coefficients: int
    order: float | None = None
    frequency_hz: float | None = None
    unit: str = ""
    what: str = ""
    over: str = ""

    @property
    def can_be_kept(self) -> bool:
        """Whether the equations of a rig can take the curve."""
        return not self.unit and is_possible(self.equation, self.regressor, self.directed)


NOTHING_KNOWN = "unknown"  # the regressor of an equation with nothing that it goes with


def nameless(equation: str, gain: float, whole: float) -> Smooth:
    """An equation that wants to be free by `gain` of the `whole` misfit [nats], with nothing that it goes with."""
    share = min(max(gain / whole, 0.0), 1.0) if whole > 0.0 else 0.0
    nothing = np.empty(0)
    return Smooth(equation, NOTHING_KNOWN, False, gain, gain, share, nothing, nothing, nothing, 0)
