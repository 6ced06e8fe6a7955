"""What a rig file leaves out and a fault needs: gravity, a stop, the motor without its mass, from what the file gives.

A guess with its width is a model; a zero is a claim that there is no stop, no friction, no gravity.
"""

from collections.abc import Mapping
from typing import NamedTuple

GUESS, DERIVED, SHEET = "guess", "derived", "data sheet"
UNLEARNED = (GUESS, DERIVED, SHEET)  # methods of values that no log has shown

GUESSED = ("B", "C", "E", "A_decoupled", "J_decoupled")  # what `derived` can give

LOOSE_FRICTION = 0.7  # of the friction: motor, gear and screw bearings keep most of it
LOOSE_INERTIA = 0.9  # of the inertia: most of it turns, and little of it moves
COMPRESSED = 0.5  # of the travel that an obstacle takes: between none and all
LEVEL_DEG = 20.0  # pitch at which gravity is worth the friction: steeper, and the mass slides back by itself
# How deep a mass presses until the stop is worth the friction: what gives way has its own size; at most a share of the travel.
PRESSED_M, PRESSED_SHARE = 2e-3, 0.1
# 1-sigma, relative: a stop that gives way by half a millimetre is sixteen times as stiff, and nobody knows which one it will be.
STIFFER = 10.0
LEAST_ACCELERATION = 1.0  # rad/s^2, that a rig without friction gives the torque of its stop


class Derived(NamedTuple):
    """A value in SI units, its 1-sigma spread (relative), how it was found, and what it rests on."""

    value: float
    spread: float
    method: str
    source: str


def derived(given: Mapping[str, float]) -> dict[str, Derived]:
    """What a rig driven by a motor has besides `given` (J, A, D and more, SI): those of B, C, E, A', J' that are not in it."""
    found = {
        "B": Derived(
            given["A"] / LEVEL_DEG, 1.0, GUESS, f"gravity as strong as friction at {LEVEL_DEG:g} deg"
        ),
        "E": Derived(COMPRESSED, 0.5, GUESS, "an obstacle takes half of the travel"),
        "C": Derived(
            _stiffness(given),
            STIFFER,
            GUESS,
            "a stop as strong as friction where the mass has pressed a little",
        ),
        "A_decoupled": Derived(
            LOOSE_FRICTION * given["A"], 0.7, GUESS, f"{LOOSE_FRICTION:.0%} of the friction with the mass"
        ),
        "J_decoupled": Derived(
            LOOSE_INERTIA * given["J"], 0.3, DERIVED, f"{LOOSE_INERTIA:.0%} of the inertia with the mass"
        ),
    }
    return {name: value for name, value in found.items() if name not in given}


def _stiffness(given: Mapping[str, float]) -> float:
    """C [N m/m^2], equation 11: friction over the square of a depth."""
    travel = given.get("x_stop_high", float("inf")) - given.get("x_stop_low", -float("inf"))
    depth = min(PRESSED_SHARE * travel, PRESSED_M)
    return max(given["A"], LEAST_ACCELERATION * given["J"]) / depth**2
