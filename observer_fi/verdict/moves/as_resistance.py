"""A rest in which voltage and current contradict the rig file by no more than its resistance is in doubt: no sensor failed, and
no coupling need have let go."""

from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank
from observer_fi.physics import Rig
from observer_fi.records import Event
from observer_fi.verdict.drift import or_healthy
from observer_fi.verdict.isolate import SHOWN_AT_REST, healthy

STILL_S = 0.1  # after the last motion, until what a stop rings is over
FEWEST = 5  # samples
READS = 5.0  # times its noise, of a current that tells a resistance
IN_DOUBT = 3.0  # standard errors of the resistance
WARMER = 0.18  # of the resistance of copper, by which a winding that has run is more: 45 K
# Mean square of what is left of the voltage, over its noise and the current's; or over what the file's resistance leaves.
FITS, NEXT_TO_NOTHING = 2.0, 0.01
_AS_LIKELY = "all of it is in the rest after the move, where a winding of another resistance reads the same"


class _Held(NamedTuple):
    """over_s: when the last motion was over [s]; R: voltage over current in the rest [ohm]; fits: whether that is all of it;
    nats: by which it explains the rest better than the resistance of the rig file."""

    over_s: float
    R: float
    fits: bool
    nats: float


def or_the_resistance(event: Event, bank: Bank, rig: Rig, explained: float) -> Event:
    """The event, healthy where a rest alone condemns a sensor that another resistance, within its standard error, explains; or as
    well healthy, where a winding that is warmer explains as much of the rest as a coupling that was lost in the stop.

    A motor that is held against its friction shows R = V / i, to a thousandth; a slow logger tells Rm to some percent.
    explained: nats by which the fault explains its move better than health.
    """
    known = rig.quantities.get("Rm")
    at_rest, let_go = SHOWN_AT_REST in event.reasons, event.label == "coupling_loss" and not event.alike
    held = _held(event, bank, rig) if known is not None and (at_rest or let_go) else None
    if held is None or known is None or not held.fits:
        return event
    off, doubt = abs(held.R - known.value), IN_DOUBT * (known.std or 0.0)
    if at_rest:
        return healthy(event) if off <= doubt else event
    in_the_stop = event.onset_s is not None and event.onset_s > held.over_s
    as_well = held.nats >= explained and off <= max(doubt, WARMER * known.value)
    return or_healthy(event, _AS_LIKELY) if in_the_stop and as_well else event


def _held(event: Event, bank: Bank, rig: Rig) -> _Held | None:
    """What the rest after a move shows of the resistance, a lost coupling from then on; None where it does not."""
    recent = bank.recent
    if recent is None:
        return None
    moving = recent.t[recent.active & (recent.t <= event.end_s)]
    over_s = float(moving[-1]) if moving.size else np.inf
    let_go = -np.inf if event.label != "coupling_loss" or event.onset_s is None else event.onset_s
    since = max(over_s + STILL_S, let_go)
    noise_V, noise_i, _ = rig.noise_std
    V, i = recent.z[:, 0], recent.z[:, 1]
    held = (recent.t > since) & (recent.t <= event.end_s) & (np.abs(i) > READS * noise_i) & np.isfinite(V)
    if held.sum() < FEWEST:
        return None
    V, i = V[held], i[held]
    R = float(V @ i / (i @ i))
    left, had = (float(np.mean((V - ohm * i) ** 2)) for ohm in (R, rig.model["Rm"]))
    noise = float(noise_V**2 + (R * noise_i) ** 2)
    return _Held(
        over_s, R, left <= max(FITS * noise, NEXT_TO_NOTHING * had), 0.5 * V.size * (had - left) / noise
    )
