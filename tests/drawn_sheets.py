"""What a user reads in the data sheets of a drawn actuator."""

import hidden

from observer_fi.physics import DataSheet


def drawn_sheet(actuator: hidden.Actuator, drive: str) -> DataSheet:
    """Its sheet, with resistance and torque constant 3 % off."""
    truth = actuator.rig
    return DataSheet(
        "drawn", drive, resistance=1.03 * truth.Rm, torque_constant=0.97 * truth.Km, rotor_inertia=actuator.rotor,
        gear=actuator.gear, lead=actuator.lead, mass=actuator.mass, travel=actuator.travel, supply=truth.Vmax,
    )  # fmt: skip
