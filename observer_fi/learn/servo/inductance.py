"""A winding with inductance, which the equations leave out: V = Rm i + L di/dt + Km w. A servo's fit of readings without it.

Taken for a resistance and a servo it made Rm 0.6 %, J 2 % and Ki 16 % of the truth off on motors of 1.5 ms. What no model of the
package knows is how such a servo closes its current; by as much as the inductance changed, intervals are wider.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.learn.integral_regression import change_rate, identify_driven
from observer_fi.logs import without_means
from observer_fi.physics import Rig
from observer_fi.records import Fit, Log, Parameter

OVER_S = 5e-4  # on either side of a reading, over which the rate of the current is taken: noise outgrows it over less
BETTER = 0.8  # of the misfit of the current, which must be left
CHANGED = 0.5  # of what the inductance changed, as a standard deviation


def winding_of(logs: Sequence[Log], rig: Rig) -> tuple[float, tuple[str, ...]]:
    """Inductance [H] that some logs show beyond doubt, and what to say of it; 0 where they show none."""
    try:
        fit = identify_driven([without_means(log) for log in logs], replace(rig, drive="voltage"))
    except InvalidLogError:
        return 0.0, ()
    return (float(fit.figures["inductance"]), fit.warnings) if fit.warnings else (0.0, ())


def without_inductance(log: Log, L: float) -> Log:
    """A log whose voltage is that of a winding without inductance, V - L di/dt."""
    z = log.z.copy()
    z[:, 0] -= L * change_rate(log.t, z[:, 1], max(1, round(OVER_S * log.rate_hz)))
    return replace(log, z=z)


def behind_inductance(behind: Fit, before: Fit, warnings: tuple[str, ...]) -> Fit:
    """The fit `behind` the inductance, whose intervals hold what `before`, which took it for something else, had otherwise; the
    latter where the servo's current follows from it as well: then a logger, or something else, looks like a winding.
    """
    if not behind.rmse["current_a"] < BETTER * before.rmse["current_a"]:
        return before
    values = {p.name: p.value for p in before.parameters}
    wider = tuple(_wider(p, CHANGED * abs(p.value - values.get(p.name, p.value))) for p in behind.parameters)
    return replace(behind, parameters=wider, warnings=warnings)


def _wider(p: Parameter, std: float) -> Parameter:
    low, high = (float(np.hypot(side, 1.96 * std)) for side in (p.value - p.low, p.high - p.value))
    return replace(p, std=float(np.hypot(p.std, std)), low=p.value - low, high=p.value + high)
