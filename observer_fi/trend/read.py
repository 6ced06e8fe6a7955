"""A log to its digest: constants where the rig has them and the logger is fast enough, else friction along the travel."""

from observer_fi.errors import InvalidLogError
from observer_fi.physics import Quantity, Rig
from observer_fi.records import Log
from observer_fi.trend import constants, travel
from observer_fi.trend.digests import Digest, joined, recorded_at
from observer_fi.trend.turn_ripple import of_turn


def digest_of(log: Log, rig: Rig) -> Digest:
    """What the log says of its actuator; without quantities, and with the reason, where it says nothing."""
    time = recorded_at(log.metadata)
    try:
        if constants.has_constants(log, rig):
            found, missing, conditions = constants.quantities(log, rig)
            names, units, value, covariance = joined(found)
            return Digest(log.path, log.sha256, names, units, value, covariance, conditions, missing, time)
    except InvalidLogError as error:
        return _silent(log, time, str(error).removeprefix(f"{log.path}: "))
    series = travel.series_of(log, rig)
    if isinstance(series, str):
        return _silent(log, time, series)
    friction, curve = travel.friction(series, rig)
    if curve is None:
        return _silent(log, time, "the mass moves too shortly; record moves of a second or longer")
    beside = [*of_turn(log, series, rig), *travel.events(series), *travel.loop(series)]
    names, units, value, covariance = joined([*friction, *beside])
    missing = {} if "A" in names else {"A": "moves in one direction only; record moves in both"}
    notes = (
        ("the current is a magnitude: its sign is taken from the direction of motion",)
        if series.unsigned
        else ()
    )
    return Digest(
        log.path, log.sha256, names, units, value, covariance, travel.conditions(series), missing, time, curve, notes
    )  # fmt: skip


def _silent(log: Log, time: str, reason: str) -> Digest:
    names, units, value, covariance = joined([])
    return Digest(
        log.path, log.sha256, names, units, value, covariance.reshape(0, 0), {}, {"everything": reason}, time
    )


def rig_without_constants() -> Rig:
    """A rig of which nothing is known: 1 mm of travel a radian and 1 N m/A, so that torques read as amperes."""
    known = {
        "D": (1e-3, "m/rad"),
        "Km": (1.0, "N m/A"),
        "J": (1e-6, "kg m^2"),
        "A": (1.0, "N m"),
        "B": (0.0, "N m/deg"),
    }
    quantities = {name: Quantity(value, unit, "chosen") for name, (value, unit) in known.items()}
    return Rig(
        "without_constants",
        "nothing is known: torques in amperes, 1 mm of travel a radian",
        "current",
        quantities,
    )
