"""A rest in which voltage and current contradict the rig file by no more than its resistance is in doubt: no sensor failed."""

import numpy as np

from observer_fi.bank import Bank
from observer_fi.physics import Rig
from observer_fi.records import Event
from observer_fi.verdict.isolate import SHOWN_AT_REST, healthy

STILL_S = 0.1  # after the last motion, until what a stop rings is over
FEWEST = 5  # samples
READS = 5.0  # times its noise, of a current that tells a resistance
IN_DOUBT = 3.0  # standard errors of the resistance
# Mean square of what is left of the voltage, over its noise and the current's; or over what the file's resistance leaves.
FITS, NEXT_TO_NOTHING = 2.0, 0.01


def or_the_resistance(event: Event, bank: Bank, rig: Rig) -> Event:
    """The event, healthy where a rest alone condemns a sensor that another resistance, within its standard error, explains.

    A motor that is held against its friction shows R = V / i, to a thousandth; a slow logger tells Rm to some percent.
    """
    known, recent = rig.quantities.get("Rm"), bank.recent
    if SHOWN_AT_REST not in event.reasons or recent is None or known is None or not known.std:
        return event
    moving = recent.t[recent.active & (recent.t <= event.end_s)]
    since = float(moving[-1]) + STILL_S if moving.size else np.inf
    noise_V, noise_i, _ = rig.noise_std
    V, i = recent.z[:, 0], recent.z[:, 1]
    held = (recent.t > since) & (recent.t <= event.end_s) & (np.abs(i) > READS * noise_i) & np.isfinite(V)
    if held.sum() < FEWEST:
        return event
    V, i = V[held], i[held]
    R = float(V @ i / (i @ i))
    left, had = (float(np.mean((V - ohm * i) ** 2)) for ohm in (R, known.value))
    fits = left <= max(FITS * float(noise_V**2 + (R * noise_i) ** 2), NEXT_TO_NOTHING * had)
    return healthy(event) if abs(R - known.value) <= IN_DOUBT * known.std and fits else event
