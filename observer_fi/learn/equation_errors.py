"""How far the equations of a rig are off on its healthy logs: the room that nominal needs from day to day.

No machine is its model. What ripples, swells, warms or is driven otherwise than the equations say stands in the innovations
of the nominal filter; the errors under which these are likeliest (Mehra, 1970) are those of the rig.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer_fi.bank import Bank, bank, between_samples, usual_errors
from observer_fi.logs import (
    Readings,
    SetBack,
    Uninductive,
    acquisition_of,
    inductance_of,
    late_by,
    unfiltered,
    with_command,
    without_means,
    without_spikes,
)
from observer_fi.physics import Rig
from observer_fi.records import Estimate, Filter, Log
from observer_fi.settings import BankSettings

ORDER = ("servo", "change", "torque", "travel", "friction")
STEPS = (4.0, 2.0, 1.3)  # an error is tried at so many times its value, and at so much less
WORTH = 3.0  # nats that another value must gain
FARTHEST = 1e3  # times the usual error: an equation that is farther off is no room for anything
# Least of the usual errors of a rig whose servo nobody knows, where the settings allow for any; of others it is the usual one.
NARROWEST = {"servo": 0.3, "change": 0.5, "travel": 0.5}
LONGEST = 40_000  # samples of a log
BEGIN = 10  # samples until a filter has found its state
PEAK = 5.0  # standard deviations that no healthy reading of a free current may be off: at eight it is taken for a glitch
WIDER, WIDEST = (
    1.3,
    10.0,
)  # step of a free current's error towards that, and the most: what is farther off is not its error


def with_equation_errors(rig: Rig, logs: Sequence[Log], filters: Sequence[Filter] = ()) -> Rig:
    """`rig` with the errors of its equations that healthy logs show; as it is where no motor drives it.

    Several logs, of several days, have one error each: it is as wide as what differs between them. filters: before the readings
    of all logs.
    """
    if not rig.driven.motor or not logs:
        return rig
    settings = replace(BankSettings(), glitch_samples=0, unknown=False, sensors=False)
    parts = [_part(_in_time(log, rig, filters), rig) for log in logs]
    usual = usual_errors(settings, rig)
    errors = _likeliest(parts, settings, usual)
    return replace(rig, errors=_above_peaks(parts, settings, errors))


def _in_time(log: Log, rig: Rig, filters: Sequence[Filter]) -> Log:
    """A log as `diagnose` takes it whose readings come through filters, or late beside a servo that nobody knows."""
    return unfiltered(log, filters) if rig.watched.servo else SetBack(late_by(filters)).take(log)


def _part(log: Log, rig: Rig) -> tuple[Log, Rig]:
    """The begin of a log as filters may take it, and the rig as its logger shows it."""
    log = with_command(log, rig).part(slice(0, LONGEST))
    log = without_means(log)
    L = inductance_of(rig, log.rate_hz)
    log = Uninductive(L, rig.file_noise_std, 1.0 / log.rate_hz).take(log)
    acquisition = acquisition_of(log, rig.file_noise_std)
    known = replace(rig, logger=acquisition)
    fresh = Readings(acquisition, log.rate_hz, known.noise_std).take(log)
    return without_spikes(fresh, acquisition), known  # a spike would be an error that hides an obstacle


def _likeliest(
    parts: Sequence[tuple[Log, Rig]], settings: BankSettings, usual: dict[str, float]
) -> dict[str, float]:
    """Errors by name, one after the other in ever smaller steps, that make the readings in motion likeliest."""
    free = not parts[0][1].watched.servo
    low = {name: value * (NARROWEST.get(name, 1.0) if free else 1.0) for name, value in usual.items()}
    best, nats = dict(usual), _nats(parts, settings, usual)
    for step in STEPS:
        for name in ORDER:
            for factor in (step, 1.0 / step):
                for _ in range(6):
                    value = best[name] * factor
                    tried = best | {name: value}
                    inside = low[name] <= value <= FARTHEST * usual[name]
                    found = _nats(parts, settings, tried) if inside else -math.inf
                    if found < nats + WORTH:
                        break
                    best, nats = tried, found
    return best


def _above_peaks(
    parts: Sequence[tuple[Log, Rig]], settings: BankSettings, errors: dict[str, float]
) -> dict[str, float]:
    """Errors with which no start of a servo that nobody knows is a glitch of its current."""
    if parts[0][1].watched.servo:
        return errors
    wider = errors
    while _peak(parts, settings, wider) > PEAK:
        wider = wider | {"servo": WIDER * wider["servo"]}
        if wider["servo"] > WIDEST * errors["servo"]:
            return errors
    return wider


def _peak(parts: Sequence[tuple[Log, Rig]], settings: BankSettings, errors: dict[str, float]) -> float:
    """The farthest innovation in motion of the channel that first shows the current, in its standard deviations."""
    far = []
    for e in _estimates(parts, settings, errors):
        seen = np.abs(e.normalised[BEGIN:][e.active[BEGIN:]])
        first = np.where(np.isfinite(seen[:, 0]), seen[:, 0], seen[:, 1])
        far.append(float(np.nanmax(first, initial=0.0)))
    return max(far)


def _nats(parts: Sequence[tuple[Log, Rig]], settings: BankSettings, errors: dict[str, float]) -> float:
    """Log-likelihood of the readings in motion."""
    found = (e.density[BEGIN:, 0][e.active[BEGIN:]].sum() for e in _estimates(parts, settings, errors))
    return float(sum(found))


def _estimates(
    parts: Sequence[tuple[Log, Rig]], settings: BankSettings, errors: dict[str, float]
) -> list[Estimate]:
    """What the nominal filter says of each log with these errors."""
    found = []
    for log, known in parts:
        rig = replace(known, errors=errors)
        now = between_samples(settings, rig, log.rate_hz)
        found.append(Bank(rig, now, hypotheses=bank(rig, now)[:1]).advance(log))
    return found
