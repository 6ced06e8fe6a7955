"""Whether a servo followed the command that was logged beside it.

A command may be logged late, held, rounded, before the drive makes a ramp of it, or from a noisy line. The bank takes it for
what the servo was told, to the sample; then the servo itself says what it was told, as where no command was logged.
"""

from dataclasses import replace

import numpy as np

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs import recover_command
from observer_fi.physics import NOMINAL, NOT_TESTED, UNKNOWN, Rig
from observer_fi.records import Array, Log, Outcome
from observer_fi.verdict.moves.whole_move import SETTLED_S

AROUND_S = 0.02  # of a ramp: the servo's ringing, or a command that comes later
LEVEL_S = 0.2  # of the speed behind it
SAME_LEVEL = 0.025  # relative: what rounding does; a sensor or a rig file that is off shifts the speed itself
SHAPE = 0.0015  # of the level, mean over the ramp: several times what recovering a clean command leaves
NO_FAULT_OF_IT = ("sensor_fault", UNKNOWN, NOT_TESTED)  # of the actuator
EXPLAINED = 1.5  # times the expected NIS
NOT_FOLLOWED = (
    "speed_cmd_rad_s is not what the servo followed: it is late, held, rounded, or not yet the ramp that the drive made of it; "
    "it was recovered from voltage and current instead. Log the command that the servo follows, with the other columns"
)


def as_followed(log: Log, rig: Rig) -> Log | None:
    """`log` with `w_cmd` (n,) [rad/s] as its servo followed it, where its first start shows that this is not the logged one.

    Equation 3 tells it, as in `recover_command`. None where the drive has no servo, no command was logged, or none can be
    recovered.
    """
    if rig.driven.command is not None or not rig.watched.servo or not np.isfinite(log.w_cmd).any():
        return None
    try:
        told = recover_command(replace(log, w_cmd=np.full(log.t.size, np.nan)), rig.model, any_shape=False)
    except (InvalidLogError, UsageError):  # nothing tells it, or the rig file has no motor
        return None
    if not _differs(log, told.w_cmd):
        return None
    return replace(told, notes=(*log.notes, NOT_FOLLOWED))


def _differs(log: Log, w_cmd: Array) -> bool:
    """Whether the first start of the logged command has another shape than `w_cmd` (n,), on the way to the same speed."""
    way = np.abs(w_cmd)
    moving = np.flatnonzero(way > 0.0)
    if not moving.size or moving[0] == 0:
        return False
    first = int(moving[0])
    top = first + int(np.argmax(np.diff(way[first:], append=-1.0) <= 0.0))
    around, level = round(AROUND_S * log.rate_hz), round(LEVEL_S * log.rate_hz)
    off = log.w_cmd - w_cmd
    behind, ramp = off[top + around : top + around + level], off[max(first - around, 0) : top + around]
    behind, ramp, speed = behind[np.isfinite(behind)], ramp[np.isfinite(ramp)], float(way[top])
    if not behind.size or not ramp.size or abs(np.median(behind)) > SAME_LEVEL * speed:
        return False
    return float(np.mean(np.abs(ramp))) > SHAPE * speed


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
    """`two`, the outcome with the command that was followed, where a hypothesis of the actuator explains that log, else `one`."""
    found = two.isolation
    if found is None or found.verdict.label in NO_FAULT_OF_IT:
        return one
    fits = found.consistency.nis_mean <= EXPLAINED * found.consistency.nis_expected
    return replace(two, warnings=(NOT_FOLLOWED, *two.warnings)) if fits else one
