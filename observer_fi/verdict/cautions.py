"""Sentences that change how far a verdict can be trusted: traits of the logger that hide something, a model that does not fit."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from observer_fi.logs import FEWEST_STEPS, LowPass, told_filter
from observer_fi.numerics import digits, with_unit
from observer_fi.physics import COLUMNS, NOT_TESTED
from observer_fi.records import Acquisition, ChannelTraits, Isolation
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.moves.circuit import is_dead
from observer_fi.verdict.moves.of_the_day import Day
from observer_fi.verdict.testable import never_learned

UNITS = ("V", "A", "m")
MISFIT = 2.0  # times its expected NIS: the model is of another machine
LOUD = 2.0  # times the noise of the rig file
COARSE = 2.0  # steps of so many standard deviations hide what is smaller
LATE = 0.5  # samples
SELDOM = 0.5  # share of the rows that have a reading


class Part(NamedTuple):
    """One channel: its column and unit, its traits, its noise in the rig file, how many samples it is late, its filter.

    without_lines, without_mean: whether its lines, or the mean that it is, are out of what is judged. filed: whether its noise in
    the rig file is that of a logger, and neither a guess of a data sheet nor told of this logger when the rig was learned.
    """

    column: str
    unit: str
    traits: ChannelTraits
    usual: float
    late: float
    low_pass: LowPass = LowPass()
    without_lines: bool = False
    without_mean: bool = False
    filed: bool = True


def cautions(
    known: AsLogged, isolation: Isolation, rate_hz: float, left_out_s: float = 0.0
) -> tuple[str, ...]:
    """What to say of a log and its verdict, none of an ideal logger on a rig that is the rig file's.

    left_out_s: of the begin of the log, that no filter took [s].
    """
    found = [*_of_the_model(isolation)]
    if left_out_s:
        found.append(
            f"the log begins within a start, while the supply limits the servo: its first {with_unit(left_out_s, 's')} are left "
            "out, and what began in them is seen later; begin the log at rest"
        )
    usual, learned = known.rig.file_noise_std.tolist(), not never_learned(known.rig, NOT_TESTED)
    lates, means = known.lateness, {mean.channel for mean in known.means}
    own = zip(COLUMNS.items(), UNITS, usual, lates, known.low_passes, strict=True)
    for c, ((name, column), unit, noise, late, low) in enumerate(own):
        taken_out = known.lines is not None and bool(known.lines.channels[c].hz.size)
        traits = getattr(known.told, name)
        filed = learned and not _as_learned(traits, known.filed, name)
        part = Part(column, unit, traits, noise, late - min(lates), low, taken_out, c in means, filed)
        filters = [told_filter(own) for own in known.low_passes.told if own.channel == name]
        found += [*_of_readings(part, rate_hz), *_of_noise(part), *filters, *_of_time(part, rate_hz)]
    if known.offset:
        found.append(
            f"voltage_v reads {with_unit(known.offset, 'V')} more at rest than current_a explains: taken for zero offsets "
            "and taken out; zero the sensors"
        )
    if known.zero:
        found.append(
            f"current_a is {with_unit(known.zero, 'A')} off its zero, as motion in both directions shows: taken out; zero the "
            "sensor"
        )
    if known.inductance:
        found.append(
            f"voltage_v runs ahead of current_a as {with_unit(1e3 * known.inductance, 'mH')} in the winding make it: taken out "
            "of its readings; those in which the current bends from one sample to the next count as missing"
        )
    found += _of_the_day(known.day)
    step = known.told.clock.resolution_s
    if step:
        found.append(
            f"time_s is rounded to {with_unit(step, 's')}: taken for an even clock; log times with more digits"
        )
    return tuple(found)


def _as_learned(traits: ChannelTraits, filed: Acquisition | None, name: str) -> bool:
    """Whether the logger that a rig file was learned through had as much noise."""
    return filed is not None and traits.as_white <= LOUD * getattr(filed, name).as_white


def _of_the_day(day: Day) -> Iterator[str]:
    shares = {
        "voltage_v reads": (day.voltage, "more", "less", "calibrate it, or learn the motor's Km anew"),
        "current_a reads": (day.current, "more", "less", "calibrate it"),
        "the winding has": (day.winding, "more resistance", "less resistance", "a warm one has"),
        "the servo has": (day.gains, "more gain", "less gain", "learn the rig anew where it is so every day"),
    }
    for what, (share, more, less, then) in shares.items():
        if share != 1.0:
            by = with_unit(100.0 * abs(share - 1.0), "%")
            side = more if share > 1.0 else less
            yield f"{what} {by} {side} than by the rig file, as the first start shows: taken so for this log; {then}"


def _of_the_model(isolation: Isolation) -> Iterator[str]:
    fit = isolation.consistency
    if (
        isolation.verdict.label != NOT_TESTED
        and not is_dead(isolation.verdict)
        and fit.nis_mean > MISFIT * fit.nis_expected
    ):
        yield (
            f"no hypothesis describes this machine as well as its sensors can tell (normalised innovation squared "
            f"{digits(fit.nis_mean)}, {digits(fit.nis_expected)} expected): is it another actuator, unit or load than "
            "the rig file's? Identify the rig from healthy logs first"
        )


def _of_readings(part: Part, rate_hz: float) -> Iterator[str]:
    traits = part.traits
    if traits.travel == 0.0:
        yield (
            f"{part.column} is the same from the first sample to the last: dead, not connected or in too coarse steps; left out, "
            "so that nothing can be told that shows in it only"
        )
    if traits.update_hz:
        yield (
            f"{part.column} is held, fresh {digits(traits.update_hz)} times a second: what a fault does to it shows up to "
            f"{with_unit(1.0 / traits.update_hz, 's')} late; log it at {digits(rate_hz, 4)} Hz"
        )
    elif traits.read < SELDOM:
        share, late = digits(100.0 * traits.read, 2), with_unit(1.0 / (traits.read * rate_hz), "s")
        yield (
            f"{part.column} is read in {share} % of the rows only, or was interpolated in the others: what a fault does to it "
            f"shows up to {late} late; log it at {digits(rate_hz, 4)} Hz"
        )
    if traits.resolution and traits.travel < FEWEST_STEPS * traits.resolution:
        yield (
            f"{part.column} comes in steps of {with_unit(traits.resolution, part.unit)} and covers "
            f"{traits.travel / traits.resolution:.0f} of them: left out, so that nothing can be told that shows in it only; "
            "choose a finer range or more digits"
        )
    elif traits.resolution and traits.resolution > COARSE * max(traits.noise_std, part.usual):
        yield (
            f"{part.column} comes in steps of {with_unit(traits.resolution, part.unit)}, more than its noise: what is smaller "
            "shows only once it has added up; choose a finer range or more digits"
        )


def _of_noise(part: Part) -> Iterator[str]:
    traits = part.traits
    if traits.grown > 1.0:
        yield (
            f"the noise of {part.column} grows {digits(traits.grown, 2)} times from the first rest to the last: taken for "
            "another range, and the larger one for the noise of the whole log; keep one range"
        )
    if traits.share:
        yield (
            f"the noise of {part.column} grows with its reading, by {digits(100.0 * traits.share, 2)} % of it: what it is near "
            "the largest is taken for the whole log; look for what is switched, or for a gain that is not steady"
        )
    elif traits.moving > 1.0:
        yield (
            f"the noise of {part.column} is {digits(traits.moving, 2)} times larger in motion than at rest, as that of brushes "
            "or of a converter is: the larger one is taken for the whole log; shield the sensor or filter all channels alike"
        )
    lines = ", ".join(
        f"{digits(line.hz, 4)} Hz ({with_unit(line.amplitude, part.unit)})" for line in sorted(traits.lines)
    )
    if lines and part.without_lines:
        yield f"{part.column} carries periodic disturbances at {lines}: taken out of it; shield or ground it"
    if not traits.as_white > LOUD * part.usual:
        return
    if math.isfinite(part.low_pass.corner_hz):
        yield (
            f"{part.column} without its filter has a noise of {with_unit(traits.noise_std, part.unit)}: small faults do not "
            "show in it, others later"
        )
        return
    if lines and not part.without_lines:
        why, cure = f"carries periodic disturbances at {lines}", "shield or ground it"
    elif traits.correlation_s:
        why, cure = (
            f"has noise that wanders over {with_unit(traits.correlation_s, 's')}",
            "look for its source",
        )
    elif not part.filed:
        return
    else:
        why, cure = f"has a noise of {with_unit(traits.noise_std, part.unit)}", "look for its source"
    yield (
        f"{part.column} {why}, and tells as little as with {digits(traits.as_white / part.usual, 2)} times the noise of the "
        f"rig file: small faults do not show in it, others later; {cure}"
    )


def _of_time(part: Part, rate_hz: float) -> Iterator[str]:
    if part.without_mean:
        yield f"{part.column} is a running mean of {part.traits.averaged} samples: what it is the mean of was taken; log that"
    elif part.traits.averaged > 1:
        yield (
            f"{part.column} is a mean of the last {part.traits.averaged} samples: what a fault does to it shows up to "
            f"{with_unit(part.traits.averaged / rate_hz, 's')} late; log it without"
        )
    elif part.late >= LATE:
        yield (
            f"{part.column} is {with_unit(part.late / rate_hz, 's')} later than the other channels: set right; log all "
            "channels at one time"
        )
