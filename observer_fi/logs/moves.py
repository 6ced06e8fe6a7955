"""A log cut into moves: where each begins and ends, its phases, and what the moves excite together."""

from enum import IntEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import constant_runs, runs
from observer_fi.physics import Model
from observer_fi.records import Array, Log, Segment

QUIET_SPEED = 0.05  # rad/s: below this a command stands for rest
BLIP = 20.0  # times that: what is slower, and short, is no motion
QUIET_SHARE = 1e-3  # of the largest command; one sample of a ramp is a tenth of it
SHORTEST_S = 0.005  # a pause or a blip shorter than this is no rest and no move
STOPPING_S = 0.04  # s: in a shorter pause (a ringing of the loop) the motor still turns, as where a position loop overshoots
SETTLING_TIMES = 5.0  # time constants of the loop until a transient is over (0.7 % left)
_CHANGING = 0.1  # of the steepest, where the command is no trapezoid: below, it stands still but for the steps of an encoder
SATURATED = 0.99  # of the supply voltage

Signs = NDArray[np.int8]


class Phase(IntEnum):
    """What the actuator does at a sample."""

    REST = 0
    ACCELERATION = 1  # the command ramps, the supply still follows
    SATURATION = 2
    STABILISATION = 3  # until the loop has settled
    STEADY = 4
    STOP = 5  # from the begin of braking until the loop has settled


class Excitation(NamedTuple):
    """What a set of moves shows: |speeds| [rad/s] and mean pitches [deg] that occur, and for how long."""

    moves: int
    speeds: tuple[float, ...]
    directions: tuple[int, ...]
    pitches: tuple[float, ...]
    reversals: int
    seconds: dict[str, float]


def segments(t: Array, w_cmd: Array, pitch: Array | None = None) -> tuple[Segment, ...]:
    """The moves of a commanded speed, in order; they share no sample and cover the log, if any.

    t, w_cmd, pitch: (n,) s, rad/s, deg; pitch 0 if None. A rest between two moves is cut in its middle. A log
    may begin or end in a move. A change of sign without rest splits a move there.
    """
    ways = _one_way(t, w_cmd)
    between = [(stop + start) // 2 for (_, stop), (start, _) in pairwise(ways)]
    cuts = [0, *between, t.size]
    return tuple(
        Segment(cuts[k], start, stop, cuts[k + 1], _peak(w_cmd, start, stop), _mean_pitch(pitch, start, stop))
        for k, (start, stop) in enumerate(ways)
    )


def log_segments(log: Log) -> tuple[Segment, ...]:
    """The moves of a log."""
    return segments(log.t, log.w_cmd, log.pitch)


def moves_from_rest(log: Log) -> tuple[Segment, ...]:
    """The moves of a log as a simulation from rest takes them: a reversal goes on with the move before it.

    So does what follows a pause that is too short for a rest.

    A move starts at its last sample at rest, and the rests before and after it belong to it whole. Its peak is that of its
    last way.
    """
    ways = _one_way(log.t, log.w_cmd)
    after_rest = [k for k, (start, _) in enumerate(ways) if k == 0 or _rests(log.t, ways[k - 1][1], start)]
    last = [k - 1 for k in after_rest[1:]] + [len(ways) - 1]
    starts = [max(ways[k][0] - 1, 0) for k in after_rest]
    stops = [ways[k][1] for k in last] if ways else []
    rests, ends = [0, *stops[:-1]], [*starts[1:], log.t.size]
    return tuple(
        Segment(rest, start, stop, end, _peak(log.w_cmd, *ways[k]), _mean_pitch(log.pitch, start, stop))
        for rest, start, stop, end, k in zip(rests, starts, stops, ends, last, strict=False)
    )


def _rests(t: Array, stop: int, start: int) -> bool:
    """Whether the motor has come to rest between a command that ends at row `stop` and the next one."""
    return start > stop and float(t[start] - t[stop]) >= STOPPING_S


def _one_way(t: Array, w_cmd: Array) -> list[tuple[int, int]]:
    """(first row, row after the last) of every stretch in which the command goes one way."""
    signs = _signs(t, w_cmd)
    return [(a, b) for a, b in constant_runs(signs) if signs[a] != 0]


def _peak(w_cmd: Array, start: int, stop: int) -> float:
    """The fastest command of a stretch [rad/s], with its sign."""
    return float(w_cmd[start + int(np.argmax(np.abs(w_cmd[start:stop])))])


def _mean_pitch(pitch: Array | None, start: int, stop: int) -> float:
    return 0.0 if pitch is None else float(np.mean(pitch[start:stop]))


def quiet_speed(w_cmd: Array) -> float:
    """Up to which a command (n,) stands for rest [rad/s]."""
    return max(QUIET_SPEED, QUIET_SHARE * float(np.abs(w_cmd).max(initial=0.0)))


def turns_round(w_cmd: Array, of: Array) -> bool:
    """Whether a part (n,) of a command `of` (m,) goes both ways, faster than a blip of it [rad/s]."""
    least = BLIP * quiet_speed(of)
    return bool(w_cmd.max(initial=0.0) > least and w_cmd.min(initial=0.0) < -least)


def _signs(t: Array, w_cmd: Array) -> Signs:
    """(n,) direction of the command, 0 at rest; short pauses are filled and short blips removed."""
    speed, quiet = np.abs(w_cmd), quiet_speed(w_cmd)
    signs: Signs = np.where(speed > quiet, np.sign(w_cmd), 0.0).astype(np.int8)
    blip = BLIP * quiet
    for a, b in constant_runs(signs):
        if b == signs.size or a == 0 or t[b] - t[a] >= SHORTEST_S or signs[a - 1] != signs[b]:
            continue
        if signs[a] == 0 or speed[a:b].max() < blip:
            signs[a:b] = signs[b]
    return signs


def settling_time(model: Model) -> float:
    """Time after which a transient of the speed loop is over [s]: `SETTLING_TIMES` of 2 J / (Km Kp)."""
    return SETTLING_TIMES * 2.0 * model["J"] / (model["Km"] * model["Kp"])


def quarter_of_a_ring(model: Model) -> float:
    """In which a servo speeds up and does not brake yet [s]; 0 where nobody knows the servo."""
    stiffness = model["Km"] * model["Ki"]
    return 0.5 * np.pi * float(np.sqrt(model["J"] / stiffness)) if stiffness > 0.0 else 0.0


def saturated(z: Array, model: Model) -> NDArray[np.bool_]:
    """(n,) whether V + Rs i has reached the supply (equation 5); no where V or i is missing. z: (n, 3)."""
    with np.errstate(invalid="ignore"):
        return np.abs(z[:, 0] + model["Rs"] * z[:, 1]) > SATURATED * model["Vmax"]


def phases(segment: Segment, t: Array, w_cmd: Array, z: Array, model: Model) -> NDArray[np.int8]:
    """(end - rest,) the `Phase` of every sample of a segment. t, w_cmd (n,), z (n, 3): those of the log."""
    part = slice(segment.rest, segment.end)
    t, speed, full = t[part], np.abs(w_cmd[part]), saturated(z[part], model)
    start, stop = segment.start - segment.rest, segment.stop - segment.rest
    settle = settling_time(model)
    codes = np.full(t.size, Phase.REST, dtype=np.int8)
    brake = _brake(speed, start, stop)
    codes[start:brake] = Phase.STEADY
    for first, last in _ramps(t, speed, start, brake, model["accel_cmd"]):
        over = np.flatnonzero(full[first:brake] & (t[first:brake] < t[last] + settle))
        calm = max(last, first + int(over[-1]) if over.size else 0)
        codes[first:brake][t[first:brake] < t[calm] + settle] = Phase.STABILISATION
        codes[first : last + 1] = Phase.ACCELERATION
    codes[start:brake][full[start:brake]] = Phase.SATURATION
    if brake < stop or stop < t.size:
        release = t[stop] if stop < t.size else np.inf
        codes[brake:][t[brake:] < release + settle] = Phase.STOP
    return codes


def log_phases(log: Log, model: Model) -> NDArray[np.int8]:
    """(n,) the `Phase` of every sample of a log; a stop lasts until the loop has settled or the next move starts."""
    codes = np.full(log.t.size, Phase.REST, dtype=np.int8)
    moves = log_segments(log)
    ends = [*(move.start for move in moves[1:]), log.t.size]
    for move, end in zip(moves, ends, strict=False):
        whole = move._replace(rest=move.start, end=end)
        codes[whole.rest : whole.end] = phases(whole, log.t, log.w_cmd, log.z, model)
    return codes


def mean_square_by_phase(r: Array, codes: NDArray[np.int8]) -> dict[str, Array]:
    """Mean square (C,) of a residual r (n, C) in every phase that occurs, by name; codes: (n,) `Phase`."""
    return {p.name.lower(): np.mean(r[codes == p] ** 2, axis=0) for p in Phase if (codes == p).any()}


def _brake(speed: Array, start: int, stop: int) -> int:
    """First sample of the ramp that ends the move; `stop` where the log ends before it."""
    if stop == speed.size and (stop - start < 2 or speed[stop - 1] >= speed[stop - 2] * (1.0 - 1e-6)):
        return stop
    falling = np.diff(speed[start:stop]) < -1e-6 * speed[start:stop].max()
    level = np.flatnonzero(~falling)
    return start + (int(level[-1]) + 1 if level.size else 0)


def _ramps(t: Array, speed: Array, start: int, brake: int, accel: float) -> list[tuple[int, int]]:
    """(first, last) samples of every stretch in which the command changes before the brake."""
    if brake - start < 2:
        return [(start, start)] if brake > start else []
    slope = np.abs(np.diff(speed[start:brake]) / np.diff(t[start:brake]))
    changing = slope > (0.01 * accel or _CHANGING * slope.max())
    if start > 0:
        changing[0] = True  # the command left zero before its first sample
    return [(start + int(a), start + int(b)) for a, b in zip(*runs(changing), strict=True)]


def excitation(log: Log, moves: tuple[Segment, ...], model: Model) -> Excitation:
    """What the moves of a log show of the actuator: speeds to 1 %, pitches to 1 deg, seconds by phase."""
    seconds = dict.fromkeys((phase.name.lower() for phase in Phase), 0.0)
    step = 1.0 / log.rate_hz
    for move in moves:
        counts = np.bincount(phases(move, log.t, log.w_cmd, log.z, model), minlength=len(Phase))
        for phase in Phase:
            seconds[phase.name.lower()] += float(counts[phase]) * step
    turns = sum(
        1
        for a, b in zip(moves[:-1], moves[1:], strict=True)
        if a.peak * b.peak < 0.0 and b.start - a.stop <= 1
    )
    return Excitation(
        len(moves),
        _distinct([abs(move.peak) for move in moves], 0.01, 0.0),
        tuple(sorted({int(np.sign(move.peak)) for move in moves})),
        _distinct([move.pitch for move in moves], 0.0, 1.0),
        turns,
        seconds,
    )


def _distinct(values: list[float], relative: float, absolute: float) -> tuple[float, ...]:
    """Values that differ, in order; what lies within the tolerance of its predecessor counts as that."""
    found: list[float] = []
    for value in sorted(values):
        if not found or value - found[-1] > max(absolute, relative * abs(value)):
            found.append(value)
    return tuple(found)
