"""The commanded speed of a log that does not hold it, from voltage and current.

Equation 3 without saturation, i = Kp e + Ki int e with e = w_cmd - w, is a high-pass filter from i to e with
the time constant Kp / Ki (2.4 ms for the paper's rig). So w + e is the command, except in saturation and a
few time constants after it. The trapezoid through it has levels, where w + e stands still, and ramps of known
acceleration between them.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.command_shape import Level, Shown, as_shown
from observer_fi.logs.logger.acquisition import OFF_ZERO
from observer_fi.logs.moves import saturated
from observer_fi.logs.position_speed import LONGEST_S, PositionSpeed, position_speed
from observer_fi.numerics import between_near, constant_runs, correlation_time, filled, resolution_of
from observer_fi.physics import UNLEARNED, Model, Rig, commanded, override, speed
from observer_fi.records import Array, Log

BLOCK_S = 0.005
FEWEST_IN_BLOCK = 4
RECOVERY_TIMES = 5.0  # of Kp / Ki after saturation, until the filter has forgotten the wound-up integral
SAME_LEVEL = 0.05  # relative: a wrong Rm shifts w by this much while the current rings
STANDS = 0.5  # share of readings that repeat the one before, from which their noise does not take them over their steps
NOISE_FLOOR = 0.2  # rad/s: commands are not finer than this
SIGMAS = 6.0
BEGIN_S = 0.2
LONG_HOLE = 4  # samples
# Of the readings of voltage or current, that have the other in their row; times as far apart as usual, between which none is.
TOGETHER, LONGER_APART = 0.5, 3.0
RINGING_S = 0.04  # a level shorter than a period of the loop (45 ms) may be a crest of its ringing,
TURNS = (0.3, 3.0)  # of the way that a speed takes a mass: what moved less or more did not turn with it
STEEP = 5e4  # rad/s^2, of ramps where nobody knows the commanded acceleration
RINGING_SHARE = 0.1  # if it is this near to the level beside it, as a share of the largest

DRIVEN, HELD = 0.4, 3.0  # of the current in motion, and times that at rest: what moves a motor
SHORT = 5  # samples: a current that is less for a shorter time is noise
# Of the speed that a mass lost: where the current can have taken less than this of it, the motor did not stop with the mass.
EXPLAINED = 0.4
SLOWS = 0.9  # of the speed before: a motor below that is being stopped
# Times the current of the motion, more than friction takes, and by when after the stand it is that much.
STALLED, SOON_S = 1.5, 0.1
AFTER_S = 0.2  # of the stand of a mass that the motor has left: what the current is then
ABSENT = "speed_cmd_rad_s is absent"  # how the note begins that says so
SHOWN = "the command has other ramps than the rig file says: it is taken from each sample as voltage and current show it"

Mask = NDArray[np.bool_]


def with_command(log: Log, rig: Rig) -> Log:
    """`log` with its command: as the law of the drive makes it, as logged, or recovered where no sample of it is a number."""
    if rig.law is not None:
        notes = tuple(note for note in log.notes if not note.startswith(ABSENT))
        return replace(commanded(log, rig), notes=notes)
    foreign = rig.driven.command is not None  # a loop by another law than the drive's
    if np.isfinite(log.w_cmd).any() and (is_recovered(log) or not foreign):
        return log
    recovered = recover_command(log, override(rig.model, "motor", Kp=0.0) if foreign else rig.model)
    friction = rig.quantities.get("A")
    known = friction is not None and friction.method not in UNLEARNED
    return _on_while_in_vain(recovered, rig.model) if known and _only_position(log) else recovered


def is_recovered(log: Log) -> bool:
    """Whether the command of a log is none that was logged."""
    return any(note.startswith(ABSENT) for note in log.notes)


def recover_command(log: Log, model: Model) -> Log:
    """`log` with `w_cmd` recovered, and a note that says so; a second one where it has other ramps than those of the model.

    Moves that hold their speed for less than two blocks of 5 ms are not seen. Raises InvalidLogError where
    neither voltage nor encoder tell the speed, UsageError where the model has no motor. Without a servo in the model
    the speed itself, where it settles, stands for the command.
    """
    if not model["Km"] > 0.0:
        raise UsageError(
            f"{log.path}: column speed_cmd_rad_s is missing and cannot be recovered without Km in the rig; "
            "log it, or give the rig of a motor with --rig"
        )
    has_loop = model["Kp"] > 0.0 and model["Ki"] > 0.0
    if not has_loop and _only_position(log):
        return _with_speed(log, position_speed(log.t, log.z[:, 2], model["D"]), model)
    given, log = log, _together(log)
    command, known = loop_command(log, model) if has_loop else motor_speed(log, model)
    rounding = _rounding(log, model)
    noise = _noise(log.t, command[known], rounding)
    levels = _levels(log.t, command, known, noise)
    if not levels:
        raise InvalidLogError(
            f"{log.path}: column speed_cmd_rad_s is missing and voltage and current never settle "
            "to a speed; log it"
        )
    off_zero = max(OFF_ZERO * noise, math.sqrt(3.0) * rounding)
    levels = _with_rests(levels, command, known, log, model, noise, off_zero)
    full = saturated(log.z, model)
    w_cmd = _trapezoid(log.t, command, known, full, levels, noise, model["accel_cmd"] or STEEP)
    if not has_loop:
        w_cmd = _on_while_stalled(log, w_cmd)
    else:
        rough = max(_roughness(command[known]), rounding, NOISE_FLOOR)
        shown = as_shown(log, Shown(command, known, rough, full), w_cmd, levels, model)
        log, w_cmd = (log, w_cmd) if shown is None else (replace(log, notes=(*log.notes, SHOWN)), shown)
    moves = sum(1 for a, b in zip(levels[:-1], levels[1:], strict=True) if a.speed == 0.0 != b.speed)
    return replace(_recovered(log, w_cmd, "voltage and current", moves), z=given.z)


def _together(log: Log) -> Log:
    """The log with voltage and current between their readings where these hardly share a row: a bus writes a row a message."""
    read = np.isfinite(log.z[:, :2])
    if (
        not read.any(axis=0).all()
        or np.count_nonzero(read.all(axis=1)) > TOGETHER * np.count_nonzero(read, axis=0).min()
    ):
        return log
    z = log.z.copy()
    for c in range(2):
        near = between_near(log.t, read[:, c], LONGER_APART)
        z[:, c] = np.where(read[:, c] | near, filled(z[:, c], log.t), np.nan)
    return replace(log, z=z)


def _on_while_stalled(log: Log, w_cmd: Array) -> Array:
    """`w_cmd`, which goes on where a motor stands that is driven harder than it was in motion: that is a stall, and no rest.

    The ring after a stop is over sooner. What the current did not drive, a ring or what a failed sensor shows, is no motion
    that could stall.
    """
    i, w_cmd = np.nan_to_num(filled(log.z[:, 1])), w_cmd.copy()
    before = 0
    for a, b in constant_runs(np.sign(w_cmd).astype(np.int8)):
        if w_cmd[a] != 0.0:
            before = a
        elif a > 0:
            way = float(np.sign(w_cmd[a - 1]))
            usual = float(np.median(way * i[(before + a) // 2 : a]))
            harder = (way * i[a:b] > STALLED * usual) & (usual > 0.0)
            first = int(np.argmax(harder))
            over = np.flatnonzero(~harder[first:])
            until = first + int(over[0]) if over.size else b - a
            if first <= SOON_S * log.rate_hz and until - first > 2.0 * RINGING_S * log.rate_hz:
                w_cmd[a : a + until] = w_cmd[a - 1]
    return w_cmd


def _recovered(log: Log, w_cmd: Array, source: str, moves: int) -> Log:
    """`log` with its command and the note that says where it is from."""
    notes = tuple(old for old in log.notes if not old.startswith(ABSENT))
    return replace(log, w_cmd=w_cmd, notes=(*notes, f"{ABSENT}: recovered from {source}, {moves} starts"))


def _only_position(log: Log) -> bool:
    """Whether neither voltage nor encoder tell how fast the motor turns."""
    seen = [bool(np.isfinite(channel).any()) for channel in log.z.T]
    return log.encoder is None and not seen[0] and seen[2]


def _with_speed(log: Log, speed_of_mass: PositionSpeed, model: Model) -> Log:
    """`log` with the speed of the mass for its command, and 0 where that is within its noise.

    A servo that nobody knows needs no more of a command than where it moves, and how fast. Where the mass stands and the
    current goes on, or never braked the motor, that is still told to move.
    """
    w, turns = speed_of_mass.w, speed_of_mass.moves
    w_cmd = np.where(turns, w, 0.0)
    stood = began = 0
    for a, b in constant_runs(turns.astype(np.int8)):
        if turns[a]:
            began = a
        if a > 0 and turns[a]:
            w_cmd[_begun(log, stood, a) : a] = w_cmd[a]
        elif a > 0:
            last = float(np.median(w_cmd[max(began, 2 * a - b) : a]))
            left = _left_behind(log, w, a, b, model)
            stood = _driven_until(log, turns, slice(began, a), b, last, left)
            w_cmd[a:stood] = last
    starts = int(np.count_nonzero(np.diff((w_cmd != 0.0).astype(np.int8)) > 0))
    return _recovered(log, w_cmd, "the position", starts)


def _on_while_in_vain(log: Log, model: Model) -> Log:
    """`log`, whose command goes on where a mass stands although the current would have moved it in equation 1.

    A current after which the mass does move belongs to that start.
    """
    drive, w_cmd = model["Km"] * np.nan_to_num(filled(log.z[:, 1])), log.w_cmd.copy()
    torque = drive - model["B"] * log.pitch - model["torque_offset"]
    turns, step = w_cmd != 0.0, float(np.median(np.diff(log.t)))
    if not turns.any() or turns.all():
        return log
    usual = float(np.median(np.abs(w_cmd[turns])))
    noise = float(np.nanstd(np.diff(log.z[:, 2])[~turns[1:]]))
    pulls = np.where(turns, 0, np.sign(torque) * (np.abs(torque) > STALLED * model["A"]))
    for a, b in constant_runs(pulls.astype(np.int8)):
        gained = np.cumsum(np.abs(torque[a:b]) - model["A"]) * step / model["J"]
        seen = model["D"] * float(gained.sum()) * step > SIGMAS * noise and gained[-1] > SAME_LEVEL * usual
        if pulls[a] and seen and not turns[b : b + round(SOON_S * log.rate_hz)].any():
            w_cmd[a:b] = pulls[a] * usual
    return replace(log, w_cmd=w_cmd)


def _begun(log: Log, stood: int, a: int) -> int:
    """The row at which the current leaves what it was in the rest since row `stood`, before the mass is seen to move at row a."""
    i = filled(log.z[:, 1])
    first = max(a - 2 * round(LONGEST_S * log.rate_hz), stood)
    quiet = i[stood:first]
    if quiet.size < 2 * SHORT:
        return first
    off = np.abs(quiet - np.median(quiet))
    usual = 1.4826 * float(np.median(off)) or float(np.min(off[off > 0.0], initial=np.inf))
    left = np.flatnonzero(np.abs(i[first:a] - np.median(quiet)) > SIGMAS * usual)
    return first + int(left[0]) if left.size else a


def _left_behind(log: Log, w: Array, a: int, b: int, model: Model) -> bool | None:
    """Whether the mass, which stands in rows a to b, stopped without its motor: what the current and friction took of its speed
    (equation 1) is far less than it lost, or would have let it go much farther than it did. None where too few samples tell.
    """
    reach = round(LONGEST_S * log.rate_hz)
    first, last = max(a - reach, 0), min(a + reach, b)
    moving = np.abs(w[first:a]) > 0.5 * np.abs(w[first])
    at = first + int(np.flatnonzero(moving)[-1]) if moving.any() else first  # from here on it slows
    first, last = max(at - reach // 4, 0), min(at + reach // 2, last)
    way, t = np.sign(w[first]), log.t[first:last]
    pull = model["Km"] * filled(log.z[:, 1])[first:last] * way - model["A"]
    if t.size < FEWEST_IN_BLOCK or not np.isfinite(pull).all():
        return None
    taken = -float(np.trapezoid(pull, t)) / model["J"]
    return taken < EXPLAINED * abs(w[first]) or _stops_short(log, w, a, b, model)


def _stops_short(log: Log, w: Array, a: int, b: int, model: Model) -> bool:
    """Whether a mass that stands in rows a to b went a much shorter way than a motor that its current slows (equation 1).

    The way counts from where the motor slows. How hard the mass went before that says the friction, whatever the rig file does.
    """
    reach = round(LONGEST_S * log.rate_hz)
    begin, middle, last = max(a - 2 * reach, 0), max(a - reach, 0), min(a + reach, b)
    way = np.sign(w[middle])
    t, pull = log.t[begin:last], model["Km"] * way * filled(log.z[:, 1])[begin:last]
    x, n = way * filled(log.z[:, 2])[begin:last], middle - begin
    if n < FEWEST_IN_BLOCK or not (np.isfinite(pull).all() and np.isfinite(x).all()):
        return False
    faster = float(np.polyfit(t[:n], way * w[begin:middle], 1)[0])
    friction = float(pull[:n].mean()) - model["J"] * faster
    taken = np.cumsum(pull[n:] - friction) * float(np.median(np.diff(t))) / model["J"]
    motor = np.maximum(abs(w[middle]) + np.minimum.accumulate(taken), 0.0)
    slows = min(int(np.argmax(motor < SLOWS * motor[0])) or a - middle, a - middle)
    expected = model["D"] * float(np.trapezoid(motor[slows:], t[n + slows :]))
    noise = float(np.std(np.diff(x[a - begin :]))) if last - a > FEWEST_IN_BLOCK else np.inf
    return x[-1] - x[n + slows] < EXPLAINED * expected - SIGMAS * noise


def _driven_until(log: Log, turns: Mask, move: slice, b: int, way: float, left: bool | None) -> int:
    """The row until which the current drives on, `way` as before, a mass that stands from the end of a move to row b.

    A stop takes the current away, or turns it round, before the mass stands; so does a rest that shows as much of it. A motor
    that has left its mass (`left`) needs less current than before; one that its current has stopped is held by what its servo
    has summed up, which is less than what moved it.
    """
    a = move.stop
    i = np.nan_to_num(filled(log.z[:, 1])) * np.sign(way)
    before = i[: int(np.argmax(turns))]
    usual = float(np.median(np.abs(i[turns])))
    enough = max(DRIVEN * usual, HELD * float(np.median(np.abs(before))) if before.size else np.inf)
    if left:
        enough = min(enough, DRIVEN * float(np.median(i[a : a + round(AFTER_S * log.rate_hz)])))
    elif left is not None:
        enough = max(enough, float(np.median(i[move])))
    begin = max(a - round(LONGEST_S * log.rate_hz), 0)
    more, around = i[begin:b] > enough, np.ones(SHORT)  # at the ends there are fewer
    pulls = np.convolve(more, around, "same") > 0.5 * np.convolve(np.ones(more.size), around, "same")
    ends = np.flatnonzero(~pulls[: b - begin - SHORT])
    return max(a, begin + int(ends[0])) if ends.size else b


def loop_command(log: Log, model: Model) -> tuple[Array, Mask]:
    """(n,) w + e [rad/s], the command as the servo's current shows it, and where it can be believed."""
    i = log.z[:, 1]
    w, seen = motor_speed(log, model)
    step = float(np.median(np.diff(log.t)))
    tau = model["Kp"] / model["Ki"]
    i = np.interp(log.t, log.t[seen], i[seen])
    e = _high_passed(i, step, tau) / model["Kp"]
    blind = saturated(log.z, model) | _long(~seen)
    wait = int(np.ceil(RECOVERY_TIMES * tau / step))
    index = np.arange(log.t.size)
    last_blind = np.maximum.accumulate(np.where(blind, index, -wait - 1))
    return w + e, seen & (index - last_blind > wait)


def motor_speed(log: Log, model: Model) -> tuple[Array, Mask]:
    """(n,) speed of the motor [rad/s], 0 where it is not known, and where it is. Raises InvalidLogError."""
    w = _speed(log, model)
    seen = np.isfinite(log.z[:, 1]) & np.isfinite(w)
    if np.count_nonzero(seen) < 2:
        raise InvalidLogError(
            f"{log.path}: column speed_cmd_rad_s is missing; without it voltage_v (or encoder_rad) and "
            "current_a are needed; log one of them"
        )
    return np.where(seen, w, 0.0), seen


def _long(missing: Mask) -> Mask:
    """Holes of `LONG_HOLE` samples and more, which interpolation of the current cannot bridge."""
    full = np.convolve(missing, np.ones(LONG_HOLE), mode="full")[LONG_HOLE - 1 :] >= LONG_HOLE
    return np.convolve(full, np.ones(LONG_HOLE), mode="full")[: missing.size] > 0.0


def _speed(log: Log, model: Model) -> Array:
    """Motor speed: equation 16, or the rate of the encoder where there is no voltage."""
    w = speed(log.z, model.vector)
    if np.isfinite(w).any() or log.encoder is None:
        return w
    return np.gradient(log.encoder, log.t)


def _high_passed(i: Array, step: float, tau: float) -> Array:
    """s / (s + 1 / tau) applied to i, taken as linear between samples."""
    decay = np.exp(-step / tau)
    taps = int(np.ceil(20.0 * tau / step)) + 1
    kernel = (1.0 - decay) * tau / step * decay ** np.arange(taps)
    return np.convolve(np.diff(i, prepend=i[0]), kernel)[: i.size]


def _noise(t: Array, command: Array, rounding: float) -> float:
    """Standard deviation of one sample [rad/s], from differences and within blocks, most of which are no ramps.

    Held readings hardly differ from the ones before them, nor do those with hum; those in coarse steps by a step at once.
    rounding: what these leave [rad/s].
    """
    least = max(NOISE_FLOOR, rounding)
    if command.size < 2:
        return least
    apart = 1.05 * float(np.median(np.abs(np.diff(command))))
    size = _block_size(t)
    blocks = command[: command.size // size * size].reshape(-1, size)
    within = float(np.median(blocks.std(axis=1))) if len(blocks) else 0.0
    return max(least, apart, within)


def _roughness(values: Array) -> float:
    """Standard deviation of one sample by what no slope leaves of them: second differences."""
    bends = np.abs(np.diff(values, 2))
    return float(np.median(bends)) / (0.6745 * math.sqrt(6.0)) if bends.size else 0.0


def _rounding(log: Log, model: Model) -> float:
    """Standard deviation of the speed [rad/s] by the steps of voltage and current whose readings mostly repeat the one before."""
    steps = []
    for z in log.z[:, :2].T:
        changes = np.diff(z[np.isfinite(z)])
        stands = changes.size > 0 and float(np.mean(changes == 0.0)) > STANDS
        steps.append((resolution_of(changes) or 0.0) if stands else 0.0)
    return math.hypot(steps[0], model["Rm"] * steps[1]) / (math.sqrt(12.0) * model["Km"])


def _block_size(t: Array) -> int:
    """Samples of a block."""
    return max(FEWEST_IN_BLOCK, round(BLOCK_S / float(np.median(np.diff(t)))))


def _levels(t: Array, command: Array, known: Mask, noise: float) -> list[Level]:
    """Stretches where the command stands still, neighbours of the same speed joined."""
    size = _block_size(t)
    blocks = t.size // size
    values = np.where(known, command, np.nan)[: blocks * size].reshape(blocks, size)
    whole = np.isfinite(values).sum(axis=1) > size // 2
    middle = np.full(blocks, np.nan)
    middle[whole] = np.nanmedian(values[whole], axis=1)
    flat = np.flatnonzero(whole)[
        (np.nanmax(values[whole], axis=1) - np.nanmin(values[whole], axis=1)) < SIGMAS * noise
    ]
    found: list[list[int]] = []
    for b in flat:
        if (
            found
            and b == found[-1][-1] + 1
            and _same(middle[b], float(np.median(middle[found[-1][-20:]])), noise)
        ):
            found[-1].append(int(b))
        else:
            found.append([int(b)])
    stretches = [run for run in found if len(run) > 1]
    return _joined(
        [Level(s[0] * size, (s[-1] + 1) * size - 1, 0.0, 0.0) for s in stretches], command, known, t, noise
    )


def _same(a: float, b: float, noise: float) -> bool:
    return abs(a - b) < max(SIGMAS * noise, SAME_LEVEL * max(abs(a), abs(b)))


def _joined(stretches: list[Level], command: Array, known: Mask, t: Array, noise: float) -> list[Level]:
    """Neighbours of the same speed as one, at the median of their samples; crests of ringing are dropped."""
    stretches = [_measured([s], command, known) for s in stretches]
    top = max((abs(s.seen) for s in stretches), default=0.0)
    groups: list[list[Level]] = []
    for k, stretch in enumerate(stretches):
        short = t[stretch.last] - t[stretch.first] < RINGING_S
        beside = [stretches[n].seen for n in (k - 1, k + 1) if 0 <= n < len(stretches)]
        if short and any(abs(stretch.seen - seen) < RINGING_SHARE * top for seen in beside):
            continue
        longest = max(groups[-1], key=lambda s: s.last - s.first) if groups else stretch
        if groups and _same(stretch.seen, longest.seen, noise):
            groups[-1].append(stretch)
        else:
            groups.append([stretch])
    return [_measured(group, command, known) for group in groups]


def _measured(group: list[Level], command: Array, known: Mask) -> Level:
    samples = np.concatenate([command[s.first : s.last + 1][known[s.first : s.last + 1]] for s in group])
    seen = float(np.median(samples))
    return Level(group[0].first, group[-1].last, seen, seen)


def _with_rests(
    levels: list[Level], command: Array, known: Mask, log: Log, model: Model, noise: float, off_zero: float
) -> list[Level]:
    """The levels with their speeds: 0 where the mass stands still, elsewhere less a bias seen at rest, if that is beyond
    `off_zero` [rad/s], which noise or rounding may leave.
    """
    top = max(abs(level.seen) for level in levels)
    rests = [_is_rest(level, top, log, model, noise) for level in levels]
    found = []
    for k, level in enumerate(levels):
        before = levels[k - 1].seen if k > 0 and rests[k - 1] else 0.0
        after = levels[k + 1].seen if k + 1 < len(levels) and rests[k + 1] else before
        seen = level.seen
        if abs(after - before) > 3.0 * noise:  # a sensor changed on the way: believe the begin of the level
            begin = log.t[level.first : level.last + 1] < log.t[level.first] + BEGIN_S
            part = command[level.first : level.last + 1][begin & known[level.first : level.last + 1]]
            seen = float(np.median(part)) if part.size else seen
        bias = before if abs(before) > off_zero else 0.0
        found.append(level._replace(speed=0.0 if rests[k] else seen - bias))
    return found


def _is_rest(level: Level, top: float, log: Log, model: Model, noise: float) -> bool:
    """A speed within the noise; one that a biased sensor shows while the position is constant, a low one or any without current.

    No motor turns without some: a current sensor that died leaves the voltage that holds a motor at rest.
    """
    if abs(level.seen) < 3.0 * noise:
        return True
    quarter = max((level.last - level.first) // 4, 1)
    x = log.z[level.first : level.last + 1, 2]
    head, tail = x[:quarter][np.isfinite(x[:quarter])], x[-quarter:][np.isfinite(x[-quarter:])]
    low = abs(level.seen) <= RINGING_SHARE * top or _draws_nothing(log.z[:, 1], level)
    if not low or not head.size or not tail.size:
        return False
    seconds = 0.75 * float(log.t[level.last] - log.t[level.first])
    error = _error_of_difference(x[np.isfinite(x)], head.size, tail.size)
    along, expected = (
        float(tail.mean() - head.mean()) * np.sign(level.seen),
        model["D"] * abs(level.seen) * seconds,
    )
    return not TURNS[0] * expected + 3.0 * error < along < TURNS[1] * expected


def _error_of_difference(y: Array, first: int, last: int) -> float:
    """Standard error of a difference of means over `first` and `last` readings of y (n,), about a line.

    Readings that are held, or whose noise wanders, tell less than as many that stand alone.
    """
    at = np.linspace(-1.0, 1.0, y.size)
    off = y - y.mean() - at * float(at @ y) / float(at @ at)
    alike = max(correlation_time(off, y.size // 4), 1.0) if y.size >= 2 * FEWEST_IN_BLOCK else 1.0
    return math.sqrt(off.var() * alike * (1.0 / first + 1.0 / last))


def _draws_nothing(current: Array, level: Level) -> bool:
    """Whether a current (n,), which the log does show elsewhere, is within its noise over a level."""
    i = current[level.first : level.last + 1]
    i = i[np.isfinite(i)]
    noise = 1.4826 * float(np.nanmedian(np.abs(np.diff(current)))) if i.size else 0.0
    largest = float(np.nanmax(np.abs(current))) if i.size else 0.0
    return i.size >= FEWEST_IN_BLOCK and abs(float(np.median(i))) < SIGMAS * noise < RINGING_SHARE * largest


def _trapezoid(
    t: Array, command: Array, known: Mask, full: Mask, levels: list[Level], noise: float, accel: float
) -> Array:
    """(n,) the piecewise linear command through the levels, with ramps of `accel` between them."""
    knots, speeds = [float(t[0])], [levels[0].speed]
    for a, b in zip(levels[:-1], levels[1:], strict=True):
        ramp = abs(b.speed - a.speed) / accel
        begin = max(_onset(t, command, known, full, a, b, noise, accel), knots[-1])
        knots += [begin, begin + ramp]
        speeds += [a.speed, b.speed]
    return np.interp(t, knots, speeds)


def _onset(
    t: Array, command: Array, known: Mask, full: Mask, a: Level, b: Level, noise: float, accel: float
) -> float:
    """Time at which the ramp from level a to level b begins, from the samples on the ramp [s].

    A start has begun by the time its voltage is at the limit (`full`): what is known behind that is the ring, and no ramp.
    """
    before = np.flatnonzero(~full[a.first : a.last + 1])
    window = slice(a.first + int(before[-1]) if before.size else a.last, max(b.first, a.last + 1) + 1)
    t, known, full = t[window], known[window], full[window]
    rise = abs(b.seen - a.seen)
    ramp = rise / accel
    share = (command[window] - a.seen) * np.sign(b.seen - a.seen)
    left = known & (share > SIGMAS * noise)
    on_ramp = left & (share < rise - SIGMAS * noise)
    stops = abs(b.speed) < abs(a.speed)
    limit = t.size if stops or not full.any() else int(np.argmax(full))
    on_ramp &= t < t[np.argmax(left)] + ramp  # what is on the way later is the ring
    if on_ramp[:limit].any():
        return float(np.median(t[on_ramp] - share[on_ramp] / accel))
    there = min(int(np.argmax(left)) if left.any() else t.size - 1, limit)
    at_level = np.flatnonzero(known[:there])
    last = float(t[at_level[-1]]) if at_level.size else float(t[0])
    if stops:  # after a stall the supply is freed by the brake, so that is late in the hole
        return max(last, float(t[there]) - ramp)
    return 0.5 * (last + min(float(t[there]), last + float(t[1] - t[0])))
