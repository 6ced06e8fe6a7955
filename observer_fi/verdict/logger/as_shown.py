"""What the servo's equation says of a log whose command was taken, sample by sample, from what voltage and current show.

Such a command has the noise of the readings. Through the servo it becomes a current: its walking integral, which the equation can
be given room for (`as_logged`), and its proportional part, which is as rough as the readings. Where that is rougher than the
current itself, the equation tells nothing but that the command was made with it, and the log is one of a servo that nobody knows.
"""

import math
from dataclasses import replace

import numpy as np

from observer_fi.logs import CHUNK_ROWS, acquisition_of, is_shown
from observer_fi.physics import Rig
from observer_fi.records import Acquisition, Log

# Times the noise of the current. The paper's servo, which tells more with its equation than without, is at 2; those of drawn
# actuators whose healthy soft starts were failed sensors with it at 6 to 74.
ROUGH = 3.0
NOTHING_OF_THE_SERVO = (
    "the command that is shown is rougher than the current: the servo is taken for one that nobody knows"
)


def as_shown_to(log: Log, rig: Rig) -> tuple[Log, Rig]:
    """The log and the rig to judge it with: one without its servo where a shown command says nothing of that."""
    if not is_shown(log) or not rig.watched.servo:
        return log, rig
    acquisition = acquisition_of(log.part(slice(0, CHUNK_ROWS)), rig.file_noise_std)
    if _proportional(acquisition, rig) <= ROUGH * acquisition.current.as_white:
        return log, rig
    return replace(log, notes=(*log.notes, NOTHING_OF_THE_SERVO)), rig.without_servo


def walk_of(acquisition: Acquisition, rig: Rig, rate_hz: float) -> float:
    """How a shown command's noise walks through the integral of its servo [A per root of a second]."""
    return _noise(acquisition, rig) * rig.model["Ki"] / math.sqrt(rate_hz)


def _proportional(acquisition: Acquisition, rig: Rig) -> float:
    """Noise of the current that the noise of a shown command is through the proportional part [A]."""
    return _noise(acquisition, rig) * rig.model["Kp"]


def _noise(acquisition: Acquisition, rig: Rig) -> float:
    """Noise of the command that voltage and current show (`loop_command`) [rad/s]: of w + i / Kp with w of equation 2."""
    model, (voltage, current) = rig.model, acquisition[:2]
    of_voltage = voltage.as_white / model["Km"]
    of_current = current.as_white * (1.0 / model["Kp"] - model["Rm"] / model["Km"])
    return float(np.hypot(*np.nan_to_num((of_voltage, of_current))))
