"""What a whole move says: nominal until a fault begins, the fault until it ends or the move does.

The bank is the fast first word and the only one of a stream; this is the last one where the move is at hand. A path is
a hypothesis with its begin and end; its gain over nominal is the difference of the log-likelihoods of every sample of the
move, less the price of each change at an unknown time. Filters that run side by side try many begins and ends at once.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import Bank, Hypothesis, HypothesisState, LogSamples
from observer_fi.numerics import MOST
from observer_fi.physics import INDEX, OwnState
from observer_fi.records import Array, Event
from observer_fi.verdict.drift import risen_drag
from observer_fi.verdict.drive_off import until_off, zero_of
from observer_fi.verdict.onset import ROOM, Entry, Filters

STRIDE = 16  # samples between the memories that are kept of a filter
CHANGE_NATS = 7.0  # a begin or an end may lie at any of some thousand samples
# Begins that a first look tries at most, or two in the samples that it looks at: filters run MOST at once.
TRIALS = 2 * MOST
# After a begin, by which a fault that comes for a while shows; beside them the whole move.
LOOKS_S = (0.03, 0.125, 1.0)
SETTLED_S = 0.15  # by then the ring of a start is over
JUMP_DEG = 1.0  # of the pitch from one sample to the next: a rig that was set up anew as it stood, which tells of no move
LEFT = 32  # samples of the move that a fault must have
# A path fits below this times the expected NIS; a begin is not followed below this share of the best.
WELL, HOPELESS = 1.2, 0.7
BY_CHANCE = 3.0  # standard deviations by which a fault of the right law may fit worse than nominal before it
# A sample, that a sensor which failed without any misfit gains where its noise is less than it should be: 0.03 in a healthy move,
# and 0.12 of readings in steps, whose error is the same for a while. One that repeats itself to the last digit gains several.
LITTLE_NATS, LITTLE_OF_STEPS = 0.1, 0.5
DRIVES = 4.0  # standard deviations beyond none, at which a torque drives the motion
# Mean NIS over its expectation: of nominal in the motion before a fault and of the fault while it lasts. Where the rig file
# does not describe the machine, both are above, and a name would be made up.
FITS = 1.3
STOPPED_S = 0.05  # before the motor is stopped: what begins then shows in the stop, of which the bank takes no evidence
AT_SPEED = 0.9  # of the speed before a stop: below it the motor brakes
KEPT = 5  # hypotheses of each look that are followed to the end
ROUNDS, ROUND_NATS = 4, 1.0  # of an iterated filter, and what a round must gain for another one


class Path(NamedTuple):
    """One way in which a move may have gone. begin, end: samples of the window, end None where it lasted to the last.

    first, last: samples that hold the begin with 95 %.
    gain: nats over nominal, less the price of its changes. memory: of the fault's filter when it ended. nis: mean normalised
    innovation squared of the fault's filter while it lasted. later: nats of the gain that came
    `SETTLED_S` or more after the begin, also behind its end. before: share of the travel that a fault before it takes.
    moving: nats of the gain that came while the motor was under way.
    """

    hypothesis: Hypothesis
    begin: int
    end: int | None
    gain: float
    memory: HypothesisState
    nis: float
    later: float
    first: int = 0
    last: int = 0
    before: float = 0.0
    moving: float = math.inf


class Begin(NamedTuple):
    """A hypothesis with its begin, the samples that hold it with 95 %, and what it found of its constants."""

    hypothesis: Hypothesis
    begin: int
    first: int
    last: int
    near: HypothesisState | None


def window_of(event: Event, bank: Bank, rest_s: float = 0.0) -> tuple[LogSamples, HypothesisState] | None:
    """The samples of a move from a rest before it to its last one under way, and nominal's memory before them.

    rest_s: so long the stop and the rest after it belong to them. None where they are no longer at hand.
    """
    recent = bank.recent
    starts = [(t, m) for t, m in bank.snapshots if t <= event.start_s]
    if recent is None or not starts or recent.t[0] > starts[-1][0] + 1e-9:
        return None
    since, memory = starts[-1]
    under_way = np.flatnonzero(recent.active & (recent.t <= event.end_s))
    first = int(np.searchsorted(recent.t, since - 1e-9))
    if not under_way.size or under_way[-1] + 1 - first < 2:
        return None
    last = int(under_way[-1])
    stopped = min(event.end_s, float(recent.t[last]) + rest_s)
    end = int(np.searchsorted(recent.t, stopped, "right"))
    interval = float(np.median(np.diff(recent.t[first:end])))
    zero = zero_of(recent.z[first : int(under_way[0]), :2])
    rest = until_off(recent.z[last + 1 : end, :2], bank.rig.noise_std[:2], interval, zero)
    if last + 1 + rest < end:  # while the motor rings a stop tells nothing
        end = last + 1 + (rest if rest * interval > SETTLED_S else 0)
    jumps = np.flatnonzero(np.abs(np.diff(recent.theta[last:end])) > JUMP_DEG)
    return recent.cut(first, last + 1 + int(jumps[0]) if jumps.size else end), memory


class WholeMove:
    """A move as samples from the rest before it to its last one under way, or on into the stop and the rest after it.

    hypotheses: those of the bank, nominal first. laws: other laws of those faults. memory: of nominal before the window's first
    sample. moving: samples up to the last one under way.
    """

    def __init__(
        self,
        hypotheses: Sequence[Hypothesis],
        window: LogSamples,
        memory: HypothesisState,
        filters: Filters,
        laws: Sequence[Hypothesis] = (),
    ) -> None:
        self.laws = tuple(laws)
        self.nominal, self.faults = hypotheses[0], tuple(hypotheses[1:])
        self.window, self.n, self.filters = window, window.t.size, filters
        under_way = np.flatnonzero(window.active)
        self.moving = int(under_way[-1]) + 1 if under_way.size else self.n
        self.zero = zero_of(window.z[: int(under_way[0]) if under_way.size else self.n, :2])
        self.interval = float(np.median(np.diff(window.t)))
        self.looks = tuple(max(LEFT, round(look / self.interval)) for look in LOOKS_S)
        self.memories, density, self.nis = self._follow(self.nominal, memory, 0)
        self.until = np.concatenate(([0.0], np.cumsum(density)))
        self.known = self._but_for_the_stop()
        self.before: dict[int, HypothesisState] = {}
        # what was asked before: windows of begins overlap
        self.found: dict[tuple[Hypothesis, int, int], Begin] = {}
        self.gained: dict[tuple[Hypothesis, bytes, int, int], float] = {}
        self.ended: dict[tuple[Hypothesis, bytes, int, int, int], Path] = {}

    def paths(self, first: int, last: int) -> list[Path]:
        """The best paths whose fault begins between two samples, the most likely first."""
        first, last = max(first, 0), min(last, self.n - LEFT)
        found: list[Path] = []
        if last <= first:
            return found
        for look in (self.n, *reversed(self.looks)):
            good = {
                (p.hypothesis.name, p.begin // STRIDE)
                for p in found
                if p.nis < WELL * self.expected(p.hypothesis)
            }
            begins = [
                self._refined(h, k, look)
                for h, k in self._promising(first, last, look)
                if not _near(h, k, good)
            ]
            stop = max((b.begin for b in begins), default=0) + look
            gains = [self._gains(b.hypothesis, [b.begin], look, stop, b.near)[b.begin] for b in begins]
            best = max(gains, default=0.0)
            same = {(p.hypothesis, p.begin) for p in found if not _constants_of(p.hypothesis)}
            for b, gain in zip(begins, gains, strict=True):
                if (b.hypothesis.name, b.begin // STRIDE) in good or (b.hypothesis, b.begin) in same:
                    continue
                if gain >= HOPELESS * best:
                    found.append(self._ended(b))
        settled = list(self._settled(found))
        return sorted((*settled, *self._by_other_laws(settled)), key=lambda path: -path.gain)

    def _by_other_laws(self, found: Sequence[Path]) -> Iterator[Path]:
        """The fault by its other laws, where it is the best or one that follows whatever comes is."""
        top = max(found, key=lambda path: path.gain, default=None)
        if top is None or top.gain <= 0.0:
            return
        for h in self.laws:
            if self._as_well(top) if top.hypothesis.label == h.label else not _follows(top.hypothesis):
                continue
            same = [p for p in found if p.hypothesis.label == h.label and p.gain >= HOPELESS * top.gain]
            best = max(same, key=lambda path: path.gain, default=top)
            yield self._again(self._ended(self._refined(h, best.begin, self.looks[-1])))

    def _settled(self, found: Sequence[Path]) -> Iterator[Path]:
        """The paths, and the best one of each name again from the constants that it found while it lasted.

        A look may go on behind the end of a fault, and what it finds there of its constants is of no fault at all.
        """
        yield from found
        best: dict[str, Path] = {}
        for path in sorted(found, key=lambda path: path.gain):
            best[path.hypothesis.name] = path
        top = max((path.gain for path in found), default=0.0)
        for path in best.values():
            if path.gain >= HOPELESS * top and _constants_of(path.hypothesis):
                yield self._again(path)

    def _again(self, path: Path) -> Path:
        """The path from its own constants and with the begin that they want, as long as that gains (an iterated filter)."""
        h = path.hypothesis
        for _ in range(ROUNDS):
            near = self._believable(h, path.memory)
            stop = min(path.begin + self.looks[-1], self.n if path.end is None else path.end)
            tried = range(max(path.begin - STRIDE + 1, 0), min(path.begin + STRIDE, stop - 1) + 1)
            gains = self._gains(h, tried, 0, stop, near)
            after = self._ended(_likely(h, gains, near))
            if after.gain < path.gain + ROUND_NATS:
                return max(path, after, key=lambda p: p.gain)
            path = after
        return path

    def _as_well(self, path: Path) -> bool:
        """Whether a fault explains its samples as well as nominal those before it: then it follows no other law."""
        last = self.n if path.end is None else path.end
        usual = float(self.nis[: path.begin].mean()) if path.begin > LEFT else self.expected(path.hypothesis)
        chance = math.sqrt(
            2.0 / max(usual, 1.0) * (1.0 / max(last - path.begin, 1) + 1.0 / max(path.begin, LEFT))
        )
        return path.nis <= usual * (1.0 + BY_CHANCE * chance)

    def entered(self, path: Path, near: HypothesisState | None = None) -> HypothesisState:
        """What the fault of a path remembers before its first sample, near the constants that it finds soon after it.

        near: what it found of them in another way.
        """
        if near is not None:
            return self._entry(path.hypothesis, self._believable(path.hypothesis, near))(
                self._nominal_at(path.begin)
            )
        look = min(self.looks[1], (self.n if path.end is None else path.end) - path.begin)
        near = self._constants(path.hypothesis, path.begin, look, None)
        return self._entry(path.hypothesis, near)(self._nominal_at(path.begin))

    def healed(self, path: Path) -> HypothesisState:
        """What nominal remembers where the fault of a path is over."""
        return self._back(path.hypothesis, self._nominal_at(path.begin))(path.memory)

    def followed(
        self, h: Hypothesis, memory: HypothesisState, first: int
    ) -> tuple[list[HypothesisState], Array]:
        """A filter's memories at every STRIDE samples from `first` on, and its normalised innovations squared."""
        memories, _, nis = self._follow(h, memory, first)
        return memories, nis

    def since(self, h: Hypothesis, begin: int) -> list[HypothesisState]:
        """A filter's memories at every STRIDE samples from a sample on at which its fault begins."""
        return self.followed(h, self._entry(h, None)(self._nominal_at(begin)), begin)[0]

    def _back(self, h: Hypothesis, before: HypothesisState) -> Entry:
        return Entry(h, self.nominal, self.filters, (self.nominal, before), within_s=self.interval)

    def friction(self, k: int) -> float:
        """Friction before sample k over that of the rig file: nominal's, and behind a jam what it rose by."""
        x, states = self._nominal_at(k).x, self.nominal.states
        usual = float(x[states.index("A")]) if "A" in states else 1.0
        risen = abs(float(x[states.index("torque")])) if self.nominal.label == "jam" else 0.0
        return usual + risen / self.nominal.model["A"]

    def drag(self, k: int) -> tuple[float, float]:
        """`friction` before sample k, and the doubt about what friction and gravity take together in the motion to come.

        Both in units of the rig file's friction. One move tells their sum, and nothing of the way back.
        """
        slope = self.direction(k) * float(self.window.theta[k])
        return self.friction(k), risen_drag(self.nominal, self._nominal_at(k), slope)[1]

    def lost(self, k: int) -> float:
        """Share of the travel that nominal loses before sample k: none, or that of a slip that takes its place."""
        share = next((own for own in self.nominal.own if own.name == "E"), None)
        if share is None:
            return 0.0
        return share.mean * float(self._nominal_at(k).x[self.nominal.states.index("E")])

    def in_motion(self, last: int | None = None) -> float:
        """Nats of the samples in motion, up to a sample, under nominal."""
        return float(np.diff(self.until)[:last][self.window.active[:last]].sum())

    def direction(self, k: int, end: int | None = None) -> float:
        """Sign of the way commanded from sample k to `end`; where none is, in a stop and the rest after it, of the speed before.

        What begins in a rest or at a reversal is about the motion behind it.
        """
        way = float(self.window.w_cmd[k:end].sum())
        if way != 0.0:
            return float(np.sign(way))
        commanded = np.flatnonzero(self.window.w_cmd[: min(k + 1, self.moving)])
        return float(np.sign(self.window.w_cmd[commanded[-1]])) if commanded.size else 0.0

    def against(self, path: Path) -> float:
        """Sign of the free torque of a path that is against the motion: friction is so either way."""
        return 1.0 if path.hypothesis.model["rubbing"] else self.direction(path.begin, path.end)

    def turns(self, path: Path, own: OwnState) -> bool:
        """Whether a torque that a fault adds to friction drives the motion for a while, as friction never does."""
        h, last = path.hypothesis, self.n if path.end is None else path.end
        memories, _ = self.followed(h, self.entered(path), path.begin)
        k = h.states.index(own.name)
        found = (
            (float(m.x[k]), float(m.P[k, k]))
            for m in memories[LEFT // STRIDE : (last - path.begin) // STRIDE]
        )
        return any(self.against(path) * value < -DRIVES * math.sqrt(max(var, 0.0)) for value, var in found)

    def reads_as_usual(self, path: Path) -> bool:
        """Whether nominal explains what a failed sensor read no worse than it should, and believing it costs next to nothing.

        A logger finer than the rig file says, or one in steps, reads more alike than nominal expects: over thousands of samples
        that adds up, and is no failure.
        """
        last, failed = self.n if path.end is None else path.end, path.hypothesis.failed
        nis = float(self.nis[path.begin : last].mean())
        a_sample = LITTLE_OF_STEPS if failed >= 0 and self.filters.rig.step[failed] else LITTLE_NATS
        little = path.gain < a_sample * max(last - path.begin, 1)
        return failed >= 0 and little and nis <= self.expected(self.nominal)

    def lasts(self, path: Path) -> bool:
        """Whether the fault of a path is there until the motor stops."""
        return path.end is None or path.end >= self.moving

    def expected(self, h: Hypothesis) -> float:
        """Readings of a sample that a hypothesis believes, on average: what its NIS is expected to be."""
        there = np.isfinite(self.window.z).mean(axis=0)
        return float(there.sum() - (there[h.failed] if h.failed >= 0 else 0.0))

    def misfit(self, nis: Array, begin: int) -> float:
        """Mean normalised innovation squared of a filter from sample `begin` on, without a stop of which nothing is known.

        What begins in the start has that to explain, and the stop with it.
        """
        starts = int(np.argmax(self.window.active)) + round(SETTLED_S / self.interval)
        told = nis[self.known[begin : begin + nis.size]] if begin > starts else nis
        return float((told if told.size >= LEFT else nis).mean())

    def _but_for_the_stop(self) -> NDArray[np.bool_]:
        """(n,) samples without those of the stop where the start is not explained either: with other gains a servo does both in
        its own way, whatever happens in between.
        """
        known, ring = np.ones(self.n, bool), round(SETTLED_S / self.interval)
        starts = int(np.argmax(self.window.active))
        begun = self.nis[starts : min(starts + ring, self.moving)]
        if not begun.size or float(begun.mean()) <= FITS * self.expected(self.nominal):
            return known
        first = max(self.moving - round(STOPPED_S / self.interval), 0)
        speed = np.abs(self.window.w_cmd[first:])
        brakes = first + int(np.argmax(speed < AT_SPEED * speed[0]))
        stands = first + int(np.argmax(speed == 0.0))
        if brakes > first:
            known[brakes : max(stands, brakes) + ring] = False
        return known

    def _promising(self, first: int, last: int, look: int) -> list[tuple[Hypothesis, int]]:
        """Hypotheses and begins that are good over the next `look` samples.

        All hypotheses share one fault: each is tried where any of them found it, from constants that it has there.
        """
        seen = [(*self._best_begin(h, first, last, look), h) for h in self.faults]
        there = max(seen, key=lambda item: item[0])[1]
        seen += [(self._gain_near(h, there, look), there, h) for h in self.faults if h.own]
        best = {h.name: (gain, begin, h) for gain, begin, h in sorted(seen, key=lambda item: item[0])}
        kept = sorted(best.values(), key=lambda item: -item[0])[:KEPT]
        return [(h, begin) for gain, begin, h in kept if gain > 0.0]

    def _gain_near(self, h: Hypothesis, begin: int, look: int) -> float:
        """Gain over the next `look` samples from the constants that h finds after this begin."""
        near = self._constants(h, begin, look, None)
        return self._gains(h, [begin], look, near=near)[begin]

    def _best_begin(self, h: Hypothesis, first: int, last: int, look: int) -> tuple[float, int]:
        """Gain over the next `look` samples, and the begin that has it, to a stride.

        Begins that lie close together are compared up to the same sample: which is better shows soon.
        """
        low = first // STRIDE * STRIDE
        step = min(_power(math.ceil((last - low) / (TRIALS - 1))), _power(look // 2 + 1) // 2)
        step = max(step, STRIDE)
        gains = self._gains(h, [low, *range((low // step + 1) * step, last + 1, step)], look)
        best = max(gains, key=lambda k: gains[k])
        while step > STRIDE:
            around, step = step, max(STRIDE, step // 4)
            begins = range(max(best - around + step, low), min(best + around - step, last) + 1, step)
            near = self._gains(h, begins, 0, best + around + min(look, self.looks[-1]))
            best = max(near, key=lambda k: near[k])
        gains |= self._gains(h, {best} - gains.keys(), look)
        best = max(gains, key=lambda k: gains[k])
        return gains[best], best

    def _refined(self, h: Hypothesis, begin: int, look: int) -> Begin:
        """The begin to a sample, all begins judged up to the same sample.

        Found from the first begin, the constants are where the next ones begin (an iterated filter).
        """
        look, near = min(look, self.looks[-1]), None
        asked = h, begin, look
        if asked in self.found:
            return self.found[asked]
        for step in (8, 4, 1):
            near, around = self._constants(h, begin, look, near), step * (TRIALS // 2)
            tried = range(max(begin - around + step, 0), min(begin + around, self.n - LEFT) + 1, step)
            gains = self._gains(h, tried, look, begin + around + look, near)
            begin = max(gains, key=lambda k: gains[k])
        self.found[asked] = _likely(h, gains, near)
        return self.found[asked]

    def _constants(
        self, h: Hypothesis, begin: int, look: int, near: HypothesisState | None
    ) -> HypothesisState | None:
        """What the fault's filter remembers `look` samples after a begin, within what is believable of its constants.

        None where a constant that no filter finds from afar ran beyond that: it is lost, and its prior is nearer.
        """
        if not h.own:
            return None
        alone = self.filters.of(h, 1, ROOM)
        alone.begin(self._entry(h, near)(self._nominal_at(begin)))
        alone.density(self.window, begin, min(begin + look, self.n))
        found = alone.memory()
        return None if _is_lost(h, found) else self._believable(h, found)

    @staticmethod
    def _believable(h: Hypothesis, memory: HypothesisState) -> HypothesisState:
        """A filter's memory with its constants within what is believable of them."""
        x = memory.x.copy()
        for own in h.own:
            k, unit = h.states.index(own.name), own.mean if own.absolute else 1.0
            x[k] = min(max(x[k], own.low / unit), own.high / unit)
        return memory._replace(x=x)

    def _gains(
        self,
        h: Hypothesis,
        begins: Iterable[int],
        look: int,
        stop: int | None = None,
        near: HypothesisState | None = None,
    ) -> dict[int, float]:
        """Nats over nominal of entering h at each begin, in the `look` samples after it or up to the sample `stop`."""
        mark = _mark(near)
        asked = {k: (h, mark, k, min(k + look if stop is None else stop, self.n)) for k in begins}
        stops = {k: key[-1] for k, key in asked.items() if key not in self.gained}
        if stops:
            enter = self._entry(h, near)
            nats = self.together(h, {k: enter(self._nominal_at(k)) for k in stops}, stops)
            for k, end in stops.items():
                self.gained[asked[k]] = nats[k] - enter.far - (self.until[end] - self.until[k])
        return {k: self.gained[key] for k, key in asked.items()}

    def _entry(self, h: Hypothesis, near: HypothesisState | None) -> Entry:
        return Entry(self.nominal, h, self.filters, near=near, within_s=self.interval)

    def _nominal_at(self, k: int) -> HypothesisState:
        """What nominal remembers before sample k."""
        memory, extra = self.memories[k // STRIDE], k % STRIDE
        if not extra:
            return memory
        if k not in self.before:
            alone = self.filters.of(self.nominal, 1, ROOM)
            alone.begin(memory)
            alone.density(self.window, k - extra, k)
            self.before[k] = alone.memory()
        return self.before[k]

    def together(
        self, h: Hypothesis, entered: dict[int, HypothesisState], stops: dict[int, int]
    ) -> dict[int, float]:
        """Log-likelihood of the samples from each entry to its stop: MOST filters side by side, which join one by one."""
        out: dict[int, float] = {}
        samples = sorted(entered)
        side_by_side = self.filters.of(h, MOST, ROOM)
        for at in range(0, len(samples), MOST):
            part = samples[at : at + MOST]
            first = part[0]
            density = side_by_side.joined(self.window, {k: entered[k] for k in part}, stops[part[-1]])
            for row, k in enumerate(part):
                out[k] = float(density[k - first : max(stops[k], k) - first, row].sum())
        return out

    def _follow(
        self, h: Hypothesis, memory: HypothesisState, first: int
    ) -> tuple[list[HypothesisState], Array, Array]:
        """The filter's memories at every STRIDE samples from `first` on; log-density and misfit of each sample."""
        samples = [*range(first, self.n, STRIDE), self.n]
        memories, density, misfit = self.filters.of(h, 1, ROOM).followed(self.window, memory, samples)
        return [memory, *memories], density, np.nan_to_num(misfit)

    def _ended(self, found: Begin) -> Path:
        """The path that stays to the end, or the best one on which nominal comes back where that is better."""
        asked = found.hypothesis, _mark(found.near), found.begin, found.first, found.last
        if asked not in self.ended:
            self.ended[asked] = self._best_end(found)
        return self.ended[asked]

    def _best_end(self, found: Begin) -> Path:
        h, begin, near = found.hypothesis, found.begin, found.near
        before, enter = self._nominal_at(begin), self._entry(h, near)
        memories, density, nis = self._follow(h, enter(before), begin)
        gained = np.concatenate(([0.0], np.cumsum(density))) - (self.until[begin:] - self.until[begin])
        gained -= enter.far
        settled = float(gained[min(round(SETTLED_S / self.interval), gained.size - 1)])
        gain, later = float(gained[-1]) - CHANGE_NATS, float(gained[-1]) - settled
        held = found.first, found.last, self.lost(begin)
        moving = float(gained[max(self.moving - begin, 0)])
        stays = Path(h, begin, None, gain, memories[-1], self.misfit(nis, begin), later, *held, moving)
        ends = _Ends(self, h, begin, self._back(h, before), memories, gained)
        best = ends.best()
        if best is None:
            return stays
        end, worth, memory = best
        lasted = self.misfit(nis[: end - begin], begin)
        moving = worth if end <= self.moving else moving
        over = Path(h, begin, end, worth, memory, lasted, worth - settled, *held, moving)
        return max(stays, over, key=lambda path: path.gain)


class _Ends:
    """When a fault that was followed from its begin was over: nominal from there on, over the ends that may be.

    gained: nats over nominal of the fault at each sample from its begin on, and after the last one. memories: of its filter
    at every STRIDE of them.
    """

    def __init__(
        self,
        move: WholeMove,
        h: Hypothesis,
        begin: int,
        back: Entry,
        memories: Sequence[HypothesisState],
        gained: Array,
    ) -> None:
        self.move, self.h, self.begin, self.back, self.gained = move, h, begin, back, gained
        self.at = {begin + k * STRIDE: memory for k, memory in enumerate(memories)}

    def best(self) -> tuple[int, float, HypothesisState] | None:
        """The end, its gain over nominal in the whole move, and what the fault's filter remembers there, if there is one.

        Ends that lie close together are compared up to the same sample: which is better shows soon.
        """
        n, begin, look = self.move.n, self.begin, self.move.looks[-1]
        step = max(STRIDE, (n - begin) // TRIALS // STRIDE * STRIDE)
        soon = [begin + int(STRIDE * 2 ** (k / 2.0)) for k in range(2 * int(math.log2(max(n, 2))))]
        gains = self._gains(self._strides([*soon, *range(begin + step, n, step)]), n)
        if not gains:
            return None
        best = max(gains, key=lambda k: gains[k])
        while step > STRIDE:
            around, step = step, max(STRIDE, step // 4 // STRIDE * STRIDE)
            ends = self._strides(range(max(best - around + step, begin + STRIDE), best + around, step))
            near = self._gains(ends | {best}, best + around + look)
            best = max(near, key=lambda k: near[k])
        self._remember(max(best - STRIDE, begin), best + STRIDE)
        near = self._gains(range(best - STRIDE + 1, best + STRIDE + 1), best + STRIDE + look)
        best = max(near, key=lambda k: near[k])
        gains |= self._gains({best} - gains.keys(), n)
        best = max(gains, key=lambda k: gains[k])
        return best, gains[best], self.at[best]

    def _strides(self, ends: Iterable[int]) -> set[int]:
        return {self.begin + STRIDE * max(1, round((end - self.begin) / STRIDE)) for end in ends}

    def _gains(self, ends: Iterable[int], stop: int) -> dict[int, float]:
        """Nats over nominal of each end up to the sample `stop`, less the price of the changes."""
        move, stop = self.move, min(stop, self.move.n)
        there = [end for end in ends if end in self.at and self.begin < end < move.n - LEFT]
        after = move.together(
            move.nominal, {end: self.back(self.at[end]) for end in there}, dict.fromkeys(there, stop)
        )
        price = 2.0 * CHANGE_NATS
        return {
            end: float(self.gained[end - self.begin]) + nats - (move.until[stop] - move.until[end]) - price
            for end, nats in after.items()
        }

    def _remember(self, first: int, last: int) -> None:
        """What the fault's filter remembers before each sample of first:last, from its memory before the first."""
        samples = range(first, min(last, self.move.n - 1) + 1)
        if len(samples) > 1:
            alone = self.move.filters.of(self.h, 1, ROOM)
            memories, _, _ = alone.followed(self.move.window, self.at[first], samples)
            self.at |= dict(zip(samples[1:], memories, strict=True))


def _mark(near: HypothesisState | None) -> bytes:
    """What tells one start of a fault's constants from another."""
    return b"" if near is None else near.x.tobytes()


def _power(samples: int) -> int:
    """The least number of samples, from those on, that is a stride times a power of two: two windows share a grid."""
    return STRIDE << max(0, math.ceil(math.log2(max(samples, 1) / STRIDE)))


def _likely(h: Hypothesis, gains: dict[int, float], near: HypothesisState | None) -> Begin:
    """The best of some begins, and the samples that hold it with 95 %."""
    samples = np.array(sorted(gains))
    nats = np.array([gains[k] for k in samples.tolist()])
    share = np.cumsum(np.exp(nats - nats.max()))
    low, high = np.searchsorted(share / share[-1], (0.025, 0.975))
    last = int(samples[min(high, samples.size - 1)])
    return Begin(h, int(samples[nats.argmax()]), int(samples[low]), last, near)


def _is_lost(h: Hypothesis, memory: HypothesisState) -> bool:
    """Whether a filter has left what is believable of a constant that it cannot find from afar."""
    far = [own for own in h.own if own.means]
    return any(not own.low <= float(memory.x[h.states.index(own.name)]) <= own.high for own in far)


def _constants_of(h: Hypothesis) -> bool:
    """Whether a fault has constants of the plant, which its filter finds the better the nearer it begins."""
    return any(own.name in INDEX for own in h.own)


def _follows(h: Hypothesis) -> bool:
    """Whether a fault has a load of its own that may do anything."""
    return any(own.name not in INDEX and own.growth > 0.0 for own in h.own)


def _near(h: Hypothesis, begin: int, known: set[tuple[str, int]]) -> bool:
    """Whether a hypothesis is known to begin within a stride of there."""
    return any((h.name, begin // STRIDE + k) in known for k in (-1, 0, 1))
