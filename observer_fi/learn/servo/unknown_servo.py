"""The servo of a rig that comes without one: gains, supply and commanded acceleration from its logs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer_fi.learn.identification import identified_rig, identify
from observer_fi.logs import is_recovered
from observer_fi.physics import PARAMETERS, Quantity, Rig
from observer_fi.records import Log

# Where the search begins; the closed forms of section 3 and the likelihood find the rest from far away.
DECAY_S = 0.06  # of the loop's ringing, 2 J / (Km Kp)
RINGING = 100.0  # rad/s, sqrt(Km Ki / J)
SOURCE = 0.03  # resistance of the supply, as a share of the winding's


def shows_servo(logs: Sequence[Log], rig: Rig) -> bool:
    """Whether logs of a rig that comes without a servo show one: by its voltage, and by a commanded speed that was logged."""
    return "voltage_v" in rig.driven.columns and not any(map(is_recovered, logs))


def with_servo(logs: Sequence[Log], rig: Rig) -> Rig:
    """`rig` driven by the PI servo (equations 3 to 6) that its logs show; as it is where it has one, or they show none."""
    if rig.driven.servo or not shows_servo(logs, rig):
        return rig
    plant = identified_rig(identify(logs, rig), rig)
    guess = with_usual_servo(logs, plant)
    return identified_rig(identify(logs, guess), guess)


def with_usual_servo(logs: Sequence[Log], plant: Rig) -> Rig:
    """`plant` behind a PI servo: supply and acceleration as the logs reach them, gains of a loop that rings as most do."""
    J, Km = plant.model["J"], plant.model["Km"]
    top = max(_highest(log, plant) for log in logs)
    accel = max(float(np.max(np.abs(np.diff(log.w_cmd) / np.diff(log.t)))) for log in logs)
    values = {
        "Vmax": top,
        "Rs": SOURCE * plant.model["Rm"],
        "Kp": 2.0 * J / (Km * DECAY_S),
        "Ki": J * RINGING**2 / Km,
        "accel_cmd": accel,
    }
    servo = {name: Quantity(value, PARAMETERS[name][0], "from the logs") for name, value in values.items()}
    return replace(plant, drive="pi_servo", quantities={**plant.quantities, **servo})


def _highest(log: Log, plant: Rig) -> float:
    """The highest voltage of a log, of its current and the speed it was asked for where none was read [V]."""
    voltage = np.abs(log.z[:, 0])
    if np.isfinite(voltage).any():
        return float(np.nanmax(voltage))
    i, w = np.nanmax(np.abs(log.z[:, 1])), np.max(np.abs(log.w_cmd))
    return float(plant.model["Rm"] * i + plant.model["Km"] * w)
