"""Whether the units of a log can be right for its rig: physics against the size of each channel.

A factor of a thousand is a wrong unit, not a fault; a note says so, because no filter says it as clearly.
Only too large values are judged: too small ones may come from a dead sensor or a lost coupling.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs.command_recovery import is_recovered
from observer_fi.logs.moves import quarter_of_a_ring
from observer_fi.numerics import digits, with_unit
from observer_fi.physics import Model
from observer_fi.records import Array, Log, Segment

FEWEST = 20  # samples at full speed that a mean needs
PREFIXES = {1e2: "centi", 1e3: "milli", 1e6: "micro"}
OPPOSITE = 0.4  # of what is expected, from which a channel goes the other way
HARD = 0.3  # of the most current that the supply drives: a start that takes less says nothing of the sign
LATE_S, RISEN = 0.1, 0.5  # of a command against its servo; of the largest current of a start
DRIVEN_BACK, TOUCHING = 0.2, 0.02  # of the largest voltage and current
# Of what a position covers; times the largest of its other steps; samples on either side that tell its motion, at least and at
# most.
JUMP, OUTSIZED, AROUND, FARTHEST = 0.8, 5.0, 20, 600
SEEN = 4.0  # times what noise moves a position, a motion
FAR = 3.0  # a ratio within this factor of a prefix is that prefix: effects and faults stay below


def suspect_units(log: Log, moves: tuple[Segment, ...], model: Model) -> tuple[str, ...]:
    """A note for every channel whose size a rig like `model` cannot produce; none is the usual answer."""
    of_loop = model["Kx"] > 0.0  # another command is made of the rig and the readings
    logged = not of_loop and not is_recovered(log)
    notes = [*_drive_notes(log, model, logged)] if model["Vmax"] > 0.0 and model["Km"] > 0.0 else []
    notes += [*_magnitude_notes(log.z[:, 0], log.z[:, 1]), *_wrap_notes(log.z[:, 2])]
    full = _at_full_speed(log, moves)
    if of_loop and model["Km"] > 0.0:  # while a mass is held, a position loop asks for more and more
        full &= np.abs(log.w_cmd) <= model["Vmax"] / model["Km"]
    if np.count_nonzero(full) >= FEWEST:
        w = float(np.abs(log.w_cmd[full]).mean())
        notes += _ratio_notes("voltage_v", np.abs(log.z[full, 0]), model["Km"] * w)
        notes += _ratio_notes("position_m", _steps(log, full), model["D"] * w / log.rate_hz)
        notes += _sign_notes(log, moves, full, model) if logged else []
    return tuple(notes)


def _magnitude_notes(volts: Array, amperes: Array) -> Iterator[str]:
    """A current that is never negative, though a negative voltage drives it: of a meter that has lost the sign."""
    both = np.isfinite(volts) & np.isfinite(amperes)
    v, i = volts[both], amperes[both]
    least = TOUCHING * _largest(i)
    back = v < -DRIVEN_BACK * _largest(v)
    if (
        np.count_nonzero(back) >= FEWEST
        and i.min() > -least
        and np.abs(i).min() < least < float(np.median(i[back]))
        and float(np.ptp(np.quantile(i[back], (0.1, 0.9)))) > least  # a frozen one is dead
    ):
        yield (
            "current_a is never negative though the voltage drives it backward: is it a magnitude? "
            "Log the current with its sign"
        )


def _wrap_notes(position: Array) -> Iterator[str]:
    """A position that starts anew: it jumps by all that it covers, against its motion before and after."""
    x = position[np.isfinite(position)]
    steps = np.diff(x)
    jumps = np.flatnonzero(np.abs(steps) > JUMP * float(np.ptp(x))) if x.size else np.zeros(0, dtype=np.int64)
    if not jumps.size or np.abs(steps[jumps]).max() < OUTSIZED * np.abs(np.delete(steps, jumps)).max(
        initial=0.0
    ):
        return  # a position in few steps
    jumping = np.where(np.isin(np.arange(steps.size), jumps), steps, 0.0)
    moving = steps - jumping
    wraps = [
        k
        for k in jumps[(jumps >= AROUND) & (jumps < steps.size - AROUND)].tolist()
        if abs(jumping[k - AROUND : k + AROUND].sum()) > 0.5 * abs(steps[k])  # a spike comes back
        and _goes_on(moving, k, -np.sign(steps[k]))
    ]
    if wraps:
        jump = with_unit(abs(float(steps[wraps[0]])), "m")
        yield (
            f"position_m jumps by {jump} against its motion: does it start anew each turn of its sensor? Log it without jumps"
        )


def _goes_on(moving: Array, k: int, way: float) -> bool:
    """Whether a position moves one way before and behind its k-th step, by more than its noise and about as fast."""
    before, behind = way * moving[max(k - FARTHEST, 0) : k], way * moving[k + 1 : k + 1 + FARTHEST]
    seen = all(side.sum() > SEEN * np.median(np.abs(side)) / 0.6745 for side in (before, behind))
    return seen and 0.5 < float(behind.mean() / before.mean()) < 2.0


def _sign_notes(log: Log, moves: tuple[Segment, ...], full: NDArray[np.bool_], model: Model) -> Iterator[str]:
    """Channels that go the other way than the command: voltage and position at full speed, current as a hard start begins."""
    w = float(np.abs(log.w_cmd[full]).mean())
    volts, step = model["Km"] * w, model["D"] * w / log.rate_hz
    resistance = model["Rm"] + model["Rs"]
    most = model["Vmax"] / resistance if resistance > 0.0 else np.inf
    way = np.sign(log.w_cmd)
    found = []
    if _mean(log.z[full, 0] * way[full]) < -OPPOSITE * volts:
        found.append("voltage_v")
    if _mean(_steps(log, full)) < -OPPOSITE * step:
        found.append("position_m")
    while_starting = quarter_of_a_ring(model)
    pushes = [i for move in moves for i in (_first_push(log, move, most, while_starting),) if np.isfinite(i)]
    if pushes and max(pushes) < -OPPOSITE:
        found.append("current_a")
    if len(found) == 3:
        yield "speed_cmd_rad_s goes the other way than voltage, current and position: is its sign inverted?"
    else:
        yield from (
            f"{column} goes the other way than the command: is its sign inverted?" for column in found
        )


def _first_push(log: Log, move: Segment, most: float, seconds: float) -> float:
    """Mean current along the command in the first seconds of a move from rest, over the largest there [1].

    A command that is logged late begins when the servo already brakes: the push is where the current rises, if that is before.
    NaN where nobody knows: of a log that begins within the start, where the servo may brake already, and of a soft start,
    whose current stays below a share of the most that the supply drives [A].
    """
    if move.start == 0:
        return np.nan
    length, late = round(seconds * log.rate_hz), round(LATE_S * log.rate_hz)
    i = log.z[:, 1] * np.sign(move.peak)
    first = max(move.start - late, 0)
    least = RISEN * _largest(i[first : move.start + length])
    begin = first + int(np.argmax(np.append(np.abs(i[first : move.start]) > least, True)))
    push = i[begin : begin + length]
    largest = _largest(push)
    return _mean(push) / largest if largest > HARD * most else np.nan


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan


def _drive_notes(log: Log, model: Model, logged: bool) -> Iterator[str]:
    """logged: whether the command is that of the log."""
    top = _often(log.w_cmd)
    if logged and top > FAR * model["Vmax"] / model["Km"]:
        yield f"speed_cmd_rad_s reaches {digits(top, 4)} rad/s, more than the supply can drive: is it in rpm?"
    most = 2.0 * model["Vmax"] / (model["Rm"] + model["Rs"])  # full reversal at full speed
    peak = _often(log.z[:, 1])
    if peak > 10.0 * FAR * most:
        yield f"current_a reaches {digits(peak, 4)} A, the supply drives at most {digits(most, 2)} A: is it in mA?"


def _often(values: Array) -> float:
    """The size that `FEWEST` readings reach, all of a short log: spikes are no unit."""
    sizes = np.sort(np.abs(values[np.isfinite(values)]))
    return float(sizes[-min(FEWEST, sizes.size)]) if sizes.size else 0.0


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))


def _at_full_speed(log: Log, moves: tuple[Segment, ...]) -> NDArray[np.bool_]:
    full = np.zeros(log.t.size, dtype=np.bool_)
    for move in moves:
        part = slice(move.start, move.stop)
        full[part] = np.abs(log.w_cmd[part]) > 0.99 * abs(move.peak)
    return full


def _steps(log: Log, full: NDArray[np.bool_]) -> Array:
    """Change of the position from a sample to the next, positive along the command, at full speed."""
    pairs = full[:-1] & full[1:]
    return (np.diff(log.z[:, 2]) * np.sign(log.w_cmd[:-1]))[pairs]


def _ratio_notes(column: str, seen: Array, expected: float) -> list[str]:
    known = seen[np.isfinite(seen)]
    ratio = float(known.mean()) / expected if known.size and expected > 0.0 else 0.0
    return [
        f"{column} is {digits(ratio)} times what the commanded speed gives: is its unit {prefix}...?"
        for factor, prefix in PREFIXES.items()
        if factor / FAR < ratio < factor * FAR
    ]
