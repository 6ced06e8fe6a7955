"""What the ladder of causes asks of a kind of drive, and the records that pass between the two.

A problem knows how the equations of a rig are fitted to its logs, which columns a cause adds, and what counts as held out.
There are two: moves that are simulated (`simulated_moves.py`), and a force that is calculated from the motion
(`calculated_force.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, NamedTuple, Protocol, TypeVar

from observer_fi.logs import Excitation
from observer_fi.physics import Cause, Rig, Variant

if TYPE_CHECKING:
    from observer_fi.improve.freed.freed_equations import FreedEquation
    from observer_fi.improve.freed.smoothed_disturbance import SmoothedDisturbance
    from observer_fi.improve.keep_curve import Kept
    from observer_fi.improve.residual_tables import Residuals
    from observer_fi.improve.unexplained import Smooth

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


class Problem(Protocol[F]):
    """What differs by kind of drive."""

    @property
    def rig(self) -> Rig:
        """The rig as its file has it."""

    @property
    def rounds(self) -> int:
        """The most steps there may be."""

    @property
    def seen_by(self) -> str:
        """The way in which effects show (`physics.effects`)."""

    @property
    def parts(self) -> str:
        """What is held out in turn, counted, in words."""

    @property
    def sample_count(self) -> int:
        """How many samples were fitted."""

    # --- the ladder ---

    def baseline(self) -> F:
        """The rig refitted, before any cause is tried."""

    def screen(self, fitted: F, steps: Sequence[Step[F]]) -> list[Candidate]:
        """Every variant that is still open after these steps, best score first."""

    def trials(self, fitted: F, candidates: Sequence[Candidate]) -> list[Trial[F]]:
        """The leading candidates refitted with everything else, the best first."""

    def judge(self, fitted: F, trial: Trial[F]) -> HeldOut | None:
        """What held-out samples gain by a trial; None where it does not pay, or means nothing."""

    def rivals(
        self, fitted: F, trial: Trial[F], trials: Sequence[Trial[F]], candidates: Sequence[Candidate]
    ) -> dict[str, tuple[str, ...]]:
        """By cause of a trial: those of another name that these logs cannot tell from it."""

    def settled(self, fitted: F, trial: Trial[F]) -> F:
        """The fit with an accepted trial, as exact as it gets."""

    def without(self, fitted: F, candidates: Sequence[Candidate]) -> F:
        """The fit with accepted candidates taken out again."""

    def reconsidered(self, ladder: Ladder[F]) -> Ladder[F]:
        """The same, where what was named puts the baseline in doubt, from another one."""

    # --- the report ---

    def measure(self, fitted: F) -> Measure:
        """How well a fit explains what it never saw."""

    def values(self, fitted: F) -> dict[str, tuple[float, float]]:
        """Every parameter that is free in a fit: value and standard error."""

    def doubt(self, fitted: F, parameter: str, std: float) -> float:
        """Standard error of an effect's size, with what the model leaves out."""

    def tables(self, fitted: F) -> "Residuals":
        """Residuals of a fit from every side."""

    def unexplained(self, ladder: Ladder[F]) -> "tuple[Smooth, ...]":
        """What the extended model still depends on, the best first."""

    def freed(self, baseline: F) -> "tuple[tuple[FreedEquation, ...], tuple[SmoothedDisturbance, ...]]":
        """Which equations the data want to free, and what that looks like; empty where nothing is simulated."""

    def kept(self, fitted: F, left: "Sequence[Smooth]") -> "tuple[F, Kept] | None":
        """What stays unexplained as an empirical curve of the rig, if it helps. Raises UsageError where it cannot."""

    def extended_rig(self, ladder: Ladder[F]) -> Rig:
        """The rig with everything that was fitted."""

    def excitations(self) -> tuple[Excitation, ...]:
        """What each log holds."""
