"""The servo of a rig that comes without one: gains, supply and commanded acceleration from its logs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer_fi.errors import UsageError
from observer_fi.learn.identification import identified_rig, identify
from observer_fi.logs import is_recovered
from observer_fi.physics import PARAMETERS, Quantity, Rig
from observer_fi.records import Log

# Where the search begins; the closed forms of section 3 and the likelihood find the rest from far away.
DECAY_S = 0.06  # of the loop's ringing, 2 J / (Km Kp)
RINGING = 100.0  # rad/s, sqrt(Km Ki / J)
SOURCE = 0.03  # resistance of the supply, as a share of the winding's


def with_servo(logs: Sequence[Log], rig: Rig) -> Rig:
    """`rig` driven by the PI servo (equations 3 to 6) that its logs show; as it is where it has one.

    Raises UsageError where the logs cannot show one: without voltage, or without a commanded speed.
    """
    if rig.driven.servo:
        return rig
    if "voltage_v" not in rig.driven.columns:
        raise UsageError(
            f'rig {rig.name!r} has drive = "{rig.drive}": a servo shows in voltage and commanded speed only'
        )
    for log in logs:
        if is_recovered(log):
            raise UsageError(
                f"{log.path}: column speed_cmd_rad_s is missing; a servo cannot be learned without it; log it"
            )
    plant = identified_rig(identify(logs, rig), rig)
    guess = replace(plant, drive="pi_servo", quantities={**plant.quantities, **_guess(logs, plant)})
    return identified_rig(identify(logs, guess), guess)


def _guess(logs: Sequence[Log], plant: Rig) -> dict[str, Quantity]:
    """Supply and acceleration as the logs reach them, gains of a loop that rings as most do."""
    J, Km = plant.model["J"], plant.model["Km"]
    top = max(float(np.nanmax(np.abs(log.z[:, 0]))) for log in logs)
    accel = max(float(np.max(np.abs(np.diff(log.w_cmd) / np.diff(log.t)))) for log in logs)
    values = {
        "Vmax": top,
        "Rs": SOURCE * plant.model["Rm"],
        "Kp": 2.0 * J / (Km * DECAY_S),
        "Ki": J * RINGING**2 / Km,
        "accel_cmd": accel,
    }
    return {name: Quantity(value, PARAMETERS[name][0], "from the logs") for name, value in values.items()}
