"""What the ladder of causes asks of a kind of drive.

A problem knows how the equations of a rig are fitted to its logs, which columns a cause adds, and what counts as held out.
There are two: moves that are simulated (`moves/`), and a force that is calculated from the motion (`force/`).
"""

from collections.abc import Sequence
from typing import Protocol

from observer_fi.improve.freed.freed_equations import FreedEquation
from observer_fi.improve.freed.smoothed_disturbance import SmoothedDisturbance
from observer_fi.improve.moves.keep_curve import Kept
from observer_fi.improve.residual_tables import Residuals
from observer_fi.improve.steps import Candidate, F, HeldOut, Ladder, Measure, Smooth, Step, Trial
from observer_fi.logs import Excitation
from observer_fi.physics import Rig


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

    def tables(self, fitted: F) -> Residuals:
        """Residuals of a fit from every side."""

    def unexplained(self, ladder: Ladder[F]) -> tuple[Smooth, ...]:
        """What the extended model still depends on, the best first."""

    def freed(self, baseline: F) -> tuple[tuple[FreedEquation, ...], tuple[SmoothedDisturbance, ...]]:
        """Which equations the data want to free, and what that looks like; empty where nothing is simulated."""

    def kept(self, fitted: F, left: Sequence[Smooth]) -> tuple[F, Kept] | None:
        """What stays unexplained as an empirical curve of the rig, if it helps. Raises UsageError where it cannot."""

    def extended_rig(self, ladder: Ladder[F]) -> Rig:
        """The rig with everything that was fitted."""

    def excitations(self) -> tuple[Excitation, ...]:
        """What each log holds."""
