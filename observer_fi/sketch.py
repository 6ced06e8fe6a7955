"""What is drawn of a log: a decimated overview that keeps extremes, in bounded memory, and every sample of a short zoom."""

import numpy as np
from numpy.typing import NDArray

from observer_fi import paper_residuals as residuals
from observer_fi.models import Rig
from observer_fi.records import Array, Estimate, Log, Traces

BUCKETS = 600  # at most twice as many are held; each keeps up to six rows: the extremes of the three channels


def rows(log: Log, e: Estimate, rig: Rig) -> Array:
    """One row a sample: t, z, w, command, pitch, probability (m), predicted (3 m), w predicted (m), norm (m), innovations."""
    p = rig.model.vector
    n, m = e.probability.shape
    norm = residuals.residual_norm(
        residuals.residual_vector(e.predicted, log.z[:, None, :], p), residuals.sensor_std(rig.noise_std, p)
    )
    return np.column_stack(
        (
            log.t, log.z, residuals.speed(log.z, p), log.w_cmd, log.pitch, e.probability, e.predicted.reshape(n, 3 * m),
            residuals.speed(e.predicted, p), norm, e.normalised,
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

    def add(self, table: Array) -> None:
        """Take the next rows."""
        number = np.arange(self.seen, self.seen + table.shape[0], dtype=np.int64)
        self.seen += table.shape[0]
        while self.seen > 2 * BUCKETS * self.size:
            self.size *= 2
        self.kept.append(self._thinned(number, table))
        if sum(k.size for k, _ in self.kept) > 24 * BUCKETS or len(self.kept) > 64:
            self.kept = [
                self._thinned(np.concatenate([k for k, _ in self.kept]), np.vstack([r for _, r in self.kept]))
            ]

    def _thinned(self, number: NDArray[np.int64], table: Array) -> tuple[NDArray[np.int64], Array]:
        """First row and extremes of voltage, current and position of each bucket, in order."""
        if not number.size:
            return number, table
        bucket = number // self.size
        first = np.flatnonzero(np.concatenate(([True], np.diff(bucket) > 0)))
        keep = [first]
        group = np.cumsum(np.concatenate(([0], (np.diff(bucket) > 0).astype(int))))
        for c in (1, 2, 3):
            order = np.lexsort((np.nan_to_num(table[:, c]), group))
            keep += [order[first], order[np.concatenate((first[1:], [number.size])) - 1]]
        chosen = np.unique(np.concatenate(keep))
        return number[chosen], table[chosen]

    def result(self) -> Array:
        """The rows kept."""
        number, table = self._thinned(
            np.concatenate([k for k, _ in self.kept]), np.vstack([r for _, r in self.kept])
        )
        return table
