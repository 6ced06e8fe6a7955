"""Columns whose sign or unit is another than the rig's motor has: a fit would take them for constants that no motor has."""

from collections.abc import Sequence

from observer_fi.errors import InvalidLogError
from observer_fi.logs import log_segments, suspect_units
from observer_fi.physics import Rig
from observer_fi.records import Fit, Log

SURE = 3.0  # standard errors below zero
_TURNED = {
    ("Rm", "Km"): "voltage_v goes the other way than current_a and position_m",
    ("Km",): "position_m goes the other way than voltage_v and current_a drive it",
    ("Rm",): "current_a goes the other way than voltage_v and position_m",
    ("J",): "position_m goes the other way than current_a drives it",
}


def refuse_suspects(logs: Sequence[Log], rig: Rig) -> None:
    """Raises InvalidLogError for a channel whose size or sign a motor like the rig's cannot produce."""
    for log in logs:
        for note in suspect_units(log, log_segments(log), rig.model):
            raise InvalidLogError(f"{log.path}: {note}")


def with_possible_signs(fit: Fit, logs: Sequence[Log]) -> Fit:
    """The fit as it is. Raises InvalidLogError where a resistance, torque constant or inertia is below zero beyond doubt."""
    below = {p.name for p in fit.parameters if p.value < -SURE * p.std}
    for names, what in _TURNED.items():
        if below.issuperset(names):
            raise InvalidLogError(
                f"{logs[0].path}: {what}: its sign is inverted; give it `factor = -1.0` in a column map, which "
                "`observer-fi inspect` writes"
            )
    return fit
