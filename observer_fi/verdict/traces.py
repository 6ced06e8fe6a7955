"""What is drawn of a log, in bounded memory: the whole of it decimated with its extremes kept, and every sample near
the moments that matter; beside it, what those samples say for each hypothesis, and what the verdict makes of it.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import inlined, uncounted
from observer_fi.physics import LABELS, Rig, label_of
from observer_fi.physics import paper_residuals as residuals
from observer_fi.records import Array, Estimate, Event, Log, Traces

BUCKETS = 600  # at most twice as many are held; each keeps up to six rows: the extremes of the three channels
MOST_SAMPLES = 3000  # kept near moments: 2 s of 1600 Hz, so that the page of a short log stays below 1.5 MB,
MORE_A_SECOND = 4.0  # and so many more a second of the log, so that an hour's stays below 5 MB
REMEMBERED_S = 1.0  # of the samples before a chunk: a moment may turn out to lie in them
_FINITE = 1e300  # densities beyond say the same
MOST_NATS = (
    50.0  # by which one sample may tell against a hypothesis: a filter that starts anew says "impossible"
)

Rows = Callable[[NDArray[np.int64] | slice], Array]
Span = tuple[float, float]


def rows(
    log: Log, e: Estimate, rig: Rig, drawn: Array, evidence: Array,
    which: NDArray[np.int64] | slice = slice(None),
) -> Array:  # fmt: skip
    """One row a sample: t, z, w, command, pitch, probability (m), predicted (3 m), w predicted (m), norm (m), innovations,
    evidence (4 m).

    drawn: (n, 3) all readings, of which the filters took those of `log`; evidence: (n, 4 m) see `Evidence`.
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
            evidence[which],
        )
    )  # fmt: skip


def unpacked(table: Array, m: int, mixture: tuple[Array, Array, Array] | None = None) -> Traces:
    """The rows of `rows` as Traces of m hypotheses, with the mixture's times, norms and predictions where it ran."""
    cuts = np.cumsum([1, 3, 1, 1, 1, m, 3 * m, m, m, 3, m, 3 * m])
    t, z, w, w_cmd, pitch, probability, predicted, w_predicted, norm, seen, evidence, spared = np.split(
        table, cuts[:-1], axis=1
    )
    mixture_t, mixture_norm, mixture_y = mixture or (np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3)))
    return Traces(
        t[:, 0], z, w[:, 0], w_cmd[:, 0], pitch[:, 0], probability, predicted.reshape(-1, m, 3), w_predicted, norm, seen,
        mixture_t, mixture_norm, mixture_y, evidence, spared.reshape(-1, m, 3), probability,
    )  # fmt: skip


class Evidence:
    """What the samples of a move so far say for each hypothesis [nats], as far as it moves; a rest says nothing."""

    def __init__(self) -> None:
        self.told: Array | None = None  # up to the end of the last chunk

    def add(self, e: Estimate, z: Array, std: Array, starts: Iterable[float]) -> Array:
        """The evidence at each of the next samples, (n, 4 m): how likely each hypothesis made them, less than the best of each
        sample did (m), and minus half its squared residuals over the noise, channel by channel (3 m).

        z (n, 3) readings; std (3,) their noise; starts: when moves began [s].
        """
        m, n = len(e.modes), e.t.size
        if self.told is None:
            self.told = np.zeros(4 * m)
        found, begins = np.empty((n, 4 * m)), np.zeros(n, dtype=np.bool_)
        for start in starts:  # one may lie in an earlier chunk
            k = int(np.searchsorted(e.t, start))
            begins[k : k + 1] = e.t[k : k + 1] == start
        density = e.density if e.density.size else np.zeros_like(e.probability)
        of_all = (np.ascontiguousarray(of) for of in (density, e.predicted, z, std, e.active))
        _add_up(*of_all, begins, self.told, found)
        return found


@uncounted
def _add_up(
    density: Array, predicted: Array, z: Array, std: Array, active: Array, begins: Array, told: Array, found: Array
) -> None:  # fmt: skip
    """Sum up in `told` what active samples tell, one after the other, anew from where a move begins.

    density (n, m), predicted (n, m, 3), z (n, 3), std (3,), active and begins (n,), told (4 m,), found (n, 4 m). What is missing
    tells nothing. Of a long log the arrays between numpy's steps, 20 MB a chunk, took a quarter of the time.
    """
    n, m = density.shape
    for k in range(n):
        if begins[k]:
            for j in range(4 * m):
                told[j] = 0.0
        if active[k]:
            best = -_FINITE
            for j in range(m):
                best = max(best, _finite(density[k, j]))
            for j in range(m):
                told[j] += max(_finite(density[k, j]) - best, -MOST_NATS)
                for c in range(3):
                    residual = (z[k, c] - predicted[k, j, c]) / std[c]
                    if residual == residual:
                        told[m + 3 * j + c] += max(-0.5 * (residual * residual), -MOST_NATS)
        for j in range(4 * m):
            found[k, j] = told[j]


@inlined
def _finite(nats: float) -> float:
    """A log-density as one can subtract it: 0 where there is none."""
    return min(max(nats, -_FINITE), _FINITE) if nats == nats else 0.0


def as_judged(traces: Traces, modes: tuple[str, ...], events: Sequence[Event]) -> Array:
    """Probabilities of the labels (k, 7), in the order of `LABELS`, as the verdicts on the moves leave them.

    From the moment on at which a verdict was certain, at the latest at the end of its move, the bank's probabilities give
    way to those of the verdict wherever they favour another label: an absolute test or the whole move has overruled them,
    which may know a fault that is no hypothesis of the bank.
    """
    labels = [label_of(mode) for mode in modes]
    p = np.column_stack(
        [traces.probability[:, [own == label for own in labels]].sum(axis=1) for label in LABELS]
    )
    for event in events:
        last = int(np.searchsorted(traces.t, event.end_s, "right")) - 1
        since = event.end_s if event.isolated_s is None else event.isolated_s
        first = min(int(np.searchsorted(traces.t, since)), last)
        if first < 0 or traces.t[last] < event.start_s:
            continue
        here = p[first : last + 1]
        here[here.argmax(axis=1) != LABELS.index(event.label)] = [event.posterior[label] for label in LABELS]
    return p


def since_onsets(evidence: Array, t: Array, events: Sequence[Event]) -> Array:
    """Evidence (k, ...) from the onset of each fault on, or from the start of a healthy move; NaN where there is no move.

    t (k,) s. Before an onset the samples speak for the healthy hypothesis, which says nothing of what came then.
    """
    found = np.full_like(evidence, np.nan)
    for event in events:
        begin = event.start_s if event.onset_s is None else event.onset_s
        first, last = int(np.searchsorted(t, begin)), int(np.searchsorted(t, event.end_s, "right"))
        if first < last:
            found[first:last] = evidence[first:last] - evidence[first]
    return found


class Samples:
    """Every sample within spans of time, which may turn out to matter after their samples have passed."""

    def __init__(self) -> None:
        self.kept: list[Array] = []
        self.times = np.empty(0)  # of what is kept, in order
        self.count, self.most, self.first = 0, float(MOST_SAMPLES), np.nan
        self.tail: Array | None = None
        self.chunk: tuple[Array, Rows] | None = None

    def add(self, t: Array, rows_of: Rows, spans: Iterable[Span]) -> None:
        """Take the next samples: t (n,) and what makes rows of them; spans: what is known to matter [s]."""
        if self.chunk is not None:
            self.tail = self._end(*self.chunk)
        self.chunk = t, rows_of
        self.first = t[0] if np.isnan(self.first) else self.first
        self.most = MOST_SAMPLES + MORE_A_SECOND * (t[-1] - self.first)
        self.keep(spans)

    def _end(self, t: Array, rows_of: Rows) -> Array:
        """The rows of the last second up to the end of the chunk, at most."""
        last = t[-1] - REMEMBERED_S
        fresh = rows_of(slice(int(np.searchsorted(t, last)), None))
        return fresh if self.tail is None else np.vstack((self.tail[self.tail[:, 0] >= last], fresh))

    def keep(self, spans: Iterable[Span]) -> None:
        """Keep the samples of these spans that are at hand: those of the last chunk, and of a second before it."""
        if self.chunk is None:
            return
        t, rows_of = self.chunk
        for low, high in spans:
            if high < t[0] - REMEMBERED_S or low > t[-1]:
                continue
            fresh = slice(int(np.searchsorted(t, low)), int(np.searchsorted(t, high, "right")))
            self._take(rows_of(fresh))
            if self.tail is not None and self.tail[0, 0] <= high and self.tail[-1, 0] >= low:
                self._take(self.tail[(self.tail[:, 0] >= low) & (self.tail[:, 0] <= high)])

    def _take(self, table: Array) -> None:
        at = np.searchsorted(self.times, table[:, 0])
        table = table[np.append(self.times, np.nan)[at] != table[:, 0]]
        if table.size and self.count + len(table) <= self.most:
            self.kept.append(table)
            self.count += len(table)
            self.times = np.sort(np.concatenate((self.times, table[:, 0])))
            if len(self.kept) > 16:
                self.kept = [np.vstack(self.kept)]

    def result(self) -> Array:
        """The rows kept, in order; the last second of the log where none are."""
        if not self.kept:
            return self._end(*self.chunk) if self.chunk is not None else np.empty((0, 0))
        table = np.vstack(self.kept)
        return table[np.argsort(table[:, 0], kind="stable")]


def together(whole: Array, near: Array) -> Array:
    """Two tables of rows of one log as one, each sample once, in order."""
    if not near.size or not whole.size:
        return whole
    both = np.vstack((whole, near))
    return both[np.unique(both[:, 0], return_index=True)[1]]


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
