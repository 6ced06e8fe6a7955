"""Whether a log holds anything that could tell a fault from none. Where it does not, the verdict is "not tested"."""

from dataclasses import replace

import numpy as np

from observer_fi.bank import Bank, log_feed
from observer_fi.logs import turns_round
from observer_fi.numerics import count_in_rows, digits, in_python, with_unit
from observer_fi.physics import (
    FAULTS,
    LABELS,
    NOMINAL,
    NOT_TESTED,
    UNKNOWN,
    UNLEARNED,
    Rig,
    equations,
    words_of,
)
from observer_fi.records import Array, Consistency, Estimate, Event, Isolation, Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.drift import or_as_well
from observer_fi.verdict.moves.unloaded import feels_another_load, presses_back

NO_MOVE = "the log holds no move"
# Samples in motion with a reading. The quickest isolation of the paper's faults takes 6 of them, and a bank that begins
# within a start needs as many again to find its state.
FEWEST_MOVING = 20
# Twice the 22 Hz at which the servo rings: below this a start cannot be told from a fault.
SLOWEST_HZ = 44.0
# Below this a start of the servo, aliased, looks like a failed sensor or like nothing known: on simulated moves (36 each
# at 44, 50 and 60 samples/s, healthy, overloaded and decoupled) such verdicts were all wrong, the others all right; at 80
# samples/s everything was right.
SURE_HZ = 75.0
# Mean square change of the command from sample to sample, over its variance (von Neumann): 2 for noise, and at 50
# samples/s still below 0.3 for a move of a third of a second.
ROUGHEST = 1.0
LEARNED_FIRST = ("J", "A")  # what any healthy move tells
# What one of a slow logger tells, too: its starts are too short for the inertia, and the errors that were learned with that of
# the data sheet hold what it is off.
FRICTION = ("A",)
_THERE_AND_BACK = (
    "the motor turned round meanwhile: what a slip takes and gives back, an obstacle that gives way does"
)
_PRESSES_NOT = "an obstacle that presses back with nothing is no other than a nut that slips"
_LESS_THAN_A_STEP = (
    "current_a comes in steps of {}, and until the mass stopped an obstacle need not have brought one of them: a nut that slips "
    "looks the same"
)
FEWEST_QUIET = 2  # channels that repeat themselves together: one could be frozen


class Testable:
    """Counts over the chunks of a log what a verdict can rest on."""

    def __init__(self) -> None:
        self.moving = self.commanded = 0
        self.sum = self.squares = self.changes = 0.0
        self.last_w = float("nan")

    def add(self, log: Log, e: Estimate) -> None:
        """Take the next chunk and its estimate."""
        self.moving += moving_samples(e)
        w = log.w_cmd[np.isfinite(log.w_cmd)]
        if w.size:
            step = np.diff(w, prepend=w[0] if np.isnan(self.last_w) else self.last_w)
            self.sum, self.squares = self.sum + float(w.sum()), self.squares + float((w**2).sum())
            self.commanded += w.size
            self.changes, self.last_w = self.changes + float((step**2).sum()), float(w[-1])

    def lack(self, rate_hz: float, rig: Rig, label: str) -> str:
        """Why nothing was tested, "" where something was. rate_hz: median rate of the samples; label: what the bank says."""
        if not self.moving:
            return NO_MOVE
        if self.moving < FEWEST_MOVING:
            return f"the log holds {self.moving} samples in motion, and {FEWEST_MOVING} are needed"
        if rig.watched.servo and rate_hz < SLOWEST_HZ:
            return f"{digits(rate_hz)} samples/s are too few: {SLOWEST_HZ:.0f} are needed to see how the servo rings"
        if rig.watched.servo and rate_hz < SURE_HZ and label in ("sensor_fault", "unknown"):
            return f"at {digits(rate_hz)} samples/s (of {SURE_HZ:.0f}) neither the model nor a sensor can be doubted with reason"
        variance = self.squares - self.sum**2 / self.commanded
        if self.changes > ROUGHEST * variance > 0.0:
            return "the commanded speed changes at random from sample to sample: it is no command"
        return "" if label == NOMINAL else never_learned(rig, label)


def never_learned(rig: Rig, label: str) -> str:
    """Why a fault on a rig whose friction or inertia no log has ever shown is none; "" for a rig that was learned.

    Of six healthy moves of drawn actuators, with the rig files of their data sheets, four looked like a fault.
    """
    first = FRICTION if rig.errors else LEARNED_FIRST
    guessed = [n for n in first if n in rig.quantities and rig.quantities[n].method in UNLEARNED]
    if not guessed:
        return ""
    return (
        f"{' and '.join(guessed)} of the rig file are from data sheets or guessed, and with them the log looks like "
        f"{words_of(label) if label in FAULTS and not FAULTS[label].by_channel else 'a sensor fault'}: learn the rig from "
        "healthy moves first (observer-fi identify)"
    )


def or_an_obstacle(event: Event, rate_hz: float, rig: Rig) -> Event:
    """A fault without a name or, as likely, an obstacle, in a log of an unknown servo too slow to show how one is met."""
    told = event.label != UNKNOWN or event.probability <= 0.5 or event.severity
    if told or rig.watched.servo or rate_hz >= SURE_HZ:
        return event
    why = (
        f"at {digits(rate_hz)} samples/s (of {SURE_HZ:.0f}) an obstacle that stops the motor between two of them looks like "
        "no fault with a name"
    )
    return or_as_well(event, "overload", why)


def or_touched(event: Event, bank: Bank) -> Event:
    """A slip or, as likely, an obstacle that the mass touches and leaves, where the motor turned round meanwhile.

    What a slip takes of the way there it gives back on the way back, as what gives way does.
    """
    recent = bank.recent
    if event.label != "slip" or "overload" in event.alike or event.onset_s is None or recent is None:
        return event
    over = event.end_s if event.over_s is None else event.over_s
    w_cmd = recent.w_cmd[(recent.t >= event.onset_s) & (recent.t <= over)]
    return or_as_well(event, "overload", _THERE_AND_BACK) if turns_round(w_cmd, recent.w_cmd) else event


def or_a_slip(event: Event, bank: Bank, rig: Rig) -> Event:
    """An obstacle or, as likely, a nut that slips, where nothing tells that it presses back.

    So it is where the stiffness that was found is none within its interval, and the current is as before; and, where none was
    found, if all that presses back until the mass stops (equation 11) is less than a step of the current.
    """
    if event.label != "overload" or "slip" in event.alike:
        return event
    pressing = presses_back(event)
    if pressing is not None:
        stands = pressing or feels_another_load(event, bank)
        return event if stands else or_as_well(event, "slip", _PRESSES_NOT)
    step = float(rig.step[1])
    if rig.model["Km"] * step <= _pressed(event, bank, rig):
        return event
    return or_as_well(event, "slip", _LESS_THAN_A_STEP.format(with_unit(step, "A")))


def _pressed(event: Event, bank: Bank, rig: Rig) -> float:
    """What an obstacle of the rig file presses back with in the end [N m]; without limit where the way into it is not known."""
    recent, onset = bank.recent, event.onset_s
    if recent is None or onset is None:
        return np.inf
    x = recent.z[(recent.t >= onset) & (recent.t <= event.end_s) & recent.active, 2]
    x = x[np.isfinite(x)]
    return in_python(equations.stop_torque)(0.0, float(np.ptp(x)), rig.model.vector) if x.size else np.inf


def moving_samples(e: Estimate) -> int:
    """Samples that count as evidence and have a reading."""
    return int(np.count_nonzero(e.active & (count_in_rows(np.isfinite(e.normalised)) > 0)))


def not_tested(reason: str) -> Event:
    """The verdict that there can be none."""
    nothing = dict.fromkeys(LABELS, 0.0)
    return Event(NOT_TESTED, None, np.nan, None, (None, None), None, None, 0.0, 0.0, nothing, (reason,))


def untested(reason: str) -> Isolation:
    """Of a log without a verdict: no event, and no word about the fit."""
    return Isolation(not_tested(reason), (), Consistency(float("nan"), 3.0, float("nan")))


def for_readings(settings: BankSettings, rig: Rig, z: Array) -> BankSettings:
    """Settings for a log whose first readings are z (n, 3): where they carry no noise, a sensor that repeats itself is none
    that is frozen.
    """
    return replace(settings, repeat_weight=0.0) if repeats_itself(z, rig, settings.repeat_scale) else settings


def repeats_itself(z: Array, rig: Rig, scale: float) -> bool:
    """Whether every channel that is there, two at least, gives the same reading, within `scale` times its noise, through a
    log's beginning.

    Coarse readings at rest repeat themselves too, but not all channels at once: of 30 recorded moves none does.
    """
    change = np.abs(np.diff(z[: log_feed.SETTLING + 1], axis=0))
    if len(change) < log_feed.SETTLING:
        return False
    there = np.isfinite(change).any(axis=0)
    return int(there.sum()) >= FEWEST_QUIET and bool((change < scale * rig.noise_std)[:, there].all())
