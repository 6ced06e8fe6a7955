"""The last word on a move: what the bank left without a name, or doubted for a moment, by every path of the whole move.

The bank knows faults of the rig file's size that stay; here a fault has any severity, may have come for a while, and has a
label that needs the whole move. Verdicts that the bank is sure of stand.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import Bank, Hypothesis, LogSamples, of_a_move, other_laws
from observer_fi.logs import quarter_of_a_ring
from observer_fi.physics import FAULTS, NOMINAL, UNKNOWN, Rig, channel_of, label_of
from observer_fi.records import Event
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.drift import (
    STOP_S,
    SURE,
    friction_in_spreads,
    jammed_before,
    mostly,
    or_as_well,
    or_else,
)
from observer_fi.verdict.drive_off import may_be_off
from observer_fi.verdict.isolate import OF_THE_REST, healthy
from observer_fi.verdict.moves.naming import FAR, Naming, draws_on, shown
from observer_fi.verdict.moves.pairs import Explained, Pairs
from observer_fi.verdict.moves.second_fault import first_misfit
from observer_fi.verdict.moves.stories import Story, constant, in_order
from observer_fi.verdict.moves.unloaded import slope_of
from observer_fi.verdict.moves.whole_move import (
    FITS,
    LEFT,
    SETTLED_S,
    STOPPED_S,
    STRIDE,
    WELL,
    Path,
    WholeMove,
    window_of,
)
from observer_fi.verdict.onset import Filters

Mask = NDArray[np.bool_]
# Where a fault may have begun: this long before the bank's first doubt, more where it is found at the edge, and after it.
BEFORE_S, EDGE_S, AFTER_S = (0.2, 3.0, 30.0), 0.05, 0.05
MOST_IN_DOUBT, MOST_SURE = (
    20,
    2,
)  # moves of a label that are asked in a log, and those of a sure one that stand
Z_REST = 4.0  # standard deviations of a drift at rest
FAR_AT_REST = 120.0  # as FAR, where the motor should stand: in three healthy stops every fault gained 47 to 65 times as much
RISEN = 1.0  # spreads from rig to rig by which friction is more than usual, and than in the moves before
RISES_S = 0.1  # from a start on, when it may have risen
ELECTRICAL, WORSE = (
    ("voltage", "current"),
    0.9,
)  # gain of a sensor that lies, of what another story gains, that is enough for it
MISREAD = "sensor:voltage"
AROUND_S, KEEPS = (
    (0.1, 0.5),
    0.25,
)  # about an onset: where speeds are steady; of what a slip should have taken of one
SHOWS_A_STOP = 0.5  # of the time in which a servo brakes: samples farther apart do not show how it stops
# Faults that are small before they are great, or look like the end of a move where nobody knows the servo, and the nats over
# health from which one of them may be; of 120 healthy ones through twelve loggers none is.
A_LITTLE_OF, A_LITTLE = ("slip", "jam", "coupling_loss"), 5.0
# Times the expected NIS of nominal before a fault, up to which that may have a name all the same.
SO_SO = 2.0
NOT_BEFORE = (
    "the motion before it is not explained to the last: the rig file may not describe this machine as it is"
)
NOT_TO_THE_LAST = "{} explains this move best, but not to the last"


class LastWord:
    """Asks whole moves; filters are made once a log."""

    def __init__(self, rig: Rig, filters: Filters, settings: DecisionSettings) -> None:
        self.rig, self.filters, self.settings = rig, filters, settings
        self.stop_s = STOP_S if rig.driven.servo else 0.0  # how an unknown servo stops, no model says
        self.stop_step_s = SHOWS_A_STOP * quarter_of_a_ring(rig.model) or math.inf  # nobody knows of others
        self.hypotheses: tuple[Hypothesis, ...] = ()
        self.laws: tuple[Hypothesis, ...] = ()
        self.asked: Counter[str] = Counter()
        self.stood: Counter[str] = Counter()  # answers that were what the bank had said
        self.rise = 0.0  # of the friction in the moves so far, in spreads from rig to rig
        self.explained: dict[float, Explained] = {}  # moves, by their starts
        self.naming = Naming(rig, settings)
        self.pairs = Pairs(self.naming, settings)

    def needed(self, event: Event) -> bool:
        """Whether the bank left the move without a name, doubted a healthy one for a moment, or named a fault that has a size.

        A position that lies may be a nut that slips, of which the bank knows nothing; any sensor, a bank at a loss.

        In a log of many such moves the first ones are asked: the others cost as much again and say the same. Of labels of
        which the bank is sure those count that stood: where the first were none, the others may be none either.
        """
        in_doubt = event.label in (NOMINAL, UNKNOWN)
        sure = not in_doubt and self.stood[event.label] >= MOST_SURE
        if sure or self.asked[event.label] >= MOST_IN_DOUBT:
            return False
        if event.label == NOMINAL:
            return event.doubted_s is not None
        return in_doubt or event.channel is not None or any(own.tells for own in FAULTS[event.label].sizes)

    def doubting(self, event: Event, bank: Bank) -> Event:
        """A healthy event, doubted in its start where more friction is found there than usual and than in the moves before.

        What rises while nominal still learns its friction is the rig's to it.
        """
        rise = friction_in_spreads(event, bank)
        if event.label != NOMINAL or event.doubted_s is not None or rise is None:
            return event
        before, self.rise = self.rise, max(self.rise, rise)
        return event._replace(doubted_s=event.start_s + RISES_S) if rise > before + RISEN else event

    def on(self, event: Event, bank: Bank) -> Event:
        """The event as the whole move has it; as it is where the move is no longer at hand or says nothing else."""
        self.asked[event.label] += 1
        doubted = event.doubted_s if event.label == NOMINAL else event.detected_s or event.doubted_s
        if doubted is None:
            return event
        told = self._asked(event, bank, doubted, self.stop_s if event.label == NOMINAL else 0.0)
        if told.label == NOMINAL and not told.alike and not self.stop_s:
            told = self._or_no_stop(told, event, bank, doubted)
        self.stood[event.label] += told.label == event.label
        stopped = told.label == UNKNOWN and event.label == UNKNOWN and self._in_the_stop(doubted, event, bank)
        return self._asked(event, bank, doubted, self.stop_s) if stopped else told

    def _or_no_stop(self, told: Event, event: Event, bank: Bank, doubted: float) -> Event:
        """Health, or as well a coupling lost as the motor seemed to be stopped, where the rest after it says so by a little.

        It says nothing else: no model knows how an unknown servo stops.
        """
        explained = dict(self.explained)
        also = self._asked(event, bank, doubted, STOP_S)
        if also.label == NOMINAL and also.alike == ("coupling_loss",):
            return also
        self.explained = explained
        return told

    def _in_the_stop(self, doubted: float, event: Event, bank: Bank) -> bool:
        """Whether a doubt came just before the motor was stopped, or later."""
        found = window_of(event, bank)
        return found is not None and doubted > found[0].t[-1] - STOPPED_S

    def _asked(self, event: Event, bank: Bank, doubted: float, rest_s: float) -> Event:
        """The event as the move has it with so much of the stop and the rest after it."""
        whole = self.move(event, bank, rest_s)
        if whole is None:
            return event
        paths, stories = self._near(doubted, event, whole)
        if event.channel in ELECTRICAL and (not stories or _fits_as(event, paths, stories, whole)):
            return event
        begun = doubted < whole.window.t[0] or (not stories and doubted < event.start_s + SETTLED_S)
        if self._is_open(paths, stories) and (
            begun or any(self.naming.counts(path, whole, event) for path in paths)
        ):
            later, stories = self._later(stories, event, whole)
            paths = paths or later
        if not stories and whole.n > whole.moving and doubted < whole.window.t[whole.moving - 1] - STOPPED_S:
            stopped = self._of_the_stop(whole)
            paths, stories = [*paths, *stopped], self.naming.told_by(stopped, whole, event)
        stories = in_order(list(self._of_sensor_or_nut(stories, whole, bank, event)))
        misread = (
            bool(stories)
            and stories[0].mode == MISREAD
            and stories[0].path.hypothesis.label != "sensor_fault"
        )
        two = None if misread else self.pairs.of(paths, stories, event, whole)
        if two is not None:
            self.explained[event.start_s] = two.explained
            return two.event
        if stories:
            gain = stories[0].gain
            self.explained[event.start_s] = Explained(whole.in_motion() + gain, gain)
            told = _or_the_banks(self.naming.told(event, stories, whole), event, paths, stories[0], whole)
            return self._or_the_better(told, event, paths, stories[0].gain, whole)
        return self._without_a_story(event, paths, whole, doubted)

    def _is_open(self, paths: Sequence[Path], stories: Sequence[Story]) -> bool:
        """Whether no story has a name, or a path that none is about explains the move better than all that have one."""
        named = max((story.gain for story in stories if story.mode != UNKNOWN), default=None)
        return named is None or (bool(paths) and paths[0].gain > named + self.settings.move_nats)

    def _without_a_story(
        self, event: Event, paths: Sequence[Path], whole: WholeMove, doubted: float
    ) -> Event:
        """The event where none of the paths of its move has a name that may be told."""
        counted = [path for path in paths if self.naming.counts(path, whole, event)]
        if event.label == NOMINAL and counted and self._without_a_name(counted[0], whole):
            return _unexplained(event, counted[0], whole)
        if event.label == UNKNOWN:
            told = self._of_the_start(event, whole, doubted, bool(counted))
            return self._or_a_name(event, paths, whole) if told is event else told
        if event.label == NOMINAL:
            return self._or_a_little(event, paths, whole)
        # a drive that goes off at rest is no misfit
        moves = whole.nis[whole.window.active] if whole.window.active.any() else whole.nis
        if not counted and float(moves.mean()) <= FITS * whole.expected(whole.nominal):
            return self._or_health(event, paths)
        own = event.label, event.channel
        gains = (p.gain for p in paths if (p.hypothesis.label, channel_of(p.hypothesis.name)) == own)
        return self._or_the_better(event, event, paths, max(gains, default=0.0), whole)

    def _of_the_start(self, event: Event, whole: WholeMove, doubted: float, counted: bool) -> Event:
        """A fault without a name; health, or a jam of before, where the doubt was of the start and nominal explains the rest."""
        if not self._settles(doubted, event, whole):
            return event
        limit = self.settings.strain_limit
        slope = whole.direction(whole.moving - 1) * float(whole.window.theta[whole.moving - 1])
        jammed = jammed_before(healthy(event), whole.memories[-1], whole.nominal, self.rig, limit, slope)
        # the ring of a soft start, which nominal explains as well as the rest of the move
        rings = not counted and first_misfit(whole.nis, whole.expected(whole.nominal), whole) is None
        return jammed if rings or jammed.label != NOMINAL else event

    def _or_a_name(self, event: Event, paths: Sequence[Path], whole: WholeMove) -> Event:
        """A fault without a name, and as well the one that explains the move best of all, but not to the last.

        That one first, where its samples are explained better than those before it: then it is the rig file that is off.
        """
        best = paths[0] if paths else None
        if best is None or best.hypothesis.label == UNKNOWN or best.gain < FAR * self.settings.move_nats:
            return event
        before = whole.nis[int(np.searchsorted(whole.window.t, event.start_s + SETTLED_S)) : best.begin]
        misfit = float(before.mean()) / whole.expected(whole.nominal) if before.size >= LEFT else math.inf
        left = best.nis / whole.expected(best.hypothesis)
        stories = in_order(list(self.naming.stories(best, whole)))
        if not stories or max(misfit, left) >= SO_SO or not self.naming.counts(best, whole, event):
            return event
        told = self.naming.told(event, stories, whole)
        if left <= misfit:
            return or_as_well(told, UNKNOWN, NOT_BEFORE)
        return or_as_well(
            event._replace(reasons=()), told.label, NOT_TO_THE_LAST.format(FAULTS[told.label].title.lower())
        )

    def _or_health(self, event: Event, paths: Sequence[Path]) -> Event:
        """Health instead of a fault that the bank is sure of and the whole move is not; both where it likes the fault too.

        What is entered in a start gains by beginning anew, but in 240 healthy ones none of these faults gained anything.
        """
        gain = max((path.gain for path in paths if path.hypothesis.label == event.label), default=-math.inf)
        if gain <= 0.0:
            return healthy(event)
        words = FAULTS[event.label].words.format(channel=event.channel)
        return or_else(healthy(event), event.label, f"of {words} and health this move does not tell which")

    def _or_a_little(self, event: Event, paths: Sequence[Path], whole: WholeMove) -> Event:
        """Health, or else the fault that explains it better by less than chance may where a begin is sought in every doubt."""
        path = max(paths, key=lambda one: one.gain, default=None)
        if path is None or path.hypothesis.label not in A_LITTLE_OF or not whole.lasts(path):
            return event
        begin, nats = float(whole.window.t[path.begin]), self.settings.move_nats
        at_rest = not self.stop_s and whole.n > whole.moving  # which is heard of a lost coupling alone
        stops = path.begin >= whole.moving - round(STOPPED_S / whole.interval) and not at_rest
        begins_anew = begin < event.start_s + SETTLED_S or stops  # where whatever is entered gains
        enough = min(path.gain, shown(path)) >= nats if begins_anew else path.gain >= A_LITTLE
        fits = path.nis <= WELL * whole.expected(path.hypothesis)
        if not (enough and fits and any(self.naming.stories(path, whole))):
            return event
        words = FAULTS[path.hypothesis.label].words
        return or_else(
            event, path.hypothesis.label, f"{words} may have begun at {begin:.3f} s, by too little to say so"
        )

    def _or_the_better(
        self, told: Event, event: Event, paths: Sequence[Path], gain: float, whole: WholeMove
    ) -> Event:
        """What the whole move says, or as well the fault that explains it better, and is not told only because nominal does not
        explain the motion before it."""
        within = (path for path in paths if whole.window.t[path.begin] > event.start_s + SETTLED_S)
        top = max(within, key=lambda path: path.gain, default=None)
        if top is None or top.gain <= gain + self.settings.move_nats:
            return told
        if top.nis > FITS * whole.expected(top.hypothesis) or not self.naming.counts(top, whole, event):
            return told
        names = [label_of(story.mode) for story in self.naming.stories(top, whole)]
        if not names or {told.label, *told.alike, UNKNOWN} & set(names):
            return told
        why = f"{FAULTS[names[0]].title.lower()} explains this move better, but nothing explains the motion before it"
        return or_as_well(told, names[0], why)

    @staticmethod
    def _of_the_stop(whole: WholeMove) -> list[Path]:
        """Paths whose fault begins as the motor is about to be stopped, or while it is."""
        return whole.paths(whole.moving - round(STOPPED_S / whole.interval), whole.moving + 2 * LEFT)

    def _without_a_name(self, path: Path, whole: WholeMove) -> bool:
        """Whether nominal, which fits elsewhere, is far off while a path lasts that fits no better."""
        at_rest = _begins_at_rest(path, whole)
        if at_rest and may_be_off(whole.window.z[path.begin :, :2], self.rig.noise_std[:2], whole.zero):
            return False
        last = whole.n if path.end is None else path.end
        elsewhere = np.concatenate((whole.nis[: path.begin], whole.nis[last:]))
        clean = elsewhere.size > 0 and float(elsewhere.mean()) <= FITS * whole.expected(whole.nominal)
        return clean and path.gain >= (FAR_AT_REST if at_rest else FAR) * self.settings.move_nats

    def _settles(self, doubted: float, event: Event, whole: WholeMove) -> bool:
        """Whether the doubt was of the start, and nominal fits once the ring is over: it has taken up what was wrong."""
        settled = event.start_s + SETTLED_S
        later = whole.nis[int(np.searchsorted(whole.window.t, settled)) : whole.moving]
        return doubted < settled and bool(later.size) and later.mean() <= FITS * whole.expected(whole.nominal)

    def _of_sensor_or_nut(
        self, stories: Sequence[Story], whole: WholeMove, bank: Bank, event: Event
    ) -> Iterator[Story]:
        """Stories with those of a slip decided by the rest after the move: a nut stands there, a sensor that drifts goes on.

        At one speed the two look alike; without a rest both are told. A slip that leaves the mass as fast as it was is a motor
        that only reads faster.
        """
        drift = _drift_at_rest(bank, event.end_s, whole)
        for story in stories:
            lost = _lost(story.path) if story.mode == "slip" else 0.0
            if lost and _keeps_pace(story.path, lost, event.start_s, whole, self.rig.watched.servo):
                yield story._replace(mode=MISREAD)
                continue
            if not lost or not whole.lasts(story.path):
                yield story
                continue
            slips = (
                -lost * self.rig.model["D"] * float(whole.window.w_cmd[whole.moving - 1])
            )  # m/s that a sensor would have to drift
            goes_on = _is_near(drift, slips, self.filters.rig.noise_std[2])
            if goes_on is not True:
                yield story
            if goes_on is not False:
                yield story._replace(mode="sensor:position")

    def _near(self, doubted: float, event: Event, whole: WholeMove) -> tuple[list[Path], list[Story]]:
        """Paths whose fault begins before a doubt, or shortly after it, and what they may be called."""
        for before in BEFORE_S:
            since = max(event.start_s, doubted - before)
            begins = np.searchsorted(whole.window.t, (since, doubted + AFTER_S))
            paths = whole.paths(int(begins[0]), int(begins[1]))
            stories = self.naming.told_by(paths, whole, event)
            edge = bool(paths) and whole.window.t[paths[0].begin] <= since + EDGE_S
            if since <= event.start_s or (not edge and (stories or before == BEFORE_S[1])):
                break
        if (
            paths and whole.window.t[paths[0].begin] >= doubted + AFTER_S - EDGE_S
        ):  # a doubt by chance, and a fault later
            further = whole.paths(paths[0].begin, whole.n)
            if further and further[0].gain > paths[0].gain:
                return further, self.naming.told_by(further, whole, event)
        return paths, stories

    def _later(self, stories: list[Story], event: Event, whole: WholeMove) -> tuple[list[Path], list[Story]]:
        """Faults after the ring of the start, and their stories where they are as good: the doubt was of the ring."""
        first = int(np.searchsorted(whole.window.t, event.start_s + SETTLED_S))
        later = [path for path in whole.paths(first, whole.n) if path.begin >= first]
        found = self.naming.told_by(later, whole, event)
        best = max((story.gain for story in stories), default=-math.inf)
        return later, found if any(story.gain >= best for story in found) else stories

    def known(self) -> tuple[Hypothesis, ...]:
        """What a move may be, nominal first; made when it is asked for, once."""
        self.hypotheses = self.hypotheses or of_a_move(self.rig, self.filters.settings)
        return self.hypotheses

    def move(self, event: Event, bank: Bank, rest_s: float = 0.0) -> WholeMove | None:
        """The move from a rest before it to its last sample under way, or so long into the rest after it."""
        found = window_of(event, bank, rest_s)
        if found is not None and rest_s and float(np.median(np.diff(found[0].t))) > self.stop_step_s:
            found = window_of(event, bank)
        if found is None:
            return None
        self.laws = self.laws or other_laws(self.rig, self.filters.settings)
        whole = WholeMove(self.known(), *found, self.filters, self.laws)
        at_once = event.label == UNKNOWN and event.start_s <= found[0].t[0]
        return _from_where_it_is_known(whole) if at_once else whole


def _or_the_banks(told: Event, event: Event, paths: Sequence[Path], best: Story, whole: WholeMove) -> Event:
    """What the whole move says, or as well the fault of which the bank is sure, where that explains the move best of all but with
    constants that are not believable: those of a data sheet are guesses. An obstacle that draws the mass on is none."""
    if event.label in (NOMINAL, UNKNOWN, told.label, *told.alike):
        return told
    better = (p for p in paths if p.hypothesis.label == event.label and p.gain >= best.gain)
    if all(draws_on(path, whole) for path in better):
        return told
    why = f"of {FAULTS[event.label].title.lower()}, which explains this move better, the constants are not believable"
    return or_as_well(told, event.label, why)


def _fits_as(event: Event, paths: Sequence[Path], stories: Sequence[Story], whole: WholeMove) -> bool:
    """Whether a path of the event's own channel describes the move, and nearly as much of it as any story.

    As much, where that is a mass that has come loose: what lies of a motor stops no mass.
    """
    best = max(stories, key=lambda story: story.gain)
    enough = best.gain * (1.0 if best.mode == "coupling_loss" else WORSE)
    own = (p for p in paths if channel_of(p.hypothesis.name) == event.channel and p.gain >= enough)
    return any(path.nis <= FITS * whole.expected(path.hypothesis) for path in own)


def _from_where_it_is_known(whole: WholeMove) -> WholeMove:
    """The move without the first samples of a log that begins in a start, of which no reading tells how far the servo was."""
    first = round(SETTLED_S / whole.interval) // STRIDE * STRIDE
    left, misfit = whole.moving - first, float(whole.nis[:first].mean()) if first else 0.0
    if left < first or not whole.window.active[0] or misfit <= FITS * whole.expected(whole.nominal):
        return whole
    hypotheses, window = (whole.nominal, *whole.faults), whole.window.cut(first, whole.n)
    return WholeMove(hypotheses, window, whole.memories[first // STRIDE], whole.filters, whole.laws)


def _drift_at_rest(bank: Bank, end_s: float, whole: WholeMove) -> tuple[float, float] | None:
    """Slope of the position after a move [m/s] and the share of its noise in that [1/s]; None where there is no rest."""
    recent = bank.recent
    if recent is None:
        return None
    after = (
        (recent.t > whole.window.t[whole.moving - 1] + SETTLED_S)
        & (recent.t <= end_s)
        & (recent.w_cmd == 0.0)
    )
    after &= np.isfinite(recent.z[:, 2])
    t, x = recent.t[after], recent.z[after, 2]
    slope = slope_of(t, x)
    return None if slope is None else (slope, float(1.0 / math.sqrt(t.size * t.var())))


def _lost(path: Path) -> float:
    """The share of its travel that a mass loses on a path with such a state."""
    return constant(path, next(own for own in path.hypothesis.own if own.name == "E"))[0]


def _keeps_pace(path: Path, lost: float, start_s: float, whole: WholeMove, told: bool) -> bool:
    """Whether a mass goes on as fast as before a fault that should have lost it a share of its travel, and a voltage says so.

    At a steady speed, soon after the fault and as long as it lasts: one that grows takes little at first. start_s: when the move
    began. told: whether the servo is, and with it the command; one that is made of the voltage rises with what that reads.
    """
    window = whole.window
    t, begin = window.t, float(window.t[path.begin])
    end = float(t[whole.moving - 1 if path.end is None else min(path.end, whole.moving) - 1])
    earlier = _steady(whole, max(begin - AROUND_S[1], start_s + SETTLED_S), begin - AROUND_S[0])
    soon = _steady(whole, begin + AROUND_S[0], begin + AROUND_S[1])
    last = _steady(whole, max(end - AROUND_S[1], begin + AROUND_S[0]), end - AROUND_S[0])
    if not np.isfinite(window.z[soon, 0]).any():
        return False
    return all(_as_fast(earlier, later, abs(lost), window, told) for later in (soon, last))


def _steady(whole: WholeMove, since: float, until: float) -> Mask:
    """Samples of a move under way between two times [s]."""
    return (whole.window.t > since) & (whole.window.t < until) & whole.window.active


def _as_fast(earlier: Mask, later: Mask, lost: float, window: LogSamples, told: bool) -> bool:
    """Whether a mass has kept its speed, and a command that is told, but for a part of a share that was lost."""
    if not earlier.any() or not later.any():
        return False
    asked = float(window.w_cmd[earlier].mean()), float(window.w_cmd[later].mean())
    moved = slope_of(window.t[earlier], window.z[earlier, 2]), slope_of(window.t[later], window.z[later, 2])
    if moved[0] is None or moved[1] is None:
        return False
    pairs = [(moved[0], moved[1]), asked] if told else [(moved[0], moved[1])]
    return all(abs(b - a) < KEEPS * lost * abs(a) for a, b in pairs)


def _is_near(drift: tuple[float, float] | None, expected: float, noise: float) -> bool | None:
    """Whether a position drifts at rest as expected [m/s], or stands; None where its noise [m] leaves both."""
    if drift is None or abs(expected) < 2.0 * Z_REST * drift[1] * noise:
        return None
    return abs(drift[0] - expected) < 0.5 * abs(expected)


def _begins_at_rest(path: Path, whole: WholeMove) -> bool:
    """Whether a path begins in the rest after the move, and not while the motor stops."""
    return path.begin > whole.moving + 2 * LEFT


def _unexplained(event: Event, path: Path, whole: WholeMove) -> Event:
    """The event where something came that none of the hypotheses explains."""
    t, at_rest = whole.window.t, _begins_at_rest(path, whole)
    return event._replace(
        label=UNKNOWN, channel=None, probability=SURE, posterior=mostly(UNKNOWN, event),
        onset_s=float(t[max(path.begin - 1, 0)]), onset_interval_s=(float(t[max(path.first - 1, 0)]), float(t[path.last])),
        over_s=None if path.end is None or whole.lasts(path) else float(t[path.end]), detected_s=event.doubted_s, isolated_s=None,
        reasons=OF_THE_REST if at_rest else ("something happened in the move that no hypothesis explains",),
    )  # fmt: skip
