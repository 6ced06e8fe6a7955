"""The last word on a move: what the bank left without a name, or doubted for a moment, by every path of the whole move.

The bank knows faults of the rig file's size that stay; here a fault has any severity, may have come for a while, and has a
label that needs the whole move. Verdicts that the bank is sure of stand.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank, Hypothesis, of_a_move, other_laws
from observer_fi.logs import quarter_of_a_ring
from observer_fi.numerics import digits
from observer_fi.physics import FAULTS, NOMINAL, PARAMETERS, UNKNOWN, OwnState, Rig, channel_of, label_of
from observer_fi.records import Event, Severity
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.drift import COMES_AND_GOES, STOP_S, SURE, jammed_before, mostly, or_else
from observer_fi.verdict.isolate import AT_START_S, healthy
from observer_fi.verdict.moves.second_fault import (
    MISFIT,
    SUSPECT,
    WINDOW_S,
    behind,
    first_misfit,
    lasted,
    until,
)
from observer_fi.verdict.moves.stories import (
    AT_WILL,
    Story,
    constant,
    follows_whole,
    in_order,
    load_of_a_spring,
    measured,
    of_any_decade,
    posterior_of,
    special_case,
    takes_up_any_load,
    worth,
)
from observer_fi.verdict.moves.whole_move import (
    HOPELESS,
    LEFT,
    SETTLED_S,
    STRIDE,
    WELL,
    Path,
    WholeMove,
    window_of,
)
from observer_fi.verdict.onset import Filters

# Where a fault may have begun: this long before the bank's first doubt, more where it is found at the edge, and after it.
BEFORE_S, EDGE_S, AFTER_S = (0.2, 3.0, 30.0), 0.05, 0.05
MOST_IN_DOUBT, MOST_SURE = 20, 2  # moves of a label that are asked in a log
PASSES_S = 0.03  # what is over so soon passed, and condemns no move
# Mean NIS over its expectation: of nominal in the motion before a fault and of the fault while it lasts. Where the rig file
# does not describe the machine, both are above, and a name would be made up.
FITS = 1.3
CLEAN_S = 0.05  # of motion that nominal must have explained before a fault
FAR = 200.0  # times the nats of another fault, that one must have for which no motion speaks before it
BELIEVABLE = 3.0  # standard deviations by which a constant may be beyond what is believable
Z95 = 1.959964
AT_REST, Z_REST = 8, 4.0  # samples of a rest that tell a drift, and standard deviations
STOPPED_S = 0.05  # before the motor is stopped: what begins then shows in the stop, of which the bank takes no evidence
# What begins within this of the stop gains by a speed in doubt anew: 39 nats in healthy moves at 10 rad/s, 53 with gains that
# are off. It must have so many times the nats of another fault.
STOPPING_S, IN_A_STOP = 0.01, 10.0


SHOWS_A_STOP = 0.5  # of the time in which a servo brakes: samples farther apart do not show how it stops
NONE_AT_ZERO = {"torque", "rate", "C", "E"}  # sizes that a fault without any has
SECONDS = 3  # labels that may be the second of two faults
TOGETHER_S = 0.1  # between the begins of two faults that may be one
CLEARLY = (
    6.0  # times the nats of another fault, by which two explain what one whose size changes does as well
)
# Faults that are small before they are great, and the nats over health from which one of them may be: of 120 healthy moves none
# has 3.
A_LITTLE_OF, A_LITTLE = ("slip", "jam"), 5.0
BLIND = 1e-3  # probability from which a lost coupling is as good as a frozen position


class Explained(NamedTuple):
    """nats: of the samples of a move in motion under what explains it best. gain: how much of that is over nominal."""

    nats: float
    gain: float


class Pair(NamedTuple):
    """A move with two faults, and what they explain of it."""

    event: Event
    explained: Explained


class LastWord:
    """Asks whole moves; filters are made once a log."""

    def __init__(self, rig: Rig, filters: Filters, settings: DecisionSettings) -> None:
        self.rig, self.filters, self.settings = rig, filters, settings
        self.stop_s = STOP_S if rig.driven.servo else 0.0  # how an unknown servo stops, no model says
        self.stop_step_s = SHOWS_A_STOP * quarter_of_a_ring(rig.model) or math.inf  # nobody knows of others
        self.hypotheses: tuple[Hypothesis, ...] = ()
        self.laws: tuple[Hypothesis, ...] = ()
        self.asked: Counter[str] = Counter()
        self.explained: dict[float, Explained] = {}  # moves, by their starts

    def needed(self, event: Event) -> bool:
        """Whether the bank left the move without a name, doubted a healthy one for a moment, or named a fault that has a size.

        A position that lies may be a nut that slips, of which the bank knows nothing.

        In a log of many such moves the first ones are asked: the others cost as much again and say the same.
        """
        in_doubt = event.label in (NOMINAL, UNKNOWN)
        if self.asked[event.label] >= (MOST_IN_DOUBT if in_doubt else MOST_SURE):
            return False
        if event.label == NOMINAL:
            return event.doubted_s is not None
        return in_doubt or event.channel == "position" or any(own.tells for own in FAULTS[event.label].sizes)

    def on(self, event: Event, bank: Bank) -> Event:
        """The event as the whole move has it; as it is where the move is no longer at hand or says nothing else."""
        self.asked[event.label] += 1
        doubted = event.doubted_s if event.label == NOMINAL else event.detected_s or event.doubted_s
        if doubted is None:
            return event
        told = self._asked(event, bank, doubted, self.stop_s if event.label == NOMINAL else 0.0)
        stopped = told.label == UNKNOWN and event.label == UNKNOWN and self._in_the_stop(doubted, event, bank)
        return self._asked(event, bank, doubted, self.stop_s) if stopped else told

    def _in_the_stop(self, doubted: float, event: Event, bank: Bank) -> bool:
        """Whether a doubt came just before the motor was stopped, or later."""
        found = window_of(event, bank)
        return found is not None and doubted > found[0].t[-1] - STOPPED_S

    def _asked(self, event: Event, bank: Bank, doubted: float, rest_s: float) -> Event:
        """The event as the move has it with so much of the stop and the rest after it."""
        whole = self._move(event, bank, rest_s)
        if whole is None:
            return event
        paths, stories = self._near(doubted, event, whole)
        named = any(story.mode != UNKNOWN for story in stories)
        if not named and any(self._counts(path, whole, event) for path in paths):
            stories = self._later(stories, event, whole)
        if not stories and whole.n > whole.moving and doubted < whole.window.t[whole.moving - 1] - STOPPED_S:
            stopped = self._of_the_stop(whole)
            paths, stories = [*paths, *stopped], self._told_by(stopped, whole, event)
        stories = in_order(list(self._of_sensor_or_nut(stories, whole, bank, event)))
        two = self._two(paths, stories, event, whole)
        if two is not None:
            self.explained[event.start_s] = two.explained
            return two.event
        if stories:
            gain = stories[0].gain
            self.explained[event.start_s] = Explained(whole.in_motion() + gain, gain)
            return self._told(event, stories, whole)
        counted = [path for path in paths if self._counts(path, whole, event)]
        if event.label == NOMINAL and counted and self._without_a_name(counted[0], whole):
            return _unexplained(event, counted[0], whole)
        if event.label == UNKNOWN and self._settles(doubted, event, whole):
            limit = self.settings.strain_limit
            slope = whole.direction(whole.moving - 1) * float(whole.window.theta[whole.moving - 1])
            jammed = jammed_before(healthy(event), whole.memories[-1], whole.nominal, self.rig, limit, slope)
            if jammed.label != NOMINAL:
                return jammed
            if not counted and first_misfit(whole.nis, whole.expected(whole.nominal), whole) is None:
                return (
                    jammed  # the ring of a soft start, which nominal explains as well as the rest of the move
                )
        if event.label == NOMINAL:
            return self._or_a_little(event, paths, whole)
        fits = float(whole.nis.mean()) <= FITS * whole.expected(whole.nominal)
        return healthy(event) if event.label != UNKNOWN and not counted and fits else event

    def _or_a_little(self, event: Event, paths: Sequence[Path], whole: WholeMove) -> Event:
        """Health, or else the fault that explains it better by less than chance may where a begin is sought in every doubt."""
        for path in paths[:1]:
            label, t = path.hypothesis.label, whole.window.t
            ends = whole.moving - round(STOPPED_S / whole.interval)
            in_motion = t[path.begin] >= event.start_s + SETTLED_S and path.begin < ends
            enough = A_LITTLE if in_motion else self.settings.move_nats
            shows = in_motion or _shown(path) >= self.settings.move_nats
            fits = path.nis <= WELL * whole.expected(path.hypothesis) and whole.lasts(path)
            if (
                label in A_LITTLE_OF
                and path.gain >= enough
                and shows
                and fits
                and any(self._stories(path, whole))
            ):
                return or_else(
                    event,
                    label,
                    f"{FAULTS[label].words} may have begun at {t[path.begin]:.3f} s, by too little to say so",
                )
        return event

    @staticmethod
    def _of_the_stop(whole: WholeMove) -> list[Path]:
        """Paths whose fault begins as the motor is about to be stopped, or while it is."""
        return whole.paths(whole.moving - round(STOPPED_S / whole.interval), whole.moving + 2 * LEFT)

    def _two(
        self, paths: Sequence[Path], stories: Sequence[Story], event: Event, whole: WholeMove
    ) -> Pair | None:
        """The event with a second fault behind the first one, where that explains the move only until then; else None.

        Where the free hypothesis follows the move better than the best name does, two faults may have met there.
        """
        named = bool(stories) and not takes_up_any_load(stories[0].path)
        found = self._suspected(stories, event, whole) if named else None
        more = self.settings.move_nats
        if found or (named and paths[0].gain < stories[0].gain + more):
            return found
        firm = (p for p in reversed(paths) if not takes_up_any_load(p) and self._counts(p, whole, event))
        tried = sorted({p.hypothesis.label: p for p in firm}.values(), key=lambda p: -p.gain)
        # of a lesser fault before it a great one leaves no trace
        before = [p.first - STRIDE for p in tried[:SECONDS]]
        if tried and tried[0].end is not None:  # it seems over where another one takes its place
            before.insert(0, tried[0].end - STRIDE)
        found = self._behind(tried, before, stories, event, whole)
        at_will = named or (found is not None and found.event.then[0].label == UNKNOWN)
        least = -math.inf if not stories else stories[0].gain + more if at_will else worth(stories[0])
        return found if found and found.explained.gain >= least else None

    def _suspected(self, stories: Sequence[Story], event: Event, whole: WholeMove) -> Pair | None:
        """A second fault where the best story no longer explains the move, or only by a size that changes there."""
        told = [stories[0].path]
        found = self._behind(told, (), stories, event, whole)
        if found is not None or not any(own.growth for own in told[0].hypothesis.own):
            return found
        found = self._behind(told, (), stories, event, whole, SUSPECT)
        enough = stories[0].gain + CLEARLY * self.settings.move_nats
        return found if found and found.explained.gain >= enough else None

    def _behind(
        self,
        tried: Sequence[Path],
        before: Sequence[int],
        stories: Sequence[Story],
        event: Event,
        whole: WholeMove,
        misfit: float = MISFIT,
    ) -> Pair | None:
        """A second fault from where one of some paths no longer explains the move, or from one of some samples on."""
        ends = {found.until for p in tried if (found := lasted(p, whole, misfit)) is not None}
        stops = [end - round(WINDOW_S / whole.interval) for end in sorted(ends, reverse=True)[:SECONDS]]
        at_once: list[Pair] = []
        for stop in (*stops, *before):
            pair = self._pair(event, whole, stop)
            if pair is not None and not _together(pair.event):
                return pair
            at_once += [] if pair is None else [pair]
        one = bool(stories) and stories[0].mode != UNKNOWN  # an obstacle that comes with a load is one fault
        return at_once[0] if at_once and not one else None

    def _pair(self, event: Event, whole: WholeMove, stop: int, again: bool = True) -> Pair | None:
        """The event with the fault that explains the move as far as a sample, and another behind it; None without either."""
        shorter = until(whole, stop)
        if shorter is None:
            return None
        first = self._one(event, shorter, 0, shorter.n)
        if first is None or first[0].label == UNKNOWN:
            return None
        told, path = first
        held = lasted(path, whole)
        rest = None if held is None else behind(held, whole)
        if held is None or rest is None:
            return None
        about = held.until - held.since
        healthy = event._replace(label=NOMINAL, start_s=float(rest.window.t[0]))
        before, window = (round(time / whole.interval) for time in (BEFORE_S[0], WINDOW_S))
        second = self._one(healthy, rest, about - before, about + window + LEFT)
        if second is None:
            return None
        later = second[0]._replace(start_s=event.start_s)
        both = told._replace(then=(_stands_in_a_jam(later) if told.label == "jam" else later,))
        behind_it = rest.in_motion() - rest.in_motion(max(shorter.n - held.since, 0))
        nats = shorter.in_motion() + path.gain + behind_it + second[1].gain
        pair = Pair(both, Explained(nats, nats - whole.in_motion()))
        begun = held.since + second[1].begin
        if again and begun < stop:  # what came first is told from what was before the second one
            return self._pair(event, whole, begun, again=False) or pair
        return pair

    def _one(self, event: Event, whole: WholeMove, first: int, last: int) -> tuple[Event, Path] | None:
        """The event with the best story that begins between two samples, and its path; None where there is none."""
        stories = in_order(self._told_by(whole.paths(first, last), whole, event))
        return (self._told(event, stories, whole), stories[0].path) if stories else None

    def _without_a_name(self, path: Path, whole: WholeMove) -> bool:
        """Whether nominal, which fits elsewhere, is far off while a path lasts that fits no better."""
        if path.begin > whole.moving + 2 * LEFT:  # at rest a drive may be switched off
            return False
        last = whole.n if path.end is None else path.end
        elsewhere = np.concatenate((whole.nis[: path.begin], whole.nis[last:]))
        clean = elsewhere.size > 0 and float(elsewhere.mean()) <= FITS * whole.expected(whole.nominal)
        return clean and path.gain >= FAR * self.settings.move_nats

    def _settles(self, doubted: float, event: Event, whole: WholeMove) -> bool:
        """Whether the doubt was of the start, and nominal fits once the ring is over: it has taken up what was wrong."""
        settled = event.start_s + SETTLED_S
        later = whole.nis[int(np.searchsorted(whole.window.t, settled)) : whole.moving]
        return doubted < settled and bool(later.size) and later.mean() <= FITS * whole.expected(whole.nominal)

    def _of_sensor_or_nut(
        self, stories: Sequence[Story], whole: WholeMove, bank: Bank, event: Event
    ) -> Iterator[Story]:
        """Stories with those of a slip decided by the rest after the move: a nut stands there, a sensor that drifts goes on.

        At one speed the two look alike; without a rest both are told.
        """
        drift = _drift_at_rest(bank, event.end_s, whole)
        for story in stories:
            if story.mode != "slip" or not whole.lasts(story.path):
                yield story
                continue
            lost = constant(story.path, next(own for own in story.path.hypothesis.own if own.name == "E"))[0]
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
            stories = self._told_by(paths, whole, event)
            edge = bool(paths) and whole.window.t[paths[0].begin] <= since + EDGE_S
            if since <= event.start_s or (not edge and (stories or before == BEFORE_S[1])):
                break
        return paths, stories

    def _later(self, stories: list[Story], event: Event, whole: WholeMove) -> list[Story]:
        """Stories of faults after the ring of the start where they are as good: the doubt was of the ring."""
        first = int(np.searchsorted(whole.window.t, event.start_s + SETTLED_S))
        later = [path for path in whole.paths(first, whole.n) if path.begin >= first]
        found = self._told_by(later, whole, event)
        best = max((story.gain for story in stories), default=-math.inf)
        return found if any(story.gain >= best for story in found) else stories

    def _counts(self, path: Path, whole: WholeMove, event: Event) -> bool:
        """Whether the path is better than nominal by more than chance, and more than the ring of a start.

        Whatever is entered there begins anew with a speed in doubt, and gains by that: a fault goes on to gain, and a size
        that stands shows; and in a stop.
        """
        if _passes(path, whole, event.start_s):
            return False
        if whole.n > whole.moving and path.begin >= whole.moving - round(STOPPING_S / whole.interval):
            more = max(_shown(path), path.later)
            return min(path.gain, more) >= IN_A_STOP * self.settings.move_nats
        rings = whole.window.t[path.begin] < event.start_s + SETTLED_S
        stands = all(own.growth == 0.0 for own in path.hypothesis.own)
        more = min(path.later, _shown(path) if stands else math.inf) if rings else math.inf
        return min(path.gain, more) >= self.settings.move_nats

    def _move(self, event: Event, bank: Bank, rest_s: float = 0.0) -> WholeMove | None:
        """The move from a rest before it to its last sample under way, or so long into the rest after it."""
        found = window_of(event, bank, rest_s)
        if found is not None and rest_s and float(np.median(np.diff(found[0].t))) > self.stop_step_s:
            found = window_of(event, bank)
        if found is None:
            return None
        self.hypotheses = self.hypotheses or of_a_move(self.rig, self.filters.settings)
        self.laws = self.laws or other_laws(self.rig, self.filters.settings)
        return WholeMove(self.hypotheses, *found, self.filters, self.laws)

    def _told_by(self, paths: Sequence[Path], whole: WholeMove, event: Event) -> list[Story]:
        """What paths may be called, where the best of all is one that fits: what is worse has no say, whatever it is called.

        A load and a slip at will fit everything: no verdict that the bank is sure of gives way to them.
        """
        sure = event.label not in (NOMINAL, UNKNOWN)
        paths = paths if sure else self._seen_to_begin(paths, whole, event)
        if not paths or not any(self._fits(path, whole, event) for path in _as_good(paths)):
            return []
        if sure and paths[0].hypothesis.label == UNKNOWN:
            return []
        told = [p for p in paths if not (sure and p.hypothesis.label == UNKNOWN)]
        swings = self._swings(paths, whole)
        told = [p for p in told if not (swings and p.hypothesis.label == "jam")]
        stories = [story for p in told if self._fits(p, whole, event) for story in self._stories(p, whole)]
        return [story for story in stories if measured(story, whole)]

    @staticmethod
    def _swings(paths: Sequence[Path], whole: WholeMove) -> bool:
        """Whether the best jam drives the motion for a while: then none of them is one, whatever friction they began with."""
        best = next((p for p in paths if p.hypothesis.label == "jam"), None)
        return best is not None and any(
            whole.turns(best, own) for own in best.hypothesis.own if own.of_friction
        )

    def _seen_to_begin(self, paths: Sequence[Path], whole: WholeMove, event: Event) -> Sequence[Path]:
        """The paths without those from the start on where one that begins in motion says as much: what grows was first less.

        From the start on a fault and a rig file that is off look alike.
        """
        seen = [p for p in paths if whole.window.t[p.begin] - event.start_s >= CLEAN_S]
        if not seen or seen[0] is paths[0] or self._fits(paths[0], whole, event):
            return paths
        return seen if seen[0].gain >= HOPELESS * paths[0].gain else paths

    def _fits(self, path: Path, whole: WholeMove, event: Event) -> bool:
        """Whether the path wins, the whole move fits it, and it is more than the ring of a start.

        Another name than the bank's needs motion before the fault that nominal explains.
        """
        if not self._counts(path, whole, event):
            return False
        if path.nis > FITS * whole.expected(path.hypothesis) or whole.reads_as_usual(path):
            return False
        return path.hypothesis.label == event.label or self._clean(path, whole, event.start_s)

    def _stories(self, path: Path, whole: WholeMove) -> Iterator[Story]:
        """What a path may be called: the fault that it was made for, or one that is a special case of it.

        A soft stop without stiffness is a slip; a mass that has lost all its travel without any change of the load is a position
        that stands still, and one that outruns the motor a position that is wrong. The evidence of a special case is the
        posterior density of its constant over the prior one (Dickey 1971). A mass that stands while the load grows is none of
        these.
        """
        mode, held = path.hypothesis.name, {own.name: own for own in path.hypothesis.own}
        if _stands_under_load(path) or self._load_in_a_stop(path, whole):
            return
        if all(self._believable(path, own, whole) for own in held.values()) and _resists(path):
            yield Story(mode, path.gain + self._as_in_the_file(path), path)
        if "E" not in held:
            return
        lost, std = constant(path, held["E"])
        if "C" in held and "torque" not in held and self._believable(path, held["E"], whole):
            yield Story("slip", path.gain + special_case(path, held["C"], 0.0), path)
        if abs(lost - 1.0) < BELIEVABLE * std:
            yield Story("sensor:position", path.gain + special_case(path, held["E"], 1.0), path)
        elif lost < -BELIEVABLE * std:
            yield Story("sensor:position", path.gain, path)

    @staticmethod
    def _load_in_a_stop(path: Path, whole: WholeMove) -> bool:
        """Whether an obstacle with a load in front of it begins as the motor stops: it follows whatever a stop does."""
        begins = path.begin >= whole.moving - round(STOPPED_S / whole.interval)
        return begins and path.hypothesis.label != UNKNOWN and takes_up_any_load(path)

    def _as_in_the_file(self, path: Path) -> float:
        """Nats by which the sizes that the rig file gives explain the move better, half of all faults having them."""
        usual = {own.name: self.rig.spread(own.name) for own in FAULTS[path.hypothesis.label].states}
        nats = any_size = 0.0
        for own in path.hypothesis.own:
            value, std = constant(path, own)
            any_size += of_any_decade(path, own)
            if own.name not in usual or own.std is None or not usual[own.name]:
                continue
            given = self.rig.model[own.name] if own.absolute else 1.0
            near = math.hypot(std, usual[own.name] * given)
            wide = math.hypot(std, own.std)
            nats += (
                0.5 * ((value - own.mean) / wide) ** 2
                - 0.5 * ((value - given) / near) ** 2
                + math.log(wide / near)
            )
        return float(np.logaddexp(nats, any_size)) - math.log(2.0)

    @staticmethod
    def _believable(path: Path, own: OwnState, whole: WholeMove) -> bool:
        value, std = constant(path, own)
        value *= whole.against(path) if own.of_friction else 1.0
        if path.hypothesis.label == "jam" and own.of_friction and value <= 0.0:
            return False
        if own.name == "A_decoupled":  # a share of the friction that the rig has on that day
            value /= max(whole.friction(path.begin), 1.0)
        return own.low - BELIEVABLE * std <= value <= own.high + BELIEVABLE * std

    def _clean(self, path: Path, whole: WholeMove, start_s: float) -> bool:
        """Whether nominal explains the motion before the fault, and there was some; or there was none, and only the fault fits.

        A fault that is there from the start must win by far: a rig file that is off also shows from the start.
        """
        first = int(np.searchsorted(whole.window.t, start_s))
        if whole.window.t[path.begin] - start_s < CLEAN_S:
            fits = path.nis <= WELL * whole.expected(path.hypothesis) and not self._is_of_the_rig(path, whole)
            return fits and whole.lasts(path) and path.later >= FAR * self.settings.move_nats
        return float(whole.nis[first : path.begin].mean()) <= FITS * whole.expected(whole.nominal)

    def _is_of_the_rig(self, path: Path, whole: WholeMove) -> bool:
        """Whether a friction that was up from the start on is one that this rig may have, as far as it is known by then."""
        rises = [own for own in path.hypothesis.own if own.of_friction]
        if path.hypothesis.label != "jam" or not rises:
            return False
        friction = (self._friction(path)[0] + constant(path, rises[0])[0]) / self.rig.model["A"]
        usual, doubt = whole.drag(path.begin)
        return friction - usual < max(self.settings.strain_limit * doubt, COMES_AND_GOES)

    def _told(self, event: Event, stories: Sequence[Story], whole: WholeMove) -> Event:
        """The event with the label, times and severity of the best story."""
        best, t = stories[0], whole.window.t
        path, label = best.path, label_of(best.mode)
        posterior = posterior_of(event, stories)
        sizes = path.hypothesis.own if path.hypothesis.label == label else FAULTS[label].sizes
        tells = [own for own in sizes if own.tells and own.name in path.hypothesis.states]
        told = event._replace(
            label=label, channel=channel_of(best.mode), probability=posterior[label], posterior=posterior,
            over_s=None if path.end is None or whole.lasts(path) else float(t[path.end]),
            alike=tuple(k for k, p in posterior.items() if k != label and p > self._least({label, k}, best.mode)),
            severity=tuple(self._severity(path, own, whole) for own in tells),
        )  # fmt: skip
        begin, first = float(t[max(path.begin - 1, 0)]), float(t[max(path.first - 1, 0)])
        if begin - event.start_s < AT_START_S:  # no motion before it: it may be as old as the rest
            moved = np.flatnonzero((t < event.start_s) & (whole.window.w_cmd != 0.0))
            first = float(t[moved[-1] if moved.size else 0])
        told = told._replace(onset_s=begin, onset_interval_s=(first, float(t[path.last])))
        if label == event.label and label != UNKNOWN:
            return (
                told
                if told.alike
                else told._replace(probability=event.probability, posterior=event.posterior)
            )
        return told._replace(
            isolated_s=None, detected_s=event.detected_s or event.doubted_s,
            reasons=(_why(best, whole),) if label != UNKNOWN else event.reasons,
        )  # fmt: skip

    def _least(self, labels: set[str], mode: str) -> float:
        """Probability from which one label is as good as another: of a lost coupling and a frozen position a small one.

        Only what the motor feels without the mass tells those two apart, and that may be what it felt with it.
        """
        blind = labels == {"coupling_loss", "sensor_fault"} and channel_of(mode) in (None, "position")
        return min(BLIND, self.settings.alike) if blind else self.settings.alike

    def _severity(self, path: Path, own: OwnState, whole: WholeMove) -> Severity:
        value, std = constant(path, next(state for state in path.hypothesis.own if state.name == own.name))
        scale, unit = 1.0, "1"
        if own.of_friction:
            friction, doubt = self._friction(path)
            scale = whole.against(path) / friction
            std = math.hypot(std, value * doubt)
        elif own.told_as is not None:
            scale, unit = own.told_as.value(path.hypothesis.model), own.told_as.unit
        elif not own.absolute:
            scale, unit = self.rig.model[own.name], PARAMETERS[own.name][0]
        said = (scale * value, unit)
        if own.told_as is not None:
            said = (value * own.told_as.in_words(path.hypothesis.model), own.told_as.unit_in_words)
        value, half = scale * value, Z95 * abs(scale) * std
        return Severity(own.tells, value, (value - half, value + half), unit, own.says(*said))

    def _friction(self, path: Path) -> tuple[float, float]:
        """Friction of the healthy rig as the move has it [N m], and the relative standard deviation of that."""
        usual, states = self.rig.model["A"], path.hypothesis.states
        if "A" not in states:
            return usual, self.rig.spread("A")
        k = states.index("A")
        factor = float(path.memory.x[k])
        return usual * factor, math.sqrt(max(float(path.memory.P[k, k]), 0.0)) / factor


def _as_good(paths: Sequence[Path]) -> list[Path]:
    """The best path and those of its label that begin at another sample and gain next to as much."""
    best = paths[0]
    return [
        p
        for p in paths
        if p.hypothesis.label == best.hypothesis.label and p.gain >= (1.0 - AT_WILL) * best.gain
    ]


def _shown(path: Path) -> float:
    """Most nats by which the sizes that a path found are not none: of its gain, what is not of having begun anew.

    In a start or a stop a mass sticks sooner or later than nominal foresees, and every fault that is entered there gains
    alike. Of a lost coupling no size is none.
    """
    sizes = [constant(path, own) for own in path.hypothesis.own if own.name in NONE_AT_ZERO]
    return sum(0.5 * (value / std) ** 2 for value, std in sizes if std) if sizes else math.inf


def _resists(path: Path) -> bool:
    """Whether a spring has shown its stiffness: one of none is a slip, and a load before it that the mass follows a jam.

    Where the mass loses travel by it, a load will do.
    """
    own = {o.name: o for o in path.hypothesis.own}
    if "C" not in own or own["C"].told_as is None:
        return True
    value, std = constant(path, own["C"])
    if "torque" in own and not follows_whole(path):
        value, std = load_of_a_spring(path)
    return value > BELIEVABLE * std


def _together(pair: Event) -> bool:
    """Whether two faults of a move begin at one time."""
    begins = [event.onset_s for event in (pair, *pair.then) if event.onset_s is not None]
    return float(np.ptp(begins)) < TOGETHER_S


def _stands_under_load(path: Path) -> bool:
    """Whether a path takes a mass that has lost all its travel for one that presses against something."""
    own = {o.name: o for o in path.hypothesis.own}
    if not {"C", "E"} <= own.keys():
        return False
    (lost, std), (stiff, doubt) = constant(path, own["E"]), constant(path, own["C"])
    return lost > 1.0 - BELIEVABLE * std and stiff > BELIEVABLE * doubt


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
    if t.size < AT_REST:
        return None
    off = t - t.mean()
    return float(off @ x / (off @ off)), float(1.0 / math.sqrt(off @ off))


def _is_near(drift: tuple[float, float] | None, expected: float, noise: float) -> bool | None:
    """Whether a position drifts at rest as expected [m/s], or stands; None where its noise [m] leaves both."""
    if drift is None or abs(expected) < 2.0 * Z_REST * drift[1] * noise:
        return None
    return abs(drift[0] - expected) < 0.5 * abs(expected)


def _passes(path: Path, whole: WholeMove, start_s: float) -> bool:
    """Whether the path is over before the ring of a start is, or as soon as it has begun."""
    if path.end is None:
        return False
    begin, end = whole.window.t[path.begin], whole.window.t[path.end]
    return bool(end < start_s + SETTLED_S or end - begin < PASSES_S)


def _stands_in_a_jam(later: Event) -> Event:
    """A position that stands behind a jam: a motor that turns freely may feel the jam, as with a dead sensor; both are told."""
    if later.channel != "position" or later.alike:
        return later
    posterior = dict.fromkeys(later.posterior, 0.0) | {later.label: 0.5, "coupling_loss": 0.5}
    return later._replace(probability=0.5, posterior=posterior, alike=("coupling_loss",))


def _unexplained(event: Event, path: Path, whole: WholeMove) -> Event:
    """The event where something came that none of the hypotheses explains."""
    t = whole.window.t
    return event._replace(
        label=UNKNOWN, channel=None, probability=SURE, posterior=mostly(UNKNOWN, event),
        onset_s=float(t[max(path.begin - 1, 0)]), onset_interval_s=(float(t[max(path.first - 1, 0)]), float(t[path.last])),
        over_s=None if path.end is None or whole.lasts(path) else float(t[path.end]), detected_s=event.doubted_s, isolated_s=None,
        reasons=("something happened in the move that no hypothesis explains",),
    )  # fmt: skip


def _why(best: Story, whole: WholeMove) -> str:
    while_it = "" if whole.lasts(best.path) else " for a while"
    powers = digits(best.gain / math.log(10.0))
    return f"the whole move says so: with this fault{while_it} it is likelier by {powers} powers of ten than without"
