"""Which equation the data want to free: each in turn gets a disturbance, whose intensity the likelihood chooses.

Source: Kristensen, Madsen and Jorgensen (2004), "Parameter estimation in stochastic grey-box models", Automatica 40: the
equation whose diffusion term is far from zero is the one that is wrong.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from observer_fi.improve.freed.random_walk import Series, likelihood
from observer_fi.learn import DISTURBANCES, TORQUE, Experiment, Linear
from observer_fi.physics import Model
from observer_fi.records import Array

WANTED_NATS = 20.0  # of 12 logs without any effect (seeds 9000 to 9011) the most is 4
CLOSE_SHARE = 0.02  # of the best gain: rivals that fall short by less are told with it
CLOSE_ALIKE = 0.05  # the same for equations that are known to look like the first
CLOSE_NATS = 6.0  # the same where gains are small, as in `ladder.py`
# s: an error that stays for a good part of a move, and one that changes within a turn of the motor.
MEMORIES = (1.0, 3e-3)
_LEAST, _START, _MOST = -5.0, -2.0, 1.0  # decades of the reference sizes
_FINER = (0.4, 0.16)  # decades
_FLAT = 0.5  # nats
ALIKE = {
    "torque": "a pitch sensor that is off acts as a load torque and as nothing else: its size and shape must rule it out; an "
    "error of the current sensor that grows with the speed, together with another Km, acts as a drag",
    "electrical": "the voltage sensor differs from it only while the supply is at its limit, and a current gain is a resistance",
    "sensor:voltage": "a voltage in the winding differs from it only while the supply is at its limit",
    "sensor:current": "a torque differs from it in the voltage only, which another Km hides where both grow with the speed",
    "kinematics": "the position sensor: what follows from x is seen by that sensor alone",
    "sensor:position": "the screw: what follows from x is seen by this sensor alone",
    "contact": "a torque at that end of the travel, for whatever reason",
    "sensor:pitch": "a load torque: gravity is all that the pitch enters",
}


# What the wrong equation may be where another comes first: the pairs of `ALIKE`.
LOOKS_LIKE = {
    "torque": ("sensor:pitch", "contact"), "electrical": ("sensor:voltage", "sensor:current"), "contact": ("torque",),
    "sensor:voltage": ("electrical",), "kinematics": ("sensor:position",), "sensor:position": ("kinematics",),
}  # fmt: skip


class Freed(NamedTuple):
    """One disturbance (index into `DISTURBANCES`) with the memory [s] and stationary standard deviation that the likelihood
    chose, and the nats that it gains.
    """

    kind: int
    memory: float
    size: float
    gain: float


@dataclass(frozen=True)
class FreedEquation:
    """One equation with its best disturbance.

    intensity: unit per root second; memory [s]; size: stationary standard deviation; rms of the smoothed disturbance while the
    motor turns. gain: nats in all. verdict: "first", "close" to it, "wanted" or "no". alike: what it may be taken for.
    """

    equation: str
    disturbance: str
    unit: str
    memory: float
    intensity: float
    size: float
    rms: float
    gain: float
    gain_per_sample: float
    verdict: str
    alike: str


def free_each(experiment: Experiment, model: Model, linear: Linear, series: Series) -> list[Freed]:
    """Every disturbance that these rows could show, in the order of `DISTURBANCES`."""
    told = [k for k, what in enumerate(DISTURBANCES) if what.equation not in experiment.silent]
    shown = [k for k in told if np.any(linear.G[k]) or np.any(linear.S[k])]
    references = _references(model, experiment.noise)
    none = likelihood(linear, series, 0, 0.0, MEMORIES[0])[0]
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda k: _freed(linear, series, k, references[k], none), shown))


def _references(model: Model, noise: Array) -> list[float]:
    """A large size of every disturbance, in its unit."""
    speed, current = model["Vmax"] / model["Km"], model["Vmax"] / (model["Rm"] + model["Rs"])
    torque, V, rate = max(model["A"], 1e-3 * model["Km"] * current), model["Vmax"], model["D"] * speed
    large = (1e3 * noise).tolist()
    return [torque, torque, torque / speed, V, model["Rm"], V, speed, current, rate, 1.0, torque, *large]


def _freed(linear: Linear, series: Series, kind: int, reference: float, none: float) -> Freed:
    """The likeliest memory and size of one disturbance; none: the likelihood without it."""

    def gain(memory: float, decade: float) -> float:
        return likelihood(linear, series, kind, reference * 10.0**decade, memory)[0] - none

    found: list[tuple[float, float, float]] = []
    for memory in MEMORIES:
        start = max(found)[1] if found and max(found)[0] > _FLAT else _START
        found.append((*climb(partial(gain, memory), start, 1.0), memory))
    most, decade, memory = max(found)
    if most < _FLAT:
        return Freed(kind, memory, 0.0, 0.0)
    for width in _FINER:
        most, decade = climb(partial(gain, memory), decade, width, 1)
    return Freed(kind, memory, reference * 10.0**decade, most)


def climb(gain: Callable[[float], float], start: float, width: float, steps: int = 10) -> tuple[float, float]:
    """The most that a gain of one maximum reaches, and where, in steps of `width` from `start` within the decades allowed."""
    at = cache(gain)
    for _ in range(steps):
        near = [d for d in (start, start - width, start + width) if _LEAST <= d <= _MOST]
        best = max(near, key=at)
        if best == start:
            break
        start = best
    return at(start), start


def freed_equations(
    experiment: Experiment, model: Model, freed: Sequence[Freed], rms: Callable[[Freed], float]
) -> tuple[FreedEquation, ...]:
    """The best disturbance of every equation, the largest gain first. rms: of the smoothed disturbance."""
    ranked = sorted(freed, key=lambda f: -f.gain)
    best = {DISTURBANCES[f.kind].equation: f for f in reversed(ranked)}
    rows = [
        _row(experiment, equation, f, ranked[0], rms(f) if f.gain >= WANTED_NATS else 0.0)
        for equation, f in best.items()
    ]
    load = next((f for f in ranked if f.kind == TORQUE and f.gain >= WANTED_NATS), None)
    if load is not None and model["B"] != 0.0:
        rows.append(_as_pitch(_row(experiment, "sensor:pitch", load, ranked[0], rms(load)), model))
    return tuple(sorted(rows, key=lambda row: -row.gain))


def _row(experiment: Experiment, equation: str, f: Freed, first: Freed, rms: float) -> FreedEquation:
    what = DISTURBANCES[f.kind]
    samples = max(int((experiment.weight > 0.0).any(axis=1).sum()), 1)
    intensity = f.size * math.sqrt(2.0 / f.memory)
    verdict = _verdict(equation, f.gain, first)
    return FreedEquation(
        equation, what.name, what.unit, f.memory, intensity, f.size, rms, f.gain, f.gain / samples, verdict,
        ALIKE.get(equation, ""),
    )  # fmt: skip


def _verdict(equation: str, gain: float, first: Freed) -> str:
    leader = DISTURBANCES[first.kind].equation
    if gain < WANTED_NATS:
        return "no"
    if equation == leader:
        return "first"
    share = CLOSE_ALIKE if equation in LOOKS_LIKE.get(leader, ()) else CLOSE_SHARE
    return "close" if first.gain - gain < max(CLOSE_NATS, share * first.gain) else "wanted"


def _as_pitch(torque: FreedEquation, model: Model) -> FreedEquation:
    """The row of the pitch sensor: B times its error is a load torque, and that is all that the pitch does."""
    B = abs(model["B"])
    return replace(
        torque,
        disturbance="pitch reading",
        unit="deg",
        intensity=torque.intensity / B,
        size=torque.size / B,
        rms=torque.rms / B,
    )
