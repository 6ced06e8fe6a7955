"""What is drawn of a log: a decimated overview that keeps extremes, in bounded memory, and every sample of a short zoom."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from observer_fi.physics import Rig
from observer_fi.physics import paper_residuals as residuals
from observer_fi.records import Array, Estimate, Log, Traces

BUCKETS = 600  # at most twice as many are held; each keeps up to six rows: the extremes of the three channels


def rows(
    log: Log, e: Estimate, rig: Rig, drawn: Array, which: NDArray[np.int64] | slice = slice(None)
) -> Array:
    """One row a sample: t, z, w, command, pitch, probability (m), predicted (3 m), w predicted (m), norm (m), innovations.

    drawn: (n, 3) all readings, of which the filters took those of `log`.
    """
    p, z, predicted = rig.model.vector, drawn[which], e.predicted[which]
    n, m, _ = predicted.shape
    norm = residuals.residual_norm(
        residuals.residual_vector(predicted, log.z[which][:, None, :], p),
        residuals.sensor_std(rig.noise_std, p),
    )
    return np.column_stack(
        (
            log.t[which], z, residuals.speed(z, p), log.w_cmd[which], log.pitch[which], e.probability[which],
            predicted.reshape(n, 3 * m), residuals.speed(predicted, p), norm, e.normalised[which],
        )
    )  # fmt: skip


def unpacked(table: Array, m: int, mixture: tuple[Array, Array, Array] | None = None) -> Traces:
    """The rows of `rows` as Traces of m hypotheses, with the mixture's times, norms and predictions where it ran."""
    cuts = np.cumsum([1, 3, 1, 1, 1, m, 3 * m, m, m, 3])
    t, z, w, w_cmd, pitch, probability, predicted, w_predicted, norm, seen = np.split(
        table, cuts[:-1], axis=1
    )
    mixture_t, mixture_norm, mixture_y = mixture or (np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3)))
    return Traces(
        t[:, 0], z, w[:, 0], w_cmd[:, 0], pitch[:, 0], probability, predicted.reshape(-1, m, 3), w_predicted, norm, seen,
        mixture_t, mixture_norm, mixture_y,
    )  # fmt: skip


class Overview:
    """Rows of a whole log in at most 2 * BUCKETS buckets; when they are full, neighbours merge."""

    def __init__(self) -> None:
        self.size = 1  # samples a bucket
        self.seen = 0
        self.kept: list[tuple[NDArray[np.int64], Array]] = []  # sample numbers, rows

    def add(self, z: Array, rows_of: Callable[[NDArray[np.int64]], Array]) -> None:
        """Take the next samples: z (n, 3), and what makes the rows of some of them."""
        number = np.arange(self.seen, self.seen + z.shape[0], dtype=np.int64)
        self.seen += z.shape[0]
        while self.seen > 2 * BUCKETS * self.size:
            self.size *= 2
        chosen = self._chosen(number, z)
        self.kept.append((number[chosen], rows_of(chosen)))
        if sum(k.size for k, _ in self.kept) > 24 * BUCKETS or len(self.kept) > 64:
            self.kept = [self._joined()]

    def _joined(self) -> tuple[NDArray[np.int64], Array]:
        number, table = np.concatenate([k for k, _ in self.kept]), np.vstack([r for _, r in self.kept])
        chosen = self._chosen(number, table[:, 1:4])
        return number[chosen], table[chosen]

    def _chosen(self, number: NDArray[np.int64], z: Array) -> NDArray[np.int64]:
        """First sample and extremes of voltage, current and position of each bucket, in order."""
        if not number.size:
            return number
        bucket = number // self.size
        first = np.flatnonzero(np.concatenate(([True], np.diff(bucket) > 0)))
        count = np.diff(np.append(first, number.size))
        keep = [first]
        for value in np.nan_to_num(z.T):
            for extreme in (np.minimum, np.maximum):
                there = np.flatnonzero(value == np.repeat(extreme.reduceat(value, first), count))
                keep.append(there[np.searchsorted(there, first)])
        return np.unique(np.concatenate(keep))

    def result(self) -> Array:
        """The rows kept."""
        return self._joined()[1]
