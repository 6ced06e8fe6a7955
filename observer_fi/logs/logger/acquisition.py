"""What a logger does to its readings, measured from a log itself: noise, steps, holds, colour, lines, spikes, its clock.

Noise, lines and colour come from rests, where nothing else moves; steps and holds from every sample. A trait is there from
the first sample on: the rest before the first move has the say, later ones count where they look alike.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs.logger.clock import clock_of, even
from observer_fi.logs.logger.holds import hold_of
from observer_fi.logs.logger.in_motion import more_in_motion, quiet_begin
from observer_fi.logs.logger.lines import lines_of
from observer_fi.logs.logger.proportional import grows_with_reading
from observer_fi.logs.logger.steps import step_of
from observer_fi.numerics import autocorrelation, resolution_of, runs
from observer_fi.physics import Rig
from observer_fi.records import CHANNELS, Acquisition, Array, ChannelTraits, Line, Log

Mask = NDArray[np.bool_]
FEWEST = 100  # samples of a rest from which anything is told
# Samples of rests where none is longer, those of slow loggers; by which later rests scatter more in which a motor settles.
SHORT, SETTLES = 24, 5.0
# Parts of a rest whose levels tell a drift, and by how many times what chance, and the rest before any move, makes of them: noise
# alone does so once in ten thousand rests.
LEVELS, DRIFTS = 8, 4.0
# Of the noise of a reading, from which the mean at rest is no zero: fourteen standard deviations of a usual rest. A command that
# is recovered and filters take out what is more, both of it or neither.
OFF_ZERO = 0.7
SETTLED_S = 0.3  # after a stop, until a rest is one
SET_UP_DEG = 1.0  # of the pitch from one sample to the next: nobody tilts a rig so fast while it moves
FOREIGN = 5.0  # times its noise: a logger that a rig file does not know
SPIKE = 6.0  # standard deviations, at rest
# By which a spike is off its neighbours: standard deviations, and times their distance from each other.
FAR, ALONE = 8.0, 4.0
# Samples on either side of a spike in which the command stands still: of one that tells that a logger has spikes, and of those of
# a logger that has.
UNMOVED, NEAR = 80, 2
ENOUGH = 0.8  # of the readings of a short rest
FEWEST_TICKS = 8  # fresh readings of a held channel at rest from which its noise is told
# Of normal noise; standard deviations by which samples at once are off the level of a rest where the motor is driven.
SIGMA_OF_MAD, DRIVEN, AT_ONCE = 1.4826, 3.0, 5
SOFTLY = 0.1  # of a rest, in which a motor may be driven by less than shows
SWITCHED = (1.5, 8.0)  # by what noise grows in another range
# Relative, of how noise grew, between rests of FEWEST readings; and by how many times what fewer readings add it must grow more.
USUAL_DOUBT, SURELY = 0.1, 4.0
FEWEST_GROWN = 8  # readings of a rest that tell it
SAME_KIND = 0.3  # relative: noise of the same colour
ALIKE = 2.0  # by how much the noise of a later rest may differ from that of the first
COARSE = 0.3  # of the noise: steps from here on are told
STANDING = 3.5  # steps of so many standard deviations and more: readings stand still where the signal does
SAME_ERROR = 2.0  # times the variance of rounding: readings that stand have one error in common
OPPOSITE = (
    -0.38
)  # autocorrelation of differences that shows a mean: -0.5 but for the error of a rest of 600 samples
BY_CHANCE = 5.0  # standard deviations of a correlation that is none, the largest of many
# Times that what the mean of a rest takes away is put back, and no more than so much of the variance.
UNBIASED, MOST_LOST = 4, 0.3
COLOURED = 0.15  # autocorrelation of neighbours from which noise is called coloured
LONGEST = 1 << 16  # samples that are looked at
# Samples that a sensor that got stuck repeats itself; times as long as it ever did while it worked.
STUCK, STUCK_FOR = 50, 20


def acquisition_of(log: Log, noise_std: Array) -> Acquisition:
    """What the logger of a log does. noise_std: (3,) what the rig file says of the noise, for channels that tell nothing."""
    log = _without_unread(log.part(slice(0, LONGEST)))
    clock = clock_of(log.t)
    if clock.resolution_s:  # how long a reading is held is counted in rows
        log = replace(log, t=even(log.t, clock.interval_s, clock.resolution_s))
    t, z, w = log.t, log.z, log.w_cmd
    rests = rests_for_noise(log)
    voltage, current, position = (
        channel_traits(t, z[:, c], w, rests, usual) for c, usual in enumerate(noise_std.tolist())
    )
    return Acquisition(voltage, current, position, clock)


def _without_unread(log: Log) -> Log:
    """The log without rows in which no channel was read: how long a reading is held is told from those that were."""
    read = np.isfinite(log.z).any(axis=1)
    return log if read.all() else log.part(np.flatnonzero(read))


def rests_for_noise(log: Log) -> list[slice]:
    """The rests of the beginning of a log in which nothing is driven, as far as they tell anything: long ones if any.

    Only the one before any move, which may be short, where a motor still settles in all others.
    """
    part = slice(0, LONGEST)
    t, z, w, pitch = log.t[part], log.z[part], log.w_cmd[part], log.pitch[part]
    parts = [undriven(still, z) for rest in rests_of(t, w, SHORT) for still in as_set_up(rest, pitch)]
    rests = [rest for rest in parts if rest.stop - rest.start >= SHORT]
    long = [rest for rest in rests if rest.stop - rest.start >= FEWEST]
    begin = [rest for rest in rests[:1] if rest.start == 0 and rest not in long]
    if long and long[0].start == 0:
        long = [long[0], *(r for r in long[1:] if not any(_drifts(long[0], r, z[:, c]) for c in range(2)))]
    others = long or rests[len(begin) :]
    if begin and any(_settles(begin[0], others, z[:, c]) for c in range(2)):
        return begin
    return long or rests


def with_logger(rig: Rig, logs: Sequence[Log]) -> Rig:
    """The rig with what the first of some logs shows of the logger; as it is where no motor drives it."""
    if not rig.driven.motor or not logs:
        return rig
    seen = acquisition_of(logs[0], rig.file_noise_std)
    return replace(
        rig, logger=seen, noise={name: _of_file(rig.noise[name], getattr(seen, name)) for name in CHANNELS}
    )


def _of_file(filed: float, seen: ChannelTraits) -> float:
    """The noise that a rig file is to have: a healthy log's where the file's knew nothing of the logger."""
    known = not math.isfinite(seen.as_white) or 1.0 / FOREIGN < seen.as_white / filed < FOREIGN
    return filed if known or seen.as_white == 0.0 else seen.as_white


def rests_of(t: Array, w_cmd: Array, fewest: int = FEWEST) -> list[slice]:
    """The rests of a log with so many samples at least, the first before any move; later ones from when the loop has settled."""
    found = []
    for first, last in zip(*runs(w_cmd == 0.0), strict=True):
        begin = first if first == 0 else int(np.searchsorted(t, t[first] + SETTLED_S))
        end = last if last == t.size else last - 2  # the command begins to rise between two samples
        if end - begin >= fewest:
            found.append(slice(int(begin), int(end)))
    return found


def as_set_up(rest: slice, pitch: Array) -> list[slice]:
    """The parts of a rest between jumps of the pitch: a rig that is set up anew as it stands is driven to hold the new load."""
    jumps = np.flatnonzero(np.abs(np.diff(pitch[rest])) > SET_UP_DEG) + 1 + rest.start
    return [slice(int(a), int(b)) for a, b in pairwise((rest.start, *jumps.tolist(), rest.stop))]


def undriven(rest: slice, z: Array) -> slice:
    """A rest without its ends in which voltage or current, z (n, 2 or more), still rings or falls, or already rises.

    Friction holds a mass while a motor that is given a voltage, and no speed, is driven up; that is no noise. A log may begin
    as a move ends.
    """
    first, last = rest.start, rest.stop
    for y in z[rest, :2].T:
        driven = _off_level(y)
        half = driven.size // 2
        if driven.size and driven[0]:
            first = max(first, rest.start + int(np.flatnonzero(driven[:half])[-1]) + AT_ONCE)
        if driven.size and driven[-1]:
            last = min(last, rest.start + half + int(np.flatnonzero(driven[half:])[0]))
    soft = int(SOFTLY * max(last - first, 0))
    first, last = first + soft * (first > rest.start), last - soft * (last < rest.stop)
    return slice(first, max(last, first))


def _off_level(y: Array) -> Mask:
    """Where the median of some samples is off the level of all of them by more than their noise, or their finest step."""
    seen = y[np.isfinite(y)]
    changes = np.abs(np.diff(seen))
    if seen.size < FEWEST or not changes.any():
        return np.zeros(0, dtype=np.bool_)
    level = float(np.median(seen))
    off = np.where(np.isfinite(y), y - level, 0.0)
    usual = max(SIGMA_OF_MAD * float(np.median(np.abs(off))), float(changes[changes > 0.0].min()))
    medians = np.median(np.lib.stride_tricks.sliding_window_view(off, AT_ONCE), axis=1)
    return np.asarray(np.abs(medians) > DRIVEN * usual, dtype=np.bool_)


def stuck_from(z: Array) -> int | None:
    """The sample from which readings z (n,) stay the same to the last digit until they end, for far longer than they ever did."""
    there = np.flatnonzero(np.isfinite(z))
    changes = np.flatnonzero(np.diff(z[there]))
    if not changes.size:
        return None
    first = int(changes[-1]) + 1
    run, longest = there.size - first, int(np.diff(changes, prepend=-1).max())
    return int(there[first]) if run >= STUCK and run > STUCK_FOR * longest else None


def channel_traits(t: Array, z: Array, w_cmd: Array, rests: Sequence[slice], usual: float) -> ChannelTraits:
    """The traits of one channel: z (n,) its readings, of which those of a sensor that got stuck tell nothing; usual: its noise in
    the rig file.
    """
    read, stuck = float(np.isfinite(z).sum()) / max(z.size, 1), stuck_from(z)
    z = z if stuck is None else np.where(np.arange(z.size) < stuck, z, np.nan)
    there = np.isfinite(z)
    if int(there.sum()) < FEWEST:
        return ChannelTraits(math.nan, math.nan)
    interval = float(np.median(np.diff(t)))
    hold = hold_of(np.round((t - t[0]) / interval).astype(np.int64), z, w_cmd)
    held = hold and hold.every
    step = resolution_of(np.diff(z[there])) if held else step_of(z[there])
    traits = _noise_of(t, z, w_cmd, rests, usual, step, held, interval)
    noise = math.hypot(traits.noise_std, step or 0.0)
    traits = traits._replace(
        update_hz=held and 1.0 / (held * interval),
        hold_s=hold and hold.longest and hold.longest * interval,
        spikes=0 if held else spikes_of(z, w_cmd, noise).size,
    )
    traits = traits._replace(travel=float(np.nanmax(z) - np.nanmin(z)) if (w_cmd != 0.0).any() else math.inf)
    if held or not rests:
        traits = traits._replace(repeats=0.0 if held else traits.repeats)
    else:
        traits = traits._replace(repeats=float(np.mean(np.diff(z[rests[0]]) == 0.0)))
    return traits._replace(offset=_level(z[rests[0]]) if rests else 0.0, read=read)


def _noise_of(
    t: Array,
    z: Array,
    w_cmd: Array,
    rests: Sequence[slice],
    usual: float,
    step: float | None,
    held: float | None,
    interval: float,
) -> ChannelTraits:
    """Noise, lines and colour of readings z (n,) in their rests, or in motion where no rest tells any.

    step: of the readings, held: rows that each is held, None where they have none; interval: of the rows [s].
    """
    there = np.isfinite(z)
    every = held or 1.0 / float(there.mean())  # rows from one reading to the next
    told = [(r, _piece(t[r], z[r], held)) for r in rests]
    told = [
        (r, p)
        for r, p in told
        if p[0].size >= max(min(FEWEST, ENOUGH * (r.stop - r.start)) / every, FEWEST_TICKS)
    ]
    pieces = [p for _, p in told]
    loud = _white(z[told[0][0]] if told else z) / SWITCHED[1]
    quiet = slice(0) if held else quiet_begin(z, told[0][0].start if told else z.size, loud)
    if quiet.stop:
        return _in_motion(z[quiet][there[quiet]], step, usual)
    if not pieces:
        return _in_motion(z[there], step, usual)
    traits, grown = _at_rest(_alike(pieces), step, usual, every * interval), _grown(pieces, step)
    moving = 1.0 if held else more_in_motion(t, z, w_cmd, rests[0], max(usual, step or 0.0))
    share, largest = (0.0, 1.0) if held or step else grows_with_reading(z, traits.noise_std)
    most = max(grown, moving, largest)
    return traits._replace(
        as_white=most * traits.as_white, grown=grown, moving=max(moving, largest), share=share
    )


def _level(z: Array) -> float:
    """Mean of the readings of a rest, z (n,), without spikes: one of them would be the offset of a short rest."""
    seen = z[np.isfinite(z)]
    return float(seen[~_spikes_among(seen - np.median(seen))].mean()) if seen.size else 0.0


def _settles(begin: slice, rests: Sequence[slice], z: Array) -> bool:
    """Whether readings z (n,) scatter far more in all rests than in the one before any move, and smoothly: no other range."""
    known = [r for r in rests if np.isfinite(z[r]).any()]
    if not known or not np.isfinite(z[begin]).any():
        return False
    usual, seen = float(np.nanstd(z[begin])), [float(np.nanstd(z[r])) for r in known]
    smooth = all(whole > ALIKE * _rough(z[r]) for whole, r in zip(seen, known, strict=True))
    return smooth and 0.0 < SETTLES * usual < min(seen)


def _drifts(begin: slice, rest: slice, z: Array) -> bool:
    """Whether readings z (n,) of a rest move on, by far more than noise moves them and than in the one before any move: a motor
    that stops softly settles for long.
    """
    changes = np.abs(np.diff(z[rest]))
    step = float(np.min(changes, where=changes > 0.0, initial=math.inf))
    by_chance = _rough(z[rest]) / math.sqrt((rest.stop - rest.start) / LEVELS)
    spread = _spread_of_levels(z[rest])
    return spread > DRIFTS * max(_spread_of_levels(z[begin]), by_chance) and DRIFTS * spread > step


def _spread_of_levels(z: Array) -> float:
    """Standard deviation of the levels of some equally long parts of readings z (n,), 0 where they are not read."""
    parts = [part[np.isfinite(part)] for part in np.array_split(z, LEVELS)]
    levels = [float(part.mean()) for part in parts if part.size]
    return float(np.std(levels)) if levels else 0.0


def _rough(z: Array) -> float:
    """Standard deviation of the noise of readings z (n,) as the changes from one to the next tell it, 0 where none do."""
    changes = np.diff(z)
    return float(np.nanstd(changes)) / math.sqrt(2.0) if np.isfinite(changes).any() else 0.0


def _in_motion(z: Array, step: float | None, usual: float) -> ChannelTraits:
    """Of a channel without a rest: its white noise, the step of its readings, and how often that noise would repeat one."""
    white = _white(z)
    coarse = step if step and step > COARSE * max(white, usual) else None
    repeats = min(step / (2.0 * math.sqrt(math.pi) * white), 1.0) if step and white > 0.0 else 0.0
    as_white = math.hypot(max(white, usual), (coarse or 0.0) / math.sqrt(12.0))
    return ChannelTraits(white, as_white, coarse, repeats=repeats)


def _at_rest(
    pieces: Sequence[tuple[Array, Array]], step: float | None, usual: float, interval: float
) -> ChannelTraits:
    """Noise, lines and colour of the readings of rests; interval: of fresh readings [s]."""
    lines, left = lines_of(pieces)
    quiet = [y for _, y in left]
    variance = sum(float(y @ y) for y in quiet) / sum(y.size for y in quiet)
    at_rest = min(step, _finest(quiet) or step) if step else 0.0
    own = variance - at_rest**2 / 12.0
    coarse = step if step and step > COARSE * math.sqrt(max(own, 0.0)) else None
    rounding = 0.0 if coarse is None else coarse**2 / 12.0
    noise = math.sqrt(max(own if coarse else variance, 0.0))
    factor, time = colour_of(quiet, interval) if noise > 0.0 else (1.0, None)
    if time is not None:  # noise that wanders takes the means of the rests along
        noise /= math.sqrt(1.0 - min(factor * len(quiet) / sum(y.size for y in quiet), MOST_LOST))
    stands = coarse is not None and coarse > STANDING * max(noise, usual)
    error = SAME_ERROR * rounding if stands else rounding
    return ChannelTraits(
        noise, _as_white(noise, factor, lines, error, usual), coarse, lines=lines, correlation_s=time,
        averaged=averaged_of(quiet), neighbour_std=_between_neighbours(quiet),
    )  # fmt: skip


def _finest(pieces: Sequence[Array]) -> float | None:
    """The step of the readings of rests, which may be finer than that of larger ones."""
    return resolution_of(np.concatenate([np.diff(y) for y in pieces]))


def _as_white(noise: float, factor: float, lines: Sequence[Line], rounding: float, usual: float) -> float:
    """Standard deviation of the white noise that says as little as this channel's: its density at frequency zero, with
    lines that do not average out within a period.

    Of coarse readings a rest tells the noise as well as where in a step they lie: it is taken for no less than the usual one.
    """
    hum = sum(line.amplitude**2 for line in lines)
    own = max(factor * noise**2, usual**2) if rounding else factor * noise**2
    return math.sqrt(own + rounding + LINE_WEIGHT * hum)


LINE_WEIGHT = 1.0


def without_spikes(log: Log, acquisition: Acquisition) -> Log:
    """The log with NaN for the spikes of its logger."""
    z = log.z.copy()
    for c, channel in enumerate(acquisition[:3]):
        if channel.spikes:
            noise = math.hypot(channel.noise_std, channel.resolution or 0.0)
            z[spikes_of(log.z[:, c], log.w_cmd, noise, NEAR), c] = np.nan
            z[_off_a_slope(log.z[:, c], noise), c] = np.nan
    return replace(log, z=z)


def spikes_of(z: Array, w_cmd: Array, noise: float, unmoved: int = UNMOVED) -> NDArray[np.int64]:
    """Rows of readings far from both neighbours, which are near each other, while the command stands still.

    noise: of readings; unmoved: samples on either side in which it does.
    """
    off, apart = z[1:-1] - 0.5 * (z[2:] + z[:-2]), np.abs(z[2:] - z[:-2])
    far = np.flatnonzero((np.abs(off) > FAR * noise) & (np.abs(off) > ALONE * apart)) + 1
    moved = np.flatnonzero(np.diff(w_cmd) != 0.0)
    return far[np.searchsorted(moved, far - unmoved) == np.searchsorted(moved, far + unmoved)]


def _off_a_slope(z: Array, noise: float) -> NDArray[np.int64]:
    """Rows of readings far from the lines through the two before and the two behind them, which meet there. noise: of readings.

    At a corner of the motion a reading lies on one of these.
    """
    before, behind = 2.0 * z[1:-3] - z[:-4], 2.0 * z[3:-1] - z[4:]
    off = np.minimum(np.abs(z[2:-2] - before), np.abs(z[2:-2] - behind))
    far = (off > FAR * math.sqrt(5.0) * noise) & (off > ALONE * np.abs(before - behind))
    return np.flatnonzero(far) + 2


def _piece(t: Array, z: Array, held: float | None) -> tuple[Array, Array]:
    """Times and readings of a rest about their mean, only fresh ones of a held channel, without spikes."""
    kept = np.isfinite(z)
    if held:
        kept &= np.append(True, np.diff(z) != 0.0)
    t, y = t[kept], z[kept]
    if not y.size:
        return t, y
    spikes = _spikes_among(y - np.median(y))
    y = y[~spikes]
    return t[~spikes], y - y.mean() if y.size else y


def _spikes_among(y: Array) -> Mask:
    """Which readings of a rest, y (n,) about their median, are spikes: none where they are many."""
    usual = SIGMA_OF_MAD * float(np.median(np.abs(y))) or float(np.min(np.abs(y[y != 0.0]), initial=np.inf))
    spikes = np.abs(y) > SPIKE * usual
    return spikes if spikes.mean() <= 0.05 else np.zeros(y.size, dtype=np.bool_)


def _alike(pieces: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    """The first rest and those whose readings scatter as its own do: a failing sensor's do not."""
    if not pieces:
        return []
    first = float(pieces[0][1].std())
    return [p for p in pieces if first / ALIKE <= float(p[1].std()) <= first * ALIKE]


def _grown(pieces: list[tuple[Array, Array]], step: float | None) -> float:
    """By what the noise of the last rest is more than that of the first, where it is of the same kind: another range.

    A drift, a stuck sensor or a burst of noise many times the usual is no range that was switched, nor is a level between
    two steps of the readings, where they change by half a step either way. A line that the first rest has not is one: something
    beside the logger was switched on.
    """
    (_, first), (_, last) = pieces[0], pieces[-1]
    if min(first.size, last.size) < FEWEST_GROWN or not np.diff(first).any() or not np.diff(last).any():
        return 1.0
    if last.std() <= math.hypot(float(first.std()), 0.5 * (step or 0.0)):
        return 1.0
    neighbours, all_of_it = (
        _between_neighbours([last]) / _between_neighbours([first]),
        float(last.std() / first.std()),
    )
    doubt = math.sqrt(0.5 / first.size + 0.5 / last.size)  # relative, of either
    same_kind = abs(neighbours / all_of_it - 1.0) < SAME_KIND + doubt
    least = SWITCHED[0] * (1.0 + SURELY * (doubt - USUAL_DOUBT)) if doubt > USUAL_DOUBT else SWITCHED[0]
    grown = neighbours if same_kind else _by_lines(pieces)
    return grown if least < grown < SWITCHED[1] else 1.0


def _by_lines(pieces: list[tuple[Array, Array]]) -> float:
    """By what the lines of the last rest, if the first has none and the last nothing else that is new, add to the noise."""
    (lines, left), (_, first) = lines_of(pieces[-1:]), pieces[0]
    usual = float(first.std())
    if not lines or lines_of(pieces[:1])[0] or float(left[0][1].std()) > ALIKE * usual:
        return 1.0
    return math.hypot(usual, *(line.amplitude for line in lines)) / usual


def _white(z: Array) -> float:
    """Standard deviation of white noise from second differences, without what moves."""
    second = np.abs(np.diff(z, 2))
    usual = second <= 5.9 * np.median(second)
    return float(np.sqrt(np.mean(second[usual] ** 2) / 6.0)) if usual.any() else 0.0


def colour_of(pieces: Sequence[Array], interval: float) -> tuple[float, float | None]:
    """How much less coloured noise says than white noise of its size, at least 1, and its correlation time [s] or None."""
    n = sum(y.size for y in pieces)
    lags = max(min(max(y.size for y in pieces) // 4, 400), 1)
    long_enough = [y for y in pieces if y.size > lags]
    weights = np.array([y.size for y in long_enough], dtype=float)
    seen = np.stack([autocorrelation(y, lags) for y in long_enough]).T @ weights / weights.sum()
    if seen[0] < max(COLOURED, 4.0 / math.sqrt(n)):
        return 1.0, None
    factor, rho = 1.0, seen
    for _ in range(UNBIASED):
        rho = _with_mean(seen, weights.mean(), factor)
        below = np.flatnonzero(rho < 2.0 / math.sqrt(n))
        rho = rho[: int(below[0]) if below.size else rho.size]
        factor = 1.0 + 2.0 * float(rho.sum())
    clear = rho[rho > max(0.5 * rho[0], 3.0 / math.sqrt(n))]
    fall = np.polyfit(np.arange(clear.size), np.log(clear), 1)[0] if clear.size > 1 else math.log(rho[0])
    beyond = rho[-1] / math.expm1(max(-fall, 1e-3))  # of what is cut off, as it falls
    return factor + 2.0 * float(beyond), interval / max(-fall, 1e-3)


def _with_mean(rho: Array, n: float, factor: float) -> Array:
    """Autocorrelations of noise from those of pieces of n samples without their means, which wander with it.

    rho (lags,). A mean has factor / n of the variance of the noise, which its pieces miss at every lag; a sum over n - k products
    that is divided by n misses k / n besides.
    """
    lost = min(factor / n, MOST_LOST)
    return lost + rho * (1.0 - lost) / (1.0 - np.arange(1, rho.size + 1) / n)


def _between_neighbours(pieces: Sequence[Array]) -> float:
    """Standard deviation of the noise by which readings differ from the ones before."""
    changes = np.concatenate([np.diff(y) for y in pieces])
    return math.sqrt(0.5 * float(np.mean(changes**2))) if changes.size else math.nan


def averaged_of(pieces: Sequence[Array]) -> int:
    """Of how many samples of white noise a reading is the mean, 1 of one, and where rests have few.

    The mean loses a sample of so long ago whenever it gains one: its differences are opposite at that distance.
    """
    y = max(pieces, key=len)
    if y.size < FEWEST:  # noise is opposite to itself by chance
        return 1
    lags = y.size // 3
    rho = autocorrelation(np.diff(y), lags)
    k = int(np.argmin(rho))
    others = float(np.abs(np.delete(rho, k)[: 2 * k + 4]).max())
    chance = min(
        BY_CHANCE / math.sqrt(y.size), 0.6 * abs(float(rho[k]))
    )  # the largest of many lags of a short rest
    return k + 1 if rho[k] < OPPOSITE and others < max(-0.5 * OPPOSITE, chance) else 1
