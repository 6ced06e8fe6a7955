"""Low-pass filters that a logger puts before its readings, told at the first start of a log.

The motion of nominal tells the corner where no fault explains the start as well. `logs.logger.low_pass` has the filters and
readings without them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from observer_fi.bank import Bank
from observer_fi.logs import (
    Lateness,
    LowPass,
    LowPasses,
    Readings,
    SetBack,
    Unfiltered,
    behind_steps,
    channel_traits,
    clock_of,
    rests_for_noise,
)
from observer_fi.physics import Rig
from observer_fi.records import Acquisition, ChannelTraits, Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.logger.lateness import first_start, set_right
from observer_fi.verdict.moves.of_the_day import BEGIN, Told, told_by

# Times its expected NIS: a start that nominal explains so well has no filter that matters; one that a first filter does not
# bring near is no matter of filters.
FITS, NEAR = 1.6, 30.0
# The same with filters of a start that is explained without them: noise that wanders alone fits worse, chance of 300 samples
# does not.
TRUE = 1.25
# The same of the best of the filters tried first, from which on a start that is not explained has none: of 45 filters, seeds
# 99720000 to 99720059, at most 110, and 0.76 of what it was without; of other machines 350 and more, or 1.
HOPELESS, NO_HELP = 200.0, 0.95
# That filters must gain at a start; where it is explained without, also its motion beside its rest.
NOTICED_NATS = 40.0
ABOUT = 2.5  # times the delay of a filter, the correlation time of noise that has come through it
LEFT = 0.1  # of what a channel covers in the start: what comes of more noise than that tells nothing
TIMES = tuple(1.5**n for n in range(11))  # time constants in samples that are tried first
CLIMBED = 3  # groups of channels whose best filter is looked at closer
COARSE = 5  # of the steps below are taken for each of these, of either order; the others for the best of them
# Factors by which a corner is tried lower and higher, and samples by which the channel is tried earlier and later.
FINER = (
    (1.41, 1.0),
    (1.2, 0.5),
    (1.2, 0.5),
    (1.1, 0.5),
    (1.05, 0.25),
    (1.02, 0.25),
    (1.01, 0.12),
    (1.005, 0.06),
)
CHANNELS = ((1,), (2,), (0,), (0, 1), (0, 1, 2))  # that may have the same filter: current, position, voltage
ORDERS = (1, 2)


def low_passes_of(
    log: Log,
    rig: Rig,
    settings: BankSettings,
    offset_of: Callable[[Acquisition, Rig], float],
    without: Told | None,
    acquisition: Acquisition,
) -> LowPasses:
    """The filters before the readings of a log; none where its first start does not tell.

    offset_of: zero offset of the voltage [V] of what a logger does and a rig; without: how well the start is explained without
    filters, and acquisition: what the logger then does.
    """
    none, cut = LowPasses(), first_start(log)
    if without is None or cut is None:
        return none
    explained = without.misfit < FITS
    groups = _groups(acquisition, 1.0 / log.rate_hz, explained)
    if not groups:
        return none
    begin = log.part(slice(0, int(np.searchsorted(log.t, cut.t[-1])) + 1))
    start = Start(begin, rig, settings, offset_of, acquisition)
    begun = _tried(start, none, groups)
    least = min(start.misfit(one) for one in begun)
    if not explained and least > min(HOPELESS, NO_HELP * without.misfit):
        return none
    best = _best_like(start, begun)
    if FITS < start.misfit(best) < NEAR:
        other = _best_like(start, _tried(start, best, groups))
        best = other if start.nats(other) > start.nats(best) + NOTICED_NATS else best
    gains = start.by_motion(best) > without.by_motion + NOTICED_NATS
    if explained and not (gains and _colours(best, acquisition)):
        return none
    worth = max(start.as_filed, without.nats) + NOTICED_NATS
    fits = TRUE if explained else FITS
    return best if start.misfit(best) < fits and start.nats(best) > worth else none


def _colours(filters: LowPasses, acquisition: Acquisition) -> bool:
    """Whether filters make noise of about the colour that it has: noise that wanders for another reason shows none.

    Of readings in steps that show no colour none is asked.
    """
    own = zip(filters, acquisition[:3], strict=True)
    told = [
        (low.delay_s, traits.correlation_s or math.inf)
        for low, traits in own
        if math.isfinite(low.corner_hz) and not _hides_colour(traits)
    ]
    return all(1.0 / ABOUT < delay / time < ABOUT for delay, time in told)


def _hides_colour(traits: ChannelTraits) -> bool:
    """Whether the steps of readings hide what colour their noise has."""
    return traits.resolution is not None and traits.correlation_s is None


def _groups(
    acquisition: Acquisition, interval: float, explained: bool
) -> dict[tuple[int, ...], list[LowPass]]:
    """Channels that may have the same filter, and the filters that are tried first.

    Of a start that is explained without only those whose noise may have come through one, too, and of one of them has.
    """
    corners = [1.0 / (2.0 * math.pi * interval * samples) for samples in TIMES]
    kinds = [LowPass(corner, order) for corner in corners for order in ORDERS]
    # a mean is known for what it is, and behind a filter no reading repeats itself
    single = {c for c, traits in enumerate(acquisition[:3]) if traits.averaged == 1 and not traits.in_a_band}
    single_groups = [channels for channels in CHANNELS if set(channels) <= single]
    if not explained:
        return dict.fromkeys(single_groups, kinds)
    coloured = {c for c, traits in enumerate(acquisition[:3]) if traits.correlation_s}
    none = LowPasses()
    likely = {
        channels: [kind for kind in kinds if _colours(none.of(channels, kind), acquisition)]
        for channels in single_groups
        if coloured & set(channels)
    }
    return {channels: tried for channels, tried in likely.items() if tried}


def _tried(start: "Start", found: LowPasses, groups: dict[tuple[int, ...], list[LowPass]]) -> list[LowPasses]:
    """The filters with a further one before each group of channels, the best of those that are tried first, best first."""
    begun = [
        max((found.of(channels, kind) for kind in kinds), key=start.nats)
        for channels, kinds in groups.items()
    ]
    return sorted(begun, key=start.nats, reverse=True)


def _best_like(start: "Start", begun: list[LowPasses]) -> LowPasses:
    """The best filters with corners and delays near those of the first few."""
    near = max((_finer(start, one, FINER[:COARSE], ORDERS) for one in begun[:CLIMBED]), key=start.nats)
    return _finer(start, near, FINER[COARSE:])


def _finer(
    start: "Start", found: LowPasses, steps: Sequence[tuple[float, float]], orders: tuple[int, ...] = ()
) -> LowPasses:
    """Filters with the best corner and delay of those like the given ones, of these orders, or of their own."""
    for factor, samples in steps:
        found = max(_near(found, factor, samples, start.interval, orders), key=start.nats)
    return found


def _near(
    found: LowPasses, factor: float, samples: float, interval: float, orders: tuple[int, ...]
) -> list[LowPasses]:
    """The same with corners lower and higher, of either order, earlier and later.

    Another corner, or order, is tried as late as the one before and as late in all: a delay looks much like a lower corner.
    """
    out = [found]
    for kind in {own for own in found if math.isfinite(own.corner_hz)}:
        channels = tuple(c for c, own in enumerate(found) if own == kind)
        lates = {kind.late - samples, kind.late, kind.late + samples}
        tried = [kind._replace(late=late) for late in lates]
        for order in orders or (kind.order,):
            for corner in (kind.corner_hz / factor, kind.corner_hz, kind.corner_hz * factor):
                other = kind._replace(corner_hz=corner, order=order)
                less = (kind.delay_s - other.delay_s) / interval
                tried += [other, other._replace(late=kind.late + less)]
        out += [found.of(channels, own) for own in tried if own.late >= 0.0]
    return out


class Start:
    """A log until its first start is over, as nominal explains it without the filters that may have come before its readings.

    read: what its logger does as it came.
    """

    def __init__(
        self,
        log: Log,
        rig: Rig,
        settings: BankSettings,
        offset_of: Callable[[Acquisition, Rig], float],
        read: Acquisition | None = None,
    ) -> None:
        self.log, self.rig, self.offset_of, self.read = log, rig, offset_of, read
        self.settings = replace(settings, unknown=False, sensors=False)
        self.interval = float(np.median(np.diff(log.t)))
        self.rests, self.clock = rests_for_noise(log), clock_of(log.t)
        self.most = [
            LEFT * float(np.ptp(z[np.isfinite(z)])) if np.isfinite(z).any() else 0.0 for z in log.z.T
        ]
        self.traits: dict[tuple[int, LowPass], ChannelTraits] = {}
        self.known: dict[LowPasses, Told] = {}
        self.full = settings

    @cached_property
    def as_filed(self) -> float:
        """Log-likelihood without filters, whatever fault there may be."""
        return self._told(LowPasses(), self.full).nats

    def nats(self, filters: LowPasses) -> float:
        """Log-likelihood of the readings as they were logged."""
        return self._of(filters).nats

    def misfit(self, filters: LowPasses) -> float:
        """NIS in motion over its expectation."""
        return self._of(filters).misfit

    def by_motion(self, filters: LowPasses) -> float:
        """Nats of the motion less those of as many samples at rest: what a filter makes of the noise is no gain."""
        return self._of(filters).by_motion

    def _of(self, filters: LowPasses) -> Told:
        if filters not in self.known:
            self.known[filters] = self._told(filters, self.settings)
        return self.known[filters]

    def _told(self, filters: LowPasses, settings: BankSettings) -> Told:
        log = Unfiltered(filters, self.interval).take(self.log)
        acquisition = self._acquisition(filters, log)
        if self._drowned(filters, acquisition):
            return Told(-math.inf, math.inf, -math.inf)
        late = Lateness(*(own.late for own in filters))
        rig = set_right(replace(self.rig, logger=acquisition), late, self.interval)
        log = Readings(acquisition, log.rate_hz, self.rig.noise_std).take(log)
        zero = np.array([self.offset_of(acquisition, rig), 0.0, 0.0])
        cut = first_start(SetBack(late).take(replace(log, z=log.z - zero)))
        assert cut is not None  # the command is the same
        told = told_by(Bank(rig, settings).advance(cut), cut.z)
        # Densities are of what is left: of what was logged they are larger by how much a filter had shrunk it.
        read = np.isfinite(cut.z[BEGIN:]).sum(axis=0)
        grown = float(read @ np.log([own.weights(self.interval)[0] for own in filters]))
        return told._replace(nats=told.nats + grown)

    def _drowned(self, filters: LowPasses, acquisition: Acquisition) -> bool:
        """Whether what is left of a channel without its filter is noise."""
        own = zip(filters, acquisition[:3], self.most, strict=True)
        return any(math.isfinite(low.corner_hz) and traits.noise_std > most for low, traits, most in own)

    def _acquisition(self, filters: LowPasses, log: Log) -> Acquisition:
        """What the logger would have done without the filters."""
        usual = self.rig.file_noise_std.tolist()
        for c, own in enumerate(filters):
            if (c, own._replace(late=0.0)) not in self.traits:
                made = channel_traits(log.t, log.z[:, c], log.w_cmd, self.rests, usual[c])
                read = made if self.read is None else self.read[:3][c]
                self.traits[c, own._replace(late=0.0)] = behind_steps(made, read, own, self.interval)
        voltage, current, position = (self.traits[c, own._replace(late=0.0)] for c, own in enumerate(filters))
        return Acquisition(voltage, current, position, self.clock)
