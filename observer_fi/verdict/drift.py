"""Small and slow changes: means of nominal's innovations over the last tenths of a second to seconds.

What grows slowly never makes another hypothesis certain: the filters follow it. But their innovations stay on one side. An
exponentially weighted mean (Roberts 1959) costs nothing in memory and says when.
"""

import numpy as np
from scipy.signal import lfilter

from observer_fi.records import Array

TIMES_S = (0.1, 0.4, 1.6)  # over which innovations are averaged
# Standard deviations of such a mean. Healthy moves over nine kinds of command reach 5.3; a false one costs a look at the move.
LIMIT = 6.0
CHANNELS = slice(
    1, 3
)  # current and position: a voltage also follows inertias that a rig file has slightly wrong


class Drift:
    """Watches one move. since: when a mean was first beyond the limit [s], None so far."""

    def __init__(self) -> None:
        self.means: list[Array] = [np.zeros((1, 2)) for _ in TIMES_S]
        self.seen = 0
        self.since: float | None = None

    def add(self, t: Array, normalised: Array, interval: float) -> None:
        """Take the next samples under way. normalised: (n, 3) innovations over their deviations, 0 where they do not count."""
        if self.since is not None or not t.size:
            return
        z = np.nan_to_num(normalised[:, CHANNELS])
        k = self.seen + np.arange(1, t.size + 1)
        self.seen += t.size
        for j, time in enumerate(TIMES_S):
            weight = min(interval / time, 1.0)
            mean, self.means[j] = lfilter([weight], [1.0, weight - 1.0], z, axis=0, zi=self.means[j])
            std = np.sqrt(weight / (2.0 - weight) * (1.0 - (1.0 - weight) ** (2 * k)))
            beyond = np.flatnonzero((np.abs(mean) > LIMIT * std[:, None]).any(axis=1))
            if beyond.size:
                found = float(t[beyond[0]])
                self.since = found if self.since is None else min(self.since, found)


def largest_means(normalised: Array, interval: float) -> Array:
    """The largest mean of any channel over any of the times, in its standard deviations, at each of (n, 3) innovations, (n,).

    They come after a long calm.
    """
    z, largest = np.nan_to_num(normalised[:, CHANNELS]), np.zeros(len(normalised))
    for time in TIMES_S:
        weight = min(interval / time, 1.0)
        mean = lfilter([weight], [1.0, weight - 1.0], z, axis=0)
        largest = np.maximum(largest, np.abs(mean).max(axis=1) / np.sqrt(weight / (2.0 - weight)))
    return largest
