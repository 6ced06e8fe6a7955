"""Channels that are read later than others, as constants fit best: told as filters without a corner."""

import math
from dataclasses import replace

import numpy as np

from observer_fi.learn.driven.windows import Driven, at_times
from observer_fi.numerics import filled
from observer_fi.records import CHANNELS, Filter

_SURE, _SEEN = 4.0, 0.05  # standard errors, and samples, from which on a channel is late


def shows(late: float, std: float, interval: float) -> bool:
    """Whether a channel is late beyond doubt. All in s."""
    return abs(late) > max(_SURE * std, _SEEN * interval)


def as_filters(late: tuple[float, float, float], rate_hz: float) -> tuple[Filter, ...]:
    """What is told of channels that are later than another one by as much [s]: behind the one that is the earliest."""
    behind = [(own - min(late)) * rate_hz for own in late]
    return tuple(
        Filter(name, math.inf, 1, own) for name, own in zip(CHANNELS, behind, strict=True) if own > _SEEN
    )


def with_voltage_later(each: Driven, late: float) -> Driven:
    """A log whose voltage is taken for as much later as its current is [s]: that has noise which must not be smoothed."""
    z = each.log.z.copy()
    z[:, 0] = np.where(np.isfinite(z[:, 0]), at_times(each.log.t, filled(z[:, 0]), each.log.t - late), np.nan)
    return each._replace(log=replace(each.log, z=z)) if late else each
