"""A log without a pitch: gravity drives its mass all the same, as if the vehicle had one pitch that its first motion tells.

Equation 3 has the pitch in proportion, so that taken as 0 it is friction that is less one way and more the other: a healthy
reversal was a jam for sure.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from observer_fi.logs import NO_PITCH, Readings, acquisition_of, moves_from_rest
from observer_fi.numerics import count_in_rows
from observer_fi.physics import NOMINAL, UNKNOWN, Rig, with_values
from observer_fi.records import Event, Log, Outcome
from observer_fi.settings import BankSettings
from observer_fi.verdict.drift import SURE, or_as_well
from observer_fi.verdict.logger.left_out import shared
from observer_fi.verdict.logger.offset import electrical_offset
from observer_fi.verdict.logger.zero_current import Said, said_by_nominal
from observer_fi.verdict.testable import for_readings

MOVES = 2  # that are looked at
WINDOWS_S = (6.0, 3.0, 1.5, 0.7, 0.3)  # of them: the longest that nominal explains with some pitch tells it
STEEPEST_DEG = 90.0
ENOUGH = 0.25  # of the pitch that weighs as much as the friction: looks so close miss no hill; what weighs less is no matter
LOOKS, MOST_LOOKS = 4, 10  # on either side of the best so far, and how often
WITHIN = 0.01  # of the distance of two looks, how well a pitch is told
# Nats that a pitch must gain over none, and how well nominal then fits: NIS over its expectation.
NOTICED_NATS, FITS = 40.0, 1.3
DRIFTS_DEG = 2.0  # by which a vehicle's pitch differs from what its first motion shows
_DRIFTED = "no pitch was logged: one that differs by {:.1f} deg from what it was taken for looks the same"
RAISED = 0.1  # of the friction: what is less is not told from rig to rig
_RAISED = "no pitch was logged: what was taken for one of {:.1f} deg may be a friction that had risen before the log begins"
_NOTHING = "no pitch was logged: what gravity does to the mass is not known"
_LOG_IT = "Log the pitch of the vehicle"
_TOLD = (
    "{} as {:.1f} deg, as the first motion of the log shows; friction that had changed before it begins looks the same in one "
    "direction, and a pitch that changes like a fault. " + _LOG_IT
)


def with_its_pitch(log: Log, rig: Rig, settings: BankSettings) -> Rig:
    """The rig whose pitch sensor is off by the pitch that a log without one shows in its first motion, if it matters.

    log: its beginning at least, with its command.
    """
    if not _is_needed(log, rig):
        return rig
    moves = moves_from_rest(log)[:MOVES]
    for seconds in WINDOWS_S if moves else ():
        end = min(moves[-1].end, int(np.searchsorted(log.t, log.t[moves[0].start] + seconds)))
        first = _First(log.part(slice(moves[0].rest, end)), rig, settings)
        pitch = first.best()
        if first.said(pitch).misfit < FITS:
            matters = first.said(pitch).nats > first.said(0.0).nats + NOTICED_NATS
            return _pitched(rig, pitch) if matters else rig
    return rig


def told_pitch(notes: Sequence[str], known: Rig, given: Rig) -> tuple[str, ...]:
    """Notes of a log, that of a missing pitch with what it was taken for. known: the rig with that pitch, given: without."""
    pitch = _pitch_of(known, given)
    if pitch == 0.0:
        return tuple(notes)
    return tuple(_TOLD.format(NO_PITCH, pitch) if note.startswith(NO_PITCH) else note for note in notes)


def is_told_pitch(note: str) -> bool:
    """Whether a note says what a missing pitch was taken for."""
    return note.startswith(NO_PITCH) and note.endswith(_LOG_IT)


def or_another_pitch(outcome: Outcome, begin: Callable[[], Log], known: Rig, given: Rig) -> Outcome:
    """The outcome of a log without a pitch, shared where another pitch than the known one would look as what was found.

    A friction that has slightly risen, and what no fault explains, may be health; health in one direction, of which the pitch
    was told, may be a friction that had risen before. begin: the first chunk of the log.
    """
    found = outcome.isolation
    absent = outcome.log is not None and any(note.startswith(NO_PITCH) for note in outcome.log.notes)
    if not absent or found is None or not found.verdict.probability > SURE:
        return outcome
    said, w_cmd = found.verdict, begin().w_cmd
    ways = {float(way) for way in np.unique(np.sign(w_cmd[w_cmd != 0.0]))}
    other = another_pitch(said, known, given, ways)
    if other is None:
        return outcome
    return shared(outcome, said, lambda event: or_as_well(event, *other), known)


def another_pitch(
    said: Event, known: Rig, given: Rig, ways: Collection[float], one_way: bool = False
) -> tuple[str, str] | None:
    """The label that looks as what was said, with another pitch than that of the known rig, and why; None where none does.

    given: the rig without a pitch that was told; ways: signs of the commands up to now; one_way: whether motion in one direction
    alone told it, a friction of that day included, which the way back shows twice. There a jam without a size says nothing.
    """
    if not known.driven.motor:
        return None
    friction, gravity, pitch = known.model["A"], abs(known.model["B"]), _pitch_of(known, given)
    risen = next((abs(one.value) for one in said.severity if one.name == "friction_rise"), math.inf)
    if said.label == "jam" and risen * friction < gravity * DRIFTS_DEG * (2.0 if one_way else 1.0):
        return NOMINAL, _DRIFTED.format(risen * friction / gravity)
    unsized = one_way and said.label == "jam" and not math.isfinite(risen)
    if _can_matter(known) and (said.label == UNKNOWN or unsized):
        return NOMINAL, _NOTHING
    # In one direction a friction that had risen has the motion as such a pitch has it.
    if said.label == NOMINAL and len(ways) == 1 and min(ways) * known.model["B"] * pitch > RAISED * friction:
        return "jam", _RAISED.format(pitch)
    return None


def _pitch_of(known: Rig, given: Rig) -> float:
    """What a missing pitch was taken for [deg]."""
    return given.model["pitch_offset"] - known.model["pitch_offset"]


def _is_needed(log: Log, rig: Rig) -> bool:
    """Whether a pitch is missing that matters and that voltage and current can tell."""
    absent = any(note.startswith(NO_PITCH) for note in log.notes)
    read = rig.driven.motor and bool(np.isfinite(log.z[:, :2]).any(axis=0).all())
    return absent and read and _can_matter(rig)


def _can_matter(rig: Rig) -> bool:
    """Whether gravity could weigh as much as a good part of the friction."""
    return abs(rig.model["B"]) * STEEPEST_DEG > ENOUGH * rig.model["A"]


class _First:
    """The first motion of a log as nominal explains it, by pitches."""

    def __init__(self, log: Log, rig: Rig, settings: BankSettings) -> None:
        acquisition = acquisition_of(log, rig.file_noise_std)
        self.rig = replace(rig, logger=acquisition)
        self.settings = for_readings(settings, rig, log.z)
        offset = np.array([electrical_offset(acquisition, rig), 0.0, 0.0])
        read = Readings(acquisition, log.rate_hz, rig.noise_std).take(log)
        self.log = replace(read, z=read.z - offset)
        self.read = count_in_rows(np.isfinite(self.log.z))
        self.known: dict[float, Said] = {}

    def said(self, pitch: float) -> Said:
        """What nominal says of the motion at a pitch [deg]."""
        if pitch not in self.known:
            self.known[pitch] = said_by_nominal(self.log, _pitched(self.rig, pitch), self.settings, self.read)
        return self.known[pitch]

    def best(self) -> float:
        """The pitch [deg] that explains the motion best, near what the current has to carry."""
        step = ENOUGH * self.rig.model["A"] / abs(self.rig.model["B"])
        at, top = math.nan, self._carried()
        for _ in range(MOST_LOOKS):
            if at == top:
                break
            at, top = top, self._best_near(top, step, LOOKS)
        return self._refined(top, step)

    def _carried(self) -> float:
        """The pitch [deg] against which the motor drives the mass, by the mean current of the motion and the usual friction."""
        m, log = self.rig.model, self.log
        driven = np.isfinite(log.z[:, 1]) & (log.w_cmd != 0.0)
        if not driven.any():
            return 0.0
        torque = m["Km"] * log.z[driven, 1] - m["A"] * np.sign(log.w_cmd[driven])
        return float(np.clip(torque.mean() / m["B"], -STEEPEST_DEG, STEEPEST_DEG))

    def _refined(self, top: float, step: float) -> float:
        """The best pitch within a step of one [deg]."""
        from scipy.optimize import minimize_scalar  # loads for as long as most logs are judged

        found = minimize_scalar(
            lambda pitch: -self.said(float(pitch)).nats,
            bounds=(max(top - step, -STEEPEST_DEG), min(top + step, STEEPEST_DEG)),
            method="bounded",
            options={"xatol": WITHIN * step},
        )
        return max(top, float(found.x), key=lambda pitch: self.said(pitch).nats)

    def _best_near(self, pitch: float, step: float, looks: int) -> float:
        """The best of pitches so far apart, as many on either side of one, and none steeper than a wall [deg]."""
        apart = pitch + step * np.arange(-looks, looks + 1)
        near = np.unique(np.clip(apart, -STEEPEST_DEG, STEEPEST_DEG)).tolist()
        return max(near, key=lambda one: self.said(one).nats)


def _pitched(rig: Rig, pitch: float) -> Rig:
    return with_values(rig, {"pitch_offset": rig.model["pitch_offset"] - pitch})
