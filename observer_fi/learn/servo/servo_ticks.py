"""Between two ticks a sampled servo holds its current: samples of another clock see it older or younger by up to a tick.

What is fitted is a servo that answers at once, late by half a tick. Where a logger's rate divides that of the ticks every sample
is as old as the next, and a delay says it; at any other rate a ramp of 15 ms leaves ten times the noise, as if the servo or the
circuit were another. The age of each sample is told by the readings themselves: what is left of voltage and current over the
slope of the current is a sawtooth in time, whose frequency, seen by the logger, is that of the ticks folded (aliasing), and
whose height is a tick. Held is the current, so that the voltage is off by Rm times as much.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.learn.joint_likelihood import JointFit, Part, model_of, predict
from observer_fi.learn.move_data import Experiment, commands, prepare, run
from observer_fi.numerics import digits
from observer_fi.physics import Model, Rig, override, simulation
from observer_fi.records import Array, Log

STEEP = 0.1  # of the best standard error of an age: flatter samples tell nothing beside the others
MOST = 4000  # samples that are looked at: the steepest
FEWEST = 40  # ages, and of a stretch without a gap from which a parabola is taken
STRETCH = 6
BEST_S = 2e-6  # standard error of an age that no model is better than
# Frequencies over those of a log of this length, and of one by which a found one may be off.
FINE, NEAR = 4, 0.25
SLOWEST_FOLD = 3.0  # turns of the fold in a log: what takes longer is one age
PER_SAMPLE = 40  # ticks at most that lie between two samples
HEIGHT = (0.5, 2.0)  # of a line of the ages over that of ticks that may have made it
TURNS, PHASES, CLOSER = 9, 24, 4  # frequencies beside a peak, phases, and how often these are taken finer
# That ticks must gain, over all and a sample, and of the misfit of steep stretches that they must explain.
NATS, EACH, SHARE = 40.0, 0.05, 0.3


class Ticks(NamedTuple):
    """The ticks of a servo on the clock of a log: their rate [1/s], and the turns of it at the log's time zero."""

    rate_hz: float
    phase: float

    def age(self, t: Array) -> Array:
        """(n,) time since the last tick [s]."""
        return ((t * self.rate_hz - self.phase) % 1.0) / self.rate_hz

    def told(self) -> str:
        """What to say of readings that are taken to one age."""
        return (
            f"the servo sets its current {digits(self.rate_hz)} times a second, which the log's rate does not divide: voltage "
            f"and current are up to {digits(1e3 / self.rate_hz)} ms old, and are taken for half as old as that"
        )


class _Ages(NamedTuple):
    """What voltage and current say of their age, of n steep samples: times [s], ages about their mean [s], weights [1/s^2].

    rows (m,): those of long enough stretches in a row, which begin at first (k,) of them; slow (m, 3): what a parabola over each
    stretch makes of weighted ages, at right angles to each other.
    """

    t: Array
    age: Array
    weight: Array
    rows: NDArray[np.intp]
    first: NDArray[np.intp]
    slow: Array

    def cost(self, ticks: Ticks) -> float:
        """Negative log-likelihood [nats] of ages that are those of these ticks, about a mean."""
        left = self.age - ticks.age(self.t)
        left -= np.average(left, weights=self.weight)
        return 0.5 * float(self.weight @ left**2)

    def bent_cost(self, ticks: Ticks | None) -> float:
        """The same of what no parabola over a stretch is: models are wrong slowly. None: of ages that are all the same."""
        left = (self.age - ticks.age(self.t) if ticks else self.age)[self.rows]
        left = np.sqrt(self.weight[self.rows]) * left
        parabolas = np.add.reduceat(self.slow * left[:, None], self.first)
        return 0.5 * float(left @ left - (parabolas**2).sum())

    def bent(self) -> "_Ages":
        """The same ages of those stretches alone, each without its parabola."""
        root = np.sqrt(self.weight[self.rows])
        left = root * self.age[self.rows]
        parabolas = np.add.reduceat(self.slow * left[:, None], self.first)
        lengths = np.diff(np.append(self.first, self.rows.size))
        left -= (self.slow * np.repeat(parabolas, lengths, axis=0)).sum(axis=1)
        every = np.arange(self.rows.size)
        return self._replace(t=self.t[self.rows], age=left / root, weight=root**2, rows=every)

    def tell(self, ticks: Ticks) -> bool:
        """Whether ticks explain enough of what they may."""
        before = self.bent_cost(None)
        noise = 0.5 * (self.rows.size - self.slow.shape[1] * self.first.size)
        gained = before - self.bent_cost(ticks)
        return gained > max(NATS, EACH * self.t.size, SHARE * (before - noise))


def ticks_of(part: Part, plant: Model, fitted: JointFit, nuisance: Array, log: Log) -> Ticks | None:
    """The servo's ticks, told by a fit of one log; None where all samples are as old, or none are told.

    Where a fit is far from its log, only the steps from one sample to the next tell.
    """
    model = model_of(plant, fitted.values, part.number)
    ages = _ages(part.experiment, predict(part, plant, fitted.values, nuisance), model["Rm"], log.rate_hz)
    if ages is None:
        return None
    found = _best(ages, ages.cost, log.rate_hz)
    if found is not None and ages.tell(found):
        return found
    found = _best(ages.bent(), ages.bent_cost, log.rate_hz)
    return found if found is not None and ages.tell(found) else None


def _best(ages: _Ages, cost: Callable[[Ticks], float], rate_hz: float) -> Ticks | None:
    """The likeliest ticks of those that a line of the ages may come of."""
    found = min(_candidates(ages, rate_hz), key=cost, default=None)
    if found is None:
        return None
    span = float(ages.t[-1] - ages.t[0])
    for closer in range(CLOSER):
        found = min(_beside(found, span, 0.5**closer), key=cost)
    return found


def at_one_age(log: Log, commanded: Log, rig: Rig, model: Model, ticks: Ticks) -> Log:
    """The log with voltage and current as they are half a tick after the last one, by what `model` says of the current's way.

    That is when a servo that answers at once, late by half a tick, has them. commanded: the same rows with the servo's command.
    """
    try:
        e = prepare([commanded], rig)
    except InvalidLogError:
        return log
    plain = override(model, model.name, tick_share=0.0)
    ready = commands(e, plain.vector)
    states, y = run(e, plain, np.zeros((e.moves, 2)), ready)
    z = log.z.copy()
    for m in range(e.moves):
        rows = e.rows(m)
        own = slice(int(e.start[m]), int(e.start[m]) + rows.stop - rows.start)
        older, read = ticks.age(e.t[rows]) - 0.5 / ticks.rate_hz, y[rows].copy()
        simulation.age(e.t[rows], states[rows], ready[1][rows], older, plain.vector, read)
        z[own, :2] -= (read - y[rows])[:, :2]
    return replace(log, z=z)


def _ages(e: Experiment, y: Array, Rm: float, rate_hz: float) -> _Ages | None:
    """What the readings beside those of a model y (n, 3) say of the age of each steep sample; None where too few say anything."""
    found = []
    for m in range(e.moves):
        rows = e.rows(m)
        slope = np.gradient(y[rows, 1], e.t[rows])
        scaled = slope[:, None] * (np.array([Rm, 1.0]) / e.noise[:2])
        weight = (scaled**2).sum(axis=1)
        off = (scaled * (e.z[rows, :2] - y[rows, :2]) / e.noise[:2]).sum(axis=1)
        there = (e.weight[rows, :2] > 0.0).all(axis=1) & (weight > 0.0)
        found.append(np.column_stack([e.t[rows], -off / np.maximum(weight, 1e-300), weight])[there])
    t, age, weight = np.concatenate(found).T
    weight = np.minimum(weight, BEST_S**-2)
    steep = weight > STEEP**2 * weight.max(initial=0.0)
    if np.count_nonzero(steep) > MOST:
        steep &= weight >= np.partition(weight, -MOST)[-MOST]
    if np.count_nonzero(steep) < FEWEST:
        return None
    t, age, weight = t[steep], age[steep], weight[steep]
    cuts = np.flatnonzero(np.diff(t) * rate_hz > 1.5) + 1
    ends = zip([0, *cuts.tolist()], [*cuts.tolist(), t.size], strict=True)
    stretches = [np.arange(a, b) for a, b in ends if b - a >= STRETCH]
    if not stretches:
        return None
    slow = [_parabolas(weight[own]) for own in stretches]
    first = np.cumsum([0, *(own.size for own in stretches[:-1])])
    about = age - np.average(age, weights=weight)
    return _Ages(t, about, weight, np.concatenate(stretches), first, np.concatenate(slow))


def _parabolas(weight: Array) -> Array:
    """(n, 3) parabolas over n samples in a row, at right angles to each other where they count so much."""
    u = np.linspace(-1.0, 1.0, weight.size)
    return np.asarray(np.linalg.qr(np.sqrt(weight)[:, None] * np.column_stack((np.ones(u.size), u, u**2)))[0])


def _candidates(ages: _Ages, rate_hz: float) -> Iterator[Ticks]:
    """Ticks whose sawtooth a logger of `rate_hz` may have seen as the strongest line of the ages."""
    row = np.round((ages.t - ages.t[0]) * rate_hz).astype(np.int64)
    size = 1 << math.ceil(math.log2(FINE * (int(row[-1]) + 1)))
    sampled = np.bincount(row, ages.weight * ages.age, minlength=size)
    line = 2.0 * np.abs(np.fft.rfft(sampled)) / ages.weight.sum()
    span = float(ages.t[-1] - ages.t[0])
    first = math.ceil(SLOWEST_FOLD / span * size / rate_hz)
    if first >= line.size:
        return
    peak = first + int(np.argmax(line[first:]))
    fold, bin_hz = peak * rate_hz / size, rate_hz / size
    alternates = 0.5 * rate_hz - fold < 2.0 / span  # of a line at half the rate both halves are one
    height = float(line[peak]) * (0.5 if alternates else 1.0)
    for n in range(1, PER_SAMPLE):
        for about in (n * rate_hz - fold, n * rate_hz + fold):
            if about > rate_hz and HEIGHT[0] < math.pi * about * height < HEIGHT[1]:
                for rate in about + np.linspace(-2.0, 2.0, TURNS) * bin_hz:
                    yield from (Ticks(float(rate), k / PHASES) for k in range(PHASES))


def _beside(found: Ticks, span: float, size: float) -> list[Ticks]:
    """Ticks about some, within a share of what a log of `span` [s] tells of their rate and their phase."""
    rates = found.rate_hz + np.linspace(-1.0, 1.0, TURNS) * NEAR * size / span
    shifts = np.linspace(-1.0, 1.0, TURNS) * size / PHASES
    return [
        found._replace(rate_hz=float(rate), phase=float(found.phase + shift))
        for rate in rates
        for shift in shifts
    ]


def with_one_age(
    logs: Sequence[Log], commanded: Sequence[Log], rig: Rig, parts: Sequence[Part], fitted: JointFit
) -> tuple[list[Log], tuple[Ticks, ...]]:
    """Logs whose voltage and current have one age, by the fit of all of them, and the ticks of those that had not.

    commanded: the same logs with the servo's command.
    """
    taken, told = list(logs), []
    for part, nuisance in zip(parts, fitted.nuisance, strict=True):
        ticks = ticks_of(part, rig.model, fitted, nuisance, logs[part.number])
        if ticks is not None and not part.loses:
            model = model_of(rig.model, fitted.values, part.number)
            taken[part.number] = at_one_age(logs[part.number], commanded[part.number], rig, model, ticks)
            told.append(ticks)
    return taken, tuple(told)


def are_one(some: Sequence[Ticks], others: Sequence[Ticks], logs: Sequence[Log]) -> bool:
    """Whether two sets of ticks have the same rates, as well as the logs tell them apart."""
    apart = max(1.0 / float(np.ptp(log.t)) for log in logs)
    return len(some) == len(others) and all(
        abs(a.rate_hz - b.rate_hz) < apart for a, b in zip(some, others, strict=True)
    )
