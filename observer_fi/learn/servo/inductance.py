"""A winding with inductance, which the equations leave out: V = Rm i + L di/dt + Km w. A servo's fit of readings without it.

Taken for a resistance and a servo it made Rm 0.6 %, J 2 % and Ki 16 % of the truth off on motors of 1.5 ms. What no model of the
package knows is how such a servo closes its current; by as much as the inductance changed, intervals are wider.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.learn.driven.integral_regression import identify_driven
from observer_fi.learn.plausibility import with_possible_signs
from observer_fi.learn.servo.servo_start import with_crawl
from observer_fi.logs import without_means
from observer_fi.physics import Rig
from observer_fi.records import Fit, Log, Parameter

# Of the misfit of the current, which must be left; or nats a sample that must be gained, or on filters before the readings may be
# lost: a filter that is as good is the lag of a servo's current loop; or of the misfit of the speed, where no servo is known.
BETTER, GAINED, LOST, HALF = 0.8, 0.05, 0.1, 0.5
# Times the misfit of the current that a winding leaves at most: what looked like one made it 1.45 times, and Kp 3 % off.
WORSE = 1.1
CHANGED = 0.5  # of what the inductance changed, as a standard deviation


def winding_of(logs: Sequence[Log], rig: Rig) -> Fit | None:
    """A fit of the winding and the mechanics alone, of logs that show an inductance beyond doubt; None of others.

    A loop whose speed is fed forward makes no command while its goal moves; that is no rest which tells a running mean.
    """
    try:
        even = [without_means(with_crawl(log, rig)) for log in logs]
        fit = identify_driven(even, replace(rig, drive="voltage"))
    except InvalidLogError:
        return None
    return with_possible_signs(fit, logs) if fit.inductance else None


def behind_inductance(behind: Fit, before: Fit, winding: Fit) -> Fit:
    """The fit `behind` the inductance, whose intervals hold what `before`, which took it for something else, had otherwise; the
    latter where the servo's current follows from it as well: then a logger, or something else, looks like a winding.
    """
    if not _better(behind, before):
        return before
    values = {p.name: p.value for p in before.parameters}
    wider = tuple(_wider(p, CHANGED * abs(p.value - values.get(p.name, p.value))) for p in behind.parameters)
    return replace(
        behind,
        parameters=wider,
        warnings=(*behind.warnings, *winding.warnings),
        inductance=winding.inductance,
    )


def _better(behind: Fit, before: Fit) -> bool:
    """Whether readings are explained better behind an inductance than by all else that looks like one."""
    if "current_a" not in behind.rmse:
        return behind.rmse["speed_rad_s"] < HALF * before.rmse["speed_rad_s"]
    left, had = behind.rmse["current_a"], before.rmse.get("current_a", np.inf)
    if left > WORSE * had:
        return False
    gained = before.nll_per_sample - behind.nll_per_sample
    return gained > -LOST if before.filters else gained > GAINED or left < BETTER * had


def _wider(p: Parameter, std: float) -> Parameter:
    low, high = (float(np.hypot(side, 1.96 * std)) for side in (p.value - p.low, p.high - p.value))
    return replace(p, std=float(np.hypot(p.std, std)), low=p.value - low, high=p.value + high)
