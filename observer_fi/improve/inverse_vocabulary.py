"""The causes that a commanded force and a position can show: which columns each adds, from where its shapes start."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from observer_fi.learn import TERMS, TIMING, Motion, Structure, Term
from observer_fi.physics import Rig


@dataclass(frozen=True)
class Candidate:
    """One variant of a cause: the terms it adds, the shapes it sets, which of them are fitted, and within which limits."""

    cause: str
    variant: str
    terms: tuple[Term, ...] = ()
    shapes: dict[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)

    def added_to(self, structure: Structure) -> Structure:
        """The structure with this cause. A timing starts where it was: it may be known in part."""
        shapes = self.shapes | {k: v for k, v in structure.shapes.items() if k in TIMING}
        free = tuple(dict.fromkeys((*structure.free, *self.free)))
        return Structure(
            structure.terms + self.terms, structure.shapes | shapes, free, structure.limits | self.limits
        )


def vocabulary(rig: Rig, motions: Sequence[Motion]) -> list[Candidate]:
    """Every cause that a commanded force and a position can show, with starts from the range of the data."""
    fastest = max(float(np.abs(m.v).max()) for m in motions) / rig.model["D"]
    found = [
        Candidate("viscous_friction", "alike in both directions", _terms("viscous")),
        Candidate("asymmetric_friction", "viscous, per direction", _terms("viscous_asymmetry")),
        Candidate("torque_offset", "constant", _terms("torque_offset")),
        Candidate("load_dependent_friction", "with gravity", _terms("load_friction")),
        Candidate("gravity_nonlinearity", "quadratic", _terms("gravity_quadratic")),
        Candidate("gravity_nonlinearity", "cubic", _terms("gravity_cubic")),
        Candidate("input_delay", "delay", shapes={"input_delay": 0.0}, free=("input_delay",)),
        Candidate("current_lag", "first-order lag", shapes={"current_lag": 0.0}, free=("current_lag",)),
        Candidate("position_lag", "first-order lag", shapes={"position_lag": 0.0}, free=("position_lag",)),
        Candidate("backlash", "play", _terms("backlash")),
        Candidate("partial_slip", "with torque", _terms("slip_per_torque")),
    ]
    # Only what happens at low speed: over the whole range of speeds this form is viscous friction by another name.
    # The size has a sign: friction that falls towards standstill is as good a finding as friction that rises.
    limits = {"stribeck_speed": (0.02 * fastest, 0.2 * fastest)}
    for share in (0.03, 0.06, 0.12):
        shape = {"stribeck_speed": share * fastest}
        variant = f"below {100 * share:.0f} % of top speed"
        found.append(
            Candidate("stribeck_friction", variant, _terms("stribeck_torque"), shape, tuple(shape), limits)
        )
    return found + _along_the_rails(motions) + _periodic(rig)


def _terms(*names: str) -> tuple[Term, ...]:
    return tuple(TERMS[name] for name in names)


def _along_the_rails(motions: Sequence[Motion]) -> list[Candidate]:
    """Friction that changes with position: a slope, a parabola, or one rough spot."""
    cause = "position_dependent_friction"
    low = min(float(m.x.min()) for m in motions)
    travel = max(float(m.x.max()) for m in motions) - low
    found = [
        Candidate(cause, "linear", _terms("friction_slope")),
        Candidate(cause, "quadratic", _terms("friction_slope", "friction_curvature")),
    ]
    limits = {"bump_position": (low, low + travel), "bump_width": (travel / 60, travel / 3)}
    for k in range(1, 9):
        shape = {"bump_position": low + travel * k / 9, "bump_width": travel / 18}
        variant = f"bump at {1e3 * shape['bump_position']:.3g} mm"
        found.append(Candidate(cause, variant, _terms("friction_bump"), shape, tuple(shape), limits))
    return found


def _periodic(rig: Rig) -> list[Candidate]:
    """Ripple per turn of the motor, per turn of the screw where the file gives its lead, and errors of the scale."""
    shaft = _terms("shaft_ripple_sin", "shaft_ripple_cos")
    screw = _terms("screw_ripple_sin", "screw_ripple_cos")
    scale = _terms("position_sin", "position_cos")
    turn = 2.0 * math.pi * rig.model["D"]
    found = [
        Candidate("shaft_ripple", f"order {k}", shaft, {"shaft_order": float(k)})
        for k in (1, 2, 3, 4, 6, 9, 13)
    ]
    lead = rig.model["screw_lead"]
    if "screw_lead" in rig.quantities and not screw_is_shaft(rig):
        found += [Candidate("screw_ripple", f"order {k}", screw, {"screw_lead": lead / k}) for k in (1, 2, 3)]
    for period in dict.fromkeys((turn, 1e-3, 5e-4, 2e-3)):
        found.append(
            Candidate("position_periodic_error", f"{1e3 * period:.3g} mm", scale, {"position_period": period})
        )
    return found


def screw_is_shaft(rig: Rig) -> bool:
    """Whether the screw turns with the motor, so that a ripple of one is a ripple of the other."""
    return abs(rig.model["screw_lead"] / (2.0 * math.pi * rig.model["D"]) - 1.0) < 1e-6
