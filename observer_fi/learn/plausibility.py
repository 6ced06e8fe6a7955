"""Why a fit is not to be believed: columns of another sign or unit, constants far from the rig file's, readings unexplained."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.learn.move_data import Experiment
from observer_fi.learn.output_error import inflation_by_channel
from observer_fi.logs import log_segments, suspect_units
from observer_fi.numerics import digits, with_unit
from observer_fi.physics import Rig
from observer_fi.records import CHANNELS, Array, Fit, Log

SURE = 3.0  # standard errors below zero
# Standard deviations of what the rig file says of a constant that are left open, and the share of its value that always is: a
# winding is warmer on another day, a lead is not.
FAR = 5.0
OPEN = {"Rm": 0.03, "Km": 0.01, "D": 0.003}
_MAY_BE = {  # where it is more, and where it is less
    "Rm": (
        "the winding is warm, it is another motor, or the current reads too little",
        "it is another motor, or the current reads too much",
    ),
    "Km": (
        "it is another motor, or the voltage reads too much",
        "it is another motor or a hot magnet, or the voltage reads too little",
    ),
    "D": (
        "it is another lead or gear, or the position reads too much",
        "it is another lead or gear, or the position reads too little, lags or slips",
    ),
}
# Times the variance of noise that residuals have, by size and how long they hold together, from which they are none: a healthy
# campaign through loggers with noise, steps, holds, hum or colour leaves 1 to 2.2.
NO_NOISE = 10.0
_UNITS = dict(zip(CHANNELS, ("V", "A", "m"), strict=True))
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


def told_if_far(fit: Fit, rig: Rig, stated: Mapping[str, float]) -> tuple[str, ...]:
    """What to say of constants that are far from the rig file's. stated: relative standard deviations where it gives none."""
    told = []
    for p in fit.parameters:
        usual = rig.model[p.name] if p.name in stated else 0.0
        if not usual > 0.0:
            continue
        off = p.value / usual - 1.0
        open_by = math.hypot(rig.spread(p.name) or stated[p.name], p.std / usual)
        if abs(off) > max(FAR * open_by, OPEN[p.name]):
            more = "more" if off > 0.0 else "less"
            times = digits(abs(off) / open_by)
            told.append(
                f"{p.name} is {digits(100.0 * abs(off))} % {more} than the rig file says, {times} times what that leaves open: "
                f"{_MAY_BE[p.name][off < 0.0]}; the other constants go with it"
            )
    return tuple(told)


def told_if_left(experiments: Sequence[Experiment], residuals: Sequence[Array]) -> tuple[str, ...]:
    """What to say of readings that a fit leaves unexplained. residuals: of each log, (N, 3) over the noise."""
    found = [inflation_by_channel(e, r) for e, r in zip(experiments, residuals, strict=True)]
    worst, k, c = max((own[c], k, c) for k, own in enumerate(found) for c in range(3))
    if worst <= NO_NOISE:
        return ()
    seen = experiments[k].weight[:, c] > 0.0
    left = float(np.sqrt(np.mean((residuals[k][seen, c] / experiments[k].weight[seen, c]) ** 2)))
    return (
        f"what the fit leaves of the {CHANNELS[c]}, {with_unit(left, _UNITS[CHANNELS[c]])}, is no noise: the equations miss "
        "something that these logs hold, and constants may be off by more than their intervals; `observer-fi improve` looks for "
        "it",
    )
