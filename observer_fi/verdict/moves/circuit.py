"""A voltage that contradicts the other channels: its sensor, or the motor's own circuit, whose law the readings then follow.

With the voltage left out, the servo's law, the current and the position tell the speed, and equation 15 what the voltage should
be. What is read beyond that goes with the current where the winding's resistance has changed, with the speed where the torque
constant has, with the direction where the brushes have; a sensor's offset, gain and drift go with none of them alone. Where
the motor stays at one speed all of these look the same.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank, HypothesisState
from observer_fi.numerics import digits
from observer_fi.physics import PARAMETERS, UNKNOWN, Rig
from observer_fi.records import Array, Event, Severity
from observer_fi.verdict.drift import STOP_S, SURE, Z95, mostly, or_as_well
from observer_fi.verdict.isolate import shown_by_rest
from observer_fi.verdict.last_word import LastWord
from observer_fi.verdict.moves.whole_move import SETTLED_S, STRIDE, WholeMove

FEWEST = 8  # readings, a stride apart, that tell a law
FITS = 2.5  # times the deviations before the fault, that a law may leave
# Of deviations: beyond which they count no more, rounds of a robust fit, the median of a squared normal one. And of two laws, how
# many times as much the worse one must leave.
FAR, ROUNDS, MEDIAN_SQUARE, WORSE = 6.0, 20, 0.455, 1.3
CLEAR = 3.0  # times the current from which on brushes have contact
# Of the current of a motor that nothing drives, about its zero, and of that zero, in standard deviations; of the travel that was
# asked for, what a mass may still make; and how long it lasts at least: one that an obstacle or a jam stops draws current.
NO_CURRENT, OFFSET, NO_TRAVEL, DEAD_S = 5.0, 8.0, 0.05, 0.05
# About a change, where speeds are not steady [s]; a command that stays where it is, as a share of the fastest; and of the current
# that a weaker motor needs more, what it may be off.
AROUND_S, LEVEL, HALF = 0.1, 1e-6, 0.5
LEAST = 0.05  # of its resistance and of its torque constant, that a motor keeps
# At rest: standard deviations by which a sensor that fails contradicts the other one, and times its noise, what rings.
Z_REST, RINGS = 4.0, 3.0
MOSTLY = 0.98  # of the readings, but for spikes
DEAD = "the motor draws no current though the servo asks it to move, and the mass stands"
_SUPPLY = f"{DEAD}: the supply is off, the drive has tripped, or a wire or a brush has no contact"


class Beyond(NamedTuple):
    """What a voltage reads beyond equation 15, (n,) each: that, its standard deviation, time [s], current, speed and voltage by
    the other channels."""

    read: Array
    std: Array
    t: Array
    current: Array
    speed: Array
    expected: Array


class Fit(NamedTuple):
    """What a law leaves: half the sum of its squared deviations in units of their own, none of which counts beyond FAR, with the
    price of its constants; the usual square of one; constants and their standard deviations."""

    nats: float
    usual: float
    value: Array
    std: Array


def of_the_circuit(event: Event, bank: Bank, word: LastWord) -> Event:
    """The event of a voltage sensor as one of the motor's circuit where its law explains the readings and no sensor's does.

    Either where both do, or neither is asked: what no law explains may be a sensor that fails in a way of its own. bank: with
    the move's samples at hand.
    """
    dead = _dead_from(event, bank)
    if dead is not None:
        return _of_a_dead_motor(event, dead)
    if event.channel in ("voltage", "current") and shown_by_rest(event):
        return _of_a_stop(event, bank)
    if event.channel != "voltage" or not word.rig.watched.servo:
        return event
    whole = word.move(event, bank, STOP_S)
    beyond = None if whole is None else _beyond(event, whole)
    if whole is None or beyond is None:
        return event
    tried = [(name, *_compared(name, beyond)) for name in _SAID]
    possible = [one for one in tried if _possible(one[0], one[1], word)]
    possible = [
        one for one in possible if one[0] != "Km" or _drives_less(one[1], beyond.t[0], event.start_s, whole)
    ]
    if not possible:
        return event
    return _decided(event, *min(possible, key=lambda one: one[1].nats - one[2].nats), word)


def _compared(name: str, beyond: Beyond) -> tuple[Fit, Fit, float]:
    """The law of a circuit's constant that has changed, that of a sensor, and the nats of no law, where the first one tells.

    A current below which brushes have no contact to speak of differs from motor to motor: where it flows, they tell nothing.
    """
    knee = CLEAR * float(PARAMETERS["brush_current"][1] or 0.0) if name == "brush_drop" else 0.0
    use = np.abs(beyond.current) >= knee
    there = Beyond(*(column[use] for column in beyond))
    column = {"Rm": there.current, "Km": there.speed, "brush_drop": np.sign(there.current)}[name]
    law = _fit(there, (column,))
    sensor = _fit(there, (np.ones_like(there.t), there.expected, there.t - beyond.t[0]))
    return law, sensor, 0.5 * float(np.minimum((there.read / there.std) ** 2, FAR**2).sum())


def _of_a_stop(event: Event, bank: Bank) -> Event:
    """A sensor's event that a stop made, shared with none of these where the rest behind the stop contradicts nothing.

    A sensor that has failed reads on as it does; an inertia or a gain that has changed shows in the stop, and in a motor that
    rings on behind it.
    """
    rests = _rests(event, bank)
    if rests is None:
        return event
    before, after = rests
    noise = bank.rig.noise_std[:2]
    rings = bool((after.std(axis=0) > RINGS * noise).all())
    if not rings and abs(_contradiction(before, after, bank.rig)) > Z_REST:
        return event
    seen = "voltage and current ring on" if rings else "voltage and current agree again"
    why = f"only the stop shows it, and in the rest behind that {seen}: a changed inertia or gain looks the same"
    return or_as_well(event, UNKNOWN, why)


def _rests(event: Event, bank: Bank) -> tuple[Array, Array] | None:
    """Voltage and current (n, 2) in the rest before a move and in the one after it; None where they do not tell."""
    recent = bank.recent
    under_way = np.empty(0) if recent is None else recent.t[recent.active & (recent.t <= event.end_s)]
    if recent is None or not under_way.size:
        return None
    rest = (recent.w_cmd == 0.0) & np.isfinite(recent.z[:, :2]).all(axis=1)
    after = rest & (recent.t > under_way[-1] + SETTLED_S) & (recent.t <= event.end_s)
    before = rest & (recent.t < event.start_s)
    if min(before.sum(), after.sum()) < FEWEST:
        return None
    return recent.z[before, :2], recent.z[after, :2]


def _contradiction(before: Array, after: Array, rig: Rig) -> float:
    """How far voltage and current (n, 2) of a rest contradict each other more than they did before, in standard deviations."""
    per_current = np.array([1.0, -rig.model["Rm"]])
    noise = float(np.hypot(*(per_current * rig.noise_std[:2])))
    more = float((after @ per_current).mean() - (before @ per_current).mean())
    return more / (noise * math.sqrt(1.0 / len(before) + 1.0 / len(after)))


def _decided(event: Event, name: str, law: Fit, sensor: Fit, none: float, word: LastWord) -> Event:
    """The event by the better one of two fits; none: nats of no law."""
    margin, scale = word.settings.move_nats, max(1.0, min(law.usual, sensor.usual))
    apart = abs(sensor.nats - law.nats) > max(margin * scale, (WORSE - 1.0) * min(sensor.nats, law.nats))
    fits = law.usual < FITS**2 and none - law.nats > margin * scale
    if not fits or (apart and sensor.nats < law.nats):
        return event
    size = _size(name, law, word)
    if apart:
        why = (
            f"that {size.words} explains what is read, and no offset, gain or drift of a voltage sensor does"
        )
        posterior = mostly(UNKNOWN, event)
        return event._replace(
            label=UNKNOWN, channel=None, probability=SURE, posterior=posterior, alike=(), isolated_s=None,
            severity=(size,), reasons=(why,),
        )  # fmt: skip
    why = f"if {size.words}, this move reads the same: a start, a stop or a reversal behind it tells"
    return or_as_well(event, UNKNOWN, why)


def _possible(name: str, law: Fit, word: LastWord) -> bool:
    """Whether a constant may have become what a law found: windings keep some resistance, magnets lose strength, brushes drop."""
    was = word.rig.model[name]
    now, doubt = was + float(law.value[0]), Z95 * float(law.std[0])
    return {"Rm": now > LEAST * was, "Km": LEAST * was < now < was, "brush_drop": now > -doubt}[name]


def _drives_less(law: Fit, begun: float, start_s: float, whole: WholeMove) -> bool:
    """Whether the current has risen as a torque constant asks that has fallen: one load needs more of it."""
    window, model = whole.window, whole.nominal.model
    steady = window.active & (np.abs(np.gradient(window.w_cmd)) < LEVEL * np.abs(window.w_cmd).max())
    steady &= np.isfinite(window.z[:, 1])
    before = steady & (window.t > start_s + SETTLED_S) & (window.t < begun - AROUND_S)
    after = steady & (window.t > begun + AROUND_S)
    if min(before.sum(), after.sum()) < FEWEST * STRIDE:
        return False
    load = window.z[:, 1] - model["B"] / model["Km"] * window.theta
    was, now = float(load[before].mean()), float(load[after].mean())
    gravity = model["B"] / model["Km"] * float(window.theta[after].mean())
    more = model["Km"] / (model["Km"] + float(law.value[0])) - 1.0
    return bool(abs((now - was) - more * (was + gravity)) < HALF * abs(more * (was + gravity)))


_SAID = {
    "Rm": ("winding_resistance", "the winding resistance changed from {} to {}", "ohm"),
    "Km": ("torque_constant", "the torque constant changed from {} to {}", "N m/A"),
    "brush_drop": ("brush_drop", "the voltage at the brushes changed from {} to {}", "V"),
}


def _size(name: str, law: Fit, word: LastWord) -> Severity:
    """What the constant has become, with its interval."""
    tells, words, unit = _SAID[name]
    was = word.rig.model[name]
    value, half = was + float(law.value[0]), Z95 * float(law.std[0])
    return Severity(
        tells, value, (value - half, value + half), unit, words.format(digits(was), f"{digits(value)} {unit}")
    )


def _beyond(event: Event, whole: WholeMove) -> Beyond | None:
    """What the voltage reads beyond equation 15 from the fault on; None where too little is read."""
    begun = next((s for s in (event.onset_s, event.detected_s, event.doubted_s) if s is not None), None)
    failed = next((h for h in whole.faults if h.failed == 0), None)
    if begun is None or failed is None:
        return None
    begin = int(np.searchsorted(whole.window.t, begun))
    voltage, current, _ = whole.filters.rig.noise_std.tolist()
    noise = math.hypot(voltage, whole.nominal.model["Rm"] * current)

    before = _read(whole, whole.memories[: begin // STRIDE + 1], 0, noise)
    usual = float(np.sqrt(np.mean(before.read**2))) if before.t.size >= FEWEST else noise
    after = _read(whole, whole.since(failed, begin), begin, max(usual, noise))
    return after if after.t.size >= FEWEST else None


def _read(whole: WholeMove, memories: Sequence[HypothesisState], first: int, noise: float) -> Beyond:
    """What the voltage reads beyond equation 15 at each memory of a filter that was entered before sample `first`.

    noise: standard deviation of that for a speed that is known [V].
    """
    model, window = whole.nominal.model, whole.window
    rows = first + STRIDE * np.arange(1, len(memories) - 1) - 1
    speed = np.array([float(m.x[0]) for m in memories[1:-1]])
    var = np.array([max(float(m.P[0, 0]), 0.0) for m in memories[1:-1]])
    voltage, current = window.z[rows, 0], window.z[rows, 1]
    # a gain goes with what its neighbours say: the noise of the reading itself is in what it reads beyond
    beside = 0.5 * (
        window.z[np.maximum(rows - 1, 0), 1] + window.z[np.minimum(rows + 1, len(window.z) - 1), 1]
    )
    read = voltage - model["Rm"] * current - model["Km"] * speed
    std = np.hypot(noise, model["Km"] * np.sqrt(var))
    columns = read, std, window.t[rows], current, speed, model["Rm"] * beside + model["Km"] * speed
    there = np.isfinite(np.stack(columns)).all(axis=0)
    return Beyond(*(column[there] for column in columns))


def _fit(beyond: Beyond, columns: Sequence[Array]) -> Fit:
    """The law whose voltage goes with some columns (n,): by least absolute deviations first, as where the current is limited the
    speed of a changed motor is not what the others say, and least squares of what is near that."""
    A, y = np.column_stack(columns) / beyond.std[:, None], beyond.read / beyond.std
    n, k = A.shape
    if n < FEWEST:
        return Fit(0.0, math.inf, np.zeros(k), np.zeros(k))
    value = _solved(A, y)
    for _ in range(ROUNDS):
        value = _solved(*_weighted(A, y, 1.0 / np.sqrt(np.maximum(np.abs(y - A @ value), 1.0))))
    near = np.abs(y - A @ value) < FAR
    if near.sum() > k:
        value = _solved(A[near], y[near])
    squares = (y - A @ value) ** 2
    usual = float(np.median(squares)) / MEDIAN_SQUARE
    covariance = np.linalg.pinv(A[near].T @ A[near]) * max(1.0, usual)
    std = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    nats = 0.5 * float(np.minimum(squares, FAR**2).sum()) + 0.5 * k * math.log(n)
    return Fit(nats, usual, value, np.asarray(std, dtype=np.float64))


def _solved(A: Array, y: Array) -> Array:
    """Least squares."""
    return np.asarray(np.linalg.lstsq(A, y, rcond=None)[0], dtype=np.float64)


def _weighted(A: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Both sides of a fit with weights (n,)."""
    return A * weight[:, None], y * weight


def _dead_from(event: Event, bank: Bank) -> float | None:
    """When a motor that was told to move began to draw no current, for good [s]; None where it draws one, or its mass moves."""
    recent = bank.recent
    if recent is None or event.label not in (UNKNOWN, "sensor_fault"):
        return None
    of_it = (recent.t >= event.start_s) & (recent.t <= event.end_s) & (recent.w_cmd != 0.0)
    of_it &= np.isfinite(recent.z[:, 1])
    t, i = recent.t[of_it], recent.z[of_it, 1] / bank.rig.noise_std[1]
    first = _silent_from(i)
    if first is None or t[-1] - t[first] < DEAD_S:
        return None
    if _turns(recent.z[of_it, 0][first:], bank.rig.model["Km"] * recent.w_cmd[of_it][first:]):
        return None
    asked = bank.rig.model["D"] * float(np.trapezoid(recent.w_cmd[of_it][first:], t[first:]))
    return float(t[first]) if _moved(recent.z[of_it, 2][first:]) < NO_TRAVEL * abs(asked) else None


def _silent_from(i: Array) -> int | None:
    """The first of currents i (n,), in standard deviations, from which on there is none but for an offset and spikes."""
    level = float(np.median(i[-len(i) // 4 :])) if i.size >= FEWEST else math.inf
    if abs(level) > OFFSET:
        return None
    drawn = np.abs(i - level) > NO_CURRENT
    left = np.cumsum(drawn[::-1])[::-1]
    silent = np.flatnonzero(~drawn & (left <= (1.0 - MOSTLY) * np.arange(i.size, 0, -1)))
    return int(silent[0]) if silent.size else None


def _turns(voltage: Array, induced: Array) -> bool:
    """Whether a voltage (n,) is near what a motor induces at the speed that is asked of it: one without a load draws next to no
    current. So may it where no voltage is read."""
    off = np.abs(voltage - induced)
    return not np.isfinite(off).any() or bool(np.nanmedian(off) < HALF * np.median(np.abs(induced)))


def _moved(x: Array) -> float:
    """How far a mass moves from the first quarter of its positions x (n,) to the last one [m]; infinite where too few tell."""
    told = x[np.isfinite(x)]
    part = told.size // 4
    return math.inf if told.size < FEWEST else abs(float(np.median(told[-part:]) - np.median(told[:part])))


def _of_a_dead_motor(event: Event, since: float) -> Event:
    """The event as that of a motor that nothing drives from then on [s]."""
    onset = since if event.onset_s is None or event.onset_s > since else event.onset_s
    return event._replace(
        label=UNKNOWN, channel=None, probability=SURE, posterior=mostly(UNKNOWN, event),
        onset_s=onset, onset_interval_s=(max(event.start_s, onset - DEAD_S), since), alike=(), severity=(), reasons=(_SUPPLY,),
    )  # fmt: skip


def is_dead(event: Event) -> bool:
    """Whether a fault is that nothing drives the motor."""
    return any(DEAD in reason for reason in event.reasons)
