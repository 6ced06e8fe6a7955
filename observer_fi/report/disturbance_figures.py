"""Charts of freed equations: a smoothed disturbance with its 95 % band over time, and over what it may depend on."""

from collections.abc import Sequence

import numpy as np

from observer_fi.improve import DRAWN, BinnedDisturbance, SmoothedDisturbance
from observer_fi.report.interactive import INK, Charts, Panel, Series, thinned
from observer_fi.report.learning_figures import AFTER, ALONG, BEFORE, REGRESSORS, ZERO, quantity

HANDY = {
    "N m": ("mN m", 1e3),
    "V": ("mV", 1e3),
    "A": ("mA", 1e3),
    "m": ("µm", 1e6),
    "m/s": ("mm/s", 1e3),
    "N m s/rad": ("nN m s/rad", 1e9),
}
_RANGE, _ROOM = (
    (0.01, 0.99),
    0.3,
)  # quantiles, and what is shown beyond them: single samples at a start ask for any size


def of_disturbances(disturbances: Sequence[SmoothedDisturbance]) -> list[tuple[Charts, Charts]]:
    """Of each disturbance its course over time, and its mean over what it may depend on."""
    return [
        (over_time(disturbance, number), over_regressors(disturbance, number))
        for number, disturbance in enumerate(disturbances)
    ]


def handy(unit: str) -> tuple[str, float]:
    """A unit in which the numbers are short, and the factor to it."""
    return HANDY.get(unit, (unit, 1.0))


def over_time(disturbance: SmoothedDisturbance, number: int) -> Charts:
    """One disturbance over the moves with its 95 % band."""
    unit, factor = handy(disturbance.what.unit)
    t, (mean, low, high) = thinned(
        disturbance.t,
        factor * disturbance.mean,
        factor * (disturbance.mean - disturbance.band),
        factor * (disturbance.mean + disturbance.band),
        most=ALONG,
    )
    line = Series("smoothed, with its 95 % band", mean, AFTER, 1.0, low=low, high=high)
    about = f"What the {disturbance.what.name} would have to be over the moves, with a band of 95 %."
    panel = Panel(disturbance.what.name.capitalize(), "" if unit == "1" else unit, t, (line,), about,
                  "time along the moves [s]", limits=_limits(disturbance, factor), levels=ZERO, height=170)  # fmt: skip
    return Charts(f"disturbance-{number}", (panel,))


def _limits(disturbance: SmoothedDisturbance, factor: float) -> tuple[float, float]:
    """What nearly all of a disturbance lies in, with room beyond, and zero."""
    known = np.isfinite(disturbance.mean)
    if not known.any():
        return -1.0, 1.0
    low = min(float(np.quantile(factor * (disturbance.mean - disturbance.band)[known], _RANGE[0])), 0.0)
    high = max(float(np.quantile(factor * (disturbance.mean + disturbance.band)[known], _RANGE[1])), 0.0)
    room = _ROOM * (high - low) or 1.0
    return low - room, high + room


def over_regressors(disturbance: SmoothedDisturbance, number: int) -> Charts:
    """The mean of a disturbance over each regressor, by the direction of motion where it differs."""
    unit, factor = handy(disturbance.what.unit)
    panels = []
    for name in (name for name in DRAWN if name in disturbance.curves):
        curve, (label, scale) = disturbance.curves[name], REGRESSORS[name]
        title = f"over {quantity(label)}, predicts {100.0 * curve.share:.0f} %"
        about = f"Mean {disturbance.what.name} over {label}, with a band of 95 %; it predicts {100.0 * curve.share:.0f} %."
        lines = _ways(curve, factor)
        panels.append(
            Panel(title, "" if unit == "1" else unit, scale * curve.at, lines, about, label, levels=ZERO)
        )
    return Charts(f"disturbance-{number}-over", tuple(panels), small=True)


def _ways(curve: BinnedDisturbance, factor: float) -> tuple[Series, ...]:
    """One line a direction; one line where both are the same."""
    directed = bool(np.isfinite(curve.backward).any())
    both = (("forward", curve.forward, AFTER), ("backward", curve.backward, BEFORE))
    ways = both if directed else (("both ways", curve.forward, INK),)
    band = factor * curve.band
    return tuple(
        Series(name, factor * y, colour, 1.5, points=3.0, low=factor * y - band, high=factor * y + band)
        for name, y, colour in ways
    )
