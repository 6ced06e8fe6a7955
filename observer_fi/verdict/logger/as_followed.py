"""Whether a servo followed the command that was logged beside it.

A command may be logged late, held, rounded, before the drive makes a ramp of it, or from a noisy line. The bank takes it for
what the servo was told, to the sample; then the servo itself says what it was told, as where no command was logged.
"""

from dataclasses import replace

import numpy as np

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs import is_recovered, recover_command
from observer_fi.numerics import filled, resolution_of
from observer_fi.physics import NOMINAL, NOT_TESTED, UNKNOWN, Rig
from observer_fi.records import Array, Log, Outcome
from observer_fi.verdict.logger.at_ticks import held_together
from observer_fi.verdict.moves.whole_move import SETTLED_S

AROUND_S = 0.02  # of a ramp: the servo's ringing, or a command that comes later
LEVEL_S = 0.2  # of the speed behind it
SAME_LEVEL = 0.025  # relative: what rounding does; a sensor or a rig file that is off shifts the speed itself
SHAPE = 0.0015  # of the level, mean over the ramp: several times what recovering a clean command leaves
STEADY = 1.02  # times a speed: what grows by less is at its level
NO_FAULT_OF_IT = ("sensor_fault", UNKNOWN, NOT_TESTED)  # of the actuator
EXPLAINED = 1.5  # times the expected NIS
START_S = 4.0  # of a log, in which its first start is over
LATE_S = 0.004  # by which readings may be later than the command
VOLTAGE_LATE_S = tuple(LATE_S * k / 8 for k in range(9))  # that are tried
# Times the noise of the voltage, that the speed of a step of the command makes; of a step, by which a multiple may be off; share
# of the samples that are multiples; levels; and share of the changes that are a step more or less than the one before: of a
# trapezoid those at its corners.
ROUNDED, OFF_STEP, MOSTLY, FEWEST_LEVELS, UNEVEN = 0.7, 0.02, 0.98, 8, 0.3
LONG = 5.0  # times AROUND_S: a way up of which late and held readings, or a delay of the servo, make no other ramp
# What is no reading's doing, as SHAPE. Seeds 99610000 to 99630005: loggers at most 0.0016, gains and windings that are
# off at most 0.0014, commands that were spoilt at least 0.005.
CLEARLY = 0.0045
RESTLESS = 2.0  # times what is off at speed, about its median: wandering readings are off by as much there
NOT_FOLLOWED = (
    "speed_cmd_rad_s is not what the servo of the rig file followed: it is late, held, rounded, or not yet the ramp that the "
    "drive made of it, or the servo has other gains; it was recovered from voltage and current instead, and the servo was not "
    "asked. Log the command that the servo follows, with the other columns"
)


def as_followed(log: Log, rig: Rig) -> Log | None:
    """`log` with `w_cmd` (n,) [rad/s] as its servo followed it, where its first start shows that this is not the logged one.

    Equation 3 tells it, as in `recover_command`, and so there is nothing left for it to check: the log is one for a rig without
    its servo. None where the drive has no servo, no command was logged, or none can be recovered.
    """
    told = _as_told(log, rig)
    if told is None or not _differs(log, told.w_cmd, 0.0, SHAPE):
        return None
    return replace(told, notes=(*log.notes, NOT_FOLLOWED))


def is_not_followed(log: Log, rig: Rig) -> bool:
    """Whether the first start of a log leaves no doubt that its servo followed another command than the logged one.

    What readings that are late or filtered make of a command is none, and held ones tell too little of its ramps.
    """
    moving = np.flatnonzero(np.nan_to_num(log.w_cmd))
    if not moving.size:
        return False
    begun = log.part(slice(0, int(moving[0]) + round(START_S * log.rate_hz)))
    if _is_rounded(log, rig) and _as_told(log, rig) is not None:
        return True
    if held_together(begun, rig):
        return False
    for late_s in VOLTAGE_LATE_S:
        told = _as_told(with_voltage_ahead(begun, late_s), rig)
        if told is None or not _differs(begun, told.w_cmd, LATE_S, CLEARLY, soft=True):
            return False
    return True


def _is_rounded(log: Log, rig: Rig) -> bool:
    """Whether the logged command comes in steps of which the voltage shows more than its noise, and that its servo did not take.

    A ramp that a drive makes rises by the same from sample to sample; rounded, it rises by one of two numbers of steps.
    """
    w = log.w_cmd[np.isfinite(log.w_cmd)]
    changes = np.diff(w)
    step = resolution_of(changes)
    if step is None or rig.model["Km"] * step <= ROUNDED * rig.file_noise_std[0]:
        return False
    levels = np.round(w / step)
    if np.mean(np.abs(w / step - levels) < OFF_STEP) < MOSTLY or np.unique(levels).size < FEWEST_LEVELS:
        return False
    by_one = np.count_nonzero(np.abs(np.diff(levels, 2)) == 1.0)
    return bool(by_one >= UNEVEN * np.count_nonzero(changes))


def with_voltage_ahead(log: Log, late_s: float) -> Log:
    """`log` with its voltage so much earlier: later than the current, it makes the servo's ring of a command."""
    there = np.isfinite(log.z[:, 0])
    if not late_s or not there.any():
        return log
    z = log.z.copy()
    z[there, 0] = np.interp(log.t[there] + late_s, log.t[there], log.z[there, 0])
    return replace(log, z=z)


def _as_told(log: Log, rig: Rig) -> Log | None:
    """`log` with the command that its servo shows."""
    logged = np.isfinite(log.w_cmd).any() and not is_recovered(log)
    if rig.driven.command is not None or not rig.watched.servo or not logged:
        return None
    try:
        return recover_command(replace(log, w_cmd=np.full(log.t.size, np.nan)), rig.model)
    except (InvalidLogError, UsageError):  # nothing tells it, or the rig file has no motor
        return None


def _differs(log: Log, w_cmd: Array, late_s: float, share: float, soft: bool = False) -> bool:
    """Whether the first start of the logged command has another shape than `w_cmd` (n,), on the way to the same speed.

    share: of that speed, mean over the way up, for the best of the times within `late_s` [s] by which one may be later; soft:
    only where that way is long, and what is off there is not so at speed.
    """
    way = np.abs(w_cmd)
    moving = np.flatnonzero(way > 0.0)
    if not moving.size or moving[0] == 0:
        return False
    around, level, late = (round(s * log.rate_hz) for s in (AROUND_S, LEVEL_S, late_s))
    first = int(moving[0])
    top = first + _brought_up(way[first:], level)
    speed, behind = float(way[top]), slice(top + around, top + around + level)
    there = np.isfinite(log.w_cmd[behind])
    if not there.any() or abs(np.median((log.w_cmd - w_cmd)[behind][there])) > SAME_LEVEL * speed:
        return False
    ramp = np.arange(max(first - around, late), min(top + around, log.t.size - late))
    told = (w_cmd, w_cmd + _of_the_winding(log, w_cmd, first, behind), w_cmd * _gain(log, w_cmd, behind))
    shifted = [log.w_cmd[ramp + shift] for shift in range(-late, late + 1)]
    least = min(float(np.nanmean(np.abs(logged - shown[ramp]))) for logged in shifted for shown in told)
    rough = float(np.median(np.abs(np.diff(w_cmd[first:top], 2)))) if top > first + 2 else 0.0
    if soft:
        apart = (log.w_cmd - w_cmd)[behind][there]
        wanders = float(np.mean(np.abs(apart - np.median(apart))))
        return top - first > LONG * around and least > max(share * speed, rough, RESTLESS * wanders)
    return least > max(share * speed, rough)


def _gain(log: Log, w_cmd: Array, behind: slice) -> float:
    """What a voltage that reads too much makes of a recovered command (n,) [rad/s], as at the speed behind the ramp."""
    there = w_cmd[behind] != 0.0
    return float(np.nanmedian(log.w_cmd[behind][there] / w_cmd[behind][there])) if there.any() else 1.0


def _of_the_winding(log: Log, w_cmd: Array, first: int, behind: slice) -> Array:
    """What a winding of another resistance makes of a recovered command (n,) [rad/s] that begins at sample `first`.

    In proportion to the current beyond that of the rest before (equation 2; the integral holds the latter), as much as that
    command is off the logged one at the speed behind the ramp.
    """
    i = np.nan_to_num(filled(log.z[:, 1]))
    i = i - float(np.median(i[:first]))
    at_speed = float(np.median(i[behind]))
    return float(np.nanmedian((log.w_cmd - w_cmd)[behind])) / at_speed * i if at_speed else np.zeros(i.size)


def _brought_up(way: Array, level: int) -> int:
    """The sample from which a speed (n,) that begins does not grow for `level` samples but for its noise."""
    padded = np.concatenate((way, np.full(level, 0.0)))
    highest = np.lib.stride_tricks.sliding_window_view(padded, level + 1)[: way.size].max(axis=1)
    return int(np.argmax(highest <= STEADY * way))


def may_not_be_followed(outcome: Outcome) -> bool:
    """Whether an odd log may have a command that was not followed: that shows from the first start on.

    What begins later in a move and explains the whole of it leaves nothing to a command.
    """
    found = outcome.isolation
    if found is None or not is_odd(outcome):
        return False
    said, fit = found.verdict, found.consistency
    later = said.onset_s is not None and said.onset_s > said.start_s + SETTLED_S
    return not (later and fit.nis_mean <= EXPLAINED * fit.nis_expected)


def is_odd(outcome: Outcome) -> bool:
    """Whether a log has no healthy first move, as far as that is explained, and no verdict on the actuator itself."""
    found = outcome.isolation
    first = found.events[0] if found is not None and found.events else None
    if found is None or (first is not None and first.label == NOMINAL and UNKNOWN not in first.alike):
        return False
    return found.verdict.label in NO_FAULT_OF_IT or bool(found.verdict.alike)


def better(one: Outcome, two: Outcome) -> Outcome:
    """`two`, the outcome with the command that was followed, where a hypothesis of the actuator explains that log, else `one`.

    A fault from the first motion on is none to go by: without its servo another machine looks like that.
    """
    found = two.isolation
    if found is None or found.verdict.label in NO_FAULT_OF_IT:
        return one
    said, fit = found.verdict, found.consistency
    from_the_first = said.onset_s is not None and said.onset_s <= said.start_s + AROUND_S
    return two if fit.nis_mean <= EXPLAINED * fit.nis_expected and not from_the_first else one
