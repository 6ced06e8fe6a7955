"""A log's first fault that begins with the brake of its move: what a rig file has slightly wrong begins to show there as well."""

import numpy as np

from observer_fi.bank import Bank
from observer_fi.numerics import runs
from observer_fi.physics import NOMINAL
from observer_fi.records import Event
from observer_fi.verdict.drift import or_healthy

BEFORE_S, AFTER_S = 5e-3, 15e-3  # of the brake, at which an onset begins with it
BEFORE, AFTER = 1.0, 2.0  # the same in samples, of a slow logger
WHY = (
    "it begins with the brake, in no motion before it: an inertia, a gain or a delay that the rig file has slightly wrong "
    "shows there first; a log that begins with a healthy move tells"
)


def or_the_brake(event: Event, bank: Bank) -> Event:
    """The event, shared with health where its fault begins as the command begins to fall to zero. event: the first of a log."""
    if event.label == NOMINAL or event.onset_s is None or NOMINAL in event.alike or bank.recent is None:
        return event
    t, w_cmd = bank.recent.t, np.abs(bank.recent.w_cmd)
    falls = np.append(False, np.diff(w_cmd) < 0.0)
    first, last = runs(falls)
    brakes = t[np.maximum(first - 1, 0)][w_cmd[np.minimum(last, t.size) - 1] == 0.0]
    step = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    behind = event.onset_s - brakes
    with_it = (behind > -max(BEFORE_S, BEFORE * step)) & (behind < max(AFTER_S, AFTER * step))
    return or_healthy(event, WHY) if with_it.any() else event
