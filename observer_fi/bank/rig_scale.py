"""How large a rig is beside the paper's, whose numbers stand in the settings and in `FAULTS`."""

from dataclasses import replace
from typing import NamedTuple

from observer_fi.physics import Model, Rig
from observer_fi.settings import BankSettings

# Table 1 of the paper: what it takes to move and to start its motor.
_FRICTION_NM, _INERTIA, _KM, _KI, _TRAVEL = 4.6e-4, 4.7e-7, 21.2e-3, 0.45, 1.9e-6


class Scale(NamedTuple):
    """Torques, currents, travel and the servo's error integral of a rig, 1 where they are the paper's.

    What holds a mass and what starts it both count, whichever is larger.
    """

    torque: float
    current: float
    travel: float
    integral: float

    def of(self, state: str) -> float:
        """The scale of a state in its own unit; factors and the motor's speed have none: motors turn alike."""
        return {
            "I": self.integral,
            "x": self.travel,
            "d": self.travel,
            "rate": self.travel,
            "torque": self.torque,
        }.get(state, 1.0)


def scale_of(model: Model) -> Scale:
    """That of a rig with a motor."""
    torque = max(model["A"] / _FRICTION_NM, model["J"] / _INERTIA)
    held = model["Km"] * model["Ki"]
    integral = (model["A"] / held) / (_FRICTION_NM / (_KM * _KI)) if held and model["A"] else 1.0
    return Scale(torque, torque * _KM / model["Km"], model["D"] / _TRAVEL, integral)


PAPERS_HZ = 1600.0  # samples a second of the paper, for which the settings' agility was found


def between_samples(settings: BankSettings, rig: Rig, rate_hz: float) -> BankSettings:
    """Settings for a log of so many samples a second: what an unknown servo does between them puts its speed in doubt."""
    if rig.driven.servo or rate_hz >= PAPERS_HZ:
        return settings
    return replace(settings, agility=settings.agility * PAPERS_HZ / rate_hz)
