"""Charts of freed equations: a smoothed disturbance with its 95 % band over time, and over what it may depend on."""

from collections.abc import Sequence

import numpy as np

from observer_fi.improve import DRAWN, BinnedDisturbance, SmoothedDisturbance
from observer_fi.numerics import readable
from observer_fi.report.interactive import INK, Charts, Panel, Series, thinned
from observer_fi.report.learning_figures import AFTER, ALONG, BEFORE, REGRESSORS, ZERO, quantity

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


def _handy(disturbance: SmoothedDisturbance) -> tuple[str, float]:
    """The unit in which nearly all of a disturbance is short, and the factor to it."""
    low, high = _limits(disturbance, 1.0)
    return readable(disturbance.what.unit, max(-low, high))


def over_time(disturbance: SmoothedDisturbance, number: int) -> Charts:
    """One disturbance over the moves with its 95 % band."""
    unit, factor = _handy(disturbance)
    t, (mean, low, high) = thinned(
        disturbance.t,
        factor * disturbance.mean,
        factor * (disturbance.mean - disturbance.band),
        factor * (disturbance.mean + disturbance.band),
        most=ALONG,
    )
    line = Series("smoothed, with its 95 % band", mean, AFTER, 1.0, low=low, high=high)
    about = f"What the {disturbance.what.name} would have to be over the moves, with a band of 95 %."
    panel = Panel(disturbance.what.name.capitalize(), unit, t, (line,), about,
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
    unit, factor = _handy(disturbance)
    panels = []
    for name in (name for name in DRAWN if name in disturbance.curves):
        curve, (label, scale) = disturbance.curves[name], REGRESSORS[name]
        title = f"over {quantity(label)}, predicts {100.0 * curve.share:.0f} %"
        about = f"Mean {disturbance.what.name} over {label}, with a band of 95 %; it predicts {100.0 * curve.share:.0f} %."
        lines = _ways(curve, factor)
        panels.append(Panel(title, unit, scale * curve.at, lines, about, label, levels=ZERO))
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
