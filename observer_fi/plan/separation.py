"""What to record next about the findings of `improve`: the move that tells a cause from its rivals, with the odds it is worth.

Every pitch of the logs is looked at by itself, the level first, until a move decides or the time is over: a fraction of what
`plan` does for the same question, and no log is simulated with noise.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer_fi.errors import UsageError
from observer_fi.improve import FoundCause, Improvement
from observer_fi.numerics import digits
from observer_fi.physics import CAUSES, MOVES, Rig
from observer_fi.plan.limits import Limits, limits_of
from observer_fi.plan.moves import total_seconds
from observer_fi.plan.planning import DECISIVE, SURE, Profile, expected_profile
from observer_fi.plan.rivals import Asked, aliases
from observer_fi.plan.written import steps
from observer_fi.records import Log

MOST_S = 8.0  # of the processor, for all findings of a record
LONGEST_S = 10.0  # of a log that is asked for
MOST_ODDS = 1e6  # that are written out
ROUND_DEG = 0.5  # pitches that are closer are one level


class _TimeIsUpError(Exception):
    """The next stage of a plan would begin too late."""


class _Deadline:
    """Ends a plan between two of its stages."""

    def __init__(self, seconds: float) -> None:
        self.until = time.process_time() + seconds

    def __call__(self, stage: str) -> None:
        if time.process_time() > self.until:
            raise _TimeIsUpError(stage)


def with_moves(record: Improvement, logs: Sequence[Log], most_s: float = MOST_S) -> Improvement:
    """The record with the moves that separate findings from their rivals; a finding that time leaves none for is as it was.

    most_s: seconds of the processor for all of them.
    """
    rivalled = [f for f in record.findings if f.indistinguishable_from]
    if not rivalled:
        return record
    until = _Deadline(most_s)
    told = {f.cause: separated(f, record, logs, until) for f in rivalled}
    return replace(
        record,
        findings=tuple(replace(f, separate_by=told.get(f.cause, f.separate_by)) for f in record.findings),
    )


def separated(finding: FoundCause, record: Improvement, logs: Sequence[Log], until: _Deadline) -> str:
    """What tells a finding from its rivals, in words: of those that no move can, and the move for the others."""
    cause = finding.cause
    same = [name for name in finding.indistinguishable_from if aliases([cause, name])]
    others = [name for name in finding.indistinguishable_from if name not in same]
    texts = [_never(cause, same)] if same else []
    if others:
        sizes = {name: v.value for name, v in finding.parameters.items()}
        asked: list[Asked] = [(cause, sizes), *((name, {}) for name in others)]
        texts.append(_move(asked, record, logs, until) or finding.separate_by)
    return "; ".join(texts)


def _never(cause: str, same: Sequence[str]) -> str:
    """Why no move helps, and what does."""
    instead = dict.fromkeys(CAUSES[name].told_apart_by(MOVES) for name in (cause, *same))
    return (
        f"no move tells {_spaced([cause])} from {_spaced(same)}: they move the readings in exactly the same way; record instead: "
        + "; ".join(text for text in instead if text)
    )


def _spaced(names: Sequence[str]) -> str:
    return " or ".join(name.replace("_", " ") for name in names)


def _move(asked: Sequence[Asked], record: Improvement, logs: Sequence[Log], until: _Deadline) -> str:
    """The best move in words, empty where none could be looked at."""
    best: tuple[Profile, Limits] | None = None
    if any(CAUSES[name].equation == "contact" for name, _ in asked):
        return ""  # these moves keep clear of the stops
    for pitch in _levels(record):
        try:
            limits = _limits(record.rig, pitch, logs)
            profile = expected_profile(asked, record.rig, limits, until)
        except (
            UsageError,
            _TimeIsUpError,
        ):  # a rival that this rig does not show, no room at this pitch, too late
            continue
        if best is None or profile.log_odds > best[0].log_odds:
            best = profile, limits
        if profile.log_odds > SURE:
            break
    return "" if best is None else _in_words(asked, *best)


def _levels(record: Improvement) -> list[float]:
    """Pitches of the logs [deg], the least tilted first."""
    found = {ROUND_DEG * round(p / ROUND_DEG) for e in record.excitations for p in e.pitches}
    return sorted(found or {0.0}, key=lambda p: (abs(p), -p))


def _limits(rig: Rig, pitch: float, logs: Sequence[Log]) -> Limits:
    """What the logs show that the rig may do: how far the mass went from where a log began."""
    away = [log.z[:, 2] - log.z[np.isfinite(log.z[:, 2]), 2][0] for log in logs]
    low, high = min(float(np.nanmin(x)) for x in away), max(float(np.nanmax(x)) for x in away)
    return limits_of(
        rig, LONGEST_S, (pitch,), travel=(min(low, 0.0), max(high, 0.0)), rate_hz=logs[0].rate_hz
    )


def _in_words(asked: Sequence[Asked], profile: Profile, limits: Limits) -> str:
    """The moves with how long they take and the odds that are expected of them."""
    seconds = total_seconds(profile.blocks, limits.accel)
    moves = f"{', then '.join(steps(profile, limits))}, at {limits.pitches[0]:g} deg, {digits(seconds, 2)} s"
    names = _spaced([name for name, _ in asked])
    if profile.log_odds <= DECISIVE:
        return (
            f"no move of {limits.seconds:g} s within what these logs did decides between {names}: the best, {moves}, is expected"
            f" to give odds of {_odds(profile.log_odds)}"
        )
    return f"{moves}: odds of {_odds(profile.log_odds)} are expected ({names})"


def _odds(nats: float) -> str:
    if nats > math.log(MOST_ODDS):
        return "more than a million to 1"
    return f"{digits(math.exp(nats), 2)} to 1"
